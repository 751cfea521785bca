"""The verbs of a study: sample, evidence, or both; every subject goes through the one pipeline (:mod:`bayes_toe.inference.subject`).

All take the same options: seed, prior, draws, workers, progress, keep.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, cast

from bayes_toe.answers.contrast import ContrastTable, contrast
from bayes_toe.arrays import FloatArray
from bayes_toe.classical.fit import (
    REPLICATES,
    FitTable,
    SubjectFit,
    bootstrap_evidence,
    bootstrap_subject,
    subject_fit,
)
from bayes_toe.comparison.evidence_table import EvidenceTable, SubjectEvidence, subject_evidence
from bayes_toe.comparison.verdict import Doubt, Verdict, data_doubts, verdict
from bayes_toe.data.messages import as_html
from bayes_toe.data.study import Study, Subject, require_study
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.errors import ConvergenceWarning, WorkerError
from bayes_toe.inference.belonging import require_update
from bayes_toe.inference.draws import Draws
from bayes_toe.inference.draws_file import assembled_tree
from bayes_toe.inference.prediction import Predictor
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.inference.subject import (
    EVIDENCE_DRAWS,
    SUMMARY_COLUMNS,
    Settings,
    SubjectDraws,
    SummaryRow,
    Wanted,
    fitted_result,
    subject_draws,
    weighted_fit,
)
from bayes_toe.kept import Done, Kept, keeping
from bayes_toe.model.ladder import PREDICTIVE_UPDATE, models_of
from bayes_toe.model.models import model_posterior, require_model, stored_model
from bayes_toe.model.posterior_protocol import SampledPosterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.study_prior import prior_for
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers, run_in_order

if TYPE_CHECKING:
    import pandas as pd

Result = TypeVar("Result")
_SHOWN = 400  # draws of the best model, for its curve
_LEVEL = 0.9  # of the bootstrap intervals beside the posterior's 5 and 95 %


@dataclass(frozen=True, eq=False, repr=False)
class Analysis:
    """Draws of the paper's model, verdicts and evidence of one study, with the settings that made them, and the paper's fits.

    The study is without subjects that failed, see :attr:`bayes_toe.inference.draws.Draws.failed`.

    Attributes
    ----------
    best : tuple of Predictor
        Some draws of the model that describes a subject best, for those for whom that is not the paper's.
    contrast : ContrastTable or None
        What differs between conditions within subjects, where the study has conditions.
    """

    study: Study
    draws: Draws
    evidence: EvidenceTable
    settings: Settings
    fits: FitTable
    best: tuple[Predictor, ...] = ()
    summary_rows: tuple[SummaryRow, ...] = ()
    contrast: ContrastTable | None = None

    def __repr__(self) -> str:
        return f"<Analysis of {self.study!r}: verdicts, draws, evidence, fits, summary()>"

    def _repr_html_(self) -> str:
        return as_html(repr(self)[1:-1], self.evidence.frame())

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """What is concluded of every subject."""
        return self.evidence.verdicts

    def summary(self) -> pd.DataFrame:
        """The same as :meth:`bayes_toe.inference.draws.Draws.summary`, made already where the draws were."""
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
    keep: str | Path | None = None,
) -> Analysis:
    """Verdicts of every subject, draws under the predictive update (H1), and every evidence, in one pass.

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
        Processes, by default one per processor; or a client of a Dask cluster, whose workers take their place. The numbers do not depend on
        it.
    progress : callable, optional
        Called with a subject's name when that subject is done.
    keep : path, optional
        A folder in which every finished subject is kept, and from which it is taken where all that decides its numbers is the same: an
        interrupted call goes on where it was, to the same bits. Without a seed, that of what is kept is
        used.
    """
    with keeping(keep) as kept:
        settings = _settings(study, draws, kept.seed(seed), prior)
        wanted = Wanted(settings.sampler, EVIDENCE_DRAWS)
        jobs = [
            partial(_analysed, subject, settings, wanted, data)
            for subject, data in zip(study, data_doubts(study), strict=True)
        ]
        study, done, failed = _survivors(study, jobs, workers, progress, kept)
        drawn = Done(
            done.size, done.failed, lambda index: cast(SubjectDraws, done.read(index).drawn)
        )
        made = Draws(assembled_tree(study, drawn, settings, failed))
        small, summary = list[_Analysed](), list[SummaryRow]()
        for one in done:  # draws do not stay in memory
            summary += () if one.drawn is None else one.drawn.summary
            small.append(replace(one, drawn=None))
    fits = FitTable(
        tuple(one.fit for one in small if one.fit is not None),
        _LEVEL,
        REPLICATES,
        settings.seed,
        settings.prior,
        study.task,
    )
    by_name = {model.name: model for model in models_of(study.task).space}
    best = tuple(
        Predictor(
            by_name[one.evidence.verdict.best_model].posterior(
                study[one.evidence.subject], settings.prior
            ),
            one.best,
        )
        for one in small
        if one.best is not None and one.evidence.verdict is not None
    )
    apart = (
        None
        if study.conditions is None
        else contrast(study, seed=settings.seed, prior=settings.prior, workers=workers, keep=keep)
    )
    return Analysis(
        study,
        made,
        _table(small, settings, failed, study.task),
        settings,
        fits,
        best,
        tuple(summary),
        apart,
    )


def sample(
    study: Study,
    *,
    model: str = "paper",
    draws: int = 4000,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    keep: str | Path | None = None,
) -> Draws:
    """Posterior draws of every subject under a model.

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

    Warns
    -----
    ConvergenceWarning
        For subjects that missed the criteria, or a quantile of whom is not precise enough; they are marked in the result as well.

    Examples
    --------
    >>> from bayes_toe.data.study import Subject
    >>> one = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> found = sample(Study([one]), model="constant-error", draws=500, seed=1, workers=1)
    >>> found.model, found.parameters
    ('constant error', ('noise', 'q0', 'lapse_rate', 'noise_slope', 'criterion_slope', 'constant_error', 'jnd', 'zone'))
    """
    made = draw(
        study,
        model=model,
        draws=draws,
        seed=seed,
        prior=prior,
        workers=workers,
        progress=progress,
        keep=keep,
    )
    for what, of in (
        (" is left out, ", made.failed),
        (" did not converge: ", made.not_converged),
        (": ", made.imprecise),
    ):
        for name, reason in of.items():
            warnings.warn(f"subject {name!r}{what}{reason}", ConvergenceWarning, stacklevel=2)
    return made


def draw(
    study: Study,
    *,
    model: str = "paper",
    draws: int = 4000,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    keep: str | Path | None = None,
) -> Draws:
    """:func:`sample` without its warning, for callers that say themselves who did not converge."""
    require_study(study)
    name = require_model(model, study.task).name
    with keeping(keep) as kept:
        settings = _settings(study, draws, kept.seed(seed), prior, name)
        wanted = Wanted(settings.sampler)
        jobs = [partial(_drawn, subject, settings, wanted) for subject in study]
        study, done, failed = _survivors(study, jobs, workers, progress, kept)
        return Draws(assembled_tree(study, done, settings, failed))


def evidence(
    study: Study,
    *,
    draws: int = EVIDENCE_DRAWS,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    keep: str | Path | None = None,
) -> EvidenceTable:
    """Verdict of every subject, and the log evidence of the paper's model (H1) against free frequencies (H0).

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
    with keeping(keep) as kept:
        settings, wanted = (
            _settings(study, draws, kept.seed(seed), prior),
            Wanted(evidence_draws=draws),
        )
        jobs = [
            partial(_analysed, subject, settings, wanted, data)
            for subject, data in zip(study, data_doubts(study), strict=True)
        ]
        _, done, failed = _survivors(study, jobs, workers, progress, kept)
        return _table(done, settings, failed, study.task)


def smooth_curve_evidence(draws: Draws, *, workers: Workers = None) -> EvidenceTable:
    """Appendix C's evidence of subjects who have draws: H1 against free frequencies (H0), without rivals of H1 and without bootstrap.

    Study, prior and seed are those of the draws, and so the values are those of the :func:`run` that made them; no chain is run again.

    Raises
    ------
    InputError
        For draws of another model than the predictive update.
    """
    require_update(draws, "evidence of saved draws")
    study, prior, seed = draws.study, draws.prior, draws.seed
    wanted = Wanted(
        evidence_draws=max(EVIDENCE_DRAWS, draws.sampler.proposals)
    )  # by as many a run judges its proposal
    jobs = [
        partial(
            _against_frequencies,
            models_of(study.task).update.posterior(subject, prior),
            seed,
            wanted,
        )
        for subject in study
    ]
    rows = run_in_order(jobs, workers, None, [(name,) for name in study.names])
    return EvidenceTable(tuple(rows), seed, prior, task=study.task)


def _against_frequencies(target: SampledPosterior, seed: int, wanted: Wanted) -> SubjectEvidence:
    return subject_evidence(*fitted_result(target, seed, wanted), None)


@dataclass(frozen=True, eq=False)
class _Analysed:
    """One subject: the row of the evidence table; draws and, but for intervals, which it does not know, the fit, where asked for.

    `best`, shape (draws, k), are some of the best model's, where that is not the paper's.
    """

    drawn: SubjectDraws | None
    evidence: SubjectEvidence
    fit: SubjectFit | None
    best: FloatArray | None


def _drawn(subject: Subject, settings: Settings, wanted: Wanted) -> SubjectDraws:
    model = stored_model(settings.model, subject.task)
    target = model_posterior(model, subject, settings.prior)
    result, _ = fitted_result(target, settings.seed, wanted)
    return subject_draws(result)


def _analysed(
    subject: Subject, settings: Settings, wanted: Wanted, data: tuple[Doubt, ...]
) -> _Analysed:
    """The verdict, and the paper's model with all that is wanted."""
    prior, seed, models = settings.prior.at(subject), settings.seed, models_of(subject.task)
    said, space = verdict(subject, prior, seed, data=data)
    result, fitted = fitted_result(models.update.posterior(subject, prior), seed, wanted)
    fit, by_bootstrap = None, None
    if (
        subject.isi is None and wanted.chains is not None
    ):  # the maximum-likelihood fit knows no intervals
        fit = subject_fit(subject, prior, seed=seed)
    if subject.isi is None and subject.task == SAME_DIFFERENT:  # of the paper's task
        made = (
            bootstrap_subject(subject, seed=seed, prior=prior, replicates=REPLICATES)
            if fit is None
            else fit.bootstrap
        )
        by_bootstrap = bootstrap_evidence(made, prior)
    described = weighted_fit(fitted.proposal, seed) if result.fit is None else result.fit
    row = subject_evidence(
        result,
        fitted,
        by_bootstrap,
        orders=(space.value(models.symmetric), space.value(models.constant_bias)),
        verdict=said,
        fit=described,
    )
    best = None
    if wanted.chains is not None and said.best_model not in ("", models.update.name):
        best = space.predictor(
            said.best_model, _SHOWN, generator(seed, subject.name, said.best_model, "shown")
        ).x
    return _Analysed(
        None if result.chains is None else subject_draws(result, summarised=True),
        row,
        fit,
        best,
    )


def _settings(
    study: Study,
    draws: int,
    seed: int,
    prior: Prior | str | None,
    model: str = PREDICTIVE_UPDATE.name,
) -> Settings:
    return Settings(seed, prior_for(study, prior), SamplerSettings(draws=draws), model)


def _table(
    done: Iterable[_Analysed], settings: Settings, failed: Mapping[str, str], task: Task
) -> EvidenceTable:
    return EvidenceTable(
        tuple(one.evidence for one in done), settings.seed, settings.prior, failed, task
    )


def _survivors(
    study: Study,
    jobs: Sequence[Callable[[], Result]],
    workers: Workers,
    progress: Progress | None,
    kept: Kept,
) -> tuple[Study, Done[Result], dict[str, str]]:
    """Do a job for each subject: the subjects that did not fail, their results, and by name why others did."""
    done = kept.work(jobs, workers, progress, [(name,) for name in study.names])
    failed = {study.names[index]: one.reason for index, one in sorted(done.failed.items())}
    if len(failed) == len(study):
        raise WorkerError("\n".join(f"{name}: {reason}" for name, reason in failed.items()))
    return (
        (
            replace(study, subjects=tuple(one for one in study if one.name not in failed))
            if failed
            else study
        ),
        done,
        failed,
    )
