"""The levels of a condition within subjects, and the location and scales of stimuli.

`Conditions` has the levels, the comparisons between them, and their design matrix.
`StimulusScales` has the means and spreads of stimuli. A subject in one condition keeps the scales
of the subject over all conditions: otherwise a constant error would move with the stimuli that a
condition happens to have.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray
from bayes_toe.data.messages import Texts, display_name, join_names, plural


class StimulusScales(NamedTuple):
    """Location and scales of stimuli, natural-log intensity, weighted by trials.

    Attributes
    ----------
    mean : float
        M, the mean of all stimuli, first and second.
    sbar : float
        Mean first stimulus.
    step : float
        D, the root mean square of s2 - s1 over unequal pairs.
    spread : float
        R, the standard deviation of all stimuli about their common mean.
    first_spread : float
        Standard deviation of the first stimuli.
    """

    mean: float
    sbar: float
    step: float
    spread: float
    first_spread: float

    @classmethod
    def from_pairs(
        cls, s1: FloatArray, s2: FloatArray, n_trials: npt.ArrayLike
    ) -> StimulusScales | None:
        """The scales of pairs, shape (pairs,) each; None without a pair of different stimuli."""
        is_unequal = s1 != s2
        if not is_unequal.any():
            return None
        weight = np.asarray(n_trials, float)
        share = weight / weight.sum()
        sbar = float(share @ s1)
        mean = 0.5 * (sbar + float(share @ s2))

        unequal_share = weight[is_unequal] / weight[is_unequal].sum()
        step = _root_mean_square((s2 - s1)[is_unequal], unequal_share)
        deviations = np.concatenate([s1 - mean, s2 - mean])
        spread = _root_mean_square(deviations, 0.5 * np.concatenate([share, share]))
        # Of a single s1 exactly 0, since s1 - sbar may be an error of rounding.
        first_spread = 0.0
        if (s1 != s1[0]).any():
            first_spread = _root_mean_square(s1 - sbar, share)
        return cls(mean, sbar, step, spread, first_spread)

    @property
    def roving_share(self) -> float:
        """Factor by which roved first stimuli narrow the prior of a contraction, at most 1.

        It is below 1 where the standard deviation of s1 is larger than 4 D. A prior as wide as
        usual would then allow shifts that are much larger than the differences in the pairs.
        """
        widest = 4.0 * self.step
        return widest / self.first_spread if self.first_spread > widest else 1.0


def _root_mean_square(values: FloatArray, share: FloatArray) -> float:
    """Root of the weighted mean square of values whose squares may leave the range of floats."""
    largest = float(np.abs(values).max())
    return largest * float(np.sqrt(share @ np.square(values / largest)))


@dataclass(frozen=True)
class Conditions:
    """The levels of a condition that differs within subjects.

    Attributes
    ----------
    name : str
        The column of the file.
    levels : tuple of str
        The other levels are compared with the first one.
    numeric : bool
        Whether levels are numbers; an effect is then a slope over them.

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

    def among(self, present: Collection[str]) -> Conditions:
        """The condition without the levels that no subject has; at least two levels stay."""
        levels = tuple(level for level in self.levels if level in present)
        return replace(self, levels=levels) if len(levels) > 1 else self

    def design(self, chosen: Texts | None = None) -> FloatArray:
        """Design matrix X of all levels or of the chosen ones, shape (levels, columns).

        Levels that are numbers have one column, (x - mean)/range, so that its effect is that over
        the whole range. Other levels have orthonormal columns that sum to 0, divided by 2^(1/2): no
        level is special, and with independent N(0, h^2) effects any two levels differ by
        N(0, h^2). Two levels are -1/2 and 1/2.
        """
        chosen = self.levels if chosen is None else tuple(chosen)
        if self.numeric:
            x = np.array(self.levels, float)
            centred = np.array(chosen, float) - x.mean()
            return (centred / np.ptp(x))[:, None]

        # The deviation of each level from the mean of all levels. The first column follows from the
        # other columns, which QR makes orthonormal.
        contrasts = np.eye(len(chosen)) - 1.0 / len(chosen)
        orthonormal, _ = np.linalg.qr(contrasts[:, 1:])
        columns = orthonormal / np.sqrt(2.0)
        # QR leaves the signs open: the last level is positive.
        return columns * np.where(columns[-1] < 0.0, -1.0, 1.0)

    @property
    def about(self) -> str:
        """The column and its levels in words."""
        names = list(map(display_name, self.levels))
        levels = f"{plural(len(names), 'level')}, {join_names(names)}"
        kind = ", as numbers" if self.numeric else f"; {names[0]} is the reference"
        return f"{display_name(self.name)}: {levels}{kind}"
