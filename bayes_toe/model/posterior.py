"""What the posteriors of all models have in common.

`AnswerPosterior` is what figures and checks need. `SampledPosterior` is what optimisers and
samplers need.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import AnyRng, ArrayPair, FloatArray, NamedArrays
from bayes_toe.data.study import Subject
from bayes_toe.errors import NumericalError
from bayes_toe.model.parameters import QUANTITY_BY_NAME

#: The range of quantiles that :func:`posterior_contraction` compares.
RANGE = (0.05, 0.95)
#: Contraction below which a parameter is said to be dominated by its prior: a range narrowed by
#: less than three tenths.
DOMINATED = 0.5


@dataclass(frozen=True)
class Names:
    """Names of quantities: as many natural and as many identified ones as there are coordinates."""

    natural: tuple[str, ...]  # what the model is written in
    identified: tuple[str, ...]  # what the answers depend on
    derived: tuple[str, ...] = ()  # further ones that tables report
    # Monotone functions of a single other one, so that their ranks say nothing new.
    monotone: tuple[str, ...] = ()

    @property
    def reported(self) -> tuple[str, ...]:
        """The quantities in tables and files: natural and derived, in order."""
        return _ordered((*self.natural, *self.derived))

    @property
    def all(self) -> tuple[str, ...]:
        """Every name, in order."""
        return _ordered((*self.natural, *self.derived, *self.identified))


def _ordered(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(name for name in QUANTITY_BY_NAME if name in names)


def require_points(x: npt.ArrayLike, k: int) -> FloatArray:
    """Points as an array of shape (points, k) without NaN."""
    points = np.atleast_2d(np.asarray(x, np.float64))
    if points.ndim != 2 or points.shape[1] != k:
        raise NumericalError(f"points must have shape (points, {k}), found {points.shape}")
    if np.isnan(points).any():
        raise NumericalError("a coordinate is NaN")
    return points


def require_defined(log_posterior: FloatArray, target: AnswerPosterior) -> None:
    """Refuse log densities among which there is a NaN."""
    if np.isnan(log_posterior).any():
        raise NumericalError(f"subject {target.subject.name!r}: log posterior is NaN")


class Transform(Protocol):
    """A bijection between the coordinates x and others, y, in which mixtures fit the posterior."""

    def forward(self, x: FloatArray) -> ArrayPair:
        """Coordinates y of x, shape (points, k), and log |dy/dx|, shape (points,)."""

    def inverse(self, y: FloatArray) -> ArrayPair:
        """Coordinates x of y, shape (points, k), and log |dy/dx| there.

        Points beyond all floats go where the density is 0.
        """


class SameCoordinates:
    """The transform that changes nothing."""

    def forward(self, x: FloatArray) -> ArrayPair:
        """A copy of x, and 0."""
        return x.copy(), np.zeros(len(x))

    def inverse(self, y: FloatArray) -> ArrayPair:
        """A copy of y, and 0."""
        return y.copy(), np.zeros(len(y))


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

    def log_answers(self, x: npt.ArrayLike) -> ArrayPair:
        """Log probability of both answers to every pair, (points, pairs) each."""

    def log_likelihood(self, x: npt.ArrayLike) -> FloatArray:
        """Log likelihood without binomial coefficients, (points,)."""

    def log_prior(self, x: npt.ArrayLike) -> FloatArray:
        """Log prior density, (points,)."""

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """Sum of both, (points,); its integral is the evidence."""

    def sample_prior(self, rng: AnyRng, size: int) -> FloatArray:
        """Independent draws from the prior, (size, k)."""

    def prior_quantile(self, name: str, probability: float) -> float:
        """Prior quantile of a quantity."""

    def quantities(self, x: FloatArray) -> dict[str, FloatArray]:
        """Every quantity, each with the shape of x without its last axis."""

    def points(self, quantities: NamedArrays) -> FloatArray:
        """Points from quantities, the inverse of :meth:`quantities`."""


class SampledPosterior(AnswerPosterior, Protocol):
    """A posterior that has to be explored: for maxima, importance sampling and emcee."""

    def gradient(self, x: npt.ArrayLike) -> ArrayPair:
        """Log density, (points,), and its gradient, (points, k)."""

    def starts(self) -> FloatArray:
        """Points of finite density from which maxima are looked for, (starts, k)."""

    def transform(self, modes: FloatArray) -> Transform:
        """Coordinates in which mixtures of Student-t densities fit the posterior."""


def judged_quantities(target: AnswerPosterior, x: FloatArray) -> dict[str, FloatArray]:
    """The quantities by which draws are judged: those that follow from no single other one."""
    repeated = target.names.monotone
    return {name: values for name, values in target.quantities(x).items() if name not in repeated}


def posterior_contraction(
    target: AnswerPosterior, parameter: str, low: float, high: float
) -> float:
    """How much the answers narrow a parameter.

    Its posterior quantiles at 5 and 95 % are `low` and `high`.

    contraction = 1 - (posterior width / prior width)^2, widths from the 5 % to the 95 % quantile.
    For normal densities that is one minus the ratio of variances; where mu1 has a funnel its
    variance is ruled by rare far draws, its quantiles are not. 1: all from the data; 0: as wide as
    the prior; negative: wider.

    Examples
    --------
    >>> from bayes_toe.model.paper_model import paper_posterior
    >>> subject = Subject("S01", [0.0], [0.3], [20], [50])
    >>> round(posterior_contraction(paper_posterior(subject), "q0", 0.5, 0.59), 2)
    0.97
    """
    prior_low, prior_high = (target.prior_quantile(parameter, share) for share in RANGE)
    return 1.0 - ((high - low) / (prior_high - prior_low)) ** 2
