"""Workers that die, and commands that are stopped or killed: what is printed and what is left."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
import xarray as xr
from commands import good, inside, refused
from conftest import few_pairs, grouped_csv, known_observers
from processes import needs_proc, start, until, until_gone

import bayes_toe as bt
from bayes_toe.errors import NumericalError

FAILURE = "no maximum"


@pytest.fixture
def folder(tmp_path):
    """A study of two subjects."""
    grouped_csv(tmp_path / "study.csv", few_pairs("AB"))
    return tmp_path


@pytest.fixture
def without_the_first(monkeypatch):
    """Commands whose first subject fails, as where there is no maximum."""

    def few_jobs(jobs, workers):
        for index, job in enumerate(jobs):
            results = job()
            if index == 0:
                results[0] = NumericalError(FAILURE)
            yield index, results

    monkeypatch.setattr("bayes_toe.result_store.run_jobs", few_jobs)


def test_a_subject_that_fails_is_marked_and_the_study_goes_on(
    folder, without_the_first, blank_pictures
):
    completed = inside("run study.csv -o out --draws 100 --figures none --seed 1", cwd=folder)
    assert (completed.returncode, completed.stderr) == (3, "")
    assert f"! A  No result: {FAILURE}" in completed.stdout
    table = pd.read_csv(folder / "out" / "evidence.csv", dtype=str)
    assert table.subject.tolist() == ["B", "A"]
    assert table.n_pairs[0] == "4"
    assert table.iloc[1].drop(["subject", "prior", "seed"]).isna().all()
    draws = bt.load(folder / "out" / "posterior.nc")
    assert (draws.names, draws.failed) == (("B",), {"A": FAILURE})
    report = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert 'A <span class="badge bad">failed</span>' in report
    assert f"A ({FAILURE})" in report


def listening(running):
    """Whether a command would hear SIGTERM."""
    status = Path(f"/proc/{running.pid}/status").read_text()
    caught = re.search(r"SigCgt:\s*(\w+)", status)[1]
    return int(caught, 16) >> (signal.SIGTERM - 1) & 1


@needs_proc
def test_a_signal_before_the_work_ends_a_command_with_one_line(folder):
    running = start(*["run", "study.csv", "-o", "out", "--seed", "1"], cwd=folder)
    until(lambda: listening(running), running)
    running.terminate()
    until_gone(running.pid)
    assert running.communicate()[1] == "stopped by SIGTERM\n"
    assert running.returncode == 128 + signal.SIGTERM
    assert [path.name for path in folder.iterdir()] == ["study.csv"]


@pytest.fixture
def four(tmp_path):
    """Four subjects with few pairs."""
    grouped_csv(tmp_path / "study.csv", few_pairs("ABCD"))
    return tmp_path


@needs_proc
def test_a_command_that_is_interrupted_then_killed_and_resumed_is_as_another(four):
    options = "--seed 1 --draws 100 --model none --workers"
    line = f"sample study.csv -o posterior.nc {options}"
    codes, errors = [], []
    # To all processes, as a terminal does; and to the command alone.
    for n_stored, send, number, resume in (
        (1, os.killpg, signal.SIGINT, ""),
        (2, os.kill, signal.SIGKILL, " --resume"),
    ):
        running = start(*f"{line} 2{resume}".split(), cwd=four)
        until(lambda n=n_stored: len(list(four.glob("*.partial/*.result"))) >= n, running)
        send(running.pid, number)
        until_gone(running.pid)
        codes.append(running.returncode or running.wait())
        errors.append(running.communicate()[1])
        assert "--resume continues it, --overwrite" in refused(f"{line} 1", cwd=four)
    assert codes == [128 + signal.SIGINT, -signal.SIGKILL]
    stored = r"stopped by SIGINT: \d of 4 subjects are saved in posterior.nc.partial; type --resume"
    assert re.match(stored, errors[0])
    assert "of 4 subjects taken from posterior.nc.partial" in good(f"{line} 1 --resume", cwd=four)
    assert sorted(path.name for path in four.iterdir()) == ["posterior.nc", "study.csv"]
    good(f"sample study.csv -o calm.nc {options} 1", cwd=four)
    resumed, calm = bt.load(four / "posterior.nc").tree, bt.load(four / "calm.nc").tree
    assert resumed.attrs.pop("created_at") <= calm.attrs.pop("created_at")
    xr.testing.assert_identical(resumed, calm)


def test_what_is_stored_is_thrown_away_with_overwrite(four):
    grouped_csv(four / "study.csv", known_observers("A"))
    partial = four / "evidence.csv.partial"
    partial.mkdir()
    (partial / f"{'0' * 32}.result").write_text("of another time")
    line = "evidence study.csv -o evidence.csv --seed 1 --workers 1"
    assert "evidence.csv.partial holds 1 result of a stopped command" in refused(line, cwd=four)
    good(f"{line} --overwrite", cwd=four)
    assert sorted(path.name for path in four.iterdir()) == ["evidence.csv", "study.csv"]


FAILING_THREAD = """
import signal, threading
from bayes_toe.cli.entry_point import Stopped, listen, say_stopped
is_stopped = threading.Event()
def fail():
    is_stopped.wait()
    raise KeyError(2)
thread = threading.Thread(target=fail)
thread.start()
listen()
try:
    signal.raise_signal(signal.SIGTERM)
except Stopped as stop:
    is_stopped.set()
    thread.join()
    say_stopped(stop.number)
"""
UNDER_NOHUP = """
import signal
from bayes_toe.cli.entry_point import listen
signal.signal(signal.SIGTERM, signal.SIG_IGN)
assert signal.SIGTERM not in listen()
signal.raise_signal(signal.SIGTERM)
"""


def test_a_thread_that_fails_after_a_signal_prints_nothing():
    words = [sys.executable, "-c", FAILING_THREAD]
    stopped = subprocess.run(words, timeout=60, capture_output=True, text=True)
    assert stopped.stderr == "stopped by SIGTERM\n"


def test_a_signal_that_is_ignored_on_purpose_goes_on_being_ignored():
    assert subprocess.run([sys.executable, "-c", UNDER_NOHUP], timeout=60).returncode == 0
