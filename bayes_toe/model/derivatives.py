"""Hessians by differences of gradients."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bayes_toe.arrays import FloatArray

Gradient = Callable[[FloatArray], FloatArray]
#: Steps in units of 1/sqrt abs H_ii: one-sided ones during a search, central ones where they are
#: kept.
_SHORT, _LONG = 1e-6, 1e-4
#: A curvature that is taken to be no smaller, and the smallest step over the coordinate.
_FLAT, _FINEST = 1e-6, 1e-12


def one_sided(gradient: Gradient, x: FloatArray, bend: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gradient (points, k) and Hessian (points, k, k) from one call.

    What a search needs of a gradient's differences.

    `bend`, shape (points, k), has the sizes of the Hessian's diagonal about there, which set the
    steps.
    """
    points, k = x.shape
    ahead = x[None] + _steps(x, bend, _SHORT)
    found = gradient(np.concatenate([x[None], ahead]).reshape(-1, k)).reshape(k + 1, points, k)
    return found[0], _symmetric(found[1:] - found[0], ahead - x)


def hessian(gradient: Gradient, x: FloatArray, bend: FloatArray | None = None) -> FloatArray:
    """Hessian, shape (points, k, k), by central differences of a gradient, (points, k) -> (points, k).

    `bend`, as in :func:`one_sided`, is found by differences over 1e-4 first where it is not given.
    """
    k = x.shape[1]
    if bend is None:
        bend = np.abs(np.diagonal(hessian(gradient, x, np.ones(x.shape)), axis1=1, axis2=2))
    step = _steps(x, bend, _LONG)
    ahead, behind = x + step, x - step
    found = gradient(np.concatenate([ahead, behind]).reshape(-1, k)).reshape(2, k, *x.shape)
    return _symmetric(found[0] - found[1], ahead - behind)


def _steps(x: FloatArray, bend: FloatArray, unit: float) -> FloatArray:
    """Steps in one coordinate after the other, (k, points, k), none so small that it is rounding."""
    return np.eye(x.shape[1])[:, None] * np.maximum(
        unit / np.sqrt(np.maximum(bend, _FLAT)), _FINEST * np.abs(x)
    )


def _symmetric(change: FloatArray, step: FloatArray) -> FloatArray:
    """Hessians from what gradients change by, (k, points, k), over steps in one coordinate after the other, of the same shape."""
    k = len(change)
    rows = change / step[np.arange(k), :, np.arange(k)][:, :, None]
    return np.asarray(0.5 * (rows.transpose(1, 0, 2) + rows.transpose(1, 2, 0)))
