"""The prior over one observer's parameters: proper, stated, replaceable. The evidence depends on it.

mu1 ~ Normal(mu1_mean, mu1_sd), sigma_p ~ HalfNormal(sigma_p_scale), gamma ~ Uniform(0, 1), q0 ~ Uniform(0, 1), independent.
The defaults are the paper's V_1 = 10^2 for mu1 and its constraint 0 < sigma_l < sigma_p; q0 has the prior that each frequency
has under H0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import expit

from bayes_toe.arrays import FloatArray
from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import MAX_PULL
from bayes_toe.model.coordinates import Natural, inverse_pull, log_jacobian, natural, reach, unconstrained

LOG_2PI = float(np.log(2.0 * np.pi))


@dataclass(frozen=True)
class Prior:
    """Prior density of (mu1, sigma_p, gamma, q0); all log densities are normalised.

    Parameters
    ----------
    mu1_mean, mu1_sd : float
        Mean and standard deviation of mu1, natural-log intensity.
    sigma_p_scale : float
        Scale of the half-normal of sigma_p, natural-log intensity.

    Raises
    ------
    InputError
        If a value is not finite or a scale is not positive.

    Examples
    --------
    >>> Prior().describe()
    'mu1 ~ Normal(0, 10), sigma_p ~ HalfNormal(1), gamma ~ Uniform(0, 1), q0 ~ Uniform(0, 1)'
    """

    mu1_mean: float = 0.0
    mu1_sd: float = 10.0
    sigma_p_scale: float = 1.0

    def __post_init__(self) -> None:
        if not np.isfinite([self.mu1_mean, self.mu1_sd, self.sigma_p_scale]).all():
            raise InputError("prior: every value must be a finite number")
        if self.mu1_sd <= 0 or self.sigma_p_scale <= 0:
            raise InputError("prior: mu1_sd and sigma_p_scale must be positive")

    def describe(self) -> str:
        """One line for tables, files and Methods sections."""
        return f"{self.describe_mu1()}, sigma_p ~ HalfNormal({self.sigma_p_scale:g}), gamma ~ Uniform(0, 1), q0 ~ Uniform(0, 1)"

    def describe_mu1(self) -> str:
        """The normal of mu1 alone, which is the penalty of a maximum-likelihood fit."""
        return f"mu1 ~ Normal({self.mu1_mean:g}, {self.mu1_sd:g})"

    def log_density(self, theta: Natural) -> FloatArray:
        """Log density with respect to (mu1, sigma_p, gamma, q0); -inf outside the support."""
        inside = (theta.sigma_p > 0) & (theta.gamma > 0) & (theta.gamma < 1) & (theta.q0 > 0) & (theta.q0 < 1)
        return np.where(inside, self._log_normals(theta.mu1, theta.sigma_p), -np.inf)

    def log_density_variances(self, theta: Natural) -> FloatArray:
        """Log density with respect to the paper's coordinates (mu1, sigma_p^2, sigma_l^2, q0), edges included; -inf outside.

        d sigma_p / d sigma_p^2 = 1 / (2 sigma_p) and, at fixed sigma_p, d gamma / d sigma_l^2 = 1 / sigma_p^2. Source: Appendix C.
        """
        inside = (theta.sigma_p > 0) & (theta.gamma >= 0) & (theta.gamma <= 1) & (theta.q0 >= 0) & (theta.q0 <= 1)
        volume = -np.log(2.0) - 3.0 * np.log(theta.sigma_p)
        return np.where(inside, self._log_normals(theta.mu1, theta.sigma_p) + volume, -np.inf)

    def log_density_unconstrained(self, x: npt.ArrayLike, sbar: float) -> FloatArray:
        """Log density with respect to the unconstrained coordinates x, shape (..., 4) -> (...)."""
        points = np.asarray(x, np.float64)
        with np.errstate(over="ignore"):  # mu1 or its square beyond the largest float: the density is 0 there
            theta = natural(points, sbar)
            return self._log_normals(theta.mu1, theta.sigma_p) + log_jacobian(points)

    def _log_normals(self, mu1: FloatArray, sigma_p: FloatArray) -> FloatArray:
        of_mu1 = -0.5 * (LOG_2PI + ((mu1 - self.mu1_mean) / self.mu1_sd) ** 2) - np.log(self.mu1_sd)
        of_sigma = -0.5 * (np.log(np.pi / 2.0) + (sigma_p / self.sigma_p_scale) ** 2) - np.log(self.sigma_p_scale)
        return np.asarray(of_mu1 + of_sigma)

    def derivatives(self, x: npt.ArrayLike, sbar: float) -> tuple[FloatArray, FloatArray]:
        """Gradient (..., 4) and Hessian (..., 4, 4) of :meth:`log_density_unconstrained`."""
        points = np.asarray(x, np.float64)
        gradient, hessian = jacobian_derivatives(points)
        with np.errstate(over="ignore"):  # 1/p^2 is beyond the largest float where p < 1e-154: infinite is right there
            for part in (self._mu1_derivatives(points, sbar), self._sigma_p_derivatives(points)):
                gradient += part[0]
                hessian += part[1]
        return gradient, hessian

    def _mu1_derivatives(self, x: FloatArray, sbar: float) -> tuple[FloatArray, FloatArray]:
        """Derivatives of -(mu1 - mean)^2 / (2 sd^2) with mu1 = sbar + c/p, d(1/p)/da = -expit(-a)/p."""
        fall, inverse, far = expit(-x[..., 1]), inverse_pull(x[..., 1]), reach(x)
        first = np.stack([inverse, -far * fall], -1)
        second = np.stack([np.stack([np.zeros_like(far), -fall * inverse], -1), np.stack([-fall * inverse, far * fall], -1)], -2)
        score = (sbar - self.mu1_mean + far) / self.mu1_sd**2
        gradient, hessian = _zeros(x)
        gradient[..., :2] = -score[..., None] * first
        steep = first / self.mu1_sd
        hessian[..., :2, :2] = -steep[..., :, None] * steep[..., None, :] - score[..., None, None] * second
        return gradient, hessian

    def _sigma_p_derivatives(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives of -sigma_p^2 / (2 scale^2) with log sigma_p = b + 1.5 log(1 - p)."""
        slope, bend = log_sigma_p_derivatives(x[..., 1])
        y = (np.exp(x[..., 2]) * (1.0 - MAX_PULL * expit(x[..., 1])) ** 1.5 / self.sigma_p_scale) ** 2
        gradient, hessian = _zeros(x)
        gradient[..., 1], gradient[..., 2] = -y * slope, -y
        hessian[..., 1, 1], hessian[..., 2, 2] = -y * (2.0 * slope**2 + bend), -2.0 * y
        hessian[..., 1, 2] = hessian[..., 2, 1] = -2.0 * y * slope
        return gradient, hessian

    def sample(self, rng: np.random.Generator | np.random.RandomState, size: int) -> Natural:
        """Independent draws, each array of shape (size,).

        Examples
        --------
        >>> Prior().sample(np.random.default_rng(1), 3).q0.shape
        (3,)
        """
        mu1 = rng.normal(self.mu1_mean, self.mu1_sd, size)
        sigma_p = np.abs(rng.normal(0.0, self.sigma_p_scale, size))
        gamma, q0 = rng.uniform(size=size), rng.uniform(size=size)
        return Natural(mu1, sigma_p, sigma_p * np.sqrt(gamma), q0)

    def sample_unconstrained(self, rng: np.random.Generator | np.random.RandomState, size: int, sbar: float) -> FloatArray:
        """Independent draws in unconstrained coordinates, shape (size, 4)."""
        return unconstrained(self.sample(rng, size), sbar)


def pull_derivatives(a: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pull p = p_max expit(a) and its first and second derivative with respect to a."""
    p = MAX_PULL * expit(a)
    p1 = p * expit(-a)
    return p, p1, p1 * -np.tanh(0.5 * a)


def log_sigma_p_derivatives(a: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First and second derivative of log sigma_p = b + 1.5 log(1 - p) with respect to a."""
    p, p1, p2 = pull_derivatives(a)
    return -1.5 * p1 / (1.0 - p), -1.5 * (p2 / (1.0 - p) + (p1 / (1.0 - p)) ** 2)


def jacobian_derivatives(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives of :func:`bayes_toe.model.coordinates.log_jacobian`."""
    a, top = x[..., 1], x[..., 3]
    p, p1, p2 = pull_derivatives(a)
    gradient, hessian = _zeros(x)
    gradient[..., 1] = p1 / (1.0 + p) + 1.5 * p1 / (1.0 - p) - expit(a)
    gradient[..., 2] = 1.0
    gradient[..., 3] = -np.tanh(0.5 * top)
    of_plus = p2 / (1.0 + p) - (p1 / (1.0 + p)) ** 2
    of_minus = p2 / (1.0 - p) + (p1 / (1.0 - p)) ** 2
    hessian[..., 1, 1] = of_plus + 1.5 * of_minus - expit(a) * expit(-a)
    hessian[..., 3, 3] = -2.0 * expit(top) * expit(-top)
    return gradient, hessian


def _zeros(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.zeros(x.shape), np.zeros((*x.shape, x.shape[-1]))
