"""The maxima of a log density in unconstrained coordinates: safeguarded Newton ascent of many points at once, inside bounds.

The objective may differ from point to point. Arrays have their points on the last axis, so that
every operation runs along memory.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import BoolArray, FloatArray, IndexArray
from bayes_toe.model.derivatives import Gradient, hessian, one_sided
from bayes_toe.model.posterior import SampledPosterior

_DECREMENT = 1e-12  # twice the predicted gain, in nats, at which a point counts as arrived
_NEAR = 1e-2  # decrement below which a start counts as close to a maximum
_CLOSE = 1e-2  # distance, in every coordinate, of the same one
_TINY = 1e-300


OfStarts = Callable[[FloatArray, IndexArray], FloatArray]


class Differenced:
    """An objective of which value and gradient are known, with Hessians by differences whose steps follow from the last ones.

    Of points, (points, k), and the start that each came from, (points,), the value has shape
    (points,) and the gradient (points, k).
    """

    def __init__(self, value: OfStarts, gradient: OfStarts, starts: int, k: int) -> None:
        self._value, self._gradient, self._bend = value, gradient, np.ones((starts, k))

    def value(self, x: FloatArray, index: IndexArray) -> FloatArray:
        """Value at x, (k, points) -> (points,)."""
        return self._value(x.T, index)

    def derivatives(self, x: FloatArray, index: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Gradient (k, points) and Hessian (k, k, points)."""
        gradient, bends = one_sided(self._of(index), x.T, self._bend[index])
        bend = np.abs(np.diagonal(bends, axis1=1, axis2=2))
        self._bend[index] = np.where(np.isfinite(bend), bend, self._bend[index])
        return gradient.T, np.moveaxis(bends, 0, -1)

    def curvature(self, x: FloatArray, index: IndexArray) -> FloatArray:
        """Negative Hessian, (k, points) -> (points, k, k), by central differences, where the ascent ended."""
        return -hessian(self._of(index), x.T, self._bend[index])

    def _of(self, index: IndexArray) -> Gradient:
        """The gradient at points of these starts, in their order as often as it takes."""
        return lambda x: self._gradient(x, np.resize(index, len(x)))


class Ascent(NamedTuple):
    """Where every start ended: point, value, gradient, Hessian, and whether it met the convergence criterion."""

    x: FloatArray
    value: FloatArray
    gradient: FloatArray
    hessian: FloatArray
    arrived: BoolArray

    def take(self, index: IndexArray) -> Ascent:
        """A copy of some of them."""
        return Ascent(
            self.x[:, index],
            self.value[index],
            self.gradient[:, index],
            self.hessian[:, :, index],
            self.arrived[index],
        )

    def put(self, index: IndexArray, some: Ascent) -> None:
        """Set some of them."""
        for part, values in zip(self, some, strict=True):
            part[..., index] = values


def ascend(
    objective: Differenced,
    x: FloatArray,
    *,
    lower: npt.ArrayLike = -np.inf,
    fixed: npt.ArrayLike = False,
    most: float = 5.0,
    iterations: int = 200,
    rivals: IndexArray | None = None,
) -> Ascent:
    """Levenberg-damped Newton ascent of every start, (k, points), by steps of `most` at most.

    None is kept that lowers the value.

    Starts are inside the bounds, where the value is finite. A coordinate that is on its lower bound
    and would fall stays there until its slope turns; one that is fixed stays where it starts.
    `rivals`, (points,), are numbers from 0 of the problems to which the starts belong, where only
    the highest maximum of each is wanted: a start that comes to where a higher one already is goes
    no further, and does not count as arrived.
    """
    at = np.arange(x.shape[1])
    now = Ascent(
        x.copy(), objective.value(x, at), *objective.derivatives(x, at), np.zeros(len(at), bool)
    )
    ended, floor, held = (
        now,
        *(np.array(np.broadcast_to(bound, x.shape)) for bound in (lower, fixed)),
    )
    damping, leaders = np.full(len(at), 1e-3), None if rivals is None else _Leaders(rivals, x)
    for _ in range(iterations):
        if not len(at):
            break
        free = ~(held | ((now.x <= floor) & (now.gradient <= 0.0)))
        # Slopes close to the largest float, of which the step has a longest length; elimination of
        # what is not positive definite.
        with np.errstate(over="ignore", invalid="ignore"):
            step, decrement, proper = _steps(now.gradient, now.hessian, free, damping)
        step *= np.minimum(1.0, most / np.maximum(np.abs(step).max(axis=0), _TINY))
        trial = np.maximum(now.x + step, floor)
        value = objective.value(trial, at)
        better = value >= now.value
        now.x[:, better], now.value[better] = trial[:, better], value[better]
        now.gradient[:, better], now.hessian[:, :, better] = objective.derivatives(
            now.x[:, better], at[better]
        )
        # A predicted gain below the rounding of the value cannot be seen: arrived, whether or not
        # the step was taken.
        now.arrived[:] = (decrement < _DECREMENT * (1.0 + np.abs(now.value) * 1e-3)) & (
            damping <= 1e-2
        )
        damping = np.where(
            better, np.maximum(damping / 16.0, 1e-12), np.maximum(8.0 * damping, 1e-3)
        )
        going = (
            ~now.arrived & (damping < 1e12) & np.isfinite(now.hessian).all(axis=(0, 1))
        )  # not beyond where slopes are floats
        if leaders is not None:
            near = np.flatnonzero(better & proper & (decrement < _NEAR))
            going[near] &= ~leaders.followed(at[near], now.x[:, near], now.value[near])
        if not going.all():
            ended.put(at, now)
            at, damping, floor, held, now = (
                at[going],
                damping[going],
                floor[:, going],
                held[:, going],
                now.take(np.flatnonzero(going)),
            )
    ended.put(at, now)
    return ended


class _Leaders:
    """The highest start of every problem among those that are close to a maximum."""

    def __init__(self, rivals: IndexArray, x: FloatArray) -> None:
        problems = int(rivals.max(initial=-1)) + 1
        self.rivals, self.at = rivals, np.full(problems, -1)
        self.x, self.value = np.empty((len(x), problems)), np.full(problems, -np.inf)

    def followed(self, at: IndexArray, x: FloatArray, value: FloatArray) -> BoolArray:
        """Which of the starts `at`, close to a maximum, are where a higher one is.

        The others may lead from now on.
        """
        order = np.argsort(value, kind="stable")
        order = order[value[order] >= self.value[self.rivals[at[order]]]]
        first = self.rivals[
            at[order]
        ]  # of several starts of a problem the last is kept, the highest
        self.at[first], self.value[first], self.x[:, first] = at[order], value[order], x[:, order]
        of = self.rivals[at]
        with np.errstate(invalid="ignore"):  # coordinates that are fixed at infinity
            close = (np.abs(x - self.x[:, of]) < _CLOSE) | (x == self.x[:, of])
        return np.asarray((self.at[of] != at) & close.all(axis=0))


def _steps(
    gradient: FloatArray, hessian: FloatArray, free: BoolArray, damping: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Ascent steps (k, points) in the free coordinates, twice their predicted gains, and whether -H is positive definite.

    -H is scaled to a unit diagonal, which the damping, (points,), raises. Where the result is
    positive definite the step follows by elimination; elsewhere eigenvalues enter by size, so that
    the step leads uphill, away from a saddle too.
    """
    diagonal = np.arange(len(gradient)), np.arange(len(gradient))
    size = np.abs(hessian[diagonal])
    scale = np.where(free & (size > 0.0), 1.0 / np.sqrt(np.maximum(size, _TINY)), free)
    matrix = hessian * -scale[:, None] * scale
    right = np.where(free, gradient, 0.0) * scale
    matrix[diagonal] += ~free
    step, proper = _solve(matrix, right, damping)
    if not proper.all():
        values, vectors = np.linalg.eigh(np.moveaxis(matrix[..., ~proper], -1, 0))
        along = np.einsum("nij,in->nj", vectors, right[:, ~proper]) / (
            np.abs(values) + damping[~proper, None]
        )
        step[:, ~proper] = np.einsum("nij,nj->in", vectors, along)
    return step * scale, np.abs(step * right).sum(axis=0), proper


def _solve(
    matrix: FloatArray, right: FloatArray, damping: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Solve many small symmetric systems with raised diagonals by elimination.

    False where a pivot is not positive.

    LAPACK, called for each, takes several times as long.
    """
    k, a, y, proper = len(right), matrix.copy(), right.copy(), np.ones(len(damping), bool)
    a[np.arange(k), np.arange(k)] += damping
    for j in range(k):
        good = a[j, j] > 1e-12
        proper &= good
        a[j, j][~good] = 1.0
        factor = a[j, j + 1 :] / a[j, j]
        for i in range(
            j + 1, k
        ):  # the rows below, of which the part on and behind the diagonal counts
            a[i, i:] -= factor[i - j - 1] * a[j, i:]
        y[j + 1 :] -= factor * y[j]
    for j in reversed(range(k)):
        y[j] /= a[j, j]
        y[:j] -= a[:j, j] * y[j]
    return y, proper


@dataclass(frozen=True, eq=False)
class Maxima:
    """Distinct local maxima of a log density, best first, in unconstrained coordinates."""

    x: FloatArray  # (modes, k)
    value: FloatArray  # (modes,)
    curvature: FloatArray  # (modes, k, k): negative Hessian; positive definite at a proper maximum
    # False where no start met the convergence criterion; the points are then the best found
    arrived: bool
    hopeless: FloatArray  # (others, k): further ones, 30 nats and more below the best

    @property
    def all(self) -> FloatArray:
        """Every one of them, shape (maxima, k)."""
        return np.concatenate([self.x, self.hopeless])


def find_maxima(target: SampledPosterior, starts: FloatArray | None = None) -> Maxima:
    """Maxima of the log density from several starts, shape (starts, k), of finite density.

    By default those that the data suggest.
    """
    x = target.starts() if starts is None else starts
    density = Differenced(
        lambda x, _: target.log_density(x), lambda x, _: target.gradient(x)[1], *x.shape
    )
    found = ascend(density, x.T)
    chosen: list[int] = []
    for i in np.argsort(-found.value):
        if (found.arrived[i] or not found.arrived.any()) and all(
            np.abs(found.x[:, i] - found.x[:, j]).max() > 1e-3 for j in chosen
        ):
            chosen.append(int(i))
    x, value = found.x.T[chosen], found.value[chosen]
    near = value > value[0] - 30.0
    kept = np.array(chosen)[near]
    return Maxima(
        x[near],
        value[near],
        density.curvature(found.x[:, kept], kept),
        bool(found.arrived.any()),
        x[~near],
    )
