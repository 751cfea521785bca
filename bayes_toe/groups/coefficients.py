"""Means and effects in units of what is known of them once the scatter is given.

Where the scatter is small, members are all but one, and their answers together tell the mean far better than where it is large. With
precisions h_i and places e_i of the members' parameters by their answers, roughly normal, the mean given tau is normal with precision and
mean

    P = 1/s^2 + sum_i w_i,    (m_0/s^2 + sum_i w_i e_i)/P,    w_i = 1/(tau^2 + 1/h_i),

and an effect has the precision 1/s^2 + sum_i w_i x_i^2. In these units coordinates are standard normal, whatever the scatter, about.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.groups.hyperprior import HyperpriorNumbers
from bayes_toe.groups.shared import with_ones
from bayes_toe.groups.told import Told


class Units(NamedTuple):
    """Centre and unit of mean and effects, (points, 1 + r, k), with its log, and what the log of the scatter does to centre and log."""

    centre: FloatArray
    log_unit: FloatArray
    unit: FloatArray
    centre_slope: FloatArray
    log_unit_slope: FloatArray


@dataclass(frozen=True, eq=False)
class CoefficientUnits:
    """Of members with regressors x, (N, r), of which so much is told.

    Parameters
    ----------
    told : Told
        Without a funnel.
    x : array, shape (N, r)
    hyperprior : HyperpriorNumbers
    """

    told: Told
    x: FloatArray
    hyperprior: HyperpriorNumbers

    @cached_property
    def _given(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Squares of 1 and the regressors, (1 + r, N), precision of the hyperprior, (1 + r, k), and its pull on the centre, (k,)."""
        sd = np.stack([self.hyperprior.mean_sd, *[self.hyperprior.effect_sd] * self.x.shape[1]])
        return np.square(with_ones(self.x)).T, sd**-2.0, self.hyperprior.mean / np.square(self.hyperprior.mean_sd)

    def at(self, log_scatter: FloatArray) -> Units:
        """At logs of scatters, (points, k)."""
        squares, of_prior, pulled = self._given
        log_ratio = self.told.log_precision + 2.0 * log_scatter[:, None]
        log_share = -np.logaddexp(0.0, log_ratio)
        weight = np.exp(self.told.log_precision + log_share)
        slope = -2.0 * weight * np.exp(log_ratio + log_share)
        precision = of_prior + squares @ weight
        log_unit_slope = -0.5 * (squares @ slope) / precision
        centre, centre_slope = np.zeros(precision.shape), np.zeros(precision.shape)
        centre[:, 0] = (pulled + (weight * self.told.place).sum(axis=1)) / precision[:, 0]
        # The slope of sum w e less that of P times the centre: about the centre, so that places far from 0 do not cancel.
        apart = self.told.place - centre[:, :1]
        centre_slope[:, 0] = (slope * apart).sum(axis=1) / precision[:, 0]
        log_unit = -0.5 * np.log(precision)
        return Units(centre, log_unit, np.exp(log_unit), centre_slope, log_unit_slope)
