"""Natural, identified, unconstrained and levelled coordinates: bijections, volumes by differences, and the funnel gone."""

import numpy as np
import pytest
from definitions import natural
from hypothesis import given
from hypothesis import strategies as st
from reference.hard_cases import hard_cases

from bayes_toe.inference.maxima import find_maxima
from bayes_toe.model.paper_equations import MAX_PULL, equal_probability, quantities
from bayes_toe.model.paper_model import paper_posterior, unconstrained

points = st.tuples(st.floats(-2, 2), st.floats(-6, 6), st.floats(-4, 2), st.floats(-6, 6))


@given(points, st.floats(-3, 3))
def test_there_and_back(x, sbar):
    back = unconstrained(natural(x, sbar), sbar)
    assert back == pytest.approx(np.array(x), rel=1e-7, abs=1e-7)


@pytest.mark.parametrize("logit_pull", [30.0, 36.0, 40.0, 700.0])
def test_a_draw_next_to_the_edge_comes_back_near_it_or_on_it(logit_pull):
    rng = np.random.default_rng(1)
    x = np.stack(
        [rng.normal(size=20_000), np.full(20_000, logit_pull), *rng.normal(size=(2, 20_000))],
        axis=-1,
    )
    back = unconstrained(natural(x, 0.3), 0.3)
    assert np.allclose(back[:, [0, 2, 3]], x[:, [0, 2, 3]], rtol=1e-12, atol=1e-12)
    assert (
        back[:, 1] > min(logit_pull, 35.0) - 1.0
    ).all()  # also where sigma_l came out above sigma_p


@given(points, st.floats(-3, 3), st.floats(-1, 1), st.floats(-1, 1))
def test_identified_coordinates_give_the_same_probability(x, sbar, s1, s2):
    c, p, w, q0 = x[0], MAX_PULL / (1 + np.exp(-x[1])), np.exp(x[2]), 1 / (1 + np.exp(-x[3]))
    z = ((s2 - s1) - c + p * (s1 - sbar)) / w
    theta = natural(x, sbar)
    assert float(equal_probability(s1, s2, *theta)) == pytest.approx(
        float(q0 * 2.0 ** -(z**2)), rel=1e-6, abs=1e-12
    )


def test_derived_quantities_follow_their_definitions():
    theta = natural(np.random.default_rng(0).normal(size=(50, 4)), 0.1)
    found = quantities(theta, 0.0)
    assert found["gain"] == pytest.approx(
        found["sigma1"] ** 2 / (found["sigma1"] ** 2 + theta.sigma_l**2), rel=1e-12
    )
    assert found["width"] == pytest.approx(
        found["sigma1"] + theta.sigma_l**2 / found["sigma1"], rel=1e-12
    )
    assert found["gamma"] == pytest.approx((theta.sigma_l / theta.sigma_p) ** 2, rel=1e-12)


CASES = hard_cases()


@pytest.fixture(scope="module", params=["funnel", "all different"])
def transform(request):
    posterior = paper_posterior(CASES[request.param])
    return posterior.transform(find_maxima(posterior).x)


@given(st.tuples(st.floats(-3, 3), st.floats(-30, 30), st.floats(-5, 3), st.floats(-30, 30)))
def test_levelled_and_back(transform, y):
    x, log_volume = transform.inverse(np.array([[y[0], y[1] / 4, y[2], y[3] / 4]]))
    back, same_volume = transform.forward(x)
    assert back[0] == pytest.approx([y[0], y[1] / 4, y[2], y[3] / 4], rel=1e-9, abs=1e-9)
    assert log_volume == pytest.approx(same_volume, rel=1e-9, abs=1e-9)


@given(st.tuples(st.floats(-1, 1), st.floats(-12, 12), st.floats(-3, 1), st.floats(-12, 12)))
def test_volume_is_the_determinant_of_differences(transform, x):
    point, h = np.array([x]), 1e-5
    columns = [
        (transform.forward(point + h * e)[0] - transform.forward(point - h * e)[0])[0] / (2 * h)
        for e in np.eye(4)
    ]
    assert transform.forward(point)[1][0] == pytest.approx(
        np.linalg.slogdet(np.array(columns))[1], abs=1e-4
    )


def test_beyond_the_smallest_float_is_nowhere():
    posterior = paper_posterior(CASES["funnel"])
    transform = posterior.transform(find_maxima(posterior).x)
    x, _ = transform.inverse(
        np.array([[0.3, -60.0, 0.0, 0.0], [0.3, 0.0, 0.0, 50.0], [0.3, 0.0, 0.0, 0.0]])
    )
    assert x[0, 2] == x[1, 2] == 400.0
    assert (posterior.log_density(x)[:2] < -1e4).all()  # no weight at all
    assert np.isfinite(posterior.log_density(x)[2])
