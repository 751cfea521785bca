"""Where chains of a group start, and on which scales: about the population that the members' answers suggest, roughly."""

from __future__ import annotations

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.groups.hyperprior import HyperpriorNumbers
from bayes_toe.groups.joint import Joint, Told

_ROUNDS = 50
_APART = 2.0  # how many times farther apart than the posterior would have them


def starts(joint: Joint, chains: int, rng: np.random.Generator) -> FloatArray:
    """Points, wider apart than the posterior has them, shape (chains, D)."""
    mean, scatter, scale = _suggested(joint)
    noise = rng.standard_normal((chains, len(scale)))
    centre = np.concatenate([mean, np.log(scatter), np.zeros(len(scale) - 2 * len(mean))])
    noise[:, : joint.size] *= _APART
    return np.asarray(centre + noise * scale)


def scales(joint: Joint) -> FloatArray:
    """About the standard deviation of every coordinate, shape (D,)."""
    return _suggested(joint)[2]


def _suggested(joint: Joint) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means and scatters, (k,) each, and scales of all coordinates, (D,)."""
    (n, k), regressors = joint.told.place.shape, joint.x.shape[1]
    mean, scatter = _moments(_without_funnel(joint.told, joint.hyperprior), joint.hyperprior)
    error = scatter / np.sqrt(n)
    return mean, scatter, np.concatenate([error, np.full(k, (2.0 * n) ** -0.5), *[error] * regressors, np.ones(n * k)])


def _moments(told: Told, hyperprior: HyperpriorNumbers) -> tuple[FloatArray, FloatArray]:
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


def _without_funnel(told: Told, hyperprior: HyperpriorNumbers) -> Told:
    """With what is told of mu1 itself, at the pull that each member seems to have."""
    if told.funnel is None:
        return told
    i, j, centre = told.funnel.mean, told.funnel.pull, told.funnel.centre
    mean, scatter = _moments(told, hyperprior)
    share = 1.0 / (1.0 + np.exp(told.log_precision[:, j]) * scatter[j] ** 2)
    pull = told.funnel.pulled(told.place[:, j] + share * (mean[j] - told.place[:, j])).pull
    precision, place = told.log_precision.copy(), told.place.copy()
    precision[:, i] += 2.0 * np.log(pull)
    place[:, i] = centre + told.place[:, i] / pull
    return Told(precision, place)
