"""Calibration of stated probabilities: right ones pass, overconfident ones fail, and the floor is what right ones show."""

import numpy as np
import pytest
from scipy.special import expit
from scipy.stats import binomtest

from bayes_toe.errors import InputError
from bayes_toe.experiments.reliability import log_score, reliability, reliability_bins


def statements(seed, stretch=1.0, size=2000, spread=2.0):
    """Log odds as stated and answers; stated ones are the right ones times `stretch`."""
    rng = np.random.default_rng(seed)
    odds = rng.normal(0.3, spread, size)
    return stretch * odds, rng.uniform(size=size) < expit(odds), rng


def test_right_probabilities_pass_and_their_error_is_the_floor():
    found = [reliability(*statements(seed)) for seed in range(12)]
    assert all(one.calibrated for one in found)
    errors, floors = np.array([one.error for one in found]), np.array([one.floor for one in found])
    assert abs(errors.mean() - floors.mean()) < 4.0 * errors.std(ddof=1) / np.sqrt(len(errors))
    assert min(one.p_value for one in found) > 1e-3


@pytest.mark.parametrize("stretch", [2.5, 0.3, -1.0])
def test_overconfident_timid_and_reversed_ones_fail(stretch):
    found = reliability(*statements(4, stretch))
    assert not found.calibrated
    assert found.p_value < 0.001
    assert found.log_score > reliability(*statements(4)).log_score


def test_a_constant_shift_of_the_evidence_fails():
    odds, answers, rng = statements(5)
    assert not reliability(odds + 1.0, answers, rng).calibrated


def test_scores_by_hand():
    odds, answers = np.log([0.8 / 0.2, 0.25 / 0.75]), np.array([True, True])
    found = reliability(odds, answers, np.random.default_rng(0))
    assert found.brier == pytest.approx((0.04 + 0.5625) / 2)
    assert found.log_score == pytest.approx(-(np.log(0.8) + np.log(0.25)) / 2)
    assert found.error == pytest.approx((0.2 + 0.75) / 2)
    assert log_score([800.0], [False]) == pytest.approx(800.0)  # beyond where the probability itself is 1


def test_bins_hold_frequencies_with_exact_intervals():
    odds, answers, _ = statements(6, size=300)
    bins = reliability_bins(odds, answers)
    assert bins.count.sum() == 300
    for n, observed, lower, upper in zip(bins.count, bins.observed, bins.lower, bins.upper, strict=True):
        interval = binomtest(round(n * observed), int(n)).proportion_ci(0.95, "exact")
        assert (lower, upper) == pytest.approx((interval.low, interval.high), abs=1e-9)


def test_nothing_to_judge_is_refused():
    rng = np.random.default_rng(0)
    for odds, answers in (([], []), ([0.0], [True, False]), ([np.nan], [True])):
        with pytest.raises(InputError):
            reliability(odds, answers, rng)
