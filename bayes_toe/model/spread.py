"""From the probabilities of both answers to counts: how far repeated answers to one pair scatter.

Binomial where every answer is given alone. Where blocks or days differ, the probability of a pair is itself drawn for the session, from a
beta distribution with the model's P(equal) as its mean and intra-class correlation rho: the counts are then beta-binomial. With
eps = rho/(1 - rho), whose log is the logit of rho, and without binomial coefficient

    A = sum_{j < n_Eq} log(P + j eps) + sum_{j < n_Diff} log(1 - P + j eps) - sum_{j < n} log(1 + j eps).

Each answer is drawn given those before it, as from Polya's urn: the logs of these probabilities are all negative, so nothing is lost as
rho -> 0, the binomial, or rho -> 1, one answer for all trials of a pair.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.data.study import Subject
from bayes_toe.model.distributions import Random
from bayes_toe.model.links import Answers, Logarithm, Rise
from bayes_toe.model.target import answer_counts, log_likelihoods, times_counts
from bayes_toe.model.urn import Rising, log_drawn, rising

OfAnswers = tuple[Logarithm, Logarithm]


class Spread(Protocol):
    """How counts scatter about the probabilities of a model; own coordinates have shape (points, 1), answers (points, pairs)."""

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Its own unconstrained coordinates."""
        ...

    def log_likelihood(self, subject: Subject, answers: Answers, *own: FloatArray) -> FloatArray:
        """Log likelihood of each pair without binomial coefficients, shape (points, pairs)."""
        ...

    def slopes(self, subject: Subject, z: FloatArray, answers: Callable[[], Answers], of: OfAnswers, *own: FloatArray) -> Logarithm:
        """Derivatives of the log likelihood from those of both answers; its own coordinates come after the link's.

        `answers` is called where their log probabilities matter.
        """
        ...

    def rise(self, subject: Subject, answers: Answers, of: tuple[Rise, Rise], *own: FloatArray) -> Rise:
        """The first of these derivatives alone."""
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

    def slopes(self, subject: Subject, z: FloatArray, answers: Callable[[], Answers], of: OfAnswers, *own: FloatArray) -> Logarithm:
        """Counts times slopes."""
        return _total(answer_counts(subject), of)

    def rise(self, subject: Subject, answers: Answers, of: tuple[Rise, Rise], *own: FloatArray) -> Rise:
        """Counts times slopes."""
        return _total_rise(answer_counts(subject), of)

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

    def slopes(self, subject: Subject, z: FloatArray, answers: Callable[[], Answers], of: OfAnswers, *own: FloatArray) -> Logarithm:
        """With t = P/(P + j eps), A has sum t in the place of the counts, sum t (1 - t) in P twice, and its own row."""
        sums = [rising(u, own[0], n) for u, n in zip(answers(), _counts(subject), strict=True)]
        trials, total = _of_trials(subject, own[0]), _total([one.first for one in sums], of)

        def more(term: Callable[[Logarithm], FloatArray]) -> FloatArray:
            """What sum t (1 - t) adds, times a product of slopes."""
            one, other = (times_counts(part.bend, term(slopes)) for part, slopes in zip(sums, of, strict=True))
            return one + other

        def slope(i: int) -> FloatArray:
            return more(lambda part: part.own[i])

        def bend(i: int, j: int) -> FloatArray:
            return total.own_own[i][j] + more(lambda part: part.own[i] * part.own[j])

        def mixed(i: int) -> FloatArray:
            return total.z_own[i] + more(lambda part: part.z * part.own[i])

        rest, at = sums[0].rest + sums[1].rest - trials.rest, range(len(total.own))
        last = (*(-slope(i) for i in at), sums[0].bend + sums[1].bend - trials.bend)
        return Logarithm(
            total.z,
            total.zz + more(lambda part: np.square(part.z)),
            total.stretch + more(lambda part: z * np.square(part.z)),
            (*total.own, rest),
            (*map(mixed, at), -more(lambda part: part.z)),
            (*(tuple(bend(i, j) for j in range(i + 1)) for i in at), last),
        )

    def rise(self, subject: Subject, answers: Answers, of: tuple[Rise, Rise], *own: FloatArray) -> Rise:
        """Sum t in the place of the counts, and its own row."""
        sums = [rising(u, own[0], n) for u, n in zip(answers, _counts(subject), strict=True)]
        total = _total_rise([one.first for one in sums], of)
        return Rise(total.z, (*total.own, sums[0].rest + sums[1].rest - _of_trials(subject, own[0]).rest))

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


def _of_trials(subject: Subject, v: FloatArray) -> Rising:
    return rising(np.zeros((len(v), subject.n_pairs)), v, subject.n_trials)


def _counts(subject: Subject) -> tuple[IntArray, IntArray]:
    return subject.n_equal, subject.n_trials - subject.n_equal


def _total_rise(weights: Sequence[FloatArray], of: tuple[Rise, Rise]) -> Rise:
    """Weights, (pairs,) or (points, pairs), times the first slopes of both answers."""
    (one, other), (w, v) = of, weights
    own = (times_counts(w, a) + times_counts(v, b) for a, b in zip(one.own, other.own, strict=True))
    return Rise(times_counts(w, one.z) + times_counts(v, other.z), tuple(own))


def _total(weights: Sequence[FloatArray], of: OfAnswers) -> Logarithm:
    """Weights, (pairs,) or (points, pairs), times the slopes of both answers."""

    def added(*parts: FloatArray) -> FloatArray:
        one, other = (times_counts(weight, part) for weight, part in zip(weights, parts, strict=True))
        return one + other

    def each(rows: tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]) -> tuple[FloatArray, ...]:
        return tuple(added(*pair) for pair in zip(*rows, strict=True))

    one, other = of
    triangle = tuple(each(rows) for rows in zip(one.own_own, other.own_own, strict=True))
    return Logarithm(
        added(one.z, other.z),
        added(one.zz, other.zz),
        added(one.stretch, other.stretch),
        each((one.own, other.own)),
        each((one.z_own, other.z_own)),
        triangle,
    )


BINOMIAL, BETA_BINOMIAL = Binomial(), BetaBinomial()
