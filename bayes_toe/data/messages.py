"""How messages show what was found: quoted, on one line, of bounded length, and nothing that a terminal would obey."""

from __future__ import annotations

from collections.abc import Sequence

MOST_SHOWN = 10
_LONGEST_SHOWN = 40


def visible(text: str) -> str:
    r"""A text without what a terminal or a browser would obey: control, bidirectional and invisible characters as their escapes.

    Examples
    --------
    >>> visible("S\x1b[2J\u202e01")
    'S\\x1b[2J\\u202e01'
    """
    return text if text.isprintable() else "".join(one if one.isprintable() else repr(one)[1:-1] for one in text)


def quoted(text: str) -> str:
    """A cell as messages show it: quoted, on one line, of bounded length."""
    shown = repr(text)
    return shown if len(shown) <= _LONGEST_SHOWN else f"{shown[: _LONGEST_SHOWN - 4]}...{shown[-1]}"


def bare(text: str) -> str:
    """A name as messages show it: bare where that is readable."""
    return text if text.isprintable() and 0 < len(text) <= _LONGEST_SHOWN else quoted(text)


def listed(items: Sequence[str], most: int = MOST_SHOWN) -> str:
    """The first items, and how many there are beyond them."""
    more = [f"... and {len(items) - most:,} more"] if len(items) > most else []
    return ", ".join([*items[:most], *more])


def counted(count: int, noun: str) -> str:
    """A number and its noun, '1 cell' or '2 cells'."""
    return f"{count} {noun}{'' if count == 1 else 's'}"
