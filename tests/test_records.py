"""Records as bytes: exact, whole, and nothing in them that could run."""

import json
from functools import partial
from io import BytesIO
from zipfile import BadZipFile

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.model.ladder import require_models
from bayes_toe.records import fingerprint, packed, unpacked
from bayes_toe.seeds import LARGEST_SEED, generator, root_seed
from bayes_toe.workers import Failed

SUBJECT = Subject("S01", [0.0, 0.3], [0.3, 0.0], [20, 15], [50, 50])


def test_everything_comes_back_to_the_bit():
    values = {
        "numbers": (0.1 + 0.2, -0.0, float("inf"), 3, True, None, "ä\n\u202e"),
        ("a", 1): [np.float32(0.1), np.int64(2**62), np.array([np.nan, -0.0]), np.empty((2, 0), np.int32)],
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


@pytest.mark.parametrize("name", ["subprocess:Popen", "bayes_toe.workers:run_jobs", "bayes_toe.workers:os", "os:system"])
def test_only_records_of_this_package_are_made(name):
    body = BytesIO()
    np.savez(body, text=np.array(json.dumps({"record": name, "fields": {"args": "true"}})))
    with pytest.raises(InputError, match=f"{name} is not a record of this package"):
        unpacked(body.getvalue())


def test_a_fingerprint_tells_every_argument_apart():
    other = Subject("S01", [0.0, 0.3], [0.3, 0.0], [20, 16], [50, 50])
    models = require_models("parts")
    calls = [partial(max, one, seed=seed, model=model) for one in (SUBJECT, other) for seed in (1, 2) for model in models]
    calls += [partial(min, SUBJECT, seed=1, model=models[0]), partial(max, SUBJECT, seed=1.0, model=models[0])]
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
        with pytest.raises(InputError, match=r"seed=.*: allowed is a whole number from 0 to 2") as caught:
            call()
        assert "\n" not in str(caught.value)


def test_integers_of_numpy_are_seeds_and_none_is_fresh():
    assert root_seed(np.int64(7)) == 7
    assert type(root_seed(np.uint8(7))) is int
    assert root_seed(LARGEST_SEED) == LARGEST_SEED
    assert generator(np.int32(7), "a").random() == generator(7, "a").random()
    assert 0 <= root_seed(None) < 2**32
    assert len({root_seed(None) for _ in range(5)}) > 1
