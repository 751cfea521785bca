"""Safeguarded Newton ascent of many points at once, inside bounds; the objective may differ from point to point.

Arrays have their points on the last axis, so that every operation runs along memory.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import BoolArray, FloatArray, IndexArray

_DECREMENT = 1e-12  # twice the predicted gain, in nats, at which a point counts as arrived
_TINY = 1e-300


class Objective(Protocol):
    """What is to be maximised."""

    def evaluate(self, x: FloatArray, index: IndexArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Value (points,), gradient (k, points) and Hessian (k, k, points) at x (k, points); `index` says which start each came from."""
        ...


class Ascent(NamedTuple):
    """Where every start ended: point, value, gradient, Hessian, and whether it met the convergence criterion."""

    x: FloatArray
    value: FloatArray
    gradient: FloatArray
    hessian: FloatArray
    arrived: BoolArray

    def take(self, index: IndexArray) -> Ascent:
        """A copy of some of them."""
        return Ascent(self.x[:, index], self.value[index], self.gradient[:, index], self.hessian[:, :, index], self.arrived[index])


def ascend(
    objective: Objective,
    x: FloatArray,
    *,
    upper: npt.ArrayLike = np.inf,
    fixed: npt.ArrayLike = False,
    most: float = 5.0,
    iterations: int = 200,
) -> Ascent:
    """Levenberg-damped Newton ascent of every start; a step is kept only if it does not lower the value.

    Parameters
    ----------
    objective : Objective
    x : array, shape (k, points)
        Starts, inside the bounds; the value there is finite.
    upper : array_like, broadcast to (k, points)
        Upper bounds. A coordinate that is on its bound and would rise stays there until its slope turns.
    fixed : array_like of bool, broadcast to (k, points)
        Coordinates that stay where they start.
    most : float
        Longest step in any coordinate.
    iterations : int
        Steps to try at most.

    Examples
    --------
    >>> class Hill:
    ...     def evaluate(self, x, index):
    ...         return -((x[0] - 2.0) ** 2), -2.0 * (x - 2.0), np.full((1, *x.shape), -2.0)
    >>> found = ascend(Hill(), np.zeros((1, 1)))
    >>> round(float(found.x[0, 0]), 9), round(float(ascend(Hill(), np.zeros((1, 1)), upper=1.0).x[0, 0]), 9)
    (2.0, 1.0)
    """
    x, n = x.copy(), x.shape[1]
    top, held = np.broadcast_to(upper, x.shape), np.broadcast_to(fixed, x.shape)
    value, gradient, hessian = objective.evaluate(x, np.arange(n))
    damping, arrived = np.full(n, 1e-3), np.zeros(n, bool)
    for _ in range(iterations):
        at = np.flatnonzero(~arrived & (damping < 1e12))
        if not len(at):
            break
        here, slope, bound = x[:, at], gradient[:, at], top[:, at]
        free = ~(held[:, at] | ((here >= bound) & (slope >= 0.0)))
        with np.errstate(over="ignore"):  # where slopes are close to the largest float; the step has a longest length
            step, decrement = _step(slope, hessian[:, :, at], free, damping[at])
        trial = np.minimum(here + step * np.minimum(1.0, most / np.maximum(np.abs(step).max(axis=0), _TINY)), bound)
        new = objective.evaluate(trial, at)
        better = new[0] >= value[at]
        kept = at[better]
        x[:, kept], value[kept], gradient[:, kept], hessian[:, :, kept] = (part[..., better] for part in (trial, *new))
        # A predicted gain below the rounding of the value cannot be seen: arrived, whether or not the step was taken.
        arrived[at] = (decrement < _DECREMENT * (1.0 + np.abs(value[at]) * 1e-3)) & (damping[at] <= 1e-2)
        damping[at] = np.where(better, np.maximum(damping[at] / 16.0, 1e-12), np.maximum(damping[at] * 8.0, 1e-3))
    return Ascent(x, value, gradient, hessian, arrived)


def _step(gradient: FloatArray, hessian: FloatArray, free: BoolArray, damping: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ascent step in the free coordinates and twice its predicted gain.

    -H is scaled to a unit diagonal, which the damping raises. Where the result is positive definite the step follows by elimination;
    elsewhere eigenvalues enter by size, so that the step leads uphill, away from a saddle too.
    """
    k = len(gradient)
    size = np.abs(hessian[np.arange(k), np.arange(k)])
    scale = np.where(free & (size > 0.0), 1.0 / np.sqrt(np.maximum(size, _TINY)), free)
    matrix = -hessian * scale[:, None] * scale[None, :]
    right = np.where(free, gradient, 0.0) * scale
    for i in range(k):
        matrix[i, i] += ~free[i]
    step, proper = _solve(matrix, right, damping)
    if not proper.all():
        step[:, ~proper] = _uphill(matrix[:, :, ~proper], right[:, ~proper], damping[~proper])
    return step * scale, np.abs(step * right).sum(axis=0)


def _solve(matrix: FloatArray, right: FloatArray, damping: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Solve many small symmetric systems with a raised diagonal by elimination; False where a pivot is not positive."""
    a, y, k = matrix.copy(), right.copy(), len(right)
    proper = np.ones(y.shape[1], bool)
    for j in range(k):
        a[j, j] += damping
    for j in range(k):
        proper &= a[j, j] > 1e-12
        a[j, j][~proper] = 1.0
        for i in range(j + 1, k):
            factor = a[i, j] / a[j, j]
            for m in range(i, k):
                a[m, i] -= factor * a[m, j]
            y[i] -= factor * y[j]
    for j in reversed(range(k)):
        for i in range(j + 1, k):
            y[j] -= a[i, j] * y[i]
        y[j] /= a[j, j]
    return y, proper


def _uphill(matrix: FloatArray, right: FloatArray, damping: FloatArray) -> FloatArray:
    """The damped step with every eigenvalue by its size."""
    values, vectors = np.linalg.eigh(np.moveaxis(matrix, -1, 0))
    along = np.einsum("nij,in->nj", vectors, right) / (np.abs(values) + damping[:, None])
    return np.asarray(np.einsum("nij,nj->in", vectors, along))
