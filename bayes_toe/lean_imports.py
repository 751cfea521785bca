"""Imports of libraries without what they bring along and is not needed."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread


@contextmanager
def out_of_sight(module: str) -> Iterator[bool]:
    """While it lasts an import of this module fails, as if it were not installed; yields whether that is so.

    It is not where the module is loaded already, nor beside the main thread: another thread could want it just then.
    """
    hidden = module not in sys.modules and current_thread() is main_thread()
    if hidden:
        sys.modules[module] = None  # type: ignore[assignment]  # which makes an import of it fail
    try:
        yield hidden
    finally:
        if hidden:
            del sys.modules[module]
