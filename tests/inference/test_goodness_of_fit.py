"""Deviance against many digits and against the log likelihood, its p-value against simulation."""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from conftest import BOTH_TASKS
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import default_rng
from reference.hard_cases import hard_cases
from serial_observers import neighbouring_pairs

import bayes_toe as bt
from bayes_toe.answers.order_effect import best_model_fit
from bayes_toe.design.observers import make_observer
from bayes_toe.design.study_design import StudyDesign
from bayes_toe.inference import goodness_of_fit as gof
from bayes_toe.inference.fitted import find_maxima
from bayes_toe.inference.order_evidence import Precision, order_evidence

#: k counted answers in n trials.
counts = st.integers(1, 10**9).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


@settings(max_examples=150, deadline=None)
@given(count=counts, power=st.floats(-12, 0), is_near=st.booleans())
def test_the_deviance_agrees_with_fifty_digits(count, power, is_near):
    """The tolerance is the rounding of two log likelihoods, whose difference the deviance is.

    The probability q is anywhere, or so near to the share k/n that the deviance is almost 0.
    """
    k, n = count
    if is_near:
        # At most a thousandth from a share that is neither 0 nor 1.
        q = min((k + 0.5) / (n + 1) * (1 + 10.0 ** (power - 3)), 1 - 1e-12)
    else:
        q = 0.999 * 10.0**power
    with mpmath.workdps(50):
        p = mpmath.mpf(q)
        expected = mpmath.mpf(0)
        for observed, mean in ((k, n * p), (n - k, n * (1 - p))):
            if observed:
                expected += 2 * observed * mpmath.log(observed / mean)
        log_q = float(mpmath.log(p))
        log_complement = float(mpmath.log(1 - p))
    rounding = 1e-15 * (n - k * log_q - (n - k) * log_complement)
    deviance = float(gof.binomial_deviance(k, n, log_q, log_complement))
    assert deviance == pytest.approx(float(expected), rel=1e-15, abs=rounding)


def test_the_deviance_of_impossible_answers_is_infinite_and_of_all_but_impossible_ones_is_not():
    # 3 'equal' of 5 at q = e^-2000: 2 [3 (ln 0.6 + 2000) + 2 ln 0.4].
    expected = 2 * (3 * (np.log(0.6) + 2000) + 2 * np.log(0.4))
    assert float(gof.binomial_deviance(3, 5, -2000.0, -0.0)) == pytest.approx(expected, rel=1e-14)

    k = np.array([0, 1, 4, 5])
    deviances_at_0 = gof.binomial_deviance(k, 5, -np.inf, 0)  # q is 0
    assert deviances_at_0.tolist() == [0.0, np.inf, np.inf, np.inf]
    deviances_at_1 = gof.binomial_deviance(k, 5, 0, -np.inf)  # q is 1
    assert deviances_at_1.tolist() == [np.inf, np.inf, np.inf, 0.0]


def test_where_all_answers_are_certain_the_p_value_is_0_or_1():
    # Trials, log q and log (1 - q) of two pairs, to which 'equal' is an impossible answer.
    session = [10, 10], np.array([-np.inf, -np.inf]), np.zeros(2)
    assert gof.deviance_p_value(np.inf, 1, *session) == 0.0
    assert gof.deviance_p_value(0.0, 1, *session) == 1.0


@pytest.mark.parametrize(
    "n_trials, q, n_pairs", [(10**8, 0.3, 14), (3, 0.4, 200), (40, 0.01, 60), (10**7, 2e-7, 30)]
)
def test_p_values_of_the_deviance_are_right_in_simulated_sessions(n_trials, q, n_pairs):
    """No parameter is fitted, so there are as many degrees of freedom as pairs.

    P(p < 0.01) is 0.01, to 4 standard errors, and 0.005 because the reference is a scaled
    chi-square, which has the mean and the variance but not the shape.
    """
    n = np.full(n_pairs, n_trials)
    log_probabilities = np.log(q), np.log1p(-q)  # of both answers to each pair
    counts = default_rng(3).binomial(n_trials, q, (2000, n_pairs))
    deviances = gof.binomial_deviance(counts, n, *log_probabilities).sum(axis=1)
    session = n, *(np.full(n_pairs, log_p) for log_p in log_probabilities)
    p_values = np.array([gof.deviance_p_value(value, n_pairs, *session) for value in deviances])
    error = 4 * np.sqrt(0.01 * 0.99 / 2000)
    assert (p_values < 0.01).mean() == pytest.approx(0.01, abs=0.005 + error)


@pytest.mark.parametrize("has_misfit", [False, True])
def test_a_misfit_has_a_small_p_and_names_its_worst_pairs(small_study, has_misfit):
    subject = small_study["A"]
    if has_misfit:  # The counts of 'equal' and 'different' are exchanged in two pairs.
        n_yes = subject.n_yes.copy()
        n_yes[[2, 5]] = subject.n_trials[[2, 5]] - n_yes[[2, 5]]
        subject = replace(subject, n_yes=n_yes)

    posterior = bt.model.paper_posterior(subject)
    maximum = find_maxima(posterior).x[0]
    draws = maximum + default_rng(1).normal(0.0, 0.01, (500, 4))  # near the maximum
    fit = gof.summarise_fit(posterior, draws, maximum)
    assert fit.degrees_of_freedom == subject.n_pairs - 4  # four parameters
    assert (fit.fit_p < 0.001) == has_misfit

    worst_pair, *_ = fit.worst
    is_worst = (subject.s1 == worst_pair.s1) & (subject.s2 == worst_pair.s2)
    assert worst_pair.observed == (subject.n_yes / subject.n_trials)[is_worst]


def test_a_fit_of_no_more_pairs_than_parameters_has_no_p_value():
    posterior = bt.model.paper_posterior(hard_cases()["single pair"])
    fit = gof.summarise_fit(posterior, np.zeros((5, 4)), np.zeros(4))
    assert fit.degrees_of_freedom == -3  # one pair, four parameters
    assert np.isnan(fit.fit_p)


@BOTH_TASKS
def test_sound_observers_are_flagged_as_often_as_the_limit_says(task):
    """The rate is .05: more than 10 of 100 observers are flagged with a probability of .011."""
    pairs = neighbouring_pairs(task)
    design = StudyDesign(*pairs.T, [15] * len(pairs), task=task)
    subjects = []
    for seed in range(100):
        rng = default_rng(seed)
        parameters = {
            "noise": rng.uniform(0.15, 0.5),
            "lapse_rate": rng.uniform(0.0, 0.05),
            "constant_error": rng.choice([-0.2, 0.0, 0.2]),
            "contraction": rng.choice([-0.3, 0.0, 0.3]),
        }
        if task.has_criterion:
            parameters["q0"] = 0.85
        observer = make_observer(str(seed), "sound", parameters, task)
        subjects.append(observer.answers(design, seed))

    n_flagged = 0
    low_precision = Precision(standard_error=0.2, effective_draws=100.0, most_draws=1000)
    for evidence in order_evidence(subjects, seed=1, precision=low_precision):
        n_flagged += best_model_fit(evidence, seed=1).fit_p < 0.05
    assert n_flagged <= 10
