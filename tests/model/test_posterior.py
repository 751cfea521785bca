"""The log posterior against fifty-digit arithmetic on formulas written another way."""

import mpmath
import numpy as np
import pytest
from definitions import terms
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.hard_cases import hard_cases

from bayes_toe.data.study import Subject
from bayes_toe.errors import NumericalError
from bayes_toe.model.ladder import posterior_of
from bayes_toe.model.prior import Prior

CASES = hard_cases()


def slack(posterior, x):
    """What rounding each pair's displacement to double may cost, in nats: its error in z times the slope of both logs there.

    |d log q / dz| = 2 ln2 |z| and |d log(1 - q) / dz| <= 2 ln2 |z| / ((1 - q0) + ln2 z^2 / 2) where z is small.
    """
    (c, a, b, top), subject = x, posterior.subject
    parts = np.abs(subject.s2 - subject.s1) + 0.382 / (1 + np.exp(-a)) * np.abs(subject.s1 - posterior.sbar) + abs(c)
    error = 4 * np.finfo(float).eps * parts * np.exp(-b)
    z = np.abs(posterior.distance(np.array([x]))[0]) + error
    lapse = 1 / (1 + np.exp(top))
    steep = 2 * np.log(2) * z
    return float(np.sum(error * steep * (subject.n_equal + (subject.n_trials - subject.n_equal) / (lapse + np.minimum(z**2, 1) / 3))))


moderate = st.tuples(st.floats(-1, 1), st.floats(-20, 20), st.floats(-4, 3), st.floats(-10, 30))


@pytest.mark.parametrize("name", ["all equal", "funnel", "one batch", "stimuli offset by 100", "a hundred million trials"])
@settings(max_examples=25, deadline=None)
@given(x=moderate)
def test_value_agrees_with_fifty_digits(name, x):
    posterior = posterior_of(CASES[name])
    with mpmath.workdps(60):
        truth = float(mpmath.fsum(terms(posterior, [mpmath.mpf(v) for v in x])))
    assert float(posterior.log_density([x])[0]) == pytest.approx(truth, rel=1e-12, abs=1e-12 + slack(posterior, x))


def test_points_in_blocks_are_points_one_by_one():
    posterior = posterior_of(CASES["400 pairs with 3 trials"])
    x = np.random.default_rng(0).normal(size=(500, 4))
    one_by_one = np.array([posterior.log_density(point)[0] for point in x])
    assert posterior.log_density(x) == pytest.approx(one_by_one, rel=1e-13)


def test_pairs_add_up_and_counts_weigh():
    s = CASES["maximum on gamma = 1"]
    x = np.random.default_rng(1).normal(size=(20, 4))
    posterior = posterior_of(s)
    assert posterior.pair_log_likelihood(x).sum(axis=1) == pytest.approx(posterior.log_likelihood(x), rel=1e-13)
    thrice = posterior_of(Subject("x3", s.s1, s.s2, 3 * s.n_equal, 3 * s.n_trials))
    assert thrice.log_likelihood(x) == pytest.approx(3 * posterior.log_likelihood(x), rel=1e-13)


def test_trials_one_by_one_have_the_likelihood_of_their_counts():
    rng = np.random.default_rng(2)
    s1, s2 = rng.choice([0.0, 0.2, 0.5], 300), rng.choice([0.0, 0.2, 0.5], 300)
    equal = rng.uniform(size=300) < 0.6
    posterior = posterior_of(Subject.from_trials("one", s1, s2, equal))
    x = np.array([[0.05, 0.3, -1.0, 2.0]])
    theta = posterior.natural(x[0])
    gain = 1 / ((1 + np.sqrt(1 + 4 * theta.gamma)) / 2)
    z = (s2 - gain * s1 - (1 - gain) * theta.mu1) / (theta.sigma_p * gain**-1.5)
    q = theta.q0 * 2 ** -(z**2)
    assert posterior.log_likelihood(x)[0] == pytest.approx(np.log(np.where(equal, q, 1 - q)).sum(), rel=1e-12)


def test_shifting_stimuli_and_prior_mean_together_changes_nothing():
    s = CASES["funnel"]
    x = np.random.default_rng(3).normal(size=(20, 4))
    shifted = posterior_of(Subject("up", s.s1 + 3.0, s.s2 + 3.0, s.n_equal, s.n_trials), Prior(mu1_mean=3.0))
    assert shifted.log_density(x) == pytest.approx(posterior_of(s).log_density(x), rel=1e-10)


def test_nan_raises_and_impossible_is_minus_infinity():
    posterior = posterior_of(CASES["all equal"])
    with pytest.raises(NumericalError, match="NaN"):
        posterior.log_density([[np.nan, 0, 0, 0]])
    with pytest.raises(NumericalError, match="shape"):
        posterior.log_density([[0.0, 0.0]])
    # Width e^-400 and an unequal pair called equal: z^2 is beyond the largest float, the probability is 0 to all digits.
    assert posterior.log_density([[0.0, 0.0, -400.0, 0.0]])[0] == -np.inf


def test_an_answer_never_given_costs_nothing_even_where_it_is_impossible():
    # All 'different' at z^2 = inf: P(different) is 1, so the log likelihood is exactly 0, not 0 times infinity.
    posterior = posterior_of(CASES["all different"])
    assert posterior.log_likelihood([[0.1, 0.0, -400.0, 0.0]])[0] == 0.0
