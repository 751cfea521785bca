"""Results that are stored: taken to the bit, and computed again where anything is not the same."""

import pickle
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import known_observers

import bayes_toe as bt
from bayes_toe import result_store
from bayes_toe.errors import InputError, NumericalError, OutputError
from bayes_toe.result_store import discard, run_stored, stored_files
from bayes_toe.seeds import generator
from bayes_toe.workers import run_jobs


@pytest.mark.parametrize("seed", [-1, 2**63, 1.5, "1", np.float64(3.0)])
def test_what_is_no_seed_is_refused_in_one_line(small_study, seed, tmp_path):
    for call in (
        lambda: bt.sample(small_study, seed=seed, workers=1, keep=tmp_path / "kept"),
        lambda: bt.evidence(small_study, seed=seed, workers=1),
        lambda: generator(seed, "trials"),
    ):
        message = r"^seed=.*: allowed is a whole number from 0 to 2.*$"
        with pytest.raises(InputError, match=message):
            call()
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def computed(monkeypatch):
    """How many jobs are computed, call by call."""
    counts = []

    def counted(jobs, workers):
        counts.append(sum(len(job.args[-1]) for job in jobs))
        return run_jobs(jobs, workers)

    monkeypatch.setattr(result_store, "run_jobs", counted)
    return counts


def interrupted(jobs, workers):
    """The work ends as by a signal after one batch."""
    yield next(run_jobs(jobs, workers))
    raise KeyboardInterrupt


@pytest.fixture(scope="module")
def few():
    return known_observers("AB")


QUICK = {"draws": 100, "workers": 1}
NONE = {"model": "none", "seed": 3, **QUICK}


def test_an_interrupted_call_goes_on_to_the_same_bits(few, tmp_path, monkeypatch):
    calm = bt.run(few, seed=3, **QUICK)
    with monkeypatch.context() as patch:
        patch.setattr(result_store, "run_jobs", interrupted)
        patch.setattr("bayes_toe.analysis.BATCH", 1)
        with pytest.raises(KeyboardInterrupt):
            bt.run(few, seed=3, keep=tmp_path / "kept", **QUICK)
    assert len(stored_files(tmp_path / "kept")) == 1
    names = []
    # With the seed that is stored there.
    resumed = bt.run(few, keep=tmp_path / "kept", progress=names.append, **QUICK)
    assert sorted(names) == ["A", "B"]
    xr.testing.assert_identical(resumed.draws.tree, calm.draws.tree)
    assert resumed.evidence.frame(full=True).equals(calm.evidence.frame(full=True))
    assert resumed.summary().equals(calm.summary())
    # Ranks of draws that differ by a rounding.
    pd.testing.assert_frame_equal(calm.summary(), calm.draws.summary(), rtol=1e-5)


def test_only_the_same_job_is_taken(few, tmp_path, monkeypatch, computed):
    half = replace(few["B"], n_yes=few["B"].n_yes // 2)
    other_counts = replace(few, subjects=(few["A"], half))
    calls = [(few, {}), (few, {}), (few, {"seed": 4}), (few, {"model": "constant-error"})]
    calls += [(few, {"prior": "paper"}), (other_counts, {})]
    for study, changes in calls:
        bt.sample(study, **{**NONE, "keep": tmp_path, **changes})
    monkeypatch.setattr(result_store, "versions", lambda: ("other",))
    bt.sample(few, keep=tmp_path, **NONE)
    assert computed == [2, 0, 2, 2, 2, 1, 2]


class Call:
    """A pickle of it calls a function when it is read."""

    def __init__(self, function, *arguments):
        self.call = function, arguments

    def __reduce__(self):
        return self.call


def foreign(value):
    return pickle.dumps({"seed": 3, "result": value})


@pytest.mark.parametrize(
    "content",
    [b"", b"cut", pickle.dumps(3), foreign(Call(print)), foreign(Call(run_jobs, [], 1))],
    ids=["empty", "cut", "no record", "a function", "a function of ours"],
)
def test_a_damaged_or_foreign_file_is_computed_again(few, tmp_path, computed, content):
    first = bt.sample(few, keep=tmp_path, **NONE)
    file = stored_files(tmp_path)[0]
    original = file.read_bytes()
    if content == b"cut":
        content = original[: len(original) // 2]
    file.write_bytes(content)
    again = bt.sample(few, keep=tmp_path, **NONE)
    xr.testing.assert_identical(again.tree, first.tree)
    assert computed == [2, 1]
    assert file.read_bytes() == original


FAILURE = NumericalError("too large")


def cubes(numbers):
    """The cube of each number; 9 fails."""
    results = (np.array(numbers, dtype=object) ** 3).tolist()
    if 9 in numbers:
        results[numbers.index(9)] = FAILURE
    return results


def stored_cubes(numbers, folder, **options):
    settings = {"seed": 1, "folder": folder, "workers": 1, "progress": None}
    return run_stored(cubes, numbers, list(map(str, numbers)), **settings | options)


def test_each_result_of_a_batch_is_stored_but_that_of_a_failed_job(tmp_path):
    heard = []
    assert stored_cubes([9, 2], tmp_path, batch=8, progress=heard.append) == [FAILURE, 8]
    assert heard == ["9", "2"]
    assert len(stored_files(tmp_path)) == 1
    assert stored_cubes([3, 2, 9], tmp_path, batch=2) == [27, 8, FAILURE]
    assert len(stored_files(tmp_path)) == 2


def test_files_of_others_stay_and_links_are_refused(tmp_path):
    folder = tmp_path / "kept"
    stored_cubes([2], folder)
    (folder / "note.result").write_text("mine")
    (file,) = stored_files(folder)
    discard(folder)
    assert [path.name for path in folder.iterdir()] == ["note.result"]
    file.symlink_to(folder / "note.result")
    with pytest.raises(OutputError, match="is a link"):
        stored_cubes([2], folder)
    assert (folder / "note.result").read_text() == "mine"
    with pytest.raises(OutputError, match="cannot be written"):
        stored_cubes([2], folder / "note.result")
