"""What the prior says that observers do on a study's pairs, beside what its subjects did."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import BLOCK, FloatArray, IntArray
from bayes_toe.data.study import Study, Subject
from bayes_toe.model.ladder import PREDICTIVE_UPDATE, Record, posterior_of
from bayes_toe.model.prior import Prior
from bayes_toe.model.study_prior import prior_for
from bayes_toe.seeds import generator

#: Who calls every pair equal more rarely says 'different' to everything.
RARELY = 0.05
PRIOR_DRAWS = 4000
_MOST_PAIRS = 40  # beyond, pairs of similar distance are taken together
_BINS = 12  # of each order then


@dataclass(frozen=True, eq=False)
class PriorPrediction:
    """P(equal), or P(second), of observers drawn from the prior, and the subjects' answers, by groups of pairs in the order of s2 - s1.

    A group is a pair (at its interval) or, in designs of more than 40, the pairs of one order with similar distances, of which `equal` is
    the mean, weighted by trials.

    Attributes
    ----------
    model : str
    prior : Prior
        In numbers.
    synthetic : bool
    pairs : Subject
        The distinct pairs of all subjects, their answers added up.
    group : array of int, shape (pairs,)
        The group of each pair.
    equal : array, shape (draws, groups)
        Probability of the answer that the task counts, of each observer drawn from the prior.
    n_yes, n_trials : array of int, shape (subjects, groups)
    """

    model: str
    prior: Prior
    synthetic: bool
    pairs: Subject
    group: IntArray
    equal: FloatArray
    n_yes: IntArray
    n_trials: IntArray

    @property
    def grouped(self) -> bool:
        """Whether a group may hold several pairs."""
        return len(self.distance) < self.pairs.n_pairs

    @property
    def distance(self) -> FloatArray:
        """Mean s2 - s1 of each group, natural-log intensity, shape (groups,): its sign tells the order."""
        return np.asarray(
            np.bincount(self.group, self.pairs.s2 - self.pairs.s1) / np.bincount(self.group)
        )

    @property
    def largest(self) -> FloatArray:
        """Largest P of the answer that the task counts of each observer drawn from the prior, shape (draws,)."""
        return np.asarray(self.equal.max(axis=1))

    @property
    def largest_observed(self) -> FloatArray:
        """Largest share of 'equal' of each subject, shape (subjects,): a frequency, which scatters upward where trials are few."""
        return np.asarray(
            (self.n_yes / np.maximum(self.n_trials, 1)).max(axis=1)
        )  # a group not met has 0/1


def prior_predictive(
    study: Study,
    prior: Prior | str | None = None,
    model: str | Record = PREDICTIVE_UPDATE.name,
    *,
    seed: int = 0,
    draws: int = PRIOR_DRAWS,
) -> PriorPrediction:
    """P of the counted answer of the study's distinct pairs for observers drawn from the prior of a model, beside the subjects' counts.

    Parameters
    ----------
    study : Study
    prior : Prior or str, optional
        As :func:`~bayes_toe.model.study_prior.prior_for` takes it; its scales are those of all stimuli of the study together.
    model : str
        A model's name or composition.
    seed, draws : int

    Raises
    ------
    InputError
        If there is no such prior or model.

    Examples
    --------
    >>> from bayes_toe.data.read_study import example_study
    >>> found = prior_predictive(example_study(), draws=100)
    >>> found.equal.shape, found.n_trials.shape
    ((100, 13), (16, 13))
    """
    numbers = prior_for(study, prior)
    columns = [_joined(study, key) for key in ("s1", "s2", *(["isi"] if study.intervals else []))]
    places, index = np.unique(np.column_stack(columns), axis=0, return_inverse=True)
    counts_of = (_joined(study, key) for key in ("n_yes", "n_trials"))
    pairs = Subject.from_counts("pairs", *columns[:2], *counts_of, *columns[2:], task=study.task)
    group = _groups(places)
    target = posterior_of(pairs, numbers, model=model)
    x = target.sample_prior(generator(seed, "prior predictive", target.model.name), draws)
    weights = np.zeros((len(group), group.max() + 1))
    weights[np.arange(len(group)), group] = (
        pairs.n_trials / np.bincount(group, pairs.n_trials)[group]
    )
    rows = max(1, BLOCK // len(group))
    equal = np.concatenate(
        [np.exp(target.log_answers(x[i : i + rows])[0]) @ weights for i in range(0, draws, rows)]
    )
    who = np.repeat(np.arange(len(study)), [subject.n_pairs for subject in study])
    counts = np.zeros((2, len(study), weights.shape[1]), np.int64)
    for to, key in zip(counts, ("n_yes", "n_trials"), strict=True):
        np.add.at(to, (who, group[index.ravel()]), _joined(study, key))
    return PriorPrediction(
        target.model.name, numbers, study.synthetic, pairs, group, equal, *counts
    )


def _joined(study: Study, key: str) -> npt.NDArray[Any]:
    return np.concatenate([getattr(subject, key) for subject in study])


def _groups(places: FloatArray) -> IntArray:
    """The group of each pair, shape (pairs, 2 or 3) -> (pairs,): by s2 - s1, then as they come."""
    distance = np.round(places[:, 1] - places[:, 0], 9)  # equal where only rounding differs
    group = np.empty(len(places), np.int64)
    if len(places) <= _MOST_PAIRS:
        group[np.argsort(distance, kind="stable")] = np.arange(
            len(places)
        )  # pairs come sorted by s1, s2 and interval
        return group
    order = np.sign(places[:, 1] - places[:, 0]).astype(np.int64)
    for sign in (-1, 0, 1):
        at = order == sign
        group[at] = sign * (1 + _bins(np.abs(distance[at])))
    return np.unique(group, return_inverse=True)[1]


def _bins(distance: FloatArray) -> IntArray:
    """Bins of about as many pairs, 12 at most, numbered by distance; pairs of one distance stay together."""
    values, index, pairs = np.unique(distance, return_inverse=True, return_counts=True)
    if len(values) <= _BINS:
        return index
    below = (np.cumsum(pairs) - 0.5 * pairs) / len(distance)
    return np.asarray(np.floor(_BINS * below).astype(np.int64)[index])
