"""Answers as they were given, before they are pooled: what counts per pair can no longer tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray, IndexArray, IntArray


@dataclass(frozen=True, eq=False)
class Answers:
    """Rows of one subject that have an answer, in the order in which they were given where rows are trials.

    Parameters
    ----------
    keys : array, shape (rows, 2 or 3)
        The pair of each row: s1 and s2 (natural-log intensities), and isi (seconds) where the study has intervals.
    n_equal, n_trials : array of int, shape (rows,)
        Answers 'equal' and answers; a trial is a count of one.
    block : array of int, shape (rows,), optional
        Where in `blocks` the name of each row's block stands; None without such a column.
    blocks : tuple of str
        Names of the blocks, in their order.
    trials : bool
        Whether rows are trials.
    """

    keys: FloatArray
    n_equal: IntArray
    n_trials: IntArray
    block: IntArray | None
    blocks: tuple[str, ...]
    trials: bool


@dataclass(frozen=True, eq=False)
class Reading:
    """What a file told besides the counts.

    Parameters
    ----------
    answers : mapping of str to Answers
        By subject, where rows are trials or have a block.
    read : tuple of str
        Columns that were read, by our names.
    ignored : tuple of str
        Columns that were not, by their names in the file.
    """

    answers: Mapping[str, Answers] = field(default_factory=dict)
    read: tuple[str, ...] = ()
    ignored: tuple[str, ...] = ()


def order_of_trials(trial: FloatArray, block: IntArray) -> IndexArray | None:
    """The order in which trials were given: by their numbers where these are unique, else by block and number; None where neither tells.

    Examples
    --------
    >>> order_of_trials(np.array([2.0, 1.0, 1.0]), np.array([0, 0, 1])).tolist()
    [1, 0, 2]
    """
    known: BoolArray = ~np.isnan(trial)
    if not known.all():
        return None
    if len(np.unique(trial)) == len(trial):
        return np.argsort(trial)
    unique = len(np.unique(np.column_stack([block, trial]), axis=0)) == len(trial)
    return np.lexsort((trial, block)) if unique else None
