"""Results that are stored: taken to the bit, and computed again where anything is not the same."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from conftest import few_pairs

import bayes_toe as bt
from bayes_toe import result_store
from bayes_toe.data.whole_files import unfinished
from bayes_toe.errors import InputError, NumericalError, OutputError
from bayes_toe.result_store import discard, run_stored, stored_files
from bayes_toe.seeds import generator
from bayes_toe.workers import run_jobs


@pytest.mark.parametrize("seed", [-1, 2**63, 1.5, "1", np.float64(3.0)])
def test_what_is_no_seed_is_refused_in_one_line(small_study, seed, tmp_path):
    for call in (
        lambda: bt.sample(small_study, seed=seed, keep=tmp_path / "kept"),
        lambda: bt.evidence(small_study, seed=seed),
        lambda: generator(seed, "trials"),
    ):
        message = r"^seed: found .*, allowed: a whole number from 0 to \d*$"
        with pytest.raises(InputError, match=message):
            call()
    assert list(tmp_path.iterdir()) == []


def interrupted(jobs, workers):
    """The work ends as by a signal after one batch."""
    yield next(run_jobs(jobs, workers))
    raise KeyboardInterrupt


def test_an_interrupted_call_goes_on_to_the_same_bits(tmp_path, monkeypatch):
    few = few_pairs("AB")
    calm = bt.run(few, seed=3, draws=100)
    with monkeypatch.context() as patch:
        patch.setattr(result_store, "run_jobs", interrupted)
        patch.setattr("bayes_toe.analysis.BATCH", 1)
        with pytest.raises(KeyboardInterrupt):
            bt.run(few, seed=3, keep=tmp_path, draws=100)
    assert len(stored_files(tmp_path)) == 1
    names = []
    # Without a seed: it is that of the stored results.
    resumed = bt.run(few, keep=tmp_path, progress=names.append, draws=100)
    assert sorted(names) == ["A", "B"]
    for analysis in (resumed, calm):
        del analysis.draws.tree.attrs["created_at"]
    xr.testing.assert_identical(resumed.draws.tree, calm.draws.tree)
    assert resumed.evidence.frame(full=True).equals(calm.evidence.frame(full=True))
    assert resumed.summary().equals(calm.summary())


def test_a_call_computes_the_subjects_whose_results_are_not_stored(tmp_path, monkeypatch):
    few = few_pairs("AB")
    bt.run(few, seed=3, keep=tmp_path, draws=100)
    counts = []

    def count_subjects(jobs, workers):
        counts.append(sum(len(job.args[-1]) for job in jobs))
        raise KeyboardInterrupt  # before the work

    monkeypatch.setattr(result_store, "run_jobs", count_subjects)

    def n_computed(study, **options):
        with pytest.raises(KeyboardInterrupt):
            bt.run(study, keep=tmp_path, draws=100, **options)
        return counts.pop()

    assert n_computed(few) == 0
    assert n_computed(few, seed=4) == 2
    assert n_computed(few, prior="paper") == 2
    fewer_yes = replace(few["B"], n_yes=few["B"].n_yes // 2)
    assert n_computed(replace(few, subjects=(few["A"], fewer_yes))) == 1
    monkeypatch.setattr(result_store, "versions", lambda: ("other",))
    assert n_computed(few, seed=3) == 2


class Call:
    """A pickle of it calls a function when it is read."""

    def __init__(self, function, *arguments):
        self.call = function, arguments

    def __reduce__(self):
        return self.call


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


def test_a_damaged_or_foreign_file_is_computed_again(tmp_path):
    assert stored_cubes([2, 3], tmp_path, seed=3) == [8, 27]

    first, second = stored_files(tmp_path)
    original = first.read_bytes()
    contents = [b"", original[:-9], pickle.dumps(3), second.read_bytes()]
    for call in (Call(print), Call(run_jobs, [], 1)):
        contents.append(pickle.dumps({"job": first.stem, "seed": 3, "result": call}))
    for content in contents:
        first.write_bytes(content)
        assert stored_cubes([2, 3], tmp_path, seed=3) == [8, 27]
        assert first.read_bytes() == original


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


def test_what_a_kill_during_writing_has_left_is_removed(tmp_path):
    folder = tmp_path / "kept"
    stored_cubes([2], folder)
    with unfinished(folder) as temporary:
        (temporary / "half.result").touch()
        discard(folder)
        assert not folder.exists()
