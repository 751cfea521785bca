"""Many subjects in one array: counts with a row a subject, so that one call of a likelihood serves all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.data.study import Subject
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.record import Model


@dataclass(frozen=True, eq=False)
class Crowd:
    """What a likelihood asks of a subject, with arrays of shape (subjects, pairs).

    Rows that are shorter than others are filled up with pairs that were never shown: an answer never given adds 0.
    """

    s1: FloatArray
    s2: FloatArray
    n_yes: IntArray
    n_trials: IntArray
    isi: FloatArray | None
    felt: None = None

    @classmethod
    def of(
        cls, subjects: Sequence[Subject], centre: float, interval: float, away: Sequence[float] = ()
    ) -> Crowd:
        """The counts of subjects, a row each; pairs never shown are two stimuli at the centre, at this interval.

        Of each subject's stimuli `away` is taken, 0 by default.
        """
        filler = {"s1": centre, "s2": centre, "n_yes": 0, "n_trials": 0, "isi": interval}
        pairs, known = max(one.n_pairs for one in subjects), subjects[0].isi is not None

        def rows(name: str) -> npt.NDArray[Any]:
            parts = [np.asarray(getattr(one, name)) for one in subjects]
            if away and name in ("s1", "s2"):
                parts = [part - far for part, far in zip(parts, away, strict=True)]
            return np.stack(
                [
                    np.pad(part, (0, pairs - len(part)), constant_values=filler[name])
                    for part in parts
                ]
            )

        return cls(
            rows("s1"), rows("s2"), rows("n_yes"), rows("n_trials"), rows("isi") if known else None
        )

    @property
    def n_pairs(self) -> int:
        """Pairs of a row."""
        return int(self.s1.shape[1])


def crowd_posterior(
    model: Model,
    prior: Prior,
    subjects: Sequence[Subject],
    centre: float,
    interval: float,
    away: Sequence[float] = (),
) -> Posterior:
    """A posterior of which `log_answers`, `likelihood_gradient` and `from_group` take points with a row for each subject.

    Offsets count from the one centre, natural-log intensity, for all of them, with stimuli of each less `away`. Nothing else of it has a
    meaning.

    Examples
    --------
    >>> from bayes_toe.model.ladder import PREDICTIVE_UPDATE
    >>> one = Subject("A", [0.0, 0.0], [0.0, 0.3], [49, 20], [50, 50])
    >>> other = Subject("B", [0.0], [0.2], [3], [5])
    >>> crowd_posterior(PREDICTIVE_UPDATE, Prior(), [one, other], 0.0, 1.0).likelihood_gradient(np.zeros((2, 4)))[1].shape
    (2, 4)
    """
    crowd = Crowd.of(subjects, centre, interval, away)
    return Posterior(cast(Subject, crowd), model, prior, centre=centre, interval=interval)
