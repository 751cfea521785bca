"""What is done to each subject of a study: maxima, proposal, evidence, draws; the same for one process and for many."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from bayes_toe.maximum import find_maxima
from bayes_toe.model_evidence import SubjectEvidence, subject_evidence
from bayes_toe.parallel import run_jobs
from bayes_toe.pointwise import POINTWISE_LIMIT, Pointwise, pointwise, values_needed
from bayes_toe.posterior import Posterior
from bayes_toe.prior import Prior
from bayes_toe.proposal import fit_proposal
from bayes_toe.sampling import Chains, SamplerSettings, sample_chains
from bayes_toe.seeds import generator
from bayes_toe.study import Study, Subject

Progress = Callable[[str], None]


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
    """Evidence of one subject; where sampling was asked for, its chains; and, where the study is not too large, values per pair."""

    subject: Subject
    evidence: SubjectEvidence
    chains: Chains | None
    pointwise: Pointwise | None


@dataclass(frozen=True, eq=False)
class _Job:
    subject: Subject
    settings: Settings
    with_chains: bool
    with_pointwise: bool


def analyse(
    study: Study, settings: Settings, *, with_chains: bool, workers: int | None = None, progress: Progress | None = None
) -> Sequence[SubjectResult]:
    """Analyse every subject; results are in the study's order and do not depend on it or on the number of workers."""
    with_pointwise = with_chains and values_needed(study, settings.sampler) <= POINTWISE_LIMIT
    jobs = [_Job(subject, settings, with_chains, with_pointwise) for subject in study]
    results: dict[int, SubjectResult] = {}
    for index, result in run_jobs(_analyse_subject, jobs, workers):
        results[index] = result
        if progress is not None:
            progress(result.subject.name)
    return [results[index] for index in range(len(jobs))]


def _analyse_subject(job: _Job) -> SubjectResult:
    posterior = Posterior(job.subject, job.settings.prior)
    maxima = find_maxima(posterior)
    fitted = fit_proposal(posterior, generator(job.settings.seed, job.subject.name, "proposal"), maxima=maxima)
    chains = sample_chains(fitted, job.settings.sampler, job.settings.seed) if job.with_chains else None
    by_pair = pointwise(posterior, chains.x, job.settings.seed) if chains is not None and job.with_pointwise else None
    return SubjectResult(job.subject, subject_evidence(job.subject, maxima, fitted), chains, by_pair)
