"""What members of a group have in common: mean, scatter and effects of every parameter, and their density under the hyperprior."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.groups.hyperprior import HyperpriorNumbers
from bayes_toe.model.distributions import LOG_2PI


class Shared(NamedTuple):
    """Mean (..., k), log of the scatter (..., k), effects (..., r, k): everything that members have in common."""

    mean: FloatArray
    log_scatter: FloatArray
    effects: FloatArray

    def expected(self, x: FloatArray) -> FloatArray:
        """The mean of members with these regressors, (N, r) -> (..., N, k)."""
        return np.asarray(self.mean[..., None, :] + x @ self.effects)


def split_shared(theta: FloatArray, k: int) -> Shared:
    """From coordinates, (points, k (2 + r)): means, log scatters, then effects by regressor."""
    return Shared(theta[:, :k], theta[:, k : 2 * k], theta[:, 2 * k :].reshape(len(theta), -1, k))


def log_hyperprior(shared: Shared, given: HyperpriorNumbers) -> tuple[FloatArray, FloatArray]:
    """Log density with respect to (m, log tau, beta), (points,), and its gradient, (points, k (2 + r))."""
    of_mean, points = (shared.mean - given.mean) / given.mean_sd, len(shared.mean)
    of_scatter, of_effects = np.exp(shared.log_scatter) / given.sd_scale, shared.effects / given.effect_sd
    constant = (np.log(given.mean_sd) + 0.5 * LOG_2PI + np.log(given.sd_scale) + 0.5 * np.log(np.pi / 2.0)).sum()
    constant += shared.effects.shape[1] * (np.log(given.effect_sd) + 0.5 * LOG_2PI).sum()
    squares = np.square(of_mean).sum(axis=1) + np.square(of_scatter).sum(axis=1) + np.square(of_effects).sum(axis=(1, 2))
    slopes = (-of_mean / given.mean_sd, 1.0 - np.square(of_scatter), (-of_effects / given.effect_sd).reshape(points, -1))
    return np.asarray(-0.5 * squares + shared.log_scatter.sum(axis=1) - constant), np.concatenate(slopes, axis=1)
