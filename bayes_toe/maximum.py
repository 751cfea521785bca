"""The maxima of a log posterior in unconstrained coordinates, all starts in one batch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import logit

from bayes_toe.newton import ascend
from bayes_toe.posterior import Posterior
from bayes_toe.study import Subject

FloatArray = npt.NDArray[np.float64]


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
    found = ascend(_LogPosterior(posterior), starts(posterior.subject).T)
    kept = found.arrived if found.arrived.any() else np.ones_like(found.arrived)
    x, value = found.x.T[kept], found.value[kept]
    chosen = _distinct(x, value)
    curvature = -posterior.derivatives(x[chosen])[1]
    return Maxima(x[chosen], value[chosen], curvature, bool(found.arrived.any()))


def starts(subject: Subject) -> FloatArray:
    """Starting points (18, 4): offsets, pulls and widths on the scale of the stimuli, q0 from the most 'equal' pair."""
    steps = np.abs(subject.s2 - subject.s1)
    scale = float(np.sqrt(np.mean(steps[steps > 0] ** 2))) if np.any(steps > 0) else 0.3
    top = float(((subject.n_equal + 1.0) / (subject.n_trials + 2.0)).max())
    grid = np.meshgrid([-scale, 0.0, scale], [-2.0, 2.0], np.log(scale) + np.array([-1.0, 0.0, 1.0]), [logit(top)])
    return np.stack([axis.ravel() for axis in grid], axis=-1)


@dataclass(frozen=True, eq=False)
class _LogPosterior:
    """The log posterior as the ascent wants it, points on the last axis."""

    posterior: Posterior

    def evaluate(self, x: FloatArray, _: npt.NDArray[np.intp]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Value, gradient and Hessian; where the density is 0 there are no derivatives, and no step leads there."""
        value = self.posterior.log_density(x.T)
        some = np.isfinite(value)
        gradient, hessian = np.zeros(x.shape), np.zeros((len(x), *x.shape))
        first, second = self.posterior.derivatives(x.T[some])
        gradient[:, some], hessian[:, :, some] = first.T, np.moveaxis(second, 0, -1)
        return value, gradient, hessian


def _distinct(x: FloatArray, value: FloatArray) -> npt.NDArray[np.intp]:
    """Indices of maxima that differ visibly and are not hopeless (30 nats below the best), best first."""
    chosen: list[int] = []
    for i in np.argsort(-value):
        far = all(np.abs(x[i] - x[j]).max() > 1e-3 for j in chosen)
        if far and value[i] > value.max() - 30.0:
            chosen.append(int(i))
    return np.array(chosen)
