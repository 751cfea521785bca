"""Families of prior distributions: normalised densities with derivatives, distribution function, quantiles and draws.

A prior names a family for every parameter (:class:`bayes_toe.model.prior.Prior`); whatever meets :class:`Distribution` will do.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.special import erf, erfinv, expit, log_expit, ndtr, ndtri

from bayes_toe.arrays import FloatArray

Random = np.random.Generator | np.random.RandomState

LOG_2PI = float(np.log(2.0 * np.pi))


class Distribution(Hashable, Protocol):
    """What a prior asks of the distribution of one parameter: a frozen record, its methods for arrays of any shape."""

    @property
    def spread(self) -> float:
        """Standard deviation, in the parameter's unit."""
        ...

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """Normalised log density; -inf outside the support, finite or a limit on its edges."""
        ...

    def derivatives(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """First and second derivative of the log density, inside the support."""
        ...

    def cdf(self, x: npt.ArrayLike) -> FloatArray:
        """Distribution function."""
        ...

    def quantile(self, p: npt.ArrayLike) -> FloatArray:
        """Inverse of the distribution function, 0 < p < 1."""
        ...

    def sample(self, rng: Random, size: int) -> FloatArray:
        """Independent draws, shape (size,)."""
        ...

    def describe(self) -> str:
        """Family and numbers, as in 'Normal(0, 10)'."""
        ...


@dataclass(frozen=True)
class Normal:
    """Normal distribution.

    Examples
    --------
    >>> Normal(0.0, 10.0).describe(), round(float(Normal(0.0, 10.0).quantile(0.95)), 4)
    ('Normal(0, 10)', 16.4485)
    """

    mean: float
    sd: float

    @property
    def spread(self) -> float:
        """Standard deviation."""
        return self.sd

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """-ln(2 pi)/2 - (x - mean)^2 / (2 sd^2) - ln sd."""
        with np.errstate(over="ignore"):  # a square beyond the largest float: the density is 0
            return np.asarray(-0.5 * (LOG_2PI + ((np.asarray(x, np.float64) - self.mean) / self.sd) ** 2) - np.log(self.sd))

    def derivatives(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """-(x - mean)/sd^2 and -1/sd^2."""
        points = np.asarray(x, np.float64)
        return np.asarray(-(points - self.mean) / self.sd**2), np.full(points.shape, -1.0 / self.sd**2)

    def cdf(self, x: npt.ArrayLike) -> FloatArray:
        """Phi((x - mean)/sd)."""
        return np.asarray(ndtr((np.asarray(x, np.float64) - self.mean) / self.sd))

    def quantile(self, p: npt.ArrayLike) -> FloatArray:
        """Mean plus sd Phi^-1(p)."""
        return np.asarray(self.mean + self.sd * ndtri(p))

    def sample(self, rng: Random, size: int) -> FloatArray:
        """Independent draws, shape (size,)."""
        return rng.normal(self.mean, self.sd, size)

    def describe(self) -> str:
        """Family, mean and standard deviation."""
        return f"Normal({self.mean:g}, {self.sd:g})"


@dataclass(frozen=True)
class HalfNormal:
    """The absolute value of a normal of mean 0 and standard deviation `scale`; support x >= 0.

    Examples
    --------
    >>> HalfNormal(1.0).describe(), round(float(HalfNormal(1.0).quantile(0.95)), 4)
    ('HalfNormal(1)', 1.96)
    """

    scale: float

    @property
    def spread(self) -> float:
        """Standard deviation, scale (1 - 2/pi)^(1/2)."""
        return self.scale * float(np.sqrt(1.0 - 2.0 / np.pi))

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """-ln(pi/2)/2 - x^2 / (2 scale^2) - ln scale; -inf below 0."""
        points = np.asarray(x, np.float64)
        with np.errstate(over="ignore"):  # a square beyond the largest float: the density is 0
            inside = -0.5 * (np.log(np.pi / 2.0) + (points / self.scale) ** 2) - np.log(self.scale)
        return np.where(points < 0.0, -np.inf, inside)

    def derivatives(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """-x/scale^2 and -1/scale^2."""
        points = np.asarray(x, np.float64)
        return np.asarray(-points / self.scale**2), np.full(points.shape, -1.0 / self.scale**2)

    def cdf(self, x: npt.ArrayLike) -> FloatArray:
        """erf(x / (2^(1/2) scale)), 0 below 0."""
        return np.asarray(erf(np.maximum(x, 0.0) / (np.sqrt(2.0) * self.scale)))

    def quantile(self, p: npt.ArrayLike) -> FloatArray:
        """2^(1/2) scale erf^-1(p)."""
        return np.asarray(self.scale * (np.sqrt(2.0) * erfinv(p)))

    def sample(self, rng: Random, size: int) -> FloatArray:
        """Independent draws, shape (size,)."""
        return np.abs(rng.normal(0.0, self.scale, size))

    def describe(self) -> str:
        """Family and scale."""
        return f"HalfNormal({self.scale:g})"


@dataclass(frozen=True)
class Uniform:
    """Uniform distribution over 0 <= x <= top.

    Examples
    --------
    >>> Uniform().describe(), float(Uniform().quantile(0.25)), Uniform(2.0).log_density([1.0, 3.0]).round(4).tolist()
    ('Uniform(0, 1)', 0.25, [-0.6931, -inf])
    """

    top: float = 1.0

    @property
    def spread(self) -> float:
        """Standard deviation, top / 12^(1/2)."""
        return self.top / float(np.sqrt(12.0))

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """-ln top, edges included; -inf outside."""
        points = np.asarray(x, np.float64)
        inside = np.where(np.isnan(points), np.nan, -np.log(self.top))
        return np.where((points < 0.0) | (points > self.top), -np.inf, inside)

    def derivatives(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Zeros."""
        shape = np.shape(x)
        return np.zeros(shape), np.zeros(shape)

    def cdf(self, x: npt.ArrayLike) -> FloatArray:
        """The share x / top, from 0 to 1."""
        return np.clip(np.asarray(x, np.float64) / self.top, 0.0, 1.0)

    def quantile(self, p: npt.ArrayLike) -> FloatArray:
        """The share p of top."""
        return np.asarray(self.top * np.asarray(p, np.float64))

    def sample(self, rng: Random, size: int) -> FloatArray:
        """Independent draws, shape (size,)."""
        return rng.uniform(0.0, self.top, size)

    def describe(self) -> str:
        """Family and range."""
        return f"Uniform(0, {self.top:g})"


def log_density_of_logit(distribution: Distribution, logits: FloatArray, top: float = 1.0) -> FloatArray:
    """Log density of logit(t / top) where t has this distribution on 0..top, shape (...)."""
    of_quantity = distribution.log_density(top * expit(logits)) + np.log(top)
    return np.asarray(of_quantity + log_expit(logits) + log_expit(-logits))
