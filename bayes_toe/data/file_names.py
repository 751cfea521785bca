"""File names that every system takes: one stem for each subject, whatever the subject is called."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Sequence

_LONGEST_STEM = 60
_HASH_DIGITS = 8
_PLAIN = re.compile(r"[A-Za-z0-9_-](?:[A-Za-z0-9._-]*[A-Za-z0-9_-])?")  # no dot at either end
_FORBIDDEN = re.compile(r"[^A-Za-z0-9._-]+")
_RESERVED = re.compile(r"(?:con|prn|aux|nul|com\d|lpt\d)(?:\..*)?", re.IGNORECASE)


def file_stems(names: Sequence[str]) -> dict[str, str]:
    """A file name without suffix for each subject, safe and distinct on every system.

    ASCII letters, digits, ``-``, ``_`` and ``.`` only, 60 characters at most. A name that had to be changed, or that
    differs from another one in case only, carries 8 hexadecimal digits of its SHA-256.

    Parameters
    ----------
    names : sequence of str
        Subject identifiers: any text.

    Returns
    -------
    dict of str to str
        The stem of each name.

    Examples
    --------
    >>> file_stems(["S01", "../S02"])
    {'S01': 'S01', '../S02': '_S02-58c1dce7'}
    """
    stems = {name: _safe(name) for name in names}
    while True:
        seen = Counter(stem.lower() for stem in stems.values())
        clashing = [name for name, stem in stems.items() if seen[stem.lower()] > 1 and stem == name]
        if not clashing:
            return stems
        stems.update({name: _marked(name, name) for name in clashing})


def _safe(name: str) -> str:
    """The name itself where every system takes it as a file name, otherwise a changed one with its hash."""
    if len(name) <= _LONGEST_STEM and _PLAIN.fullmatch(name) and not _RESERVED.fullmatch(name):
        return name
    clean = _FORBIDDEN.sub("_", name).lstrip(".")
    return _marked(f"_{clean}" if clean == "" or _RESERVED.fullmatch(clean) else clean, name)


def _marked(stem: str, name: str) -> str:
    digits = hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()[:_HASH_DIGITS]
    return f"{stem[: _LONGEST_STEM - _HASH_DIGITS - 1]}-{digits}"
