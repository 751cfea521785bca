"""Asymmetry of the answers: signs, exact tests and direction, counts over subjects, files."""

import numpy as np
import pandas as pd
import pytest
from conftest import made_subject, refused
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

import bayes_toe as bt
from bayes_toe.classical.asymmetry import (
    ASYMMETRY_COLUMNS,
    equality_test,
    holm,
)

# Rows of subjects are s1, s2, number of 'equal', trials.


def test_asymmetry_and_p_value_of_one_comparison_are_those_by_scipy():
    subject = made_subject("0 0.3 12 50, 0.3 0 25 40")
    row = bt.asymmetry(bt.Study([subject]))["S"].maximal
    # Posteriors of P(equal) after 12 'equal' in 50 trials and 25 in 40, from a uniform prior.
    weak_first, strong_first = stats.beta(13, 39), stats.beta(26, 16)
    assert (row.s_weak, row.s_strong) == (0.0, 0.3)
    assert (row.n_equal_weak_first, row.n_trials_weak_first) == (12, 50)
    assert (row.n_equal_strong_first, row.n_trials_strong_first) == (25, 40)
    assert row.asymmetry == pytest.approx(strong_first.mean() - weak_first.mean())
    assert row.asymmetry_se == pytest.approx(np.sqrt(strong_first.var() + weak_first.var()))
    # Rows are 'equal' and 'different', columns are the orders.
    assert row.p_value == pytest.approx(stats.boschloo_exact([[12, 25], [38, 15]]).pvalue, rel=1e-6)


@pytest.mark.parametrize("name, sign", [("A", 1), ("B", -1)])
def test_a_prior_below_the_stimuli_makes_the_asymmetry_positive(small_study, name, sign):
    # Fig. 3 of the paper: if the prior is below the stimuli (A), responses are more accurate with
    # the weaker stimulus first. If the prior is above the stimuli (B), the opposite holds.
    row = bt.asymmetry(small_study)[name]
    assert (sign * row.comparisons["asymmetry"] > 0).all()


@pytest.fixture(scope="module")
def table():
    """The asymmetry of six subjects, some of whom have several pairs.

    'corrected' is significant as one comparison but not as one of three, and 'two alike' has the
    same counts for both pairs.
    """
    corrected = "0 0.3 15 50, 0.3 0 26 50, 0 0.6 20 50, 0.6 0 20 50, 0 0.9 20 50, 0.9 0 20 50"
    two_alike = "0 0.3 10 30, 0.3 0 20 30, 0 0.6 10 30, 0.6 0 20 30"
    subjects = [
        made_subject("0 0.3 10 50, 0.3 0 40 50", "strongly positive"),
        made_subject("0 0.3 20 50, 0.3 0 22 50", "weakly positive"),
        made_subject("0 0.3 40 50, 0.3 0 10 50", "strongly negative"),
        made_subject("0 0.3 20 50, 0.3 0 20 50", "none"),
        made_subject(corrected, "corrected"),
        made_subject(two_alike, "two alike"),
    ]
    return bt.asymmetry(bt.Study(subjects))


def test_subjects_are_counted_by_sign_and_by_significance_with_and_without_correction(table):
    assert (
        "4 of 6 subjects gave more 'equal' responses with the stronger stimulus first than in the "
        "other order. The difference is significant (p < .05) in 3 of them, in 2 after Holm's "
        "correction. 1 of 6 subjects gave more 'equal' responses with the weaker stimulus first"
    ) in table.describe()


def test_one_comparison_of_a_subject_is_maximal_and_p_values_are_corrected_within_subjects(table):
    assert table["two alike"].comparisons["is_maximal"].sum() == 1
    for row in table:
        comparisons = table.frame(full=True).query("subject == @row.subject")
        assert abs(row.maximal.asymmetry) == comparisons.asymmetry.abs().max()
        assert comparisons.p_adjusted.tolist() == holm(comparisons.p_value).tolist()


def test_the_table_comes_back_from_its_file(table, tmp_path):
    frame = pd.read_csv(table.save(tmp_path / "asymmetry.csv"), dtype={"subject": str})
    assert tuple(frame.columns) == ASYMMETRY_COLUMNS
    pd.testing.assert_frame_equal(frame, table.frame(full=True), check_exact=True)


def test_pairs_in_one_order_are_left_out():
    # Subject A met one of two pairs in both orders, and B met its pair in one order.
    subject_a = made_subject("0 0.3 5 10, 0.3 0 6 10, 0 0.6 7 10", "A")
    subject_b = made_subject("0 0 5 10, 0 0.3 6 10", "B")
    table = bt.asymmetry(bt.Study([subject_a, subject_b]))
    assert len(table["A"].comparisons) == 1
    assert table["B"].maximal is None
    assert "1 of 1 subject gave" in table.describe()  # only A is counted
    with refused("in both orders"):
        bt.asymmetry(bt.Study([subject_b]))
    with refused("no subject 'x'"):
        table["x"]


# --- The exact test: k1 'equal' in n1 trials against k2 in n2 -------------------------------------

#: k1, n1, k2, n2
COUNTS = st.tuples(st.integers(1, 40), st.integers(1, 40)).flatmap(
    lambda n: st.tuples(st.integers(0, n[0]), st.just(n[0]), st.integers(0, n[1]), st.just(n[1]))
)


def fisher(k1, n1, k2, n2):
    """The two-sided p-value of Fisher's test: twice the smaller tail, at most 1."""
    table = [[k1, k2], [n1 - k1, n2 - k2]]
    less, greater = (stats.fisher_exact(table, side).pvalue for side in ("less", "greater"))
    return min(1.0, 2.0 * less, 2.0 * greater)


@settings(max_examples=40, deadline=None)
@given(COUNTS)
def test_the_exact_p_value_is_at_most_fishers_and_does_not_depend_on_names(counts):
    """Counts of at most 80 trials have Boschloo's test, which has more power than Fisher's.

    The p-value stays the same if the two orders, or the two responses, swap their names.
    """
    k1, n1, k2, n2 = counts
    p_value, _ = equality_test(*counts)
    assert 0 < p_value <= fisher(*counts) * (1 + 1e-9)  # up to rounding
    other_orders, other_responses = (k2, n2, k1, n1), (n1 - k1, n1, n2 - k2, n2)
    for renamed_counts in (other_orders, other_responses):
        # The p-values are equal up to the accuracy of SciPy's numerical optimum.
        assert equality_test(*renamed_counts)[0] == pytest.approx(p_value, rel=1e-6)


def test_more_than_150_trials_have_fishers_test_instead_of_boschloos():
    for counts in ((25, 75, 40, 76), (300, 1200, 380, 1250)):  # 151 trials, and many more
        assert equality_test(*counts) == (pytest.approx(fisher(*counts), rel=1e-9), "fisher")
    assert equality_test(300, 600, 300, 600)[0] == 1.0  # equal shares


def test_both_tests_are_close_where_one_replaces_the_other():
    # 150 trials are the largest number for Boschloo's test, which has more power than Fisher's.
    counts = 30, 75, 45, 75
    p_value, test = equality_test(*counts)
    assert test == "boschloo"
    assert p_value < fisher(*counts) < 1.5 * p_value


def test_p_values_are_adjusted_as_holm_says():
    # The sorted values .01, .03, .04 and .9 are multiplied by 4, 3, 2 and 1. The third product is
    # .08, and it is raised to the second, .09.
    assert holm([0.04, 0.01, 0.03, 0.9]) == pytest.approx([0.09, 0.04, 0.09, 0.9])
    assert holm([0.6, 0.7]).tolist() == [1.0, 1.0]
    assert holm([]).shape == (0,)
