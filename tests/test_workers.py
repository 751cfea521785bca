"""Work shared between processes of this machine."""

import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from commands import output_of, run_python
from conftest import quick_study, results_of
from processes import (
    kill_this_worker,
    needs_proc,
    raise_interrupt,
    return_slowly,
    wait_until,
    wait_until_gone,
    workers_of,
)

import bayes_toe as bt
from bayes_toe.errors import NumericalError, WorkerError
from bayes_toe.workers import run_in_order, run_jobs, without_failed


def test_a_worker_that_dies_ends_the_work_in_one_line_and_the_next_call_has_others():
    # One job of seven kills its worker. The jobs of the next call run in two new workers, and no
    # job runs in this process.
    jobs = [partial(kill_this_worker, os.getpid()), *[partial(return_slowly, 1, 0.3)] * 6]
    message = r"^a worker died \(killed, or out of memory\): use fewer workers$"
    with pytest.raises(WorkerError, match=message):
        results_of(jobs, workers=2)
    assert os.getpid() not in results_of([os.getpid] * 4, workers=2)


def test_jobs_that_failed_are_named_and_an_error_if_all_did():
    # The subjects a and b have the results 1 and an error.
    results, failed = without_failed("ab", [1, NumericalError("no maximum")])
    assert (results, failed) == ([1], {"b": "no maximum"})
    with pytest.raises(WorkerError, match=r"^a: no maximum$"):
        without_failed("a", [NumericalError("no maximum")])


@needs_proc
@pytest.mark.parametrize(
    "second_job, progress",
    [
        pytest.param(raise_interrupt, None, id="in a job"),
        pytest.param(partial(return_slowly, 2, 0.3), lambda _: raise_interrupt(), id="in progress"),
    ],
)
def test_an_interrupt_in_a_job_or_in_its_progress_leaves_no_worker_at_work(second_job, progress):
    jobs = [partial(return_slowly, 1, 0.3), second_job, *[partial(return_slowly, 3, 0.3)] * 50]
    # Either the second of 52 jobs is interrupted, or the report of the first result. Python's
    # prompt keeps the last traceback, and with it the generator of the results. So the workers must
    # end although the traceback of `error` still holds the generator.
    with pytest.raises(KeyboardInterrupt) as error:
        run_in_order(jobs, 2, progress, [("a subject",)] * len(jobs))
    wait_until(lambda: not workers_of(os.getpid()))
    assert error.tb is not None  # It still holds the generator.


def test_a_caller_that_stops_after_one_result_is_not_warned(recwarn):
    jobs = [partial(return_slowly, k, 0.3) for k in range(9)]
    index, value = next(run_jobs(jobs, workers=2))
    # Either of the first two jobs may be done first. The value of a job is its index.
    assert index == value < 2
    assert not recwarn.list


@pytest.mark.parametrize("workers", [1, 2])
def test_results_are_in_the_order_of_the_jobs_and_progress_hears_each_name_once(workers):
    # The jobs give 2^0 to 2^3. A job has one name, none or several, such as a batch of subjects.
    reported = []
    names = [("a",), (), ("b", "c"), ("d",)]
    jobs = [partial(pow, 2, k) for k in range(4)]
    assert run_in_order(jobs, workers, reported.append, names) == [1, 2, 4, 8]
    assert sorted(reported) == ["a", "b", "c", "d"]


def put_modules(folder):
    """Put files into a folder that have the names of Python's modules, and end what runs them."""
    for name in ("random", "json", "queue", "select"):
        (folder / f"{name}.py").write_text("raise SystemExit('a file of the data folder was run')")


def test_a_command_runs_no_file_of_a_data_folder_and_takes_no_settings_from_there(tmp_path):
    # The working folder has modules, and settings of matplotlib and ArviZ that end in errors.
    put_modules(tmp_path)
    (tmp_path / "matplotlibrc").write_bytes(b"text.usetex: True\n\xff\xfe")
    (tmp_path / "arvizrc").write_bytes(b"plot.backend : evil\n")
    draws = bt.sample(quick_study("A"), model="none", draws=20, seed=1)
    draws.save(tmp_path / "draws.nc")
    program = Path(sys.executable).parent / "bayes-toe"
    words = [program, "corner", "draws.nc", "-o", "corner"]
    output_of(subprocess.run(words, cwd=tmp_path, capture_output=True, text=True))
    assert os.listdir(tmp_path / "corner") == ["A.png"]


#: A script that works with two workers, of which one imports a library.
SCRIPT = """
import bayes_toe as bt
from functools import partial
from bayes_toe.workers import run_in_order
if __name__ == "__main__":
    jobs = [partial(exec, "import matplotlib"), partial(pow, 2, 1), partial(pow, 2, 2)]
    print(run_in_order(jobs, 2, None, [()] * 3))
"""
#: In the place of matplotlib and ArviZ, which read settings from the working folder.
LIBRARY = "import os; assert not os.path.exists('matplotlibrc'), 'settings of the data folder'"


def test_workers_of_a_script_run_no_file_of_the_data_folder_and_take_no_settings(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    for name in ("matplotlib", "arviz"):
        (tmp_path / f"{name}.py").write_text(LIBRARY)
    data = tmp_path / "data"
    data.mkdir()
    put_modules(data)
    (data / "matplotlibrc").touch()
    # The script prints the results of its jobs: None of exec, and 2 and 4 of pow.
    # The variable would keep the working directory out of Python's path by itself.
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONSAFEPATH"}
    assert output_of(run_python(str(script), cwd=data, env=environment)) == "[None, 2, 4]\n"


#: A process has two workers, of which one finishes its job, and waits for the other one.
WAIT_FOR_A_WORKER = """
from functools import partial
from time import sleep
from bayes_toe.workers import run_in_order
jobs = [partial(pow, 2, 3), partial(sleep, 600)]
run_in_order(jobs, 2, lambda _: print(flush=True), names=[("a",), ()])
"""


@needs_proc
def test_workers_end_with_a_process_that_is_killed():
    words = [sys.executable, "-c", WAIT_FOR_A_WORKER]
    running = subprocess.Popen(words, start_new_session=True, stdout=subprocess.PIPE)
    with running:
        running.stdout.readline()  # printed when the first job is done
        running.kill()
    wait_until_gone(running.pid)


#: A script that works with two workers, and whose copy (os.fork) then works with two workers, too.
WORK_IN_A_COPY = """
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
    """The process and its copy print the powers of 2; then it prints the exit code of its copy."""
    # From 3.12 on Python warns of the copy of a process with threads, such as those of joblib.
    words = ["-W", "ignore::DeprecationWarning", "-c", WORK_IN_A_COPY]
    assert output_of(run_python(*words, cwd=tmp_path)) == "[1, 2, 4]\n[1, 2, 4]\n0\n"
