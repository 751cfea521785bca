"""Natural parameters, scores of the prior, and coordinates without a funnel: maps and volumes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference.hard_cases import hard_cases

from bayes_toe.inference.fitted import find_maxima
from bayes_toe.inference.searches import funnel_of_maxima
from bayes_toe.model.paper_model import paper_posterior

CASES = hard_cases()
points = st.tuples(*[st.floats(-4, 4)] * 4)


@pytest.fixture(scope="module", params=["funnel", "all different"])
def funnel(request):
    posterior = paper_posterior(CASES[request.param])
    return funnel_of_maxima(posterior.rows, find_maxima(posterior))


@given(x=points)
def test_volume_is_the_determinant_of_differences(funnel, x):
    steps = 1e-5 * np.eye(4)
    rise = funnel.forward((x + steps)[None])[0][0] - funnel.forward((x - steps)[None])[0][0]
    log_volume = funnel.forward(np.array([[x]]))[1][0, 0]
    assert log_volume == pytest.approx(np.linalg.slogdet(rise / 2e-5)[1], abs=1e-4)


@given(x=st.tuples(*[st.floats(-40, 40)] * 4))
def test_the_funnel_is_a_bijection_however_small_the_pull_is(funnel, x):
    back = funnel.inverse(funnel.forward(np.array([[x]]))[0])[0][0, 0]
    assert back == pytest.approx(np.array(x), rel=1e-6, abs=1e-6)
