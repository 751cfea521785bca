"""Root seeds and the streams keyed by them."""

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.errors import InputError
from bayes_toe.seeds import LARGEST_SEED, generator, root_seed


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
