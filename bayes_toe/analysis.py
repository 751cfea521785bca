"""The verbs of a study: sample, evidence, or both; every subject goes through the one pipeline (:mod:`bayes_toe.inference.subject`).

All take the same options: seed, prior, draws, workers, progress.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

from bayes_toe.classical.fit_table import REPLICATES, FitTable, SubjectFit, subject_fit
from bayes_toe.comparison.evidence_table import EvidenceTable, SubjectEvidence, subject_evidence
from bayes_toe.comparison.presets import UnderPresets, under_presets
from bayes_toe.data.study import Study, Subject
from bayes_toe.errors import ConvergenceWarning, InputError, WorkerError
from bayes_toe.inference.draws import Draws, build_draws
from bayes_toe.inference.evidence import Evidence
from bayes_toe.inference.pointwise import POINTWISE_LIMIT, values_needed
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.inference.subject import EVIDENCE_DRAWS, Fitted, Settings, SubjectResult, Wanted, fitted_result, infer, weighted_fit
from bayes_toe.model.ladder import CONSTANT_BIAS, PREDICTIVE_UPDATE, SYMMETRIC, model_named
from bayes_toe.model.posterior import Model
from bayes_toe.model.prior import Prior
from bayes_toe.model.study_prior import PRESETS, prior_for
from bayes_toe.seeds import root_seed
from bayes_toe.workers import Failed, Progress, Workers, run_or_fail

Result = TypeVar("Result")
_LEVEL = 0.9  # of the bootstrap intervals beside the posterior's 5 and 95 %


@dataclass(frozen=True, eq=False)
class Analysis:
    """Draws and evidence of one study, from the same fitted proposals, with the settings that made them, and the paper's fits.

    The study is without subjects that failed, see :attr:`bayes_toe.inference.draws.Draws.failed`.
    """

    study: Study
    draws: Draws
    evidence: EvidenceTable
    settings: Settings
    fits: FitTable
    presets: tuple[UnderPresets, ...] = ()


def run(
    study: Study,
    *,
    draws: int = 4000,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
) -> Analysis:
    """Sample every subject under the predictive update (H1) and compute every evidence in one pass.

    Parameters
    ----------
    study : Study
    draws : int
        Bulk and tail effective draws to reach for every parameter of every subject.
    seed : int, optional
        Root seed; without one, fresh entropy that is stored with the results.
    prior : Prior or str, optional
        Or a preset, "paper" (the default) or "stimuli", see :func:`bayes_toe.model.study_prior.prior_for`.
    workers : int or distributed.Client, optional
        Processes, by default one per processor; or a client of a Dask cluster, whose workers take their place. The numbers do not depend on
        it.
    progress : callable, optional
        Called with a subject's name when that subject is done.
    """
    settings = _settings(study, draws, seed, prior)
    wanted = Wanted(settings.sampler, EVIDENCE_DRAWS, values_per_pair=_affordable(study, settings))
    presets = _presets(study)
    jobs = [partial(_evidence_of, subject, settings, wanted, presets) for subject in study]
    study, done, failed = _survivors(study, jobs, workers, progress)
    made = build_draws(study, [one.result for one in done], settings, failed)
    fits = FitTable(tuple(one.fit for one in done if one.fit is not None), _LEVEL, REPLICATES, settings.seed, settings.prior)
    moved = tuple(one.presets for one in done if one.presets is not None)
    return Analysis(study, made, _table(done, settings, failed), settings, fits, moved)


def sample(
    study: Study,
    *,
    model: str = PREDICTIVE_UPDATE.name,
    draws: int = 4000,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
) -> Draws:
    """Posterior draws of every subject under a model.

    Parameters
    ----------
    study : Study
    model : str
        A name of :data:`bayes_toe.model.ladder.NAMES`; the predictive update (H1) by default.
    draws : int
        Bulk and tail effective draws to reach for every judged quantity of every subject.
    seed, prior, workers, progress
        As in :func:`run`.

    Raises
    ------
    InputError
        If there is no such model, or a number is not allowed.

    Warns
    -----
    ConvergenceWarning
        For subjects that missed the criteria; they are marked in the result as well.

    Examples
    --------
    >>> from bayes_toe.data.study import Subject
    >>> one = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> found = sample(Study([one]), model="constant bias", draws=500, seed=1, workers=1)
    >>> found.model, found.parameters
    ('constant bias', ('q0', 'width', 'offset'))
    """
    made = draw(study, model=model, draws=draws, seed=seed, prior=prior, workers=workers, progress=progress)
    for name, reason in made.failed.items():
        warnings.warn(f"subject {name!r} is left out, {reason}", ConvergenceWarning, stacklevel=2)
    for name, shortfall in made.not_converged.items():
        warnings.warn(f"subject {name!r} did not converge: {shortfall}", ConvergenceWarning, stacklevel=2)
    return made


def draw(
    study: Study,
    *,
    model: str = PREDICTIVE_UPDATE.name,
    draws: int = 4000,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
) -> Draws:
    """:func:`sample` without its warning, for callers that say themselves who did not converge."""
    record, settings = model_named(model), _settings(study, draws, seed, prior, model)
    wanted = Wanted(settings.sampler, values_per_pair=_affordable(study, settings))
    jobs = [partial(infer, record.posterior(subject, settings.prior), settings.seed, wanted) for subject in study]
    kept, results, failed = _survivors(study, jobs, workers, progress)
    return build_draws(kept, results, settings, failed)


def evidence(
    study: Study,
    *,
    draws: int = EVIDENCE_DRAWS,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
) -> EvidenceTable:
    """Log evidence of the update (H1), of its rivals without it and of free frequencies (H0), and goodness of fit, of every subject.

    Parameters
    ----------
    study : Study
    draws : int
        Independent draws behind each evidence; its standard error goes as one over their root.
    seed, prior, workers, progress
        As in :func:`run`.

    Examples
    --------
    >>> from bayes_toe.data.study import Subject
    >>> one = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> evidence(Study([one]), seed=1, workers=1)["S01"].log_evidence_h1_se < 0.02
    True
    """
    settings, wanted = _settings(study, draws, seed, prior), Wanted(evidence_draws=draws)
    jobs = [partial(_evidence_of, subject, settings, wanted) for subject in study]
    _, done, failed = _survivors(study, jobs, workers, progress)
    return _table(done, settings, failed)


@dataclass(frozen=True, eq=False)
class _Analysed:
    """One subject: the pipeline's result, the row of the evidence table, the fit (None with intervals, which it does not know)."""

    result: SubjectResult
    evidence: SubjectEvidence
    fit: SubjectFit | None
    presets: UnderPresets | None


def _presets(study: Study) -> dict[str, Prior]:
    """Every preset in numbers for the study; none where its stimuli have no scale."""
    try:
        return {name: prior_for(study, name) for name in PRESETS}
    except InputError:
        return {}


def _evidence_of(subject: Subject, settings: Settings, wanted: Wanted, presets: Mapping[str, Prior] | None = None) -> _Analysed:
    posterior = PREDICTIVE_UPDATE.posterior(subject, settings.prior)
    result, fitted = fitted_result(posterior, settings.seed, wanted)
    fit = subject_fit(subject, settings.prior, seed=settings.seed) if subject.isi is None else None
    described = weighted_fit(fitted.proposal, settings.seed) if result.fit is None else result.fit
    (symmetric, of_symmetric), (constant, of_constant) = (_rival(model, subject, settings) for model in (SYMMETRIC, CONSTANT_BIAS))
    row = subject_evidence(result, fitted, (symmetric, constant), described, None if fit is None else fit.bootstrap)
    moved = under_presets((of_symmetric, of_constant, fitted), presets, settings.seed) if presets else None
    return _Analysed(result, row, fit, moved)


def _rival(model: Model, subject: Subject, settings: Settings) -> tuple[Evidence, Fitted]:
    """The evidence of a model that differs from H1 in its order effect alone, and what was fitted for it."""
    found, fitted = fitted_result(model.posterior(subject, settings.prior), settings.seed, Wanted(evidence_draws=EVIDENCE_DRAWS))
    assert found.evidence is not None  # it was asked for
    return found.evidence, fitted


def _settings(study: Study, draws: int, seed: int | None, prior: Prior | str | None, model: str = PREDICTIVE_UPDATE.name) -> Settings:
    return Settings(root_seed(seed), prior_for(study, prior), SamplerSettings(draws=draws), model)


def _affordable(study: Study, settings: Settings) -> bool:
    """Whether values of every draw and pair are few enough to be stored."""
    return values_needed(study, settings.sampler) <= POINTWISE_LIMIT


def _table(done: Sequence[_Analysed], settings: Settings, failed: Mapping[str, str]) -> EvidenceTable:
    return EvidenceTable(tuple(one.evidence for one in done), settings.seed, settings.prior, failed)


def _survivors(
    study: Study, jobs: Sequence[Callable[[], Result]], workers: Workers, progress: Progress | None
) -> tuple[Study, list[Result], dict[str, str]]:
    """Do a job for each subject: the subjects that did not fail, their results, and by name why others did."""
    done = dict(zip(study.names, run_or_fail(jobs, workers, progress, [(name,) for name in study.names]), strict=True))
    failed = {name: one.reason for name, one in done.items() if isinstance(one, Failed)}
    if len(failed) == len(study):
        raise WorkerError("\n".join(f"{name}: {reason}" for name, reason in failed.items()))
    kept = replace(study, subjects=tuple(subject for subject in study if subject.name not in failed)) if failed else study
    return kept, [one for one in done.values() if not isinstance(one, Failed)], failed
