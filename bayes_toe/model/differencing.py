"""Differencing rule of signal detection: 'equal' where a noisy difference of the two stimuli lies within a criterion.

P(equal) = Phi(k - z) - Phi(-k - z), with z the mean of the difference over its standard deviation; the criterion k follows from the peak
q0 = 2 Phi(k) - 1. Source: Macmillan and Creelman, Detection Theory, chapter on same-different designs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import erfcx, erfinv, expit, log_expit, log_ndtr, ndtri_exp

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.model.closed_form import LN2
from bayes_toe.model.distributions import LOG_2PI
from bayes_toe.model.links import Answers, Link, Logarithm


def _gauss_legendre(n: int) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of integrals over 0..1; nodes near 0, where what is integrated here is largest, are as precise as any.

    Newton's method for P_n(1 - 2 t) = 0 by the recurrence of differences of successive polynomials, which loses nothing at small t.
    """
    t = 0.5 * (1.0 + np.polynomial.legendre.leggauss(n)[0])
    for _ in range(2):
        before, p, step = np.ones(n), 1.0 - 2.0 * t, -2.0 * t
        for j in range(1, n):
            step = (j * step - 2.0 * t * (2 * j + 1) * p) / (j + 1)
            before, p = p, p + step
        t = t + p * 2.0 * t * (1.0 - t) / (n * (before - (1.0 - 2.0 * t) * p))
    return t, 4.0 * t * (1.0 - t) / np.square(n * before)


_NODES, _WEIGHTS = _gauss_legendre(12)
_MANY_NODES, _MANY_WEIGHTS = _gauss_legendre(40)


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
    # Where the window is narrow and the density in it nearly level the two nearly cancel: its integral, by positive terms.
    level = _level(distance, k)
    if level.any():
        d, half = distance[level], k[level]
        t = half[:, None] * _NODES
        mean = (np.exp(-0.5 * np.square(t)) * np.cosh(d[:, None] * t)) @ _WEIGHTS
        result[level] = np.log(2.0 * half * mean) - 0.5 * (np.square(d) + LOG_2PI)
    return np.asarray(result)


def _level(distance: FloatArray, k: FloatArray) -> BoolArray:
    """Where the window is narrow and the density in it nearly level."""
    return np.asarray((k < 0.5) & (np.minimum(k, 0.5) * distance < 0.5))


class _Peaked(NamedTuple):
    """Derivatives of the log of a probability in z, z >= 0, and in the logit l of the peak."""

    z: FloatArray
    peak: FloatArray
    zz: FloatArray
    z_peak: FloatArray
    peak_peak: FloatArray

    def mirrored(self, side: FloatArray, distance: FloatArray) -> Logarithm:
        """The same for z of either side of 0."""
        z, stretch = side * self.z, side * (self.z + distance * self.zz)
        return Logarithm(z, self.zz, stretch, (self.peak,), (side * self.z_peak,), ((self.peak_peak,),))

    def of_complement(self, odds: FloatArray) -> _Peaked:
        """Derivatives of log(1 - P) from those of log P and the odds P/(1 - P)."""
        more = 1.0 + odds
        with np.errstate(over="ignore", invalid="ignore"):  # where P is 0 its log may have infinite slopes, its complement has none
            slopes = (
                *(self.z, self.peak, self.zz + more * np.square(self.z)),
                *(self.z_peak + more * self.z * self.peak, self.peak_peak + more * np.square(self.peak)),
            )
            return _Peaked(*(np.where(odds == 0.0, 0.0, -odds * slope) for slope in slopes))


class _Criterion(NamedTuple):
    """Criterion k with its derivatives in l: 2 phi(k) dk/dl = expit(l) expit(-l)."""

    k: FloatArray
    rate: FloatArray
    bend: FloatArray

    @classmethod
    def at(cls, logit_peak: FloatArray, shape: tuple[int, ...]) -> _Criterion:
        k = criterion(logit_peak)
        rate = np.exp(log_expit(logit_peak) + log_expit(-logit_peak) + 0.5 * (np.square(k) + LOG_2PI) - LN2)
        return cls(*(np.broadcast_to(part, shape) for part in (k, rate, rate * (k * rate - np.tanh(0.5 * logit_peak)))))

    def chained(self, z: FloatArray, k: FloatArray, zz: FloatArray, zk: FloatArray, kk: FloatArray) -> _Peaked:
        """Derivatives in l from those in k."""
        return _Peaked(z, k * self.rate, zz, zk * self.rate, kk * np.square(self.rate) + k * self.bend)


def differencing_slopes(z: FloatArray, logit_peak: FloatArray) -> tuple[Logarithm, Logarithm]:
    """Derivatives of :func:`differencing_answers`."""
    side, distance, at = np.where(z < 0.0, -1.0, 1.0), np.abs(z), _Criterion.at(logit_peak, z.shape)
    inside, outside = differencing_answers(distance, logit_peak)
    many = inside > -LN2
    with np.errstate(over="ignore", invalid="ignore"):  # branches not taken
        of_equal = _chosen(_level(distance, at.k), _narrow_slopes(distance, at, logit_peak), _inside_slopes(distance, at, inside))
        of_different = _chosen(many, _outside_slopes(distance, at, outside, logit_peak), of_equal.of_complement(np.exp(inside - outside)))
    return of_equal.mirrored(side, distance), of_different.mirrored(side, distance)


def differencing_shape(z: FloatArray, equal: Logarithm, logit_peak: FloatArray) -> FloatArray:
    """Slope of log P(equal) in logit q0 less 1 - q0; of a narrow window, which is nearly the peak times a shape, without the difference."""
    distance, at = np.abs(z), _Criterion.at(logit_peak, z.shape)
    shape, level = np.asarray(equal.own[0] - expit(-logit_peak)), _level(distance, at.k)
    shape[level] = _narrow_drift(distance[level], at.k[level])[0] * at.rate[level]
    return shape


def differencing_fall(z: FloatArray, logit_peak: FloatArray) -> FloatArray:
    """Log of the peak less P(equal): near z = 0 the integral of phi(k - s) - phi(k + s) over 0..z, by positive terms."""
    distance, k = np.broadcast_arrays(np.abs(z), criterion(logit_peak))
    near = distance < 1.0
    with np.errstate(divide="ignore"):  # no fall at z = 0
        inside, outside = (np.exp(part) for part in differencing_answers(distance, logit_peak))
        far = np.where(np.broadcast_to(logit_peak, k.shape) < 0.0, expit(logit_peak) - inside, outside - expit(-logit_peak))
        result = np.asarray(np.log(np.where(near, 1.0, far)))
        d, top = distance[near], k[near]
        s = d[:, None] * _NODES
        mean = (np.exp(-0.5 * np.square(top[:, None] - s)) * -np.expm1(-2.0 * top[:, None] * s)) @ _WEIGHTS
        result[near] = np.log(d * mean) - 0.5 * LOG_2PI
    return result


def _chosen(where: BoolArray, one: _Peaked, other: _Peaked) -> _Peaked:
    return _Peaked(*(np.where(where, a, b) for a, b in zip(one, other, strict=True)))


def _inside_slopes(z: FloatArray, at: _Criterion, log_inside: FloatArray) -> _Peaked:
    """Derivatives of log P(|z + e| <= k), e standard normal, with edges at d = z - k and e = z + k from its mean.

    With hazards a = phi(d)/P and b = phi(e)/P, and s the mean distance from the near edge inside the window, d - a + b = -s and
    e + b - a = 2 k - s, so that all second derivatives become sums of terms of one sign: nothing cancels.
    """
    d, wide = z - at.k, 2.0 * at.k
    easy = (d <= 2.0) & (at.k >= 1.0)
    near = np.exp(-0.5 * (np.square(d) + LOG_2PI) - log_inside)
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


def _narrow_slopes(z: FloatArray, at: _Criterion, logit_peak: FloatArray) -> _Peaked:
    """The same where the window is narrow: the log of the peak is taken out, because what is left depends on k only a little.

    log P(z, k) = log peak + F(z, k) - F(0, k) with F the log of the mean density in the window: with t normal about z and inside it,
    F_k = (z E t - E t^2)/k and F_kk = (Var(z t - t^2) - E t^2)/k^2, all by positive terms.
    """
    k = np.minimum(at.k, 0.5)
    slope, (t1, t2, t3, t4), (u2, u4) = _narrow_drift(z, k)
    first = z * t1 - t2
    bend = (z * z * t2 - 2.0 * z * t3 + t4 - np.square(first) - t2 - (u4 - np.square(u2) - u2)) / np.square(k)
    lapse, peak = expit(-logit_peak), expit(logit_peak)
    return _Peaked(
        z=t1 - z,
        peak=lapse + slope * at.rate,
        zz=t2 - np.square(t1) - 1.0,
        z_peak=(t1 + z * t2 - t3 - t1 * first) / k * at.rate,
        peak_peak=-peak * lapse + bend * np.square(at.rate) + slope * at.bend,
    )


def _narrow_drift(z: FloatArray, k: FloatArray) -> tuple[FloatArray, list[FloatArray], list[FloatArray]]:
    """F_k(z, k) - F_k(0, k), moments 1 to 4 inside the window at z, and moments 2 and 4 at 0."""
    t, u = _moments(np.minimum(z, 0.5 / np.maximum(k, 1e-300)), k), _moments(np.zeros_like(z), k)
    return (z * t[0] - t[1] + u[1]) / k, t, u[1::2]


def _moments(z: FloatArray, k: FloatArray) -> list[FloatArray]:
    """E t, E t^2, E t^3 and E t^4 of a normal about z inside -k..k, narrow; odd ones without cancellation, because z >= 0."""
    t = k[..., None] * _NODES
    weights = np.exp(-0.5 * np.square(t)) * _WEIGHTS
    even, odd = weights * np.cosh(z[..., None] * t), weights * np.sinh(z[..., None] * t)
    mass = even.sum(axis=-1)
    return [((odd if power % 2 else even) * t**power).sum(axis=-1) / mass for power in (1, 2, 3, 4)]


def _outside_slopes(z: FloatArray, at: _Criterion, log_outside: FloatArray, logit_peak: FloatArray) -> _Peaked:
    """Derivatives of log P(|z + e| > k): two half lines with weights w, hazards h and mean excesses m over their edges."""
    edges = (at.k - z, at.k + z)
    weights = [np.exp(log_ndtr(-edge) - log_outside) for edge in edges]
    hazards = [np.sqrt(2.0 / np.pi) / erfcx(edge / np.sqrt(2.0)) for edge in edges]
    within = [w * h * _excess(edge, h) for w, h, edge in zip(weights, hazards, edges, strict=True)]
    upper, lower = (w * h for w, h in zip(weights, hazards, strict=True))
    between = weights[0] * weights[1]
    found = at.chained(
        z=upper - lower,
        k=-(upper + lower),
        zz=between * np.square(hazards[0] + hazards[1]) - within[0] - within[1],
        zk=within[0] - within[1] - between * (np.square(hazards[0]) - np.square(hazards[1])),
        kk=between * np.square(hazards[0] - hazards[1]) - within[0] - within[1],
    )
    far = (at.k > 3.0) & (2.0 * z < at.k)
    if far.any():
        found.peak_peak[far] = _bend_far_inside(z[far], at.k[far], np.broadcast_to(logit_peak, z.shape)[far])
    return found


def _bend_far_inside(z: FloatArray, k: FloatArray, logit_peak: FloatArray) -> FloatArray:
    """Second derivative of log P(|z + e| > k) in the logit of the peak where both edges are far out; shape (n,) each.

    P = 2 e^(-z^2/2) Q(k) C with Q the normal's upper tail, 1 - q0 = 2 Q(k), and C = E cosh(z (k + t)) over the excess t of a normal over
    k. With D = C - cosh(z k), u = D/C and the hazard h of k the derivative is

        -q0 (1 - q0) (1 - u) + q0^2 (D_k/(h C) - u^2),    D_k/h = (E [z sinh(z (k + t)) - z sinh(z k)] - Cov [t, cosh(z (k + t))])/h:

    what is of the order of 1/k^2 in the general form cancels here on paper. The factor e^(z k)/2 is left out of all that is hyperbolic.
    """
    t, weights = _nodes(np.minimum(40.0 / (k - z), 9.0))
    density = np.exp(-t * (k[:, None] + 0.5 * t)) * weights
    mass, z_, k_ = density.sum(axis=1), z[:, None], k[:, None]
    grown = np.exp(z_ * t) * (density / mass[:, None])
    lost, lower = -np.expm1(-z_ * t), np.exp(-z_ * (2.0 * k_ + t))
    whole = (grown * (1.0 + np.exp(-2.0 * z_ * (k_ + t)))).sum(axis=1)
    above = grown * -np.expm1(-z_ * (2.0 * k_ + t)) * lost
    excess = (t * density).sum(axis=1) / mass
    change = (z_ * grown * (1.0 + lower) * lost).sum(axis=1) - ((t - excess[:, None]) * above).sum(axis=1)
    u, q0, lapse = above.sum(axis=1) / whole, expit(logit_peak), expit(-logit_peak)
    return np.asarray(-q0 * lapse * (1.0 - u) + np.square(q0) * (mass * change / whole - np.square(u)))


def _excess(edge: FloatArray, hazard: FloatArray) -> FloatArray:
    """Mean excess over an edge, hazard - edge; by the integral where the two nearly cancel."""
    result, far = hazard - edge, edge > 2.0
    if far.any():
        result[far] = _from_edge(edge[far], np.full(int(far.sum()), np.inf))[1]
    return result


def _from_edge(d: FloatArray, wide: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Integral over 0..wide of exp(-d s - s^2/2), and the mean of s under it; shape (n,) each. d > 2 where the window is wide."""
    s, weights = _nodes(np.minimum(wide, np.divide(40.0, d, out=np.full(d.shape, np.inf), where=d > 0.0)))
    density = np.exp(-s * (d[:, None] + 0.5 * s)) * weights
    mass = density.sum(axis=1)
    return mass, (s * density).sum(axis=1) / mass


def _nodes(end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of integrals over 0..end, (n,) -> (n, nodes) each."""
    return end[:, None] * _MANY_NODES, end[:, None] * _MANY_WEIGHTS


#: Signal detection: 'equal' where a noisy difference lies within a criterion.
DIFFERENCING = Link(("logit_q0",), differencing_answers, differencing_slopes, differencing_fall, own_shape=differencing_shape)
