"""Names, numbers and lists in messages.

A name in a message is on one line, has a limited length, and has no control characters. `as_html`
makes the short table that a notebook shows, and `with_policy` adds a security policy to a page.
"""

from __future__ import annotations

import hashlib
import re
import reprlib
import shlex
from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, SupportsIndex, TypeAlias

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

#: Names, cells or lines, in their order.
Texts: TypeAlias = Sequence[str]
MAX_LINES = 10

_LONGEST_SHOWN = 40
_SHORT = reprlib.Repr()
_SHORT.maxstring = _LONGEST_SHOWN
#: Why repeated trials matter.
TWICE = "repeated trials make intervals too narrow"


def visible(text: str) -> str:
    r"""A text in which control, bidirectional and invisible characters are escapes, such as '\x1b'.

    A terminal or a browser would obey such characters.
    """
    return "".join(
        character if character.isprintable() else repr(character)[1:-1]  # without its quotes
        for character in text
    )


def quoted(text: str) -> str:
    """A cell as messages show it: quoted, on one line, of bounded length."""
    return _SHORT.repr(text)


def display_name(text: str) -> str:
    """A name as messages show it: quoted if it is empty, long or not printable."""
    return text if text.isprintable() and 0 < len(text) <= _LONGEST_SHOWN else quoted(text)


def format_path(path: Path) -> str:
    r"""A path as messages show it: quoted if it is not printable, as with an end of a line."""
    return str(path) if str(path).isprintable() else repr(str(path))


def join_names(names: Iterable[str], max_items: int = MAX_LINES) -> str:
    """The first names with commas between them, and how many there are beyond `max_items`."""
    items = list(names)
    if len(items) > max_items:
        items[max_items:] = [f"... and {len(items) - max_items:,} more"]
    return ", ".join(items)


def join_quoted(texts: Iterable[str]) -> str:
    """The first cells as messages show them, and how many there are beyond them."""
    return join_names(map(quoted, texts))


def join_display_names(names: Iterable[str]) -> str:
    """The first names as messages show them, and how many there are beyond them."""
    return join_names(map(display_name, names))


def named_counts(counts: Mapping[str, int]) -> Texts:
    """Names with their counts, without names whose count is 0.

    Examples
    --------
    >>> named_counts({"S01": 2, "S02": 0, "S03": 5})
    ['S01 2', 'S03 5']
    """
    return [f"{display_name(name)} {n}" for name, n in counts.items() if n]


class Note(str):
    """A note on a file, which keeps its counts and names apart from its other texts.

    Its parts are texts, numbers with a noun, numbers, and lists of names.

    Examples
    --------
    >>> Note((2, "row"), " left out: ", ["S01 1", "S02 1"])
    '2 rows left out: S01 1, S02 1'
    """

    parts: Sequence[object]

    def __new__(cls, *parts: object) -> Note:
        """The note that joins these parts."""
        words = []
        for part in parts:
            if isinstance(part, tuple):
                part = plural(*part)
            words.append(join_names(part) if isinstance(part, list) else str(part))
        note = super().__new__(cls, "".join(words))
        note.parts = parts
        return note


def fixed_texts(note: str) -> Texts:
    """The parts of a note that are no counts and no names; the whole text if it is no Note."""
    return [part for part in getattr(note, "parts", [note]) if isinstance(part, str)]


def sum_of_notes(notes: Texts) -> str | None:
    """One note in the place of several that differ in counts and names only; else None.

    Its counts are the sums, and its lists have the names of all notes.

    Examples
    --------
    >>> sum_of_notes([Note((n, "row"), " left out: ", [f"S{n} {n}"]) for n in (1, 2)])
    '3 rows left out: S1 1, S2 2'
    """
    if any(fixed_texts(note) != fixed_texts(notes[0]) for note in notes):
        return None
    parts_of_notes = [getattr(note, "parts", [note]) for note in notes]
    parts = []
    for part, *other_parts in zip(*parts_of_notes, strict=True):  # at the same place in each note
        if isinstance(part, tuple):  # a number with its noun
            n_first, noun = part
            part = (n_first + sum(n for n, _ in other_parts), noun)
        elif not isinstance(part, str):
            part = sum(other_parts, part)  # numbers add up, and lists of names are joined
        parts.append(part)
    return Note(*parts)


def join_words(words: Iterable[str]) -> str:
    """Words of a list in a sentence.

    Examples
    --------
    >>> join_words(["2"]), join_words(["2", "4", "6"])
    ('2', '2, 4 and 6')
    """
    items = list(words)
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} and {items[-1]}"


def capitalized(text: str) -> str:
    """A text with a capital first letter; the other letters stay as they are.

    Examples
    --------
    >>> capitalized("in 2AFC"), capitalized("PSE shift")
    ('In 2AFC', 'PSE shift')
    """
    return text[:1].upper() + text[1:]


def plural(count: SupportsIndex, noun: str) -> str:
    """A number and its noun, '1 cell' or '2 cells'."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def format_estimate(low: str, median: str, high: str, unit: str = "") -> str:
    """A median with its unit and its interval, from the numbers as texts in ascending order.

    Examples
    --------
    >>> format_estimate("+8", "+12", "+16", "%")
    '+12 % [+8, +16]'
    """
    estimate = f"{median} {unit}".rstrip()
    return f"{estimate} [{low}, {high}]"


def format_p_value(value: float) -> str:
    """A p-value for a table, two significant digits.

    Examples
    --------
    >>> [format_p_value(value) for value in (0.0, 0.0123, 0.0042, 0.5)]
    ['< .001', '.012', '.0042', '.50']
    """
    if value < 0.001:
        return "< .001"
    # Two digits are two decimals from 0.095 on, which rounds to .10. A smaller number needs a third
    # decimal, and one below 0.0095 a fourth.
    n_decimals = 2 + (value < 0.095) + (value < 0.0095)
    return f"{value:.{n_decimals}f}".removeprefix("0")


def describe_p_value(value: float) -> str:
    """A p-value in a sentence, with two significant digits however small it is.

    Examples
    --------
    >>> describe_p_value(0.398), describe_p_value(0.00083), describe_p_value(0.0)
    ('test p = .40', 'test p = .00083', 'test p < .00001')
    """
    if value < 1e-5:
        return "test p < .00001"
    digits = f"{Decimal(f'{value:.1e}'):f}"  # 0.00083, and not 8.3e-04
    return f"test p = {digits.removeprefix('0')}"


def join_few(names: Texts) -> str:
    """The first four names, quoted, and how many there are beyond them."""
    return join_names(map(repr, names), max_items=4)


def name_from_key(name: object) -> str:
    """The name of a subject by which a table is asked; the whole number 7 is the subject '7'."""
    if isinstance(name, str | int | np.integer) and not isinstance(name, bool):
        return str(name)
    return repr(name)  # no subject, for the message that there is none


def cli_argument(name: str, blocks: Texts = ()) -> str:
    """A subject, or blocks of a subject, as they are typed after --swap and --exclude."""
    return shlex.quote(f"{name}:{','.join(blocks)}" if blocks else name)


def as_html(caption: str, frame: pd.DataFrame) -> str:
    """The HTML of a caption and 20 rows of a frame: of more rows, the first and the last ones."""
    table = frame.to_html(
        max_rows=20, index=False, border=0, na_rep="", float_format="{:.4g}".format
    )
    return f"<p><b>{escape(caption)}</b></p>{table}"


def with_policy(page: str, *more_sources: str) -> str:
    """An HTML page with a policy: a browser loads nothing, and runs only the scripts in the page.

    `more_sources` are what scripts may do besides, such as "'unsafe-eval'".
    """
    hashes = []
    # A script with another type holds data, and does not run.
    for script in re.findall(r'<script(?: type="text/javascript")?>((?s:.*?))</script>', page):
        digest = hashlib.sha256(script.encode("utf-8")).digest()
        hashes.append(f"'sha256-{b64encode(digest).decode()}'")
    policy = (
        f"default-src 'none'; script-src {' '.join([*hashes, *more_sources])}; "
        "style-src 'unsafe-inline'; img-src data: blob:; font-src data:"
    )
    meta = f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
    return page.replace("<head>", f"<head>{meta}", 1)


def one_line(error: Exception | str) -> str:
    """The message of a library about a file, on one line of bounded length."""
    return visible(" ".join(str(error).split())[:200])
