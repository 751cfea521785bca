"""The programs in scripts/, run as a user runs them.

What a process of its own would not change is run in this one.
"""

import io
import runpy
import subprocess
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from unittest.mock import patch

import adaptive_session
import pandas as pd
import pytest
from conftest import grouped_csv
from matplotlib.image import imread

import bayes_toe as bt

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


def inside(name, *args, cwd):
    """The same program in this process."""
    arguments, code = [str(SCRIPTS / name), *map(str, args)], 0
    with (
        chdir(cwd),
        patch.object(sys, "argv", arguments),
        redirect_stdout(io.StringIO()) as out,
        redirect_stderr(io.StringIO()) as errors,
    ):
        try:
            runpy.run_path(arguments[0], run_name="__main__")
        except SystemExit as left:
            code = left.code or 0
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), errors.getvalue())


def is_drawn(path):
    """A picture that reads back and is not blank."""
    picture = imread(path)[..., :3]
    return picture.min() < 0.5 < picture.max()


@pytest.fixture(scope="module")
def folder(tmp_path_factory, small_study):
    """Two subjects, one with a name that no file may have, and their draws."""
    folder = tmp_path_factory.mktemp("scripts")
    a, b, _ = small_study
    grouped_csv(
        folder / "study.csv", bt.Study([a, bt.Subject("b/2", b.s1, b.s2, b.n_yes, b.n_trials)])
    )
    words = [
        SCRIPTS / "sample_posteriors.py",
        "study.csv",
        "-o",
        "p.nc",
        "--draws",
        "500",
        "--seed",
        "1",
        "--workers",
        "1",
    ]
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "sigma_p" in done.stdout
    assert "seed 1" in done.stdout
    return folder


def test_the_draws_are_those_of_the_study(folder):
    draws = bt.load(folder / "p.nc")
    assert draws.names == ("A", "b/2")
    assert draws.attrs["seed"] == 1


def test_evidence_table_and_figure(folder, tmp_path):
    done = inside(
        "evidence_table.py", folder / "study.csv", "--figure", "e.png", "--workers", 1, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert is_drawn(tmp_path / "e.png")
    table = pd.read_csv(tmp_path / "evidence.csv")
    assert list(table.subject) == ["A", "b/2"]
    seed = done.stdout.split("seed ")[1].split(";")[
        0
    ]  # fresh, and printed: the table can be made again
    again = inside(
        "evidence_table.py",
        folder / "study.csv",
        "--seed",
        seed,
        "-o",
        "again.csv",
        "--workers",
        1,
        cwd=tmp_path,
    )
    assert again.returncode == 0, again.stderr
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "again.csv"), table, check_exact=True)


@pytest.mark.parametrize(
    ("words", "pictures"),
    [
        (["--coordinates", "gain,mu1"], ["A.png", "b_2.png"]),
        (["--subject", "A", "--prior"], ["A.png"]),
    ],
)
def test_corner_plots_of_all_subjects_or_one(folder, tmp_path, words, pictures):
    done = inside("corner_plots.py", folder / "p.nc", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in (tmp_path / "corner").iterdir()) == pictures
    assert all(is_drawn(path) for path in (tmp_path / "corner").iterdir())


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (
            ("sample_posteriors.py", "none.csv", "-o", "p.nc"),
            "p.nc: exists",
        ),  # refused before the study is read
        (("evidence_table.py", "none.csv", "-o", "p.nc"), "p.nc: exists"),
        (("evidence_table.py", "none.csv", "--figure", "p.nc"), "p.nc: exists"),
        (("calibration.py", "-o", "z", "--studies", "0", "--data-sets", "0"), "studies=0"),
        (("calibration.py", "-o", "p.nc"), "p.nc"),
    ],
)
def test_problems_are_told_before_the_work_and_end_with_exit_code_2(folder, arguments, named):
    before = (folder / "p.nc").read_bytes()
    done = inside(*arguments, cwd=folder)
    assert done.returncode == 2
    assert named in done.stderr.splitlines()[-1]
    assert (folder / "p.nc").read_bytes() == before
    assert not (folder / "z").exists()


@pytest.mark.parametrize(
    ("options", "subject", "case"),
    [
        ((), "one batch", "one batch"),
        (("--order",), "2AFC, simulated S01", "2AFC, simulated S01: constant error"),
    ],
)
def test_error_bars_of_a_case_are_judged_and_an_unknown_subject_is_refused(
    folder, options, subject, case
):
    name = "_".join(["error_bars", *(option.strip("-") for option in options)])
    done = inside(
        "error_bars.py",
        "-o",
        "bars",
        *options,
        "--seeds",
        "12",
        "--subjects",
        subject,
        "--workers",
        "1",
        cwd=folder,
    )
    assert done.returncode in (0, 3), done.stdout + done.stderr
    row = pd.read_csv(folder / "bars" / f"{name}.csv").iloc[0]
    assert (row["case"], row["seeds"], row["withheld"]) == (case, 12, 0)
    assert 0.4 < row["sd_z"] < 1.8
    assert bool(row["honest"]) == (0.8 < row["sd_z"] < 1.25) == (done.returncode == 0)
    assert f"| {case} |" in (folder / "bars" / f"{name}.md").read_text(encoding="utf-8")
    assert (
        inside(
            "error_bars.py", "-o", "bars2", *options, "--subjects", "nobody", cwd=folder
        ).returncode
        == 2
    )


def test_a_small_calibration_of_the_four_models_is_written(folder):
    done = inside(
        *("order_calibration.py", "-o", "cal", "--observers", "3", "--workers", "1"), cwd=folder
    )
    assert done.returncode in (0, 3), done.stderr
    table = pd.read_csv(folder / "cal" / "calibration_order.csv")
    assert set(table["part"]) == {"probability", "rank"}
    every = table[(table["design"] == "all") & (table["part"] == "probability")]
    assert every["observers"].tolist() == [18, 18, 18]
    assert "| all | order effect | 18 |" in (folder / "cal" / "calibration_order.md").read_text()


def test_a_session_is_saved_goes_on_and_leaves_a_study(tmp_path, monkeypatch, capsys):
    for trials in (3, 6):
        monkeypatch.setattr(
            sys,
            "argv",
            [
                "x",
                str(tmp_path / "a.json"),
                "--trials",
                str(trials),
                "--simulate",
                "--subject",
                "P7",
            ],
        )
        adaptive_session.main()
        assert "P(contraction) = " in capsys.readouterr().out
        study = bt.read_study(tmp_path / "a.csv")
        assert (study.names, study["P7"].total_trials) == (("P7",), trials)
    assert bt.design.Adaptive.resume(tmp_path / "a.json").trials == 6
