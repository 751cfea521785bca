"""Student-t mixtures and proposals: density, moments, EM, weights."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.random import default_rng
from reference.hard_cases import hard_cases
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.proposal import (
    StudentMixture,
    WeightedDraws,
    efficiency,
    importance_draws,
    tempered,
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


def test_a_joined_mixture_is_the_weighted_sum(mixture):
    x = default_rng(3).normal(size=(10, 2))
    second = StudentMixture(np.ones(1), np.array([[5.0, 5.0]]), np.eye(2)[None], df=6)
    third = StudentMixture(np.ones(1), np.array([[-3.0, 2.0]]), 2.0 * np.eye(2)[None], df=6)
    first, *remaining = (np.exp(part.log_density(x)) for part in (mixture, second, third))
    expected = 0.8 * (0.8 * first + 0.2 * remaining[0]) + 0.2 * remaining[1]
    joined = mixture.joined([second, third], 0.2)
    assert np.exp(joined.log_density(x)) == pytest.approx(expected, rel=1e-12)


def test_the_covariance_is_that_of_draws(mixture):
    x = mixture.sample(default_rng(1), 400_000)
    assert mixture.covariance == pytest.approx(np.cov(x.T), abs=0.05)


def test_em_climbs_and_recovers_the_mixture(mixture):
    x = mixture.sample(default_rng(2), 20_000)
    weights = np.full(len(x), 1 / len(x))
    means, scales = np.array([[-1.0, 0.0], [1.0, 0.0]]), np.stack([np.eye(2), np.eye(2)])
    fits = [StudentMixture(np.array([0.5, 0.5]), means, scales, 6)]
    for _ in range(60):
        fits.append(fits[-1].updated(x, weights))
    likelihoods = [weights @ fit.log_density(x) for fit in fits]
    assert all(b >= a - 1e-3 for a, b in pairwise(likelihoods))
    assert np.sort(fits[-1].weights) == pytest.approx([0.3, 0.7], abs=0.03)
    assert likelihoods[-1] == pytest.approx(weights @ mixture.log_density(x), abs=0.005)


def test_a_step_with_inertia_lies_between_the_old_mixture_and_the_whole_step(mixture):
    rng = default_rng(4)
    x = rng.normal(0.3, 1.0, (3000, 2))
    weights = rng.dirichlet(np.ones(len(x)))
    complete = mixture.updated(x, weights)
    spread = 1e-3 * np.diag(weights @ np.square(x - weights @ x))  # only the whole step adds it
    free = mixture.drawn_toward(x, weights, floor=0.0, inertia=0.0)
    assert free.weights == pytest.approx(complete.weights, rel=1e-12)
    assert free.means == pytest.approx(complete.means, rel=1e-12)
    assert free.scales == pytest.approx(complete.scales - spread, rel=1e-8, abs=1e-8)

    effective = complete.weights / np.square(weights).sum()
    share = (effective / (effective + 50.0))[:, None]
    half = mixture.drawn_toward(x, weights, floor=1.0, inertia=50.0)
    assert half.weights == pytest.approx((complete.weights + 0.5) / 2.0)
    assert half.means == pytest.approx(mixture.means + share * (complete.means - mixture.means))
    separation = complete.means - half.means
    outer = np.einsum("ja,jb->jab", separation, separation)
    # Near points count more: their weights do not sum to what a component holds.
    scatter = (half.scales - mixture.scales) / share[..., None] + mixture.scales
    ratio = (scatter - free.scales)[:, 0, 0] / outer[:, 0, 0]
    assert scatter - free.scales == pytest.approx(ratio[:, None, None] * outer, rel=1e-5, abs=1e-6)
    assert np.all((ratio > 0.5) & (ratio < 8.0 / 6.0))


def test_log_proposal_density_integrates_to_one():
    """Prior over proposal density, at draws of the proposal, averages to the prior's mass."""
    posterior = paper_posterior(hard_cases()["one batch"])
    proposal = fit_proposal(posterior, default_rng(9)).proposal
    draws = importance_draws(proposal, default_rng(10), 200_000)
    ratio = np.exp(draws.log_prior - draws.log_proposal)
    assert ratio.mean() == pytest.approx(1.0, abs=5 * ratio.std() / np.sqrt(len(ratio)))


def test_efficiency_of_even_and_of_single_weights():
    assert efficiency(np.full(7, -1e6)) == pytest.approx(1.0)
    assert efficiency(np.array([0.0] + [-1e4] * 9)) == pytest.approx(0.1)


def test_weights_are_flattened_only_until_enough_draws_count():
    log_weights = default_rng(6).normal(0.0, 4.0, 1000)
    raw = log_weights - logsumexp(log_weights)
    assert np.log(tempered(log_weights, 1.0)) == pytest.approx(raw)
    flattened = tempered(log_weights, 60.0)
    assert 60.0 <= 1.0 / np.square(flattened).sum() < 150.0
    power = np.log(flattened[0] / flattened[1]) / (raw[0] - raw[1])
    assert 0.0 < power < 1.0
    assert np.diff(np.log(flattened)) == pytest.approx(power * np.diff(raw))


@pytest.mark.parametrize("size", [1, 12, 20, 21])
def test_equal_weights_have_no_error(size):
    draws = WeightedDraws(np.zeros((size, 1)), *np.full((3, size), 0.3))
    assert draws.standard_error == pytest.approx(0.0, abs=1e-15)
