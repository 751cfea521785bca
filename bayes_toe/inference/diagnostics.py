"""Convergence and weight diagnostics, all computed by ArviZ: the only module that knows ArviZ 0.x from 1.x.

Chains here are independent ensembles and draws within a chain are walker-major; for walkers as chains, or step-major draws,
rank R-hat and ESS are not valid because the walkers of one ensemble interact.
"""

from __future__ import annotations

import importlib.metadata
import warnings
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray

#: Tail ESS is the smaller of the two at these probabilities; fixed here because ArviZ versions differ in their default.
TAIL = (0.05, 0.95)
_ONE_SD = (0.1586553, 0.8413447)  # of a normal, below and above its mean


class Convergence(NamedTuple):
    """Bulk and tail effective sample size and rank-normalised split R-hat of one scalar quantity."""

    ess_bulk: float
    ess_tail: float
    r_hat: float


def convergence(draws: npt.ArrayLike) -> Convergence:
    """Diagnostics of draws, shape (chains, draws).

    A constant quantity has no such diagnostics; all three are then NaN.

    Examples
    --------
    >>> draws = np.random.default_rng(0).standard_normal((4, 500))
    >>> convergence(draws).r_hat < 1.01
    True
    """
    values = np.asarray(draws, np.float64)
    if np.ptp(values) == 0.0:
        return Convergence(np.nan, np.nan, np.nan)
    arviz = _arviz()
    if _is_one():
        axes: dict[str, Any] = {"chain_axis": 0, "draw_axis": 1}
        bulk, tail = (arviz.ess(values, method=m, **axes, **p) for m, p in (("bulk", {}), ("tail", {"prob": TAIL})))
        return Convergence(float(bulk), float(tail), float(arviz.rhat(values, method="rank", **axes)))
    bulk, tail = arviz.ess(values, method="bulk"), arviz.ess(values, method="tail", prob=TAIL)
    return Convergence(float(bulk), float(tail), float(arviz.rhat(values, method="rank")))


class Errors(NamedTuple):
    """Monte Carlo standard errors of the mean and of the 5, 50 and 95 % quantiles of one scalar quantity, in its unit."""

    mean: float
    q05: float
    q50: float
    q95: float


def errors(draws: npt.ArrayLike) -> Errors:
    """Monte Carlo standard errors of what is said of draws, shape (chains, draws); NaN for a constant quantity.

    Examples
    --------
    >>> draws = np.random.default_rng(0).standard_normal((4, 2500))
    >>> 0.008 < errors(draws).mean < 0.012
    True
    """
    values = np.asarray(draws, np.float64)
    if np.ptp(values) == 0.0:
        return Errors(*[np.nan] * 4)
    axes: dict[str, Any] = {"chain_axis": 0, "draw_axis": 1} if _is_one() else {}
    mcse = partial(_arviz().mcse, values, **axes)
    return Errors(float(mcse(method="mean")), *(float(mcse(method="quantile", prob=p)) for p in (0.05, 0.5, 0.95)))


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
    from scipy.stats import beta

    ordered, p = np.sort(np.ravel(draws)), np.asarray(probabilities, np.float64)
    if not ess > 0.0:
        return np.full(p.shape, np.nan)
    low, high = (beta.ppf(level, ess * p + 1.0, ess * (1.0 - p) + 1.0) * ordered.size - 1.0 for level in _ONE_SD)
    ends = np.maximum(np.floor(low), 0.0), np.minimum(np.ceil(high), ordered.size - 1.0)
    return np.asarray((ordered[ends[1].astype(int)] - ordered[ends[0].astype(int)]) / 2.0)


def pareto_k(log_weights: npt.ArrayLike) -> float:
    """Pareto k-hat of importance weights, shape (draws,): above 0.7 their average cannot be trusted (Vehtari et al. 2024).

    Examples
    --------
    >>> pareto_k(np.log(np.random.default_rng(0).uniform(size=5000))) < 0.7
    True
    """
    return smoothed_weights(log_weights).pareto_k


class SmoothedWeights(NamedTuple):
    """Importance weights with a Pareto-smoothed tail: normalised log weights, shape (draws,), and k-hat."""

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
    values = np.asarray(log_weights, np.float64)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # ArviZ warns of a large k-hat; here the number itself is the result
        # 0.x takes log weights; 1.x takes log likelihoods to be left out, that is, their negative.
        smoothed, k = _arviz().psislw(-values if _is_one() else values)
    result = np.asarray(smoothed, np.float64)
    return SmoothedWeights(result - log_sum(result), float(np.asarray(k)))


def log_sum(values: FloatArray) -> float:
    """Log of the sum of exp(values), shape (draws,), the largest of them finite. scipy's does more and takes several times as long."""
    top = values.max()
    return float(top + np.log(np.exp(values - top).sum()))


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
    made, k = smoothed_weights(values)
    # All weights but the tail are the raw ones up to a constant, which the median weight tells.
    middle = np.argsort(values)[len(values) - np.count_nonzero(np.isfinite(values)) // 2 - 1]
    return SmoothedWeights(np.where(np.isfinite(values), made + (values[middle] - made[middle]), -np.inf), k)


@cache
def _is_one() -> bool:
    # hasattr(arviz, "InferenceData") would be true on 1.2 and later as well: only the version tells.
    return int(importlib.metadata.version("arviz").split(".")[0]) >= 1


@cache
def _arviz() -> Any:
    """The array functions of whichever ArviZ is installed, imported at first use because it is slow to import."""
    if _is_one():
        from arviz_stats.base import array_stats

        return array_stats
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # 0.23 announces its refactoring at import
        import arviz

    return arviz
