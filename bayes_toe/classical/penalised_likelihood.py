"""Penalised log likelihood of many count vectors over one design, its derivatives up to and on the edges of the model, its high points.

log likelihood (no binomial coefficients) - (mu1 - mean)^2 / (2 V_1), in y = (c, log(p/p_max), log w, log q0). There gamma = 1 and q0 = 1
are the bounds y_1 = 0 and y_3 = 0, where everything stays finite: an edge is reached, not approached. Source: Eq. mod:logp_grouped.

Ascents start at the highest points of the parts of a grid. Several maxima differ in the pull: a vanishing one with the prior mean far to
either side, a middle one, the largest. At each pull the rest is nearly determined, so that the highest grid point of a range of pulls lies
close to the ridge. At points of a grid log q and log(1 - q) of the pairs are the same for all rows: their likelihoods there are one matrix
product.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate, repeat
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import log_expit, logit

from bayes_toe.arrays import BLOCK, FloatArray, IndexArray
from bayes_toe.data.conditions import mean_first
from bayes_toe.data.study import Subject, refuse_intervals
from bayes_toe.model.closed_form import LN2, MAX_PULL
from bayes_toe.model.distributions import Normal
from bayes_toe.model.prior import Prior

#: Values of one temporary array: small enough for the processor's cache, so memory stays flat however many points.
_BLOCK = 1 << 16
_TWO_LN2 = 2.0 * LN2
#: Parts of the grid: pulls as shares of the largest, 0 for the edge gamma = 0, and sides of the offset.
_PARTS = (
    ((0.0,), (0.0,)),
    ((0.003, 0.01, 0.03), (-1.0,)),
    ((0.003, 0.01, 0.03), (1.0,)),
    ((0.1, 0.2, 0.4), (-1.0, 1.0)),
    ((1.0,), (-1.0, 1.0)),
)
#: Of a subject's own fit: offsets and widths (log) on the scale of the design, narrow, middle and wide ones apart, and logits of q0.
_OFFSETS = (0.05, 0.15, 0.4, 1.0, 2.0)
_WIDTHS = ((-2.0, -1.5, -1.0, -0.5), (0.0, 0.5, 1.0), (1.5, 2.0, 2.5, 3.0))
_PEAKS = logit(np.array([0.05, 0.2, 0.5, 0.8, 0.95, 0.99]))
#: Of its replicates: the same from those of the fit.
_OFFSETS_AROUND = (0.02, 0.1, 0.25, 0.5, 1.0)
_WIDTHS_AROUND = (-0.8, -0.4, 0.0, 0.4, 0.8)
_PEAKS_AROUND = (-2.0, -1.0, 0.0, 1.0, 2.0)


class Counts(NamedTuple):
    """Answers of many rows in one design, each of shape (rows, pairs)."""

    equal: FloatArray
    different: FloatArray

    @classmethod
    def of(cls, n_yes: npt.ArrayLike, n_trials: npt.ArrayLike) -> Counts:
        """From counts of 'equal', (rows, pairs), and of trials, (pairs,)."""
        equal = np.atleast_2d(np.asarray(n_yes, np.float64))
        return cls(equal, np.asarray(n_trials, np.float64) - equal)


@dataclass(frozen=True, eq=False)
class Design:
    """The pairs that every row of a batch shares, and the penalty."""

    s1: FloatArray
    s2: FloatArray
    sbar: float
    penalty: Normal

    @classmethod
    def of(cls, subject: Subject, prior: Prior) -> Design:
        """Pairs of a subject; of the prior only the normal of mu1 is used."""
        refuse_intervals([subject], "maximum-likelihood fit")
        sbar = mean_first(subject)
        return cls(subject.s1, subject.s2, sbar, prior.at(subject).penalty)

    @property
    def scale(self) -> float:
        """Root mean square step between the stimuli of a pair, natural-log intensity."""
        steps = np.abs(self.s2 - self.s1)
        moved = steps[steps > 0] if np.any(steps > 0) else np.abs(self.s1 - self.sbar)
        return float(np.sqrt(np.mean(np.square(moved)))) if np.any(moved > 0) else 0.3


@dataclass(frozen=True, eq=False)
class PenalisedLikelihood:
    """What a fit maximises, for one or many count vectors; points and rows are on the last axis of every array.

    Parameters
    ----------
    design : Design
        Its normal of mu1 is the penalty; the paper's has mean 0 and V_1 = 10^2.
    equal, different : array, shape (pairs, rows)
        Answers of each row.
    row : array of int, shape (starts,)
        The row to which each start belongs.
    """

    design: Design
    equal: FloatArray
    different: FloatArray
    row: IndexArray

    def value(self, x: FloatArray, index: IndexArray) -> FloatArray:
        """Value at x, (4, points) -> (points,), for the rows of the starts `index`.

        At log(p/p_max) = -inf, the edge gamma = 0, the offset is 0 and mu1 rests at the penalty's mean.
        """
        value, row = np.empty(x.shape[1]), self.row[index]
        # Where q = 1 and 'different' was answered the value is -inf, which is the truth.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for part in self._parts(x.shape[1]):
                log_q0, equal, different = x[3, part], *(counts.take(row[part], axis=1) for counts in (self.equal, self.different))
                t, rest = self._answers(self._distances(x[:, part]), log_q0, different)
                value[part] = (equal * (log_q0 - t) + different * np.log(rest)).sum(axis=0)
        return value - self.penalty(x)

    def derivatives(self, x: FloatArray, index: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Gradient (4, points) and Hessian (4, 4, points) there, where the value is finite."""
        row, gradient, hessian = self.row[index], np.empty(x.shape), np.empty((4, *x.shape))
        for part in self._parts(x.shape[1]):
            gradient[:, part], hessian[:, :, part] = self._of_answers(x[:, part], row[part])
        p = MAX_PULL * np.exp(x[1])  # from p to log p
        gradient[1] *= p
        hessian[1] *= p
        hessian[:, 1] *= p
        hessian[1, 1] += gradient[1]
        # The penalty: mu1 = sbar + c/p and d(1/p)/d(log p) = -1/p.
        (inverse, far, reach), weight = self._far(x), 1.0 / self.design.penalty.sd**2
        gradient[0] -= weight * far * inverse
        gradient[1] += weight * far * reach
        cross = weight * inverse * (reach + far)
        hessian[:2, :2] += np.array([[-weight * np.square(inverse), cross], [cross, -weight * reach * (reach + far)]])
        return gradient, hessian

    def penalty(self, x: FloatArray) -> FloatArray:
        """(mu1 - mean)^2 / (2 V_1), shape (4, points) -> (points,)."""
        return np.asarray(0.5 * np.square(self._far(x)[1] / self.design.penalty.sd))

    def _parts(self, points: int) -> list[slice]:
        size = max(1, _BLOCK // len(self.design.s1))
        return [slice(i, i + size) for i in range(0, points, size)]

    def _of_answers(self, x: FloatArray, row: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the log likelihood in (c, p, log w, log q0).

        With L = log q = log q0 - ln2 z^2 and the odds r = q/(1 - q), an answer 'equal' has slope 1 and curvature 0 in L, an answer
        'different' -r and -r (1 + r). What is left are sums over pairs of powers of z and of the lever s1 - sbar.
        """
        lever, z, k = self.design.s1 - self.design.sbar, self._distances(x), _TWO_LN2 * np.exp(-x[2])
        equal, different = (counts.take(row, axis=1) for counts in (self.equal, self.different))
        t, rest = self._answers(z, x[3], different)
        odds = different * np.exp(x[3] - t) / rest
        slope, curve, powers = equal - odds, odds / rest, np.stack([np.ones_like(lever), lever, np.square(lever)])
        e, ez, ezz = powers @ slope, powers[:2] @ (slope * z), (slope * z * z).sum(axis=0)
        h, hz, hzz, hz3, hz4 = (powers @ part for part in accumulate(repeat(z, 4), np.multiply, initial=curve))
        bend = k * np.exp(-x[2])
        cc, cp, pp = (bend * sign * (e[i] + _TWO_LN2 * hzz[i]) for i, sign in enumerate((-1.0, 1.0, -1.0)))
        cb, pb = (k * sign * (2.0 * ez[i] + _TWO_LN2 * hz3[i]) for i, sign in enumerate((-1.0, 1.0)))
        bb, bu = -_TWO_LN2 * (2.0 * ezz + _TWO_LN2 * hz4[0]), -_TWO_LN2 * hzz[0]
        cu, pu = -k * hz[0], k * hz[1]
        gradient = np.stack([k * ez[0], -k * ez[1], _TWO_LN2 * ezz, e[0]])
        return gradient, np.array([[cc, cp, cb, cu], [cp, pp, pb, pu], [cb, pb, bb, bu], [cu, pu, bu, -h[0]]])

    def _distances(self, x: FloatArray) -> FloatArray:
        """Normalised distances z, (pairs, points)."""
        s1, s2 = self.design.s1[:, None], self.design.s2[:, None]
        return np.asarray(((s2 - s1) + MAX_PULL * np.exp(x[1]) * (s1 - self.design.sbar) - x[0]) * np.exp(-x[2]))

    @staticmethod
    def _answers(z: FloatArray, log_q0: FloatArray, different: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The exponent t = ln2 z^2 and 1 - q, (pairs, points) each; 1 where nobody answered 'different', which contributes nothing then."""
        t = LN2 * np.square(z)
        rest = -np.expm1(log_q0) - np.exp(log_q0) * np.expm1(-t)  # positive terms only
        return t, np.where(different == 0.0, 1.0, rest)

    def _far(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """1/p, mu1 - mean and mu1 - sbar = c/p; at p = 0 the first and the last are given as 0 and mu1 rests at the mean."""
        some = np.isfinite(x[1])
        with np.errstate(over="ignore"):
            inverse = np.where(some, np.exp(-x[1]) / MAX_PULL, 0.0)
        reach = x[0] * inverse
        return inverse, np.where(some, self.design.sbar - self.design.penalty.mean + reach, 0.0), reach


# --- Where to start -------------------------------------------------------------------------------


def first_starts(design: Design, counts: Counts) -> FloatArray:
    """Starts (offset, log(p/p_max), log w, log q0) of rows of which nothing is known, shape (4, rows, 15).

    Of 66,000 rows (replicates of 43 subjects, bundled, hard and real) 7 stayed below the best that these or others led to.
    """
    scale = design.scale
    grids = [
        _points(part, scale * np.array(_OFFSETS), np.log(scale) + widths, _PEAKS) for part in _PARTS for widths in map(np.array, _WIDTHS)
    ]
    return np.stack([_highest(design, counts, points) for points in grids], axis=-1)


def replicate_starts(design: Design, identified: FloatArray, counts: Counts) -> FloatArray:
    """The same for replicates of a subject, (4, rows, 6): its own offset, pull, width and q0, and the highest points around them.

    Of the same 66,000 replicates 18 stayed below the best, all of subjects whose answers leave the pull nearly open.
    """
    offset, pull, width, q0 = identified
    scale = (2.0 if width > design.scale else 0.3) * design.scale
    w = width if 0.05 * design.scale < width < np.inf else scale
    peaks = logit(np.clip(q0, 0.02, 0.98)) + np.array(_PEAKS_AROUND)
    grids = [_points(part, w * np.array(_OFFSETS_AROUND), np.log(w) + np.array(_WIDTHS_AROUND), peaks) for part in _PARTS]
    own = np.empty((4, len(counts.equal)))
    own[:3] = [[offset], [min(0.0, np.log(max(pull / MAX_PULL, 1e-4)))], [np.log(w)]]
    own[3] = np.log(((counts.equal + 1.0) / (counts.equal + counts.different + 2.0)).max(axis=1))
    return np.stack([own, *(_highest(design, counts, points) for points in grids)], axis=-1)


def _points(
    part: tuple[tuple[float, ...], tuple[float, ...]], offsets: FloatArray, log_widths: FloatArray, peaks: FloatArray
) -> FloatArray:
    """Points of a part of a grid, (4, points)."""
    shares, sides = part
    with np.errstate(divide="ignore"):
        axes = np.meshgrid(np.unique(np.outer(sides, offsets)), np.log(shares), log_widths, log_expit(peaks))
    return np.stack([axis.ravel() for axis in axes])


def _highest(design: Design, counts: Counts, points: FloatArray) -> FloatArray:
    """The point that is highest for each row, (4, rows)."""
    c, log_share, log_width, log_q0 = points[..., None]
    p = MAX_PULL * np.exp(log_share)
    t = LN2 * np.square(((design.s2 - design.s1) + p * (design.s1 - design.sbar) - c) * np.exp(-log_width))
    table = np.concatenate([log_q0 - t, np.log(-np.expm1(log_q0) - np.exp(log_q0) * np.expm1(-t))], axis=1).T
    mu1 = design.sbar + np.divide(c, p, out=np.full_like(c, design.penalty.mean - design.sbar), where=p > 0.0)
    penalty = 0.5 * np.square((mu1[:, 0] - design.penalty.mean) / design.penalty.sd)
    answers, size = np.concatenate(counts, axis=1), max(1, 4 * BLOCK // points.shape[1])
    best = [(answers[i : i + size] @ table - penalty).argmax(axis=1) for i in range(0, len(answers), size)]
    return points[:, np.concatenate(best)]
