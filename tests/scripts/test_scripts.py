"""The programs in scripts/, run as a user runs them.

What a process of its own would not change is run in this one.
"""

import runpy
import shlex
import sys
from functools import partial
from pathlib import Path
from unittest.mock import patch

from commands import run_captured
from conftest import each_row

import bayes_toe as bt

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


def inside(line, cwd):
    """The exit code and the output of a script that runs in this process, by a line as typed."""
    name, *words = shlex.split(line)
    path = str(SCRIPTS / name)
    with patch.object(sys, "argv", [path, *words]):
        return run_captured(partial(runpy.run_path, path, run_name="__main__"), cwd)


def good(line, cwd):
    """What a program prints that ends well."""
    finished = inside(line, cwd)
    assert finished.returncode == 0, finished.stderr
    return finished.stdout


#: A script in a folder with a file `taken`, and a word of what it is refused with.
REFUSED = """
    calibration.py -o z --studies 0 | must be at least 1
    calibration.py -o taken | taken
    error_bars.py -o z --subjects nobody | nobody
    error_bars.py -o z --order --subjects nobody | nobody
"""


@each_row("line, message", REFUSED)
def test_problems_are_told_before_the_work_and_end_with_exit_code_2(tmp_path, line, message):
    (tmp_path / "taken").write_text("of the user")
    finished = inside(line, tmp_path)
    assert finished.returncode == 2
    assert message in finished.stderr.splitlines()[-1]
    assert (tmp_path / "taken").read_text() == "of the user"
    assert not (tmp_path / "z").exists()


#: A small run of each script, and the name of the table that it writes.
RUNS = """
    error_bars.py --seeds 3 --subjects 'one batch' | error_bars
    error_bars.py --order --seeds 3 --subjects '2AFC, simulated S01' | error_bars_order
    order_calibration.py --observers 2 | calibration_order
    speed_vs_error.py --quick --sections ordinary evidence curves | speed_vs_error
"""


@each_row("line, name", RUNS)
def test_a_script_writes_what_it_found(tmp_path, line, name):
    finished = inside(f"{line} -o out", tmp_path)
    # 3: so small a run may find that something is not calibrated.
    assert finished.returncode in (0, 3), finished.stderr
    assert "| " in (tmp_path / "out" / f"{name}.md").read_text(encoding="utf-8")


def test_a_session_is_saved_goes_on_and_leaves_a_study(tmp_path):
    # The second call continues the session of the first up to six trials.
    for n_trials in (3, 6):
        line = f"adaptive_session.py a.json --trials {n_trials} --subject P7"
        assert "P(contraction) = " in good(line, tmp_path)
        study = bt.read_study(tmp_path / "a.csv")
        assert (study.names, study["P7"].total_trials) == (("P7",), n_trials)
    assert bt.design.Adaptive.resume(tmp_path / "a.json").trials == 6
