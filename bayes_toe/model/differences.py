"""Gradient and Hessian by central differences, many points in one call: for densities whose derivatives nobody wants to write down."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bayes_toe.arrays import FloatArray

#: Between the error of the formula, h^2, and that of rounding, 1e-16 of the value over h^2.
STEP = 1e-4


def central_derivatives(function: Callable[[FloatArray], FloatArray], x: FloatArray, step: float = STEP) -> tuple[FloatArray, FloatArray]:
    """Gradient (points, k) and Hessian (points, k, k) of function, (points, k) -> (points,), at x.

    Both are 0 at points with a neighbour of infinite value: there are none to be had.

    Examples
    --------
    >>> gradient, hessian = central_derivatives(lambda x: x[:, 0] ** 2 * x[:, 1], np.array([[1.0, 3.0]]))
    >>> gradient.round(6).tolist(), hessian.round(5).tolist()
    ([[6.0, 1.0]], [[[6.0, 2.0], [2.0, 0.0]]])
    """
    k = x.shape[1]
    unit, corners = np.eye(k), [(i, j) for i in range(k) for j in range(i)]
    both = [unit[i] + unit[j] for i, j in corners] + [unit[i] - unit[j] for i, j in corners]
    moves = np.concatenate([np.zeros((1, k)), unit, -unit, *(np.stack([m, -m]) for m in both)])
    values = function((x[:, None] + step * moves).reshape(-1, k)).reshape(len(x), len(moves))
    known = np.asarray(np.isfinite(values).all(axis=1))
    values = np.where(known[:, None], values, 0.0)
    centre, plus, minus = values[:, :1], values[:, 1 : k + 1], values[:, k + 1 : 2 * k + 1]
    hessian = np.zeros((*x.shape, k))
    hessian[:, range(k), range(k)] = (plus - 2.0 * centre + minus) / step**2
    along = values[:, 2 * k + 1 :].reshape(len(x), 2, len(corners), 2).sum(axis=3)
    for n, (i, j) in enumerate(corners):
        hessian[:, i, j] = hessian[:, j, i] = (along[:, 0, n] - along[:, 1, n]) / (4.0 * step**2)
    return (plus - minus) / (2.0 * step), hessian
