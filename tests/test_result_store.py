"""Stored results: used to the bit, and computed again where anything is not the same."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from conftest import quick_study, refused

import bayes_toe as bt
from bayes_toe import result_store
from bayes_toe.data.whole_files import unfinished
from bayes_toe.errors import NumericalError, OutputError
from bayes_toe.result_store import discard, load_result, run_stored, stored_files
from bayes_toe.seeds import generator
from bayes_toe.workers import run_jobs


@pytest.mark.parametrize("seed", [-1, 2**63, 1.5, "1", np.float64(3.0)])
def test_a_wrong_seed_is_refused_in_one_line(small_study, seed, tmp_path):
    # A seed is a whole number from 0 to 2^63 - 1. Nothing is stored before the refusal.
    for call in (
        lambda: bt.sample(small_study, seed=seed, keep=tmp_path / "kept"),
        lambda: bt.evidence(small_study, seed=seed),
        lambda: generator(seed, "trials"),
    ):
        message = r"^seed: found .*, allowed: a whole number from 0 to \d*$"
        with refused(message):
            call()
    assert list(tmp_path.iterdir()) == []


def run_one_job(jobs, workers):
    """In the place of run_jobs: one job is done, and then the work ends as by Ctrl+C."""
    yield next(run_jobs(jobs, workers))
    raise KeyboardInterrupt


def test_an_interrupted_call_goes_on_to_the_same_bits(tmp_path, monkeypatch):
    study = quick_study("AB")
    expected = bt.run(study, seed=3, draws=100)
    # Two subjects make two batches. The call is interrupted after the first batch.
    with monkeypatch.context() as patch:
        patch.setattr(result_store, "run_jobs", run_one_job)
        patch.setattr("bayes_toe.analysis.BATCH", 1)
        with pytest.raises(KeyboardInterrupt):
            bt.run(study, seed=3, keep=tmp_path, draws=100)
    assert len(stored_files(tmp_path)) == 1

    # Without a seed, the call has the seed of the stored results. Times of creation may differ.
    reported_names = []
    analysis = bt.run(study, keep=tmp_path, progress=reported_names.append, draws=100)
    assert sorted(reported_names) == ["A", "B"]
    del analysis.draws.tree.attrs["created_at"]
    del expected.draws.tree.attrs["created_at"]
    xr.testing.assert_identical(analysis.draws.tree, expected.draws.tree)
    assert analysis.evidence.frame(full=True).equals(expected.evidence.frame(full=True))
    assert analysis.summary().equals(expected.summary())


def test_a_call_computes_the_subjects_whose_results_are_not_stored(tmp_path, monkeypatch):
    study = quick_study("AB")
    bt.run(study, seed=3, keep=tmp_path, draws=100)
    counts = []

    def count_subjects(jobs, workers):
        # The last argument of a job is its batch of subjects.
        counts.append(sum(len(job.args[-1]) for job in jobs))
        raise KeyboardInterrupt  # before the work

    monkeypatch.setattr(result_store, "run_jobs", count_subjects)

    def n_computed(study, **options):
        with pytest.raises(KeyboardInterrupt):
            bt.run(study, keep=tmp_path, draws=100, **options)
        return counts.pop()

    # Without a change no subject is computed again. With another seed or prior both subjects are,
    # and if only the counts of one subject change, this subject is.
    assert n_computed(study) == 0
    assert n_computed(study, seed=4) == 2
    assert n_computed(study, prior="paper") == 2
    changed_subject = replace(study["B"], n_yes=study["B"].n_yes // 2)
    assert n_computed(replace(study, subjects=(study["A"], changed_subject))) == 1
    # As if the results were stored by another version of the program.
    monkeypatch.setattr(result_store, "versions", lambda: ("other",))
    assert n_computed(study, seed=3) == 2


class Call:
    """An object whose pickle calls a function when it is read."""

    def __init__(self, function, *arguments):
        self.call = function, arguments

    def __reduce__(self):
        return self.call


ERROR_OF_9 = NumericalError("too large")


def cube_numbers(numbers):
    """The cube of each number; 9 fails."""
    results = (np.array(numbers, dtype=object) ** 3).tolist()
    if 9 in numbers:
        results[numbers.index(9)] = ERROR_OF_9
    return results


def stored_cubes(numbers, folder, **options):
    """The cubes of the numbers, each a job; cubes that the folder has are not computed again."""
    settings = {"seed": 1, "folder": folder, "workers": 1, "progress": None}
    names = list(map(str, numbers))
    return list(map(load_result, run_stored(cube_numbers, numbers, names, **settings | options)))


def test_a_damaged_or_foreign_file_is_computed_again(tmp_path):
    assert stored_cubes([2, 3], tmp_path, seed=3) == [8, 27]

    file, other_file = stored_files(tmp_path)
    original = file.read_bytes()
    # The file is empty, cut, of another kind, of another job, or calls a function when it is read.
    contents = [b"", original[:-9], pickle.dumps(3), other_file.read_bytes()]
    for call in (Call(print), Call(run_jobs, [], 1)):
        contents.append(pickle.dumps({"job": file.stem, "seed": 3, "result": call}))
    for content in contents:
        file.write_bytes(content)
        assert stored_cubes([2, 3], tmp_path, seed=3) == [8, 27]
        assert file.read_bytes() == original


def test_each_result_of_a_batch_is_stored_but_that_of_a_failed_job(tmp_path):
    # The number 9 fails, in a batch with other numbers. Jobs are named after their numbers.
    reported_names = []
    results = stored_cubes([9, 2], tmp_path, batch=8, progress=reported_names.append)
    assert results == [ERROR_OF_9, 8]
    assert reported_names == ["9", "2"]
    assert len(stored_files(tmp_path)) == 1
    assert stored_cubes([3, 2, 9], tmp_path, batch=2) == [27, 8, ERROR_OF_9]
    assert len(stored_files(tmp_path)) == 2


def test_a_stored_result_is_read_when_it_is_used(tmp_path):
    # The draws of an analysis are not in memory: they are gone with their folder.
    draws = bt.sample(quick_study("A"), seed=3, keep=tmp_path / "kept", draws=100)
    assert draws.values("A", "mu1").shape == (4, 2560)
    discard(tmp_path / "kept")
    with refused("this result is missing or damaged by now"):
        draws.values("A", "mu1")


def test_files_of_others_stay_and_links_are_refused(tmp_path):
    # A file of the user has the suffix of stored results. Then the name of a stored result is a
    # link to this file.
    folder = tmp_path / "kept"
    stored_cubes([2], folder)
    (folder / "note.result").write_text("mine")
    (file,) = stored_files(folder)
    discard(folder)
    assert [path.name for path in folder.iterdir()] == ["note.result"]

    file.symlink_to(folder / "note.result")
    with refused("is a link", OutputError):
        stored_cubes([2], folder)
    assert (folder / "note.result").read_text() == "mine"
    # A file is no folder in which results could be stored.
    with refused("cannot be written", OutputError):
        stored_cubes([2], folder / "note.result")


def test_files_that_a_killed_process_left_are_removed(tmp_path):
    # A process was killed when it had written half a file into its temporary folder.
    folder = tmp_path / "kept"
    stored_cubes([2], folder)
    with unfinished(folder) as temporary:
        (temporary / "half.result").touch()
        discard(folder)
        assert not folder.exists()
