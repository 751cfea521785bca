"""Natural, identified, unconstrained and levelled coordinates: bijections and volumes."""

import numpy as np
import pytest
from definitions import natural
from hypothesis import given
from hypothesis import strategies as st
from numpy.random import default_rng
from reference.hard_cases import hard_cases

from bayes_toe.inference.maxima import find_maxima
from bayes_toe.model.paper_model import paper_posterior, unconstrained

points = st.tuples(st.floats(-2, 2), st.floats(-6, 6), st.floats(-4, 2), st.floats(-6, 6))


@given(points, st.floats(-3, 3))
def test_there_and_back(x, sbar):
    back = unconstrained(natural(x, sbar), sbar)
    assert back == pytest.approx(np.array(x), rel=1e-7, abs=1e-7)


@pytest.mark.parametrize("logit_pull", [30.0, 36.0, 40.0, 700.0])
def test_a_draw_next_to_the_edge_comes_back_near_it_or_on_it(logit_pull):
    x = default_rng(1).normal(size=(20_000, 4))
    x[:, 1] = logit_pull
    back = unconstrained(natural(x, 0.3), 0.3)
    assert np.allclose(back[:, [0, 2, 3]], x[:, [0, 2, 3]], rtol=1e-12, atol=1e-12)
    # Also where sigma_l came out above sigma_p.
    assert (back[:, 1] > min(logit_pull, 35.0) - 1.0).all()


CASES = hard_cases()


@pytest.fixture(scope="module", params=["funnel", "all different"])
def transform(request):
    posterior = paper_posterior(CASES[request.param])
    return posterior.transform(find_maxima(posterior).x)


@given(st.tuples(st.floats(-1, 1), st.floats(-12, 12), st.floats(-3, 1), st.floats(-12, 12)))
def test_volume_is_the_determinant_of_differences(transform, x):
    steps = 1e-5 * np.eye(4)
    rise = transform.forward(x + steps)[0] - transform.forward(x - steps)[0]
    log_volume = transform.forward(np.array([x]))[1][0]
    assert log_volume == pytest.approx(np.linalg.slogdet(rise / 2e-5)[1], abs=1e-4)


def test_beyond_the_smallest_float_is_nowhere():
    posterior = paper_posterior(CASES["funnel"])
    transform = posterior.transform(find_maxima(posterior).x)
    y = [[0.3, -60.0, 0.0, 0.0], [0.3, 0.0, 0.0, 50.0], [0.3, 0.0, 0.0, 0.0]]
    x, _ = transform.inverse(np.array(y))
    assert x[0, 2] == x[1, 2] == 400.0
    assert (posterior.log_density(x)[:2] < -1e4).all()  # no weight at all
    assert np.isfinite(posterior.log_density(x)[2])
