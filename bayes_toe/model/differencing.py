"""Differencing rule of signal detection: 'equal' where a noisy difference of the two stimuli lies within a criterion.

P(equal) = Phi(k - z) - Phi(-k - z), with z the mean of the difference over its standard deviation; the criterion k follows from the peak
q0 = 2 Phi(k) - 1. Source: Macmillan and Creelman, Detection Theory, chapter on same-different designs.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.special import erfcx, erfinv, expit, log_expit, log_ndtr, ndtri_exp

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.model.closed_form import LN2
from bayes_toe.model.distributions import LOG_2PI
from bayes_toe.model.links import Answers, Link, Slopes

_NODES, _WEIGHTS = (0.5 * (part + offset) for part, offset in zip(np.polynomial.legendre.leggauss(12), (1.0, 0.0), strict=True))


def differencing_answers(z: FloatArray, logit_peak: FloatArray) -> Answers:
    """Log P(equal) and log P(different), each accurate to rounding wherever the other is near 1.

    Examples
    --------
    >>> np.exp(differencing_answers(np.array([0.0]), np.array([0.0]))[0]).round(12).tolist()
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
    level = _level(distance, k)
    if level.any():
        result[level] = _log_mass(distance[level], k[level]) - 0.5 * (np.square(distance[level]) + LOG_2PI)
    return np.asarray(result)


def _level(distance: FloatArray, k: FloatArray) -> BoolArray:
    """Where the window is narrow and the density in it nearly level: there Phi(k - d) and Phi(-k - d) nearly cancel."""
    return np.asarray((k < 0.5) & (np.minimum(k, 0.5) * distance < 0.5))


def _log_mass(distance: FloatArray, k: FloatArray) -> FloatArray:
    """Log of the integral of exp(-t^2/2 - d t) over the window -k < t < k, shape (n,), where it is narrow: by positive terms."""
    t = k[:, None] * _NODES
    return np.asarray(np.log(2.0 * k * ((np.exp(-0.5 * np.square(t)) * np.cosh(distance[:, None] * t)) @ _WEIGHTS)))


def differencing_slopes(z: FloatArray, answers: Answers, logit_peak: FloatArray) -> tuple[Slopes, Slopes]:
    """Slopes of :func:`differencing_answers` in z and in the logit l of the peak, with 2 phi(k) dk/dl = expit(l) expit(-l).

    With d = abs(z) - k the distance of the near edge from the mean, log P has the slopes phi(d) (e^(-2 abs(z) k) - 1)/P in abs(z) and
    phi(d) (1 + e^(-2 abs(z) k))/P in k; log(1 - P) has the same over -(1 - P).
    """
    distance, k = np.broadcast_arrays(np.abs(z), criterion(logit_peak))
    with np.errstate(over="ignore", invalid="ignore"):  # distances whose square is beyond the largest float
        rate = np.exp(log_expit(logit_peak) + log_expit(-logit_peak) + 0.5 * (np.square(k) + LOG_2PI) - LN2)
        fall, far = np.sign(z) * np.expm1(-2.0 * distance * k), np.exp(-2.0 * distance * k)
        log_edge = -0.5 * (np.square(distance - k) + LOG_2PI)
        inside, outside = np.asarray(np.exp(log_edge - answers[0])), np.exp(log_edge - answers[1])
        # Far out P and phi(d) are too small for their ratio: P by Mills' ratios of both edges, or by the integral over the window.
        level = _level(distance, k)
        beyond = (distance - k > 2.0) & ~level
        mills = np.sqrt(0.5 * np.pi) * (erfcx((distance - k) * np.sqrt(0.5)) - far * erfcx((distance + k) * np.sqrt(0.5)))
        inside[beyond] = 1.0 / mills[beyond]
        d, half = distance[level], k[level]
        inside[level] = np.exp(half * (d - 0.5 * half) - _log_mass(d, half))
        return Slopes(inside * fall, (inside * (1.0 + far) * rate,)), Slopes(-outside * fall, (-outside * (1.0 + far) * rate,))


#: Signal detection: 'equal' where a noisy difference lies within a criterion.
DIFFERENCING = Link(("logit_q0",), differencing_answers, differencing_slopes)
