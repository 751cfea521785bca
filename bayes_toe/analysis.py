"""The analysis of every subject of a study, in parallel.

`run` computes the answers, the evidence, the draws of the paper's model, the differences between
conditions and the group. Its result is an `Analysis`. `sample` draws from one model, and
`evidence` computes the answers and the evidence only.

All three take seed, prior, draws, workers, progress and keep. A subject whose computation fails is
left out, and the result names the reason.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from bayes_toe.answers.contrast import ContrastTable, contrast
from bayes_toe.answers.evidence_table import EvidenceTable, SubjectEvidence, subject_evidence
from bayes_toe.answers.order_effect import OrderEffect, answer_evidence
from bayes_toe.answers.study_summary import FEWEST_FOR_GROUP
from bayes_toe.arrays import FloatArray, StrPath
from bayes_toe.checks.answer_checks import Finding, answer_flags, not_interpreted
from bayes_toe.data.messages import as_html
from bayes_toe.data.study import Study, Subject, require_study
from bayes_toe.data.tasks import Task
from bayes_toe.errors import ConvergenceWarning, NumericalError
from bayes_toe.groups.population import PopulationResult, population
from bayes_toe.inference.draws import Draws, require_fitting
from bayes_toe.inference.draws_file import subjects_tree
from bayes_toe.inference.fitted import Fitted
from bayes_toe.inference.order_evidence import BATCH, OrderEvidence, unchecked_evidence
from bayes_toe.inference.prediction import Predictor
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.inference.subject import (
    EVIDENCE_DRAWS,
    SUMMARY_COLUMNS,
    Settings,
    SubjectDraws,
    SummaryRow,
    fit_subject,
    model_evidence,
    subject_draws,
)
from bayes_toe.model.models import OrderModel, model_posterior, require_model
from bayes_toe.model.paper_model import PAPER_MODEL, paper_posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.prior_file import prior_for
from bayes_toe.result_store import load_result, resumed_seed, run_stored
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers, try_each, without_failed

if TYPE_CHECKING:
    import pandas as pd

Result = TypeVar("Result")
Sampled = TypeVar("Sampled", bound=SubjectDraws)


@dataclass(frozen=True, eq=False, repr=False)
class Analysis:
    """Answers, evidence and draws of one study, with their settings.

    The study is without subjects that failed, see :attr:`bayes_toe.inference.draws.Draws.failed`.

    Attributes
    ----------
    curves : tuple of Predictor
        Some draws of every subject, averaged over the four models, in the coordinates of 'both'.
    contrast : ContrastTable or None
        The differences between conditions within subjects, if the study has conditions.
    group : PopulationResult or None
        The group of the interpretable subjects, if there are at least six.
    """

    study: Study
    draws: Draws
    evidence: EvidenceTable
    settings: Settings
    curves: tuple[Predictor, ...]
    summary_rows: tuple[SummaryRow, ...]
    contrast: ContrastTable | None
    group: PopulationResult | None

    def __repr__(self) -> str:
        return f"<Analysis of {self.study!r}: answers, draws, evidence, summary()>"

    def _repr_html_(self) -> str:
        return as_html(repr(self)[1:-1], self.evidence.frame())  # without < and >

    @property
    def answers(self) -> tuple[OrderEffect, ...]:
        """The conclusion for every subject."""
        return self.evidence.answers

    def curve(self, subject: str) -> Predictor:
        """Predictions for one subject, averaged over the four models.

        Raises
        ------
        InputError
            For an unknown subject.
        """
        name = self.study[subject].name  # refuses an unknown subject
        return self.curves[self.study.names.index(name)]

    def summary(self) -> pd.DataFrame:
        """The table of :meth:`bayes_toe.inference.draws.Draws.summary`."""
        import pandas as pd

        return pd.DataFrame(self.summary_rows, columns=SUMMARY_COLUMNS)


def run(
    study: Study,
    *,
    draws: int = 4000,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    keep: StrPath | None = None,
) -> Analysis:
    """Estimate the order effects of every subject, and sample the paper's model (H1).

    Parameters
    ----------
    study : Study
    draws : int
        Bulk and tail effective draws to reach for every parameter of every subject.
    seed : int, optional
        Root seed; without one, fresh entropy that is stored with the results.
    prior : Prior or str, optional
        A prior, a preset, "default" or "paper", or a TOML file, see :mod:`bayes_toe.model.prior`.
    workers : int or distributed.Client, optional
        Processes, by default one per processor; or a client of a Dask cluster, whose workers take
        their place. The numbers do not depend on it.
    progress : callable, optional
        Called with a subject's name when that subject is done.
    keep : path, optional
        A folder in which finished subjects are stored. The draws of the result are read from there
        when they are used, so that they need no memory. A stopped call that is repeated with the
        same folder continues there, to the same bits, if all that decides the numbers is the same.
        Without a seed, that of the stored subjects is used.
    """
    settings = _settings(study, draws, resumed_seed(seed, keep), prior)
    require_fitting(study, settings)
    results = _analyse_study(
        study, settings, _sample_h1, folder=keep, workers=workers, progress=progress
    )
    study, analyses, all_draws = _finished(study, results, settings)

    rows = []
    summary: list[SummaryRow] = []
    curves = []
    for subject, analysis in zip(study, map(load_result, analyses), strict=True):
        rows.append(analysis.evidence)
        summary += analysis.summary
        posterior = OrderModel("both").posterior(subject, settings.prior.observer)
        curves.append(Predictor(posterior, analysis.curve_draws))
    table = _table(rows, settings, all_draws.failed, study.task)

    differences = None
    if study.conditions is not None:
        differences = contrast(
            study, seed=settings.seed, prior=settings.prior, workers=workers, keep=keep
        )
    return Analysis(
        study,
        all_draws,
        table,
        settings,
        curves=tuple(curves),
        summary_rows=tuple(summary),
        contrast=differences,
        group=_group(study, table.answers, settings),
    )


def _group(
    study: Study, answers: Sequence[OrderEffect], settings: Settings
) -> PopulationResult | None:
    """The group of the interpretable subjects; None if they are too few.

    A unit of the study is a subject, or a subject in one condition, and has an answer of its own.
    If one answer of a subject is not interpretable, all its units are left out. The result itself
    says whether it is reliable, so no warning is raised.
    """
    interpretable = {answer.subject for answer in answers if answer.is_interpretable}
    left_out = {unit.subject_name for unit in study if unit.name not in interpretable}
    names = [unit.name for unit in study if unit.subject_name not in left_out]
    if len({unit.subject_name for unit in study} - left_out) < FEWEST_FOR_GROUP:
        return None

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return population(study.select(names), seed=settings.seed, hyperprior=settings.prior.group)


def sample(
    study: Study,
    *,
    model: str = "paper",
    draws: int = 4000,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    keep: StrPath | None = None,
) -> Draws:
    """Draw from the posterior of one model for every subject.

    Parameters
    ----------
    study : Study
    model : str
        "none", "constant-error", "contraction", "both", or "paper", the paper's (H1).
    draws : int
        Bulk and tail effective draws to reach for every judged quantity of every subject.
    seed, prior, workers, progress, keep
        As in :func:`run`.

    Raises
    ------
    InputError
        If there is no such model, or a number is not allowed.
    WorkerError
        If the work of every subject was lost.

    Warns
    -----
    ConvergenceWarning
        For subjects that missed the criteria, or a quantile of whom is not precise enough; they are
        marked in the result as well.

    Examples
    --------
    >>> from bayes_toe.data.study import Subject
    >>> one = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> draws = sample(Study([one]), model="constant-error", draws=500, seed=1, workers=1)
    >>> draws.model, draws.parameters[-3:]
    ('constant error', ('constant_error', 'jnd', 'zone'))
    """
    require_study(study)
    name = require_model(model)

    settings = _settings(study, draws, resumed_seed(seed, keep), prior, name)
    require_fitting(study, settings)
    results = run_stored(
        partial(try_each, partial(_sample_subject, settings=settings)),
        study.subjects,
        study.names,
        seed=settings.seed,
        folder=keep,
        workers=workers,
        progress=progress,
    )
    _, _, all_draws = _finished(study, results, settings)

    # The words of a warning between a subject and the reason, and the reasons by subject.
    for problem, reasons in (
        (" is left out, ", all_draws.failed),
        (" did not converge: ", all_draws.not_converged),
        (": ", all_draws.imprecise),
    ):
        for subject, reason in reasons.items():
            warnings.warn(f"subject {subject!r}{problem}{reason}", ConvergenceWarning, stacklevel=2)
    return all_draws


def evidence(
    study: Study,
    *,
    draws: int = EVIDENCE_DRAWS,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    keep: StrPath | None = None,
) -> EvidenceTable:
    """Estimate the order effects of every subject, and compare models by their evidence.

    Parameters
    ----------
    study : Study
    draws : int
        Independent draws behind the evidence of H1; its standard error goes as one over their root.
    seed, prior, workers, progress, keep
        As in :func:`run`.

    Examples
    --------
    >>> from bayes_toe.data.study import Subject
    >>> one = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> evidence(Study([one]), seed=1, workers=1)["S01"].log_evidence_h1_se < 0.02
    True
    """
    settings = _settings(study, draws, resumed_seed(seed, keep), prior)
    results = _analyse_study(
        study,
        settings,
        partial(_compute_evidence, n_draws=draws),
        folder=keep,
        workers=workers,
        progress=progress,
    )
    rows, failed = without_failed(study.names, results)
    return _table(list(map(load_result, rows)), settings, failed, study.task)


@dataclass(frozen=True, eq=False)
class _AnalysedSubject(SubjectDraws):
    """What :func:`run` computes for one subject: draws of the paper's model, and more.

    `curve_draws`, shape (draws, k), are those of the four models together, each model by its
    posterior probability.
    """

    evidence: SubjectEvidence
    curve_draws: FloatArray


#: The evidences of a subject's four models, and the findings on its responses.
_FlaggedEvidence: TypeAlias = tuple[OrderEvidence, Sequence[Finding]]


def _sample_subject(subject: Subject, settings: Settings) -> SubjectDraws:
    """The draws of one subject under the model of the settings."""
    target = model_posterior(settings.model, subject, settings.prior)
    fitted = fit_subject(target, settings.seed, has_chains=True)
    return subject_draws(fitted, settings.sampler, settings.seed)


def _analyse_subjects(
    flagged_subjects: Sequence[tuple[Subject, Sequence[Finding]]],
    settings: Settings,
    analyse: Callable[..., Result],
) -> list[Result | NumericalError]:
    """What `analyse` gives for each subject, or the error that it raises.

    The evidences of all subjects are computed together, which is faster. `analyse` takes the pair
    of the evidences of a subject and the findings on its responses, and the settings.
    """
    subjects, findings = zip(*flagged_subjects, strict=True)
    evidences = unchecked_evidence(subjects, settings.seed, settings.prior.observer)
    return try_each(partial(analyse, settings=settings), zip(evidences, findings, strict=True))


def _fit_h1(
    flagged_evidence: _FlaggedEvidence, settings: Settings, n_draws: int, *, has_chains: bool
) -> tuple[Fitted, SubjectEvidence]:
    """The mixture of the paper's model (H1) of one subject, and its row of the evidence table."""
    evidence, findings = flagged_evidence
    seed = settings.seed
    # An evidence that is not finite raises an error here, where it costs this subject only.
    answer = answer_evidence(evidence.checked(), seed, findings)
    target = paper_posterior(evidence.subject, settings.prior)
    fitted = fit_subject(target, seed, has_chains=has_chains)
    return fitted, subject_evidence(fitted, model_evidence(fitted, seed, n_draws), answer)


def _compute_evidence(
    flagged_evidence: _FlaggedEvidence, settings: Settings, n_draws: int
) -> SubjectEvidence:
    """The row of one subject in the evidence table, with so many draws behind that of H1."""
    _, row = _fit_h1(flagged_evidence, settings, n_draws, has_chains=False)
    return row


def _sample_h1(flagged_evidence: _FlaggedEvidence, settings: Settings) -> _AnalysedSubject:
    """The row of one subject in the evidence table, and draws of the paper's model (H1)."""
    fitted, row = _fit_h1(flagged_evidence, settings, EVIDENCE_DRAWS, has_chains=True)
    draws = subject_draws(fitted, settings.sampler, settings.seed, summarised=True)
    evidence, _ = flagged_evidence
    # 400 draws suffice for the bands of curves in figures.
    rng = generator(settings.seed, evidence.subject.name, "shown")
    curve_draws = evidence.averaged().resampled(rng, size=400)
    row = replace(row, fit=draws.fit)
    return _AnalysedSubject(**vars(draws), evidence=row, curve_draws=curve_draws)


def _settings(
    study: Study,
    draws: int,
    seed: int,
    prior: Prior | str | None,
    model: str = PAPER_MODEL,
) -> Settings:
    """The settings of an analysis, with the prior that is asked for."""
    return Settings(seed, prior_for(study, prior), SamplerSettings(draws=draws), model)


def _table(
    rows: Sequence[SubjectEvidence], settings: Settings, failed: Mapping[str, str], task: Task
) -> EvidenceTable:
    """The evidence table of the subjects that did not fail.

    The limits of p-values in its answers are those for as many subjects as the table has.
    """
    final_rows = [replace(row, answer=row.answer.in_study(len(rows))) for row in rows]
    return EvidenceTable(tuple(final_rows), settings.seed, settings.prior, failed, task)


def _analyse_study(
    study: Study, settings: Settings, analyse: Callable[..., Result], **options: Any
) -> Sequence[Result | Path | NumericalError]:
    """What `analyse` gives for every subject, or its error, by batches of subjects in parallel.

    The options are those of :func:`bayes_toe.result_store.run_stored`.
    """
    return run_stored(
        partial(_analyse_subjects, settings=settings, analyse=analyse),
        list(zip(study, answer_flags(study), strict=True)),
        study.names,
        seed=settings.seed,
        batch=BATCH,
        **options,
    )


def _finished(
    study: Study, results: Sequence[Sampled | Path | NumericalError], settings: Settings
) -> tuple[Study, list[Sampled | Path], Draws]:
    """The subjects that did not fail, their results, and the draws of these results.

    A WorkerError is raised if all subjects failed.
    """
    finished, failed = without_failed(study.names, results)
    # Faults of all subjects, also of those that failed: limits of alarms depend on the number of
    # subjects.
    faults = not_interpreted(study)
    if failed:
        subjects = tuple(subject for subject in study if subject.name not in failed)
        study = replace(study, subjects=subjects)
    return study, finished, Draws(subjects_tree(study, finished, settings, failed, faults))
