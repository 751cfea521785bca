"""Power of a design: how often it detects the effects of assumed observers.

`power` simulates their responses, analyses each data set as that of a real subject, and counts the
words ('yes', 'probably' and so on) about the order effect, the constant error and the
contraction. The result is a :class:`PowerTable`.

`group_power` plans the number of subjects. It draws studies from these observers, and counts the
subjects and the group means with 'yes' or 'probably'.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, product
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import beta, betabinom

from bayes_toe.answers.order_effect import (
    QUESTIONS,
    SIZE_OF,
    OrderEffect,
    order_effect,
    word_of_bayes_factor,
)
from bayes_toe.answers.words import Word
from bayes_toe.arrays import FloatArray, Rng, StrPath
from bayes_toe.checks.identification import identify
from bayes_toe.data.conditions import StimulusScales
from bayes_toe.data.messages import capitalized, join_names, join_words
from bayes_toe.data.tables import Table
from bayes_toe.design.observers import Observer, assume_observers
from bayes_toe.design.study_design import StudyDesign, paper_study_design
from bayes_toe.errors import InputError, require_kind, require_number
from bayes_toe.groups.hyperprior import HyperpriorNumbers
from bayes_toe.groups.zero_mean import approximate_zero_mean
from bayes_toe.inference.order_evidence import BATCH, order_evidence
from bayes_toe.model.parameters import CONSTANT_ERROR, ObserverPrior
from bayes_toe.model.prior import Prior
from bayes_toe.model.prior_file import preset_or_file
from bayes_toe.seeds import generator, root_seed
from bayes_toe.workers import Progress, Workers, run_in_order

#: The names of the default design, and of a single design without a name.
PAPER_PAIRS = "the paper's pairs"
GIVEN_PAIRS = "these pairs"
#: The answer 'yes' or 'probably'.
DETECTED = "yes or probably"
_N_STUDIES = 400  # simulated studies for each number of subjects


@dataclass(frozen=True)
class DataSet:
    """The conclusion from one simulated observer's answers to a design."""

    design: str
    trials: int
    observer: Observer
    answer: OrderEffect
    scales: StimulusScales


class PowerEstimate(NamedTuple):
    """A share of simulated data sets, with the 95 % interval of its Monte Carlo error.

    Attributes
    ----------
    design : str
    trials : int
    observers : str
        The kind.
    quantity : str
        One of the three questions.
    answer : str
        The word that is counted, or :data:`DETECTED`.
    value, low, high : float
    data_sets : int
    """

    design: str
    trials: int
    observers: str
    quantity: str
    answer: str
    value: float
    low: float
    high: float
    data_sets: int

    @property
    def percent(self) -> str:
        """The share with its interval, such as '35 % [17, 57]'."""
        return f"{100 * self.value:.0f} % [{100 * self.low:.0f}, {100 * self.high:.0f}]"


@dataclass(frozen=True, eq=False)
class PowerTable(Table[PowerEstimate]):
    """Shares of simulated data sets, one in each row: the table of power.csv.

    Attributes
    ----------
    rows : tuple of PowerEstimate
    data_sets : tuple of DataSet
    seed : int
    """

    data_sets: tuple[DataSet, ...]
    seed: int

    @classmethod
    def from_data_sets(cls, data_sets: Iterable[DataSet], seed: int) -> PowerTable:
        """The share of each word about each question, in each group of :func:`group_data_sets`."""
        data_sets = tuple(data_sets)
        # Responses of simulated observers have no problems, and are always interpreted.
        possible_words = [word for word in Word if word is not Word.NOT_INTERPRETABLE]

        rows = []
        for (design, trials, kind), group in group_data_sets(data_sets).items():
            for question in QUESTIONS:
                words = [data_set.answer.words[question] for data_set in group]
                counts = {word.value: words.count(word) for word in possible_words}
                counts[DETECTED] = sum(word.is_positive for word in words)
                for answer, count in counts.items():
                    interval = share(count, len(group))  # value, low and high
                    rows.append(
                        PowerEstimate(design, trials, kind, question, answer, *interval, len(group))
                    )
        return cls(tuple(rows), data_sets, seed)

    def __getitem__(self, key: tuple[str, int, str, str, str]) -> PowerEstimate:
        """A row, by (design, trials, kind of observers, quantity, answer)."""
        for row in self.rows:
            if row[:5] == key:  # the fields up to `answer`
                return row
        raise InputError(
            f"nothing counted for {key!r}; answers: {join_names(self.different('answer'))}"
        )

    def different(self, *columns: str) -> tuple[Any, ...]:
        """The different values of a column, or tuples of several columns, in the order of rows."""
        return tuple(dict.fromkeys(map(attrgetter(*columns), self.rows)))

    def has_effect(self, kind: str, question: str) -> bool:
        """Whether any observer of a kind truly has the effect that is asked about."""
        return any(
            data_set.observer.has_effect(question)
            for data_set in self.data_sets
            if data_set.observer.kind == kind
        )

    def sentences(self) -> list[str]:
        """How often each design detects order effects, and which questions it cannot answer.

        A sentence such as 'Order effect: cannot be told.' follows for each of these questions.
        """
        lines = []
        for design, trials in self.different("design", "trials"):
            findings = "; ".join(self._describe_detection(design, trials))
            text = f"{capitalized(design)}, {trials:,} trials: {findings}."
            for question in QUESTIONS:
                if self.is_unknown(design, trials, question):
                    text += f" {capitalized(question.replace('_', ' '))}: {Word.CANNOT_BE_TOLD}."
            lines.append(text)
        return lines

    def _describe_detection(self, design: str, trials: int) -> list[str]:
        """The kind of observers whom a design detects least often, and false positives, as texts.

        As in ['contraction detected least often, in 35 % [17, 57]', 'false positives 2 % [0, 9]'].
        """
        detections = []  # of the kinds with an order effect
        false_positives = []
        for kind in self.different("observers"):
            estimate = self[design, trials, kind, "order_effect", DETECTED]
            if self.has_effect(kind, "order_effect"):
                detections.append(estimate)
            else:
                false_positives.append(f"false positives {estimate.percent}")

        findings = []
        if detections:
            rarest = min(detections, key=attrgetter("value"))
            adverb = " least often," if len(detections) > 1 else ""
            findings.append(f"{rarest.observers} detected{adverb} in {rarest.percent}")
        return findings + false_positives

    def is_unknown(self, design: str, trials: int, question: str) -> bool:
        """Whether the word for a question is 'cannot be told' for every simulated observer."""
        word = Word.CANNOT_BE_TOLD.value
        kinds = self.different("observers")
        return all(self[design, trials, kind, question, word].value == 1.0 for kind in kinds)


def group_data_sets(
    data_sets: Iterable[DataSet],
) -> Mapping[tuple[str, int, str], Sequence[DataSet]]:
    """The data sets by (design, trials, kind of observers), in their order."""
    groups = defaultdict(list)
    for data_set in data_sets:
        groups[data_set.design, data_set.trials, data_set.observer.kind].append(data_set)
    return groups


def share(hits: int, size: int) -> tuple[float, float, float]:
    """The share hits/size and its 95 % interval, by Jeffreys' prior, Beta(1/2, 1/2).

    The interval begins at 0 if there is no hit, and ends at 1 if all are hits.

    Examples
    --------
    >>> [round(value, 3) for value in share(7, 20)]
    [0.35, 0.172, 0.568]
    """
    low, high = beta.interval(0.95, hits + 0.5, size - hits + 0.5)
    if hits == 0:
        low = 0.0
    if hits == size:
        high = 1.0
    return hits / size, float(low), float(high)


# --- Simulation -----------------------------------------------------------------------------------


def power(
    design: StudyDesign | Mapping[str, StudyDesign] | None = None,
    trials: Sequence[int] = (325, 650, 1300),
    observers: StrPath | Sequence[Observer] | None = None,
    *,
    data_sets: int = 50,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
) -> PowerTable:
    """Estimate how often and how precisely a design shows the effects of assumed observers.

    Parameters
    ----------
    design : StudyDesign or mapping of str to StudyDesign, optional
        A design, or several by name; by default the paper's 13 pairs. If the designs have several
        tasks, the observers of each task have the same effects and the same noise.
    trials : sequence of int
        Numbers of trials of one subject, shared among the pairs as the design shares its own.
    observers : str, path or sequence of Observer, optional
        As :func:`bayes_toe.design.observers.assume_observers` takes them.
    data_sets : int
        Observers of each kind. Each has one data set for every design and number of trials.
    seed, prior, workers, progress
        As in :func:`bayes_toe.analysis.evidence`.

    Raises
    ------
    InputError
        If there are fewer trials than pairs, something is not allowed, or observers would always
        answer alike.

    Examples
    --------
    >>> table = power(trials=[130], observers="both", data_sets=2, seed=1, workers=1)
    >>> table["the paper's pairs", 130, "both", "order_effect", "yes"].data_sets
    2
    """
    require_kind("trials", trials, Iterable, "whole numbers, in a list")
    if design is None:
        design = {PAPER_PAIRS: paper_study_design()}
    elif isinstance(design, StudyDesign):
        design = {GIVEN_PAIRS: design}
    require_kind("design", design, Mapping, "a StudyDesign, or several by their names")
    root = root_seed(seed)
    observer_prior = preset_or_file(prior).observer

    jobs = []  # a batch of observers with one design each
    names = []  # of the observers of each job, which progress shows
    # An observer has one task, so the designs of each task have observers of their own.
    for task in dict.fromkeys(pairs.task for pairs in design.values()):
        designs = {name: pairs for name, pairs in design.items() if pairs.task == task}
        assumed_observers = assume_observers(
            observers,
            size=data_sets,
            seed=root,
            designs=list(designs.values()),
            prior=observer_prior,
            is_even=True,
        )
        # A number of trials that is given twice counts once.
        for (name, pairs), total in product(designs.items(), dict.fromkeys(trials)):
            sized = pairs.with_total(total)
            for start in range(0, len(assumed_observers), BATCH):
                batch = assumed_observers[start : start + BATCH]
                jobs.append(partial(simulate_batch, name, sized, batch, root, observer_prior))
                names.append(tuple(observer.name for observer in batch))
    results = run_in_order(jobs, workers, progress, names)
    return PowerTable.from_data_sets(chain.from_iterable(results), root)


def simulate_batch(
    name: str,
    design: StudyDesign,
    observers: Sequence[Observer],
    seed: int,
    prior: ObserverPrior,
) -> list[DataSet]:
    """The data sets of some observers, who answer the design of this name."""
    subjects = [observer.answers(design, seed) for observer in observers]
    identification = identify(design.unanswered)
    evidences = order_evidence(subjects, seed, prior)
    data_sets = []
    for observer, evidence in zip(observers, evidences, strict=True):
        answer = order_effect(evidence, identification)
        data_sets.append(DataSet(name, design.total, observer, answer, evidence.subject.scales))
    return data_sets


# --- Groups ---------------------------------------------------------------------------------------


class GroupPower(NamedTuple):
    """The results of studies of so many subjects, who are observers of one kind.

    Attributes
    ----------
    design : str
    trials : int
        Of each subject.
    observers : str
        The kind.
    question : str
        One of the three questions.
    subjects : int
    true_mean, true_sd : float
        Mean of the effect over these observers and standard deviation between them: constant error
        (natural-log intensity) or contraction. NaN for the order effect.
    detected, detected_low, detected_high : int
        Subjects with 'yes' or 'probably' in a study: median and 95 % prediction interval.
    power, power_low, power_high : float
        Share of studies in which the group mean differs from 0 by 'yes' or 'probably', with its
        95 % interval. NaN for the order effect.
    """

    design: str
    trials: int
    observers: str
    question: str
    subjects: int
    true_mean: float
    true_sd: float
    detected: int
    detected_low: int
    detected_high: int
    power: float
    power_low: float
    power_high: float

    @property
    def counts_text(self) -> str:
        """Subjects with the effect, and their prediction interval, such as '14 [9, 18]'."""
        return f"{self.detected} [{self.detected_low}, {self.detected_high}]"

    @property
    def percent(self) -> str:
        """The power with its interval, per cent, such as '80 [76, 84]'.

        It is in brackets if the true mean is 0, because it is then the share of false positives.
        """
        text = f"{100 * self.power:.0f} [{100 * self.power_low:.0f}, {100 * self.power_high:.0f}]"
        return text if self.has_nonzero_mean else f"({text})"

    @property
    def has_nonzero_mean(self) -> bool:
        """Whether the true mean differs from 0 by more than an error of rounding."""
        return abs(self.true_mean) > 1e-6


@dataclass(frozen=True, eq=False)
class GroupPowerTable(Table[GroupPower]):
    """The table of power_groups.csv: a row for each kind of observers, question and group size."""

    seed: int

    def select(self, design: str, trials: int, question: str) -> dict[str, list[GroupPower]]:
        """The rows of one design, number of trials and question, by kind of observers."""
        rows = defaultdict(list)
        for row in self.rows:
            if (row.design, row.trials, row.question) == (design, trials, question):
                rows[row.observers].append(row)
        return rows

    def sentences(self) -> list[str]:
        """For each design and effect, the share of studies that find the smallest true mean."""
        lines = []
        for design, trials in dict.fromkeys((row.design, row.trials) for row in self.rows):
            for question in SIZE_OF:  # the order effect has no mean
                # A kind of observers has a row for each number of subjects, all with one true mean.
                rows_by_kind = self.select(design, trials, question)
                nonzero = [rows for rows in rows_by_kind.values() if rows[0].has_nonzero_mean]
                if nonzero:
                    smallest = min(nonzero, key=lambda rows: abs(rows[0].true_mean))
                    shares = [f"{row.percent} % with {row.subjects} subjects" for row in smallest]
                    lines.append(
                        f"{capitalized(design)}, {trials:,} trials: studies detect the mean of "
                        f"'{smallest[0].observers}' in {join_words(shares)}."
                    )
        return lines


def group_power(
    table: PowerTable, subjects: Sequence[int], prior: Prior | str | None = None
) -> GroupPowerTable:
    """Predict in how many subjects a study finds an effect, and how often in the group mean.

    A study draws its subjects from the simulated observers of a kind, with replacement. A subject's
    estimate is its true effect with a normal error, as large as the analysis of that observer says.
    The Bayes factor of the group mean averages over the prior of the standard deviation between
    subjects, as `population` does. A question that the design cannot answer has no rows.

    Parameters
    ----------
    table : PowerTable
    subjects : sequence of int
        Numbers of subjects.
    prior
        The prior with which the observers were analysed; it has the prior of a group, too.

    Examples
    --------
    >>> table = power(trials=[130], observers="both", data_sets=2, seed=1, workers=1)
    >>> [row.question for row in group_power(table, [10]).rows]  # these pairs show no contraction
    ['order_effect', 'constant_error']
    """
    whole_prior = preset_or_file(prior)
    rows = []
    for (design, trials, kind), group in group_data_sets(table.data_sets).items():
        for question in QUESTIONS:
            if table.is_unknown(design, trials, question):
                continue
            n_detected = sum(data_set.answer.words[question].is_positive for data_set in group)
            # The true effect of each observer. It is NaN for the order effect, which has no
            # parameter, and so are its mean and the power of its mean.
            effects = np.array(
                [data_set.observer.parameters.get(question, np.nan) for data_set in group]
            )
            for size in subjects:
                require_number("subjects", size, smallest=2)
                power_of_mean = (np.nan, np.nan, np.nan)
                if question in SIZE_OF:
                    rng = generator(table.seed, design, kind, f"{trials} {size} {question}")
                    hits = _count_detected_means(group, question, effects, size, whole_prior, rng)
                    power_of_mean = share(hits, _N_STUDIES)
                rows.append(
                    GroupPower(
                        design,
                        trials,
                        kind,
                        question,
                        size,
                        float(np.mean(effects)),
                        float(np.std(effects)),
                        *predicted_count(n_detected, len(group), size),  # median and interval
                        *power_of_mean,  # value and interval
                    )
                )
    return GroupPowerTable(tuple(rows), table.seed)


def _count_detected_means(
    group: Sequence[DataSet],
    question: str,
    effects: FloatArray,
    size: int,
    prior: Prior,
    rng: Rng,
) -> int:
    """How many of :data:`_N_STUDIES` studies say 'yes' or 'probably' to a group mean that is not 0.

    A study draws `size` subjects from the observers of the group, with replacement. `effects` has
    the true effect of each observer, (observers,).
    """
    intervals = np.array([data_set.answer.sizes[SIZE_OF[question]] for data_set in group])
    low, _, high = intervals.T  # 95 % intervals, (observers,) each
    # The unit in which the hyperprior has the effect, and the SD of a subject's prior in this unit.
    scales = group[0].scales
    if question == CONSTANT_ERROR.name:
        low, high = np.log1p([low / 100.0, high / 100.0])  # from per cent of intensity
        unit = scales.step
        hyperprior = prior.group.constant_error
        # A subject's prior is Student's t with 3 degrees of freedom and this scale. At 0 it is
        # curved like a normal with this SD: its log density has the curvature (3 + 1)/3/scale^2.
        prior_sd = 0.5 * np.sqrt(3.0) * prior.observer.constant_error_scale
    else:
        unit = 1.0
        hyperprior = prior.group.contraction.narrowed(scales.roving_share)
        prior_sd = prior.observer.contraction_sd * scales.roving_share

    # With normal densities, the precision of the responses is that of the posterior less that of
    # the prior. Where the posterior is as wide as the prior, or wider by Monte Carlo error, the
    # responses say next to nothing: an SD of 100 units.
    posterior_sd = (high - low) / 3.92 / unit  # a normal interval is 2 x 1.96 SD wide
    standard_error = np.maximum(posterior_sd**-2.0 - prior_sd**-2.0, 1e-4) ** -0.5  # (observers,)

    drawn = rng.integers(len(group), size=(_N_STUDIES, size))  # indices of observers
    standard_errors = standard_error[drawn]  # (studies, subjects)
    estimates = effects[drawn] / unit + standard_errors * rng.standard_normal(drawn.shape)
    numbers = HyperpriorNumbers.from_rows([hyperprior])
    # The function has the log Bayes factor for a mean of 0, and its negative is against this mean.
    log_factors = -approximate_zero_mean(estimates, standard_errors, numbers)  # (studies,)
    return sum(word_of_bayes_factor(value).is_positive for value in log_factors.tolist())


def predicted_count(hits: int, size: int, subjects: int) -> tuple[int, int, int]:
    """Predict how many of so many subjects have an effect that `hits` of `size` observers had.

    The median and the ends of the 95 % interval are those of a beta-binomial distribution, with
    Jeffreys' prior of the share, Beta(1/2, 1/2).

    Examples
    --------
    >>> predicted_count(35, 50, 20)
    (14, 9, 18)
    """
    counts = betabinom(subjects, hits + 0.5, size - hits + 0.5)
    low, high = counts.interval(0.95)
    return int(counts.median()), int(low), int(high)
