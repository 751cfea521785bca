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
from bayes_toe.model.posterior_array import PosteriorArray

_TINY = 1e-300
POLISH_GAIN = 1e-8  # nats of predicted gain below which a search for an exact maximum ends


class Expansion(NamedTuple):
    """Log densities about points: value, gradient and curvature.

    The curvature is the negative Hessian, or a positive definite approximation.
    """

    value: FloatArray  # (points,)
    gradient: FloatArray  # (points, k)
    curvature: FloatArray  # (points, k, k)


#: From points, (points, k), and the start that each point came from, (points,), to the expansion.
Expand = Callable[[FloatArray, IndexArray], Expansion]


class Ascent(NamedTuple):
    """The ends of searches, and the expansion of the log density about each."""

    x: FloatArray  # (starts, k)
    value: FloatArray  # (starts,)
    gradient: FloatArray  # (starts, k)
    curvature: FloatArray  # (starts, k, k)

    def part(self, is_chosen: BoolArray | IndexArray) -> Ascent:
        """Some of the searches, by a mask or by their indices."""
        return Ascent._make([values[is_chosen] for values in self])

    def distinct(self) -> Ascent:
        """The distinct ends that matter, the highest first.

        An end 8 nats below the highest end does not matter. Two ends within half a standard
        deviation in every coordinate count as one end.
        """
        highest_first = np.argsort(-self.value, kind="stable")
        heights = self.value[highest_first]
        chosen: list[int] = []
        for i in highest_first[heights >= heights[0] - 8.0].tolist():
            inverse_sds = np.sqrt(np.abs(np.diagonal(self.curvature[i])))
            distances = np.abs(self.x[chosen] - self.x[i]) * inverse_sds  # (chosen, k)
            if (distances.max(axis=1) > 0.5).all():  # far from every chosen end
                chosen.append(i)
        return self.part(np.array(chosen))


def ascend(
    expand: Expand,
    starts: FloatArray,
    *,
    is_held: npt.ArrayLike = False,
    least_gain: float = 0.0,
    most_steps: int = 200,
    retry_damping: float = 1e-3,
) -> Ascent:
    """Damped Newton ascent from every start; no step is taken that lowers the value.

    A step is at most 2 in every coordinate. The damping of a search becomes a tenth after a step
    that is taken, and ten times as heavy otherwise.

    Parameters
    ----------
    expand : callable
        The log density about points.
    starts : ndarray, shape (starts, k)
        Points where the density is finite.
    is_held : array_like of bool
        Coordinates that stay where they start.
    least_gain : float
        A search ends before a step that promises fewer nats.
    most_steps : int
    retry_damping : float
        Least damping after a step that would have lowered the value.
    """
    active = np.arange(len(starts))  # the searches that go on
    ends = Ascent(starts.copy(), *expand(starts, active))  # its arrays change in place
    is_moving = ~np.broadcast_to(is_held, starts.shape)
    damping = np.full(len(starts), 1e-3)  # beside a scaled curvature whose diagonal is 1

    for _ in range(most_steps):
        step, gains = _steps(ends.part(active), is_moving[active], damping[active])
        is_promising = gains.sum(axis=1) >= least_gain
        active = active[is_promising]
        if not len(active):
            break

        # A step is taken where it does not lower the value.
        trial = ends.x[active] + step[is_promising]
        trial_expansion = expand(trial, active)
        is_better = trial_expansion.value >= ends.value[active]
        for end_values, new_values in zip(ends, (trial, *trial_expansion), strict=True):
            end_values[active[is_better]] = new_values[is_better]

        old_damping = damping[active]
        lighter = np.maximum(0.1 * old_damping, 1e-12)  # never 0, which would stay 0
        heavier = np.maximum(10.0 * old_damping, retry_damping)
        damping[active] = np.where(is_better, lighter, heavier)

        # A gain below the rounding of the value cannot be seen: the search has converged, whether
        # or not the step was taken. A heavily damped step promises little anywhere.
        total_gain = np.abs(gains[is_promising]).sum(axis=1)
        is_small = total_gain < 5e-13 * (1.0 + 1e-3 * np.abs(ends.value[active]))
        has_converged = is_small & (old_damping <= 1e-2)
        # A search ends where slopes are beyond all floats, or where damping does not help.
        is_finite = np.isfinite(ends.curvature[active]).all(axis=(1, 2))
        active = active[is_finite & ~has_converged & (damping[active] < 1e12)]
    return ends


def _steps(searches: Ascent, is_moving: BoolArray, damping: FloatArray) -> ArrayPair:
    """Steps uphill of at most 2 in the moving coordinates, (points, k), and their predicted gains.

    The curvature H is scaled to a unit diagonal, S H S, and has the eigenvalues e and eigenvectors
    V. The step is S V (|e| + damping)^-1 V' S g, g the gradient. The size of e makes it lead uphill
    from a saddle too. The gain of each coordinate is that of a Newton step in a quadratic.
    """
    diagonal = np.arange(searches.x.shape[1])
    size = np.abs(searches.curvature[:, diagonal, diagonal])

    # Slopes may be close to the largest float.
    with np.errstate(over="ignore", invalid="ignore"):
        # The diagonal of S, (points, k): |H_ii|^(-1/2), or 1 where the curvature is 0. Where a
        # coordinate is held, S is 0, and S H S gets the eigenvalue 1 in the place of 0.
        inverse_scale = np.sqrt(np.where(size > 0.0, np.maximum(size, _TINY), 1.0))
        scale = np.where(is_moving, 1.0 / inverse_scale, 0.0)
        matrix = searches.curvature * scale[:, :, None] * scale[:, None, :]
        matrix[:, diagonal, diagonal] += np.where(is_moving, 0.0, 1.0)
        slope = np.where(is_moving, searches.gradient, 0.0) * scale  # S g

        eigenvalues, vectors = np.linalg.eigh(matrix)
        along_vectors = np.einsum("nij,ni->nj", vectors, slope)  # V' S g
        damped = along_vectors / (np.abs(eigenvalues) + damping[:, None])
        scaled_step = np.einsum("nij,nj->ni", vectors, damped)
        step = scaled_step * scale
        longest = np.maximum(np.abs(step).max(axis=1), _TINY)
        shortening = np.minimum(1.0, 2.0 / longest)
        # The gain of a Newton step is half of step' g.
        return step * shortening[:, None], 0.5 * scaled_step * slope


# --- Posteriors ----------------------------------------------------------------------------------


def ascend_from(
    posteriors: PosteriorArray,
    owners: IndexArray,
    starts: FloatArray,
    is_held: BoolArray | bool = False,
    least_gain: float = 0.03,
    most_steps: int = 12,
) -> Ascent:
    """Fisher scoring from many starts at once; exact maxima are left to :func:`polished`.

    Parameters
    ----------
    posteriors : PosteriorArray
    owners : ndarray of int, shape (searches,)
        The posterior of each search.
    starts : ndarray, shape (searches, d)
    is_held : ndarray of bool, shape (searches, d)
        Further coordinates that stay where they start.
    least_gain : float
        A search ends where the predicted gain, nats, is below this limit.
    most_steps : int
    """
    return ascend(
        lambda x, index: expansion(posteriors.part(owners[index]), x),
        starts,
        is_held=~posteriors.is_free[owners] | is_held,
        least_gain=least_gain,
        most_steps=most_steps,
        retry_damping=0.0,
    )


def polished(posteriors: PosteriorArray, owners: IndexArray, starts: FloatArray) -> Ascent:
    """Exact maxima from the ends of searches, by Newton's method; arguments as `ascend_from`.

    Scoring would need many steps where the answers leave a coordinate open. The curvature is here
    the negative Hessian.
    """
    search_posteriors = posteriors.part(owners)
    return ascend(
        lambda x, index: _newton_expansion(search_posteriors.part(index), x),
        starts,
        is_held=~search_posteriors.is_free,
        least_gain=POLISH_GAIN,
    )


def _newton_expansion(posteriors: PosteriorArray, points: FloatArray) -> Expansion:
    """:func:`expansion`, but with the negative Hessian, by differences of gradients."""
    n_points, k = points.shape
    value, gradient, curvature = expansion(posteriors, points)
    # A step is a millionth of the SD in its coordinate, or larger where the point would hide it by
    # rounding.
    inverse_variance = np.diagonal(curvature, axis1=1, axis2=2)  # (points, k)
    steps = 1e-6 / np.sqrt(np.maximum(inverse_variance, 1e-6))
    steps = np.maximum(steps, 1e-12 * np.abs(points))

    # From each point a step in each coordinate alone, (k, points, k), all at once.
    shifted_points = points + np.eye(k)[:, None] * steps
    lengths = np.einsum("ipi->ip", shifted_points - points)[:, :, None]  # after rounding
    repeated_posteriors = posteriors.part(np.resize(np.arange(n_points), k * n_points))
    shifted = expansion(repeated_posteriors, shifted_points.reshape(-1, k))
    changes = shifted.gradient.reshape(k, n_points, k) - gradient
    second_derivatives = (changes / lengths).swapaxes(0, 1)  # (points, k, k)
    symmetric = 0.5 * (second_derivatives + second_derivatives.swapaxes(1, 2))
    return Expansion(value, gradient, -symmetric)


def expansion(posteriors: PosteriorArray, points: FloatArray) -> Expansion:
    """The log density of each posterior about its own point; `points` has shape (posteriors, d).

    The curvature is the Fisher information plus the stand-in for the negative curvature of the log
    prior, see :data:`bayes_toe.model.densities.PriorDensity`.
    """
    w = points[:, None, :]  # one point for each posterior
    is_free = posteriors.is_free
    log_likelihood, likelihood_slopes, information = posteriors.likelihood.scoring(w)
    prior_slopes, negative_curvatures = posteriors.prior_slopes(w)
    value = log_likelihood[:, 0] + posteriors.log_prior(w)[:, 0]
    gradient = np.where(is_free, (likelihood_slopes + prior_slopes)[:, 0], 0.0)

    curvature = _free_part(information[:, 0], is_free)  # 1 in coordinates that are held
    diagonal = np.arange(points.shape[1])
    curvature[:, diagonal, diagonal] += np.where(is_free, negative_curvatures[:, 0], 0.0)
    return Expansion(value, gradient, curvature)


def _free_part(curvature: FloatArray, is_free: BoolArray) -> FloatArray:
    """The curvature in free coordinates, and the identity matrix in held coordinates."""
    both_free = is_free[:, :, None] & is_free[:, None, :]
    return np.where(both_free, curvature, np.eye(is_free.shape[1]))


def laplace(posteriors: PosteriorArray, maxima: Sequence[Ascent]) -> ArrayPair:
    """The highest maximum of every posterior, (n, d), and Laplace's log evidence, (n,).

    The evidence is NaN where the curvature at the maximum is not positive definite.
    """
    owners = np.arange(len(posteriors))
    highest_ends = np.array([ends.x[np.argmax(ends.value)] for ends in maxima])
    exact_maxima = polished(posteriors, owners, highest_ends)

    # ln evidence = ln density at the maximum + (k/2) ln(2 pi) - (1/2) ln det(-Hessian), with the
    # number k of free coordinates. Ones on the diagonal do not change the determinant.
    curvature = _free_part(exact_maxima.curvature, posteriors.is_free)
    is_proper = np.linalg.eigvalsh(curvature)[:, 0] > 0.0  # the smallest eigenvalue
    _, log_determinant = np.linalg.slogdet(curvature)
    log_evidence = (
        exact_maxima.value + 0.5 * posteriors.is_free.sum(axis=1) * LOG_2PI - 0.5 * log_determinant
    )
    return exact_maxima.x, np.where(is_proper, log_evidence, np.nan)
