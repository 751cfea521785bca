"""Spreads of counts against SciPy and many digits, what is asked of them beside their likelihood, and Polya's urn."""

import mpmath
import numpy as np
import pytest
from scipy.special import gammaln
from scipy.stats import beta, betabinom

from bayes_toe.data.study import Subject
from bayes_toe.model.spread import BETA_BINOMIAL, BINOMIAL, log_drawn, rising

COUNTS = np.array([0, 1, 17, 49, 50, 0, 1])
TRIALS = np.array([50, 50, 50, 50, 50, 1, 1])
SUBJECT = Subject("S", np.arange(7.0), np.arange(7.0) + 0.5, COUNTS, TRIALS)
P = np.array([[0.02, 0.03, 0.4, 0.95, 0.999, 0.3, 0.3]])
ANSWERS = np.log(P), np.log1p(-P)


def own(icc):
    return np.array([[np.log(icc / (1 - icc))]])


def ways(subject):
    return (
        gammaln(subject.n_trials + 1)
        - gammaln(subject.n_yes + 1)
        - gammaln(subject.n_trials - subject.n_yes + 1)
    )


@pytest.mark.parametrize("icc", [0.001, 0.1, 0.5, 0.97])
def test_likelihood_is_scipys(icc):
    total = 1 / icc - 1
    expected = betabinom.logpmf(COUNTS, TRIALS, total * P[0], total * (1 - P[0])) - ways(SUBJECT)
    assert BETA_BINOMIAL.log_likelihood(SUBJECT, ANSWERS, own(icc))[0] == pytest.approx(
        expected, rel=1e-10, abs=1e-10
    )


def test_without_correlation_it_is_the_binomial_and_with_all_of_it_one_answer():
    independent = BINOMIAL.log_likelihood(SUBJECT, ANSWERS)
    assert BETA_BINOMIAL.log_likelihood(SUBJECT, ANSWERS, np.array([[-700.0]])) == pytest.approx(
        independent, rel=1e-14
    )
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
                rest = BETA_BINOMIAL.log_likelihood(
                    less, tuple(part[:, [i]] for part in ANSWERS), own(icc)
                )[0, 0]
                assert found[0, i] == pytest.approx(full[i] - rest, rel=1e-9, abs=1e-11)
            elif given:  # of a single trial nothing else is known
                assert found[0, i] == pytest.approx(full[i], rel=1e-12)


@pytest.mark.parametrize("icc", [0.01, 0.2, 0.7])
def test_realised_answers_have_the_betas_moments_and_shape(icc):
    size, total = 30_000, 1 / icc - 1
    answers = tuple(np.repeat(part, size, axis=0) for part in ANSWERS)
    one, other = BETA_BINOMIAL.realised(
        np.random.default_rng(5), answers, np.full((size, 1), own(icc)[0, 0])
    )
    p = np.exp(one)
    np.testing.assert_allclose(p + np.exp(other), 1.0, atol=1e-12)
    # 42 looks at 4.8 standard errors: a false alarm in 15,000 such tests. Seen to fail with total + 1 in the place of total.
    for i in range(P.shape[1]):
        made = beta(total * P[0, i], total * (1 - P[0, i]))
        assert p[:, i].mean() == pytest.approx(P[0, i], abs=4.8 * made.std() / np.sqrt(size))
        share = (p[:, i] < made.median()).mean() if 0.0 < made.median() < 1.0 else 0.5
        assert share == pytest.approx(0.5, abs=4.8 * 0.5 / np.sqrt(size))
        square = np.square(p[:, i] - P[0, i])
        assert square.mean() == pytest.approx(
            P[0, i] * (1 - P[0, i]) * icc, abs=4.8 * square.std() / np.sqrt(size)
        )


def test_realised_answers_where_sessions_are_all_or_nothing():
    answers = tuple(np.repeat(part, 20_000, axis=0) for part in ANSWERS)
    one, _ = BETA_BINOMIAL.realised(np.random.default_rng(6), answers, np.full((20_000, 1), 690.0))
    assert np.isin(np.exp(one), [0.0, 1.0]).all()
    assert np.exp(one).mean(axis=0) == pytest.approx(P[0], abs=4.5 * 0.5 / np.sqrt(20_000))


SIDES = [-1e-300, -1e-20, -1e-9, -0.011, -0.3, -2.0, -26.0, -300.0, -900.0]  # log P, with Q = 1 - P


def exact(log_p, v, n, before):
    """Log probability and sums of slopes in exact terms, and log Q."""
    with mpmath.workdps(500):
        p, q, eps = mpmath.exp(log_p), -mpmath.expm1(log_p), mpmath.exp(v)
        drawn = mpmath.fsum(mpmath.log((p + j * eps) / (1 + (before + j) * eps)) for j in range(n))
        share = [p / (p + j * eps) for j in range(n)]
        sums = [mpmath.fsum(share), mpmath.fsum(1 - t for t in share)]
        return float(mpmath.log(q)), float(drawn), [float(one) for one in sums]


@pytest.mark.parametrize("v", [-600.0, -60.0, -11.0, -2.0, 0.0, 3.0, 40.0, 600.0])
@pytest.mark.parametrize("swapped", [False, True], ids=["first", "other"])
def test_every_digit_of_likely_and_unlikely_answers(v, swapped):
    for log_p in SIDES:
        for n, before in ((0, 3), (1, 0), (2, 0), (17, 40), (50, 7)):
            log_q, drawn, sums = exact(log_p, v, n, before)
            if swapped:
                with mpmath.workdps(500):
                    p, eps = -mpmath.expm1(log_p), mpmath.exp(v)
                    drawn = float(
                        mpmath.fsum(
                            mpmath.log((p + j * eps) / (1 + (before + j) * eps)) for j in range(n)
                        )
                    )
            sides = [np.array([[one]]) for one in ((log_q, log_p) if swapped else (log_p, log_q))]
            found = log_drawn(tuple(sides), np.array([[v]]), np.array([n]), np.array([before]))
            assert found[0, 0] == pytest.approx(drawn, rel=1e-13, abs=0.0)
            if not swapped:
                assert [
                    one[0, 0] for one in rising(sides[0], np.array([[v]]), np.array([n]))
                ] == pytest.approx(sums, rel=1e-12, abs=1e-290)


def test_many_answers_do_not_underflow():
    n, v = np.array([1000]), np.array([[-18.0], [1.0]])
    log_p = np.full((2, 1), -40.0)
    found = log_drawn((log_p, np.log1p(-np.exp(log_p))), v, n, np.array([100]))
    for value, one in zip(found[:, 0], v[:, 0], strict=True):
        assert value == pytest.approx(exact(-40.0, one, 1000, 100)[1], rel=1e-12)


def test_a_crowd_has_the_sums_of_its_points():
    rng = np.random.default_rng(3)
    n, before, log_p = (
        rng.integers(0, 9, (4, 3)),
        rng.integers(0, 9, (4, 3)),
        np.log(rng.uniform(size=(4, 3))),
    )
    answers, v = (log_p, np.log(-np.expm1(log_p))), rng.normal(size=(4, 1))
    crowd, slopes = log_drawn(answers, v, n, before), rising(log_p, v, n)
    for i in range(4):
        at = slice(i, i + 1)
        alone = log_drawn((answers[0][at], answers[1][at]), v[at], n[i], before[i])
        np.testing.assert_array_equal(crowd[at], alone)
        for one, other in zip(slopes, rising(log_p[at], v[at], n[i]), strict=True):
            np.testing.assert_array_equal(one[at], other)
