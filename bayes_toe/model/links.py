"""From a normalised distance to the two answers: what they weigh, and how that changes with the distance and with the peak.

A link gives log P(equal) and log P(different) together, each accurate to rounding wherever the other is near 1: whichever probability is
the smaller is formed from positive terms, and the larger one is its complement. Its slopes are the derivatives of

    A(z, l) = n_Eq log P(equal) + n_Diff log P(different)

for the chain rule of :mod:`bayes_toe.model.derivatives`; l is the logit of the peak, P(equal) at z = 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import erfcx, erfinv, expit, hyp1f1, log_expit, log_ndtr, ndtri_exp

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.model.closed_form import LN2, log_different, log_equal

Answers = tuple[FloatArray, FloatArray]
_LOG_2PI = float(np.log(2.0 * np.pi))
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_MANY_NODES, _MANY_WEIGHTS = np.polynomial.legendre.leggauss(40)


class Slopes(NamedTuple):
    """Derivatives of A(z, l), each of shape (points, pairs).

    `stretch` is d(z A_z)/dz = A_z + z A_zz: what a change of the width does to A_z. It is formed on its own, because its two terms cancel
    where the answers are surprising.
    """

    z: FloatArray
    zz: FloatArray
    stretch: FloatArray
    peak: FloatArray
    z_peak: FloatArray
    peak_peak: FloatArray


@dataclass(frozen=True)
class Link:
    """A rule of answering.

    Parameters
    ----------
    log_answers : callable
        z and the logit of the peak, which broadcast to (points, pairs) -> log P(equal), log P(different).
    slopes : callable
        z, logit of the peak, shape (points, 1), and counts of both answers, shape (pairs,) -> :class:`Slopes`.
    """

    log_answers: Callable[[FloatArray, FloatArray], Answers]
    slopes: Callable[[FloatArray, FloatArray, FloatArray, FloatArray], Slopes]


# --- The paper's: a bell with lapses ------------------------------------------------------------------


def lapse_answers(z: FloatArray, logit_peak: FloatArray) -> Answers:
    """The paper's P(equal) = q0 2^(-z^2); logit_peak = logit q0 may be +inf, for q0 = 1. Source: Eq. mod:q.

    Examples
    --------
    >>> lapse_answers(np.array([1.0]), np.array([np.inf]))[1].round(12).tolist() == [round(-LN2, 12)]
    True
    """
    with np.errstate(over="ignore"):  # z^2 beyond the largest float: log P(equal) is -inf to all digits
        return log_equal(z, log_expit(logit_peak)), log_different(z, logit_peak)


def lapse_slopes(z: FloatArray, logit_peak: FloatArray, equal: FloatArray, different: FloatArray) -> Slopes:
    """Slopes of :func:`lapse_answers`; exact where q0 is 1 and where z^2 is far below rounding.

    With t = ln2 z^2, the odds r = q/(1 - q) and d = 1 - q0, one 'different' answer A = log(1 - q) has A_z = 2 ln2 r z,
    A_zz = 2 ln2 r (2 F - 1), (z A_z)_z = 4 ln2 r F z, A_l = -r d, A_zl = 2 ln2 z r (1 + r) d and A_ll = -r d ((1 + r) d - q0).
    F = 1 - (1 + r) t = [d 2^-z^2 - (t - 1 + 2^-z^2)] / (1 - q) and the last bracket, [d^2 - q0^2 (1 - 2^-z^2)] / (1 - q), are formed
    from their numerators: the differences would lose all digits.
    """
    t, q0, lapse = LN2 * np.square(z), expit(logit_peak), expit(-logit_peak)
    log_diff, fall = log_different(z, logit_peak), np.expm1(-t)
    odds = different * np.exp(log_expit(logit_peak) - t - log_diff)
    share = np.exp(log_expit(-logit_peak) - log_diff)  # (1 - q0) / (1 - q) = (1 + r) d
    bend = (lapse * (1.0 + fall) - _second_rest(t)) * np.exp(-log_diff)
    gap = share * lapse + np.square(q0) * fall * np.exp(-log_diff)
    lost = odds * lapse
    return Slopes(
        z=2.0 * LN2 * (odds - equal) * z,
        zz=2.0 * LN2 * (odds * (2.0 * bend - 1.0) - equal),
        stretch=4.0 * LN2 * (odds * bend - equal) * z,
        peak=equal * lapse - lost,
        z_peak=2.0 * LN2 * odds * share * z,
        peak_peak=-equal * q0 * lapse - lost * gap,
    )


def _second_rest(t: FloatArray) -> FloatArray:
    """e^-t - 1 + t without cancellation, t >= 0; its series is t^2/2 M(1, 3, -t), M Kummer's function."""
    small = np.minimum(t, 1.0)
    return np.where(t < 1.0, 0.5 * np.square(small) * hyp1f1(1.0, 3.0, -small), np.expm1(-t) + t)


# --- Signal detection: a difference against a criterion -----------------------------------------------


def differencing_answers(z: FloatArray, logit_peak: FloatArray) -> Answers:
    """Differencing rule of signal detection: 'equal' where a noisy difference of mean z and unit variance lies within -k..k.

    P(equal) = Phi(k - z) - Phi(-k - z); the criterion k follows from the peak 2 Phi(k) - 1.
    Source: Macmillan and Creelman, Detection Theory, chapter on same-different designs.

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
    # Where the window is narrow and the density in it nearly level the two nearly cancel: its integral, by positive terms.
    level = _level(distance, k)
    if level.any():
        d, half = distance[level], k[level]
        t = 0.5 * half[:, None] * (_NODES + 1.0)
        mean = 0.5 * (np.exp(-0.5 * np.square(t)) * np.cosh(d[:, None] * t)) @ _WEIGHTS
        result[level] = np.log(2.0 * half * mean) - 0.5 * (np.square(d) + _LOG_2PI)
    return np.asarray(result)


def _level(distance: FloatArray, k: FloatArray) -> BoolArray:
    """Where the window is narrow and the density in it nearly level."""
    return np.asarray((k < 0.5) & (np.minimum(k, 0.5) * distance < 0.5))


class _Logarithm(NamedTuple):
    """Derivatives of the log of a probability in z, z >= 0, and in the logit l of the peak."""

    z: FloatArray
    peak: FloatArray
    zz: FloatArray
    z_peak: FloatArray
    peak_peak: FloatArray

    def of_complement(self, odds: FloatArray) -> _Logarithm:
        """Derivatives of log(1 - P) from those of log P and the odds P/(1 - P)."""
        more = 1.0 + odds
        return _Logarithm(
            -odds * self.z,
            -odds * self.peak,
            -odds * (self.zz + more * np.square(self.z)),
            -odds * (self.z_peak + more * self.z * self.peak),
            -odds * (self.peak_peak + more * np.square(self.peak)),
        )


class _Criterion(NamedTuple):
    """Criterion k with its derivatives in l: 2 phi(k) dk/dl = expit(l) expit(-l)."""

    k: FloatArray
    rate: FloatArray
    bend: FloatArray

    @classmethod
    def at(cls, logit_peak: FloatArray, shape: tuple[int, ...]) -> _Criterion:
        k = criterion(logit_peak)
        rate = np.exp(log_expit(logit_peak) + log_expit(-logit_peak) + 0.5 * (np.square(k) + _LOG_2PI) - LN2)
        return cls(*(np.broadcast_to(part, shape) for part in (k, rate, rate * (k * rate - np.tanh(0.5 * logit_peak)))))

    def chained(self, z: FloatArray, k: FloatArray, zz: FloatArray, zk: FloatArray, kk: FloatArray) -> _Logarithm:
        """Derivatives in l from those in k."""
        return _Logarithm(z, k * self.rate, zz, zk * self.rate, kk * np.square(self.rate) + k * self.bend)


def differencing_slopes(z: FloatArray, logit_peak: FloatArray, equal: FloatArray, different: FloatArray) -> Slopes:
    """Slopes of :func:`differencing_answers`."""
    side, distance, at = np.where(z < 0.0, -1.0, 1.0), np.abs(z), _Criterion.at(logit_peak, z.shape)
    inside, outside = differencing_answers(distance, logit_peak)
    many = inside > -LN2
    with np.errstate(over="ignore", invalid="ignore"):  # branches not taken
        of_equal = _chosen(_level(distance, at.k), _narrow_slopes(distance, at, logit_peak), _inside_slopes(distance, at, inside))
        of_different = _chosen(many, _outside_slopes(distance, at, outside), of_equal.of_complement(np.exp(inside - outside)))
    total = _Logarithm(*(_weighed(equal, one) + _weighed(different, other) for one, other in zip(of_equal, of_different, strict=True)))
    return Slopes(
        z=side * total.z,
        zz=total.zz,
        stretch=side * (total.z + distance * total.zz),
        peak=total.peak,
        z_peak=side * total.z_peak,
        peak_peak=total.peak_peak,
    )


def _chosen(where: BoolArray, one: _Logarithm, other: _Logarithm) -> _Logarithm:
    return _Logarithm(*(np.where(where, a, b) for a, b in zip(one, other, strict=True)))


def _weighed(counts: FloatArray, values: FloatArray) -> FloatArray:
    """Counts times values; 0 where an answer was never given, also where its derivative is infinite."""
    return np.where(counts > 0.0, counts * np.where(counts > 0.0, values, 0.0), 0.0)


def _inside_slopes(z: FloatArray, at: _Criterion, log_inside: FloatArray) -> _Logarithm:
    """Derivatives of log P(|z + e| <= k), e standard normal, with edges at d = z - k and e = z + k from its mean.

    With hazards a = phi(d)/P and b = phi(e)/P, and s the mean distance from the near edge inside the window, d - a + b = -s and
    e + b - a = 2 k - s, so that all second derivatives become sums of terms of one sign: nothing cancels.
    """
    d, wide = z - at.k, 2.0 * at.k
    easy = (d <= 2.0) & (at.k >= 1.0)
    near = np.exp(-0.5 * (np.square(d) + _LOG_2PI) - log_inside)
    far = near * np.exp(-2.0 * z * at.k)
    depth = near - far - d
    if not easy.all():
        mass, mean = _from_edge(d[~easy], wide[~easy])
        near[~easy], depth[~easy] = 1.0 / mass, mean
        far[~easy] = np.exp(-2.0 * z[~easy] * at.k[~easy]) / mass
    rest = wide - depth
    return at.chained(
        z=near * np.expm1(-2.0 * z * at.k),
        k=near + far,
        zz=-(near * depth + far * rest),
        zk=near * depth - far * rest,
        kk=-(near * (depth + 3.0 * far) + far * (z + at.k + far)),
    )


def _narrow_slopes(z: FloatArray, at: _Criterion, logit_peak: FloatArray) -> _Logarithm:
    """The same where the window is narrow: the log of the peak is taken out, because what is left depends on k only a little.

    log P(z, k) = log peak + F(z, k) - F(0, k) with F the log of the mean density in the window: with t normal about z and inside it,
    F_k = (z E t - E t^2)/k and F_kk = (Var(z t - t^2) - E t^2)/k^2, all by positive terms.
    """
    k = np.minimum(at.k, 0.5)
    (t1, t2, t3, t4), (_, u2, _, u4) = _moments(np.minimum(z, 0.5 / np.maximum(k, 1e-300)), k), _moments(np.zeros_like(z), k)
    first, first_0 = z * t1 - t2, -u2
    slope = (first - first_0) / k
    bend = (z * z * t2 - 2.0 * z * t3 + t4 - np.square(first) - t2 - (u4 - np.square(u2) - u2)) / np.square(k)
    lapse, peak = expit(-logit_peak), expit(logit_peak)
    return _Logarithm(
        z=t1 - z,
        peak=lapse + slope * at.rate,
        zz=t2 - np.square(t1) - 1.0,
        z_peak=(t1 + z * t2 - t3 - t1 * first) / k * at.rate,
        peak_peak=-peak * lapse + bend * np.square(at.rate) + slope * at.bend,
    )


def _moments(z: FloatArray, k: FloatArray) -> list[FloatArray]:
    """E t, E t^2, E t^3 and E t^4 of a normal about z inside -k..k, narrow; odd ones without cancellation, because z >= 0."""
    t = 0.5 * k[..., None] * (_NODES + 1.0)
    weights = np.exp(-0.5 * np.square(t)) * _WEIGHTS
    even, odd = weights * np.cosh(z[..., None] * t), weights * np.sinh(z[..., None] * t)
    mass = even.sum(axis=-1)
    return [((odd if power % 2 else even) * t**power).sum(axis=-1) / mass for power in (1, 2, 3, 4)]


def _outside_slopes(z: FloatArray, at: _Criterion, log_outside: FloatArray) -> _Logarithm:
    """Derivatives of log P(|z + e| > k): two half lines with weights w, hazards h and mean excesses m over their edges."""
    edges = (at.k - z, at.k + z)
    weights = [np.exp(log_ndtr(-edge) - log_outside) for edge in edges]
    hazards = [np.sqrt(2.0 / np.pi) / erfcx(edge / np.sqrt(2.0)) for edge in edges]
    within = [w * h * _excess(edge, h) for w, h, edge in zip(weights, hazards, edges, strict=True)]
    upper, lower = (w * h for w, h in zip(weights, hazards, strict=True))
    between = weights[0] * weights[1]
    return at.chained(
        z=upper - lower,
        k=-(upper + lower),
        zz=between * np.square(hazards[0] + hazards[1]) - within[0] - within[1],
        zk=within[0] - within[1] - between * (np.square(hazards[0]) - np.square(hazards[1])),
        kk=between * np.square(hazards[0] - hazards[1]) - within[0] - within[1],
    )


def _excess(edge: FloatArray, hazard: FloatArray) -> FloatArray:
    """Mean excess over an edge, hazard - edge; by the integral where the two nearly cancel."""
    result, far = hazard - edge, edge > 2.0
    if far.any():
        result[far] = _from_edge(edge[far], np.full(int(far.sum()), np.inf))[1]
    return result


def _from_edge(d: FloatArray, wide: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Integral over 0..wide of exp(-d s - s^2/2), and the mean of s under it; shape (n,) each. d > 2 where the window is wide."""
    end = np.minimum(wide, np.divide(40.0, d, out=np.full(d.shape, np.inf), where=d > 0.0))
    s = 0.5 * end[:, None] * (_MANY_NODES + 1.0)
    density = np.exp(-s * (d[:, None] + 0.5 * s))
    mass = density @ _MANY_WEIGHTS
    return 0.5 * end * mass, ((s * density) @ _MANY_WEIGHTS) / mass


#: The paper's rule, P(equal) = q0 2^(-z^2).
LAPSE = Link(lapse_answers, lapse_slopes)
#: Signal detection: 'equal' where a noisy difference lies within a criterion.
DIFFERENCING = Link(differencing_answers, differencing_slopes)
