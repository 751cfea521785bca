"""Differences between the conditions of a subject in constant error, contraction and JND.

All conditions are fitted together (:mod:`bayes_toe.model.condition_model`), once for each of the
2^3 sets of quantities that may differ. The Bayes factor of a quantity is that of inclusion: the
mean evidence of the sets in which it differs over that of the others. The Bayes factor of 'order
effect' compares three cases with none: constant error, contraction or both differ. Each case has
the weight 1/3. The size of a difference is the average over the sets in which the quantity differs,
weighted by their evidence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, combinations
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from scipy.special import logsumexp, softmax

from bayes_toe.answers.order_effect import (
    Size,
    format_bayes_factor,
    format_difference,
    format_share,
)
from bayes_toe.answers.study_summary import count_words
from bayes_toe.answers.words import Word
from bayes_toe.arrays import FloatArray, NamedArrays, Rng, StrPath
from bayes_toe.data.conditions import Conditions
from bayes_toe.data.messages import capitalized, display_name, join_names, plural
from bayes_toe.data.stimulus_unit import UNKNOWN_UNIT, StimulusUnit
from bayes_toe.data.study import Study, Subject, require_study, units_by_subject
from bayes_toe.data.tables import Table, frame_of
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.errors import InputError, WorkerError
from bayes_toe.inference.adaptation import quick_proposal, with_trusted_draws
from bayes_toe.inference.evidence import importance_evidence
from bayes_toe.inference.maxima import Maxima, find_maxima
from bayes_toe.inference.proposal import WeightedDraws
from bayes_toe.model.condition_model import ConditionPosterior
from bayes_toe.model.observer import OrderModel
from bayes_toe.model.parameters import (
    CONSTANT_ERROR,
    CONTRACTION,
    LAPSE_RATE,
    NOISE,
    PEAK,
    ObserverPrior,
    Parameter,
)
from bayes_toe.model.prior import Prior
from bayes_toe.model.prior_file import prior_for
from bayes_toe.result_store import open_store
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers

if TYPE_CHECKING:
    import pandas as pd

    from bayes_toe.model.posterior import SampledPosterior

#: The quantities by name, each with the parameter that differs, and the quantity of the observer.
QUANTITIES: Mapping[str, tuple[Parameter, str]] = {
    "constant error": (CONSTANT_ERROR, "constant_error"),
    "contraction": (CONTRACTION, "contraction"),
    "JND": (NOISE, "jnd"),
}
ORDER_EFFECT = "order effect"
_PARAMETERS_OF: Mapping[str, frozenset[Parameter]] = {
    **{name: frozenset([parameter]) for name, (parameter, _) in QUANTITIES.items()},
    ORDER_EFFECT: frozenset([CONSTANT_ERROR, CONTRACTION]),
}
#: Bayes factors from which a difference, or none, is probable, and from which it is stated.
PROBABLY, SURELY = 3.0, 20.0
WORDS = (
    "differs",
    "probably differs",
    str(Word.UNDECIDED),
    "probably no difference",
    "no difference",
)
#: The words of screens for them.
_SHORT_WORDS = tuple(map(str, Word))[: len(WORDS)]
CONTRAST_COLUMNS = (
    *("subject", "quantity", "comparison", "mean", "sd", "q025", "q05", "q50", "q95", "q975"),
    *("p_direction", "log_bf_differs", "log_bf_differs_se", "word", "robust", "model", "prior"),
)
#: What the words mean.
LEGEND = (
    f"'Differs' needs a Bayes factor of at least {SURELY:g}, 'probably differs' of at least "
    f"{PROBABLY:g}; 'no difference' and 'probably no difference' need at most 1/{SURELY:g} and "
    f"1/{PROBABLY:g}. 'Order effect' is constant error, contraction or both. 'Depends on "
    "lapses' means that the word changes if the lapse rate may differ between conditions"
)
_PROBABILITIES = (0.025, 0.05, 0.5, 0.95, 0.975)
_FAR = 10.0  # nats below the best maximum from which on others are left out
_CLOUD = 400  # draws about the maxima with which a proposal begins
_LEAST_CURVATURE = 0.2  # of these draws, in units of the prior
_DRAWS, _CURVES = 4000, 400  # of a difference, and for curves


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
    log_bf_differs, log_bf_differs_se : float or None
        Natural log of the Bayes factor of a difference, between any levels, against none.
    robust : str
        'yes' if the word stays the same when the lapses may differ too; empty if that is not
        known.
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
    log_bf_differs: float | None
    log_bf_differs_se: float | None
    robust: str

    @property
    def word(self) -> str:
        """One of :data:`WORDS`; empty where there is no Bayes factor."""
        return word_of(self.log_bf_differs)

    @property
    def short_word(self) -> str:
        """The word of screens; empty where there is no Bayes factor."""
        return _SHORT_WORDS[WORDS.index(self.word)] if self.word else ""

    @property
    def has_unit(self) -> bool:
        """Whether the quantity is an intensity."""
        return self.quantity != "contraction"

    def interval(self, unit: StimulusUnit) -> Size:
        """The median and 95 % interval; those of an intensity in the unit of differences."""
        quantiles = [self.q025, self.q50, self.q975]
        if self.has_unit:
            quantiles = unit.differences(quantiles).tolist()
        return Size(*quantiles)

    @property
    def factor(self) -> str:
        """The Bayes factor of a difference against none, in words."""
        return "-" if self.log_bf_differs is None else format_bayes_factor(self.log_bf_differs)

    def size(self, unit: StimulusUnit) -> str:
        """The median with its 95 % interval; only a difference with a direction has a sign.

        Examples
        --------
        >>> ends = (-0.0012, 0.001, 0.0104, 0.018, 0.019)
        >>> row = Difference("S", "JND", "b - a", 0.01, 0.01, *ends, 0.98, 2.5, 0.01, "yes")
        >>> row.size(StimulusUnit())
        '+1.0 % [-0.1, +1.9]'
        """
        if not self.has_unit:
            return format_share(self.interval(unit), "+")
        text = format_difference(self.interval(StimulusUnit()), unit)
        return text.replace("+", "") if self.p_direction is None else text


def word_of(log_bf: float | None) -> str:
    """The word for a log Bayes factor of a difference.

    Examples
    --------
    >>> [word_of(value) for value in (3.1, 1.2, 0.0, -1.2, -3.1, None)]
    ['differs', 'probably differs', 'undecided', 'probably no difference', 'no difference', '']
    """
    if log_bf is None:
        return ""
    limits = np.log([SURELY, PROBABLY, 1.0 / PROBABLY, 1.0 / SURELY])
    return WORDS[int((log_bf < limits).sum())]


@dataclass(frozen=True, eq=False)
class SubjectContrast:
    """The differences of one subject, its conditions, and equally weighted draws.

    `x` has the coordinates of the observer 'both' in each condition, (conditions, draws, k), over
    all sets of what differs.
    """

    subject: str
    rows: tuple[Difference, ...]
    levels: tuple[str, ...]
    x: FloatArray
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class ContrastTable(Table[Difference]):
    """The differences of every subject.

    Attributes
    ----------
    subjects : tuple of SubjectContrast
    conditions : Conditions
    prior : ObserverPrior
    seed : int
    task : Task
    unit : StimulusUnit
        The unit in which differences are shown.
    left_out : dict of str to str
        Subjects who met no two levels that are compared, and which ones they met.
    failed : dict of str to str
        Subjects whose work was lost, and why.
    """

    subjects: tuple[SubjectContrast, ...]
    conditions: Conditions
    prior: ObserverPrior
    seed: int
    task: Task = SAME_DIFFERENT
    unit: StimulusUnit = UNKNOWN_UNIT
    left_out: dict[str, str] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    short_columns = ("subject", "quantity", "comparison", "q025", "q50", "q975", "word")

    def _full_frame(self) -> pd.DataFrame:
        """The table with the columns of contrast.csv."""
        frame = frame_of(self.rows, CONTRAST_COLUMNS[:-2])
        prior = OrderModel("both").describe(self.prior, self.task)
        return frame.assign(model="both", prior=prior)

    @property
    def quantities(self) -> tuple[str, ...]:
        """The quantities, in order."""
        return tuple(_PARAMETERS_OF)

    def sentences(self) -> list[str]:
        """The conditions, and in how many subjects each quantity differs; each counts once."""
        column, _, levels = self.conditions.about.partition(": ")
        lines = [f"Condition {column}: {levels}."]
        for quantity in self.quantities:
            first: dict[str, str] = {}
            for row in self.select(quantity):
                first.setdefault(row.subject, row.short_word or "no Bayes factor")
            counts = count_words(first.values(), f" of {plural(len(first), 'subject')}")
            lines.append(f"{capitalized(quantity)} differs: {counts}.")
        return lines

    def select(self, quantity: str, comparison: str | None = None) -> tuple[Difference, ...]:
        """The rows of a quantity, and of a comparison."""
        rows = [row for row in self.rows if row.quantity == quantity]
        return tuple(row for row in rows if comparison in (None, row.comparison))


def contrast(
    study: Study,
    *,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    keep: StrPath | None = None,
) -> ContrastTable:
    """Differences between the conditions of each subject, and their sizes.

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
    require_study(study)
    conditions = _require_conditions(study)
    compared = _compared_subjects(study, conditions)
    left_out = {}
    for name, units in units_by_subject(study).items():
        if name not in compared:
            levels = join_names([display_name(unit.condition) for unit in units])
            left_out[name] = f"at {levels} only"
    with open_store(keep) as store:
        root, numbers = store.seed(seed), prior_for(study, prior).observer
        jobs = [
            partial(subject_contrast, units, conditions, numbers, root)
            for units in compared.values()
        ]
        results = store.work(jobs, workers, progress, [(name,) for name in compared])
        subjects = tuple(results)
    names = list(compared)
    failed = {names[i]: failure.reason for i, failure in sorted(results.failed.items())}
    if not subjects:
        raise WorkerError("\n".join(f"{name}: {reason}" for name, reason in failed.items()))
    rows = tuple(chain.from_iterable(subject.rows for subject in subjects))
    return ContrastTable(
        rows,
        subjects,
        conditions,
        numbers,
        root,
        task=study.task,
        unit=study.unit,
        left_out=left_out,
        failed=failed,
    )


def _require_conditions(study: Study) -> Conditions:
    """The conditions of a study; an InputError where it has none."""
    if study.conditions is not None:
        return study.conditions
    choices = "a column condition, or --condition COLUMN"
    if len(study.intervals) > 1:
        choices += "; --condition isi compares the intervals"
    raise InputError(f"{study.source}: found no condition within subjects, allowed: {choices}")


def _compared_subjects(study: Study, conditions: Conditions) -> dict[str, tuple[Subject, ...]]:
    """The units of each subject who met two levels that are compared."""
    compared = {}
    for name, units in units_by_subject(study).items():
        levels = {unit.condition for unit in units}
        if any(levels.issuperset(pair) for pair in conditions.comparisons):
            compared[name] = units
    if not compared:
        pairs = []
        for level, other in conditions.comparisons:
            pairs.append(f"{display_name(level)} and {display_name(other)}")
        raise InputError(
            f"contrast: found no subject at both {' or '.join(pairs)}, "
            "allowed: one and more; another --reference"
        )
    return compared


# --- One subject ---------------------------------------------------------------------------------


class ConditionEvidence(NamedTuple):
    """One set of what differs: log evidence, NaN where it is withheld, its error, and draws."""

    differing: frozenset[Parameter]
    posterior: ConditionPosterior
    log_evidence: float
    se: float
    draws: WeightedDraws


def subject_contrast(
    units: Sequence[Subject], conditions: Conditions, prior: ObserverPrior, seed: int
) -> SubjectContrast:
    """The differences of one subject between its conditions.

    Random streams are keyed by seed, subject and what differs.
    """
    name = units[0].subject_name
    levels = tuple(unit.condition for unit in units)
    pooled = ConditionPosterior(tuple(units), conditions.design(levels), (), prior)
    evidences, with_lapses = condition_evidences(pooled, seed)
    rng = generator(seed, name, "differences")

    rows = []
    for quantity, parameters in _PARAMETERS_OF.items():
        log_bf, se = log_bayes_factor(evidences, parameters)
        answer = log_bf, se, _robust(log_bf, log_bayes_factor(with_lapses, parameters)[0])
        differing = [evidence for evidence in evidences if evidence.differing & parameters]
        values = pooled.shared.quantities(_draws(differing, rng, _DRAWS))
        for level, reference in conditions.comparisons:
            if level in levels and reference in levels:
                pair = levels.index(level), levels.index(reference)
                summary = _difference(quantity, values, pair, pooled)
                comparison = f"{level} - {reference}"
                rows.append(Difference._make((name, quantity, comparison, *summary, *answer)))

    withheld = []
    for evidence in evidences:
        if np.isnan(evidence.log_evidence):
            names = sorted(parameter.name for parameter in evidence.differing)
            withheld.append(f"no evidence where these differ: {join_names(names) or 'none'}")
    x = _draws(evidences, rng, _CURVES)
    return SubjectContrast(name, tuple(rows), levels, x, tuple(withheld))


def _difference(
    quantity: str,
    values: NamedArrays,
    pair: tuple[int, int],
    pooled: ConditionPosterior,
) -> tuple[Any, ...]:
    """Mean, standard deviation, quantiles and direction of a difference between two conditions."""
    level, reference = pair
    change = {key: draws[level] - draws[reference] for key, draws in values.items()}
    p_direction = None
    if quantity == ORDER_EFFECT:
        # The shift is c - p (s1 - sbar).
        of_contraction = change["contraction"] * pooled.shared.scales.first_spread
        difference = np.hypot(change["constant_error"], of_contraction)
    else:
        difference = change[QUANTITIES[quantity][1]]
        p_direction = float(max(np.mean(difference > 0.0), np.mean(difference < 0.0)))
    quantiles = np.quantile(difference, _PROBABILITIES).tolist()
    return float(difference.mean()), float(difference.std(ddof=1)), *quantiles, p_direction


def _robust(log_bf: float | None, log_bf_with_lapses: float | None) -> str:
    """Whether lapses that differ too leave the word as it is."""
    if log_bf is None or log_bf_with_lapses is None:
        return ""
    return "yes" if word_of(log_bf) == word_of(log_bf_with_lapses) else "no"


def condition_evidences(
    pooled: ConditionPosterior, seed: int
) -> tuple[list[ConditionEvidence], list[ConditionEvidence]]:
    """Evidence and draws of each set of quantities that may differ, from the pooled posterior.

    And the same where the lapse rate and, of same or different, the peak differ too.
    """
    maxima = find_maxima(cast("SampledPosterior", pooled))
    starts = maxima.x[maxima.value > maxima.value[0] - _FAR]
    lapses = [parameter for parameter in pooled.parameters if parameter in (LAPSE_RATE, PEAK)]
    compared = [parameter for parameter, _ in QUANTITIES.values()]
    evidences, with_lapses = [], []
    for size in range(len(compared) + 1):
        for differing in combinations(compared, size):
            key = frozenset(differing)
            posterior = replace(pooled, differing=differing)
            evidences.append(_evidence(key, posterior, starts, seed))
            posterior = replace(pooled, differing=(*differing, *lapses))
            with_lapses.append(_evidence(key, posterior, starts, seed))
    return evidences, with_lapses


def _evidence(
    differing: frozenset[Parameter], posterior: ConditionPosterior, starts: FloatArray, seed: int
) -> ConditionEvidence:
    """Evidence and draws of a posterior; the search starts where nothing differs."""
    target = cast("SampledPosterior", posterior)
    names = [parameter.name for parameter in posterior.differing]
    rng = generator(seed, posterior.subject.name, "contrast", *names)
    maxima = find_maxima(target, posterior.without_differences(starts))
    proposal = quick_proposal(target, maxima.x[:1], _laplace_draws(maxima, rng), rng)
    fitted = with_trusted_draws(proposal, rng)
    evidence = importance_evidence(fitted)
    value, se = np.array([evidence.value, evidence.se], np.float64).tolist()  # None becomes NaN
    return ConditionEvidence(differing, posterior, value, se, fitted.draws)


def _laplace_draws(maxima: Maxima, rng: Rng) -> FloatArray:
    """Draws of the normals at the maxima, by their evidence, (draws, coordinates)."""
    curvatures, axes = np.linalg.eigh(maxima.curvature)
    curvatures = np.maximum(curvatures, _LEAST_CURVATURE)
    log_evidence = maxima.value - 0.5 * np.log(curvatures).sum(axis=1)
    index = rng.choice(len(log_evidence), _CLOUD, p=softmax(log_evidence))
    scaled = rng.standard_normal((_CLOUD, maxima.x.shape[1])) / np.sqrt(curvatures[index])
    return maxima.x[index] + np.einsum("nij,nj->ni", axes[index], scaled)


def log_bayes_factor(
    evidences: Sequence[ConditionEvidence], parameters: frozenset[Parameter]
) -> tuple[float | None, float | None]:
    """Log Bayes factor of a difference in any of some parameters against none, and its error."""
    values = np.array([evidence.log_evidence for evidence in evidences])
    errors = np.array([evidence.se for evidence in evidences])
    differs = np.array([not evidence.differing.isdisjoint(parameters) for evidence in evidences])
    if np.isnan(values).any():
        return None, None
    log_odds = logsumexp(values[differs]) - logsumexp(values[~differs])
    log_prior_odds = np.log(differs.sum() / (~differs).sum())
    variance = 0.0
    for side in (differs, ~differs):
        variance += float(np.square(softmax(values[side]) * errors[side]).sum())
    return float(log_odds - log_prior_odds), variance**0.5


def _draws(evidences: Sequence[ConditionEvidence], rng: Rng, size: int) -> FloatArray:
    """Draws in each condition, (conditions, draws, k), over some sets by their evidence.

    A set without evidence counts as the least probable one.
    """
    values = np.array([evidence.log_evidence for evidence in evidences])
    values = np.nan_to_num(values, nan=-1e300)
    draws = []
    for evidence, count in zip(evidences, rng.multinomial(size, softmax(values)), strict=True):
        points = evidence.draws.resampled(rng, int(count))
        draws.append(evidence.posterior.in_conditions(points))
    return np.concatenate(draws, axis=1)
