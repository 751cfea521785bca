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
    best, step = maxima.x[0], 1e-4
    hessian = np.empty((4, 4))
    for i, first in enumerate(step * np.eye(4)):
        for j, second in enumerate(step * np.eye(4)):
            corners = [best + first + second, best - first - second]
            corners += [best + first - second, best - first + second]
            heights = posterior.log_density(np.array(corners))
            hessian[i, j] = (heights[:2].sum() - heights[2:].sum()) / (4 * step**2)
    height = posterior.log_density(best)[0]
    expected = height + 2 * np.log(2 * np.pi) - 0.5 * np.linalg.slogdet(-hessian)[1]
    assert float(log_evidences[0]) == pytest.approx(expected, abs=0.01)
