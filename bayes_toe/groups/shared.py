"""What members of a group have in common: mean, scatter and effects of every parameter, and their density under the hyperprior."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.groups.correlations import log_lkj
from bayes_toe.groups.hyperprior import HyperpriorNumbers
from bayes_toe.model.distributions import LOG_2PI


class Shared(NamedTuple):
    """Mean (..., k), log of the scatter (..., k), effects (..., r, k), coordinates of correlations (..., c): what members share.

    Without correlations c is 0; see :mod:`bayes_toe.groups.correlations`.
    """

    mean: FloatArray
    log_scatter: FloatArray
    effects: FloatArray
    z: FloatArray

    @classmethod
    def of(cls, coefficients: FloatArray, log_scatter: FloatArray, z: FloatArray) -> Shared:
        """From means and effects in one array, (..., 1 + r, k)."""
        return cls(coefficients[..., 0, :], log_scatter, coefficients[..., 1:, :], z)

    @property
    def coefficients(self) -> FloatArray:
        """Means, then effects, (..., 1 + r, k)."""
        return np.concatenate([self.mean[..., None, :], self.effects], axis=-2)

    def expected(self, x: FloatArray) -> FloatArray:
        """The mean of members with these regressors, (N, r) -> (..., N, k)."""
        return np.asarray(self.mean[..., None, :] + x @ self.effects)


def with_ones(x: FloatArray) -> FloatArray:
    """1, which the mean goes with, and the regressors, (N, r) -> (N, 1 + r)."""
    return np.column_stack([np.ones(len(x)), x])


def split_shared(theta: FloatArray, k: int, r: int) -> Shared:
    """From coordinates, (points, k (2 + r) + c): means, log scatters, effects by regressor, then those of correlations."""
    mean, log_scatter, effects, z = np.split(theta, (k, 2 * k, (2 + r) * k), axis=1)
    return Shared(mean, log_scatter, effects.reshape(len(theta), r, k), z)


def log_hyperprior(shared: Shared, given: HyperpriorNumbers) -> tuple[FloatArray, Shared]:
    """Log density with respect to (m, log tau, beta, z), (points,), and its slopes in each of them."""
    of_mean, of_effects = (shared.mean - given.mean) / given.mean_sd, shared.effects / given.effect_sd
    of_scatter = np.exp(shared.log_scatter) / given.sd_scale
    constant = (np.log(given.mean_sd) + 0.5 * LOG_2PI + np.log(given.sd_scale) + 0.5 * np.log(np.pi / 2.0)).sum()
    constant += shared.effects.shape[1] * (np.log(given.effect_sd) + 0.5 * LOG_2PI).sum()
    squares = np.square(of_mean).sum(axis=1) + np.square(of_scatter).sum(axis=1) + np.square(of_effects).sum(axis=(1, 2))
    of_correlations, of_z = log_lkj(shared.z, shared.mean.shape[1], given.lkj)
    slopes = Shared(-of_mean / given.mean_sd, 1.0 - np.square(of_scatter), -of_effects / given.effect_sd, of_z)
    return np.asarray(-0.5 * squares + shared.log_scatter.sum(axis=1) - constant + of_correlations), slopes
