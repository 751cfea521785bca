"""population.nc: the same population again, to the bit; ArviZ opens it; what is damaged or something else is refused in one line."""

import json
import warnings

import numpy as np
import pytest
import xarray as xr
from populations import SIZE, made_up

import bayes_toe as bt
from bayes_toe.data.covariates import Covariates
from bayes_toe.groups import population_file
from bayes_toe.groups.population_file import load_population
from bayes_toe.groups.regressors import regressors
from bayes_toe.records import packed


@pytest.fixture(scope="module")
def found(small_study):
    who = regressors(Covariates({"group": {"A": "x", "B": "x", "C": "y"}}), small_study.names)
    return made_up(small_study, who, z=0.1 * np.random.default_rng(3).standard_normal((*SIZE, 6)))


@pytest.fixture(scope="module")
def file(found, tmp_path_factory):
    return found.save(tmp_path_factory.mktemp("nc") / "population.nc")


def test_it_comes_back_to_the_bit(found, file):
    again = bt.load(file)
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
    assert np.array_equal(
        drawn["eta"].sel(subject="B", parameter="width").values, found.chains.eta[:, :, 1, 2]
    )
    assert np.allclose(np.log(drawn["width"].sel(subject="B").values), found.chains.eta[:, :, 1, 2])
    assert np.array_equal(
        drawn["correlation"].sel(parameter="mu1", other="gamma").values,
        found.chains.correlation[..., 0, 1],
    )
    assert np.array_equal(
        drawn["new_subject"].sel(quantity="gain").values,
        found.quantities(found.new_subject())["gain"],
    )
    assert json.loads(tree.attrs["settings"])["hyperprior"]["gamma"]["sd_scale"] == 1.0
    assert (tree.attrs["seed"], tree.attrs["model"], tree.attrs["converged"]) == (
        0,
        "predictive update",
        1,
    )
    assert tree.attrs["regressors"] == "group y against x"
    tree.close()


def test_of_a_large_group_quantities_of_subjects_are_thinned(found, tmp_path, monkeypatch):
    monkeypatch.setattr(population_file, "MOST_DRAWS", 200)
    monkeypatch.setattr(population_file, "AFFORDABLE", 100)
    again = bt.load(found.save(tmp_path / "large.nc"))
    assert packed(again) == packed(found)
    with xr.open_datatree(tmp_path / "large.nc") as tree:
        assert "gain" not in tree["posterior"]
        assert tree["posterior_predictive"]["gain"].dims == ("chain", "draw", "subject")
        assert tree["posterior_predictive"]["gain"].shape[1] < found.chains.mean.shape[1]
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
            load_population(path)
        assert str(refused.value).count("\n") == 0
