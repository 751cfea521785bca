"""Log probabilities of both answers, their derivatives, and the log likelihood of counts.

All are functions of the distance z between two stimuli, which counts in standard deviations of the
noise. An observer who is asked which stimulus is stronger answers 'second' with P = Phi(z).
An observer who is asked 'same or different' answers 'equal' where the noisy distance lies within a
criterion k: P = Phi(k - z) - Phi(-k - z).

Both answers have a log probability of their own, formed from positive terms, so that each is
accurate where the other probability is near 1.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, Self

import numpy as np
from scipy.special import expit, log_expit, log_ndtr

from bayes_toe.arrays import FloatArray, IndexArray, NamedArrays, Texts
from bayes_toe.data.study import Subject
from bayes_toe.model.densities import Priors, half_normal_quantile, log_normal_density
from bayes_toe.model.paper_equations import LN2

#: Nodes and weights of Gauss and Legendre on (0, 1), for windows in which the density is level:
#: there, twelve nodes leave no error but rounding. NumPy has nodes and weights on (-1, 1).
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_NODES = 0.5 * (_NODES + 1.0)
_WEIGHTS = 0.5 * _WEIGHTS


class LogAnswers(NamedTuple):
    """Log probabilities of the answer that the task counts, and of the other answer."""

    yes: FloatArray
    no: FloatArray


#: The log probability of each answer, (rows, points, pairs), and its slopes in every coordinate,
#: (rows, points, k, pairs).
AnswerSlopes = tuple[Sequence[FloatArray], Sequence[FloatArray]]


# --- Counts --------------------------------------------------------------------------------------


def times_counts(counts: FloatArray, values: FloatArray) -> FloatArray:
    """Counts times values; a count of 0 gives 0, also where the value is infinite or NaN."""
    # A product beyond the largest float is infinite, and 0 times infinity is NaN.
    with np.errstate(over="ignore", invalid="ignore"):
        product = np.asarray(counts * values)
    is_given = counts > 0.0
    if is_given.all():  # the usual case, without another array of this size
        return product
    return np.where(is_given, product, 0.0)


def with_complement(yes: FloatArray, no: FloatArray) -> LogAnswers:
    """Both log probabilities, the larger computed as the complement of the smaller.

    The log of the larger probability is near 0, where its own digits are lost.
    """
    yes_is_rare = yes < no
    larger = np.log1p(-np.exp(np.minimum(yes, no)))
    return LogAnswers(np.where(yes_is_rare, yes, larger), np.where(yes_is_rare, larger, no))


def over_scale(numerator: FloatArray, log_scale: FloatArray) -> FloatArray:
    """A numerator over a scale; 0 stays 0, even if the scale is below the smallest float."""
    # In logs, because 0 / 0 is NaN; the log of a numerator of 0 is -inf.
    with np.errstate(divide="ignore", over="ignore"):
        return np.sign(numerator) * np.exp(np.log(np.abs(numerator)) - log_scale)


# --- Which is stronger ---------------------------------------------------------------------------


def second_answers(z: FloatArray) -> LogAnswers:
    """Log of Phi(z), 'second', and of Phi(-z), 'first'."""
    return LogAnswers(log_ndtr(z), log_ndtr(-z))


# --- Same or different ---------------------------------------------------------------------------


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


def equal_answers(z: FloatArray, k: FloatArray) -> LogAnswers:
    """Log of Phi(k - z) - Phi(-k - z), 'equal', and of its complement, 'different'.

    Parameters
    ----------
    z, k : array_like
        Distance and criterion, k >= 0; they broadcast. Both may be infinite.
    """
    distance, k = np.broadcast_arrays(np.abs(z), k)
    # Infinite arguments give logs of 0, which are -inf, and inf - inf, which `near_edge` replaces.
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        near_end = near_edge(distance, k)
        log_inside = _log_inside(distance, k, near_end)
        log_outside = np.logaddexp(log_ndtr(-near_end), log_ndtr(-distance - k))
        return with_complement(log_inside, log_outside)


def near_edge(distance: FloatArray, k: FloatArray) -> FloatArray:
    """How far the near edge of the window is beyond the distance, k - d; 0 if both are infinite."""
    edge = np.asarray(k - distance)
    edge[np.isnan(edge)] = 0.0
    return edge


def _log_inside(distance: FloatArray, k: FloatArray, near_end: FloatArray) -> FloatArray:
    """Log of Phi(k - d) - Phi(-k - d) for d, k >= 0; `near_end` is k - d."""
    log_upper = log_ndtr(near_end)
    log_lower = log_ndtr(-k - distance)
    # Where Phi(k - d) is 0 even as a logarithm, so is the difference.
    log_ratio = np.where(np.isfinite(log_upper), log_lower - log_upper, -np.inf)
    result = np.asarray(log_upper + np.log1p(-np.exp(log_ratio)))

    # In a narrow window, in which the density changes by a factor of less than e, the two terms
    # would cancel. There the density is integrated.
    is_narrow = (k < 0.5) & (k * distance < 0.5)
    if is_narrow.any():
        d = distance[is_narrow]
        result[is_narrow] = _log_window(d, k[is_narrow]) + log_normal_density(d)
    return result


def _log_window(distance: FloatArray, k: FloatArray) -> FloatArray:
    """Log of the integral of exp(-t^2/2 - d t) over -k < t < k, shape (n,).

    By symmetry it is twice that of exp(-t^2/2) cosh(d t) over 0 < t < k, whose terms are positive.
    """
    t = k[:, None] * _NODES
    heights = np.exp(-0.5 * np.square(t)) * np.cosh(distance[:, None] * t)
    # Not by a matrix product: it may round a row otherwise where the matrix has other rows.
    return np.log(2.0 * k * (heights * _WEIGHTS).sum(axis=1))


# --- Rows of counts ------------------------------------------------------------------------------


#: The names of the arrays that :func:`pair_arrays` gives.
_PAIR_ARRAYS = ("first", "difference", "middle", "n_yes", "n_no")


def pair_arrays(
    subjects: Sequence[Subject], origins: Sequence[float], units: Sequence[float]
) -> NamedArrays:
    """Stimuli and counts of several subjects by name, shape (rows, 1, pairs) each.

    The stimuli of each subject count from its origin, in its unit. Subjects with fewer pairs than
    other subjects get further pairs that nobody answered: their counts are 0.
    """
    n_pairs = max(subject.n_pairs for subject in subjects)
    arrays = np.zeros((len(_PAIR_ARRAYS), len(subjects), 1, n_pairs))  # with an axis of one point
    for i, (subject, origin, unit) in enumerate(zip(subjects, origins, units, strict=True)):
        first = (subject.s1 - origin) / unit
        second = (subject.s2 - origin) / unit
        difference = (subject.s2 - subject.s1) / unit  # without the rounding of `first`
        n_no = subject.n_trials - subject.n_yes
        columns = (first, difference, 0.5 * (first + second), subject.n_yes, n_no)
        arrays[:, i, 0, : subject.n_pairs] = columns
    return dict(zip(_PAIR_ARRAYS, arrays, strict=True))


@dataclass(frozen=True, eq=False)
class AnswerRows(ABC):
    """Counts of one or several subjects of a task.

    Points u have the shape (rows, points, k).

    Attributes
    ----------
    first, difference, middle : ndarray, shape (rows, 1, pairs)
        s1, s2 - s1 and (s1 + s2)/2, from the origin of the model and in its unit.
    n_yes, n_no : ndarray, shape (rows, 1, pairs)
        How often each answer was given. With three answers, (rows, 1, 2 pairs): 'equal' and
        'unequal' to each pair, then 'second' and 'first' to each pair.
    """

    first: FloatArray
    difference: FloatArray
    middle: FloatArray
    n_yes: FloatArray
    n_no: FloatArray
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
        names = (*_PAIR_ARRAYS, *self.row_numbers)
        return replace(self, **{name: getattr(self, name)[index] for name in names})

    @abstractmethod
    def log_answers(self, u: FloatArray) -> LogAnswers:
        """Log probability of both answers to every pair, (rows, points, pairs) each."""

    @property
    def answer_counts(self) -> tuple[FloatArray, ...]:
        """How often each answer was given to every pair, (rows, 1, pairs) each."""
        return self.n_yes, self.n_no

    @abstractmethod
    def answer_slopes(self, u: FloatArray) -> AnswerSlopes:
        """Log probability of each answer, and its slopes, with the shapes of `AnswerSlopes`."""

    def log_likelihood(self, u: FloatArray) -> FloatArray:
        """Log likelihood without binomial coefficients, (rows, points, k) -> (rows, points)."""
        return self.terms(self.log_answers(u)).sum(axis=-1)

    def terms(self, answers: LogAnswers) -> FloatArray:
        """What each question of each pair adds to the log likelihood, (rows, points, pairs)."""
        return times_counts(self.n_yes, answers.yes) + times_counts(self.n_no, answers.no)

    def plain_log_likelihood(self, u: FloatArray) -> FloatArray:
        """:meth:`log_likelihood` by a cheaper form, if the model has it."""
        return self.log_likelihood(u)

    def scoring(self, u: FloatArray) -> tuple[FloatArray, ...]:
        """Log likelihood, gradient and Fisher information, (rows, points[, k[, k]]).

        The information is the sum over answers of n P slope slope', with the trials n of the pair.
        """
        log_answers, slopes = self.answer_slopes(u)
        n_trials = np.asarray(sum(self.answer_counts))
        value, gradient, information = np.zeros((3, 1))  # sums over the answers, which broadcast
        # Where an answer is impossible its slopes are infinite or NaN. It counts only if given.
        with np.errstate(over="ignore", invalid="ignore"):
            for counts, log_p, slope in zip(self.answer_counts, log_answers, slopes, strict=True):
                # The root of n P, so that a product of scaled slopes has n P. Counts get an axis
                # for the coordinates, as slopes have: (rows, points, k, pairs).
                root_expected = np.sqrt(n_trials * np.exp(log_p))
                scaled_slope = times_counts(root_expected[..., None, :], slope)
                value = value + times_counts(counts, log_p).sum(axis=-1)
                gradient = gradient + times_counts(counts[..., None, :], slope).sum(axis=-1)
                information = information + scaled_slope @ np.swapaxes(scaled_slope, -1, -2)
        return value, gradient, information
