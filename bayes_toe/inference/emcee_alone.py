"""emcee without scipy.stats, which it loads for one of its moves, and which takes longer to load than a subject to sample."""

from __future__ import annotations

import sys
from contextlib import suppress
from threading import current_thread, main_thread
from typing import Any


def emcee_alone() -> Any:
    """The library emcee; where nothing has loaded scipy.stats yet, that is loaded when somebody uses emcee's KDE move.

    emcee takes scipy.stats if it can be imported and goes on without it else. Only in the main thread is it hidden for that moment:
    another one could want it just then.
    """
    if not {"emcee", "scipy.stats"} & sys.modules.keys() and current_thread() is main_thread():
        _load_without("scipy.stats")
    import emcee

    return emcee


def _load_without(hidden: str) -> None:
    sys.modules[hidden] = None  # type: ignore[assignment]  # which makes an import of it fail
    try:
        with suppress(ImportError):  # of an emcee that cannot do without it
            import emcee

            emcee.moves.kde.gaussian_kde = _gaussian_kde
    finally:
        del sys.modules[hidden]


def _gaussian_kde(*args: Any, **options: Any) -> Any:
    from scipy.stats import gaussian_kde

    return gaussian_kde(*args, **options)
