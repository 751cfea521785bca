"""Results are those of commit 869a979 within Monte Carlo error.

Some subjects are tested here; scripts/frozen.py tests all.
"""

from pathlib import Path

import frozen
import pandas as pd
import pytest
from commands import inside

import bayes_toe

TABLE = Path(__file__).with_name("frozen.csv.gz")
BUNDLED = Path(bayes_toe.__file__).parent / "data" / "example_same_different_study.csv"


@pytest.fixture(scope="module")
def table():
    return pd.read_csv(TABLE, keep_default_na=False, na_values=[""])


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    """Numbers do not depend on the process that makes them."""
    monkeypatch.setattr(frozen, "call", inside)


def held(folder, table, study, subjects, commands):
    """The commands on some subjects of a study, against the table."""
    lines = study.read_text(encoding="utf-8").splitlines(keepends=True)
    name = {"example_same_different_study.csv": "bundled", "dots.csv": "dots"}[study.name]
    head = next(i for i, line in enumerate(lines) if line.startswith("subject,"))
    chosen = folder / study.name
    chosen.write_text(
        "".join([lines[head], *(line for line in lines[head:] if line.split(",")[0] in subjects)]),
        encoding="utf-8",
    )
    frozen.run(folder / "made" / f"{name}-7", chosen, 7, commands)
    numbers, outside = frozen.check(folder / "made", table)
    is_selected = table["row"].str.split(" / ").str[0].isin(subjects) & (table["study"] == name)
    assert numbers == is_selected.sum() >= 60 * len(subjects)
    assert not frozen.too_far(numbers, outside), outside.to_string()


def test_bundled_subjects(tmp_path, table):
    held(tmp_path, table, BUNDLED, ("S06",), ("run", "fit"))


def test_listeners_to_morse_signals(tmp_path, table, real_data):
    held(
        tmp_path,
        table,
        real_data / "morse_rothkopf_1957" / "dots.csv",
        ("dots",),
        ("run", "fit"),
    )


def test_the_check_can_fail(table):
    """A posterior sd too small by a tenth, and one evidence a nat off, are seen."""
    wide = table[table["table"] == "results/summary.csv"].copy()
    moved = wide["centre"].where(wide["column"] != "sd", 0.9 * wide["centre"])
    distance = (moved - wide["centre"]).abs() / wide["tolerance"]
    assert (distance > 1.0).sum() > len(wide) / 1000
    evidences = table[table["column"] == "log_evidence_h1"]
    assert (1.0 / evidences["tolerance"] > 3.0).mean() > 0.9
