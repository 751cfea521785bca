"""Effects of the trial before on the next trial, added to the observer.

`TrialHistoryPosterior` is the posterior with these effects, and `TrialSequence` has the trials in
their order. `looks_sorted` finds files in which the order of the trials was lost.

    previous response   k_m exp(kappa r) in 'same or different', z + kappa r in the other tasks
    carry-over          sbar + E takes the place of sbar in p (s1 - sbar)

r is the answer of the trial before: 1 for the answer that the task counts, -1 for the other answer,
0 without an answer. With three answers r is 1 after 'second', 0 after 'equal' and -1 after 'first'.
So kappa > 0 repeats answers and kappa < 0 alternates them. E is 0 at the start of a session or
block, and afterwards

    E' = rho ((1 - p) (s2 - sbar) + p (1 - p) (s1 - sbar) + p^2 E)

of the trial before, also if that trial has no answer: its stimuli were perceived all the same.
rho = 0 is the observer without carry-over.

kappa has the prior Normal(0, 0.5), in 'same or different' Normal(0, 0.25); rho has Uniform(0, 1).
The coordinates of both are standard normal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import compress

import numpy as np
from scipy.special import bdtr, ndtr

from bayes_toe.arrays import BoolArray, FloatArray, IndexArray, NamedArrays, Texts
from bayes_toe.data.answers import Answers
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.model.densities import Priors, StandardNormal
from bayes_toe.model.models import ObserverPosterior, OrderModel
from bayes_toe.model.observer import DEFAULT_PRIOR, Curve, ObserverRows
from bayes_toe.model.parameters import ObserverPrior
from bayes_toe.model.posterior_array import PosteriorArray, independent_array


@dataclass(frozen=True)
class TrialHistory:
    """A model of the order of stimuli, with effects of the trial before.

    Attributes
    ----------
    order : OrderModel
    has_previous_response : bool
        Whether the answer of the trial before has an effect.
    has_carry_over : bool
        Whether the stimuli of the trial before have an effect. The order model then has a
        contraction.
    """

    order: OrderModel
    has_previous_response: bool
    has_carry_over: bool

    @property
    def effects(self) -> Texts:
        """Names of the coordinates that the histories add, in their order."""
        is_present = self.has_previous_response, self.has_carry_over
        return tuple(compress(("previous_response", "carry_over"), is_present))

    @property
    def name(self) -> str:
        """The order model and its histories, as in 'both + carry-over + previous response'.

        Random streams are keyed by the name, so the order of the histories in it must stay.
        """
        is_present = self.has_carry_over, self.has_previous_response
        histories = compress(("carry-over", "previous response"), is_present)
        return " + ".join([self.order.name, *histories])


@dataclass(frozen=True, eq=False)
class HistoryRows(ObserverRows):
    """One row of the trials of a subject, whose responses also depend on the trial before.

    In the place of a pair, the row has a cell: an answered trial, or without carry-over all trials
    of a pair after the same answer. Points have the observer's coordinates, then those of kappa and
    rho if the model has them. The class has no slopes in kappa and rho, only values.

    Attributes
    ----------
    history : TrialHistory
    trials : TrialSequence
    previous : ndarray, shape (cells,)
        r, the answer before the trials of the cell.
    cell_of_trial : ndarray of int, shape (answered trials,)
        The cell of each answered trial.
    first_of_trial, second_of_trial : ndarray, shape (trials, 1)
        Stimuli from sbar, in D.
    """

    history: TrialHistory
    trials: TrialSequence
    previous: FloatArray
    cell_of_trial: IndexArray
    first_of_trial: FloatArray
    second_of_trial: FloatArray

    @classmethod
    def from_trials(cls, observer: ObserverPosterior, history: TrialHistory) -> HistoryRows:
        """The trials of a subject, with the scales and the prior of a posterior.

        With carry-over, each answered trial is a cell. Without carry-over, all trials of a pair
        after the same answer are one cell.
        """
        trials = TrialSequence.from_subject(observer.subject)
        # Pair and answer of each answered trial, and the answer before it.
        answered_trials = np.flatnonzero(trials.is_answered)
        pair_of_trial = trials.pair[answered_trials]
        answer_of_trial = trials.answer[answered_trials]
        trials_before = trials.previous[answered_trials]
        # The first trial of a session has no earlier trial.
        answer_before = np.where(trials_before >= 0, trials.answer[trials_before], 0.0)

        # Trials with the same key are one cell. The answer before is -1, 0 or 1.
        if history.has_carry_over:
            key = np.arange(len(answered_trials))
        else:
            key = 3 * pair_of_trial + answer_before
        # Indices of answered trials: one trial of each cell, which stands for it; and the cell of
        # each trial.
        _, trial_of_cell, cell_of_trial = np.unique(key, return_index=True, return_inverse=True)

        n_positive = np.bincount(cell_of_trial, answer_of_trial > 0.0)
        n_negative = np.bincount(cell_of_trial, answer_of_trial < 0.0)
        if observer.subject.task.has_three_answers:
            n_equal = np.bincount(cell_of_trial, answer_of_trial == 0.0)
            counts = [n_equal, n_positive, n_negative]
        else:
            counts = [n_positive, n_negative]

        # Task, scales and prior come from the posterior. A cell has the stimuli of its pair.
        values = {field.name: getattr(observer.rows, field.name) for field in fields(ObserverRows)}
        for name in ("first", "difference", "middle"):
            values[name] = values[name][..., pair_of_trial[trial_of_cell]]
        values["counts"] = np.array(counts)[None, :, None]  # (1, answers, 1, cells)

        scales = observer.scales
        return cls(
            **values,
            history=history,
            trials=trials,
            previous=answer_before[trial_of_cell],
            cell_of_trial=cell_of_trial,
            first_of_trial=((trials.first - scales.sbar) / scales.step)[:, None],
            second_of_trial=((trials.second - scales.sbar) / scales.step)[:, None],
        )

    @property
    def coordinates(self) -> Texts:
        """Names of the observer's coordinates, then the coordinates of kappa and rho."""
        return (*super().coordinates, *self.history.effects)

    @cached_property
    def priors(self) -> Priors:
        """The prior of every coordinate."""
        return (*super().priors, *(StandardNormal() for _ in self.history.effects))

    def quantities(self, u: FloatArray) -> NamedArrays:
        """The parameters at points, stimuli in units of D, shape (rows, points) each."""
        values = super().quantities(u)
        scores = dict(zip(self.coordinates, np.moveaxis(u, -1, 0), strict=True))
        if self.history.has_previous_response:
            sd = 0.5 if self.task.has_direction else 0.25  # of the prior of kappa, see the module
            values["previous_response"] = sd * scores["previous_response"]
        if self.history.has_carry_over:
            values["carry_over"] = ndtr(scores["carry_over"])
        return values

    def first_from_centre(self, values: NamedArrays) -> FloatArray:
        """The first stimulus less the centre of the contraction, here sbar + E, in units of D."""
        if not self.history.has_carry_over:
            return self.first
        expected = expectations(
            self.first_of_trial,
            self.second_of_trial,
            values["contraction"][0],  # (points,), of the one row
            values["carry_over"][0],
            self.trials.is_session_start,
        )
        # From (trials, points) to (1, points, answered trials). Each answered trial is a cell.
        return self.first - expected[self.trials.is_answered].T[None]

    def curve_at(self, u: FloatArray) -> Curve:
        """The curve of every point; arrays have cells in the place of pairs."""
        curve = super().curve_at(u)
        if not self.history.has_previous_response:
            return curve
        shift = curve.values["previous_response"][..., None] * self.previous
        if self.task.has_direction:
            return curve._replace(z=curve.z + shift)
        assert curve.k is not None  # same or different
        return curve._replace(k=curve.k * np.exp(shift))

    def log_likelihood(self, u: FloatArray) -> FloatArray:
        """Log likelihood, (1, points); -inf where abs(p) is 1 or more.

        A contraction of that size does not exist. An expectation would grow from trial to trial.
        """
        is_possible = np.abs(super().quantities(u)["contraction"]) < 1.0  # (1, points)
        log_likelihood_of_blocks = []
        for block in self._point_blocks(u[:, is_possible[0]]):
            log_likelihood_of_blocks.append(super().log_likelihood(block))

        log_likelihood = np.full(u.shape[:2], -np.inf)
        log_likelihood[is_possible] = np.concatenate(log_likelihood_of_blocks, axis=1)[0]
        return log_likelihood

    def trial_probabilities(self, u: FloatArray) -> FloatArray:
        """P of the counted answer in every answered trial, (points, trials).

        With three answers, it is P('second').
        """
        p_of_cells = []
        for block in self._point_blocks(u):
            # The last answer is 'different' or 'first'. Before it stands 'equal' or 'second'.
            *_, counted, _ = self.answers_at(self.curve_at(block))
            p_of_cells.append(counted[0])  # (points, cells), of the one row
        return np.concatenate(p_of_cells)[:, self.cell_of_trial]

    def _point_blocks(self, u: FloatArray) -> list[FloatArray]:
        """Points in blocks, so that temporary arrays have at most about 2^17 values."""
        n_values = u.shape[1] * len(self.previous)  # a value for each point and cell
        return np.array_split(u, max(1, math.ceil(n_values / 2**17)), axis=1)


@dataclass(frozen=True, eq=False)
class TrialHistoryPosterior:
    """The posterior of one subject under a model with a history of trials.

    Points have the shape (points, d), with all coordinates of :class:`HistoryRows`. A coordinate
    that the order model does not have is 0.
    """

    subject: Subject
    model: TrialHistory
    prior: ObserverPrior = DEFAULT_PRIOR

    @cached_property
    def observer(self) -> ObserverPosterior:
        """The observer 'both' without history."""
        return OrderModel("both").posterior(self.subject, self.prior)

    @cached_property
    def rows(self) -> HistoryRows:
        """The trials, as one row."""
        return HistoryRows.from_trials(self.observer, self.model)

    @cached_property
    def array(self) -> PosteriorArray:
        """The posterior as an array of one posterior."""
        coordinates = self.model.order.coordinates(self.subject.task)
        return independent_array(self.rows, [(*coordinates, *self.model.effects)])

    def quantities(self, points: FloatArray) -> NamedArrays:
        """Every named quantity, (points,) each."""
        k = len(self.observer.coordinates)
        row_quantities = self.rows.quantities(points[None])
        effects = {name: row_quantities[name][0] for name in self.model.effects}
        return self.observer.quantities(points[:, :k]) | effects

    def trial_probabilities(self, points: FloatArray) -> FloatArray:
        """P of the answer that the task counts in every answered trial, (points, trials)."""
        return self.rows.trial_probabilities(points[None])


def expectations(
    first: FloatArray,
    second: FloatArray,
    p: FloatArray | float,
    rho: FloatArray | float,
    is_session_start: BoolArray | None = None,
) -> FloatArray:
    """E of every trial by the formula of the module, (trials, ...).

    Parameters
    ----------
    first, second : ndarray, shape (trials, ...)
        Stimuli from sbar.
    p, rho : ndarray or float
        Contraction and carry-over, which broadcast with the stimuli.
    is_session_start : ndarray of bool, shape (trials,), optional
        By default only the first trial is the start of a session.
    """
    # E' = rho (1 - p) (s2 + p s1) + rho p^2 E
    stimulus_term = rho * (1.0 - p) * (second + p * first)
    decay = rho * np.square(p)
    expected = np.zeros_like(stimulus_term)
    for trial in range(1, len(expected)):
        if is_session_start is None or not is_session_start[trial]:
            expected[trial] = stimulus_term[trial - 1] + decay * expected[trial - 1]
    return expected


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
        r: 1 for the answer that the task counts, -1 for the other answer, 0 without an answer. With
        three answers, 1 for 'second', 0 for 'equal', -1 for 'first'.
    is_answered : ndarray of bool
        Whether trials have an answer.
    is_session_start : ndarray of bool
        Whether a session or block begins: the trial before has no effect there.
    """

    first: FloatArray
    second: FloatArray
    pair: IndexArray
    answer: FloatArray
    is_answered: BoolArray
    is_session_start: BoolArray

    @classmethod
    def from_subject(cls, subject: Subject) -> TrialSequence:
        """The trials of a subject; an InputError if their order is not known."""
        import pandas as pd

        answers = require_order(subject)  # one trial a row
        pairs = pd.MultiIndex.from_arrays([subject.s1, subject.s2])
        # r is 1 for a positive answer, -1 for a negative answer, and 0 without an answer: then both
        # counts are 0. Among three answers, 'equal' is neither positive nor negative.
        signed = answers if answers.n_second is None else answers.unequal_answers
        return cls(
            first=answers.keys[:, 0],
            second=answers.keys[:, 1],
            pair=pairs.get_indexer(pd.MultiIndex.from_arrays(list(answers.keys.T))),
            # Positive minus negative answers, which are n_trials - n_yes.
            answer=np.asarray(2.0 * signed.n_yes - signed.n_trials, np.float64),
            is_answered=answers.n_trials > 0,
            is_session_start=answers.is_session_start,
        )

    @property
    def previous(self) -> IndexArray:
        """Index of the trial before in the same session; -1 where there is no such trial."""
        return np.where(self.is_session_start, -1, np.arange(len(self.answer)) - 1)


def require_order(subject: Subject) -> Answers:
    """The answers of a subject in the order of presentation; an InputError if it is not known."""
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


def looks_sorted(answers: Answers) -> bool:
    """Whether the trials look sorted by their stimuli, with a false-alarm rate of one in a million.

    In sorted trials, pairs rise, or fall, from trial to trial more often than by chance. Trials in
    one run of each pair count as sorted, too; blocks of a pair in both orders do not.

    Examples
    --------
    >>> pairs = np.array([[0.0, 0.0], [0.0, 0.3], [0.3, 0.0]])
    >>> trials = {"n_yes": np.ones(60, int), "n_trials": np.ones(60, int), "place": np.arange(60)}
    >>> looks_sorted(Answers(np.repeat(pairs, 20, axis=0), **trials))
    True
    >>> looks_sorted(Answers(np.tile(pairs, (20, 1)), **trials))
    False
    """
    # Steps between trials of a session, in the rank of the pair by its stimuli.
    pair = answers.pair
    step = np.diff(pair)[~answers.is_session_start[1:]]
    n_changes = np.count_nonzero(step)
    n_rises = np.count_nonzero(step > 0)
    n_rarer = min(n_rises, n_changes - n_rises)
    # In random order, rising and falling are equally probable. P of so few rarer changes:
    if bdtr(n_rarer, n_changes, 0.5) < 1e-6:
        return True

    session = np.cumsum(answers.is_session_start)
    pairs_in_sessions = np.unique(np.column_stack([session, pair]), axis=0)
    # A run begins with each session, and with each change of the pair.
    n_runs = n_changes + np.count_nonzero(answers.is_session_start)
    has_one_run_of_each = n_runs == len(pairs_in_sessions)
    # A run has more than two trials on average. A single change may be that of two blocks.
    has_long_runs = len(step) > 2 * n_changes and n_changes > 1
    # Without rarer changes, all pairs rise, or all fall.
    return bool(n_rarer == 0 and has_one_run_of_each and has_long_runs)
