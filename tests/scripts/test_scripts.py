"""The programs in scripts/, run as a user runs them.

What a process of its own would not change is run in this one.
"""

import io
import runpy
import shlex
import subprocess
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import pandas as pd
import pytest
from conftest import grouped_csv, text_table
from matplotlib.image import imread

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


def is_drawn(path):
    """A picture that reads back and is not blank."""
    picture = imread(path)[..., :3]
    return picture.min() < 0.5 < picture.max()


@pytest.fixture(scope="module")
def folder(tmp_path_factory, small_study):
    """Two subjects, one with a name that no file may have, and their draws."""
    folder = tmp_path_factory.mktemp("scripts")
    first, second, _ = small_study
    grouped_csv(folder / "study.csv", bt.Study([first, replace(second, name="b/2")]))
    words = ["study.csv", "-o", "p.nc", "--draws", "500", "--seed", "1", "--workers", "1"]
    program = [sys.executable, SCRIPTS / "sample_posteriors.py"]
    finished = subprocess.run([*program, *words], capture_output=True, text=True, cwd=folder)
    assert finished.returncode == 0, finished.stderr
    assert "sigma_p" in finished.stdout
    assert "seed 1" in finished.stdout
    return folder


def test_the_draws_are_those_of_the_study(folder):
    draws = bt.load(folder / "p.nc")
    assert draws.names == ("A", "b/2")
    assert draws.attrs["seed"] == 1


def test_evidence_table_and_figure(folder, tmp_path):
    line = f"evidence_table.py {folder}/study.csv --workers 1"
    screen = good(f"{line} --figure e.png", tmp_path)
    assert is_drawn(tmp_path / "e.png")
    table = pd.read_csv(tmp_path / "evidence.csv")
    assert list(table.subject) == ["A", "b/2"]
    # The seed is fresh, and printed: the table can be made again.
    seed = screen.split("seed ")[1].split(";")[0]
    good(f"{line} --seed {seed} -o again.csv", tmp_path)
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "again.csv"), table, check_exact=True)


@pytest.mark.parametrize(
    "options, pictures",
    [("--coordinates gain,mu1", ["A.png", "b_2.png"]), ("--subject A --prior", ["A.png"])],
)
def test_corner_plots_of_all_subjects_or_one(folder, tmp_path, options, pictures):
    good(f"corner_plots.py {folder}/p.nc {options}", tmp_path)
    files = sorted((tmp_path / "corner").iterdir())
    assert [file.name for file in files] == pictures
    assert all(map(is_drawn, files))


#: The first three are refused before the study is read.
REFUSED = """
    sample_posteriors.py none.csv -o p.nc | p.nc: exists
    evidence_table.py none.csv -o p.nc | p.nc: exists
    evidence_table.py none.csv --figure p.nc | p.nc: exists
    calibration.py -o z --studies 0 --data-sets 0 | studies=0
    calibration.py -o p.nc | p.nc
    error_bars.py -o z --subjects nobody | nobody
    error_bars.py -o z --order --subjects nobody | nobody
"""


@pytest.mark.parametrize("line, message", text_table(REFUSED))
def test_problems_are_told_before_the_work_and_end_with_exit_code_2(folder, line, message):
    earlier = (folder / "p.nc").read_bytes()
    finished = inside(line, folder)
    assert finished.returncode == 2
    assert message in finished.stderr.splitlines()[-1]
    assert (folder / "p.nc").read_bytes() == earlier
    assert not (folder / "z").exists()


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
def test_error_bars_of_a_case_are_judged(folder, option, name, subject, case):
    line = f"error_bars.py -o bars {option} --seeds 12 --subjects '{subject}' --workers 1"
    finished = inside(line, folder)
    assert finished.returncode in (0, 3), finished.stdout + finished.stderr
    row = pd.read_csv(folder / "bars" / f"{name}.csv").iloc[0]
    assert (row["case"], row["seeds"], row["withheld"]) == (case, 12, 0)
    assert 0.4 < row["sd_z"] < 1.8
    assert bool(row["honest"]) == (0.8 < row["sd_z"] < 1.25) == (finished.returncode == 0)
    assert f"| {case} |" in (folder / "bars" / f"{name}.md").read_text(encoding="utf-8")


def test_a_small_calibration_of_the_four_models_is_written(folder):
    finished = inside("order_calibration.py -o cal --observers 3 --workers 1", folder)
    assert finished.returncode in (0, 3), finished.stderr
    table = pd.read_csv(folder / "cal" / "calibration_order.csv")
    assert set(table["part"]) == {"probability", "rank"}
    of_all = table[(table["design"] == "all") & (table["part"] == "probability")]
    assert of_all["observers"].tolist() == [18, 18, 18]
    assert "| all | order effect | 18 |" in (folder / "cal" / "calibration_order.md").read_text()


def test_a_session_is_saved_goes_on_and_leaves_a_study(tmp_path):
    for n_trials in (3, 6):
        line = f"adaptive_session.py a.json --trials {n_trials} --simulate --subject P7"
        assert "P(contraction) = " in good(line, tmp_path)
        study = bt.read_study(tmp_path / "a.csv")
        assert (study.names, study["P7"].total_trials) == (("P7",), n_trials)
    assert bt.design.Adaptive.resume(tmp_path / "a.json").trials == 6
