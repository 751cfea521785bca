"""Sampling: chains of an ensemble, when it stops, what it reports, and seeds."""

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.random import default_rng
from reference.hard_cases import hard_cases
from scipy.special import logsumexp

import bayes_toe as bt
from bayes_toe.errors import ConvergenceWarning
from bayes_toe.inference.diagnostics import TAIL, convergence, errors
from bayes_toe.inference.fitted import fit_posterior
from bayes_toe.inference.sampling import SamplerSettings, sample_chains
from bayes_toe.model.paper_model import paper_posterior
from bayes_toe.seeds import generator

CASES = hard_cases()


@pytest.fixture(scope="module")
def funnel():
    """The fit of a subject whose posterior has a funnel."""
    return fit_posterior(paper_posterior(CASES["funnel"]), generator(1, "funnel"))


@pytest.mark.parametrize("name", ["S01", "S14"])
def test_every_chain_has_its_share_of_draws_in_the_far_tail(name):
    """An independence sampler sticks where the proposal is thin.

    So each chain of a small sample must have about .3 % of its draws beyond the 99.7 % quantile.
    The quantile is that of 100,000 weighted draws.
    """
    posterior = paper_posterior(bt.example_study("same/different")[name])
    fitted = fit_posterior(posterior, generator(1, name, "proposal"))
    draws = fitted.fresh(default_rng(0), 100_000)
    weights = np.exp(draws.log_weights - logsumexp(draws.log_weights))
    q0 = posterior.quantities(fitted.original(draws.x)[0])["q0"]
    order = np.argsort(q0)
    quantile = q0[order][np.searchsorted(np.cumsum(weights[order]), 0.997)]
    chains = sample_chains(fitted, SamplerSettings(draws=1000), seed=1)
    shares_beyond = (posterior.quantities(chains.x)["q0"] > quantile).mean(axis=1)  # (chains,)
    # 640 or more effective draws a chain expect two or more beyond; a walker that stuck for long
    # would add one in 64. Limits are five standard errors.
    assert shares_beyond.max() < 0.003 + 5 * np.sqrt(0.003 / 600)
    assert shares_beyond.mean() == pytest.approx(0.003, abs=5 * np.sqrt(0.003 / 2000))


def test_chains_meet_what_was_asked_and_are_walker_major(analysis):
    draws = analysis.draws
    sampler = analysis.settings.sampler
    assert not draws.not_converged

    n_draws = sampler.walkers * sampler.kept_steps
    assert dict(draws.tree["posterior"].sizes) == {"chain": 4, "draw": n_draws, "subject": 3}

    # The sampler judges all quantities except these two, which follow from other quantities.
    rows = draws.summary().query("parameter != ['pse_shift', 'jnd']")
    assert rows[["ess_bulk", "ess_tail"]].to_numpy().min() >= 2000
    assert rows["r_hat"].max() < 1.01

    walker = draws.tree["posterior"]["walker"].values  # of each draw
    assert (np.diff(walker) >= 0).all()
    assert (np.bincount(walker) == sampler.kept_steps).all()


def test_an_r_hat_above_its_limit_is_reported(monkeypatch):
    # The settings have a limit that no draws meet, and allow no second pass.
    strict_settings = partial(SamplerSettings, max_r_hat=1.000001, max_thin=1)
    monkeypatch.setattr("bayes_toe.analysis.SamplerSettings", strict_settings)
    with pytest.warns(ConvergenceWarning, match="did not converge"):
        draws = bt.sample(bt.Study([CASES["guessing at 0.5"]]), seed=1)
    assert "required" in draws.not_converged["guessing at 0.5"]
    assert not draws.imprecise


def test_no_pass_is_thinned_by_more_than_the_limit(funnel):
    strict_settings = SamplerSettings(draws=500, max_r_hat=1.0000001, max_thin=3)
    assert sample_chains(funnel, strict_settings, seed=1).thin == 3


def chains_and_error(fitted, draws, limit, **options):
    """Chains, and the largest error of a 5 or 95 % quantile over the distance of both quantiles.

    The sampler goes on until the error of each natural parameter is below `limit`.
    """
    settings = SamplerSettings(draws=draws, max_quantile_error=limit, **options)
    # Draws of seed 9 are correlated in a single pass; those of seed 1 are all but independent.
    chains = sample_chains(fitted, settings, seed=9)
    values = fitted.target.quantities(chains.x)
    largest_error = 0.0
    for name in fitted.target.names.natural:
        low, high = np.quantile(values[name], TAIL)
        error = errors(values[name])
        largest_error = max(largest_error, error.q05 / (high - low), error.q95 / (high - low))
    return chains, largest_error


@pytest.fixture(scope="module")
def quantile_limit(funnel):
    """A limit that a single pass of 5,000 draws just misses, within reach of independent draws."""
    chains, error = chains_and_error(funnel, 5000, np.inf, max_thin=1)
    assert chains.converged
    assert chains.log_posterior.size >= 10_000  # at least twice as many draws as are asked for
    return 0.95 * error


def test_sampling_goes_on_until_quantiles_of_natural_quantities_are_certain(funnel, quantile_limit):
    chains, error = chains_and_error(funnel, 5000, quantile_limit)
    assert chains.converged
    assert chains.thin > 1
    assert error <= quantile_limit


def test_draws_that_are_too_few_for_a_limit_say_how_many_would_do(funnel, quantile_limit):
    limit = 0.5 * quantile_limit
    chains, _ = chains_and_error(funnel, 5000, limit)
    # There was a single pass: the sampler saw that no further pass could help.
    assert (chains.converged, chains.reason, chains.thin) == (True, "", 1)
    match = re.fullmatch(r"a 5 or 95 % quantile of .*: ([0-9,]+) draws would do", chains.imprecise)
    n_sufficient = int(match[1].replace(",", ""))
    chains, error = chains_and_error(funnel, n_sufficient, limit)
    assert chains.imprecise == ""
    assert error <= limit


def test_stated_errors_of_quantiles_are_the_spread_over_independent_runs():
    """The subject has forty runs. The draws that judge the mixture are part of a run."""
    posterior = paper_posterior(CASES["one order missing"])
    fitted = fit_posterior(posterior, generator(3, "claims"))
    runs = []
    for seed in range(40):
        draws = fitted.fresh(generator(seed, "judged"), 8000)
        runs.append(sample_chains(replace(fitted, draws=draws), SamplerSettings(draws=1000), seed))

    log_ratios = []
    for key in ("mu1", "sigma_p", "q0"):
        values = [posterior.quantities(run.x)[key] for run in runs]
        # `errors` has the error of the mean, and then those of three quantiles: (runs, quantiles).
        stated = np.sqrt(np.mean(np.square([errors(value)[1:] for value in values]), axis=0))
        spread = np.std([np.quantile(value, [0.05, 0.5, 0.95]) for value in values], axis=0, ddof=1)
        log_ratios.extend(np.log(stated / spread))
    # The log of a standard deviation of 40 values has an error of 0.113. The limit is four such
    # errors.
    assert np.abs(log_ratios).max() < 0.45
    # The limit is four errors of the mean of nine log ratios, which are nearly independent. If the
    # stated errors were those of independent draws, the mean would be -0.22.
    assert abs(np.mean(log_ratios)) < 0.17


def test_draws_of_a_subject_depend_on_the_seed_and_not_on_others_or_their_order(
    analysis, small_study
):
    # Draws of several workers are compared in tests/cli/test_faults.py.
    options = {"draws": 2000, "prior": "paper"}  # those of `analysis`, whose seed is 5
    backward = bt.sample(small_study.select(["C", "A"]), seed=5, **options)
    for name in backward.names:
        assert np.array_equal(analysis.draws.points(name), backward.points(name))
    changed = bt.sample(small_study.select(["B"]), seed=6, **options)
    assert not np.array_equal(changed.points("B"), analysis.draws.points("B"))


def test_walkers_that_never_move_do_not_pass_for_a_converged_sample():
    # 256 dispersed starts, repeated: far from 4 effective draws a walker, whatever was asked.
    assert SamplerSettings(draws=10).required == 4 * 4 * 64
    values = np.repeat(default_rng(0).normal(size=(4, 64)), 32, axis=1)  # (chains, draws)
    assert convergence(values).ess_bulk < SamplerSettings(draws=10).required
