"""Pairs, designs, populations, covariates: the small files beside a study, all read by the study's strict reader."""

import codecs
import csv
from importlib.resources import files

import pytest
from commands import call

import bayes_toe as bt
from bayes_toe.data.covariates import read_covariates
from bayes_toe.data.text_table import read_table
from bayes_toe.data.validation import read_numbers
from bayes_toe.errors import InputError
from bayes_toe.experiments.recipes import design_from, population_from
from bayes_toe.experiments.simulate import reference_design
from bayes_toe.inference.prediction import predict_pairs

PAIRS = "s1,s2,isi\n0,0.25,0.5\n0.5,-0.125,2\n0.75,0.5,8.5\n"
POPULATION = "subject,mu1,sigma_p,sigma_l,q0\n01,-0.5,0.25,0.125,0.75\nNA,0.5,1.25,0.5,0.875\n"
COVARIATES = "subject,age,gender\n01,20.5,f\nNA,30.25,m\nx,41.125,f\n"


def _pairs(path):
    columns = read_numbers(path, ("s1", "s2"), optional=("isi",))[1]
    return {name: values.tolist() for name, values in columns.items()}


def _design(path):
    found = design_from(str(path), "", 1)
    return {"s1": found.s1.tolist(), "s2": found.s2.tolist(), "isi": found.isi.tolist()}


def _population(path):
    names, observers = population_from(str(path), 1, 1, reference_design())
    return names, [values.tolist() for values in observers]


TEXTS = {"pairs": PAIRS, "design": PAIRS, "population": POPULATION, "covariates": COVARIATES}
READERS = {"pairs": _pairs, "design": _design, "population": _population, "covariates": lambda path: read_covariates(path).values}
#: Files that end in a refusal are refused before the draws are looked at.
REFUSING = READERS | {"pairs": lambda path: predict_pairs(None, path, ["S01"])}
ENCODINGS = [(b"", "utf-8"), (codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be")]
KINDS = pytest.mark.parametrize("kind", TEXTS)
NUMERIC = pytest.mark.parametrize(("kind", "column"), [("pairs", "s2"), ("pairs", "isi"), ("design", "s1"), ("population", "sigma_l")])


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
    return list(refused.value.problems)


def with_cell(text, column, cell, row=3):
    """The text with another cell in a row (the header is row 1)."""
    lines = [line.split(",") for line in text.splitlines()]
    lines[row - 1][lines[0].index(column)] = cell
    return "".join(",".join(line) + "\n" for line in lines)


def test_what_the_plain_files_hold(written):
    assert _pairs(written(PAIRS)) == {"s1": [0.0, 0.5, 0.75], "s2": [0.25, -0.125, 0.5], "isi": [0.5, 2.0, 8.5]}
    assert _design(written(PAIRS)) == _pairs(written(PAIRS))
    assert _population(written(POPULATION)) == (["01", "NA"], [[-0.5, 0.5], [0.25, 1.25], [0.125, 0.5], [0.75, 0.875]])
    assert read_covariates(written(COVARIATES)).values == {
        "age": {"01": 20.5, "NA": 30.25, "x": 41.125},
        "gender": {"01": "f", "NA": "m", "x": "f"},
    }


@KINDS
@pytest.mark.parametrize("end", ["\n", "\r\n", "\n\n"])
@pytest.mark.parametrize(
    ("mark", "codec"), [(b"", "utf-8"), (codecs.BOM_UTF8, "utf-8"), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be")]
)
@pytest.mark.parametrize(("delimiter", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), (", ", ".")])
def test_every_dialect_of_a_study_is_one_of_small_files(written, kind, delimiter, decimal, mark, codec, end):
    plain = READERS[kind](written(TEXTS[kind]))
    text = TEXTS[kind].replace(",", "|").replace(".", decimal).replace("|", delimiter).replace("\n", end)
    assert READERS[kind](written(mark + text.encode(codec))) == plain


@KINDS
def test_an_extra_cell_in_every_row_is_refused(written, kind):
    """Readers that guess take the first column for an index, and shift all others in silence."""
    header, *rows = TEXTS[kind].splitlines()
    path = written("\n".join([header, *(f"{row},7" for row in rows)]))
    width = header.count(",") + 1
    said = [f"file.csv: row {i}: found {width + 1} cells, allowed: {width} cells as in the header" for i in range(2, 2 + len(rows))]
    assert problems(REFUSING[kind], path) == said


@KINDS
def test_a_row_that_is_too_short_is_refused(written, kind):
    header, *rows = TEXTS[kind].splitlines()
    width = header.count(",") + 1
    path = written("\n".join([header, rows[0], "", rows[1].rpartition(",")[0]]))
    assert problems(REFUSING[kind], path) == [f"file.csv: row 4: found {width - 1} cells, allowed: {width} cells as in the header"]


@NUMERIC
@pytest.mark.parametrize("cell", ["", "nan", "NA", "inf", "-inf", "1e400", "1_0", "0x10", "x", "1 2", "١"])
def test_cells_that_hold_no_finite_number_are_refused(written, kind, column, cell):
    path = written(with_cell(TEXTS[kind], column, cell))
    assert problems(REFUSING[kind], path) == [f"file.csv: row 3, column {column}: found '{cell}', allowed: a finite number"]


def test_a_covariate_that_is_not_finite_is_refused(written):
    (problem,) = problems(read_covariates, written(with_cell(COVARIATES, "age", "inf")))
    assert problem == "file.csv: row 3, column age: found 'inf', allowed: a finite number (or no number in the whole column)"


@NUMERIC
def test_a_decimal_comma_between_commas_is_refused_with_the_way_out(written, kind, column):
    (problem,) = problems(REFUSING[kind], written(with_cell(TEXTS[kind], column, '"1|5"').replace("|", ",")))
    assert problem.endswith(f"column {column}: found '1,5', allowed: a finite number; decimal commas need ';' or tab between cells")


@pytest.mark.parametrize(("kind", "column"), [("pairs", "s2"), ("design", "s1"), ("population", "q0"), ("population", "subject")])
def test_a_missing_column_is_named(written, kind, column):
    header = TEXTS[kind].partition("\n")[0].replace(column, "other")
    found = ", ".join(repr(name) for name in header.split(","))
    path = written(TEXTS[kind].replace(column, "other"))
    assert problems(REFUSING[kind], path) == [f"file.csv: row 1, column {column}: missing, found {found}, allowed: a column of this name"]


@NUMERIC
def test_a_column_that_is_there_twice_is_refused(written, kind, column):
    header, *rows = TEXTS[kind].splitlines()
    path = written("\n".join([f"{header},{column}", *(f"{row},1" for row in rows)]))
    assert problems(REFUSING[kind], path) == [f"file.csv: row 1, column {column}: found 2 columns of this name, allowed: one"]


def test_columns_that_nobody_asked_for_are_ignored(written):
    path = written("note,s1,note,s2\n,0,x,1\n?,0.5,inf,2\n")
    assert _pairs(path) == {"s1": [0.0, 0.5], "s2": [1.0, 2.0]}


@pytest.mark.parametrize("kind", ["population", "covariates"])
def test_a_subject_without_a_name_or_named_twice_is_refused(written, kind):
    once, first, second, *_ = TEXTS[kind].splitlines()
    path = written("\n".join([once, first, second, first, second.replace("NA", "", 1)]))
    assert problems(READERS[kind], path) == [
        "file.csv: row 4, column subject: found '01', allowed: each name once, and row 2 has it",
        "file.csv: row 5, column subject: found '', allowed: a text that is not empty",
    ]


@KINDS
def test_ten_problems_are_shown(written, kind):
    header, first, *_ = TEXTS[kind].splitlines()
    found = problems(REFUSING[kind], written("\n".join([header, *[f"{first},7"] * 12])))
    assert len(found) == 11
    assert found[-1] == "... and 2 more problems"


@KINDS
@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "file.csv: found an empty file, allowed: a header and at least one row"),
        (b"HEADER\n\n", "file.csv: row 1: found a header only, allowed: at least one row below it"),
        (b'HEADER\n"a"b,1\n', "file.csv: row 2: found text after a closing quote, allowed: quotes around whole cells, doubled inside"),
        (b"HEADER\n\xe9", "file.csv: row 2: found byte 0xe9 at offset {0}, not UTF-8, allowed: text in UTF-8"),
        (b"HEADER\n1\0", "file.csv: row 2: found a NUL character at offset {1}, allowed: text in UTF-8"),
    ],
)
def test_files_that_are_no_tables_are_refused(written, kind, data, said):
    header = TEXTS[kind].partition("\n")[0].encode()
    (problem,) = problems(REFUSING[kind], written(data.replace(b"HEADER", header)))
    assert problem.startswith(said.format(len(header) + 1, len(header) + 2))


@pytest.mark.parametrize("kind", ["pairs", "covariates"])
def test_files_that_are_not_there_are_refused(tmp_path, kind):
    (problem,) = problems(REFUSING[kind], tmp_path / "none.csv")
    assert problem.endswith("none.csv: cannot be read (No such file or directory), allowed: a CSV file that exists and may be read")


def test_the_bundled_truth_is_read_to_the_last_bit():
    with (files("bayes_toe.data") / "example_truth.csv").open(encoding="utf-8", newline="") as file:
        rows = {row.pop("subject"): {name: float(cell) for name, cell in row.items()} for row in csv.DictReader(file)}
    assert bt.example_truth() == rows


@pytest.mark.parametrize(
    ("text", "command"),
    [
        (PAIRS, ("simulate", "-o", "out.csv", "--design", "file.csv")),
        (POPULATION, ("simulate", "-o", "out.csv", "--population", "file.csv")),
        (COVARIATES, ("asymmetry", "study.csv", "-o", "out.csv", "--covariates", "file.csv")),
    ],
)
def test_commands_refuse_with_exit_code_2_and_write_nothing(tmp_path, written, text, command):
    (tmp_path / "study.csv").write_text("subject,s1,s2,n_equal,n_trials\n01,0,0.25,1,2\n01,0.25,0,1,2\n", encoding="utf-8")
    header, *rows = text.splitlines()
    written("\n".join([header, *(f"{row},7" for row in rows)]))
    done = call(*command, cwd=tmp_path)
    assert done.returncode == 2
    assert "file.csv: row 2: found" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize("kind", ["pairs", "covariates"])
def test_files_without_an_end_are_refused_at_their_beginning(kind, written, monkeypatch):
    assert "a pipe or device, not a file" in problems(REFUSING[kind], "/dev/zero")[0]
    monkeypatch.setattr(read_table, "__defaults__", (40,))
    (problem,) = problems(REFUSING[kind], written(TEXTS[kind]))
    assert f"{len(TEXTS[kind].encode())} bytes, more than 40" in problem
