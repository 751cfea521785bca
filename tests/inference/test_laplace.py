"""Laplace's approximation of H1, against its definition."""

import definitions
import numpy as np
import pytest
from conftest import hard_and_ordinary_subjects

import bayes_toe as bt
from bayes_toe.inference.fitted import find_maxima
from bayes_toe.inference.maxima import laplace


@pytest.mark.parametrize("name", ["S07", "funnel", "stimuli spanning 10 log units"])
def test_laplaces_evidence_is_that_of_the_definition(name):
    """The height of the maximum, and the determinant of the Hessian by differences of slopes."""
    posterior = bt.model.paper_posterior(hard_and_ordinary_subjects()[name], bt.Prior())
    maxima = find_maxima(posterior)
    _, log_evidences = laplace(posterior.array, [maxima])
    highest = maxima.x[:1]
    hessian = definitions.slopes(lambda x: definitions.computed_gradient(posterior, x)[1], highest)
    _, (log_determinant,) = np.linalg.slogdet(-hessian)
    # A normal density of four coordinates has the height (2 pi)^-2 |-H|^(1/2).
    expected = posterior.log_density(highest)[0] + 2 * np.log(2 * np.pi) - 0.5 * log_determinant
    # The tolerance is that of the differences in both Hessians.
    assert float(log_evidences[0]) == pytest.approx(expected, abs=0.01)
