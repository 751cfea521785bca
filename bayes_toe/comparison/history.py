"""Do answers depend on the trials before? Histories of a few good compositions of one subject, tried against none.

A history is tried with the three compositions of the default space that describe the subject best with all expectations relaxed, and with
the best that has a pull, without which no expectation has an effect. Every level of the part is equally probable beforehand, and within a
level every composition; 'by time' is one where the times between trials are known. The answer before is asked of 'which is stronger?'
alone, as a part by itself.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import logsumexp, softmax

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.words import PROBABLY_NONE, compared, side
from bayes_toe.data.messages import counted, listed
from bayes_toe.data.study import Study, Subject, require_study
from bayes_toe.data.tables import SubjectTable, frame_of
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.inference.prediction import Predictor
from bayes_toe.inference.predictive_checks import HISTORY_DRAWS, history_p
from bayes_toe.inference.space import SpaceEvidence, space_evidence
from bayes_toe.kept import keeping
from bayes_toe.model.ladder import models_of, posterior_of
from bayes_toe.model.parts import compose
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.record import Model
from bayes_toe.model.study_prior import prior_for
from bayes_toe.model.trial_history import require_order
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers

if TYPE_CHECKING:
    import pandas as pd

#: Columns of history.csv.
HISTORY_COLUMNS = (
    *(
        "subject",
        "depends",
        "p_static",
        "p_carry_over",
        "p_carry_over_by_time",
        "p_running_average",
        "log_bayes_factor_history",
    ),
    *(
        "log_bayes_factor_previous_answer",
        "lead",
        "best_model",
        "static_model",
        "parameter",
        "q05",
        "q50",
        "q95",
    ),
    *("history_p_static", "history_p", "note"),
)
_TRIED, _SHOWN = 3, 400  # compositions; draws that figures get
#: What the histories' own quantities are called in figures and sentences.
QUANTITIES = {
    "carry_over": "carried over, share",
    "carry_over_tau": "carried over, time constant in s",
    "half_life": "half-life, trials",
}
_STATIC, _BIAS = "static", {"answer bias": "previous answer"}


@dataclass(frozen=True, eq=False)
class SubjectHistory:
    """What is concluded of one subject; columns of history.csv are attributes.

    Attributes
    ----------
    subject : str
    p_static, p_carry_over, p_carry_over_by_time, p_running_average : float or None
        Posterior probabilities of the levels of the part within the compositions that have a pull; None of a level that was not tried.
    log_bayes_factor_history : float
        Natural log of the evidence of any history over that of none, within the same.
    log_bayes_factor_previous_answer : float or None
        Of a bias by the answer before over none, within the compositions tried; None of 'same or different?'.
    lead : float
        Log evidence of the best model with a history of stimuli over the best without, whether that has a pull or not, nats.
    best_model, static_model : str
        The best model with a history of stimuli, and the best without.
    parameter : str
        The history's own: carry_over (rho), carry_over_tau (s) or half_life (trials).
    q05, q50, q95 : float
        Its posterior quantiles.
    history_p_static, history_p : float
        :func:`history_p` of the static model and of the best one.
    note : str
        What is withheld.
    shown : tuple of array, shape (draws, k)
        Some draws of both, the static model's first, unconstrained.
    pulled : bool
        Whether the static model has a pull.
    """

    subject: str
    p_static: float | None = None
    p_carry_over: float | None = None
    p_carry_over_by_time: float | None = None
    p_running_average: float | None = None
    log_bayes_factor_history: float = np.nan
    log_bayes_factor_previous_answer: float | None = None
    lead: float = np.nan
    best_model: str = ""
    static_model: str = ""
    parameter: str = ""
    q05: float = np.nan
    q50: float = np.nan
    q95: float = np.nan
    history_p_static: float = np.nan
    history_p: float = np.nan
    note: str = ""
    shown: tuple[FloatArray, ...] = ()
    pulled: bool = True

    @property
    def depends(self) -> str:
        """Whether the expectation follows the trials before: yes, probably, undecided, probably not, no; 'no pull' where none is likelier.

        Without a pull no expectation has an effect, so that its history cannot be told.
        """
        p = self.p_static
        if p is None:
            return ""
        if not self.pulled and self.lead <= 0.0 and p <= PROBABLY_NONE:
            return "no pull"
        said = {
            "has": "yes",
            "probably has": "probably",
            "undecided": "undecided",
            "probably none": "probably not",
            "none": "no",
        }
        return said[side(p)]

    def describe(self) -> str:
        """The same in a sentence without the subject's name."""
        said = {
            "yes": "answers follow the trials before",
            "probably": "answers probably follow the trials before",
            "undecided": "whether answers follow the trials before is undecided",
            "probably not": "answers probably do not follow the trials before",
            "no": "answers do not follow the trials before",
            "no pull": "no pull, hence no history to be told",
            "": f"no probability: {self.note}",
        }[self.depends]
        if self.p_static is None or self.depends == "no pull":
            return said
        what = f"{QUANTITIES[self.parameter]}: {self.q50:.2g} ({self.q05:.2g} to {self.q95:.2g})"
        static, best = (
            compared(p).removeprefix("= ") for p in (self.history_p_static, self.history_p)
        )
        fits = f"; p of the answers by trial before {static} static, {best} with it"
        return f"{said} (P of a history {compared(1.0 - self.p_static)}; {what}{fits})"


@dataclass(frozen=True, eq=False)
class HistoryTable(SubjectTable[SubjectHistory]):
    """Every subject's row, with the study, seed and prior."""

    study: Study
    seed: int
    prior: Prior

    def predictors(self, row: SubjectHistory) -> tuple[Predictor, Predictor]:
        """Some draws of a subject's best model without and with a history."""
        names = (row.static_model, row.best_model)
        found = [posterior_of(self.study[row.subject], self.prior, model=name) for name in names]
        static, best = (
            Predictor(one, x)
            for one, x in zip(found, row.shown, strict=True)
            if isinstance(one, Posterior)
        )
        return static, best

    def sentence(self) -> str:
        """How many subjects' answers follow the trials before, and the evidence in sum."""
        counts = Counter(row.depends or "no result" for row in self.rows)
        words = ("yes", "probably", "undecided", "probably not", "no", "no pull", "no result")
        said = listed([f"{word} {counts[word]}" for word in words if counts[word]])
        total = np.nansum([row.log_bayes_factor_history for row in self.rows])
        found = f"{said}; log Bayes factor of a history {total:+.1f} in sum"
        told = [
            require_order(self.study[row.subject]) for row in self.rows
        ]  # others of the study may have no order
        if all(one.iti is None and one.begins.sum() == 1 for one in told):
            found += "; no column session, block or iti tells of pauses, so trials are taken to follow each other without any"
        return f"answers follow them, of {counted(len(self.rows), 'subject')}: {found}"

    def frame(self) -> pd.DataFrame:
        """The table with the columns of history.csv; natural logs, empty where a value does not exist."""
        return frame_of(self.rows, HISTORY_COLUMNS)


def compare_history(
    study: Study,
    *,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    keep: str | Path | None = None,
) -> HistoryTable:
    """Whether what was felt in a trial, or answered, has an effect on the next, for every subject.

    Parameters
    ----------
    study : Study
        Of trials whose order is known.
    seed, prior, workers, progress, keep
        As in :func:`bayes_toe.analysis.evidence`.

    Raises
    ------
    InputError
        If the order of a subject's trials is not known.
    """
    require_study(study)
    for subject in study:
        require_order(subject)
    with keeping(keep, "histories of subjects") as kept:
        chosen, root = prior_for(study, prior), kept.seed(seed)
        jobs = [partial(_tried, subject, chosen, root) for subject in study]
        done = kept.work(jobs, workers, progress, [(name,) for name in study.names])
        rows = [
            SubjectHistory(name, note=done.failed[i].reason) if i in done.failed else done.read(i)
            for i, name in enumerate(study.names)
        ]
    return HistoryTable(tuple(rows), study, root, chosen)


def _tried(subject: Subject, prior: Prior, seed: int) -> SubjectHistory:
    return subject_history(
        space_evidence(subject, prior, models_of(subject.task).space, seed), seed
    )


def subject_history(found: SpaceEvidence, seed: int) -> SubjectHistory:
    """The histories of one subject of whom the space of the task is known, which says with what compositions they are tried."""
    subject, static = found.subject, _likeliest(found)
    of_levels = _with_histories(subject, static)
    flexible = [
        model for level, models in of_levels.items() if level != _STATIC for model in models
    ]
    biased = [_with(model, **_BIAS) for model in static] if subject.task == WHICH_STRONGER else []
    tried = space_evidence(subject, found.prior, [*static, *flexible, *biased], seed)
    if np.isnan(tried.log_evidence).any():
        missing = [
            model.name
            for model, value in zip(tried.models, tried.log_evidence, strict=True)
            if np.isnan(value)
        ]
        return SubjectHistory(subject.name, note=f"no evidence of {', '.join(missing)}")
    log_evidence = dict(zip(tried.models, tried.log_evidence.tolist(), strict=True))

    def mean(models: Sequence[Model]) -> float:
        """Log of the mean evidence."""
        return float(logsumexp([log_evidence[model] for model in models]) - np.log(len(models)))

    means = [mean(models) for models in of_levels.values()]
    p = dict(zip(of_levels, softmax(means).tolist(), strict=True))
    plain, best = (max(models, key=log_evidence.__getitem__) for models in (static, flexible))
    drawn = [_drawn(tried, model, seed) for model in (plain, best)]
    quantity = drawn[1].target.names.natural[-1]
    q05, q50, q95 = np.quantile(
        drawn[1].target.quantities(drawn[1].x)[quantity], [0.05, 0.5, 0.95]
    ).tolist()
    p_static_fit, p_fit = (history_p(one.target, one.x, seed) for one in drawn)
    return SubjectHistory(
        subject.name,
        p[_STATIC],
        p["carry-over"],
        p.get("carry-over by time"),
        p["running average"],
        mean(flexible) - means[0],
        mean(biased) - mean(static) if biased else None,
        log_evidence[best] - log_evidence[plain],
        best.name,
        plain.name,
        *(quantity, q05, q50, q95),
        *(p_static_fit, p_fit),
        shown=tuple(one.x[:_SHOWN] for one in drawn),
        pulled=plain.pull is not None,
    )


def _likeliest(found: SpaceEvidence) -> list[Model]:
    """The compositions that describe a subject best, the best that has a pull among them."""
    values = found.log_evidence
    order = [found.models[i] for i in np.argsort(-np.where(np.isnan(values), -np.inf, values))]
    best = order[:_TRIED]
    if all(model.pull is None for model in best):
        best.append(next(model for model in order if model.pull is not None))
    return best


def _with_histories(subject: Subject, static: Sequence[Model]) -> dict[str, list[Model]]:
    """Those that have a pull, with every level of the part: none, and what is known enough to be tried."""
    answers, pulled = require_order(subject), [model for model in static if model.pull is not None]
    timed = answers.iti is not None and bool(np.isfinite(answers.iti[~answers.begins]).any())
    levels = ("carry-over", *(["carry-over by time"] if timed else []), "running average")
    return {
        _STATIC: pulled,
        **{level: [_with(model, history=level) for model in pulled] for level in levels},
    }


def _with(model: Model, **levels: str) -> Model:
    """The same composition with other levels of some parts."""
    return compose(model.task, **{**dict(model.levels), **levels})


def _drawn(found: SpaceEvidence, model: Model, seed: int) -> Predictor:
    """Equally weighted posterior draws of a model; sampled anew where its evidence was Laplace's."""
    subject, sampled = found.subject, found.models.index(model) in found.sampled
    known = found if sampled else space_evidence(subject, found.prior, [model], seed)
    return known.predictor(
        model.name, HISTORY_DRAWS, generator(seed, subject.name, model.name, "history draws")
    )
