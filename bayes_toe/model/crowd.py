"""Many subjects in one array: counts, or trials, with a row a subject, so that one call of a likelihood serves all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray, IndexArray, IntArray
from bayes_toe.data.study import Subject
from bayes_toe.model.history import Trials
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.record import Model


@dataclass(frozen=True, eq=False)
class Crowd:
    """What a likelihood asks of a subject, with arrays of shape (subjects, pairs).

    Rows that are shorter than others are filled up with pairs that were never shown: an answer never given adds 0. `trials` are those of
    models with a history.
    """

    s1: FloatArray
    s2: FloatArray
    n_yes: IntArray
    n_trials: IntArray
    isi: FloatArray | None
    felt: None = None
    trials: CrowdTrials | None = None

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


@dataclass(frozen=True, eq=False)
class CrowdTrials(Trials):
    """Trials of subjects: of those answered a row each, shape (subjects, trials); of those felt a lane each, (steps, sessions, subjects).

    Filled up with trials that nobody answered. `pair` is the place of each trial's among its subject's pairs; `starts` has no meaning.
    """

    pair: IndexArray

    @classmethod
    def of_all(
        cls, subjects: Sequence[Subject], crowd: Crowd, centre: float, interval: float
    ) -> CrowdTrials:
        """Those of subjects whose order of trials is known, and whose counts are a crowd's."""
        filler = {"s1": centre, "s2": centre, "isi": interval, "seconds": interval, "iti": np.inf}
        made = [Trials.of(one) for one in subjects]
        pairs = [
            np.repeat(np.arange(one.n_pairs), np.diff(np.r_[of.starts, of.n_pairs]))
            for one, of in zip(subjects, made, strict=True)
        ]
        parts: dict[str, list[npt.NDArray[Any]]] = {"pair": [*pairs]}
        for name in (field.name for field in fields(Trials)):
            parts[name] = [getattr(of, name) for of in made]
        parts |= {
            name: [row[pair] for row, pair in zip(getattr(crowd, name), pairs, strict=True)]
            for name in ("s1", "s2")
        }

        def together(name: str, values: list[npt.NDArray[Any]]) -> Any:
            if any(one is None for one in values):  # times, of which somebody has none
                return None
            longest, rest = np.max([one.shape for one in values], axis=0), filler.get(name, 0)
            behind = [
                [(0, most - n) for n, most in zip(one.shape, longest, strict=True)]
                for one in values
            ]
            filled = [
                np.pad(one, width, constant_values=rest)
                for one, width in zip(values, behind, strict=True)
            ]
            return np.concatenate(filled, axis=2) if filled[0].ndim > 2 else np.stack(filled)

        return cls(**{name: together(name, values) for name, values in parts.items()})

    def answered(self, felt: FloatArray) -> FloatArray:
        """Of each subject's own trials."""
        steps, sessions, subjects = felt.shape
        return np.take_along_axis(felt.reshape(steps * sessions, subjects), self.at.T, axis=0).T

    def by_pair(self, log_probability: FloatArray) -> FloatArray:
        """Log of the mean probability of each pair's trials, (subjects, trials) -> (subjects, pairs); -inf of pairs never shown."""
        shape, shown = (len(self.pair), int(self.pair.max()) + 1), self.n_trials > 0
        place = (self.pair + shape[1] * np.arange(shape[0])[:, None])[shown]
        counts = np.bincount(place, minlength=shape[0] * shape[1])
        sums = np.bincount(place, np.exp(log_probability[shown]), minlength=len(counts))
        with np.errstate(divide="ignore"):
            return np.log(sums / np.maximum(counts, 1)).reshape(shape)


class _CrowdPosterior(Posterior):
    """Of a crowd, by its trials where the model looks at these."""

    @cached_property
    def _rows(self) -> Subject | Trials:
        crowd = cast(Crowd, self.subject)
        return self.subject if crowd.trials is None else crowd.trials


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
    if model.by_trial:
        crowd = replace(crowd, trials=CrowdTrials.of_all(subjects, crowd, centre, interval))
    return _CrowdPosterior(cast(Subject, crowd), model, prior, centre=centre, interval=interval)
