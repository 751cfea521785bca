"""Spreads of counts: the beta-binomial against scipy and fifty digits, and what is asked of it beside its likelihood."""

import mpmath as mp
import numpy as np
import pytest
from scipy.special import gammaln
from scipy.stats import beta, betabinom

from bayes_toe.data.study import Subject
from bayes_toe.model.spread import BETA_BINOMIAL, BINOMIAL

COUNTS = np.array([0, 1, 17, 49, 50, 0, 1])
TRIALS = np.array([50, 50, 50, 50, 50, 1, 1])
SUBJECT = Subject("S", np.arange(7.0), np.arange(7.0) + 0.5, COUNTS, TRIALS)
P = np.array([[0.02, 0.03, 0.4, 0.95, 0.999, 0.3, 0.3]])
ANSWERS = np.log(P), np.log1p(-P)


def own(icc):
    return np.array([[np.log(icc / (1 - icc))]])


def ways(subject):
    return gammaln(subject.n_trials + 1) - gammaln(subject.n_equal + 1) - gammaln(subject.n_trials - subject.n_equal + 1)


@pytest.mark.parametrize("icc", [0.001, 0.1, 0.5, 0.97])
def test_likelihood_is_scipys(icc):
    total = 1 / icc - 1
    expected = betabinom.logpmf(COUNTS, TRIALS, total * P[0], total * (1 - P[0])) - ways(SUBJECT)
    assert BETA_BINOMIAL.log_likelihood(SUBJECT, ANSWERS, own(icc))[0] == pytest.approx(expected, rel=1e-10, abs=1e-10)


@pytest.mark.parametrize("logit_icc", [-690.0, -40.0, -1.0, 20.0, 690.0])
@pytest.mark.parametrize("log_p", [-1e5, -600.0, -30.0, -0.7, -1e-12, -1e-200])
def test_likelihood_at_its_ends_against_many_digits(logit_icc, log_p):
    with mp.workdps(700):
        p = mp.exp(mp.mpf(log_p)) if log_p > -1e4 else mp.mpf(0)  # beyond the digits of every sum but its own
        other = -mp.expm1(mp.mpf(log_p))
        log_other = mp.log(other)
        eps = mp.exp(mp.mpf(logit_icc))

        def rising(log, size, n):
            return mp.fsum([log if j == 0 else mp.log(size + j * eps) for j in range(n)])

        truth = []
        for k, n in zip(COUNTS.tolist(), TRIALS.tolist(), strict=True):
            truth.append(float(rising(mp.mpf(log_p), p, k) + rising(log_other, other, n - k) - rising(mp.mpf(0), mp.mpf(1), n)))
        answers = np.full((1, 7), log_p), np.full((1, 7), float(log_other))
    assert BETA_BINOMIAL.log_likelihood(SUBJECT, answers, np.array([[logit_icc]]))[0] == pytest.approx(truth, rel=1e-12, abs=1e-300)


def test_without_correlation_it_is_the_binomial_and_with_all_of_it_one_answer():
    independent = BINOMIAL.log_likelihood(SUBJECT, ANSWERS)
    assert BETA_BINOMIAL.log_likelihood(SUBJECT, ANSWERS, np.array([[-700.0]])) == pytest.approx(independent, rel=1e-14)
    whole = Subject("S", np.arange(3.0), np.arange(3.0), np.array([0, 50, 7]), np.full(3, 50))
    p = np.full((1, 3), 0.3)
    found = BETA_BINOMIAL.log_likelihood(whole, (np.log(p), np.log1p(-p)), np.array([[600.0]]))[0]
    assert found[:2] == pytest.approx(np.log([0.7, 0.3]), rel=1e-12)
    assert found[2] < -500.0  # both answers to one pair


@pytest.mark.parametrize("icc", [1e-6, 0.05, 0.6])
def test_an_answer_given_the_rest_is_a_ratio_of_likelihoods(icc):
    # Leave one trial out: P(counts) / P(counts without that answer).
    one, other = BETA_BINOMIAL.given_the_rest(SUBJECT, ANSWERS, own(icc))
    full = BETA_BINOMIAL.log_likelihood(SUBJECT, ANSWERS, own(icc))[0]
    for i, (k, n) in enumerate(zip(COUNTS, TRIALS, strict=True)):
        for fewer, found, given in ((k - 1, one, k > 0), (k, other, k < n)):
            if given and n > 1:
                less = Subject("S", SUBJECT.s1[[i]], SUBJECT.s2[[i]], [fewer], [n - 1])
                rest = BETA_BINOMIAL.log_likelihood(less, tuple(part[:, [i]] for part in ANSWERS), own(icc))[0, 0]
                assert found[0, i] == pytest.approx(full[i] - rest, rel=1e-9, abs=1e-11)
            elif given:  # of a single trial nothing else is known
                assert found[0, i] == pytest.approx(full[i], rel=1e-12)


@pytest.mark.parametrize("icc", [0.01, 0.2, 0.7])
def test_realised_answers_have_the_betas_moments_and_shape(icc):
    size, total = 100_000, 1 / icc - 1
    answers = tuple(np.repeat(part, size, axis=0) for part in ANSWERS)
    one, other = BETA_BINOMIAL.realised(np.random.default_rng(5), answers, np.full((size, 1), own(icc)[0, 0]))
    p = np.exp(one)
    assert p + np.exp(other) == pytest.approx(np.ones(p.shape), abs=1e-12)
    # 42 looks at 4.8 standard errors: a false alarm in 15,000 such tests. Seen to fail with total + 1 in the place of total.
    for i in range(P.shape[1]):
        made = beta(total * P[0, i], total * (1 - P[0, i]))
        assert p[:, i].mean() == pytest.approx(P[0, i], abs=4.8 * made.std() / np.sqrt(size))
        share = (p[:, i] < made.median()).mean() if 0.0 < made.median() < 1.0 else 0.5
        assert share == pytest.approx(0.5, abs=4.8 * 0.5 / np.sqrt(size))
        square = np.square(p[:, i] - P[0, i])
        assert square.mean() == pytest.approx(P[0, i] * (1 - P[0, i]) * icc, abs=4.8 * square.std() / np.sqrt(size))


def test_realised_answers_where_sessions_are_all_or_nothing():
    answers = tuple(np.repeat(part, 20_000, axis=0) for part in ANSWERS)
    one, _ = BETA_BINOMIAL.realised(np.random.default_rng(6), answers, np.full((20_000, 1), 690.0))
    assert np.isin(np.exp(one), [0.0, 1.0]).all()
    assert np.exp(one).mean(axis=0) == pytest.approx(P[0], abs=4.5 * 0.5 / np.sqrt(20_000))
