"""The densities of coordinates: the prior of every coordinate of every model is here.

A score is the standard normal quantile of the probability that the prior gives to smaller values. A
coordinate that is a score has the density :class:`StandardNormal`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import (
    betaincinv,
    betaln,
    erf,
    erfcx,
    erfinv,
    expit,
    log_expit,
    log_ndtr,
    ndtr,
    ndtri,
    ndtri_exp,
    stdtrit,
)

from bayes_toe.arrays import FloatArray
from bayes_toe.model.paper_equations import LN2

LOG_2PI = float(np.log(2.0 * np.pi))
#: Below this score P = Phi(score) is so small that the half-normal quantile is P sqrt(pi/2).
_LOWEST_SCORE = -20.0


def log_normal_density(u: FloatArray) -> FloatArray:
    """Log of the standard normal density, -u^2/2 - ln(2 pi)/2."""
    return -0.5 * (np.square(u) + LOG_2PI)


@dataclass(frozen=True)
class StandardNormal:
    """Normal(0, 1)."""

    def log_density(self, u: FloatArray) -> FloatArray:
        """-u^2/2 - ln(2 pi)/2."""
        return log_normal_density(u)

    def slope(self, u: FloatArray) -> FloatArray:
        """-u."""
        return -u

    def curvature(self, u: FloatArray) -> FloatArray:
        """1."""
        return np.ones_like(u)

    def quantile(self, probability: FloatArray) -> FloatArray:
        """Inverse of the distribution function."""
        return ndtri(probability)


@dataclass(frozen=True)
class StandardStudent:
    """Student's t with 3 degrees of freedom and scale 1."""

    def log_density(self, u: FloatArray) -> FloatArray:
        """ln(2 / (pi sqrt 3)) - 2 ln(1 + u^2 / 3)."""
        log_norm = np.log(2.0 / (np.pi * np.sqrt(3.0)))
        return log_norm - 2.0 * np.log1p(np.square(u) / 3.0)

    def slope(self, u: FloatArray) -> FloatArray:
        """-4 u / (3 + u^2)."""
        return -4.0 * u / (3.0 + np.square(u))

    def curvature(self, u: FloatArray) -> FloatArray:
        """4 / (3 + u^2), the weight of a normal that touches the density from below."""
        return 4.0 / (3.0 + np.square(u))

    def quantile(self, probability: FloatArray) -> FloatArray:
        """Inverse of the distribution function."""
        # SciPy gives +inf at a probability of 0.
        return np.where(probability == 0.0, -np.inf, stdtrit(3.0, probability))


@dataclass(frozen=True)
class CutNormal(StandardNormal):
    """Normal(0, 1) on (-limit, limit); `limit` may be an array that broadcasts with u."""

    limit: FloatArray | float

    def log_density(self, u: FloatArray) -> FloatArray:
        """Log density of the normal over its mass inside; -inf outside."""
        log_mass = np.log1p(-2.0 * ndtr(-self.limit))
        return np.where(np.abs(u) < self.limit, log_normal_density(u) - log_mass, -np.inf)

    def quantile(self, probability: FloatArray) -> FloatArray:
        """Inverse of the distribution function."""
        mass_below = ndtr(-self.limit)  # of the normal without limits; as much is above
        return ndtri(mass_below + probability * (1.0 - 2.0 * mass_below))


@dataclass(frozen=True)
class LogitOfBeta:
    """The logit of a share with the distribution Beta(a, b)."""

    a: float
    b: float

    def log_density(self, u: FloatArray) -> FloatArray:
        """Log of q^a (1 - q)^b / B(a, b), with respect to the logit."""
        return self.a * log_expit(u) + self.b * log_expit(-u) - betaln(self.a, self.b)

    def slope(self, u: FloatArray) -> FloatArray:
        """Derivative of `log_density`, a (1 - q) - b q."""
        return self.a * expit(-u) - self.b * expit(u)

    def curvature(self, u: FloatArray) -> FloatArray:
        """(a + b) q (1 - q)."""
        return (self.a + self.b) * expit(u) * expit(-u)

    def quantile(self, probability: FloatArray) -> FloatArray:
        """Inverse of the distribution function, finite also where the share rounds to 0 or 1.

        logit q = ln q - ln(1 - q), and 1 - q has the distribution Beta(b, a).
        """
        log_share = _log_beta_quantile(self.a, self.b, probability)
        return log_share - _log_beta_quantile(self.b, self.a, 1.0 - probability)


@dataclass(frozen=True)
class ProbitOfBeta:
    """The probit v of a share with the distribution Beta(a, b): the share is Phi(v).

    If the data do not determine the share, its posterior has normal tails in v.
    """

    a: float
    b: float

    def log_density(self, u: FloatArray) -> FloatArray:
        """Log of phi(v) Phi(v)^(a - 1) Phi(-v)^(b - 1) / B(a, b)."""
        log_norm = betaln(self.a, self.b) + 0.5 * LOG_2PI
        log_shares = (self.a - 1.0) * log_ndtr(u) + (self.b - 1.0) * log_ndtr(-u)
        return log_shares - 0.5 * np.square(u) - log_norm

    def slope(self, u: FloatArray) -> FloatArray:
        """Derivative of `log_density`; ln Phi(v) has the derivative phi(v) / Phi(v)."""
        return (self.a - 1.0) * normal_hazard(-u) - (self.b - 1.0) * normal_hazard(u) - u

    def curvature(self, u: FloatArray) -> FloatArray:
        """The negative second derivative, without the terms that are negative for a, b < 1."""
        lower_hazard = normal_hazard(-u)
        upper_hazard = normal_hazard(u)
        share_term = max(self.a - 1.0, 0.0) * lower_hazard * (lower_hazard + u)
        complement_term = max(self.b - 1.0, 0.0) * upper_hazard * (upper_hazard - u)
        return 1.0 + share_term + complement_term

    def quantile(self, probability: FloatArray) -> FloatArray:
        """Inverse of the distribution function, finite also where the share rounds to 0 or 1."""
        return probit_of_logit(LogitOfBeta(self.a, self.b).quantile(probability))


#: The prior of a coordinate u, for arrays of any shape. `log_density` is normalised, and `slope` is
#: its derivative. `curvature` is a positive stand-in for its negative second derivative, for Fisher
#: scoring. `quantile` is the inverse of the distribution function.
PriorDensity = StandardNormal | StandardStudent | LogitOfBeta | ProbitOfBeta
#: The prior of every coordinate, in their order.
Priors = tuple[PriorDensity, ...]


def by_coordinate(
    priors: Priors, method: Literal["log_density", "slope", "curvature", "quantile"], u: FloatArray
) -> FloatArray:
    """The values of a method of the prior of every coordinate, (..., k) -> (..., k)."""
    columns = [getattr(density, method)(u[..., j]) for j, density in enumerate(priors)]
    return np.stack(columns, axis=-1)


def normal_hazard(u: FloatArray) -> FloatArray:
    """phi(u) / Phi(-u), by Mills' ratio Phi(-u) / phi(u) = sqrt(pi/2) erfcx(u / sqrt(2)).

    Examples
    --------
    >>> normal_hazard(np.array([-40.0, 0.0, 1e8])).round(4).tolist()
    [0.0, 0.7979, 100000000.0]
    """
    return np.sqrt(2.0 / np.pi) / erfcx(u * np.sqrt(0.5))


def probit_of_logit(logits: FloatArray) -> FloatArray:
    """Standard normal quantile of expit(logit), by the smaller tail, which keeps its digits."""
    return np.sign(logits) * -ndtri_exp(log_expit(-np.abs(logits)))


def _log_beta_quantile(a: float, b: float, probability: FloatArray) -> FloatArray:
    """Log of the quantile of Beta(a, b), finite also where the quantile is too small for a float.

    Up to 1e-200, it follows from the distribution function of a small x, x^a / (a B(a, b)).
    """
    quantile = betaincinv(a, b, probability)
    with np.errstate(divide="ignore"):
        log_of_small = (np.log(probability) + np.log(a) + betaln(a, b)) / a
        return np.where(quantile > 1e-200, np.log(quantile), log_of_small)


def half_normal_quantile(probability: FloatArray, log_complement: FloatArray) -> FloatArray:
    """The quantile u >= 0 with 2 Phi(u) - 1 = P, from P and ln(1 - P).

    A small P and a small 1 - P each have all their digits, so that u is accurate in both tails.
    """
    # 2 Phi(u) - 1 = erf(u / 2^(1/2)), and ln Phi(-u) = ln((1 - P) / 2).
    from_probability = np.sqrt(2.0) * erfinv(probability)
    from_complement = -ndtri_exp(log_complement - LN2)
    return np.where(probability < 0.5, from_probability, from_complement)


def from_half_normal_score(score: FloatArray) -> FloatArray:
    """The u >= 0 with 2 Phi(u) - 1 = Phi(score), accurate in both tails.

    Examples
    --------
    >>> from_half_normal_score(np.array([-10.0, 0.0, 10.0])).round(4).tolist()
    [0.0, 0.6745, 10.0684]
    """
    return half_normal_quantile(ndtr(score), log_ndtr(-score))


def half_normal_score(u: FloatArray) -> FloatArray:
    """Inverse of :func:`from_half_normal_score`, from the smaller of P and 1 - P."""
    probability = erf(u * np.sqrt(0.5))  # 2 Phi(u) - 1
    log_complement = log_ndtr(-u) + LN2
    return np.where(probability < 0.5, ndtri(probability), -ndtri_exp(log_complement))


def log_half_normal_value(score: FloatArray) -> FloatArray:
    """Log of :func:`from_half_normal_score`, finite also where the value is too small for a float.

    Examples
    --------
    >>> log_half_normal_value(np.array([-100.0, 0.0])).round(4).tolist()
    [-5005.2984, -0.3938]
    """
    # At lower scores, u might be 0, whose logarithm is not finite.
    u = from_half_normal_score(np.maximum(score, _LOWEST_SCORE))
    log_of_small = log_ndtr(score) + 0.5 * np.log(0.5 * np.pi)  # u = P (pi/2)^(1/2)
    return np.where(score > _LOWEST_SCORE, np.log(u), log_of_small)


def log_half_normal_slope(score: FloatArray) -> FloatArray:
    """Derivative of :func:`log_half_normal_value`: phi(score) / (2 phi(u) u).

    With 2 Phi(-u) = Phi(-score), the slope is the ratio of two hazards over u. Where u is
    proportional to P = Phi(score), the slope is the derivative of ln P.
    """
    raised_score = np.maximum(score, _LOWEST_SCORE)  # at lower scores, u might be 0
    u = from_half_normal_score(raised_score)
    slope = normal_hazard(raised_score) / (normal_hazard(u) * u)
    return np.where(score > _LOWEST_SCORE, slope, normal_hazard(-score))
