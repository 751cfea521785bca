"""The maxima of a log density in unconstrained coordinates, all starts in one batch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayes_toe.arrays import FloatArray, IndexArray
from bayes_toe.inference.newton import Differenced, ascend
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
    x = target.starts() if starts is None else starts
    density = Differenced(target.log_density, lambda x: target.gradient(x)[1], *x.shape)
    found = ascend(density, x.T)
    kept = np.flatnonzero(found.arrived if found.arrived.any() else np.ones_like(found.arrived))
    kept = kept[_distinct(found.x.T[kept], found.value[kept])]
    x, value = found.x.T[kept], found.value[kept]
    hopeless = value <= value[0] - 30.0
    chosen = kept[~hopeless]
    return Maxima(x[~hopeless], value[~hopeless], density.curvature(found.x[:, chosen], chosen), bool(found.arrived.any()), x[hopeless])


def _distinct(x: FloatArray, value: FloatArray) -> IndexArray:
    """Indices of maxima that differ visibly, best first."""
    chosen: list[int] = []
    for i in np.argsort(-value):
        if all(np.abs(x[i] - x[j]).max() > 1e-3 for j in chosen):
            chosen.append(int(i))
    return np.array(chosen)
