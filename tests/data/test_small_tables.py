"""Pairs, designs, populations, covariates.

The small files beside a study, all read by the study's strict reader.
"""

import csv
from importlib.resources import files

import pytest
from commands import inside

import bayes_toe as bt
from bayes_toe.data.covariates import Covariates, read_covariates
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.data.validation import read_numbers
from bayes_toe.design.simulate import make_batch_design, read_observers
from bayes_toe.errors import InputError

TEXTS = {
    "pairs": "s1,s2,isi\n0,0.25,0.5\n0.5,-0.125,2\n0.75,0.5,8.5\n",
    "design": "s1,s2,isi\n0,0.25,0.5\n0.5,-0.125,2\n0.75,0.5,8.5\n",
    "population": "subject,mu1,sigma_p,sigma_l,q0\n01,-0.5,0.25,0.125,0.75\nNA,0.5,1.25,0.5,0.875\n",
    "covariates": "subject,age,gender\n01,20.5,f\nNA,30.25,m\nx,41.125,f\n",
}


def _pairs(path):
    return {
        name: values.tolist()
        for name, values in read_numbers(path, ("s1", "s2"), optional=("isi",))[1].items()
    }


def _design(path):
    found = make_batch_design(str(path), "", 1)
    return {"s1": found.s1.tolist(), "s2": found.s2.tolist(), "isi": found.isi.tolist()}


def _population(path):
    observers = read_observers(str(path), SAME_DIFFERENT)
    names = [observer.name for observer in observers]
    return names, [list(observer.parameters.values()) for observer in observers]


READERS = {
    "pairs": _pairs,
    "design": _design,
    "population": _population,
    "covariates": lambda path: read_covariates(path).values,
}
KINDS = pytest.mark.parametrize("kind", TEXTS)


@pytest.fixture
def written(tmp_path):
    def write(data):
        path = tmp_path / "file.csv"
        path.write_bytes(data if isinstance(data, bytes) else data.encode("utf-8"))
        return path

    return write


def problems(read, path):
    with pytest.raises(InputError) as refused:
        read(path)
    return [problem.removeprefix("file.csv: ") for problem in refused.value.problems]


def test_what_the_plain_files_hold(written):
    assert _pairs(written(TEXTS["pairs"])) == {
        "s1": [0.0, 0.5, 0.75],
        "s2": [0.25, -0.125, 0.5],
        "isi": [0.5, 2.0, 8.5],
    }
    assert _design(written(TEXTS["design"])) == _pairs(written(TEXTS["pairs"]))
    assert _population(written(TEXTS["population"])) == (
        ["01", "NA"],
        [[-0.5, 0.25, 0.125, 0.75], [0.5, 1.25, 0.5, 0.875]],
    )
    assert read_covariates(written(TEXTS["covariates"])).values == {
        "age": {"01": 20.5, "NA": 30.25, "x": 41.125},
        "gender": {"01": "f", "NA": "m", "x": "f"},
    }
    assert _pairs(written("note,s1,note,s2\n,0,x,1\n?,0.5,inf,2\n")) == {
        "s1": [0.0, 0.5],
        "s2": [1.0, 2.0],
    }, "others are ignored"


@KINDS
def test_rows_of_another_width_are_refused(written, kind):
    """Readers that guess take the first column for an index, and shift all others in silence."""
    header, *rows = TEXTS[kind].splitlines()
    width = header.count(",") + 1
    text = "\n".join(
        [header, rows[0], "", rows[1].rpartition(",")[0], *(f"{rows[0]},7" for _ in range(11))]
    )
    said = [
        f"row {4 + i}: found {width + (1 if i else -1)} cells, allowed: {width} cells as in the "
        "header"
        for i in range(10)
    ]
    assert problems(READERS[kind], written(text)) == [*said, "... and 2 more problems"]


@pytest.mark.parametrize(
    ("kind", "column"), [("pairs", "isi"), ("design", "s1"), ("population", "sigma_l")]
)
def test_cells_and_columns_of_numbers(written, kind, column):
    header, *rows = TEXTS[kind].splitlines()
    place = header.split(",").index(column)
    for cell, way in (
        ("", ""),
        ("nan", ""),
        ("1e400", ""),
        ("1_0", ""),
        ("1,5", "; decimal commas need ';' or tab between cells"),
    ):
        cells = rows[1].split(",")
        file = written(
            "\n".join(
                [header, rows[0], ",".join([*cells[:place], f'"{cell}"', *cells[place + 1 :]])]
            )
        )
        assert problems(READERS[kind], file) == [
            f"row 3, column {column}: found '{cell}', allowed: a finite number{way}"
        ]
    twice = written("\n".join([f"{header},{column}", *(f"{row},1" for row in rows)]))
    assert problems(READERS[kind], twice) == [
        f"row 1, column {column}: found 2 columns of this name, allowed: one"
    ]
    if column != "isi":
        found = ", ".join(repr(name) for name in header.replace(column, "other").split(","))
        (problem,) = problems(READERS[kind], written(TEXTS[kind].replace(column, "other")))
        assert (
            problem
            == f"row 1, column {column}: missing, found {found}, allowed: a column of this name"
        )


@pytest.mark.parametrize("kind", ["population", "covariates"])
def test_a_subject_without_a_name_or_named_twice_is_refused(written, kind):
    once, first, second, *_ = TEXTS[kind].splitlines()
    assert problems(
        READERS[kind], written("\n".join([once, first, second, first, second.replace("NA", "", 1)]))
    ) == [
        "row 4, column subject: found '01', allowed: each name once, and row 2 has it",
        "row 5, column subject: found '', allowed: a text that is not empty",
    ]


def test_the_bundled_truth_is_read_to_the_last_bit():
    with (files("bayes_toe.data") / "example_same_different_truth.csv").open(
        encoding="utf-8", newline=""
    ) as file:
        truth = {}
        for row in csv.DictReader(file):
            subject = row.pop("subject")
            truth[subject] = {name: float(cell) for name, cell in row.items()}
    assert bt.example_truth("same/different") == truth


@pytest.mark.parametrize(
    ("kind", "command"),
    [
        ("design", ("simulate", "-o", "out.csv", "--design", "file.csv")),
        ("population", ("simulate", "-o", "out.csv", "--population", "file.csv")),
        ("covariates", ("population", "study.csv", "-o", "out.nc", "--covariates", "file.csv")),
    ],
)
def test_commands_refuse_with_exit_code_2_and_write_nothing(tmp_path, written, kind, command):
    (tmp_path / "study.csv").write_text(
        "subject,s1,s2,n_equal,n_trials\n01,0,0.25,1,2\n01,0.25,0,1,2\n", encoding="utf-8"
    )
    header, *rows = TEXTS[kind].splitlines()
    written("\n".join([header, *(f"{row},7" for row in rows)]))
    done = inside(*command, cwd=tmp_path)
    assert done.returncode == 2
    assert "file.csv: row 2: found" in done.stderr
    assert not (tmp_path / "out.csv").exists()


# --- Covariates -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "values"),
    [
        (
            "subject,age\n01,23\n02,NA\n\n03,31.5\n04,40\n",
            {"age": {"01": 23.0, "03": 31.5, "04": 40.0}},
        ),
        (
            "subject,gender,site\n01,f,1\n02,m,2\n",
            {"gender": {"01": "f", "02": "m"}, "site": {"01": 1.0, "02": 2.0}},
        ),
        ("\ufeffsubject;age\n01;23,5\n1,5;41\n", {"age": {"01": 23.5, "1,5": 41.0}}),
        (
            "subject,site,dose\n01,north,1\n02,NA,1\n03,west,x\n04,south,\n",
            {
                "site": {"01": "north", "03": "west", "04": "south"},
                "dose": {"01": "1", "02": "1", "03": "x"},
            },
        ),
    ],
)
def test_numbers_levels_and_what_is_missing(written, text, values):
    assert read_covariates(written(text)).values == values


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "subject,age\na,23\nb,2O\nc,31\n",
            "row 3, column age: found '2O', allowed: a finite number (or no number in the whole "
            "column)",
        ),
        ("subject,age\na,23\nb,inf\nc,31\n", "row 3, column age: found 'inf'"),
        (
            "subject,100% sure\na,x\nb,y\nc,3\n",
            "row 2, column 100% sure: found 'x', allowed: a finite number (or no number in the "
            "whole",
        ),
        (
            "name,age\na,23\n",
            "row 1: found columns 'name', 'age', allowed: subject and at least one covariate, each "
            "with a name of its own",
        ),
        (
            "subject\na\n",
            "row 1: found columns 'subject', allowed: subject and at least one covariate",
        ),
        ("subject,age,age\na,1,2\n", "row 1: found columns 'subject', 'age', 'age', allowed"),
    ],
)
def test_bad_covariates_are_refused_with_the_place(written, text, said):
    assert problems(read_covariates, written(text))[0].startswith(said)


def test_no_number_from_python_is_not_finite():
    with pytest.raises(
        InputError,
        match="covariate age of subject 'a': found nan, allowed: a finite number or a text; leave out",
    ):
        Covariates({"age": {"a": float("nan")}})
