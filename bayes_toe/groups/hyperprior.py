"""The prior of a group as arrays: densities and slopes for the sampler.

:mod:`bayes_toe.model.prior` has the numbers.
"""

from __future__ import annotations

from dataclasses import astuple
from typing import NamedTuple

import numpy as np

from bayes_toe.arrays import ArrayPair, BoolArray, FloatArray
from bayes_toe.model.densities import (
    StandardStudent,
    from_half_normal_score,
    log_normal_density,
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
        # The columns of a table with a row for each coefficient, in which True is 1.
        mean, mean_scale, sd_scale, has_heavy_tails = np.array([astuple(row) for row in rows]).T
        return cls(mean, mean_scale, sd_scale, has_heavy_tails.astype(np.bool_))

    def prior_of_mean(self, mean: FloatArray) -> ArrayPair:
        """Log prior density of each mean, (..., coefficients), and its derivative."""
        log_density, slope = self._density((mean - self.mean) / self.mean_scale)
        return log_density - np.log(self.mean_scale), slope / self.mean_scale

    def sds(self, score: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Standard deviations between subjects from their scores, shape (..., coefficients).

        Returns four arrays of this shape: the standard deviations, their derivatives in the scores,
        the log prior density of each score without a constant, and its derivative.

        A standard deviation is sd_scale times u, which is half-normal or half Student's t.

        The score is the standard normal quantile of the probability that a half-normal variable
        is smaller. Where the data do not show that subjects differ, the posterior of a score has
        a normal tail; the posterior of a log SD has a long tail.
        """
        u = from_half_normal_score(score)
        # From 2 Phi(u) - 1 = Phi(score): du/dscore = phi(score) / (2 phi(u)). The density of the
        # score is that of u times this derivative.
        rise = 0.5 * np.exp(0.5 * (np.square(u) - np.square(score)))
        log_density, slope_in_u = self._density(u)
        log_prior = log_normal_density(score) + log_density - log_normal_density(u)
        slope = (slope_in_u + u) * rise - score  # of `log_prior`, by the chain rule
        return self.sd_scale * u, self.sd_scale * rise, log_prior, slope

    def prior_of_effect(self, effect: FloatArray) -> ArrayPair:
        """Log prior density of a covariate's effects, Normal(0, sd_scale), and its derivative."""
        log_density = log_normal_density(effect / self.sd_scale) - np.log(self.sd_scale)
        return log_density, -effect / np.square(self.sd_scale)

    def _density(self, u: FloatArray) -> ArrayPair:
        """Log density of Student's t or the normal, whichever a coefficient has, and its slope."""
        student = StandardStudent()
        log_density = np.where(self.has_heavy_tails, student.log_density(u), log_normal_density(u))
        return log_density, np.where(self.has_heavy_tails, student.slope(u), -u)
