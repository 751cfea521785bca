"""How far one run is from the reference, and how many effective draws it claims."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import softmax

from bayes_toe.arrays import FloatArray
from bayes_toe.inference.diagnostics import convergence
from bayes_toe.inference.proposal import efficiency
from speed.cases import LEVELS, Reference
from speed.outcome import APPROXIMATION, CHAINS, WEIGHTED, Outcome


@dataclass(frozen=True, eq=False)
class Score:
    """One run. Errors are the worst over the four natural parameters, in units of the reference's posterior sd.

    Attributes
    ----------
    chain_means : array, shape (independent means, 4)
        One row a chain, or one for the whole run where draws are weighted.
    """

    wall_s: float
    chain_means: FloatArray
    error_mean: float
    error_sd: float
    error_quantiles: float
    claimed_ess: float | None
    evaluations: int | None
    sampling_evaluations: int | None
    draws: int
    divergences: int | None
    converged: bool
    says: str
    log_evidence_error: float | None
    log_evidence_se: float | None

    @property
    def error_worst(self) -> float:
        """The worst of the mean, the sd and the three quantiles."""
        return float(np.max([self.error_mean, self.error_sd, self.error_quantiles]))


def score(outcome: Outcome, reference: Reference, wall_s: float) -> Score:
    """Everything the tables say of one run; none of it is timed."""
    flat, weights = _flat(outcome)
    mean = np.average(flat, axis=0, weights=weights)
    sd = np.sqrt(np.average(np.square(flat - mean), axis=0, weights=weights))
    converged, says = outcome.verdict()
    return Score(
        wall_s,
        outcome.draws.mean(axis=1) if outcome.kind == CHAINS else mean[None],
        _worst(mean - reference.means, reference),
        _worst(sd - reference.sds, reference),
        _worst(quantiles(flat, weights) - reference.quantiles, reference),
        claimed_ess(outcome),
        outcome.evaluations,
        outcome.sampling_evaluations,
        outcome.draws[..., 0].size,
        outcome.divergences,
        converged,
        says,
        None if outcome.log_evidence is None else outcome.log_evidence - reference.log_evidence,
        outcome.log_evidence_se,
    )


def _flat(outcome: Outcome) -> tuple[FloatArray, FloatArray | None]:
    """Draws (draws, 4) and weights that add up to 1; those of weight 0 count for nothing, even where mu1 is infinite, and are left out."""
    flat = outcome.draws.reshape(-1, 4)
    if outcome.log_weights is None:
        return flat, None
    weights = softmax(outcome.log_weights)
    return flat[weights > 0], weights[weights > 0]


def claimed_ess(outcome: Outcome) -> float | None:
    """Bulk ESS of the worst natural parameter; of weighted draws (sum w)^2 / sum w^2; None for an approximation."""
    if outcome.kind == APPROXIMATION:
        return None
    if outcome.kind == WEIGHTED and outcome.log_weights is not None:
        return efficiency(outcome.log_weights) * len(outcome.log_weights)
    return float(min(convergence(outcome.draws[..., i]).ess_bulk for i in range(4)))


def quantiles(draws: FloatArray, weights: FloatArray | None) -> FloatArray:
    """Quantiles at 5, 50 and 95 %, (draws, 4) -> (4, 3); the smallest draw with at least that weight at or below it.

    Examples
    --------
    >>> quantiles(np.tile(np.arange(5.0)[:, None], 4), np.array([0.1, 0.1, 0.6, 0.1, 0.1]))[0].tolist()
    [0.0, 2.0, 4.0]
    """
    if weights is None:
        return np.asarray(np.quantile(draws, LEVELS, axis=0).T)
    order = np.argsort(draws, axis=0)
    cumulative = np.cumsum(weights[order], axis=0)
    index = np.stack([np.searchsorted(cumulative[:, i], LEVELS) for i in range(draws.shape[1])])
    return np.stack([draws[order[np.minimum(index[i], len(draws) - 1), i], i] for i in range(draws.shape[1])])


def _worst(gap: FloatArray, reference: Reference) -> float:
    """Largest gap, (4,) or (4, 3), in posterior sds; NaN if any is."""
    return float(np.max(np.abs(gap) / (reference.sds if gap.ndim == 1 else reference.sds[:, None])))


def true_ess(scores: list[Score], reference: Reference) -> float | None:
    """Effective draws of one run, from the spread of independent means about the reference's mean; worst parameter.

    Independent means a run, times sd^2 / mean square distance: a bias that all chains share counts as error. None with fewer than
    three means.
    """
    means = _means(scores)
    return None if len(means) < 3 else _effective(np.mean(np.square(means - reference.means), axis=0), scores, reference)


def spread_ess(scores: list[Score], reference: Reference) -> float | None:
    """The same from their variance about their own average: what all chains get wrong in the same way is not seen."""
    means = _means(scores)
    return None if len(means) < 3 else _effective(means.var(axis=0, ddof=1), scores, reference)


def _means(scores: list[Score]) -> FloatArray:
    return np.concatenate([entry.chain_means for entry in scores])


def _effective(square: FloatArray, scores: list[Score], reference: Reference) -> float:
    with np.errstate(divide="ignore"):  # chains that never left one point have no spread at all
        return float(np.min(len(_means(scores)) / len(scores) * reference.sds**2 / square))
