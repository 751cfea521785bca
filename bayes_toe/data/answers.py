"""Answers of a subject in the order in which they were given, before they are pooled.

`Answers` has the rows. It can swap the two answers in some rows and leave rows out. `counted_rows`
checks counts and makes `Answers` of them. `Reading` has what else a file said: its columns and its
probable mistakes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import BoolArray, FloatArray, IndexArray, IntArray, Record, run_starts
from bayes_toe.data.messages import Texts, join_display_names, join_names, quoted
from bayes_toe.data.validation import LARGEST_COUNT
from bayes_toe.errors import InputError, Remedy

#: Counts of rows, shape (rows,) each, by their names in :class:`Answers`.
Counts: TypeAlias = Mapping[str, IntArray]


@dataclass(frozen=True, eq=False)
class Answers:
    """Rows of one subject, in the order in which they were given where rows are trials.

    Parameters
    ----------
    keys : array, shape (rows, 2)
        The stimuli of each row: s1 and s2 (natural-log intensities).
    n_yes, n_trials : array of int, shape (rows,)
        How many answers the task counts, and how many answers there are: 1 in a trial, and 0 in a
        trial that nobody answered in time.
    block : array of int, shape (rows,), or None
        The index in `blocks` of each row's block; None without such a column.
    blocks : tuple of str
    has_trial_rows : bool
        Whether rows are trials.
    place : array of int, shape (rows,), or None
        Positions of trials in their order; None if it is not known. They rise by one within a
        session; a gap is the start of a session.
    span : tuple of int, or None
        The first and the last row of the file that is one of these trials.
    n_second : array of int, shape (rows,), or None
        Of three answers: how many of the n_trials - n_yes that are not 'equal' are 'second'.
    """

    keys: FloatArray
    n_yes: IntArray
    n_trials: IntArray
    block: IntArray | None = None
    blocks: tuple[str, ...] = ()
    has_trial_rows: bool = False
    place: IntArray | None = None
    span: tuple[int, int] | None = None
    n_second: IntArray | None = None

    @property
    def answered(self) -> Answers:
        """The rows that have an answer."""
        return self.excluding(self.n_trials == 0)

    @property
    def named_counts(self) -> Record:
        """`n_yes`, `n_trials` and, of three answers, `n_second`."""
        counts = {"n_yes": self.n_yes, "n_trials": self.n_trials}
        if self.n_second is not None:
            counts["n_second"] = self.n_second
        return counts

    @property
    def counts(self) -> IntArray:
        """The arrays of :attr:`named_counts`, one below the other, shape (2 or 3, rows)."""
        return np.stack(list(self.named_counts.values()))

    @property
    def sums(self) -> Answers:
        """A row for each distinct pair with an answer, with the sums of its counts.

        The rows are sorted by s1, then by s2.
        """
        rows = np.flatnonzero(self.n_trials)
        s1, s2 = self.keys[rows].T
        rows = rows[np.lexsort((s2, s1))]  # sorts by the last key first

        starts = run_starts(*self.keys[rows].T)  # rows with equal pairs are now a run
        sums: Record = {
            name: np.add.reduceat(counts[rows], starts)
            for name, counts in self.named_counts.items()
        }
        return Answers(self.keys[rows[starts]], **sums)

    @property
    def pair(self) -> IndexArray:
        """The pair of each row among the pairs of all rows, sorted by (s1, s2), shape (rows,)."""
        _, index = np.unique(self.keys, axis=0, return_inverse=True)
        return index.ravel()

    @property
    def is_session_start(self) -> BoolArray:
        """Whether a new block or session begins at each row, shape (rows,).

        A row begins a session if its place is not one more than the place of the row before. If
        places are not known, every row begins a session.

        Examples
        --------
        >>> ones = np.ones(4, int)
        >>> answers = Answers(np.zeros((4, 2)), ones, ones, place=np.array([0, 1, 3, 4]))
        >>> answers.is_session_start.tolist()
        [True, False, True, False]
        """
        if self.place is None:
            return np.ones(len(self.n_trials), bool)
        place_before = self.place[:1] - 2  # a gap, since the first row begins a session
        return np.diff(self.place, prepend=place_before) != 1

    def rows_of(self, blocks: Texts) -> BoolArray:
        """Whether each row is in one of these blocks; all rows are if no block is named.

        Raises an InputError if the subject has no such block.
        """
        if not blocks:
            return np.ones(len(self.n_trials), bool)
        if self.block is None:
            raise InputError(
                "found no column block, allowed: all answers of the subject, or a column with "
                "--columns block=NAME"
            )
        unknown = [quoted(block) for block in blocks if block not in self.blocks]
        if unknown:
            raise InputError(
                f"found no block {join_names(unknown)}, allowed: {join_display_names(self.blocks)}"
            )
        return np.isin(self.block, [self.blocks.index(block) for block in blocks])

    def swapped(self, rows: BoolArray) -> Answers:
        """A copy with the two answers exchanged in these rows; of three, 'first' and 'second'."""
        n_no = self.n_trials - self.n_yes
        if self.n_second is None:
            return replace(self, n_yes=np.where(rows, n_no, self.n_yes))
        n_first = n_no - self.n_second
        return replace(self, n_second=np.where(rows, n_first, self.n_second))

    @property
    def unequal_answers(self) -> Answers:
        """Of three answers, 'second' and 'first' alone; rows with 'equal' are not answered."""
        n_unequal = self.n_trials - self.n_yes
        assert self.n_second is not None
        return replace(self, n_yes=self.n_second, n_trials=n_unequal, n_second=None)

    def excluding(self, rows: BoolArray) -> Answers:
        """A copy without these rows.

        A session starts after each row that is left out, because the places then have a gap.
        """
        columns: Record = {}
        for key, values in vars(self).items():
            if isinstance(values, np.ndarray):
                columns[key] = values[~rows]
        return replace(self, **columns).with_own_blocks()

    def with_own_blocks(self) -> Answers:
        """A copy whose `blocks` are only those that its rows have."""
        if self.block is None:
            return self
        present, block = np.unique(self.block, return_inverse=True)
        blocks = np.array(self.blocks, object)[present]
        return replace(self, block=block, blocks=tuple(blocks))


@dataclass(frozen=True, eq=False)
class Reading:
    """Facts that a file told besides the counts.

    `read` has our names of the columns that were read. `ignored` has the names of other columns in
    the file. `doubts` are probable mistakes in the file, a sentence each, without its full stop.
    `pooled` are ignored columns that look like a condition with several levels of a subject.
    `codes` are the texts of the responses. `missed` are codes of missed trials that options name
    and cells have. `evident` are the options that no user typed.
    """

    read: Texts = ()
    ignored: Texts = ()
    doubts: Texts = ()
    pooled: Texts = ()
    codes: Texts = ()
    missed: Texts = ()
    evident: tuple[Remedy, ...] = ()

    @property
    def options_found(self) -> str:
        """The options that no user typed, as they are typed; empty without such options."""
        return " ".join(remedy.typed for remedy in self.evident)


def counted_rows(
    subject: str,
    stimuli: Sequence[npt.ArrayLike],
    n_yes: npt.ArrayLike,
    n_trials: npt.ArrayLike,
    n_second: npt.ArrayLike | None = None,
) -> Answers:
    """Rows of one subject from stimuli s1 and s2 and from counts, shape (rows,) each.

    An InputError where stimuli are no numbers, a count is impossible, or lengths differ.
    """
    columns = []
    for name, values in zip(("s1", "s2"), stimuli, strict=True):
        columns.append(real_numbers(f"subject {subject!r}: {name}", values).astype(float))

    counts: Record = {"n_yes": n_yes, "n_trials": n_trials}
    if n_second is not None:
        counts["n_second"] = n_second
    for name, values in counts.items():
        counts[name] = _whole_numbers(subject, name, values)
    if len({len(values) for values in (*columns, *counts.values())}) > 1:
        names = join_names(["s1", "s2", *counts])
        raise InputError(f"subject {subject!r}: {names} must be of one length")

    # Checked row by row: in the sums of repeated pairs, two wrong counts could cancel.
    rows = Answers(np.column_stack(columns), **counts)
    n_no = rows.n_trials - rows.n_yes
    if np.any((rows.n_yes < 0) | (n_no < 0)):
        raise InputError(f"subject {subject!r}: every n_yes must lie in 0..n_trials")
    if rows.n_second is not None and np.any((rows.n_second < 0) | (rows.n_second > n_no)):
        raise InputError(f"subject {subject!r}: every n_second must lie in 0..n_trials - n_yes")
    return rows


def real_numbers(name: str, argument: npt.ArrayLike) -> npt.NDArray[Any]:
    """Real numbers, shape (rows,); an InputError where they are masked or of another kind."""
    values = np.asarray(argument).ravel()  # without the mask of a masked array
    if values.dtype.kind not in "iuf" or np.ma.is_masked(argument):
        raise InputError(
            f"{name} must be numbers, none of them masked, found {values[:3].tolist()}"
        )
    return values


def _whole_numbers(subject: str, name: str, counts: npt.ArrayLike) -> IntArray:
    """Counts as int64, shape (rows,); an InputError where 2.5 would become 2."""
    values = real_numbers(f"subject {subject!r}: {name}", counts)
    wrong_values = values[values != np.floor(values)]
    if wrong_values.size:
        raise InputError(
            f"subject {subject!r}: {name} must be whole numbers, found {wrong_values[:3].tolist()}"
        )
    if np.sum(np.abs(values), dtype=np.float64) > LARGEST_COUNT:
        raise InputError(f"subject {subject!r}: {name} must add up to no more than 10^12")
    return values.astype(np.int64)
