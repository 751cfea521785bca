"""Work shared between processes."""

import subprocess
import sys

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
