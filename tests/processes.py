"""Commands that are killed, and processes that are left: what stands in /proc."""

import os
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path

import pytest
from commands import PROGRAM

needs_proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")


def start(*args, cwd, **options):
    """The command as a user starts it, still running."""
    env = {**os.environ, "OMP_NUM_THREADS": "1"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([*PROGRAM, *map(str, args)], cwd=cwd, env=env, start_new_session=True, **pipes, **options)


def workers(session):
    """Worker processes of a command, by its session: they stay in it when their parent is gone."""
    return [pid for pid, line in members(session).items() if "popen_loky" in line]


def members(session):
    """Every process of a session that has not ended, with its command line."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            state, _, _, of = (folder / "stat").read_text().rpartition(")")[2].split()[:4]
            if int(of) == session and state != "Z":
                found[int(folder.name)] = (folder / "cmdline").read_text().replace("\0", " ")
    return found


def kill_workers(running, deaths):
    """Kill that many workers of a command as they appear, one after the other."""
    killed = set()
    while len(killed) < deaths and running.poll() is None:
        for pid in set(workers(running.pid)) - killed:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
            killed.add(pid)
        time.sleep(0.05)
    assert len(killed) == deaths


def until(true):
    """Wait for something to become true; the limit is that of a command that hangs, not of a slow machine."""
    begun = time.monotonic()
    while not true():
        assert time.monotonic() - begun < 120
        time.sleep(0.02)


def until_gone(session):
    """Wait until no process of a session is left."""
    until(lambda: not members(session))
