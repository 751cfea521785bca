"""The prior of a group as arrays: densities and slopes for the sampler.

:mod:`bayes_toe.model.prior` has the numbers.
"""

from __future__ import annotations

from dataclasses import astuple
from typing import NamedTuple

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.model.densities import (
    StandardStudent,
    from_half_normal_score,
    log_normal,
)
from bayes_toe.model.prior import ParameterHyperprior


class HyperpriorNumbers(NamedTuple):
    """The numbers of several coefficients, shape (coefficients,) each."""

    mean: FloatArray
    mean_scale: FloatArray
    sd_scale: FloatArray
    has_heavy_tails: BoolArray

    @classmethod
    def from_rows(cls, rows: list[ParameterHyperprior]) -> HyperpriorNumbers:
        """The numbers of some rows, as arrays."""
        mean, mean_scale, sd_scale, tails = np.array([astuple(row) for row in rows]).T
        return cls(mean, mean_scale, sd_scale, tails.astype(np.bool_))

    def log_prior_of_mean(self, mean: FloatArray) -> FloatArray:
        """Log prior density of each mean, (..., coefficients)."""
        return self._log_density((mean - self.mean) / self.mean_scale) - np.log(self.mean_scale)

    def slope_of_mean_prior(self, mean: FloatArray) -> FloatArray:
        """Its derivative."""
        return self._slope((mean - self.mean) / self.mean_scale) / self.mean_scale

    def sds(self, score: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Standard deviations between subjects from their scores, (..., coefficients) each.

        Their derivatives in the scores follow. Then come the log prior density of each score,
        without a constant, and its derivative.

        The score is the standard normal quantile of the probability that a half-normal variable
        is smaller. Where the data do not show that subjects differ, the posterior of a score has
        a normal tail; that of a log SD has a long one.
        """
        u = from_half_normal_score(score)
        rise = 0.5 * np.exp(0.5 * (np.square(u) - np.square(score)))
        log_prior = log_normal(score) + self._log_density(u) - log_normal(u)
        slope = (self._slope(u) + u) * rise - score
        return self.sd_scale * u, self.sd_scale * rise, log_prior, slope

    def log_effect(self, effect: FloatArray) -> FloatArray:
        """Log prior density of a covariate's effects: Normal(0, sd_scale)."""
        return log_normal(effect / self.sd_scale) - np.log(self.sd_scale)

    def effect_slope(self, effect: FloatArray) -> FloatArray:
        """Its derivative."""
        return -effect / np.square(self.sd_scale)

    def _log_density(self, u: FloatArray) -> FloatArray:
        return np.where(self.has_heavy_tails, StandardStudent().log_density(u), log_normal(u))

    def _slope(self, u: FloatArray) -> FloatArray:
        return np.where(self.has_heavy_tails, StandardStudent().slope(u), -u)
