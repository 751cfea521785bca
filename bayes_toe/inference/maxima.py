"""The maxima of log densities: damped Newton ascent of many points at once, inside bounds.

`ascend` searches from every start, with a density of its own for each if wanted. `ascend_from`
searches the posteriors of an array, and `laplace` has Laplace's approximation at their maxima.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import ArrayPair, BoolArray, FloatArray, IndexArray
from bayes_toe.model.densities import LOG_2PI
from bayes_toe.model.derivatives import hessian, one_sided_hessian
from bayes_toe.model.posterior_array import PosteriorArray

_CONVERGED = 5e-13  # predicted gain, in nats, at which a search has converged
_ROUNDING = 1e-3  # of the value, in units of this, where that is large
_LIGHT, _HEAVY = 1e-2, 1e12  # damping of a search that converges, and of one that fails
_FIRST, _LEAST = 1e-3, 1e-12  # damping to begin with, and the smallest
_TINY = 1e-300
# --- Of posteriors ---
_GAIN = 0.03  # nats of predicted gain below which a search ends
_LARGEST_STEP = 2.0
_MOST_STEPS = 12
_POLISH_GAIN = 1e-8  # the same for the maximum of which Laplace's evidence is
_EQUAL_WITHIN = (
    0.5  # standard deviations, in every coordinate, within which two ends are one maximum
)
_FAR = 8.0  # nats below the highest at which a maximum does not matter


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

    def part(self, is_chosen: BoolArray | IndexArray) -> Ascent:
        """Some of the searches."""
        return Ascent._make([values[is_chosen] for values in self])

    def joined(self, other: Ascent) -> Ascent:
        """These searches and those of another ascent."""
        return Ascent._make([np.concatenate(pair) for pair in zip(self, other, strict=True)])

    def distinct(self) -> Ascent:
        """The distinct ends that matter, the highest first."""
        ranked = np.argsort(-self.value, kind="stable")
        ranked = ranked[self.value[ranked] >= self.value[ranked[0]] - _FAR]
        chosen: list[int] = []
        for i in ranked.tolist():
            precision = np.sqrt(np.abs(np.diagonal(self.curvature[i])))
            distances = np.abs(self.x[chosen] - self.x[i]) * precision
            if (distances.max(axis=1, initial=0.0) > _EQUAL_WITHIN).all():
                chosen.append(i)
        return self.part(np.array(chosen))


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


# --- Posteriors ----------------------------------------------------------------------------------


def ascend_from(
    array: PosteriorArray,
    owners: IndexArray,
    starts: FloatArray,
    is_held: BoolArray | bool = False,
    least_gain: float = _GAIN,
) -> Ascent:
    """Fisher scoring from many starts at once.

    Parameters
    ----------
    array : PosteriorArray
    owners : ndarray of int, shape (searches,)
        The posterior of each search.
    starts : ndarray, shape (searches, d)
    is_held : ndarray of bool, shape (searches, d)
        Further coordinates that stay where they start.
    least_gain : float
        A search ends where the predicted gain, nats, is below this.
    """
    return ascend(
        lambda x, index: _expansion(array.part(owners[index]), x),
        starts,
        is_held=~array.is_free[owners] | is_held,
        least_gain=least_gain,
        largest_step=_LARGEST_STEP,
        most_steps=_MOST_STEPS,
        retry_damping=0.0,
    )


def _expansion(array: PosteriorArray, points: FloatArray) -> Expansion:
    """The log density of each posterior about its point, (posteriors, d).

    The curvature is that of Fisher information and prior.
    """
    w, is_free = points[:, None, :], array.is_free
    log_likelihood, gradient, information = array.likelihood.scoring(w)
    slopes, curvatures = array.prior_slopes(w)
    value = log_likelihood[:, 0] + array.log_prior(w)[:, 0]
    gradient = np.where(is_free, (gradient + slopes)[:, 0], 0.0)

    both_free = is_free[:, :, None] & is_free[:, None, :]
    curvature = np.where(both_free, information[:, 0], 0.0)
    diagonal = np.arange(points.shape[1])
    curvature[:, diagonal, diagonal] += np.where(is_free, curvatures[:, 0], 1.0)
    return Expansion(value, gradient, curvature)


def laplace(array: PosteriorArray, maxima: Sequence[Ascent]) -> ArrayPair:
    """The highest maximum of every posterior, (n, d), and Laplace's log evidence, (n,)."""
    n, d = array.is_free.shape
    owners = np.arange(n)
    highest = np.array([ends.x[np.argmax(ends.value)] for ends in maxima])
    top = ascend_from(array, owners, highest, least_gain=_POLISH_GAIN)

    def gradient(points: FloatArray) -> FloatArray:
        repeated = array.part(np.resize(owners, len(points)))
        w = points[:, None, :]
        slope = repeated.likelihood.gradient(w)[1] + repeated.prior_slopes(w)[0]
        return slope[:, 0]

    diagonal = np.arange(d)
    curvature = -hessian(gradient, top.x, top.curvature[:, diagonal, diagonal])
    both_free = array.is_free[:, :, None] & array.is_free[:, None, :]
    curvature = np.where(both_free, curvature, np.eye(d))
    is_proper = np.linalg.eigvalsh(curvature)[:, 0] > 0.0
    log_determinant = np.linalg.slogdet(curvature)[1]
    dimensions = array.is_free.sum(axis=1)
    laplace = top.value + 0.5 * dimensions * LOG_2PI - 0.5 * log_determinant
    return top.x, np.where(is_proper, laplace, np.nan)
