"""Models that are compared: their probabilities, Bayes factors and averaged draws.

A choice of models is an array of bool, one for each model: those that have an effect, for example.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import logsumexp, softmax

from bayes_toe.arrays import BoolArray, FloatArray, Rng
from bayes_toe.inference.mixture import WeightedDraws


def probability_of(
    log_evidence: FloatArray, prior_probabilities: FloatArray, is_chosen: BoolArray
) -> float:
    """Posterior probability of some models, shape (models,) each.

    Examples
    --------
    >>> has_effect = np.array([False, True, True])
    >>> round(probability_of(np.zeros(3), np.array([0.5, 0.25, 0.25]), has_effect), 3)
    0.5
    """
    log_joint = log_evidence + np.log(prior_probabilities)
    return float(np.exp(logsumexp(log_joint[is_chosen]) - logsumexp(log_joint)))


def log_bayes_factor(log_evidence: FloatArray, has_effect: BoolArray) -> float:
    """Log of the mean evidence of the models with an effect over that of the others.

    It does not depend on the prior probabilities of the two groups of models.
    """
    log_mean_with = logsumexp(log_evidence[has_effect]) - np.log(has_effect.sum())
    log_mean_without = logsumexp(log_evidence[~has_effect]) - np.log((~has_effect).sum())
    return float(log_mean_with - log_mean_without)


def weighted_quantiles(
    values: FloatArray, weights: FloatArray, probabilities: Sequence[float]
) -> list[float]:
    """Quantiles of weighted values, (draws,) each, with the weight of a draw about its place.

    Examples
    --------
    >>> np.round(weighted_quantiles(np.arange(5.0), np.full(5, 0.2), [0.5]), 9).tolist()
    [2.0]
    """
    order = np.argsort(values, kind="stable")
    ordered = weights[order]
    middle = np.cumsum(ordered) - 0.5 * ordered
    return np.interp(probabilities, middle, values[order]).tolist()


@dataclass(frozen=True, eq=False)
class AveragedDraws:
    """Draws of several models, shape (draws, k), with normalised weights, shape (draws,)."""

    x: FloatArray
    weights: FloatArray

    def resampled(self, rng: Rng, size: int) -> FloatArray:
        """Points drawn by their weights, shape (size, k)."""
        return self.x[rng.choice(len(self.weights), size, p=self.weights)]


@dataclass(frozen=True, eq=False)
class ModelSet:
    """Models of the same answers, by their weighted draws in common coordinates.

    Attributes
    ----------
    draws : tuple of WeightedDraws
        One of each model.
    prior_probabilities : ndarray, shape (models,)
    """

    draws: tuple[WeightedDraws, ...]
    prior_probabilities: FloatArray

    @cached_property
    def log_evidence(self) -> FloatArray:
        """Log evidences, nats, without binomial coefficients, shape (models,)."""
        return np.array([draws.log_evidence for draws in self.draws])

    @cached_property
    def standard_error(self) -> FloatArray:
        """Their standard errors, shape (models,)."""
        return np.array([draws.standard_error for draws in self.draws])

    @cached_property
    def effective_draws(self) -> FloatArray:
        """The effective number of each model's draws, shape (models,)."""
        return np.array([draws.effective_number for draws in self.draws])

    @property
    def log_joint(self) -> FloatArray:
        """Log evidence plus log prior probability, shape (models,)."""
        return self.log_evidence + np.log(self.prior_probabilities)

    @property
    def probabilities(self) -> FloatArray:
        """Posterior probabilities of the models, shape (models,)."""
        return np.asarray(softmax(self.log_joint))

    def log_bayes_factor(self, has_effect: BoolArray) -> tuple[float, float]:
        """:func:`log_bayes_factor` of these models, and its standard error."""
        variance = 0.0
        for side in (has_effect, ~has_effect):
            shares = softmax(self.log_evidence[side])
            variance += float(np.square(shares * self.standard_error[side]).sum())
        return log_bayes_factor(self.log_evidence, has_effect), variance**0.5

    def averaged(self, is_chosen: BoolArray) -> AveragedDraws:
        """Draws of some models.

        A draw weighs as much as its model's posterior probability times its importance weight.
        """
        points, weights = [], []
        probabilities = softmax(self.log_joint[is_chosen])
        for i, probability in zip(np.flatnonzero(is_chosen), probabilities, strict=True):
            points.append(self.draws[i].x)
            weights.append(probability * self.draws[i].shares)
        return AveragedDraws(np.concatenate(points), np.concatenate(weights))
