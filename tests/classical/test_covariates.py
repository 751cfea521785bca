"""Tests of covariates against scipy."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import stdtr

from bayes_toe.classical.covariates import covariate_tests
from bayes_toe.data.covariates import Covariates
from bayes_toe.errors import InputError


def one_test(column, values):
    """The only row of one covariate and one outcome, both in the order of the subjects."""
    names = [f"{i}" for i in range(len(values))]
    (row,) = covariate_tests(
        Covariates({"x": dict(zip(names, column, strict=True))}),
        {"y": dict(zip(names, values, strict=True))},
    )
    return row


def test_pearson_by_its_formulas():
    rng = np.random.default_rng(5)
    for _ in range(10):
        x = rng.normal(1e6, 1, 9)
        y = x + rng.normal(0, 0.3, 9)
        row = one_test(x, y)
        u, v = x - x.mean(), y - y.mean()
        slope = u @ v / (u @ u)
        error = np.sqrt(
            ((v - slope * u) ** 2).sum() / 7 / (u @ u)
        )  # t of the regression's slope, with no r in it
        assert (row.df, row.statistic) == pytest.approx((7, slope / error), rel=1e-6)
        assert row.p_value == pytest.approx(2 * stdtr(7, -slope / error), rel=1e-6)
        assert row.difference_or_r == pytest.approx(slope * np.sqrt(u @ u / (v @ v)), rel=1e-6)


def test_two_texts_two_numbers_and_a_subject_without_covariates():
    gender, site = (
        dict(zip(("01", "02", "03", "04"), "fmfm", strict=True)),
        {"01": 1.0, "02": 2.0, "03": 2.0, "04": 1.0},
    )
    read = Covariates({"gender": gender, "age": {"01": 23.0, "03": 31.5, "04": 40.0}, "site": site})
    outcome = {"01": 0.1, "02": -0.2, "03": 0.3, "04": 0.05, "05": 9.0}
    table = covariate_tests(read, {"mean_asymmetry": outcome})
    gender, age, site = table.rows
    expected = stats.ttest_ind([0.1, 0.3], [-0.2, 0.05], equal_var=False)
    assert (gender.test, gender.groups, gender.n) == ("t", "f - m", "2 + 2")
    assert (gender.statistic, gender.df, gender.p_value) == pytest.approx(
        (expected.statistic, expected.df, expected.pvalue)
    )
    assert gender.difference_or_r == pytest.approx(0.2 - -0.075)
    assert (age.test, age.n) == ("pearson", "3")
    assert age.difference_or_r == pytest.approx(stats.pearsonr([23, 31.5, 40], [0.1, 0.3, 0.05])[0])
    assert (site.test, site.groups) == (
        "t",
        "1 - 2",
    )  # two numbers split the subjects as two texts do
    assert table.notes == ("subjects without covariates: '05'",)


@pytest.mark.parametrize(
    ("column", "values", "said"),
    [
        ("xxx", (1.0, 2.0, 3.0), "one value only"),
        ("xyx", (1.0, 2.0, 3.0), "no variance"),
        ("xyz", (1.0, 2.0, 3.0), "3 groups: Welch's t-test compares two"),
        ("xxyy", (1.0, 1.0, 1.0, 1.0), "does not vary"),
        ((1.0, 2.0), (1.0, 2.0), "no variance"),
        ((1.0, 2.0, 3.0, 9.0), (1.0, 1.0, 1.0, 1.0), "does not vary"),
    ],
)
def test_what_cannot_be_tested_is_said(column, values, said):
    row = one_test(list(column), values)
    assert row.p_value is None
    assert said in row.note
    with pytest.raises(InputError, match="no subject of the study"):
        covariate_tests(Covariates({"age": {"x": 1.0}}), {"y": {"a": 1.0}})
