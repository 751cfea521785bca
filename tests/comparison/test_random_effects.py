"""Model frequencies against enumeration of all assignments, Monte Carlo of the Dirichlet, adaptive quadrature, and known limits."""

import itertools

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad
from scipy.optimize import minimize
from scipy.special import gammaln, logsumexp, softmax

from bayes_toe.comparison.random_effects import (
    exact_random_effects,
    exact_terms,
    exceedance_probabilities,
    fixed_effects,
    is_affordable,
    random_effects,
)
from bayes_toe.errors import InputError

RNG = np.random.default_rng(3)
UNEVEN = RNG.normal(size=(5, 3)) * 2.5 + [0.0, 1.0, -0.5]


def log_beta(alpha):
    return gammaln(alpha).sum() - gammaln(np.sum(alpha))


def enumerated(log_l, prior):
    """Log evidence, expected frequencies and exceedance by one term per assignment."""
    n, k = log_l.shape
    terms, alphas = [], []
    for assignment in itertools.product(range(k), repeat=n):
        alphas.append(prior + np.bincount(assignment, minlength=k))
        terms.append(log_l[np.arange(n), assignment].sum() + log_beta(alphas[-1]) - log_beta(np.full(k, prior)))
    total = logsumexp(terms)
    weights = np.exp(terms - total)
    means = [alpha / alpha.sum() for alpha in alphas]
    return total, weights @ means, weights @ [exceedance_probabilities(alpha)[0] for alpha in alphas]


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


@pytest.mark.parametrize("n_models", [2, 3])
def test_the_variational_bound_is_its_definition_and_lies_below_the_exact_sum(n_models):
    log_l = UNEVEN[:, :n_models]
    found = random_effects(log_l, prior=0.7)
    draws = np.log(np.random.default_rng(4).dirichlet(found.alpha, 200_000))
    g = found.responsibilities
    prior = np.full(n_models, 0.7)
    # E[ln p(y, m, r)] - E[ln q(m)] - E[ln q(r)], the expectation over r by drawing.
    over_r = draws @ (g.sum(axis=0) + prior - found.alpha)
    drawn = (g * (log_l - np.log(g))).sum() + over_r - log_beta(prior) + log_beta(found.alpha)
    assert found.log_evidence == pytest.approx(drawn.mean(), abs=1e-9 + 4 * drawn.std() / np.sqrt(len(draws)))
    exact = exact_random_effects(log_l, prior=0.7)
    assert exact.log_evidence - 0.6 < found.log_evidence < exact.log_evidence
    assert found.omnibus_risk > exact.omnibus_risk
    assert g.sum(axis=1) == pytest.approx(np.ones(5), abs=1e-14)
    assert found.alpha == pytest.approx(0.7 + g.sum(axis=0), abs=1e-11)
    assert found.protected.sum() == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("prior", [1.0, 0.6])
def test_the_fixed_point_is_the_highest_bound_that_a_general_optimiser_finds(prior):
    def lower(logits):
        g = softmax(logits.reshape(UNEVEN.shape), axis=1)
        return -((g * (UNEVEN - np.log(g))).sum() + log_beta(prior + g.sum(axis=0)) - log_beta(np.full(3, prior)))

    best = minimize(lower, UNEVEN.ravel(), method="BFGS", options={"gtol": 1e-7})
    found = random_effects(UNEVEN, prior=prior)
    assert -1e-9 < found.log_evidence + best.fun < 1e-7
    assert found.responsibilities == pytest.approx(softmax(best.x.reshape(UNEVEN.shape), axis=1), abs=1e-3)


def test_where_the_assignment_is_sure_both_are_one_dirichlet():
    log_l = 200.0 * np.eye(3)[[0, 0, 0, 1, 1, 2, 0]]
    found, exact = random_effects(log_l), exact_random_effects(log_l)
    assert found.alpha == pytest.approx([5, 3, 2], abs=1e-12)
    assert found.log_evidence == pytest.approx(exact.log_evidence, abs=1e-10)
    assert found.exceedance == pytest.approx(exact.exceedance, abs=1e-10)
    assert exact.expected == pytest.approx([0.5, 0.3, 0.2], abs=1e-12)


def test_without_information_nothing_is_preferred():
    for n_models in (2, 4):
        found = random_effects(np.full((40, n_models), -3.0))
        even = np.full(n_models, 1 / n_models)
        assert found.expected == pytest.approx(even, abs=1e-9)
        assert found.exceedance == pytest.approx(even, abs=1e-9)
        assert found.protected == pytest.approx(even, abs=1e-9)
        assert found.omnibus_risk > 0.8
        assert exact_random_effects(np.full((10, n_models), -3.0)).omnibus_risk == pytest.approx(0.5, abs=1e-12)  # both explain nothing


def test_all_subjects_alike_and_sure():
    found = random_effects(np.tile([50.0, 0.0], (9, 1)))
    assert found.expected == pytest.approx([10 / 11, 1 / 11], abs=1e-9)
    assert found.exceedance == pytest.approx([1 - 0.5**10, 0.5**10], abs=1e-9)  # Beta(10, 1) above one half
    assert found.omnibus_risk == pytest.approx(1 / (1 + 2**9 / 10), rel=1e-6)  # B(10, 1)/B(1, 1) against 2^-9
    assert found.group_log_evidence.tolist() == [450.0, 0.0]


def test_only_differences_within_a_subject_count_and_names_follow_their_models():
    shifted = UNEVEN + np.array([[5.0], [-300.0], [0.1], [1e4], [0.0]])
    one, two = random_effects(UNEVEN), random_effects(shifted[:, ::-1])
    assert two.alpha[::-1] == pytest.approx(one.alpha, abs=1e-9)
    assert two.protected[::-1] == pytest.approx(one.protected, abs=1e-8)


@pytest.mark.parametrize("alpha", [[1.3, 4.0], [0.4, 2.0, 7.5], [3.0, 3.5, 2.0, 12.0, 9.0], [120.0, 110.0, 1.0], [40.0] * 12])
def test_exceedance_by_drawing(alpha):
    draws = np.random.default_rng(5).dirichlet(alpha, 400_000).argmax(axis=1)
    found, error = exceedance_probabilities(alpha)
    share = np.bincount(draws, minlength=len(alpha)) / len(draws)
    assert found == pytest.approx(share, abs=4.5 * 0.5 / np.sqrt(len(draws)))
    assert error < 1e-11


@pytest.mark.parametrize("alpha", [[2.0, 3.0, 2.5], [0.2, 0.3, 1.0], [40.0, 1.0, 38.0, 45.0]])
def test_exceedance_by_adaptive_quadrature(alpha):
    gammas = [stats.gamma(a) for a in alpha]
    for k, value in enumerate(exceedance_probabilities(alpha)[0]):
        others = [g for j, g in enumerate(gammas) if j != k]
        direct = quad(lambda u, k=k, others=others: np.prod([g.cdf(gammas[k].ppf(u)) for g in others]), 0, 1, epsabs=1e-11, limit=400)[0]
        assert value == pytest.approx(direct, abs=1e-9)


@pytest.mark.parametrize("alpha", [[0.01, 0.01, 0.01], [0.01, 1e6, 1e6], [1e6, 1e6, 1e6, 1e6]])
def test_exceedance_at_the_ends(alpha):
    found, error = exceedance_probabilities(alpha)
    top = np.asarray(alpha) == max(alpha)
    assert found == pytest.approx(np.where(top, 1 / top.sum(), 0.0), abs=1e-8)
    assert error < 1e-8


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


def test_fixed_effects_are_sums():
    group, probability = fixed_effects(UNEVEN)
    assert group == pytest.approx(UNEVEN.sum(axis=0))
    assert probability == pytest.approx(np.exp(group) / np.exp(group).sum())
    with pytest.raises(InputError, match="rules out some subject"):
        fixed_effects([[0.0, -np.inf], [-np.inf, 0.0]])


def test_one_subject_decides_fixed_effects_but_not_random_effects():
    log_l = np.column_stack([np.zeros(12), np.r_[np.full(11, -3.0), 100.0]])
    assert fixed_effects(log_l)[1][1] > 0.999
    assert random_effects(log_l).expected[0] > 0.75


def test_withheld_evidences_are_refused_by_name_or_left_out_by_name():
    log_l = UNEVEN.copy()
    log_l[1, 2] = log_l[3, 0] = np.nan
    who = ["A", "B", "C", "D", "E"]
    with pytest.raises(InputError) as caught:
        random_effects(log_l, subjects=who, models=["H0", "H1", "H2"])
    assert len(caught.value.problems) == 2
    assert caught.value.problems[0].startswith("subject B: no evidence for model H2")
    found = random_effects(log_l, subjects=who, leave_out=True)
    assert (found.subjects, found.left_out) == (("A", "C", "E"), ("B", "D"))
    assert found.alpha == pytest.approx(random_effects(log_l[[0, 2, 4]]).alpha, abs=1e-9)
    assert exact_random_effects(log_l, subjects=who, leave_out=True).left_out == ("B", "D")


@pytest.mark.parametrize(
    ("log_l", "options", "message"),
    [
        ([[1.0], [2.0]], {}, "at least two models"),
        ([1.0, 2.0], {}, "at least two models"),
        (np.zeros((0, 2)), {}, "at least two models"),
        ([[0.0, np.inf]], {}, r"subject 1: a log evidence is \+inf"),
        ([[-np.inf, -np.inf]], {}, "all are -inf"),
        ([[np.nan, 0.0]], {"leave_out": True}, "no subject has"),
        ([[0.0, 1.0]], {"prior": 0.0}, "prior=0"),
        ([[0.0, 1.0]], {"models": ["a", "a"]}, "models: 2 names"),
        ([[0.0, 1.0]], {"subjects": ["a", "b"]}, "subjects: 2 names, allowed are 1"),
    ],
)
def test_bad_input_is_refused(log_l, options, message):
    with pytest.raises(InputError, match=message):
        random_effects(log_l, **options)


def test_the_table_of_models():
    frame = random_effects(UNEVEN, models=["H0", "H1", "H2"]).frame()
    assert list(frame) == ["model", "alpha", "expected", "exceedance", "protected", "group_log_evidence", "omnibus_risk"]
    assert frame["model"].tolist() == ["H0", "H1", "H2"]
