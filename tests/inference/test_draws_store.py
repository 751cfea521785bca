"""Draws in a Zarr store: the same as in a file, read in parts, whole or not at all, and nobody else's folder."""

import json
import os
import shutil
import subprocess
import sys

import pytest
import xarray as xr
from commands import inside
from conftest import grouped_csv
from processes import save_on_a_full_disk

import bayes_toe as bt
from bayes_toe.data.stores import SEAL
from bayes_toe.errors import InputError, OutputError

zarr = pytest.importorskip("zarr", "3.1")


@pytest.fixture(scope="module")
def made(analysis, tmp_path_factory):
    return analysis.draws.save(tmp_path_factory.mktemp("zarr") / "posterior.zarr")


@pytest.fixture
def store(made, tmp_path):
    return shutil.copytree(made, tmp_path / "posterior.zarr")


def content(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def flip(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(data)


def test_store_and_file_hold_the_same(made, analysis, tmp_path):
    there, here = bt.load(made), bt.load(analysis.draws.save(tmp_path / "posterior.nc"))
    assert {"log_likelihood", "posterior_predictive"} <= set(there.tree.children)
    xr.testing.assert_identical(there.tree.load(), here.tree)
    assert (there.parameters, there.attrs, there.names) == (here.parameters, here.attrs, ("A", "B", "C"))
    for group, node in here.tree.children.items():
        assert {name: one.dtype for name, one in node.variables.items()} == {
            name: one.dtype for name, one in there.tree[group].variables.items()
        }
    here.save(tmp_path / "other.zarr")
    lazy = bt.load(made)
    lazy.save(tmp_path / "third.zarr")
    assert not any(one.variable._in_memory for one in lazy.tree["posterior"].to_dataset().data_vars.values())
    assert content(made) == content(tmp_path / "other.zarr") == content(tmp_path / "third.zarr")


def test_subjects_with_other_pairs_and_other_quantities(tmp_path):
    """Chunks are of the commonest number of pairs; a quantity that a subject lacks is NaN, and stored."""
    few = [bt.Subject("a", [0.0, 0.3], [0.3, 0.0], [20, 15], [50, 50])]
    few += [bt.Subject(name, [0.0, 0.0, 0.4], [0.0, 0.4, 0.0], [45, 20, 15], [50] * 3) for name in "bc"]
    draws = bt.sample(bt.Study(few), model="free frequencies", draws=200, seed=1, workers=1)
    there = bt.load(draws.save(tmp_path / "posterior.zarr"))
    assert there.tree["posterior"].to_dataset().isnull().any().to_array().any()
    xr.testing.assert_identical(there.tree.load(), draws.tree)


def test_xarray_and_arviz_open_it_as_it_is(made):
    code = """
import sys, warnings
warnings.simplefilter("ignore")
import arviz as az, xarray as xr
tree = xr.open_datatree(sys.argv[1], engine="zarr")
one = tree["posterior"].to_dataset().sel(subject="A")
assert float(az.rhat(one)["mu1"]) < 1.01
assert len(az.summary(one)) == 8
data = az.InferenceData.from_datatree(tree) if hasattr(getattr(az, "InferenceData", None), "from_datatree") else tree
loo = az.loo(data, var_name="n_equal", pointwise=True)
assert float(loo.elpd if hasattr(loo, "elpd") else loo.elpd_loo) < 0
"""
    subprocess.run([sys.executable, "-c", code, str(made)], check=True)


def test_one_subject_reads_its_own_chunks_alone(store, analysis):
    for path in store.glob("*/*/c/0/0/*"):
        if path.name != "1":
            flip(path)
    draws = bt.load(store)
    xr.testing.assert_identical(draws["B"].group("posterior"), analysis.draws["B"].group("posterior"))
    assert draws.points("B").tolist() == analysis.draws.points("B").tolist()
    assert not any(one.variable._in_memory for one in draws.tree["posterior"].to_dataset().data_vars.values())
    for read in (draws.select, draws.points):
        with pytest.raises(InputError, match=r"posterior\.zarr: damaged: its numbers do not fit their checksums; allowed: "):
            read("A")
    with pytest.raises(InputError, match=r"posterior\.zarr: damaged: its numbers do not fit"):
        draws.save(store.with_name("again.zarr"))
    assert [path.name for path in store.parent.iterdir()] == ["posterior.zarr"]


def _document(change):
    def damage(store):
        """As somebody would who knows how stores are sealed."""
        from bayes_toe.inference.draws_store import _digest

        document = json.loads((store / "zarr.json").read_text())
        change(document["consolidated_metadata"]["metadata"], document["attributes"])
        document["attributes"][SEAL] = _digest(document)
        (store / "zarr.json").write_text(json.dumps(document))

    return damage


def _altered(store):
    text = (store / "zarr.json").read_text()
    (store / "zarr.json").write_text(text.replace('"seed": 5', '"seed": 6'))


def _no_seal(store):
    (store / "zarr.json").write_text('{"attributes": {}}')


def _linked(store):
    shutil.move(store / "posterior/q0/c/0/0/1", store / "elsewhere")
    (store / "posterior/q0/c/0/0/1").symlink_to(store / "elsewhere")


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (_altered, "damaged: it does not fit its checksum"),
        (_no_seal, "not a store of draws"),
        (_linked, "'posterior/q0' is kept in another place"),
        (lambda store: flip(store / "zarr.json"), "damaged|not a store"),
        (lambda store: flip(store / "observed_data/n_equal/c/0"), "damaged: its numbers do not fit their checksums"),
        (lambda store: flip(store / "observed_data/subject/c/0"), "damaged: its numbers do not fit their checksums"),
        (lambda store: (store / "posterior/q0/c/0/0/1").unlink(), "'posterior/q0' is not all there"),
        (lambda store: shutil.rmtree(store / "posterior/q0"), "not a store of draws that can be read"),
        (lambda store: (store / "zarr.json").unlink(), "not a store of draws"),
        (lambda store: (store / "zarr.json").write_text("[" * 60_000), "not a store of draws that can be read"),
        (_document(lambda found, _: found.update({"posterior/../x": found["posterior/q0"]})), "not a group or a variable of its own"),
        (_document(lambda found, _: found["posterior/q0"].update(zarr_format=2)), "not a group or a variable of its own"),
        (_document(lambda found, _: found["posterior/q0"]["codecs"].insert(0, {"name": "numcodecs.pickle"})), "has other codecs"),
        (_document(lambda found, _: found["posterior/q0"]["codecs"].pop()), "or no checksum"),
        (_document(lambda found, _: found["posterior/q0"].update(shape=[10**6, 10**6, 3])), "'posterior/q0' is not all there"),
        (_document(lambda found, _: found["posterior/walker"].update(shape=[10**12], chunk_grid=_one_chunk(10**12))), "bytes of variables"),
        (_document(lambda found, _: found.pop("posterior/q0")), "no q0 among the draws"),
        (_document(lambda _, attrs: attrs.update(seed="five")), "attribute seed is not a whole number"),
        (_document(lambda _, attrs: attrs.update(model="lapse")), "draws of model 'lapse'"),
    ],
)
def test_what_is_not_ours_is_refused_in_one_line(store, damage, said):
    damage(store)
    with pytest.raises(InputError, match=said) as refused:
        bt.load(store)
    assert str(store) in str(refused.value)
    assert "; allowed" in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


def _one_chunk(length):
    return {"name": "regular", "configuration": {"chunk_shape": [length]}}


def test_it_replaces_a_store_and_nothing_else(store, analysis):
    one = analysis.draws["B"]
    with pytest.raises(OutputError, match="exists, choose another name or allow to overwrite it"):
        one.save(store)
    one.save(store, overwrite=True)
    assert bt.load(store).names == ("B",)
    assert not (store / "posterior/q0/c/0/0/1").exists()
    (store / "mine.txt").write_text("m")
    before = content(store)
    with pytest.raises(OutputError, match=r"posterior\.zarr: holds something else than draws, choose another name"):
        analysis.draws.save(store, overwrite=True)
    assert content(store) == before
    assert bt.load(store).names == ("B",)  # the file of a user does not make it unreadable
    again = store.with_name("self.zarr")
    one.save(again)
    bt.load(again).save(again, overwrite=True)  # reads what it replaces
    xr.testing.assert_identical(bt.load(again).group("posterior").load(), one.group("posterior"))


@pytest.mark.parametrize("name", ["posterior.zarr", "folder"])
def test_a_folder_of_others_is_neither_replaced_nor_read(analysis, tmp_path, name):
    (tmp_path / name).mkdir()
    (tmp_path / name / "image").write_text("precious")
    with pytest.raises(OutputError, match=r"holds something else|is a folder"):
        analysis.draws.save(tmp_path / name, overwrite=True)
    with pytest.raises(InputError, match="not a store of draws; allowed"):
        bt.load(tmp_path / name)
    assert content(tmp_path) == {f"{name}/image": b"precious"}


def test_a_full_disk_leaves_nothing(made, tmp_path):
    save_on_a_full_disk(made, tmp_path / "new.zarr", 100_000)
    assert list(tmp_path.iterdir()) == []


# --- by the command line --------------------------------------------------------------------------


def test_commands_write_and_take_stores(small_study, tmp_path):
    grouped_csv(tmp_path / "study.csv", small_study.select(["A", "B"]))
    options = ("--draws", "200", "--seed", "1", "--workers", "1")
    for name in ("p.nc", "p.zarr"):
        done = inside("sample", "study.csv", "-o", name, *options, cwd=tmp_path)
        assert (done.returncode, done.stderr) == (0, "")
    assert inside("run", "study.csv", "-o", "out", "--pictures", "none", *options, cwd=tmp_path).returncode == 0
    done = inside("run", "study.csv", "-o", "out", "--store", "zarr", *options, cwd=tmp_path)
    assert (done.returncode, done.stderr.count("\n"), "already holds posterior.nc" in done.stderr) == (2, 1, True)
    done = inside("run", "study.csv", "-o", "out", "--store", "zarr", *options, "--overwrite", cwd=tmp_path)
    assert done.returncode == 0
    assert "posterior.zarr, summary.csv" in done.stdout
    assert {"posterior.zarr", "report.html"} <= set(os.listdir(tmp_path / "out"))
    assert "posterior.nc" not in os.listdir(tmp_path / "out")  # of other draws than those beside it
    files = [bt.load(tmp_path / name).tree.load() for name in ("p.nc", "p.zarr", "out/posterior.zarr")]
    xr.testing.assert_identical(files[0], files[1])
    xr.testing.assert_identical(files[0]["posterior"].to_dataset(), files[2]["posterior"].to_dataset())
    (tmp_path / "pairs.csv").write_text("s1,s2\n0,0.3\n")
    for name in ("p.nc", "p.zarr"):
        assert inside("predict", name, "pairs.csv", "-o", f"{name}.csv", cwd=tmp_path).returncode == 0
    assert (tmp_path / "p.nc.csv").read_text() == (tmp_path / "p.zarr.csv").read_text()
    assert inside("corner", "out/posterior.zarr", "-o", "corner", "--subject", "B", "--workers", "1", cwd=tmp_path).returncode == 0
    assert os.listdir(tmp_path / "corner").count("B.png") == 1
    assert not [name for name in os.listdir(tmp_path) if name.startswith(".") or name.endswith(".partial")]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("run", "STUDY", "-o", "out", "--store", "hdf"), "--store hdf: allowed: nc, zarr"),
        (("run", "STUDY", "-o", "theirs", "--store", "zarr", "--overwrite"), "posterior.zarr: holds something else than draws"),
        (("sample", "STUDY", "-o", "theirs/posterior.zarr", "--overwrite"), "posterior.zarr: holds something else than draws"),
        (("corner", "theirs/posterior.zarr", "-o", "out"), "posterior.zarr: not a store of draws"),
        (("corner", "none.zarr", "-o", "out"), "none.zarr: no such folder"),
    ],
)
def test_refusals_are_one_line_before_the_work(study_csv, tmp_path, monkeypatch, words, said):
    monkeypatch.setattr("bayes_toe.analysis._survivors", lambda *_: pytest.fail("the work began"))
    (tmp_path / "theirs" / "posterior.zarr").mkdir(parents=True)
    (tmp_path / "theirs" / "posterior.zarr" / "zarr.json").write_text('{"attributes": {}}')
    done = inside(*(study_csv if word == "STUDY" else word for word in words), cwd=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert said in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("words", [("run", "STUDY", "--store", "zarr"), ("sample", "STUDY", "-o", "p.zarr"), ("corner", "STORE")])
def test_without_the_library_one_line_names_the_extra(store, study_csv, monkeypatch, words):
    monkeypatch.setitem(sys.modules, "zarr.codecs", None)
    monkeypatch.setattr("bayes_toe.analysis._survivors", lambda *_: pytest.fail("the work began"))
    done = inside(*({"STUDY": study_csv, "STORE": store}.get(word, word) for word in words), cwd=store.parent)
    assert (done.returncode, done.stderr) == (2, "error: Zarr 3 is not installed: pip install 'bayes_toe[zarr]'\n")
