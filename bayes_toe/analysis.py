"""The analysis of every subject of a study, in parallel.

`run` computes the answers, the evidence, the draws of the paper's model, the differences between
conditions and the group. Its result is an `Analysis`. `sample` draws from one model, and
`evidence` computes the answers and the evidence only.

All three take seed, prior, draws, workers, progress and keep. A subject whose computation fails is
left out, and the result names the reason.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, TypeVar

from bayes_toe.answers.contrast import ContrastTable, contrast
from bayes_toe.answers.evidence_table import EvidenceTable, SubjectEvidence, subject_evidence
from bayes_toe.answers.order_effect import OrderEffect, answer_subject
from bayes_toe.answers.study_summary import FEWEST_FOR_GROUP
from bayes_toe.arrays import FloatArray, StrPath
from bayes_toe.checks.answer_checks import Finding, answer_flags, not_interpreted
from bayes_toe.data.messages import as_html
from bayes_toe.data.study import Study, Subject, require_study
from bayes_toe.data.tasks import Task
from bayes_toe.errors import ConvergenceWarning, NumericalError
from bayes_toe.groups.population import PopulationResult, population
from bayes_toe.inference.draws import Draws
from bayes_toe.inference.draws_file import subjects_tree
from bayes_toe.inference.prediction import Predictor
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.inference.subject import (
    EVIDENCE_DRAWS,
    SUMMARY_COLUMNS,
    AnalysisRequest,
    Settings,
    SubjectDraws,
    SummaryRow,
    fitted_result,
    subject_draws,
)
from bayes_toe.model.models import OrderModel, model_posterior, require_model, stored_model
from bayes_toe.model.paper_model import PAPER_MODEL, paper_posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.prior_file import prior_for
from bayes_toe.result_store import resumed_seed, run_stored
from bayes_toe.seeds import generator
from bayes_toe.workers import Failed, Progress, Workers, without_failed

if TYPE_CHECKING:
    import pandas as pd

Result = TypeVar("Result")
_N_CURVE_DRAWS = 400  # draws averaged over the four models, for curves


@dataclass(frozen=True, eq=False, repr=False)
class Analysis:
    """Answers, evidence and draws of one study, with their settings.

    The study is without subjects that failed, see :attr:`bayes_toe.inference.draws.Draws.failed`.

    Attributes
    ----------
    curves : tuple of Predictor
        Some draws of every subject, averaged over the four models, in the coordinates of 'both'.
    contrast : ContrastTable or None
        What differs between conditions within subjects, where the study has conditions.
    group : PopulationResult or None
        The group of the interpretable subjects, where there are at least six.
    group_of_good_fits : PopulationResult or None
        The group without the subjects whom the model does not fit, where there are any.
    """

    study: Study
    draws: Draws
    evidence: EvidenceTable
    settings: Settings
    curves: tuple[Predictor, ...] = ()
    summary_rows: tuple[SummaryRow, ...] = ()
    contrast: ContrastTable | None = None
    group: PopulationResult | None = None
    group_of_good_fits: PopulationResult | None = None

    def __repr__(self) -> str:
        return f"<Analysis of {self.study!r}: answers, draws, evidence, summary()>"

    def _repr_html_(self) -> str:
        return as_html(repr(self)[1:-1], self.evidence.frame())

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
        return self.curves[self.study.names.index(self.study[subject].name)]

    def summary(self) -> pd.DataFrame:
        """The same as :meth:`bayes_toe.inference.draws.Draws.summary`."""
        import pandas as pd

        return pd.DataFrame(self.summary_rows, columns=list(SUMMARY_COLUMNS))


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
        Or a preset, "default" or "paper", or a TOML file, see :mod:`bayes_toe.model.prior`.
    workers : int or distributed.Client, optional
        Processes, by default one per processor; or a client of a Dask cluster, whose workers take
        their place. The numbers do not depend on it.
    progress : callable, optional
        Called with a subject's name when that subject is done.
    keep : path, optional
        A folder in which finished subjects are stored. A stopped call that is repeated with the
        same folder continues there, to the same bits, if all that decides the numbers is the same.
        Without a seed, that of the stored subjects is used.
    """
    settings = _settings(study, draws, resumed_seed(seed, keep), prior)
    jobs = _analysis_jobs(study, settings, AnalysisRequest(settings.sampler, EVIDENCE_DRAWS))
    faults = not_interpreted(study)
    study, analysed, failed = _survivors(study, jobs, settings.seed, workers, progress, keep)
    drawn = [result.drawn for result in analysed if result.drawn is not None]
    analysed = [replace(result, drawn=None) for result in analysed]
    summary = tuple(chain.from_iterable(subject.summary for subject in drawn))
    all_draws = Draws(subjects_tree(study, drawn, settings, failed, faults))
    curves = []
    for result in analysed:
        if result.curve_draws is not None:
            posterior = OrderModel("both").posterior(
                study[result.evidence.subject], settings.prior.observer
            )
            curves.append(Predictor(posterior, result.curve_draws))
    differences = None
    if study.conditions is not None:
        differences = contrast(
            study, seed=settings.seed, prior=settings.prior, workers=workers, keep=keep
        )
    table = _table(analysed, settings, failed, study.task)
    group_of_good_fits = None
    excluded, misfits = list[OrderEffect](), list[OrderEffect]()
    for answer in table.answers:
        if not answer.is_interpretable:
            excluded.append(answer)
        elif answer.fits is False:
            misfits.append(answer)
    group = _group(study, excluded, settings.seed)
    if group is not None and misfits:
        group_of_good_fits = _group(study, [*excluded, *misfits], settings.seed)
    return Analysis(
        study,
        all_draws,
        table,
        settings,
        tuple(curves),
        summary,
        differences,
        group,
        group_of_good_fits,
    )


def _group(study: Study, excluded: Sequence[OrderEffect], seed: int) -> PopulationResult | None:
    """The group of the subjects none of whose answers are excluded; None where they are few.

    The result says itself whether it is reliable, so no warning is raised.
    """
    left_out = {study[answer.subject].subject_name for answer in excluded}
    names = [subject.name for subject in study if subject.subject_name not in left_out]
    if len({study[name].subject_name for name in names}) < FEWEST_FOR_GROUP:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return population(study.select(names), seed=seed)


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
    name = require_model(model, study.task).name
    settings = _settings(study, draws, resumed_seed(seed, keep), prior, name)
    request = AnalysisRequest(settings.sampler)
    jobs = [partial(_catch_failure, _drawn, subject, settings, request) for subject in study]
    faults = not_interpreted(study)
    study, analysed, failed = _survivors(study, jobs, settings.seed, workers, progress, keep)
    all_draws = Draws(subjects_tree(study, analysed, settings, failed, faults))
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
    jobs = _analysis_jobs(study, settings, AnalysisRequest(evidence_draws=draws))
    _, analysed, failed = _survivors(study, jobs, settings.seed, workers, progress, keep)
    return _table(analysed, settings, failed, study.task)


@dataclass(frozen=True, eq=False)
class _Analysed:
    """The row of one subject in the evidence table, with draws if they are wanted.

    `curve_draws`, shape (draws, k), are averaged over the four models; they are there if chains are
    wanted.
    """

    drawn: SubjectDraws | None
    evidence: SubjectEvidence
    curve_draws: FloatArray | None


def _analysis_jobs(
    study: Study, settings: Settings, request: AnalysisRequest
) -> list[Callable[[], _Analysed | Failed]]:
    jobs: list[Callable[[], _Analysed | Failed]] = []
    for subject, flags in zip(study, answer_flags(study), strict=True):
        jobs.append(partial(_catch_failure, _analysed, subject, settings, request, flags))
    return jobs


def _catch_failure(work: Callable[..., Result], *arguments: object) -> Result | Failed:
    """The work of a subject; a numerical failure is the refusal of that subject alone."""
    try:
        return work(*arguments)
    except NumericalError as error:
        return Failed(str(error))


def _drawn(subject: Subject, settings: Settings, request: AnalysisRequest) -> SubjectDraws:
    model = stored_model(settings.model, subject.task)
    target = model_posterior(model, subject, settings.prior)
    result, _ = fitted_result(target, settings.seed, request)
    return subject_draws(result)


def _analysed(
    subject: Subject, settings: Settings, request: AnalysisRequest, flags: tuple[Finding, ...]
) -> _Analysed:
    """The answer, and the paper's model with all that is wanted."""
    prior, seed = settings.prior.for_subjects(subject), settings.seed
    answer, order = answer_subject(subject, seed, settings.prior.observer, flags)
    result, fitted = fitted_result(paper_posterior(subject, prior), seed, request)
    row = subject_evidence(result, fitted, answer=answer, fit=result.fit)
    curve_draws, drawn = None, None
    if request.chains is not None:
        curve_draws = order.averaged().resampled(
            generator(seed, subject.name, "shown"), _N_CURVE_DRAWS
        )
    if result.chains is not None:
        drawn = subject_draws(result, summarised=True)
    return _Analysed(drawn, row, curve_draws)


def _settings(
    study: Study,
    draws: int,
    seed: int,
    prior: Prior | str | None,
    model: str = PAPER_MODEL,
) -> Settings:
    return Settings(seed, prior_for(study, prior), SamplerSettings(draws=draws), model)


def _table(
    analysed: Iterable[_Analysed], settings: Settings, failed: Mapping[str, str], task: Task
) -> EvidenceTable:
    rows = [result.evidence for result in analysed]
    judged = []
    for row in rows:
        answer = None if row.answer is None else row.answer.in_study(len(rows))
        judged.append(replace(row, answer=answer))
    return EvidenceTable(tuple(judged), settings.seed, settings.prior, failed, task)


def _survivors(
    study: Study,
    jobs: Sequence[Callable[[], Result | Failed]],
    seed: int,
    workers: Workers,
    progress: Progress | None,
    keep: StrPath | None,
) -> tuple[Study, list[Result], dict[str, str]]:
    """Do a job for each subject.

    The result has the subjects that did not fail, their results, and the reasons of the others by
    name. A WorkerError is raised if all failed.
    """
    results = run_stored(jobs, seed, keep, workers, progress, study.names)
    analysed, failed = without_failed(study.names, results)
    if failed:
        subjects = tuple(subject for subject in study if subject.name not in failed)
        study = replace(study, subjects=subjects)
    return study, analysed, failed
