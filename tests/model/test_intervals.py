"""The model at several intervals: the filter step by step, scales exactly 1 at one second, and the equations of their moments."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kalman import evolve, settled, shift, update
from scipy.integrate import solve_ivp

from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import MAX_PULL, equal_probability, gain, pull, width
from bayes_toe.model.coordinates import Natural
from bayes_toe.model.intervals import (
    OF_EQUAL,
    at_interval,
    mean_reversion,
    mean_reverting_scales,
    random_walk,
    random_walk_scales,
)

OBSERVER = Natural(*map(np.asarray, (-0.6, 0.21, 0.14, 0.93)))


@pytest.mark.parametrize("isi", [0.05, 0.3, 1.0, 4.0, 60.0])
def test_filter_equations_give_the_closed_form(isi):
    prior = settled(OBSERVER.mu1, OBSERVER.sigma_p, OBSERVER.sigma_l, isi)
    for s1, s2 in [(0.0, 0.0), (0.4, 0.1), (-0.2, 0.5)]:
        evolved = evolve(update(prior, s1, OBSERVER.sigma_l), OBSERVER.sigma_p, isi)
        literal = OBSERVER.q0 * 2.0 ** -np.square(shift(evolved, s2, OBSERVER.sigma_l))
        assert equal_probability(s1, s2, *at_interval(OBSERVER, isi)) == pytest.approx(
            float(literal), rel=1e-12
        )
    weight = prior.variance / (prior.variance + OBSERVER.sigma_l**2)
    assert gain(at_interval(OBSERVER, isi).gamma) == pytest.approx(float(weight), rel=1e-12)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_an_interval_is_positive(bad):
    with pytest.raises(InputError, match="positive finite"):
        at_interval(OBSERVER, [1.0, bad])


FAR = st.floats(-700.0, 700.0)


def one(scales, *coordinates):
    return [float(part[0, 0]) for part in scales(*(np.array([value]) for value in coordinates))]


@given(a=FAR, split=FAR)
def test_one_second_is_exactly_one(a, split):
    assert one(random_walk(OF_EQUAL).scales, a, 1.0) == [1.0, 1.0]
    assert one(mean_reversion(OF_EQUAL).scales, a, split, 1.0) == [1.0, 1.0]


@given(a=st.floats(-600, 30), t=st.floats(1e-3, 1e3))
def test_random_walk_is_the_closed_form_of_its_interval(a, t):
    p = MAX_PULL / (1 + np.exp(-a))
    theta = Natural(np.array(0.0), np.array(1.0), np.array(np.sqrt(p) / (1 - p)), np.array(0.9))
    there = at_interval(theta, t)
    expected = pull(there.gamma) / p, width(there.sigma_p, there.gamma) / width(1.0, theta.gamma)
    assert one(random_walk_scales, a, t) == pytest.approx(
        [float(value) for value in expected], rel=1e-12
    )


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
    found = solve_ivp(
        lambda _, y: [-y[0] / tau, 2 * (SIGMA1**2 - y[1]) / tau],
        (0, t),
        start,
        rtol=1e-11,
        atol=1e-13,
    ).y[:, -1]
    sd = np.sqrt(found[1])
    assert of_memory(t) == pytest.approx((found[0], sd + SIGMA_L**2 / sd), rel=1e-8)


def test_mean_reversion_begins_with_the_gain_and_ends_with_the_prior():
    assert of_memory(1e-12) == pytest.approx(
        (GAIN, (v := np.sqrt(GAIN) * SIGMA_L) + SIGMA_L**2 / v), rel=1e-9
    )
    assert of_memory(1e6) == pytest.approx(
        (0.0, SIGMA1 + SIGMA_L**2 / SIGMA1), rel=1e-12, abs=1e-12
    )
