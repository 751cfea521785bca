"""Model-free estimates against the paper's formula in exact fractions and against the Beta distribution they are moments of."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

import bayes_toe as bt
from bayes_toe.classical.frequencies import accuracy, frequencies, laplace_error, laplace_estimate, presentation_order
from bayes_toe.comparison.evidence_table import frequency_evidence_laplace
from bayes_toe.errors import InputError

counts = st.integers(0, 10**9).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


@given(counts)
def test_the_papers_formula_in_exact_fractions(count):
    k, n = count
    q = Fraction(k + 1, n + 2)
    variance = q * (Fraction(k + 2, n + 3) - q)  # Eq. e:2b as printed; this difference is what floats would lose
    assert float(laplace_estimate(k, n)) == pytest.approx(float(q), rel=1e-15)
    assert float(laplace_error(k, n)) ** 2 == pytest.approx(float(variance), rel=1e-14)


def test_they_are_mean_and_sd_of_the_posterior_of_a_frequency():
    k, n = np.array([0, 3, 50]), 50
    posterior = stats.beta(k + 1, n - k + 1)
    assert laplace_estimate(k, n) == pytest.approx(posterior.mean(), rel=1e-13)
    assert laplace_error(k, n) == pytest.approx(posterior.std(), rel=1e-13)


def test_the_evidence_of_h0_uses_the_same_estimates(small_study):
    s = small_study["A"]
    q, error = laplace_estimate(s.n_equal, s.n_trials), laplace_error(s.n_equal, s.n_trials)
    by_hand = s.n_equal * np.log(q) + (s.n_trials - s.n_equal) * np.log1p(-q) + np.log(error) + 0.5 * np.log(2 * np.pi)
    assert frequency_evidence_laplace(s) == pytest.approx(by_hand.sum(), rel=1e-12)


def test_one_subject():
    subject = bt.Subject("S", [0.0, 0.0, 0.4, 0.4], [0.0, 0.4, 0.0, 0.4], [8, 3, 5, 9], [10, 20, 30, 10])
    found = frequencies(subject)
    assert found.order.tolist() == presentation_order(subject).tolist() == [0, -1, 1, 0]
    assert found.q == pytest.approx([9 / 12, 4 / 22, 6 / 32, 10 / 12])
    assert accuracy(subject) == pytest.approx((8 + 17 + 25 + 9) / 70)


def test_an_ideal_and_a_contrary_observer():
    s1, s2 = [0.0, 0.0, 0.4], [0.0, 0.4, 0.0]
    assert accuracy(bt.Subject("S", s1, s2, [7, 0, 0], [7, 9, 9])) == 1.0
    assert accuracy(bt.Subject("S", s1, s2, [0, 9, 9], [7, 9, 9])) == 0.0


@pytest.mark.parametrize(("k", "n"), [(-1, 3), (4, 3), (np.nan, 3)])
def test_impossible_counts_are_refused(k, n):
    with pytest.raises(InputError, match=r"0\.\.n_trials"):
        laplace_estimate(k, n)
