"""The exact test against enumeration of all tables; Fisher's above it; the direction against exact fractions and integration."""

import itertools
from fractions import Fraction
from math import comb, factorial

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from bayes_toe.classical.asymmetry import BOSCHLOO_TRIALS, equality_test, holm, probability_greater
from bayes_toe.errors import InputError

tables = st.tuples(st.integers(1, 40), st.integers(1, 40)).flatmap(
    lambda n: st.tuples(st.integers(0, n[0]), st.just(n[0]), st.integers(0, n[1]), st.just(n[1]))
)


def fisher(k1, n1, k2, n2):
    tails = [stats.fisher_exact([[k1, k2], [n1 - k1, n2 - k2]], alternative=side)[1] for side in ("less", "greater")]
    return min(1.0, 2.0 * min(tails))


def brute_one_sided(k1, n1, k2, n2):
    """Boschloo's p-value for the first being smaller, from every table in exact fractions and a dense grid of probabilities."""

    def statistic(a, b):
        m = a + b
        return Fraction(sum(comb(n1, i) * comb(n2, m - i) for i in range(max(0, m - n2), a + 1)), comb(n1 + n2, m))

    seen = statistic(k1, k2)
    extreme = [(a, b) for a, b in itertools.product(range(n1 + 1), range(n2 + 1)) if statistic(a, b) <= seen]
    pi = np.sin(np.linspace(1e-6, np.pi / 2 - 1e-6, 4001)) ** 2
    return float(np.max(sum(stats.binom.pmf(a, n1, pi) * stats.binom.pmf(b, n2, pi) for a, b in extreme)))


@pytest.mark.parametrize("table", [(2, 6, 7, 8), (0, 5, 5, 5), (3, 9, 3, 4), (1, 1, 0, 3), (4, 8, 4, 8), (6, 6, 2, 11), (38, 50, 15, 50)])
def test_enumeration_of_all_tables_gives_the_same(table):
    k1, n1, k2, n2 = table
    expected = min(1.0, 2 * min(brute_one_sided(k1, n1, k2, n2), brute_one_sided(k2, n2, k1, n1)))
    assert float(equality_test(*table).p_value) == pytest.approx(expected, rel=1e-5)


@settings(max_examples=40, deadline=None)
@given(tables)
def test_never_above_fisher_and_blind_to_names(table):
    k1, n1, k2, n2 = table
    found = float(equality_test(*table).p_value)
    assert 0 < found <= fisher(*table) * (1 + 1e-9)
    for same in ((k2, n2, k1, n1), (n1 - k1, n1, n2 - k2, n2)):
        assert float(equality_test(*same).p_value) == found


def test_the_level_is_kept_at_every_probability():
    n1, n2 = 14, 11
    a, b = (side.ravel() for side in np.meshgrid(np.arange(n1 + 1), np.arange(n2 + 1), indexing="ij"))
    p = equality_test(a, n1, b, n2).p_value
    pi = np.linspace(0.001, 0.999, 500)[:, None]
    for level in (0.01, 0.05, 0.2):
        rejected = p <= level
        chance = (stats.binom.pmf(a[rejected], n1, pi) * stats.binom.pmf(b[rejected], n2, pi)).sum(axis=1)
        assert chance.max() <= level * (1 + 1e-9)
        assert chance.max() > 0.3 * level  # it does reject


def test_fisher_for_many_trials_and_close_to_what_it_replaces():
    n = BOSCHLOO_TRIALS // 2
    below, above = equality_test([30, 300, 25], [n, 1200, n], [45, 380, 40], [n, 1250, n + 1]), [(300, 1200, 380, 1250), (25, n, 40, n + 1)]
    assert below.test.tolist() == ["boschloo", "fisher", "fisher"]
    assert below.p_value[1:] == pytest.approx([fisher(*table) for table in above], rel=1e-9)
    assert below.p_value[0] < fisher(30, n, 45, n) < 1.5 * below.p_value[0]


@settings(max_examples=60, deadline=None)
@given(tables)
def test_direction_in_exact_fractions(table):
    k1, n1, k2, n2 = table
    # P(q1 > q2) = sum over j of the integral of Beta(q1) q1^j (1 - q1)^(n2 + 1 - j) C(n2 + 1, j): q2 < q1 where j >= k2 + 1 of n2 + 1.
    whole = Fraction(factorial(k1) * factorial(n1 - k1), factorial(n1 + 1))
    exact = sum(
        Fraction(comb(n2 + 1, j) * factorial(k1 + j) * factorial(n1 - k1 + n2 + 1 - j), factorial(n1 + n2 + 2)) / whole
        for j in range(k2 + 1, n2 + 2)
    )
    assert float(probability_greater(*table)) == pytest.approx(float(exact), rel=1e-12)


def test_tails_far_out_and_for_a_thousand_million_trials():
    assert float(probability_greater(0, 500, 500, 500)) == pytest.approx(float(1 / mpmath.binomial(1002, 501)), rel=1e-10)
    n, k1, k2 = 10**9, 400_000_000, 400_030_000
    sd = np.sqrt(2 * 0.4 * 0.6 / n)
    assert float(probability_greater(k1, n, k2, n)) == pytest.approx(stats.norm.sf(3e-5 / sd), rel=1e-3)
    assert float(equality_test(k1, n, k2, n).p_value) == pytest.approx(2 * stats.norm.sf(3e-5 / sd), rel=1e-3)
    skewed = probability_greater(10, 10**9, 0, 10**9)  # rates of Poisson counts: 1 - 2^-11
    assert float(skewed) == pytest.approx(1 - 2.0**-11, rel=1e-6)


def test_holm_is_the_closed_test_of_bonferroni():
    rng = np.random.default_rng(3)
    for _ in range(20):
        p = rng.uniform(0, 0.3, 5)
        closed = []
        for i in range(5):
            families = [s for r in range(1, 6) for s in itertools.combinations(range(5), r) if i in s]
            closed.append(max(min(1.0, len(s) * min(p[list(s)])) for s in families))
        assert holm(p) == pytest.approx(closed, rel=1e-14)
    assert holm([]).shape == (0,)


@pytest.mark.parametrize("bad", [(3, 2, 0, 1), (-1, 2, 0, 1), (0.5, 2, 0, 1), (np.nan, 2, 0, 1), ("3", 4, 0, 1), (1, 10**12, 1, 10**12)])
def test_impossible_tables_are_refused(bad):
    with pytest.raises(InputError):
        equality_test(*bad)
    with pytest.raises(InputError):
        probability_greater(*bad)
