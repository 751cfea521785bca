"""The maxima of a log density in unconstrained coordinates, all starts in one batch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayes_toe.arrays import FloatArray, IndexArray
from bayes_toe.inference.newton import ascend
from bayes_toe.model.target import Target


@dataclass(frozen=True, eq=False)
class Maxima:
    """Distinct local maxima, best first.

    Attributes
    ----------
    x : array, shape (modes, k)
        Unconstrained coordinates.
    value : array, shape (modes,)
        Log posterior density there.
    curvature : array, shape (modes, k, k)
        Negative Hessian; positive definite at a proper maximum.
    arrived : bool
        False where no start met the convergence criterion; the points are then the best found.
    hopeless : array, shape (others, k)
        Further ones, 30 nats and more below the best.
    """

    x: FloatArray
    value: FloatArray
    curvature: FloatArray
    arrived: bool
    hopeless: FloatArray

    @property
    def all(self) -> FloatArray:
        """Every one of them, shape (maxima, k)."""
        return np.concatenate([self.x, self.hopeless])


def find_maxima(target: Target, starts: FloatArray | None = None) -> Maxima:
    """Maxima of the log density from several starts, shape (starts, k), of finite density; by default those that the data suggest.

    Examples
    --------
    >>> from bayes_toe.model.ladder import posterior_of
    >>> from bayes_toe.data.study import Subject
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> find_maxima(posterior_of(subject)).arrived
    True
    """
    found = ascend(_LogDensity(target), (target.starts() if starts is None else starts).T)
    kept = found.arrived if found.arrived.any() else np.ones_like(found.arrived)
    x, value = found.x.T[kept], found.value[kept]
    distinct = _distinct(x, value)
    hopeless = value[distinct] <= value.max() - 30.0
    chosen = distinct[~hopeless]
    curvature = -np.moveaxis(found.hessian[:, :, kept], -1, 0)[chosen]
    return Maxima(x[chosen], value[chosen], curvature, bool(found.arrived.any()), x[distinct[hopeless]])


@dataclass(frozen=True, eq=False)
class _LogDensity:
    """The log density as the ascent wants it, points on the last axis."""

    target: Target

    def value(self, x: FloatArray, _: IndexArray) -> FloatArray:
        """Its value, (k, points) -> (points,)."""
        return self.target.log_density(x.T)

    def derivatives(self, x: FloatArray, _: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Gradient and Hessian; no step leads to where the density is 0."""
        gradient, hessian = self.target.derivatives(x.T)
        return gradient.T, np.moveaxis(hessian, 0, -1)


def _distinct(x: FloatArray, value: FloatArray) -> IndexArray:
    """Indices of maxima that differ visibly, best first."""
    chosen: list[int] = []
    for i in np.argsort(-value):
        if all(np.abs(x[i] - x[j]).max() > 1e-3 for j in chosen):
            chosen.append(int(i))
    return np.array(chosen)
