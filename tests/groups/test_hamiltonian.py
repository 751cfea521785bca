"""The sampler on densities whose answer is known, and its rule for stopping."""

import numpy as np
import pytest
from numpy.random import default_rng
from populations import simulated_group

from bayes_toe.groups import group_sampler
from bayes_toe.groups.group_sampler import GroupDraws, Hamiltonian, Metric, sample_group
from bayes_toe.groups.population import group_posterior
from bayes_toe.model.prior import Hyperprior

#: A covariance of two shared coordinates and two blocks of two, all correlated.
_ROOT = np.tril(default_rng(5).normal(0.0, 0.4, (6, 6)), -1) + np.diag(
    [3.0, 0.05, 1.0, 0.2, 2.0, 0.7]
)
COVARIANCE = _ROOT @ _ROOT.T
PRECISION = np.linalg.inv(COVARIANCE)
CENTRE = np.array([1.0, -2.0, 0.0, 3.0, 5.0, -1.0])


def normal(x):
    """Log density and gradient of the normal with this covariance, at points x."""
    weighted = (x - CENTRE) @ PRECISION
    return -0.5 * (weighted * (x - CENTRE)).sum(axis=1), -weighted


def further_draws(sampler, n_draws):
    """Further draws, (chains, draws, coordinates), and how often a trajectory diverged."""
    (x,), n_divergent = sampler.advance(n_draws, lambda point: [point])  # the points themselves
    return x, n_divergent


def test_moments_of_a_correlated_normal():
    rng = default_rng(1)
    start = CENTRE + rng.standard_normal((8, 6))
    metric = Metric(n_shared=2, n_blocks=2, block_size=2)
    sampler = Hamiltonian(normal, start, metric, rng)
    sampler.warm_up()
    x, n_divergent = further_draws(sampler, 1500)
    draws = x.reshape(-1, 6)
    sd = np.sqrt(np.diag(COVARIANCE))
    # There are 12,000 draws; .06 is four standard errors of a mean of 4,400 independent draws.
    assert (draws.mean(axis=0) - CENTRE) / sd == pytest.approx(np.zeros(6), abs=0.06)
    assert draws.std(axis=0) / sd == pytest.approx(np.ones(6), abs=0.06)
    correlation = COVARIANCE / np.outer(sd, sd)
    assert np.corrcoef(draws.T) == pytest.approx(correlation, abs=0.05)
    assert n_divergent == 0


def test_a_cliff_makes_trajectories_diverge_and_none_crosses_it():
    def cliff(x):
        """A standard normal density, which is next to nothing where the first coordinate is < 0."""
        value, gradient = -0.5 * np.square(x).sum(axis=1), -x
        return np.where(x[:, 0] > 0.0, value, -1e6), gradient

    rng = default_rng(2)
    start = np.abs(rng.standard_normal((8, 3)))  # above the cliff
    sampler = Hamiltonian(cliff, start, Metric(n_shared=1, n_blocks=1, block_size=2), rng)
    x, n_divergent = further_draws(sampler, 200)
    assert n_divergent > 0
    assert x[..., 0].min() > 0.0


def test_last_bits_do_not_change_the_draws_of_a_group():
    study = simulated_group(seed=1, n_subjects=3)
    posterior = group_posterior(study, Hyperprior(), np.zeros((3, 0)))
    rows = posterior.rows

    def warm_trace(relative_error):
        """Draws after the warm-up, from a density with so large an error."""

        def density(x):
            value, gradient = posterior(x)
            return value * (1.0 + relative_error), gradient * (1.0 + relative_error)

        rng = default_rng(4)
        metric = Metric(posterior.n_shared, rows.n_subjects, rows.n_coordinates)
        sampler = Hamiltonian(density, posterior.start(4, rng), metric, rng)
        sampler.warm_up()
        draws, _ = further_draws(sampler, 50)
        return draws

    # Trajectories of 50 draws multiply the error, but no decision of the warm-up turns on it.
    assert warm_trace(1e-14) == pytest.approx(warm_trace(0.0), abs=1e-5)


def test_draws_that_are_not_reliable_say_why():
    # 4 chains of 300 draws: 2 coefficients without covariates, and 4 coordinates of each of 3
    # subjects.
    rng = default_rng(3)
    mean = rng.standard_normal((4, 300, 2))
    sd = rng.uniform(1.0, 2.0, (4, 300, 2))
    no_effects = np.empty((4, 300, 0, 2))
    subjects = rng.standard_normal((4, 300, 3, 4))
    assert GroupDraws(mean, sd, no_effects, subjects).shortfall == ""
    draws = GroupDraws(mean, sd, no_effects, subjects, n_divergent=2)
    assert "2 of 1200 trajectories diverged" in draws.shortfall
    chains_apart = mean + np.arange(4)[:, None, None]  # each chain 1 above the chain before
    assert "R-hat" in GroupDraws(chains_apart, sd, no_effects, subjects).shortfall
    draws = GroupDraws(mean[:, :50], sd[:, :50], no_effects[:, :50], subjects[:, :50])
    assert ", 300 required" in draws.shortfall


def test_twice_the_draws_where_the_first_are_not_reliable(monkeypatch):
    study = simulated_group(seed=1, n_subjects=3)
    posterior = group_posterior(study, Hyperprior(), np.zeros((3, 0)))

    def sample():
        return sample_group(posterior, n_draws=40, rng=default_rng(1))

    # A short warm-up, and limits that any draws meet.
    monkeypatch.setattr(group_sampler, "_ROUNDS", (10, 10))
    monkeypatch.setattr(group_sampler, "MAX_R_HAT", 9.0)
    monkeypatch.setattr(group_sampler, "MIN_EFFECTIVE_DRAWS", 0)
    expected = sample()
    assert expected.mean.shape == (4, 10, 3)  # 4 chains of 10 draws, 3 coefficients
    monkeypatch.setattr(group_sampler, "MAX_R_HAT", 0.5)  # a limit that no draws meet
    draws = sample()
    assert draws.mean.shape == (4, 20, 3)
    assert (draws.mean[:, :10] == expected.mean).all()  # The first draws are the same.
