"""Trials in the order in which they were given.

What each subject answered row by row, and where memory begins anew.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from bayes_toe.arrays import FloatArray, IndexArray, IntArray, run_starts
from bayes_toe.data.answers import Answers
from bayes_toe.data.messages import TWICE, bare, counted, listed
from bayes_toe.data.text_table import Column, TextTable
from bayes_toe.data.validation import AT, number, numbers

#: Runs in which numbers of trials may begin anew, the shortest first; memory does so at each of the
#: longest kind that there is.
_RUNS = ("block", "session")


def answers_in_order(
    table: TextTable,
    columns: Mapping[str, Column],
    keys: Sequence[FloatArray],
    parts: Mapping[str, IndexArray],
    k: IntArray,
    n: IntArray,
) -> tuple[dict[str, Answers], list[str], list[str]]:
    """What each subject answered, notes of what is missing, and doubts about trials that are there twice.

    Columns are by our names; `keys` are the pair of every row, NaN where a cell cannot be read;
    `parts` the rows of every subject that have answers; k answers that the task counts and n all
    answers of each row, none of a trial that nobody answered.
    """
    trials, pairs = "n_trials" not in columns, np.column_stack(keys)
    runs = {name: _ranked(table, columns[name]) for name in _RUNS if name in columns}
    trial, iti = (
        numbers(table, columns[name]) if trials and name in columns else None
        for name in ("trial", "iti")
    )
    blocks, rank = runs.get("block", ((), None))
    ranks = np.column_stack([np.zeros(len(n), np.int64), *(one for _, one in runs.values())])
    felt = parts if trial is None else _felt(columns["subject"], pairs, "condition" in columns)
    found, disordered, gaps, untimed = dict[str, Answers](), list[str](), dict[str, int](), 0
    for name, part in parts.items():
        at, place, timed = part, None, None
        if trial is not None:  # rows without an answer may be something else than trials
            ordered = next(
                (
                    some[order]
                    for some in (felt[name], part)
                    if (order := _order(trial[some], ranks[some])) is not None
                ),
                None,
            )
            disordered += [bare(name)] if ordered is None else []
            if ordered is not None:
                at, place, missing = ordered, *_places(trial[ordered], ranks[ordered, -1])
                timed = None if iti is None else np.where(iti[at] >= 0.0, iti[at], math.nan)
                gaps |= (
                    {name.partition(AT)[0] if "condition" in columns else name: missing}
                    if missing
                    else {}
                )
        own = columns["subject"].codes[at] == columns["subject"].codes[part[0]]
        n_yes, n_trials = (np.where(own, counts[at], 0) for counts in (k, n))
        span = (int(part.min()), int(part.max())) if trials else None
        every = Answers(
            pairs[at],
            n_yes,
            n_trials,
            None if rank is None else rank[at],
            blocks,
            trials,
            place,
            timed,
            span,
        )
        found[name] = every.without(
            np.zeros(len(at), np.bool_)
        )  # with the blocks that are this subject's
        untimed += 0 if timed is None else int(np.isnan(timed[~every.begins]).sum())
    notes = []
    if disordered:
        what = f"column {bare(columns['trial'].name)} does not order all trials"
        notes.append(f"{what}, so the order of the file is used: {listed(disordered)}")
    if gaps:
        missed = listed([f"{bare(name)} {count}" for name, count in gaps.items()])
        notes.append(
            f"trial numbers are missing ({missed}); keep trials without a response in the file, "
            "with an empty response"
        )
    if untimed:
        notes.append(
            f"no time since the trial before for {counted(untimed, 'trial')} in column "
            f"{bare(columns['iti'].name)}"
        )
    return (
        found,
        notes,
        _repeated(table, columns, keys, k, n) if disordered else [],
    )  # no trial is there twice where the order is known


def _felt(subject: Column, pairs: FloatArray, units: bool) -> dict[str, IndexArray]:
    """Rows of every subject that have a pair, with an answer or without.

    Of a unit those of its subject in all conditions.
    """
    people = [text.partition(AT)[0] if units else text for text in subject.texts]
    places = {person: place for place, person in enumerate(people)}
    whose = np.array([places[person] for person in people])[subject.codes]
    rows = np.flatnonzero(~np.isnan(pairs).any(axis=1))
    rows = rows[np.argsort(whose[rows], kind="stable")]
    of = {people[whose[some[0]]]: some for some in np.split(rows, run_starts(whose[rows])[1:])}
    return {
        text: of[person] for text, person in zip(subject.texts, people, strict=True) if person in of
    }


def _ranked(table: TextTable, column: Column) -> tuple[tuple[str, ...], IntArray]:
    """Names of blocks or sessions in their order, by number where all are numbers, else by appearance; and which of them each row's is."""
    values = [number(text, table.decimal_comma) for text in column.texts]
    order = (
        np.arange(len(values))
        if any(map(math.isnan, values))
        else np.argsort(values, kind="stable")
    )
    return tuple(column.texts[one] for one in order.tolist()), np.argsort(order)[column.codes]


def _order(trial: FloatArray, ranks: IntArray) -> IndexArray | None:
    """The order in which trials were given.

    By their numbers where these are unique, else by block, or session, too; None if not known.
    """
    for last in range(1, ranks.shape[1] + 1):
        keys = (trial, *ranks[:, :last].T)
        order = np.lexsort(keys)
        if not np.isnan(trial).any() and len(run_starts(*(key[order] for key in keys))) == len(
            trial
        ):
            return np.asarray(order)
    return None


def _places(trial: FloatArray, run: IntArray) -> tuple[IntArray, int]:
    """Places of trials in their order, with a gap where another run begins, and how many numbers are left out within runs."""
    anew = np.diff(run) != 0
    steps = np.diff(trial)[~anew]
    missing = int((steps[steps > 1] - 1).sum()) if (trial == np.floor(trial)).all() else 0
    return np.arange(len(trial)) + np.r_[0, np.cumsum(anew)], missing


def _repeated(
    table: TextTable,
    columns: Mapping[str, Column],
    keys: Sequence[FloatArray],
    k: IntArray,
    n: IntArray,
) -> list[str]:
    """What is said of answered trials with the number, subject and block of an earlier row.

    A row without a number repeats none.
    """
    block, trial, subject = (
        columns.get("block"),
        numbers(table, columns["trial"]),
        columns["subject"],
    )
    seen, again = dict[tuple[float, ...], int](), list[tuple[int, int]]()
    blocks = np.column_stack(
        [column.codes for column in (block, columns.get("session")) if column]
        or [np.zeros(len(n), np.int64)]
    )
    for row in np.flatnonzero((n > 0) & ~np.isnan(trial)).tolist():
        first = seen.setdefault((subject.codes[row], *blocks[row], trial[row]), row)
        again += [(row, first)] if first != row else []
    if not again:
        return []
    later, earlier = np.array(again).T
    same = np.logical_and.reduce([key[later] == key[earlier] for key in (*keys, k)])
    if block is None and not same.all():
        # without blocks numbers may begin anew in each: only rows that are the same in everything
        # count
        return []
    verb = "repeats" if len(same) == 1 else "repeat"
    what = f"{counted(len(same), 'row')} {verb} {'' if block is None else 'block and '}trial of another row"
    row, other = (table.rows[one[0]] for one in (later, earlier))
    where = f"first row {row}, which repeats row {other} (subject {bare(subject.text(later[0]))})"
    if same.all():
        return [f"{what} with the same stimuli and answer, {where}: {TWICE}, remove them"]
    alike = (
        f"{same.sum()} of them with the same stimuli and answer"
        if same.any()
        else "none with the same stimuli and answer"
    )
    return [
        f"{what}, {alike}, {where}: unless these are several sessions under the same numbers, "
        f"{TWICE}"
    ]
