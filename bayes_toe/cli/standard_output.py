"""Standard output and error that cannot fail a command: a closed one is not there, a full one is said in the end, any character fits."""

from __future__ import annotations

import errno
import io
import os
import sys
from typing import Any


class _Log(io.FileIO):
    """A stream whose first failed write is kept in `failed` and not raised: hours of work must not end because a log is full."""

    failed: OSError | None = None

    def write(self, data: Any, /) -> int:
        """Write; what comes after a failure is dropped."""
        if self.failed is None:
            try:
                return super().write(data)
            except OSError as error:
                self.failed = error
        return memoryview(data).nbytes


def guard_streams() -> None:
    """Give this process standard streams to which everything can be printed."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        stream = getattr(sys, name)
        if stream is None:  # closed: its number must not become that of a file of ours
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115
        elif mode == "w":
            log = io.BufferedWriter(_Log(stream.fileno(), "w", closefd=False))
            lines = stream.line_buffering
            setattr(sys, name, io.TextIOWrapper(log, stream.encoding, "backslashreplace", line_buffering=lines))


def output_problem() -> str:
    """Why standard output is not complete; nothing where it is, or where its reader went away, as `head` does."""
    sys.stdout.flush()
    log = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    failed = log.failed if isinstance(log, _Log) else None
    return "" if failed is None or failed.errno == errno.EPIPE else f"standard output: cannot be written ({failed.strerror})"
