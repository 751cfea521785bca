"""Units: a subject in one condition is analysed as a subject of its own, such as S01@left.

`unit_column` has these names in place of the subjects. `with_conditions` gives the study its
conditions, or takes the names back if no subject has two levels. Where the levels are tasks,
`options_by_task` has the options for the rows of each task, and `study_of_tasks` makes one study.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from bayes_toe.arrays import FloatArray, combination_counts
from bayes_toe.data.answers import Counts
from bayes_toe.data.column_roles import has_word, looks_like, named_places, says_interval
from bayes_toe.data.conditions import Conditions
from bayes_toe.data.covariates import level_words, levels
from bayes_toe.data.messages import Texts, display_name, join_display_names, join_names, quoted
from bayes_toe.data.options import ReadOptions
from bayes_toe.data.study import Study, Subject, pooled, with_shared_scales
from bayes_toe.data.study_files import together
from bayes_toe.data.tasks import tasks_named
from bayes_toe.data.text_table import Column, Columns, TextTable, value_text
from bayes_toe.data.validation import CONDITION_SEPARATOR, number
from bayes_toe.errors import InputError

#: The condition whose levels are tasks.
TASK = "task"
#: With so many repeated trials it is no chance that each pair keeps its level.
_REPEATED = 10


def unit_column(table: TextTable, columns: Columns, categorical: bool) -> Column:
    """The column of the unit of each row, such as S01@left, from subjects and conditions.

    Numbers that are written differently are one level, unless the condition is categorical. A name
    with the sign that joins subject and level is a problem of the table.
    """
    subject = columns["subject"]
    condition = columns["condition"]
    for column in (subject, condition):
        is_joined = column.map(lambda text: CONDITION_SEPARATOR in text)
        table.fault(
            column,
            is_joined,
            f"a name without {CONDITION_SEPARATOR}, which joins subject and condition",
        )

    level_names = []
    for text in condition.texts:
        value = math.nan if categorical else number(text, table.decimal_comma)
        level_names.append(text if math.isnan(value) else value_text(value))

    unit_names = []  # each subject at each level
    for name in subject.texts:  # a unit without a subject has no name
        unit_names += [name and f"{name}{CONDITION_SEPARATOR}{level}" for level in level_names]
    unit_of_row = subject.codes * len(level_names) + condition.codes  # index in `unit_names`
    units = Column.from_texts(subject.name, unit_names, unit_of_row)
    return units.only(np.arange(len(unit_of_row)))  # without units that have no rows


def with_conditions(study: Study, options: ReadOptions) -> Study:
    """A study of units with their conditions; of subjects, if no subject has several levels.

    The units of `study` have names such as 'S01@left', if a condition was read.

    Raises
    ------
    InputError
        If the options name a condition with one level in every subject or a reference that cannot
        be used, or if only some files have the column.
    """
    has_options = options.reference is not None or options.categorical
    if "condition" not in study.reading.read:
        # The condition is then the task, unless --where chooses one of its levels.
        if options.condition is not None and options.condition not in options.where:
            raise InputError(
                f"{study.source}: --condition {options.condition}: found the task "
                f"{study.task.name!r} alone, allowed: two tasks or more"
            )
        if has_options:
            raise InputError(
                "--reference and --categorical-condition: found without a condition, allowed: with "
                "--condition COLUMN"
            )
        return study

    column = options.name("condition")
    units = []
    unit_levels = []
    for unit in study:
        _, _, level = unit.name.partition(CONDITION_SEPARATOR)
        units.append(replace(unit, condition=level))
        unit_levels.append(level)
    if not all(unit_levels):
        raise InputError(
            f"{study.source}: found column {display_name(column)} in some files only, "
            "allowed: in all or in none"
        )
    subject_names = [unit.subject_name for unit in units]
    if len(set(subject_names)) == len(subject_names):  # a single unit of each subject
        problem = f"column {display_name(column)}: found every subject at one level of it"
        if has_options or options.condition is not None:
            raise InputError(
                f"{study.source}: {problem}, allowed: at two and more of some subject; "
                "between subjects it is a covariate"
            )
        subjects = [replace(unit, name=unit.subject_name, condition="") for unit in units]
        note = f"{problem}, so that it is no condition within subjects: not used"
        return replace(study, subjects=tuple(subjects), notes=(*study.notes, note))

    order, is_numeric = _level_order(unit_levels, options)
    # Subjects stay in the order of the file.
    units.sort(
        key=lambda unit: (subject_names.index(unit.subject_name), order.index(unit.condition))
    )
    conditions = Conditions(column, tuple(order), is_numeric)
    notes = (*study.notes, f"condition {conditions.about}")
    return replace(study, subjects=with_shared_scales(units), conditions=conditions, notes=notes)


def options_by_task(table: TextTable, options: ReadOptions) -> tuple[TextTable, list[ReadOptions]]:
    """The table, perhaps with a note, and the options of each task, where tasks are the condition.

    The condition is then a column whose texts name tasks. Without a column `task`,
    `--condition task` means that each file has one task.

    Raises
    ------
    InputError
        If codes of responses are of two tasks, and the condition is not the task.
    """
    if options.condition is None:
        return table, [options]

    column = table.columns.get(options.condition)
    # All rows that are read are of one task.
    if options.condition in options.where or (column is None and options.condition == TASK):
        return table, [options.without_condition]
    tasks = {} if column is None else tasks_named(column.texts)
    if column is None or len(set(tasks.values())) < 2:  # the condition is no task
        replace(options, condition=None)  # an InputError if the codes are of two tasks
        return table, [options]

    left_out = [quoted(text) for text in column.texts if text not in tasks]
    if left_out:
        note = f"{column}: rows with {join_names(left_out)} left out, which tell no task"
        table = replace(table, notes=(*table.notes, note))
    return table, [options.of_task(task, {column.name: text}) for text, task in tasks.items()]


def study_of_tasks(studies: Sequence[Study], options: ReadOptions) -> Study:
    """One study of several; if tasks are the condition, its units are S01@2AFC and so on."""
    tasks = {study.task for study in studies}
    has_conditions = any("condition" in study.reading.read for study in studies)
    if options.condition is None or len(tasks) == 1 or has_conditions:
        return together(studies)  # one task, or conditions that are no tasks

    studies_of_units = []
    for study in studies:
        level = study.task.short_name
        units = []
        for subject in study:
            unit_name = f"{subject.name}{CONDITION_SEPARATOR}{level}"
            units.append(replace(subject, name=unit_name, condition=level))
        # `with_conditions` makes conditions of the names of units.
        reading = replace(study.reading, read=(*study.reading.read, "condition"))
        studies_of_units.append(replace(study, subjects=tuple(units), reading=reading))
    return together(studies_of_units)


def _level_order(unit_levels: Texts, options: ReadOptions) -> tuple[list[str], bool]:
    """The different levels, the reference first, and whether they are numbers.

    Examples
    --------
    >>> _level_order(["10", "2", "10"], ReadOptions())
    (['2', '10'], True)
    >>> _level_order(["left", "right"], ReadOptions(condition="hand", reference="right"))
    (['right', 'left'], False)
    """
    values = list(map(number, unit_levels))
    is_numeric = not options.categorical and not any(map(math.isnan, values))
    order = level_words(levels(values if is_numeric else unit_levels))

    reference = options.reference
    if reference is None:
        return order, is_numeric
    if is_numeric:
        raise InputError(
            f"--reference: found with levels that are numbers ({join_names(order)}), allowed: with "
            "--categorical-condition"
        )
    if reference not in order:
        raise InputError(
            f"--reference: found {quoted(reference)}, allowed: {join_display_names(order)}"
        )
    order.sort(key=lambda level: level != reference)
    return order, is_numeric


def follows_from_pairs(units_of_subjects: Iterable[Sequence[Subject]]) -> bool:
    """Whether pairs were repeated, and no subject gave one answer to one pair at two levels.

    The levels of such a condition may be names of pairs, of their order, or of the outcome.
    """
    n_repeated = 0
    for units in units_of_subjects:
        if len(units) == 1:
            continue
        subject = pooled(units)
        n_outcomes = _n_outcomes(subject)
        if n_outcomes < sum(map(_n_outcomes, units)):  # two levels have the same answer to a pair
            return False
        # Trials that could have given an answer again, at another level.
        n_repeated += subject.total_trials - n_outcomes
    return n_repeated >= _REPEATED


def _n_outcomes(unit: Subject) -> int:
    """In how many pairs the counted answer was given, and another answer, both numbers added up."""
    return int(np.count_nonzero([unit.n_yes, unit.n_trials - unit.n_yes]))


def pooled_conditions(
    columns: Iterable[Column], subject: Column, counts: Counts, pairs: FloatArray
) -> Iterator[str]:
    """The names of columns that may be a condition, in which a subject has several levels.

    A condition has 2 to 6 levels, none of them rare, which nearly all subjects have. It does not
    follow from stimuli and answers; but the pairs may tell the task. Names such as 'block' or
    'confidence', or of one of the stimuli, are of no condition.
    """
    answered = np.flatnonzero(counts["n_trials"])
    # Whether all answers of a row are the same: 'yes' or, of three, 'second'.
    outcomes = (np.array([*counts.values()]) == counts["n_trials"])[:, answered]
    subjects = subject.codes[answered]
    direction = np.sign(np.diff(pairs[answered]))  # of s2 - s1, shape (rows, 1)
    is_unequal = direction[:, 0] != 0.0  # equal stimuli have no order and no right answer

    for column in columns:
        has_other_meaning = (
            named_places(column.name).places
            or has_word(column.name, "of_no_condition")
            or says_interval(column)
        )
        row_levels = column.codes[answered]
        n_levels = len(combination_counts(row_levels))
        has_levels = 1 < n_levels <= min(6, len(answered) / _REPEATED)  # a condition has few
        if has_other_meaning or not has_levels:
            continue
        n_cells = len(combination_counts(subjects)) * n_levels  # each subject at each level
        # A level of a subject is rare with less than half of its share of the rows.
        is_rare = combination_counts(subjects, row_levels) < 0.5 * len(answered) / n_cells
        if np.count_nonzero(~is_rare) < 0.8 * n_cells:
            continue
        follows_from_stimuli = False
        # An order or an outcome follows from the direction, the name of a pair from the pair.
        for stimuli in (direction, pairs[answered]):
            # A group of rows has the same subject, answer and stimuli. If the level follows from
            # these, each group has one level.
            rows = np.column_stack([subjects, *outcomes, stimuli])[is_unequal]
            n_groups = len(combination_counts(*rows.T))
            n_group_levels = len(combination_counts(*rows.T, row_levels[is_unequal]))
            n_repeats = len(rows) - n_groups
            follows_from_stimuli |= n_repeats >= _REPEATED and n_group_levels == n_groups
        # Tasks may have pairs of their own.
        if not follows_from_stimuli or looks_like(column.name, "dimension"):
            yield column.name
