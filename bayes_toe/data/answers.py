"""Answers as they were given, block by block and in their order, before they are pooled: what can be turned back or left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray, IntArray
from bayes_toe.data.messages import bare, listed, quoted
from bayes_toe.errors import InputError


@dataclass(frozen=True, eq=False)
class Answers:
    """Rows of one subject that have an answer, in the order in which they were given where rows are trials.

    `keys`, shape (rows, 2 or 3), are the pair of each row: s1 and s2 (natural-log intensities), and isi (seconds) where the study has
    intervals; `n_yes` and `n_trials`, shape (rows,), the answers that the task counts and all answers, of which a trial is one. `block` is
    where in `blocks`, names in their order, that of each row's block stands, None without such a column; `trials` says whether rows are
    trials, and `place` between which rows of the file they are.
    """

    keys: FloatArray
    n_yes: IntArray
    n_trials: IntArray
    block: IntArray | None
    blocks: tuple[str, ...]
    trials: bool
    place: tuple[int, int] | None = None

    def rows_of(self, blocks: Sequence[str]) -> BoolArray:
        """Which rows are in one of these blocks; all rows where none is named.

        Raises
        ------
        InputError
            If there is no such block, or there are no blocks.
        """
        if not blocks:
            return np.ones(len(self.n_trials), np.bool_)
        if self.block is None:
            raise InputError("found no column block, allowed: all answers of the subject, or a column with --columns block=NAME")
        unknown = [quoted(one) for one in blocks if one not in self.blocks]
        if unknown:
            raise InputError(f"found no block {listed(unknown)}, allowed: {listed([*map(bare, self.blocks)])}")
        return np.isin(self.block, [self.blocks.index(one) for one in blocks])

    def turned(self, rows: BoolArray) -> Answers:
        """The same with each answer for the other one in these rows."""
        return replace(self, n_yes=np.where(rows, self.n_trials - self.n_yes, self.n_yes))

    def without(self, rows: BoolArray) -> Answers:
        """All other rows, with the blocks that they are in."""
        blocks, block = self.blocks, self.block
        if block is not None:
            own, block = np.unique(block[~rows], return_inverse=True)
            blocks = tuple(blocks[place] for place in own.tolist())
        return Answers(self.keys[~rows], self.n_yes[~rows], self.n_trials[~rows], block, blocks, self.trials, self.place)


@dataclass(frozen=True, eq=False)
class Reading:
    """What a file told besides the counts.

    `answers` are by subject, where rows are trials or have a block; `read` are the columns that were, by our names, `ignored` those that
    were not, by their names in the file; `doubts` say what is probably a mistake in the file, a sentence each, without its full stop.
    """

    answers: Mapping[str, Answers] = field(default_factory=dict)
    read: tuple[str, ...] = ()
    ignored: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
