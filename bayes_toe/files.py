"""Studies as they come in: CSV files of trials or of counts, read strictly and reported by row.

Everything is read as text first, so that subject '01' stays '01' and subject 'NA' stays 'NA'; each distinct text of a
column is converted once. Nothing is guessed in silence: what was detected, dropped or merged is in the study's notes,
and what cannot be used is refused with all problems of the file at once.
"""

from __future__ import annotations

import codecs
import csv
import io
import itertools
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from bayes_toe.errors import InputError
from bayes_toe.study import FloatArray, IntArray, Study, Subject

BoolArray = npt.NDArray[np.bool_]
_Records = Iterator[tuple[int, list[str] | csv.Error]]

COLUMNS = ("subject", "s1", "s2", "i1", "i2", "response", "n_equal", "n_trials")
_SYNTHETIC = "synthetic"
_DELIMITERS = {",": "comma", ";": "semicolon", "\t": "tab"}
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

_EQUAL_WORDS = frozenset({"equal", "same", "1"})
_DIFFERENT_WORDS = frozenset({"different", "0"})
_MISSING_WORDS = frozenset({"", "na", "n/a", "nan", "none"})
_TRUE_WORDS = frozenset({"1", "true", "yes"})
_EQUAL, _DIFFERENT, _MISSING, _UNKNOWN = 1, 0, -1, -2

# Alternatives never overlap, so that a cell of 100,000 digits costs linear time.
_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
# '5.0' is how pandas writes a 5 beside missing cells; '5.000' may be a German five thousand, so it is not read at all.
_COUNT = re.compile(r"\+?0*(\d{1,16})(?:\.(?!000$)0*)?", re.ASCII)
_SWITCH = re.compile(r"([01])[.,]0*")
_LARGEST_COUNT = 2**53  # beyond it, whole numbers are no longer exact in the floating point of the likelihood
_MOST_SHOWN = 10
_LONGEST_SHOWN = 40


@dataclass(frozen=True)
class ReadOptions:
    """How to read a file whose layout is not the default.

    Parameters
    ----------
    intensity : float, optional
        REF: columns i1, i2 hold raw amplitudes i and are read as s = ln(i / REF). Positive, in the unit of the columns.
    equal_code, different_code : str, optional
        The exact text that stands for this answer; other texts for it are then refused.
    columns : mapping of str to str
        Our column names to those of the file, for columns that the file names otherwise.

    Raises
    ------
    InputError
        If REF is not positive and finite, a code is empty, both codes are one text, or a column name is unknown or
        repeated.

    Examples
    --------
    >>> ReadOptions(equal_code=" f ", different_code="j").equal_code
    'f'
    """

    intensity: float | None = None
    equal_code: str | None = None
    different_code: str | None = None
    columns: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for key in ("equal_code", "different_code"):
            code = getattr(self, key)
            object.__setattr__(self, key, None if code is None else code.strip())
        columns = {ours.strip(): theirs.strip() for ours, theirs in self.columns.items()}
        object.__setattr__(self, "columns", columns)
        problems = [*_reference_problems(self.intensity), *_code_problems(self), *_name_problems(self.columns.items())]
        if problems:
            raise InputError(problems)


def parse_columns(text: str) -> dict[str, str]:
    """Column names as given on the command line, ours=the file's.

    Parameters
    ----------
    text : str
        Comma-separated entries, e.g. ``subject=participant,s1=first``.

    Returns
    -------
    dict of str to str
        Our names to the file's names.

    Raises
    ------
    InputError
        One line per entry that is malformed, unknown or repeated.

    Examples
    --------
    >>> parse_columns("subject=participant, s1=first")
    {'subject': 'participant', 's1': 'first'}
    """
    entries = [entry.strip() for entry in text.split(",")]
    problems = [_name_problem(entry, "OURS=NAME") for entry in entries if "=" not in entry]
    split = (entry.partition("=") for entry in entries if "=" in entry)
    pairs = [(ours.strip(), theirs.strip()) for ours, _, theirs in split]
    problems += _name_problems(pairs)
    if problems:
        raise InputError(problems)
    return dict(pairs)


def read_study(path: str | Path, options: ReadOptions | None = None) -> Study:
    r"""The study in a CSV file of trials or of counts; the header tells which.

    Trials: ``subject,s1,s2,response``, the response 'equal' or 'different' (also same/different, 1/0). Counts:
    ``subject,s1,s2,n_equal,n_trials``. s1 and s2 are natural-log intensities; other columns are ignored.

    Parameters
    ----------
    path : str or Path
        Comma, semicolon or tab between cells; UTF-8, or UTF-16 with a byte-order mark.
    options : ReadOptions, optional
        For raw amplitudes, other answer codes or other column names.

    Returns
    -------
    Study
        Subjects in order of first appearance; its notes say what was detected, dropped and merged.

    Raises
    ------
    InputError
        If anything cannot be used: one line per problem of the file, ten at most, with row and column.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pilot = Path(folder, "pilot.csv")
    ...     _ = pilot.write_text("subject,s1,s2,response\n01,0,0.3,equal\n01,0.3,0,different\n", encoding="utf-8")
    ...     study = read_study(pilot)
    >>> study.names, study.notes
    (('01',), ("trial rows, comma-separated, UTF-8, responses 'equal' (1) / 'different' (1)",))
    """
    options = ReadOptions() if options is None else options
    source = _plain(Path(path).name)
    text, encoding = _decode(source, _bytes(path))
    table = _table(_header(source, text, encoding, options), text, options)
    return _trial_study(table, options) if "response" in table.columns else _count_study(table, options)


# --- Options --------------------------------------------------------------------------------------


def _reference_problems(reference: float | None) -> list[str]:
    if reference is None or (math.isfinite(reference) and reference > 0):
        return []
    return [f"--intensity: found {reference!r}, allowed: a positive finite number"]


def _code_problems(options: ReadOptions) -> list[str]:
    given = {"--equal-code": options.equal_code, "--different-code": options.different_code}
    problems = [f"{name}: found '', allowed: a text that is not empty" for name, code in given.items() if code == ""]
    if options.equal_code is not None and options.equal_code == options.different_code and not problems:
        found = _found(options.equal_code)
        problems.append(f"--different-code: found {found} as --equal-code, allowed: two different texts")
    return problems


def _name_problem(found: str, allowed: str) -> str:
    return f"--columns: found {_found(found)}, allowed: {allowed} with OURS one of {', '.join(COLUMNS)}"


def _name_problems(pairs: Iterable[tuple[str, str]]) -> list[str]:
    """Entries that name no column of ours or of the file, or that name one twice."""
    problems, seen_ours, seen_theirs = [], set[str](), set[str]()
    for ours, theirs in pairs:
        if ours not in COLUMNS or not theirs:
            problems.append(_name_problem(f"{ours}={theirs}", "OURS=NAME"))
        elif ours in seen_ours or theirs in seen_theirs:
            problems.append(_name_problem(f"{ours}={theirs}", "each name once, as OURS=NAME"))
        seen_ours.add(ours)
        seen_theirs.add(theirs)
    return problems


# --- Showing what was found -----------------------------------------------------------------------


def _found(text: str) -> str:
    """A cell as messages show it: quoted, on one line, of bounded length."""
    shown = repr(text)
    return shown if len(shown) <= _LONGEST_SHOWN else f"{shown[: _LONGEST_SHOWN - 4]}...{shown[-1]}"


def _plain(text: str) -> str:
    """A name as messages show it: bare where that is readable."""
    return text if text.isprintable() and 0 < len(text) <= _LONGEST_SHOWN else _found(text)


def _listed(items: Sequence[str]) -> str:
    """The first items, and how many there are beyond them."""
    more = [f"... and {len(items) - _MOST_SHOWN} more"] if len(items) > _MOST_SHOWN else []
    return ", ".join([*items[:_MOST_SHOWN], *more])


@dataclass(frozen=True)
class _Fault:
    """One kind of problem: how often it occurs, and its first occurrences as (row, what is said about it)."""

    count: int
    shown: tuple[tuple[int, str], ...]


def _refuse(source: str, faults: Sequence[_Fault]) -> None:
    """Raise all problems of a file at once, in the order of its rows."""
    count = sum(fault.count for fault in faults)
    if count == 0:
        return
    shown = sorted((line for fault in faults for line in fault.shown), key=itemgetter(0))[:_MOST_SHOWN]
    more = count - len(shown)
    rest = [f"... and {more} more problem{'s' if more > 1 else ''}"] if more else []
    raise InputError([*(f"{source}: {text}" for _, text in shown), *rest])


# --- From bytes to cells --------------------------------------------------------------------------


def _bytes(path: str | Path) -> bytes:
    try:
        return Path(path).read_bytes()
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
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=True, strict=True)
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


def _first_cells(text: str, delimiter: str) -> list[str]:
    _, cells = next(_records(text, delimiter), (0, csv.Error()))
    return [] if isinstance(cells, csv.Error) else [cell.strip() for cell in cells]


def _delimiter(text: str, options: ReadOptions) -> str:
    """The delimiter under which the header has most of the names we look for, then most cells."""
    names = {options.columns.get(ours, ours) for ours in COLUMNS}
    cells = {delimiter: _first_cells(text, delimiter) for delimiter in _DELIMITERS}
    return max(cells, key=lambda delimiter: (len(names.intersection(cells[delimiter])), len(cells[delimiter])))


@dataclass(frozen=True)
class _Header:
    """What the first record of a file tells, and its physical row."""

    source: str
    encoding: str
    delimiter: str
    names: list[str]
    row: int

    @property
    def decimal_comma(self) -> bool:
        """Whether the delimiter leaves the comma free to be a decimal sign."""
        return self.delimiter != ","


def _header(source: str, text: str, encoding: str, options: ReadOptions) -> _Header:
    delimiter = _delimiter(text, options)
    row, cells = next(_records(text, delimiter), (0, None))
    if cells is None:
        raise InputError(f"{source}: found an empty file, allowed: a header and at least one row")
    if isinstance(cells, csv.Error):
        raise InputError(f"{source}: {_broken(row, cells, 0)[1]}")
    return _Header(source, encoding, delimiter, [cell.strip() for cell in cells], row)


def _broken(row: int, record: list[str] | csv.Error, width: int) -> tuple[int, str]:
    """What is said about a row that cannot be split, or not into as many cells as the header has."""
    if not isinstance(record, csv.Error):
        return row, f"row {row}: found {_some(len(record), 'cell')}, allowed: {width} cells as in the header"
    found = next((said for part, said in _SPLIT_ERRORS.items() if part in str(record)), str(record))
    return row, f"row {row}: found {found}, allowed: quotes around whole cells, doubled inside"


# --- From cells to columns --------------------------------------------------------------------------


@dataclass(frozen=True)
class _Column:
    """One column: its name in the file, its distinct texts, and the place of each row's text among them."""

    name: str
    texts: list[str]
    codes: IntArray

    def spread(self, values: Sequence[float], dtype: type) -> npt.NDArray[Any]:
        """One value per row, from one value per distinct text."""
        array: npt.NDArray[Any] = np.array(values, dtype)[self.codes]
        return array

    def text(self, index: int) -> str:
        return self.texts[int(self.codes[index])]


def _column(name: str, cells: Sequence[str]) -> _Column:
    seen: dict[str, int] = {}
    codes = np.fromiter((seen.setdefault(cell.strip(), len(seen)) for cell in cells), np.int64, len(cells))
    return _Column(name, list(seen), codes)


@dataclass(frozen=True)
class _Table:
    """The needed columns by our names, the physical row of each record, and the fault of records that do not fit."""

    header: _Header
    columns: dict[str, _Column]
    rows: IntArray
    fault: _Fault


def _table(header: _Header, text: str, options: ReadOptions) -> _Table:
    places, lines = _places(header, options)
    kept: dict[str, list[str]] = {ours: [] for ours in places}
    wanted = [(kept[ours], place) for ours, place in places.items()]
    rows, fault = _keep(itertools.islice(_records(text, header.delimiter), 1, None), len(header.names), wanted)
    if lines:
        _refuse(header.source, [*(_Fault(1, ((header.row, line),)) for line in lines), fault])
    columns = {ours: _column(header.names[place], kept[ours]) for ours, place in places.items()}
    return _Table(header, columns, np.array(rows, np.int64), fault)


def _keep(records: _Records, width: int, wanted: Sequence[tuple[list[str], int]]) -> tuple[list[int], _Fault]:
    """Append the cells of the wanted columns only: files of experiments are much wider than what we read."""
    rows: list[int] = []
    broken: list[tuple[int, list[str] | csv.Error]] = []
    for row, record in records:
        if isinstance(record, csv.Error) or len(record) != width:
            broken.append((row, record))
            continue
        rows.append(row)
        for cells, place in wanted:
            cells.append(record[place])
    return rows, _Fault(len(broken), tuple(_broken(*entry, width) for entry in broken[:_MOST_SHOWN]))


def _fault(table: _Table, column: _Column, bad: BoolArray, allowed: Callable[[int], str]) -> _Fault:
    """The cells of a column that are bad; `allowed` says for the index of a record what would have been right."""
    shown = []
    for index in np.flatnonzero(bad)[:_MOST_SHOWN].tolist():
        row, found = int(table.rows[index]), _found(column.text(index))
        shown.append((row, f"row {row}, column {_plain(column.name)}: found {found}, allowed: {allowed(index)}"))
    return _Fault(int(np.count_nonzero(bad)), tuple(shown))


def _places(header: _Header, options: ReadOptions) -> tuple[dict[str, int], list[str]]:
    """Where each column that we read is, and what is wrong with the header."""
    named = {ours: options.columns.get(ours, ours) for ours in COLUMNS}
    needed = _needed(header.names, named, options)
    lines = [*_conflict(named, needed), *_read_twice(named, needed)]
    for ours in COLUMNS:
        count = header.names.count(named[ours])
        if count == 0 and (ours in needed or ours in options.columns):
            lines.append(_missing(header.names, named, ours))
        elif count > 1 and ours in needed:
            lines.append(f"column {_plain(named[ours])}: found {count} columns of this name, allowed: one")
    places = {ours: header.names.index(named[ours]) for ours in needed if named[ours] in header.names}
    marked = {_SYNTHETIC: header.names.index(_SYNTHETIC)} if _SYNTHETIC in header.names else {}
    return places | marked, [f"row {header.row}, {line}" for line in lines]


def _needed(names: Sequence[str], named: Mapping[str, str], options: ReadOptions) -> list[str]:
    """Our names of the columns that this header calls for."""
    counts = [ours for ours in ("n_equal", "n_trials") if named[ours] in names]
    if named["response"] in names:
        return ["subject", *_stimuli(options), "response", *counts]
    return ["subject", *_stimuli(options), *(("n_equal", "n_trials") if counts else ("response",))]


def _stimuli(options: ReadOptions) -> tuple[str, str]:
    return ("s1", "s2") if options.intensity is None else ("i1", "i2")


def _conflict(named: Mapping[str, str], needed: Sequence[str]) -> list[str]:
    counts = [_plain(named[ours]) for ours in needed if ours in ("n_equal", "n_trials")]
    if "response" not in needed or not counts:
        return []
    response, both = _plain(named["response"]), f"{_plain(named['n_equal'])} and {_plain(named['n_trials'])}"
    allowed = f"{response} alone (one row per trial) or {both} alone (one row per pair)"
    return [f"column {response}: found together with {' and '.join(counts)}, allowed: {allowed}"]


def _missing(names: Sequence[str], named: Mapping[str, str], ours: str) -> str:
    """What is said about a column that the header lacks, with the way out that fits."""
    found = _listed([_found(name) for name in names])
    hint = f"a column of this name, or --columns {ours}=NAME"
    if ours in ("s1", "s2") and any(named[other] in names for other in ("i1", "i2")):
        hint += f"; the amplitudes {_plain(named['i1'])}, {_plain(named['i2'])} need --intensity REF"
    if ours in ("i1", "i2") and any(named[other] in names for other in ("s1", "s2")):
        hint += f"; the log intensities {_plain(named['s1'])}, {_plain(named['s2'])} are read without --intensity"
    if ours == "response":
        hint += f"; or counts in {_plain(named['n_equal'])} and {_plain(named['n_trials'])}"
    return f"column {_plain(named[ours])}: missing, found {found}, allowed: {hint}"


def _read_twice(named: Mapping[str, str], needed: Sequence[str]) -> list[str]:
    """Columns of the file that --columns would have stand for two of ours."""
    lines = []
    for theirs in dict.fromkeys(named[ours] for ours in needed):
        roles = [ours for ours in needed if named[ours] == theirs]
        if len(roles) > 1:
            lines.append(f"column {_plain(theirs)}: found as {' and as '.join(roles)}, allowed: one meaning per column")
    return lines


# --- Numbers --------------------------------------------------------------------------------------


def _number(text: str, decimal_comma: bool) -> float:
    """The finite number that a cell holds, NaN if it holds none."""
    plain = text.replace(",", ".") if decimal_comma else text
    value = float(plain) if _NUMBER.fullmatch(plain) is not None else math.nan
    return value + 0.0 if math.isfinite(value) else math.nan  # + 0.0 turns -0.0 into 0.0


def _count(text: str, decimal_comma: bool) -> int:
    """The whole number that a cell holds, -1 if it holds none."""
    match = _COUNT.fullmatch(text.replace(",", ".") if decimal_comma else text)
    value = -1 if match is None else int(match[1])
    return value if value <= _LARGEST_COUNT else -1


def _log_ratio(value: float, reference: float) -> float:
    # The difference of logs, because the ratio itself may overflow.
    return math.log(value) - math.log(reference) if value > 0 else math.nan


@dataclass(frozen=True)
class _Pairs:
    """Who met which stimuli, row by row; s1 and s2 are natural-log intensities, NaN where a cell cannot be read."""

    subject: _Column
    first: _Column
    second: _Column
    s1: FloatArray
    s2: FloatArray


def _pairs(table: _Table, options: ReadOptions) -> _Pairs:
    first, second = (table.columns[ours] for ours in _stimuli(options))
    s1, s2 = (_log_intensity(table, column, options) for column in (first, second))
    return _Pairs(table.columns["subject"], first, second, s1, s2)


def _log_intensity(table: _Table, column: _Column, options: ReadOptions) -> FloatArray:
    values = [_number(text, table.header.decimal_comma) for text in column.texts]
    if options.intensity is not None:
        values = [_log_ratio(value, options.intensity) for value in values]
    return column.spread(values, np.float64)


def _pair_faults(table: _Table, pairs: _Pairs, asked: BoolArray, options: ReadOptions) -> list[_Fault]:
    """Subjects without a name and stimuli without a number, in the rows that have an answer."""
    empty = pairs.subject.spread([text == "" for text in pairs.subject.texts], np.bool_)
    return [
        _fault(table, pairs.subject, asked & empty, lambda _: "a text that is not empty"),
        _stimulus_fault(table, pairs.first, asked & np.isnan(pairs.s1), options),
        _stimulus_fault(table, pairs.second, asked & np.isnan(pairs.s2), options),
    ]


def _stimulus_fault(table: _Table, column: _Column, bad: BoolArray, options: ReadOptions) -> _Fault:
    kind = "a finite number" if options.intensity is None else "a positive finite number"

    def allowed(index: int) -> str:
        text = column.text(index)
        if not table.header.decimal_comma and "," in text and not math.isnan(_number(text, True)):
            return f"{kind}; decimal commas need ';' or tab between cells"
        if "," in text or text.count(".") > 1:
            return f"{kind}, without thousands separators"
        return kind

    return _fault(table, column, bad, allowed)


# --- Trials ---------------------------------------------------------------------------------------


def _word(text: str) -> str:
    """A cell without what spreadsheets do to it: case, and the decimals of 1.0 and 0.0."""
    whole = _SWITCH.fullmatch(text)
    return text.lower() if whole is None else whole[1]


def _answer(text: str, options: ReadOptions) -> int:
    """The answer that a cell stands for."""
    codes = {options.equal_code: _EQUAL, options.different_code: _DIFFERENT}
    if text in codes:
        return codes[text]
    word = _word(text)
    if word in _MISSING_WORDS:
        return _MISSING
    # Where '0' was declared to mean equal, '0.0' must not count as different by default.
    if any(word == _word(code) for code in codes if code is not None):
        return _UNKNOWN
    if word in _EQUAL_WORDS and options.equal_code is None:
        return _EQUAL
    return _DIFFERENT if word in _DIFFERENT_WORDS and options.different_code is None else _UNKNOWN


def _allowed_answers(options: ReadOptions) -> str:
    equal = "equal, same, 1" if options.equal_code is None else _found(options.equal_code)
    different = "different, 0" if options.different_code is None else _found(options.different_code)
    return f"{equal} (equal) or {different} (different), or empty; other codes by --equal-code, --different-code"


def _trial_study(table: _Table, options: ReadOptions) -> Study:
    pairs, response = _pairs(table, options), table.columns["response"]
    answer = response.spread([_answer(text, options) for text in response.texts], np.int64)
    asked = answer != _MISSING  # rows without an answer, such as instruction screens, may hold anything else
    unknown = _fault(table, response, answer == _UNKNOWN, lambda _: _allowed_answers(options))
    _refuse(table.header.source, [table.fault, *_pair_faults(table, pairs, asked, options), unknown])
    _require_rows(table, asked)
    notes = [
        f"trial rows, {_format(table, (pairs.first, pairs.second))}, responses {_answers_note(response, answer)}",
        *_layout_notes(pairs, options),
        *_dropped_notes(pairs.subject, ~asked),
    ]
    # A trial is a count of one, a trial without an answer a count of none.
    return _study(table, _subjects(pairs, np.where(answer == _EQUAL, 1, 0), np.where(asked, 1, 0)), notes)


def _require_rows(table: _Table, asked: BoolArray) -> None:
    if len(asked) == 0:
        what = f"row {table.header.row}: found a header only, allowed: at least one row below it"
    elif not asked.any():
        what = f"found no response in any of {len(asked)} rows, allowed: at least one answered trial"
    else:
        return
    raise InputError(f"{table.header.source}: {what}")


# --- Counts ---------------------------------------------------------------------------------------


def _count_study(table: _Table, options: ReadOptions) -> Study:
    pairs, equal, trials = _pairs(table, options), table.columns["n_equal"], table.columns["n_trials"]
    k, n = (_whole_numbers(table, column) for column in (equal, trials))
    every = np.ones(len(n), np.bool_)
    faults = [*_count_faults(table, equal, trials, k, n), _total_fault(table, pairs.subject, trials, n)]
    _refuse(table.header.source, [table.fault, *_pair_faults(table, pairs, every, options), *faults])
    _require_rows(table, every)
    subjects = _subjects(pairs, k, n)
    notes = [
        f"grouped rows, {_format(table, (pairs.first, pairs.second))}, {k.sum()} of {n.sum()} trials answered 'equal'",
        *_layout_notes(pairs, options),
        *_grouping_notes(pairs.subject, subjects, n),
    ]
    return _study(table, subjects, notes)


def _whole_numbers(table: _Table, column: _Column) -> IntArray:
    return column.spread([_count(text, table.header.decimal_comma) for text in column.texts], np.int64)


def _count_faults(table: _Table, equal: _Column, trials: _Column, k: IntArray, n: IntArray) -> list[_Fault]:
    return [
        _fault(table, equal, k < 0, _allowed_count),
        _fault(table, trials, n < 0, _allowed_count),
        _fault(table, equal, (n >= 0) & (k > n), lambda index: f"0 to {_plain(trials.name)} = {n[index]}"),
    ]


def _allowed_count(_: int) -> str:
    return "a whole number from 0 to 2**53, without thousands separators"


def _total_fault(table: _Table, subject: _Column, trials: _Column, n: IntArray) -> _Fault:
    """Subjects whose trials add up to nothing, or to more than can be counted exactly."""
    # A bad count makes the sum NaN, for which both comparisons are false.
    total = np.bincount(subject.codes, np.where(n < 0, np.nan, n), minlength=len(subject.texts))
    named = np.array([text != "" for text in subject.texts], np.bool_)
    bad = np.flatnonzero(named & ((total == 0) | (total > _LARGEST_COUNT)))
    shown = []
    for code in bad[:_MOST_SHOWN].tolist():
        row, name = int(table.rows[np.argmax(subject.codes == code)]), _found(subject.texts[code])
        what = "0 in all rows" if total[code] == 0 else f"a sum of {total[code]:.0f} over the rows"
        where = f"row {row}, column {_plain(trials.name)}"
        shown.append((row, f"{where}: found {what} of subject {name}, allowed: 1 to 2**53 trials per subject"))
    return _Fault(len(bad), tuple(shown))


# --- Notes ----------------------------------------------------------------------------------------


def _format(table: _Table, numbers: Sequence[_Column]) -> str:
    header = table.header
    comma = header.decimal_comma and any("," in text for column in numbers for text in column.texts)
    return f"{_DELIMITERS[header.delimiter]}-separated, {header.encoding}{', decimal comma' if comma else ''}"


def _answers_note(response: _Column, answer: IntArray) -> str:
    return " / ".join(_side_note(response, answer, *side) for side in ((_EQUAL, "equal"), (_DIFFERENT, "different")))


def _side_note(response: _Column, answer: IntArray, value: int, word: str) -> str:
    """Which texts were read as this answer, and how often it was given."""
    chosen = answer == value
    texts = [response.texts[code] for code in np.unique(response.codes[chosen]).tolist()]
    meaning = "" if all(text.lower() == word for text in texts) else f" as {word}"
    shown = _listed([_found(text) for text in texts]) if texts else f"'{word}'"
    return f"{shown}{meaning} ({np.count_nonzero(chosen)})"


def _layout_notes(pairs: _Pairs, options: ReadOptions) -> list[str]:
    notes = [f"column {_plain(theirs)} read as {ours}" for ours, theirs in options.columns.items() if theirs != ours]
    if options.intensity is None:
        return notes
    names = [_plain(column.name) for column in (pairs.first, pairs.second)]
    return notes + [f"column {name} read as amplitude in units of {float(options.intensity)!r}" for name in names]


def _dropped_notes(subject: _Column, dropped: BoolArray) -> list[str]:
    """How many trials without a response each subject has, and who has no other."""
    count = np.bincount(subject.codes[dropped], minlength=len(subject.texts))
    total = np.bincount(subject.codes, minlength=len(subject.texts))
    names = ["(no subject)" if text == "" else _plain(text) for text in subject.texts]
    each = [f"{names[code]} {count[code]}" for code in np.flatnonzero(count).tolist()]
    gone = [names[code] for code in np.flatnonzero(count == total).tolist() if subject.texts[code]]
    notes = [f"{_some(int(count.sum()), 'trial')} without a response dropped: {_listed(each)}"] if each else []
    return notes + ([f"{_some(len(gone), 'subject')} without any response left out: {_listed(gone)}"] if gone else [])


def _grouping_notes(subject: _Column, subjects: Sequence[Subject], n: IntArray) -> list[str]:
    """How many rows of counts were empty, and how many repeated a pair of the same subject."""
    zero = int(np.count_nonzero(n == 0))
    rows = np.bincount(subject.codes[n > 0], minlength=len(subject.texts)).tolist()
    merged = {one.name: count - one.n_pairs for one, count in zip(subjects, rows, strict=True)}
    each = [f"{_plain(name)} {count}" for name, count in merged.items() if count]
    notes = [f"{_some(zero, 'row')} with n_trials = 0 left out"] if zero else []
    return notes + ([f"{_some(sum(merged.values()), 'repeated row')} merged: {_listed(each)}"] if each else [])


def _some(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


# --- The study ------------------------------------------------------------------------------------


def _subjects(pairs: _Pairs, n_equal: IntArray, n_trials: IntArray) -> list[Subject]:
    """Subjects with an answered trial, in order of first appearance."""
    rows = np.flatnonzero(n_trials > 0)
    rows = rows[np.argsort(pairs.subject.codes[rows], kind="stable")]
    ends = 1 + np.flatnonzero(np.diff(pairs.subject.codes[rows]))
    columns = (pairs.s1, pairs.s2, n_equal, n_trials)
    parts = np.split(rows, ends)
    return [Subject.from_counts(pairs.subject.text(part[0]), *(column[part] for column in columns)) for part in parts]


def _study(table: _Table, subjects: Sequence[Subject], notes: Sequence[str]) -> Study:
    synthetic, note = _synthetic(table)
    return Study(tuple(subjects), table.header.source, synthetic, (*notes, *note))


def _synthetic(table: _Table) -> tuple[bool, list[str]]:
    """Whether the file says that its data were simulated, and the note about it."""
    if _SYNTHETIC not in table.columns:
        return False, []
    marks = [_word(text) in _TRUE_WORDS for text in table.columns[_SYNTHETIC].texts]
    if all(marks):
        return True, ["synthetic data: column synthetic says so in every row"]
    return False, ["column synthetic says so in some rows only: not marked synthetic"] if any(marks) else []
