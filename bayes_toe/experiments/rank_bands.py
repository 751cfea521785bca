"""Whether numbers are uniform on (0, 1): their empirical distribution function with bands that hold at all points at once.

At a point z the count of n uniform numbers below it is Binomial(n, z). A band cuts the same tail probability t off every one of these, and
t is such that the whole function stays inside with the stated probability. That probability is exact: counts at successive points are
sums of Poisson numbers given their total, so it takes one convolution a point. Source: Sailynoja, Buerkner and Vehtari (2022).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import gammaln
from scipy.stats import binom

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.errors import NumericalError

#: Points at which the function is looked at, 1/100 to 99/100.
POINTS = np.arange(1, 100) / 100.0
_HALVINGS = 60
_SMALLEST = -700.0  # log of the smallest tail probability that is looked at


@dataclass(frozen=True, eq=False)
class Band:
    """Smallest and largest counts below each of :data:`POINTS` that lie inside, each of shape (points,)."""

    size: int
    lower: IntArray
    upper: IntArray

    @property
    def probability(self) -> float:
        """Probability that the counts of `size` independent uniform numbers lie inside at all points."""
        return _stay(self.size, self.lower, self.upper)

    def differences(self) -> tuple[FloatArray, FloatArray]:
        """The band as it is drawn: lower and upper share of the numbers, minus the uniform one."""
        return self.lower / self.size - POINTS, self.upper / self.size - POINTS


def band(size: int, level: float) -> Band:
    """The narrowest band inside which `size` uniform numbers stay with at least the probability `level`.

    Examples
    --------
    >>> 0.99 <= band(1000, 0.99).probability < 0.991
    True
    """
    low, high = _SMALLEST, 0.0  # of log t; the probability falls as t grows
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _cut(size, middle).probability >= level else (low, middle)
    return _cut(size, low)


def counts_below(values: npt.ArrayLike) -> IntArray:
    """How many of the values lie at or below each of :data:`POINTS`.

    Raises
    ------
    NumericalError
        If a value is not between 0 and 1.
    """
    u = np.sort(np.asarray(values, np.float64))
    if len(u) == 0 or not (u[0] >= 0.0 and u[-1] <= 1.0):
        raise NumericalError("ranks must be numbers between 0 and 1")
    return np.searchsorted(u, POINTS, side="right").astype(np.int64)


def ecdf_difference(values: npt.ArrayLike) -> FloatArray:
    """Share of the values at or below each of :data:`POINTS`, minus the uniform share, shape (points,)."""
    return counts_below(values) / np.size(values) - POINTS


def uniformity(values: npt.ArrayLike) -> float:
    """Probability that as many uniform numbers stray as far as these values, at the point where they stray most: a p-value.

    Examples
    --------
    >>> grid = (np.arange(200) + 0.5) / 200
    >>> uniformity(grid) > 0.99, uniformity(grid**2) < 1e-6
    (True, True)
    """
    counts, size = counts_below(values), int(np.size(values))
    tails = np.minimum(binom.logcdf(counts, size, POINTS), binom.logsf(counts - 1, size, POINTS))
    rarest = float(tails.min()) + np.log(2.0)
    if rarest <= _SMALLEST:
        return 0.0
    # A hair more: the values themselves are then outside.
    return max(0.0, 1.0 - _cut(size, min(0.0, rarest + 1e-9)).probability)


def _cut(size: int, log_tail: float) -> Band:
    """The band that leaves half of the tail probability on either side of every point."""
    half = 0.5 * np.exp(log_tail)
    lower = binom.ppf(half, size, POINTS)
    upper = size - binom.ppf(half, size, 1.0 - POINTS)  # the upper tail as a lower one: 1 - half would lose its digits
    return Band(size, lower.astype(np.int64), upper.astype(np.int64))


def _stay(size: int, lower: IntArray, upper: IntArray) -> float:
    """Probability that all counts lie inside: Poisson steps, and the total is `size`."""
    if np.any(lower > upper):
        return 0.0
    lows, highs = np.append(lower, size), np.append(upper, size)
    steps = np.diff(np.concatenate([[0.0], POINTS, [1.0]])) * size
    inside, start = np.ones(1), 0
    for low, high, step in zip(lows, highs, steps, strict=True):
        k = np.arange(high - start + 1)
        reached = np.convolve(inside, np.exp(k * np.log(step) - step - gammaln(k + 1.0)))
        inside, start = reached[low - start : high - start + 1], low
    total = size * np.log(size) - size - gammaln(size + 1.0)
    return float(min(1.0, inside[0] * np.exp(-total)))
