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
    """The id of a process's parent; None where the process has ended.

    /proc/7/stat is `7 (name) S 3 ...`: the state and the parent follow the name in brackets.
    """
    with suppress(OSError):
        return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


def members(session):
    """The processes of a session that have not ended: command lines by id.

    The state Z is that of a process that has ended and that nobody has waited for.
    """
    line_by_pid = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if (
                os.getsid(int(folder.name)) == session
                and (folder / "stat").read_text().rpartition(")")[2].split()[0] != "Z"
            ):
                line_by_pid[int(folder.name)] = (folder / "cmdline").read_text().replace("\0", " ")
    return line_by_pid


# --- jobs; in this file because a worker that begins loads the file of its job, and with that of a
# test all libraries of all tests ---


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


def save_on_a_full_disk(source, target, room):
    """Load the draws in `source` and save them as `target`, where a file has at most `room` bytes.

    This happens in a process of its own, which must end in an OutputError and in no other way. It
    has the option -B, without which Python would leave libraries compiled by half on the full disk,
    and nobody could import them later.
    """
    saves = (
        "import resource, sys, bayes_toe as bt; _, source, target, room = sys.argv; "
        "draws = bt.load(source); "
        "resource.setrlimit(resource.RLIMIT_FSIZE, (int(room), int(room))); draws.save(target)"
    )
    ended = run_python("-B", "-c", saves, str(source), str(target), str(room))
    assert ended.returncode == 1
    *_, last_line = ended.stderr.splitlines()
    assert "OutputError: " in last_line
    assert f"{target.name}: cannot be written (File too large)" in last_line


def wait_until(is_true, running=None):
    """Wait for something to become true, or for the command to end that would make it so."""
    # Counted, not timed: on a slow machine each look takes longer, and only what hangs is looked at
    # 30,000 times, ten minutes with these pauses.
    looks = 0
    while not is_true() and (running is None or running.poll() is None):
        looks += 1
        assert running is not None or looks < 30_000
        time.sleep(0.02)


def wait_until_gone(session):
    """Wait until no process of a session is left."""
    wait_until(lambda: not members(session))
