"""Results of a bundled subject are those of commit 869a979 within Monte Carlo error.

scripts/frozen.py tests all subjects.
"""

from pathlib import Path

import frozen
import pandas as pd
from commands import inside

import bayes_toe

TABLE = Path(__file__).with_name("frozen.csv.gz")
BUNDLED = Path(bayes_toe.__file__).parent / "data" / "example_same_different_study.csv"
SUBJECT = "S06"


def test_a_bundled_subject(tmp_path, monkeypatch):
    monkeypatch.setattr(frozen, "call", inside)
    table = pd.read_csv(TABLE, keep_default_na=False, na_values=[""])
    lines = BUNDLED.read_text(encoding="utf-8").splitlines(keepends=True)
    rows = [line for line in lines if line.startswith(("subject,", f"{SUBJECT},"))]
    (tmp_path / BUNDLED.name).write_text("".join(rows), encoding="utf-8")
    folder = tmp_path / "made"
    frozen.run(folder / "bundled-7", tmp_path / BUNDLED.name, 7, ("run",))
    n_numbers, outside = frozen.check(folder, table)
    assert n_numbers >= 60
    assert not frozen.too_far(n_numbers, outside), outside.to_string()
