"""Trials that a study seems to have twice: everything learnt from them would look surer than it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import BoolArray, FloatArray, IndexArray, run_starts
from bayes_toe.data.answers import Answers
from bayes_toe.data.messages import bare, counted

_FEWEST = 20  # answers to one sequence of pairs that are not the same by chance
_TWICE = "trials that are there twice make everything look surer than it is"


def repeats(trial: FloatArray, *others: npt.NDArray[Any]) -> tuple[IndexArray, IndexArray]:
    """Rows with the number of a trial, and all other keys, of an earlier row, and these earliest rows; a number that is NaN repeats none.

    Examples
    --------
    >>> [rows.tolist() for rows in repeats(np.array([2.0, 1.0, 1.0, 2.0, 2.0]), np.array([0, 0, 0, 1, 0]))]
    [[2, 4], [1, 0]]
    """
    known = np.flatnonzero(~np.isnan(trial))
    order = known[np.lexsort([key[known] for key in (trial, *others)])]
    starts = run_starts(*(key[order] for key in (trial, *others)))
    again = np.ones(len(order), np.bool_)
    again[starts] = False
    first = np.repeat(order[starts], np.diff(starts, append=len(order)))
    by_row = np.argsort(order[again])
    return order[again][by_row], first[again][by_row]


def repeat_note(rows: tuple[int, int], subject: str, same: BoolArray, *, blocks: bool) -> list[str]:
    """What is said of rows that repeat others: the first of them and the row that it repeats, and which have the same pair and answer.

    Without blocks numbers of trials may begin anew in each: only rows that are the same in everything count.
    """
    if not (blocks or same.all()):
        return []
    what = f"{counted(len(same), 'row')} {'repeats' if len(same) == 1 else 'repeat'} {'block and ' if blocks else ''}trial of another row"
    first = f"first row {rows[0]}, which repeats row {rows[1]} (subject {bare(subject)})"
    if same.all():
        return [f"{what} with the same stimuli and answer, {first}: {_TWICE}, leave them out"]
    alike = f"{same.sum()} of them with the same stimuli and answer" if same.any() else "none with the same stimuli and answer"
    return [f"{what}, {alike}, {first}: unless these are several sessions under the same numbers, {_TWICE}"]


def copies(of: Sequence[tuple[str, Answers]], subject: str) -> list[str]:
    """What is said of files that have the same answers of a subject, trial by trial."""
    found: dict[tuple[bytes, bytes], str] = {}
    notes = []
    for source, one in of:
        if not one.trials or len(one.n_equal) < _FEWEST:
            continue
        earlier = found.setdefault((one.keys.tobytes(), one.n_equal.tobytes()), source)
        if earlier != source:
            what = f"{source} has the same {len(one.n_equal)} trials of subject {bare(subject)} as {earlier}"
            notes.append(f"{what}: {_TWICE}, leave one file out")
    return notes
