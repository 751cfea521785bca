"""Arrays as text in a page: base64 of little-endian numbers, which a browser turns into typed arrays without parsing them."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np
import numpy.typing as npt

#: Numbers of a contour's coordinate from one end of its frame to the other.
FRAME = 65535


def floats(values: npt.ArrayLike) -> str:
    """As float32.

    Examples
    --------
    >>> floats([1.0])
    'AACAPw=='
    """
    return base64.b64encode(np.ascontiguousarray(values, "<f4").tobytes()).decode("ascii")


def shorts(values: npt.ArrayLike) -> str:
    """As unsigned integers of 16 bits."""
    return base64.b64encode(np.ascontiguousarray(values, "<u2").tobytes()).decode("ascii")


def island(content: Any) -> str:
    r"""JSON for a script element: nothing in it ends the element, whatever a subject is called.

    Examples
    --------
    >>> island({"subject": "</script>"})
    '{"subject":"\\u003c/script>"}'
    """
    return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).replace("<", r"\u003c")
