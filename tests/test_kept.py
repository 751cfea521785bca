"""Finished work that is kept: taken where all that decides it is the same, computed again where anything is not."""

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
from bayes_toe import kept as store
from bayes_toe.errors import InputError
from bayes_toe.kept import discard, keeping, kept_in
from bayes_toe.workers import Failed, run_jobs


@pytest.fixture
def computed(monkeypatch):
    """How many jobs are computed, call by call."""
    counts = []
    monkeypatch.setattr(store, "run_jobs", lambda jobs, workers: counts.append(len(jobs)) or run_jobs(jobs, workers))
    return counts


def interrupted(monkeypatch, after):
    """Let the work end as by a signal after some jobs."""

    def some(jobs, workers):
        for number, found in enumerate(run_jobs(jobs, workers)):
            if number == after:
                raise KeyboardInterrupt
            yield found

    monkeypatch.setattr(store, "run_jobs", some)


@pytest.fixture(scope="module")
def few():
    return known_observers("AB")


QUICK = {"draws": 100, "workers": 1}


def test_an_interrupted_call_goes_on_to_the_same_bits(few, tmp_path, monkeypatch, computed, three_models):
    calm = bt.run(few, seed=3, **QUICK)
    monkeypatch.undo()
    interrupted(monkeypatch, 1)
    with pytest.raises(KeyboardInterrupt):
        bt.run(few, seed=3, keep=tmp_path / "kept", **QUICK)
    monkeypatch.undo()
    assert kept_in(tmp_path / "kept") == 1
    said = []
    resumed = bt.run(few, keep=tmp_path / "kept", progress=said.append, **QUICK)  # with the seed that is kept there
    assert sorted(said) == ["A", "B"]
    xr.testing.assert_identical(resumed.draws.tree, calm.draws.tree)
    assert resumed.evidence.frame().equals(calm.evidence.frame())
    assert resumed.summary().equals(calm.summary())
    pd.testing.assert_frame_equal(calm.summary(), calm.draws.summary(), rtol=1e-5)  # ranks of draws that differ by a rounding
    assert resumed.fits.frame().equals(calm.fits.frame())


def test_many_draws_are_put_together_in_a_store(few, tmp_path, monkeypatch):
    plain = bt.sample(few, seed=3, **QUICK)
    monkeypatch.setattr("bayes_toe.inference.draws_file.AT_ONCE", 0)
    kept = bt.sample(few, seed=3, keep=tmp_path / "kept", **QUICK)
    assert (plain.file, kept.file) == (None, tmp_path / "kept" / "posterior.zarr")
    xr.testing.assert_identical(plain.tree, kept.tree.load())


def test_each_verb_takes_what_is_kept_and_nothing_else(few, tmp_path, computed, three_models):
    verbs = [partial(bt.sample, model="symmetric"), bt.evidence, partial(bt.compare, models=["symmetric", "free frequencies"])]
    for verb in verbs:
        first, again = (verb(few, seed=3, keep=tmp_path, **QUICK) for _ in range(2))
        if isinstance(first, bt.Draws):
            xr.testing.assert_identical(first.tree, again.tree)
        else:
            assert first.frame().equals(again.frame())
    assert computed == [2, 0, 2, 0, 4, 0]
    changed = [
        partial(bt.sample, few, model="symmetric", seed=4),
        partial(bt.sample, few, model="constant bias", seed=3),
        partial(bt.sample, few, model="symmetric", seed=3, prior="paper"),
        partial(bt.sample, replace(few, subjects=(few["A"], replace(few["B"], n_yes=few["B"].n_yes // 2))), model="symmetric", seed=3),
    ]
    del computed[:]
    for call in changed:
        call(keep=tmp_path, **QUICK)
    assert computed == [2, 2, 2, 1]


def test_other_versions_are_computed_again(few, tmp_path, monkeypatch, computed):
    for versions in (("1",), ("1",), ("2",)):
        monkeypatch.setattr(store, "versions", lambda versions=versions: versions)
        bt.sample(few, model="symmetric", seed=3, keep=tmp_path, **QUICK)
    assert computed == [2, 0, 2]


def packed_text(text):
    body = BytesIO()
    np.savez(body, text=np.array(text))
    return body.getvalue()


ODD = ["{}[", '{"record": "bayes_toe.data.study:Subject", "fields": {"age": 7}}', '{"array": 7}', '{"record": "os:system", "fields": {}}']


def test_a_damaged_or_foreign_result_is_computed_again(few, tmp_path, computed):
    """Also a whole file: a program that was changed meanwhile, or somebody, has written it."""
    words = {"model": "symmetric", "seed": 3, "keep": tmp_path, **QUICK}
    bt.sample(few, **words)
    file = next(tmp_path.glob("*.kept"))
    content = file.read_bytes()
    for other in (content[: len(content) // 2], b"", *map(packed_text, ODD)):
        file.write_bytes(other)
        del computed[:]
        bt.sample(few, **words)
        assert computed == [1]
        assert file.read_bytes() == content


def test_a_failed_job_is_not_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(store, "run_jobs", lambda jobs, workers: (one for one in [(0, Failed("died")), (1, 8)]))
    with keeping(tmp_path) as kept:
        done = kept.work([partial(pow, 2, 2), partial(pow, 2, 3)], 1, None, [("a",), ("b",)])
        assert (list(done), dict(done.failed)) == ([8], {0: Failed("died")})
    assert kept_in(tmp_path) == 1


def test_a_folder_in_use_is_refused_and_one_of_a_dead_process_is_not(tmp_path):
    with keeping(tmp_path):
        there = "import sys; from bayes_toe.kept import keeping\nwith keeping(sys.argv[1]): pass"
        ended = subprocess.run([sys.executable, "-c", there, str(tmp_path)], capture_output=True, text=True)
        assert f"in use by process {os.getpid()} on " in ended.stderr.splitlines()[-1]
        assert (tmp_path / "lock").exists()  # though nothing is kept here yet
    dies = "import os, sys; from bayes_toe.kept import keeping\nwith keeping(sys.argv[1]): os._exit(1)"
    subprocess.run([sys.executable, "-c", dies, str(tmp_path)], check=False)
    with keeping(tmp_path):
        pass


def test_what_cannot_be_done_is_refused_before_anything_is_left(few, tmp_path):
    with pytest.raises(InputError, match="nonsense"):
        bt.sample(few, model="nonsense", keep=tmp_path / "kept")
    with pytest.raises(InputError, match="seed"):
        bt.sample(few, seed=-1, keep=tmp_path / "kept")
    assert list(tmp_path.iterdir()) == []


def test_discarding_leaves_what_is_not_ours(tmp_path):
    (tmp_path / "note.txt").write_text("mine")
    with keeping(tmp_path) as kept:
        kept.work([partial(pow, 2, 2)], 1, None, [("a",)])
    assert kept_in(tmp_path) == 1
    discard(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["note.txt"]
