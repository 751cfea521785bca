"""The variational scheme against its definition, a general optimiser, the exact sum, and known limits."""

import numpy as np
import pytest
from assignments import UNEVEN, log_beta
from scipy.optimize import minimize
from scipy.special import softmax

from bayes_toe.comparison.exact_random_effects import exact_random_effects
from bayes_toe.comparison.random_effects import fixed_effects, random_effects
from bayes_toe.errors import InputError


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
