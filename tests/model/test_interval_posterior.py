"""The log posterior with intervals: the filter's equations pair by pair, fifty digits, and the posterior without intervals."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.hard_cases import hard_cases

from bayes_toe.data.study import Subject
from bayes_toe.model.beliefs import comparison_distance, evolve, steady_prior, update
from bayes_toe.model.ladder import posterior_of
from bayes_toe.model.prior import Prior

CASES = hard_cases()
SECOND = Prior(reference_interval=1.0)
UNEVEN = Subject(
    "uneven",
    [0.0, 0.0, 0.0, 0.3, 0.3, 0.5, 0.5, 0.0],
    [0.3, 0.0, 0.3, 0.0, 0.0, 0.5, 0.2, 0.3],
    [21, 40, 33, 18, 30, 44, 30, 0],
    [50, 45, 50, 50, 48, 50, 40, 7],
    isi=[0.2, 1.0, 1.0, 0.2, 5.0, 5.0, 1.0, 30.0],
)


def at_one_second(subject):
    return Subject(subject.name, subject.s1, subject.s2, subject.n_equal, subject.n_trials, isi=np.ones(subject.n_pairs))


@pytest.mark.parametrize("name", ["funnel", "all equal", "stimuli offset by 100", "400 pairs with 3 trials"])
def test_one_second_everywhere_is_the_posterior_without_intervals(name):
    plain, timed = posterior_of(CASES[name]), posterior_of(at_one_second(CASES[name]))
    x = np.random.default_rng(1).normal(size=(50, 4)) * [0.3, 3.0, 1.0, 4.0]
    assert timed.log_density(x) == pytest.approx(plain.log_density(x), rel=1e-12, abs=1e-12)
    without = plain.gradient(x)[1]
    assert timed.gradient(x)[1] == pytest.approx(without, rel=1e-12, abs=1e-12 * np.abs(without).max())


def test_likelihood_is_that_of_the_filter_equations_pair_by_pair():
    posterior = posterior_of(UNEVEN, SECOND)
    x = np.random.default_rng(2).normal(size=(30, 4)) * [0.3, 1.5, 0.4, 1.0] + [0.0, 0.0, -1.0, 2.0]
    theta = posterior.natural(x)
    total = np.zeros(len(x))
    for s1, s2, k, n, isi in zip(UNEVEN.s1, UNEVEN.s2, UNEVEN.n_equal, UNEVEN.n_trials, UNEVEN.isi, strict=True):
        diffusion = theta.sigma_p * np.sqrt(isi)
        evolved = evolve(update(steady_prior(theta.mu1, diffusion, theta.sigma_l), s1, theta.sigma_l), diffusion)
        q = theta.q0 * 2.0 ** -np.square(comparison_distance(evolved, s2, theta.sigma_l))
        total += k * np.log(q) + (n - k) * np.log1p(-q)
    assert posterior.log_likelihood(x) == pytest.approx(total, rel=1e-11)


def precise(posterior, x):
    """By mpmath, natural parameters first, the paper's unsimplified equations with sigma_p^2 t for every pair; 1 - q by subtraction."""
    c, a, b, top = (mpmath.mpf(v) for v in x)
    prior, subject = posterior.prior, posterior.subject
    most = (3 - mpmath.sqrt(5)) / 2
    p = most / (1 + mpmath.exp(-a))
    k = 1 - p
    sigma_p, mu1, q0 = mpmath.exp(b) * k ** mpmath.mpf(1.5), mpmath.mpf(posterior.sbar) + c / p, 1 / (1 + mpmath.exp(-top))
    noise = p / k**2 * sigma_p**2
    total = mpmath.mpf(0)
    for s1, s2, n_equal, n, isi in zip(subject.s1, subject.s2, subject.n_equal, subject.n_trials, subject.isi, strict=True):
        diffusion = sigma_p**2 * mpmath.mpf(float(isi))
        before = (diffusion + mpmath.sqrt(diffusion**2 + 4 * diffusion * noise)) / 2
        kept = before * noise / (before + noise)
        mean = kept * (mpmath.mpf(float(s1)) / noise + mu1 / before)
        sd = mpmath.sqrt(kept + diffusion)
        q = q0 * mpmath.power(2, -(((mpmath.mpf(float(s2)) - mean) / (sd + noise / sd)) ** 2))
        total += int(n_equal) * mpmath.log(q) + int(n - n_equal) * mpmath.log(1 - q)
    total += mpmath.log(mpmath.npdf(mu1, prior.mu1_mean, prior.mu1_sd))
    total += mpmath.log(2 * mpmath.npdf(sigma_p, 0, prior.sigma_p_scale))
    volume = (1 + p) / (p * k ** mpmath.mpf(1.5)) * p * (1 - p / most) * mpmath.exp(b) * q0 * (1 - q0)
    return total + mpmath.log(volume)


@settings(max_examples=25, deadline=None)
@given(x=st.tuples(st.floats(-1, 1), st.floats(-600, 20), st.floats(-2, 3), st.floats(-10, 20)))
def test_value_agrees_with_hundreds_of_digits(x):
    posterior = posterior_of(UNEVEN, Prior(mu1_sd=1e300, reference_interval=1.0))  # flat, so that a tiny pull is not outside the floats
    with mpmath.workdps(900):
        truth = float(precise(posterior, x))
    # Rounding of each displacement, times the slope of both logs there.
    z = np.abs(posterior.distance(np.array([x]))[0])
    lapse = 1 / (1 + np.exp(x[3]))
    error = 1e-15 * (2.0 + abs(x[0]) / UNEVEN.isi) * np.exp(-x[2]) / np.sqrt(UNEVEN.isi)
    room = np.sum(error * 2 * z * (UNEVEN.n_equal + (UNEVEN.n_trials - UNEVEN.n_equal) / (lapse + np.minimum(z**2, 1) / 3)))
    assert float(posterior.log_density([x])[0]) == pytest.approx(truth, rel=1e-12, abs=1e-11 + float(room))


def test_slopes_hold_where_the_pull_is_tiny_and_the_interval_extreme():
    subject = Subject("far", [0.0, 0.1, 0.4], [0.2, 0.1, 0.1], [10, 20, 12], [30, 30, 30], isi=[1e-6, 1.0, 1e6])
    posterior = posterior_of(subject, SECOND)
    x = np.array([[1e-5, -40.0, -0.5, 1.0], [0.02, 3.0, 0.5, 1.0], [0.02, 12.0, 6.0, 1.0]])
    _, gradient = posterior.gradient(x)
    for i in range(4):
        step = np.zeros(4)
        step[i] = 1e-4 if i else 1e-9
        slope = (posterior.log_density(x + step) - posterior.log_density(x - step)) / (2 * step[i])
        assert gradient[:, i] == pytest.approx(slope, rel=1e-4, abs=1e-6 * np.abs(gradient).max())
