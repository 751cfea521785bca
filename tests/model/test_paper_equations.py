"""The closed form to its last digits, and against a Kalman filter."""

from typing import NamedTuple

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayes_toe.errors import NumericalError
from bayes_toe.model.paper_equations import (
    equal_probability,
    evolved_mean,
    gain,
    noise_ratio,
    normalised_distance,
    pull,
    width,
)
from bayes_toe.model.paper_model import bell_answers

# A scalar Kalman filter with a random walk, written from its textbook equations.


class Belief(NamedTuple):
    """Mean and variance of a Gaussian."""

    mean: float
    variance: float


def update(belief, stimulus, noise):
    """The belief after a measurement with this standard deviation."""
    gain = belief.variance / (belief.variance + noise**2)
    mean = belief.mean + gain * (stimulus - belief.mean)
    return Belief(mean, (1.0 - gain) * belief.variance)


def evolve(belief, diffusion):
    """The belief after a step of a random walk."""
    return Belief(belief.mean, belief.variance + diffusion**2)


def stationary_belief(mean, diffusion, noise):
    """The belief whose variance a stimulus and a step of the random walk leave as it is.

    The variance is the positive root of v^2 = step (v + noise^2), which follows from
    v = v noise^2 / (v + noise^2) + step.
    """
    step = diffusion**2
    return Belief(mean, 0.5 * (step + np.sqrt(step**2 + 4.0 * step * noise**2)))


def shift(belief, stimulus, noise):
    """How far a stimulus moves the mean, in standard deviations of the belief."""
    return (update(belief, stimulus, noise).mean - belief.mean) / np.sqrt(belief.variance)


@pytest.mark.parametrize("gamma", [1e-300, 1e-100, 1e-16, 1e-3, 0.5, 1 - 1e-12])
def test_gain_and_pull_to_the_last_digits(gamma):
    """With G = (1 + sqrt(1 + 4 gamma)) / 2, the pull is gamma / G^2 and the gain is 1 / G."""
    with mpmath.workdps(50):
        g = mpmath.mpf(gamma)
        ratio = (1 + mpmath.sqrt(1 + 4 * g)) / 2
        assert float(pull(gamma)) == pytest.approx(float(g / ratio**2), rel=1e-15, abs=0.0)
        assert float(gain(gamma)) == pytest.approx(float(1 / ratio), rel=1e-15)


@settings(max_examples=100, deadline=None)
@given(
    s1=st.floats(-2, 2), s2=st.floats(-2, 2), mu1=st.floats(-5, 5),
    sigma_p=st.floats(-2, 2).map(lambda e: 10.0**e), gamma=st.floats(-6, 0).map(lambda e: 10.0**e),
)  # fmt: skip
def test_two_stimuli_are_two_steps_of_the_filter(s1, s2, mu1, sigma_p, gamma):
    """sigma_p is the diffusion, sigma_l the noise of a measurement, and gamma their ratio squared.

    P('equal') falls with the distance z by which the second stimulus moves the evolved belief.
    """
    sigma_l = sigma_p * np.sqrt(gamma)
    q0 = 0.93
    prior = stationary_belief(mu1, sigma_p, sigma_l)
    belief = evolve(update(prior, s1, sigma_l), sigma_p)  # before the second stimulus
    sd = np.sqrt(belief.variance)

    rounded_gamma = noise_ratio(sigma_p, sigma_l)  # with the rounding of the root
    assert evolved_mean(s1, mu1, rounded_gamma) == pytest.approx(belief.mean, rel=1e-14, abs=1e-14)
    assert width(sigma_p, rounded_gamma) == pytest.approx(sd + sigma_l**2 / sd, rel=1e-14)
    weight = prior.variance / (prior.variance + sigma_l**2)
    assert gain(rounded_gamma) == pytest.approx(weight, rel=1e-12)

    z = normalised_distance(s1, s2, mu1, sigma_p, sigma_l)
    expected = shift(belief, s2, sigma_l)
    # Stimuli have sizes of about 1, so that rounding errors of their differences are 1e-16. The
    # tolerance is a thousand times as large.
    assert z == pytest.approx(expected, rel=1e-9, abs=1e-13 + 1e-13 / sigma_p)
    q = equal_probability(s1, s2, mu1, sigma_p, sigma_l, q0)
    assert q == pytest.approx(q0 * 2.0 ** -(z**2), rel=1e-12, abs=1e-300)


def test_log_of_a_small_probability_of_different_does_not_round():
    """log(1 - q0 2^(-z^2)) at z = 0 and 1, with q0 = 1 - 1e-300, which rounds to 1."""
    _, log_different = bell_answers(np.arange(2.0), np.ones(1), np.array([1e-300]))
    assert log_different == pytest.approx(np.log([1e-300, 0.5]), rel=1e-15)


@pytest.mark.parametrize(
    # mu1, sigma_p, sigma_l and q0, and the parameter or rule that the refusal names.
    "parameters, name",
    [
        ((np.nan, 0.2, 0.1, 0.9), "mu1"),
        ((0.0, 0.0, 0.1, 0.9), "sigma_p"),
        ((0.0, 0.2, -0.1, 0.9), "sigma_l"),
        ((0.0, 0.2, 0.1, 1.1), "q0"),
        ((0.0, 1e-200, 1.0, 0.9), "sigma_l / sigma_p must be below 1e153"),
    ],
)
def test_unusable_parameters_raise_and_are_named(parameters, name):
    with pytest.raises(NumericalError, match=name):
        equal_probability(0.0, 0.1, *parameters)
