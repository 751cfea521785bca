"""Standard output and error that cannot fail a command: a closed one is not there, a full one is said in the end, any character fits."""

from __future__ import annotations

import errno
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from bayes_toe.data.enduring_file import EnduringFile


@contextmanager
def guarded_streams() -> Iterator[None]:
    """Standard streams to which everything can be printed; where output was lost, one line on standard error and exit code 2 in the end."""
    _guard()
    code: Any = 0
    try:
        yield
    except SystemExit as ended:
        code = ended.code
    problem = _problem()
    if problem:
        from bayes_toe.cli.task import BAD_INPUT

        code = code or BAD_INPUT
        sys.stderr.write(f"error: {problem}\n")
    sys.exit(code)


def _guard() -> None:
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        stream = getattr(sys, name)
        if stream is None:  # closed: its number must not become that of a file of ours
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115
        elif mode == "w":
            log = io.BufferedWriter(EnduringFile(stream.fileno(), "w", closefd=False))  # hours of work must not end because a log is full
            lines = stream.line_buffering
            setattr(sys, name, io.TextIOWrapper(log, stream.encoding, "backslashreplace", line_buffering=lines))


def _problem() -> str:
    """Why standard output is not complete; nothing where it is, or where its reader went away, as `head` does."""
    sys.stdout.flush()
    log = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    failed = log.failed if isinstance(log, EnduringFile) else None
    return "" if failed is None or failed.errno == errno.EPIPE else f"standard output: cannot be written ({failed.strerror})"
