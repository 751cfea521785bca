"""Covariates as columns: what a regression finds, who is excluded, what cannot be told."""

import numpy as np
import pytest
from conftest import problems, refused

from bayes_toe.data.covariates import read_covariates
from bayes_toe.groups.regressors import regressors

NAMES = tuple("abcdefgh")
AGES = {"a": 23.0, "b": 31.0, "c": 40.0, "d": 28.5, "e": 61.0, "f": 19.0, "g": 35.0, "h": 44.0}
DOSES = {"a": 10.0, "b": 2.0, "c": 0.0, "d": 10.0, "e": 2.0, "f": 0.0, "g": 2.0, "h": 0.0}
SITES = {
    "a": "west",
    "b": "north",
    "c": "east",
    "d": "west",
    "e": "north",
    "f": "east",
    "g": "east",
    "h": "north",
}


def test_least_squares_on_the_columns_finds_slopes_and_differences():
    """The regression is that of a y that rises by .3 a year and has a level for each site."""
    result = regressors({"age": AGES, "site": SITES}, NAMES)
    level = {"east": 2.0, "north": -1.0, "west": 4.5}
    y = np.array([0.3 * AGES[name] + level[SITES[name]] for name in NAMES])
    with_intercept = np.column_stack([np.ones(8), result.x])
    coefficients, *_ = np.linalg.lstsq(with_intercept, y, rcond=None)
    mean, slope, *differences = coefficients
    ages = np.array(list(AGES.values()))
    assert (mean, slope) == pytest.approx((0.3 * ages.mean() + 2.0, 0.3 * ages.std(ddof=1)))
    assert differences == pytest.approx([-3.0, 2.5])  # north and west, against east
    labels = [(column.label, column.meaning) for column in result.columns]
    assert labels == [
        ("age", f"age, per sd of {ages.std(ddof=1):.4g} about {ages.mean():.4g}"),
        ("site north", "site north against east"),
        ("site west", "site west against east"),
    ]


def test_subjects_in_the_studys_order_and_those_left_out_by_name(tmp_path):
    path = tmp_path / "people.csv"
    path.write_text(
        "subject,age,site\nz,90,south\na,23,x\nb,NA,y\nc,40,y\nd,28,x\ne,61,\nf,19,x\ng,,\n",
        encoding="utf-8",
    )
    # The file lacks h, and the study lacks z. Some other subjects lack a cell.
    result = regressors(read_covariates(path), ["h", "g", "f", "e", "d", "c", "b", "a"])
    assert result.subjects == ("f", "d", "c", "a")
    assert result.x[:, 1].tolist() == [0.0, 0.0, 1.0, 0.0]  # site y against x
    # Ages are standardised over these subjects, whose mean age is 27.5.
    ages = result.x[:, 0]
    assert (ages.mean(), ages.std(ddof=1)) == pytest.approx((0, 1), abs=1e-12)
    assert result.columns[0].meaning.endswith("about 27.5")
    assert result.notes == (
        "covariates of subjects that are not in the study ignored: 'z'",
        "subjects left out: 'h' (no age, site), 'g' (no age, site), 'e' (no site), 'b' (no age)",
    )


def test_a_covariate_of_numbers_is_one_slope():
    (column,) = regressors({"dose": DOSES}, NAMES).columns
    assert column.label == "dose"
    assert column.level == ""  # A slope has no level.


def test_numbers_are_levels_where_it_is_asked_for_or_where_one_is_a_text():
    expected = regressors({"dose": DOSES}, NAMES, categorical=["dose"])
    meanings = [column.meaning for column in expected.columns]
    assert meanings == ["dose 2 against 0", "dose 10 against 0"]  # not in the order of texts
    n_subjects = expected.x.sum(axis=0)  # with each level
    assert n_subjects.tolist() == [3, 2]
    result = regressors({"dose": {**DOSES, "a": "10"}}, NAMES)
    assert result.columns == expected.columns
    assert result.x.tolist() == expected.x.tolist()


def test_a_categorical_covariate_that_is_not_there_is_refused():
    with refused("categorical: found 'doze', allowed: 'dose'"):
        regressors({"dose": DOSES}, NAMES, categorical=["doze"])


def test_the_unit_of_a_covariate_changes_nothing():
    # The factor is 1e300, because squares of these numbers are beyond the largest float.
    other_ages = {name: (age + 1e3) * 1e300 for name, age in AGES.items()}
    expected, x = (regressors({"age": ages}, NAMES).x for ages in (AGES, other_ages))
    assert x == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize(
    # Covariates, and the refusal: one value for all subjects; one value for all subjects with both
    # covariates; two covariates that determine each other; too few subjects with both covariates; a
    # level for each subject.
    "columns, message",
    [
        (
            {"age": dict.fromkeys(NAMES, 30.0)},
            "covariate age: found '30' for every subject, allowed: at least two different values; "
            "leave",
        ),
        (
            {"age": {**AGES, "a": 1.0}, "site": dict.fromkeys(NAMES[1:], "x")},
            "covariate site: found 'x' for every subject",
        ),
        (
            {"age": AGES, "born": {name: 2024 - age for name, age in AGES.items()}},
            "covariates: born follows from age, allowed: columns that",
        ),
        (
            {"age": {"a": 1.0, "b": 2.0}, "x": AGES},
            "covariates: found 2 subjects with all of them, allowed: at least 4 for 2 columns; "
            "left out: 'c' ",
        ),
        (
            {"who": {name: name for name in NAMES}},
            "covariates: found 8 subjects with all of them, allowed: at least 9 for 7 columns",
        ),
    ],
)
def test_covariates_that_cannot_be_used_are_refused_in_one_line(columns, message):
    (line,) = problems(regressors, columns, NAMES)
    assert line.startswith(message)


def test_a_number_from_python_that_is_not_finite_is_refused():
    with refused("covariate age: found a number that is not finite"):
        regressors({"age": {**AGES, NAMES[0]: float("nan")}}, NAMES)
