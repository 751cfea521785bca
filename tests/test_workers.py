"""Work shared between processes."""

import subprocess
import sys
from functools import partial

import pytest

from bayes_toe.workers import run_in_order

DYING = """
import os, time
from functools import partial
from bayes_toe.workers import run_jobs

MAIN = os.getpid()

def job(main):
    time.sleep(0.2)
    if os.getpid() != main:
        os._exit(1)

list(run_jobs([partial(job, MAIN)] * 8, 2))
"""


def test_a_worker_that_dies_is_an_error_and_not_a_wait_for_ever():
    done = subprocess.run([sys.executable, "-c", DYING], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "TerminatedWorkerError" in done.stderr


@pytest.mark.parametrize("workers", [1, 2])
def test_results_are_in_the_order_of_the_jobs_and_progress_hears_each_name_once(workers):
    said = []
    names = [("a",), (), ("b", "c"), ("d",)]
    assert run_in_order([partial(pow, 2, k) for k in range(4)], workers, said.append, names) == [1, 2, 4, 8]
    assert sorted(said) == ["a", "b", "c", "d"]
