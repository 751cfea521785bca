"""Leave-one-out values against refits without the unit (evidence ratios), against Beta integrals, and where importance sampling fails."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import logit, logsumexp

import bayes_toe as bt
from bayes_toe.comparison import model_row
from bayes_toe.comparison.leave_one_out import (
    LeaveOneOut,
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
from bayes_toe.model.closed_form import log_different, log_equal, normalised_distance
from bayes_toe.model.free_frequencies import frequency_evidence
from bayes_toe.model.ladder import model_named, posterior_of
from bayes_toe.model.parts import composition
from bayes_toe.model.prior import DEFAULT
from bayes_toe.model.study_prior import prior_for

K, N = np.array([9, 0, 25, 13]), np.array([20, 15, 25, 40])


@pytest.fixture(scope="module")
def observed():
    """A bundled subject, log P of both answers at its posterior draws, and its log evidence with error."""
    study = bt.example_study()
    subject = study["S01"]
    draws = bt.sample(study.select(["S01"]), draws=20_000, seed=3, workers=1)
    mu1, sigma_p, sigma_l, q0 = (np.ravel(v)[:, None] for v in draws.natural("S01"))
    z = normalised_distance(subject.s1, subject.s2, mu1, sigma_p, sigma_l)
    return subject, log_equal(z, np.log(q0)), log_different(z, logit(q0)), evidence(subject)


def evidence(subject, whole=None):
    """Of a subject under the prior of the one who it is a part of: its numbers are those of all stimuli."""
    prior = DEFAULT.at(subject if whole is None else whole)
    estimate = importance_evidence(fit_proposal(posterior_of(subject, prior), np.random.default_rng(11)))
    value, error, why_not = estimate.value, estimate.se, estimate.why_not
    assert not why_not
    return np.array([value, error])


def without(s, pair):
    kept = np.arange(s.n_pairs) != pair
    return bt.Subject(s.name, s.s1[kept], s.s2[kept], s.n_yes[kept], s.n_trials[kept])


def log_evidence_by_grid(subject, n_equal, n_trials):
    """Of the symmetric model with beta-binomial counts by a sum over a grid, without draws."""
    some = n_trials > 0
    counts = bt.Subject("S", subject.s1[some], subject.s2[some], n_equal[some], n_trials[some])
    axes = np.linspace(-7.0, 2.5, 48), np.linspace(-9.0, 9.0, 46), np.linspace(-13.0, 6.0, 48)
    target = composition("none + beta-binomial").posterior(counts, bt.Prior())
    points = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=-1)
    return logsumexp(target.log_density(points)) + np.log([axis[1] - axis[0] for axis in axes]).sum()


@pytest.fixture(scope="module")
def beta_binomial():
    """Three pairs that scatter more than answers given alone would, the row of their comparison, and the log evidence of all answers."""
    subject = bt.Subject("S", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [9, 1, 8], [10, 12, 10])
    row = compare_one(subject, composition("none + beta-binomial"), draws=8000, seed=3, prior=bt.Prior())
    return subject, row, log_evidence_by_grid(subject, subject.n_yes, subject.n_trials)


def test_answers_that_go_together_are_left_out_given_the_others_to_their_pair(beta_binomial):
    subject, row, full = beta_binomial
    assert row.log_evidence == pytest.approx(full, abs=0.02)
    for pair in range(3):
        one = (np.arange(3) == pair).astype(int)
        for answer in (0, 1):  # one 'equal', one 'different'
            less = log_evidence_by_grid(subject, subject.n_yes - one * (answer == 0), subject.n_trials - one)
            assert row.left_out["trial"].values[answer, pair] == pytest.approx(full - less, abs=0.03)
        rest = log_evidence_by_grid(subject, subject.n_yes * (1 - one), subject.n_trials * (1 - one))
        assert row.left_out["pair"].values[0, pair] == pytest.approx(full - rest, abs=0.06)


def of_unit(unit, equal, different, n_yes, n_trials):
    """A trial left out, or a pair whose answers are independent."""
    if unit == "trial":
        return leave_one_out(equal, different, n_yes, n_trials)
    return leave_one_pair_out(n_yes * equal + (n_trials - n_yes) * different, n_trials)


def monte_carlo_error(log_p):
    """Of the importance-sampling estimate, relative to it; draws taken to be worth a third of their number."""
    weights, p = np.exp(smoothed_weights(-log_p).log_weights), np.exp(log_p)
    mean = weights @ p
    return np.sqrt(3 * (np.square(weights) @ np.square(p / mean - 1)))


@pytest.mark.parametrize(("pair", "answer"), [(0, None), (4, None), (9, None), (0, 0), (4, 1), (9, 0), (9, 1)])
def test_a_unit_left_out_is_the_evidence_with_it_over_the_evidence_without(observed, pair, answer):
    s, equal, different, (full, full_error) = observed
    if answer is None:
        rest, unit = without(s, pair), "pair"
        log_p = s.n_yes[pair] * equal[:, pair] + (s.n_trials - s.n_yes)[pair] * different[:, pair]
    else:
        one, unit = (np.arange(s.n_pairs) == pair).astype(int), "trial"
        rest = bt.Subject("S", s.s1, s.s2, s.n_yes - one * (answer == 0), s.n_trials - one)
        log_p = (equal, different)[answer][:, pair]
    less, less_error = evidence(rest, s)
    found = of_unit(unit, equal, different, s.n_yes, s.n_trials)
    error = np.sqrt(full_error**2 + less_error**2 + monte_carlo_error(log_p) ** 2)
    assert error < (0.06 if unit == "pair" else 0.01)
    assert found.values[answer or 0, pair] == pytest.approx(full - less, abs=4 * error)


def test_trials_add_up_with_their_counts(observed):
    s, equal, different, _ = observed
    found = leave_one_out(equal, different, s.n_yes, s.n_trials)
    answers = [s.n_yes, s.n_trials - s.n_yes]
    each = np.concatenate([np.repeat(found.values[a], answers[a]) for a in (0, 1)])  # one value per trial
    assert len(each) == s.total_trials
    assert found.elpd == pytest.approx(each.sum(), rel=1e-12)
    assert found.se == pytest.approx(np.sqrt(len(each)) * each.std(ddof=1), rel=1e-9)
    assert np.nanmax(found.pareto_k) < 0.5
    free = leave_one_out_frequencies(s.n_yes, s.n_trials)
    difference, error = found.minus(free)
    both = np.concatenate([np.repeat(free.values[a], answers[a]) for a in (0, 1)])
    assert difference == pytest.approx(found.elpd - free.elpd, abs=1e-9)
    assert error == pytest.approx(np.sqrt(len(each)) * (each - both).std(ddof=1), rel=1e-9)


def test_free_frequencies_are_beta_integrals():
    trial, pair = leave_one_out_frequencies(K, N), leave_one_out_frequencies(K, N, unit="pair")
    for i, (k, n) in enumerate(zip(K, N, strict=True)):

        def mean(answer, k, n):  # of P(answer) under the posterior of k 'equal' answers in n
            top = quad(lambda q: (q if answer == 0 else 1 - q) * q**k * (1 - q) ** (n - k), 0, 1, epsabs=0, epsrel=1e-11)[0]
            return top / quad(lambda q: q**k * (1 - q) ** (n - k), 0, 1, epsabs=0, epsrel=1e-11)[0]

        for answer, given in enumerate((k, n - k)):
            if given:
                assert trial.values[answer, i] == pytest.approx(np.log(mean(answer, k - (answer == 0), n - 1)), abs=1e-9)
            else:
                assert np.isnan(trial.values[answer, i])
        direct = quad(lambda q, k=k, n=n: q**k * (1 - q) ** (n - k), 0, 1, epsabs=0, epsrel=1e-11)[0]
        assert pair.values[0, i] == pytest.approx(np.log(direct), abs=1e-9)
    assert np.isfinite([trial.elpd, trial.se, pair.elpd, pair.se]).all()
    assert trial.counts.sum() == N.sum()
    subject = bt.Subject("S", [0.0, 0.1, 0.2, 0.3], np.zeros(4), K, N)
    assert pair.elpd == pytest.approx(frequency_evidence(subject), rel=1e-13)
    assert np.isnan(leave_one_out_frequencies([3], [5], unit="pair").se)  # one unit


def test_importance_sampling_of_free_frequencies_fails_for_pairs_and_so_needs_the_closed_form():
    # Without its own answers a frequency is uniform, and its posterior no proposal for that: k-hat tends to n/(n + 1).
    draws = np.random.default_rng(2).beta(K + 1, N - K + 1, size=(20_000, 4))
    found = of_unit("pair", np.log(draws), np.log1p(-draws), K, N)
    assert (found.pareto_k > 0.7).all()
    assert np.isnan([found.elpd, found.se]).all()
    assert np.isnan(found.values).all()
    assert found.note.startswith("leave-one-out by pair withheld")
    assert "pair 2" in found.note
    trial = leave_one_out(np.log(draws), np.log1p(-draws), K, N)  # one trial of many is no trouble
    assert trial.note == ""
    assert trial.elpd == pytest.approx(leave_one_out_frequencies(K, N).elpd, abs=0.02)
    rare = np.random.default_rng(2).beta(0.2, 3.0, size=(5_000, 1))
    found = leave_one_out(np.log(rare), np.log1p(-rare), [1], [4])
    assert np.isnan(found.elpd)
    assert "pair 1 ('equal')" in found.note
    assert "'different'" not in found.note
    assert np.isfinite(found.values[1, 0])


def test_answers_never_given_need_no_probability():
    q = np.random.default_rng(2).uniform(0.2, 0.3, size=(500, 1))
    with np.errstate(divide="ignore"):
        equal = np.log(np.column_stack([q, 0 * q]))
    different = np.log1p(-np.exp(equal))
    found = leave_one_out(equal, different, [3, 0], [5, 7])
    assert found.values[1, 1] == 0.0  # 'different' for sure
    assert np.isfinite(found.elpd)


def test_joined_subjects_are_all_their_units():
    parts = [leave_one_out_frequencies(K, N, unit="pair"), leave_one_out_frequencies(K[:2], N[:2], unit="pair")]
    joined = LeaveOneOut.joined(parts)
    each = np.concatenate([one.values[0] for one in parts])
    assert joined.elpd == pytest.approx(sum(one.elpd for one in parts))
    assert joined.se == pytest.approx(np.sqrt(6) * each.std(ddof=1))


# --- pairs, by the proposal ---------------------------------------------------------------------------------------------------------

#: Sure of a value that is uncertain by 0.022 at most, and of a fit by 0.005, in fewer than one of 10,000 cases.
TOLERANCE = 0.1


def found(name, model):
    """The posterior of a bundled subject, what was fitted to it, and its pairs left out."""
    study = bt.example_study()
    target = model_named(model).posterior(study[name], prior_for(study, None))
    result, fitted = fitted_result(target, 1, Wanted(evidence_draws=20_000))
    return target, fitted, result.evidence, left_out_pairs(fitted.proposal, fitted.maxima, result.evidence, 1)


def refitted(target, pair, evidence):
    return evidence.value - log_evidence_without(target, pair, np.random.default_rng(5))


def by_weights(target, fitted):
    draws = fitted.proposal.draws
    nothing = np.zeros(target.subject.n_pairs, bool)
    weights = draws.log_prior - draws.log_proposal
    return weighted_pairs(target.pair_log_likelihood(draws.x), weights, target.subject.n_trials, withheld=nothing)


# By the posterior's own draws the first has k-hat 0.86; of the last two too few draws count, and it is refitted.
@pytest.mark.parametrize(
    ("name", "model", "pair"), [("S01", "mean-reverting memory", 7), ("S05", "free weighting", 0), ("S13", "no lapses", 0)]
)
def test_weights_agree_with_fits_without_the_pair(name, model, pair):
    target, _, evidence, pairs = found(name, model)
    assert np.isfinite(pairs.values).all()
    assert pairs.note == ""
    assert pairs.elpd == pytest.approx(pairs.values.sum(), rel=1e-12)
    assert pairs.values[0, pair] == pytest.approx(refitted(target, pair, evidence), abs=TOLERANCE)


def test_mass_behind_the_wall_of_a_pair_is_found_where_no_draw_is():
    target, fitted, evidence, pairs = found("S11", "no lapses")
    alone, truth = by_weights(target, fitted), refitted(target, 1, evidence)
    assert alone.pareto_k[0, 1] < 0.5
    assert alone.values[0, 1] > truth + 1.0  # nothing in the weights tells
    assert pairs.values[0, 1] == pytest.approx(truth, abs=TOLERANCE)


def test_maxima_of_all_answers_lead_to_every_maximum_without_a_pair_that_the_grid_finds():
    study = bt.example_study()
    target = model_named("no lapses").posterior(study["S08"], prior_for(study, None))
    for pair in (3, 11):  # walls, behind which there is mass
        rest = target.for_subject(without(target.subject, pair))
        grid, ours = find_maxima(rest), find_maxima(rest, find_maxima(target).all)
        near = grid.x[grid.value > grid.value[0] - 10.0]
        assert (np.abs(near[:, None] - ours.all).max(axis=2).min(axis=1) < 1e-2).all()
        assert ours.value[0] > grid.value[0] - 1e-6


def test_where_an_answer_is_impossible_draws_count_for_the_other_answers_only():
    rng = np.random.default_rng(3)
    logs = np.log(rng.uniform(0.4, 0.6, (4000, 2)))
    logs[::2, 0] = -np.inf
    pairs = weighted_pairs(logs, np.zeros(4000), [1, 1], withheld=np.zeros(2, bool))
    p = np.exp(logs)
    exact = np.log(p.prod(axis=1).mean()) - np.log(p[:, ::-1].mean(axis=0))
    assert pairs.values[0] == pytest.approx(exact, abs=1e-3)
    kept = weighted_pairs(logs, np.zeros(4000), [1, 1], withheld=np.array([True, False]))
    assert np.isnan(kept.values[0, 0])
    assert "pair 1" in kept.note
    assert kept.values[0, 1] == pairs.values[0, 1]
    few = logs.copy()
    few[160:, 1] = -30.0  # 80 draws count: too few, however even their weights
    assert np.isnan(weighted_pairs(few, np.zeros(4000), [1, 1], withheld=np.zeros(2, bool)).values[0, 0])


def test_chains_take_over_where_more_draws_are_asked_for_than_the_proposal_has(small_study, monkeypatch):
    asked = []
    sample = model_row.sample_chains

    def counted(fitted, settings, seed):
        asked.append(settings.draws)
        return sample(fitted, settings, seed)

    monkeypatch.setattr(model_row, "sample_chains", counted)
    one, other = (compare_one(small_study["C"], model_named("symmetric"), draws=n, seed=1, prior=bt.Prior()) for n in (1000, 15_000))
    assert asked == [15_000]
    assert one.log_evidence == other.log_evidence
    assert one.checks.elpd_loo_trial == pytest.approx(other.checks.elpd_loo_trial, abs=0.2)
    assert one.left_out["pair"].values == pytest.approx(other.left_out["pair"].values)  # by the proposal in either case
    assert one.checks.p_predictive == pytest.approx(other.checks.p_predictive, abs=0.06)
