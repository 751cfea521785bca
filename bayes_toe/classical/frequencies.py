"""Statistics of responses without a model.

`laplace_estimate` and `laplace_error` are the mean and the standard deviation of a frequency under
a uniform prior, Beta(n_Eq + 1, n_Diff + 1): inside (0, 1) and above 0 even if all answers are the
same. `accuracy` is the share of right answers. `presentation_order` says which stimulus of a pair
came first.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.data.study import Subject


def laplace_estimate(n_yes: npt.ArrayLike, n_trials: npt.ArrayLike) -> FloatArray:
    """Estimated P(equal), qhat = (n_Eq + 1)/(n + 2); no unit. Arguments broadcast.

    Source: Eq. e:2b.

    Examples
    --------
    >>> laplace_estimate([0, 24, 48], 48).tolist()
    [0.02, 0.5, 0.98]
    """
    return np.add(n_yes, 1.0) / np.add(n_trials, 2.0)


def laplace_error(n_yes: npt.ArrayLike, n_trials: npt.ArrayLike) -> FloatArray:
    """Uncertainty of qhat, sigmahat_q = sqrt(qhat (1 - qhat)/(n + 3)).

    Arguments as for :func:`laplace_estimate`.

    Source: Eq. e:2b, in the form in which nothing cancels.
    """
    estimate = laplace_estimate(n_yes, n_trials)
    complement = laplace_estimate(np.subtract(n_trials, n_yes), n_trials)
    return np.sqrt(estimate * complement / np.add(n_trials, 3.0))


def accuracy(subject: Subject) -> float:
    """Share of correct answers, 0..1, among trials that have one; NaN without such trials.

    Source: Results, first part. Every trial counts alike.

    Examples
    --------
    >>> accuracy(Subject("S01", [0.0, 0.0], [0.0, 0.3], [9, 4], [10, 10]))
    0.75
    """
    difference = subject.s2 - subject.s1  # (pairs,)
    # Equal stimuli have no correct answer in some tasks, where `right` is 0.
    n_judged = subject.n_trials[subject.task.right(difference) != 0].sum()
    if not n_judged:
        return np.nan

    if subject.n_second is None:
        n_wrong = subject.task.wrong(difference, subject.n_yes, subject.n_trials)
    else:  # of three answers, 'equal', 'second' or 'first' is correct
        n_correct = np.select(
            [difference == 0.0, difference > 0.0],
            [subject.n_yes, subject.n_second],
            subject.n_first,
        )
        n_wrong = subject.n_trials - n_correct
    return float(1.0 - n_wrong.sum() / n_judged)


def presentation_order(subject: Subject) -> IntArray:
    """Order of every pair, sign(s1 - s2).

    -1 weaker first (the paper's red), 0 equal stimuli (grey), 1 stronger first (blue).

    Source: Methods and Fig. 1C; the caption of Fig. 3 swaps the colours of its circles.

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [9, 4, 5], [10, 10, 10])
    >>> presentation_order(subject).tolist()
    [0, -1, 1]
    """
    return np.sign(subject.s1 - subject.s2).astype(np.int64)
