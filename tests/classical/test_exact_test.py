"""The exact test against scipy and against brute-force enumeration; the direction against exact integration."""

import itertools
from fractions import Fraction
from math import comb, factorial

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from bayes_toe.classical import exact_test
from bayes_toe.classical.exact_test import equality_test, fisher_p_value, holm, hypergeometric_tails, probability_greater
from bayes_toe.errors import InputError

tables = st.tuples(st.integers(1, 40), st.integers(1, 40)).flatmap(
    lambda n: st.tuples(st.integers(0, n[0]), st.just(n[0]), st.integers(0, n[1]), st.just(n[1]))
)


@pytest.mark.parametrize("sizes", [(50, 50), (7, 12), (55, 56), (104, 97)])
def test_scipy_finds_the_same_p_values(sizes):
    n1, n2 = sizes
    rng = np.random.default_rng(n1)
    for _ in range(6):
        k1, k2 = rng.integers(0, n1 + 1), rng.integers(0, n2 + 1)
        expected = stats.boschloo_exact([[k1, k2], [n1 - k1, n2 - k2]], n=64).pvalue
        assert float(equality_test(k1, n1, k2, n2).p_value) == pytest.approx(expected, rel=1e-6)


def brute_one_sided(k1, n1, k2, n2):
    """Boschloo's p-value for the first being smaller, from every table in exact fractions and a dense grid of probabilities."""

    def statistic(a, b):
        m = a + b
        return Fraction(sum(comb(n1, i) * comb(n2, m - i) for i in range(max(0, m - n2), a + 1)), comb(n1 + n2, m))

    seen = statistic(k1, k2)
    extreme = [(a, b) for a, b in itertools.product(range(n1 + 1), range(n2 + 1)) if statistic(a, b) <= seen]
    pi = np.sin(np.linspace(1e-6, np.pi / 2 - 1e-6, 4001)) ** 2
    total = sum(stats.binom.pmf(a, n1, pi) * stats.binom.pmf(b, n2, pi) for a, b in extreme)
    return float(np.max(total))


@pytest.mark.parametrize("table", [(2, 6, 7, 8), (0, 5, 5, 5), (3, 9, 3, 4), (1, 1, 0, 3), (4, 8, 4, 8), (6, 6, 2, 11)])
def test_enumeration_of_all_tables_gives_the_same(table):
    k1, n1, k2, n2 = table
    expected = min(1.0, 2 * min(brute_one_sided(k1, n1, k2, n2), brute_one_sided(k2, n2, k1, n1)))
    assert float(equality_test(*table).p_value) == pytest.approx(expected, rel=1e-5)


def test_the_extreme_tables_are_a_staircase():
    # What the fast sum rests on: Fisher's statistic rises with the first count and falls with the second.
    for n1, n2 in [(1, 1), (3, 11), (50, 50), (40, 87)]:
        statistic = exact_test._fisher_statistics(n1, n2)
        assert (np.diff(statistic, axis=0) >= -1e-12).all()
        assert (np.diff(statistic, axis=1) <= 1e-12).all()


@settings(max_examples=80, deadline=None)
@given(tables)
def test_never_above_fisher_and_blind_to_names(table):
    k1, n1, k2, n2 = table
    found = float(equality_test(*table).p_value)
    assert 0 < found <= float(fisher_p_value(*table)) * (1 + 1e-9)
    assert found == pytest.approx(float(equality_test(k2, n2, k1, n1).p_value), rel=1e-9)
    assert found == pytest.approx(float(equality_test(n1 - k1, n1, n2 - k2, n2).p_value), rel=1e-6)  # 'equal' and 'different' swapped


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


def test_fisher_against_scipy_and_for_large_tables():
    for k1, n1, k2, n2 in [(3, 10, 8, 12), (40, 60, 20, 61), (300, 1200, 380, 1250)]:
        less, greater = (stats.fisher_exact([[k1, k2], [n1 - k1, n2 - k2]], alternative=side)[1] for side in ("less", "greater"))
        assert float(fisher_p_value(k1, n1, k2, n2)) == pytest.approx(min(1, 2 * min(less, greater)), rel=1e-9)
    found = equality_test([300, 30], [1200, 120], [380, 38], [1250, 125])
    assert found.test.tolist() == ["fisher", "boschloo"]
    assert found.p_value[0] == float(fisher_p_value(300, 1200, 380, 1250))


def test_boschloo_and_fisher_meet_where_one_replaces_the_other(monkeypatch):
    table = (430, 990, 480, 990)
    exact = float(equality_test(*table).p_value)
    monkeypatch.setattr(exact_test, "LARGEST_TABLE", 10)
    switched = equality_test(*table)
    assert str(switched.test) == "fisher"
    assert exact < float(switched.p_value) < 1.15 * exact


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
    assert float(probability_greater(*table) + probability_greater(k2, n2, k1, n1)) == pytest.approx(1.0, rel=1e-13)


def test_direction_by_integration_of_the_two_densities():
    with mpmath.workdps(30):
        for k1, n1, k2, n2 in [(12, 50, 25, 50), (49, 50, 20, 45), (0, 30, 30, 30)]:
            b1 = mpmath.beta(k1 + 1, n1 - k1 + 1)

            def mass(q, k1=k1, n1=n1, k2=k2, n2=n2, b1=b1):
                return q**k1 * (1 - q) ** (n1 - k1) / b1 * mpmath.betainc(k2 + 1, n2 - k2 + 1, 0, q, regularized=True)

            expected = mpmath.quad(mass, mpmath.linspace(0, 1, 9))
            assert float(probability_greater(k1, n1, k2, n2)) == pytest.approx(float(expected), rel=1e-10)


def test_tails_far_out_and_for_a_thousand_million_trials():
    # Zero of a thousand against all of a thousand: 1/C(2002, 1001).
    tiny = mpmath.mpf(1) / mpmath.binomial(2002, 1001)
    assert probability_greater(0, 1000, 1000, 1000) == pytest.approx(0.0, abs=1e-300)
    assert float(probability_greater(0, 500, 500, 500)) == pytest.approx(float(1 / mpmath.binomial(1002, 501)), rel=1e-10)
    assert float(tiny) == 0.0  # and that is why the first is 0
    n, k1, k2 = 10**9, 400_000_000, 400_030_000
    sd = np.sqrt(2 * 0.4 * 0.6 / n)
    assert float(probability_greater(k1, n, k2, n)) == pytest.approx(stats.norm.sf(3e-5 / sd), rel=1e-3)
    skewed = probability_greater(10, 10**9, 0, 10**9)  # rates of Poisson counts: 1 - 2^-11
    assert float(skewed) == pytest.approx(1 - 2.0**-11, rel=1e-6)


def test_tails_add_up_to_one_and_the_value_itself():
    for x in range(-1, 12):
        fewer, more = hypergeometric_tails(x, 11, 9, 14)
        reference = stats.hypergeom(25, 11, 9)
        assert fewer == pytest.approx(reference.cdf(x), rel=1e-12, abs=1e-300)
        assert more == pytest.approx(reference.sf(x - 1), rel=1e-12, abs=1e-300)


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


@pytest.mark.parametrize("bad", [(3, 2, 0, 1), (-1, 2, 0, 1), (0.5, 2, 0, 1), (np.nan, 2, 0, 1), ("3", 4, 0, 1)])
def test_impossible_tables_are_refused(bad):
    with pytest.raises(InputError):
        equality_test(*bad)


def test_more_trials_than_can_be_summed_are_refused():
    with pytest.raises(InputError, match="at most"):
        probability_greater(1, 10**12, 1, 10**12)
