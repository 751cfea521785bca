"""Averages over the four models of the observer: weighted draws, their quantiles, curves.

`averaged_draws` has the draws of all four models with weights.

A draw weighs as much as its model's posterior probability times its importance weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from bayes_toe.arrays import BoolArray, FloatArray, Rng
from bayes_toe.inference.order_evidence import MODEL_NAMES, OrderEvidence
from bayes_toe.model.models import ObserverPosterior, OrderModel
from bayes_toe.model.parameters import CONSTANT_ERROR, CONTRACTION, MODEL_PRIOR, ORDER_MODELS

#: Prior probabilities of the four models, in the order of their evidences.
PRIOR_PROBABILITIES = np.array([MODEL_PRIOR[name] for name in MODEL_NAMES])
#: Which of the four models have each effect.
HAS_ERROR = np.array([CONSTANT_ERROR in ORDER_MODELS[name] for name in MODEL_NAMES])
HAS_CONTRACTION = np.array([CONTRACTION in ORDER_MODELS[name] for name in MODEL_NAMES])
HAS_EFFECT = HAS_ERROR | HAS_CONTRACTION
EVERY_MODEL = np.ones(len(MODEL_NAMES), np.bool_)


@dataclass(frozen=True, eq=False)
class AveragedDraws:
    """Draws of several of the four models with normalised weights.

    Attributes
    ----------
    evidence : OrderEvidence
    points : ndarray, shape (draws, k)
        All coordinates of the task; an absent effect is 0.
    weights : ndarray, shape (draws,)
    """

    evidence: OrderEvidence
    points: FloatArray
    weights: FloatArray

    @cached_property
    def posterior(self) -> ObserverPosterior:
        """The posterior of 'both', in whose coordinates the points are."""
        return ObserverPosterior(self.evidence.subject, OrderModel("both"), self.evidence.prior)

    @cached_property
    def quantities(self) -> dict[str, FloatArray]:
        """Every named quantity at the draws, (draws,) each."""
        return self.posterior.quantities(self.points)

    def resampled(self, rng: Rng, size: int) -> FloatArray:
        """Points drawn by their weights, shape (size, k)."""
        chosen = rng.choice(len(self.weights), size, p=self.weights)
        return self.points[chosen]


def averaged_draws(evidence: OrderEvidence, is_included: BoolArray = EVERY_MODEL) -> AveragedDraws:
    """Draws of the models that are included, shape (4,); by default of all four."""
    selected = np.flatnonzero(is_included)
    log_weights = []
    for i in selected:
        log_weight = evidence.draws[i].log_weights
        log_model = evidence.log_evidence[i] + np.log(PRIOR_PROBABILITIES[i])
        log_weights.append(log_weight - logsumexp(log_weight) + log_model)
    joined = np.concatenate(log_weights)
    weights = np.exp(joined - logsumexp(joined))
    points = np.concatenate([evidence.draws[i].x for i in selected])
    return AveragedDraws(evidence, points, weights / weights.sum())


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
