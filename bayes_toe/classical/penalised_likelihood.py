"""Penalised log likelihood of many count vectors over one design, with derivatives up to and on the edges of the model.

log likelihood (no binomial coefficients) - (mu1 - mean)^2 / (2 V_1), in y = (c, log(p/p_max), log w, log q0). There gamma = 1 and q0 = 1
are the bounds y_1 = 0 and y_3 = 0, where everything stays finite: an edge is reached, not approached. Source: Eq. mod:logp_grouped.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np

from bayes_toe.arrays import FloatArray, IndexArray
from bayes_toe.model.closed_form import LN2, MAX_PULL
from bayes_toe.model.distributions import Normal

#: Values of one temporary array: small enough for the processor's cache, so memory stays flat however many pairs or points. Of very many
#: pairs so many are taken at once: a block of few points would be gone through in steps of a few values.
_BLOCK, _PAIRS = 1 << 16, 1 << 8
_TWO_LN2 = 2.0 * LN2


@dataclass(frozen=True, eq=False)
class PenalisedLikelihood:
    """What a fit maximises, for one or many count vectors; points and rows are on the last axis of every array.

    Parameters
    ----------
    s1, s2 : array, shape (pairs,)
        Stimuli, natural-log intensity.
    sbar : float
        Mean first stimulus, from which the offset c = p (mu1 - sbar) counts; natural-log intensity.
    equal, different : array, shape (pairs, rows)
        Answers of each row.
    row : array of int, shape (starts,)
        The row to which each start belongs.
    normal : Normal
        Of mu1, as the penalty; the paper's has mean 0 and V_1 = 10^2.
    """

    s1: FloatArray
    s2: FloatArray
    sbar: float
    equal: FloatArray
    different: FloatArray
    row: IndexArray
    normal: Normal

    def value(self, x: FloatArray, index: IndexArray) -> FloatArray:
        """Value at x, (4, points) -> (points,), for the rows of the starts `index`.

        At log(p/p_max) = -inf, the edge gamma = 0, the offset is 0 and mu1 rests at the penalty's mean.
        """
        value, row = np.empty(x.shape[1]), self.row[index]
        # Where q = 1 and 'different' was answered the value is -inf, which is the truth.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for part in self._parts(x.shape[1]):
                value[part] = sum(self._log_likelihood(x[:, part], row[part], pairs) for pairs in self._pairs)
        return value - self.penalty(x)

    def derivatives(self, x: FloatArray, index: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Gradient (4, points) and Hessian (4, 4, points) there, where the value is finite."""
        row, gradient, hessian = self.row[index], np.empty(x.shape), np.empty((4, *x.shape))
        for part in self._parts(x.shape[1]):
            self._block(x[:, part], row[part], gradient[:, part], hessian[:, :, part])
        self._to_log_pull(x, gradient, hessian)
        self._penalise(x, gradient, hessian)
        return gradient, hessian

    def _parts(self, points: int) -> list[slice]:
        size = max(1, _BLOCK // min(_PAIRS, len(self.s1)))
        return [slice(i, i + size) for i in range(0, points, size)]

    @property
    def _pairs(self) -> list[slice]:
        return [slice(i, i + _PAIRS) for i in range(0, len(self.s1), _PAIRS)]

    def penalty(self, x: FloatArray) -> FloatArray:
        """(mu1 - mean)^2 / (2 V_1), shape (4, points) -> (points,)."""
        return np.asarray(0.5 * np.square(self._far(x)[1] / self.normal.sd))

    def _log_likelihood(self, x: FloatArray, row: IndexArray, pairs: slice) -> FloatArray:
        """What some pairs add to it, (points,)."""
        equal, different = self._counts(row, pairs)
        t, _, rest = self._answers(self._distances(x, np.exp(-x[2]), pairs), x[3], different)
        return np.asarray(
            np.einsum("pn,pn->n", equal, np.subtract(x[3], t, out=t)) + np.einsum("pn,pn->n", different, np.log(rest, out=rest))
        )

    def _block(self, x: FloatArray, row: IndexArray, gradient: FloatArray, hessian: FloatArray) -> None:
        """Derivatives of the log likelihood in (c, p, log w, log q0) go into `gradient` and `hessian`.

        With L = log q = log q0 - ln2 z^2 and the odds r = q/(1 - q), an answer 'equal' has slope 1 and curvature 0 in L, an answer
        'different' -r and -r (1 + r). What is left are sums over pairs of powers of z and of the lever s1 - sbar.
        """
        inverse = np.exp(-x[2])
        parts = (self._sums(x, inverse, row, pairs) for pairs in self._pairs)
        e, h, ez, ezz, hz, hzz, hz3, hz4 = reduce(lambda all_, some: [a + b for a, b in zip(all_, some, strict=True)], parts)
        k, bend = _TWO_LN2 * inverse, _TWO_LN2 * np.square(inverse)
        gradient[0], gradient[1], gradient[2], gradient[3] = k * ez[0], -k * ez[1], _TWO_LN2 * ezz, e[0]
        cc, cp, pp = (bend * sign * (e[i] + _TWO_LN2 * hzz[i]) for i, sign in enumerate((-1.0, 1.0, -1.0)))
        cb, pb = (k * sign * (2.0 * ez[i] + _TWO_LN2 * hz3[i]) for i, sign in enumerate((-1.0, 1.0)))
        bb, bu = -_TWO_LN2 * (2.0 * ezz + _TWO_LN2 * hz4), -_TWO_LN2 * hzz[0]
        cu, pu = -k * hz[0], k * hz[1]
        for i, row_of in enumerate(((cc,), (cp, pp), (cb, pb, bb), (cu, pu, bu, -h))):
            for j, values in enumerate(row_of):
                hessian[i, j] = hessian[j, i] = values

    def _sums(self, x: FloatArray, inverse: FloatArray, row: IndexArray, pairs: slice) -> list[FloatArray]:
        """What some pairs add to the sums of slopes and curvatures in log q times powers of z and of the lever."""
        lever, z = self.s1[pairs] - self.sbar, self._distances(x, inverse, pairs)
        powers = np.stack([np.ones_like(lever), lever, np.square(lever)])
        slope, different = self._counts(row, pairs)
        _, curve, rest = self._answers(z, x[3], different)
        curve += 1.0
        curve *= np.exp(x[3])
        curve *= different
        curve /= rest  # now the odds
        slope -= curve
        curve /= rest
        e, h = powers @ slope, curve.sum(axis=0)
        slope *= z
        ez, ezz = powers[:2] @ slope, np.einsum("pn,pn->n", slope, z)
        curve *= z
        hz = powers[:2] @ curve
        curve *= z
        hzz = powers @ curve
        curve *= z
        return [e, h, ez, ezz, hz, hzz, powers[:2] @ curve, np.einsum("pn,pn->n", curve, z)]

    def _counts(self, row: IndexArray, pairs: slice) -> tuple[FloatArray, FloatArray]:
        return self.equal[pairs].take(row, axis=1), self.different[pairs].take(row, axis=1)

    def _distances(self, x: FloatArray, inverse: FloatArray, pairs: slice) -> FloatArray:
        """Normalised distances z, (pairs, points); in place, here and below: few arrays stay in the processor's cache."""
        z: FloatArray = (self.s1[pairs] - self.sbar)[:, None] * (MAX_PULL * np.exp(x[1]))
        z += (self.s2 - self.s1)[pairs, None]
        z -= x[0]
        z *= inverse
        return z

    @staticmethod
    def _answers(z: FloatArray, log_q0: FloatArray, different: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """With t = ln2 z^2: t, exp(-t) - 1 and 1 - q, (pairs, points) each."""
        t = np.square(z)
        t *= LN2
        shape = np.expm1(np.negative(t))
        rest = np.exp(log_q0) * shape
        np.subtract(-np.expm1(log_q0), rest, out=rest)  # positive terms only
        rest[different == 0.0] = 1.0  # an answer never given contributes nothing, also where it is impossible
        return t, shape, rest

    @staticmethod
    def _to_log_pull(x: FloatArray, gradient: FloatArray, hessian: FloatArray) -> None:
        """From p to log p, in place."""
        p = MAX_PULL * np.exp(x[1])
        gradient[1] *= p
        hessian[1] *= p
        hessian[:, 1] *= p
        hessian[1, 1] += gradient[1]

    def _far(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """1/p, mu1 - mean and mu1 - sbar = c/p; at p = 0 the first and the last are given as 0 and mu1 rests at the mean."""
        some = np.isfinite(x[1])
        with np.errstate(over="ignore"):
            inverse = np.where(some, np.exp(-x[1]) / MAX_PULL, 0.0)
        reach = x[0] * inverse
        return inverse, np.where(some, self.sbar - self.normal.mean + reach, 0.0), reach

    def _penalise(self, x: FloatArray, gradient: FloatArray, hessian: FloatArray) -> None:
        """The penalty's derivatives as a gain, in place; mu1 = sbar + c/p and d(1/p)/d(log p) = -1/p."""
        inverse, far, reach = self._far(x)
        weight = 1.0 / self.normal.sd**2
        gradient[0] -= weight * far * inverse
        gradient[1] += weight * far * reach
        hessian[0, 0] -= weight * np.square(inverse)
        cross = weight * inverse * (reach + far)
        hessian[0, 1] += cross
        hessian[1, 0] += cross
        hessian[1, 1] -= weight * reach * (reach + far)
