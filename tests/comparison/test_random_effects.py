"""Sampled model frequencies against the sum over all assignments, quadrature, known limits, and themselves."""

import itertools

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.special import gammaln, logsumexp
from scipy.stats import gamma

from bayes_toe.comparison.random_effects import random_effects

#: Of 5 s.e. from 20 repeats, Student's t with 19 degrees of freedom: a false alarm in 12,000.
SURE = 5.0
UNEVEN = np.random.default_rng(3).normal(size=(5, 3)) * 2.5 + [0.0, 1.0, -0.5]


def log_beta(alpha):
    return gammaln(alpha).sum() - gammaln(np.sum(alpha))


def largest(alpha):
    """P(r_k is the largest) for r ~ Dirichlet(alpha): gamma variables, one density times the others' distribution functions."""
    x = np.exp(np.linspace(-60.0, 6.0, 4000))
    below, density = gamma.cdf(x[:, None], alpha), gamma.pdf(x[:, None], alpha)
    return [
        trapezoid(density[:, k] * np.delete(below, k, axis=1).prod(axis=1), x)
        for k in range(len(alpha))
    ]


def enumerated(log_l):
    """Log evidence, expected frequencies and exceedance by one term per assignment of models to subjects."""
    n, k = log_l.shape
    terms = {}
    for assignment in itertools.product(range(k), repeat=n):
        counts = tuple(np.bincount(assignment, minlength=k))
        terms.setdefault(counts, []).append(log_l[np.arange(n), assignment].sum())
    alphas = [1.0 + np.array(counts) for counts in terms]
    logs = [
        logsumexp(of_one) + log_beta(alpha) - log_beta(np.ones(k))
        for of_one, alpha in zip(terms.values(), alphas, strict=True)
    ]
    total = logsumexp(logs)
    weights = np.exp(logs - total)
    return (
        total,
        weights @ [alpha / alpha.sum() for alpha in alphas],
        weights @ [largest(alpha) for alpha in alphas],
    )


def agree(found, total, expected, exceedance):
    assert abs(found.log_evidence - total) < SURE * found.log_evidence_se + 1e-12
    assert (np.abs(found.expected - expected) < SURE * found.expected_se + 1e-12).all()
    assert (np.abs(found.exceedance - exceedance) < SURE * found.exceedance_se + 1e-5).all()
    odds = np.exp(found.log_evidence_equal - total)
    risk_se = found.omnibus_risk * (1.0 - found.omnibus_risk) * found.log_evidence_se
    assert abs(found.omnibus_risk - odds / (1 + odds)) < SURE * risk_se + 1e-12


@pytest.mark.parametrize("shape", [(5, 3), (5, 2), (1, 2), (3, 6), (5, 4)])
def test_frequencies_are_those_of_the_sum_over_assignments(shape):
    log_l = (
        UNEVEN[:, : shape[1]]
        if shape[1] < 4 and shape[0] == 5
        else np.random.default_rng(shape[1]).normal(size=shape) * 2
    )
    found = random_effects(log_l, seed=3)
    agree(found, *enumerated(log_l))
    assert found.log_evidence_equal == pytest.approx(
        np.log(np.exp(log_l).mean(axis=1)).sum(), rel=1e-12
    )
    assert found.log_evidence_se < 0.02
    assert max(found.expected_se) < 0.005
    assert found.protected.sum() == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(("size", "spread"), [(20, 2.0), (300, 0.3), (300, 4.0)])
def test_two_models_by_quadrature_over_their_frequency(size, spread):
    log_l = np.random.default_rng(size).normal(size=(size, 2)) * spread + [0.3, 0.0]
    log_l[:3, 0] = -np.inf
    found = random_effects(log_l, seed=1)
    t = np.linspace(-30.0, 30.0, 40_001)  # logit of the frequency
    r = 1 / (1 + np.exp(-t))
    logs = np.log(r[:, None] * np.exp(log_l[:, 0]) + (1 - r[:, None]) * np.exp(log_l[:, 1])).sum(
        axis=1
    )
    logs += np.log(r * (1 - r))
    weights = np.exp(logs - logs.max())
    total = logs.max() + np.log(trapezoid(weights, t))
    weights /= weights.sum()
    agree(
        found,
        total,
        [weights @ r, weights @ (1 - r)],
        [weights[r > 0.5].sum(), weights[r < 0.5].sum()],
    )


def test_where_assignments_are_sure_or_say_nothing_there_is_no_error_of_the_evidence():
    log_l = 500.0 * np.eye(3)[[0, 0, 1, 2, 0]]
    sure = random_effects(log_l)
    assert sure.expected == pytest.approx([0.5, 0.25, 0.25], abs=1e-12)
    assert sure.log_evidence == pytest.approx(
        2500.0 + log_beta([4, 2, 2]) - log_beta([1, 1, 1]), abs=1e-9
    )
    alike = random_effects(np.tile([50.0, 0.0], (9, 1)))
    assert alike.exceedance == pytest.approx(
        [1 - 0.5**10, 0.5**10], abs=SURE * 1e-3
    )  # Beta(10, 1) above one half
    assert alike.omnibus_risk == pytest.approx(
        1 / (1 + 2**9 / 10), rel=1e-6
    )  # B(10, 1)/B(1, 1) against 2^-9
    none = random_effects(np.full((300, 13), -7.0))
    assert none.omnibus_risk == pytest.approx(0.5, abs=1e-9)  # both explain nothing
    assert none.log_evidence_se < 1e-9
    assert (np.abs(none.exceedance - 1 / 13) < SURE * none.exceedance_se).all()


def test_many_subjects_and_models_have_an_error_and_the_same_seed_the_same_numbers():
    rng = np.random.default_rng(5)
    true = rng.choice(13, size=100, p=np.r_[0.5, 0.3, np.full(11, 0.2 / 11)])
    log_l = rng.normal(size=(100, 13)) + 3.0 * np.eye(13)[true]
    one, same, other = (random_effects(log_l, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(one.expected, same.expected)
    assert one.log_evidence == same.log_evidence
    assert (
        np.abs(one.expected - other.expected) < SURE * np.hypot(one.expected_se, other.expected_se)
    ).all()
    assert abs(one.log_evidence - other.log_evidence) < SURE * np.hypot(
        one.log_evidence_se, other.log_evidence_se
    )
    assert one.expected.sum() == pytest.approx(1.0, abs=1e-12)
    assert one.exceedance[0] > 0.9


def test_only_differences_within_a_subject_count_and_one_subject_does_not_decide():
    shifted = UNEVEN + np.array([[5.0], [-300.0], [0.1], [1e4], [0.0]])
    assert random_effects(shifted).expected == pytest.approx(
        random_effects(UNEVEN).expected, abs=1e-9
    )
    one_sure = np.column_stack([np.zeros(12), np.r_[np.full(11, -3.0), 100.0]])
    assert random_effects(one_sure).expected[0] > 0.75
