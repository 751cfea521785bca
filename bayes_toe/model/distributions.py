"""Families of prior distributions: normalised densities with their slopes, quantiles and draws.

A prior names a family for every parameter (:class:`bayes_toe.model.prior.Prior`).
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.special import (
    betaincinv,
    betaln,
    erf,
    erfinv,
    expit,
    log_expit,
    logit,
    ndtr,
    ndtri,
    xlog1py,
    xlogy,
)

from bayes_toe.arrays import FloatArray

Random = np.random.Generator | np.random.RandomState

LOG_2PI = float(np.log(2.0 * np.pi))


class Distribution(Hashable, Protocol):
    """What a prior asks of the distribution of one parameter.

    A frozen record, its methods for arrays of any shape.
    """

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """Normalised log density; -inf outside the support, finite or a limit on its edges."""

    def slope(self, x: npt.ArrayLike) -> FloatArray:
        """Derivative of the log density, inside the support."""

    def quantile(self, p: npt.ArrayLike) -> FloatArray:
        """Inverse of the distribution function, 0 < p < 1."""

    def sample(self, rng: Random, size: int) -> FloatArray:
        """Independent draws, shape (size,)."""

    def describe(self) -> str:
        """Family and numbers, as in 'Normal(0, 10)'."""


@dataclass(frozen=True)
class Normal:
    """Normal distribution."""

    mean: float
    sd: float

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """-ln(2 pi)/2 - (x - mean)^2 / (2 sd^2) - ln sd."""
        with np.errstate(over="ignore"):  # a square beyond the largest float: the density is 0
            return np.asarray(
                -0.5 * (LOG_2PI + ((np.asarray(x, np.float64) - self.mean) / self.sd) ** 2)
                - np.log(self.sd)
            )

    def slope(self, x: npt.ArrayLike) -> FloatArray:
        """-(x - mean)/sd^2."""
        return np.asarray((self.mean - np.asarray(x, np.float64)) / self.sd**2)

    def quantile(self, p: npt.ArrayLike) -> FloatArray:
        """Inverse of the distribution function, 0 < p < 1."""
        return np.asarray(self.mean + self.sd * ndtri(p))

    def sample(self, rng: Random, size: int) -> FloatArray:
        """Independent draws, shape (size,)."""
        return rng.normal(self.mean, self.sd, size)

    def describe(self) -> str:
        """Family, mean and standard deviation."""
        return f"Normal({self.mean:g}, {self.sd:g})"


@dataclass(frozen=True)
class HalfNormal:
    """The absolute value of a normal of mean 0 and standard deviation `scale`; support x >= 0."""

    scale: float

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """-ln(pi/2)/2 - x^2 / (2 scale^2) - ln scale; -inf below 0."""
        points = np.asarray(x, np.float64)
        with np.errstate(over="ignore"):  # a square beyond the largest float: the density is 0
            inside = -0.5 * (np.log(np.pi / 2.0) + (points / self.scale) ** 2) - np.log(self.scale)
        return np.where(points < 0.0, -np.inf, inside)

    def slope(self, x: npt.ArrayLike) -> FloatArray:
        """-x/scale^2."""
        return np.asarray(-np.asarray(x, np.float64) / self.scale**2)

    def cdf(self, x: npt.ArrayLike) -> FloatArray:
        """Distribution function."""
        return np.asarray(erf(np.maximum(x, 0.0) / (self.scale * math.sqrt(2.0))))

    def quantile(self, p: npt.ArrayLike) -> FloatArray:
        """Inverse of the distribution function, 0 < p < 1."""
        return np.asarray(self.scale * math.sqrt(2.0) * erfinv(p))

    def sample(self, rng: Random, size: int) -> FloatArray:
        """Independent draws, shape (size,)."""
        return np.abs(rng.normal(0.0, self.scale, size))

    def describe(self) -> str:
        """Family and scale."""
        return f"HalfNormal({self.scale:g})"


@dataclass(frozen=True)
class Uniform:
    """Uniform distribution over 0 <= x <= top."""

    top: float = 1.0

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """-ln top, edges included; -inf outside."""
        points = np.asarray(x, np.float64)
        inside = np.where(np.isnan(points), np.nan, -np.log(self.top))
        return np.where((points < 0.0) | (points > self.top), -np.inf, inside)

    def slope(self, x: npt.ArrayLike) -> FloatArray:
        """Zeros."""
        return np.zeros(np.shape(x))

    def quantile(self, p: npt.ArrayLike) -> FloatArray:
        """Inverse of the distribution function, 0 < p < 1."""
        return np.asarray(self.top * np.asarray(p))

    def sample(self, rng: Random, size: int) -> FloatArray:
        """Independent draws, shape (size,)."""
        return rng.uniform(0.0, self.top, size)

    def describe(self) -> str:
        """Family and range."""
        return f"Uniform(0, {self.top:g})"


@dataclass(frozen=True)
class Beta:
    """Beta distribution over 0 <= x <= 1, density in proportion to x^(a-1) (1-x)^(b-1)."""

    a: float
    b: float

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """(a - 1) ln x + (b - 1) ln(1 - x) - ln B(a, b), limits on the edges; -inf outside."""
        points = np.asarray(x, np.float64)
        outside = (points < 0.0) | (points > 1.0)
        inside = np.where(outside, 0.5, points)
        return np.where(
            outside,
            -np.inf,
            xlogy(self.a - 1.0, inside) + xlog1py(self.b - 1.0, -inside) - betaln(self.a, self.b),
        )

    def log_density_of_logs(self, log_x: FloatArray, log_rest: FloatArray) -> FloatArray:
        """:meth:`log_density` from ln x and ln(1 - x), where x is too near an edge for a float to tell."""
        return np.asarray(
            (self.a - 1.0) * log_x + (self.b - 1.0) * log_rest - betaln(self.a, self.b)
        )

    def slope(self, x: npt.ArrayLike) -> FloatArray:
        """(a - 1)/x - (b - 1)/(1 - x)."""
        points = np.asarray(x, np.float64)
        return np.asarray((self.a - 1.0) / points - (self.b - 1.0) / (1.0 - points))

    def quantile(self, p: npt.ArrayLike) -> FloatArray:
        """Inverse of the distribution function, 0 < p < 1."""
        return np.asarray(betaincinv(self.a, self.b, p))

    def sample(self, rng: Random, size: int) -> FloatArray:
        """Independent draws, shape (size,)."""
        return rng.beta(self.a, self.b, size)

    def sample_logit(self, rng: Random, size: int) -> FloatArray:
        """Logits of independent draws, shape (size,), however near an edge: x/(1 - x) is a ratio of gamma variates.

        Of shape a such a variate is one of shape a + 1 times U^(1/a), and -ln U is exponential; in
        logs nothing underflows.
        """
        above, below = (
            np.log(rng.standard_gamma(k + 1.0, size)) - rng.standard_exponential(size) / k
            for k in (self.a, self.b)
        )
        return np.asarray(above - below)

    def describe(self) -> str:
        """Family, a and b."""
        return f"Beta({self.a:g}, {self.b:g})"


def share(a: float, b: float) -> Uniform | Beta:
    """Beta(a, b), by its better known name where it is uniform."""
    return Uniform() if a == b == 1.0 else Beta(a, b)


@dataclass(frozen=True)
class LogNormal:
    """Distribution over x > 0 whose logarithm is normal with mean ln median and standard deviation `sd`."""

    median: float
    sd: float

    @property
    def of_log(self) -> Normal:
        """Distribution of the logarithm."""
        return Normal(math.log(self.median), self.sd)

    def _score(self, x: npt.ArrayLike) -> FloatArray:
        """Z = ln(x/median)/sd, -inf from 0 downward."""
        with np.errstate(divide="ignore"):
            return np.asarray((np.log(np.maximum(x, 0.0)) - np.log(self.median)) / self.sd)

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """-z (z/2 + sd) - ln(median sd) - ln(2 pi)/2 with z = ln(x/median)/sd; -inf from 0 downward."""
        z = self._score(x)
        return np.asarray(-z * (0.5 * z + self.sd) - np.log(self.median * self.sd) - 0.5 * LOG_2PI)

    def slope(self, x: npt.ArrayLike) -> FloatArray:
        """-(1 + z/sd)/x."""
        return np.asarray(-(1.0 + self._score(x) / self.sd) / np.asarray(x, np.float64))

    def cdf(self, x: npt.ArrayLike) -> FloatArray:
        """Distribution function."""
        return np.asarray(ndtr(self._score(x)))

    def quantile(self, p: npt.ArrayLike) -> FloatArray:
        """Inverse of the distribution function, 0 < p < 1."""
        return np.asarray(self.median * np.exp(self.sd * ndtri(p)))

    def sample(self, rng: Random, size: int) -> FloatArray:
        """Independent draws, shape (size,)."""
        return self.median * np.exp(rng.normal(0.0, self.sd, size))

    def describe(self) -> str:
        """Family, median and standard deviation of the logarithm."""
        return f"LogNormal({self.median:g}, {self.sd:g})"


# --- The same distributions on the scale of a coordinate ----------------------------------------


def log_density_of_log(distribution: Distribution, x: FloatArray) -> FloatArray:
    """Log density of the logarithm x of a quantity, with respect to x."""
    if isinstance(distribution, LogNormal):
        return distribution.of_log.log_density(x)
    with np.errstate(over="ignore"):  # beyond the largest float the density is 0
        return np.asarray(distribution.log_density(np.exp(x)) + x)


def slope_of_log(distribution: Distribution, x: FloatArray) -> FloatArray:
    """Derivative of :func:`log_density_of_log` in x."""
    if isinstance(distribution, LogNormal):
        return distribution.of_log.slope(x)
    with np.errstate(over="ignore"):
        value = np.exp(x)
        return np.asarray(value * distribution.slope(value) + 1.0)


def log_density_of_logit(distribution: Distribution, x: FloatArray) -> FloatArray:
    """Log density of the logit x of a share, with respect to x."""
    log_share, log_rest = log_expit(x), log_expit(-x)
    if isinstance(distribution, Beta):
        density = distribution.log_density_of_logs(log_share, log_rest)
    else:
        density = distribution.log_density(expit(x))
    return np.asarray(density + log_share + log_rest)


def slope_of_logit(distribution: Distribution, x: FloatArray) -> FloatArray:
    """Derivative of :func:`log_density_of_logit` in x."""
    share, rest = expit(x), expit(-x)
    if isinstance(distribution, Beta):
        return np.asarray(distribution.a * rest - distribution.b * share)
    return np.asarray(distribution.slope(share) * share * rest - np.tanh(0.5 * x))


def sample_logits(distribution: Distribution, rng: Random, size: int) -> FloatArray:
    """Logits of independent draws of a share, shape (size,)."""
    if isinstance(distribution, Beta) and min(distribution.a, distribution.b) < 1.0:
        return distribution.sample_logit(rng, size)
    return np.asarray(logit(distribution.sample(rng, size)))
