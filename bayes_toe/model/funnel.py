"""Coordinates in which the posteriors of the paper's model (H1) have no funnel.

The answers determine the offset c = p (mu1 - sbar), so that mu1 is the more open the smaller the
pull p is. Given pull and width, the score of mu1 is about normal with

    s^-2 = 1 + kappa sd^2 p^2 / (w^2 + w_0^2),   mean = (1 - s^2) (sbar + c/p - m) / sd,

where m and sd are those of the prior of mu1, and the answers give c, kappa and w_0 at the highest
maximum. A curve that is much steeper than the steps of the stimuli tells c no better. The
coordinates y have (u_0 - mean)/s in the place of u_0, and the others as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from bayes_toe.arrays import ArrayPair, FloatArray, IndexArray
from bayes_toe.model.paper_rows import PaperRows
from bayes_toe.model.posterior_array import PosteriorArray


@dataclass(frozen=True, eq=False)
class Funnel:
    """The normal distribution of the score of mu1 given pull and width.

    Attributes
    ----------
    rows : PaperRows
    centre : ndarray, shape (posteriors, 1)
        The score at which mu1 is sbar.
    offset : ndarray, shape (posteriors, 1)
        c over the prior standard deviation of mu1.
    log_precision : ndarray, shape (posteriors, 1)
        Of kappa sd^2.
    log_least_width : ndarray, shape (posteriors, 1)
        Of w_0.
    follows_width : ndarray, shape (posteriors, 1)
        1, or 0 where the precision does not depend on the width: several maxima leave c open.
    """

    rows: PaperRows
    centre: FloatArray
    offset: FloatArray
    log_precision: FloatArray
    log_least_width: FloatArray
    follows_width: FloatArray

    def part(self, index: IndexArray) -> Funnel:
        """The funnels of some posteriors, in this order."""
        columns = [getattr(self, field.name)[index] for field in fields(self)[1:]]
        return Funnel(self.rows.part(index), *columns)

    def conditional(self, u: FloatArray) -> ArrayPair:
        """Mean and log standard deviation, (posteriors, points) each."""
        log_pull = self.rows.log_pull(u)
        log_square = np.logaddexp(2.0 * self.rows.log_width(u), 2.0 * self.log_least_width)
        # The precision that the answers give, and its share of the whole precision, 1 - s^2.
        log_information = self.log_precision + 2.0 * log_pull - self.follows_width * log_square
        log_sd = -0.5 * np.logaddexp(0.0, log_information)
        log_share = log_information + 2.0 * log_sd

        # c/p in logs, because p may be below the smallest float.
        mean = np.exp(log_share) * self.centre + np.exp(log_share - log_pull) * self.offset
        return mean, log_sd

    def forward(self, u: FloatArray) -> ArrayPair:
        """Coordinates y of u, (posteriors, points, 4), and log |dy/du|, (posteriors, points)."""
        mean, log_sd = self.conditional(u)
        y = self.rows.with_log_width(u)
        y[..., 0] = (u[..., 0] - mean) * np.exp(-log_sd)
        return y, self.rows.log_width_volume(u) - log_sd

    def inverse(self, y: FloatArray) -> ArrayPair:
        """Coordinates u of y, and log |dy/du| there."""
        u = self.rows.without_log_width(y)
        mean, log_sd = self.conditional(u)
        u[..., 0] = mean + y[..., 0] * np.exp(log_sd)
        return u, self.rows.log_width_volume(u) - log_sd


@dataclass(frozen=True, eq=False)
class FunnelArray(PosteriorArray):
    """Posteriors of H1 in the coordinates y of their funnels.

    Densities are with respect to y.
    """

    funnel: Funnel

    @classmethod
    def from_array(cls, array: PosteriorArray, funnel: Funnel) -> Self:
        """The posteriors of an array of H1."""
        return cls(array.likelihood, array.names, array.further_priors, array.is_free, funnel)

    def part(self, index: IndexArray) -> FunnelArray:
        """Some posteriors, in this order; one may come more than once."""
        return self.from_array(super().part(index), self.funnel.part(index))

    def prior_points(self, probability: FloatArray) -> FloatArray:
        """Points of the prior by the quantiles of its coordinates, (posteriors, points, 4)."""
        return self.funnel.forward(super().prior_points(probability))[0]

    def densities(self, y: FloatArray) -> ArrayPair:
        """Log prior and log posterior density, (posteriors, points)."""
        u, log_volume = self.funnel.inverse(y)
        log_prior, log_posterior = super().densities(u)
        return log_prior - log_volume, log_posterior - log_volume

    def original(self, y: FloatArray) -> ArrayPair:
        """Points u of the posteriors, and log |dy/du| there."""
        return self.funnel.inverse(y)
