"""Scales on which single quantities are unconstrained: as they are, by their logarithm, by the logit of their share of a top."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from scipy.special import expit, logit

from bayes_toe.arrays import FloatArray
from bayes_toe.model.distributions import Distribution, Random, log_density_of_logit, sample_logit, slope_of_logit
from bayes_toe.model.probits import log_slope, logit_of_probit, probit_of_logit


class Scale(Protocol):
    """A bijection between a quantity and its coordinate, with the density that a distribution of the quantity has on it; any shape."""

    @property
    def prefix(self) -> str:
        """What the name of the coordinate begins with."""
        ...

    def quantity(self, x: FloatArray) -> FloatArray:
        """The quantity at coordinates."""
        ...

    def coordinate(self, t: FloatArray) -> FloatArray:
        """The coordinate of quantities."""
        ...

    def sample(self, distribution: Distribution, rng: Random, size: int) -> FloatArray:
        """Coordinates of independent draws of the quantity, shape (size,)."""
        ...

    def log_density(self, distribution: Distribution, x: FloatArray) -> FloatArray:
        """Log density with respect to the coordinate."""
        ...

    def slope(self, distribution: Distribution, x: FloatArray) -> FloatArray:
        """Its derivative."""
        ...

    def to_group(self, x: FloatArray) -> FloatArray:
        """Coordinates on the scale on which a group's members scatter about their mean: as they are, logarithms, or probits of a share."""
        ...

    def from_group(self, eta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The inverse: coordinates, and their derivative."""
        ...


@dataclass(frozen=True)
class Plain:
    """As it is."""

    prefix: ClassVar[str] = ""

    def quantity(self, x: FloatArray) -> FloatArray:
        """The same."""
        return x

    def coordinate(self, t: FloatArray) -> FloatArray:
        """The same."""
        return np.asarray(t)

    def sample(self, distribution: Distribution, rng: Random, size: int) -> FloatArray:
        """Draws of the quantity."""
        return distribution.sample(rng, size)

    def log_density(self, distribution: Distribution, x: FloatArray) -> FloatArray:
        """That of the quantity."""
        return distribution.log_density(x)

    def slope(self, distribution: Distribution, x: FloatArray) -> FloatArray:
        """That of the quantity."""
        return distribution.slope(x)

    def to_group(self, x: FloatArray) -> FloatArray:
        """The same."""
        return x

    def from_group(self, eta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same, slope 1."""
        return eta, np.ones_like(eta)


@dataclass(frozen=True)
class Log:
    """By the logarithm."""

    prefix: ClassVar[str] = "log_"

    def quantity(self, x: FloatArray) -> FloatArray:
        """Its exponential."""
        return np.exp(x)

    def coordinate(self, t: FloatArray) -> FloatArray:
        """Its logarithm."""
        return np.log(t)

    def sample(self, distribution: Distribution, rng: Random, size: int) -> FloatArray:
        """Logarithms of draws."""
        return np.log(distribution.sample(rng, size))

    def log_density(self, distribution: Distribution, x: FloatArray) -> FloatArray:
        """With log dt/dx = x."""
        with np.errstate(over="ignore"):  # beyond the largest float: the density is 0
            return np.asarray(distribution.log_density(np.exp(x)) + x)

    def slope(self, distribution: Distribution, x: FloatArray) -> FloatArray:
        """T f' + 1."""
        with np.errstate(over="ignore"):
            t = np.exp(x)
            return np.asarray(t * distribution.slope(t) + 1.0)

    def to_group(self, x: FloatArray) -> FloatArray:
        """The same."""
        return x

    def from_group(self, eta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same, slope 1."""
        return eta, np.ones_like(eta)


@dataclass(frozen=True)
class Logit:
    """By the logit of the share of the top."""

    top: float = 1.0
    prefix: ClassVar[str] = "logit_"

    def quantity(self, x: FloatArray) -> FloatArray:
        """The share of the top."""
        return np.asarray(self.top * expit(x))

    def coordinate(self, t: FloatArray) -> FloatArray:
        """The logit."""
        return np.asarray(logit(t / self.top))

    def sample(self, distribution: Distribution, rng: Random, size: int) -> FloatArray:
        """Logits of draws."""
        return sample_logit(distribution, rng, size, self.top)

    def log_density(self, distribution: Distribution, x: FloatArray) -> FloatArray:
        """With dt/dx = top expit(x) expit(-x)."""
        return log_density_of_logit(distribution, x, self.top)

    def slope(self, distribution: Distribution, x: FloatArray) -> FloatArray:
        """With d(log dt/dx)/dx = -tanh(x/2)."""
        return slope_of_logit(distribution, x, self.top)

    def to_group(self, x: FloatArray) -> FloatArray:
        """The probit of the share: uniform is standard normal, so that its edges are far away."""
        return probit_of_logit(x)

    def from_group(self, eta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The logit of the share."""
        x = logit_of_probit(eta)
        return x, np.exp(-log_slope(eta))
