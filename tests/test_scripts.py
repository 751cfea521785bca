"""The three programs in scripts/, run as a user runs them."""

import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from conftest import grouped_csv

SCRIPTS = Path(__file__).resolve().parents[1] / "scripts"


def call(name, *args, cwd):
    return subprocess.run([sys.executable, str(SCRIPTS / name), *map(str, args)], capture_output=True, text=True, cwd=cwd)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, small_study):
    folder = tmp_path_factory.mktemp("scripts")
    grouped_csv(folder / "study.csv", small_study.select(["A", "B"]))
    done = call("sample_posteriors.py", "study.csv", "-o", "p.nc", "--draws", "500", "--seed", "1", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "sigma_p" in done.stdout
    return folder


def test_evidence_table_and_figure(folder):
    done = call("evidence_table.py", "study.csv", "-o", "e.csv", "--figure", "e.pdf", "--seed", "1", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert list(pd.read_csv(folder / "e.csv").subject) == ["A", "B"]
    assert (folder / "e.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize("coordinates", ["natural", "identified", "gain,mu1"])
def test_corner_plot(folder, coordinates):
    done = call("corner_plots.py", "p.nc", "A", "-o", f"{coordinates}.png", "--coordinates", coordinates, "--prior", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert (folder / f"{coordinates}.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("sample_posteriors.py", "none.csv"), "none.csv"),
        (("sample_posteriors.py", "study.csv", "-o", "p.nc", "--draws", "200"), "exists"),
        (("evidence_table.py", "p.nc"), "p.nc"),
        (("corner_plots.py", "p.nc", "Z", "-o", "z.png"), "no subject 'Z'"),
        (("corner_plots.py", "p.nc", "A", "-o", "z.xyz"), "suffix"),
    ],
)
def test_problems_are_lines_and_exit_code_2(folder, arguments, named):
    done = call(*arguments, cwd=folder)
    assert done.returncode == 2
    assert named in done.stderr
    assert "Traceback" not in done.stderr
    assert not (folder / "z.png").exists()
