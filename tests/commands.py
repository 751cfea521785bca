"""The command line as a user calls it: a process of its own."""

import os
import subprocess
import sys

PROGRAM = [sys.executable, "-m", "bayes_toe"]


def call(*args, cwd=None, **environment):
    """Run the command in its own process, as a user does."""
    env = {**os.environ, "OMP_NUM_THREADS": "1", **environment}
    return subprocess.run([*PROGRAM, *map(str, args)], capture_output=True, text=True, cwd=cwd, env=env, encoding="utf-8")
