"""The posterior of H1, written from the definitions.

    x = (c, a, b, l),   p = p_max / (1 + e^-a),   w = e^b,   q0 = 1 / (1 + e^-l)
    mu1 = sbar + c/p,   gamma = p/(1 - p)^2,      sigma_p = w (1 - p)^(3/2)

The prior of the natural parameters is multiplied by the Jacobian, a product because mu1 alone
depends on c, sigma_p or w alone on b, and gamma on a only:

    d mu1/dc = 1/p,   d gamma/da = p (1 - p/p_max) (1 + p)/(1 - p)^3,   d q0/dl = q0 (1 - q0)

The coordinates are x, which are 'identified', or y = (mu1, log sigma_p, logit gamma, logit q0),
which are 'natural'. The prior is the paper's: mu1 is normal, sigma_p half-normal, gamma and q0 are
uniform. A namespace of array functions, such as `jax.numpy` or `pytensor.tensor`, may take the
place of NumPy, so that other programs sample this same density.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.special import erfinv, expit, log_ndtr, ndtr, ndtri

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.model.paper_equations import Natural

#: Standard deviation of mu1, whose mean is 0, and scale of sigma_p.
MU1_SD, SIGMA_P_SCALE = 10.0, 1.0
_LN2 = float(np.log(2.0))

#: Largest contraction towards the prior mean that gamma < 1 allows: 1 - 1/(golden ratio).
MAX_PULL = (3.0 - 5.0**0.5) / 2.0


class Counts(NamedTuple):
    """The counts of one subject, (pairs,) each, and the mean first stimulus."""

    first: Any
    difference: Any
    n_yes: Any
    n_no: Any
    sbar: Any

    @classmethod
    def of_subject(cls, subject: Subject) -> Counts:
        """The counts of a subject."""
        n_no = subject.n_trials - subject.n_yes
        sbar = float(np.average(subject.s1, weights=subject.n_trials))
        return cls(subject.s1, subject.s2 - subject.s1, subject.n_yes, n_no, sbar)


class PaperScores:
    """The log likelihood of a subject at normal scores of the paper's parameters.

    The scores of mu1, sigma_p, gamma and q0 are independent under the prior.
    """

    def __init__(self, subject: Subject) -> None:
        self.counts = Counts.of_subject(subject)

    def _coordinates(self, scores: FloatArray) -> FloatArray:
        """The coordinates x at scores, (points, 4) each."""
        mu1, spread, gamma, q0 = scores.T
        with np.errstate(divide="ignore"):
            from_below = np.log(np.sqrt(2.0) * erfinv(ndtr(spread)))
            from_above = np.log(-ndtri(0.5 * ndtr(-spread)))
        log_sigma_p = np.where(spread < 0.0, from_below, from_above)
        columns = [
            MU1_SD * mu1,
            np.log(SIGMA_P_SCALE) + log_sigma_p,
            log_ndtr(gamma) - log_ndtr(-gamma),
            log_ndtr(q0) - log_ndtr(-q0),
        ]
        return identified(np.column_stack(columns), self.counts.sbar)[0]

    def natural(self, scores: FloatArray) -> Natural:
        """Natural parameters, (points, 4) -> (points,) each."""
        with np.errstate(over="ignore"):
            return natural(self._coordinates(scores), self.counts.sbar)

    def __call__(self, scores: FloatArray) -> FloatArray:
        """Log likelihood without binomial coefficients, (points, 4) -> (points,)."""
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            return _log_likelihood(self._coordinates(scores), self.counts, np)


def identified(y: Any, sbar: Any, xp: Any = np) -> tuple[Any, Any]:
    """The coordinates x of points y, (..., 4) each, and log |dx/dy|, (...)."""
    log_gamma, log_rest = log_expit(y[..., 2], xp), log_expit(-y[..., 2], xp)
    gamma = xp.exp(log_gamma)
    log_p = _LN2 + log_gamma - xp.log(1.0 + 2.0 * gamma + xp.sqrt(1.0 + 4.0 * gamma))
    p = xp.exp(log_p)
    log_complement = xp.log1p(-p)
    # p_max - p without cancellation: 1 - gamma over (1 - p p_max) / ((1 - p_max)^2 (1 - p)^2)
    log_left = log_rest + 2.0 * (np.log1p(-MAX_PULL) + log_complement) - xp.log1p(-MAX_PULL * p)
    log_width = y[..., 1] - 1.5 * log_complement
    columns = [p * (y[..., 0] - sbar), log_p - log_left, log_width, y[..., 3]]
    # da/d(logit gamma) = p_max (1 - p) (1 - gamma) / ((p_max - p) (1 + p))
    log_slope = np.log(MAX_PULL) + log_complement + log_rest - log_left - xp.log1p(p)
    return xp.stack(columns, axis=-1), log_p + log_slope


def log_density(points: Any, counts: Counts, coordinates: str, xp: Any = np) -> Any:
    """Log posterior density without its constant, (points, 4) -> (points,)."""
    if coordinates == "natural":
        x, log_volume = identified(points, counts.sbar, xp)
        return log_density(x, counts, "identified", xp) + log_volume
    return _log_likelihood(points, counts, xp) + _log_prior(points, counts.sbar, xp)


def log_expit(x: Any, xp: Any = np) -> Any:
    """Log of 1 / (1 + e^-x)."""
    return -xp.logaddexp(0.0, -x)


def _log_likelihood(x: Any, counts: Counts, xp: Any) -> Any:
    log_share, log_rest = log_expit(x[:, 3:], xp), log_expit(-x[:, 3:], xp)
    pull = MAX_PULL / (1.0 + xp.exp(-x[:, 1:2]))
    shifted = counts.difference + pull * (counts.first - counts.sbar) - x[:, :1]
    log_bell = -_LN2 * (shifted * xp.exp(-x[:, 2:3])) ** 2
    log_off = log_share + xp.log(-xp.expm1(log_bell))
    log_equal, log_different = log_share + log_bell, xp.logaddexp(log_rest, log_off)
    equal = xp.where(counts.n_yes > 0, counts.n_yes * log_equal, 0.0)
    different = xp.where(counts.n_no > 0, counts.n_no * log_different, 0.0)
    return (equal + different).sum(axis=1)


def _log_prior(x: Any, sbar: Any, xp: Any) -> Any:
    log_pull = np.log(MAX_PULL) + log_expit(x[:, 1], xp)
    pull = xp.exp(log_pull)
    log_complement = xp.log1p(-pull)

    mu1 = -0.5 * ((sbar + x[:, 0] / pull) / MU1_SD) ** 2 - log_pull
    log_sigma_p = x[:, 2] + 1.5 * log_complement
    sigma_p = log_sigma_p - 0.5 * xp.exp(2.0 * log_sigma_p) / SIGMA_P_SCALE**2
    gamma = log_pull + log_expit(-x[:, 1], xp) + xp.log1p(pull) - 3.0 * log_complement
    q0 = log_expit(x[:, 3], xp) + log_expit(-x[:, 3], xp)
    return mu1 + sigma_p + gamma + q0


def natural(x: FloatArray, sbar: float) -> Natural:
    """The paper's parameters at x, shape (..., 4)."""
    c, a, log_width, top = np.moveaxis(x, -1, 0)
    p = MAX_PULL * expit(a)
    sigma_p = np.exp(log_width) * (1.0 - p) ** 1.5
    with np.errstate(divide="ignore", invalid="ignore"):
        mu1 = sbar + np.where(c == 0.0, 0.0, c / p)
    return Natural(mu1, sigma_p, sigma_p * np.sqrt(p) / (1.0 - p), expit(top))
