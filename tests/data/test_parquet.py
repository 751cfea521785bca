"""Parquet files, in and out: the cells of a CSV file, and the same refusals."""

import importlib.util
import random
from contextlib import suppress
from decimal import Decimal

import numpy as np
import pandas as pd
import pytest
from commands import inside

from bayes_toe.data.covariates import read_covariates
from bayes_toe.data.options import ReadOptions
from bayes_toe.data.read_study import read_study
from bayes_toe.data.tables import write_table
from bayes_toe.errors import InputError

pytest.importorskip("pyarrow")

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
COUNTS = pd.DataFrame({"subject": ["a", "a", "b"], "s1": [0, 0, 1], "s2": [1, 2, 3], "n_equal": [1, 2, 3], "n_trials": [4, 5, 6]})


def parquet(folder, frame, **how):
    frame.to_parquet(folder / "study.parquet", index=False, **how)
    return folder / "study.parquet"


def content(study):
    pairs = [(one.name, [None if v is None else v.tolist() for v in (one.s1, one.s2, one.n_equal, one.n_trials, one.isi)]) for one in study]
    looked_at = {
        name: (of.keys.tolist(), of.n_equal.tolist(), None if of.block is None else of.block.tolist(), of.blocks)
        for name, of in study.reading.answers.items()
    }
    return pairs, looked_at, study.reading.read, study.reading.ignored


def problems(path, options=None):
    with pytest.raises(InputError) as caught:
        read_study(path, options)
    return list(caught.value.problems)


@pytest.mark.parametrize("frame", [TRIALS, COUNTS], ids=["trials", "counts"])
@pytest.mark.parametrize("how", [{}, {"row_group_size": 2, "use_dictionary": False, "compression": "zstd"}])
def test_a_study_is_the_same_as_from_csv(tmp_path, frame, how):
    read, plain = read_study(parquet(tmp_path, frame, **how)), read_study(write_table(frame.replace("'=q", "''=q"), tmp_path / "study.csv"))
    names = [name.replace("''", "'") for name in plain.names]
    assert (list(read.names), read.source) == (names, "study.parquet")
    assert str(content(read)) == str(content(plain)).replace("''=q", "'=q")
    assert read.notes == tuple(note.replace("comma-separated, UTF-8", "Parquet") for note in plain.notes)


def test_values_of_other_types_are_read_as_what_they_say(tmp_path):
    frame = pd.DataFrame(
        {
            "subject": pd.Categorical(["b", "a", "b"], categories=["a", "b"]),
            "s1": np.array([0.1, 0.2, 0.1], np.float32),  # 0.1, not its nearest neighbour among the doubles
            "s2": [Decimal("0.30"), Decimal("0.25"), Decimal("0.30")],
            "response": [True, False, False],
            "synthetic": [True] * 3,
        }
    )
    study = read_study(parquet(tmp_path, frame))
    assert study.synthetic
    assert [(one.name, one.s1.tolist(), one.s2.tolist(), one.n_equal.tolist()) for one in study] == [
        ("b", [0.1], [0.3], [1]),
        ("a", [0.2], [0.25], [0]),
    ]


def test_refusals_are_those_of_csv_by_row_and_column(tmp_path):
    frame = COUNTS.assign(s1=["0", "x", "1,5"], n_equal=[1.0, None, 7.0], subject=["a", "a\0", ""])
    assert problems(parquet(tmp_path, frame)) == [
        "study.parquet: row 2, column subject: found 'a\\x00', allowed: text without NUL characters",
        "study.parquet: row 2, column s1: found 'x', allowed: a finite number",
        "study.parquet: row 2, column n_equal: found '', allowed: a whole number from 0 to 2**53, without thousands separators",
        "study.parquet: row 3, column subject: found '', allowed: a text that is not empty",
        "study.parquet: row 3, column s1: found '1,5', allowed: a finite number, without thousands separators",
        "study.parquet: row 3, column n_equal: found '7', allowed: 0 to n_trials = 6",
    ]


def test_a_schema_that_does_not_fit_is_refused(tmp_path):
    assert problems(parquet(tmp_path, COUNTS.drop(columns="s2"))) == [
        "study.parquet: schema, column s2: missing, found 'subject', 's1', 'n_equal', 'n_trials', "
        "allowed: a column of this name, or --columns s2=NAME"
    ]
    dates = COUNTS.assign(subject=pd.Series([pd.Timestamp("2024-01-01")] * 3, dtype="datetime64[ns]"), s2=[[1.0], [2.0], [3.0]])
    assert problems(parquet(tmp_path, dates)) == [
        f"study.parquet: row 1, column {name}: found {found}, allowed: text, numbers or truth values"
        for name, found in (("subject", "'2024-01-01 00:00:00' of type Timestamp"), ("s2", "'[1.0]' of type list"))
    ]
    assert problems(parquet(tmp_path, COUNTS[:0].astype(str))) == [
        "study.parquet: schema: found no row below it, allowed: at least one row"
    ]


def test_other_names_and_amplitudes_are_read_as_in_csv(tmp_path):
    frame = COUNTS.rename(columns={"s1": "i1", "s2": "i.2", "subject": " who"}).assign(i1=[1, 2, 4])
    study = read_study(parquet(tmp_path, frame), ReadOptions(intensity=2.0, columns={"i2": "i.2", "subject": "who"}))
    assert study["b"].s1.tolist() == [np.log(2.0)]


def test_small_files_may_be_parquet_too(tmp_path):
    path = tmp_path / "people.parquet"
    pd.DataFrame({"subject": ["01", "NA"], "age": [20.5, None], "group": ["x", "y"]}).to_parquet(path)
    assert read_covariates(path).values == {"age": {"01": 20.5}, "group": {"01": "x", "NA": "y"}}


def test_a_damaged_file_is_one_line(tmp_path):
    path = write_table(COUNTS, tmp_path / "study.parquet")
    whole, random_bytes, plain = path.read_bytes(), random.Random(1), content(read_study(path))
    for at in random_bytes.sample(range(len(whole)), 150):
        path.write_bytes(whole[:at])
        assert len(problems(path)) == 1
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1 << random_bytes.randrange(8)]) + whole[at + 1 :])
        with suppress(InputError):  # in what is not read, such as statistics, a change does no harm
            assert content(read_study(path)) == plain
    path.write_bytes(b"subject,s1,s2,response\na,0,0,equal\n")
    done = inside("check", path)
    assert (done.returncode, done.stdout, len(done.stderr.strip().splitlines())) == (2, "", 1)
    assert "study.parquet: found a damaged Parquet file" in done.stderr


def test_more_rows_than_a_file_can_hold_are_refused_unread(tmp_path):
    path = tmp_path / "people.parquet"
    pd.DataFrame({"subject": "a", "age": np.zeros(2**22 + 1)}).to_parquet(path)
    assert path.stat().st_size < 2**20
    with pytest.raises(InputError, match=r"^people\.parquet: found 4194305 rows of .* allowed: 4194304 rows, 33554432 bytes$"):
        read_covariates(path)


def test_tables_keep_every_bit_and_no_apostrophe_is_put(tmp_path):
    frame = pd.DataFrame({"subject": ["=1", "b"], "q0": [0.1 + 0.2, np.nan], "n": [1, 2], "note": [None, "a"]}, index=[3, 4])
    again = pd.read_parquet(write_table(frame, tmp_path / "t.parquet", spreadsheet_safe=True))
    assert again["q0"].to_numpy().tobytes() == frame["q0"].to_numpy().tobytes()
    assert (list(again.columns), again["subject"].tolist(), again["note"].isna().tolist()) == (
        list(frame.columns),
        ["=1", "b"],
        [True, False],
    )


def test_commands_read_and_write_parquet(tmp_path):
    study, table = tmp_path / "study.parquet", tmp_path / "a.parquet"
    assert inside("simulate", "-o", study, "--subjects", 2, "--batches", 2, "--seed", 1).returncode == 0
    assert inside("asymmetry", study, "-o", table).returncode == 0
    assert set(pd.read_parquet(table)["subject"]) >= {"S01", "S02"}


def test_without_pyarrow_one_line_says_what_to_install(tmp_path, monkeypatch):
    path = parquet(tmp_path, COUNTS)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    said = "study.parquet: found a Parquet file and no pyarrow, allowed: pip install 'bayes_toe[parquet]', or a CSV file"
    assert problems(path) == [said]
    with pytest.raises(InputError, match="no pyarrow"):
        write_table(COUNTS, tmp_path / "t.parquet")
    refused = inside("asymmetry", "there is no such study.csv", "-o", tmp_path / "t.parquet")
    assert refused.returncode == 2
    assert "no pyarrow" in refused.stderr, "before the work"
