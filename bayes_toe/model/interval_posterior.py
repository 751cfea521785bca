"""Log posterior of one subject with several inter-stimulus intervals; the same coordinates, prior and seam as for one interval.

Unconstrained coordinates refer to one second: x = (c, a, b, l) with c = p_1 (mu_1 - sbar), p_1 = p_max expit(a), log w_1 = b. With the
random walk's scales of pull and width, r and v, which depend on a alone (:mod:`bayes_toe.model.propagators`),

    z = ((s2 - s1) + r [p_1 (s1 - sbar) - c]) / (w_1 v).

The prior on gamma is at one second.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.special import expit

from bayes_toe.arrays import FloatArray, IndexArray
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import MAX_PULL, pull
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.propagators import grouped_intervals, noise_ratio_at, random_walk_scales, typical_interval


def posterior_of(subject: Subject, prior: Prior | None = None) -> Posterior:
    """The log posterior that a subject needs: with intervals where it has them, the paper's where not.

    Examples
    --------
    >>> type(posterior_of(Subject("S01", [0.0], [0.3], [2], [5], isi=[0.5]))).__name__
    'IntervalPosterior'
    """
    chosen = Prior() if prior is None else prior
    return Posterior(subject, chosen) if subject.isi is None else IntervalPosterior(subject, chosen)


@dataclass(frozen=True, eq=False)
class IntervalPosterior(Posterior):
    """Log posterior of one subject whose pairs have intervals (`subject.isi`, seconds).

    Equations and the assumption behind them: :mod:`bayes_toe.model.intervals`. With every interval one second it equals
    :class:`bayes_toe.model.posterior.Posterior`.

    Raises
    ------
    InputError
        If the subject has no intervals.

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0], [0.3, 0.3], [20, 30], [50, 50], isi=[0.5, 2.0])
    >>> IntervalPosterior(subject).log_density([[0.0, 0.0, -1.0, 2.0]]).shape
    (1,)
    """

    knows_intervals: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.subject.isi is None:
            raise InputError(f"subject {self.subject.name!r} has no intervals: Posterior is for one interval")
        for key, values in zip(("_seconds", "_which"), grouped_intervals(self.subject.isi), strict=True):
            object.__setattr__(self, key, values)

    _seconds: FloatArray = field(init=False, repr=False)
    _which: IndexArray = field(init=False, repr=False)

    def starts(self) -> FloatArray:
        """Points from which to look for maxima, shape (18, 4): on the scale of the stimuli at the typical interval."""
        points = super().starts()
        scale = random_walk_scales(points[:, 1], typical_interval(np.asarray(self.subject.isi), self.subject.n_trials))
        return scale.to_one_second(points, offset=0, log_width=2)

    def distance(self, x: FloatArray) -> FloatArray:
        """Normalised distance z of every pair at its interval, (points, 4) -> (points, pairs)."""
        scale = random_walk_scales(x[:, 1], self._seconds).of_pairs(self._which)
        shift = scale.pull * (MAX_PULL * expit(x[:, 1, None]) * self._lever - x[:, 0, None])
        return np.asarray((self._step + shift) * np.exp(-x[:, 2, None]) / scale.width)

    def _distance_derivatives(self, x: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """First derivatives of z in (c, a, b), (points, pairs, 3), and its second ones in (c, a) and (a, a), (points, pairs, 2)."""
        scale = random_walk_scales(x[:, 1], self._seconds).of_pairs(self._which)
        growth = _growth(x[:, 1], self._seconds).of_pairs(self._which)
        fall, slope, bend = expit(-x[:, 1, None]), growth.first, growth.second
        inverse = np.exp(-x[:, 2, None]) / scale.width
        pulled = scale.pull * MAX_PULL * expit(x[:, 1, None]) * self._lever
        apart = scale.pull * x[:, 0, None]
        # With e = log(G_t/G_1): r_a/r = -2 e_a, (p_t)_a/p_t = expit(-a) - 2 e_a, v_a/v = 1.5 e_a; N is the numerator of z.
        n_a = pulled * (fall - 2.0 * slope) + 2.0 * apart * slope
        n_aa = pulled * (np.square(fall - 2.0 * slope) - fall * (1.0 - fall) - 2.0 * bend) - apart * (4.0 * np.square(slope) - 2.0 * bend)
        z_c = -scale.pull * inverse
        z_a = n_a * inverse - 1.5 * slope * z
        z_aa = n_aa * inverse - 3.0 * slope * n_a * inverse + z * (2.25 * np.square(slope) - 1.5 * bend)
        return np.stack([z_c, z_a, -z], -1), np.stack([-3.5 * slope * z_c, z_aa], -1)

    def _curvature(self, z: FloatArray, z1: FloatArray, second: FloatArray, odds: FloatArray, bend: FloatArray) -> FloatArray:
        """As for one interval, and what the slope of r and v in a adds: here z_ca is not 0."""
        result = super()._curvature(z, z1, second[..., 1], odds, bend)
        mixed = ((odds - self._equal) * z * second[..., 0]).sum(axis=1)
        result[:, 0, 1] += mixed
        result[:, 1, 0] += mixed
        return result


class _Growth(NamedTuple):
    """First and second derivative of log(G_t/G_1) in a, each of shape (points, intervals)."""

    first: FloatArray
    second: FloatArray

    def of_pairs(self, which: IndexArray) -> _Growth:
        return _Growth(self.first[:, which], self.second[:, which])


def _growth(a: FloatArray, seconds: FloatArray) -> _Growth:
    """With u = log gamma: d log G/du = p/(1 + p), its slope p (1 - p)/(1 + p)^3, and du/da = expit(-a) (1 + p_1)/(1 - p_1)."""
    gamma, fall = noise_ratio_at(a), expit(-a[:, None])
    p1, pt = pull(gamma), pull(gamma / seconds)
    u1 = fall * (1.0 + p1) / (1.0 - p1)
    u2 = 2.0 * p1 * np.square(fall / (1.0 - p1)) - (1.0 - fall) * u1
    steep = pt / (1.0 + pt) - p1 / (1.0 + p1)
    bent = pt * (1.0 - pt) / (1.0 + pt) ** 3 - p1 * (1.0 - p1) / (1.0 + p1) ** 3
    return _Growth(steep * u1, bent * np.square(u1) + steep * u2)
