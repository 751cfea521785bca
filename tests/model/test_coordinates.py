"""Natural, identified and unconstrained coordinates: a bijection, and the Jacobian by differences."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_toe.model.closed_form import MAX_PULL, equal_probability
from bayes_toe.model.coordinates import Natural, derived, log_jacobian, natural, unconstrained
from bayes_toe.model.prior import Prior

points = st.tuples(st.floats(-2, 2), st.floats(-6, 6), st.floats(-4, 2), st.floats(-6, 6))


@given(points, st.floats(-3, 3))
def test_there_and_back(x, sbar):
    back = unconstrained(natural(x, sbar), sbar)
    assert back == pytest.approx(np.array(x), rel=1e-7, abs=1e-7)


@pytest.mark.parametrize("logit_pull", [30.0, 36.0, 40.0, 700.0])
def test_a_draw_next_to_the_edge_comes_back_near_it_or_on_it(logit_pull):
    rng = np.random.default_rng(1)
    x = np.stack([rng.normal(size=20_000), np.full(20_000, logit_pull), *rng.normal(size=(2, 20_000))], axis=-1)
    back = unconstrained(natural(x, 0.3), 0.3)
    assert np.allclose(back[:, [0, 2, 3]], x[:, [0, 2, 3]], rtol=1e-12, atol=1e-12)
    assert (back[:, 1] > min(logit_pull, 35.0) - 1.0).all()  # also where sigma_l came out above sigma_p


@given(points, st.floats(-3, 3), st.floats(-1, 1), st.floats(-1, 1))
def test_identified_coordinates_give_the_same_probability(x, sbar, s1, s2):
    c, p, w, q0 = x[0], MAX_PULL / (1 + np.exp(-x[1])), np.exp(x[2]), 1 / (1 + np.exp(-x[3]))
    z = ((s2 - s1) - c + p * (s1 - sbar)) / w
    theta = natural(x, sbar)
    assert float(equal_probability(s1, s2, *theta)) == pytest.approx(float(q0 * 2.0 ** -(z**2)), rel=1e-6, abs=1e-12)


@given(points, st.floats(-3, 3))
def test_jacobian_is_the_determinant_of_differences(x, sbar):
    with mpmath.workdps(40):

        def column(i, h):
            shifted = [mpmath.mpf(v) + (h if j == i else 0) for j, v in enumerate(x)]
            c, a, b, top = shifted
            p = mpmath.mpf(MAX_PULL) / (1 + mpmath.exp(-a))
            k = 1 - p
            return [sbar + c / p, mpmath.exp(b) * k ** mpmath.mpf(1.5), p / k**2, 1 / (1 + mpmath.exp(-top))]

        h = mpmath.mpf(10) ** -15
        matrix = mpmath.matrix(4, 4)
        for i in range(4):
            for j, (up, down) in enumerate(zip(column(i, h), column(i, -h), strict=True)):
                matrix[j, i] = (up - down) / (2 * h)
        truth = float(mpmath.log(abs(mpmath.det(matrix))))
    assert float(log_jacobian(x)) == pytest.approx(truth, rel=1e-9, abs=1e-9)


def test_gamma_stays_below_one_and_pull_below_its_limit():
    theta = natural([0.0, 40.0, 0.0, 0.0], 0.0)
    assert float(theta.gamma) == pytest.approx(1.0, abs=1e-12)
    assert float(derived(theta)["gain"]) >= 1.0 - MAX_PULL - 1e-15


def test_prior_density_in_natural_coordinates_and_outside_the_support():
    inside = Natural(*(np.array([v]) for v in (0.0, 0.5, 0.2, 0.5)))
    outside = Natural(*(np.array([v]) for v in (0.0, 0.5, 0.6, 0.5)))
    expected = -0.5 * np.log(2 * np.pi) - np.log(10) + 0.5 * np.log(2 / np.pi) - 0.125
    assert Prior().log_density(inside)[0] == pytest.approx(expected, rel=1e-12)
    assert Prior().log_density(outside)[0] == -np.inf


def test_derived_quantities_follow_their_definitions():
    theta = natural(np.random.default_rng(0).normal(size=(50, 4)), 0.1)
    found = derived(theta)
    assert found["gain"] == pytest.approx(found["sigma1"] ** 2 / (found["sigma1"] ** 2 + theta.sigma_l**2), rel=1e-12)
    assert found["width"] == pytest.approx(found["sigma1"] + theta.sigma_l**2 / found["sigma1"], rel=1e-12)
    assert found["gamma"] == pytest.approx((theta.sigma_l / theta.sigma_p) ** 2, rel=1e-12)
