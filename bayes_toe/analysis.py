"""What is done to each subject of a study: maxima, proposal, evidence, draws; the same for one process and for many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

from bayes_toe.classical.fit_table import SubjectFit, subject_fit
from bayes_toe.comparison.evidence_table import SubjectEvidence, subject_evidence
from bayes_toe.data.study import Study, Subject
from bayes_toe.inference.adaptation import adapt_proposal, with_fresh_draws
from bayes_toe.inference.modes import find_maxima
from bayes_toe.inference.pointwise import POINTWISE_LIMIT, Pointwise, pointwise, values_needed
from bayes_toe.inference.sampling import Chains, SamplerSettings, sample_chains
from bayes_toe.model.ladder import posterior_of
from bayes_toe.model.prior import Prior
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, run_in_order


@dataclass(frozen=True)
class Settings:
    """Everything that decides the numbers, stored with the results.

    Parameters
    ----------
    seed : int
        Root seed; streams are keyed by it and the subject's name.
    prior : Prior
    sampler : SamplerSettings
    """

    seed: int
    prior: Prior = field(default_factory=Prior)
    sampler: SamplerSettings = field(default_factory=SamplerSettings)


@dataclass(frozen=True, eq=False)
class SubjectResult:
    """What was asked for of one subject, None for the rest; the fit comes with the evidence, values per pair only with small studies.

    The fit is None for subjects with intervals, which it does not know.

    `efficiency` and `pareto_k` tell how good the fitted proposal is.
    """

    subject: Subject
    efficiency: float
    pareto_k: float
    evidence: SubjectEvidence | None
    fit: SubjectFit | None
    chains: Chains | None
    pointwise: Pointwise | None


@dataclass(frozen=True, eq=False)
class _Job:
    subject: Subject
    settings: Settings
    with_evidence: bool
    with_chains: bool
    with_pointwise: bool


def analyse(
    study: Study,
    settings: Settings,
    *,
    with_evidence: bool = True,
    with_chains: bool = True,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Sequence[SubjectResult]:
    """Analyse every subject; results are in the study's order and do not depend on it or on the number of workers."""
    with_pointwise = with_chains and values_needed(study, settings.sampler) <= POINTWISE_LIMIT
    jobs = [_Job(subject, settings, with_evidence, with_chains, with_pointwise) for subject in study]
    return run_in_order([partial(_analyse_subject, job) for job in jobs], workers, progress, [(name,) for name in study.names])


def _analyse_subject(job: _Job) -> SubjectResult:
    subject, seed = job.subject, job.settings.seed
    posterior = posterior_of(subject, job.settings.prior)
    maxima = find_maxima(posterior)
    rng = generator(seed, subject.name, "proposal")
    fitted = adapt_proposal(posterior, rng, maxima=maxima)
    chains = sample_chains(fitted, job.settings.sampler, seed) if job.with_chains else None
    fit = subject_fit(subject, posterior.prior, seed=seed) if job.with_evidence and subject.isi is None else None
    replicates = None if fit is None else fit.bootstrap
    return SubjectResult(
        subject=subject,
        efficiency=fitted.efficiency,
        pareto_k=fitted.pareto_k,
        evidence=subject_evidence(posterior, maxima, with_fresh_draws(fitted, rng), replicates) if job.with_evidence else None,
        fit=fit,
        chains=chains,
        pointwise=pointwise(posterior, chains.x, seed) if chains is not None and job.with_pointwise else None,
    )
