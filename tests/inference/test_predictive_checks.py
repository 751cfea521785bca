"""Deviance against many digits and against the log likelihood.

Predictive p-values against scipy and simulation.
"""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
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
    q = (
        min(max((k + 0.5) / (n + 1) * (1 + 10.0 ** (power - 3)), 1e-300), 1 - 1e-12)
        if near
        else 0.999 * 10.0**power
    )
    with mpmath.workdps(50):
        p = mpmath.mpf(q)
        expected = float(
            2
            * mpmath.fsum(x * mpmath.log(x / m) for x, m in ((k, n * p), (n - k, n * (1 - p))) if x)
        )
        log_q, log_rest = float(mpmath.log(p)), float(mpmath.log(1 - p))
    rounding = 1e-15 * (n - k * log_q - (n - k) * log_rest)
    assert float(gof.binomial_deviance(k, n, log_q, log_rest)) == pytest.approx(
        expected, rel=1e-15, abs=rounding
    )


def test_deviance_of_answers_that_are_impossible_or_all_but():
    # 3 'equal' of 5 at q = e^-2000: 2 [3 (ln 0.6 + 2000) + 2 ln 0.4].
    assert float(gof.binomial_deviance(3, 5, -2000.0, -0.0)) == pytest.approx(
        2 * (3 * (np.log(0.6) + 2000) + 2 * np.log(0.4)), rel=1e-14
    )
    found = [
        float(gof.binomial_deviance(k, 5, *logs))
        for logs in ((-np.inf, 0.0), (0.0, -np.inf))
        for k in (0, 1, 4, 5)
    ]
    assert found == [0.0, np.inf, np.inf, np.inf, np.inf, np.inf, np.inf, 0.0]
    log_q, log_rest = np.array([-np.inf, -np.inf]), np.zeros(2)
    assert [
        gof.deviance_p_value(value, 1, [10, 10], log_q, log_rest) for value in (np.inf, 0.0)
    ] == [0.0, 1.0]
    assert np.isnan(gof.deviance_p_value(3.0, 0, [10, 10], log_q, log_rest))


def test_the_fit_at_a_maximum(small_study):
    subject = small_study["A"]
    posterior = bt.model.paper_posterior(subject)
    fit = gof.fit_at(posterior, find_maxima(posterior).x[0])
    assert fit.degrees_of_freedom == 9
    assert (np.sign(fit.residual) == np.sign(subject.n_yes / subject.n_trials - fit.q)).all()
    assert np.square(fit.residual).sum() == pytest.approx(fit.deviance)
    assert fit.deviance < 1.0  # the counts are the model's own, rounded
    assert fit.p_value > 0.999
    assert np.isnan(
        gof.fit_at(bt.model.paper_posterior(hard_cases()["single pair"]), np.zeros(4)).p_value
    )


def posterior_and_draws(subject, size=4000):
    """Draws about the maximum, wide enough to matter: any draws serve to test the predictive arithmetic."""
    posterior = bt.model.paper_posterior(subject)
    rng = np.random.default_rng(2)
    return posterior, find_maxima(posterior).x[0] + 0.15 * rng.standard_normal((size, 4)) * [
        0.2,
        1,
        0.5,
        1,
    ]


def test_predictive_p_values_against_simulated_repetitions(small_study):
    subject = small_study["B"]
    posterior, x = posterior_and_draws(subject)
    found = gof.predictive_check(posterior, x, seed=1)
    rng = np.random.default_rng(3)
    q = np.exp(posterior.log_answers(x)[0])
    again = rng.binomial(subject.n_trials, np.repeat(q, 25, axis=0))
    error = 5 * 0.5 / np.sqrt(len(again))
    assert found.expected == pytest.approx(q.mean(axis=0))
    assert found.p_fewer == pytest.approx((again <= subject.n_yes).mean(axis=0), abs=error)
    assert found.p_more == pytest.approx((again >= subject.n_yes).mean(axis=0), abs=error)
    assert (found.p_value <= 1).all()
    assert gof.predictive_check(posterior, x, seed=1).p_overall == found.p_overall
    with pytest.raises(NumericalError, match="a coordinate is NaN"):
        gof.predictive_check(posterior, np.full((2, 4), np.nan), seed=1)


@pytest.mark.parametrize(
    ("n", "q", "pairs"), [(10**8, 0.3, 14), (3, 0.4, 200), (40, 0.01, 60), (10**7, 2e-7, 30)]
)
def test_the_reference_of_the_deviance_against_simulated_sessions(n, q, pairs):
    # No parameter is fitted: as many degrees of freedom as pairs. P(p < 0.01) is 0.01; 4 s.e. of
    # 20,000 sessions and 0.005 of the shape.
    log_q, log_rest = np.full(pairs, np.log(q)), np.full(pairs, np.log1p(-q))
    again = np.random.default_rng(3).binomial(n, q, (20_000, pairs))
    values = gof.binomial_deviance(again, n, log_q, log_rest).sum(axis=1)
    beyond = np.mean(
        [
            gof.deviance_p_value(value, pairs, np.full(pairs, n), log_q, log_rest) < 0.01
            for value in values[:2000]
        ]
    )
    assert beyond == pytest.approx(0.01, abs=0.005 + 4 * np.sqrt(0.01 * 0.99 / 2000))


def test_a_misfit_names_its_worst_pairs(small_study):
    subject = small_study["A"]
    odd = subject.n_yes.copy()
    odd[[2, 5]] = subject.n_trials[[2, 5]] - odd[[2, 5]]
    bent = bt.Subject("bent", subject.s1, subject.s2, odd, subject.n_trials)
    for one, misfit in ((subject, False), (bent, True)):
        posterior = bt.model.paper_posterior(one)
        best = find_maxima(posterior).x[:1]
        found = gof.summarise_fit(posterior, np.repeat(best, 500, axis=0), seed=1)
        assert (found.misfit, found.p_overall < 0.01) == (misfit, misfit)
        assert [replace(found, p_overall=p, p_deviance=0.5).misfit for p in (0.001, 0.5)] == [
            True,
            False,
        ]
        assert 1 <= len(found.worst) <= 3
        assert found.p_deviance == pytest.approx(gof.fit_at(posterior, best[0]).p_value, rel=1e-10)
        worst = found.worst[0]
        at = int(np.flatnonzero((one.s1 == worst.s1) & (one.s2 == worst.s2))[0])
        assert worst.observed == one.n_yes[at] / one.n_trials[at]
        assert at == np.argmax(np.abs(gof.fit_at(posterior, best[0]).residual))


def test_the_summary_is_the_predictive_check_and_the_deviance_near_the_maximum(
    analysis, small_study
):
    posterior = bt.model.paper_posterior(small_study["B"])
    x = unconstrained(Natural(*map(np.ravel, analysis.draws.natural("B"))), posterior.sbar)
    found = gof.summarise_fit(posterior, x, seed=3, most=len(x))
    check = gof.predictive_check(posterior, x, seed=3)
    assert (found.p_overall, found.p_overall_se) == (check.p_overall, check.p_overall_se)
    assert found.worst_p == check.p_value.min()
    at = int(np.argmin(check.p_value))
    assert (found.worst_s1, found.worst_s2) == (posterior.subject.s1[at], posterior.subject.s2[at])
    n, k = posterior.subject.n_trials, posterior.subject.n_yes
    saturated = (xlogy(k, k / n) + xlogy(n - k, 1.0 - k / n)).sum()
    assert found.deviance == pytest.approx(-2.0 * (posterior.log_likelihood(x).max() - saturated))
    best = min(gof.fit_at(posterior, start).deviance for start in find_maxima(posterior).x)
    assert best - 0.2 < found.deviance < best + 0.1
    assert found.degrees_of_freedom == 9
