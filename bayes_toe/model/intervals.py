"""Pull and width of the paper's model (H1) as functions of the inter-stimulus interval.

The memory is a random walk: its variance grows with time. `random_walk_scales` gives pull and width
at an interval over those at the reference interval, which `reference_interval` chooses.

The coordinates of H1 (offset c, pull p, width w) and their prior refer to a reference interval, by
default the geometric mean of the study's, in which time is counted here: t = 1 is the reference.
The prior mean mu1 is the same at every interval and the offset at t is p_t (mu1 - sbar), so with r
= p_t/p_1 and v = w_t/w_1

    z = ((s2 - s1) + r [p_1 (s1 - sbar) - c]) / (w_1 v).

Both scales are 1 at the reference, so a study with one interval is one without. They follow from
the same filtering equations as the model at one interval: a stimulus is measured, the belief
evolves for t, the next stimulus meets it.

The variance grows by sigma_p^2 t, so gamma_t = gamma/t, r = (G_1/G_t)^2 / t and v = sqrt(t)
(G_t/G_1)^(3/2); asked which is stronger, v = sqrt(t) G_t/G_1. The longer the interval, the nearer
the weight of the first stimulus comes to 1, and the width grows without end. In seconds everything
that the paper derives for one interval holds with sigma_p sqrt(t) in the place of sigma_p, which
then is in natural-log intensity per square root of a second; mu1, sigma_l and q0 are common to all
intervals. The model assumes that each interval has its own self-consistent prior, of variance G_t
sigma_p^2 t, as it has when its trials are run in a block. If intervals were mixed at random and had
one prior, the weight of the first stimulus would be the same at every interval, and only the width
would depend on the interval. Data from mixed intervals can decide between the two. Forgetting shows
in the width alone (erratum 6; see docs/background.md). The width is smallest, 2 sigma_l, where
gamma_t = 2. At shorter intervals the memory is so narrow that the second stimulus moves it little.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import expit

from bayes_toe.arrays import FloatArray, IndexArray, IntArray
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.model.paper_equations import MAX_PULL, Natural, pull, variance_ratio


def at_interval(theta: Natural, isi: npt.ArrayLike) -> Natural:
    """The parameters of the one-interval model that describe an interval.

    sigma_p sqrt(isi) takes the place of sigma_p.

    Parameters
    ----------
    theta : Natural
        mu1, sigma_l (natural-log intensity), sigma_p (natural-log intensity per square root of a
        second), q0; broadcast with isi.
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
    return theta._replace(sigma_p=np.asarray(theta.sigma_p, np.float64) * np.sqrt(interval))


def require_intervals(isi: npt.ArrayLike) -> FloatArray:
    """Intervals as an array of seconds, positive and finite."""
    intervals = np.asarray(isi, np.float64)
    if not (np.isfinite(intervals) & (intervals > 0)).all():
        raise InputError("isi: intervals must be positive finite numbers of seconds")
    return intervals


class Scales(NamedTuple):
    """Pull and width at intervals over those at the reference, r and v, or derivatives.

    Each has the shape (points, intervals).
    """

    pull: FloatArray
    width: FloatArray

    def of_pairs(self, interval: IndexArray) -> Scales:
        """The values for pairs, given the index of each pair's interval, shape (pairs,)."""
        return Scales(self.pull[:, interval], self.width[:, interval])


#: At one interval: exactly 1.
UNSCALED = Scales(np.ones((1, 1)), np.ones((1, 1)))


def typical_interval(isi: FloatArray, n_trials: IntArray) -> FloatArray:
    """Geometric mean over trials, seconds, shape (1,).

    Where a search starts from widths on the scale of the stimuli.
    """
    return np.exp(np.average(np.log(isi), weights=n_trials, keepdims=True))


def reference_interval(reference: float | None, *subjects: Subject) -> float:
    """An interval, or the geometric mean of the subjects' intervals over all trials, seconds.

    It is 1 where subjects have none.
    """
    if reference is not None:
        return reference
    timed = [(subject.isi, subject.n_trials) for subject in subjects if subject.isi is not None]
    if not timed:
        return 1.0
    isi, n_trials = map(np.concatenate, zip(*timed, strict=True))
    if np.ptp(isi) == 0.0:
        return float(isi[0])
    return float(typical_interval(isi, n_trials)[0])


def random_walk_scales(logit_pull: FloatArray, intervals: FloatArray, power: float = 1.5) -> Scales:
    """Scales of a memory that diffuses by sigma_p^2 a reference interval.

    The width is sigma_p G^power. As gamma -> 0, r -> 1/t and v -> sqrt(t): nothing is lost however
    small the pull.

    Examples
    --------
    >>> scales = random_walk_scales(np.array([-40.0]), np.array([1.0, 4.0]))
    >>> [part.round(6).tolist() for part in scales]
    [[[1.0, 0.25]], [[1.0, 2.0]]]
    """
    gamma = noise_ratio_at(logit_pull)
    # t = 1 goes by the same formula: exactly 1.
    ratio = variance_ratio(gamma / intervals) / variance_ratio(gamma)
    return Scales(1.0 / (np.square(ratio) * intervals), np.sqrt(intervals) * ratio**power)


def random_walk_slopes(logit_pull: FloatArray, intervals: FloatArray, power: float = 1.5) -> Scales:
    """Derivatives of the logs of :func:`random_walk_scales` in the logit of the pull.

    With e = log(G_t/G_1), log r = -2 e - log t and log v = power e + log(t)/2. With u = log gamma,
    de/du = p_t/(1 + p_t) - p_1/(1 + p_1) and du/da = expit(-a) (1 + p_1)/(1 - p_1).
    """
    gamma = noise_ratio_at(logit_pull)
    p1, pt = pull(gamma), pull(gamma / intervals)
    by_log_gamma = pt / (1.0 + pt) - p1 / (1.0 + p1)
    slope = by_log_gamma * expit(-logit_pull[:, None]) * (1.0 + p1) / (1.0 - p1)
    return Scales(-2.0 * slope, power * slope)


def noise_ratio_at(logit_pull: FloatArray) -> FloatArray:
    """Noise ratio at the reference interval, (points,) -> (points, 1).

    gamma = p/(1 - p)^2 with p = p_max expit(logit_pull).
    """
    p = MAX_PULL * expit(logit_pull[:, None])
    return p / np.square(1.0 - p)


def interval_units(reference: float) -> dict[str, str]:
    """Units of the quantities that are those at the reference interval, seconds.

    Examples
    --------
    >>> interval_units(0.5)["gamma"]
    '1, at 0.5 s'
    """
    share, intensity = f"1, at {reference:g} s", f"ln intensity, at {reference:g} s"
    return {
        "sigma_p": f"ln intensity / ({reference:g} s)^(1/2)",
        "gamma": share,
        "gain": share,
        "sigma1": intensity,
        "width": intensity,
    }
