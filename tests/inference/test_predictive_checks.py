"""Deviance against many digits and against the log likelihood.

Predictive p-values against scipy and simulation.
"""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import default_rng
from reference.hard_cases import hard_cases
from scipy.special import xlogy

import bayes_toe as bt
from bayes_toe.errors import NumericalError
from bayes_toe.inference import predictive_checks as gof
from bayes_toe.inference.maxima import find_maxima
from bayes_toe.model.paper_equations import Natural
from bayes_toe.model.paper_model import unconstrained

counts = st.integers(1, 10**9).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


@settings(max_examples=150, deadline=None)
@given(count=counts, power=st.floats(-12, 0), near=st.booleans())
def test_deviance_against_fifty_digits(count, power, near):
    """To the rounding of the two log likelihoods of which it is the difference."""
    k, n = count
    q = 0.999 * 10.0**power
    if near:
        q = min((k + 0.5) / (n + 1) * (1 + 10.0 ** (power - 3)), 1 - 1e-12)
    with mpmath.workdps(50):
        p, expected = mpmath.mpf(q), mpmath.mpf(0)
        for observed, mean in ((k, n * p), (n - k, n * (1 - p))):
            if observed:
                expected += 2 * observed * mpmath.log(observed / mean)
        log_q, log_rest = float(mpmath.log(p)), float(mpmath.log(1 - p))
    rounding = 1e-15 * (n - k * log_q - (n - k) * log_rest)
    deviance = float(gof.binomial_deviance(k, n, log_q, log_rest))
    assert deviance == pytest.approx(float(expected), rel=1e-15, abs=rounding)


def test_deviance_of_answers_that_are_impossible_or_all_but():
    # 3 'equal' of 5 at q = e^-2000: 2 [3 (ln 0.6 + 2000) + 2 ln 0.4].
    expected = 2 * (3 * (np.log(0.6) + 2000) + 2 * np.log(0.4))
    assert float(gof.binomial_deviance(3, 5, -2000.0, -0.0)) == pytest.approx(expected, rel=1e-14)
    k = np.array([0, 1, 4, 5])
    never, always = (gof.binomial_deviance(k, 5, *logs) for logs in ((-np.inf, 0), (0, -np.inf)))
    assert never.tolist() == [0.0, np.inf, np.inf, np.inf]
    assert always.tolist() == [np.inf, np.inf, np.inf, 0.0]
    session = [10, 10], np.array([-np.inf, -np.inf]), np.zeros(2)
    assert gof.deviance_p_value(np.inf, 1, *session) == 0.0
    assert gof.deviance_p_value(0.0, 1, *session) == 1.0
    assert np.isnan(gof.deviance_p_value(3.0, 0, *session))


def test_the_fit_at_a_maximum(small_study):
    subject = small_study["A"]
    posterior = bt.model.paper_posterior(subject)
    fit = gof.fit_at(posterior, find_maxima(posterior).x[0])
    assert fit.degrees_of_freedom == 9
    assert (np.sign(fit.residual) == np.sign(subject.n_yes / subject.n_trials - fit.q)).all()
    assert np.square(fit.residual).sum() == pytest.approx(fit.deviance)
    assert fit.deviance < 1.0  # the counts are the model's own, rounded
    assert fit.p_value > 0.999
    single_pair = bt.model.paper_posterior(hard_cases()["single pair"])
    assert np.isnan(gof.fit_at(single_pair, np.zeros(4)).p_value)


def test_predictive_p_values_against_simulated_repetitions(small_study):
    """Any draws serve: these lie about the maximum, wide enough to matter."""
    subject = small_study["B"]
    posterior = bt.model.paper_posterior(subject)
    scatter = default_rng(2).normal(size=(4000, 4)) * [0.03, 0.15, 0.075, 0.15]
    x = find_maxima(posterior).x[0] + scatter
    check = gof.predictive_check(posterior, x, seed=1)
    q = np.exp(posterior.log_answers(x)[0])
    counts = default_rng(3).binomial(subject.n_trials, np.repeat(q, 25, axis=0))
    error = 5 * 0.5 / np.sqrt(len(counts))
    assert check.expected == pytest.approx(q.mean(axis=0))
    assert check.p_fewer == pytest.approx((counts <= subject.n_yes).mean(axis=0), abs=error)
    assert check.p_more == pytest.approx((counts >= subject.n_yes).mean(axis=0), abs=error)
    assert (check.p_value <= 1).all()
    assert gof.predictive_check(posterior, x, seed=1).p_overall == check.p_overall
    with pytest.raises(NumericalError, match="a coordinate is NaN"):
        gof.predictive_check(posterior, np.full((2, 4), np.nan), seed=1)


@pytest.mark.parametrize(
    "n, q, pairs", [(10**8, 0.3, 14), (3, 0.4, 200), (40, 0.01, 60), (10**7, 2e-7, 30)]
)
def test_the_reference_of_the_deviance_against_simulated_sessions(n, q, pairs):
    # No parameter is fitted, so there are as many degrees of freedom as pairs. P(p < 0.01) is 0.01,
    # to 4 s.e. and 0.005 of the shape.
    session = np.full(pairs, n), np.full(pairs, np.log(q)), np.full(pairs, np.log1p(-q))
    counts = default_rng(3).binomial(n, q, (2000, pairs))
    values = gof.binomial_deviance(counts, n, *session[1:]).sum(axis=1)
    p_values = np.array([gof.deviance_p_value(value, pairs, *session) for value in values])
    error = 4 * np.sqrt(0.01 * 0.99 / 2000)
    assert (p_values < 0.01).mean() == pytest.approx(0.01, abs=0.005 + error)


@pytest.mark.parametrize("is_bent", [False, True])
def test_a_misfit_names_its_worst_pairs(small_study, is_bent):
    subject = small_study["A"]
    if is_bent:
        n_yes = subject.n_yes.copy()
        n_yes[[2, 5]] = subject.n_trials[[2, 5]] - n_yes[[2, 5]]
        subject = bt.Subject("bent", subject.s1, subject.s2, n_yes, subject.n_trials)
    posterior = bt.model.paper_posterior(subject)
    best = find_maxima(posterior).x[:1]
    fit = gof.summarise_fit(posterior, np.repeat(best, 500, axis=0), seed=1)
    assert (fit.misfit, fit.p_overall < 0.01) == (is_bent, is_bent)
    assert replace(fit, p_overall=0.001, p_deviance=0.5).misfit
    assert not replace(fit, p_overall=0.5, p_deviance=0.5).misfit
    assert fit.p_deviance == pytest.approx(gof.fit_at(posterior, best[0]).p_value, rel=1e-10)
    assert 1 <= len(fit.worst) <= 3


def test_the_summary_is_the_predictive_check_and_the_deviance_near_the_maximum(
    analysis, small_study
):
    posterior = bt.model.paper_posterior(small_study["B"])
    subject = posterior.subject
    x = unconstrained(Natural(*map(np.ravel, analysis.draws.natural("B"))), posterior.sbar)
    fit = gof.summarise_fit(posterior, x, seed=3, most=len(x))
    check = gof.predictive_check(posterior, x, seed=3)
    assert (fit.p_overall, fit.p_overall_se) == (check.p_overall, check.p_overall_se)
    index = np.argmin(check.p_value)
    assert fit.worst_p == check.p_value[index]
    assert (fit.worst_s1, fit.worst_s2) == (subject.s1[index], subject.s2[index])
    n, k = subject.n_trials, subject.n_yes
    # The largest residual at the maximum need not be that of the smallest p-value.
    worst = fit.worst[0]
    is_worst = (subject.s1 == worst.s1) & (subject.s2 == worst.s2)
    assert worst.observed == (k / n)[is_worst]
    saturated = (xlogy(k, k / n) + xlogy(n - k, 1.0 - k / n)).sum()
    assert fit.deviance == pytest.approx(-2.0 * (posterior.log_likelihood(x).max() - saturated))
    best = min(gof.fit_at(posterior, start).deviance for start in find_maxima(posterior).x)
    assert best - 0.2 < fit.deviance < best + 0.1
    assert fit.degrees_of_freedom == 9
