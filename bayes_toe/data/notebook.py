"""How studies, draws and tables show themselves: a line at a prompt, a small table in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

#: Rows that a notebook shows; the rest is counted.
MOST_ROWS = 20


def named_few(names: Sequence[str], most: int = 4) -> str:
    """The first names, and how many there are beyond them.

    Examples
    --------
    >>> named_few(["A", "B", "C"], 2), named_few(["A"])
    ("'A', 'B' and 1 more", "'A'")
    """
    more = f" and {len(names) - most:,} more" if len(names) > most else ""
    return ", ".join(map(repr, names[:most])) + more


def as_html(caption: str, frame: pd.DataFrame, rows: int | None = None) -> str:
    """A caption and a frame of which the first rows are shown; `rows` says how many there are, where the frame has only the first.

    Examples
    --------
    >>> import pandas as pd
    >>> "<b>1 &lt; 2</b>" in as_html("1 < 2", pd.DataFrame({"a": ["<i>"]}))
    True
    """
    count = len(frame) if rows is None else rows
    shown = frame.head(MOST_ROWS).to_html(index=False, border=0, na_rep="", float_format=lambda value: f"{value:.4g}")
    more = f"<p>and {count - MOST_ROWS:,} more rows</p>" if count > MOST_ROWS else ""
    return f"<p><b>{escape(caption)}</b></p>{shown}{more}"
