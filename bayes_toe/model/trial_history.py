"""Effects of the trial before on the next one, added to the observer.

`TrialHistoryPosterior` is the posterior with these effects, and `TrialSequence` has the trials in
their order. `looks_sorted` finds files in which that order was lost.

    previous response   z + kappa r in 'which is stronger', k_m exp(kappa r) with 'equal'
    carry-over          sbar + E takes the place of sbar in p (s1 - sbar)

r is the answer of the trial before: 1 for the one that the task counts, -1 for the other one, 0
where there is none. So kappa > 0 repeats answers and kappa < 0 alternates them. E is 0 at the start
of a session or block, and afterwards

    E' = rho ((1 - p) (s2 - sbar) + p (1 - p) (s1 - sbar) + p^2 E)

of the trial before, whether that has an answer or not: its stimuli were perceived all the same.
rho = 0 is the observer without carry-over.

kappa has the prior Normal(0, 0.5), with 'equal' Normal(0, 0.25); rho has Uniform(0, 1). The
coordinates of both are standard normal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import bdtr, ndtr, xlogy

from bayes_toe.arrays import AnyRng, ArrayPair, BoolArray, FloatArray, IndexArray, NamedArrays
from bayes_toe.data.answers import Answers
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.errors import InputError
from bayes_toe.model.distributions import LOG_2PI
from bayes_toe.model.observer import (
    DEFAULT_PRIOR,
    ObserverBatch,
    ObserverPosterior,
    OrderModel,
)
from bayes_toe.model.parameters import ObserverPrior
from bayes_toe.model.posterior import SameCoordinates

#: Values of a temporary array of points times trials.
_BLOCK = 1 << 17
#: Chance below which trials count as sorted by their stimuli.
SORTED = 1e-6


def response_sd(task: Task) -> float:
    """Standard deviation of the prior of kappa."""
    return 0.25 if task == SAME_DIFFERENT else 0.5


@dataclass(frozen=True)
class TrialHistory:
    """A model of the order of stimuli with what the trial before does.

    Attributes
    ----------
    order : OrderModel
    has_previous_response : bool
        Whether the answer of the trial before has an effect.
    has_carry_over : bool
        Whether its stimuli have; the order model then has a contraction.
    """

    order: OrderModel
    has_previous_response: bool
    has_carry_over: bool

    @property
    def name(self) -> str:
        """The order model and its histories."""
        parts = [self.order.name]
        if self.has_carry_over:
            parts.append("carry-over")
        if self.has_previous_response:
            parts.append("previous response")
        return " + ".join(parts)


class _Cells(NamedTuple):
    """Answered trials; without carry-over those of a pair after the same answer are one cell."""

    pair: IndexArray  # (cells,)
    response: FloatArray  # (cells,): the answer before, r
    cell: IndexArray  # (answered trials,): the cell of each
    n_yes: FloatArray  # (cells,)
    n_no: FloatArray


@dataclass(frozen=True, eq=False)
class TrialHistoryPosterior:
    """The posterior of one subject under a model with a history of trials.

    Points have the shape (points, k): the free coordinates of the order model, then those of kappa
    and rho where the model has them. The log likelihood is that of the counts where neither has an
    effect.
    """

    subject: Subject
    model: TrialHistory
    prior: ObserverPrior = DEFAULT_PRIOR

    @cached_property
    def observer(self) -> ObserverPosterior:
        """The posterior without history."""
        return self.model.order.posterior(self.subject, self.prior)

    @cached_property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        names = list(self.observer.coordinates)
        if self.model.has_previous_response:
            names.append("previous_response")
        if self.model.has_carry_over:
            names.append("carry_over")
        return tuple(names)

    @cached_property
    def trials(self) -> TrialSequence:
        """All trials in order."""
        return TrialSequence.from_subject(self.subject)

    @cached_property
    def _stimuli(self) -> ArrayPair:
        """First and second stimuli of all trials about sbar, in D, (trials, 1) each."""
        scales = self.observer.scales
        first = (self.trials.first - scales.sbar) / scales.step
        second = (self.trials.second - scales.sbar) / scales.step
        return first[:, None], second[:, None]

    @cached_property
    def _cells(self) -> _Cells:
        """The cells over which the likelihood is a product."""
        trials = self.trials
        rows = np.flatnonzero(trials.is_answered)
        earlier = trials.earlier(1)[rows]
        pair, is_yes = trials.pair[rows], trials.answer[rows] > 0.0
        response = np.where(earlier >= 0, trials.answer[earlier], 0.0)
        if self.model.has_carry_over:
            own_cell = np.arange(len(rows))
            return _Cells(pair, response, own_cell, is_yes.astype(float), (~is_yes).astype(float))
        distinct, cell = np.unique(np.stack([pair, response]), axis=1, return_inverse=True)
        cell = cell.ravel()
        n_yes = np.bincount(cell, is_yes).astype(np.float64)
        n_no = np.bincount(cell).astype(np.float64) - n_yes
        return _Cells(distinct[0].astype(np.intp), distinct[1], cell, n_yes, n_no)

    @cached_property
    def _batch(self) -> ObserverBatch:
        """The observer with cells for pairs."""
        cells, batch = self._cells, self.observer.batch
        return replace(
            batch,
            first=batch.first[..., cells.pair],
            difference=batch.difference[..., cells.pair],
            middle=batch.middle[..., cells.pair],
            n_yes=cells.n_yes[None, None],
            n_no=cells.n_no[None, None],
        )

    def expectation(self, x: FloatArray) -> FloatArray:
        """E of every trial in D, (points, k) -> (trials, points)."""
        values = self.observer.batch.quantities(self.observer.full_points(self._of_order(x)))
        p, rho = values["contraction"][0], self._carry_over(x)
        first, second = self._stimuli
        # E' = rho (1 - p) (s2 + p s1) + rho p^2 E, stimuli from sbar.
        of_stimuli = rho * (1.0 - p) * (second + p * first)
        share_kept = rho * np.square(p)
        expectations = np.zeros_like(of_stimuli)
        for trial in range(1, len(expectations)):
            if not self.trials.is_session_start[trial]:
                before = trial - 1
                expectations[trial] = of_stimuli[before] + share_kept * expectations[before]
        return expectations

    def log_likelihood(self, x: FloatArray) -> FloatArray:
        """Log likelihood, (points, k) -> (points,); -inf where abs(p) is 1 or more.

        There is no such contraction, and an expectation would grow from trial to trial.
        """
        full = self.observer.full_points(self._of_order(x))
        contraction = self.observer.batch.quantities(full)["contraction"][0]
        is_possible = np.abs(contraction) < 1.0
        values = np.full(len(x), -np.inf)
        if is_possible.any():
            parts = [self._part_likelihood(part) for part in self._parts(x[is_possible])]
            values[is_possible] = np.concatenate(parts)
        return values

    def _part_likelihood(self, x: FloatArray) -> FloatArray:
        """The log likelihood of a few points, (points,)."""
        yes, no = self._batch.plain_answers_at(*self._observer_at(x))
        terms = xlogy(self._cells.n_yes, yes) + xlogy(self._cells.n_no, no)
        return terms[0].sum(axis=1)

    def trial_probabilities(self, x: FloatArray) -> FloatArray:
        """P of the answer that the task counts in every answered trial, (points, trials)."""
        cells = [
            self._batch.plain_answers_at(*self._observer_at(part))[0][0] for part in self._parts(x)
        ]
        return np.concatenate(cells)[:, self._cells.cell]

    def _parts(self, x: FloatArray) -> list[FloatArray]:
        """Points in parts of which temporary arrays stay small."""
        n_cells = len(self._cells.pair)
        return np.array_split(x, max(1, -(-len(x) * n_cells // _BLOCK)))

    def _observer_at(self, x: FloatArray) -> tuple[NamedArrays, FloatArray, FloatArray | None]:
        """The observer's parameters at points, distances and criteria, (1, points, cells) each."""
        batch = self._batch
        values = batch.quantities(self.observer.full_points(self._of_order(x)))
        expectation: FloatArray | float = 0.0
        if self.model.has_carry_over:
            expectation = self.expectation(x)[self.trials.is_answered].T[None]
        z = batch.distance_at(values, expectation)
        k = batch.criterion_at(values)
        if self.model.has_previous_response:
            shift = self._previous_response(x)[:, None] * self._cells.response
            if k is None:
                z = z + shift
            else:
                k = k * np.exp(shift)
        return values, z, k

    def log_prior(self, x: FloatArray) -> FloatArray:
        """Log prior density, (points, k) -> (points,)."""
        scores = x[:, len(self.observer.coordinates) :]
        log_normal = -0.5 * (np.square(scores) + LOG_2PI).sum(axis=1)
        return self.observer.log_prior(self._of_order(x)) + log_normal

    def sample_prior(self, rng: AnyRng, size: int) -> FloatArray:
        """Independent draws from the prior, (size, k)."""
        of_order = self.observer.sample_prior(rng, size)
        n_own = len(self.coordinates) - of_order.shape[1]
        return np.concatenate([of_order, rng.standard_normal((size, n_own))], axis=1)

    def transform(self, modes: FloatArray) -> SameCoordinates:
        """Coordinates in which a mixture fits: these ones."""
        return SameCoordinates()

    def quantities(self, x: FloatArray) -> dict[str, FloatArray]:
        """Every named quantity, (points,) each."""
        values = self.observer.quantities(self._of_order(x))
        if self.model.has_previous_response:
            values["previous_response"] = self._previous_response(x)
        if self.model.has_carry_over:
            values["carry_over"] = self._carry_over(x)
        return values

    def _of_order(self, x: FloatArray) -> FloatArray:
        return x[:, : len(self.observer.coordinates)]

    def _previous_response(self, x: FloatArray) -> FloatArray:
        """Kappa, (points,)."""
        score = x[:, len(self.observer.coordinates)]
        return response_sd(self.subject.task) * score

    def _carry_over(self, x: FloatArray) -> FloatArray:
        """Rho, (points,)."""
        return ndtr(x[:, -1])


# --- The order of the trials ----------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class TrialSequence:
    """All trials of a subject in the order of presentation; arrays have the shape (trials,).

    Attributes
    ----------
    first, second : ndarray
        Stimuli, natural-log intensity.
    pair : ndarray of int
        The trial's pair among those of the subject; -1 where that pair was never answered.
    answer : ndarray
        1 for the answer that the task counts, -1 for the other one, 0 for none.
    is_session_start : ndarray of bool
        Whether a session or block begins: the trial before has no effect there.
    """

    first: FloatArray
    second: FloatArray
    pair: IndexArray
    answer: FloatArray
    is_session_start: BoolArray

    @classmethod
    def from_subject(cls, subject: Subject) -> TrialSequence:
        """The trials of a subject; an InputError if their order is not known."""
        answers = require_order(subject)
        stacked = np.concatenate([np.column_stack([subject.s1, subject.s2]), answers.keys])
        _, number = np.unique(stacked, axis=0, return_inverse=True)
        number = number.ravel()
        pair_of_number = np.full(int(number.max()) + 1, -1, np.intp)
        pair_of_number[number[: subject.n_pairs]] = np.arange(subject.n_pairs)
        answer = np.where(answers.n_trials > 0, 2.0 * answers.n_yes - 1.0, 0.0)
        return cls(
            answers.keys[:, 0],
            answers.keys[:, 1],
            pair_of_number[number[subject.n_pairs :]],
            answer,
            answers.is_session_start,
        )

    @property
    def is_answered(self) -> BoolArray:
        """Whether trials have an answer."""
        return self.answer != 0.0

    def earlier(self, lag: int) -> IndexArray:
        """Index of the trial `lag` trials before, of the same session; -1 where there is none."""
        session = np.cumsum(self.is_session_start)
        index = np.full(len(session), -1, np.intp)
        is_known = session[lag:] == session[:-lag]
        index[lag:][is_known] = np.flatnonzero(is_known)
        return index


def require_order(subject: Subject) -> Answers:
    """The answers of a subject in the order of presentation.

    An InputError where it is not known.
    """
    answers = subject.answers
    if answers is None or answers.place is None:
        raise InputError(
            f"subject {subject.name!r}: a model with a history needs the order of trials, found "
            "none; allowed: rows that are trials, with a column trial (numbers, once each, or once "
            "in each session or block)"
        )
    if looks_sorted(answers):
        raise InputError(
            f"subject {subject.name!r}: trials are sorted by their stimuli, which is not the order "
            "in which they were presented; allowed: a column trial that tells it"
        )
    return answers


def knows_order(subject: Subject) -> bool:
    """Whether the order of a subject's trials is known."""
    answers = subject.answers
    return answers is not None and answers.place is not None and not looks_sorted(answers)


def looks_sorted(answers: Answers) -> bool:
    """Whether stimuli rise or fall from trial to trial more often than by chance.

    Trials in one run of each pair count as sorted, too; blocks of a pair in both orders do not.

    Examples
    --------
    >>> keys, ones = np.array([[0.0, 0.0], [0.0, 0.3], [0.3, 0.0]]), np.ones(60, int)
    >>> sorted_keys = np.repeat(keys, 20, axis=0)
    >>> looks_sorted(Answers(sorted_keys, ones, ones, None, (), True, np.arange(60)))
    True
    >>> looks_sorted(Answers(np.tile(keys, (20, 1)), ones, ones, None, (), True, np.arange(60)))
    False
    """
    pair = np.unique(answers.keys, axis=0, return_inverse=True)[1].ravel()
    step = np.diff(pair)[~answers.is_session_start[1:]]
    n_changes = np.count_nonzero(step)
    n_rarer = min(np.count_nonzero(step > 0), np.count_nonzero(step < 0))
    if bdtr(n_rarer, n_changes, 0.5) < SORTED:
        return True
    in_sessions = np.unique(np.column_stack([np.cumsum(answers.is_session_start), pair]), axis=0)
    is_run_of_each = n_changes == len(in_sessions) - np.count_nonzero(answers.is_session_start)
    is_long = len(step) > 2 * n_changes > 2
    return bool(n_rarer == 0 and is_run_of_each and is_long)
