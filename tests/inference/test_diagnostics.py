"""Convergence, Monte Carlo errors and weights without a Pareto tail.

Numbers are compared with known numbers, and with those of the ArviZ that users have.
"""

import arviz
import numpy as np
import pytest
from numpy.random import default_rng

from bayes_toe.inference.diagnostics import (
    convergence,
    convergence_of,
    errors,
    errors_of,
    pareto_k,
)

RNG = default_rng(6)


def walk(rho, shape=(4, 1500)):
    """AR(1) chains with coefficient rho, (chains, draws): slow near 1."""
    draws = default_rng(4).normal(size=shape)
    for i in range(1, shape[1]):
        draws[:, i] += rho * draws[:, i - 1]
    return draws


#: Draws of a quantity, (chains, draws).
DRAWS = {
    "independent": RNG.normal(size=(4, 1500)),
    "slow": walk(0.99),
    "means apart": walk(0.2) + np.arange(4.0)[:, None],
    "one chain": walk(0.5, (1, 1502)),
    "a draw that is NaN": np.where(np.arange(1500) == 7, np.nan, walk(0.3)),
    "two draws": walk(0.5, (4, 2)),
}


@pytest.mark.parametrize("case", DRAWS)
def test_every_number_is_that_of_the_arviz_that_users_have(case):
    """Effective draws, R-hat, and errors of the mean and of the 5, 50 and 95 % quantiles."""
    draws = np.asarray(DRAWS[case], np.float64)
    expected = [
        arviz.ess(draws, method="bulk"),
        arviz.ess(draws, method="tail", prob=(0.05, 0.95)),
        arviz.rhat(draws, method="rank"),
        arviz.mcse(draws, method="mean"),
    ]
    for p in (0.05, 0.5, 0.95):
        expected.append(arviz.mcse(draws, method="quantile", prob=p))
    observed = [*convergence(draws), *errors(draws)]
    np.testing.assert_allclose(observed, expected, rtol=1e-9)


def test_many_quantities_have_the_numbers_of_each_and_constants_have_none():
    """Quantities that are computed together have the numbers that each has alone."""
    shape = (4, 500)
    chains = {
        "slow": walk(0.9, shape),
        "constant": np.ones(shape),
        "constant in each chain": np.arange(4.0)[:, None] * np.ones(shape),
    }
    for name, draws in chains.items():
        # The order of the numbers in memory does not count.
        expected = convergence(np.asfortranarray(draws))
        np.testing.assert_array_equal(convergence_of(chains)[name], expected)
        np.testing.assert_array_equal(errors_of(chains)[name], errors(draws))
    assert np.isnan([*convergence(chains["constant"]), *errors(chains["constant"])]).all()
    # If chains differ and have no variance, R-hat is infinite but for rounding.
    assert convergence(chains["constant in each chain"]).r_hat > 1e10


#: Log weights.
WITHOUT_TAIL = {
    "too few": RNG.normal(size=12),
    "a single weight": np.zeros(1),
    "all the same": np.full(100, -3.0),
    "nearly all zero": np.where(np.arange(900) % 99, -np.inf, RNG.normal(size=900)),
    "apart by rounding": -1e-19 * np.arange(1000),
}


@pytest.mark.parametrize("case", WITHOUT_TAIL)
def test_weights_without_a_tail_have_no_pareto_k(case):
    assert pareto_k(WITHOUT_TAIL[case]) == np.inf
