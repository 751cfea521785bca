"""Whether another library's model is the package's model, checked at random points before anything is timed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.special import gammaln

from bayes_toe.arrays import FloatArray
from bayes_toe.inference.modes import find_maxima
from bayes_toe.model.coordinates import log_jacobian
from bayes_toe.model.posterior import Posterior
from bayes_toe.seeds import generator

_POINTS = 20
_DROP = 200.0  # nats below the highest point found, beyond which no sampler goes


def random_points(posterior: Posterior) -> FloatArray:
    """Points about the highest maximum, shape (20, 4), unconstrained coordinates: as wide as the posterior allows."""
    top = np.clip(find_maxima(posterior).x[:1], -6.0, 6.0)
    rng = generator(1, posterior.subject.name, "agreement")
    lowest = posterior.log_density(top)[0] - _DROP
    points = np.empty((0, 4))
    for scale in 0.7 ** np.arange(60):
        cloud = top + scale * rng.standard_normal((_POINTS, 4))
        points = np.concatenate([points, cloud[posterior.log_density(cloud) > lowest]])
        if len(points) >= _POINTS:
            return points[:_POINTS]
    raise AssertionError("no points to compare the models at")


def log_binomial_coefficients(posterior: Posterior) -> float:
    """Sum of log n over k: the constant that the package leaves out and binomial distributions put in."""
    k, n = posterior.subject.n_equal, posterior.subject.n_trials
    return float((gammaln(n + 1.0) - gammaln(k + 1.0) - gammaln(n - k + 1.0)).sum())


def require_same(posterior: Posterior, log_density: Callable[[FloatArray], float], *, natural: bool, coefficients: bool) -> None:
    """Compare with the package at random points x.

    Parameters
    ----------
    log_density : callable
        Of one point x in unconstrained identified coordinates, shape (4,): the other model's log density there.
    natural : bool
        True where that is a density with respect to (mu1, sigma_p, gamma, q0), False where with respect to x.
    coefficients : bool
        True where it counts the binomial coefficients.

    Raises
    ------
    AssertionError
        If they differ by more than a millionth of a nat and what rounding of the sums explains.
    """
    x = random_points(posterior)
    expected = posterior.log_density(x)
    size = np.abs(expected)
    if natural:
        expected = expected - log_jacobian(x)
    if coefficients:
        expected = expected + log_binomial_coefficients(posterior)
        size = size + gammaln(posterior.subject.n_trials + 1.0).sum()
    gap = np.abs(np.array([float(log_density(point)) for point in x]) - expected)
    if not np.all(gap < 1e-6 + 1e-10 * size):
        raise AssertionError(f"the model's log density differs from the package's by {gap.max():.1e} nat")
