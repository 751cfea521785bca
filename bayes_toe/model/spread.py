"""From the probabilities of both answers to counts: how far repeated answers to one pair scatter.

Binomial where every answer is given alone. Where blocks or days differ, the probability of a pair is itself drawn for the session, from a
beta distribution with the model's P(equal) as its mean and intra-class correlation rho: the counts are then beta-binomial. With
eps = rho/(1 - rho), whose log is the logit of rho, and without binomial coefficient

    A = sum_{j < n_Eq} log(P + j eps) + sum_{j < n_Diff} log(1 - P + j eps) - sum_{j < n} log(1 + j eps).

Each answer is drawn given those before it, as from Polya's urn: the logs of these probabilities are all negative, so nothing is lost as
rho -> 0, the binomial, or rho -> 1, one answer for all trials of a pair.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import expit, log_expit

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.data.study import Subject
from bayes_toe.model.distributions import Random
from bayes_toe.model.links import Answers, Slopes
from bayes_toe.model.target import answer_counts, log_likelihoods, times_counts

_LEAST = -20.0  # log of factors below which the larger of their two parts is set apart
_TOGETHER = 16  # factors whose product is a float, with the former and up to a million answers


def log_drawn(
    answers: tuple[FloatArray, FloatArray], v: FloatArray, n: IntArray, before: IntArray
) -> FloatArray:
    """Log probability of n answers of the first kind after some of the other, shape (points, pairs), as log P and log Q, the answers.

    v is log eps, (points, 1); counts have the shape (pairs,), or (points, pairs) for a crowd.

    Examples
    --------
    >>> once = np.zeros(1, int) + 2
    >>> half = np.full((1, 1), np.log(0.5))
    >>> round(float(np.exp(log_drawn((half, half), np.zeros((1, 1)), once, 0 * once))[0, 0]), 12)  # 1/2, then (1/2 + 1)/(1 + 1)
    0.375
    """
    pairs = _ByCount(n)
    (u, other), v, b = map(pairs.take, answers), pairs.take(v), pairs.take(before)
    rho, rest = expit(v), expit(-v)
    own, step, scale = _parts(u, v, least=_LEAST)
    unlike = np.exp(other) * rest + b * rho
    product, taken, total = np.ones(u.shape), np.zeros(u.shape), np.zeros(u.shape)
    for j, at in pairs.going():
        below = rest[at] + (b[at] + j) * rho[at]
        product[at] *= (own[at] + j * step[at]) / below
        taken[at] += (1.0 - taken[at]) * (unlike[at] / below)
        if j % _TOGETHER == 0:
            total[at] += np.log(product[at])
            product[at] = 1.0
    total += np.log(product) + scale * np.maximum(pairs.counts - 1, 0)
    following = np.where(taken < 0.5, np.log1p(-np.minimum(taken, 0.5)), total)
    with np.errstate(divide="ignore"):  # log 0: nothing before it
        first = u - np.logaddexp(0.0, np.log(b) + v)
    return pairs.put(np.where(pairs.counts > 0, first, 0.0) + following)


class Rising(NamedTuple):
    """Of the sum over j < n of log(P + j eps): the derivatives in log P and in log eps."""

    first: FloatArray
    rest: FloatArray


def rising(u: FloatArray, v: FloatArray, n: IntArray) -> Rising:
    """At u = log P, shape (points, pairs), v = log eps, shape (points, 1), and n, as in :func:`log_drawn`.

    They are sums of t_j = P/(P + j eps), which is 1 for the first answer, and of 1 - t_j.
    """
    pairs = _ByCount(n)
    own, step, _ = _parts(pairs.take(u), pairs.take(v))
    first = np.broadcast_to((pairs.counts > 0).astype(np.float64), own.shape).copy()
    rest = np.zeros(own.shape)
    for j, at in pairs.going():
        added = j * step[at]
        whole = own[at] + added
        first[at] += own[at] / whole
        rest[at] += added / whole
    return Rising(*map(pairs.put, (first, rest)))


def _parts(
    u: FloatArray, v: FloatArray, least: float = np.inf
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """P (1 - rho) and rho over the larger of both where its log is below `least`, and that log, or 0."""
    log_own, log_step = u + log_expit(-v), log_expit(v)
    larger = np.maximum(log_own, log_step)
    scale = np.where(larger < least, larger, 0.0)
    return np.exp(log_own - scale), np.exp(log_step - scale), scale


class _ByCount:
    """Pairs, or the pairs of all points of a crowd, in the order of falling counts: those that go on are always the first ones.

    Arrays have them on the first axis, and points on the second, along which they lie in memory.
    """

    def __init__(self, n: IntArray) -> None:
        flat = n.ravel()
        self._shape, self._order = n.shape, np.argsort(-flat, kind="stable")
        self.counts = flat[self._order, None]

    def take(self, part: npt.NDArray[np.float64] | IntArray) -> FloatArray:
        """What has the shape of counts, of (points, pairs) or of (points, 1), in that order."""
        if len(self._shape) > 1:
            return np.broadcast_to(part, self._shape).ravel()[self._order, None].astype(np.float64)
        if part.ndim == 1:
            return part[self._order, None].astype(np.float64)
        return np.ascontiguousarray(
            part.T if part.shape[1] == 1 < len(self._order) else part.T[self._order], np.float64
        )

    def put(self, values: FloatArray) -> FloatArray:
        """The inverse, shape (points, pairs)."""
        back = np.empty_like(values)
        back[self._order] = values
        return back.reshape(self._shape) if len(self._shape) > 1 else back.T

    def going(self) -> Iterator[tuple[int, slice]]:
        """The numbers j of answers, from 1 on, and those who give one more."""
        j = np.arange(1, int(self.counts.max(initial=1)))
        yield from zip(
            j.tolist(), map(slice, np.searchsorted(-self.counts[:, 0], -j).tolist()), strict=True
        )


OfAnswers = tuple[Slopes, Slopes]


@dataclass(frozen=True)
class Spread:
    """How counts scatter about the probabilities of a model; this one: binomial, answers are independent.

    Own coordinates have shape (points, 1), answers and what is made of them (points, pairs).
    """

    coordinates: ClassVar[tuple[str, ...]] = ()

    def log_likelihood(self, subject: Subject, answers: Answers, *own: FloatArray) -> FloatArray:
        """Log likelihood of each pair without binomial coefficients: counts times log probabilities."""
        return log_likelihoods(subject, answers)

    def slopes(self, subject: Subject, answers: Answers, of: OfAnswers, *own: FloatArray) -> Slopes:
        """Slopes of the log likelihood from those of both answers; its own coordinates come after the link's. Here counts times slopes."""
        return _total(answer_counts(subject), of)

    def given_the_rest(self, subject: Subject, answers: Answers, *own: FloatArray) -> Answers:
        """Log probabilities of one answer given all others to its pair; here the same."""
        return answers

    def realised(self, rng: Random, answers: Answers, *own: FloatArray) -> Answers:
        """Log probabilities of a session, given which its answers are independent; here the same."""
        return answers


@dataclass(frozen=True)
class BetaBinomial(Spread):
    """Answers to a pair that go together, with intra-class correlation rho."""

    coordinates: ClassVar[tuple[str, ...]] = ("logit_icc",)

    def log_likelihood(self, subject: Subject, answers: Answers, *own: FloatArray) -> FloatArray:
        """All 'equal', then all 'different', each given those before it; their order does not matter."""
        k, rest = _counts(subject)
        return log_drawn(answers, own[0], k, np.zeros_like(k)) + log_drawn(
            answers[::-1], own[0], rest, k
        )

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
            share = np.where(
                total > 0.0, gammas[0] / total, rng.uniform(size=total.shape) < np.exp(answers[0])
            )
            return np.log(share), np.log1p(-share)


def _counts(subject: Subject) -> tuple[IntArray, IntArray]:
    return subject.n_yes, subject.n_trials - subject.n_yes


def _total(weights: Sequence[FloatArray], of: OfAnswers) -> Slopes:
    """Weights, (pairs,) or (points, pairs), times the slopes of both answers."""
    (one, other), (w, v) = of, weights
    own = (times_counts(w, a) + times_counts(v, b) for a, b in zip(one.own, other.own, strict=True))
    return Slopes(times_counts(w, one.z) + times_counts(v, other.z), tuple(own))


BINOMIAL, BETA_BINOMIAL = Spread(), BetaBinomial()
