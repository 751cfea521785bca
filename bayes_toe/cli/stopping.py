"""The `bayes-toe` command from its first moment to its last: a signal ends it with one line and no process left behind."""

from __future__ import annotations

import os
import signal
import socket
import sys
import time
from threading import Thread
from types import FrameType

from bayes_toe.cli.caches import require_caches
from bayes_toe.cli.standard_output import guarded_streams
from bayes_toe.data.places import shown
from bayes_toe.data.unfinished import said_kept
from bayes_toe.data.whole_files import finished

_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
_PATIENCE = 3.0  # seconds for tidying up after a signal


class Stopped(BaseException):
    """Raised wherever the main thread is when a signal arrives; like KeyboardInterrupt nothing to be caught on the way."""

    def __init__(self, number: int) -> None:
        self.number = number
        super().__init__(number)


def main() -> None:
    """Entry point of the `bayes-toe` command."""
    require_caches()
    try:
        heard = _listen()
        with guarded_streams():
            from bayes_toe.cli.app import app  # what it loads takes a while, in which a signal is answered already

            try:
                app()
            finally:
                _ignore(heard)
    except Stopped as stop:
        print(f"stopped by {signal.Signals(stop.number).name}: {said_kept() or _said_finished()}", file=sys.stderr)
        raise SystemExit(128 + stop.number) from None


def _listen() -> list[signal.Signals]:
    """Raise :class:`Stopped` at the first signal; those that are ignored, as under nohup, go on being ignored."""
    heard = [one for one in _SIGNALS if signal.getsignal(one) is not signal.SIG_IGN]

    def stop(number: int, _: FrameType | None) -> None:
        _ignore(heard)  # a second one must not interrupt the tidying up
        raise Stopped(number)

    reader, writer = socket.socketpair()
    writer.setblocking(False)
    Thread(target=_insist, args=(reader,), daemon=True).start()
    signal.set_wakeup_fd(writer.detach())
    for one in heard:
        signal.signal(one, stop)
    return heard


def _insist(reader: socket.socket) -> None:
    """End in any case: a library may swallow the exception, or compute for long without looking."""
    number = reader.recv(1)[0]
    time.sleep(_PATIENCE)
    os._exit(128 + number)  # workers see that and end as well


def _ignore(heard: list[signal.Signals]) -> None:
    for one in heard:
        signal.signal(one, signal.SIG_IGN)


def _said_finished() -> str:
    """What has its final name already; what belongs into unfinished folders vanished, or vanishes with them."""
    return f"written: {', '.join(map(shown, finished))}" if finished else "nothing written"
