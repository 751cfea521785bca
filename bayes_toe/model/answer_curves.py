"""Rows of counts: their log likelihood, its gradient and its Fisher information.

A model has the log probability of each answer to each pair, see :class:`AnswerRows`. The
probability of each answer is a sum of positive terms of its own, so that it is accurate where the
probability of another answer is near 1. An answer whose probability is below the smallest float
counts as impossible.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from scipy.special import expit, log_expit

from bayes_toe.arrays import ArrayPair, FloatArray, IndexArray, IntArray, NamedArrays, Texts
from bayes_toe.data.study import Subject
from bayes_toe.model.densities import Priors, half_normal_quantile, log_normal_density
from bayes_toe.model.paper_equations import LN2

#: The log probability of each answer, (rows, points, pairs). The answer that the task counts comes
#: first: 'equal' or 'second'. Three answers are 'equal', 'second' and 'first'.
LogAnswers = Sequence[FloatArray] | FloatArray
#: The log probability of each answer, and its slopes in every coordinate, (rows, points, k, pairs).
AnswerSlopes = tuple[LogAnswers, Sequence[FloatArray]]


# --- Counts and answers --------------------------------------------------------------------------


def times_counts(counts: FloatArray, values: FloatArray) -> FloatArray:
    """Counts times values; a count of 0 gives 0, also where the value is infinite or NaN."""
    # A product beyond the largest float is infinite, and 0 times infinity is NaN.
    with np.errstate(over="ignore", invalid="ignore"):
        product = np.asarray(counts * values)
    is_given = counts > 0.0
    if is_given.all():  # the usual case, without another array of this size
        return product
    return np.where(is_given, product, 0.0)


def over_scale(numerator: FloatArray, log_scale: FloatArray) -> FloatArray:
    """A numerator over a scale; 0 stays 0, even if the scale is below the smallest float."""
    # In logs, because 0 / 0 is NaN; the log of a numerator of 0 is -inf.
    with np.errstate(divide="ignore", over="ignore"):
        return np.sign(numerator) * np.exp(np.log(np.abs(numerator)) - log_scale)


def criterion(logit_peak: FloatArray) -> FloatArray:
    """The criterion k for which P(equal) at its peak is 2 Phi(k) - 1 = expit(logit_peak).

    Examples
    --------
    >>> criterion(np.array([0.0, 50.0])).round(4).tolist()
    [0.6745, 9.7455]
    """
    return half_normal_quantile(expit(logit_peak), log_expit(-logit_peak))


def criterion_slope(logit_peak: FloatArray, k: FloatArray) -> FloatArray:
    """Derivative dk/dl of :func:`criterion`, from 2 phi(k) dk/dl = expit(l) expit(-l)."""
    return np.exp(log_expit(logit_peak) + log_expit(-logit_peak) - log_normal_density(k) - LN2)


def log_questions(log_answers: LogAnswers) -> list[ArrayPair]:
    """Log probabilities of the counted answer and of the other answer to each question.

    Three answers are two questions: was it 'equal'; and if not, was it 'second'? Where every answer
    is 'equal', the share of 'second' among the other answers is not defined: it is 1/2 here.
    """
    if len(log_answers) == 2:
        log_yes, log_no = log_answers
        return [(log_yes, log_no)]
    log_equal, log_second, log_first = log_answers
    log_unequal = np.logaddexp(log_second, log_first)
    with np.errstate(invalid="ignore"):  # -inf - -inf
        log_odds = np.where(np.isfinite(log_unequal), log_second - log_first, 0.0)
    return [(log_equal, log_unequal), (log_expit(log_odds), log_expit(-log_odds))]


# --- Rows of counts ------------------------------------------------------------------------------


def pair_arrays(
    subjects: Sequence[Subject],
    origins: Sequence[float],
    units: Sequence[float],
    counts_by_subject: Sequence[Sequence[IntArray]],
) -> NamedArrays:
    """Stimuli and counts of several subjects by name, with the shapes of :class:`AnswerRows`.

    The stimuli of each subject count from its origin, in its unit. Subjects with fewer pairs than
    other subjects get further pairs that nobody answered: their counts are 0.
    """
    n_rows = len(subjects)
    n_answers = len(counts_by_subject[0])
    n_pairs = max(subject.n_pairs for subject in subjects)
    # The axis of length 1 is for the points.
    first, difference, middle = np.zeros((3, n_rows, 1, n_pairs))
    counts = np.zeros((n_rows, n_answers, 1, n_pairs))
    for i, (subject, origin, unit) in enumerate(zip(subjects, origins, units, strict=True)):
        s1 = (subject.s1 - origin) / unit
        s2 = (subject.s2 - origin) / unit
        pairs = slice(subject.n_pairs)
        first[i, 0, pairs] = s1
        middle[i, 0, pairs] = 0.5 * (s1 + s2)
        difference[i, 0, pairs] = (subject.s2 - subject.s1) / unit  # s2 - s1 would be less exact
        counts[i, :, 0, pairs] = counts_by_subject[i]
    return {"first": first, "difference": difference, "middle": middle, "counts": counts}


@dataclass(frozen=True, eq=False)
class AnswerRows(ABC):
    """Counts of one or several subjects of a task.

    Points u have the shape (rows, points, k).

    Attributes
    ----------
    first, difference, middle : ndarray, shape (rows, 1, pairs)
        s1, s2 - s1 and (s1 + s2)/2, from the origin of the model and in its unit.
    counts : ndarray, shape (rows, answers, 1, pairs)
        How often each answer was given, in the order of :data:`LogAnswers`.
    """

    first: FloatArray
    difference: FloatArray
    middle: FloatArray
    counts: FloatArray
    #: The names of the further arrays of a model that have a row for each row of counts.
    row_numbers: ClassVar[Texts] = ()

    @property
    @abstractmethod
    def coordinates(self) -> Texts:
        """Names of the k coordinates."""

    @property
    @abstractmethod
    def priors(self) -> Priors:
        """The prior of every coordinate."""

    def part(self, index: IndexArray) -> Self:
        """The rows with these indices, in their order; an index may be there more than once."""
        names = ("first", "difference", "middle", "counts", *self.row_numbers)
        return replace(self, **{name: getattr(self, name)[index] for name in names})

    @abstractmethod
    def log_answers(self, u: FloatArray) -> LogAnswers:
        """Log probability of each answer to every pair, (rows, points, pairs) each."""

    @abstractmethod
    def answer_slopes(self, u: FloatArray) -> AnswerSlopes:
        """Log probability of each answer, and its slopes, with the shapes of `AnswerSlopes`."""

    @property
    def counts_by_answer(self) -> FloatArray:
        """How often each answer was given to every pair, (answers, rows, 1, pairs)."""
        return self.counts.swapaxes(0, 1)

    def log_likelihood(self, u: FloatArray) -> FloatArray:
        """Log likelihood without binomial coefficients, (rows, points, k) -> (rows, points)."""
        return self.terms(self.log_answers(u)).sum(axis=-1)

    def terms(self, log_answers: LogAnswers) -> FloatArray:
        """What each pair adds to the log likelihood, (rows, points, pairs)."""
        return np.asarray(sum(map(times_counts, self.counts_by_answer, log_answers)))

    def scoring(self, u: FloatArray) -> tuple[FloatArray, ...]:
        """Log likelihood, gradient and Fisher information, (rows, points[, k[, k]]).

        The information is the sum over answers of n P slope slope', with the trials n of the pair.
        """
        log_answers, slopes = self.answer_slopes(u)
        n_trials = self.counts.sum(axis=1)
        value, gradient, information = np.zeros((3, 1))  # sums over the answers, which broadcast
        # Where an answer is impossible its slopes are infinite or NaN. It counts only if given.
        with np.errstate(over="ignore", invalid="ignore"):
            for counts, log_p, slope in zip(
                self.counts_by_answer, log_answers, slopes, strict=True
            ):
                # The root of n P, so that a product of scaled slopes has n P. Counts get an axis
                # for the coordinates, as slopes have: (rows, points, k, pairs).
                root_expected = np.sqrt(n_trials * np.exp(log_p))
                scaled_slope = times_counts(root_expected[..., None, :], slope)
                value = value + times_counts(counts, log_p).sum(axis=-1)
                gradient = gradient + times_counts(counts[..., None, :], slope).sum(axis=-1)
                information = information + scaled_slope @ np.swapaxes(scaled_slope, -1, -2)
        return value, gradient, information
