"""Models that are compared: probabilities, Bayes factors and averages.

A choice of models is an array of bool, one for each model: those that have an effect, for example.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress
from typing import Any, Self

import numpy as np
from scipy.special import expit, softmax

from bayes_toe.arrays import BoolArray, FloatArray, Rng
from bayes_toe.inference.mixture import WeightedDraws


@dataclass(frozen=True, eq=False)
class ModelSet:
    """Models of the same responses.

    Attributes
    ----------
    log_evidence : ndarray, shape (models,)
        Nats, without binomial coefficients.
    prior_probabilities : ndarray, shape (models,)
    draws : tuple of WeightedDraws
        The draws of each model; empty if only the evidences are known.

    Examples
    --------
    >>> models = ModelSet(np.zeros(3), np.array([0.5, 0.25, 0.25]))
    >>> has_effect = np.array([False, True, True])
    >>> models.probability(has_effect), models.log_bayes_factor(has_effect)
    (0.5, 0.0)
    """

    log_evidence: FloatArray
    prior_probabilities: FloatArray
    draws: tuple[WeightedDraws, ...] = ()

    @classmethod
    def from_draws(
        cls, draws: Sequence[WeightedDraws], prior_probabilities: FloatArray, **attributes: Any
    ) -> Self:
        """Models by their weighted draws, with the further attributes of a subclass."""
        log_evidence = np.array([model_draws.log_evidence for model_draws in draws])
        return cls(log_evidence, prior_probabilities, tuple(draws), **attributes)

    @property
    def standard_error(self) -> FloatArray:
        """Standard errors of the log evidences, shape (models,)."""
        return np.array([draws.standard_error for draws in self.draws])

    @property
    def probabilities(self) -> FloatArray:
        """Posterior probabilities of the models, shape (models,)."""
        return np.asarray(softmax(self._log_joint))

    @property
    def log_mean_evidence(self) -> float:
        """Log of the mean evidence by the prior probabilities."""
        return _log_sum(self._log_joint)

    @property
    def _log_joint(self) -> FloatArray:
        """Log of the prior probability times the evidence, shape (models,)."""
        return self.log_evidence + np.log(self.prior_probabilities)

    def probability(self, is_chosen: BoolArray) -> float:
        """Posterior probability of some models together."""
        return float(expit(self.log_odds(is_chosen)))

    def log_odds(self, is_chosen: BoolArray) -> float:
        """Log of the posterior odds of some models against the other models."""
        log_joint = self._log_joint
        return _log_sum(log_joint[is_chosen]) - _log_sum(log_joint[~is_chosen])

    def log_bayes_factor(self, has_effect: BoolArray) -> float:
        """Log of the mean evidence of the models with an effect over that of the other models.

        It does not depend on the prior probabilities of the two groups of models.
        """
        lacks_effect = ~has_effect
        log_mean_with = _log_sum(self.log_evidence[has_effect]) - np.log(has_effect.sum())
        log_mean_without = _log_sum(self.log_evidence[lacks_effect]) - np.log(lacks_effect.sum())
        return float(log_mean_with - log_mean_without)

    def bayes_factor_error(self, has_effect: BoolArray) -> float:
        """The standard error of :meth:`log_bayes_factor`.

        The variance of a log mean is a sum over its terms of (share in the mean * error)^2.
        """
        variance = 0.0
        for is_chosen in (has_effect, ~has_effect):
            shares = softmax(self.log_evidence[is_chosen])
            variance += float(np.square(shares * self.standard_error[is_chosen]).sum())
        return variance**0.5

    def weights(self, is_chosen: BoolArray) -> FloatArray:
        """Normalised weights of the draws of some models, one model after the other.

        A draw weighs as much as its model's posterior probability times its importance weight.
        """
        weights = []
        probabilities = softmax(self._log_joint[is_chosen])  # among the chosen models
        for draws, probability in zip(compress(self.draws, is_chosen), probabilities, strict=True):
            weights.append(probability * draws.shares)
        return np.concatenate(weights)

    def averaged(self, is_chosen: BoolArray) -> AveragedDraws:
        """Draws of some models that have common coordinates."""
        points = np.concatenate([draws.x for draws in compress(self.draws, is_chosen)])
        return AveragedDraws(points, self.weights(is_chosen))


@dataclass(frozen=True, eq=False)
class AveragedDraws:
    """Draws of several models, shape (draws, k), with normalised weights, shape (draws,)."""

    x: FloatArray
    weights: FloatArray

    def resampled(self, rng: Rng, size: int) -> FloatArray:
        """Points drawn by their weights, shape (size, k)."""
        return self.x[rng.choice(len(self.weights), size, p=self.weights)]

    def quantiles(self, values: FloatArray, probabilities: Sequence[float]) -> list[float]:
        """:func:`weighted_quantiles` of values at the draws."""
        return weighted_quantiles(values, self.weights, probabilities)


def weighted_quantiles(
    values: FloatArray, weights: FloatArray, probabilities: Sequence[float]
) -> list[float]:
    """Quantiles of values with weights that sum to 1, (draws,) each.

    Half of the weight of a value counts as below it. Between values the quantiles are linear.

    Examples
    --------
    >>> np.round(weighted_quantiles(np.arange(5.0), np.full(5, 0.2), [0.5]), 9).tolist()
    [2.0]
    """
    order = np.argsort(values, kind="stable")
    ordered_weights = weights[order]
    weight_below = np.cumsum(ordered_weights) - 0.5 * ordered_weights
    return np.interp(probabilities, weight_below, values[order]).tolist()


def _log_sum(values: FloatArray) -> float:
    """Log of the sum of exp(values)."""
    return float(np.logaddexp.reduce(values))
