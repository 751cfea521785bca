"""The `bayes-toe` command from its first moment to its last: no log that is closed or full and no missing home costs a result.

A signal ends it with one line and no process left behind.
"""

from __future__ import annotations

import atexit
import errno
import io
import os
import shutil
import signal
import sys
import tempfile
from contextlib import suppress
from threading import Timer
from types import FrameType
from typing import Any

from bayes_toe.data.messages import shown
from bayes_toe.data.whole_files import describe_stored, finished
from bayes_toe.library_settings import ignore_settings_of_folder

_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
PATIENCE = 10.0  # seconds for tidying up after a signal
_LOST = 2  # exit code where standard output is not complete
_BAD_INPUT = 2


class Stopped(BaseException):
    """Raised wherever the main thread is when a signal arrives; like KeyboardInterrupt nothing to be caught on the way."""

    def __init__(self, number: int) -> None:
        self.number = number
        super().__init__(number)


def main() -> None:
    """Entry point of the `bayes-toe` command."""
    output = open_streams()
    require_usable_process()
    require_cache()
    code: Any = 0
    try:
        heard = listen()
        ignore_settings_of_folder()
        from bayes_toe.cli.app import (
            app,
        )  # what it loads takes a while, in which a signal is answered already

        try:
            app()
        except SystemExit as ended:
            code = ended.code
        finally:
            _ignore(heard)
    except Stopped as stop:
        say_stopped(stop.number)
        raise SystemExit(128 + stop.number) from None
    sys.stdout.flush()
    if (
        output.failed is not None and output.failed.errno != errno.EPIPE
    ):  # a reader may go away, as `head` does
        sys.stderr.write(f"error: standard output: cannot be written ({output.failed.strerror})\n")
        code = code or _LOST
    sys.exit(code)


def require_usable_process() -> None:
    """End with one line where Python itself cannot work: no working folder, no docstrings."""
    problem = ""
    try:
        os.getcwd()
    except OSError as error:
        problem = f"the working folder cannot be used ({error.strerror}); change to another one"
    if sys.flags.optimize > 1:
        problem = "PYTHONOPTIMIZE=2 removes docstrings that libraries need; unset the variable"
    if problem:
        print(f"error: {problem}", file=sys.stderr, flush=True)
        raise SystemExit(_BAD_INPUT)


class Log(io.FileIO):
    """A file of which a failed write is kept in `failed` and not raised: hours of work must not end because a log is full."""

    failed: OSError | None = None

    def write(self, data: Any, /) -> int:
        """Write; what comes after a failure is dropped."""
        if self.failed is None:
            try:
                return super().write(data)
            except OSError as error:
                self.failed = error
        return memoryview(data).nbytes


def open_streams() -> Log:
    """Standard streams to which everything can be printed, whatever the characters; returns what is below standard output."""
    for number in range(3):
        try:
            os.fstat(number)
        except (
            OSError
        ):  # closed: its number must not become that of a file of ours, nor of one of a worker's
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    if sys.stdin is None:
        sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115
    logs = [Log(number, "w", closefd=False) for number in (1, 2)]
    for name, log in zip(("stdout", "stderr"), logs, strict=True):
        before = getattr(sys, name)
        encoding, lines = (
            ("utf-8", False) if before is None else (before.encoding, before.line_buffering)
        )
        setattr(
            sys,
            name,
            io.TextIOWrapper(
                io.BufferedWriter(log), encoding, "backslashreplace", line_buffering=lines
            ),
        )
    return logs[0]


def require_cache() -> None:
    """Give libraries a folder for this run where they could not make theirs: some fail without, or make it in the working directory."""
    cache = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    with suppress(OSError):
        if os.path.isabs(cache):
            os.makedirs(cache, exist_ok=True)
            if os.access(cache, os.W_OK):
                return
    with suppress(OSError):
        folder = tempfile.mkdtemp(prefix="bayes_toe-")
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        os.environ["XDG_CACHE_HOME"] = folder
        os.environ.setdefault("MPLCONFIGDIR", folder)


def listen() -> list[signal.Signals]:
    """Raise :class:`Stopped` at the first signal; those that are ignored, as under nohup, go on being ignored."""
    heard = [one for one in _SIGNALS if signal.getsignal(one) is not signal.SIG_IGN]

    def stop(number: int, _: FrameType | None) -> None:
        _ignore(heard)  # a second one must not interrupt the tidying up
        end = Timer(PATIENCE, _end, (number,))
        end.daemon = True
        end.start()
        raise Stopped(number)

    for one in heard:
        signal.signal(one, stop)
    return heard


def say_stopped(number: int) -> None:
    """What a signal has left of the command's work, on standard error."""
    there = ", ".join(shown(path) for path in finished if os.path.lexists(path))
    said = describe_stored() or (f"written: {there}" if there else "nothing written")
    print(f"stopped by {signal.Signals(number).name}: {said}", file=sys.stderr, flush=True)


def _end(number: int) -> None:
    """End in any case: a library may swallow the exception, or take long to notice; workers see that and end as well."""
    say_stopped(number)
    os._exit(128 + number)


def _ignore(heard: list[signal.Signals]) -> None:
    for one in heard:
        signal.signal(one, signal.SIG_IGN)
