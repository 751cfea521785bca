"""The families of the prior of the paper's model (H1): normal, half-normal, beta and lognormal.

Each has a normalised log density, quantiles and random draws. :class:`bayes_toe.model.prior.Prior`
names a family for every parameter. The densities of the observer's prior are in
:mod:`bayes_toe.model.parameters`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import (
    betaincinv,
    betaln,
    erf,
    erfinv,
    logit,
    ndtr,
    ndtri,
)

from bayes_toe.arrays import AnyRng, FloatArray

LOG_2PI = float(np.log(2.0 * np.pi))


@dataclass(frozen=True)
class Normal:
    """Normal distribution."""

    mean: float
    sd: float

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """-ln(2 pi)/2 - (x - mean)^2 / (2 sd^2) - ln sd."""
        with np.errstate(over="ignore"):  # a square beyond the largest float: the density is 0
            score = (np.asarray(x, np.float64) - self.mean) / self.sd
            return -0.5 * (LOG_2PI + score**2) - np.log(self.sd)

    def slope(self, x: npt.ArrayLike) -> FloatArray:
        """-(x - mean)/sd^2."""
        return (self.mean - np.asarray(x, np.float64)) / self.sd**2

    def quantile(self, p: npt.ArrayLike) -> FloatArray:
        """Inverse of the distribution function, 0 < p < 1."""
        return self.mean + self.sd * ndtri(p)

    def sample(self, rng: AnyRng, size: int) -> FloatArray:
        """Independent draws, shape (size,)."""
        return rng.normal(self.mean, self.sd, size)


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

    def log_density_of_log(self, log_x: FloatArray) -> FloatArray:
        """Log density of the logarithm of x, with respect to it."""
        with np.errstate(over="ignore"):  # beyond the largest float the density is 0
            return self.log_density(np.exp(log_x)) + log_x

    def slope_of_log(self, log_x: FloatArray) -> FloatArray:
        """Derivative of :meth:`log_density_of_log`, 1 - x^2/scale^2."""
        with np.errstate(over="ignore"):
            x = np.exp(log_x)
            return x * (-x / self.scale**2) + 1.0

    def cdf(self, x: npt.ArrayLike) -> FloatArray:
        """Distribution function."""
        return erf(np.maximum(x, 0.0) / (self.scale * math.sqrt(2.0)))

    def quantile(self, p: npt.ArrayLike) -> FloatArray:
        """Inverse of the distribution function, 0 < p < 1."""
        return self.scale * math.sqrt(2.0) * erfinv(p)

    def sample(self, rng: AnyRng, size: int) -> FloatArray:
        """Independent draws, shape (size,)."""
        return np.abs(rng.normal(0.0, self.scale, size))


@dataclass(frozen=True)
class Beta:
    """Beta distribution over 0 <= x <= 1, density in proportion to x^(a-1) (1-x)^(b-1)."""

    a: float
    b: float

    def log_density_of_logs(self, log_x: FloatArray, log_complement: FloatArray) -> FloatArray:
        """Log density from ln x and ln(1 - x), which stay finite where x rounds to 0 or 1."""
        total = np.full(log_x.shape, -betaln(self.a, self.b))
        for exponent, values in ((self.a - 1.0, log_x), (self.b - 1.0, log_complement)):
            if exponent != 0.0:  # 0 times an infinite logarithm is 0
                total += exponent * values
        return total

    def quantile(self, p: npt.ArrayLike) -> FloatArray:
        """Inverse of the distribution function, 0 < p < 1."""
        return betaincinv(self.a, self.b, p)

    def sample(self, rng: AnyRng, size: int) -> FloatArray:
        """Independent draws, shape (size,)."""
        if self._is_uniform:
            return rng.uniform(0.0, 1.0, size)
        return rng.beta(self.a, self.b, size)

    def sample_logits(self, rng: AnyRng, size: int) -> FloatArray:
        """Logits of independent draws, shape (size,), finite also where draws round to an edge.

        x/(1 - x) is a ratio of gamma variates. Of shape a such a variate is one of shape a + 1
        times U^(1/a), and -ln U is exponential; in logs nothing underflows.
        """
        if min(self.a, self.b) >= 1.0:
            return logit(self.sample(rng, size))
        log_ratio = np.zeros(size)
        for sign, shape in ((1.0, self.a), (-1.0, self.b)):
            log_variate = np.log(rng.standard_gamma(shape + 1.0, size))
            log_ratio += sign * (log_variate - rng.standard_exponential(size) / shape)
        return log_ratio

    @property
    def _is_uniform(self) -> bool:
        return self.a == self.b == 1.0


@dataclass(frozen=True)
class LogNormal:
    """Distribution over x > 0 whose logarithm is Normal(ln median, sd)."""

    median: float
    sd: float

    def log_density_of_log(self, log_x: FloatArray) -> FloatArray:
        """Log density of the logarithm of x, with respect to it."""
        return self._normal.log_density(log_x)

    def slope_of_log(self, log_x: FloatArray) -> FloatArray:
        """Derivative of :meth:`log_density_of_log`."""
        return self._normal.slope(log_x)

    @property
    def _normal(self) -> Normal:
        """Distribution of the logarithm."""
        return Normal(math.log(self.median), self.sd)

    def _score(self, x: npt.ArrayLike) -> FloatArray:
        """Z = ln(x/median)/sd, -inf for x <= 0."""
        with np.errstate(divide="ignore"):
            return (np.log(np.maximum(x, 0.0)) - np.log(self.median)) / self.sd

    def cdf(self, x: npt.ArrayLike) -> FloatArray:
        """Distribution function."""
        return ndtr(self._score(x))

    def quantile(self, p: npt.ArrayLike) -> FloatArray:
        """Inverse of the distribution function, 0 < p < 1."""
        return self.median * np.exp(self.sd * ndtri(p))

    def sample(self, rng: AnyRng, size: int) -> FloatArray:
        """Independent draws, shape (size,)."""
        return self.median * np.exp(rng.normal(0.0, self.sd, size))


#: The distribution of one parameter of a prior.
Distribution = Normal | HalfNormal | Beta | LogNormal
