"""corner without ArviZ, which it loads for draws that are not an array, and which takes longer to load than a corner plot to draw."""

from __future__ import annotations

import sys
from typing import Any

from bayes_toe.lean_imports import out_of_sight


def corner_alone() -> Any:
    """What the library corner draws an array with; ArviZ is loaded when somebody gives `corner.corner` something."""
    if "corner" not in sys.modules:
        with out_of_sight("corner.arviz_corner") as hidden:
            import corner  # noqa: F401

            if hidden:
                sys.modules["corner.corner"].arviz_corner = _arviz_corner  # type: ignore[attr-defined]
    from corner.core import corner_impl

    return corner_impl


def _arviz_corner(*args: Any, **options: Any) -> Any:
    from corner.arviz_corner import arviz_corner

    return arviz_corner(*args, **options)
