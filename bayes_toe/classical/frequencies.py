"""What the answers alone say: frequencies of 'equal' with their uncertainty, accuracy, order of presentation. No model.

The Laplace estimator is the mean, and its error the standard deviation, of the posterior Beta(n_Eq + 1, n_Diff + 1) that a uniform prior
gives each frequency; neither degenerates where every answer was the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError


def laplace_estimate(n_equal: npt.ArrayLike, n_trials: npt.ArrayLike) -> FloatArray:
    """Estimated P(equal), qhat = (n_Eq + 1)/(n + 2); no unit. Arguments broadcast.

    Source: Eq. e:2b.

    Raises
    ------
    InputError
        Unless 0 <= n_equal <= n_trials.

    Examples
    --------
    >>> laplace_estimate([0, 24, 48], 48).tolist()
    [0.02, 0.5, 0.98]
    """
    k, n = _counts(n_equal, n_trials)
    return np.asarray((k + 1.0) / (n + 2.0))


def laplace_error(n_equal: npt.ArrayLike, n_trials: npt.ArrayLike) -> FloatArray:
    """Uncertainty of qhat, sigmahat_q = sqrt(qhat (1 - qhat)/(n + 3)); arguments and errors as for :func:`laplace_estimate`.

    Source: Eq. e:2b, in the form in which nothing cancels.

    Examples
    --------
    >>> float(laplace_error(0, 0)) == 12**-0.5  # the uniform distribution
    True
    """
    k, n = _counts(n_equal, n_trials)
    return np.asarray(np.sqrt((k + 1.0) / (n + 2.0) * ((n - k + 1.0) / (n + 2.0)) / (n + 3.0)))


def accuracy(subject: Subject) -> float:
    """Share of correct answers, 0..1: 'equal' to a stimulus paired with itself, 'different' to any other pair.

    Source: Results, first part. Every trial counts alike.

    Examples
    --------
    >>> accuracy(Subject("S01", [0.0, 0.0], [0.0, 0.3], [9, 4], [10, 10]))
    0.75
    """
    same = subject.s1 == subject.s2
    correct = np.where(same, subject.n_equal, subject.n_trials - subject.n_equal)
    return float(correct.sum() / subject.n_trials.sum())


def presentation_order(subject: Subject) -> IntArray:
    """Order of every pair, sign(s1 - s2): -1 weaker first (the paper's red), 0 equal stimuli (grey), 1 stronger first (blue).

    Source: Methods and Fig. 1C; the caption of Fig. 3 swaps the colours of its circles.

    Examples
    --------
    >>> presentation_order(Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [9, 4, 5], [10, 10, 10])).tolist()
    [0, -1, 1]
    """
    return np.sign(subject.s1 - subject.s2).astype(np.int64)


@dataclass(frozen=True, eq=False)
class Frequencies:
    """Model-free estimates of one subject, arrays of shape (pairs,) in the order of the subject's pairs.

    Attributes
    ----------
    s1, s2 : array
        Natural-log intensities.
    order : array of int
        See :func:`presentation_order`.
    q, error : array
        Laplace estimator of P(equal) and its uncertainty.
    """

    s1: FloatArray
    s2: FloatArray
    order: IntArray
    q: FloatArray
    error: FloatArray


def frequencies(subject: Subject) -> Frequencies:
    """Model-free estimates of every pair of a subject. Source: Eq. e:2b; the circles of Fig. 3.

    Examples
    --------
    >>> frequencies(Subject("S01", [0.0, 0.0], [0.0, 0.3], [48, 24], [48, 48])).q.tolist()
    [0.98, 0.5]
    """
    k, n = subject.n_equal, subject.n_trials
    return Frequencies(subject.s1, subject.s2, presentation_order(subject), laplace_estimate(k, n), laplace_error(k, n))


def _counts(n_equal: npt.ArrayLike, n_trials: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    k, n = np.asarray(n_equal, np.float64), np.asarray(n_trials, np.float64)
    if not np.all((k >= 0) & (k <= n)):
        raise InputError("every n_equal must lie in 0..n_trials")
    return k, n
