"""Importance weights whose largest are replaced by quantiles of a generalised Pareto distribution fitted to them.

Sources: Vehtari, Simpson, Gelman, Yao, Gabry 2024, Pareto smoothed importance sampling, Journal of Machine Learning Research 25(72), 1-58;
Zhang and Stephens 2009, A new and efficient estimation method for the generalized Pareto distribution, Technometrics 51, 316-325.
"""

from __future__ import annotations

import numpy as np

from bayes_toe.arrays import FloatArray

_FEWEST = 5  # weights in a tail that can be fitted
_PRIOR_WEIGHT, _PRIOR_K = 10.0, 0.5  # k-hat is drawn towards one half as by ten more weights
_SMALLEST = float(np.finfo(np.float64).tiny)
_EPSILON = float(np.finfo(np.float64).eps)


def smoothed_tail(log_weights: FloatArray) -> tuple[FloatArray, float]:
    """Log weights, shape (draws,), relative to the largest raw one, with a smoothed tail; and k-hat, infinite where no tail can be fitted.

    The tail are the weights above the (M + 1)-th largest, M the smaller of a fifth of the draws and 3 sqrt(draws), rounded up.

    Source: Vehtari et al. 2024, section 3 and appendix G.

    Examples
    --------
    >>> shifted, k = smoothed_tail(np.random.default_rng(0).standard_normal(5000))
    >>> bool(shifted.max() <= 0.0), k < 0.7
    (True, True)
    """
    with np.errstate(invalid="ignore"):  # without a finite largest weight there are none, which NaN says
        shifted = log_weights - log_weights.max()
    cut = _cut(shifted)
    tail = np.flatnonzero(shifted > cut)
    if len(tail) < _FEWEST:
        return shifted, float("inf")
    tail = tail[np.argsort(shifted[tail])]
    threshold = np.exp(cut)
    excess = np.exp(shifted[tail]) - threshold
    if not _quartile(excess) > 0.0:  # they differ from the cut by less than a float can tell
        return shifted, float("inf")
    k, scale = fitted_pareto(excess)
    middles = np.arange(0.5, len(tail)) / len(tail)
    shifted[tail] = np.minimum(np.log(pareto_quantiles(middles, k, scale) + threshold), 0.0)
    return shifted, k


def _cut(shifted: FloatArray) -> float:
    """Log of the weight above which the tail begins, if as a number above zero."""
    size = len(shifted)
    place = size - 1 - int(np.ceil(min(size / 5.0, 3.0 * np.sqrt(size))))
    return float(np.maximum(np.partition(shifted, place)[place], np.log(_SMALLEST)))


def _quartile(ascending: FloatArray) -> float:
    return float(ascending[int(len(ascending) / 4.0 + 0.5) - 1])


def fitted_pareto(ascending: FloatArray) -> tuple[float, float]:
    """Shape k and scale of a generalised Pareto distribution of ascending positive values, shape (values,).

    The posterior mean of theta = -k / scale on a grid, under Zhang and Stephens' prior of it, then k at this theta, drawn to one half.

    Source: Zhang and Stephens 2009, section 3; Vehtari et al. 2024, appendix G. k here is minus theirs.

    Examples
    --------
    >>> k, scale = fitted_pareto(np.sort(np.random.default_rng(0).pareto(2.0, 4000)))
    >>> round(k, 1), round(scale, 1)
    (0.5, 0.5)
    """
    size = len(ascending)
    points = 30 + int(np.sqrt(size))
    theta = 1.0 / ascending[-1] + (1.0 - np.sqrt(points / np.arange(0.5, points))) / (3.0 * _quartile(ascending))
    shapes = np.log1p(-theta[:, None] * ascending).mean(axis=1)
    log_likelihood = size * (np.log(-theta / shapes) - shapes - 1.0)
    weights = np.exp(log_likelihood - log_likelihood.max())
    weights /= weights.sum()
    counted = weights >= 10.0 * _EPSILON
    mean = float((theta * weights)[counted].sum() / weights[counted].sum())
    k = float(np.log1p(-mean * ascending).mean())
    return (size * k + _PRIOR_WEIGHT * _PRIOR_K) / (size + _PRIOR_WEIGHT), -k / mean


def pareto_quantiles(probabilities: FloatArray, k: float, scale: float) -> FloatArray:
    """Quantiles of a generalised Pareto distribution from zero on, at probabilities strictly between 0 and 1.

    Examples
    --------
    >>> pareto_quantiles(np.array([0.75]), 1.0, 2.0).tolist()
    [6.0]
    """
    exponential = -np.log1p(-probabilities)
    return scale * (exponential if abs(k) < _EPSILON else np.expm1(k * exponential) / k)
