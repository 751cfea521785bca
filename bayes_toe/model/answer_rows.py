"""Likelihoods of many rows of counts at once, from the curves of both answers.

:class:`bayes_toe.model.observer.ObserverRows` and :class:`bayes_toe.model.paper_rows.PaperRows` say
what the curves are.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Self

import numpy as np

from bayes_toe.arrays import ArrayPair, FloatArray, IndexArray
from bayes_toe.model.answer_curves import LogAnswers, times_counts
from bayes_toe.model.densities import PriorDensity


class AnswerRows(ABC):
    """Counts of one or several subjects of a task.

    Points u have the shape (rows, points, k). Pairs of subjects who have fewer than others are
    filled up with pairs that nobody answered.
    """

    difference: FloatArray  # s2 - s1, (rows, 1, pairs)
    n_yes: FloatArray
    n_no: FloatArray

    @property
    @abstractmethod
    def coordinates(self) -> tuple[str, ...]:
        """Names of the k coordinates."""

    @property
    @abstractmethod
    def priors(self) -> tuple[PriorDensity, ...]:
        """The prior of every coordinate."""

    @abstractmethod
    def part(self, index: IndexArray) -> Self:
        """Some rows, in this order; a row may come more than once."""

    @abstractmethod
    def distance(self, u: FloatArray) -> FloatArray:
        """The distance z of every pair in units of the noise or width, (rows, points, pairs)."""

    @abstractmethod
    def answers_at_distance(self, u: FloatArray, z: FloatArray) -> LogAnswers:
        """Log probability of both answers at distances z, (n,) -> (rows, points, n) each."""

    @abstractmethod
    def log_answers(self, u: FloatArray) -> LogAnswers:
        """Log probability of both answers to every pair, (rows, points, pairs) each."""

    @abstractmethod
    def answer_slopes(self, u: FloatArray) -> tuple[LogAnswers, FloatArray, FloatArray]:
        """Log answers, and the slopes of both in every coordinate, (rows, points, k, pairs)."""

    def log_likelihood(self, u: FloatArray) -> FloatArray:
        """Log likelihood without binomial coefficients, (rows, points, k) -> (rows, points)."""
        answers = self.log_answers(u)
        terms = times_counts(self.n_yes, answers.yes) + times_counts(self.n_no, answers.no)
        return terms.sum(axis=-1)

    def plain_log_likelihood(self, u: FloatArray) -> FloatArray:
        """:meth:`log_likelihood` by a cheaper form, where a model has one."""
        return self.log_likelihood(u)

    def gradient(self, u: FloatArray) -> ArrayPair:
        """Log likelihood (rows, points), and its gradient (rows, points, k)."""
        return self._summed(*self.answer_slopes(u))

    def plain_gradient(self, u: FloatArray) -> ArrayPair:
        """:meth:`gradient` by a cheaper form, where a model has one."""
        return self.gradient(u)

    def scoring(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Log likelihood, gradient and Fisher information, (rows, points[, k[, k]])."""
        answers, yes_slopes, no_slopes = self.answer_slopes(u)
        value, gradient = self._summed(answers, yes_slopes, no_slopes)
        n_trials = self.n_yes + self.n_no
        yes_weight = (n_trials * np.exp(answers.yes))[..., None, :]
        no_weight = (n_trials * np.exp(answers.no))[..., None, :]
        with np.errstate(over="ignore", invalid="ignore"):  # infinite slopes, as in _summed
            information = times_counts(yes_weight, yes_slopes) @ np.swapaxes(yes_slopes, -1, -2)
            information += times_counts(no_weight, no_slopes) @ np.swapaxes(no_slopes, -1, -2)
        return value, gradient, information

    def _summed(
        self, answers: LogAnswers, yes_slopes: FloatArray, no_slopes: FloatArray
    ) -> ArrayPair:
        """Log likelihood and its gradient, from what an answer to each pair adds."""
        terms = times_counts(self.n_yes, answers.yes) + times_counts(self.n_no, answers.no)
        in_yes = times_counts(self.n_yes[:, :, None], yes_slopes)
        in_no = times_counts(self.n_no[:, :, None], no_slopes)
        # Where an answer is impossible the density is 0, and slopes are infinite.
        with np.errstate(invalid="ignore"):
            return terms.sum(axis=-1), (in_yes + in_no).sum(axis=-1)
