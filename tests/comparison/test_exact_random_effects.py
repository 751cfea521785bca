"""The exact sum over assignments against their enumeration, Monte Carlo of the Dirichlet, and known limits."""

import itertools

import numpy as np
import pytest
from assignments import UNEVEN, enumerated, log_beta
from scipy.special import logsumexp

from bayes_toe.comparison.exact_random_effects import exact_random_effects, exact_terms, is_affordable
from bayes_toe.comparison.random_effects import random_effects
from bayes_toe.errors import InputError


@pytest.mark.parametrize("prior", [1.0, 0.3, 4.0])
@pytest.mark.parametrize("n_models", [2, 3])
def test_the_exact_sum_is_the_enumeration(prior, n_models):
    log_l = UNEVEN[:, :n_models]
    found = exact_random_effects(log_l, prior=prior)
    total, expected, exceedance = enumerated(log_l, prior)
    assert found.log_evidence == pytest.approx(total, abs=1e-12)
    assert found.expected == pytest.approx(expected, abs=1e-13)
    assert found.exceedance == pytest.approx(exceedance, abs=1e-12)
    odds = np.exp(found.log_evidence_equal - total)
    assert found.omnibus_risk == pytest.approx(odds / (1 + odds), rel=1e-12)
    assert found.log_evidence_equal == pytest.approx(np.log(np.exp(log_l).mean(axis=1)).sum(), rel=1e-13)


def test_the_exact_sum_by_drawing_frequencies_from_the_prior():
    r = np.random.default_rng(8).dirichlet(np.ones(3), 400_000)
    likelihood = np.prod(r @ np.exp(UNEVEN).T, axis=1)
    found = exact_random_effects(UNEVEN)
    relative_error = likelihood.std() / likelihood.mean() / np.sqrt(len(r))
    assert np.exp(found.log_evidence) == pytest.approx(likelihood.mean(), rel=4 * relative_error)
    weights = likelihood / likelihood.sum()
    error = 4 * np.sqrt((weights**2).sum())  # the sd of r or of an indicator is below 1
    assert found.expected == pytest.approx(weights @ r, abs=error)
    assert found.exceedance == pytest.approx(np.bincount(r.argmax(axis=1), weights), abs=error)


@pytest.mark.parametrize(("n_subjects", "n_models"), [(1, 2), (5, 4), (3, 6), (1, 5)])
def test_the_exact_sum_is_the_enumeration_for_other_sizes(n_subjects, n_models):
    log_l = np.random.default_rng(n_models).normal(size=(n_subjects, n_models)) * 2
    found = exact_random_effects(log_l)
    total, expected, exceedance = enumerated(log_l, 1.0)
    assert found.log_evidence == pytest.approx(total, abs=1e-12)
    assert found.expected == pytest.approx(expected, abs=1e-13)
    assert found.exceedance == pytest.approx(exceedance, abs=1e-11)


def test_how_many_subjects_follow_a_model_is_that_of_the_enumeration():
    found = exact_random_effects(UNEVEN, prior=0.7)
    weights = np.zeros((3, 6))
    for assignment in itertools.product(range(3), repeat=5):
        counts = np.bincount(assignment, minlength=3)
        weights[np.arange(3), counts] += np.exp(UNEVEN[np.arange(5), assignment].sum() + log_beta(0.7 + counts))
    assert found.count_probability == pytest.approx(weights / weights[0].sum(), abs=1e-13)


def test_intervals_of_frequencies_hold_their_share_of_draws():
    exact, variational = exact_random_effects(UNEVEN, prior=0.7), random_effects(UNEVEN, prior=0.7)
    rng = np.random.default_rng(6)
    for k, limits in enumerate(exact.interval(0.8)):
        n = rng.choice(6, size=200_000, p=exact.count_probability[k] / exact.count_probability[k].sum())
        below = (rng.beta(0.7 + n, 5 - n + 2 * 0.7)[:, None] < limits).mean(axis=0)
        assert below == pytest.approx([0.1, 0.9], abs=4.5 * 0.3 / np.sqrt(200_000))
    below = (rng.dirichlet(variational.alpha, 200_000)[:, :, None] < variational.interval(0.8)).mean(axis=0)
    assert below == pytest.approx(np.tile([0.1, 0.9], (3, 1)), abs=4.5 * 0.3 / np.sqrt(200_000))
    sure = 500.0 * np.eye(3)[[0, 0, 1, 2, 0]]  # one Dirichlet: both are the same
    assert exact_random_effects(sure).interval() == pytest.approx(random_effects(sure).interval(), abs=1e-9)
    for level in (0.0, 1.0, np.nan):
        with pytest.raises(InputError, match="level="):
            exact.interval(level)


def test_where_the_assignment_is_sure_both_are_one_dirichlet():
    log_l = 200.0 * np.eye(3)[[0, 0, 0, 1, 1, 2, 0]]
    found, exact = random_effects(log_l), exact_random_effects(log_l)
    assert found.alpha == pytest.approx([5, 3, 2], abs=1e-12)
    assert found.log_evidence == pytest.approx(exact.log_evidence, abs=1e-10)
    assert found.exceedance == pytest.approx(exact.exceedance, abs=1e-10)
    assert exact.expected == pytest.approx([0.5, 0.3, 0.2], abs=1e-12)


def test_eight_models_and_sixteen_subjects_are_within_reach():
    log_l = np.random.default_rng(0).normal(size=(16, 4)) * 2
    found = exact_random_effects(np.column_stack([log_l, np.full((16, 4), -np.inf)]), prior=1.0)
    same = exact_random_effects(log_l[:, :2])
    assert found.exceedance_error < 1e-11
    assert found.expected[4:] == pytest.approx(np.full(4, 1 / 24), abs=1e-12)
    assert same.exceedance_error < 1e-11
    with pytest.raises(InputError, match="1081575 terms"):
        exact_random_effects(np.zeros((17, 9)))
    with pytest.raises(InputError, match="271953 terms, allowed are 1000000, and 200000000 times subjects"):
        exact_random_effects(np.zeros((736, 3)))


@pytest.mark.parametrize(("n_models", "most"), [(2, 14_141), (3, 735), (4, 179), (5, 67), (6, 38), (7, 26), (8, 20)])
def test_most_subjects_of_an_exact_sum(n_models, most):
    assert is_affordable(most, n_models)
    assert not is_affordable(most + 1, n_models)
    assert exact_terms(3, n_models) == len({tuple(sorted(one)) for one in itertools.product(range(n_models), repeat=3)})


def test_the_exact_sum_of_sixteen_subjects_and_eight_models_by_drawing():
    log_l = np.random.default_rng(10).normal(size=(16, 8)) * 2
    found = exact_random_effects(log_l)
    near = 1.0 + 0.3 * (random_effects(log_l).alpha - 1.0)  # wider than the posterior
    r = np.random.default_rng(11).dirichlet(near, 300_000)
    log_weights = np.log(r @ np.exp(log_l).T).sum(axis=1) - log_beta(np.ones(8)) - np.log(r) @ (near - 1.0) + log_beta(near)
    total = logsumexp(log_weights)
    weights = np.exp(log_weights - total)
    error = 4.5 * np.sqrt((weights**2).sum())
    assert error < 0.015
    assert found.log_evidence == pytest.approx(total - np.log(len(r)), abs=error)
    assert found.expected == pytest.approx(weights @ r, abs=error)
    assert found.exceedance == pytest.approx(np.bincount(r.argmax(axis=1), weights), abs=error)
    for k, limits in enumerate(found.interval(0.8)):
        assert (weights[:, None] * (r[:, [k]] < limits)).sum(axis=0) == pytest.approx([0.1, 0.9], abs=error)
