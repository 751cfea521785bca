"""From the probabilities of both answers to counts: how far repeated answers to one pair scatter.

Binomial where every answer is given alone. Where blocks or days differ, the probability of a pair is itself drawn for the session, from a
beta distribution with the model's P(equal) as its mean and intra-class correlation rho: the counts are then beta-binomial. With
eps = rho/(1 - rho), whose log is the logit of rho, and without binomial coefficient

    A = sum_{j < n_Eq} log(P + j eps) + sum_{j < n_Diff} log(1 - P + j eps) - sum_{j < n} log(1 + j eps).

Each answer is drawn given those before it, as from Polya's urn: the logs of these probabilities are all negative, so nothing is lost as
rho -> 0, the binomial, or rho -> 1, one answer for all trials of a pair.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.data.study import Subject
from bayes_toe.model.distributions import Random
from bayes_toe.model.links import Answers, Slopes
from bayes_toe.model.target import answer_counts, log_likelihoods, times_counts
from bayes_toe.model.urn import log_drawn, rising

OfAnswers = tuple[Slopes, Slopes]


class Spread(Protocol):
    """How counts scatter about the probabilities of a model; own coordinates have shape (points, 1), answers (points, pairs)."""

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Its own unconstrained coordinates."""
        ...

    def log_likelihood(self, subject: Subject, answers: Answers, *own: FloatArray) -> FloatArray:
        """Log likelihood of each pair without binomial coefficients, shape (points, pairs)."""
        ...

    def slopes(self, subject: Subject, answers: Answers, of: OfAnswers, *own: FloatArray) -> Slopes:
        """Slopes of the log likelihood from those of both answers; its own coordinates come after the link's."""
        ...

    def given_the_rest(self, subject: Subject, answers: Answers, *own: FloatArray) -> Answers:
        """Log probabilities of one answer given all others to its pair, shape (points, pairs) each."""
        ...

    def realised(self, rng: Random, answers: Answers, *own: FloatArray) -> Answers:
        """Log probabilities of a session, shape (points, pairs) each: given them its answers are independent."""
        ...


@dataclass(frozen=True)
class Binomial:
    """Independent answers."""

    coordinates: ClassVar[tuple[str, ...]] = ()

    def log_likelihood(self, subject: Subject, answers: Answers, *own: FloatArray) -> FloatArray:
        """Counts times log probabilities."""
        return log_likelihoods(subject, answers)

    def slopes(self, subject: Subject, answers: Answers, of: OfAnswers, *own: FloatArray) -> Slopes:
        """Counts times slopes."""
        return _total(answer_counts(subject), of)

    def given_the_rest(self, subject: Subject, answers: Answers, *own: FloatArray) -> Answers:
        """The same."""
        return answers

    def realised(self, rng: Random, answers: Answers, *own: FloatArray) -> Answers:
        """The same."""
        return answers


@dataclass(frozen=True)
class BetaBinomial:
    """Answers to a pair that go together, with intra-class correlation rho."""

    coordinates: ClassVar[tuple[str, ...]] = ("logit_icc",)

    def log_likelihood(self, subject: Subject, answers: Answers, *own: FloatArray) -> FloatArray:
        """All 'equal', then all 'different', each given those before it; their order does not matter."""
        k, rest = _counts(subject)
        return log_drawn(answers, own[0], k, np.zeros_like(k)) + log_drawn(answers[::-1], own[0], rest, k)

    def slopes(self, subject: Subject, answers: Answers, of: OfAnswers, *own: FloatArray) -> Slopes:
        """With t = P/(P + j eps), sum t in the place of the counts, and in log eps the sums of 1 - t less that of the trials."""
        sums = [rising(u, own[0], n) for u, n in zip(answers, _counts(subject), strict=True)]
        total = _total([one.first for one in sums], of)
        of_trials = rising(np.zeros((len(own[0]), subject.n_pairs)), own[0], subject.n_trials).rest
        return Slopes(total.z, (*total.own, sums[0].rest + sums[1].rest - of_trials))

    def given_the_rest(self, subject: Subject, answers: Answers, *own: FloatArray) -> Answers:
        """(P + (n_Eq - 1) eps)/(1 + (n - 1) eps), and its like; of no meaning for answers that were never given."""
        log_others = np.log(np.maximum(subject.n_trials - 1, 1)) + own[0]
        whole = np.where(subject.n_trials > 1, np.logaddexp(0.0, log_others), 0.0)
        one, other = (
            np.where(n > 1, np.logaddexp(u, np.log(np.maximum(n - 1, 1)) + own[0]), u) - whole
            for u, n in zip(answers, _counts(subject), strict=True)
        )
        return np.asarray(one), np.asarray(other)

    def realised(self, rng: Random, answers: Answers, *own: FloatArray) -> Answers:
        """Beta(P/eps, (1 - P)/eps) as a ratio of gammas; where both are below the smallest float it is 0 or 1."""
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            gammas = [rng.standard_gamma(np.exp(u - own[0])) for u in answers]
            total = gammas[0] + gammas[1]
            share = np.where(total > 0.0, gammas[0] / total, rng.uniform(size=total.shape) < np.exp(answers[0]))
            return np.log(share), np.log1p(-share)


def _counts(subject: Subject) -> tuple[IntArray, IntArray]:
    return subject.n_equal, subject.n_trials - subject.n_equal


def _total(weights: Sequence[FloatArray], of: OfAnswers) -> Slopes:
    """Weights, (pairs,) or (points, pairs), times the slopes of both answers."""
    (one, other), (w, v) = of, weights
    own = (times_counts(w, a) + times_counts(v, b) for a, b in zip(one.own, other.own, strict=True))
    return Slopes(times_counts(w, one.z) + times_counts(v, other.z), tuple(own))


BINOMIAL, BETA_BINOMIAL = Binomial(), BetaBinomial()
