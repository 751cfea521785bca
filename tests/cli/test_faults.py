"""Workers that die, and commands that are stopped or killed: what is said, what is left on the disk, and that no process is."""

import pandas as pd
import pytest
import xarray as xr
from conftest import grouped_csv
from processes import kill_workers, needs_proc, start

import bayes_toe as bt

pytestmark = needs_proc
FATAL = "left out A: failed: 2 workers died of it (killed, or out of memory)"


@pytest.fixture
def folder(tmp_path):
    """Three subjects with few pairs."""
    few = [bt.Subject(name, [0.0, 0.0, 0.3, 0.3], [0.0, 0.3, 0.0, 0.3], [45, 20 - k, 15, 46], [50] * 4) for k, name in enumerate("ABC")]
    grouped_csv(tmp_path / "study.csv", bt.Study(few))
    return tmp_path


def end_after(deaths, *args, folder):
    running = start(*args, "--seed", "1", "--workers", "2", cwd=folder)
    kill_workers(running, deaths)
    out, errors = running.communicate()
    assert errors == ""
    return running.returncode, out


def test_a_subject_whose_worker_died_once_is_as_if_nothing_had_happened(folder):
    options = ("--draws", "300", "--model", "symmetric")
    code, _ = end_after(1, "sample", "study.csv", "-o", "once.nc", *options, folder=folder)
    once, calm = (
        bt.load(folder / "once.nc"),
        bt.sample(bt.read_study(folder / "study.csv"), model="symmetric", draws=300, seed=1, workers=1),
    )
    assert code == 0
    assert once.failed == {}
    xr.testing.assert_identical(once.group("posterior"), calm.group("posterior"))


def test_a_subject_whose_workers_die_is_marked_and_the_study_goes_on(folder):
    code, out = end_after(2, "run", "study.csv", "-o", "out", "--draws", "300", folder=folder)
    assert code == 3
    assert FATAL in out
    table = pd.read_csv(folder / "out" / "evidence.csv", dtype=str)
    assert table.subject.tolist() == ["B", "C", "A"]
    assert table.n_pairs.tolist()[:2] == ["4", "4"]
    assert table.iloc[2].drop(["subject", "prior"]).isna().all()
    draws = bt.load(folder / "out" / "posterior.nc")
    assert draws.names == ("B", "C")
    assert draws.failed == {"A": FATAL.removeprefix("left out A: ")}
    report = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert 'A <span class="badge bad">failed</span>' in report
    assert f"A ({draws.failed['A']})" in report


def test_a_comparison_has_an_empty_row_with_a_note(folder):
    models = ("--model", "symmetric", "--model", "free frequencies")
    code, out = end_after(2, "compare", "study.csv", "-o", "compare.csv", *models, "--draws", "200", folder=folder)
    assert code == 3
    assert FATAL.replace("A:", "A (free frequencies):") in out
    rows = pd.read_csv(folder / "compare.csv").set_index(["subject", "model"])
    assert rows.log_evidence.isna().tolist() == [True] + [False] * 5
    assert rows.note["A", "free frequencies"].startswith("failed: 2 workers died")
    assert rows.model_probability.isna().tolist() == [True, True] + [False] * 4
