"""Hessians by differences of gradients.

`one_sided_hessian` is fast, for searches. `hessian` is accurate, for results.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bayes_toe.arrays import ArrayPair, FloatArray

Gradient = Callable[[FloatArray], FloatArray]
#: Points, (points, k), to the value, (points,), and the gradient, (points, k).
ValueAndGradient = Callable[[FloatArray], ArrayPair]
#: Steps in units of 1/sqrt abs H_ii: one-sided ones during a search, central ones for results.
_SHORT, _LONG = 1e-6, 1e-4
#: Smallest size of a curvature, and smallest step over the size of the coordinate.
_FLAT, _FINEST = 1e-6, 1e-12


def one_sided_hessian(
    value_and_gradient: ValueAndGradient, x: FloatArray, diagonal: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Value (points,), gradient (points, k) and Hessian (points, k, k) from one call.

    `diagonal`, shape (points, k), has the sizes of the Hessian's diagonal nearby. They set the
    steps.
    """
    n_points, k = x.shape
    ahead = x + _steps(x, diagonal, _SHORT)
    value, gradient = value_and_gradient(np.concatenate([x[None], ahead]).reshape(-1, k))
    gradient = gradient.reshape(k + 1, n_points, k)
    return value[:n_points], gradient[0], _symmetric(gradient[1:] - gradient[0], ahead - x)


def hessian(gradient: Gradient, x: FloatArray, diagonal: FloatArray | None = None) -> FloatArray:
    """Hessian, (points, k, k), by central differences of a gradient, (points, k) -> (points, k).

    By default `diagonal`, as in :func:`one_sided_hessian`, comes from differences over 1e-4.
    """
    k = x.shape[1]
    if diagonal is None:
        diagonal = np.abs(np.diagonal(hessian(gradient, x, np.ones(x.shape)), axis1=1, axis2=2))
    step = _steps(x, diagonal, _LONG)
    forward, backward = x + step, x - step
    slopes = gradient(np.concatenate([forward, backward]).reshape(-1, k)).reshape(2, k, *x.shape)
    return _symmetric(slopes[0] - slopes[1], forward - backward)


def _steps(x: FloatArray, diagonal: FloatArray, unit: float) -> FloatArray:
    """Steps in one coordinate after the other, (k, points, k), larger than rounding errors."""
    sizes = unit / np.sqrt(np.maximum(diagonal, _FLAT))
    return np.eye(x.shape[1])[:, None] * np.maximum(sizes, _FINEST * np.abs(x))


def _symmetric(change: FloatArray, step: FloatArray) -> FloatArray:
    """Hessians from changes of gradients, (k, points, k), over steps of the same shape."""
    k = len(change)
    rows = change / step[np.arange(k), :, np.arange(k)][:, :, None]
    return 0.5 * (rows.transpose(1, 0, 2) + rows.transpose(1, 2, 0))
