"""Student-t mixtures and weighted draws."""

import numpy as np
import pytest
from numpy.random import default_rng
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from bayes_toe.inference.mixture import StudentMixture


def log_density_of(means, scales, df, x):
    """Log density of components of equal weight, by SciPy."""
    parts = []
    for mean, scale in zip(means, scales, strict=True):
        parts.append(multivariate_t(mean, scale, df=df).logpdf(x))
    return logsumexp(parts, axis=0) - np.log(len(means))


@pytest.mark.parametrize(
    # Every sum of both numbers is even: `StudentMixture` needs whole powers, and refuses others.
    "dim, df",
    [(1, 1), (1, 3), (2, 8), (3, 9), (4, 4), (4, 8), (5, 9), (13, 3)],
)
def test_the_density_of_a_mixture_is_that_of_its_definition(dim, df):
    """The mixture has three components; points x are near to their centres and far out."""
    rng = default_rng([dim, df])
    roots = rng.normal(size=(3, dim, dim))
    means = rng.normal(size=(3, dim))
    scales = roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(dim)  # positive definite matrices
    # There are more points than in two blocks; a block of 1,024 points is computed at a time.
    x = rng.normal(size=(2500, dim)) * rng.choice([0.1, 1.0, 100.0], (2500, 1))
    mixture = StudentMixture(np.full(3, 1 / 3), means, scales, df)
    expected = log_density_of(means, scales, df, x)
    assert mixture.log_density(x) == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("distance", [1e2, 1e6, 1e12])
def test_components_far_apart_cost_no_more_digits_than_a_subtraction(distance):
    # The subtraction x - mean loses digits in proportion to the distance over the scale. The
    # density may lose as many, and no more.
    means = np.array([[0.0, 0.0], [distance, -distance]])
    scales = np.stack([np.eye(2), np.eye(2)])
    mixture = StudentMixture(np.array([0.5, 0.5]), means, scales, df=8)
    x = means[1] + default_rng(1).normal(size=(500, 2))
    expected = log_density_of(means, scales, df=8, x=x)
    assert mixture.log_density(x) == pytest.approx(expected, abs=1e-13 + 1e-15 * distance)
