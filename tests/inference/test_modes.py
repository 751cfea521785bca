"""Maxima: against a general optimiser, several of them, and none."""

import numpy as np
import pytest
from reference.hard_cases import hard_cases
from scipy.optimize import minimize

from bayes_toe.inference.maxima import find_maxima
from bayes_toe.model.ladder import posterior_of

CASES = hard_cases()


@pytest.mark.parametrize("name", ["funnel", "maximum on gamma = 1", "guessing at 0.5", "400 pairs with 3 trials"])
def test_newton_is_never_beaten_by_a_general_optimiser(name):
    posterior = posterior_of(CASES[name])
    found = find_maxima(posterior)
    assert found.arrived
    simplex = {"maxiter": 4000, "xatol": 1e-8, "fatol": 1e-9}
    rivals = [
        -minimize(lambda x: -posterior.log_density(x)[0], s, method="Nelder-Mead", options=simplex).fun for s in posterior.starts()[::4]
    ]
    assert found.value[0] >= max(rivals) - 1e-7
    _, gradient = posterior.gradient(found.x[:1])
    assert np.linalg.eigvalsh(found.curvature[0])[0] > 0
    step = np.linalg.solve(found.curvature[0], gradient[0])
    assert gradient[0] @ step < 1e-9


def test_two_maxima_are_both_found():
    found = find_maxima(posterior_of(CASES["all different"]))
    assert len(found.x) >= 2
    assert found.x[:, 0].min() < 0 < found.x[:, 0].max()
    assert list(found.value) == sorted(found.value, reverse=True)


def test_a_maximum_that_does_not_exist_is_not_claimed():
    # A perfect observer's density rises without end toward gamma = 0.
    assert not find_maxima(posterior_of(CASES["perfect observer"])).arrived
