"""Bands for distribution functions: coverage by simulation, exact small cases, and what they catch."""

import numpy as np
import pytest
from scipy.stats import binom

from bayes_toe.errors import NumericalError
from bayes_toe.experiments.rank_bands import POINTS, Band, band, counts_below, ecdf_difference, uniformity


def inside(limits, u):
    counts = (u[:, :, None] <= POINTS).sum(axis=1)
    return ((counts >= limits.lower) & (counts <= limits.upper)).all(axis=1)


@pytest.mark.parametrize(("size", "level"), [(40, 0.9), (150, 0.99)])
def test_a_band_holds_as_often_as_it_says(size, level):
    """Independent route: uniform numbers. 4 standard errors: a false alarm in 16,000 runs."""
    rng = np.random.default_rng(11)
    limits = band(size, level)
    trials = 8000
    held = sum(inside(limits, rng.uniform(size=(500, size))).sum() for _ in range(trials // 500)) / trials
    stated = limits.probability
    assert level <= stated < level + 0.02
    assert abs(held - stated) < 4.0 * np.sqrt(stated * (1.0 - stated) / trials)


def test_a_band_that_binds_at_one_point_has_its_binomial_probability():
    lower, upper = np.zeros(len(POINTS), int), np.full(len(POINTS), 30)
    lower[49], upper[49] = 12, 17  # and so the counts before are at most 17, those after at least 12
    upper[:49], lower[50:] = 17, 12
    expected = binom.cdf(17, 30, 0.5) - binom.cdf(11, 30, 0.5)
    assert Band(30, lower, upper).probability == pytest.approx(expected, rel=1e-12)


def test_p_values_are_uniform_and_agree_with_the_band():
    rng = np.random.default_rng(5)
    sets = rng.uniform(size=(1000, 60))
    p = np.array([uniformity(u) for u in sets])
    for level in (0.05, 0.2, 0.5):
        assert abs((p <= level).mean() - level) < 4.0 * np.sqrt(level * (1.0 - level) / len(p)) + 0.02  # counts are whole: p has steps
    limits = band(60, 0.95)
    assert (inside(limits, sets) == (p > 1.0 - limits.probability - 1e-9)).all()


@pytest.mark.parametrize("power", [0.7, 1.4])
def test_a_shift_is_seen_on_either_side(power):
    u = np.random.default_rng(2).uniform(size=500) ** power
    assert uniformity(u) < 1e-5
    difference = ecdf_difference(u)
    assert np.sign(difference[np.abs(difference).argmax()]) == np.sign(power - 1.0)


def test_too_narrow_and_too_wide_posteriors_are_seen():
    rng = np.random.default_rng(3)
    for u in (rng.beta(0.7, 0.7, 800), rng.beta(1.4, 1.4, 800)):
        assert uniformity(u) < 1e-4


def test_impossible_numbers_are_refused():
    assert uniformity(np.zeros(1000)) == 0.0
    assert counts_below([0.01, 0.5]).tolist()[:2] == [1, 1]
    for bad in ([], [0.2, np.nan], [0.2, 1.1]):
        with pytest.raises(NumericalError):
            counts_below(bad)
