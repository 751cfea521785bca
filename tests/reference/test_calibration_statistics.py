"""P-values of ranks are right, by simulation."""

import numpy as np
import pytest
from numpy.random import default_rng
from reference.calibration_statistics import uniformity


@pytest.mark.parametrize("size, p", [(40, 0.1), (150, 0.01)])
def test_uniform_ranks_have_a_small_p_value_as_often_as_it_says(size, p):
    """4 standard errors: a false alarm in 16,000 runs."""
    rng, n_runs = default_rng(11), 4000
    p_values = [uniformity(ranks) for ranks in rng.uniform(size=(n_runs, size))]
    share = np.mean(np.array(p_values) <= p)
    standard_error = np.sqrt(p * (1.0 - p) / n_runs)
    # Counts are whole numbers, so that the share is a little below p.
    assert 0.8 * p - 4.0 * standard_error < share < p + 4.0 * standard_error
