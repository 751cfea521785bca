"""Trials in the order in which they were given.

`answers_in_order` sorts the rows of each subject by session, block and trial number. It reports
rows that repeat a trial number.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray, IndexArray, IntArray, combination_counts, run_starts
from bayes_toe.data.answers import Answers, Counts
from bayes_toe.data.column_roles import role_by_cells
from bayes_toe.data.messages import TWICE, Note, display_name, plural
from bayes_toe.data.tasks import are_trials
from bayes_toe.data.text_table import Column, Columns, TextTable
from bayes_toe.data.validation import CONDITION_SEPARATOR, number, numbers

#: Columns of runs in which numbers of trials may begin anew, the shortest run first.
_RUNS = ("block", "session")


class _Order(NamedTuple):
    """What orders the rows of a file."""

    trial: FloatArray  # numbers of trials, (rows,); NaN without a number
    # The number of each row's run, (rows, kinds of runs). In the first column all rows are one run;
    # the next columns have blocks and sessions, as far as the file has them.
    runs: IntArray
    block: IntArray | None  # index in `blocks`, (rows,)
    blocks: tuple[str, ...]


def answers_in_order(
    table: TextTable,
    columns: Columns,
    pairs: FloatArray,
    rows_of_units: Mapping[str, IndexArray],
    counts: Counts,
) -> tuple[dict[str, Answers], list[str], list[str]]:
    """The answers of each unit in order, with notes and doubts.

    A unit is a subject, or a subject in one condition. A note names subjects whose trials have no
    order. Doubts name trials that the file has twice.

    `columns` has the columns by our names. `pairs` are the stimuli of every row, NaN where a cell
    cannot be read. `rows_of_units` has the rows with answers of every unit. `counts` are the
    answers of each row by their names in :class:`Answers`; n_trials is 0 where nobody answered.
    """
    is_trials = are_trials(columns)
    unit = columns["subject"]
    if "condition" in columns:  # 'S01@left' is a unit of 'S01'
        names = [text.partition(CONDITION_SEPARATOR)[0] for text in unit.texts]
        subject = Column.from_texts(unit.name, names, unit.codes)
    else:
        subject = unit
    rows_with_pair = subject.rows_by_text(np.flatnonzero(~np.isnan(pairs).any(axis=1)))
    order = _order_of_rows(table, columns)

    answers = {}
    unordered_names = []
    for name, answered_rows in rows_of_units.items():
        rows = answered_rows
        place = None
        if is_trials and "trial" in columns:
            subject_name = subject.text(answered_rows[0])
            # Trials without an answer, and in other conditions, are part of the order. But if rows
            # without an answer are no trials, they may have no order, so that the answered rows are
            # the second choice.
            ordered = _ordered((rows_with_pair[subject_name], answered_rows), order)
            if ordered is None:
                unordered_names.append(display_name(name))
            else:
                rows = ordered
                # Memory ends where a run of the longest kind ends.
                place = _places(order.runs[rows, -1])

        # Trials of other units have no answers here.
        is_own_row = unit.codes[rows] == unit.codes[answered_rows[0]]
        in_order = Answers(
            keys=pairs[rows],
            **{key: np.where(is_own_row, values[rows], 0) for key, values in counts.items()},
            block=None if order.block is None else order.block[rows],
            blocks=order.blocks,
            has_trial_rows=is_trials,
            place=place,
            span=(int(answered_rows.min()), int(answered_rows.max())) if is_trials else None,
        )
        answers[name] = in_order.with_own_blocks()

    if not unordered_names:  # no number is there twice
        return answers, [], []
    note = Note(
        f"{columns['trial']} does not order all trials, so the order of the file is used for ",
        unordered_names,
        ". If its numbers begin anew, two persons or sessions may be pooled: --columns "
        "subject=NAME or session=NAME keeps them apart, or --where one of them",
    )
    return answers, [note], _repeat_doubts(table, unit, order, pairs, counts)


def _order_of_rows(table: TextTable, columns: Columns) -> _Order:
    """The columns that order rows; numbers of trials are NaN if the file has none."""
    n_rows = len(table.rows)
    if "trial" in columns:
        trial = numbers(table, columns["trial"])
    else:
        trial = np.full(n_rows, np.nan)

    runs = [np.zeros(n_rows, np.int64)]  # all rows are one run
    blocks: tuple[str, ...] = ()
    block = None
    for name in _RUNS:
        if name not in columns:
            continue
        column = columns[name]
        # Runs are in the order of their numbers where all are numbers, else in that of appearance.
        values = [number(text, table.decimal_comma) for text in column.texts]
        order = np.arange(len(values))
        if not np.isnan(values).any():
            order = np.argsort(values, kind="stable")
        rank = np.argsort(order)  # the inverse of the order
        runs.append(rank[column.codes])
        if name == "block":
            blocks = tuple(np.array(column.texts, object)[order])
            block = runs[-1]
    return _Order(trial, np.column_stack(runs), block, blocks)


def _ordered(choices: Sequence[IndexArray], order: _Order) -> IndexArray | None:
    """The first choice of rows whose order is known, in this order; None if no order is known.

    Rows have the order of the numbers of trials; where these are not unique, the order of blocks
    and the numbers in them; else that of sessions, blocks and numbers.
    """
    for rows in choices:
        trial = order.trial[rows]
        # All rows are one run; then each block is a run, then each block of a session.
        for n_kinds in range(1, order.runs.shape[1] + 1):
            keys = (trial, *order.runs[rows, :n_kinds].T)
            index = np.lexsort(keys)  # the last key counts first
            is_unique = len(run_starts(*(key[index] for key in keys))) == len(rows)
            if is_unique and not np.isnan(trial).any():
                return rows[index]
    return None


def _places(run: IntArray) -> IntArray:
    """Places of trials in their order.

    A place is left out where another run begins: trials 1, 2, 4 of run 0 and 1 of run 1 have the
    places 0, 1, 2, 4.
    """
    is_new_run = np.diff(run) != 0
    n_earlier_runs = np.r_[0, np.cumsum(is_new_run)]  # each leaves out a place at its end
    return np.arange(len(run)) + n_earlier_runs


def _repeat_doubts(
    table: TextTable, unit: Column, order: _Order, pairs: FloatArray, counts: Counts
) -> list[str]:
    """A doubt about answered trials that repeat the number and all else of an earlier row.

    If other rows repeat a number and differ, numbers may begin anew. If they do in a file of a
    single subject, there is a doubt for each column in whose blocks no number is repeated. Without
    such a column, there is a doubt if ten rows or more repeat a number.
    """
    import pandas as pd  # slow to load, and seldom needed

    number_of_trial = [unit.codes, *order.runs.T, order.trial]
    rows = pd.DataFrame(np.column_stack([*number_of_trial, pairs, *counts.values()]))
    rows = rows[counts["n_trials"] > 0].dropna()
    is_repeat = rows.duplicated()
    n_repeats = sum(is_repeat)
    repeats_number = rows.duplicated(list(range(len(number_of_trial))))
    if not n_repeats or repeats_number.sum() > n_repeats:  # some repeat the number alone
        if len(unit.texts) > 1:
            return []
        problem = f"all rows are of subject {unit.texts[0]}, but trial numbers begin anew"
        doubts = [
            f"{problem} wherever {column} changes. If it tells subjects apart, type --columns "
            f"subject={column.name}"
            for column in table.columns.values()
            if role_by_cells(column) == "subject"
            and combination_counts(column.codes, order.trial).max() == 1
        ]
        if not doubts and repeats_number.sum() >= 10:
            doubts.append(
                f"{problem}. If there are several, add a column subject; if not, a column session"
            )
        return doubts

    first_repeat = rows.index[is_repeat][0]
    name = display_name(unit.text(first_repeat))
    return [
        f"{plural(n_repeats, 'row')} with the trial number and all cells of an earlier row, first "
        f"row {table.rows[first_repeat]} (subject {name}): {TWICE}, remove them"
    ]
