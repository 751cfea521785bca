"""Tests of covariates against scipy; files of covariates are read strictly."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import stdtr

import bayes_toe as bt
from bayes_toe.classical.covariates import Covariates, covariate_tests, read_covariates
from bayes_toe.errors import InputError


def one_test(column, values):
    """The only row of one covariate and one outcome, both in the order of the subjects."""
    names = [f"{i}" for i in range(len(values))]
    (row,) = covariate_tests(Covariates({"x": dict(zip(names, column, strict=True))}), {"y": dict(zip(names, values, strict=True))})
    return row


def test_welch_by_its_formulas():
    rng = np.random.default_rng(4)
    for _ in range(10):
        groups = rng.normal(1, 2, rng.integers(2, 12)), rng.normal(0, 0.5, rng.integers(2, 12))
        row = one_test(np.repeat(["a", "b"], [*map(len, groups)]), np.concatenate(groups))
        shares = [values.var(ddof=1) / len(values) for values in groups]
        t = (groups[0].mean() - groups[1].mean()) / np.sqrt(sum(shares))
        df = sum(shares) ** 2 / sum(share**2 / (len(values) - 1) for share, values in zip(shares, groups, strict=True))
        assert (row.statistic, row.df, row.p_value) == pytest.approx((t, df, 2 * stdtr(df, -abs(t))), rel=1e-10)


def test_welch_with_one_group_all_alike():
    row = one_test(["a", "a", "b", "b"], [1.0, 1.0, 2.0, 4.0])
    assert (row.statistic, row.df) == pytest.approx((-2.0, 1.0))
    assert row.p_value == pytest.approx(2 * np.arctan(0.5) / np.pi)  # Student's t with one degree of freedom is Cauchy


def test_pearson_by_its_formulas():
    rng = np.random.default_rng(5)
    for _ in range(10):
        x = rng.normal(1e6, 1, 9)
        y = x + rng.normal(0, 0.3, 9)
        row = one_test(x, y)
        u, v = x - x.mean(), y - y.mean()
        slope = u @ v / (u @ u)
        error = np.sqrt(((v - slope * u) ** 2).sum() / 7 / (u @ u))  # t of the regression's slope, with no r in it
        assert (row.df, row.statistic) == pytest.approx((7, slope / error), rel=1e-6)
        assert row.p_value == pytest.approx(2 * stdtr(7, -slope / error), rel=1e-6)
        assert row.difference_or_r == pytest.approx(slope * np.sqrt(u @ u / (v @ v)), rel=1e-6)


def test_a_perfect_correlation():
    row = one_test([1.0, 2.0, 4.0], [-2.0, -4.0, -8.0])
    assert row.difference_or_r == pytest.approx(-1)
    assert row.p_value == pytest.approx(0, abs=1e-7)
    assert row.statistic < -1e7


@pytest.fixture
def people(tmp_path):
    def write(text):
        path = tmp_path / "people.csv"
        path.write_bytes(text.encode("utf-8"))
        return path

    return write


def test_a_file_of_covariates(people):
    read = read_covariates(people("subject,gender,age,site\n01,f,23,1\n02,m,NA,2\n\n03,f,31.5,2\n04,m,40,1\n"))
    assert read.values["gender"] == {"01": "f", "02": "m", "03": "f", "04": "m"}
    assert read.values["age"] == {"01": 23.0, "03": 31.5, "04": 40.0}
    outcome = {"01": 0.1, "02": -0.2, "03": 0.3, "04": 0.05, "05": 9.0}
    table = covariate_tests(read, {"mean_asymmetry": outcome})
    gender, age, site = table.rows
    expected = stats.ttest_ind([0.1, 0.3], [-0.2, 0.05], equal_var=False)
    assert (gender.test, gender.groups, gender.n) == ("t", "f - m", "2 + 2")
    assert (gender.statistic, gender.p_value) == pytest.approx((expected.statistic, expected.pvalue))
    assert gender.difference_or_r == pytest.approx(0.2 - -0.075)
    assert (age.test, age.n) == ("pearson", "3")
    assert age.difference_or_r == pytest.approx(stats.pearsonr([23, 31.5, 40], [0.1, 0.3, 0.05])[0])
    assert (site.test, site.groups) == ("t", "1 - 2")  # two numbers split the subjects as two texts do
    assert table.notes == ("subjects without covariates: '05'",)


def test_semicolons_decimal_commas_and_a_byte_order_mark(people):
    read = read_covariates(people("\ufeffsubject;age\n01;23,5\n02;30\n1,5;41\n"))
    assert read.values["age"] == {"01": 23.5, "02": 30.0, "1,5": 41.0}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("subject,age\na,23\nb,2O\nc,31\n", "row 3, column age: found '2O', allowed: a finite number"),
        ("subject,age\na,23\nb,inf\nc,31\n", "row 3, column age: found 'inf'"),
        ("subject,group\na,x\nb,y\nc,z\n", "row 2, column group: found 'x'"),
        ("subject,100% sure\na,x\nb,y\nc,z\n", "column 100% sure: found 'x'"),
        ("subject,age\na,23\na,24\n", "row 3, column subject: found 'a', allowed: each name once, and row 2 has it"),
        ("subject,age\n,23\n", "row 2, column subject: found ''"),
        ("subject,age\na,23,5\n", "row 2: found 3 cells, allowed: 2"),
        ("name,age\na,23\n", "found columns 'name', 'age', allowed: subject and"),
        ("subject\na\n", "at least one covariate"),
        ("subject,age,age\na,1,2\n", "a name of its own"),
        ("subject,age\n", "row 1: found a header only, allowed: at least one row"),
        ("", "found an empty file, allowed: a header and at least one row"),
        ('subject,age\n"a"b,3\n', "row 2: found text after a closing quote"),
    ],
)
def test_bad_files_are_refused_with_the_place(people, text, said):
    with pytest.raises(InputError) as refused:
        read_covariates(people(text))
    assert said in str(refused.value)


def test_files_that_are_not_there_or_not_text(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_covariates(tmp_path / "none.csv")
    (tmp_path / "latin.csv").write_bytes(b"subject,age\n\xe9,3\n")
    with pytest.raises(InputError, match="row 2: found byte 0xe9 at offset 12, not UTF-8"):
        read_covariates(tmp_path / "latin.csv")


def test_what_cannot_be_tested_is_said():
    outcome = {"y": {"a": 1.0, "b": 2.0, "c": 3.0}}
    notes = {}
    for key, column in {
        "alone": {"a": "x", "b": "x", "c": "x"},
        "lonely": {"a": "x", "b": "y", "c": "x"},
        "few": {"a": 1.0, "b": 2.0, "z": 3.0},
        "empty": {"c": 1.0},
    }.items():
        (row,) = covariate_tests(Covariates({key: column}), outcome)
        assert row.p_value is None
        notes[key] = row.note
    assert "one value only" in notes["alone"]
    assert "no variance" in notes["lonely"]
    assert "fewer than three" in notes["few"]
    flat = {"y": dict.fromkeys("abcd", 1.0)}
    (row,) = covariate_tests(Covariates({"g": {"a": "x", "b": "x", "c": "y", "d": "y"}}), flat)
    assert "does not vary" in row.note
    (row,) = covariate_tests(Covariates({"g": {"a": 1.0, "b": 2.0, "c": 3.0, "d": 9.0}}), flat)
    assert "does not vary" in row.note


def test_covariates_of_other_people_are_refused():
    with pytest.raises(InputError, match="no subject of the study"):
        covariate_tests(Covariates({"age": {"x": 1.0}}), {"y": {"a": 1.0}})


def test_the_table_is_written(tmp_path):
    table = covariate_tests(
        Covariates({"age": dict(zip("abcd", [1.0, 2.0, 3.0, 5.0], strict=True))}),
        {"y": dict(zip("abcd", [1.0, 3.0, 2.0, 2.5], strict=True))},
    )
    text = table.save(tmp_path / "c.csv").read_text()
    assert text.startswith("covariate,outcome,test,groups,n,")
    assert bt.covariate_tests is covariate_tests
