"""Model-free estimates against the paper's formula in exact fractions.

Their collapse on the curve of a known observer.
"""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bayes_toe as bt
from bayes_toe.classical.frequencies import (
    accuracy,
    collapse,
    laplace_error,
    laplace_estimate,
    presentation_order,
)
from bayes_toe.inference.maxima import find_maxima
from bayes_toe.model.paper_equations import Natural
from bayes_toe.model.paper_model import unconstrained

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
    subject = bt.Subject(
        "S", [0.0, 0.0, 0.4, 0.4], [0.0, 0.4, 0.0, 0.4], [8, 3, 5, 9], [10, 20, 30, 10]
    )
    assert presentation_order(subject).tolist() == [0, -1, 1, 0]
    assert laplace_estimate(subject.n_yes, subject.n_trials) == pytest.approx(
        [9 / 12, 4 / 22, 6 / 32, 10 / 12]
    )
    assert accuracy(subject) == pytest.approx((8 + 17 + 25 + 9) / 70)


def test_both_orders_collapse_on_one_curve(small_study):
    truth = Natural(*map(np.asarray, (-0.7, 0.25, 0.17, 0.92)))
    subject = small_study["A"]  # rounded expected counts of this observer
    posterior = bt.model.paper_posterior(subject)
    found = collapse(posterior, unconstrained(truth, posterior.sbar))
    big = float((1 + np.sqrt(1 + 4 * truth.gamma)) / 2)
    expected = (subject.s2 - (subject.s1 + (1 - 1 / big) * (-0.7 - subject.s1))) / (0.25 * big**1.5)
    assert found.z == pytest.approx(expected, rel=1e-12)
    assert (found.z_low == found.z).all()
    assert (np.abs(found.ratio - 2.0 ** -np.square(found.z)) < 0.03).all()
    assert (found.error > 0).all()
    assert set(found.order) == {-1, 0, 1}


def test_bands_of_the_collapse_hold_their_mass(small_study):
    posterior = bt.model.paper_posterior(small_study["C"])
    x = find_maxima(posterior).x[0] + 0.15 * np.random.default_rng(2).standard_normal((4000, 4)) * [
        0.2,
        1,
        0.5,
        1,
    ]
    found = collapse(posterior, x, mass=0.6)
    z = posterior.distance(x)
    inside = ((z >= found.z_low) & (z <= found.z_high)).mean(axis=0)
    assert inside == pytest.approx(np.full(13, 0.6), abs=1e-3)
