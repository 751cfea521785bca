"""P-values of ranks are right, by simulation."""

import numpy as np
import pytest
from numpy.random import default_rng
from reference.calibration_statistics import POINTS, counts_below, uniformity
from scipy.stats import binom


def rarest_tail(values):
    """The smallest tail probability of the counts below each point."""
    counts = counts_below(values)
    size = len(values)
    return np.min([binom.cdf(counts, size, POINTS), binom.sf(counts - 1, size, POINTS)])


@pytest.mark.parametrize("power", [1.0, 1.1, 1.2])
def test_the_p_value_is_the_share_of_uniform_numbers_that_deviate_as_far(power):
    """A power above 1 makes the numbers less uniform.

    The tolerance is 4 standard errors: a false alarm in 5,000 runs.
    """
    rng = default_rng(11)
    n_sets = 4000
    values = rng.uniform(size=150) ** power
    tails = [rarest_tail(numbers) for numbers in rng.uniform(size=(n_sets, 150))]
    # Tails that are equal but for rounding are counted.
    share = np.mean(np.less_equal(tails, rarest_tail(values) * (1.0 + 1e-9)))
    p_value = uniformity(values)
    error = np.sqrt(p_value * (1.0 - p_value) / n_sets)
    assert share == pytest.approx(p_value, abs=4.0 * error)
