"""Studies and subjects: counts of answers to each pair, validated once and immutable.

The likelihood needs only how often each answer was given to each ordered pair of stimuli, so trials
are grouped on the way in: a million trials cost what their distinct pairs cost.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from itertools import compress
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import BoolArray, FloatArray, IndexArray, IntArray, Record
from bayes_toe.data.answers import Answers, Reading, counted_rows
from bayes_toe.data.conditions import Conditions, StimulusScales
from bayes_toe.data.messages import (
    Texts,
    as_html,
    cli_argument,
    display_name,
    join_few,
    join_names,
    join_words,
    name_from_key,
)
from bayes_toe.data.stimulus_unit import UNKNOWN_UNIT, StimulusUnit
from bayes_toe.data.tables import frame_of, of_subject
from bayes_toe.data.tasks import SAME_DIFFERENT, THREE_ANSWERS, WHICH_STRONGER, Task, task_of
from bayes_toe.data.validation import CONDITION_SEPARATOR
from bayes_toe.errors import InputError, require_kind

if TYPE_CHECKING:
    import pandas as pd


#: Differences within this share of the smallest one are equal: stimuli may have two digits only.
_ROUNDING = 0.35


#: One name or number of a subject or block, or several.
Names: TypeAlias = Sequence[str | int] | str | int


@dataclass(frozen=True, eq=False, repr=False)
class Subject:
    """Response counts of one subject for each ordered pair of stimuli, sorted by (s1, s2).

    Repeated pairs are added up. Pairs that were never answered are left out.

    Parameters
    ----------
    name : str
        The identifier as the file had it: any text.
    s1, s2 : array_like, shape (pairs,)
        Natural-log intensities of the first and the second stimulus.
    n_yes, n_trials : array_like of int, shape (pairs,)
        How often the answer that the task counts was given, 'equal' or 'second', and how often the
        pair was answered. For single trials, `n_yes` is 1 or 0, and `n_trials` is 1.
    n_second : array_like of int, shape (pairs,), optional
        Of three answers: how often 'second' was given. It may be omitted where every answer is
        'equal'.
    task : Task or str
        What was asked: same or different (the default), which is stronger, or three answers.
    unit : StimulusUnit
        The unit in which screens, figures and reports show the stimuli.
    condition : str
        The level of a unit, which is a subject at one level of a condition. The name of a unit is
        the subject's name, @ and the level.
    shared_scales : StimulusScales, optional
        Location and scales of the stimuli in all conditions of the subject of a unit. They replace
        the scales of the unit alone, except for the spread of the first stimuli.
    answers : Answers, optional
        The rows that the counts are the sums of, as read. Checks of the responses and models of
        serial dependence use them. If they do not add up to the counts, None takes their place.

    Raises
    ------
    InputError
        If shapes differ, a value is not finite, counts are outside 0 <= n_yes <= n_trials, or all
        are 0. If `n_second` is missing or out of place.

    Examples
    --------
    >>> Subject("S01", [0.0, 0.0], [0.0, 0.3], [49, 20], [50, 50]).fraction_yes
    0.69
    >>> Subject("S02", [0.0], [0.3], [2], [5], task="2afc").task.yes
    'second'
    """

    name: str
    s1: FloatArray
    s2: FloatArray
    n_yes: IntArray
    n_trials: IntArray
    _: KW_ONLY
    n_second: IntArray | None = None
    task: Task = SAME_DIFFERENT
    unit: StimulusUnit = UNKNOWN_UNIT
    condition: str = ""
    shared_scales: StimulusScales | None = None
    answers: Answers | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InputError(f"subject name {self.name!r} must be a non-empty text")

        require_kind("unit", self.unit, StimulusUnit, "a StimulusUnit; s1 and s2 are natural logs")
        object.__setattr__(self, "task", task_of(self.task))
        rows = counted_rows(
            self.name, (self.s1, self.s2), self.n_yes, self.n_trials, self._all_n_second()
        ).sums
        if not len(rows.keys):
            raise InputError(f"subject {self.name!r}: no answered trial")
        if not np.isfinite(rows.keys).all():
            raise InputError(f"subject {self.name!r}: s1 and s2 must be finite numbers")

        s1, s2 = rows.keys.T.copy()
        for name, values in {"s1": s1, "s2": s2, **rows.named_counts}.items():
            values.setflags(write=False)
            object.__setattr__(self, name, values)

        if self.answers is not None:
            sums = self.answers.sums
            # A copy with other counts does not keep the answers.
            has_pairs = np.array_equal(sums.keys, rows.keys)
            if not has_pairs or not np.array_equal(sums.counts, rows.counts):
                object.__setattr__(self, "answers", None)

    def _all_n_second(self) -> npt.ArrayLike | None:
        """The numbers of 'second', which only the task with three answers has."""
        has_three = self.task.has_three_answers
        if has_three == (self.n_second is not None):
            return self.n_second
        if has_three and np.array_equal(self.n_yes, self.n_trials):
            return np.zeros_like(self.n_trials)  # all answers are 'equal'
        raise InputError(
            f"subject {self.name!r}: n_second must be given with the task "
            f"{THREE_ANSWERS.name!r}, and with no other"
        )

    @classmethod
    def from_answers(
        cls,
        name: str,
        answers: Answers,
        task: Task = SAME_DIFFERENT,
        unit: StimulusUnit = UNKNOWN_UNIT,
    ) -> Subject:
        """A subject from rows as they were given, which it keeps."""
        counts = answers.named_counts
        return cls(name, *answers.keys.T, **counts, task=task, unit=unit, answers=answers)

    @property
    def scales(self) -> StimulusScales:
        """Location and scales of the stimuli.

        Raises
        ------
        InputError
            If no pair has two different stimuli.
        """
        scales = StimulusScales.from_pairs(self.s1, self.s2, self.n_trials)
        if scales is None:
            raise InputError(
                f"subject {self.name!r}: no pair has two different stimuli, so no order effect can "
                "be seen"
            )
        return (self.shared_scales or scales)._replace(first_spread=scales.first_spread)

    @property
    def subject_name(self) -> str:
        """The name of the subject, without a condition."""
        if not self.condition:
            return self.name
        return self.name.removesuffix(f"{CONDITION_SEPARATOR}{self.condition}")

    @property
    def n_pairs(self) -> int:
        """Number of distinct ordered pairs."""
        return len(self.s1)

    @property
    def pairs(self) -> list[tuple[float, float]]:
        """First and second stimulus of every pair, natural-log intensity."""
        return list(zip(self.s1.tolist(), self.s2.tolist(), strict=True))

    @property
    def mean_first(self) -> float:
        """The mean first stimulus over all trials, natural-log intensity."""
        return float(np.average(self.s1, weights=self.n_trials))

    @property
    def stimuli(self) -> FloatArray:
        """The first stimuli of all pairs, then the second ones, natural-log intensity."""
        return np.concatenate([self.s1, self.s2])

    @property
    def steps(self) -> FloatArray:
        """The difference s2 - s1 of every pair, natural-log intensity, shape (pairs,).

        Differences that only the rounding of the stimuli distinguishes are equal.

        Examples
        --------
        >>> Subject("S01", [0.0, 0.3], [0.3, 0.599], [4, 2], [5, 5]).steps.round(4).tolist()
        [0.2995, 0.2995]
        """
        values, index = np.unique(self.s2 - self.s1, return_inverse=True)  # in ascending order
        rounding = _ROUNDING * np.abs(values[values != 0.0]).min(initial=np.inf)
        # The number of each value's group. Values that differ by rounding from the first value of a
        # group are in it, and become its mean.
        group = np.zeros(len(values), np.int64)
        first_of_group = values[0]
        for i, value in enumerate(values):
            if value - first_of_group > rounding:
                first_of_group = value
                group[i:] += 1
        means = np.bincount(group, values) / np.bincount(group)
        return means[group][index]

    @property
    def two_answers(self) -> Subject | None:
        """The subject with two answers: itself, or a subject with 'second' and 'first' of three.

        Trials whose answer is 'equal' then count as not answered. None if all answers are 'equal'.
        """
        if self.n_second is None:
            return self
        rows = _rows(self).unequal_answers
        if not rows.n_trials.any():
            return None
        return _with_rows(self, rows, WHICH_STRONGER)

    @property
    def n_first(self) -> IntArray:
        """How often 'first' was given, of three answers, shape (pairs,)."""
        assert self.n_second is not None  # None with two answers
        return self.n_trials - self.n_yes - self.n_second

    @property
    def counts(self) -> tuple[IntArray, ...]:
        """How often each answer of the task was given, shape (pairs,) each."""
        if self.n_second is None:
            return self.n_yes, self.n_trials - self.n_yes
        return self.n_yes, self.n_second, self.n_first

    @property
    def answers_given(self) -> Texts:
        """The answers that were given at least once."""
        return list(compress(self.task.answers, map(np.any, self.counts)))

    @property
    def total_trials(self) -> int:
        """Number of answered trials."""
        return int(self.n_trials.sum())

    @property
    def fraction_yes(self) -> float:
        """Share of trials with the answer that the task counts, 'equal' or 'second', in 0..1."""
        return float(self.n_yes.sum() / self.n_trials.sum())

    def __repr__(self) -> str:
        size = f"{self.n_pairs:,} pairs, {self.total_trials:,} trials"
        return f"<Subject {self.name!r}: {size}, {self.fraction_yes:.0%} {self.task.yes!r}>"


@dataclass(frozen=True, eq=False, repr=False)
class Study:
    """The subjects of one experiment, and the source of their data.

    Parameters
    ----------
    subjects : sequence of Subject
        At least one subject; names are unique (case matters).
    source : str
        What reports call the study.
    synthetic : bool
        True where the data were simulated; shown wherever the study is shown.
    notes : sequence of str
        What reading the study detected, merged or dropped.
    reading : Reading
        What the file holds besides the counts, for checks before pooling; no inference uses it.
    changes : sequence of str
        Responses that were swapped and subjects that were excluded (:meth:`swap`, :meth:`exclude`),
        as options: "--swap 946:2,4".
    conditions : Conditions, optional
        Levels of a condition within subjects, where subjects are units such as S01@left.

    Examples
    --------
    >>> study = Study([Subject("S01", [0.0], [0.3], [2], [5])], source="pilot")
    >>> study["S01"].n_pairs, study.names
    (1, ('S01',))
    """

    subjects: tuple[Subject, ...]
    source: str = "study"
    synthetic: bool = False
    notes: tuple[str, ...] = ()
    reading: Reading = field(default_factory=Reading)
    changes: tuple[str, ...] = ()
    conditions: Conditions | None = None

    def __post_init__(self) -> None:
        require_kind("Study", self.subjects, Iterable, "Subjects, in a list")
        subjects = tuple(self.subjects)
        for subject in subjects:
            require_kind("Study", subject, Subject, "Subjects, in a list")
        if not subjects:
            raise InputError("a study needs at least one subject")
        names = Counter(subject.name for subject in subjects)
        repeated = [repr(name) for name in sorted(names) if names[name] > 1]
        if repeated:
            raise InputError(f"subject names must be unique, repeated: {join_names(repeated)}")

        # A dict has one task at each level, so that it is shorter if a level has two tasks.
        tasks_at_levels = {(subject.condition, subject.task) for subject in subjects}
        if len(tasks_at_levels) > len(dict(tasks_at_levels)):
            raise InputError(
                "every subject of a study must have been asked the same: same or different, which "
                "is stronger, or three answers"
            )
        for key in ("subjects", "notes", "changes"):
            object.__setattr__(self, key, tuple(getattr(self, key)))

    @property
    def names(self) -> tuple[str, ...]:
        """Subject identifiers, in the order of the study."""
        return tuple(subject.name for subject in self.subjects)

    @property
    def task(self) -> Task:
        """The task of all subjects; of a study of several tasks, that of its first unit."""
        return self.subjects[0].task

    @property
    def by_task(self) -> tuple[Study, ...]:
        """A study for each task, of the units that did it; this study where there is one task."""
        tasks = dict.fromkeys(subject.task for subject in self)
        if len(tasks) == 1:
            return (self,)
        studies = []
        for task in tasks:
            units = tuple(subject for subject in self if subject.task == task)
            # The tasks are the conditions: one task has nothing to compare.
            studies.append(replace(self, subjects=units, conditions=None))
        return tuple(studies)

    @property
    def unit(self) -> StimulusUnit:
        """The unit in which the stimuli are shown."""
        return self.subjects[0].unit

    def __len__(self) -> int:
        return len(self.subjects)

    def __iter__(self) -> Iterator[Subject]:
        return iter(self.subjects)

    def __getitem__(self, name: str | int) -> Subject:
        """A subject by name, which may be a whole number: 7 means '7'."""
        return of_subject(self._by_name, name, self.source)

    @cached_property
    def _by_name(self) -> dict[str, Subject]:
        return {subject.name: subject for subject in self.subjects}

    def select(self, names: Names) -> Study:
        """The study of these subjects, or of this one, in the order of the names."""
        return replace(self, subjects=tuple(self[name] for name in name_list(names)))

    def swap(self, name: Names, blocks: Names = ()) -> Study:
        """Exchange the two responses of a subject, or of several, in these blocks or in all.

        For a subject with swapped response keys, which :func:`~bayes_toe.check` finds. The option
        of commands is ``--swap``.

        Raises
        ------
        InputError
            If there is no such subject or block, or no block was read.

        Examples
        --------
        >>> Study([Subject("S01", [0.0], [0.3], [2], [5])]).swap("S01")["S01"].n_yes.tolist()
        [3]
        """
        return self._changed("--swap", "responses swapped", name, blocks, Answers.swapped)

    def exclude(self, name: Names, blocks: Names = ()) -> Study:
        """Exclude a subject, or several, or these blocks of them.

        The option of commands is ``--exclude``.

        Raises
        ------
        InputError
            If there is no such subject or block, no block was read, or no subject is left.

        Examples
        --------
        >>> study = Study([Subject(name, [0.0], [0.3], [2], [5]) for name in ("S01", "S02")])
        >>> study.exclude("S02").names, study.exclude("S02").changes
        (('S01',), ('--exclude S02',))
        """
        return self._changed("--exclude", "excluded", name, blocks, Answers.excluding)

    def _changed(
        self,
        option: str,
        description: str,
        names: Names,
        blocks: Names,
        change: Callable[[Answers, BoolArray], Answers],
    ) -> Study:
        """The study after a change of these blocks of subjects, or of all their answers.

        `change` makes new answers from answers and the rows to change. The notes have the
        description, and `changes` have the option.
        """
        study = self
        block_names = name_list(blocks)
        for name in dict.fromkeys(name_list(names)):  # a second swap would undo the first one
            subject = study[name]
            typed_option = f"{option} {cli_argument(name, block_names)}"
            rows = _rows(subject)
            try:
                changed_rows = change(rows, rows.rows_of(block_names))
            except InputError as error:
                raise InputError(f"{typed_option}: {error}") from None

            subjects = {**study._by_name}
            if changed_rows.n_trials.any():
                subjects[name] = _with_rows(subject, changed_rows, subject.task)
            else:
                del subjects[name]
            remaining_units = tuple(subjects.values())
            if not remaining_units:
                raise InputError(f"{typed_option}: no subject is left; exclude fewer")
            conditions = study.conditions
            if conditions is not None:
                remaining_units = with_shared_scales(remaining_units)
                conditions = conditions.among({unit.condition for unit in remaining_units})

            owner = f"subject {display_name(name)}"
            if block_names:
                owner += f", block{'s' * (len(block_names) > 1)} {join_names(block_names)}"
            study = replace(
                study,
                subjects=remaining_units,
                notes=(*study.notes, f"{owner}: {description}"),
                changes=(*study.changes, typed_option),
                conditions=conditions,
            )
        return study

    def frame(self) -> pd.DataFrame:
        """The counts, one row for each subject and pair.

        :func:`~bayes_toe.read_study` reads this table to the same study.

        The columns are subject, s1, s2 (natural-log intensity), and n_equal or n_second with
        n_trials, or n_first, n_equal and n_second.
        A study with conditions also has condition, a synthetic study `synthetic`, which is 1.

        Examples
        --------
        >>> Study([Subject("S01", [0.0], [0.3], [2], [5])]).frame().to_dict("list")
        {'subject': ['S01'], 's1': [0.0], 's2': [0.3], 'n_equal': [2], 'n_trials': [5]}
        """
        import pandas as pd

        require_study(self)
        names = [(subject.subject_name, subject.condition) for subject in self]
        n_pairs = [subject.n_pairs for subject in self]
        subject_names, levels = np.repeat(np.array(names, object), n_pairs, axis=0).T
        columns: Record = {"subject": subject_names}
        if self.conditions:
            columns["condition"] = levels
        counts: Texts = ("n_yes", "n_trials")
        if self.task == THREE_ANSWERS:
            counts = ("n_first", "n_yes", "n_second")
        for key, values in _joined_columns(self, ("s1", "s2", *counts)).items():
            columns[self.task.count if key == "n_yes" else key] = values
        if self.synthetic:
            columns["synthetic"] = 1
        return pd.DataFrame(columns)

    def __repr__(self) -> str:
        n_trials = sum(subject.total_trials for subject in self)
        size = f"{len(self):,} subjects ({join_few(self.names)}), {n_trials:,} trials"
        mark = ", synthetic" if self.synthetic else ""
        return f"<Study {self.source!r}{mark}: {size}>"

    def _repr_html_(self) -> str:
        frame = frame_of(self.subjects, ("name", "n_pairs", "total_trials", "fraction_yes"))
        frame.columns = ["subject", "pairs", "trials", f"fraction {self.task.yes!r}"]
        return as_html(repr(self)[1:-1], frame)


def pooled(units: Sequence[Subject]) -> Subject:
    """One subject with the answers of all its units, whatever the condition."""
    first = units[0]
    columns = _joined_columns(units, ("s1", "s2", *first.task.counts))
    return Subject(first.subject_name, **columns, task=first.task, unit=first.unit)


def units_by_subject(units: Iterable[Subject]) -> dict[str, tuple[Subject, ...]]:
    """The units of each subject, by its name."""
    by_subject: dict[str, tuple[Subject, ...]] = {}
    for unit in units:
        by_subject[unit.subject_name] = (*by_subject.get(unit.subject_name, ()), unit)
    return by_subject


def with_shared_scales(units: Iterable[Subject]) -> tuple[Subject, ...]:
    """Units with the location and scales of all stimuli of their subject, grouped by subject."""
    scaled_units = []
    for subject_units in units_by_subject(units).values():
        # A unit alone would give the scales back that it shares already.
        scales = common_scales(*(replace(unit, shared_scales=None) for unit in subject_units))
        scaled_units += [replace(unit, shared_scales=scales) for unit in subject_units]
    return tuple(scaled_units)


def common_scales(*subjects: Subject) -> StimulusScales | None:
    """Location and scales of the stimuli of several subjects together, or of one.

    One unit has the scales of its subject over all conditions. Without a pair of different stimuli,
    there are no scales.
    """
    if len(subjects) == 1 and subjects[0].shared_scales is not None:
        return subjects[0].shared_scales
    columns = _joined_columns(subjects, ("s1", "s2", "n_trials"))
    return StimulusScales.from_pairs(*columns.values())


def _joined_columns(units: Iterable[Subject], keys: Texts) -> Record:
    """Arrays of all units behind each other, by the names of the attributes."""
    columns: Record = {}
    for key in keys:
        columns[key] = np.concatenate([getattr(unit, key) for unit in units])
    return columns


def require_study(study: Any, several_tasks: bool = False) -> None:
    """Refuse what is no study, and a study of several tasks unless these are allowed."""
    rule = "a Study, such as bt.read_study(path or DataFrame) or bt.Study(subjects)"
    require_kind("study", study, Study, rule)
    tasks = [repr(task_study.task.name) for task_study in study.by_task]
    if len(tasks) > 1 and not several_tasks:
        raise InputError(
            f"{study.source}: found the tasks {join_words(tasks)}, allowed: one task, in a file of "
            "its own or in the rows that --where COLUMN=TEXT chooses; contrast compares tasks"
        )


def pairs_in_both_orders(subject: Subject) -> IndexArray:
    """Rows of pairs that were presented in both orders, shape (pairs, 2).

    The first column has the row with the weaker stimulus first.

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [4, 2, 1], [5, 5, 5])
    >>> pairs_in_both_orders(subject).tolist()
    [[1, 2]]
    """
    row_by_pair = {pair: row for row, pair in enumerate(subject.pairs)}
    rows = []
    for (s1, s2), row in row_by_pair.items():
        if s1 < s2 and (s2, s1) in row_by_pair:
            rows.append((row, row_by_pair[s2, s1]))
    return np.array(rows, np.intp).reshape(-1, 2)


def name_list(names: Names) -> list[str]:
    """A list of texts from one name or several; 7 becomes '7'."""
    if isinstance(names, str | int | np.integer):
        names = [names]
    require_kind("names", names, Iterable, "a name of a subject or block, or several in a list")
    return list(map(name_from_key, names))


def _rows(subject: Subject) -> Answers:
    """The answers of a subject, as they were given if this is known, else a row for each pair."""
    if subject.answers is not None:
        return subject.answers
    counts = [getattr(subject, name) for name in subject.task.counts]
    return counted_rows(subject.name, (subject.s1, subject.s2), *counts)


def _with_rows(subject: Subject, rows: Answers, task: Task) -> Subject:
    """The subject with other rows; the copy keeps them if the subject has answers of its own."""
    s1, s2 = rows.keys.T
    counts = {"n_second": None, **rows.named_counts}
    answers = None if subject.answers is None else rows
    return replace(subject, s1=s1, s2=s2, **counts, task=task, answers=answers)
