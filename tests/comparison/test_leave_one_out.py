"""Leave-one-out values against evidences without the unit, a grid, Beta integrals, and where importance sampling fails."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import logsumexp

import bayes_toe as bt
from bayes_toe.comparison import model_row
from bayes_toe.comparison.leave_one_out import (
    leave_one_out,
    leave_one_out_frequencies,
    leave_one_pair_out,
    left_out_pairs,
    log_evidence_without,
    weighted_pairs,
)
from bayes_toe.comparison.model_row import compare_one
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.diagnostics import smoothed_weights
from bayes_toe.inference.evidence import importance_evidence
from bayes_toe.inference.maxima import find_maxima
from bayes_toe.inference.subject import Wanted, fitted_result
from bayes_toe.model.free_frequencies import frequency_evidence
from bayes_toe.model.ladder import model_named, posterior_of
from bayes_toe.model.parts import composition
from bayes_toe.model.prior import DEFAULT
from bayes_toe.model.study_prior import prior_for

K, N = np.array([9, 0, 25, 13]), np.array([20, 15, 25, 40])


def evidence(target):
    """Its value and error."""
    estimate = importance_evidence(fit_proposal(target, np.random.default_rng(11)))
    assert not estimate.why_not
    return estimate.value, estimate.se


@pytest.fixture(scope="module")
def observed():
    """The posterior of a bundled subject, log P of both answers at draws from it, and its log evidence with error."""
    study = bt.example_study().select(["S01"])
    target, draws = (
        posterior_of(study["S01"], DEFAULT.at(study["S01"])),
        bt.sample(study, draws=20_000, seed=3, workers=1),
    )
    return (
        target,
        *target.answers_given_the_rest(draws.points("S01").reshape(-1, 4)),
        evidence(target),
    )


def answers(s, n_yes, n_trials):
    """The subject with these answers alone."""
    some = n_trials > 0
    return bt.Subject("S", s.s1[some], s.s2[some], n_yes[some], n_trials[some])


def monte_carlo_error(log_p):
    """Of the importance-sampling estimate, relative to it; draws taken to be worth a third of their number."""
    weights, p = np.exp(smoothed_weights(-log_p).log_weights), np.exp(log_p)
    return np.sqrt(3 * (np.square(weights) @ np.square(p / (weights @ p) - 1)))


@pytest.mark.parametrize(("pair", "answer"), [(0, None), (9, None), (4, 1), (9, 0)])
def test_a_unit_left_out_is_the_evidence_with_it_over_the_evidence_without(observed, pair, answer):
    target, equal, different, (full, full_error) = observed
    s, one = target.subject, np.arange(target.subject.n_pairs) == pair
    if answer is None:
        log_p = s.n_yes * equal + (s.n_trials - s.n_yes) * different
        found, log_p, n_yes, n_trials = (
            leave_one_pair_out(log_p, s.n_trials),
            log_p[:, pair],
            s.n_yes * ~one,
            s.n_trials * ~one,
        )
    else:
        found, log_p = (
            leave_one_out(equal, different, s.n_yes, s.n_trials),
            (equal, different)[answer][:, pair],
        )
        n_yes, n_trials = s.n_yes - one * (answer == 0), s.n_trials - one
    less, less_error = evidence(target.for_subject(answers(s, n_yes, n_trials)))
    error = np.sqrt(full_error**2 + less_error**2 + monte_carlo_error(log_p) ** 2)
    assert error < (0.06 if answer is None else 0.01)
    assert found.values[answer or 0, pair] == pytest.approx(full - less, abs=4 * error)


def log_evidence_by_grid(subject, n_equal, n_trials):
    """Of the symmetric model with beta-binomial counts by a sum over a grid, without draws."""
    axes = np.linspace(-7.0, 2.5, 48), np.linspace(-9.0, 9.0, 46), np.linspace(-13.0, 6.0, 48)
    points = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=-1)
    density = (
        composition("none + beta-binomial")
        .posterior(answers(subject, n_equal, n_trials), bt.Prior())
        .log_density(points)
    )
    return logsumexp(density) + np.log([axis[1] - axis[0] for axis in axes]).sum()


def test_answers_that_go_together_are_left_out_given_the_others_to_their_pair():
    """Three pairs that scatter more than answers given alone would."""
    s = bt.Subject("S", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [9, 1, 8], [10, 12, 10])
    row = compare_one(s, composition("none + beta-binomial"), draws=8000, seed=3, prior=bt.Prior())
    full = log_evidence_by_grid(s, s.n_yes, s.n_trials)
    assert row.log_evidence == pytest.approx(full, abs=0.02)
    for pair, one in enumerate(np.eye(3, dtype=int)):
        for answer in (0, 1):  # one 'equal', one 'different'
            less = log_evidence_by_grid(s, s.n_yes - one * (answer == 0), s.n_trials - one)
            assert row.left_out["trial"].values[answer, pair] == pytest.approx(
                full - less, abs=0.03
            )
        rest = log_evidence_by_grid(s, s.n_yes * (1 - one), s.n_trials * (1 - one))
        assert row.left_out["pair"].values[0, pair] == pytest.approx(full - rest, abs=0.06)


def test_trials_add_up_with_their_counts(observed):
    target, *logs, _ = observed
    s = target.subject
    found = leave_one_out(*logs, s.n_yes, s.n_trials)
    each = np.repeat(
        found.values.ravel(), np.concatenate([s.n_yes, s.n_trials - s.n_yes])
    )  # one value per trial
    assert len(each) == s.total_trials
    assert (found.elpd, found.se) == pytest.approx(
        (each.sum(), np.sqrt(len(each)) * each.std(ddof=1)), rel=1e-9
    )


def integral(k, n):
    """Of q^k (1 - q)^(n - k)."""
    return quad(lambda q: q**k * (1 - q) ** (n - k), 0, 1, epsabs=0, epsrel=1e-11)[0]


def test_free_frequencies_are_beta_integrals():
    trial, pair = leave_one_out_frequencies(K, N), leave_one_out_frequencies(K, N, unit="pair")
    for i, (k, n) in enumerate(zip(K, N, strict=True)):
        whole = integral(k, n)
        assert pair.values[0, i] == pytest.approx(np.log(whole), abs=1e-9)
        for answer, given in enumerate((k, n - k)):
            expected = np.log(whole / integral(k - (answer == 0), n - 1)) if given else np.nan
            assert trial.values[answer, i] == pytest.approx(expected, abs=1e-9, nan_ok=True)
    assert trial.counts.tolist() == [K.tolist(), (N - K).tolist()]
    assert pair.elpd == pytest.approx(
        frequency_evidence(bt.Subject("S", [0.0, 0.1, 0.2, 0.3], np.zeros(4), K, N)), rel=1e-13
    )
    assert np.isnan(leave_one_out_frequencies([3], [5], unit="pair").se)  # one unit


def test_importance_sampling_of_free_frequencies_fails_for_pairs_and_so_needs_the_closed_form():
    # Without its own answers a frequency is uniform, and its posterior no proposal for that: k-hat tends to n/(n + 1).
    draws = np.random.default_rng(2).beta(K + 1, N - K + 1, size=(20_000, 4))
    equal, different = np.log(draws), np.log1p(-draws)
    found = leave_one_pair_out(K * equal + (N - K) * different, N)
    assert (found.pareto_k > 0.7).all()
    assert np.isnan([*found.values[0], found.elpd, found.se]).all()
    assert found.note.startswith("leave-one-out by pair withheld")
    assert "pair 2" in found.note
    trial = leave_one_out(equal, different, K, N)  # one trial of many is no trouble
    assert trial.note == ""
    assert trial.elpd == pytest.approx(leave_one_out_frequencies(K, N).elpd, abs=0.02)
    rare = np.random.default_rng(2).beta(0.2, 3.0, size=(5_000, 1))
    found = leave_one_out(np.log(rare), np.log1p(-rare), [1], [4])
    assert np.isnan([found.values[0, 0], found.elpd]).all()
    assert np.isfinite(found.values[1, 0])
    assert "pair 1 ('equal')" in found.note
    assert "'different'" not in found.note


def test_answers_never_given_need_no_probability():
    q = np.random.default_rng(2).uniform(0.2, 0.3, size=(500, 1))
    with np.errstate(divide="ignore"):
        equal = np.log(np.column_stack([q, 0 * q]))
    found = leave_one_out(equal, np.log1p(-np.exp(equal)), [3, 0], [5, 7])
    assert found.values[1, 1] == 0.0  # 'different' for sure
    assert np.isfinite(found.elpd)


# --- pairs, by the proposal ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "model", "pair"),
    [
        ("S01", "mean-reverting memory", 7),  # by the posterior's own draws k-hat would be 0.86
        ("S05", "free weighting", 0),  # too few draws count: refitted
        ("S13", "no lapses", 0),  # as well
        (
            "S11",
            "no lapses",
            1,
        ),  # without the pair there is mass behind a wall, where no draw is: nothing in the weights tells
    ],
)
def test_a_pair_left_out_is_that_of_a_fit_without_it(name, model, pair):
    """Within 0.1: the fit is sure to 0.005, the value to 0.022 at most, in fewer than one of 10,000 cases."""
    study = bt.example_study()
    target = model_named(model).posterior(study[name], prior_for(study, None))
    result, (maxima, fitted) = fitted_result(target, 1, Wanted(evidence_draws=20_000))
    found = left_out_pairs(fitted, maxima, result.evidence, 1)
    truth = result.evidence.value - log_evidence_without(target, pair, np.random.default_rng(5))
    assert np.isfinite(found.values).all()
    assert found.note == ""
    assert found.elpd == pytest.approx(found.values.sum(), rel=1e-12)
    assert found.values[0, pair] == pytest.approx(truth, abs=0.1)
    if name == "S11":
        draws, nothing = fitted.draws, np.zeros(target.subject.n_pairs, bool)
        logs = target.pair_log_likelihood(draws.x), draws.log_prior - draws.log_proposal
        alone = weighted_pairs(*logs, target.subject.n_trials, withheld=nothing)
        assert alone.pareto_k[0, pair] < 0.5
        assert alone.values[0, pair] > truth + 1.0


def test_maxima_of_all_answers_lead_to_every_maximum_without_a_pair_that_the_grid_finds():
    study = bt.example_study()
    target = model_named("no lapses").posterior(study["S08"], prior_for(study, None))
    for pair in (3, 11):  # walls, behind which there is mass
        s = target.subject
        rest = target.for_subject(answers(s, s.n_yes, s.n_trials * (np.arange(s.n_pairs) != pair)))
        grid, ours = find_maxima(rest), find_maxima(rest, find_maxima(target).all)
        near = grid.x[grid.value > grid.value[0] - 10.0]
        assert (np.abs(near[:, None] - ours.all).max(axis=2).min(axis=1) < 1e-2).all()


def test_where_an_answer_is_impossible_draws_count_for_the_other_answers_only():
    logs = np.log(np.random.default_rng(3).uniform(0.4, 0.6, (4000, 2)))
    logs[::2, 0] = -np.inf
    pairs = weighted_pairs(logs, np.zeros(4000), [1, 1], withheld=np.zeros(2, bool))
    p = np.exp(logs)
    assert pairs.values[0] == pytest.approx(
        np.log(p.prod(axis=1).mean()) - np.log(p[:, ::-1].mean(axis=0)), abs=1e-3
    )
    kept = weighted_pairs(logs, np.zeros(4000), [1, 1], withheld=np.array([True, False]))
    assert kept.values[0] == pytest.approx([np.nan, pairs.values[0, 1]], nan_ok=True)
    assert "pair 1" in kept.note
    few = logs.copy()
    few[160:, 1] = -30.0  # 80 draws count: too few, however even their weights
    assert np.isnan(
        weighted_pairs(few, np.zeros(4000), [1, 1], withheld=np.zeros(2, bool)).values[0, 0]
    )


def test_chains_take_over_where_more_draws_are_asked_for_than_the_proposal_has(
    small_study, monkeypatch
):
    asked, sample = [], model_row.sample_chains
    monkeypatch.setattr(
        model_row,
        "sample_chains",
        lambda fitted, how, seed: asked.append(how.draws) or sample(fitted, how, seed),
    )
    one, other = (
        compare_one(small_study["C"], model_named("symmetric"), draws=n, seed=1, prior=bt.Prior())
        for n in (1000, 15_000)
    )
    assert asked == [15_000]
    assert one.log_evidence == other.log_evidence
    assert one.checks.elpd_loo_trial == pytest.approx(other.checks.elpd_loo_trial, abs=0.2)
    assert one.left_out["pair"].values == pytest.approx(
        other.left_out["pair"].values
    )  # by the proposal in either case
    assert one.checks.p_predictive == pytest.approx(other.checks.p_predictive, abs=0.06)
