"""The posterior in the paper's natural coordinates, vectorised, as a user of an ensemble sampler would write it."""

from __future__ import annotations

import numpy as np
from scipy.special import logit

from bayes_toe.arrays import FloatArray
from bayes_toe.model.closed_form import LN2, log_different, pull, width
from bayes_toe.model.coordinates import Natural
from bayes_toe.model.posterior import Posterior


class NaturalTarget:
    """Log densities of one subject at (mu1, sigma_p, sigma_l, q0); `evaluations` counts the points of the likelihood."""

    def __init__(self, posterior: Posterior) -> None:
        subject = posterior.subject
        self._prior = posterior.prior
        self._s1, self._s2 = subject.s1, subject.s2
        self._equal, self._different = subject.n_equal.astype(float), (subject.n_trials - subject.n_equal).astype(float)
        self.evaluations = 0

    def log_density(self, theta: FloatArray) -> FloatArray:
        """With respect to (mu1, sigma_p, sigma_l, q0), (points, 4) -> (points,); -inf outside the support."""
        mu1, sigma_p, sigma_l, q0 = theta.T
        inside = (sigma_p > 0) & (sigma_l > 0) & (sigma_l < sigma_p) & (q0 > 0) & (q0 < 1)
        result = np.full(len(theta), -np.inf)
        some = Natural(mu1[inside], sigma_p[inside], sigma_l[inside], q0[inside])
        # gamma = sigma_l^2 / sigma_p^2 is uniform, so sigma_l has the density 2 sigma_l / sigma_p^2.
        of_noise = np.log(2.0 * some.sigma_l) - 2.0 * np.log(some.sigma_p)
        result[inside] = self._prior.log_density(some) + of_noise + self.log_likelihood(some.mu1, some.sigma_p, some.gamma, some.q0)
        return result

    def log_likelihood(self, mu1: FloatArray, sigma_p: FloatArray, gamma: FloatArray, q0: FloatArray) -> FloatArray:
        """Without binomial coefficients; parameters (points,) -> (points,)."""
        self.evaluations += len(mu1)
        shift = pull(gamma)[:, None] * (self._s1 - mu1[:, None])
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # q0 at 0 or 1 to all digits, widths near 0
            z = (self._s2 - self._s1 + shift) / width(sigma_p, gamma)[:, None]
            log_equal = np.log(q0)[:, None] - LN2 * z**2
            log_other = log_different(z, logit(q0)[:, None])
            terms = np.where(self._equal > 0, self._equal * log_equal, 0.0) + np.where(
                self._different > 0, self._different * log_other, 0.0
            )
        return np.asarray(terms.sum(axis=1))
