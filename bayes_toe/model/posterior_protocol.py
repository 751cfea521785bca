"""What an engine asks of a posterior, whichever model it is of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy.typing as npt

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.model.distributions import Random
from bayes_toe.model.target import Levels, Names


class NamedModel(Protocol):
    """A model, by whose name random streams are keyed."""

    @property
    def name(self) -> str:
        """Its name."""


class AnswerPosterior(Protocol):
    """The posterior of one subject that gives the answers their probabilities.

    Points x have the shape (points, k), with unconstrained coordinates.
    """

    @property
    def subject(self) -> Subject:
        """The counts."""

    @property
    def model(self) -> NamedModel:
        """The model."""

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates."""

    @property
    def names(self) -> Names:
        """Names of the quantities."""

    def log_answers(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Log probability of both answers to every pair, (points, pairs) each."""

    def realised_answers(
        self, rng: Random, x: npt.ArrayLike, answers: tuple[FloatArray, FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """The same in one session a point, in which counts may scatter more than binomially."""

    def pair_log_likelihood(
        self, x: npt.ArrayLike, answers: tuple[FloatArray, FloatArray] | None = None
    ) -> FloatArray:
        """Log likelihood of each pair, (points, pairs)."""

    def log_likelihood(self, x: npt.ArrayLike) -> FloatArray:
        """Log likelihood without binomial coefficients, (points,)."""

    def log_prior(self, x: npt.ArrayLike) -> FloatArray:
        """Log prior density, (points,)."""

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """Sum of both, (points,); its integral is the evidence."""

    def sample_prior(self, rng: Random, size: int) -> FloatArray:
        """Independent draws from the prior, (size, k)."""

    def prior_quantile(self, name: str, probability: float) -> float:
        """Prior quantile of a quantity."""

    def quantities(self, x: FloatArray) -> dict[str, FloatArray]:
        """Every quantity, each with the shape of x without its last axis."""

    def judged(self, x: FloatArray) -> dict[str, FloatArray]:
        """The quantities by which the convergence of draws is judged."""

    def points(self, quantities: Mapping[str, FloatArray]) -> FloatArray:
        """Points from quantities, the inverse of :meth:`quantities`."""


class SampledPosterior(AnswerPosterior, Protocol):
    """A posterior that has to be explored: for maxima, importance sampling and emcee."""

    def gradient(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Log density, (points,), and its gradient, (points, k)."""

    def starts(self) -> FloatArray:
        """Points of finite density from which maxima are looked for, (starts, k)."""

    def levelling(self, modes: FloatArray) -> Levels:
        """Coordinates in which mixtures of Student-t densities fit the posterior."""
