"""Processes that are killed, stopped by a full disk, or left: what stands in /proc."""

import os
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path

import pytest
from commands import PROGRAM, run_python

from bayes_toe.errors import InputError

needs_proc = pytest.mark.skipif(
    not Path("/proc/self/stat").exists(), reason="looks for processes in /proc"
)


def start_command(line, cwd):
    """Start a command as a user does, in a session of its own; the process is still running."""
    env = {**os.environ, "OMP_NUM_THREADS": "1"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(
        [*PROGRAM, *line.split()], cwd=cwd, env=env, start_new_session=True, **pipes
    )


def workers_of(parent):
    """The ids of worker processes that a process has begun, by the command line of joblib's."""
    return [
        pid
        for pid, line in members(os.getsid(parent)).items()
        if "popen_loky" in line and parent_of(pid) == parent
    ]


def parent_of(pid):
    """The id of a process's parent; None where the process has ended."""
    with suppress(OSError):
        _, parent = state_and_parent(Path(f"/proc/{pid}"))
        return int(parent)


def state_and_parent(folder):
    """The state and the parent of a process; in /proc/7, the file stat is `7 (name) S 3 ...`."""
    _, _, fields = (folder / "stat").read_text().rpartition(")")
    state, parent, *_ = fields.split()
    return state, parent


def members(session):
    """The processes of a session that have not ended: command lines by id.

    The state Z is that of a process that has ended and that nobody has waited for.
    """
    line_by_pid = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            state, _ = state_and_parent(folder)
            if os.getsid(int(folder.name)) == session and state != "Z":
                line_by_pid[int(folder.name)] = (folder / "cmdline").read_text().replace("\0", " ")
    return line_by_pid


# --- Jobs -----------------------------------------------------------------------------------------

# A worker loads the file of its job. Jobs in the file of a test would load all libraries of tests.


def return_slowly(value, seconds):
    time.sleep(seconds)
    return value


def raise_interrupt():
    raise KeyboardInterrupt


def raise_input_error():
    raise InputError("no")


def blas_threads():
    import numpy as np
    from threadpoolctl import threadpool_info

    np.linalg.inv(np.eye(2))
    return [
        element["num_threads"] for element in threadpool_info() if element["user_api"] == "blas"
    ]


def kill_this_worker(main):
    """A job that kills the worker that runs it, and never the main process with this id."""
    assert os.getpid() != main
    os.kill(os.getpid(), signal.SIGKILL)


#: A script that loads draws, saves them where a file may have fewer and fewer bytes, and prints the
#: errors.
SAVE_ON_A_FULL_DISK = """
import resource, sys, bayes_toe as bt
from bayes_toe.errors import OutputError
_, source, target, *sizes = sys.argv
draws = bt.load(source)
for size in map(int, sizes):
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
    try:
        draws.save(target)
    except OutputError as error:
        print(error)
"""


def errors_on_a_full_disk(source, target, sizes):
    """The errors of saving the draws in `source` as `target`, if a file has at most `sizes` bytes.

    This happens in a process of its own, which must end well. It has the option -B, without which
    Python would leave libraries compiled by half on the full disk, and nobody could import them
    later.
    """
    words = [str(source), str(target), *map(str, sizes)]
    result = run_python("-B", "-c", SAVE_ON_A_FULL_DISK, *words)
    assert result.returncode == 0, result.stderr
    return result.stdout.splitlines()


def wait_until(is_true, running=None):
    """Wait for something to become true, or for the command to end that would make it so."""
    # Looks are counted, because on a slow machine each look takes longer. Only a process that hangs
    # gets 30,000 looks, which take ten minutes with these pauses.
    n_looks = 0
    while not is_true() and (running is None or running.poll() is None):
        n_looks += 1
        assert running is not None or n_looks < 30_000
        time.sleep(0.02)


def wait_until_gone(session):
    """Wait until no process of a session is left."""
    wait_until(lambda: not members(session))
