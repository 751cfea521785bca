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


#: The numbers of :class:`Convergence` and of :class:`Errors`, in their order, each computed from
#: draws of many quantities, (quantities, chains, draws).
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

    All three are NaN for a constant, for draws with a NaN, and for fewer than four draws. R-hat of
    a single chain is NaN too.
    """
    return convergence_of({"": draws})[""]


def errors(draws: FloatArray) -> Errors:
    """Monte Carlo standard errors of draws, shape (chains, draws).

    NaN as in :func:`convergence`.
    """
    return errors_of({"": draws})[""]


def convergence_of(quantities: NamedArrays) -> dict[str, Convergence]:
    """:func:`convergence` of many quantities of one shape, by name, in one go."""
    values = _measured(_CONVERGENCE, quantities)
    return dict(zip(quantities, map(Convergence._make, values), strict=True))


def errors_of(quantities: NamedArrays) -> dict[str, Errors]:
    """:func:`errors` of many quantities of one shape, by name, in one go."""
    return dict(zip(quantities, map(Errors._make, _measured(_ERRORS, quantities)), strict=True))


def _measured(
    measures: tuple[Callable[[FloatArray], FloatArray], ...], quantities: NamedArrays
) -> list[list[float]]:
    """For each quantity a list of the measures of its draws, (chains, draws).

    All are NaN for a constant, for which ArviZ would count all draws as effective.
    """
    draws = np.stack(list(quantities.values()))  # (quantities, chains, draws)
    values = np.full((len(draws), len(measures)), np.nan)
    varies = draws.max(axis=(1, 2)) > draws.min(axis=(1, 2))  # False where a draw is NaN
    if varies.any():  # ArviZ fails without a quantity
        with np.errstate(all="ignore"):  # of infinite draws, and of chains none of which varies
            values[varies] = np.stack([measure(draws[varies]) for measure in measures], axis=-1)
    return values.tolist()


def worst(
    convergences: Mapping[str, Convergence],
) -> tuple[tuple[str, float], tuple[str, float]]:
    """The quantity with the fewest effective draws, and the one with the largest R-hat.

    Each comes with its number; effective draws are the fewer of bulk and tail. NaN is worst: 0
    effective draws, and an infinite R-hat.
    """
    ess = {}
    r_hat = {}
    for name, diagnostics in convergences.items():
        fewest = np.minimum(diagnostics.ess_bulk, diagnostics.ess_tail)  # NaN if one is NaN
        ess[name] = float(np.nan_to_num(fewest))
        r_hat[name] = float(np.nan_to_num(diagnostics.r_hat, nan=np.inf))
    number = itemgetter(1)
    return min(ess.items(), key=number), max(r_hat.items(), key=number)


def shortfall(convergences: Mapping[str, Convergence], required: int, max_r_hat: float) -> str:
    """The criteria that were not met, in words; empty if all were.

    Every quantity needs the `required` effective draws and an R-hat below the largest one allowed.
    """
    (lowest, ess), (highest, r_hat) = worst(convergences)
    problems = []
    if ess < required:
        problems.append(f"{ess:.0f} effective draws of {lowest}, {required} required")
    if r_hat >= max_r_hat:
        problems.append(f"R-hat {r_hat:.3f} of {highest}, below {max_r_hat:g} required")
    return "; ".join(problems)


def quantile_errors(draws: npt.ArrayLike, probabilities: npt.ArrayLike, ess: float) -> FloatArray:
    """Monte Carlo errors of quantiles where the effective sample size is known.

    Draws have any shape. There is one error for each probability.

    The share of draws below the p-quantile is as uncertain as that of `ess` independent draws: it
    has the distribution Beta(ess p + 1, ess (1 - p) + 1). The error is half of the distance between
    the draws at the ends of its central 68 %. With the smallest of several effective sample sizes
    it is an upper bound.

    Source: Vehtari et al. 2021, section 4.4.
    """
    ascending = np.sort(np.ravel(draws))
    p = np.asarray(probabilities, np.float64)
    if not ess > 0.0:  # NaN too
        return np.full(p.shape, np.nan)

    # The ends of the central 68 % of Beta(a, b): as one SD of a normal below and above its mean.
    a = ess * p + 1.0
    b = ess * (1.0 - p) + 1.0
    low_share = betaincinv(a, b, 0.1586553)
    high_share = betaincinv(a, b, 0.8413447)

    # The draw with a share q of all draws up to it has the index q size - 1; both round outward.
    size = ascending.size
    low_index = np.floor(low_share * size - 1.0)
    high_index = np.ceil(high_share * size - 1.0)

    # Rounded outward, an index may be one beyond the first or the last draw.
    low = ascending[np.maximum(low_index, 0.0).astype(int)]
    high = ascending[np.minimum(high_index, size - 1.0).astype(int)]
    return (high - low) / 2.0


def tail_error(draws: FloatArray, ess: float) -> float:
    """The larger Monte Carlo error of the 5 and 95 % quantiles over the range between them.

    `ess` is the effective number of draws.
    """
    low, high = np.quantile(draws, TAIL)
    return float(quantile_errors(draws, TAIL, ess).max() / (high - low))


# --- Pareto smoothing -----------------------------------------------------------------------------


def pareto_k(log_weights: FloatArray) -> float:
    """Pareto k-hat of importance weights, shape (draws,); infinite where no tail can be fitted.

    Above 0.7 their average cannot be trusted.
    """
    with np.errstate(all="ignore"):  # weights of zero, and tails that are all but flat
        try:
            smoothed, k = array_stats.psislw(-log_weights)  # ArviZ takes the opposite sign
        except (ValueError, IndexError):  # a tail of fewer than five weights, or of equal ones
            return np.inf
    if not np.isfinite(k) or np.isnan(smoothed).any():
        return np.inf
    return float(k)
