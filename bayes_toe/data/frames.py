"""Data frames beside files: pandas' and polars' are read into the same cells, so that every check is the same.

Neither library is imported: a frame is known by what it can do. Each distinct value is read as the text that a CSV file would have; a
missing value is an empty cell. Rows count from 0, as in `frame.iloc`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal
from typing import Any

import numpy as np

from bayes_toe.data.cells import Cells, Column, Fault, Header, refuse, stripped, with_zeros
from bayes_toe.data.messages import bare, quoted
from bayes_toe.errors import InputError

_MISSING = ("NAType", "NaTType")  # pandas' own; they equal nothing, and say so in words that are no truth values
_READABLE = "text, numbers or truth values"


def is_frame(given: object) -> bool:
    """Whether something is a data frame, of pandas or of polars.

    Raises
    ------
    InputError
        For a lazy one, with the way out.

    Examples
    --------
    >>> is_frame("study.csv")
    False
    """
    if hasattr(given, "collect") and not hasattr(given, "to_series"):
        raise InputError(f"{type(given).__name__}: found a lazy frame, allowed: a frame, which its collect() gives")
    return hasattr(given, "columns") and (hasattr(given, "iloc") or hasattr(given, "to_series"))


def frame_header(frame: Any) -> Header:
    """The header that the columns of a frame stand for."""
    source = f"{type(frame).__module__.partition('.')[0]} {type(frame).__name__}"
    return Header(source, source, "", [str(name).strip() for name in frame.columns], 0, python=True)


def frame_cells(header: Header, frame: Any, places: Mapping[str, int], problems: Sequence[str]) -> Cells:
    """What :func:`bayes_toe.data.cells.read_cells` gives of a CSV file.

    Raises
    ------
    InputError
        Where the columns have problems, one holds something else than text, numbers or truth values, or there is no row.
    """
    refuse(header.source, [Fault(1, ((0, line),)) for line in problems])
    if len(frame) == 0:
        raise InputError(f"{header.source}: found no row, allowed: at least one")
    columns, faults = {}, []
    for name, place in places.items():
        columns[name], fault = _column(header.names[place], _values(frame, place), header.row)
        faults.append(fault)
    refuse(header.source, faults)
    return with_zeros(Cells(header, columns, header.row + np.arange(len(frame)), Fault(0, ())))


def _values(frame: Any, place: int) -> list[object]:
    column = frame.iloc[:, place] if hasattr(frame, "iloc") else frame.to_series(place)
    found: list[object] = column.tolist() if hasattr(column, "tolist") else column.to_list()
    return found


def _column(name: str, values: Iterable[object], first: int) -> tuple[Column, Fault]:
    """Distinct texts in the order of appearance and their places; and the first value that has no text."""
    seen: dict[str, int] = {}
    codes, wrong = [], list[tuple[int, object]]()
    for row, value in enumerate(values, first):
        text = _text(value)
        if text is None:
            wrong.append((row, value))
        codes.append(seen.setdefault("" if text is None else text, len(seen)))
    said = [
        (row, f"row {row}, column {bare(name)}: found {quoted(str(value))} of type {type(value).__name__}, allowed: {_READABLE}")
        for row, value in wrong[:1]
    ]
    return stripped(name, seen, np.array(codes, np.int64)), Fault(len(said), tuple(said))


def _text(value: object) -> str | None:
    """What a CSV file would have; None where a value has no text.

    Examples
    --------
    >>> [_text(value) for value in (1008.0, 0.1, float("nan"), True, None, "same")]
    ['1008', '0.1', '', '1', '', 'same']
    """
    plain = value.item() if isinstance(value, np.generic) else value
    if plain is None or type(plain).__name__ in _MISSING or plain != plain:
        return ""
    if isinstance(plain, bool):
        return str(int(plain))
    if isinstance(plain, float):
        return str(int(plain)) if plain.is_integer() else repr(plain)
    return str(plain) if isinstance(plain, str | int | Decimal) else None
