"""Records as bytes, exact and whole.

Finished work that is kept, and computed again where anything is not the same; root seeds.
"""

import json
import os
import subprocess
import sys
from dataclasses import replace
from functools import partial
from io import BytesIO

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import known_observers

import bayes_toe as bt
from bayes_toe import result_store
from bayes_toe.errors import InputError, OutputError
from bayes_toe.result_store import (
    count_stored,
    discard,
    open_store,
    packed,
    unpacked,
)
from bayes_toe.seeds import generator
from bayes_toe.workers import Failed, run_jobs


def packed_text(text):
    body = BytesIO()
    np.savez(body, text=np.array(text))
    return body.getvalue()


def test_everything_comes_back_to_the_bit():
    arrays = np.float32(0.1), np.int64(2**62), np.array([np.nan, -0.0]), np.empty((2, 0), np.int32)
    plain = 0.1 + 0.2, -0.0, float("inf"), 3, True, None, "ä\n\u202e"
    values = {"numbers": plain, ("a", 1): [*arrays]}
    again = unpacked(packed(values))
    assert repr(again) == repr(values)
    assert again["a", 1][2].tobytes() == values["a", 1][2].tobytes()
    assert again["a", 1][3].dtype == np.int32


@pytest.mark.parametrize(
    "name", ["subprocess:Popen", "bayes_toe.workers:run_jobs", "bayes_toe.workers:os", "os:system"]
)
def test_only_records_of_this_package_are_made(name):
    text = json.dumps({"record": name, "fields": {"args": "true"}})
    with pytest.raises(InputError, match=f"{name} is not a record of this package"):
        unpacked(packed_text(text))


@pytest.mark.parametrize("seed", [-1, 2**63, 1.5, "1", np.float64(3.0)])
def test_what_is_no_seed_is_refused_in_one_line(small_study, seed):
    for call in (
        lambda: bt.sample(small_study, seed=seed, workers=1),
        lambda: bt.evidence(small_study, seed=seed, workers=1),
        lambda: generator(seed, "trials"),
    ):
        message = r"^seed=.*: allowed is a whole number from 0 to 2.*$"
        with pytest.raises(InputError, match=message):
            call()


@pytest.fixture
def computed(monkeypatch):
    """How many jobs are computed, call by call."""
    counts = []

    def counted(jobs, workers):
        counts.append(len(jobs))
        return run_jobs(jobs, workers)

    monkeypatch.setattr(result_store, "run_jobs", counted)
    return counts


def interrupted(monkeypatch, after):
    """Let the work end as by a signal after some jobs."""

    def stopped(jobs, workers):
        for number, result in enumerate(run_jobs(jobs, workers)):
            if number == after:
                raise KeyboardInterrupt
            yield result

    monkeypatch.setattr(result_store, "run_jobs", stopped)


@pytest.fixture(scope="module")
def few():
    return known_observers("AB")


QUICK = {"draws": 100, "workers": 1}


def test_an_interrupted_call_goes_on_to_the_same_bits(few, tmp_path, monkeypatch):
    calm = bt.run(few, seed=3, **QUICK)
    with monkeypatch.context() as patch:
        interrupted(patch, 1)
        with pytest.raises(KeyboardInterrupt):
            bt.run(few, seed=3, keep=tmp_path / "kept", **QUICK)
    assert count_stored(tmp_path / "kept") == 1
    names = []
    # With the seed that is kept there.
    resumed = bt.run(few, keep=tmp_path / "kept", progress=names.append, **QUICK)
    assert sorted(names) == ["A", "B"]
    xr.testing.assert_identical(resumed.draws.tree, calm.draws.tree)
    assert resumed.evidence.frame(full=True).equals(calm.evidence.frame(full=True))
    assert resumed.summary().equals(calm.summary())
    # Ranks of draws that differ by a rounding.
    pd.testing.assert_frame_equal(calm.summary(), calm.draws.summary(), rtol=1e-5)


def test_each_verb_takes_what_is_kept(few, tmp_path, computed):
    options = {"seed": 3, "keep": tmp_path, **QUICK}
    first, again = (bt.sample(few, model="none", **options) for _ in range(2))
    xr.testing.assert_identical(first.tree, again.tree)
    first, again = (bt.evidence(few, **options) for _ in range(2))
    assert first.frame(full=True).equals(again.frame(full=True))
    assert computed == [2, 0, 2, 0]


def test_nothing_else_is_taken(few, tmp_path, computed):
    half = replace(few["B"], n_yes=few["B"].n_yes // 2)
    calls = [
        (few, {}),
        (few, {"seed": 4}),
        (few, {"model": "constant-error"}),
        (few, {"prior": "paper"}),
        (replace(few, subjects=(few["A"], half)), {}),
    ]
    for study, changes in calls:
        bt.sample(study, **{"model": "none", "seed": 3, "keep": tmp_path, **QUICK, **changes})
    assert computed == [2, 2, 2, 2, 1]


def test_other_versions_are_computed_again(few, tmp_path, monkeypatch, computed):
    for versions in (("1",), ("1",), ("2",)):
        monkeypatch.setattr(result_store, "versions", lambda versions=versions: versions)
        bt.sample(few, model="none", seed=3, keep=tmp_path, **QUICK)
    assert computed == [2, 0, 2]


ODD = [
    "{}[",
    '{"record": "bayes_toe.data.study:Subject", "fields": {"age": 7}}',
    '{"array": 7}',
    '{"record": "os:system", "fields": {}}',
]


def test_a_damaged_or_foreign_result_is_computed_again(few, tmp_path, computed):
    """Also a whole file: a program that was changed meanwhile, or somebody, has written it."""
    words = {"model": "none", "seed": 3, "keep": tmp_path, **QUICK}
    bt.sample(few, **words)
    file = next(tmp_path.glob("*.result"))
    content = file.read_bytes()
    for other in (content[: len(content) // 2], b"", *map(packed_text, ODD)):
        file.write_bytes(other)
        del computed[:]
        bt.sample(few, **words)
        assert computed == [1]
        assert file.read_bytes() == content


def test_a_failed_job_is_not_kept(tmp_path, monkeypatch):
    results = [(0, Failed("died")), (1, 8)]
    monkeypatch.setattr(
        result_store, "run_jobs", lambda jobs, workers: (result for result in results)
    )
    jobs = [partial(pow, 2, 2), partial(pow, 2, 3)]
    with open_store(tmp_path) as store:
        finished = store.work(jobs, 1, None, [("a",), ("b",)])
    assert list(finished) == [8]
    assert dict(finished.failed) == {0: Failed("died")}
    assert count_stored(tmp_path) == 1


OPENS = """
import os, sys
from bayes_toe.result_store import open_store
with open_store(sys.argv[1]):
    os._exit(1)
"""


def test_a_folder_in_use_is_refused_and_one_of_a_dead_process_is_not(tmp_path):
    words = [sys.executable, "-c", OPENS, str(tmp_path)]
    with open_store(tmp_path):
        refusal = subprocess.run(words, capture_output=True, text=True)
        assert f"in use by process {os.getpid()} on " in refusal.stderr.splitlines()[-1]
        assert (tmp_path / "lock").exists()  # though nothing is kept here yet
    died = subprocess.run(words, capture_output=True, text=True)
    assert (died.returncode, died.stderr) == (1, "")
    with open_store(tmp_path):
        pass


def test_what_cannot_be_done_is_refused_before_anything_is_left(few, tmp_path):
    with pytest.raises(InputError, match="nonsense"):
        bt.sample(few, model="nonsense", keep=tmp_path / "kept")
    with pytest.raises(InputError, match="seed"):
        bt.sample(few, seed=-1, keep=tmp_path / "kept")
    assert list(tmp_path.iterdir()) == []


def test_discarding_leaves_what_is_not_ours(tmp_path):
    with open_store(tmp_path) as store:
        store.work([partial(pow, 2, 2)], 1, None, [("a",)])
    (tmp_path / "note.txt").write_text("mine")
    assert count_stored(tmp_path) == 1
    discard(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["note.txt"]


def test_a_folder_without_our_mark_is_refused_and_stays(tmp_path):
    for name in ("seed", "a.result", "note.txt"):
        (tmp_path / name).write_text("mine")
    for action in (lambda: open_store(tmp_path).__enter__(), lambda: discard(tmp_path)):
        with pytest.raises(OutputError, match="holds files that this program did not write"):
            action()
    assert {path.read_text() for path in tmp_path.iterdir()} == {"mine"}


def test_a_linked_folder_and_a_linked_lock_are_refused(tmp_path):
    precious, store = tmp_path / "precious", tmp_path / "store"
    precious.mkdir()
    (precious / "seed").write_text("mine")
    store.symlink_to(precious)
    for action in (lambda: open_store(store).__enter__(), lambda: discard(store)):
        with pytest.raises(OutputError, match="is a link"):
            action()
    store.unlink()
    store.mkdir()
    (store / "lock").symlink_to(precious / "seed")
    with pytest.raises(OutputError, match="is a link"), open_store(store):
        pass
    assert (precious / "seed").read_text() == "mine"


def test_results_that_change_places_are_computed_again(few, tmp_path, computed):
    options = {"model": "none", "seed": 3, "keep": tmp_path, **QUICK}
    earlier = bt.sample(few, **options)
    first, second = tmp_path.glob("*.result")
    content = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(content)
    xr.testing.assert_identical(bt.sample(few, **options).tree, earlier.tree)
    assert computed == [2, 2]
