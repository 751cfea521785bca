"""Bands for ranks: coverage by simulation, exact small cases, what they catch.

Stated probabilities: right ones pass, wrong ones fail.
"""

import numpy as np
import pytest
from numpy.random import default_rng
from reference.calibration_statistics import (
    POINTS,
    band,
    reliability,
)
from scipy.special import expit


def inside(limits, u):
    counts = (u[:, :, None] <= POINTS).sum(axis=1)
    return ((counts >= limits.lower) & (counts <= limits.upper)).all(axis=1)


@pytest.mark.parametrize("size, level", [(40, 0.9), (150, 0.99)])
def test_a_band_holds_as_often_as_it_says(size, level):
    """Independent route: uniform numbers. 4 standard errors: a false alarm in 16,000 runs."""
    rng, limits, trials = default_rng(11), band(size, level), 8000
    held = (
        sum(inside(limits, rng.uniform(size=(500, size))).sum() for _ in range(trials // 500))
        / trials
    )
    assert level <= limits.probability < level + 0.02
    assert abs(held - limits.probability) < 4.0 * np.sqrt(level * (1.0 - level) / trials)


def statements(seed, stretch=1.0, size=2000):
    """Log odds as stated and answers; stated ones are the right ones times `stretch`."""
    rng = default_rng(seed)
    odds = rng.normal(0.3, 2.0, size)
    return stretch * odds, rng.uniform(size=size) < expit(odds), rng


def test_right_probabilities_pass_and_their_error_is_the_floor():
    outcome = [reliability(*statements(seed)) for seed in range(12)]
    assert all(element.calibrated for element in outcome)
    errors, floors = (
        np.array([element.error for element in outcome]),
        np.array([element.floor for element in outcome]),
    )
    assert abs(errors.mean() - floors.mean()) < 4.0 * errors.std(ddof=1) / np.sqrt(len(errors))
    assert min(element.p_value for element in outcome) > 1e-3


@pytest.mark.parametrize("stretch, shift", [(2.5, 0.0), (0.3, 0.0), (-1.0, 0.0), (1.0, 1.0)])
def test_overconfident_timid_reversed_and_shifted_ones_fail(stretch, shift):
    odds, answers, rng = statements(4, stretch)
    outcome = reliability(odds + shift, answers, rng)
    assert not outcome.calibrated
    assert outcome.p_value < 0.001
    assert outcome.log_score > reliability(*statements(4)).log_score
