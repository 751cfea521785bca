"""Convergence and weight diagnostics: ArviZ's values, computed here, all that is asked of a quantity from one sort.

Where versions of ArviZ differ: draws equal to a quantile are never above it (as in 1.x; 0.x may round them off), and the number of smoothed
weights is rounded up (as in 0.x and in the paper's own software). Tests compare with the ArviZ that is installed.

Chains here are independent ensembles and draws within a chain are walker-major; for walkers as chains, or step-major draws,
rank R-hat and ESS are not valid because the walkers of one ensemble interact.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import betaincinv

from bayes_toe.arrays import FloatArray
from bayes_toe.inference.effective_size import Series, effective_size, r_hat, series
from bayes_toe.inference.pareto_smoothing import smoothed_tail
from bayes_toe.inference.rank_statistics import Ordered, folded, in_order, normal_scores, quantiles, split_chains

#: Tail ESS is the smaller of the two at these probabilities.
TAIL = (0.05, 0.95)
_ONE_SD = (0.1586553, 0.8413447)  # of a normal, below and above its mean
_FEWEST = 4  # draws of a chain that can be judged


class Convergence(NamedTuple):
    """Bulk and tail effective sample size and rank-normalised split R-hat of one scalar quantity."""

    ess_bulk: float
    ess_tail: float
    r_hat: float


class Errors(NamedTuple):
    """Monte Carlo standard errors of the mean and of the 5, 50 and 95 % quantiles of one scalar quantity, in its unit."""

    mean: float
    q05: float
    q50: float
    q95: float


def convergence(draws: npt.ArrayLike) -> Convergence:
    """Diagnostics of draws, shape (chains, draws).

    A constant quantity has no such diagnostics; all three are then NaN. So are those of draws with a NaN, of fewer than four draws, and
    R-hat of a single chain.

    Source: Vehtari, Gelman, Simpson, Carpenter, Buerkner 2021, Bayesian Analysis 16, 667-718.

    Examples
    --------
    >>> draws = np.random.default_rng(0).standard_normal((4, 500))
    >>> convergence(draws).r_hat < 1.01
    True
    """
    return Quantity(draws).convergence


def errors(draws: npt.ArrayLike) -> Errors:
    """Monte Carlo standard errors of what is said of draws, shape (chains, draws); NaN where there is no convergence to judge.

    Examples
    --------
    >>> draws = np.random.default_rng(0).standard_normal((4, 2500))
    >>> 0.008 < errors(draws).mean < 0.012
    True
    """
    return Quantity(draws).errors


class Quantity:
    """Draws of one scalar quantity, shape (chains, draws), sorted once, and what follows from the order; see :func:`convergence`."""

    def __init__(self, draws: npt.ArrayLike) -> None:
        self._draws = np.atleast_2d(np.ascontiguousarray(draws, np.float64))  # of one layout, so that sums have one order
        halves = split_chains(self._draws)
        self._halves, self._ordered = halves, in_order(halves)
        whole = halves.size == self._draws.size
        self.ascending = self._ordered.values if whole else np.sort(self._draws, axis=None)
        # NaN is the last in order, and equal to nothing.
        self._varies = self._draws.shape[1] >= _FEWEST and bool(self.ascending[0] < self.ascending[-1])
        self._sizes: dict[float, float] = {}

    @cached_property
    def convergence(self) -> Convergence:
        """Effective sizes and R-hat."""
        if not self._varies:
            return Convergence(*[np.nan] * 3)
        scores = series(self._scored(self._ordered))
        return Convergence(effective_size(scores), min(map(self._size_at, TAIL)), self._r_hat(scores))

    @property
    def errors(self) -> Errors:
        """Monte Carlo standard errors; see :func:`errors`."""
        if not self._varies:
            return Errors(*[np.nan] * 4)
        mean = self._draws.std(ddof=1) / np.sqrt(effective_size(series(self._halves)))
        return Errors(float(mean), *(float(_errors_at(self.ascending, p, self._size_at(p))) for p in (0.05, 0.5, 0.95)))

    def quantiles(self, probabilities: npt.ArrayLike) -> FloatArray:
        """Quantiles of the draws, to the bit as numpy's."""
        return quantiles(self.ascending, probabilities)

    def tail_error(self, ess: float) -> float:
        """The larger Monte Carlo error of the 5 and 95 % quantiles in units of the range between them, from so many effective draws."""
        low, high = quantiles(self.ascending, TAIL)
        return float(_errors_at(self.ascending, TAIL, ess).max() / (high - low))

    def _size_at(self, probability: float) -> float:
        """Effective size of the share of draws up to the quantile at a probability."""
        if probability not in self._sizes:
            below = self._halves <= quantiles(self.ascending, probability)
            self._sizes[probability] = effective_size(series(below.astype(np.float64)))
        return self._sizes[probability]

    def _r_hat(self, scores: Series) -> float:
        """The larger of that of the normal scores and that of the scores of distances to the median, which tells of different spreads."""
        if len(self._draws) < 2:
            return np.nan
        distances = folded(self._ordered)
        spread = np.nan if np.isnan(distances.values[-1]) else r_hat(series(self._scored(distances)))
        return float(np.fmax(r_hat(scores), spread))

    def _scored(self, ordered: Ordered) -> FloatArray:
        return normal_scores(ordered).reshape(self._halves.shape)


def quantile_errors(draws: npt.ArrayLike, probabilities: npt.ArrayLike, ess: float) -> FloatArray:
    """The same of quantiles where the effective sample size is known, at the price of a sort; draws of any shape, one error a probability.

    The share of draws below the quantile is as uncertain as in `ess` independent ones, Beta(ess p + 1, ess (1 - p) + 1): half of the
    distance between the draws at the ends of its central 68 %. With the smallest of several sizes it is an upper bound.

    Source: Vehtari et al. 2021, section 4.4; the same as ArviZ's with the size at each quantile.

    Examples
    --------
    >>> bool(0.5 <= quantile_errors(np.arange(101.0), [0.5], 10_000)[0] <= 1.5)  # sd of the share 0.005: half a percentile, whole steps
    True
    """
    return _errors_at(np.sort(np.ravel(draws)), np.asarray(probabilities, np.float64), ess)


def _errors_at(ascending: FloatArray, p: npt.ArrayLike, ess: float) -> FloatArray:
    p = np.asarray(p, np.float64)
    if not ess > 0.0:
        return np.full(p.shape, np.nan)
    low, high = (betaincinv(ess * p + 1.0, ess * (1.0 - p) + 1.0, level) * ascending.size - 1.0 for level in _ONE_SD)
    ends = np.maximum(np.floor(low), 0.0), np.minimum(np.ceil(high), ascending.size - 1.0)
    return np.asarray((ascending[ends[1].astype(int)] - ascending[ends[0].astype(int)]) / 2.0)


def pareto_k(log_weights: npt.ArrayLike) -> float:
    """Pareto k-hat of importance weights, shape (draws,): above 0.7 their average cannot be trusted (Vehtari et al. 2024).

    Examples
    --------
    >>> pareto_k(np.log(np.random.default_rng(0).uniform(size=5000))) < 0.7
    True
    """
    return smoothed_tail(np.asarray(log_weights, np.float64))[1]


class SmoothedWeights(NamedTuple):
    """Importance weights with a Pareto-smoothed tail: log weights, shape (draws,), and k-hat."""

    log_weights: FloatArray
    pareto_k: float


def smoothed_weights(log_weights: npt.ArrayLike) -> SmoothedWeights:
    """Pareto-smoothed importance weights (Vehtari et al. 2024) of log weights, shape (draws,); in sum 1.

    Examples
    --------
    >>> smoothed = smoothed_weights(np.random.default_rng(0).standard_normal(5000))
    >>> bool(abs(np.exp(smoothed.log_weights).sum() - 1) < 1e-12), smoothed.pareto_k < 0.7
    (True, True)
    """
    shifted, k = smoothed_tail(np.asarray(log_weights, np.float64))
    return SmoothedWeights(shifted - log_sum(shifted), k)


def smoothed_unnormalised(log_weights: npt.ArrayLike) -> SmoothedWeights:
    """Pareto-smoothed weights on the scale of the raw ones, for sums that matter as such; -inf where a draw has no weight.

    Examples
    --------
    >>> raw = np.random.default_rng(0).normal(0.0, 0.3, 5000)
    >>> smoothed = smoothed_unnormalised(raw)
    >>> bool(abs(np.exp(smoothed.log_weights).mean() - np.exp(raw).mean()) < 0.01), smoothed.pareto_k < 0.7
    (True, True)
    """
    values = np.asarray(log_weights, np.float64)
    shifted, k = smoothed_tail(values)
    return SmoothedWeights(shifted + values.max(), k)


def log_sum(values: FloatArray) -> float:
    """Log of the sum of exp(values), shape (draws,), the largest of them finite. scipy's does more and takes several times as long."""
    top = values.max()
    return float(top + np.log(np.exp(values - top).sum()))
