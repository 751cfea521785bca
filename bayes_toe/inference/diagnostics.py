"""Convergence, Monte Carlo errors and Pareto smoothing, by arviz_stats.

Chains here are independent ensembles and draws within a chain are walker-major; for walkers as
chains, or step-major draws, rank R-hat and ESS are not valid because the walkers of one ensemble
interact.

Sources: Vehtari, Gelman, Simpson, Carpenter, Buerkner 2021, Rank-normalization, folding, and
localization, Bayesian Analysis 16, 667-718; Vehtari, Simpson, Gelman, Yao, Gabry 2024, Pareto
smoothed importance sampling, Journal of Machine Learning Research 25(72), 1-58.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from operator import itemgetter
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from arviz_stats.base import array_stats
from scipy.special import betaincinv

from bayes_toe.arrays import FloatArray, NamedArrays

#: Tail ESS is the smaller of the two at these probabilities.
TAIL = (0.05, 0.95)


class Convergence(NamedTuple):
    """Bulk and tail effective sample size and rank-normalised split R-hat of a quantity."""

    ess_bulk: float
    ess_tail: float
    r_hat: float


class Errors(NamedTuple):
    """Monte Carlo standard errors of the mean and of quantiles of a quantity, in its unit."""

    mean: float
    q05: float
    q50: float
    q95: float


_CONVERGENCE = (
    partial(array_stats.ess, method="bulk"),
    partial(array_stats.ess, method="tail", prob=TAIL),
    partial(array_stats.rhat, method="rank"),
)
_ERRORS = (
    partial(array_stats.mcse, method="mean"),
    *(partial(array_stats.mcse, method="quantile", prob=p) for p in (0.05, 0.5, 0.95)),
)


def convergence(draws: FloatArray) -> Convergence:
    """Diagnostics of draws, shape (chains, draws).

    A constant quantity has no such diagnostics; all three are then NaN. So are those of draws with
    a NaN, of fewer than four draws, and R-hat of a single chain.
    """
    return convergence_of({"": draws})[""]


def errors(draws: FloatArray) -> Errors:
    """Monte Carlo standard errors of what is said of draws, shape (chains, draws).

    NaN where there is no convergence to judge.
    """
    return errors_of({"": draws})[""]


def convergence_of(quantities: NamedArrays) -> dict[str, Convergence]:
    """:func:`convergence` of many quantities of one shape, by name, in one go."""
    if not quantities:
        return {}
    values = _measured(_CONVERGENCE, quantities)
    return dict(zip(quantities, map(Convergence._make, values), strict=True))


def errors_of(quantities: NamedArrays) -> dict[str, Errors]:
    """:func:`errors` of many quantities of one shape, by name, in one go."""
    return dict(zip(quantities, map(Errors._make, _measured(_ERRORS, quantities)), strict=True))


def _measured(
    measures: tuple[Callable[[FloatArray], FloatArray], ...], quantities: NamedArrays
) -> list[list[float]]:
    """Diagnostics of draws, (chains, draws) of each quantity.

    They are NaN for a constant, for which ArviZ would count all draws as effective.
    """
    draws = np.stack(list(quantities.values()))
    values = np.full((len(draws), len(measures)), np.nan)
    varies = draws.max(axis=(1, 2)) > draws.min(axis=(1, 2))  # NaN is above nothing
    if varies.any():
        with np.errstate(all="ignore"):  # of infinite draws, and of chains none of which varies
            values[varies] = np.stack([measure(draws[varies]) for measure in measures], axis=-1)
    return values.tolist()


def worst(
    convergences: Mapping[str, Convergence],
) -> tuple[tuple[str, float], tuple[str, float]]:
    """The quantity with the fewest effective draws, and the one with the largest R-hat.

    Each comes with its number; effective draws are the fewer of bulk and tail. NaN is worst.
    """
    ess = {}
    r_hat = {}
    for name, convergence in convergences.items():
        ess[name] = float(np.nan_to_num(np.min(convergence[:2])))
        r_hat[name] = float(np.nan_to_num(convergence.r_hat, nan=np.inf))
    value = itemgetter(1)
    return min(ess.items(), key=value), max(r_hat.items(), key=value)


def shortfall(convergences: Mapping[str, Convergence], draws: int, max_r_hat: float) -> str:
    """The criteria that were not met, in words; empty if all were."""
    (lowest, ess), (highest, r_hat) = worst(convergences)
    problems = []
    if ess < draws:
        problems.append(f"{ess:.0f} effective draws of {lowest}, {draws} required")
    if r_hat >= max_r_hat:
        problems.append(f"R-hat {r_hat:.3f} of {highest}, below {max_r_hat:g} required")
    return "; ".join(problems)


def quantile_errors(draws: npt.ArrayLike, probabilities: npt.ArrayLike, ess: float) -> FloatArray:
    """Monte Carlo errors of quantiles where the effective sample size is known.

    Draws of any shape, one error a probability.

    The share of draws below the quantile is as uncertain as in `ess` independent ones, Beta(ess p +
    1, ess (1 - p) + 1): half of the distance between the draws at the ends of its central 68 %.
    With the smallest of several sizes it is an upper bound.

    Source: Vehtari et al. 2021, section 4.4.
    """
    ascending = np.sort(np.ravel(draws))
    p = np.asarray(probabilities, np.float64)
    if not ess > 0.0:
        return np.full(p.shape, np.nan)

    a = ess * p + 1.0
    b = ess * (1.0 - p) + 1.0
    size = ascending.size
    below, above = 0.1586553, 0.8413447  # one SD of a normal below its mean, and above it

    low_place = np.floor(betaincinv(a, b, below) * size - 1.0)
    high_place = np.ceil(betaincinv(a, b, above) * size - 1.0)

    low = ascending[np.maximum(low_place, 0.0).astype(int)]
    high = ascending[np.minimum(high_place, size - 1.0).astype(int)]
    return (high - low) / 2.0


def tail_error(draws: FloatArray, ess: float) -> float:
    """The larger Monte Carlo error of the 5 and 95 % quantiles over the range between them.

    `ess` is the effective number of draws.
    """
    low, high = np.quantile(draws, TAIL)
    return float(quantile_errors(draws, TAIL, ess).max() / (high - low))


# --- Pareto smoothing -----------------------------------------------------------------------------


def pareto_k(log_weights: FloatArray) -> float:
    """Pareto k-hat of importance weights, shape (draws,); infinite where there is no tail.

    Above 0.7 their average cannot be trusted.
    """
    with np.errstate(all="ignore"):  # weights of zero, and tails that are all but flat
        try:
            smoothed, k = array_stats.psislw(-log_weights)  # it takes negative ones
        except ValueError:  # a tail of fewer than five weights, or of equal ones
            return np.inf
        return float(k) if np.isfinite(k) and not np.isnan(smoothed).any() else np.inf
