"""The draws of one proposal as draws under another prior.

Draws x of a fitted proposal g carry log likelihood and log g; under another prior pi' their importance weights are L(x) pi'(x) / g(x),
exactly, so nothing is sampled again. The largest weights are smoothed (PSIS, Vehtari et al. 2024). Where k-hat exceeds 0.7 or too few draws
count, a proposal is fitted under that prior and fresh draws are made.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from bayes_toe.arrays import FloatArray
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.diagnostics import smoothed_unnormalised
from bayes_toe.inference.proposal import TRUSTED_EFFICIENCY, TRUSTED_K, FittedProposal, efficiency
from bayes_toe.model.posterior import Posterior
from bayes_toe.seeds import generator

REWEIGHTED, RESAMPLED = "reweighted", "resampled"
#: Effective draws below which re-weighted draws give way to fresh ones.
ENOUGH = 1000


class Weighted(NamedTuple):
    """Draws x, their log weights, k-hat and efficiency under some prior, and how they were made."""

    x: FloatArray
    log_weights: FloatArray
    pareto_k: float
    efficiency: float
    method: str

    @property
    def trusted(self) -> bool:
        """Whether averages over the weights can be trusted."""
        return self.pareto_k <= TRUSTED_K and self.efficiency > TRUSTED_EFFICIENCY

    @property
    def log_evidence(self) -> float:
        """Natural log."""
        return float(logsumexp(self.log_weights) - np.log(len(self.x)))


def under(fitted: FittedProposal, posterior: Posterior, wanted: Posterior, seed: int) -> Weighted:
    """The draws of a proposal for one posterior under the prior of another one of the same model; fresh ones where those do not do."""
    old = reweighted(fitted, posterior, wanted)
    if old.trusted and old.efficiency * len(old.x) >= ENOUGH:
        return old
    rng = generator(seed, wanted.subject.name, wanted.model.name, "sensitivity", wanted.model.describe(wanted.prior))
    return reweighted(fit_proposal(wanted, rng), wanted, wanted)._replace(method=RESAMPLED)


def reweighted(fitted: FittedProposal, posterior: Posterior, wanted: Posterior) -> Weighted:
    """The draws of a proposal that was fitted to one posterior as draws of the same model's under another prior."""
    draws = fitted.draws
    log_weights = draws.log_weights.copy()
    if wanted.prior != posterior.prior:
        some = np.isfinite(log_weights)  # elsewhere the likelihood or the prior is 0, under any prior
        log_weights[some] += posterior.log_prior_under(draws.x[some], wanted.prior) - draws.log_prior[some]
    made, k = smoothed_unnormalised(log_weights)
    return Weighted(draws.x, made, k, efficiency(made), REWEIGHTED)
