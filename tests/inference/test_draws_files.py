"""Files of draws: whole or not at all, and damaged or foreign ones refused in one line."""

import contextlib
import random
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from commands import refused
from processes import save_on_a_full_disk

import bayes_toe as bt
from bayes_toe.errors import InputError, OutputError
from bayes_toe.inference import draws_file


@pytest.fixture(scope="module")
def saved(analysis, tmp_path_factory):
    """A file of draws."""
    return analysis.draws.save(tmp_path_factory.mktemp("saved") / "posterior.nc")


@pytest.fixture
def path(saved, tmp_path):
    """A file that a test may damage."""
    return Path(shutil.copy(saved, tmp_path))


def content(folder):
    return {
        file.relative_to(folder).as_posix(): file.read_bytes()
        for file in folder.rglob("*")
        if file.is_file()
    }


def flip(file, index=None):
    data = bytearray(file.read_bytes())
    data[len(data) // 2 if index is None else index] ^= 4
    file.write_bytes(data)


# --- What is stored, and what follows from it -----------------------------------------------------


def test_natural_parameters_are_stored_and_all_else_follows(saved, analysis):
    loaded, draws = bt.load(saved), analysis.draws
    assert set(loaded.tree.children) == {
        "posterior",
        "sample_stats",
        "observed_data",
        "constant_data",
    }
    assert set(loaded.group("posterior").data_vars) == {"mu1", "sigma_p", "sigma_l", "q0"}
    xr.testing.assert_identical(loaded.tree.load(), draws.tree)
    assert (loaded.parameters, loaded.attrs, loaded.names) == (
        draws.parameters,
        draws.attrs,
        ("A", "B", "C"),
    )
    half_a_megabyte_each = 3 * 1.06e6
    assert saved.stat().st_size < half_a_megabyte_each
    for key in draws.posterior("B").names.all:
        assert np.array_equal(loaded.values("B", key), draws.values("B", key))
    loaded.save(saved, overwrite=True)  # a file is not locked by having been read


def test_draws_of_much_data_are_read_when_they_are_asked_for(
    saved, analysis, tmp_path, monkeypatch
):
    monkeypatch.setattr(draws_file, "AT_ONCE", 0)
    draws = bt.load(saved)
    xr.testing.assert_identical(
        draws["B"].group("posterior"), analysis.draws["B"].group("posterior")
    )
    assert np.array_equal(draws.points("C"), analysis.draws.points("C"))
    assert not any(
        variable.variable._in_memory for variable in draws.group("posterior").data_vars.values()
    )
    again = bt.load(draws.save(tmp_path / "again.nc"))
    xr.testing.assert_identical(again.tree.load(), analysis.draws.tree)


# --- What is not ours -----------------------------------------------------------------------------


def _delete(name):
    return lambda file: file.pop(name)


def _attribute(**values):
    return lambda file: file.attrs.update(values)


def _set(name, index, value):
    return lambda file: file[name].__setitem__(index, value)


def _link(name, link):
    return lambda file: file.__setitem__(name, link)


def _inside_itself(file):
    file["posterior/loop"] = file["/"]


@pytest.mark.parametrize(
    "damage, message",
    [
        (_delete("constant_data"), "no group constant_data"),
        (_delete("sample_stats/lp"), "no variable sample_stats/lp over"),
        (_delete("posterior/q0"), "no q0 among the draws"),
        (_attribute(seed="five"), "attribute seed is not a whole number"),
        (_attribute(settings="[" * 60_000), "none that draws have"),
        (
            _attribute(model="psychic"),
            "draws of model 'psychic': no such model; allowed: none, constant-error",
        ),
        (_set("observed_data/subject", 0, "Z"), "not of the same subjects"),
        (_set("observed_data/n_equal", 0, -1), "n_yes"),
        (_set("constant_data/s1", 0, 7.0), "of other pairs"),
        (_set("posterior/mu1", (0, 0, 0), np.inf), "draws of 'mu1' are no numbers"),
        (_set("posterior/mu1", ..., 1e308), "draws of 'mu1' are beyond -1e\\+100 to 1e\\+100"),
        (_set("posterior/sigma_p", ..., -1.0), "draws of 'sigma_p' are beyond 0 to"),
        (_set("posterior/q0", ..., 2.0), "draws of 'q0' are beyond 0 to 1"),
        (_set("sample_stats/lp", ..., np.nan), "draws of 'lp' are no numbers"),
        (_set("sample_stats/converged", ..., 77), "converged is neither 0 nor 1"),
        (_set("sample_stats/min_ess", ..., -3.0), "min_ess is below 0"),
        (_attribute(seed=-1), "attribute seed is not a whole number"),
        (_attribute(failed="[1"), "attribute failed is not an object of JSON"),
        (_attribute(failed='["A"]'), "attribute failed is not an object of JSON"),
        (_attribute(versions="4"), "attribute versions is not an object of JSON"),
        (_link("posterior/loop", h5py.SoftLink("/")), "'loop' in 'posterior' is a link"),
        (_link("posterior/other", h5py.ExternalLink("p.nc", "/x")), "'other' in 'posterior' is a"),
        (_link("extra", h5py.SoftLink("/extra")), "'extra' is a link"),
        (_inside_itself, "'loop' in 'posterior' is a group"),
    ],
)
def test_a_file_of_what_draws_are_not_is_refused_in_one_line(path, damage, message):
    with h5py.File(path, "r+") as file:
        damage(file)
    one_line(path, message)


def one_line(path, message):
    with pytest.raises(InputError, match=message) as refused:
        bt.load(path).points("A")
    assert str(path) in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


def test_changed_bytes_are_refused_in_one_line_or_harmless(path):
    content_before = path.read_bytes()
    random_bytes = random.Random(1)
    for i in range(40):
        changed = bytearray(content_before)
        end = len(content_before) if i % 2 else 20_000
        for _ in range(3):
            changed[random_bytes.randrange(end)] = random_bytes.randrange(256)
        path.write_bytes(changed)
        with contextlib.suppress(InputError):
            bt.load(path).summary()


def test_a_damaged_file_is_refused_in_one_line(path):
    with h5py.File(path) as file:
        index = file["posterior/q0"].id.get_chunk_info(0).byte_offset
    flip(path, index + 100)
    one_line(path, "damaged: its numbers do not fit their checksums")
    path.write_bytes(path.read_bytes()[:10_000])
    one_line(path, "not a NetCDF file that can be read")


# --- Whole or not at all, and nobody else's -------------------------------------------------------


def test_a_full_disk_is_an_error_and_leaves_nothing(saved, tmp_path):
    """HDF5 itself ends the process with a segmentation fault here."""
    save_on_a_full_disk(saved, tmp_path / "posterior.nc", 50_000)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_of_others_is_neither_replaced_nor_read(analysis, tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "image").write_text("precious")
    with pytest.raises(OutputError, match="is a folder"):
        analysis.draws.save(folder, overwrite=True)
    with pytest.raises(InputError, match="folder: not a file; allowed"):
        bt.load(folder)
    assert content(tmp_path) == {"folder/image": b"precious"}


def test_more_draws_than_a_file_is_written_from_are_refused_with_the_way_out(
    study_csv, tmp_path, monkeypatch
):
    monkeypatch.setattr(draws_file, "LARGEST", 10**6)
    monkeypatch.setattr("bayes_toe.analysis._survivors", lambda *_: pytest.fail("the work began"))
    message = "allowed in a NetCDF file: 0.001 GB; fewer --draws, or files of some subjects each"
    assert message in refused("sample", study_csv, "-o", "posterior.nc", cwd=tmp_path)
