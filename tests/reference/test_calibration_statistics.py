"""Bands for ranks hold as often as they say, by simulation."""

import numpy as np
import pytest
from numpy.random import default_rng
from reference.calibration_statistics import (
    POINTS,
    band,
)


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
