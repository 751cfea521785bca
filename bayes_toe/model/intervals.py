"""How pull and width depend on the inter-stimulus interval: one propagator, one pair of scales.

A model's coordinates (offset c, pull p, width w) and their prior refer to a reference interval, by default the geometric mean of the
study's, in which time is counted here: t = 1 is the reference. The prior mean mu1 is the same at every interval and the offset at t is
p_t (mu1 - sbar), so with r = p_t/p_1 and v = w_t/w_1

    z = ((s2 - s1) + r [p_1 (s1 - sbar) - c]) / (w_1 v).

Both scales are 1 at the reference, so a study with one interval is one without. They follow from the same filtering equations as the model
at one interval: a stimulus is measured, the belief evolves for t, the next stimulus meets it.

**Random walk** (predictive update). The variance grows by sigma_p^2 t, so gamma_t = gamma/t, r = (G_1/G_t)^2 / t and
v = sqrt(t) (G_t/G_1)^(3/2): the longer the interval, the nearer the weight of the first stimulus comes to 1, and the width grows without
end. In seconds everything that the paper derives for one interval holds with sigma_p sqrt(t) in the place of sigma_p, which then is in
natural-log intensity per square root of a second; mu1, sigma_l and q0 are common to all intervals. Assumed is that each interval has its
own self-consistent prior, of variance G_t sigma_p^2 t, as it has when its trials are run in a block. Were intervals mixed at random and
the prior one for all of them, the first stimulus would be weighted alike at every interval, and only the width would depend on it; data
from mixed intervals can tell. Forgetting shows in the width alone (erratum 6; see docs/errata.md), which is least, 2 sigma_l, where
gamma_t = 2: at shorter intervals the memory is so narrow that the second stimulus moves it little.

**Mean-reverting memory** (Ornstein-Uhlenbeck). Drift -(s - mu1)/tau and diffusion 2 sigma1^2/tau have the prior as their stationary state,
as at one interval, where the record ties both to (mu1, sigma1). Two such steps make one, rho_(t+u) = rho_t rho_u with rho_t = exp(-t/tau),
so with rho = rho_1 the memory kept over t is rho^t. The measurement does not know how long the pause will be: its gain
K = sigma1^2/(sigma1^2 + sigma_l^2) has no interval. Therefore

    mu_2 = mu1 + rho^t K (s1 - mu1),    sigma_2^2 = sigma1^2 (1 - rho^(2t) K),
    g_t = 1 - p_t = rho^t K,            w_t = sigma_2 + sigma_l^2/sigma_2 = sigma1 (1 - g_t^2) / (K (1 - g_t rho^t)^(1/2)).

Only the decay is a power of the interval, not the weight: g_t goes from K, right after the stimulus, to 0, and the width saturates at
sigma1/K, that of a comparison with the prior alone. Nothing else is open: a stationary variance other than sigma1^2 would be a
parameter that the model at one interval does not have. One prior serves all intervals, mixed or in blocks; assumed is, as at one interval,
that the pause before a pair is long enough for the memory to be the prior again. One interval tells rho K only; several tell rho and K.

What the unit of z is depends on the task (:class:`CurveScale`); above it is that of same or different.

The two disagree on what an interval does to the order effect: under the random walk it shrinks as the interval grows, under the
mean-reverting memory it grows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import expit, exprel, log_expit

from bayes_toe.arrays import FloatArray, IndexArray, IntArray
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import MAX_PULL, pull, variance_ratio
from bayes_toe.model.coordinates import Natural


def at_interval(theta: Natural, isi: npt.ArrayLike) -> Natural:
    """The parameters of the one-interval model that describe an interval: sigma_p sqrt(isi) in the place of sigma_p.

    Parameters
    ----------
    theta : Natural
        mu1, sigma_l (natural-log intensity), sigma_p (natural-log intensity per square root of a second), q0; broadcast with isi.
    isi : array_like
        Intervals, seconds.

    Raises
    ------
    InputError
        If an interval is not positive and finite.

    Examples
    --------
    >>> theta = Natural(*map(np.asarray, (0.0, 0.2, 0.2, 0.9)))
    >>> [round(float(at_interval(theta, isi).gamma), 12) for isi in (0.5, 1.0, 4.0)]
    [2.0, 1.0, 0.25]
    """
    interval = require_intervals(isi)
    return theta._replace(
        sigma_p=np.asarray(np.asarray(theta.sigma_p, np.float64) * np.sqrt(interval))
    )


def require_intervals(isi: npt.ArrayLike) -> FloatArray:
    """Intervals as an array of seconds, positive and finite."""
    intervals = np.asarray(isi, np.float64)
    if not (np.isfinite(intervals) & (intervals > 0)).all():
        raise InputError("isi: intervals must be positive finite numbers of seconds")
    return intervals


class Scales(NamedTuple):
    """Pull and width at an interval over those at the reference, r and v, each of shape (points, intervals).

    Or their logarithmic derivatives in the q coordinates of a propagator, each of shape (q, points, intervals).
    """

    pull: FloatArray
    width: FloatArray

    def of_pairs(self, which: IndexArray) -> Scales:
        """Those of pairs, shape (..., points, pairs), given the place of each pair's interval, shape (pairs,) or (points, pairs)."""
        at = (..., which) if which.ndim == 1 else (..., np.arange(len(which))[:, None], which)
        return Scales(self.pull[at], self.width[at])


class CurveScale(NamedTuple):
    """What a curve's width is, by the variances of memory and measurement: (sigma_2^2 + sigma_l^2)^total / sigma_2^(2 own).

    In the predictive update sigma_2^2 = G sigma_p^2 and the sum G^2 sigma_p^2, so that the width is sigma_p G^(2 total - own).
    """

    total: float
    own: float

    @property
    def power(self) -> float:
        """Of G, in the predictive update."""
        return 2.0 * self.total - self.own


#: Same or different: sigma_2 + sigma_l^2/sigma_2 (Eq. mod:q).
OF_EQUAL = CurveScale(1.0, 0.5)
#: Which is stronger: sigma_d, the standard deviation of the second measurement as memory predicts it.
OF_SECOND = CurveScale(0.5, 0.0)


#: At one interval, and of a model that does not mention the interval: exactly 1.
UNSCALED = Scales(np.ones((1, 1)), np.ones((1, 1)))


def typical_interval(isi: FloatArray, n_trials: IntArray) -> FloatArray:
    """Geometric mean over trials, seconds, shape (1,): where a search starts from widths on the scale of the stimuli."""
    return np.asarray(np.exp(np.average(np.log(isi), weights=n_trials, keepdims=True)))


def reference_interval(given: float | None, *subjects: Subject) -> float:
    """The interval given, or the geometric mean of the subjects' own over all trials, seconds; 1 where they have none."""
    known = [(one.isi, one.n_trials) for one in subjects if one.isi is not None]
    if given is not None or not known:
        return 1.0 if given is None else given
    isi, n_trials = (np.concatenate(columns) for columns in zip(*known, strict=True))
    return float(isi[0] if np.ptp(isi) == 0.0 else typical_interval(isi, n_trials)[0])


def random_walk_scales(
    logit_pull: FloatArray, intervals: FloatArray, curve: CurveScale = OF_EQUAL
) -> Scales:
    """Scales of a memory that diffuses by sigma_p^2 a reference interval, shapes (points,) and (intervals,).

    As gamma -> 0, r -> 1/t and v -> sqrt(t): nothing is lost however small the pull.

    Examples
    --------
    >>> [part.round(6).tolist() for part in random_walk_scales(np.array([-40.0]), np.array([1.0, 4.0]))]
    [[[1.0, 0.25]], [[1.0, 2.0]]]
    """
    gamma = noise_ratio_at(logit_pull)
    ratio = variance_ratio(gamma / intervals) / variance_ratio(
        gamma
    )  # t = 1 by the same formula: exactly 1
    return Scales(1.0 / (np.square(ratio) * intervals), np.sqrt(intervals) * ratio**curve.power)


def noise_ratio_at(logit_pull: FloatArray) -> FloatArray:
    """Noise ratio at the reference interval, gamma = p/(1 - p)^2 with p = p_max expit(logit_pull), shape (points,) -> (points, 1)."""
    p = MAX_PULL * expit(logit_pull[:, None])
    return np.asarray(p / np.square(1.0 - p))


def mean_reverting_scales(
    logit_pull: FloatArray,
    logit_split: FloatArray,
    intervals: FloatArray,
    curve: CurveScale = OF_EQUAL,
) -> Scales:
    """Scales of a memory that decays to the prior by rho^t, shapes (points,), (points,) and (intervals,).

    With l = -ln g_1 and rho = g_1^s, 0 < s < 1, the exponents are linear in the interval: g_t = exp(-l m) and g_t rho^t = exp(-l n) with
    m = 1 - s + s t and n = m + s t, so

        r = (1 - exp(-l m)) / (1 - exp(-l)),    v = f_t/f_1,    f_t = (1 - exp(-2 l m)) / (1 - exp(-l n))^(1/2).

    and of another curve, with sigma_2^2 + sigma_l^2 = sigma1^2 (1 - g_t^2)/K and sigma_2^2 = sigma1^2 (1 - g_t rho^t), other powers of
    these.

    As l -> 0, r -> m and v -> m ((1 + s)/n)^(1/2), which the quotients (1 - e^-x)/x keep to all digits.

    Examples
    --------
    >>> scales = mean_reverting_scales(np.array([0.0]), np.array([0.0]), np.array([1.0, 3.0]))  # g_1 = 1/2, so g_3 = 1/4
    >>> scales.pull.round(12).tolist()
    [[1.0, 1.5]]
    """
    lost = np.logaddexp(0.0, logit_pull[:, None])
    kept, decayed = expit(-logit_split[:, None]), expit(logit_split[:, None])

    def forms(t: FloatArray) -> Scales:
        """(1 - g_t)/l and f_t/l^(1/2), but for factors without t."""
        m, n = kept + decayed * t, kept + 2.0 * decayed * t
        return Scales(
            m * exprel(-lost * m),
            (m * exprel(-2.0 * lost * m)) ** curve.total / (n * exprel(-lost * n)) ** curve.own,
        )

    at, one = forms(intervals), forms(np.ones(1))  # t = 1 by the same formula: exactly 1
    return Scales(at.pull / one.pull, at.width / one.width)


def random_walk_growth(
    logit_pull: FloatArray, intervals: FloatArray, curve: CurveScale = OF_EQUAL
) -> Scales:
    """Derivatives of :func:`random_walk_scales`: with e = log(G_t/G_1), log r = -2 e - log t and log v = power e + log(t)/2.

    With u = log gamma, de/du = p_t/(1 + p_t) - p_1/(1 + p_1) and du/da = expit(-a) (1 + p_1)/(1 - p_1).
    """
    gamma = noise_ratio_at(logit_pull)
    p1, pt = pull(gamma), pull(gamma / intervals)
    slope = (
        (pt / (1.0 + pt) - p1 / (1.0 + p1)) * expit(-logit_pull[:, None]) * (1.0 + p1) / (1.0 - p1)
    )
    return Scales(-2.0 * slope[None], curve.power * slope[None])


def mean_reverting_growth(
    logit_pull: FloatArray,
    logit_split: FloatArray,
    intervals: FloatArray,
    curve: CurveScale = OF_EQUAL,
) -> Scales:
    """Derivatives of :func:`mean_reverting_scales` in (logit pull, logit split), with d log(1 - e^-x)/d log x = x/(e^x - 1)."""
    lost, log_growth = np.logaddexp(0.0, logit_pull[:, None]), log_lost_slope(logit_pull[:, None])
    kept, decayed = expit(-logit_split[:, None]), expit(logit_split[:, None])

    def forms(t: FloatArray) -> Scales:
        """Of log(1 - g_t) and log f_t, less what log l adds to each."""
        m, n = kept + decayed * t, kept + 2.0 * decayed * t
        by_m, by_n = kept * decayed * (t - 1.0) / m, kept * decayed * (2.0 * t - 1.0) / n
        once, twice, mixed = (1.0 / exprel(lost * part) for part in (m, 2.0 * m, n))
        of_width = (
            log_growth * (curve.total * twice - curve.own * mixed - curve.total + curve.own),
            curve.total * by_m * twice - curve.own * by_n * mixed,
        )
        return Scales(np.stack([log_growth * (once - 1.0), by_m * once]), np.stack(of_width))

    return Scales(*(at - one for at, one in zip(forms(intervals), forms(np.ones(1)), strict=True)))


def log_lost_slope(logit_pull: FloatArray) -> FloatArray:
    """Derivative of log l in the logit of the pull p, l = -log(1 - p)."""
    return np.asarray(np.exp(log_expit(logit_pull) - log_lost(logit_pull)))


def log_lost(logit_pull: FloatArray) -> FloatArray:
    """log(-log(1 - p)) at the logit of the pull."""
    return np.where(
        logit_pull < -30.0, logit_pull, np.log(np.logaddexp(0.0, np.maximum(logit_pull, -30.0)))
    )


@dataclass(frozen=True)
class Propagator:
    """How a memory evolves over an interval, as its scales and their logarithmic derivatives.

    Both follow from unconstrained coordinates, each of shape (points,), and the intervals over the reference, shape (intervals,).
    """

    about: str
    coordinates: tuple[str, ...]
    scales: Callable[..., Scales]
    growth: Callable[..., Scales]
    units: tuple[
        tuple[str, str], ...
    ]  # of quantities that are those at the reference interval, {} in them


_SHARE, _INTENSITY = "1, at {}", "ln intensity, at {}"


def random_walk(curve: CurveScale) -> Propagator:
    """The predictive update's."""
    return Propagator(
        "memory's variance grows by sigma_p^2 over the reference interval, with a self-consistent prior for each interval",
        ("logit_pull",),
        partial(random_walk_scales, curve=curve),
        partial(random_walk_growth, curve=curve),
        (
            ("sigma_p", "ln intensity / ({})^(1/2)"),
            ("gamma", _SHARE),
            ("gain", _SHARE),
            ("sigma1", _INTENSITY),
            ("width", _INTENSITY),
        ),
    )


def mean_reversion(curve: CurveScale) -> Propagator:
    """That of a memory that decays to the prior."""
    return Propagator(
        "memory keeps rho over the reference interval, rho^t over t of them",
        ("logit_pull", "logit_split"),
        partial(mean_reverting_scales, curve=curve),
        partial(mean_reverting_growth, curve=curve),
        (("rho", _SHARE), ("gain", _SHARE), ("width", _INTENSITY)),
    )
