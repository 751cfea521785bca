"""The maxima of log densities: damped Newton ascent of many points at once, inside bounds.

`ascend` searches from every start, with a density of its own for each if wanted. `find_maxima`
gives the distinct maxima of one posterior.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import ArrayPair, BoolArray, FloatArray, IndexArray
from bayes_toe.model.derivatives import hessian, one_sided_hessian
from bayes_toe.model.posterior import SampledPosterior

_CONVERGED = 5e-13  # predicted gain, in nats, at which a search has converged
_ROUNDING = 1e-3  # of the value, in units of this, where that is large
_LIGHT, _HEAVY = 1e-2, 1e12  # damping of a search that converges, and of one that fails
_FIRST, _LEAST = 1e-3, 1e-12  # damping to begin with, and the smallest
_SMALL_DISTANCE = 1e-3  # distance, in every coordinate, of points that are one maximum
_FAR = 30.0  # nats below the best at which a maximum does not matter
_TINY = 1e-300
#: What differences cannot distinguish from 0 is no curvature.
LEAST_CURVATURE = 1e-8


class Expansion(NamedTuple):
    """Log densities about points: value, gradient and curvature.

    The curvature is the negative Hessian, or a positive definite approximation of it.
    """

    value: FloatArray  # (points,)
    gradient: FloatArray  # (points, k)
    curvature: FloatArray  # (points, k, k)


#: From points, (points, k), and the start that each of them came from, (points,).
Expand = Callable[[FloatArray, IndexArray], Expansion]
ValueAndGradient = Callable[[FloatArray, IndexArray], ArrayPair]


class Differenced:
    """Log densities with known gradients, and curvatures by differences of these.

    The steps of the differences follow from the last curvature of each search.
    """

    def __init__(self, density: ValueAndGradient, n_starts: int, k: int) -> None:
        self._density = density
        self._diagonal = np.ones((n_starts, k))

    def expand(self, x: FloatArray, index: IndexArray) -> Expansion:
        """The log densities about points, as :data:`Expand`."""

        def slopes(points: FloatArray) -> ArrayPair:
            return self._density(points, np.resize(index, len(points)))

        value, gradient, second = one_sided_hessian(slopes, x, self._diagonal[index])
        diagonal = np.abs(np.diagonal(second, axis1=1, axis2=2))
        self._diagonal[index] = np.where(np.isfinite(diagonal), diagonal, self._diagonal[index])
        return Expansion(value, gradient, -second)

    def curvature(self, x: FloatArray, index: IndexArray) -> FloatArray:
        """Negative Hessian where searches ended, (points, k, k), by central differences."""

        def gradient(points: FloatArray) -> FloatArray:
            return self._density(points, np.resize(index, len(points)))[1]

        return -hessian(gradient, x, self._diagonal[index])


class Ascent(NamedTuple):
    """The ends of searches, the log densities there, and whether the searches converged."""

    x: FloatArray  # (starts, k)
    value: FloatArray  # (starts,)
    gradient: FloatArray  # (starts, k)
    curvature: FloatArray  # (starts, k, k)
    has_converged: BoolArray  # (starts,)

    def part(self, is_chosen: BoolArray) -> Ascent:
        """Some of the searches."""
        return Ascent._make([values[is_chosen] for values in self])

    def joined(self, other: Ascent) -> Ascent:
        """These searches and those of another ascent."""
        return Ascent._make([np.concatenate(pair) for pair in zip(self, other, strict=True)])


def ascend(
    expand: Expand,
    starts: FloatArray,
    *,
    lower: npt.ArrayLike = -np.inf,
    is_held: npt.ArrayLike = False,
    least_gain: float = 0.0,
    largest_step: float = 5.0,
    most_steps: int = 200,
    retry_damping: float = 1e-3,
) -> Ascent:
    """Damped Newton ascent from every start; no step is taken that lowers the value.

    Parameters
    ----------
    expand : callable
        The log density about points.
    starts : ndarray, shape (starts, k)
        Points inside the bounds, where the density is finite.
    lower : array_like
        Lower bounds. A coordinate on its bound stays there until its slope is positive.
    is_held : array_like of bool
        Coordinates that stay where they start.
    least_gain : float
        A search ends, without having converged, before a step that promises fewer nats.
    largest_step : float
        In every coordinate.
    most_steps : int
    retry_damping : float
        Least damping after a step that would have lowered the value.
    """
    active = np.arange(len(starts))
    has_converged = np.zeros(len(starts), np.bool_)
    ended = Ascent(starts.copy(), *expand(starts, active), has_converged)
    x, value, gradient, curvature, _ = ended
    floor = np.broadcast_to(lower, x.shape)
    is_fixed = np.broadcast_to(is_held, x.shape)
    damping = np.full(len(starts), _FIRST)
    for _ in range(most_steps):
        is_on_floor = (x[active] <= floor[active]) & (gradient[active] <= 0.0)
        is_moving = ~(is_fixed[active] | is_on_floor)
        step, gains = _steps(gradient[active], curvature[active], is_moving, damping[active])
        is_worth_it = gains.sum(axis=1) >= least_gain
        active, step, gains = active[is_worth_it], step[is_worth_it], gains[is_worth_it]
        if not len(active):
            break
        longest = np.abs(step).max(axis=1)
        step *= np.minimum(1.0, largest_step / np.maximum(longest, _TINY))[:, None]
        trial = np.maximum(x[active] + step, floor[active])
        expansion = expand(trial, active)
        is_better = expansion.value >= value[active]
        better = active[is_better]
        x[better] = trial[is_better]
        for stored, new in zip((value, gradient, curvature), expansion, strict=True):
            stored[better] = new[is_better]

        # A gain below the rounding of the value cannot be seen: the search has converged, whether
        # or not the step was taken.
        is_small = np.abs(gains).sum(axis=1) < _CONVERGED * (
            1.0 + _ROUNDING * np.abs(value[active])
        )
        has_converged[active] = is_small & (damping[active] <= _LIGHT)
        lighter = np.maximum(0.1 * damping[active], _LEAST)
        heavier = np.maximum(10.0 * damping[active], retry_damping)
        damping[active] = np.where(is_better, lighter, heavier)
        # No further where slopes are beyond all floats.
        is_finite = np.isfinite(curvature[active]).all(axis=(1, 2))
        active = active[~has_converged[active] & (damping[active] < _HEAVY) & is_finite]
    return ended


def _steps(
    gradient: FloatArray, curvature: FloatArray, is_moving: BoolArray, damping: FloatArray
) -> ArrayPair:
    """Steps uphill in the moving coordinates, (points, k), and the gain that each predicts.

    The curvature is scaled to a unit diagonal, and the damping is added to the sizes of its
    eigenvalues: where it is not positive definite, the step leads away from a saddle.
    """
    k = gradient.shape[1]
    diagonal = np.arange(k)
    size = np.abs(curvature[:, diagonal, diagonal])
    scale = np.where(is_moving, 1.0, 0.0)
    # Slopes may be close to the largest float.
    with np.errstate(over="ignore", invalid="ignore"):
        np.divide(1.0, np.sqrt(np.maximum(size, _TINY)), out=scale, where=is_moving & (size > 0.0))
        matrix = curvature * scale[:, :, None] * scale[:, None, :]
        matrix[:, diagonal, diagonal] += ~is_moving
        slope = np.where(is_moving, gradient, 0.0) * scale
        values, vectors = np.linalg.eigh(matrix)
        along = np.einsum("nij,ni->nj", vectors, slope) / (np.abs(values) + damping[:, None])
        step = np.einsum("nij,nj->ni", vectors, along)
        return step * scale, 0.5 * step * slope


# --- The maxima of a posterior -------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Maxima:
    """Distinct local maxima of a log density that matter, best first, unconstrained coordinates.

    Attributes
    ----------
    x : ndarray, shape (modes, k)
    value : ndarray, shape (modes,)
    curvature : ndarray, shape (modes, k, k)
        The negative Hessian; positive definite at a proper maximum.
    has_converged : bool
        False where no search converged; the points are then the best ones that were reached.
    """

    x: FloatArray
    value: FloatArray
    curvature: FloatArray
    has_converged: bool


def find_maxima(target: SampledPosterior, starts: FloatArray | None = None) -> Maxima:
    """Maxima of the log density from several starts, shape (starts, k), of finite density.

    The default starts are those that the data suggest.
    """
    if starts is None:
        starts = target.starts()
    density = Differenced(lambda x, _: target.gradient(x), *starts.shape)
    ascent = ascend(density.expand, starts)
    is_candidate = ascent.has_converged
    if not is_candidate.any():
        is_candidate = np.ones(len(starts), np.bool_)
    distinct: list[int] = []
    for i in np.argsort(-ascent.value).tolist():
        distances = np.abs(ascent.x[distinct] - ascent.x[i]).max(axis=1)
        if is_candidate[i] and (distances > _SMALL_DISTANCE).all():
            distinct.append(i)
    best = np.array(distinct)
    best = best[ascent.value[best] > ascent.value[best[0]] - _FAR]
    curvature = density.curvature(ascent.x[best], best)
    # Without curvature in a coordinate a search has come to an edge, not to a maximum.
    is_proper = np.diagonal(curvature, axis1=1, axis2=2).min(axis=1) > LEAST_CURVATURE
    is_proper[0] = True
    best, curvature = best[is_proper], curvature[is_proper]
    has_converged = bool(ascent.has_converged.any())
    return Maxima(ascent.x[best], ascent.value[best], curvature, has_converged)
