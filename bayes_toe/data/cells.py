"""Cells of a CSV file: the distinct texts of each column, the row that each record starts at, and problems by their place.

Everything is read as text first, so that subject '01' stays '01' and subject 'NA' stays 'NA'; each distinct text of a
column is converted once. Every CSV file that this package takes is read here; what its columns mean is for others to say.
"""

from __future__ import annotations

import codecs
import csv
import io
import itertools
import math
import os
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import BoolArray, IntArray
from bayes_toe.data.input_bytes import input_bytes
from bayes_toe.data.messages import MOST_SHOWN, bare, counted, quoted
from bayes_toe.errors import InputError

#: A pandas or polars DataFrame, neither of which is imported to know one.
Frame: TypeAlias = Any
_Records = Iterator[tuple[int, list[str] | csv.Error]]
_PIECE, _ROWS = 1 << 20, 1 << 10  # characters split into lines, and rows whose texts are told apart, at once: memory stays flat

DELIMITERS = {",": "comma", ";": "semicolon", "\t": "tab"}
_ENCODINGS = (
    (codecs.BOM_UTF8, "utf-8", "UTF-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le", "UTF-16"),
    (codecs.BOM_UTF16_BE, "utf-16-be", "UTF-16"),
    (b"", "utf-8", "UTF-8"),
)
_TEXT_ALLOWED = "text in UTF-8, or in UTF-16 that starts with its byte-order mark"
# What the csv module says, and what we say.
_SPLIT_ERRORS = {
    "end of data": "a quote that is never closed",
    "expected after": "text after a closing quote",
    "field larger": "a cell of more than 131072 characters (a quote that is never closed?)",
}
_LINE_END = re.compile(r"\r\n|\r|\n")

# Alternatives never overlap, so that a cell of 100,000 digits costs linear time.
_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
# '5.0' is how pandas writes a 5 beside missing cells; '5.000' may be a German five thousand, so it is not read at all.
_COUNT = re.compile(r"\+?0*(\d{1,16})(?:\.(?!000$)0*)?", re.ASCII)
LARGEST_COUNT = 2**53  # beyond it, whole numbers are no longer exact in the floating point of the likelihood
#: Bytes. A study of 10^7 trials has some 300 million, pairs and covariates of 10^5 subjects some 5 million.
LARGEST_STUDY, LARGEST_SMALL_FILE = 2**30, 2**25
_RUN = ("=", "+", "-", "@", "\t", "\r")


def runs(text: str) -> bool:
    """Whether a spreadsheet takes a cell for a formula; a number is none.

    Examples
    --------
    >>> [runs(text) for text in ("=1+1", "@a", "-1", "-a", "a=1")]
    [True, True, False, True, False]
    """
    return text.startswith(_RUN) and _NUMBER.fullmatch(text) is None


@dataclass(frozen=True)
class Fault:
    """One kind of problem: how often it occurs, and its first occurrences as (row, what is said about it)."""

    count: int
    shown: tuple[tuple[int, str], ...]


def refuse(source: str, faults: Sequence[Fault]) -> None:
    """Raise all problems of a file at once, in the order of its rows."""
    count = sum(fault.count for fault in faults)
    if count == 0:
        return
    shown = sorted((line for fault in faults for line in fault.shown), key=itemgetter(0))[:MOST_SHOWN]
    more = count - len(shown)
    rest = [f"... and {more} more problem{'s' if more > 1 else ''}"] if more else []
    raise InputError([*(f"{source}: {text}" for _, text in shown), *rest])


# --- From bytes to cells --------------------------------------------------------------------------


def _bytes(path: str | Path, largest: int) -> bytes:
    try:
        return input_bytes(path, largest)
    except OSError as error:
        reason = error.strerror if error.strerror is not None else str(error)
    except ValueError as error:  # a NUL character in the path
        reason = str(error)
    shown = str(path) if str(path).isprintable() else repr(str(path))
    raise InputError(f"{shown}: cannot be read ({reason}), allowed: a CSV file that exists and may be read")


def _decode(source: str, data: bytes) -> tuple[str, str]:
    """The text of a file, and the name of its encoding."""
    mark, codec, label = next(entry for entry in _ENCODINGS if data.startswith(entry[0]))
    try:
        text = data[len(mark) :].decode(codec)
    except UnicodeDecodeError as error:
        offset = len(mark) + error.start
        before = data[len(mark) : offset].decode(codec, errors="ignore")
        what = f"byte 0x{data[offset]:02x} at offset {offset}, not {label}"
        raise InputError(f"{source}: row {_row_after(before)}: found {what}, allowed: {_TEXT_ALLOWED}") from None
    zero = text.find("\0")
    if zero >= 0:
        offset = len(mark) + len(text[:zero].encode(codec))
        what = f"a NUL character at offset {offset}"
        raise InputError(f"{source}: row {_row_after(text[:zero])}: found {what}, allowed: {_TEXT_ALLOWED}")
    return text, label


def _row_after(text: str) -> int:
    return 1 + len(_LINE_END.findall(text))


def _records(text: str, delimiter: str) -> _Records:
    """First physical row and cells of every record that is not blank; the error where a row cannot be split."""
    # Not strict, the csv module would read '"12"3' as 123 and a quote left open as one giant cell, without a word.
    reader = csv.reader(_lines(text), delimiter=delimiter, skipinitialspace=True, strict=True)
    while True:
        row = reader.line_num + 1
        try:
            cells = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            yield row, error
            continue
        if "".join(cells).strip():
            yield row, cells


def _lines(text: str) -> Iterator[str]:
    """Lines with their ends, piece by piece: a buffer of text takes four bytes for every character."""
    start = 0
    while start < len(text):
        end = text.find("\n", start + _PIECE) + 1
        yield from io.StringIO(text[start : end if end else len(text)], newline="")
        start = end if end else len(text)


def _first_cells(text: str, delimiter: str) -> list[str]:
    _, cells = next(_records(text, delimiter), (0, csv.Error()))
    return [] if isinstance(cells, csv.Error) else [cell.strip() for cell in cells]


def _delimiter(text: str, names: frozenset[str]) -> str:
    """The delimiter under which the header has most of the names we look for, then most cells."""
    cells = {delimiter: _first_cells(text, delimiter) for delimiter in DELIMITERS}
    return max(cells, key=lambda delimiter: (len(names.intersection(cells[delimiter])), len(cells[delimiter])))


@dataclass(frozen=True)
class Header:
    """What the first record of a file tells, and its physical row; of a Parquet file its schema, of a frame its columns, no delimiter.

    `python` says that it is a frame, so that messages name arguments and not options of the command line.
    """

    source: str
    encoding: str
    delimiter: str
    names: list[str]
    row: int
    python: bool = False

    @property
    def decimal_comma(self) -> bool:
        """Whether the delimiter leaves the comma free to be a decimal sign."""
        return self.delimiter in (";", "\t")

    @property
    def place(self) -> str:
        """What messages call it."""
        return f"row {self.row}" if self.delimiter else {"Parquet": "schema", "MATLAB": "variables"}.get(self.encoding, "columns")


def read_header(path: str | Path | Frame, names: frozenset[str], largest: int = LARGEST_SMALL_FILE) -> tuple[Header, Any]:
    """The header of a file in which columns of these names are looked for, as they tell the delimiter; and the file's text.

    A file whose name ends in .parquet is read as one, see :mod:`bayes_toe.data.parquet`; a frame as :mod:`bayes_toe.data.frames` does.

    Raises
    ------
    InputError
        If the file cannot be read, has more than `largest` bytes, is not text in UTF-8 or marked UTF-16, is empty, or its first record
        cannot be split.
    """
    from bayes_toe.data.frames import frame_header, is_frame

    if is_frame(path):
        return frame_header(path), path
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"found {quoted(type(path).__name__)}, allowed: the path of a file, or a pandas or polars DataFrame")
    path = Path(path)
    source = bare(path.name)
    from bayes_toe.data.matlab import is_matlab, matlab_header
    from bayes_toe.data.parquet import is_parquet, parquet_header, require_parquet

    require_parquet(path)
    data = _bytes(path, largest)
    if is_parquet(path):
        return parquet_header(source, data, largest)
    if is_matlab(path):
        return matlab_header(source, data)
    text, encoding = _decode(source, data)
    delimiter = _delimiter(text, names)
    row, cells = next(_records(text, delimiter), (0, None))
    if cells is None:
        raise InputError(f"{source}: found an empty file, allowed: a header and at least one row")
    if isinstance(cells, csv.Error):
        raise InputError(f"{source}: {_broken(row, cells, 0)[1]}")
    return Header(source, encoding, delimiter, [cell.strip() for cell in cells], row), text


def _broken(row: int, record: list[str] | csv.Error, width: int) -> tuple[int, str]:
    """What is said about a row that cannot be split, or not into as many cells as the header has."""
    if not isinstance(record, csv.Error):
        return row, f"row {row}: found {counted(len(record), 'cell')}, allowed: {width} cells as in the header"
    found = next((said for part, said in _SPLIT_ERRORS.items() if part in str(record)), str(record))
    return row, f"row {row}: found {found}, allowed: quotes around whole cells, doubled inside"


# --- From cells to columns --------------------------------------------------------------------------


@dataclass(frozen=True)
class Column:
    """One column: its name in the file, its distinct texts, and the place of each row's text among them."""

    name: str
    texts: list[str]
    codes: IntArray

    def spread(self, values: Sequence[float], dtype: type) -> npt.NDArray[Any]:
        """One value per row, from one value per distinct text."""
        array: npt.NDArray[Any] = np.array(values, dtype)[self.codes]
        return array

    def only(self, rows: BoolArray) -> Column:
        """The column of these rows, without the texts that only others have."""
        codes, places = np.unique(self.codes[rows], return_inverse=True)
        return Column(self.name, [self.texts[code] for code in codes.tolist()], places.astype(np.int64))

    def text(self, index: int) -> str:
        """The text of one row."""
        return self.texts[int(self.codes[index])]


def stripped(name: str, texts: Iterable[str], codes: IntArray) -> Column:
    """A column without the spaces around its texts, by which some of them may become one."""
    seen: dict[str, int] = {}
    places = np.array([seen.setdefault(text.strip(), len(seen)) for text in texts], np.int64)
    return Column(name, list(seen), places[codes])


class _Texts:
    """Distinct texts of a column in order of appearance, and the place of each cell's text among them."""

    def __init__(self) -> None:
        self._places: dict[str, int] = defaultdict(itertools.count().__next__)
        self._codes = [np.empty(0, np.int64)]

    def add(self, cells: Sequence[str]) -> None:
        self._codes.append(np.fromiter(map(self._places.__getitem__, cells), np.int64, len(cells)))

    def column(self, name: str) -> Column:
        return stripped(name, self._places, np.concatenate(self._codes))


def _bare_names(column: Column) -> Column:
    """Names without the apostrophe that keeps a spreadsheet from running them, where that makes no two of them one."""
    texts = [text[1:] if text[:1] == "'" and runs(text[1:]) else text for text in column.texts]
    return Column(column.name, texts, column.codes) if len(set(texts)) == len(texts) else column


@dataclass(frozen=True)
class Cells:
    """The needed columns by name, the physical row of each record, and the fault of records that do not fit."""

    header: Header
    columns: dict[str, Column]
    rows: IntArray
    fault: Fault


def read_cells(header: Header, text: Any, places: Mapping[str, int], problems: Sequence[str]) -> Cells:
    """The columns at these places of the records, by name.

    Raises
    ------
    InputError
        Where the header has problems: they and the rows that cannot be split. Where there is no row below the header.
    """
    from bayes_toe.data.frames import frame_cells, is_frame

    if is_frame(text):
        return frame_cells(header, text, places, problems)
    if not isinstance(text, str):
        from bayes_toe.data.parquet import parquet_cells

        return parquet_cells(header, text, places, problems)
    texts = [_Texts() for _ in places]
    rows, fault = _keep(itertools.islice(_records(text, header.delimiter), 1, None), len(header.names), tuple(places.values()), texts)
    if problems:
        refuse(header.source, [*(Fault(1, ((header.row, line),)) for line in problems), fault])
    if not len(rows) and fault.count == 0:
        raise InputError(f"{header.source}: {header.place}: found a header only, allowed: at least one row below it")
    columns = {name: kept.column(header.names[place]) for (name, place), kept in zip(places.items(), texts, strict=True)}
    columns.update({name: _bare_names(columns[name]) for name in ("subject",) if name in columns})
    return Cells(header, columns, rows, fault)


def _keep(records: _Records, width: int, places: tuple[int, ...], texts: Sequence[_Texts]) -> tuple[IntArray, Fault]:
    """Append the cells at these places only: files of experiments are much wider than what we read."""
    rows, count, shown = [np.empty(0, np.int64)], 0, list[tuple[int, str]]()
    while some := list(itertools.islice(records, _ROWS)):
        whole = [(row, record) for row, record in some if isinstance(record, list) and len(record) == width]
        if len(whole) < len(some):
            broken = [entry for entry in some if not isinstance(entry[1], list) or len(entry[1]) != width]
            count += len(broken)
            shown += [_broken(*entry, width) for entry in broken[: MOST_SHOWN - len(shown)]]
        for kept, place in zip(texts, places, strict=True):
            kept.add([record[place] for _, record in whole])
        rows.append(np.fromiter(map(itemgetter(0), whole), np.int64, len(whole)))
    return np.concatenate(rows), Fault(count, tuple(shown))


def fault_in(cells: Cells, column: Column, bad: BoolArray, allowed: Callable[[int], str]) -> Fault:
    """The cells of a column that are bad; `allowed` says for the index of a record what would have been right."""
    shown = []
    for index in np.flatnonzero(bad)[:MOST_SHOWN].tolist():
        row, found = int(cells.rows[index]), quoted(column.text(index))
        shown.append((row, f"row {row}, column {bare(column.name)}: found {found}, allowed: {allowed(index)}"))
    return Fault(int(np.count_nonzero(bad)), tuple(shown))


def with_zeros(cells: Cells) -> Cells:
    """The same with the fault of cells that hold NUL characters, for what was not decoded from a file's bytes."""
    faults = []
    for column in cells.columns.values():
        bad = column.spread(["\0" in text for text in column.texts], np.bool_)
        faults.append(fault_in(cells, column, bad, lambda _: "text without NUL characters"))
    shown = sorted(line for fault in faults for line in fault.shown)[:MOST_SHOWN]
    return Cells(cells.header, cells.columns, cells.rows, Fault(sum(fault.count for fault in faults), tuple(shown)))


# --- Numbers --------------------------------------------------------------------------------------


def number(text: str, decimal_comma: bool) -> float:
    """The finite number that a cell holds, NaN if it holds none."""
    plain = text.replace(",", ".") if decimal_comma else text
    value = float(plain) if _NUMBER.fullmatch(plain) is not None else math.nan
    return value + 0.0 if math.isfinite(value) else math.nan  # + 0.0 turns -0.0 into 0.0


def whole_number(text: str, decimal_comma: bool) -> int:
    """The whole number that a cell holds, -1 if it holds none."""
    match = _COUNT.fullmatch(text.replace(",", ".") if decimal_comma else text)
    value = -1 if match is None else int(match[1])
    return value if value <= LARGEST_COUNT else -1
