"""Laplace's approximation of H1, against its definition."""

import numpy as np
import pytest
from conftest import hard_and_ordinary_subjects

import bayes_toe as bt
from bayes_toe.inference.fitted import find_maxima
from bayes_toe.inference.maxima import laplace


@pytest.mark.parametrize("name", ["S07", "funnel", "stimuli spanning 10 log units"])
def test_value_is_that_of_the_definition(name):
    """The height of the maximum, and the determinant of the Hessian there by differences."""
    posterior = bt.model.paper_posterior(hard_and_ordinary_subjects()[name], bt.Prior())
    maxima = find_maxima(posterior)
    _, log_evidences = laplace(posterior.array, [maxima])
    best, steps = maxima.x[0], 1e-5 * np.eye(4)
    _, slopes_ahead = posterior.array.gradient(best + steps)
    _, slopes_backward = posterior.array.gradient(best - steps)
    hessian = (slopes_ahead - slopes_backward) / 2e-5
    height = posterior.log_density(best)[0]
    expected = height + 2 * np.log(2 * np.pi) - 0.5 * np.linalg.slogdet(-hessian)[1]
    assert float(log_evidences[0]) == pytest.approx(expected, abs=0.01)
