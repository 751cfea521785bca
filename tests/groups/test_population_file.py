"""population.nc: the same population again, to the bit; ArviZ opens it; what is damaged or something else is refused in one line."""

import hashlib
import io
import json
import lzma
import sys
import warnings
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from populations import NAMES, made_up

import bayes_toe as bt
from bayes_toe.data.covariates import Covariates
from bayes_toe.groups import population_file
from bayes_toe.groups.regressors import regressors
from bayes_toe.records import packed


@pytest.fixture(scope="module")
def found(small_study):
    who = regressors(Covariates({"group": {"A": "x", "B": "x", "C": "y"}}), small_study.names)
    return made_up(small_study, who)


@pytest.fixture(scope="module")
def file(found, tmp_path_factory):
    return found.save(tmp_path_factory.mktemp("nc") / "population.nc")


def test_it_comes_back_to_the_bit(found, file):
    again = bt.load_population(file)
    assert packed(again) == packed(found)
    assert packed(again.table.rows) == packed(found.table.rows)


def test_arviz_opens_it(found, file):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # ArviZ announces its own changes
        import arviz as az

        tree = az.from_netcdf(file)
    drawn = tree["posterior"]
    assert drawn["effect"].dims == ("chain", "draw", "regressor", "parameter")
    assert drawn["regressor"].values.tolist() == ["group y"]
    assert np.array_equal(drawn["eta"].sel(subject="B", parameter="width").values, found.chains.eta[:, :, 1, 2])
    assert np.allclose(np.log(drawn["width"].sel(subject="B").values), found.chains.eta[:, :, 1, 2])
    assert np.array_equal(drawn["new_subject"].sel(quantity="gain").values, found.quantities(found.new_subject())["gain"])
    assert tree["posterior_predictive"]["asymmetry"].sel(level="group y - x").shape[1] == len(found.asymmetries.kept)
    assert json.loads(tree.attrs["settings"])["hyperprior"]["gamma"]["sd_scale"] == 1.0
    assert (tree.attrs["seed"], tree.attrs["model"], tree.attrs["converged"]) == (0, "predictive update", 1)
    assert tree.attrs["regressors"] == "group y against x"
    tree.close()


def test_of_a_large_group_quantities_of_subjects_are_thinned(found, tmp_path, monkeypatch):
    monkeypatch.setattr(population_file, "AFFORDABLE", 100)
    monkeypatch.setattr(population_file, "spaced", lambda *_: pytest.fail("asymmetries say which draws"))
    again = bt.load_population(found.save(tmp_path / "large.nc"))
    assert packed(again) == packed(found)
    with xr.open_datatree(tmp_path / "large.nc") as tree:
        assert "gain" not in tree["posterior"]
        assert tree["posterior_predictive"]["gain"].shape == (*found.asymmetries.new_subject.shape, 3)
        assert tree.attrs["thinned"]


def test_what_is_no_population_is_refused(found, file, analysis, tmp_path):
    damaged = tmp_path / "damaged.nc"
    content = bytearray(file.read_bytes())
    content[content.index(found.chains.eta[0, 0, 0, 0].tobytes())] ^= 1
    damaged.write_bytes(content)
    (tmp_path / "text.nc").write_text("population")
    other = analysis.draws.save(tmp_path / "posterior.nc")
    for path in (damaged, tmp_path / "text.nc", other, tmp_path / "none.nc", tmp_path):
        with pytest.raises(bt.InputError, match=r"allowed: a population\.nc") as refused:
            bt.load_population(path)
        assert str(refused.value).count("\n") == 0


# --- Of bayes_toe 0.1 -----------------------------------------------------------------------------


@pytest.fixture
def old(tmp_path):
    """Written by 0.1.0 (869a979): three subjects, four chains of four draws, correlations, a covariate."""
    path = tmp_path / "old.nc"
    path.write_bytes(lzma.decompress(Path(__file__).with_name("population_of_0_1.nc.xz").read_bytes()))
    return path


def test_files_of_0_1_are_read(old, tmp_path):
    found = bt.load_population(old)
    assert (found.names, found.study.names, found.study.source, found.study.synthetic) == (NAMES, ("A", "B", "C"), "old.csv", True)
    assert found.study["B"].n_trials.tolist() == [49, 50, 50]
    assert (found.left_out, found.rough, found.chains.divergent, found.chains.reason) == ({"E": "lost"}, ("B",), 2, "few")
    assert (found.settings.draws, found.settings.correlations, found.settings.prior) == (2000, True, bt.Prior())
    assert found.settings.hyperprior == bt.Hyperprior().for_study(found.study)
    assert [column.about for column in found.regressors.columns] == ["group y against x"]
    own = found.chains
    sums = [values.sum() for values in (own.scatter, own.effects, own.eta, own.z, found.unpooled)]
    assert sums == pytest.approx([64.41441601906564, 2.678, 9.432, 1.115, 4.83], rel=1e-12)
    assert found.table.some("effect")[0].q50 == pytest.approx(0.012)
    assert packed(bt.load_population(found.save(tmp_path / "again.nc"))) == packed(found)


def test_no_name_in_a_file_decides_what_is_imported(old):
    """It did: a record called bayes_toe.__main__:Regressors ran the program."""
    with h5py.File(old, "r+") as file:
        stored = file["constant_data/record"]
        content = stored[:].tobytes()
        with np.load(io.BytesIO(content[51:])) as parts:
            arrays = dict(parts)
        name, other = "bayes_toe.groups.regressors:Regressors", "bayes_toe.__main__:Regressors"
        text = str(arrays["text"]).replace(f'"{name}"', f'"{other}"'.ljust(len(name) + 2))
        body = io.BytesIO()
        np.savez(body, **arrays | {"text": np.array(text)})
        stored[:] = np.frombuffer(content[:19] + hashlib.sha256(body.getvalue()).digest() + body.getvalue(), np.uint8)
    with pytest.raises(bt.InputError, match=r"bayes_toe\.__main__:Regressors is no part of it") as refused:
        bt.load_population(old)
    assert str(refused.value).count("\n") == 0
    assert "bayes_toe.__main__" not in sys.modules


def test_nothing_is_replaced_unasked(found, file):
    before = file.read_bytes()
    with pytest.raises(bt.OutputError):
        found.save(file)
    assert file.read_bytes() == before
