"""A design as an experimenter has it: ordered pairs and how often each is shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.data.study import Subject
from bayes_toe.data.tables import write_cells
from bayes_toe.data.validation import read_numbers
from bayes_toe.errors import InputError
from bayes_toe.experiments.simulate import PAPER_AMPLITUDES, Design, full_design, reference_design

#: Columns of a design's file; isi where there are intervals.
DESIGN_COLUMNS = ("s1", "s2", "n_trials", "isi")


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs that could be shown, natural-log intensities and seconds, shape (pairs,) each."""

    s1: FloatArray
    s2: FloatArray
    isi: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.s1)

    @property
    def columns(self) -> tuple[FloatArray, ...]:
        """s1, s2 and, where there are intervals, isi."""
        return (self.s1, self.s2) if self.isi is None else (self.s1, self.s2, self.isi)


@dataclass(frozen=True, eq=False)
class StudyDesign:
    """Ordered pairs, each with its number of trials, sorted by (s1, s2).

    Parameters
    ----------
    s1, s2 : array_like, shape (pairs,)
        Natural-log intensities.
    n_trials : array_like of int, shape (pairs,)
        At least 1.
    isi : array_like, shape (pairs,), optional
        Inter-stimulus intervals, seconds: the same stimuli at another interval are another pair.

    Raises
    ------
    InputError
        If shapes differ, a value is not allowed, or a pair is repeated.

    Examples
    --------
    >>> design = StudyDesign([0.0, 0.0], [0.0, 0.3], [30, 10])
    >>> design.total, design.with_total(10).n_trials.tolist()
    (40, [8, 2])
    """

    s1: FloatArray
    s2: FloatArray
    n_trials: IntArray
    isi: FloatArray | None = None

    def __post_init__(self) -> None:
        try:
            pairs = Subject("design", self.s1, self.s2, np.zeros(np.shape(self.s1), np.int64), self.n_trials, self.isi)
        except InputError as error:
            raise InputError(str(error).replace("subject 'design'", "design")) from error
        for key in DESIGN_COLUMNS:
            object.__setattr__(self, key, getattr(pairs, key))

    @property
    def pairs(self) -> Pairs:
        """The pairs without their numbers of trials."""
        return Pairs(self.s1, self.s2, self.isi)

    @property
    def n_pairs(self) -> int:
        """Distinct ordered pairs; with intervals, pairs and intervals."""
        return len(self.s1)

    @property
    def total(self) -> int:
        """Trials of all pairs."""
        return int(self.n_trials.sum())

    def answered(self, n_equal: npt.ArrayLike, name: str = "design") -> Subject:
        """The counts of a subject who has answered every trial."""
        return Subject(name, self.s1, self.s2, np.asarray(n_equal), self.n_trials, self.isi)

    @property
    def unanswered(self) -> Subject:
        """The pairs as a subject that never said 'equal': for what depends on the pairs alone."""
        return self.answered(np.zeros_like(self.n_trials))

    def with_total(self, trials: int) -> StudyDesign:
        """The same pairs with so many trials in all, each pair its share and at least one.

        Raises
        ------
        InputError
            If there are fewer trials than pairs.
        """
        if trials < self.n_pairs:
            raise InputError(f"{trials} trials for {self.n_pairs} pairs: allowed is at least one trial a pair")
        return self if trials == self.total else replace(self, n_trials=apportioned(self.n_trials / self.total, trials))

    def moved(self, by: float) -> StudyDesign:
        """The same pairs with a constant added to every stimulus."""
        return replace(self, s1=self.s1 + by, s2=self.s2 + by)

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write s1,s2,n_trials (and isi) as a CSV file, whole or not at all."""
        names = DESIGN_COLUMNS if self.isi is not None else DESIGN_COLUMNS[:3]
        columns: Sequence[Any] = [getattr(self, name).tolist() for name in names]
        return write_cells(names, zip(*columns, strict=True), path, overwrite=overwrite)


def apportioned(share: FloatArray, trials: int) -> IntArray:
    """Whole numbers of at least 1 that add up to `trials`, as near to shares of it as they can be.

    Examples
    --------
    >>> apportioned(np.array([0.5, 0.49, 0.01]), 11).tolist()
    [5, 5, 1]
    """
    ideal = share / share.sum() * trials
    counts: IntArray = np.maximum(1, np.floor(ideal)).astype(np.int64)
    while (left := trials - int(counts.sum())) != 0:
        off = np.where(counts > 1, ideal - counts, np.inf) if left < 0 else ideal - counts
        counts[off.argmin() if left < 0 else off.argmax()] += 1 if left > 0 else -1
    return counts


def read_study_design(path: str | Path) -> StudyDesign:
    """A design from a CSV file with columns s1,s2,n_trials, and isi where there are intervals.

    Raises
    ------
    InputError
        One line per problem of the file, with row and column.
    """
    columns = read_numbers(path, DESIGN_COLUMNS[:3], optional=DESIGN_COLUMNS[3:], counts=("n_trials",))[1]
    try:
        return StudyDesign(columns["s1"], columns["s2"], columns["n_trials"].astype(np.int64), columns.get("isi"))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def paper_study_design(trials: int | None = None) -> StudyDesign:
    """The paper's 13 pairs, 50 trials each, or so many in all.

    Examples
    --------
    >>> paper_study_design().total
    650
    """
    return _of_batches(reference_design(), trials)


def full_study_design(trials: int) -> StudyDesign:
    """Every ordered pair of the paper's five stimuli."""
    return _of_batches(full_design(PAPER_AMPLITUDES), trials)


def narrow_study_design(first: FloatArray, steps: FloatArray, trials: int) -> StudyDesign:
    """First stimuli, and second ones so many steps from each (natural-log intensities).

    Examples
    --------
    >>> narrow_study_design(np.array([0.0, 1.0]), np.array([-0.1, 0.0, 0.1]), 60).n_pairs
    6
    """
    s1 = np.repeat(first, len(steps))
    return StudyDesign(s1, s1 + np.tile(steps, len(first)), apportioned(np.ones(len(s1)), trials))


def _of_batches(design: Design, trials: int | None) -> StudyDesign:
    made = StudyDesign(design.s1, design.s2, np.full(len(design.s1), design.batches), design.isi)
    return made if trials is None else made.with_total(trials)
