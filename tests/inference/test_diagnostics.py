"""Convergence, Monte Carlo errors and Pareto smoothing: of known draws, and every number against the ArviZ that is installed."""

import importlib.metadata

import arviz
import numpy as np
import pytest

from bayes_toe.inference.diagnostics import (
    Quantity,
    convergence,
    errors,
    pareto_k,
    quantile_errors,
    smoothed_unnormalised,
    smoothed_weights,
)

ONE = int(importlib.metadata.version("arviz").split(".")[0]) >= 1


def walk(rho, shape=(4, 1500), seed=4):
    """An AR(1) series: slow with a coefficient near 1, antithetic with a negative one."""
    steps = np.random.default_rng(seed).normal(size=shape)
    for i in range(1, shape[1]):
        steps[:, i] += rho * steps[:, i - 1]
    return steps


def rejected(share, shape=(4, 1500)):
    """Draws that repeat the one before, as rejected proposals do."""
    rng = np.random.default_rng(5)
    draws, stay = rng.normal(size=shape), rng.random(shape) < share
    for i in range(1, shape[1]):
        draws[stay[:, i], i] = draws[stay[:, i], i - 1]
    return draws


def with_values(*values):
    draws = walk(0.3)
    draws[np.arange(len(values)) % 4, 7 * np.arange(len(values))] = values
    return draws


RNG = np.random.default_rng(6)
CASES = {
    "independent": RNG.normal(size=(4, 1500)),
    "skewed": np.exp(walk(0.6)),
    "heavy tails": RNG.standard_cauchy((4, 1500)),
    "slow": walk(0.99),
    "very slow": walk(0.999),
    "antithetic": walk(-0.6),
    "very antithetic": walk(-0.95),
    "odd": walk(0.5, (4, 1501)),
    "three rejected in ten": rejected(0.3),
    "nine rejected in ten": rejected(0.9, (4, 1003)),
    "means apart": walk(0.2) + np.arange(4.0)[:, None],
    "spreads apart": walk(0.2) * np.arange(1.0, 5.0)[:, None],
    "far from zero": walk(0.2) + 1e8,
    "whole numbers": RNG.integers(0, 10, size=(4, 1000)),
    "two values": RNG.integers(0, 2, size=(4, 1000)),
    "one value but for a few": RNG.binomial(1, 0.01, (4, 1000)),
    "one chain": walk(0.5, (1, 1502)),
    "one constant chain": walk(0.5) * (np.arange(4) != 2)[:, None],
    "constant chains": np.arange(4.0)[:, None] * np.ones((4, 50)),
    "smaller than a float resolves": 1e-17 * walk(0.5),
    "infinite draws": with_values(np.inf, -np.inf, np.inf),
    "a draw that is none": with_values(np.nan),
    **{f"chains of {n}": walk(0.5, (4, n)) for n in (2, 3, 4, 5, 6, 7, 8, 9, 21)},
    "three chains of seven": walk(0.5, (3, 7)),
}


def by_arviz(draws):
    """All numbers of a Convergence and of Errors."""
    if ONE:
        from arviz_stats.base import array_stats as by

        axes = {"chain_axis": 0, "draw_axis": 1}
    else:
        by, axes = arviz, {}
    sizes = [by.ess(draws, method="bulk", **axes), by.ess(draws, method="tail", prob=(0.05, 0.95), **axes)]
    quantiles = [by.mcse(draws, method="quantile", prob=p, **axes) for p in (0.05, 0.5, 0.95)]
    return np.array([*sizes, by.rhat(draws, method="rank", **axes), by.mcse(draws, method="mean", **axes), *quantiles], np.float64)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of ArviZ, where chains are constant or draws infinite
@pytest.mark.parametrize("case", CASES)
def test_every_number_is_that_of_arviz(case):
    draws = CASES[case]
    np.testing.assert_allclose([*convergence(draws), *errors(draws)], by_arviz(draws), rtol=1e-12, atol=0.0)


def test_a_draw_that_is_a_quantile_is_not_above_it(monkeypatch):
    # The 5 and 95 % quantiles of 1001 draws are draws. ArviZ 0.x rounds one of them away, 1.x does not.
    draws = walk(0.5, (1, 1001))
    if not ONE:
        monkeypatch.setattr("arviz.stats.diagnostics._quantile", lambda values, p: [np.quantile(values, p)])
    np.testing.assert_allclose([*convergence(draws), *errors(draws)], by_arviz(draws), rtol=1e-12, atol=0.0)


@pytest.mark.parametrize("case", ["independent", "odd", "three rejected in ten", "chains of 5"])
def test_nothing_depends_on_layout(case):
    draws = CASES[case]
    alone = convergence(draws)
    assert convergence(np.asfortranarray(draws)) == alone
    assert Quantity(np.stack([draws, -draws], axis=-1)[..., 0]).convergence == alone
    assert Quantity(draws).errors == errors(draws)


def test_constant_draws_have_no_diagnostics():
    assert np.isnan([*convergence(np.ones((4, 100))), *errors(np.ones((4, 100)))]).all()


@pytest.mark.parametrize("case", ["independent", "odd", "three rejected in ten", "whole numbers", "a draw that is none"])
def test_quantiles_are_those_of_numpy(case):
    p = [0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0]
    np.testing.assert_array_equal(Quantity(CASES[case]).quantiles(p), np.quantile(np.asarray(CASES[case], np.float64), p))


def test_independent_normal_draws_have_the_errors_of_the_textbook():
    found = errors(np.random.default_rng(1).normal(size=(4, 10_000)))
    assert found.mean == pytest.approx(1 / 200, rel=0.1)
    assert found.q50 == pytest.approx(np.sqrt(np.pi / 2) / 200, rel=0.15)
    # sqrt(p (1 - p)) over the density at the quantile
    assert [found.q05, found.q95] == pytest.approx([np.sqrt(0.0475) / 0.1031 / 200] * 2, rel=0.2)


def test_dependent_draws_have_larger_errors():
    skewed = CASES["skewed"]
    shuffled = np.random.default_rng(2).permutation(skewed.ravel()).reshape(skewed.shape)
    assert errors(skewed).mean > 1.3 * errors(shuffled).mean
    assert errors(skewed).q50 > 1.3 * errors(shuffled).q50


def test_known_effective_sizes_give_the_same_errors():
    skewed = CASES["skewed"]
    found = errors(skewed)
    for p, expected in ((0.05, found.q05), (0.5, found.q50), (0.95, found.q95)):
        size = float(arviz.ess(skewed, method="quantile", prob=p))
        assert quantile_errors(skewed, [p], size)[0] == expected
    assert np.isnan(quantile_errors(skewed, [0.5], np.nan)).all()


# Sizes of which ArviZ 0.x and 1.x smooth equally many: 3 sqrt(size) is whole.
WEIGHTS = {
    "light": RNG.normal(size=10_000),
    "bounded": np.log(RNG.uniform(size=2500)),
    "heavy": -0.9 * np.log(RNG.uniform(size=2500)),
    "hopeless": RNG.standard_cauchy(900),
    "wide": 300.0 * RNG.normal(size=2500),
    "few": RNG.normal(size=100),
    "half of them zero": np.where(np.arange(2500) % 2, -np.inf, RNG.normal(size=2500)),
}
# And those where 0.x alone has an answer that is worth keeping.
ONLY_0 = {
    "not a square": RNG.normal(size=4321),
    "ties": RNG.integers(0, 9, 5000) / 3.0,
    "too few": RNG.normal(size=12),
    "all the same": np.full(100, -3.0),
    "nearly all zero": np.where(np.arange(900) % 99, -np.inf, RNG.normal(size=900)),
}


@pytest.mark.parametrize("case", WEIGHTS if ONE else WEIGHTS | ONLY_0)
def test_smoothed_weights_are_those_of_arviz(case):
    raw = (WEIGHTS | ONLY_0)[case]
    if ONE:
        from arviz_stats.base import array_stats

        expected, k = array_stats.psislw(-raw)
    else:
        expected, k = arviz.psislw(raw)
    found = smoothed_weights(raw)
    np.testing.assert_allclose(np.exp(found.log_weights), np.exp(expected), rtol=1e-11, atol=1e-15)
    np.testing.assert_allclose([found.pareto_k, pareto_k(raw)], float(k), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("case", WEIGHTS | ONLY_0)
def test_smoothing_on_the_raw_scale_leaves_all_but_the_tail(case):
    raw = (WEIGHTS | ONLY_0)[case]
    found, normalised = smoothed_unnormalised(raw), smoothed_weights(raw)
    body = np.argsort(raw)[: -int(np.ceil(min(raw.size / 5, 3 * np.sqrt(raw.size))))]
    np.testing.assert_allclose(found.log_weights[body], raw[body], rtol=1e-12, atol=1e-12)
    assert found.log_weights.max() <= raw.max()
    some = np.isfinite(raw)
    assert np.ptp(found.log_weights[some] - normalised.log_weights[some]) < 1e-9


def test_weights_that_differ_by_rounding_have_no_tail():
    nearly = smoothed_weights(-1e-19 * np.arange(1000))
    assert nearly.pareto_k == np.inf
    assert np.exp(nearly.log_weights) == pytest.approx(np.full(1000, 1e-3))
