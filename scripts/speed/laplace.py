"""Laplace's approximation in identified coordinates and in the paper's; moments and quantiles from draws of the Gaussian."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from bayes_toe.arrays import FloatArray
from bayes_toe.inference.laplace import laplace_evidence, laplace_evidence_natural
from bayes_toe.inference.modes import find_maxima
from bayes_toe.model.coordinates import log_jacobian
from bayes_toe.seeds import generator
from speed.cases import Case
from speed.counting import Counting
from speed.method import Prepared
from speed.outcome import APPROXIMATION, DoesNotExistError, Outcome, natural_draws

_STEP = 1e-3  # of central differences, in unconstrained coordinates


def prepare_identified(case: Case) -> Prepared:
    """The Gaussian at the highest maximum in (offset, logit pull, log width, logit q0); effort is the number of its draws."""

    def run(effort: int, seed: int) -> Outcome:
        posterior = Counting(case.posterior)
        maxima = find_maxima(posterior)
        value, why_not = laplace_evidence(maxima)
        if value is None:
            raise DoesNotExistError(why_not)
        x = _gaussian(maxima.x[0], maxima.curvature[0], effort, seed)
        return Outcome(APPROXIMATION, natural_draws(*posterior.natural(x)), None, posterior.evaluations, log_evidence=value)

    return Prepared(run)


def prepare_natural(case: Case) -> Prepared:
    """The Gaussian at the maximum in the paper's coordinates (mu1, sigma_p^2, sigma_l^2, q0).

    The package gives the evidence, or says that there is no such maximum; centre and curvature are found here by another route, and
    the evidence that follows from them has to be the package's.
    """

    def run(effort: int, seed: int) -> Outcome:
        posterior = Counting(case.posterior)
        value, why_not = laplace_evidence_natural(posterior, find_maxima(posterior))
        if value is None:
            raise DoesNotExistError(why_not)
        centre, precision, again = _natural_gaussian(posterior)
        if not abs(again - value) < 0.01:
            raise AssertionError(f"Laplace in the paper's coordinates is {value:.3f} by one route and {again:.3f} by another")
        mu1, variance_p, variance_l, q0 = _gaussian(centre, precision, effort, seed).T
        # A Gaussian reaches below zero, where a variance has no root: the root keeps the sign, and the error shows it.
        draws = natural_draws(mu1, _signed_root(variance_p), _signed_root(variance_l), q0)
        return Outcome(APPROXIMATION, draws, None, posterior.evaluations, log_evidence=value)

    return Prepared(run)


def _natural_gaussian(posterior: Counting) -> tuple[FloatArray, FloatArray, float]:
    """Centre, precision and log evidence in (mu1, sigma_p^2, sigma_l^2, q0), by a general optimiser and central differences."""

    def paper(x: FloatArray) -> FloatArray:
        theta = posterior.natural(x)
        return np.stack([theta.mu1, theta.sigma_p**2, theta.sigma_l**2, theta.q0], axis=-1)

    def log_density(x: FloatArray) -> FloatArray:
        """With respect to the paper's coordinates; |d(sigma_p^2, sigma_l^2) / d(sigma_p, gamma)| = 2 sigma_p^3."""
        return np.asarray(posterior.log_density(x) - log_jacobian(x) - np.log(2.0) - 3.0 * np.log(posterior.natural(x).sigma_p))

    def lower(x: FloatArray) -> tuple[float, FloatArray]:
        values = log_density(np.concatenate([x[None], x + 1e-5 * np.eye(4), x - 1e-5 * np.eye(4)]))
        return -float(values[0]), -(values[1:5] - values[5:]) / 2e-5

    found = [minimize(lower, start, jac=True, method="BFGS", options={"gtol": 1e-4}) for start in find_maxima(posterior).x]
    x = min(found, key=lambda one: float(one.fun)).x
    jacobian = (paper(x + _STEP * np.eye(4)) - paper(x - _STEP * np.eye(4))).T / (2.0 * _STEP)
    back = np.linalg.inv(jacobian)
    precision = -back.T @ _hessian(log_density, x) @ back
    evidence = float(log_density(x[None])[0] - 0.5 * np.linalg.slogdet(precision)[1] + 2.0 * np.log(2.0 * np.pi))
    return paper(x), precision, evidence


def _hessian(function: object, x: FloatArray) -> FloatArray:
    """Second central differences of a vectorised function, (4, 4)."""
    steps = _STEP * np.eye(4)
    corners = [x + a * steps[i] + b * steps[j] for i in range(4) for j in range(4) for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
    values = np.asarray(function(np.array(corners))).reshape(4, 4, 4)  # type: ignore[operator]
    return np.asarray((values[..., 0] - values[..., 1] - values[..., 2] + values[..., 3]) / (4.0 * _STEP**2))


def _gaussian(centre: FloatArray, precision: FloatArray, size: int, seed: int) -> FloatArray:
    """Draws of the Gaussian with this mean and inverse covariance, shape (size, 4)."""
    normal = generator(seed, "laplace").standard_normal((size, 4))
    return np.asarray(centre + np.linalg.solve(np.linalg.cholesky(precision).T, normal.T).T)


def _signed_root(values: FloatArray) -> FloatArray:
    return np.asarray(np.sign(values) * np.sqrt(np.abs(values)))
