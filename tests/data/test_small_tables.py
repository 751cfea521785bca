"""Pairs, designs, populations, covariates.

The small files beside a study, all read by the study's strict reader.
"""

import pytest
from conftest import problems

from bayes_toe.data.covariates import read_covariates
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.design.simulate import make_design, read_observers

TEXTS = {
    # Other columns are ignored, also where their name is there twice.
    "design": "note,s1,s2,note\n,0,0.25,a\n?,0.5,-0.125,inf\n,0.75,0.5,c\n",
    "population": (
        "subject,mu1,sigma_p,sigma_l,q0\n01,-0.5,0.25,0.125,0.75\nNA,0.5,1.25,0.5,0.875\n"
    ),
    "covariates": "subject,age,gender\n01,20.5,f\nNA,30.25,m\nx,41.125,f\n",
}


def _design(path):
    design = make_design(str(path), "", 1)
    return {"s1": design.s1.tolist(), "s2": design.s2.tolist()}


def _population(path):
    observers = read_observers(str(path), SAME_DIFFERENT)
    return {observer.name: list(observer.parameters.values()) for observer in observers}


READERS = {
    "design": _design,
    "population": _population,
    "covariates": read_covariates,
}
EACH_KIND = pytest.mark.parametrize("kind", TEXTS)


@pytest.fixture
def written(tmp_path):
    def write(data):
        path = tmp_path / "file.csv"
        path.write_text(data, encoding="utf-8")
        return path

    return write


def problems_of(kind, path):
    lines = problems(READERS[kind], path)
    return [line.removeprefix("file.csv: ") for line in lines]


def test_what_the_plain_files_hold(written):
    assert _design(written(TEXTS["design"])) == {
        "s1": [0.0, 0.5, 0.75],
        "s2": [0.25, -0.125, 0.5],
    }
    assert _population(written(TEXTS["population"])) == {
        "01": [-0.5, 0.25, 0.125, 0.75],
        "NA": [0.5, 1.25, 0.5, 0.875],
    }
    assert read_covariates(written(TEXTS["covariates"])) == {
        "age": {"01": 20.5, "NA": 30.25, "x": 41.125},
        "gender": {"01": "f", "NA": "m", "x": "f"},
    }


@EACH_KIND
def test_rows_of_another_width_are_refused(written, kind):
    """Readers that guess take the first column for an index, and shift all others in silence."""
    header, row, *_ = TEXTS[kind].splitlines()
    width = header.count(",") + 1
    path = written(f"{header}\n{row}\n\n{row.rpartition(',')[0]}\n{row},7\n")
    assert problems_of(kind, path) == [
        f"row 4: found {width - 1} cells, allowed: {width} cells as in the header",
        f"row 5: found {width + 1} cells, allowed: {width} cells as in the header",
    ]


EACH_COLUMN = pytest.mark.parametrize("kind, column", [("design", "s1"), ("population", "sigma_l")])


@EACH_COLUMN
@pytest.mark.parametrize("cell", ["", "nan", "1e400", "1_0", "1,5"])
def test_cells_that_are_no_numbers_are_refused(written, kind, column, cell):
    header, row, other, *_ = TEXTS[kind].splitlines()
    cells = other.split(",")
    cells[header.split(",").index(column)] = f'"{cell}"'
    path = written("\n".join([header, row, ",".join(cells)]))
    (problem,) = problems_of(kind, path)
    hint = "; decimal commas need ';' or tab between cells" if cell == "1,5" else ""
    assert problem == f"row 3, column {column}: found '{cell}', allowed: a finite number{hint}"


@EACH_COLUMN
def test_a_column_is_there_once(written, kind, column):
    header, row, *_ = TEXTS[kind].splitlines()
    assert problems_of(kind, written(f"{header},{column}\n{row},1")) == [
        f"row 1, column {column}: found 2 columns of this name, allowed: one"
    ]
    (problem,) = problems_of(kind, written(TEXTS[kind].replace(column, "other")))
    assert problem.startswith(f"row 1, column {column}: missing, found '")
    assert problem.endswith(", allowed: a column of this name")


@pytest.mark.parametrize("kind", ["population", "covariates"])
def test_a_subject_without_a_name_or_named_twice_is_refused(written, kind):
    header, row, other, *_ = TEXTS[kind].splitlines()
    path = written("\n".join([header, row, other, row, other.replace("NA", "", 1)]))
    assert problems_of(kind, path) == [
        "row 4, column subject: found '01', allowed: each name once, and row 2 has it",
        "row 5, column subject: found '', allowed: a text that is not empty",
    ]


# --- Covariates -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text, values",
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
    assert read_covariates(written(text)) == values


@pytest.mark.parametrize(
    "text, expected",
    [
        (
            "subject,age\na,23\nb,2O\nc,31\n",
            "row 3, column age: found '2O', allowed: a finite number (or no number in the whole "
            "column)",
        ),
        ("subject,age\na,23\nb,inf\nc,31\n", "row 3, column age: found 'inf'"),
        ("subject,100% sure\na,x\nb,y\nc,3\n", "row 2, column 100% sure: found 'x', allowed: "),
        (
            "name,age\na,23\n",
            "row 1: found columns 'name', 'age', allowed: subject and at least one covariate, each "
            "with a name of its own",
        ),
        ("subject\na\n", "row 1: found columns 'subject', allowed: subject and at least one"),
        ("subject,age,age\na,1,2\n", "row 1: found columns 'subject', 'age', 'age', allowed"),
    ],
)
def test_bad_covariates_are_refused_with_the_place(written, text, expected):
    assert problems_of("covariates", written(text))[0].startswith(expected)
