"""emcee without scipy.stats, which it loads for one of its moves, and which takes longer to load than a subject to sample."""

from __future__ import annotations

import sys
from contextlib import suppress
from typing import Any

from bayes_toe.lean_imports import out_of_sight


def emcee_alone() -> Any:
    """The library emcee; where nothing has loaded scipy.stats yet, that is loaded when somebody uses emcee's KDE move.

    emcee takes scipy.stats if it can be imported and goes on without it else.
    """
    if "emcee" not in sys.modules:
        with suppress(ImportError), out_of_sight("scipy.stats") as hidden:  # an emcee that cannot do without it is loaded below
            import emcee

            if hidden:
                emcee.moves.kde.gaussian_kde = _gaussian_kde
    import emcee

    return emcee


def _gaussian_kde(*args: Any, **options: Any) -> Any:
    from scipy.stats import gaussian_kde

    return gaussian_kde(*args, **options)
