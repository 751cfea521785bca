"""Frames and MATLAB: read as their CSV file is, and refused by row and column."""

import json
from decimal import Decimal
from io import StringIO

import numpy as np
import pandas as pd
import pytest
from conftest import answers_in_order, each_row, problems, refused, s1_s2_yes_trials
from scipy.io import savemat

import bayes_toe as bt
from bayes_toe.data import matlab_file
from bayes_toe.data.read_table import input_bytes
from bayes_toe.data.tables import write_table

TRIALS = pd.DataFrame(
    {
        "subject": ["01", "NA", "Zoë", "01", "=q", "01"],
        "s1": [0.0, 0.1 + 0.2, -1e-300, 0.0, 2.0, 0.0],
        "s2": [0.3, 0.0, 2.5, 0.3, 2.0, 0.3],
        "response": ["equal", "different", "equal", None, "different", "different"],
        "block": ["b", "a", "b", "a", "b", "a"],
        "trial": [1, 2, 3, 4, 5, 6],
        "more": [None] * 6,
    }
)
COUNTS = pd.read_csv(StringIO("subject,s1,s2,n_equal,n_trials\na,0,1,1,4\na,0,2,2,5\nb,1,3,3,6\n"))


def as_polars(frame):
    """A DataFrame of polars with the same cells, and with None for a missing one."""
    with_none = frame.astype(object).where(frame.notna(), None)
    return pytest.importorskip("polars").DataFrame(with_none.to_dict("list"), strict=False)


EACH_SOURCE = pytest.mark.parametrize("as_source", [pd.DataFrame, as_polars])


def rows_and_answers(study):
    """The table of a study, and the answers of its subjects in their order."""
    rows = [study.frame().to_csv()]
    for subject in study:
        if subject.answers is not None:
            rows += answers_in_order(subject)
    return rows


@EACH_SOURCE
@pytest.mark.parametrize("frame", [TRIALS, COUNTS], ids=["trials", "counts"])
def test_a_study_is_the_same_as_from_csv(tmp_path, as_source, frame):
    # COUNTS has no order of answers, and TRIALS has one. Notes are the same but for the format,
    # which is the kind of frame.
    from_frame = bt.read_study(as_source(frame))
    # write_table puts an apostrophe before a formula, and only CSV files lose it again.
    from_file = bt.read_study(write_table(frame, tmp_path / "study.csv"))
    assert rows_and_answers(from_frame) == rows_and_answers(from_file)
    assert from_frame.reading.read == from_file.reading.read
    assert from_frame.reading.ignored == from_file.reading.ignored
    notes = "\n".join(from_file.notes).replace("comma-separated, UTF-8", from_frame.source)
    assert "\n".join(from_frame.notes) == notes


@EACH_SOURCE
@pytest.mark.parametrize(
    "column, cells, expected",
    [
        ("s1", [0.0, None, 0.0], "'', allowed: a finite number"),
        ("s2", [1.0, float("inf"), 3.0], "'inf', allowed: a finite number"),
        ("subject", ["1", None, "7"], "'', allowed: a text that is not empty"),
        (
            "s1",
            ["0", "0,3", "0"],
            "'0,3', allowed: a finite number, with a decimal point and no thousands separators",
        ),
        ("n_equal", [1, 7, 3], "'7', allowed: 0 to n_trials = 5"),
    ],
)
def test_cells_that_cannot_be_used_are_refused_by_row_and_column(
    as_source, column, cells, expected
):
    # COUNTS with one column replaced, whose second cell (row 1) cannot be used.
    (problem,) = problems(bt.read_study, as_source(COUNTS.assign(**{column: cells})))
    assert problem.endswith(f" DataFrame: row 1, column {column}: found {expected}")


def test_dates_and_lists_are_read_as_their_texts():
    # As a CSV file would have them. A character that no file can hold becomes U+FFFD.
    dates = pd.Series([pd.Timestamp("2024-01-01")] * 3, dtype="datetime64[ns]")
    assert bt.read_study(COUNTS.assign(subject=dates)).names == ("2024-01-01 00:00:00",)
    assert bt.read_study(COUNTS.assign(subject="a\0\ud800")).names == ("a\ufffd\ufffd",)
    assert problems(bt.read_study, COUNTS.assign(s2=[[1.0]] * 3)) == [
        "pandas DataFrame: column s2: found '[1.0]' in 3 rows, the first is row 0, allowed: "
        "a finite number"
    ]


def test_sources_without_rows_and_of_other_types_are_refused():
    # The problems by which tables without rows, and sources of other types, are refused.
    no_row = "found no row below it, allowed: at least one row"
    table = "allowed: the path of a file, or a pandas or polars DataFrame"
    refusals = {
        f"pandas DataFrame: columns: {no_row}": COUNTS[:0],
        f"found 'dict', {table}": {},
        f"found 'int', {table}": 3,
        f"found 'LazyFrame', {table}": as_polars(COUNTS).lazy(),
    }
    for problem, source in refusals.items():
        assert problems(bt.read_study, source) == [problem]


def test_values_of_other_types_are_read_as_what_they_say():
    # Categories, 32-bit floats, decimal numbers and truth values, in columns with other names.
    frame = pd.DataFrame(
        {
            " who": pd.Categorical(["b", "a", "b"], categories=["a", "b"]),
            # 0.1, not its nearest neighbour among the doubles.
            "i.1": np.array([0.1, 0.2, 0.1], np.float32),
            "s2": [Decimal("0.30"), Decimal("0.25"), Decimal("0.30")],
            "response": [True, False, False],
            "synthetic": [True] * 3,
        }
    )
    options = bt.ReadOptions(columns={"subject": "who", "s1": "i.1"}, equal_code="1")
    study = bt.read_study(frame, options)
    assert study.synthetic
    assert list(study.names) == ["b", "a"]
    assert s1_s2_yes_trials(study["b"]) == [(0.1, 0.3, 1, 2)]
    assert s1_s2_yes_trials(study["a"]) == [(0.2, 0.25, 0, 1)]


def test_whole_numbers_keep_their_digits():
    # A column of whole numbers with a missing number becomes floats in pandas: 1008.0 is still
    # subject 1008, by its name as a text or as a number.
    codes = bt.ReadOptions(equal_code="1")
    frame = pd.DataFrame({"subject": [1008.0, 1008.0, np.nan], "s1": 0, "s2": [0, 1, 0]})
    study = bt.read_study(frame.assign(response=[1.0, 0.0, None]), codes)
    assert study.names == ("1008",)
    assert study[1008] is study["1008"] is study[np.int64(1008)]


def test_covariates_are_read_from_a_frame_without_those_that_are_missing():
    # The subject 'NA' is a subject, whose age is missing.
    people = pd.DataFrame({"subject": ["01", "NA"], "age": [20.5, None], "group": ["x", "y"]})
    assert bt.read_covariates(people) == {
        "age": {"01": 20.5},
        "group": {"01": "x", "NA": "y"},
    }


# --- Files that are damaged, too large, or none ---------------------------------------------------


#: The program of the process that reads a file, and the beginning of the problem.
READERS = """
    import os; os.abort() | found a damaged MATLAB file (its reader ended with -
    import time; time.sleep(60) | not read within 0.5 s
"""


@each_row("reader, message", READERS)
def test_a_matlab_file_that_ends_or_stops_its_reader(reader, message, tmp_path, monkeypatch):
    # A MATLAB file is read in another process, which here runs the program `reader`: it crashes, or
    # sleeps longer than the limit of 0.5 s.
    monkeypatch.setattr(matlab_file, "_READER", reader)
    monkeypatch.setattr(matlab_file, "_LONGEST", 0.5)
    savemat(tmp_path / "trials.mat", {"subject": "M1"})
    (problem,) = problems(bt.read_study, tmp_path / "trials.mat")
    assert problem.startswith(f"trials.mat: {message}")
    assert problem.endswith("allowed: one that MATLAB has saved with '-v7'")


def test_a_small_matlab_file_with_too_many_rows_is_refused(tmp_path):
    # Compressed, 25,000,001 zeros need few bytes. The subject's name makes a second column.
    stimuli = np.zeros(25_000_001, np.int8)
    savemat(tmp_path / "trials.mat", {"s1": stimuli, "subject": "M1"}, do_compression=True)
    (problem,) = problems(bt.read_study, tmp_path / "trials.mat")
    rule = "found 2 columns with 50,000,002 cells, allowed: at most 16,384 columns and 50,000,000"
    assert problem == f"trials.mat: {rule} cells"


@pytest.mark.parametrize(
    "name, text",
    [
        ("wide.csv", "a," * 16_384),
        ("k.json", json.dumps([{**dict.fromkeys(range(1_000), 1), "t": [{}] * 600}])),
    ],
    ids=["columns", "cells"],
)
def test_a_table_of_too_many_cells_is_refused_before_they_are_made(
    name, text, tmp_path, monkeypatch
):
    # 16,385 columns in one line, or a record of 1,000 keys with 600 trials, which would be rows of
    # 1,000 cells, 600,000 together. The limit of cells is a hundredth of the program's limit.
    monkeypatch.setattr("bayes_toe.data.text_table._MOST_CELLS", 500_000)
    (tmp_path / name).write_text(text)
    with refused("at most 16,384 columns and 500,000 cells"):
        bt.read_study(tmp_path / name)


def test_arrays_in_cells_are_ignored_until_they_are_read(tmp_path):
    # The column frames has an array in each cell. It is ignored until it is called response.
    frames = np.empty(2, object)
    frames[0] = frames[1] = np.arange(3.0)
    columns = {"subject": "M1", "s1": [0.0, 0.3], "s2": [0.3, 0.0], "frames": frames}
    path = tmp_path / "trials.mat"
    savemat(path, {**columns, "response": ["same", "same"]})
    assert bt.read_study(path)["M1"].total_trials == 2
    savemat(path, {**columns, "response": frames})
    (problem,) = problems(bt.read_study, path)
    assert problem.startswith("trials.mat: column response: the codes are '[0.0, 1.0, 2.0]' (2)")


def test_folders_and_files_that_are_too_large_are_refused(tmp_path, monkeypatch):
    # The file has 4 bytes, more than the limit of 3.
    with refused("Is a directory"):
        input_bytes(tmp_path)
    (tmp_path / "file").write_bytes(b"a\n1\n")
    assert input_bytes(tmp_path / "file") == b"a\n1\n"
    monkeypatch.setattr("bayes_toe.data.read_table.LARGEST_FILE", 3)
    with refused("4 bytes, more than 3"):
        input_bytes(tmp_path / "file")
