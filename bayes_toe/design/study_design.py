"""A design: ordered pairs of stimuli, and how often each is shown."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from bayes_toe.arrays import FloatArray, IndexArray, IntArray, StrPath
from bayes_toe.data.column_roles import intensity_remedies
from bayes_toe.data.messages import join_names
from bayes_toe.data.options import ReadOptions
from bayes_toe.data.read_table import read_table
from bayes_toe.data.stimulus_unit import (
    ANY_UNIT,
    LOG_UNITS,
    UNKNOWN_UNIT,
    StimulusUnit,
    why_not_logs,
)
from bayes_toe.data.study import Subject
from bayes_toe.data.tables import write_table
from bayes_toe.data.tasks import SAME_DIFFERENT, Task, task_of
from bayes_toe.data.validation import read_numbers
from bayes_toe.errors import InputError, Remedy, require_number

#: Columns of a design's file.
DESIGN_COLUMNS = ("s1", "s2", "n_trials")
#: Amplitudes of the paper's five stimuli in units of the reference (0.087 g). Source: Methods.
PAPER_AMPLITUDES = (1.0, 1.15, 1.36, 1.55, 1.66)
#: Answered repetitions of the whole set of pairs by each of the paper's subjects.
PAPER_BATCHES = 50


@dataclass(frozen=True, eq=False)
class StudyDesign:
    """Ordered pairs of stimuli with their numbers of trials.

    Parameters
    ----------
    s1, s2 : array_like, shape (pairs,)
        Natural-log intensities.
    n_trials : array_like of int, shape (pairs,)
        At least 1.
    task : Task
        What is asked, by default whether both are the same; "2afc": which is stronger.

    Raises
    ------
    InputError
        If shapes differ, a value is not allowed, or a pair is repeated.

    Examples
    --------
    >>> design = StudyDesign([0.0, 0.0], [0.0, 0.3], [30, 10])
    >>> design.total, design.with_total(10).n_trials.tolist()
    (40, [8, 2])
    """

    s1: FloatArray
    s2: FloatArray
    n_trials: IntArray
    task: Task = field(default=SAME_DIFFERENT, kw_only=True)

    def __post_init__(self) -> None:
        # A subject checks its stimuli and its numbers of trials; a design has the same rules.
        no_answers = np.zeros(np.shape(self.s1), np.int64)
        try:
            subject = Subject("design", self.s1, self.s2, no_answers, self.n_trials)
        except InputError as error:
            raise InputError(str(error).replace("subject 'design'", "design")) from error
        if subject.n_pairs < np.size(self.s1):
            raise InputError("design: a pair of stimuli is repeated, or has no trial")
        # The columns become arrays of the types that the subject has. The subject has sorted its
        # rows, and a design keeps their order.
        for name in DESIGN_COLUMNS:
            column = np.asarray(getattr(self, name), getattr(subject, name).dtype)
            object.__setattr__(self, name, column)
        object.__setattr__(self, "task", task_of(self.task))

    @property
    def pairs(self) -> list[tuple[float, float]]:
        """First and second stimulus of each pair."""
        return list(zip(self.s1.tolist(), self.s2.tolist(), strict=True))

    @property
    def n_pairs(self) -> int:
        """Distinct ordered pairs."""
        return len(self.s1)

    @property
    def total(self) -> int:
        """Trials of all pairs."""
        return int(self.n_trials.sum())

    @property
    def n_batches(self) -> int:
        """The most batches that have every pair equally often."""
        return int(np.gcd.reduce(self.n_trials))

    def answered(
        self, n_yes: npt.ArrayLike, name: str = "design", n_second: IntArray | None = None
    ) -> Subject:
        """A subject who has answered every trial, by the counts of answers to each pair.

        `n_second` are the answers 'second' in a task with three answers.
        """
        return Subject(
            name,
            self.s1,
            self.s2,
            np.asarray(n_yes),
            self.n_trials,
            n_second=n_second,
            task=self.task,
        )

    @property
    def unanswered(self) -> Subject:
        """The pairs as a subject, for whatever depends on the pairs alone.

        A subject needs counts of answers; these are arbitrary.
        """
        return self.answered(self.n_trials)

    @property
    def turned(self) -> IndexArray:
        """The index of each pair in the other order, or its own index without that, (pairs,)."""
        index = {pair: i for i, pair in enumerate(self.pairs)}
        return np.array([index.get((s2, s1), i) for (s1, s2), i in index.items()])

    def with_total(self, trials: int) -> StudyDesign:
        """The same pairs with so many trials in all: each pair has its share, and at least one.

        Raises
        ------
        InputError
            If there are fewer trials than pairs.
        """
        require_number("trials", trials)
        if trials < self.n_pairs:
            raise InputError(
                f"{trials} trials for {self.n_pairs} pairs: allowed is at least one trial a pair"
            )
        return replace(self, n_trials=apportioned(self.n_trials / self.total, trials))

    def select(self, index: IndexArray, n_trials: IntArray) -> StudyDesign:
        """The pairs at these positions, in this order, with new numbers of trials."""
        return replace(self, s1=self.s1[index], s2=self.s2[index], n_trials=n_trials)

    def in_order(self) -> StudyDesign:
        """The same pairs, sorted by (s1, s2)."""
        index = np.lexsort([self.s2, self.s1])
        return self.select(index, self.n_trials[index])

    def frame(self, unit: StimulusUnit = UNKNOWN_UNIT) -> pd.DataFrame:
        """A row a pair: the columns of :func:`stimulus_columns` in a unit, and n_trials."""
        columns = stimulus_columns(self.s1, self.s2, unit)
        return pd.DataFrame({**columns, "n_trials": self.n_trials})

    def save(self, path: StrPath, *, overwrite: bool = False) -> Path:
        """Write the pairs as a CSV file, whole or not at all."""
        return write_table(self.frame(), path, overwrite=overwrite)


def each_once(s1: npt.ArrayLike, s2: npt.ArrayLike, *, task: Task = SAME_DIFFERENT) -> StudyDesign:
    """A design that has each of these pairs once, sorted by (s1, s2)."""
    n_trials = np.ones(np.shape(s1), np.int64)
    return StudyDesign(s1, s2, n_trials, task=task).in_order()  # type: ignore[arg-type]


def all_pairs(levels: FloatArray, task: Task = SAME_DIFFERENT) -> StudyDesign:
    """Every ordered pair of levels once."""
    s1, s2 = np.meshgrid(levels, levels, indexing="ij")
    return each_once(s1.ravel(), s2.ravel(), task=task)


def apportioned(share: FloatArray, trials: int) -> IntArray:
    """Whole numbers of at least 1 that add up to `trials`, as near to shares of it as they can be.

    Examples
    --------
    >>> apportioned(np.array([0.5, 0.49, 0.01]), 11).tolist()
    [5, 5, 1]
    """
    ideal = share / share.sum() * trials  # no whole numbers
    counts: IntArray = np.maximum(1, np.floor(ideal)).astype(np.int64)
    while counts.sum() > trials:  # small shares were raised to 1
        excess = np.where(counts > 1, counts - ideal, -np.inf)
        counts[excess.argmax()] -= 1
    while counts.sum() < trials:  # floor has lost trials
        counts[(ideal - counts).argmax()] += 1
    return counts


def read_study_design(
    path: StrPath,
    task: Task | str = SAME_DIFFERENT,
    unit: str | None = None,
    *,
    batches: int | None = None,
) -> StudyDesign:
    """Read a design from a CSV file with the columns s1,s2,n_trials.

    Parameters
    ----------
    path : str or path
    task : Task or str
    unit : str, optional
        Of the stimuli, as in :class:`bayes_toe.ReadOptions`; intensities may be in i1 and i2.
    batches : int, optional
        Trials of each pair of a file without the column n_trials, which is otherwise required.

    Raises
    ------
    InputError
        One line per problem of the file, with row and column.
    """
    counts = ("n_trials",)
    required, optional = (counts, ()) if batches is None else ((), counts)
    _, columns = read_stimuli(path, ReadOptions(unit=unit), required=required, optional=optional)
    s1 = columns["s1"]
    s2 = columns["s2"]
    n_trials = columns.get("n_trials", np.full(len(s1), batches)).astype(np.int64)
    try:
        design = StudyDesign(s1, s2, n_trials, task=task)  # type: ignore[arg-type]
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return design.in_order()


def read_stimuli(
    path: StrPath,
    options: ReadOptions,
    s_names: tuple[str, ...] = ("s1", "s2"),
    i_names: tuple[str, ...] = ("i1", "i2"),
    *,
    required: tuple[str, ...] = (),
    optional: tuple[str, ...] = (),
) -> tuple[tuple[str, ...], dict[str, FloatArray]]:
    """The stimuli of a CSV file in natural logs, and other columns of numbers.

    If the options have a unit of intensities, the columns `i_names` are read as intensities, or the
    columns `s_names` where the file lacks them. Without such a unit, the columns `s_names` are read
    as logs. Other columns are those in `required`, and those in `optional` that the file has; a
    column `n_trials` must have counts.

    Returns
    -------
    stimulus_names : tuple of str
        The columns of stimuli that were read.
    columns : dict of str to ndarray, shape (rows,)
        The stimuli by the names in `s_names`, and the other columns by their names.
    """
    # Columns of other names are not read.
    table = read_table(path, lambda _: {*s_names, *i_names, *required, *optional})
    header = set(table.names)
    stimulus_names = s_names
    if header.issuperset(i_names):
        if options.has_intensities:
            stimulus_names = i_names
        elif not header.intersection(s_names):
            raise InputError(
                f"{table.source}: columns {join_names(i_names)} are intensities without a unit",
                [Remedy("unit", ANY_UNIT, "or the name of their unit")],
            )

    _, columns = read_numbers(table, (*stimulus_names, *required), optional=optional)
    stimuli = [columns.pop(name) for name in stimulus_names]
    logs = to_logs(str(path), stimuli, options)
    return stimulus_names, columns | dict(zip(s_names, logs, strict=True))


def to_logs(source: str, stimuli: list[FloatArray], options: ReadOptions) -> list[FloatArray]:
    """Natural logs of one or two columns of stimuli in the unit of these options.

    Without a unit, numbers that look like intensities are refused. An error begins with `source`.
    """
    smallest = min(values.min() for values in stimuli)
    if options.has_intensities and smallest <= 0.0:
        raise InputError(f"{source}: found the intensity {smallest:g}, allowed: positive numbers")
    if options.unit is None and not options.has_intensities:
        # A single column stands for both s1 and s2.
        reason, _ = why_not_logs(stimuli[0], stimuli[-1])
        if reason:
            raise InputError(
                f"{source}: found {reason}, allowed: natural logs of intensities",
                intensity_remedies(np.concatenate(stimuli)),
            )
    return [log_levels(values, options) for values in stimuli]


def log_levels(levels: FloatArray, options: ReadOptions) -> FloatArray:
    """Natural logs of levels in the unit of these options."""
    if options.has_intensities:
        return options.stimulus_unit.to_logs(levels)
    return levels * LOG_UNITS[options.unit or "ln"]


def stimulus_columns(
    s1: FloatArray, s2: FloatArray, unit: StimulusUnit = UNKNOWN_UNIT
) -> dict[str, FloatArray]:
    """The columns s1 and s2, and with a unit of intensities i1 and i2, as a command reads them.

    The arguments are natural logs. The columns s1 and s2 are natural logs too, or in the log unit
    that `unit` is.

    Examples
    --------
    >>> logs = np.log([45.0, 60.0])
    >>> columns = stimulus_columns(logs, logs[::-1], StimulusUnit("um"))
    >>> {name: column.round(3).tolist() for name, column in columns.items()}
    {'s1': [3.807, 4.094], 's2': [4.094, 3.807], 'i1': [45.0, 60.0], 'i2': [60.0, 45.0]}
    """
    log_unit = LOG_UNITS.get(unit.name, 1.0)
    columns = {"s1": s1 / log_unit, "s2": s2 / log_unit}
    if unit.stimulus_unit and not unit.is_decibel:
        for name, logs in (("i1", s1), ("i2", s2)):
            # Without the rounding of logarithms: 45, not 44.99999999999997.
            columns[name] = np.array([float(f"{value:.12g}") for value in unit.to_stimuli(logs)])
    return columns


def paper_study_design(task: Task | str = SAME_DIFFERENT) -> StudyDesign:
    """The paper's 13 pairs, 50 trials each, sorted by (s1, s2)."""
    return replace(reference_design(), task=task).in_order()  # type: ignore[arg-type]


def reference_design(
    amplitudes: Iterable[float] = PAPER_AMPLITUDES, batches: int = PAPER_BATCHES
) -> StudyDesign:
    """The paper's design: every stimulus with itself; the first with the others in both orders.

    Amplitudes are in units of the reference, s = ln(amplitude). `batches` is the number of trials
    of each pair.
    """
    s = np.log(list(amplitudes))
    references = np.full(len(s) - 1, s[0])
    s1 = np.concatenate([s, references, s[1:]])
    s2 = np.concatenate([s, s[1:], references])
    return StudyDesign(s1, s2, np.full(len(s1), batches))


def full_design(batches: int = PAPER_BATCHES) -> StudyDesign:
    """Every ordered pair of the paper's stimuli `batches` times, equal pairs included."""
    pairs = all_pairs(np.log(PAPER_AMPLITUDES))
    return replace(pairs, n_trials=batches * pairs.n_trials)
