"""Convergence, Monte Carlo errors and Pareto smoothing.

Of draws of which the answer is known, and against the ArviZ that users have.
"""

import importlib.metadata

import arviz
import numpy as np
import pytest
from numpy.random import default_rng
from scipy.special import logsumexp

from bayes_toe.inference.diagnostics import (
    convergence,
    convergence_of,
    errors,
    errors_of,
    smoothed_weights,
)

IS_ARVIZ_1 = int(importlib.metadata.version("arviz").split(".")[0]) >= 1
RNG = default_rng(6)


def walk(rho, shape=(4, 1500), seed=4):
    """An AR(1) series: slow with a coefficient near 1, antithetic with a negative one."""
    steps = default_rng(seed).normal(size=shape)
    for i in range(1, shape[1]):
        steps[:, i] += rho * steps[:, i - 1]
    return steps


CASES = {
    "independent": RNG.normal(size=(4, 1500)),
    "skewed": np.exp(walk(0.6)),
    "heavy tails": RNG.standard_cauchy((4, 1500)),
    "slow": walk(0.99),
    "antithetic": walk(-0.6),
    "odd": walk(0.5, (4, 1501)),
    "means apart": walk(0.2) + np.arange(4.0)[:, None],
    "whole numbers": RNG.integers(0, 10, size=(4, 1000)),
    "one chain": walk(0.5, (1, 1502)),
    "one constant chain": walk(0.5) * (np.arange(4) != 2)[:, None],
    "a draw that is none": np.where(np.arange(1500) == 7, np.nan, walk(0.3)),
    **{f"chains of {n}": walk(0.5, (4, n)) for n in (2, 4, 21)},
}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of ArviZ, where a chain is constant
@pytest.mark.parametrize("case", CASES)
def test_every_number_is_that_of_the_arviz_that_users_have(case):
    draws = np.asarray(CASES[case], np.float64)
    sizes = [arviz.ess(draws, method="bulk"), arviz.ess(draws, method="tail", prob=(0.05, 0.95))]
    uncertain = [
        arviz.mcse(draws, method="mean"),
        *(arviz.mcse(draws, method="quantile", prob=p) for p in (0.05, 0.5, 0.95)),
    ]
    expected = np.array([*sizes, arviz.rhat(draws, method="rank"), *uncertain], np.float64)
    # A draw that is itself a quantile ArviZ 0.x may round off.
    np.testing.assert_allclose(
        [*convergence(draws), *errors(draws)],
        expected,
        rtol=0.02 if "odd" in case and not IS_ARVIZ_1 else 1e-9,
    )


def test_many_quantities_have_the_numbers_of_each_and_constants_have_none():
    shape = (4, 500)
    observed = {
        "slow": walk(0.9, shape),
        "constant": np.ones(shape),
        "one step": np.arange(4.0)[:, None] * np.ones(shape),
    }
    for name, draws in observed.items():
        np.testing.assert_array_equal(
            convergence_of(observed)[name], convergence(np.asfortranarray(draws))
        )
        np.testing.assert_array_equal(errors_of(observed)[name], errors(draws))
    assert np.isnan([*convergence(observed["constant"]), *errors(observed["constant"])]).all()
    assert convergence(observed["one step"]).r_hat > 1e10


WEIGHTS = {
    "light": RNG.normal(size=10_000),
    "bounded": np.log(RNG.uniform(size=2500)),
    "heavy": -0.9 * np.log(RNG.uniform(size=2500)),
    "wide": 300.0 * RNG.normal(size=2500),
    "half of them zero": np.where(np.arange(2500) % 2, -np.inf, RNG.normal(size=2500)),
}
FLAT = {
    "too few": RNG.normal(size=12),
    "all the same": np.full(100, -3.0),
    "nearly all zero": np.where(np.arange(900) % 99, -np.inf, RNG.normal(size=900)),
    "apart by rounding": -1e-19 * np.arange(1000),
}


@pytest.mark.parametrize("case", WEIGHTS | FLAT)
def test_smoothed_weights_sum_to_one_and_only_the_tail_is_smoothed(case):
    raw = (WEIGHTS | FLAT)[case]
    observed = smoothed_weights(raw)
    assert np.exp(observed.log_weights).sum() == pytest.approx(1.0, abs=1e-12)
    if case in FLAT:  # no tail can be fitted
        finite = np.isfinite(raw)
        normalised = raw[finite] - logsumexp(raw)
        np.testing.assert_allclose(observed.log_weights[finite], normalised, rtol=1e-12, atol=1e-12)
        assert observed.pareto_k == np.inf
        return
    n_tail = int(np.ceil(min(raw.size / 5, 3 * np.sqrt(raw.size))))
    body = np.argsort(raw)[:-n_tail]
    body = body[np.isfinite(raw[body])]
    shift = observed.log_weights[body] - raw[body]
    np.testing.assert_allclose(shift, shift[0], rtol=0.0, atol=1e-12)
    assert observed.log_weights.max() - raw.max() <= shift[0] + 1e-12
