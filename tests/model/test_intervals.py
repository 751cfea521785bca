"""The model at several intervals against the filter's own equations, solved step by step, and against high precision."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayes_toe.errors import InputError
from bayes_toe.model.beliefs import Gaussian, comparison_distance, evolve, update
from bayes_toe.model.closed_form import equal_probability, width
from bayes_toe.model.coordinates import Natural
from bayes_toe.model.intervals import at_interval, equal_probability_at, gain_at

OBSERVER = Natural(*map(np.asarray, (-0.6, 0.21, 0.14, 0.93)))


def settled_prior(theta, isi, rounds=400):
    """The prior that one stimulus and one interval leave as it is, found by living through many trials."""
    belief = Gaussian(theta.mu1, np.asarray(1.0))
    for _ in range(rounds):
        variance = evolve(update(belief, theta.mu1, theta.sigma_l), theta.sigma_p, isi).variance
        belief = Gaussian(theta.mu1, variance)
    return belief


@pytest.mark.parametrize("isi", [0.05, 0.3, 1.0, 4.0, 60.0])
def test_filter_equations_give_the_closed_form(isi):
    prior = settled_prior(OBSERVER, isi)
    for s1, s2 in [(0.0, 0.0), (0.4, 0.1), (-0.2, 0.5)]:
        evolved = evolve(update(prior, s1, OBSERVER.sigma_l), OBSERVER.sigma_p, isi)
        literal = OBSERVER.q0 * 2.0 ** -np.square(comparison_distance(evolved, s2, OBSERVER.sigma_l))
        assert equal_probability_at(s1, s2, isi, OBSERVER) == pytest.approx(float(literal), rel=1e-12)
    weight = prior.variance / (prior.variance + OBSERVER.sigma_l**2)
    assert gain_at(OBSERVER, isi) == pytest.approx(float(weight), rel=1e-12)


def test_one_second_is_the_model_without_intervals():
    s1, s2 = np.array([0.0, 0.4]), np.array([0.3, 0.1])
    assert np.array_equal(equal_probability_at(s1, s2, 1.0, OBSERVER), equal_probability(s1, s2, *OBSERVER))


def test_the_unit_of_time_is_free():
    # Seconds or minutes: sigma_p per root of a minute is sqrt(60) times larger.
    slow = OBSERVER._replace(sigma_p=OBSERVER.sigma_p * np.sqrt(60.0))
    assert equal_probability_at(0.0, 0.3, 3.0, OBSERVER) == pytest.approx(float(equal_probability_at(0.0, 0.3, 0.05, slow)), rel=1e-13)


def test_gain_rises_with_the_interval_and_the_width_is_least_where_gamma_is_two():
    isi = np.geomspace(0.01, 100.0, 400)
    assert (np.diff(gain_at(OBSERVER, isi)) > 0).all()
    at = at_interval(OBSERVER, isi)
    wide = width(at.sigma_p, at.gamma)
    shortest = float(OBSERVER.gamma) / 2.0
    assert isi[np.argmin(wide)] == pytest.approx(shortest, rel=0.03)
    assert float(width(at_interval(OBSERVER, shortest).sigma_p, 2.0)) == pytest.approx(2.0 * float(OBSERVER.sigma_l), rel=1e-12)


@settings(max_examples=60, deadline=None)
@given(sigma_p=st.floats(-150, 150), gamma=st.floats(-300, 0), isi=st.floats(-120, 120), pair=st.tuples(st.floats(-3, 3), st.floats(-3, 3)))
def test_distance_agrees_with_high_precision_at_extremes(sigma_p, gamma, isi, pair):
    sigma, t = 10.0**sigma_p, 10.0**isi
    sigma_l = sigma * 10.0 ** (gamma / 2)
    if sigma_l < 1e-150:
        return
    theta = Natural(*map(np.asarray, (0.7, sigma, sigma_l, 1.0)))
    with mpmath.workdps(700):
        noise, diffusion = mpmath.mpf(sigma_l) ** 2, mpmath.mpf(sigma) ** 2 * mpmath.mpf(t)
        prior = (diffusion + mpmath.sqrt(diffusion**2 + 4 * diffusion * noise)) / 2
        kept = prior * noise / (prior + noise)
        mean = kept * (mpmath.mpf(pair[0]) / noise + mpmath.mpf(0.7) / prior)
        later = kept + diffusion
        z = (mpmath.mpf(pair[1]) - mean) / (mpmath.sqrt(later) + noise / mpmath.sqrt(later))
        # What rounding the stimuli's difference and the pull may cost.
        room = (abs(pair[0]) + abs(pair[1]) + 0.7) / (mpmath.sqrt(later) + noise / mpmath.sqrt(later)) * mpmath.mpf(2) ** -50
        low, high = (mpmath.mpf(2) ** -(v**2) for v in (abs(z) + room, max(abs(z) - room, 0)))
        pull = 1 - float(prior / (prior + noise))
    found = float(equal_probability_at(pair[0], pair[1], t, theta))
    assert float(low) * (1 - 1e-12) - 1e-300 <= found <= float(high) * (1 + 1e-12)
    assert 1.0 - float(gain_at(theta, t)) == pytest.approx(pull, abs=1e-15)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_an_interval_is_positive(bad):
    with pytest.raises(InputError, match="positive finite"):
        at_interval(OBSERVER, [1.0, bad])
