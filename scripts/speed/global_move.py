"""The package's own routes: the global move from the maximum to the draws, and importance sampling alone."""

from __future__ import annotations

import numpy as np

from bayes_toe.maximum import find_maxima
from bayes_toe.model_evidence import importance_evidence
from bayes_toe.proposal import FittedProposal, fit_proposal
from bayes_toe.sampling import SamplerSettings, sample_chains
from bayes_toe.seeds import generator
from speed.cases import Case
from speed.counting import Counting
from speed.method import Prepared
from speed.outcome import CHAINS, WEIGHTED, Outcome, natural_draws


def prepare_global(case: Case) -> Prepared:
    """The whole route of `bayes-toe sample`; effort is the number of effective draws asked for."""

    def run(effort: int, seed: int) -> Outcome:
        posterior = Counting(case.posterior)
        fitted = _fitted(posterior, seed)
        spent = posterior.evaluations
        chains = sample_chains(fitted, SamplerSettings(draws=effort), seed)
        value, error, _ = importance_evidence(fitted)
        return Outcome(
            CHAINS,
            natural_draws(*posterior.natural(chains.x)),
            None,
            posterior.evaluations,
            posterior.evaluations - spent,
            log_evidence=value,
            log_evidence_se=error,
            verdict=lambda: (chains.converged, chains.reason),
        )

    return Prepared(run)


def prepare_importance(case: Case) -> Prepared:
    """Weighted draws of the fitted proposal; effort is their number."""

    def run(effort: int, seed: int) -> Outcome:
        posterior = Counting(case.posterior)
        fitted = _fitted(posterior, seed, draws=effort)
        value, error, why_not = importance_evidence(fitted)
        return Outcome(
            WEIGHTED,
            natural_draws(*posterior.natural(fitted.draws.x)),
            fitted.draws.log_weights,
            posterior.evaluations,
            len(fitted.draws.x),
            log_evidence=value,
            log_evidence_se=error,
            verdict=lambda: (fitted.trusted, why_not),
        )

    return Prepared(run)


def _fitted(posterior: Counting, seed: int, **size: int) -> FittedProposal:
    rng: np.random.Generator = generator(seed, posterior.subject.name, "proposal")
    return fit_proposal(posterior, rng, maxima=find_maxima(posterior), **size)
