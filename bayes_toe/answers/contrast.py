"""Differences between the conditions of a subject in constant error, contraction and JND.

All conditions are fitted together (:mod:`bayes_toe.model.condition_model`), once for each of the
2^3 sets of quantities that may differ. The Bayes factor of a quantity is the mean evidence of the
sets in which the quantity differs, over the mean evidence of the other sets. The Bayes factor of
'order effect' compares three cases with no difference: constant error, contraction or both differ.
Each case has the weight 1/3. The size of a difference is the average over the sets in which the
quantity differs, weighted by their evidence.

The conditions may be tasks. Then one observer does all tasks, and :func:`one_observer` has the
evidences of all responses of a subject together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from bayes_toe.answers.order_effect import (
    ANSWER_COLUMNS,
    OrderEffect,
    Size,
    format_bayes_factor,
    format_difference,
    format_share,
    order_effect,
    word_of_bayes_factor,
)
from bayes_toe.answers.study_summary import count_words
from bayes_toe.answers.words import Word
from bayes_toe.arrays import NamedArrays, StrPath, Texts
from bayes_toe.checks.identification import identify
from bayes_toe.data.conditions import Conditions, StimulusScales
from bayes_toe.data.messages import capitalized, display_name, join_display_names, plural
from bayes_toe.data.stimulus_unit import UNKNOWN_UNIT, StimulusUnit
from bayes_toe.data.study import Study, Subject, require_study, units_by_subject
from bayes_toe.data.tables import Table, frame_of, write_table
from bayes_toe.data.tasks import Task
from bayes_toe.errors import InputError
from bayes_toe.inference.engine import (
    Precision,
    PriorMixture,
    fitted_draws,
    mixture_of_maxima,
)
from bayes_toe.inference.maxima import ascend_from
from bayes_toe.inference.model_set import ModelSet
from bayes_toe.inference.order_evidence import OrderEvidence, evidences_of
from bayes_toe.inference.searches import observer_maxima
from bayes_toe.model.condition_model import ConditionModels
from bayes_toe.model.parameters import (
    CONSTANT_ERROR,
    CONTRACTION,
    LAPSE_RATE,
    NOISE,
    PEAK,
    ObserverPrior,
)
from bayes_toe.model.posterior_array import PosteriorArray
from bayes_toe.model.prior import Prior
from bayes_toe.model.prior_file import prior_for
from bayes_toe.result_store import load_result, resumed_seed, run_stored
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers, try_each, without_failed

if TYPE_CHECKING:
    import pandas as pd


#: The models: the sets of parameters that differ in each, from () to all three.
CHOICES = tuple(
    chain.from_iterable(combinations((CONSTANT_ERROR, CONTRACTION, NOISE), n) for n in range(4))
)
ORDER_EFFECT = "order effect"
#: The quantities, each with the parameters of which at least one differs if the quantity differs.
QUANTITIES = {
    "constant error": {CONSTANT_ERROR},
    "contraction": {CONTRACTION},
    "JND": {NOISE},
    ORDER_EFFECT: {CONSTANT_ERROR, CONTRACTION},
}
#: What the words of a report mean.
LEGEND = (
    "The word says whether the quantity differs. 'Yes' needs a Bayes factor of at least 19, and "
    "'probably' needs at least 3. 'No' needs at most 1/19, and 'probably not' needs at most 1/3. "
    "'Order effect' is constant error, contraction or both. 'Depends on lapses' means that the "
    "word changes if the lapse rate may differ between conditions"
)


def observer_name(quantity: str) -> str:
    """The name that the observer has for a quantity: 'JND' -> 'jnd'."""
    return quantity.lower().replace(" ", "_")


class Difference(NamedTuple):
    """A quantity at one level of a condition minus the same quantity at another level.

    The names of the attributes are columns of contrast.csv.

    Attributes
    ----------
    subject, quantity, comparison : str
        As in 'S01', 'contraction', 'right - left'.
    mean, sd, q025, q05, q50, q95, q975 : float
        The difference, given that the quantity differs. The unit is natural-log intensity; the
        contraction has none. The order effect has the size of its change: the root mean square
        of the change of the shift over the first stimuli shown.
    p_direction : float or None
        Probability of the more probable sign; None for a size.
    log_bf_differs, log_bf_differs_se : float
        Natural log of the Bayes factor of a difference, between any levels, against no difference.
    robust : str
        'yes' if the word stays the same when the lapses may differ too.
    """

    subject: str
    quantity: str
    comparison: str
    mean: float
    sd: float
    q025: float
    q05: float
    q50: float
    q95: float
    q975: float
    p_direction: float | None
    log_bf_differs: float
    log_bf_differs_se: float
    robust: str

    @property
    def word(self) -> Word:
        """The word for the Bayes factor of a difference."""
        return word_of_bayes_factor(self.log_bf_differs)

    def interval(self, unit: StimulusUnit) -> Size:
        """The median and 95 % interval, in the unit of differences unless it is a contraction."""
        quantiles = Size(self.q025, self.q50, self.q975)
        if self.quantity == "contraction":
            return quantiles
        return Size(*unit.to_differences(quantiles).tolist())

    @property
    def factor(self) -> str:
        """The Bayes factor of a difference against no difference, in words."""
        return format_bayes_factor(self.log_bf_differs)

    def size(self, unit: StimulusUnit) -> str:
        """The median with its 95 % interval; only a difference with a direction has a sign.

        Examples
        --------
        >>> quantiles = {"q025": -0.0012, "q05": 0.001, "q50": 0.0104, "q95": 0.018, "q975": 0.019}
        >>> factor = {"log_bf_differs": 2.5, "log_bf_differs_se": 0.01, "robust": "yes"}
        >>> numbers = {"mean": 0.01, "sd": 0.01, "p_direction": 0.98, **quantiles, **factor}
        >>> Difference("S", "JND", "b - a", **numbers).size(StimulusUnit())
        '+1.0 % [-0.1, +1.9]'
        """
        if self.quantity == "contraction":
            return format_share(self.interval(unit), sign="+")
        sign = "" if self.p_direction is None else "+"
        # Differences in the unknown unit are per cents, which `format_difference` takes.
        return format_difference(self.interval(UNKNOWN_UNIT), unit, sign)


#: The columns of contrast.csv: 'robust', the last attribute, follows the word.
CONTRAST_COLUMNS = (*Difference._fields[:-1], "word", "robust", "model", "prior")


@dataclass(frozen=True, eq=False)
class ContrastTable(Table[Difference]):
    """The differences of every subject.

    Attributes
    ----------
    conditions : Conditions
    prior : ObserverPrior
    seed : int
    task : Task
        The task; of several tasks, a task that has a criterion.
    unit : StimulusUnit
        The unit in which differences are shown.
    left_out : dict of str to str
        Subjects who met no two levels that are compared, with the levels that they met.
    failed : dict of str to str
        Subjects whose work was lost, and why.
    answers : tuple of OrderEffect
        With several tasks, the order effect of each subject, if one observer does all tasks.
    """

    conditions: Conditions
    prior: ObserverPrior
    seed: int
    task: Task
    unit: StimulusUnit
    left_out: dict[str, str]
    failed: dict[str, str]
    answers: tuple[OrderEffect, ...]
    short_columns = ("subject", "quantity", "comparison", "q025", "q50", "q975", "word")

    def _full_frame(self) -> pd.DataFrame:
        """The table with the columns of contrast.csv."""
        frame = frame_of(self.rows, CONTRAST_COLUMNS[:-2])  # without model and prior
        return frame.assign(model="both", prior=self.prior.describe(self.task))

    @property
    def subjects(self) -> Texts:
        """The subjects that have a row."""
        return tuple(dict.fromkeys(row.subject for row in self.rows))

    @property
    def quantities(self) -> Texts:
        """The quantities of the rows, in their order in :data:`QUANTITIES`."""
        return tuple(QUANTITIES)

    def sentences(self) -> list[str]:
        """Sentences on the conditions, and in how many subjects each quantity differs."""
        lines = [f"Condition {self.conditions.about}."]
        for quantity in self.quantities:
            # All rows of a subject have the same word and Bayes factor: the last row suffices.
            rows = {row.subject: row for row in self.select(quantity)}.values()
            counts = count_words([row.word for row in rows], f" of {plural(len(rows), 'subject')}")
            # Only a study of several tasks has answers. It asks of all subjects together whether
            # the tasks share an observer.
            if self.answers:
                log_factor = sum(row.log_bf_differs for row in rows)
                counts += f"; product of the Bayes factors {format_bayes_factor(log_factor)}"
            lines.append(f"{capitalized(quantity)} differs: {counts}.")
        return lines

    def save_answers(self, path: StrPath, *, overwrite: bool = False) -> Path:
        """Write :attr:`answers` as a table with the first columns of evidence.csv."""
        import pandas as pd

        frame = pd.DataFrame([answer.cells for answer in self.answers], columns=ANSWER_COLUMNS)
        frame["prior"] = self.prior.describe(self.task)
        return write_table(frame, path, self.seed, overwrite=overwrite)

    def select(self, quantity: str, comparison: str | None = None) -> tuple[Difference, ...]:
        """The rows of a quantity, and of a comparison."""
        return tuple(
            row
            for row in self.rows
            if row.quantity == quantity and comparison in (None, row.comparison)
        )


def contrast(
    study: Study,
    *,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    keep: StrPath | None = None,
) -> ContrastTable:
    """Estimate the differences between the conditions of each subject.

    Parameters
    ----------
    study : Study
        Read with a condition, see :class:`bayes_toe.ReadOptions`.
    seed, prior, workers, progress, keep
        As in :func:`bayes_toe.run`. Differences follow the scales of the prior.

    Raises
    ------
    InputError
        If the study has no conditions, or no subject met two levels that are compared.
    WorkerError
        If the work of every subject was lost.
    """
    require_study(study, several_tasks=True)
    conditions = study.conditions
    if conditions is None:
        choices = "a column condition, or --condition COLUMN"
        if study.reading.pooled:
            choices += f", such as --condition {display_name(study.reading.pooled[0])}"
        raise InputError(f"{study.source}: found no condition within subjects, allowed: {choices}")

    compared, left_out = _compared_subjects(study, conditions)
    root = resumed_seed(seed, keep)
    observer_prior = prior_for(study, prior).observer
    contrasts_of_subject = partial(
        _contrasts, conditions=conditions, prior=observer_prior, seed=root
    )
    results = run_stored(
        partial(try_each, contrasts_of_subject),
        list(compared.values()),
        list(compared),
        seed=root,
        folder=keep,
        workers=workers,
        progress=progress,
    )
    contrasts, failed = without_failed(compared, results)
    rows = []
    answers = []
    for differences, answer in map(load_result, contrasts):
        rows += differences
        if answer is not None:
            answers.append(answer.in_study(len(compared)))
    return ContrastTable(
        tuple(rows),
        conditions,
        observer_prior,
        root,
        # A task with a criterion, if the study has it: the description of its prior is complete.
        task=max((unit.task for unit in study), key=lambda task: task.has_criterion),
        unit=study.unit,
        left_out=left_out,
        failed=failed,
        answers=tuple(answers),
    )


def _compared_subjects(
    study: Study, conditions: Conditions
) -> tuple[dict[str, tuple[Subject, ...]], dict[str, str]]:
    """The units of each subject who met two levels that are compared; why a subject is left out."""
    compared = {}
    left_out = {}
    for name, units in units_by_subject(study).items():
        levels = [unit.condition for unit in units]
        # A comparison is a pair of levels. The subject must have met both levels of one pair.
        if any(map(set(levels).issuperset, conditions.comparisons)):
            compared[name] = units
        else:
            left_out[name] = f"at {join_display_names(levels)} only"

    if not compared:
        pairs = [" and ".join(map(display_name, pair)) for pair in conditions.comparisons]
        raise InputError(
            f"contrast: found no subject at both {' or '.join(pairs)}, "
            "allowed: one and more; another --reference"
        )
    return compared, left_out


# --- One subject ---------------------------------------------------------------------------------


#: The differences of one subject, and with several tasks the answer of one observer.
SubjectContrasts: TypeAlias = tuple[list[Difference], OrderEffect | None]


def _contrasts(
    units: Sequence[Subject], conditions: Conditions, prior: ObserverPrior, seed: int
) -> SubjectContrasts:
    """The differences of one subject, and with several tasks an answer.

    The units of a subject are its answers in each condition.
    """
    answer = None
    if len({unit.task for unit in units}) > 1:
        # What one task can show, one observer of all tasks can show. So the questions that can be
        # told are those of the task that has the fewest reasons against them.
        identification = min(map(identify, units), key=lambda design: len(design.reasons))
        answer = order_effect(one_observer(units, prior, seed), identification)
    return subject_contrast(units, conditions, prior, seed), answer


def one_observer(units: Sequence[Subject], prior: ObserverPrior, seed: int) -> OrderEvidence:
    """The evidences of a subject's four models, if one observer does the tasks of all units.

    A NumericalError is raised if an evidence is not a finite number.
    """
    # Without columns in the design nothing differs between the units.
    models = ConditionModels(tuple(units), np.zeros((len(units), 0)), prior)
    (evidence,) = evidences_of(models.posteriors_without_differences, [models.subject], seed, prior)
    return evidence.checked()


def subject_contrast(
    units: Sequence[Subject], conditions: Conditions, prior: ObserverPrior, seed: int
) -> list[Difference]:
    """The differences of one subject: a row for each quantity and comparison of two conditions.

    `conditions` are those of the study, of which the subject may have met only some.
    """
    name = units[0].subject_name
    levels = tuple(unit.condition for unit in units)
    models = ConditionModels(tuple(units), conditions.design(levels), prior)
    same_lapses, free_lapses = condition_evidences(models, seed)
    rng = generator(seed, name, "differences")

    rows = []
    for quantity, parameters in QUANTITIES.items():
        # Whether the quantity differs, for each model, shape (models,).
        differs = np.array([not parameters.isdisjoint(choice) for choice in CHOICES])
        log_bf = same_lapses.log_bayes_factor(differs)
        error = same_lapses.bayes_factor_error(differs)
        word_with_free_lapses = word_of_bayes_factor(free_lapses.log_bayes_factor(differs))
        robust = "yes" if word_of_bayes_factor(log_bf) is word_with_free_lapses else "no"

        # Draws of equal weight from the models in which the quantity differs.
        draws = same_lapses.averaged(differs).resampled(rng, size=4000)
        values = models.quantities(draws)  # (conditions, draws) each
        for level, reference in conditions.comparisons:
            if level not in levels or reference not in levels:
                continue
            i = levels.index(level)
            j = levels.index(reference)
            changes = {key: at_levels[i] - at_levels[j] for key, at_levels in values.items()}
            summary = _summary(quantity, changes, models.shared_observer.scales)
            comparison = f"{level} - {reference}"
            row = (name, quantity, comparison, *summary, log_bf, error, robust)
            rows.append(Difference._make(row))
    return rows


def _summary(quantity: str, changes: NamedArrays, scales: StimulusScales) -> tuple[Any, ...]:
    """Mean, standard deviation, quantiles and direction of a difference between two conditions.

    `changes` has draws of the change of each quantity of the observer, shape (draws,). The result
    has the entries of :class:`Difference` from `mean` to `p_direction`.
    """
    if quantity == ORDER_EFFECT:
        # The root mean square over the first stimuli of the change of the shift, c - p (s1 - sbar):
        # the root of the squared change of c, plus the squared change of p times the spread of s1.
        contraction_shift = changes["contraction"] * scales.first_spread
        difference = np.hypot(changes["constant_error"], contraction_shift)
        p_direction = None  # a size has no direction
    else:
        difference = changes[observer_name(quantity)]
        # The probability of the more probable sign.
        p_direction = float(max(np.mean(difference > 0.0), np.mean(difference < 0.0)))

    quantiles = np.quantile(difference, [0.025, 0.05, 0.5, 0.95, 0.975]).tolist()
    return float(difference.mean()), float(difference.std(ddof=1)), *quantiles, p_direction


def condition_evidences(models: ConditionModels, seed: int) -> tuple[ModelSet, ModelSet]:
    """Evidences and draws of the models of :data:`CHOICES`, in two sets.

    In the models of the second set, the lapses differ too: the lapse rate and, in 'same or
    different', the peak.
    """
    lapses = [
        parameter for parameter in (PEAK, LAPSE_RATE) if parameter in models.differing_parameters
    ]
    # A choice has the parameters that differ. First come CHOICES, then the choices with lapses.
    choices_with_lapses = [(*choice, *lapses) for choice in CHOICES]
    all_choices = [*CHOICES, *choices_with_lapses]
    posteriors = models.posteriors(all_choices)  # one for each choice
    generators = []
    for choice in all_choices:
        names = [parameter.name for parameter in choice]
        generators.append(generator(seed, models.subject.name, "contrast", *names))

    # More draws than usual, because intervals of differences come from them too.
    precision = Precision(effective_draws=1000.0, most_draws=12_000, pool_rounds=4)
    _, draws = fitted_draws(posteriors, _mixtures(posteriors), generators, precision)

    n = len(CHOICES)
    prior_probabilities = np.full(n, 1.0 / n)
    return (
        ModelSet.from_draws(draws[:n], prior_probabilities),
        ModelSet.from_draws(draws[n:], prior_probabilities),
    )


def _mixtures(posteriors: PosteriorArray) -> list[PriorMixture]:
    """The mixture that proposes the draws of each model, made from the maxima of its posterior.

    All searches start at the maxima of the first model, in which nothing differs. They do not start
    at maxima that are 10 nats below the best maximum, whose weight is below exp(-10).
    """
    (maxima,) = observer_maxima(posteriors.part(np.array([0])))
    starts = maxima.x[maxima.value > maxima.value.max() - 10.0]  # (starts, coordinates)
    n_models = len(posteriors)
    owners = np.repeat(np.arange(n_models), len(starts))  # the model of each search
    searches = ascend_from(posteriors, owners, np.tile(starts, (n_models, 1)))
    return [
        mixture_of_maxima(searches.part(owners == i), posteriors.is_free[i])
        for i in range(n_models)
    ]
