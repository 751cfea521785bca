"""Answers of many rows in one design: what is fitted, all rows at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject, refuse_intervals
from bayes_toe.model.distributions import Normal
from bayes_toe.model.prior import Prior


class Counts(NamedTuple):
    """Answers of many rows in one design, each of shape (rows, pairs)."""

    equal: FloatArray
    different: FloatArray

    @classmethod
    def of(cls, n_equal: npt.ArrayLike, n_trials: npt.ArrayLike) -> Counts:
        """From counts of 'equal', (rows, pairs), and of trials, (pairs,)."""
        equal = np.atleast_2d(np.asarray(n_equal, np.float64))
        return cls(equal, np.asarray(n_trials, np.float64) - equal)


@dataclass(frozen=True, eq=False)
class Design:
    """The pairs that every row of a batch shares, and the penalty."""

    s1: FloatArray
    s2: FloatArray
    sbar: float
    penalty: Normal

    @classmethod
    def of(cls, subject: Subject, prior: Prior) -> Design:
        """Pairs of a subject; of the prior only the normal of mu1 is used."""
        refuse_intervals([subject], "maximum-likelihood fit")
        sbar = float(np.average(subject.s1, weights=subject.n_trials))
        return cls(subject.s1, subject.s2, sbar, prior.penalty)

    @property
    def scale(self) -> float:
        """Root mean square step between the stimuli of a pair, natural-log intensity."""
        steps = np.abs(self.s2 - self.s1)
        moved = steps[steps > 0] if np.any(steps > 0) else np.abs(self.s1 - self.sbar)
        return float(np.sqrt(np.mean(np.square(moved)))) if np.any(moved > 0) else 0.3
