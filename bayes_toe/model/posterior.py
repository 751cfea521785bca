"""Log posterior of one subject in unconstrained coordinates: value, gradient, Hessian. The one thing that engines see.

log posterior = log likelihood (no binomial coefficients) + log prior, a density with respect to
x = (c, logit(p/p_max), log w, logit q0), so that its integral over x is the evidence of H1.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import expit, hyp1f1, log_expit, logit

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject, refuse_intervals
from bayes_toe.model.closed_form import LN2, MAX_PULL, log_different, log_equal
from bayes_toe.model.coordinates import UNCONSTRAINED, Natural, derived, natural
from bayes_toe.model.levelling import Levelling
from bayes_toe.model.prior import Prior, pull_derivatives
from bayes_toe.model.target import require_points

#: Values of one temporary array: small enough for the processor's cache, so memory stays flat however many pairs or points.
_BLOCK = 1 << 16
#: Quantities whose ranks differ, so whose diagnostics do: the four natural parameters, and of the unconstrained and derived ones
#: those that are not a monotone function of a single one already listed.
JUDGED = ("mu1", "sigma_p", "sigma_l", "q0", "gamma", "sigma1", "width", "offset")


class Parts(NamedTuple):
    """Log likelihood and log prior density, each of shape (points,)."""

    log_likelihood: FloatArray
    log_prior: FloatArray

    @property
    def log_posterior(self) -> FloatArray:
        """Their sum: the unnormalised log posterior density."""
        return self.log_likelihood + self.log_prior


@dataclass(frozen=True, eq=False)
class Posterior:
    """Log posterior of one subject.

    Parameters
    ----------
    subject : Subject
        The counts.
    prior : Prior
        The prior; default as stated in :mod:`bayes_toe.model.prior`.

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0], [0.0, 0.3], [49, 20], [50, 50])
    >>> Posterior(subject).log_density([[0.0, 0.0, -1.0, 2.0]]).shape
    (1,)
    """

    subject: Subject
    prior: Prior = field(default_factory=Prior)

    #: Whether pairs may have intervals of their own: see :class:`bayes_toe.model.interval_posterior.IntervalPosterior`.
    knows_intervals: ClassVar[bool] = False

    def __post_init__(self) -> None:
        subject = self.subject
        if not self.knows_intervals:
            refuse_intervals([subject], "Posterior (bt.posterior_of gives the one that knows them)")
        sbar = float(np.average(subject.s1, weights=subject.n_trials))
        different = (subject.n_trials - subject.n_equal).astype(np.float64)
        for key, value in {
            "sbar": sbar,
            "_step": subject.s2 - subject.s1,
            "_lever": subject.s1 - sbar,
            "_equal": subject.n_equal.astype(np.float64),
            "_different": different,
        }.items():
            object.__setattr__(self, key, value)

    sbar: float = field(init=False)
    _step: FloatArray = field(init=False, repr=False)
    _lever: FloatArray = field(init=False, repr=False)
    _equal: FloatArray = field(init=False, repr=False)
    _different: FloatArray = field(init=False, repr=False)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the unconstrained coordinates."""
        return UNCONSTRAINED

    def natural(self, x: npt.ArrayLike) -> Natural:
        """Natural coordinates of unconstrained points x, shape (..., 4)."""
        return natural(x, self.sbar)

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """Log posterior density at x, shape (points, 4) -> (points,).

        Raises
        ------
        NumericalError
            If a coordinate is NaN.
        """
        return self.parts(x).log_posterior

    def parts(self, x: npt.ArrayLike) -> Parts:
        """Log likelihood and log prior at x, shape (points, 4)."""
        points = require_points(x, len(UNCONSTRAINED))
        return Parts(self.log_likelihood(points), self.log_prior(points))

    def log_prior(self, x: npt.ArrayLike) -> FloatArray:
        """Log prior density at x, shape (points, 4) -> (points,)."""
        return self.prior.log_density_unconstrained(x, self.sbar)

    def sample_prior(self, rng: np.random.Generator | np.random.RandomState, size: int) -> FloatArray:
        """Independent draws from the prior in unconstrained coordinates, shape (size, 4)."""
        return self.prior.sample_unconstrained(rng, size, self.sbar)

    def starts(self) -> FloatArray:
        """Points from which to look for maxima, shape (18, 4)."""
        return starts(self.subject)

    def levelling(self, modes: FloatArray) -> Levelling:
        """Coordinates in which mixtures fit, given modes, shape (modes, 4), best first."""
        return Levelling.at(self, modes)

    def for_subject(self, subject: Subject) -> Posterior:
        """The same model for other answers; its prior is about mu1, so it does not depend on where offsets count from."""
        return type(self)(subject, self.prior)

    def judged(self, x: FloatArray) -> dict[str, FloatArray]:
        """The quantities that :data:`JUDGED` names, each with the shape of x without its last axis."""
        theta = self.natural(x)
        everything = {**theta._asdict(), **derived(theta), "offset": x[..., 0]}
        return {name: everything[name] for name in JUDGED}

    def log_likelihood(self, x: npt.ArrayLike) -> FloatArray:
        """Log likelihood at x, shape (points, 4) -> (points,)."""
        points = require_points(x, len(UNCONSTRAINED))
        rows = max(1, _BLOCK // self.subject.n_pairs)
        return np.concatenate([self._block(points[i : i + rows]) for i in range(0, len(points), rows)])

    def pair_log_likelihood(self, x: npt.ArrayLike) -> FloatArray:
        """Log likelihood of each pair, shape (points, 4) -> (points, pairs)."""
        points = require_points(x, len(UNCONSTRAINED))
        z = self.distance(points)
        logit_q0 = points[:, 3, None]
        result = np.zeros(z.shape)
        for counts, log_answer in ((self._equal, self._log_equal), (self._different, log_different)):
            given = counts > 0  # an answer never given contributes 0, also where its probability is 0
            some = slice(None) if given.all() else given  # a slice does not copy
            result[:, some] += counts[some] * log_answer(z[:, some], logit_q0)
        return result

    def log_answers(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Log P(equal) and log P(different) of every pair, (points, 4) -> (points, pairs) each."""
        points = require_points(x, len(UNCONSTRAINED))
        z, top = self.distance(points), points[:, 3, None]
        with np.errstate(over="ignore"):  # z^2 beyond the largest float: log P(equal) is -inf to all digits
            return log_equal(z, log_expit(top)), log_different(z, top)

    @staticmethod
    def _log_equal(z: FloatArray, logit_q0: FloatArray) -> FloatArray:
        return np.asarray(log_expit(logit_q0) - LN2 * np.square(z))

    def distance(self, x: FloatArray) -> FloatArray:
        """Normalised distance z of every pair, (points, 4) -> (points, pairs)."""
        shift = MAX_PULL * expit(x[:, 1, None]) * self._lever - x[:, 0, None]
        return np.asarray((self._step + shift) * np.exp(-x[:, 2, None]))

    def equal_probability(self, x: FloatArray) -> FloatArray:
        """P(equal) of every pair, (points, 4) -> (points, pairs). Source: Eq. mod:q."""
        return np.asarray(np.exp(log_expit(x[:, 3, None]) - LN2 * np.square(self.distance(x))))

    def _block(self, points: FloatArray) -> FloatArray:
        with np.errstate(over="ignore"):  # z^2 beyond the largest float: P(equal) is 0 to all digits, log P is -inf
            return np.asarray(self.pair_log_likelihood(points).sum(axis=1))

    def derivatives(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Gradient (points, 4) and Hessian (points, 4, 4) of the log posterior density, analytic."""
        points = require_points(x, len(UNCONSTRAINED))
        gradient, hessian = self.prior.derivatives(points, self.sbar)
        likelihood = self.likelihood_derivatives(points)
        return gradient + likelihood[0], hessian + likelihood[1]

    def likelihood_derivatives(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gradient (points, 4) and Hessian (points, 4, 4) of the log likelihood alone.

        With t = ln2 z^2, the odds r = q/(1 - q) and d = 1 - q0, one 'different' answer A = log(1 - q) has A_i = 2 ln2 r z z_i and
        A_ij = 2 ln2 r [(2 F - 1) z_i z_j + z z_ij] in (c, a, b), A_l = -r d, A_il = 2 ln2 z z_i r (1 + r) d and
        A_ll = -r d ((1 + r) d - q0). F = 1 - (1 + r) t = [d 2^-z^2 - (t - 1 + 2^-z^2)] / (1 - q) and the last bracket,
        [d^2 - q0^2 (1 - 2^-z^2)] / (1 - q), are formed from their numerators: the differences would lose all digits.
        """
        z, logit_q0 = self.distance(x), x[:, 3, None]
        q0, lapse = expit(x[:, 3]), expit(-x[:, 3])
        log_diff = log_different(z, logit_q0)
        fall = np.expm1(-LN2 * np.square(z))
        odds = self._different * np.exp(log_expit(logit_q0) - LN2 * np.square(z) - log_diff)
        share = np.exp(log_expit(-logit_q0) - log_diff)  # (1 - q0) / (1 - q) = (1 + r) d
        bend = (lapse[:, None] * (1.0 + fall) - _second_rest(LN2 * np.square(z))) * np.exp(-log_diff)
        gap = share * lapse[:, None] + np.square(q0)[:, None] * fall * np.exp(-log_diff)
        z1, z_aa = self._distance_derivatives(x, z)
        gradient, hessian = np.empty(x.shape), np.empty((*x.shape, 4))
        gradient[:, :3] = 2.0 * LN2 * np.einsum("nj,nji->ni", (odds - self._equal) * z, z1)
        hessian[:, :3, :3] = 2.0 * LN2 * self._curvature(z, z1, z_aa, odds, bend)
        hessian[:, :3, 3] = hessian[:, 3, :3] = 2.0 * LN2 * np.einsum("nj,nji->ni", odds * share * z, z1)
        lost = odds * lapse[:, None]
        gradient[:, 3] = self._equal.sum() * lapse - lost.sum(axis=1)
        hessian[:, 3, 3] = -self._equal.sum() * q0 * lapse - (lost * gap).sum(axis=1)
        return gradient, hessian

    def _curvature(self, z: FloatArray, z1: FloatArray, z_aa: FloatArray, odds: FloatArray, bend: FloatArray) -> FloatArray:
        """Sum over pairs of what 2 ln2 multiplies in the Hessian of (c, a, b), (points, 3, 3).

        z_b = -z and z_ib = -z_i, so rows of b reduce to -2 F z z_i and 2 F z^2 (with -1 in the place of r F for 'equal' answers).
        """
        result = np.empty((len(z), 3, 3))
        inner = odds * (2.0 * bend - 1.0) - self._equal
        result[:, :2, :2] = np.einsum("nj,nji,njk->nik", inner, z1[..., :2], z1[..., :2])
        result[:, 1, 1] += ((odds - self._equal) * z * z_aa).sum(axis=1)
        outer = 2.0 * (odds * bend - self._equal) * z
        result[:, :2, 2] = result[:, 2, :2] = -np.einsum("nj,nji->ni", outer, z1[..., :2])
        result[:, 2, 2] = (outer * z).sum(axis=1)
        return result

    def _distance_derivatives(self, x: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """First derivatives of z in (c, a, b), (points, pairs, 3), and its second in a, (points, pairs)."""
        _, p1, p2 = pull_derivatives(x[:, 1, None])
        inverse = np.exp(-x[:, 2, None]) * np.ones_like(z)
        return np.stack([-inverse, p1 * self._lever * inverse, -z], -1), p2 * self._lever * inverse


def starts(subject: Subject) -> FloatArray:
    """Starting points (18, 4): offsets, pulls and widths on the scale of the stimuli, q0 from the most 'equal' pair."""
    steps = np.abs(subject.s2 - subject.s1)
    scale = float(np.sqrt(np.mean(steps[steps > 0] ** 2))) if np.any(steps > 0) else 0.3
    top = float(((subject.n_equal + 1.0) / (subject.n_trials + 2.0)).max())
    grid = np.meshgrid([-scale, 0.0, scale], [-2.0, 2.0], np.log(scale) + np.array([-1.0, 0.0, 1.0]), [logit(top)])
    return np.stack([axis.ravel() for axis in grid], axis=-1)


def _second_rest(t: FloatArray) -> FloatArray:
    """e^-t - 1 + t without cancellation, t >= 0; its series is t^2/2 M(1, 3, -t), M Kummer's function."""
    small = np.minimum(t, 1.0)
    return np.where(t < 1.0, 0.5 * np.square(small) * hyp1f1(1.0, 3.0, -small), np.expm1(-t) + t)
