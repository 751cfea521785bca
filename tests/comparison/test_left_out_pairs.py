"""Pairs left out by the weights of one proposal: against fits without the pair, behind walls, and where an answer is impossible."""

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.comparison import model_row
from bayes_toe.comparison.leave_one_out import weighted_pairs
from bayes_toe.comparison.left_out_pairs import _of_pairs, left_out_pairs, log_evidence_without
from bayes_toe.comparison.model_row import compare_one
from bayes_toe.inference.modes import find_maxima
from bayes_toe.inference.subject import Wanted, fitted_result
from bayes_toe.model.ladder import model_named
from bayes_toe.model.study_prior import prior_for

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
        rest = target.for_subject(_of_pairs(target.subject, np.arange(target.subject.n_pairs) != pair))
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
