"""Student-t mixtures and proposals: density, moments, EM, weights."""

import numpy as np
import pytest
from bayes_toe.inference.adaptation import fit_proposal
from numpy.random import default_rng
from reference.hard_cases import hard_cases
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from bayes_toe.inference.mixture import (
    StudentMixture,
    WeightedDraws,
    importance_draws,
)
from bayes_toe.model.paper_model import paper_posterior


@pytest.fixture
def mixture():
    means = np.array([[0.0, 1.0], [2.0, -1.0]])
    scales = np.array([[[1.0, 0.6], [0.6, 0.8]], [[0.3, -0.1], [-0.1, 0.2]]])
    return StudentMixture(np.array([0.3, 0.7]), means, scales, df=6)


def log_density_of(means, scales, df, x):
    """Log density of components of equal weight, by SciPy."""
    parts = []
    for mean, scale in zip(means, scales, strict=True):
        parts.append(multivariate_t(mean, scale, df=df).logpdf(x))
    return logsumexp(parts, axis=0) - np.log(len(means))


@pytest.mark.parametrize(
    "dim, df", [(1, 1), (1, 3), (2, 8), (3, 9), (4, 4), (4, 8), (5, 9), (13, 3)]
)
def test_mixture_density_in_any_dimension(dim, df):
    rng = default_rng([dim, df])
    roots, means = rng.normal(size=(3, dim, dim)), rng.normal(size=(3, dim))
    scales = roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(dim)
    # More than two blocks of points.
    x = rng.normal(size=(2500, dim)) * rng.choice([0.1, 1.0, 100.0], (2500, 1))
    mixture = StudentMixture(np.full(3, 1 / 3), means, scales, df)
    expected = log_density_of(means, scales, df, x)
    assert mixture.log_density(x) == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("distance", [1e2, 1e6, 1e12])
def test_mixture_density_of_narrow_components_far_apart(distance):
    # Whitening loses what the subtraction x - mean loses, digits in proportion to distance over
    # scale, and no more.
    means = np.array([[0.0, 0.0], [distance, -distance]])
    scales = np.stack([np.eye(2), np.eye(2)])
    mixture = StudentMixture(np.array([0.5, 0.5]), means, scales, 8)
    x = means[1] + default_rng(1).normal(size=(500, 2))
    expected = log_density_of(means, scales, 8, x)
    assert mixture.log_density(x) == pytest.approx(expected, abs=1e-13 + 1e-15 * distance)


def test_the_covariance_is_that_of_draws(mixture):
    x = mixture.sample(default_rng(1), 400_000)
    assert mixture.covariance == pytest.approx(np.cov(x.T), abs=0.05)


def test_log_proposal_density_integrates_to_one():
    """Prior over proposal density, at draws of the proposal, averages to the prior's mass."""
    posterior = paper_posterior(hard_cases()["one batch"])
    proposal = fit_proposal(posterior, default_rng(9)).proposal
    draws = importance_draws(proposal, default_rng(10), 200_000)
    ratio = np.exp(draws.log_prior - draws.log_proposal)
    assert ratio.mean() == pytest.approx(1.0, abs=5 * ratio.std() / np.sqrt(len(ratio)))


@pytest.mark.parametrize("size", [1, 12, 20, 21])
def test_equal_weights_have_no_error(size):
    draws = WeightedDraws(np.zeros((size, 1)), *np.full((3, size), 0.3))
    assert draws.standard_error == pytest.approx(0.0, abs=1e-15)
