"""Frames, Parquet, MATLAB: the same study as from their CSV file, the same strictness, refusals by row and column of the source."""

import importlib.util
import json
import os
import random
from contextlib import suppress
from decimal import Decimal
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import good, refused
from scipy.io import savemat

import bayes_toe as bt
from bayes_toe.data import matlab_file
from bayes_toe.data.read_table import input_bytes, read_table
from bayes_toe.data.tables import write_table

TRIALS = pd.DataFrame(
    {
        "subject": ["01", "NA", "Zoë", "01", "'=q", "01"],
        "s1": [0.0, 0.1 + 0.2, -1e-300, 0.0, 2.0, 0.0],
        "s2": [0.3, 0.0, 5e300, 0.3, 2.0, 0.3],
        "response": ["equal", "different", "equal", None, "different", "different"],
        "isi": [0.5, 2.0, 0.5, 2.0, 0.5, 0.5],
        "block": ["b", "a", "b", "a", "b", "a"],
        "trial": [1, 2, 3, 4, 5, 6],
        "more": [None] * 6,
    }
)
COUNTS = pd.DataFrame(
    {
        "subject": ["a", "a", "b"],
        "s1": [0, 0, 1],
        "s2": [1, 2, 3],
        "n_equal": [1, 2, 3],
        "n_trials": [4, 5, 6],
    }
)


def as_pandas(frame, folder):
    return frame


def as_polars(frame, folder):
    columns = {
        name: [None if value is None or value != value else value for value in frame[name].tolist()]
        for name in frame
    }
    return pytest.importorskip("polars").DataFrame(columns, strict=False)


def as_parquet(frame, folder):
    pytest.importorskip("pyarrow")
    frame.to_parquet(folder / "study.parquet", index=False, row_group_size=2)
    return folder / "study.parquet"


SOURCES = {
    as_pandas: ("pandas DataFrame", 0),
    as_polars: ("polars DataFrame", 0),
    as_parquet: ("Parquet", 1),
}
EVERY = pytest.mark.parametrize("made", SOURCES)


def content(study):
    counts = [
        (
            subject.name,
            subject.s1.tolist(),
            subject.s2.tolist(),
            subject.n_yes.tolist(),
            subject.n_trials.tolist(),
            subject.intervals,
        )
        for subject in study
    ]
    looked_at = {
        subject.name: (
            of.keys.tolist(),
            of.n_yes.tolist(),
            None if of.block is None else of.block.tolist(),
            of.blocks,
        )
        for subject in study
        if (of := subject.answers)
    }
    return counts, looked_at, study.reading.read, study.reading.ignored


def problems(source, read=bt.read_study, options=None):
    with pytest.raises(bt.InputError) as caught:
        read(source, *([] if options is None else [options]))
    return list(caught.value.problems)


@EVERY
@pytest.mark.parametrize("frame", [TRIALS, COUNTS], ids=["trials", "counts"])
def test_a_study_is_the_same_as_from_csv(tmp_path, made, frame):
    read, plain = (
        bt.read_study(made(frame, tmp_path)),
        bt.read_study(write_table(frame.replace("'=q", "''=q"), tmp_path / "study.csv")),
    )
    form = SOURCES[made][0]
    assert read.source == ("study.parquet" if form == "Parquet" else form)
    assert str(content(read)).replace("'=q", "''=q") == str(
        content(plain)
    )  # a spreadsheet's apostrophe is taken off in CSV files alone
    assert read.notes == tuple(note.replace("comma-separated, UTF-8", form) for note in plain.notes)


@EVERY
@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"s1": [0.0, None, 0.0]}, "row {}, column s1: found '', allowed: a finite number"),
        (
            {"s2": [1.0, float("inf"), 3.0]},
            "row {}, column s2: found 'inf', allowed: a finite number",
        ),
        (
            {"subject": ["1", None, "7"]},
            "row {}, column subject: found '', allowed: a text that is not empty",
        ),
        (
            {"subject": ["a", "a\0b", "b"]},
            "row {}, column subject: found 'a\\x00b' of type str, allowed: text, numbers or truth "
            "values",
        ),
        (
            {"s1": ["0", "0,3", "0"]},
            "row {}, column s1: found '0,3', allowed: a finite number, without thousands "
            "separators",
        ),
        ({"n_equal": [1, 7, 3]}, "row {}, column n_equal: found '7', allowed: 0 to n_trials = 5"),
        (
            {"s1": [None, b"x", None]},
            "row {}, column s1: found \"b'x'\" of type bytes, allowed: text, numbers or truth "
            "values",
        ),
    ],
    ids=["missing", "infinite", "name", "nul", "comma", "count", "bytes"],
)
def test_what_cannot_be_used_is_refused_by_row_and_column(tmp_path, made, change, said):
    (problem,) = problems(made(COUNTS.assign(**change), tmp_path))
    form, first = SOURCES[made]
    assert problem == f"{'study.parquet' if form == 'Parquet' else form}: {said.format(first + 1)}"


def test_columns_that_are_missing_or_hold_something_else_or_nothing(tmp_path):
    frame = COUNTS.rename(columns={"subject": "who"})
    with pytest.raises(bt.InputError) as caught:
        bt.read_study(frame)
    assert "use ReadOptions(columns={'subject': 'NAME'})" in str(caught.value)
    assert bt.read_study(frame, bt.ReadOptions(columns={"subject": "who"})).names == ("a", "b")
    (problem,) = problems(as_parquet(COUNTS.drop(columns="s2"), tmp_path))
    assert problem == (
        "study.parquet: schema: there is no column s2. "
        "The columns are subject, s1, n_equal, n_trials."
    )
    dates = COUNTS.assign(
        subject=pd.Series([pd.Timestamp("2024-01-01")] * 3, dtype="datetime64[ns]"),
        s2=[[1.0], [2.0], [3.0]],
    )
    assert problems(as_parquet(dates, tmp_path)) == [
        f"study.parquet: row 1, column {name}: found {found}, allowed: text, numbers or truth "
        "values"
        for name, found in (
            ("subject", "'2024-01-01 00:00:00' of type Timestamp"),
            ("s2", "'[1.0]' of type list"),
        )
    ]
    assert problems(as_parquet(COUNTS[:0].astype(str), tmp_path)) == [
        "study.parquet: schema: found no row below it, allowed: at least one row"
    ]
    assert problems(COUNTS[:0]) == [
        "pandas DataFrame: columns: found no row below it, allowed: at least one row"
    ]
    for wrong, found in ((TRIALS.to_dict("list"), "dict"), (3, "int")):
        assert problems(wrong) == [
            f"found {found!r}, allowed: the path of a file, or a pandas or polars DataFrame"
        ]
    lazy = pytest.importorskip("polars").DataFrame({"subject": ["a"]}).lazy()
    assert problems(lazy) == [
        "LazyFrame: found a lazy frame, allowed: a frame, which its collect() gives"
    ]


def test_values_of_other_types_are_read_as_what_they_say(tmp_path):
    frame = pd.DataFrame(
        {
            " who": pd.Categorical(["b", "a", "b"], categories=["a", "b"]),
            "i.1": np.array(
                [0.1, 0.2, 0.1], np.float32
            ),  # 0.1, not its nearest neighbour among the doubles
            "s2": [Decimal("0.30"), Decimal("0.25"), Decimal("0.30")],
            "response": [True, False, False],
            "synthetic": [True] * 3,
        }
    )
    study = bt.read_study(
        as_parquet(frame, tmp_path),
        bt.ReadOptions(columns={"subject": "who", "s1": "i.1"}, equal_code="1"),
    )
    assert study.synthetic
    assert [
        (subject.name, subject.s1.tolist(), subject.s2.tolist(), subject.n_yes.tolist())
        for subject in study
    ] == [
        ("b", [0.1], [0.3], [1]),
        ("a", [0.2], [0.25], [0]),
    ]
    floats = pd.DataFrame(
        {
            "subject": [1008.0, 1008.0, np.nan],
            "s1": [0, 0, 0],
            "s2": [0, 1, 0],
            "response": [1.0, 0.0, np.nan],
        }
    )
    study = bt.read_study(floats, bt.ReadOptions(equal_code="1"))
    assert study.names == ("1008",), "whole numbers keep their digits whatever pandas made of them"
    assert study[1008] is study["1008"] is study[np.int64(1008)]
    answers = pd.DataFrame(
        {
            "subject": pd.Categorical(["x"] * 2),
            "s1": 0,
            "s2": [0, 1],
            "response": pd.array([True, False], "boolean"),
        }
    )
    assert bt.read_study(answers, bt.ReadOptions(equal_code="1"))["x"].n_yes.tolist() == [1, 0]


@pytest.mark.parametrize("isi", [None, [0.5, 2.0]])
def test_a_study_gives_the_frame_that_it_is_read_from(isi):
    study = bt.simulate(2, batches=3, isi=isi, seed=1).study
    again = bt.read_study(study.frame())
    assert again.synthetic
    assert content(again)[0] == content(study)[0]
    people = pd.DataFrame({"subject": ["01", "NA"], "age": [20.5, None], "group": ["x", "y"]})
    assert bt.read_covariates(people).values == {
        "age": {"01": 20.5},
        "group": {"01": "x", "NA": "y"},
    }


# --- Files that are damaged, too large, or none ---------------------------------------------------


def test_a_damaged_parquet_file_is_one_line(tmp_path):
    pytest.importorskip("pyarrow")
    path = write_table(COUNTS, tmp_path / "study.parquet")
    whole, random_bytes, plain = path.read_bytes(), random.Random(1), content(bt.read_study(path))
    for at in random_bytes.sample(range(len(whole)), 60):
        path.write_bytes(whole[:at])
        assert len(problems(path)) == 1
        path.write_bytes(
            whole[:at] + bytes([whole[at] ^ 1 << random_bytes.randrange(8)]) + whole[at + 1 :]
        )
        with suppress(
            bt.InputError
        ):  # in what is not read, such as statistics, a change does no harm
            assert content(bt.read_study(path)) == plain
    path.write_bytes(b"subject,s1,s2,response\na,0,0,equal\n")
    assert "study.parquet: found a damaged Parquet file" in refused("check", path, cwd=tmp_path)


def test_without_pyarrow_one_line_says_what_to_install(tmp_path, monkeypatch):
    path = as_parquet(COUNTS, tmp_path)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    said = "found a Parquet file and no pyarrow, allowed: pip install 'bayes_toe[parquet]', or a CSV file"
    assert problems(path) == [f"study.parquet: {said}"]
    with pytest.raises(bt.InputError, match="no pyarrow"):
        write_table(COUNTS, tmp_path / "t.parquet")
    before_the_work = refused("fit", "there is no such study.csv", "-o", "t.parquet", cwd=tmp_path)
    assert before_the_work == f"error: t.parquet: {said}\n"


def test_a_damaged_matlab_file_is_one_line(tmp_path):
    columns = {
        "subject": "M1",
        "s1": np.array([0.0, 0.3, 0.0]),
        "s2": np.array([0.3, 0.0, 0.0]),
        "response": np.array([1, 0, 1]),
    }
    savemat(tmp_path / "trials.mat", columns)
    assert bt.read_study(tmp_path / "trials.mat", bt.ReadOptions(equal_code="1"))[
        "M1"
    ].n_yes.tolist() == [1, 1, 0]
    (tmp_path / "trials.mat").write_bytes((tmp_path / "trials.mat").read_bytes()[:200])
    (problem,) = problems(tmp_path / "trials.mat")
    assert problem.startswith("trials.mat: found a damaged MATLAB file (")
    assert problem.endswith("), allowed: one that MATLAB has saved with '-v7'")


@pytest.mark.parametrize(
    ("reader", "found"),
    [
        ("import os; os.abort()", "found a damaged MATLAB file (its reader ended with -"),
        ("import time; time.sleep(60)", "not read within 0.5 s"),
    ],
)
def test_a_matlab_file_that_ends_or_stops_its_reader(reader, found, tmp_path, monkeypatch):
    monkeypatch.setattr(matlab_file, "_READER", reader)
    monkeypatch.setattr(matlab_file, "_LONGEST", 0.5)
    savemat(tmp_path / "trials.mat", {"subject": "M1", "s1": 0.0, "s2": 0.3, "response": 1})
    (problem,) = problems(tmp_path / "trials.mat")
    assert problem.startswith(f"trials.mat: {found}")
    assert problem.endswith("allowed: one that MATLAB has saved with '-v7'")


def test_only_columns_that_are_read_must_hold_texts(tmp_path):
    frames = np.empty(2, object)
    frames[0] = frames[1] = np.arange(3.0)
    columns = {"subject": "M1", "s1": [0.0, 0.3], "s2": [0.3, 0.0], "frames": frames}
    path = tmp_path / "trials.mat"
    savemat(path, {**columns, "response": ["same", "same"]})
    assert bt.read_study(path)["M1"].total_trials == 2
    savemat(path, {**columns, "response": frames})
    (problem,) = problems(path)
    assert problem.startswith("trials.mat: row 1, column response: found")
    assert problem.endswith("of type ndarray, allowed: text, numbers or truth values")


def test_changed_bytes_of_a_matlab_file(tmp_path):
    stimuli = np.linspace(0.0, 1.0, 40)
    path = tmp_path / "trials.mat"
    savemat(path, {"subject": "M1", "s1": stimuli, "s2": stimuli[::-1], "response": 1})
    whole = path.read_bytes()
    random_bytes = random.Random(1)
    for _ in range(12):
        changed = bytearray(whole)
        for _ in range(3):
            changed[random_bytes.randrange(128, 500)] = random_bytes.randrange(256)
        path.write_bytes(changed)
        with suppress(bt.InputError):
            bt.read_study(path, bt.ReadOptions(equal_code="1"))


def test_files_without_an_end_and_files_that_are_too_large(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero")):
        assert "a pipe or device, not a file" in problems(path)[0]
    with pytest.raises(IsADirectoryError):
        input_bytes(tmp_path)
    (tmp_path / "file").write_bytes(b"a\n1\n")
    assert input_bytes(tmp_path / "file", 4) == b"a\n1\n"
    with pytest.raises(bt.InputError, match="4 bytes, more than 3"):
        read_table(tmp_path / "file", {"a"}, 3)


@pytest.mark.parametrize(
    "command",
    [
        ("check", "LONG"),
        ("check", "LONG.mat"),
        ("check", "example.csv", "LONG.csv"),
        ("simulate", "-o", "out.csv", "--design", "LONG"),
        ("simulate", "-o", "out.csv", "--population", "LONG.csv"),
        ("corner", "LONG"),
    ],
)
def test_a_name_that_is_too_long_for_a_file_is_one_line(tmp_path, command):
    COUNTS.to_csv(tmp_path / "example.csv", index=False)
    assert refused(*(word.replace("LONG", 300 * "x") for word in command), cwd=tmp_path).startswith(
        "error: "
    )


def test_commands_read_and_write_parquet(tmp_path):
    pytest.importorskip("pyarrow")
    good(
        "simulate",
        "-o",
        "study.parquet",
        "--subjects",
        2,
        "--batches",
        2,
        "--seed",
        1,
        cwd=tmp_path,
    )
    words = ("--asymmetry", "a.parquet", "--replicates", 2, "--seed", 1, "--workers", 1)
    good("fit", "study.parquet", "-o", "f.parquet", *words, cwd=tmp_path)
    assert set(pd.read_parquet(tmp_path / "a.parquet")["subject"]) >= {"S01", "S02"}


# --- Spreadsheets, JSON, encodings ---------------------------------------------------------------

ROWS = [["subject", "s1", "s2", "response"], ["01", 0, 0.3, "second"], ["01", 0.3, 0, "first"]]


def workbook(folder, sheets, name="study.xlsx"):
    """An Excel file with these rows by sheet."""
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, rows in sheets.items():
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
    book.save(folder / name)
    return folder / name


def test_excel_is_read_as_csv_is(tmp_path):
    path = workbook(
        tmp_path, {"Info": [["made by", "me"]], "Daten": [*ROWS, [], ["02", *ROWS[1][1:]]]}
    )
    study = bt.read_study(path)
    assert study.names == ("01", "02")
    assert "trial rows, Excel" in study.notes[0]
    assert "sheet Daten read, not Info" in study.notes
    assert (study["01"].s2 - study["01"].s1).tolist() == [0.3, -0.3]


def test_german_excel_with_decimal_commas_and_a_title_is_read(tmp_path):
    rows = [["Versuch 1"], ["Versuchsperson", "s1", "s2", "Antwort"]]
    rows += [["A", "0,25", "0,5", "second"], ["A", "0,5", "0,25", "first"]]
    study = bt.read_study(workbook(tmp_path, {"Tabelle1": rows}))
    assert study["A"].s1.tolist() == [0.25, 0.5]
    assert "rows above row 2 left out" in study.notes


def test_the_names_of_a_table_without_our_names_are_shown(tmp_path):
    rows = [["Lab"], ["Versuchsperson", "Reiz 1", "Reiz 2", "Antwort"], ["A", 1, 2, "second"]]
    path = workbook(tmp_path, {"Info": [["made by", "me"]], "Daten": rows})
    (problem,) = problems(path)
    assert problem.endswith("The columns are Versuchsperson, Reiz 1, Reiz 2, Antwort.")
    columns = {"s1": "Reiz 1", "s2": "Reiz 2"}
    assert bt.read_study(path, bt.ReadOptions(columns=columns)).names == ("A",)


def test_which_sheet_is_asked(tmp_path):
    path = workbook(tmp_path, {"A": ROWS, "B": ROWS})
    text = refused("check", path.name, cwd=tmp_path)
    assert "the sheets A and B have tables" in text
    assert "--sheet A" in text
    assert "A, B" not in good("check", path.name, "--sheet", "B", cwd=tmp_path)
    with pytest.raises(bt.InputError, match="found the sheets A, B, allowed: one of them"):
        bt.read_study(path, bt.ReadOptions(sheet="C"))


@pytest.mark.parametrize(
    ("cell", "said"),
    [
        ("=1+1", "sheet T, row 2, cell 2: found a formula without a value"),
        ("#DIV/0!", "sheet T, row 2, cell 2: found the error #DIV/0!, allowed: a value"),
    ],
)
def test_cells_of_excel_that_hold_no_value_are_refused(tmp_path, cell, said):
    rows = [ROWS[0], ["01", cell, 0.3, "second"]]
    (problem,) = problems(workbook(tmp_path, {"T": rows}))
    assert said in problem


def test_damaged_excel_files_are_one_line(tmp_path):
    data = bytearray(workbook(tmp_path, {"T": ROWS}).read_bytes())
    rng = random.Random(1)
    for _ in range(25):
        damaged = bytearray(data)
        for _ in range(20):
            damaged[rng.randrange(len(data))] = rng.randrange(256)
        (tmp_path / "damaged.xlsx").write_bytes(damaged)
        with suppress(bt.InputError):
            bt.read_study(tmp_path / "damaged.xlsx")


TRIAL_DICTS = [dict(zip(ROWS[0], row, strict=True)) for row in ROWS[1:]]


@pytest.mark.parametrize(
    ("suffix", "content"),
    [
        (".json", TRIAL_DICTS),
        (".json", {"trials": TRIAL_DICTS, "version": 2}),
        (".json", pd.DataFrame(TRIAL_DICTS).to_dict("list")),
        (".json", [{"subject": "01", "data": [{**trial} for trial in TRIAL_DICTS]}]),
        (".jsonl", None),
    ],
    ids=["trials", "in a key", "columns", "by participant", "lines"],
)
def test_json_is_read_as_csv_is(tmp_path, suffix, content):
    text = json.dumps(content)
    if content is None:
        text = "\n".join(map(json.dumps, TRIAL_DICTS))
    path = tmp_path / f"study{suffix}"
    path.write_text(text, encoding="utf-8")
    study = bt.read_study(path)
    assert study.names == ("01",)
    assert study["01"].s1.tolist() == [0.0, 0.3]
    assert "JSON, UTF-8" in study.notes[0]


@pytest.mark.parametrize("text", ["[1, 2]", "{", "[" * 100_000, "3"])
def test_json_that_is_no_table_is_one_line(tmp_path, text):
    (tmp_path / "study.json").write_text(text, encoding="utf-8")
    (problem,) = problems(tmp_path / "study.json")
    assert problem.startswith("study.json: found ")


@pytest.mark.parametrize(
    ("codec", "note", "options"),
    [
        ("cp1252", "Windows-1252 (--encoding NAME if that is wrong)", {}),
        ("utf-16-le", "UTF-16", {}),
        ("mac-roman", "mac-roman", {"encoding": "mac-roman"}),
    ],
)
def test_encodings(tmp_path, codec, note, options):
    text = "subject,s1,s2,response\n" + "Zoë,0,0.3,second\nZoë,0.3,0,first\n" * 3
    (tmp_path / "study.csv").write_bytes(text.encode(codec))
    study = bt.read_study(tmp_path / "study.csv", bt.ReadOptions(**options))
    assert study.names == ("Zoë",)
    assert f"comma-separated, {note}, " in study.notes[0]


def test_an_unknown_encoding_is_refused(tmp_path):
    (tmp_path / "study.csv").write_text("subject\n", encoding="utf-8")
    with pytest.raises(bt.InputError, match=r"^--encoding: found 'klingon', allowed: a name such"):
        bt.read_study(tmp_path / "study.csv", bt.ReadOptions(encoding="klingon"))


def test_lines_above_the_names_are_left_out(tmp_path):
    text = "Experiment 3\nroom 12;monitor B;\n\nsubject;s1;s2;response\nA;0;0,3;second\n"
    (tmp_path / "study.csv").write_text(text, encoding="utf-8")
    study = bt.read_study(tmp_path / "study.csv")
    assert study["A"].s2.tolist() == [0.3]
    assert "rows above row 4 left out" in study.notes
