"""The trials of a subject in the order of presentation, and whether that order is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import bdtr

from bayes_toe.arrays import BoolArray, FloatArray, IndexArray
from bayes_toe.data.answers import Answers
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError

#: Chance below which trials count as sorted by their stimuli.
SORTED = 1e-6


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
    begins : ndarray of bool
        Where a session or block begins: the trial before has no effect there.
    """

    first: FloatArray
    second: FloatArray
    pair: IndexArray
    answer: FloatArray
    begins: BoolArray

    @classmethod
    def from_subject(cls, subject: Subject) -> TrialSequence:
        """The trials of a subject; an InputError where their order is not known."""
        answers = require_order(subject)
        columns = [subject.s1, subject.s2]
        if subject.isi is not None:
            columns.append(subject.isi)
        stacked = np.concatenate([np.column_stack(columns), answers.keys])
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
            answers.begins,
        )

    @property
    def is_answered(self) -> BoolArray:
        """Which trials have an answer."""
        return np.asarray(self.answer != 0.0)

    def earlier(self, lag: int) -> IndexArray:
        """Index of the trial `lag` trials before, of the same session; -1 where there is none."""
        session = np.cumsum(self.begins)
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
    step = np.diff(pair)[~answers.begins[1:]]
    n_changes = np.count_nonzero(step)
    n_rarer = min(np.count_nonzero(step > 0), np.count_nonzero(step < 0))
    if bdtr(n_rarer, n_changes, 0.5) < SORTED:
        return True
    in_sessions = np.unique(np.column_stack([np.cumsum(answers.begins), pair]), axis=0)
    is_run_of_each = n_changes == len(in_sessions) - np.count_nonzero(answers.begins)
    is_long = len(step) > 2 * n_changes > 2
    return bool(n_rarer == 0 and is_run_of_each and is_long)
