"""Conditions within subjects: their levels, and the stimuli to which constant errors refer.

Each subject at each level is a unit `S01@left`, which every analysis of single subjects takes as a
subject. Location and scales of its stimuli are those of the subject over all conditions: else a
constant error would move with the stimuli that a condition happens to have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.data.messages import bare, counted, listed


class Stimuli(NamedTuple):
    """Location and scales of stimuli, natural-log intensity; all are means over trials.

    Attributes
    ----------
    mean : float
        M, of all stimuli, first and second.
    sd : float
        R, their standard deviation.
    step : float
        D, root mean square of s2 - s1 over trials with different stimuli.
    first : float
        sbar, of the first stimuli.
    """

    mean: float
    sd: float
    step: float
    first: float

    @classmethod
    def of_trials(cls, s1: FloatArray, s2: FloatArray, n_trials: IntArray) -> Stimuli | None:
        """The stimuli of pairs that were met so often; None without a pair of different stimuli."""
        is_unequal = (s1 != s2) & (n_trials > 0)
        if not is_unequal.any():
            return None
        mean = float(np.average(0.5 * (s1 + s2), weights=n_trials))
        squares = 0.5 * (np.square(s1 - mean) + np.square(s2 - mean))
        sd = float(np.sqrt(np.average(squares, weights=n_trials)))
        differences = np.square(s2 - s1)[is_unequal]
        step = float(np.sqrt(np.average(differences, weights=n_trials[is_unequal])))
        if not (sd > 0.0 and step > 0.0):  # The squares are below the smallest float.
            return None
        return cls(mean, sd, step, float(np.average(s1, weights=n_trials)))

    def number(self, symbol: str) -> float:
        """The value of a key of :data:`bayes_toe.model.prior_fields.OF_STIMULI`."""
        return {"M": self.mean, "2.5 R": 2.5 * self.sd, "D": self.step}[symbol]


@dataclass(frozen=True)
class Conditions:
    """The levels of a condition that differs within subjects.

    Attributes
    ----------
    name : str
        The column of the file.
    levels : tuple of str
        The first one is that with which the others are compared.
    numeric : bool
        Whether levels are numbers, of which an effect is a slope.

    Examples
    --------
    >>> Conditions("hand", ("left", "right")).design().round(3).tolist()
    [[-0.5], [0.5]]
    >>> Conditions("delay", ("2", "4", "6"), numeric=True).comparisons
    (('6', '2'),)
    """

    name: str
    levels: tuple[str, ...]
    numeric: bool = False

    @cached_property
    def comparisons(self) -> tuple[tuple[str, str], ...]:
        """Pairs of levels whose difference is reported: of numbers, the largest and smallest."""
        if self.numeric:
            return ((max(self.levels, key=float), min(self.levels, key=float)),)
        return tuple((level, self.levels[0]) for level in self.levels[1:])

    def design(self, chosen: Sequence[str] | None = None) -> FloatArray:
        """Columns X, shape (levels, columns), of all levels or some.

        With independent N(0, h^2) effects any two levels differ by N(0, h^2). Two levels are -1/2
        and 1/2. More have orthonormal columns that sum to 0, over 2^(1/2), so that no level is
        special. Numbers have one, (x - mean)/range, whose effect is that over the whole range.
        """
        chosen = self.levels if chosen is None else tuple(chosen)
        if self.numeric:
            x = np.array(self.levels, np.float64)
            centred = np.array(chosen, np.float64) - x.mean()
            return (centred / np.ptp(x))[:, None]
        contrasts = np.eye(len(chosen)) - 1.0 / len(chosen)
        columns = np.linalg.qr(contrasts[:, 1:])[0] / np.sqrt(2.0)
        return columns * np.where(columns[-1] < 0.0, -1.0, 1.0)

    @property
    def about(self) -> str:
        """The column and its levels in words."""
        names = [*map(bare, self.levels)]
        kind = ", as numbers" if self.numeric else f"; {names[0]} is the reference"
        return f"{bare(self.name)}: {counted(len(names), 'level')}, {listed(names)}{kind}"
