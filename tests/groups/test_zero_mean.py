"""Bayes factors of 0 against integrals of a model in which everything is normal."""

import numpy as np
import pytest
from numpy.random import default_rng
from scipy import stats

from bayes_toe.groups.group_sampler import GroupDraws
from bayes_toe.groups.hyperprior import HyperpriorNumbers
from bayes_toe.groups.zero_mean import (
    zero_difference,
    zero_effect,
    zero_mean,
)
from bayes_toe.model.prior import ParameterHyperprior

TAU = np.array([0.3, 0.5])  # known SDs between subjects of two coefficients
NO_EFFECTS = np.zeros((0, 2))


def known_draws(y, effects=NO_EFFECTS, mean=(0.0, 0.0)):
    """Two chains of 50 equal draws: subjects' coefficients y, (N, 2), and all else are known."""
    parts = map(np.asarray, (mean, TAU, effects, y))
    # Axes for chains and draws come before those of the values, which stay as they are.
    return GroupDraws(*(np.tile(values, (2, 50) + (1,) * values.ndim) for values in parts))


@pytest.mark.parametrize("centre", [0.0, 0.2, 1.0])
def test_the_bayes_factor_of_a_mean_is_that_of_integrals(centre):
    """The prior of the first coefficient has heavy tails, and that of the second is normal."""
    y = centre + default_rng(1).normal(0.0, 0.3, (9, 2))
    heavy_tailed = ParameterHyperprior(0.0, 0.5, 1.0, has_heavy_tails=True)
    numbers = HyperpriorNumbers.from_rows([heavy_tailed, ParameterHyperprior(0.0, 0.2, 1.0)])
    priors = stats.t(3, scale=0.5), stats.norm(0.0, 0.2)
    for j, prior in enumerate(priors):
        likelihood = stats.norm(y[:, j].mean(), TAU[j] / 3.0)  # 3 is the root of 9 subjects
        # The likelihood of 0 over its mean under the prior, integrated where it is not negligible.
        low, high = likelihood.interval(1 - 1e-12)
        evidence = likelihood.expect(prior.pdf, lb=low, ub=high)
        expected = likelihood.logpdf(0.0) - np.log(evidence)
        result = zero_mean(known_draws(y), numbers, np.zeros((9, 0)), j)
        # The integral of the heavy tails has 400 nodes.
        assert result.log_bf == pytest.approx(expected, abs=1e-4)


def test_the_bayes_factor_of_an_effect_is_that_of_normal_densities():
    rng = default_rng(2)
    x = rng.standard_normal((8, 2))
    y = 0.3 + 0.4 * x[:, [0]] + rng.normal(0.0, 0.3, (8, 2))
    numbers = HyperpriorNumbers.from_rows([ParameterHyperprior(0.0, 1.0, 0.25)] * 2)
    draws = known_draws(y, [[0.0, 0.0], [0.1, 0.1]], (0.3, 0.3))
    # The mean, .3, the effect of the second column, .1, and the SD of the effect, .25, are known.
    residual = y[:, 0] - 0.3 - 0.1 * x[:, 1]
    without_effect = stats.norm.logpdf(residual, 0.0, TAU[0]).sum()
    # An effect of the first column makes the residuals of subjects covary.
    covariance = 0.25**2 * np.outer(x[:, 0], x[:, 0]) + TAU[0] ** 2 * np.eye(8)
    with_effect = stats.multivariate_normal.logpdf(residual, cov=covariance)
    result = zero_effect(draws, numbers, x, i=0, j=0)  # covariate i, coefficient j
    assert result.log_bf == pytest.approx(without_effect - with_effect, abs=1e-9)


def test_the_bayes_factor_of_a_sum_of_coefficients_is_the_posterior_over_the_prior_at_0():
    """A difference between conditions is a weighted sum of columns of the design."""
    y = default_rng(3).normal(0.2, 0.3, (7, 2))
    numbers = HyperpriorNumbers.from_rows([ParameterHyperprior(0.0, 0.4, 1.0)] * 2)
    weights = np.array([0.7, -0.5])
    variance = np.square(TAU) / 7
    posterior_variance = 1.0 / (1.0 / variance + 1.0 / 0.16)  # the prior SD of each is .4
    posterior_mean = posterior_variance * y.mean(axis=0) / variance
    posterior = stats.norm(
        weights @ posterior_mean, np.sqrt(np.square(weights) @ posterior_variance)
    )
    prior = stats.norm(0.0, 0.4 * np.sqrt(np.square(weights).sum()))
    expected = posterior.logpdf(0.0) - prior.logpdf(0.0)
    result = zero_difference(known_draws(y), numbers, [0, 1], weights)
    assert result.log_bf == pytest.approx(expected, abs=1e-9)
