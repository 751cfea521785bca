"""Polya's urn: answers to one pair, each of which makes its like more probable.

After b answers of the other kind and j of its own an answer of probability P at first has, with 1 - P = Q and eps = rho/(1 - rho),

    (P + j eps)/(1 + (b + j) eps) = (P (1 - rho) + j rho)/(1 - rho + (b + j) rho) = 1 - (Q (1 - rho) + b rho)/(1 - rho + (b + j) rho).

A logarithm for each answer would be most of the work. So factors are multiplied, and what they take away from 1 is counted beside: both
are sums and products of positive numbers, and the one that is far from 1 gives the logarithm to all digits.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import expit, log_expit

from bayes_toe.arrays import FloatArray, IntArray

_LEAST = -20.0  # log of factors below which the larger of their two parts is set apart
_TOGETHER = 16  # factors whose product is a float, with the former and up to a million answers


def log_drawn(answers: tuple[FloatArray, FloatArray], v: FloatArray, n: IntArray, before: IntArray) -> FloatArray:
    """Log probability of n answers of the first kind after some of the other, shape (points, pairs).

    Parameters
    ----------
    answers : tuple of array, shape (points, pairs)
        log P and log Q.
    v : array, shape (points, 1)
        log eps.
    n, before : array of int, shape (pairs,), or (points, pairs) for a crowd

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


def _parts(u: FloatArray, v: FloatArray, least: float = np.inf) -> tuple[FloatArray, FloatArray, FloatArray]:
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
        return np.ascontiguousarray(part.T if part.shape[1] == 1 < len(self._order) else part.T[self._order], np.float64)

    def put(self, values: FloatArray) -> FloatArray:
        """The inverse, shape (points, pairs)."""
        back = np.empty_like(values)
        back[self._order] = values
        return back.reshape(self._shape) if len(self._shape) > 1 else back.T

    def going(self) -> Iterator[tuple[int, slice]]:
        """The numbers j of answers, from 1 on, and those who give one more."""
        j = np.arange(1, int(self.counts.max(initial=1)))
        yield from zip(j.tolist(), map(slice, np.searchsorted(-self.counts[:, 0], -j).tolist()), strict=True)
