"""The entry point of the `bayes-toe` command: `main`.

`main` runs the commands of `app.py`. It replaces standard output and standard error first, so that
a failed write does not end the command. It gives libraries a cache folder if they can make none.
After a signal the command prints one line, cleans up, and ends its worker processes.
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
import threading
from contextlib import suppress
from types import FrameType
from typing import Any

from bayes_toe.data.whole_files import describe_stored
from bayes_toe.libraries import import_without_folder_settings

_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


class Stopped(BaseException):
    """Raised in the main thread when a signal arrives; as KeyboardInterrupt, not to be caught."""

    def __init__(self, number: int) -> None:
        self.number = number  # the number of the signal
        super().__init__(number)


def main() -> None:
    """Run the command that is typed, and exit with its code.

    The code is 128 + n after signal n, and 2 if standard output could not be written.
    """
    output = open_streams()
    require_usable_process()
    require_cache()
    code: Any = 0
    try:
        handled_signals = listen()
        import_without_folder_settings()
        # The import takes a while, in which a signal is answered already.
        from bayes_toe.cli.app import app

        try:
            app()
        except SystemExit as end:
            code = end.code
        finally:
            # The command is over, and a signal must not change its exit code.
            _ignore(handled_signals)
    except Stopped as stop:
        say_stopped(stop.number)
        raise SystemExit(128 + stop.number) from None

    sys.stdout.flush()
    error = output.failed
    if error is not None and error.errno != errno.EPIPE:  # A reader may go away, as `head` does.
        sys.stderr.write(f"error: standard output: cannot be written ({error.strerror})\n")
        code = code or 2
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
        raise SystemExit(2)


class Log(io.FileIO):
    """A file that stores a failed write in `failed`: a full log must not end hours of work."""

    failed: OSError | None = None

    def write(self, data: Any, /) -> int:
        """Write, or drop the data after a failure; return the number of bytes in both cases."""
        if self.failed is None:
            try:
                return super().write(data)
            except OSError as error:
                self.failed = error
        return memoryview(data).nbytes


def open_streams() -> Log:
    """Make standard streams that take any character; return the file of standard output."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # The stream is closed. The null device, opened now, gets the lowest free number, which
            # is this one: otherwise a later file gets it, and what is printed goes there.
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    if sys.stdin is None:
        sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115
    output, sys.stdout = _open_log(1, sys.stdout)
    _, sys.stderr = _open_log(2, sys.stderr)
    return output


def _open_log(number: int, stream: Any) -> tuple[Log, io.TextIOWrapper]:
    """A log on a file number, and a text stream into it with the settings of `stream`."""
    encoding = getattr(stream, "encoding", "utf-8")
    is_by_line = getattr(stream, "line_buffering", False)
    log = Log(number, "w", closefd=False)
    buffer = io.BufferedWriter(log)
    return log, io.TextIOWrapper(buffer, encoding, "backslashreplace", line_buffering=is_by_line)


def require_cache() -> None:
    """Give libraries a temporary cache folder if the user's own cannot be written.

    Some libraries fail without one, or make it in the working folder.
    """
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
    """From now on, raise :class:`Stopped` at the first signal; return the signals that do so.

    A signal that is ignored, as under nohup, stays ignored.
    """
    handled_signals = [
        number for number in _SIGNALS if signal.getsignal(number) is not signal.SIG_IGN
    ]

    def stop(number: int, _: FrameType | None) -> None:
        """Raise :class:`Stopped`, once."""
        _ignore(handled_signals)  # A second signal must not interrupt the cleaning up.
        # A thread of joblib may fail while its workers are ended; nobody needs its traceback.
        threading.excepthook = lambda _: None
        raise Stopped(number)

    for number in handled_signals:
        signal.signal(number, stop)
    return handled_signals


def say_stopped(number: int) -> None:
    """Print on standard error that a signal ends the command, and which results are stored."""
    # The second text is '' if no results are stored.
    texts = [f"stopped by {signal.Signals(number).name}", describe_stored()]
    print(": ".join(filter(None, texts)), file=sys.stderr, flush=True)


def _ignore(signals: list[signal.Signals]) -> None:
    """Ignore signals from now on."""
    for number in signals:
        signal.signal(number, signal.SIG_IGN)
