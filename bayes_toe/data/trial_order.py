"""Trials in the order in which they were given.

`answers_in_order` sorts the rows of each subject by session, block and trial number. It notes
missing trial numbers and times, and reports rows that repeat a trial number.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

from bayes_toe.arrays import FloatArray, IndexArray, IntArray, run_starts
from bayes_toe.data.answers import Answers
from bayes_toe.data.messages import TWICE, display_name, join_counts, join_names, plural
from bayes_toe.data.tasks import task_counted
from bayes_toe.data.text_table import Column, TextTable
from bayes_toe.data.validation import CONDITION_SEPARATOR, number, numbers

Numbers = TypeVar("Numbers", FloatArray, IntArray)
#: Runs in which numbers of trials may begin anew, the shortest first; memory does so at each of the
#: longest kind that there is.
_RUNS = ("block", "session")


def answers_in_order(
    table: TextTable,
    columns: Mapping[str, Column],
    keys: Sequence[FloatArray],
    parts: Mapping[str, IndexArray],
    counts: Mapping[str, IntArray],
) -> tuple[dict[str, Answers], list[str], list[str]]:
    """The answers of each subject in order, with notes and doubts.

    Notes say what is missing. Doubts name trials that the file has twice.

    `columns` has the columns by our names. `keys` are the pair of every row, NaN where a cell
    cannot be read. `parts` has the rows with answers of every subject. `counts` are the answers of
    each row by their names in :class:`Answers`; n_trials is 0 where nobody answered a trial.
    """
    is_trials = task_counted(columns) is None
    pairs, subject = np.column_stack(keys), columns["subject"]
    runs = {name: _ranked(table, columns[name]) for name in _RUNS if name in columns}
    blocks, block_rank = runs.get("block", ((), None))
    ranks = np.column_stack([np.zeros(len(pairs), np.int64), *(rank for _, rank in runs.values())])
    trial, iti = _trial_numbers(table, columns) if is_trials else (None, None)
    if trial is None:
        rows_with_pair = parts
    else:
        rows_with_pair = _rows_with_a_pair(subject, pairs, "condition" in columns)

    answers, unordered, n_missing, n_untimed = dict[str, Answers](), list[str](), {}, 0
    for name, part in parts.items():
        rows, place, n_absent = _in_order((rows_with_pair[name], part), trial, ranks)
        if trial is not None and place is None:
            unordered.append(display_name(name))
        if n_absent:
            n_missing[name.partition(CONDITION_SEPARATOR)[0]] = n_absent
        # Rows of the same subject in other conditions stay in the sequence, without answers.
        is_own_row = subject.codes[rows] == subject.codes[part[0]]
        in_order = Answers(
            keys=pairs[rows],
            **{name: np.where(is_own_row, count[rows], 0) for name, count in counts.items()},
            block=_at_rows(block_rank, rows),
            blocks=blocks,
            has_trial_rows=is_trials,
            place=place,
            iti=None if place is None else _at_rows(iti, rows),
            span=(int(part.min()), int(part.max())) if is_trials else None,
        )
        if in_order.iti is not None:
            is_untimed = np.isnan(in_order.iti) & ~in_order.is_session_start
            n_untimed += int(is_untimed.sum())
        answers[name] = in_order.with_own_blocks()
    notes = _order_notes(columns, unordered, n_missing, n_untimed)
    # No trial is there twice where the order is known.
    doubts = _repeated(table, columns, keys, counts) if unordered else []
    return answers, notes, doubts


def _at_rows(column: Numbers | None, rows: IndexArray) -> Numbers | None:
    """The numbers of a column in these rows, where there is the column."""
    return None if column is None else column[rows]


def _trial_numbers(
    table: TextTable, columns: Mapping[str, Column]
) -> tuple[FloatArray | None, FloatArray | None]:
    """Numbers of trials, and the times before them; None without such a column."""
    if "trial" not in columns:
        return None, None
    trial = numbers(table, columns["trial"])
    if "iti" not in columns:
        return trial, None
    iti = numbers(table, columns["iti"])
    return trial, np.where(iti >= 0.0, iti, math.nan)


def _in_order(
    choices: Sequence[IndexArray], trial: FloatArray | None, ranks: IntArray
) -> tuple[IndexArray, IntArray | None, int]:
    """The rows of a subject in order, their places, and how many trials are missing.

    They are the first choice whose order is known: rows without an answer may be no trials. Where
    no order is known, they are the last choice, without places.
    """
    if trial is not None:
        for rows in choices:
            ordered = _ordered(rows, trial, ranks)
            if ordered is not None:
                return ordered, *_places(trial[ordered], ranks[ordered, -1])
    return choices[-1], None, 0


def _order_notes(
    columns: Mapping[str, Column],
    unordered: Sequence[str],
    n_missing: Mapping[str, int],
    n_untimed: int,
) -> list[str]:
    """Notes on trials whose order, number or time is not known."""
    notes = []
    if unordered:
        problem = f"column {display_name(columns['trial'].name)} does not order all trials"
        notes.append(f"{problem}, so the order of the file is used: {join_names(unordered)}")
    if n_missing:
        notes.append(
            f"trial numbers are missing ({join_counts(n_missing)}); keep trials without a response "
            "in the file, with an empty response"
        )
    if n_untimed:
        notes.append(
            f"no time since the trial before for {plural(n_untimed, 'trial')} in column "
            f"{display_name(columns['iti'].name)}"
        )
    return notes


def _rows_with_a_pair(
    subject: Column, pairs: FloatArray, has_conditions: bool
) -> dict[str, IndexArray]:
    """Rows of every subject that have a pair, with an answer or without.

    A unit has the rows of its subject in all conditions.
    """
    names = subject.texts
    if has_conditions:
        names = [text.partition(CONDITION_SEPARATOR)[0] for text in subject.texts]
    owner = Column.from_texts(subject.name, names, subject.codes)
    rows_of = owner.rows_by_text(np.flatnonzero(~np.isnan(pairs).any(axis=1)))
    units = zip(subject.texts, names, strict=True)
    return {unit: rows_of[name] for unit, name in units if name in rows_of}


def _ranked(table: TextTable, column: Column) -> tuple[tuple[str, ...], IntArray]:
    """Names of blocks or sessions in their order, and which of them each row's is.

    The order is that of numbers where all are numbers, else that of appearance.
    """
    values = np.array([number(text, table.decimal_comma) for text in column.texts])
    order = np.arange(len(values))
    if not np.isnan(values).any():
        order = np.argsort(values, kind="stable")
    names = tuple(column.texts[place] for place in order.tolist())
    return names, np.argsort(order)[column.codes]


def _ordered(rows: IndexArray, trial: FloatArray, ranks: IntArray) -> IndexArray | None:
    """Rows in the order in which their trials were given; None if that is not known.

    By their numbers where these are unique, else by block, or session, too.
    """
    numbers_of_rows = trial[rows]
    if np.isnan(numbers_of_rows).any():
        return None
    for last in range(1, ranks.shape[1] + 1):
        keys = (numbers_of_rows, *ranks[rows, :last].T)
        order = np.lexsort(keys)
        is_unique = len(run_starts(*(key[order] for key in keys))) == len(rows)
        if is_unique:
            return rows[order]
    return None


def _places(trial: FloatArray, run: IntArray) -> tuple[IntArray, int]:
    """Places of trials in their order, and how many numbers are left out within runs.

    There is a gap between places where another run begins.
    """
    is_new_run = np.diff(run) != 0
    missing = 0
    if (trial == np.floor(trial)).all():
        steps = np.diff(trial)[~is_new_run]
        missing = int((steps[steps > 1] - 1).sum())
    return np.arange(len(trial)) + np.r_[0, np.cumsum(is_new_run)], missing


def _repeated(
    table: TextTable,
    columns: Mapping[str, Column],
    keys: Sequence[FloatArray],
    counts: Mapping[str, IntArray],
) -> list[str]:
    """A doubt about answered trials that repeat the number and all else of an earlier row.

    There is none where a row with a number that is there twice is another trial: numbers may begin
    anew.
    """
    import pandas as pd

    subject = columns["subject"]
    runs = {name: columns[name].codes for name in _RUNS if name in columns}
    trial = numbers(table, columns["trial"])
    is_numbered = (counts["n_trials"] > 0) & ~np.isnan(trial)
    identity = pd.DataFrame({"subject": subject.codes, **runs, "trial": trial})[is_numbered]
    columns_of_content = {"s1": keys[0], "s2": keys[1], **counts}
    content = identity.assign(
        **{name: values[is_numbered] for name, values in columns_of_content.items()}
    )
    is_repeat = content.duplicated()
    n_repeats = int(is_repeat.sum())
    if not n_repeats or identity.duplicated().sum() > n_repeats:
        return []

    later = content.index[is_repeat][0]
    is_same = (content == content.loc[later]).all(axis=1)
    earlier = content.index[is_same][0]
    verb = "repeats" if n_repeats == 1 else "repeat"
    number_words = "block and trial" if "block" in columns else "trial"
    problem = f"{plural(n_repeats, 'row')} {verb} {number_words} of another row"
    row, other, name = table.rows[later], table.rows[earlier], display_name(subject.text(later))
    location = f"first row {row}, which repeats row {other} (subject {name})"
    return [f"{problem} with the same stimuli and answer, {location}: {TWICE}, remove them"]
