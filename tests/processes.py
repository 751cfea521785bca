"""Processes that are killed, stopped by a full disk, or left: what stands in /proc."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from commands import PROGRAM

from bayes_toe.errors import InputError

needs_proc = pytest.mark.skipif(
    not Path("/proc/self/stat").exists(), reason="looks for processes in /proc"
)


def start(*args, cwd, **options):
    """The command as a user starts it, still running."""
    env = {**os.environ, "OMP_NUM_THREADS": "1"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(
        [*PROGRAM, *map(str, args)], cwd=cwd, env=env, start_new_session=True, **pipes, **options
    )


def workers_of(parent):
    """Worker processes that a process has begun."""
    return [
        pid
        for pid, line in members(os.getsid(parent)).items()
        if "popen_loky" in line and parent_of(pid) == parent
    ]


def parent_of(pid):
    """The parent of a process; none where it has ended."""
    with suppress(OSError):
        return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


def members(session):
    """Every process of a session that has not ended, with its command line."""
    observed = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if (
                os.getsid(int(folder.name)) == session
                and (folder / "stat").read_text().rpartition(")")[2].split()[0] != "Z"
            ):
                observed[int(folder.name)] = (folder / "cmdline").read_text().replace("\0", " ")
    return observed


# --- jobs; in this file because a worker that begins loads the file of its job, and with that of a
# test all libraries of all tests ---


def slow(value, seconds):
    time.sleep(seconds)
    return value


def interrupted():
    raise KeyboardInterrupt


def refuse():
    raise InputError("no")


def blas_threads():
    import numpy as np
    from threadpoolctl import threadpool_info

    np.linalg.inv(np.eye(2))
    return [
        element["num_threads"] for element in threadpool_info() if element["user_api"] == "blas"
    ]


def die(main):
    """A job that kills its worker, and never the main process."""
    assert os.getpid() != main
    os.kill(os.getpid(), signal.SIGKILL)


def save_on_a_full_disk(source, target, room):
    """Save draws again where no file may have more bytes than `room`.

    An error, and no other end of the process.

    With -B: Python would leave libraries half compiled, in which nobody could load them any more.
    """
    saves = (
        "import resource, sys, bayes_toe as bt; draws = bt.load(sys.argv[1]); room = "
        "int(sys.argv[3]); "
        "resource.setrlimit(resource.RLIMIT_FSIZE, (room, room)); draws.save(sys.argv[2])"
    )
    ended = subprocess.run(
        [sys.executable, "-B", "-c", saves, str(source), str(target), str(room)],
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 1
    assert "OutputError: " in ended.stderr.splitlines()[-1]
    assert f"{target.name}: cannot be written (File too large)" in ended.stderr.splitlines()[-1]


def until(true, running=None):
    """Wait for something to become true, or for the command to end that would make it so."""
    # counted, not timed: only what hangs is looked at so often, and a slow machine looks less often
    looks = 0
    while not true() and (running is None or running.poll() is None):
        looks += 1
        assert running is not None or looks < 30_000
        time.sleep(0.02)


def until_gone(session):
    """Wait until no process of a session is left."""
    until(lambda: not members(session))
