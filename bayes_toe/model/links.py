"""From a normalised distance to the two answers: log P(equal) and log P(different) for the links of the ladder.

Both come together, each accurate to rounding wherever the other is near 1: whichever probability is the smaller is formed from positive
terms, and the larger one is its complement.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.special import erfinv, expit, log_expit, log_ndtr, ndtri_exp

from bayes_toe.arrays import FloatArray
from bayes_toe.model.closed_form import LN2, log_different, log_equal

Answers = tuple[FloatArray, FloatArray]
#: z and the logit of the peak (P(equal) at z = 0), which broadcast -> log P(equal), log P(different).
Link = Callable[[FloatArray, FloatArray], Answers]
_LOG_2PI = float(np.log(2.0 * np.pi))
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)


def lapse_link(z: FloatArray, logit_peak: FloatArray) -> Answers:
    """The paper's P(equal) = q0 2^(-z^2); logit_peak = logit q0 may be +inf, for q0 = 1. Source: Eq. mod:q.

    Examples
    --------
    >>> lapse_link(np.array([1.0]), np.array([np.inf]))[1].round(12).tolist() == [round(-LN2, 12)]
    True
    """
    with np.errstate(over="ignore"):  # z^2 beyond the largest float: log P(equal) is -inf to all digits
        return log_equal(z, log_expit(logit_peak)), log_different(z, logit_peak)


def differencing_link(z: FloatArray, logit_peak: FloatArray) -> Answers:
    """Differencing rule of signal detection: 'equal' where a noisy difference of mean z and unit variance lies within -k..k.

    P(equal) = Phi(k - z) - Phi(-k - z); the criterion k follows from the peak 2 Phi(k) - 1.
    Source: Macmillan and Creelman, Detection Theory, chapter on same-different designs.

    Examples
    --------
    >>> np.exp(differencing_link(np.array([0.0]), np.array([0.0]))[0]).round(12).tolist()
    [0.5]
    """
    distance, k = np.broadcast_arrays(np.abs(z), criterion(logit_peak))
    with np.errstate(over="ignore", divide="ignore"):  # distances whose square is beyond the largest float; probabilities that are 0
        inside = _log_inside(distance, k)
        outside = np.logaddexp(log_ndtr(distance - k), log_ndtr(-distance - k))
        few, many = inside < -LN2, outside < -LN2
        # Each from the other where it is the larger: its log is then near 0 and would lose its digits.
        return (
            np.where(many & ~few, np.log1p(-np.exp(np.minimum(outside, -LN2))), inside),
            np.where(few, np.log1p(-np.exp(np.minimum(inside, -LN2))), outside),
        )


def criterion(logit_peak: npt.ArrayLike) -> FloatArray:
    """Criterion k with 2 Phi(k) - 1 = expit(logit_peak), accurate in both tails; in standard deviations of the difference.

    Examples
    --------
    >>> round(float(criterion(np.log(0.95 / 0.05))), 6)
    1.959964
    """
    a = np.asarray(logit_peak, np.float64)
    small = np.sqrt(2.0) * erfinv(expit(np.minimum(a, 0.0)))
    return np.asarray(np.where(a < 0.0, small, -ndtri_exp(log_expit(-np.maximum(a, 0.0)) - LN2)))


def _log_inside(distance: FloatArray, k: FloatArray) -> FloatArray:
    """Log of Phi(k - d) - Phi(-k - d) for d, k >= 0."""
    upper, lower = log_ndtr(k - distance), log_ndtr(-k - distance)
    apart = np.where(np.isfinite(upper), lower - np.where(np.isfinite(upper), upper, 0.0), -np.inf)
    result = upper + np.log1p(-np.exp(apart))
    # Where the window is narrow and the density in it nearly level the two nearly cancel: its integral, by positive terms.
    level = (k < 0.5) & (np.minimum(k, 0.5) * distance < 0.5)
    if level.any():
        d, half = distance[level], k[level]
        t = 0.5 * half[:, None] * (_NODES + 1.0)
        mean = 0.5 * (np.exp(-0.5 * np.square(t)) * np.cosh(d[:, None] * t)) @ _WEIGHTS
        result[level] = np.log(2.0 * half * mean) - 0.5 * (np.square(d) + _LOG_2PI)
    return np.asarray(result)
