"""What the engines see of a model of one subject: a log density in unconstrained coordinates, and where to start with it.

Proposal, sampler and evidence are written against :class:`Target` alone, so each model of the ladder costs its own dimensions only.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.errors import NumericalError


def require_points(x: npt.ArrayLike, k: int) -> FloatArray:
    """Points as an array of shape (points, k) without NaN.

    Raises
    ------
    NumericalError
        If they are not.
    """
    points = np.atleast_2d(np.asarray(x, np.float64))
    if points.ndim != 2 or points.shape[1] != k:
        raise NumericalError(f"points must have shape (points, {k}), found {points.shape}")
    if np.isnan(points).any():
        raise NumericalError("a coordinate is NaN")
    return points


def require_defined(log_posterior: FloatArray, target: Target) -> None:
    """Refuse log densities among which there is a NaN.

    Raises
    ------
    NumericalError
        If there is one, with the subject's name.
    """
    if np.isnan(log_posterior).any():
        raise NumericalError(f"subject {target.subject.name!r}: log posterior is NaN")


class Levels(Protocol):
    """A bijection between unconstrained coordinates x and levelled ones y, in which mixtures of Student-t densities fit the posterior."""

    def level(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Levelled coordinates of x, shape (points, k), and log |dy/dx|, shape (points,)."""
        ...

    def unlevel(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Unconstrained coordinates of y, shape (points, k), and log |dy/dx| there; points beyond all floats go where the density is 0."""
        ...


class Answering(Protocol):
    """A model that gives probabilities of both answers to every pair of one subject; x has shape (points, k)."""

    @property
    def subject(self) -> Subject:
        """The counts."""
        ...

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the k coordinates."""
        ...

    def log_likelihood(self, x: npt.ArrayLike) -> FloatArray:
        """Log likelihood without binomial coefficients, (points, k) -> (points,)."""
        ...

    def log_answers(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Log P(equal) and log P(different) of every pair, (points, k) -> (points, pairs) each."""
        ...


class Target(Answering, Protocol):
    """The posterior of one model of one subject over unconstrained x, shape (points, k); both densities are with respect to x.

    The prior is proper and normalised, so the integral of likelihood times prior over x is the model's evidence.
    """

    def log_prior(self, x: npt.ArrayLike) -> FloatArray:
        """Log prior density, (points, k) -> (points,)."""
        ...

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """Their sum, (points, k) -> (points,)."""
        ...

    def derivatives(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Gradient (points, k) and Hessian (points, k, k) of the log density."""
        ...

    def starts(self) -> FloatArray:
        """Points from which to look for maxima, shape (starts, k), of finite density."""
        ...

    def sample_prior(self, rng: np.random.Generator | np.random.RandomState, size: int) -> FloatArray:
        """Independent draws from the prior, shape (size, k)."""
        ...

    def levelling(self, modes: FloatArray) -> Levels:
        """Coordinates in which mixtures fit, given modes of the density, shape (modes, k), best first."""
        ...

    def for_subject(self, subject: Subject) -> Target:
        """The same model with the same prior for other answers, offsets counted from the same intensity where the prior is about them."""
        ...

    def judged(self, x: FloatArray) -> dict[str, FloatArray]:
        """The quantities by which draws are judged to have converged, (..., k) -> (...) each."""
        ...
