"""The batched ascent on a surface whose maxima are known, and on posteriors.

The maxima of posteriors are compared with those of a general optimiser.
"""

import definitions
import numpy as np
import pytest
from numpy.random import default_rng
from reference.hard_cases import hard_cases
from scipy.optimize import minimize

from bayes_toe.inference.fitted import find_maxima
from bayes_toe.inference.maxima import Expansion, ascend
from bayes_toe.model.paper_model import paper_posterior

CASES = hard_cases()


def saddle(x, index):
    """Value, slopes and minus second derivatives of a^2 - a^4 - b^2.

    The surface has a saddle at 0 and maxima at a = +-1/sqrt(2).
    """
    a, b = x.T
    value = a**2 - a**4 - b**2
    slopes = np.stack([2 * a - 4 * a**3, -2 * b], axis=-1)
    curvature = np.zeros((len(x), 2, 2))
    curvature[:, 0, 0] = 12 * a**2 - 2
    curvature[:, 1, 1] = 2.0
    return Expansion(value, slopes, curvature)


def test_a_saddle_is_left_uphill():
    # Two of the starts are next to the ridge between the maxima, where Newton's step leads to the
    # saddle.
    result = ascend(saddle, np.array([[1e-6, 0.5], [-1e-6, 0.5], [0.3, 0.5]]))
    assert np.abs(result.x[:, 0]) == pytest.approx([0.5**0.5] * 3, abs=1e-6)


@pytest.mark.parametrize("name", ["funnel", "maximum on gamma = 1", "400 pairs with 3 trials"])
def test_scoring_is_never_beaten_by_a_general_optimiser(name):
    posterior = paper_posterior(CASES[name])
    maxima = find_maxima(posterior)  # the highest maximum first
    highest, *_ = maxima.value
    simplex = {"maxiter": 4000, "xatol": 1e-8, "fatol": 1e-9}

    def minus_log_density(x):
        return -posterior.log_density(x)[0]

    for start in posterior.sample_prior(default_rng(1), 5):
        rival = minimize(minus_log_density, start, method="Nelder-Mead", options=simplex)
        assert highest >= -rival.fun - 1e-7  # nats
    # The gain that a further Newton step would have.
    _, (gradient,) = definitions.computed_gradient(posterior, maxima.x[:1])
    step = np.linalg.solve(maxima.curvature[0], gradient)
    assert gradient @ step < 1e-7


def test_maxima_with_the_prior_mean_on_either_side_are_both_found():
    """Without any 'equal', mu1 (the first coordinate) may be below or above the stimuli."""
    maxima = find_maxima(paper_posterior(CASES["all different"]))
    assert maxima.x[:, 0].min() < 0 < maxima.x[:, 0].max()
    assert list(maxima.value) == sorted(maxima.value, reverse=True)
