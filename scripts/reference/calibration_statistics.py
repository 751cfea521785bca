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

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import expit, gammaln, log_expit
from scipy.stats import binom

from bayes_toe.arrays import BoolArray, FloatArray, IntArray
from bayes_toe.errors import InputError, NumericalError

#: Points at which the distribution function of ranks is looked at, 1/100 to 99/100.
POINTS = np.arange(1, 100) / 100.0
_SMALLEST = -700.0  # log of the smallest tail probability that is looked at

#: A p-value below this is not chance.
LEAST_P = 0.001
BINS = 10
_SIMULATIONS = 2000


@dataclass(frozen=True, eq=False)
class Band:
    """Smallest and largest counts below each of :data:`POINTS` that lie inside, (points,) each."""

    size: int
    lower: IntArray
    upper: IntArray

    @property
    def probability(self) -> float:
        """Probability that the counts of `size` uniform numbers lie inside at all points.

        They are Poisson steps given their total.
        """
        if np.any(self.lower > self.upper):
            return 0.0
        inside, start = np.ones(1), 0
        steps = np.diff(POINTS, prepend=0.0, append=1.0) * self.size
        for low, high, step in zip(
            np.append(self.lower, self.size), np.append(self.upper, self.size), steps, strict=True
        ):
            k = np.arange(high - start + 1)
            reached = np.convolve(inside, np.exp(k * np.log(step) - step - gammaln(k + 1.0)))
            inside, start = reached[low - start : high - start + 1], low
        total = self.size * np.log(self.size) - self.size - gammaln(self.size + 1.0)
        return float(min(1.0, inside[0] * np.exp(-total)))


def place(truth: float, among: FloatArray, rng: np.random.Generator) -> float:
    """The place of the truth among draws, in 0..1.

    Ties are broken at random, and so is the position within the place.

    Source: Talts et al. (2018).
    """
    if np.isnan(truth) or np.isnan(among).any():
        raise NumericalError("a ranked quantity is NaN")
    below, tied = int((among < truth).sum()), int((among == truth).sum())
    return float((below + rng.integers(0, tied + 1) + rng.uniform()) / (len(among) + 1))


def counts_below(values: npt.ArrayLike) -> IntArray:
    """How many of the values, all in 0..1, lie at or below each of :data:`POINTS`."""
    u = np.sort(np.asarray(values, np.float64))
    if len(u) == 0 or not (u[0] >= 0.0 and u[-1] <= 1.0):
        raise NumericalError("ranks must be numbers between 0 and 1")
    return np.searchsorted(u, POINTS, side="right").astype(np.int64)


def uniformity(values: npt.ArrayLike) -> float:
    """P-value of the largest deviation of these values from uniform numbers."""
    counts, size = counts_below(values), int(np.size(values))
    tails = np.minimum(binom.logcdf(counts, size, POINTS), binom.logsf(counts - 1, size, POINTS))
    rarest = float(tails.min()) + np.log(2.0)
    if rarest <= _SMALLEST:
        return 0.0
    # A hair more: the values themselves are then outside.
    return max(0.0, 1.0 - _cut(size, min(0.0, rarest + 1e-9)).probability)


def judge_ranks(values: npt.ArrayLike) -> dict[str, float | bool]:
    """Largest difference of ranks from uniform numbers, where it is, and whether it is chance."""
    difference = counts_below(values) / np.size(values) - POINTS
    farthest = int(np.abs(difference).argmax())
    p_value = uniformity(values)
    return {
        "largest_difference": float(difference[farthest]),
        "at": float(POINTS[farthest]),
        "p_value": p_value,
        "calibrated": p_value >= LEAST_P,
    }


def _cut(size: int, log_tail: float) -> Band:
    """The band that leaves half of the tail probability on either side of every point."""
    half = 0.5 * np.exp(log_tail)
    lower = binom.ppf(half, size, POINTS)
    upper = size - binom.ppf(
        half, size, 1.0 - POINTS
    )  # the upper tail as a lower one: 1 - half would lose its digits
    return Band(size, lower.astype(np.int64), upper.astype(np.int64))


# --- probabilities --------------------------------------------------------------------------------


def judge_probabilities(
    log_odds: npt.ArrayLike, true: npt.ArrayLike, rng: np.random.Generator
) -> dict[str, float | bool]:
    """Judge probabilities, as natural log odds, against the truth, shape (statements,) each.

    The error of calibration, its mean for right probabilities, the share of simulations of right
    probabilities with an error as large, and the log score in bits.
    """
    odds, y = np.asarray(log_odds, np.float64), np.asarray(true, np.bool_)
    if odds.shape != y.shape or odds.ndim != 1 or len(odds) == 0 or np.isnan(odds).any():
        raise InputError(
            "log odds and truth must have one common length of at least 1, without NaN"
        )
    p = expit(odds)
    member = np.eye(BINS)[np.minimum((p * BINS).astype(np.int64), BINS - 1)]

    def error(answers: BoolArray) -> FloatArray:
        return np.abs((answers - p) @ member).sum(axis=1) / len(p)

    observed = error(y[None])[0]
    right = [error(rng.uniform(size=(100, len(p))) < p) for _ in range(_SIMULATIONS // 100)]
    floor = np.concatenate(right)
    p_value = float((1 + (floor >= observed).sum()) / (1 + _SIMULATIONS))
    return {
        "ece": float(observed),
        "floor": float(floor.mean()),
        "p_value": p_value,
        "log_score_bits": log_score(odds, y),
        "calibrated": p_value >= LEAST_P,
    }


def log_score(log_odds: npt.ArrayLike, true: npt.ArrayLike) -> float:
    """Mean of minus the log probability given to what was true, bits; infinite where it was 0."""
    odds = np.where(true, log_odds, np.negative(log_odds))
    return float(-np.mean(log_expit(odds)) / np.log(2.0))
