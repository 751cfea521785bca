"""The one pipeline of a subject under a model: modes, proposal, chains, evidence, values per pair, goodness of fit."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np

from bayes_toe.data.study import Subject
from bayes_toe.inference.adaptation import EVIDENCE_DRAWS as EVIDENCE_DRAWS
from bayes_toe.inference.adaptation import adapt_proposal, with_trusted_draws
from bayes_toe.inference.diagnostics import smoothed_weights
from bayes_toe.inference.evidence import Evidence, exact_evidence, importance_evidence
from bayes_toe.inference.modes import Maxima, find_maxima
from bayes_toe.inference.predictive_checks import FitSummary, summarise_fit
from bayes_toe.inference.proposal import FittedProposal
from bayes_toe.inference.sampling import Chains, SamplerSettings, independent_chains, sample_chains
from bayes_toe.model.prior import Prior
from bayes_toe.model.target import Answering, Conjugate, Target
from bayes_toe.seeds import generator

AnyPosterior: TypeAlias = Target | Conjugate


@dataclass(frozen=True)
class Settings:
    """Everything that decides the numbers, stored with the results.

    Parameters
    ----------
    seed : int
        Root seed; streams are keyed by it, the subject's name and the model's.
    prior : Prior
    sampler : SamplerSettings
    model : str
    """

    seed: int
    prior: Prior = field(default_factory=Prior)
    sampler: SamplerSettings = field(default_factory=SamplerSettings)
    model: str = ""

    def as_dict(self) -> dict[str, object]:
        """What a file of results keeps of it."""
        return {"model": self.model, "prior": asdict(self.prior), "sampler": asdict(self.sampler)}


@dataclass(frozen=True)
class Wanted:
    """What is asked for of a subject.

    Parameters
    ----------
    chains : SamplerSettings, optional
        Posterior draws by these; with them, goodness of fit.
    evidence_draws : int
        Independent draws behind the evidence; 0 for no evidence.
    """

    chains: SamplerSettings | None = None
    evidence_draws: int = 0

    @property
    def judging_draws(self) -> int:
        """By how many draws a proposal is judged: those of an evidence, asked for or not (chains are then the same), or more for chains."""
        return max(self.evidence_draws or EVIDENCE_DRAWS, 0 if self.chains is None else self.chains.proposals)


@dataclass(frozen=True, eq=False)
class SubjectResult:
    """What was asked for of one subject under one model, None for the rest; small enough to send to another process.

    Attributes
    ----------
    target : Answering
        The posterior.
    efficiency, pareto_k : float
        How good the fitted proposal is; 1 and NaN where draws come from the posterior itself.
    """

    target: Answering
    efficiency: float
    pareto_k: float
    evidence: Evidence | None
    chains: Chains | None
    fit: FitSummary | None

    @property
    def subject(self) -> Subject:
        """The counts."""
        return self.target.subject


class Fitted(NamedTuple):
    """What the pipeline found on its way: maxima and proposal, with fresh draws where an evidence was asked for."""

    maxima: Maxima
    proposal: FittedProposal


def infer(target: AnyPosterior, seed: int, wanted: Wanted) -> SubjectResult:
    """The pipeline of one subject under one model; random streams are keyed by seed, subject, model and purpose."""
    return exact_result(target, seed, wanted) if isinstance(target, Conjugate) else fitted_result(target, seed, wanted)[0]


def exact_result(target: Conjugate, seed: int, wanted: Wanted) -> SubjectResult:
    """The pipeline where the posterior is known in closed form."""
    chains = None if wanted.chains is None else independent_chains(target, wanted.chains, seed)
    evidence = exact_evidence(target) if wanted.evidence_draws else None
    return _result(target, seed, (1.0, float("nan")), evidence, chains)


def fitted_result(target: Target, seed: int, wanted: Wanted) -> tuple[SubjectResult, Fitted]:
    """The pipeline where a proposal has to be fitted, with what it found on its way."""
    maxima, rng = find_maxima(target), generator(seed, target.subject.name, target.model.name, "proposal")
    adapted = adapt_proposal(target, rng, start=maxima, draws=wanted.judging_draws)
    chains = None if wanted.chains is None else sample_chains(adapted, wanted.chains, seed)
    fitted = with_trusted_draws(adapted, rng) if wanted.evidence_draws else adapted
    evidence = importance_evidence(fitted) if wanted.evidence_draws else None
    result = _result(target, seed, (adapted.efficiency, adapted.pareto_k), evidence, chains)
    return result, Fitted(maxima, fitted)


def weighted_fit(fitted: FittedProposal, seed: int) -> FitSummary | None:
    """Goodness of fit without chains: by the draws of a proposal, resampled by their weights; None where these cannot be trusted."""
    if not fitted.trusted:
        return None
    target, draws = fitted.proposal.posterior, fitted.draws
    rng = generator(seed, target.subject.name, target.model.name, "resampling")
    weights = np.exp(smoothed_weights(draws.log_weights).log_weights)
    kept = rng.choice(len(weights), len(weights), p=weights / weights.sum())
    return summarise_fit(target, draws.x[kept], seed, log_likelihood=draws.log_posterior[kept] - draws.log_prior[kept])


def _result(target: Answering, seed: int, quality: tuple[float, float], evidence: Evidence | None, chains: Chains | None) -> SubjectResult:
    fit = None if chains is None else _chains_fit(target, chains, seed)
    return SubjectResult(target, *quality, evidence, chains, fit)


def _chains_fit(target: Answering, chains: Chains, seed: int) -> FitSummary:
    x = chains.x.reshape(-1, chains.x.shape[-1])
    return summarise_fit(target, x, seed, log_likelihood=chains.log_posterior.ravel() - target.log_prior(x))
