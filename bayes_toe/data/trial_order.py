"""Trials in the order in which they were given.

`answers_in_order` sorts the rows of each subject by session, block and trial number. It notes
missing trial numbers and times, and reports rows that repeat a trial number.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bayes_toe.arrays import FloatArray, IndexArray, IntArray, run_starts
from bayes_toe.data.answers import Answers, Counts
from bayes_toe.data.messages import TWICE, Note, Texts, display_name, named_counts, plural
from bayes_toe.data.tasks import are_trials
from bayes_toe.data.text_table import Column, Columns, TextTable
from bayes_toe.data.validation import CONDITION_SEPARATOR, number, numbers

#: Runs in which numbers of trials may begin anew, the shortest first; memory does so at each of the
#: longest kind that there is.
_RUNS = ("block", "session")


def answers_in_order(
    table: TextTable,
    columns: Columns,
    pairs: FloatArray,
    parts: Mapping[str, IndexArray],
    counts: Counts,
) -> tuple[dict[str, Answers], list[str], list[str]]:
    """The answers of each subject in order, with notes and doubts.

    Notes say what is missing. Doubts name trials that the file has twice.

    `columns` has the columns by our names. `pairs` are the stimuli of every row, NaN where a cell
    cannot be read. `parts` has the rows with answers of every subject. `counts` are the answers of
    each row by their names in :class:`Answers`; n_trials is 0 where nobody answered a trial.
    """
    is_trials = are_trials(columns)
    subject, owner = columns["subject"], _without_conditions(columns)
    rows_with_pair = owner.rows_by_text(np.flatnonzero(~np.isnan(pairs).any(axis=1)))

    runs = {name: _ranked(table, columns[name]) for name in filter(columns.__contains__, _RUNS)}
    blocks, block_rank = runs.get("block", ((), None))
    ranks = np.column_stack([np.zeros(len(pairs), np.int64), *(rank for _, rank in runs.values())])
    trial = times = np.full(len(pairs), np.nan)
    is_numbered = is_trials and "trial" in columns
    if is_numbered:
        trial = numbers(table, columns["trial"])
    if "iti" in columns:
        times = numbers(table, columns["iti"])
        times[times < 0.0] = np.nan

    answers = {}
    unordered = []
    n_missing = {}
    n_untimed = 0
    for name, answered_rows in parts.items():
        rows, place, iti = answered_rows, None, None
        if is_numbered:
            owner_name = owner.text(answered_rows[0])
            # Rows without an answer may be no trials.
            ordered = _ordered((rows_with_pair[owner_name], answered_rows), trial, ranks)
            if ordered is None:
                unordered.append(display_name(name))
            else:
                rows = ordered
                place, n_absent = _places(trial[rows], ranks[rows, -1])
                if n_absent:
                    n_missing[owner_name] = n_absent
                if "iti" in columns:
                    iti = times[rows]

        # Rows of the same subject in other conditions stay in the sequence, without answers.
        is_own_row = subject.codes[rows] == subject.codes[answered_rows[0]]
        in_order = Answers(
            keys=pairs[rows],
            **{key: np.where(is_own_row, values[rows], 0) for key, values in counts.items()},
            block=None if block_rank is None else block_rank[rows],
            blocks=blocks,
            has_trial_rows=is_trials,
            place=place,
            iti=iti,
            span=(int(answered_rows.min()), int(answered_rows.max())) if is_trials else None,
        )
        if iti is not None:
            n_untimed += int((np.isnan(iti) & ~in_order.is_session_start).sum())
        answers[name] = in_order.with_own_blocks()

    notes = _order_notes(columns, unordered, n_missing, n_untimed)
    return answers, notes, _repeated(table, columns, pairs, counts, unordered)


def _without_conditions(columns: Columns) -> Column:
    """The subject of each row, also of a unit, which is a subject in a condition."""
    subject = columns["subject"]
    if "condition" not in columns:
        return subject
    names = [text.partition(CONDITION_SEPARATOR)[0] for text in subject.texts]
    return Column.from_texts(subject.name, names, subject.codes)


def _order_notes(
    columns: Columns, unordered: list[str], n_missing: Mapping[str, int], n_untimed: int
) -> list[str]:
    """Notes on trials whose order, number or time is not known."""
    notes = list[str]()
    if unordered:
        text = "does not order all trials, so the order of the file is used: "
        notes.append(Note(f"{columns['trial']} {text}", unordered))
    if n_missing:
        advice = "); keep trials without a response in the file, with an empty response"
        notes.append(Note("trial numbers are missing (", named_counts(n_missing), advice))
    if n_untimed:
        times = f" in {columns['iti']}"
        notes.append(Note("no time since the trial before for ", (n_untimed, "trial"), times))
    return notes


def _ranked(table: TextTable, column: Column) -> tuple[tuple[str, ...], IntArray]:
    """Names of blocks or sessions in their order, and the index of the one of each row.

    The order is that of numbers where all are numbers, else that of appearance.
    """
    values = [number(text, table.decimal_comma) for text in column.texts]
    order = np.arange(len(values))
    if not np.isnan(values).any():
        order = np.argsort(values, kind="stable")
    names = tuple(np.array(column.texts, object)[order])
    return names, np.argsort(order)[column.codes]


def _ordered(
    choices: Sequence[IndexArray], trial: FloatArray, ranks: IntArray
) -> IndexArray | None:
    """The first choice of rows whose order is known, in this order; None if there is none.

    The order is that of the numbers of trials. Where these are not unique, block and session count
    first.
    """
    for rows in choices:
        for n_ranks in range(1, ranks.shape[1] + 1):
            keys = (trial[rows], *ranks[rows, :n_ranks].T)
            order = np.lexsort(keys)
            is_unique = len(run_starts(*(key[order] for key in keys))) == len(rows)
            if is_unique and not np.isnan(trial[rows]).any():
                return rows[order]
    return None


def _places(trial: FloatArray, run: IntArray) -> tuple[IntArray, int]:
    """Places of trials in their order, and how many numbers are left out within runs.

    There is a gap between places where another run begins.
    """
    is_new_run = np.diff(run) != 0
    missing = 0
    if (trial % 1 == 0).all():
        steps = np.diff(trial)[~is_new_run]
        missing = int((steps[steps > 1] - 1).sum())
    return np.arange(len(trial)) + np.r_[0, np.cumsum(is_new_run)], missing


def _repeated(
    table: TextTable, columns: Columns, pairs: FloatArray, counts: Counts, unordered: Texts
) -> list[str]:
    """A doubt about answered trials that repeat the number and all else of an earlier row.

    There is none where a row with a number that is there twice is another trial: numbers may begin
    anew. No trial is there twice where the order is known.
    """
    if not unordered:
        return []
    import pandas as pd  # slow to load, and seldom needed

    numbered_by = [name for name in ("subject", *_RUNS) if name in columns]
    rows = pd.DataFrame({name: columns[name].codes for name in numbered_by})
    rows["trial"] = numbers(table, columns["trial"])
    rows = rows.assign(s1=pairs[:, 0], s2=pairs[:, 1], **counts)
    rows = rows[rows["n_trials"] > 0].dropna(subset="trial")
    is_repeat = rows.duplicated()
    n_repeats = int(is_repeat.sum())
    if not n_repeats or rows.duplicated([*numbered_by, "trial"]).sum() > n_repeats:
        return []

    later = rows.index[is_repeat][0]
    name = display_name(columns["subject"].text(later))
    return [
        f"{plural(n_repeats, 'row')} with the trial number and all else of an earlier row, first "
        f"row {table.rows[later]} (subject {name}): {TWICE}, remove them"
    ]
