"""Coordinates without a funnel are a map with an inverse."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference.hard_cases import hard_cases

from bayes_toe.inference.fitted import find_maxima
from bayes_toe.inference.searches import funnel_of_maxima
from bayes_toe.model.paper_model import paper_posterior

CASES = hard_cases()


@pytest.fixture(scope="module", params=["funnel", "all different"])
def funnel(request):
    """The map to coordinates in which the posterior of a hard case has no funnel."""
    posterior = paper_posterior(CASES[request.param])
    return funnel_of_maxima(posterior, find_maxima(posterior))


@given(x=st.tuples(*[st.floats(-40, 40)] * 4))
def test_the_funnel_is_a_bijection_however_small_the_pull_is(funnel, x):
    # `inverse` has the log Jacobian as its second result.
    points = np.array([[x]])  # one point of one posterior
    back, _ = funnel.inverse(funnel.forward(points))
    assert back == pytest.approx(points, rel=1e-6, abs=1e-6)
