"""Work shared between processes of this machine."""

import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from conftest import few_pairs, grouped_csv
from processes import die, interrupted, needs_proc, slow, until, workers_of

from bayes_toe.errors import WorkerError
from bayes_toe.workers import Failed, run_in_order, run_jobs, run_or_fail

FATAL = "failed: 2 workers died of it (killed, or out of memory)"


@pytest.mark.parametrize(
    "deaths, expected", [(1, "alive"), (9, Failed(FATAL))], ids=["once", "always"]
)
def test_a_job_whose_worker_dies_is_tried_once_more_and_no_other_job_suffers(
    tmp_path, deaths, expected
):
    jobs = [
        partial(die, os.getpid(), tmp_path / "marks", deaths),
        *(partial(slow, k, 0.3) for k in range(6)),
    ]
    message, names = [], [(str(k),) for k in range(7)]
    assert run_or_fail(jobs, 2, message.append, names) == [expected, *range(6)]
    assert (tmp_path / "marks").stat().st_size == 2
    assert sorted(message) == sorted(str(k) for k in range(7))


def test_where_every_result_is_needed_the_one_that_is_missing_is_named(tmp_path):
    jobs = [partial(die, os.getpid(), tmp_path / "marks", 9), partial(slow, 1, 0.3)]
    with pytest.raises(WorkerError) as error:
        run_in_order(jobs, 2, None, [("S01",), ("S02",)])
    assert str(error.value) == f"S01: {FATAL}"


def test_a_worker_that_died_without_work_is_replaced():
    pids = set(run_in_order([partial(os.getpid)] * 4, 2, None, [()] * 4))
    assert os.getpid() not in pids
    for pid in pids:
        os.kill(pid, signal.SIGKILL)
    assert not pids.intersection(run_in_order([partial(os.getpid)] * 4, 2, None, [()] * 4))


@needs_proc
@pytest.mark.parametrize("way", ["of a job", "of who listens"])
def test_an_interrupt_leaves_no_worker_at_work(way):
    jobs = [
        partial(slow, 1, 0.3),
        partial(interrupted) if way == "of a job" else partial(slow, 2, 0.3),
        *[partial(slow, 3, 0.3)] * 50,
    ]
    with pytest.raises(
        KeyboardInterrupt
    ) as error:  # which keeps what was under way, as a session does
        run_in_order(jobs, 2, lambda _: interrupted(), [("",)] * 52)
    until(lambda: not workers_of(os.getpid()))
    assert error.tb is not None


def test_who_wants_no_more_results_is_not_warned(recwarn):
    assert next(run_jobs([partial(slow, k, 0.3) for k in range(9)], 2)) in {(0, 0), (1, 1)}
    assert not recwarn.list


@pytest.mark.parametrize("workers", [1, 2])
def test_results_are_in_the_order_of_the_jobs_and_progress_hears_each_name_once(workers):
    message = []
    names = [("a",), (), ("b", "c"), ("d",)]
    assert run_in_order([partial(pow, 2, k) for k in range(4)], workers, message.append, names) == [
        1,
        2,
        4,
        8,
    ]
    assert sorted(message) == ["a", "b", "c", "d"]


def installed(line, folder):
    """The installed command in a data folder."""
    program = Path(sys.executable).parent / "bayes-toe"
    return subprocess.run([program, *line.split()], cwd=folder, capture_output=True, text=True)


def test_workers_of_a_command_run_no_file_of_the_working_directory(tmp_path):
    """A data folder may hold a random.py or a json.py."""
    grouped_csv(tmp_path / "study.csv", few_pairs("AB"))
    for name in ("random", "json", "queue", "select"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('a file of the data folder')")
    finished = installed("fit study.csv -o fit.csv --replicates 2 --workers 2", tmp_path)
    assert (finished.returncode, finished.stderr) == (0, "")
    assert "failed" not in finished.stdout


CALLED_FROM_A_DATA_FOLDER = """
import bayes_toe as bt
from functools import partial
from bayes_toe.workers import run_in_order
if __name__ == "__main__":
    print(run_in_order([partial(pow, 2, k) for k in range(3)], 2, None, [()] * 3))
"""


def test_workers_of_a_script_run_no_file_of_the_working_directory(tmp_path):
    code, data = tmp_path / "code", tmp_path / "data"
    code.mkdir()
    data.mkdir()
    (code / "script.py").write_text(CALLED_FROM_A_DATA_FOLDER)
    for name in ("random", "json", "queue", "select"):
        (data / f"{name}.py").write_text("raise SystemExit('a file of the data folder was run')")
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONSAFEPATH"}
    words = [sys.executable, str(code / "script.py")]
    finished = subprocess.run(words, cwd=data, capture_output=True, text=True, env=environment)
    assert (finished.stdout, finished.stderr, finished.returncode) == ("[1, 2, 4]\n", "", 0)


def test_commands_take_no_settings_from_the_data_folder(tmp_path):
    (tmp_path / "matplotlibrc").write_bytes(b"text.usetex: True\n")
    (tmp_path / "arvizrc").write_bytes(b"plot.backend : evil\n")
    grouped_csv(tmp_path / "study.csv", few_pairs("AB"))
    sampled = installed(
        "sample study.csv -o draws.nc --seed 1 --draws 100 --workers 2 -q", tmp_path
    )
    assert sampled.returncode in (0, 3)
    drawn = installed("corner draws.nc -o corner --workers 1 -q", tmp_path)
    assert (drawn.returncode, sampled.stderr, drawn.stderr) == (0, "", "")
    (tmp_path / "matplotlibrc").write_bytes(b"\xff\xfe")
    drawn = installed("corner draws.nc -o corner_again --workers 1 -q", tmp_path)
    assert (drawn.returncode, drawn.stderr) == (0, "")


FORKED = """
import os, signal
from functools import partial
from bayes_toe.workers import run_in_order
jobs = [partial(pow, 2, k) for k in range(3)]
print(run_in_order(jobs, 2, None, [()] * 3), flush=True)
child = os.fork()
if child == 0:
    signal.alarm(120)  # ends what hangs
    print(run_in_order(jobs, 2, None, [()] * 3), flush=True)
    os._exit(0)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that are copies")
def test_a_copy_of_a_process_that_has_workers_can_work(tmp_path):
    # From 3.12 on Python warns of a copy of a process with threads, which joblib's has.
    words = [sys.executable, "-W", "ignore::DeprecationWarning", "-c", FORKED]
    finished = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert (finished.stdout, finished.stderr) == ("[1, 2, 4]\n[1, 2, 4]\n0\n", "")
