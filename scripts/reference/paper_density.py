"""The posterior of H1 in the coordinates of the quadrature, written from the definitions.

    x = (c, a, b, l),   p = p_max / (1 + e^-a),   w = e^b,   q0 = 1 / (1 + e^-l)
    mu1 = sbar + c/p,   gamma = p/(1 - p)^2,      sigma_p = w (1 - p)^(3/2)

The prior of the natural parameters is multiplied by the Jacobian, a product because mu1 alone
depends on c, sigma_p or w alone on b, and gamma on a only:

    d mu1/dc = 1/p,   d gamma/da = p (1 - p/p_max) (1 + p)/(1 - p)^3,   d q0/dl = q0 (1 - q0)
"""

from __future__ import annotations

import numpy as np
from scipy.special import betaln, log_expit, xlog1py

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.model.paper_equations import MAX_PULL, Natural
from bayes_toe.model.prior import Prior

_LN2, _LOG_2PI = float(np.log(2.0)), float(np.log(2.0 * np.pi))


class PaperDensity:
    """Log posterior of a subject of same or different, and the natural parameters, at points x."""

    def __init__(self, subject: Subject, prior: Prior) -> None:
        self.subject, self.prior = subject, prior.for_subjects(subject)
        self.sbar = float(np.average(subject.s1, weights=subject.n_trials))

    def natural(self, x: FloatArray) -> Natural:
        """Natural parameters, (points, 4) -> (points,) each."""
        return natural(x, self.sbar)

    def log_density(self, x: FloatArray) -> FloatArray:
        """Log posterior density, (points, 4) -> (points,)."""
        return self._log_likelihood(x) + self._log_prior(x)

    def _log_likelihood(self, x: FloatArray) -> FloatArray:
        subject, log_share, log_rest = self.subject, log_expit(x[:, 3:]), log_expit(-x[:, 3:])
        pull = MAX_PULL / (1.0 + np.exp(-x[:, 1:2]))
        shifted = (subject.s2 - subject.s1) + pull * (subject.s1 - self.sbar) - x[:, :1]
        with np.errstate(over="ignore", divide="ignore"):
            log_bell = -_LN2 * np.square(shifted * np.exp(-x[:, 2:3]))
            log_off = log_share + np.log(-np.expm1(log_bell))
        log_equal, log_different = log_share + log_bell, np.logaddexp(log_rest, log_off)
        n_different = subject.n_trials - subject.n_yes
        equal = np.where(subject.n_yes > 0, subject.n_yes * log_equal, 0.0)
        different = np.where(n_different > 0, n_different * log_different, 0.0)
        return np.asarray((equal + different).sum(axis=1))

    def _log_prior(self, x: FloatArray) -> FloatArray:
        prior, theta = self.prior, self.natural(x)
        log_pull = np.log(MAX_PULL) + log_expit(x[:, 1])
        pull = np.exp(log_pull)
        mean, sd = prior.mu1_normal
        mu1 = -0.5 * (np.square((theta.mu1 - mean) / sd) + _LOG_2PI) - np.log(sd) - log_pull

        scale = prior.spread_scale
        if prior.width_median is None:
            relative = theta.sigma_p / scale
            spread = 0.5 * np.log(2.0 / np.pi) - 0.5 * np.square(relative) + np.log(relative)
        else:
            score = (x[:, 2] - np.log(scale)) / prior.width_sd
            spread = -0.5 * (np.square(score) + _LOG_2PI) - np.log(prior.width_sd)

        log_gamma = log_pull - 2.0 * np.log1p(-pull)
        gamma = (prior.gamma_a - 1.0) * log_gamma
        gamma += xlog1py(prior.gamma_b - 1.0, -np.exp(log_gamma))
        gamma -= betaln(prior.gamma_a, prior.gamma_b)
        gamma += log_pull + log_expit(-x[:, 1]) + np.log1p(pull) - 3.0 * np.log1p(-pull)

        share = prior.q0_a * log_expit(x[:, 3]) + prior.q0_b * log_expit(-x[:, 3])
        share -= betaln(prior.q0_a, prior.q0_b)
        return np.asarray(mu1 + spread + gamma + share)


def natural(x: FloatArray, sbar: float) -> Natural:
    """The paper's parameters at x, shape (..., 4)."""
    c, a, log_width, top = np.moveaxis(np.asarray(x, np.float64), -1, 0)
    p = MAX_PULL / (1.0 + np.exp(-a))
    sigma_p = np.exp(log_width) * (1.0 - p) ** 1.5
    with np.errstate(over="ignore", invalid="ignore"):
        mu1 = sbar + np.where(c == 0.0, 0.0, c * (1.0 + np.exp(-a)) / MAX_PULL)
    return Natural(mu1, sigma_p, sigma_p * np.sqrt(p) / (1.0 - p), 1.0 / (1.0 + np.exp(-top)))
