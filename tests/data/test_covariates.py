"""Files of covariates: numbers, levels, what is missing, and one line for what cannot be used."""

import pytest

from bayes_toe.data.covariates import Covariates, read_covariates
from bayes_toe.errors import InputError


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
    assert read.values["site"] == {"01": 1.0, "02": 2.0, "03": 2.0, "04": 1.0}


def test_semicolons_decimal_commas_and_a_byte_order_mark(people):
    read = read_covariates(people("\ufeffsubject;age\n01;23,5\n02;30\n1,5;41\n"))
    assert read.values["age"] == {"01": 23.5, "02": 30.0, "1,5": 41.0}


def test_levels_in_any_number(people):
    read = read_covariates(people("subject,site,dose\n01,north,1\n02,NA,1\n03,west,x\n04,south,\n"))
    assert read.values == {"site": {"01": "north", "03": "west", "04": "south"}, "dose": {"01": "1", "02": "1", "03": "x"}}


def test_no_number_from_python_is_not_finite():
    with pytest.raises(InputError, match="covariate age of subject 'a': found nan, allowed: a finite number or a text; leave out"):
        Covariates({"age": {"a": float("nan")}})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("subject,age\na,23\nb,2O\nc,31\n", "row 3, column age: found '2O', allowed: a finite number"),
        ("subject,age\na,23\nb,inf\nc,31\n", "row 3, column age: found 'inf'"),
        ("subject,group\na,x\nb,y\nc,3\n", "row 2, column group: found 'x', allowed: a finite number (or no number in the whole column)"),
        ("subject,100% sure\na,x\nb,2\nc,3\n", "column 100% sure: found 'x'"),
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
