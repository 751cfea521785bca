"""The package's own routes: the global move from the maximum to the draws, and importance sampling alone."""

from __future__ import annotations

import numpy as np

from bayes_toe.inference.adaptation import adapt_proposal, fit_proposal
from bayes_toe.inference.evidence import importance_evidence
from bayes_toe.inference.modes import find_maxima
from bayes_toe.inference.sampling import SamplerSettings, sample_chains
from bayes_toe.seeds import generator
from speed.cases import Case
from speed.counting import Counting
from speed.method import Prepared
from speed.outcome import CHAINS, WEIGHTED, Outcome, natural_draws


def prepare_global(case: Case) -> Prepared:
    """The whole route of `bayes-toe sample`; effort is the number of effective draws asked for."""

    def run(effort: int, seed: int) -> Outcome:
        posterior = Counting(case.posterior)
        fitted = adapt_proposal(posterior, _stream(posterior, seed), start=find_maxima(posterior))
        spent = posterior.evaluations
        chains = sample_chains(fitted, SamplerSettings(draws=effort), seed)
        return Outcome(
            CHAINS,
            natural_draws(*posterior.natural(chains.x)),
            None,
            posterior.evaluations,
            posterior.evaluations - spent,
            verdict=lambda: (chains.converged, chains.reason),
        )

    return Prepared(run)


def prepare_importance(case: Case) -> Prepared:
    """Weighted draws of the fitted proposal; effort is their number."""

    def run(effort: int, seed: int) -> Outcome:
        posterior = Counting(case.posterior)
        fitted = fit_proposal(posterior, _stream(posterior, seed), start=find_maxima(posterior), draws=effort)
        estimate = importance_evidence(fitted)
        value, error, why_not = estimate.value, estimate.se, estimate.why_not
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


def _stream(posterior: Counting, seed: int) -> np.random.Generator:
    return generator(seed, posterior.subject.name, "proposal")
