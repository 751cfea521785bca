"""The maximum of a log posterior in unconstrained coordinates: safeguarded Newton, all starts in one batch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import logit

from bayes_toe.posterior import Posterior
from bayes_toe.study import Subject

FloatArray = npt.NDArray[np.float64]
_MAX_ITERATIONS = 200
_DECREMENT = 1e-12  # twice the predicted gain, in nats, at which a start counts as arrived


@dataclass(frozen=True, eq=False)
class Maxima:
    """Distinct local maxima, best first.

    Attributes
    ----------
    x : array, shape (modes, 4)
        Unconstrained coordinates.
    value : array, shape (modes,)
        Log posterior density there.
    curvature : array, shape (modes, 4, 4)
        Negative Hessian; positive definite at a proper maximum.
    arrived : bool
        False where no start met the convergence criterion; the points are then the best found.
    """

    x: FloatArray
    value: FloatArray
    curvature: FloatArray
    arrived: bool


def find_maxima(posterior: Posterior) -> Maxima:
    """Maxima of the log posterior from several starts that the data suggest.

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> find_maxima(Posterior(subject)).arrived
    True
    """
    x, value, arrived = _newton(posterior, starts(posterior.subject))
    if arrived.any():
        x, value = x[arrived], value[arrived]
    chosen = _distinct(x, value)
    curvature = -posterior.derivatives(x[chosen])[1]
    return Maxima(x[chosen], value[chosen], curvature, bool(arrived.any()))


def starts(subject: Subject) -> FloatArray:
    """Starting points (18, 4): offsets, pulls and widths on the scale of the stimuli, q0 from the most 'equal' pair."""
    steps = np.abs(subject.s2 - subject.s1)
    scale = float(np.sqrt(np.mean(steps[steps > 0] ** 2))) if np.any(steps > 0) else 0.3
    top = float(((subject.n_equal + 1.0) / (subject.n_trials + 2.0)).max())
    grid = np.meshgrid([-scale, 0.0, scale], [-2.0, 2.0], np.log(scale) + np.array([-1.0, 0.0, 1.0]), [logit(top)])
    return np.stack([axis.ravel() for axis in grid], axis=-1)


def _newton(posterior: Posterior, x: FloatArray) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Levenberg-damped Newton ascent of every start; a step is kept only if it raises the density."""
    x, value = x.copy(), posterior.log_density(x)
    damping = np.full(len(x), 1e-2)
    arrived = np.zeros(len(x), bool)
    for _ in range(_MAX_ITERATIONS):
        at = np.flatnonzero(~arrived & (damping < 1e12))
        if not len(at):
            break
        step, decrement = _step(posterior, x[at], damping[at])
        trial = x[at] + step
        trial_value = posterior.log_density(trial)
        better = trial_value >= value[at]
        arrived[at] = (decrement < _DECREMENT * (1.0 + np.abs(value[at]) * 1e-3)) & better
        x[at[better]], value[at[better]] = trial[better], trial_value[better]
        damping[at] = np.where(better, np.maximum(damping[at] / 8.0, 1e-12), damping[at] * 4.0)
    return x, value, arrived


def _step(posterior: Posterior, x: FloatArray, damping: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ascent step and twice its predicted gain; eigenvalues enter by size, so that a saddle is left uphill."""
    gradient, hessian = posterior.derivatives(x)
    scale = 1.0 / np.sqrt(np.abs(np.diagonal(hessian, axis1=1, axis2=2)) + 1e-300)
    scaled = -hessian * scale[:, :, None] * scale[:, None, :]
    values, vectors = np.linalg.eigh(scaled)
    slope = np.einsum("nij,ni->nj", vectors, gradient * scale)
    along = slope / (np.abs(values) + damping[:, None])
    decrement = np.sum(slope**2 / (np.abs(values) + 1e-300), axis=1)
    step = np.einsum("nij,nj->ni", vectors, along) * scale
    return step * np.minimum(1.0, 5.0 / np.abs(step).max(axis=1, keepdims=True).clip(1e-300)), decrement


def _distinct(x: FloatArray, value: FloatArray) -> npt.NDArray[np.intp]:
    """Indices of maxima that differ visibly and are not hopeless (30 nats below the best), best first."""
    chosen: list[int] = []
    for i in np.argsort(-value):
        far = all(np.abs(x[i] - x[j]).max() > 1e-3 for j in chosen)
        if far and value[i] > value.max() - 30.0:
            chosen.append(int(i))
    return np.array(chosen)
