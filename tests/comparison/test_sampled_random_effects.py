"""Sampled model frequencies against the exact sum, against known limits, and against themselves."""

import numpy as np
import pytest

from bayes_toe.comparison.exact_random_effects import exact_random_effects
from bayes_toe.comparison.sampled_random_effects import sampled_random_effects
from bayes_toe.errors import InputError

#: Of 5 s.e. from 20 repeats, Student's t with 19 degrees of freedom: a false alarm in 12,000.
SURE = 5.0


def tables():
    rng = np.random.default_rng(7)
    yield pytest.param(rng.normal(size=(20, 8)) * 2, 1.0, id="20 subjects, 8 models")
    yield pytest.param(rng.normal(size=(9, 13)) * 2, 0.3, id="9 subjects, 13 models, another prior")
    yield pytest.param(rng.normal(size=(150, 4)) * 0.3, 1.0, id="subjects who say little")
    clear = rng.normal(size=(200, 3)) * 3 + [0.0, 1.0, 2.0]
    clear[:20, 0] = -np.inf
    yield pytest.param(clear, 2.0, id="a model that some rule out")


@pytest.mark.parametrize(("log_l", "prior"), list(tables()))
def test_sampling_agrees_with_the_exact_sum_within_its_errors(log_l, prior):
    exact, found = exact_random_effects(log_l, prior=prior), sampled_random_effects(log_l, prior=prior, seed=3)
    assert abs(found.log_evidence - exact.log_evidence) < SURE * found.log_evidence_se
    assert (np.abs(found.expected - exact.expected) < SURE * found.expected_se).all()
    assert (np.abs(found.exceedance - exact.exceedance) < SURE * found.exceedance_se + 1e-5).all()
    assert abs(found.omnibus_risk - exact.omnibus_risk) < SURE * found.omnibus_risk_se + 1e-12
    assert found.log_evidence_se < 0.02
    assert (found.expected_se < 0.1 * found.draws.std(axis=0)).all()
    # Quantiles of 20,000 draws, particles as good as a few thousand independent ones.
    within = [(found.draws[:, [k]] < limits).mean(axis=0) for k, limits in enumerate(exact.interval(0.8))]
    assert np.array(within) == pytest.approx(np.tile([0.1, 0.9], (len(within), 1)), abs=0.03)
    assert found.interval(0.8) == pytest.approx(np.quantile(found.draws, [0.1, 0.9], axis=0).T)


def test_where_assignments_are_sure_or_say_nothing_there_is_no_error_of_the_evidence():
    sure = sampled_random_effects(500.0 * np.eye(3)[[0, 0, 1, 2, 0]])
    assert sure.expected == pytest.approx([0.5, 0.25, 0.25], abs=1e-12)
    assert sure.log_evidence == pytest.approx(exact_random_effects(500.0 * np.eye(3)[[0, 0, 1, 2, 0]]).log_evidence, abs=1e-10)
    none = sampled_random_effects(np.full((300, 13), -7.0))
    assert none.omnibus_risk == pytest.approx(0.5, abs=1e-9)
    assert none.log_evidence_se < 1e-9


def test_many_subjects_and_models_have_an_error_and_the_same_seed_the_same_numbers():
    rng = np.random.default_rng(5)
    true = rng.choice(13, size=100, p=np.r_[0.5, 0.3, np.full(11, 0.2 / 11)])
    log_l = rng.normal(size=(100, 13)) + 3.0 * np.eye(13)[true]
    one, same, other = (sampled_random_effects(log_l, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(one.expected, same.expected)
    assert one.log_evidence == same.log_evidence
    assert (np.abs(one.expected - other.expected) < SURE * np.hypot(one.expected_se, other.expected_se)).all()
    assert abs(one.log_evidence - other.log_evidence) < SURE * np.hypot(one.log_evidence_se, other.log_evidence_se)
    assert one.expected.sum() == pytest.approx(1.0, abs=1e-12)
    assert one.exceedance[0] > 0.9


def test_it_refuses_what_the_others_refuse_and_leaves_out_by_name():
    with pytest.raises(InputError, match="no evidence for model 1"):
        sampled_random_effects([[np.nan, 0.0], [0.0, 1.0]])
    assert sampled_random_effects([[np.nan, 0.0], [0.0, 1.0]], subjects=["A", "B"], leave_out=True).left_out == ("A",)
