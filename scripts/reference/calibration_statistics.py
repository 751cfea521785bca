"""How calibration is judged.

Whether ranks are uniform, and whether stated probabilities mean what they say.

Ranks: at a point z the count of n uniform numbers below it is Binomial(n, z). A band cuts the same
tail probability t off every one of these, and t is such that the whole function stays inside with
the stated probability. That probability is exact: counts at successive points are sums of Poisson
numbers given their total, so it takes one convolution a point. Source: Sailynoja, Buerkner and
Vehtari (2022).

Probabilities: the expected calibration error is not 0 even where every probability is right,
because frequencies in bins scatter. Its floor is what right probabilities would show: answers are
drawn anew from the stated probabilities themselves.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.special import expit, log_expit
from scipy.stats import binom, poisson

from bayes_toe.arrays import BoolArray, FloatArray, IntArray, Rng
from bayes_toe.errors import NumericalError

#: Points at which the distribution function of ranks is looked at, 1/100 to 99/100.
POINTS = np.arange(1, 100) / 100.0
_SMALLEST = -700.0  # log of the smallest tail probability that is looked at

#: A p-value below this is not chance.
LEAST_P = 0.001
BINS = 10
_SIMULATIONS = 2000


def place(truth: float, among: FloatArray, rng: Rng) -> float:
    """The place of the truth among draws, in 0..1.

    Ties are broken at random, and so is the position within the place.

    Source: Talts et al. (2018).
    """
    if np.isnan(truth) or np.isnan(among).any():
        raise NumericalError("a ranked quantity is NaN")
    below, tied = (among < truth).sum(), (among == truth).sum()
    return (below + rng.integers(0, tied + 1) + rng.uniform()) / (len(among) + 1)


def counts_below(values: npt.ArrayLike) -> IntArray:
    """How many of the values, all in 0..1, lie at or below each of :data:`POINTS`."""
    return np.searchsorted(np.sort(values), POINTS, side="right").astype(np.int64)


def uniformity(values: npt.ArrayLike) -> float:
    """P-value of the largest deviation of these values from uniform numbers."""
    counts, size = counts_below(values), int(np.size(values))
    tails = np.minimum(binom.logcdf(counts, size, POINTS), binom.logsf(counts - 1, size, POINTS))
    rarest = tails.min() + np.log(2.0)
    if rarest <= _SMALLEST:
        return 0.0
    # A hair more: the values themselves are then outside.
    half = 0.5 * np.exp(min(0.0, rarest + 1e-9))
    lower = binom.ppf(half, size, POINTS).astype(np.int64)
    # The upper tail as a lower one: 1 - half would lose its digits.
    upper = size - binom.ppf(half, size, 1.0 - POINTS).astype(np.int64)
    return max(0.0, 1.0 - probability_inside(lower, upper, size))


def probability_inside(lower: IntArray, upper: IntArray, size: int) -> float:
    """Probability that the counts of so many uniform numbers lie inside at all points.

    The limits are those of the counts below each of :data:`POINTS`. The counts are Poisson steps
    given their total.
    """
    inside, start = np.ones(1), 0
    steps = np.diff(POINTS, prepend=0.0, append=1.0) * size
    for low, high, step in zip([*lower, size], [*upper, size], steps, strict=True):
        rises = poisson.pmf(np.arange(high - start + 1), step)
        inside = np.convolve(inside, rises)[low - start : high - start + 1]
        start = low
    return min(1.0, inside[0] / poisson.pmf(size, size))


def judge_ranks(values: npt.ArrayLike) -> dict[str, float | bool]:
    """Largest difference of ranks from uniform numbers, where it is, and whether it is chance."""
    difference = counts_below(values) / np.size(values) - POINTS
    farthest = int(np.abs(difference).argmax())
    p_value = uniformity(values)
    return {
        "largest_difference": difference[farthest],
        "at": POINTS[farthest],
        "p_value": p_value,
        "calibrated": p_value >= LEAST_P,
    }


def judged_ranks(table: pd.DataFrame, quantities: tuple[str, ...]) -> list[dict[str, object]]:
    """Whether the ranks of each quantity are uniform in each design of a table."""
    rows: list[dict[str, object]] = []
    for design, group in table.groupby("design", sort=False):
        for quantity in quantities:
            ranks = group[quantity].dropna()
            if len(ranks):
                rows.append(
                    {
                        "part": "rank",
                        "design": design,
                        "what": quantity,
                        "data_sets": len(ranks),
                        **judge_ranks(ranks),
                    }
                )
    return rows


# --- probabilities --------------------------------------------------------------------------------


def judge_probabilities(
    log_odds: npt.ArrayLike, true: npt.ArrayLike, rng: Rng
) -> dict[str, float | bool]:
    """Judge probabilities, as natural log odds, against the truth, shape (statements,) each.

    The error of calibration, its mean for right probabilities, the share of simulations of right
    probabilities with an error as large, and the log score in bits.
    """
    odds, y = np.asarray(log_odds, np.float64), np.asarray(true, np.bool_)
    p = expit(odds)
    member = np.eye(BINS)[np.minimum((p * BINS).astype(np.int64), BINS - 1)]

    def error(answers: BoolArray) -> FloatArray:
        return np.abs((answers - p) @ member).sum(axis=1) / len(p)

    observed = error(y[None])[0]
    floor = error(rng.uniform(size=(_SIMULATIONS, len(p))) < p)
    p_value = (1 + (floor >= observed).sum()) / (1 + _SIMULATIONS)
    return {
        "ece": observed,
        "floor": floor.mean(),
        "p_value": p_value,
        "log_score_bits": log_score(odds, y),
        "calibrated": p_value >= LEAST_P,
    }


def log_score(log_odds: npt.ArrayLike, true: npt.ArrayLike) -> float:
    """Mean of minus the log probability given to what was true, bits; infinite where it was 0."""
    odds = np.where(true, log_odds, np.negative(log_odds))
    return -np.mean(log_expit(odds)) / np.log(2.0)
