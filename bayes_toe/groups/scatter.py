"""How subjects scatter about the mean of their group: scores u, subject less mean over tau, normal or Student's t; correlated or not.

Student's tails let single subjects be far away. Scores of a subject are independent, or u = L v with independent v, L the Cholesky factor
of their correlations R:

    L_ij = t_ij prod_(l < j) (1 - t_il^2)^(1/2),    t_ij = tanh z_ij for j < i, t_ii = 1,

where t_ij is the partial correlation of i and j given those before j, and z_ij has no bounds. Under R ~ LKJ(eta), density det(R)^(eta - 1),
the z_ij are independent with densities sech(z)^(2 b) / B(b, 1/2), b = eta + (k - 2 - j)/2, j from 0. Without coordinates R is 1.

Source: Lewandowski, Kurowicka and Joe 2009, Journal of Multivariate Analysis 100, 1989-2001.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.special import betaln, ndtri, stdtrit

from bayes_toe.arrays import FloatArray
from bayes_toe.errors import InputError
from bayes_toe.model.distributions import LOG_2PI, Random


@dataclass(frozen=True)
class Scatter:
    """A density of independent scores, symmetric about 0: standard normal, or Student's t with 4 degrees of freedom.

    Of a normal one tau is the standard deviation, of Student's the scale, 1/2^(1/2) of it.
    """

    name: str

    @property
    def _normal(self) -> bool:
        return self.name == "normal"

    def log_density(self, u: FloatArray) -> FloatArray:
        """-u^2/2 - ln(2 pi)/2, or ln(3/8) - (5/2) ln(1 + u^2/4)."""
        return np.asarray(-0.5 * (np.square(u) + LOG_2PI) if self._normal else np.log(0.375) - 2.5 * np.log1p(0.25 * np.square(u)))

    def slope(self, u: FloatArray) -> FloatArray:
        """Its derivative: -u, or -5 u/(4 + u^2)."""
        return np.asarray(-u if self._normal else -5.0 * u / (4.0 + np.square(u)))

    def sample(self, rng: Random, shape: tuple[int, ...]) -> FloatArray:
        """Independent scores."""
        return rng.standard_normal(shape) if self._normal else rng.standard_t(4, shape)

    def quantile(self, p: FloatArray) -> FloatArray:
        """Scores below which these probabilities lie."""
        return np.asarray(ndtri(p) if self._normal else stdtrit(4.0, p))

    def precisions(self, rng: Random, u: FloatArray) -> FloatArray:
        """Draws of the precision with which each score, given its value, counts as a normal one.

        Student's t is normal with a precision of Gamma(2, rate 2), which given the score is Gamma(5/2, rate 2 + u^2/2).
        """
        return np.ones(u.shape) if self._normal else np.asarray(rng.standard_gamma(2.5, u.shape) / (2.0 + 0.5 * np.square(u)))


SCATTERS = ("normal", "t")


def scatter_named(name: str) -> Scatter:
    """The scatter of this name.

    Raises
    ------
    InputError
        If there is none.

    Examples
    --------
    >>> scatter_named("t").log_density(np.zeros(1)).round(4).tolist()
    [-0.9808]
    """
    if name not in SCATTERS:
        raise InputError(f"population {name!r}: allowed: {', '.join(SCATTERS)}")
    return Scatter(name)


def pairs(k: int) -> tuple[tuple[int, int], ...]:
    """The pairs (j, i), j < i, of k parameters: the order of the coordinates.

    Examples
    --------
    >>> pairs(3)
    ((0, 1), (0, 2), (1, 2))
    """
    return tuple(combinations(range(k), 2))


class Root(NamedTuple):
    """L, (points, k, k), log of its diagonal, (points, k), and of what it is made: t and the product, both (points, k, k)."""

    factor: FloatArray
    log_diagonal: FloatArray
    partial: FloatArray
    left: FloatArray

    @classmethod
    def at(cls, z: FloatArray, k: int) -> Root:
        """At coordinates, (points, k (k - 1)/2), or (points, 0).

        Examples
        --------
        >>> factor = Root.at(np.array([[np.arctanh(0.6)]]), 2).factor[0]
        >>> (factor @ factor.T).round(12).tolist()
        [[1.0, 0.6], [0.6, 1.0]]
        """
        square = np.zeros((len(z), k, k))
        for place, (j, i) in enumerate(pairs(k)[: z.shape[1]]):
            square[:, i, j] = z[:, place]
        log_rest = np.log(2.0) - np.logaddexp(square, -square)  # ln sech
        log_left = np.cumsum(log_rest, axis=2) - log_rest
        partial, left = np.tanh(square) + np.eye(k), np.exp(log_left)
        return cls(np.tril(partial * left), np.diagonal(log_left, axis1=1, axis2=2), partial, left)

    def plain(self, u: FloatArray) -> FloatArray:
        """Independent scores v of scores u = L v, (points, N, k)."""
        v, diagonal = np.empty(u.shape), np.exp(self.log_diagonal)
        for i in range(u.shape[2]):
            v[..., i] = (u[..., i] - (v[..., :i] @ self.factor[:, i, :i, None])[..., 0]) / diagonal[:, i, None]
        return v

    def back(self, slopes: FloatArray) -> FloatArray:
        """What slopes in v are in u, (points, N, k)."""
        found, diagonal = np.empty(slopes.shape), np.exp(self.log_diagonal)
        for i in reversed(range(slopes.shape[2])):
            later = (found[..., i + 1 :] @ self.factor[:, i + 1 :, i, None])[..., 0]
            found[..., i] = (slopes[..., i] - later) / diagonal[:, i, None]
        return found

    def slopes(self, of_factor: FloatArray) -> FloatArray:
        """What slopes in L, (points, k, k), are in the coordinates, (points, k (k - 1)/2)."""
        through = of_factor * self.factor
        later = np.cumsum(through[:, :, ::-1], axis=2)[:, :, ::-1] - through
        return _below(of_factor * (1.0 - np.square(self.partial)) * self.left - self.partial * later)

    @property
    def log_diagonal_slopes(self) -> FloatArray:
        """Those of the sum of the logs of the diagonal of L."""
        return _below(-self.partial)


def log_lkj(z: FloatArray, k: int, shape: float) -> tuple[FloatArray, FloatArray]:
    """Log density of the coordinates under LKJ(shape), (points,), and its slopes; 0 and none where there are no coordinates."""
    b = np.array([shape + 0.5 * (k - 2 - j) for j, _ in pairs(k)[: z.shape[1]]])
    log_cosh = np.logaddexp(z, -z) - np.log(2.0)
    return np.asarray((-2.0 * b * log_cosh - betaln(b, 0.5)).sum(axis=1)), np.asarray(-2.0 * b * np.tanh(z))


def _below(square: FloatArray) -> FloatArray:
    """The entries below the diagonal in the order of the coordinates."""
    k = square.shape[-1]
    return np.stack([square[:, i, j] for j, i in pairs(k)], axis=1) if k > 1 else np.empty((len(square), 0))
