"""The closed form against the paper's unsimplified equations, and the invariances that catch wrong signs and powers."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from bayes_toe.errors import NumericalError
from bayes_toe.model.closed_form import (
    equal_probability,
    evolved_mean,
    gain,
    log_different,
    log_equal,
    normalised_distance,
    pull,
    variance_ratio,
    width,
)

stimulus = st.floats(-2, 2)
means = st.floats(-3, 3)
scales = st.floats(0.05, 2)
gammas = st.floats(1e-6, 0.999)
tops = st.floats(0.05, 0.99)


def filtered(s1, mu1, sigma_p, sigma_l):
    """Mean and variance of the memory from Eq. mod:update, the prior variance by root finding: no closed form of ours."""

    def misfit(log_variance):
        v = np.exp(log_variance)
        return np.log(1 / sigma_p**2 + 1 / sigma_l**2 + 1 / v) - np.log(v / (sigma_p**2 * (v - sigma_p**2)))

    v = np.exp(brentq(misfit, np.log(sigma_p**2) + 1e-13, np.log(sigma_p**2) + 3, xtol=1e-15))
    precision = 1 / sigma_p**2 + 1 / sigma_l**2 + 1 / v
    mean = v / sigma_p**2 * (s1 / sigma_l**2 + mu1 / v) / precision
    return mean, v


@given(stimulus, stimulus, means, scales, st.floats(0.01, 0.999), tops)
def test_closed_form_is_the_papers_filter(s1, s2, mu1, sigma_p, gamma, q0):
    sigma_l = sigma_p * np.sqrt(gamma)
    mean, v = filtered(s1, mu1, sigma_p, sigma_l)
    z = (s2 - mean) / (np.sqrt(v) + sigma_l**2 / np.sqrt(v))
    assert float(evolved_mean(s1, mu1, gamma)) == pytest.approx(mean, rel=1e-9, abs=1e-9)
    assert float(variance_ratio(gamma)) == pytest.approx(v / sigma_p**2, rel=1e-9)
    assert float(equal_probability(s1, s2, mu1, sigma_p, sigma_l, q0)) == pytest.approx(q0 * 2 ** -(z**2), rel=1e-7, abs=1e-12)


@given(stimulus, stimulus, means, scales, gammas, tops, st.floats(-5, 5), st.floats(0.1, 10))
def test_shifting_and_scaling_everything_changes_nothing(s1, s2, mu1, sigma_p, gamma, q0, shift, k):
    sigma_l = sigma_p * np.sqrt(gamma)
    q = equal_probability(s1, s2, mu1, sigma_p, sigma_l, q0)
    moved = equal_probability(k * s1 + shift, k * s2 + shift, k * mu1 + shift, k * sigma_p, k * sigma_l, q0)
    assert float(moved) == pytest.approx(float(q), rel=1e-8, abs=1e-12)


def test_a_lower_prior_mean_pulls_the_first_stimulus_down():
    # Kind A of Fig. 3: prior below the stimuli, weaker first is told apart better than stronger first.
    weaker_first = equal_probability(0.0, 0.4, -0.7, 0.25, 0.2, 0.95)
    stronger_first = equal_probability(0.4, 0.0, -0.7, 0.25, 0.2, 0.95)
    assert weaker_first < stronger_first - 0.1


@given(stimulus, means, scales, gammas, tops)
def test_top_on_the_axis_and_half_at_one_width(s1, mu1, sigma_p, gamma, q0):
    sigma_l = sigma_p * np.sqrt(gamma)
    axis = float(evolved_mean(s1, mu1, gamma))
    w = float(width(sigma_p, gamma))
    assert float(equal_probability(s1, axis, mu1, sigma_p, sigma_l, q0)) == pytest.approx(q0, rel=1e-9)
    for side in (-w, w):
        assert float(equal_probability(s1, axis + side, mu1, sigma_p, sigma_l, q0)) == pytest.approx(q0 / 2, rel=1e-6)


def test_no_measurement_noise_means_no_order_effect():
    assert float(evolved_mean(0.3, 7.0, 0.0)) == 0.3
    assert float(width(0.2, 0.0)) == 0.2


@pytest.mark.parametrize("gamma", [1e-300, 1e-100, 1e-16, 1e-3, 0.5, 1 - 1e-12])
def test_gain_and_pull_to_the_last_digits(gamma):
    with mpmath.workdps(50):
        g = mpmath.mpf(gamma)
        big = (1 + mpmath.sqrt(1 + 4 * g)) / 2
        assert abs(mpmath.mpf(float(pull(gamma))) / (1 - 1 / big) - 1) < 1e-15 if gamma > 1e-30 else float(pull(gamma)) == gamma
        assert abs(mpmath.mpf(float(gain(gamma))) * big - 1) < 1e-15


@given(st.one_of(st.just(0.0), st.floats(-150, 150).map(lambda e: 10.0**e)), st.floats(-700, 690))
def test_logs_of_both_answers_agree_with_fifty_digits(z, logit_q0):
    with mpmath.workdps(50):
        odds = mpmath.exp(mpmath.mpf(logit_q0))
        q0, lapse, t = odds / (1 + odds), 1 / (1 + odds), mpmath.log(2) * mpmath.mpf(z) ** 2
        q = q0 * mpmath.exp(-t)
        truth_different = mpmath.log1p(-q) if q < 0.1 else mpmath.log(lapse - q0 * mpmath.expm1(-t))
        truth_equal = -mpmath.log1p(mpmath.exp(-mpmath.mpf(logit_q0))) - t
    assert float(log_different(z, logit_q0)) == pytest.approx(float(truth_different), rel=1e-12, abs=1e-300)
    log_q0 = -np.logaddexp(0.0, -logit_q0)
    assert float(log_equal(z, log_q0)) == pytest.approx(float(truth_equal), rel=1e-12)


def test_certainty_is_minus_infinity_without_a_warning():
    # q0 = 1 to all digits is not reachable in these coordinates; a logit of 1e4 still has a finite log.
    assert float(log_different(0.0, 1e4)) == -1e4
    assert float(log_different(1.0, 1e4)) == pytest.approx(np.log(0.5), rel=1e-15)


@pytest.mark.parametrize(
    ("values", "named"),
    [((np.nan, 0.2, 0.1, 0.9), "mu1"), ((0.0, 0.0, 0.1, 0.9), "sigma_p"), ((0.0, 0.2, -0.1, 0.9), "sigma_l"), ((0.0, 0.2, 0.1, 1.1), "q0")],
)
def test_unusable_parameters_raise_and_are_named(values, named):
    with pytest.raises(NumericalError, match=named):
        equal_probability(0.0, 0.1, *values)


def test_distance_is_zero_on_the_axis_and_broadcasts():
    z = normalised_distance(np.zeros((1, 3)), np.array([[0.0, 0.1, 0.2]]), np.zeros((4, 1)), 0.2, 0.1)
    assert z.shape == (4, 3)
    assert z[0, 0] == 0.0
