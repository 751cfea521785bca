"""The command line as a user calls it, in a process of its own.

And the same in this process, where that changes nothing.
"""

import io
import os
import shlex
import subprocess
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from functools import partial
from subprocess import CompletedProcess

PROGRAM = [sys.executable, "-m", "bayes_toe"]


def call(*args, cwd=None, **environment):
    """Run the command in its own process, as a user does."""
    env = {**os.environ, "OMP_NUM_THREADS": "1", **environment}
    return subprocess.run(
        [*PROGRAM, *map(str, args)],
        capture_output=True,
        text=True,
        cwd=cwd,
        env=env,
        encoding="utf-8",
    )


def inside(*args, cwd="."):
    """The same command in this process, which has its libraries already.

    The first word may be the beginning of a line as it is typed.
    """
    from bayes_toe.cli.app import app

    line, *extra = map(str, args)
    words = [*shlex.split(line), *extra]
    return captured(partial(app, words, prog_name="bayes-toe"), cwd)


def captured(program, cwd):
    """The exit code of a function that ends with one, and what it prints."""
    code = 0
    with (
        chdir(cwd),
        redirect_stdout(io.StringIO()) as out,
        redirect_stderr(io.StringIO()) as errors,
    ):
        try:
            program()
        except SystemExit as end:
            code = end.code or 0
    return CompletedProcess(program, code, out.getvalue(), errors.getvalue())


def good(*words, cwd):
    """What a command says that ends well."""
    finished = inside(*words, cwd=cwd)
    assert (finished.returncode, finished.stderr) == (0, ""), (words, finished.stderr)
    return finished.stdout


def refused(*words, cwd, silent=True):
    """The line of a command that is refused and leaves the folder as it was."""
    earlier = content(cwd)
    finished = inside(*words, cwd=cwd)
    # What to type comes below the problem.
    problems = [
        line for line in finished.stderr.splitlines() if not line.startswith(("type:", "       -"))
    ]
    assert (finished.returncode, len(problems)) == (2, 1), (words, finished.stderr)
    assert not (silent and finished.stdout)
    assert content(cwd) == earlier
    return finished.stderr


def content(folder):
    """What is in a folder, and when its files were written."""
    return {path: path.is_file() and path.stat().st_mtime_ns for path in folder.rglob("*")}
