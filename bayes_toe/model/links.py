"""From normalised distance to the two answers: what they weigh, and how that changes with the distance and with the curve's parameters.

A link gives the log probabilities of both answers together, first that of the answer which the task counts, each accurate to rounding
wherever the other is near 1: whichever probability is the smaller is formed from positive terms, and the larger one is its complement. Its
slopes are the first derivatives of both logs in z and in the link's own coordinates, for the chain rule of
:mod:`bayes_toe.model.posterior`.

*Same or different*: the first own coordinate is l, the logit of the peak, the P(equal) at z = 0; where a model has none, the peak is 1 and
l infinite. *Which is stronger*: P(second) = F(z), with z the distance from the evolved memory in units of sigma_d, the standard deviation
of the second measurement as memory predicts it.

An observer who lapses answers a share lambda of the trials without regard to the stimuli: P = lambda g + (1 - lambda) P(z). Of these the
share g is 'equal' with the peak's probability q0, or 'second' with one half or with a share of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import erfcx, erfinv, expit, log_expit, log_ndtr, ndtri, ndtri_exp

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.model.closed_form import LN2, log_different, log_equal
from bayes_toe.model.distributions import LOG_2PI

Answers = tuple[FloatArray, FloatArray]


class Slopes(NamedTuple):
    """First derivatives of the log of a probability in z and in the own coordinates of a link; arrays broadcast to (points, pairs)."""

    z: FloatArray
    own: tuple[FloatArray, ...]


@dataclass(frozen=True)
class Link:
    """A rule of answering, with unconstrained coordinates of its own, the peak's first.

    Of z and these, which broadcast to (points, pairs), `log_answers` has log P of the answer that is counted, and of the other one;
    `slopes`, which takes both of them behind z, has those of both. The just noticeable z is where P(equal) is half its peak, or P(second)
    75 %; it is a function of the own coordinates where it depends on them.
    """

    coordinates: tuple[str, ...]
    log_answers: Callable[..., Answers]
    slopes: Callable[..., tuple[Slopes, Slopes]]
    noticeable: float | Callable[..., FloatArray] = 1.0


# --- The paper's: a bell ------------------------------------------------------------------------------


def bell_answers(z: FloatArray, logit_peak: FloatArray) -> Answers:
    """The paper's P(equal) = q0 2^(-z^2); logit_peak = logit q0 may be +inf, for q0 = 1. Source: Eq. mod:q."""
    with np.errstate(
        over="ignore"
    ):  # z^2 beyond the largest float: log P(equal) is -inf to all digits
        return log_equal(z, log_expit(logit_peak)), log_different(z, logit_peak)


def bell_slopes(z: FloatArray, answers: Answers, logit_peak: FloatArray) -> tuple[Slopes, Slopes]:
    """Slopes of :func:`bell_answers`: with the odds r = q/(1 - q), those of log(1 - q) are 2 ln2 r z and -r (1 - q0)."""
    lapse = expit(-logit_peak)
    with np.errstate(
        over="ignore", invalid="ignore"
    ):  # at z = 0 with q0 = 1 'different' is nobody's answer
        odds = np.exp(answers[0] - answers[1])
        return Slopes(-2.0 * LN2 * z, (lapse,)), Slopes(2.0 * LN2 * odds * z, (-odds * lapse,))


# --- A free exponent ----------------------------------------------------------------------------------


def exponent_answers(z: FloatArray, logit_peak: FloatArray, log_exponent: FloatArray) -> Answers:
    """P(equal) = q0 2^(-abs(z)^nu); nu = 2 is the paper's curve, nu = 1 Shepard's exponential."""
    log_t = _log_t(z, log_exponent)
    with np.errstate(over="ignore"):  # t beyond the largest float
        t = np.exp(log_t)
    log_q = log_expit(logit_peak) - t
    # 1 - q = (1 - q0) + q0 (1 - e^-t); 1 - e^-t is t where t is far below rounding, and its log is known there even where t is 0.
    rest = np.logaddexp(log_expit(-logit_peak), log_expit(logit_peak) + _log_lost(log_t, t))
    return np.asarray(log_q), np.where(
        log_q < -LN2, np.log1p(-np.exp(np.minimum(log_q, -LN2))), rest
    )


def exponent_slopes(
    z: FloatArray, answers: Answers, logit_peak: FloatArray, log_exponent: FloatArray
) -> tuple[Slopes, Slopes]:
    """Slopes of :func:`exponent_answers` in z, the logit of the peak and log nu.

    With t = ln2 abs(z)^nu, the odds r = q/(1 - q) and R = r t, those of log(1 - q) are nu R/z, -r (1 - q0) and R nu log abs(z); 'equal' has
    -t in the place of R. At z = 0 itself, where a derivative exists for nu > 1 only, the first is 0, the mean of both sides.
    """
    nu, log_t, lapse = np.exp(log_exponent), _log_t(z, log_exponent), expit(-logit_peak)
    with np.errstate(
        over="ignore", invalid="ignore", divide="ignore"
    ):  # z = 0 and t beyond the largest float: handled below
        log_odds, along = answers[0] - answers[1], nu * np.log(np.abs(z))

        def of(steep: FloatArray, peak: FloatArray) -> Slopes:
            flat = (z == 0.0) | (steep == 0.0)
            return Slopes(
                np.where(flat, 0.0, nu * steep / z),
                (peak, np.where(steep == 0.0, 0.0, steep * along)),
            )

        return of(-np.exp(log_t), lapse), of(np.exp(log_odds + log_t), -np.exp(log_odds) * lapse)


def _log_t(z: FloatArray, log_exponent: FloatArray) -> FloatArray:
    """Log of t = ln2 abs(z)^nu; -inf at z = 0."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(LN2) + np.exp(log_exponent) * np.log(np.abs(z)))


def _log_lost(log_t: FloatArray, t: FloatArray) -> FloatArray:
    """Log of 1 - e^-t."""
    return np.where(t < 1e-17, log_t, np.log(-np.expm1(-np.maximum(t, 1e-17))))


# --- Which is stronger --------------------------------------------------------------------------------


def probit_answers(z: FloatArray) -> Answers:
    """P(second) = Phi(z)."""
    return np.asarray(log_ndtr(z)), np.asarray(log_ndtr(-z))


def probit_slopes(z: FloatArray, answers: Answers) -> tuple[Slopes, Slopes]:
    """Mills' ratios, by which nothing cancels far out: phi(z)/Phi(z) = sqrt(2/pi) / erfcx(-z/sqrt 2)."""
    rise, fall = (np.sqrt(2.0 / np.pi) / erfcx(sign * z * np.sqrt(0.5)) for sign in (-1.0, 1.0))
    return Slopes(np.asarray(rise), ()), Slopes(np.asarray(-fall), ())


_STEEP = 1.702  # with which a logistic curve is nearest to a normal one


def logistic_answers(z: FloatArray) -> Answers:
    """P(second) = 1 / (1 + exp(-1.702 z)), which has heavier tails than a normal."""
    return np.asarray(log_expit(_STEEP * z)), np.asarray(log_expit(-_STEEP * z))


def logistic_slopes(z: FloatArray, answers: Answers) -> tuple[Slopes, Slopes]:
    """Slopes of :func:`logistic_answers`."""
    return Slopes(_STEEP * expit(-_STEEP * z), ()), Slopes(-_STEEP * expit(_STEEP * z), ())


# --- Lapses -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Lapsing:
    """The rule of an observer who answers by another rule but for a share lambda of the trials; its attributes are those of :class:`Link`.

    `guess` is the coordinate that is the logit of the share, among blind answers, of the one that is counted: one of the link's, or one
    more. None: one half.

    Examples
    --------
    >>> far = Lapsing(BELL, "logit_q0").log_answers(np.array([[1e9]]), np.array([[0.0]]), np.array([[np.log(0.2 / 0.8)]]))[0]
    >>> float(np.exp(far).round(12)[0, 0])  # lambda q0 = 0.2 0.5
    0.1
    >>> Lapsing(PROBIT).coordinates, Lapsing(PROBIT, "logit_guess_second").coordinates
    (('logit_lapse_rate',), ('logit_guess_second', 'logit_lapse_rate'))
    """

    link: Link
    guess: str | None = None

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The rule's, the share's where it has its own, and the logit of lambda."""
        own = () if self.guess is None or self.guess in self.link.coordinates else (self.guess,)
        return (*self.link.coordinates, *own, "logit_lapse_rate")

    def log_answers(self, z: FloatArray, *own: FloatArray) -> Answers:
        """Sums of positive terms; the larger probability is the complement of the smaller one."""
        yes, no = (np.logaddexp(*parts) for parts in self._parts(self._of_curve(z, own), own))
        few = yes < no
        with np.errstate(divide="ignore"):  # an answer that is impossible
            other = np.log1p(-np.exp(np.where(few, yes, no)))
        return np.where(few, yes, other), np.where(few, other, no)

    def slopes(self, z: FloatArray, answers: Answers, *own: FloatArray) -> tuple[Slopes, Slopes]:
        """Slopes of the logs of a mixture: the curve's by the share of attention in an answer, those of blind answers by the rest."""
        of_curve, rate = self._of_curve(z, own), own[-1]

        def mixed(sign: float, parts: Answers, log_p: FloatArray, of: Slopes) -> Slopes:
            lapsed, attended = (np.exp(part - log_p) for part in parts)
            # Far out, where nothing of the curve is left, its slopes may be infinite: they no longer count.
            z_slope, *rest = (
                np.where(attended > 0.0, attended * part, 0.0) for part in (of.z, *of.own)
            )
            found = dict(zip(self.link.coordinates, rest, strict=True))
            if self.guess is not None:  # d log g or d log(1 - g)
                found[self.guess] = found.get(self.guess, 0.0) + lapsed * sign * expit(
                    -sign * self._guess(own)
                )
            return Slopes(
                z_slope, (*found.values(), lapsed * expit(-rate) - attended * expit(rate))
            )

        with np.errstate(over="ignore", invalid="ignore"):
            slopes = self.link.slopes(z, of_curve, *own[: len(self.link.coordinates)])
            one, other = map(mixed, (1.0, -1.0), self._parts(of_curve, own), answers, slopes)
        return one, other

    def _of_curve(self, z: FloatArray, own: tuple[FloatArray, ...]) -> Answers:
        return self.link.log_answers(z, *own[: len(self.link.coordinates)])

    def _guess(self, own: tuple[FloatArray, ...]) -> FloatArray:
        """The logit of the share of blind answers that is counted."""
        return np.zeros(1) if self.guess is None else own[self.coordinates.index(self.guess)]

    def _parts(self, of_curve: Answers, own: tuple[FloatArray, ...]) -> tuple[Answers, Answers]:
        """For either answer: logs of the parts that lapse and that attend, from the answers that a curve gives."""
        lapsed = (log_expit(own[-1]) + log_expit(sign * self._guess(own)) for sign in (1.0, -1.0))
        attended = (log_expit(-own[-1]) + part for part in of_curve)
        one, other = zip(lapsed, attended, strict=True)
        return one, other


#: The paper's rule, P(equal) = q0 2^(-z^2).
BELL = Link(("logit_q0",), bell_answers, bell_slopes)
#: The same with a free exponent.
EXPONENT = Link(("logit_q0", "log_exponent"), exponent_answers, exponent_slopes)


_NODES, _WEIGHTS = (
    0.5 * (part + offset)
    for part, offset in zip(np.polynomial.legendre.leggauss(12), (1.0, 0.0), strict=True)
)


def differencing_answers(z: FloatArray, logit_peak: FloatArray) -> Answers:
    """Log P(equal) and log P(different), each accurate to rounding wherever the other is near 1."""
    distance, k = np.broadcast_arrays(np.abs(z), criterion(logit_peak))
    with np.errstate(
        over="ignore", divide="ignore"
    ):  # distances whose square is beyond the largest float; probabilities that are 0
        inside = _log_inside(distance, k)
        outside = np.logaddexp(log_ndtr(distance - k), log_ndtr(-distance - k))
        few, many = inside < -LN2, outside < -LN2
        # Each from the other where it is the larger: its log is then near 0 and would lose its digits.
        return (
            np.where(many & ~few, np.log1p(-np.exp(np.minimum(outside, -LN2))), inside),
            np.where(few, np.log1p(-np.exp(np.minimum(inside, -LN2))), outside),
        )


def criterion(logit_peak: npt.ArrayLike) -> FloatArray:
    """Criterion k with 2 Phi(k) - 1 = expit(logit_peak), accurate in both tails; in standard deviations of the difference."""
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
        result[level] = _log_mass(distance[level], k[level]) - 0.5 * (
            np.square(distance[level]) + LOG_2PI
        )
    return np.asarray(result)


def _level(distance: FloatArray, k: FloatArray) -> BoolArray:
    """Where the window is narrow and the density in it nearly level: there Phi(k - d) and Phi(-k - d) nearly cancel."""
    return np.asarray((k < 0.5) & (np.minimum(k, 0.5) * distance < 0.5))


def _log_mass(distance: FloatArray, k: FloatArray) -> FloatArray:
    """Log of the integral of exp(-t^2/2 - d t) over the window -k < t < k, shape (n,), where it is narrow: by positive terms."""
    t = k[:, None] * _NODES
    return np.asarray(
        np.log(
            2.0 * k * ((np.exp(-0.5 * np.square(t)) * np.cosh(distance[:, None] * t)) @ _WEIGHTS)
        )
    )


def differencing_slopes(
    z: FloatArray, answers: Answers, logit_peak: FloatArray
) -> tuple[Slopes, Slopes]:
    """Slopes of :func:`differencing_answers` in z and in the logit l of the peak, with 2 phi(k) dk/dl = expit(l) expit(-l).

    With d = abs(z) - k the distance of the near edge from the mean, log P has the slopes phi(d) (e^(-2 abs(z) k) - 1)/P in abs(z) and
    phi(d) (1 + e^(-2 abs(z) k))/P in k; log(1 - P) has the same over -(1 - P).
    """
    distance, k = np.broadcast_arrays(np.abs(z), criterion(logit_peak))
    with np.errstate(
        over="ignore", invalid="ignore"
    ):  # distances whose square is beyond the largest float
        rate = np.exp(
            log_expit(logit_peak) + log_expit(-logit_peak) + 0.5 * (np.square(k) + LOG_2PI) - LN2
        )
        fall, far = np.sign(z) * np.expm1(-2.0 * distance * k), np.exp(-2.0 * distance * k)
        log_edge = -0.5 * (np.square(distance - k) + LOG_2PI)
        inside, outside = np.asarray(np.exp(log_edge - answers[0])), np.exp(log_edge - answers[1])
        # Far out P and phi(d) are too small for their ratio: P by Mills' ratios of both edges, or by the integral over the window.
        level = _level(distance, k)
        beyond = (distance - k > 2.0) & ~level
        mills = np.sqrt(0.5 * np.pi) * (
            erfcx((distance - k) * np.sqrt(0.5)) - far * erfcx((distance + k) * np.sqrt(0.5))
        )
        inside[beyond] = 1.0 / mills[beyond]
        d, half = distance[level], k[level]
        inside[level] = np.exp(half * (d - 0.5 * half) - _log_mass(d, half))
        return Slopes(inside * fall, (inside * (1.0 + far) * rate,)), Slopes(
            -outside * fall, (-outside * (1.0 + far) * rate,)
        )


def differencing_half(logit_peak: FloatArray) -> FloatArray:
    """The z at which P(equal) is half its peak; sqrt(2 ln 2) for a peak near 0, about the criterion for one near 1.

    Examples
    --------
    >>> z = differencing_half(np.array([-30.0, 0.0, 8.0]))
    >>> z.round(3).tolist(), np.exp(differencing_answers(z, np.array([-30.0, 0.0, 8.0]))[0]).round(3).tolist()
    ([1.177, 1.269, 3.587], [0.0, 0.25, 0.5])
    """
    k = criterion(logit_peak)
    z = np.sqrt(2.0 * LN2 + np.square(k))  # above the root
    goal = log_expit(logit_peak) - LN2
    for _ in range(
        6
    ):  # Newton on the log of P(equal), which is concave in z: from above each step stays there
        answers = differencing_answers(z, logit_peak)
        z = z - (answers[0] - goal) / differencing_slopes(z, answers, logit_peak)[0].z
    return np.asarray(z)


#: Signal detection: 'equal' where a noisy difference lies within a criterion.
DIFFERENCING = Link(("logit_q0",), differencing_answers, differencing_slopes, differencing_half)
#: Which is stronger: a normal curve, and a logistic one.
PROBIT = Link((), probit_answers, probit_slopes, float(ndtri(0.75)))
LOGISTIC = Link((), logistic_answers, logistic_slopes, float(np.log(3.0) / _STEEP))
