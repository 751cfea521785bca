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

#: Tail ESS is the smaller ESS of the quantiles at these probabilities.
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

    All four are NaN where the diagnostics of :func:`convergence` are.
    """
    return errors_of({"": draws})[""]


def convergence_of(quantities: NamedArrays) -> dict[str, Convergence]:
    """:func:`convergence` of many quantities by name; draws of all have the same shape."""
    values = _measure_all(_CONVERGENCE, quantities)
    return dict(zip(quantities, map(Convergence._make, values), strict=True))


def errors_of(quantities: NamedArrays) -> dict[str, Errors]:
    """:func:`errors` of many quantities by name; draws of all have the same shape."""
    return dict(zip(quantities, map(Errors._make, _measure_all(_ERRORS, quantities)), strict=True))


def _measure_all(
    measures: tuple[Callable[[FloatArray], FloatArray], ...], quantities: NamedArrays
) -> list[list[float]]:
    """A list of the measures for each quantity, whose draws have the shape (chains, draws).

    The measures of a constant are NaN, because ArviZ would count all of its draws as effective.
    """
    draws = np.stack(list(quantities.values()))  # (quantities, chains, draws)
    values = np.full((len(draws), len(measures)), np.nan)
    varies = draws.max(axis=(1, 2)) > draws.min(axis=(1, 2))  # False where a draw is NaN
    if varies.any():  # ArviZ fails without a quantity
        with np.errstate(all="ignore"):  # infinite draws, and chains that do not vary
            values[varies] = np.stack([measure(draws[varies]) for measure in measures], axis=-1)
    return values.tolist()


def worst(
    convergences: Mapping[str, Convergence],
) -> tuple[tuple[str, float], tuple[str, float]]:
    """The quantity with the fewest effective draws, and the quantity with the largest R-hat.

    Each name comes with its number. The effective draws of a quantity are the fewer of bulk and
    tail. NaN counts as the worst value: as 0 effective draws, and as an infinite R-hat.
    """
    ess = {}
    r_hat = {}
    for name, diagnostics in convergences.items():
        fewest = np.minimum(diagnostics.ess_bulk, diagnostics.ess_tail)  # NaN if either is NaN
        ess[name] = float(np.nan_to_num(fewest))
        r_hat[name] = float(np.nan_to_num(diagnostics.r_hat, nan=np.inf))
    number = itemgetter(1)
    return min(ess.items(), key=number), max(r_hat.items(), key=number)


def shortfall(convergences: Mapping[str, Convergence], required: int, max_r_hat: float) -> str:
    """The criteria of convergence that were not met, in words; empty if all were met.

    Every quantity needs at least `required` effective draws and an R-hat below `max_r_hat`.

    Examples
    --------
    >>> shortfall({"p": Convergence(399.7, 900.0, 1.0103)}, 400, 1.01)
    '399 effective draws of p, 400 required; R-hat 1.011 of p, below 1.01 required'
    """
    # Neither number is NaN, which would pass its comparison: `worst` turns a NaN into 0 effective
    # draws or an infinite R-hat.
    (lowest, ess), (highest, r_hat) = worst(convergences)
    problems = []
    # A number is rounded away from its limit, or 399.7 would read "400 effective draws, 400
    # required". Half a unit of the last digit is added to R-hat, so that R-hat is rounded up.
    if ess < required:
        problems.append(f"{int(ess)} effective draws of {lowest}, {required} required")
    if r_hat >= max_r_hat:
        problems.append(f"R-hat {r_hat + 0.0005:.3f} of {highest}, below {max_r_hat:g} required")
    return "; ".join(problems)


def quantile_errors(draws: npt.ArrayLike, probabilities: npt.ArrayLike, ess: float) -> FloatArray:
    """Monte Carlo errors of quantiles where the effective sample size is known.

    Draws may have any shape. There is one error for each probability.

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

    # The ends of the central 68 % of Beta(a, b). A normal has 68 % within one SD of its mean.
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

    Above 0.7, averages with these weights cannot be trusted.
    """
    with np.errstate(all="ignore"):  # warnings of weights of 0 and of nearly flat tails
        try:
            smoothed, k = array_stats.psislw(-log_weights)  # ArviZ takes the opposite sign
        except (ValueError, IndexError):  # a tail of fewer than five weights, or of equal weights
            return np.inf
    if not np.isfinite(k) or np.isnan(smoothed).any():
        return np.inf
    return float(k)
