"""Answers as they were given, before they are pooled: what counts per pair can no longer tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import BoolArray, FloatArray, IndexArray, IntArray, run_starts


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
    doubts : tuple of str
        What is probably a mistake in the file: a sentence each, without its full stop.
    """

    answers: Mapping[str, Answers] = field(default_factory=dict)
    read: tuple[str, ...] = ()
    ignored: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


def order_of_trials(owner: IntArray, trial: FloatArray, block: IntArray) -> tuple[IndexArray, BoolArray]:
    """The order in which trials were given, and of which owners it is not known, shape (owners,): theirs stays as it is.

    By their numbers where these are unique, else by block and number; by owner first.

    Examples
    --------
    >>> [part.tolist() for part in order_of_trials(np.array([0, 0, 0, 1]), np.array([2.0, 1.0, 1.0, np.nan]), np.array([0, 0, 1, 0]))]
    [[1, 0, 2, 3], [False, True]]
    """
    unknown = np.bincount(owner, np.isnan(trial)) > 0
    by_trial, by_block = (~unknown & ~_repeated(owner, *keys) for keys in ((trial,), (block, trial)))
    number = np.where((by_trial | by_block)[owner], trial, 0.0)
    part = np.where((by_block & ~by_trial)[owner], block, 0)
    return np.lexsort((number, part, owner)), ~(by_trial | by_block)


def _repeated(owner: IntArray, *keys: npt.NDArray[Any]) -> BoolArray:
    """Which owners have equal keys in two rows."""
    order = np.lexsort((*keys, owner))
    once = np.bincount(owner[order][run_starts(*(values[order] for values in (owner, *keys)))], minlength=owner.max() + 1)
    return np.asarray(once < np.bincount(owner))
