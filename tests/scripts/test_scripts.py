"""The programs in scripts/, run as a user runs them.

What a process of its own would not change is run in this one.
"""

import io
import runpy
import shlex
import subprocess
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from unittest.mock import patch

import pandas as pd
import pytest
from conftest import text_table

import bayes_toe as bt

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


def inside(line, cwd):
    """The same program in this process, by a line as it is typed."""
    name, *words = shlex.split(line)
    arguments, code = [str(SCRIPTS / name), *words], 0
    with (
        chdir(cwd),
        patch.object(sys, "argv", arguments),
        redirect_stdout(io.StringIO()) as out,
        redirect_stderr(io.StringIO()) as errors,
    ):
        try:
            runpy.run_path(arguments[0], run_name="__main__")
        except SystemExit as end:
            code = end.code or 0
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), errors.getvalue())


def good(line, cwd):
    """What a program prints that ends well."""
    finished = inside(line, cwd)
    assert finished.returncode == 0, finished.stderr
    return finished.stdout


REFUSED = """
    calibration.py -o z --studies 0 --data-sets 0 | studies=0
    calibration.py -o taken | taken
    error_bars.py -o z --subjects nobody | nobody
    error_bars.py -o z --order --subjects nobody | nobody
"""


@pytest.mark.parametrize("line, message", text_table(REFUSED))
def test_problems_are_told_before_the_work_and_end_with_exit_code_2(tmp_path, line, message):
    (tmp_path / "taken").write_text("of the user")
    finished = inside(line, tmp_path)
    assert finished.returncode == 2
    assert message in finished.stderr.splitlines()[-1]
    assert (tmp_path / "taken").read_text() == "of the user"
    assert not (tmp_path / "z").exists()


@pytest.mark.parametrize(
    "option, name, subject, case",
    [
        ("", "error_bars", "one batch", "one batch"),
        (
            "--order",
            "error_bars_order",
            "2AFC, simulated S01",
            "2AFC, simulated S01: constant error",
        ),
    ],
)
def test_error_bars_of_a_case_are_judged(tmp_path, option, name, subject, case):
    line = f"error_bars.py -o bars {option} --seeds 12 --subjects '{subject}' --workers 1"
    finished = inside(line, tmp_path)
    assert finished.returncode in (0, 3), finished.stdout + finished.stderr
    row = pd.read_csv(tmp_path / "bars" / f"{name}.csv").iloc[0]
    assert (row["case"], row["seeds"], row["withheld"]) == (case, 12, 0)
    assert 0.4 < row["sd_z"] < 1.8
    assert bool(row["honest"]) == (0.8 < row["sd_z"] < 1.25) == (finished.returncode == 0)
    assert f"| {case} |" in (tmp_path / "bars" / f"{name}.md").read_text(encoding="utf-8")


def test_a_small_calibration_of_the_four_models_is_written(tmp_path):
    finished = inside("order_calibration.py -o cal --observers 3 --workers 1", tmp_path)
    assert finished.returncode in (0, 3), finished.stderr
    table = pd.read_csv(tmp_path / "cal" / "calibration_order.csv")
    assert set(table["part"]) == {"probability", "rank"}
    of_all = table[(table["design"] == "all") & (table["part"] == "probability")]
    assert of_all["observers"].tolist() == [18, 18, 18]
    assert "| all | order effect | 18 |" in (tmp_path / "cal" / "calibration_order.md").read_text()


def test_a_quick_comparison_of_speed_is_written(tmp_path):
    good("speed_vs_error.py --quick -o speed", tmp_path)
    table = pd.read_csv(tmp_path / "speed" / "speed_vs_error.csv")
    assert table[table["method"] == "sample"]["error"].between(0.0, 0.1).all()
    assert (
        "| ordinary | sample | 1 | 1 | 1 | S01 | 0 |"
        in (tmp_path / "speed" / "speed_vs_error.md").read_text()
    )


def test_a_session_is_saved_goes_on_and_leaves_a_study(tmp_path):
    for n_trials in (3, 6):
        line = f"adaptive_session.py a.json --trials {n_trials} --simulate --subject P7"
        assert "P(contraction) = " in good(line, tmp_path)
        study = bt.read_study(tmp_path / "a.csv")
        assert (study.names, study["P7"].total_trials) == (("P7",), n_trials)
    assert bt.design.Adaptive.resume(tmp_path / "a.json").trials == 6
