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
from itertools import product
from zipfile import BadZipFile

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import known_observers

import bayes_toe as bt
from bayes_toe import result_store
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError, OutputError
from bayes_toe.model.models import MODEL_NAMES
from bayes_toe.result_store import (
    count_stored,
    discard,
    fingerprint,
    open_store,
    packed,
    unpacked,
)
from bayes_toe.seeds import LARGEST_SEED, generator, root_seed
from bayes_toe.workers import Failed, run_jobs

SUBJECT = Subject("S01", [0.0, 0.3], [0.3, 0.0], [20, 15], [50, 50])


def test_everything_comes_back_to_the_bit():
    values = {
        "numbers": (0.1 + 0.2, -0.0, float("inf"), 3, True, None, "ä\n\u202e"),
        ("a", 1): [
            np.float32(0.1),
            np.int64(2**62),
            np.array([np.nan, -0.0]),
            np.empty((2, 0), np.int32),
        ],
    }
    again = unpacked(packed(values))
    assert repr(again) == repr(values)
    assert again["a", 1][2].tobytes() == values["a", 1][2].tobytes()
    assert again["a", 1][3].dtype == np.int32


def test_a_record_is_made_again_from_what_it_is_made_from():
    again = unpacked(packed((SUBJECT, Failed("why"))))
    assert isinstance(again[0], Subject)
    assert again[0].n_yes.tolist() == [20, 15]
    assert again[1] == Failed("why")


@pytest.mark.parametrize("value", [object(), {1, 2}, max, lambda: 0, np.array([object()])])
def test_what_is_neither_record_nor_plain_is_refused(value):
    with pytest.raises((TypeError, ValueError)):
        packed(value)


def test_damage_is_noticed():
    content = packed(SUBJECT)
    middle = content.index(np.array([20, 15]).tobytes())
    for damaged in (content[:-30], content[:middle] + b"\x15" + content[middle + 1 :]):
        with pytest.raises(BadZipFile):
            unpacked(damaged)


@pytest.mark.parametrize(
    "name", ["subprocess:Popen", "bayes_toe.workers:run_jobs", "bayes_toe.workers:os", "os:system"]
)
def test_only_records_of_this_package_are_made(name):
    body = BytesIO()
    np.savez(body, text=np.array(json.dumps({"record": name, "fields": {"args": "true"}})))
    with pytest.raises(InputError, match=f"{name} is not a record of this package"):
        unpacked(body.getvalue())


def test_a_fingerprint_tells_every_argument_apart():
    other = Subject("S01", [0.0, 0.3], [0.3, 0.0], [20, 16], [50, 50])
    models = MODEL_NAMES
    calls = [
        partial(max, subject, seed=seed, model=model)
        for subject, seed, model in product((SUBJECT, other), (1, 2), models)
    ]
    calls += [
        partial(min, SUBJECT, seed=1, model=models[0]),
        partial(max, SUBJECT, seed=1.0, model=models[0]),
    ]
    assert len({fingerprint(call) for call in calls}) == len(calls)
    same = Subject("S01", [0.0, 0.3], [0.3, 0.0], [20, 15], [50, 50])
    assert fingerprint(calls[0]) == fingerprint(partial(max, same, seed=1, model=models[0]))


def test_what_has_no_name_has_no_fingerprint():
    with pytest.raises(TypeError):
        fingerprint(partial(lambda: 0))


@pytest.mark.parametrize("seed", [-1, 2**63, 1.5, "1", np.float64(3.0)])
def test_what_is_no_seed_is_refused_in_one_line(small_study, seed):
    calls = (
        lambda: bt.sample(small_study, seed=seed, workers=1),
        lambda: bt.evidence(small_study, seed=seed, workers=1),
        lambda: generator(seed, "trials"),
    )
    for call in calls:
        with pytest.raises(
            InputError, match=r"seed=.*: allowed is a whole number from 0 to 2"
        ) as caught:
            call()
        assert "\n" not in str(caught.value)


def test_integers_of_numpy_are_seeds_and_none_is_fresh():
    assert root_seed(np.int64(7)) == 7
    assert type(root_seed(np.uint8(7))) is int
    assert root_seed(LARGEST_SEED) == LARGEST_SEED
    assert generator(np.int32(7), "a").random() == generator(7, "a").random()
    assert 0 <= root_seed(None) < 2**32
    assert len({root_seed(None) for _ in range(5)}) > 1


@pytest.fixture
def computed(monkeypatch):
    """How many jobs are computed, call by call."""
    counts = []
    monkeypatch.setattr(
        result_store,
        "run_jobs",
        lambda jobs, workers: counts.append(len(jobs)) or run_jobs(jobs, workers),
    )
    return counts


def interrupted(monkeypatch, after):
    """Let the work end as by a signal after some jobs."""

    def some(jobs, workers):
        for number, found in enumerate(run_jobs(jobs, workers)):
            if number == after:
                raise KeyboardInterrupt
            yield found

    monkeypatch.setattr(result_store, "run_jobs", some)


@pytest.fixture(scope="module")
def few():
    return known_observers("AB")


QUICK = {"draws": 100, "workers": 1}


def test_an_interrupted_call_goes_on_to_the_same_bits(few, tmp_path, monkeypatch, computed):
    calm = bt.run(few, seed=3, **QUICK)
    monkeypatch.undo()
    interrupted(monkeypatch, 1)
    with pytest.raises(KeyboardInterrupt):
        bt.run(few, seed=3, keep=tmp_path / "kept", **QUICK)
    monkeypatch.undo()
    assert count_stored(tmp_path / "kept") == 1
    said = []
    resumed = bt.run(
        few, keep=tmp_path / "kept", progress=said.append, **QUICK
    )  # with the seed that is kept there
    assert sorted(said) == ["A", "B"]
    xr.testing.assert_identical(resumed.draws.tree, calm.draws.tree)
    assert resumed.evidence.frame().equals(calm.evidence.frame())
    assert resumed.summary().equals(calm.summary())
    pd.testing.assert_frame_equal(
        calm.summary(), calm.draws.summary(), rtol=1e-5
    )  # ranks of draws that differ by a rounding
    assert resumed.fits.frame().equals(calm.fits.frame())


def test_each_verb_takes_what_is_kept_and_nothing_else(few, tmp_path, computed):
    for verb in (partial(bt.sample, model="none"), bt.evidence):
        first, again = (verb(few, seed=3, keep=tmp_path, **QUICK) for _ in range(2))
        if isinstance(first, bt.Draws):
            xr.testing.assert_identical(first.tree, again.tree)
        else:
            assert first.frame().equals(again.frame())
    assert computed == [2, 0, 2, 0]
    changed = [
        partial(bt.sample, few, model="none", seed=4),
        partial(bt.sample, few, model="constant-error", seed=3),
        partial(bt.sample, few, model="none", seed=3, prior="paper"),
        partial(
            bt.sample,
            replace(few, subjects=(few["A"], replace(few["B"], n_yes=few["B"].n_yes // 2))),
            model="none",
            seed=3,
        ),
    ]
    del computed[:]
    for call in changed:
        call(keep=tmp_path, **QUICK)
    assert computed == [2, 2, 2, 1]


def test_other_versions_are_computed_again(few, tmp_path, monkeypatch, computed):
    for versions in (("1",), ("1",), ("2",)):
        monkeypatch.setattr(result_store, "versions", lambda versions=versions: versions)
        bt.sample(few, model="none", seed=3, keep=tmp_path, **QUICK)
    assert computed == [2, 0, 2]


def packed_text(text):
    body = BytesIO()
    np.savez(body, text=np.array(text))
    return body.getvalue()


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
    monkeypatch.setattr(
        result_store,
        "run_jobs",
        lambda jobs, workers: (one for one in [(0, Failed("died")), (1, 8)]),
    )
    with open_store(tmp_path) as kept:
        done = kept.work([partial(pow, 2, 2), partial(pow, 2, 3)], 1, None, [("a",), ("b",)])
        assert (list(done), dict(done.failed)) == ([8], {0: Failed("died")})
    assert count_stored(tmp_path) == 1


def test_a_folder_in_use_is_refused_and_one_of_a_dead_process_is_not(tmp_path):
    with open_store(tmp_path):
        there = "import sys; from bayes_toe.result_store import open_store\nwith open_store(sys.argv[1]): pass"
        ended = subprocess.run(
            [sys.executable, "-c", there, str(tmp_path)], capture_output=True, text=True
        )
        assert f"in use by process {os.getpid()} on " in ended.stderr.splitlines()[-1]
        assert (tmp_path / "lock").exists()  # though nothing is kept here yet
    dies = "import os, sys; from bayes_toe.result_store import open_store\nwith open_store(sys.argv[1]): os._exit(1)"
    subprocess.run([sys.executable, "-c", dies, str(tmp_path)], check=False)
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
    words = {"model": "none", "seed": 3, "keep": tmp_path, **QUICK}
    before = bt.sample(few, **words)
    first, second = sorted(tmp_path.glob("*.result"))
    contents = first.read_bytes(), second.read_bytes()
    second.write_bytes(contents[0])
    first.write_bytes(contents[1])
    xr.testing.assert_identical(bt.sample(few, **words).tree, before.tree)
    assert computed == [2, 2]
