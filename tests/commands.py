"""The command line as a user calls it, in a process of its own, or in this process."""

import io
import os
import shlex
import subprocess
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from functools import partial
from subprocess import CompletedProcess

PROGRAM = [sys.executable, "-m", "bayes_toe"]


def run_python(*words, **options):
    """Run Python with words such as `-c` and a script, in a process of its own.

    The result has the exit code, stdout and stderr.
    """
    return subprocess.run([sys.executable, *words], capture_output=True, text=True, **options)


def call(line, cwd=None, **environment):
    """Run a command as a user does, in a process of its own with these environment variables."""
    env = {**os.environ, "OMP_NUM_THREADS": "1", **environment}
    return run_python("-m", "bayes_toe", *line.split(), cwd=cwd, env=env, encoding="utf-8")


def run_command(*args, cwd="."):
    """Run the command in this process, which has its libraries already, however it ends.

    The first argument is the beginning of a line as it is typed, such as `check study.csv`, and
    further arguments are the words that follow. The result has the exit code, stdout and stderr.
    """
    from bayes_toe.cli.app import app

    line, *extra = map(str, args)
    words = [*shlex.split(line), *extra]
    return run_captured(partial(app, words, prog_name="bayes-toe"), cwd)


def run_captured(program, cwd):
    """Run a function in a folder: its exit code, 0 where it has none, and what it prints."""
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


def run_ok(*words, cwd):
    """Run a command that must end with exit code 0 and without errors, and return its stdout."""
    return output_of(run_command(*words, cwd=cwd))


def output_of(result):
    """The stdout of a program that must have ended with exit code 0 and without errors."""
    assert (result.returncode, result.stderr) == (0, ""), result.stderr
    return result.stdout


def refusal_of(*words, cwd, silent=True):
    """Run a command that must be refused, and return its stderr.

    The command has exit code 2, and one line of an error, with lines of what to type below it. No
    file of the folder changes. A silent command prints nothing before the error.
    """
    earlier_content = content(cwd)
    result = run_command(*words, cwd=cwd)
    # Lines of what to type are `type:  --equal-code 1`, and then `       --second-code 1`.
    problems = [
        line for line in result.stderr.splitlines() if not line.startswith(("type:", "       -"))
    ]
    assert (result.returncode, len(problems)) == (2, 1), (words, result.stderr)
    assert not (silent and result.stdout)
    assert content(cwd) == earlier_content
    return result.stderr


def on_one_line(text):
    """The text with one space between two words, wherever its lines end."""
    return " ".join(text.split())


def content(folder):
    """The paths in a folder, with the time when each file was written; False for a folder."""
    return {path: path.is_file() and path.stat().st_mtime_ns for path in folder.rglob("*")}
