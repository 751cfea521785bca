"""Model-free estimates against the paper's formula in exact fractions.

Their collapse on the curve of a known observer.
"""

from fractions import Fraction

import pytest
from conftest import made_subject
from hypothesis import given
from hypothesis import strategies as st

from bayes_toe.classical.frequencies import (
    accuracy,
    laplace_error,
    laplace_estimate,
    presentation_order,
)

counts = st.integers(0, 10**9).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


@given(counts)
def test_the_papers_formula_in_exact_fractions(count):
    k, n = count
    q = Fraction(k + 1, n + 2)
    variance = q * (
        Fraction(k + 2, n + 3) - q
    )  # Eq. e:2b as printed; this difference is what floats would lose
    assert float(laplace_estimate(k, n)) == pytest.approx(float(q), rel=1e-15)
    assert float(laplace_error(k, n)) ** 2 == pytest.approx(float(variance), rel=1e-14)


def test_one_subject():
    subject = made_subject("0 0 8 10, 0 0.4 3 20, 0.4 0 5 30, 0.4 0.4 9 10")
    assert presentation_order(subject).tolist() == [0, -1, 1, 0]
    assert laplace_estimate(subject.n_yes, subject.n_trials) == pytest.approx(
        [9 / 12, 4 / 22, 6 / 32, 10 / 12]
    )
    assert accuracy(subject) == pytest.approx((8 + 17 + 25 + 9) / 70)
