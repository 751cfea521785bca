"""Groups whose truth is known, invariance, the public studies, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import refused
from numpy.random import default_rng
from populations import made_result, simulated_group, two_conditions
from scipy.stats import norm

import bayes_toe as bt
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.groups.predictive_check import CONTRADICTED, contradictions, predictive_check
from bayes_toe.groups.zero_mean import zero_mean
from bayes_toe.model.parameters import task_parameters


@pytest.fixture(scope="module")
def result():
    """The result of ten subjects: constant errors of .6 D on average with an SD of .2, p of .25."""
    study = simulated_group(7, n_subjects=10, n_each=60, mean_c=0.6, sd_c=0.2, mean_p=0.25)
    return bt.population(study, draws=1600, seed=1)


def test_the_intervals_of_a_group_hold_the_true_values(result):
    assert result.is_reliable
    assert result.problems == ()
    row = result.table.row
    constant_error = row("mean", "constant_error")
    contraction = row("mean", "contraction")
    assert constant_error.q025 < 0.6 < constant_error.q975
    assert contraction.q025 < 0.25 < contraction.q975
    assert constant_error.q975 - constant_error.q025 < 0.5  # Under the prior it is about 3.
    assert row("sd", "constant_error").q025 < 0.2 < row("sd", "constant_error").q975
    # Both means differ from 0: a Bayes factor of 0 below 1/e.
    assert constant_error.ln_bf_zero < -1.0
    assert contraction.ln_bf_zero < -1.0
    shift = 100.0 * np.expm1(0.25 * constant_error.q50)  # D is .25
    assert row("mean", "pse_shift_percent").q50 == pytest.approx(shift)


def test_the_table_of_the_group_has_what_the_draws_say(result):
    row = result.table.row
    draws = result.draws
    contraction = row("mean", "contraction")
    index = result.index("contraction")
    expected = np.quantile(draws.mean[..., index], (0.025, 0.5, 0.975))  # (chains, draws)
    assert contraction.interval == pytest.approx(expected)
    zero = zero_mean(draws, result.numbers, result.regressors.x, index)
    assert contraction.ln_bf_zero == zero.log_bf
    noise = 0.25 * np.exp(draws.mean[..., result.index("noise")])  # D is .25
    jnd = np.median(100.0 * np.expm1(norm.ppf(0.75) * noise))  # from 50 to 75 % 'second'
    assert row("mean", "jnd_percent").q50 == pytest.approx(jnd)
    assert np.ptp(row("new_subject", "contraction").interval) > np.ptp(contraction.interval)


def test_the_table_of_subjects_has_all_their_parameters(result):
    # The parameters of the group, two quantities that follow from them, and further parameters of a
    # single subject.
    subjects = result.subject_table
    assert subjects["subject"].unique().tolist() == list(result.subjects)
    parameters = {parameter.name for parameter in task_parameters(WHICH_STRONGER)}
    computed = {"pse_shift_percent", "jnd_percent"}
    assert set(subjects["parameter"]) == {*result.names, *computed, *parameters}


def test_a_normal_group_is_not_contradicted(result):
    assert contradictions(result) == ()
    p_values = [row.p_value for row in predictive_check(result)]
    assert len(p_values) == 6
    assert min(p_values) > CONTRADICTED
    # Tails that are not doubled would end at .5. The largest of six p-values is above .7 in most
    # normal groups.
    assert 0.7 < max(p_values) <= 1.0


def test_a_subject_of_another_kind_contradicts_a_normal_group():
    """One of 24 subjects responds 'second' in every trial."""
    study = simulated_group(7, n_subjects=24, n_each=60)
    subject, *other_subjects = study
    odd_subject = replace(subject, n_yes=subject.n_trials, answers=None)
    # The draws of the group are those for 24 ordinary subjects.
    result = replace(made_result(study), study=bt.Study([odd_subject, *other_subjects]))
    warnings = "\n".join(contradictions(result))
    assert "farthest in its share of 'second'" in warnings


def test_covariates_move_the_means():
    """Constant errors of group b are 0.8 D larger, and ages are random."""
    group_a = simulated_group(1, n_subjects=6).subjects
    group_b = []
    for i, subject in enumerate(simulated_group(2, n_subjects=7, mean_c=0.8)):
        group_b.append(replace(subject, name=f"Q{i}"))
    study = bt.Study([*group_a, *group_b])
    # There are twelve values for thirteen subjects, so that the last subject, Q6, has no value.
    groups = dict(zip(study.names, 6 * ["a"] + 6 * ["b"], strict=False))
    ages = dict(zip(study.names, default_rng(4).normal(30.0, 5.0, 12).tolist(), strict=False))
    covariates = {"group": groups, "age": ages}
    with pytest.warns(bt.ConvergenceWarning, match=r"subjects left out: 'Q6' \(no group, age\)"):
        result = bt.population(study, covariates=covariates, seed=1)
    rows = {(row.level, row.parameter): row for row in result.table.select("effect")}
    group = rows["group b", "constant_error"]
    assert group.q025 < 0.8 < group.q975
    assert group.ln_bf_zero < -1.0  # a Bayes factor of 0 below 1/e
    assert group.p_direction > 0.99
    # Nothing else depends on the group or the age, and the mean of group a is 0.
    age = rows["age", "contraction"]
    assert age.q025 < 0.0 < age.q975
    mean_of_group_a = result.table.row("mean", "constant_error")
    assert mean_of_group_a.q025 < 0.0 < mean_of_group_a.q975


def test_a_group_differs_between_conditions_in_the_constant_error_alone():
    """In units of D, the constant error is 0.2 on average, and larger by 0.5 at the right."""
    result = bt.population(two_conditions(3, n_each=40), draws=1600, seed=1)
    (error,) = result.table.select("difference", "constant_error")
    assert error.level == "right - left"
    assert error.q025 < 0.5 < error.q975
    assert error.q975 - error.q025 < 0.6  # Under the prior it is 1.
    (contraction,) = result.table.select("difference", "contraction")
    assert contraction.q025 < 0.0 < contraction.q975
    assert error.ln_bf_zero < contraction.ln_bf_zero
    # 0.2 is close to a limit of the interval, which depends on the processor. So the median is
    # compared: .15 is half the width of the interval.
    assert result.table.row("mean", "constant_error").q50 == pytest.approx(0.2, abs=0.15)


AGES = {"age": {"P000": 20.0, "P001": 30.0}}


@pytest.mark.parametrize(
    "study, options, message",
    [
        (simulated_group(1, n_subjects=1), {}, "P000 is one subject; allowed: 2 and more"),
        (two_conditions(1, n_subjects=2), {"covariates": AGES}, "a condition and covariates are "),
    ],
)
def test_a_group_of_one_and_covariates_beside_a_condition_are_refused(study, options, message):
    with refused(message):
        bt.population(study, **options)


@pytest.mark.slow
def test_a_public_study_has_its_means_sds_and_bayes_factors(vibrotactile):
    """Intervals of means and SDs between subjects are those of an earlier analysis.

    In the public vibrotactile study swapped blocks are turned back. The tolerances are several
    Monte Carlo errors of these quantiles with 1,600 draws.
    """
    study = vibrotactile.swap("946", (2, 4, 6)).swap("865", (2,))
    result = bt.population(study, draws=1600, seed=1)
    assert result.is_reliable
    row = result.table.row
    error = row("mean", "constant_error")
    contraction = row("mean", "contraction")
    assert error.interval == pytest.approx((0.000, 0.047, 0.094), abs=0.015)
    assert contraction.interval == pytest.approx((-0.047, 0.019, 0.076), abs=0.01)
    assert row("sd", "constant_error").interval == pytest.approx((0.035, 0.062, 0.117), abs=0.015)
    assert row("sd", "contraction").interval == pytest.approx((0.032, 0.073, 0.141), abs=0.01)
    assert (error.ln_bf_zero, contraction.ln_bf_zero) == pytest.approx((0.9, 1.6), abs=0.2)
