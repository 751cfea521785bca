"""From normalised distance to the two answers: what they weigh, and how that changes with the distance and with the curve's parameters.

A link gives log P(equal) and log P(different) together, each accurate to rounding wherever the other is near 1: whichever probability is
the smaller is formed from positive terms, and the larger one is its complement. Its slopes are the derivatives of both logs in z and in the
link's own coordinates, for the chain rule of :mod:`bayes_toe.model.derivatives`. The first of these is l, the logit of the peak, the
P(equal) at z = 0; where a model has none, the peak is 1 and l infinite.

With lapses in both directions an observer answers a share lambda of the trials without regard to the stimuli, 'equal' with the peak's
probability q0: P(equal) = lambda q0 + (1 - lambda) Q(z), whatever curve Q is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import expit, hyp1f1, log_expit

from bayes_toe.arrays import FloatArray
from bayes_toe.model.closed_form import LN2, log_different, log_equal

Answers = tuple[FloatArray, FloatArray]
_NONE = np.zeros((1, 1))


class Logarithm(NamedTuple):
    """Derivatives of the log of a probability in z and in the m own coordinates of a link; arrays broadcast to (points, pairs).

    `stretch` is d(z A_z)/dz = A_z + z A_zz: what a change of the width does to A_z. It is formed on its own, because its two terms cancel
    where the answers are surprising. `own_own` holds the rows of a triangle: row i has the columns 0..i.
    """

    z: FloatArray
    zz: FloatArray
    stretch: FloatArray
    own: tuple[FloatArray, ...]
    z_own: tuple[FloatArray, ...]
    own_own: tuple[tuple[FloatArray, ...], ...]


class Rise(NamedTuple):
    """The first of these alone: in z and in the own coordinates."""

    z: FloatArray
    own: tuple[FloatArray, ...]


@dataclass(frozen=True)
class Link:
    """A rule of answering.

    Parameters
    ----------
    coordinates : tuple of str
        Its own unconstrained coordinates, the peak's first.
    log_answers : callable
        z and the own coordinates, which broadcast to (points, pairs) -> log P(equal), log P(different).
    slopes : callable
        The same -> :class:`Logarithm` of both.
    log_fall : callable
        The same -> log of the peak less P(equal).
    own_rise : callable, optional
        z, both log probabilities and the own coordinates -> :class:`Rise` of both, where that is less work than :attr:`slopes`.
    own_shape : callable, optional
        z, the slopes of log P(equal) and the own coordinates -> what the logit of the peak adds to log P(equal) beside log q0, of first
        order. None: nothing, because P(equal) is the peak times a shape.
    """

    coordinates: tuple[str, ...]
    log_answers: Callable[..., Answers]
    slopes: Callable[..., tuple[Logarithm, Logarithm]]
    log_fall: Callable[..., FloatArray]
    own_rise: Callable[..., tuple[Rise, Rise]] | None = None
    own_shape: Callable[..., FloatArray] | None = None

    def shape(self, z: FloatArray, equal: Logarithm, *own: FloatArray) -> FloatArray:
        """Slope of log P(equal) in logit q0 less 1 - q0, from the slopes of log P(equal)."""
        return np.zeros((1, 1)) if self.own_shape is None else self.own_shape(z, equal, *own)

    def rise(self, z: FloatArray, answers: Answers, *own: FloatArray) -> tuple[Rise, Rise]:
        """First derivatives of both answers."""
        return _first(self.slopes(z, *own)) if self.own_rise is None else self.own_rise(z, answers, *own)


def _first(of: tuple[Logarithm, Logarithm]) -> tuple[Rise, Rise]:
    one, other = of
    return Rise(one.z, one.own), Rise(other.z, other.own)


# --- The paper's: a bell ------------------------------------------------------------------------------


def bell_answers(z: FloatArray, logit_peak: FloatArray) -> Answers:
    """The paper's P(equal) = q0 2^(-z^2); logit_peak = logit q0 may be +inf, for q0 = 1. Source: Eq. mod:q.

    Examples
    --------
    >>> bell_answers(np.array([1.0]), np.array([np.inf]))[1].round(12).tolist() == [round(-LN2, 12)]
    True
    """
    with np.errstate(over="ignore"):  # z^2 beyond the largest float: log P(equal) is -inf to all digits
        return log_equal(z, log_expit(logit_peak)), log_different(z, logit_peak)


def bell_slopes(z: FloatArray, logit_peak: FloatArray) -> tuple[Logarithm, Logarithm]:
    """Slopes of :func:`bell_answers`; exact where q0 is 1 and where z^2 is far below rounding.

    With t = ln2 z^2, the odds r = q/(1 - q) and d = 1 - q0, a 'different' answer A = log(1 - q) has A_z = 2 ln2 r z,
    A_zz = 2 ln2 r (2 F - 1), (z A_z)_z = 4 ln2 r F z, A_l = -r d, A_zl = 2 ln2 z r (1 + r) d and A_ll = -r d ((1 + r) d - q0).
    F = 1 - (1 + r) t = [d 2^-z^2 - (t - 1 + 2^-z^2)] / (1 - q) and the last bracket, [d^2 - q0^2 (1 - 2^-z^2)] / (1 - q), are formed
    from their numerators: the differences would lose all digits.
    """
    with np.errstate(over="ignore"):  # z^2 beyond the largest float
        t, log_diff = LN2 * np.square(z), log_different(z, logit_peak)
    q0, lapse, fall = expit(logit_peak), expit(-logit_peak), np.expm1(-t)
    equal = Logarithm(-2.0 * LN2 * z, np.full((1, 1), -2.0 * LN2), -4.0 * LN2 * z, (lapse,), (_NONE,), ((-q0 * lapse,),))
    with np.errstate(over="ignore", invalid="ignore"):  # at z = 0 with q0 = 1 'different' is impossible: not defined, and nobody's answer
        odds = np.exp(log_expit(logit_peak) - t - log_diff)
        share = np.exp(log_expit(-logit_peak) - log_diff)  # (1 - q0) / (1 - q) = (1 + r) d
        bend = np.where(odds == 0.0, 0.0, (lapse * (1.0 + fall) - _second_rest(t)) * np.exp(-log_diff))  # t may be infinite
        gap = share * lapse + np.square(q0) * fall * np.exp(-log_diff)
        rate, lost = 2.0 * LN2 * odds, odds * lapse
        different = Logarithm(
            z=rate * z,
            zz=rate * (2.0 * bend - 1.0),
            stretch=2.0 * rate * bend * z,
            own=(-lost,),
            z_own=(rate * share * z,),
            own_own=((-lost * gap,),),
        )
    return equal, different


def bell_rise(z: FloatArray, answers: Answers, logit_peak: FloatArray) -> tuple[Rise, Rise]:
    """The first of :func:`bell_slopes`, from the answers."""
    lapse = expit(-logit_peak)
    with np.errstate(over="ignore", invalid="ignore"):  # at z = 0 with q0 = 1 'different' is nobody's answer
        odds = np.exp(answers[0] - answers[1])
        return Rise(-2.0 * LN2 * z, (lapse,)), Rise(2.0 * LN2 * odds * z, (-odds * lapse,))


def bell_fall(z: FloatArray, logit_peak: FloatArray) -> FloatArray:
    """Log of q0 (1 - 2^(-z^2))."""
    with np.errstate(divide="ignore", over="ignore"):  # no fall at z = 0, and all of it where z^2 is beyond the largest float
        return np.asarray(log_expit(logit_peak) + np.log(-np.expm1(-LN2 * np.square(z))))


def _second_rest(t: FloatArray) -> FloatArray:
    """e^-t - 1 + t without cancellation, t >= 0; its series is t^2/2 M(1, 3, -t), M Kummer's function."""
    small = np.minimum(t, 1.0)
    return np.where(t < 1.0, 0.5 * np.square(small) * hyp1f1(1.0, 3.0, -small), np.expm1(-t) + t)


# --- A free exponent ----------------------------------------------------------------------------------


def exponent_answers(z: FloatArray, logit_peak: FloatArray, log_exponent: FloatArray) -> Answers:
    """P(equal) = q0 2^(-abs(z)^nu); nu = 2 is the paper's curve, nu = 1 Shepard's exponential.

    Examples
    --------
    >>> np.exp(exponent_answers(np.array([2.0]), np.array([np.inf]), np.array([0.0]))[0]).round(12).tolist()
    [0.25]
    """
    log_t = _log_t(z, log_exponent)
    with np.errstate(over="ignore"):  # t beyond the largest float
        t = np.exp(log_t)
    log_q = log_expit(logit_peak) - t
    # 1 - q = (1 - q0) + q0 (1 - e^-t); 1 - e^-t is t where t is far below rounding, and its log is known there even where t is 0.
    rest = np.logaddexp(log_expit(-logit_peak), log_expit(logit_peak) + _log_lost(log_t, t))
    return np.asarray(log_q), np.where(log_q < -LN2, np.log1p(-np.exp(np.minimum(log_q, -LN2))), rest)


def exponent_slopes(z: FloatArray, logit_peak: FloatArray, log_exponent: FloatArray) -> tuple[Logarithm, Logarithm]:
    """Slopes of :func:`exponent_answers` in z, the logit of the peak and log nu.

    With t = ln2 abs(z)^nu, v = nu log abs(z), r, d, F and (1 + r) d as in :func:`bell_slopes` and R = r t,

        A_z = nu R/z,   A_zz = nu R (nu F - 1)/z^2,   (z A_z)_z = nu^2 R F/z,   A_k = R v,   A_kk = R v (v F + 1),
        A_zk = nu R (v F + 1)/z,   A_zl = nu R (1 + r) d/z,   A_kl = R v (1 + r) d

    for 'different'; 'equal' has -t in the place of R and 1 in that of F. At z = 0 itself, where a derivative exists for nu > 2 only, they
    are 0, the mean of both sides.
    """
    nu, log_t, size = np.exp(log_exponent), _log_t(z, log_exponent), np.abs(z)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # z = 0 and t beyond the largest float: handled below
        t, v = np.exp(log_t), nu * np.log(size)
        q0, lapse = expit(logit_peak), expit(-logit_peak)
        log_diff = exponent_answers(z, logit_peak, log_exponent)[1]
        odds, share = np.exp(log_expit(logit_peak) - t - log_diff), np.exp(log_expit(-logit_peak) - log_diff)
        steep = np.exp(log_expit(logit_peak) - t - log_diff + log_t)
        rest = np.where(t < 1.0, 0.5 * t * hyp1f1(1.0, 3.0, -np.minimum(t, 1.0)), 1.0 + np.expm1(-t) / np.maximum(t, 1.0))
        bend = share * np.exp(-t) - np.where(steep == 0.0, 0.0, np.exp(log_t - log_diff) * rest)
        gap = share * lapse - np.square(q0) * np.exp(_log_lost(log_t, t) - log_diff)

        def of(steep: FloatArray, bend: FloatArray, peak: FloatArray, share: FloatArray, peak_peak: FloatArray) -> Logarithm:
            turn, flat = v * bend + 1.0, (z == 0.0) | (steep == 0.0)  # with t beyond the largest float R is 0, and F may be anything
            z_terms = [np.where(flat, 0.0, nu * steep * part / z) for part in (1.0, nu * bend, share, turn)]
            zz = np.where(flat, 0.0, nu * steep * (nu * bend - 1.0) / np.square(z))
            along, along_peak, along_along = (np.where(steep == 0.0, 0.0, steep * v * part) for part in (1.0, share, turn))
            triangle = (peak_peak,), (along_peak, along_along)
            return Logarithm(z_terms[0], zz, z_terms[1], (peak, along), (z_terms[2], z_terms[3]), triangle)

        return of(-t, np.ones_like(t), lapse, _NONE, -q0 * lapse), of(steep, bend, -odds * lapse, share, -odds * lapse * gap)


def exponent_fall(z: FloatArray, logit_peak: FloatArray, log_exponent: FloatArray) -> FloatArray:
    """Log of q0 (1 - 2^(-abs(z)^nu))."""
    log_t = _log_t(z, log_exponent)
    with np.errstate(over="ignore"):
        return np.asarray(log_expit(logit_peak) + _log_lost(log_t, np.exp(log_t)))


def _log_t(z: FloatArray, log_exponent: FloatArray) -> FloatArray:
    """Log of t = ln2 abs(z)^nu; -inf at z = 0."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(LN2) + np.exp(log_exponent) * np.log(np.abs(z)))


def _log_lost(log_t: FloatArray, t: FloatArray) -> FloatArray:
    """Log of 1 - e^-t."""
    return np.where(t < 1e-17, log_t, np.log(-np.expm1(-np.maximum(t, 1e-17))))


# --- Lapses in both directions ------------------------------------------------------------------------


@dataclass(frozen=True)
class Lapsing:
    """The rule of an observer who answers by another rule but for a share lambda of the trials, of which the share q0 is 'equal'.

    Its attributes are those of :class:`Link`.

    Examples
    --------
    >>> far = Lapsing(BELL).log_answers(np.array([[1e9]]), np.array([[0.0]]), np.array([[np.log(0.2 / 0.8)]]))[0]
    >>> Lapsing(BELL).coordinates, float(np.exp(far).round(12)[0, 0])  # lambda q0 = 0.2 0.5
    (('logit_q0', 'logit_lapse_rate'), 0.1)
    """

    link: Link

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The rule's, and the logit of lambda."""
        return (*self.link.coordinates, "logit_lapse_rate")

    def log_answers(self, z: FloatArray, *own: FloatArray) -> Answers:
        """Sums of positive terms; the larger probability is the complement of the smaller one."""
        equal, different = (np.logaddexp(*parts) for parts in self._parts(z, own))
        few = equal < different
        with np.errstate(divide="ignore"):  # an answer that is impossible
            other = np.log1p(-np.exp(np.where(few, equal, different)))
        return np.where(few, equal, other), np.where(few, other, different)

    def slopes(self, z: FloatArray, *own: FloatArray) -> tuple[Logarithm, Logarithm]:
        """Derivatives of the logs of a mixture.

        With the share rho of the part that attends, g = rho g_b + (1 - rho) g_a and
        H = rho H_b + (1 - rho) H_a + rho (1 - rho) (g_b - g_a)(g_b - g_a)'. In the logit of lambda, g is G = lambda (1 - lambda) (q0 - Q)/P
        for 'equal' and its like of other sign for 'different', by the fall q0 - Q of the curve, and the second derivative is
        G (1 - 2 lambda - G) = G ((1 - lambda) rho - lambda (1 - rho)), which does not cancel where lapses alone explain an answer. In the
        logit of the peak, g_b - g_a of 'equal' is what the shape of a curve changes with its peak (nothing, where P(equal) is the peak
        times a shape), and that of 'different' is (q0 - Q)/(1 - Q) less Q/(1 - Q) times that.
        """
        fall, base, log_q = self.link.log_fall(z, *own[:-1]), self.link.slopes(z, *own[:-1]), self.link.log_answers(z, *own[:-1])
        shape = self.link.shape(z, base[0], *own[:-1])
        of_peak = shape, np.exp(fall - log_q[1]) - shape * np.exp(log_q[0] - log_q[1])
        log_p, parts = self.log_answers(z, *own), self._parts(z, own)
        moved = [sign * np.exp(log_expit(own[-1]) + log_expit(-own[-1]) + fall - log) for sign, log in zip((1.0, -1.0), log_p, strict=True)]
        shares = [(np.exp(lapsed - log), np.exp(attended - log)) for (lapsed, attended), log in zip(parts, log_p, strict=True)]
        each = zip((1.0, -1.0), shares, base, of_peak, moved, strict=True)
        one, other = (_mixed(z, own, *this) for this in each)
        return one, other

    def rise(self, z: FloatArray, answers: Answers, *own: FloatArray) -> tuple[Rise, Rise]:
        """First derivatives of both answers."""
        return _first(self.slopes(z, *own))

    def log_fall(self, z: FloatArray, *own: FloatArray) -> FloatArray:
        """Log of (1 - lambda) (q0 - Q)."""
        return np.asarray(log_expit(-own[-1]) + self.link.log_fall(z, *own[:-1]))

    def _parts(self, z: FloatArray, own: tuple[FloatArray, ...]) -> tuple[Answers, Answers]:
        """For 'equal' and for 'different': logs of the parts that lapse and that attend."""
        peak, rate = own[0], own[-1]
        lapsed = (log_expit(rate) + log_expit(sign * peak) for sign in (1.0, -1.0))
        attended = (log_expit(-rate) + part for part in self.link.log_answers(z, *own[:-1]))
        one, other = zip(lapsed, attended, strict=True)
        return one, other


def _mixed(
    z: FloatArray, own: tuple[FloatArray, ...], sign: float, shares: Answers, base: Logarithm, of_peak: FloatArray, moved: FloatArray
) -> Logarithm:
    """Slopes of one answer, 'equal' (sign 1) or 'different' (-1), from the shares of lapses and attention in it.

    `of_peak` is g_b - g_a in the logit of the peak, `moved` g in that of lambda.
    """
    (lapsed, attended), peak, rate = shares, own[0], own[-1]
    both, blind = lapsed * attended, sign * expit(-sign * peak)  # blind: d log q0 or d log(1 - q0)
    # Far out, where nothing of the curve is left, its slopes may be infinite: they no longer count.
    base = _where_it_counts(attended, base)
    apart = (np.where(attended > 0.0, of_peak, 0.0), *base.own[1:])
    triangle = [tuple(attended * bend + both * apart[i] * apart[j] for j, bend in enumerate(row)) for i, row in enumerate(base.own_own)]
    triangle[0] = (triangle[0][0] - lapsed * expit(peak) * expit(-peak),)
    return Logarithm(
        attended * base.z,
        attended * base.zz + both * np.square(base.z),
        attended * base.stretch + both * base.z * (z * base.z),
        (attended * base.own[0] + lapsed * blind, *(attended * part for part in base.own[1:]), moved),
        (*(attended * mixed + both * base.z * part for mixed, part in zip(base.z_own, apart, strict=True)), -both * base.z),
        (*triangle, (*(-both * part for part in apart), moved * (expit(-rate) * attended - expit(rate) * lapsed))),
    )


def _where_it_counts(share: FloatArray, of: Logarithm) -> Logarithm:
    """Slopes, 0 where the share is."""

    def kept(parts: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
        return tuple(np.where(share > 0.0, part, 0.0) for part in parts)

    z, zz, stretch = kept((of.z, of.zz, of.stretch))
    return Logarithm(z, zz, stretch, kept(of.own), kept(of.z_own), tuple(map(kept, of.own_own)))


#: The paper's rule, P(equal) = q0 2^(-z^2).
BELL = Link(("logit_q0",), bell_answers, bell_slopes, bell_fall, bell_rise)
#: The same with a free exponent.
EXPONENT = Link(("logit_q0", "log_exponent"), exponent_answers, exponent_slopes, exponent_fall)
