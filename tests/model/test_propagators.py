"""Scales of pull and width over the interval: exactly 1 at one second, hundreds of digits, the filter in time, simulated memories."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from bayes_toe.model.closed_form import MAX_PULL, pull, width
from bayes_toe.model.coordinates import Natural
from bayes_toe.model.intervals import MEAN_REVERSION, RANDOM_WALK, at_interval, mean_reverting_scales, random_walk_scales

FAR = st.floats(-700.0, 700.0)


def one(scales, *coordinates):
    return [float(part[0, 0]) for part in scales(*(np.array([value]) for value in coordinates))]


@given(a=FAR, split=FAR)
def test_one_second_is_exactly_one(a, split):
    assert one(RANDOM_WALK.scales, a, 1.0) == [1.0, 1.0]
    assert one(MEAN_REVERSION.scales, a, split, 1.0) == [1.0, 1.0]


@given(a=st.floats(-600, 30), t=st.floats(1e-3, 1e3))
def test_random_walk_is_the_closed_form_of_its_interval(a, t):
    p = MAX_PULL / (1 + np.exp(-a))
    theta = Natural(np.array(0.0), np.array(1.0), np.array(np.sqrt(p) / (1 - p)), np.array(0.9))
    there = at_interval(theta, t)
    expected = pull(there.gamma) / p, width(there.sigma_p, there.gamma) / width(1.0, theta.gamma)
    assert one(random_walk_scales, a, t) == pytest.approx([float(value) for value in expected], rel=1e-12)


@settings(max_examples=200, deadline=None)
@given(a=st.floats(-600, 300), split=st.floats(-300, 300), t=st.floats(1e-6, 1e4))
def test_mean_reversion_agrees_with_hundreds_of_digits(a, split, t):
    # From natural parameters and the filter's equations as they are written, with sigma1 = 1.
    with mpmath.workdps(1200):
        v = 1 / (1 + mpmath.exp(-mpmath.mpf(split)))
        g = 1 / (1 + mpmath.exp(mpmath.mpf(a)))
        rho, gain = g**v, g ** (1 - v)
        noise = 1 / gain - 1

        def at(seconds):
            kept = rho ** mpmath.mpf(seconds)
            sd = mpmath.sqrt(kept**2 * (1 - gain) + 1 - kept**2)
            return 1 - kept * gain, sd + noise / sd

        (p1, w1), (pt, wt) = at(1), at(t)
        expected = float(pt / p1), float(wt / w1)
    assert one(mean_reverting_scales, a, split, t) == pytest.approx(expected, rel=1e-12)


SIGMA1, SIGMA_L, RHO = 0.7, 0.4, 0.55
GAIN = SIGMA1**2 / (SIGMA1**2 + SIGMA_L**2)


def of_memory(t):
    """Weight and width of the memory with these parameters after t seconds, by the scales from those at one second."""
    weight = GAIN * RHO
    sd = np.sqrt(SIGMA1**2 * (1 - RHO**2 * GAIN))
    a, split = np.log(1 / weight - 1), np.log(np.log(RHO) / np.log(GAIN))
    r, v = one(mean_reverting_scales, a, split, t)
    return 1 - r * (1 - weight), v * (sd + SIGMA_L**2 / sd)


@pytest.mark.parametrize("t", [0.05, 0.3, 1.0, 2.5, 9.0])
def test_mean_reversion_solves_the_equations_of_its_moments(t):
    # dm/dt = -(m - mu1)/tau and dV/dt = 2 (sigma1^2 - V)/tau, with tau = -1/ln rho, from the belief right after a stimulus at mu1 + 1.
    tau = -1 / np.log(RHO)
    start = [GAIN, GAIN * SIGMA_L**2]
    found = solve_ivp(lambda _, y: [-y[0] / tau, 2 * (SIGMA1**2 - y[1]) / tau], (0, t), start, rtol=1e-11, atol=1e-13).y[:, -1]
    sd = np.sqrt(found[1])
    assert of_memory(t) == pytest.approx((found[0], sd + SIGMA_L**2 / sd), rel=1e-8)


@pytest.mark.parametrize("t", [0.4, 2.0])
def test_mean_reversion_is_what_simulated_memories_do(t):
    # Intensities from the prior, measured with noise, then drifting by Euler steps: the regression of where they end on what was measured.
    rng, size, steps = np.random.default_rng(6), 100_000, 400
    tau, h = -1 / np.log(RHO), t / steps
    s = rng.normal(0.0, SIGMA1, size)
    measured = s + rng.normal(0.0, SIGMA_L, size)
    for _ in range(steps):
        s = s - s * h / tau + rng.normal(0.0, SIGMA1 * np.sqrt(2 * h / tau), size)
    slope = float(s @ measured / (measured @ measured))
    sd = float(np.std(s - slope * measured))
    weight, w = of_memory(t)
    euler = 2 * (t / tau) ** 2 / steps + h / tau  # bias of the steps
    assert weight == pytest.approx(slope, abs=4.5 * sd / np.sqrt(measured @ measured) + euler * slope)
    assert w == pytest.approx(sd + SIGMA_L**2 / sd, rel=4.5 / np.sqrt(2 * size) + euler)


def test_mean_reversion_begins_with_the_gain_and_ends_with_the_prior():
    assert of_memory(1e-12) == pytest.approx((GAIN, (v := np.sqrt(GAIN) * SIGMA_L) + SIGMA_L**2 / v), rel=1e-9)
    assert of_memory(1e6) == pytest.approx((0.0, SIGMA1 + SIGMA_L**2 / SIGMA1), rel=1e-12, abs=1e-12)


def test_the_two_memories_disagree_on_what_an_interval_does_to_the_order_effect():
    seconds, a = np.array([0.25, 0.5, 2.0, 4.0]), np.array([-1.0, 1.0])
    assert (np.diff(random_walk_scales(a, seconds).pull) < 0).all()
    assert (np.diff(mean_reverting_scales(a, a, seconds).pull) > 0).all()
