"""Files and stores of draws: whole or not at all, old ones readable, damaged ones refused in one line, and nobody else's folder."""

import json
import os
import shutil
import sys
import tarfile
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from commands import good, inside, refused
from conftest import grouped_csv
from processes import save_on_a_full_disk

import bayes_toe as bt
from bayes_toe.errors import InputError, OutputError
from bayes_toe.inference import draws_file

zarr = pytest.importorskip("zarr", "3.1")
KINDS = ["posterior.nc", "posterior.zarr"]


@pytest.fixture(scope="module")
def saved(analysis, tmp_path_factory):
    """The same draws as a file and as a store, by name."""
    folder = tmp_path_factory.mktemp("saved")
    return {name: analysis.draws.save(folder / name) for name in KINDS}


@pytest.fixture
def path(saved, tmp_path):
    """A file that a test may damage."""
    return Path(shutil.copy(saved["posterior.nc"], tmp_path))


@pytest.fixture
def store(saved, tmp_path):
    """A store that a test may damage."""
    return Path(shutil.copytree(saved["posterior.zarr"], tmp_path / "posterior.zarr"))


def content(folder):
    return {
        file.relative_to(folder).as_posix(): file.read_bytes()
        for file in folder.rglob("*")
        if file.is_file()
    }


def flip(file, at=None):
    data = bytearray(file.read_bytes())
    data[len(data) // 2 if at is None else at] ^= 4
    file.write_bytes(data)


# --- What is stored, and what follows from it -----------------------------------------------------


@pytest.mark.parametrize("name", KINDS)
def test_natural_parameters_are_stored_and_all_else_follows(saved, analysis, name):
    there, here = bt.load(saved[name]), analysis.draws
    assert set(there.tree.children) == {
        "posterior",
        "sample_stats",
        "observed_data",
        "constant_data",
    }
    assert set(there.group("posterior").data_vars) == {"mu1", "sigma_p", "sigma_l", "q0"}
    xr.testing.assert_identical(there.tree.load(), here.tree)
    assert (there.parameters, there.attrs, there.names) == (
        here.parameters,
        here.attrs,
        ("A", "B", "C"),
    )
    assert name != "posterior.nc" or saved[name].stat().st_size < 3 * 1.06e6, (
        "of a thousand draws half a megabyte a subject"
    )
    for key in here.posterior("B").names.all:
        assert np.array_equal(there.values("B", key), here.values("B", key))
    there.save(saved[name], overwrite=True)  # a file is not locked by having been read


def test_files_of_earlier_versions_are_read_where_the_model_is_still_there(tmp_path):
    """With all reported quantities, pointwise groups and a seal behind the end of the file; 2 chains of 4 draws were cut out."""
    with tarfile.open(Path(__file__).with_name("old_posteriors.tar.xz")) as archive:
        archive.extractall(tmp_path, filter="data")
    files = {file: bt.load(tmp_path / file) for file in ("old_intervals.nc", "old_update.nc")}
    for file in ("old_frequencies.nc", "old_store.zarr"):
        with pytest.raises(InputError, match=r"draws of model '.*' is retired; type: --model"):
            bt.load(tmp_path / file)
    for key, mean in json.loads((tmp_path / "expected.json").read_text()).items():
        file, subject, quantity = key.split(" ")
        if file not in files:
            continue
        draws, target = files[file], files[file].posterior(subject)
        assert draws.values(subject, quantity).mean() == pytest.approx(mean, rel=1e-12, nan_ok=True)
        assert target.quantities(draws.points(subject))[quantity] == pytest.approx(
            draws.values(subject, quantity), rel=1e-9
        )
    for draws in files.values():
        assert draws.to_arviz()["log_likelihood"]["n_equal"].shape[:2] == (2, 4)
        assert draws.study.names == ("a", "b")
        xr.testing.assert_equal(
            bt.load(draws.save(tmp_path / "again.nc", overwrite=True)).tree.load(),
            draws.tree.load(),
        )


@pytest.mark.parametrize("name", KINDS)
def test_draws_of_much_data_are_read_when_they_are_asked_for(
    saved, analysis, tmp_path, monkeypatch, name
):
    monkeypatch.setattr(draws_file, "AT_ONCE", 0)
    draws = bt.load(saved[name])
    xr.testing.assert_identical(
        draws["B"].group("posterior"), analysis.draws["B"].group("posterior")
    )
    assert np.array_equal(draws.points("C"), analysis.draws.points("C"))
    assert not any(one.variable._in_memory for one in draws.group("posterior").data_vars.values())
    for other in KINDS:
        draws.save(tmp_path / other)
        xr.testing.assert_identical(bt.load(tmp_path / other).tree.load(), analysis.draws.tree)


def test_one_subject_of_a_store_reads_its_own_chunks_alone(store, analysis):
    for file in store.glob("*/*/c/0/0/*"):
        if file.name != "1":
            flip(file)
    draws = bt.load(store)
    xr.testing.assert_identical(
        draws["B"].group("posterior"), analysis.draws["B"].group("posterior")
    )
    for read in (draws.__getitem__, draws.points):
        with pytest.raises(
            InputError,
            match=r"posterior\.zarr: damaged: its numbers do not fit their checksums; allowed: ",
        ):
            read("A")


# --- What is not ours -----------------------------------------------------------------------------


def _delete(name):
    return lambda file: file.pop(name)


def _attribute(**values):
    return lambda file: file.attrs.update(values)


def _put(name, at, value):
    return lambda file: file[name].__setitem__(at, value)


@pytest.mark.parametrize(
    ("damage", "said"),
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
        (_put("observed_data/subject", 0, "Z"), "not of the same subjects"),
        (_put("observed_data/n_equal", 0, -1), "n_yes"),
        (_put("constant_data/s1", 0, 7.0), "of other pairs"),
        (_put("posterior/mu1", (0, 0, 0), np.inf), "draws of 'mu1' are no numbers"),
    ],
)
def test_a_file_of_what_draws_are_not_is_refused_in_one_line(path, damage, said):
    with h5py.File(path, "r+") as file:
        damage(file)
    one_line(path, said)


def one_line(path, said):
    with pytest.raises(InputError, match=said) as refused:
        bt.load(path).points("A")
    assert str(path) in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


def test_a_damaged_file_is_refused_in_one_line(path):
    with h5py.File(path) as file:
        at = file["posterior/q0"].id.get_chunk_info(0).byte_offset
    flip(path, at + 100)
    one_line(path, "damaged: its numbers do not fit their checksums")
    path.write_bytes(path.read_bytes()[:10_000])
    one_line(path, "not a NetCDF file that can be read")


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (
            lambda store: (store / "zarr.json").write_text('{"attributes": {}}'),
            "not a store of draws that can be read",
        ),
        (
            lambda store: (store / "zarr.json").write_text("[" * 60_000),
            "not a store of draws that can be read",
        ),
        (lambda store: (store / "zarr.json").unlink(), "not a store of draws that can be read"),
        (
            lambda store: flip(store / "observed_data/n_equal/c/0"),
            "damaged: its numbers do not fit their checksums",
        ),
        (
            lambda store: (store / "posterior/q0/c/0/0/0").unlink(),
            "damaged: its numbers do not fit their checksums",
        ),
        (lambda store: shutil.rmtree(store / "posterior"), "allowed: a posterior.nc"),
        (lambda store: shutil.rmtree(store), "no such folder"),
    ],
)
def test_a_damaged_store_is_refused_in_one_line(store, damage, said):
    damage(store)
    one_line(store, said)


# --- Whole or not at all, and nobody else's -------------------------------------------------------


@pytest.mark.parametrize("name", KINDS)
def test_a_full_disk_is_an_error_and_leaves_nothing(saved, tmp_path, name):
    """HDF5 itself ends the process with a segmentation fault here."""
    save_on_a_full_disk(saved["posterior.nc"], tmp_path / name, 50_000)
    assert list(tmp_path.iterdir()) == []


def test_a_store_replaces_a_store_and_nothing_else(store, analysis):
    one = analysis.draws["B"]
    with pytest.raises(OutputError, match="exists, choose another name or allow to overwrite it"):
        one.save(store)
    one.save(store, overwrite=True)
    assert bt.load(store).names == ("B",)
    assert not (store / "posterior/q0/c/0/0/1").exists()
    bt.load(store).save(store, overwrite=True)  # reads what it replaces
    xr.testing.assert_identical(bt.load(store).group("posterior").load(), one.group("posterior"))
    (store / "mine.txt").write_text("m")
    before = content(store)
    with pytest.raises(
        OutputError, match=r"posterior\.zarr: holds something else than draws, choose another name"
    ):
        analysis.draws.save(store, overwrite=True)
    assert content(store) == before
    assert bt.load(store).names == ("B",)  # the file of a user does not make it unreadable


@pytest.mark.parametrize("name", ["posterior.zarr", "folder"])
def test_a_folder_of_others_is_neither_replaced_nor_read(analysis, tmp_path, name):
    (tmp_path / name).mkdir()
    (tmp_path / name / "image").write_text("precious")
    with pytest.raises(OutputError, match=r"holds something else|is a folder"):
        analysis.draws.save(tmp_path / name, overwrite=True)
    with pytest.raises(InputError, match=f"{name}: not a .* that can be read; allowed"):
        bt.load(tmp_path / name)
    assert content(tmp_path) == {f"{name}/image": b"precious"}


def test_more_draws_than_a_file_is_written_from_are_refused_with_the_way_out(
    study_csv, tmp_path, monkeypatch
):
    monkeypatch.setattr(draws_file, "LARGEST", 10**6)
    monkeypatch.setattr("bayes_toe.analysis._survivors", lambda *_: pytest.fail("the work began"))
    said = "allowed in a NetCDF file: 0.001 GB; a Zarr store takes them: -o NAME.zarr, run --store zarr"
    assert said in refused("sample", study_csv, "-o", "posterior.nc", cwd=tmp_path)


def test_commands_write_and_take_stores(small_study, tmp_path, monkeypatch, blank_pictures):
    grouped_csv(tmp_path / "study.csv", small_study.select(["B"]))
    options = ("--draws", "100", "--seed", "1", "--workers", "1")
    good("run", "study.csv", "-o", "out", "--pictures", "none", *options, cwd=tmp_path)
    shutil.copy(tmp_path / "out" / "posterior.nc", tmp_path / "p.nc")
    with monkeypatch.context() as patch:
        patch.setattr(draws_file, "AT_ONCE", 0)
        good("sample", "study.csv", "-o", "p.zarr", *options, cwd=tmp_path)
    stored = ("run", "study.csv", "-o", "out", "--store", "zarr", *options)
    assert "already holds posterior.nc" in refused(*stored, cwd=tmp_path)
    assert "posterior.zarr, summary.csv" in good(*stored, "--overwrite", cwd=tmp_path)
    assert "posterior.nc" not in os.listdir(tmp_path / "out")  # of other draws than those beside it
    one, *others = (
        bt.load(tmp_path / name).group("posterior").load()
        for name in ("p.nc", "p.zarr", "out/posterior.zarr")
    )
    for other in others:
        xr.testing.assert_identical(one, other)
    (tmp_path / "pairs.csv").write_text("s1,s2\n0,0.3\n")
    for name in ("p.nc", "p.zarr"):
        good("predict", name, "pairs.csv", "-o", f"{name}.csv", cwd=tmp_path)
    assert (tmp_path / "p.nc.csv").read_text() == (tmp_path / "p.zarr.csv").read_text()
    assert not [
        name for name in os.listdir(tmp_path) if name.startswith(".") or name.endswith(".partial")
    ]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("run", "STUDY", "-o", "theirs", "--store", "zarr", "--overwrite"),
            "posterior.zarr: holds something else than draws",
        ),
        (
            ("sample", "STUDY", "-o", "theirs/posterior.zarr", "--overwrite"),
            "posterior.zarr: holds something else than draws",
        ),
        (
            ("corner", "theirs/posterior.zarr", "-o", "out"),
            "posterior.zarr: not a store of draws that can be read",
        ),
        (("corner", "none.zarr", "-o", "out"), "none.zarr: no such folder"),
    ],
)
def test_refusals_are_one_line_before_the_work(study_csv, tmp_path, monkeypatch, words, said):
    monkeypatch.setattr("bayes_toe.analysis._survivors", lambda *_: pytest.fail("the work began"))
    (tmp_path / "theirs" / "posterior.zarr").mkdir(parents=True)
    (tmp_path / "theirs" / "posterior.zarr" / "zarr.json").write_text('{"attributes": {}}')
    assert said in refused(
        *(study_csv if word == "STUDY" else word for word in words), cwd=tmp_path
    )


@pytest.mark.parametrize(
    "words",
    [("run", "STUDY", "--store", "zarr"), ("sample", "STUDY", "-o", "p.zarr"), ("corner", "STORE")],
)
def test_without_the_library_one_line_names_the_extra(store, study_csv, monkeypatch, words):
    monkeypatch.setitem(sys.modules, "zarr.codecs", None)
    monkeypatch.setattr("bayes_toe.analysis._survivors", lambda *_: pytest.fail("the work began"))
    done = inside(
        *({"STUDY": study_csv, "STORE": store}.get(word, word) for word in words), cwd=store.parent
    )
    assert (done.returncode, done.stderr) == (
        2,
        "error: Zarr 3 is not installed: pip install 'bayes_toe[zarr]'\n",
    )
