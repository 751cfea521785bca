"""What each member's answers alone say of its parameters, about; exact nowhere, but good for coordinates and starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.groups.hyperprior import HyperpriorNumbers
from bayes_toe.model.parameters import GroupPull

_ROUNDS = 50


@dataclass(frozen=True, eq=False)
class Told:
    """Log precision and place of each member's parameters by its answers, shape (N, k); a precision of -inf where they say nothing.

    Of the prior mean mu1 answers tell p (mu1 - centre), with pull p: the less of it there is, the less they say of mu1. Where `funnel` is
    given, precision and place in the column of mu1 are those of this product.
    """

    log_precision: FloatArray
    place: FloatArray
    funnel: Funnel | None = None


@dataclass(frozen=True)
class Funnel:
    """Columns of the prior mean and of what the pull follows from, the centre, and how it follows."""

    mean: int
    pull: int
    centre: float
    pulled: Callable[[FloatArray], GroupPull]


def moments(told: Told, hyperprior: HyperpriorNumbers) -> tuple[FloatArray, FloatArray]:
    """Means and scatters of which the members may have been drawn: a few rounds of expectation and maximisation."""
    mean, scatter, n = hyperprior.mean, hyperprior.sd_scale, len(told.place)
    precision = np.exp(told.log_precision)
    for _ in range(_ROUNDS):
        share = 1.0 / (1.0 + precision * np.square(scatter))
        member, unit = told.place + share * (mean - told.place), np.square(scatter) * share
        inverse = np.square(scatter / hyperprior.mean_sd) / n
        mean = (member.mean(axis=0) + inverse * hyperprior.mean) / (1.0 + inverse)
        # Half a member as far away as the hyperprior has them, so that a scatter cannot vanish.
        scatter = np.sqrt(((np.square(member - mean) + unit).sum(axis=0) + 0.5 * np.square(hyperprior.sd_scale)) / (n + 0.5))
    return mean, scatter


def without_funnel(told: Told, hyperprior: HyperpriorNumbers) -> Told:
    """With what is told of mu1 itself, at the pull that each member seems to have."""
    if told.funnel is None:
        return told
    i, j, centre = told.funnel.mean, told.funnel.pull, told.funnel.centre
    mean, scatter = moments(told, hyperprior)
    share = 1.0 / (1.0 + np.exp(told.log_precision[:, j]) * scatter[j] ** 2)
    pull = told.funnel.pulled(told.place[:, j] + share * (mean[j] - told.place[:, j])).pull
    precision, place = told.log_precision.copy(), told.place.copy()
    precision[:, i] += 2.0 * np.log(pull)
    place[:, i] = centre + told.place[:, i] / pull
    return Told(precision, place)
