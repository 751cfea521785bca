"""Subjects that fail, and commands that are stopped: what is printed and what is left."""

import os
import re
import signal
from pathlib import Path

import pandas as pd
import pytest
import xarray as xr
from commands import refusal_of, run_command, run_ok, run_python
from conftest import quick_study, write_counts
from processes import needs_proc, start_command, wait_until, wait_until_gone

import bayes_toe as bt
from bayes_toe.errors import NumericalError

FAILURE = "no maximum"


@pytest.fixture
def folder(tmp_path):
    """A folder with study.csv, of four subjects A to D, and nothing else."""
    write_counts(tmp_path / "study.csv", quick_study("ABCD"))
    return tmp_path


def test_a_subject_that_fails_is_marked_and_the_study_goes_on(folder, monkeypatch, blank_pictures):
    def failing_for_a(evidence):
        if evidence.subject.name == "A":
            raise NumericalError(FAILURE)
        return evidence

    monkeypatch.setattr("bayes_toe.inference.order_evidence.OrderEvidence.checked", failing_for_a)
    completed = run_command("run study.csv -o out --draws 100 --figures none --seed 1", cwd=folder)
    assert (completed.returncode, completed.stderr) == (3, "")
    assert f"! A  No result: {FAILURE}" in completed.stdout
    table = pd.read_csv(folder / "out" / "evidence.csv", dtype=str)
    assert table.subject.tolist() == ["B", "C", "D", "A"]
    assert table.n_pairs[0] == "4"  # and not 4.0, although A has no number
    row_of_a = table.iloc[-1].drop(["subject", "prior", "seed"])
    assert row_of_a.isna().all()
    draws = bt.load(folder / "out" / "posterior.nc")
    assert draws.names == ("B", "C", "D")
    assert draws.failed == {"A": FAILURE}
    report = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert 'A <span class="badge bad">failed</span>' in report
    assert f"A ({FAILURE})" in report


def is_listening(running):
    """Whether a process catches SIGTERM, by the mask SigCgt, such as 0000000000004002.

    Bit n - 1 of this hexadecimal number is that of signal n.
    """
    status = Path(f"/proc/{running.pid}/status").read_text()
    mask = int(re.search(r"SigCgt:\s*(\w+)", status)[1], 16)
    return mask & 1 << (signal.SIGTERM - 1)


@needs_proc
def test_a_signal_before_the_work_ends_a_command_with_one_line(folder):
    # The signal comes as soon as the command catches it, which is before its work.
    running = start_command("run study.csv -o out --seed 1", cwd=folder)
    wait_until(lambda: is_listening(running), running)
    running.terminate()
    wait_until_gone(running.pid)
    _, errors = running.communicate()
    assert errors == "stopped by SIGTERM\n"
    assert running.returncode == 128 + signal.SIGTERM
    assert os.listdir(folder) == ["study.csv"]


SAMPLE = "sample study.csv --seed 1 --draws 100 --model none -o"


def code_and_errors_after_signal(line, n_results, folder, send, number):
    """The exit code and stderr of a command that gets a signal when so many results are stored.

    `send` is os.kill, or os.killpg for all its processes, as Ctrl+C in a terminal does.
    """
    running = start_command(line, cwd=folder)
    wait_until(lambda: len(list(folder.glob("*.partial/*.result"))) >= n_results, running)
    send(running.pid, number)
    wait_until_gone(running.pid)
    _, errors = running.communicate()
    return running.returncode, errors


@needs_proc
def test_a_command_that_is_killed_and_then_interrupted_goes_on_to_the_same_draws(folder):
    # Two workers store a result of eight, and then one more: the command is still at work.
    write_counts(folder / "study.csv", quick_study("ABCDEFGH"))
    line = f"{SAMPLE} posterior.nc --workers 2"
    code, _ = code_and_errors_after_signal(line, 1, folder, os.kill, signal.SIGKILL)
    assert code == -signal.SIGKILL
    n_results = len(list(folder.glob("*.partial/*.result"))) + 1
    line = f"{line} --resume"
    code, errors = code_and_errors_after_signal(line, n_results, folder, os.killpg, signal.SIGINT)
    assert code == 128 + signal.SIGINT
    saved = r"stopped by SIGINT: \d of 8 subjects are saved in posterior.nc.partial; type --resume"
    assert re.match(saved, errors)
    problem = refusal_of(f"{SAMPLE} posterior.nc", cwd=folder)
    assert "--resume continues it, --overwrite" in problem

    # This process has no workers.
    screen = run_ok(f"{SAMPLE} posterior.nc --resume --workers 1", cwd=folder)
    assert "of 8 subjects taken from posterior.nc.partial" in screen
    assert sorted(os.listdir(folder)) == ["posterior.nc", "study.csv"]

    run_ok(f"{SAMPLE} without_a_stop.nc", cwd=folder)
    names = ("posterior.nc", "without_a_stop.nc")
    resumed, expected = (bt.load(folder / name).tree for name in names)
    # Only the times of both files differ.
    assert resumed.attrs.pop("created_at") <= expected.attrs.pop("created_at")
    xr.testing.assert_identical(resumed, expected)


def test_stored_results_are_thrown_away_with_overwrite(tmp_path):
    # The folder of stored results has one of an earlier command, by the name of its file.
    write_counts(tmp_path / "study.csv", quick_study("A"))
    partial = tmp_path / "evidence.csv.partial"
    partial.mkdir()
    (partial / f"{'0' * 32}.result").write_text("of an earlier command")
    line = "evidence study.csv -o evidence.csv --seed 1"
    refusal = refusal_of(line, cwd=tmp_path)
    assert "evidence.csv.partial holds 1 result of a stopped command" in refusal
    run_ok(f"{line} --overwrite", cwd=tmp_path)
    assert sorted(os.listdir(tmp_path)) == ["evidence.csv", "study.csv"]


#: A thread fails after the signal has come and before the program says that it stopped.
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
#: SIGTERM is ignored before the program listens to signals, and stays so.
UNDER_NOHUP = """
import signal
from bayes_toe.cli.entry_point import listen
signal.signal(signal.SIGTERM, signal.SIG_IGN)
assert signal.SIGTERM not in listen()
signal.raise_signal(signal.SIGTERM)
"""


def test_a_thread_that_fails_after_a_signal_prints_nothing():
    # The script waits for the thread, which raises KeyError(2), before it prints that it stopped.
    finished = run_python("-c", FAILING_THREAD, timeout=60)
    assert finished.stderr == "stopped by SIGTERM\n"


def test_a_signal_that_is_ignored_on_purpose_goes_on_being_ignored():
    # The script ignores SIGTERM, as `nohup` does with another signal, listens, and sends itself
    # SIGTERM.
    assert run_python("-c", UNDER_NOHUP, timeout=60).returncode == 0
