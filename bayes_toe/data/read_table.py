"""Any source of a table as columns of text: CSV, Excel, JSON, MATLAB, data frames.

`read_table` reads one, `toml_table` a TOML file.
"""

from __future__ import annotations

import errno
import io
import json
import os
import re
import stat
import tomllib
import warnings
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bayes_toe.arrays import Record, StrPath
from bayes_toe.data.matlab_file import SAVED, matlab_values
from bayes_toe.data.messages import (
    display_name,
    join_display_names,
    join_words,
    one_line,
    quoted,
    visible,
)
from bayes_toe.data.text_table import (
    EXCEL,
    MOST_RECORDS,
    Choice,
    Column,
    Frame,
    Problems,
    TableRecord,
    TextTable,
    damaged,
    decoded,
    header_place,
    n_chosen,
    read_csv,
    record_names,
    require_size,
    table_of_records,
    value_text,
)
from bayes_toe.errors import InputError, NoTrialsError, Remedy

#: Bytes of the largest file. A study of 10^7 trials has some 300 million.
LARGEST_FILE = 2**30

#: How a text begins that is JSON, whatever its suffix: a record, or a list of records or lists, as
#: '[ {'. A byte-order mark may stand in front.
_JSON_START = rb"(?:\xef\xbb\xbf)?\s*(?:\[\s*[\[{]|\{)"
_TEXT_SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".xpd", ".lvm", ".iqdat")
#: A formula that no program has computed, such as '<c r="B2"><f>A1+1</f><v></v></c>', and the error
#: that stands for it.
_NOT_COMPUTED = (
    rb"(<c (?![^<>]*\bt=)[^<>]*)>(?:<f[^<>]*/>|<f[^<>]*>[^<>]*</f>)(?:<v ?/>|<v></v>)?</c>"
)
_ERROR = rb'\1 t="e"><v>#N/A (a formula without a value)</v></c>'
_EXCEL_SUFFIXES = (".xlsx", ".xlsm")
_JSON_SUFFIXES = (".json", ".jsonl", ".ndjson")
#: Types of the parts of a record that are no single values.
_NESTED = (list, dict)
#: Suffixes of tables. A file that is named and has another suffix is read as a text.
TABLE_SUFFIXES = _TEXT_SUFFIXES + _EXCEL_SUFFIXES + _JSON_SUFFIXES + (".mat",)
#: What to do with files that are not read, by their suffix.
_NOT_READ = {
    ".toml": "settings, allowed: a table of trials or counts",
    **dict.fromkeys(
        [".gz", ".zip", ".7z", ".xz", ".tar", ".tgz"], "an archive, allowed: the file in it"
    ),
    **dict.fromkeys([".ods", ".numbers"], "a spreadsheet, allowed: its copy as .xlsx or CSV"),
    ".parquet": "a Parquet file, allowed: its copy as CSV, or the data frame of pandas in Python",
    **dict.fromkeys([".rdata", ".rda", ".rds"], "R data, allowed: a CSV file that write.csv makes"),
    **dict.fromkeys(
        [".sav", ".dta", ".por", ".psydat", ".edat2", ".edat3"],
        "data of another program, allowed: its copy as CSV",
    ),
}


def read_table(
    source: StrPath | Frame,
    choice: Choice,
    *,
    encoding: str | None = None,
    sheet: str | None = None,
) -> TextTable:
    """The columns that are chosen of a file, whose suffix tells its form, or of a data frame.

    Parameters
    ----------
    source : path, pandas.DataFrame or polars.DataFrame
    choice : callable
        Which columns are read, of the names in a header.
    encoding : str, optional
        Of a CSV or JSON file; see :func:`~bayes_toe.data.text_table.decoded`.
    sheet : str, optional
        Of an Excel file with several tables. The path of an Excel file may also end in the sheet,
        as in study.xlsx/S01.

    Raises
    ------
    InputError
        If the source cannot be read, is too large or empty, or its head cannot be split.
    """
    # A lazy frame of polars has no rows, and warns where it is asked for its columns.
    has_rows = hasattr(source, "iloc") or hasattr(source, "to_series")
    if has_rows and hasattr(source, "columns"):
        return _table_of_frame(source)
    if not isinstance(source, str | os.PathLike):
        raise InputError(
            f"found {quoted(type(source).__name__)}, allowed: the path of a file, or a pandas or "
            "polars DataFrame"
        )

    path = Path(source)
    book = path.parent
    if is_excel(book) and book.is_file():
        table = _read_file(book, choice, encoding, path.name)
        table.problems.source = display_name(f"{book.name}/{path.name}")
        return table
    return _read_file(path, choice, encoding, sheet)


def _read_file(path: Path, choice: Choice, encoding: str | None, sheet: str | None) -> TextTable:
    """The columns that are chosen of a file, whose suffix tells its form."""
    data = input_bytes(path)
    name = display_name(path.name)
    suffix = path.suffix.lower()
    if suffix in _NOT_READ:
        raise InputError(f"{name}: found {_NOT_READ[suffix]}")
    if sheet is not None and not is_excel(path):
        raise InputError(f"{name}: found --sheet {sheet}, allowed: with an Excel file")

    if is_excel(path):
        return _read_excel(name, data, choice, sheet)
    if suffix in _JSON_SUFFIXES or (suffix in _TEXT_SUFFIXES and re.match(_JSON_START, data)):
        return _read_json(name, data, encoding)
    if suffix == ".mat":
        return _read_matlab(name, data)
    return read_csv(name, data, choice, encoding)


def input_bytes(path: StrPath, allowed: str = "a CSV file that exists and may be read") -> bytes:
    """The content of a file; `allowed` says in an error what may be read.

    Raises
    ------
    InputError
        If the file cannot be read, is too large, or is a pipe or a device, which may have no end.
    """
    try:
        status = os.stat(path)
        # The system itself refuses to read a folder.
        if not stat.S_ISREG(status.st_mode) and not stat.S_ISDIR(status.st_mode):
            raise OSError(errno.EINVAL, "a pipe or device, not a file")
        if status.st_size > LARGEST_FILE:
            raise OSError(errno.EFBIG, f"{status.st_size} bytes, more than {LARGEST_FILE}")
        return Path(path).read_bytes()
    except (OSError, ValueError) as error:  # a ValueError for a path with a NUL character
        reason = getattr(error, "strerror", error)
        raise InputError(
            f"{visible(str(path))}: cannot be read ({reason}); allowed: {allowed}"
        ) from error


def toml_table(path: StrPath, lines: str) -> Mapping[str, Any]:
    """The contents of a TOML file; `lines` describes the allowed lines.

    Raises
    ------
    InputError
        In one line, if the file cannot be read or is not TOML.
    """
    data = input_bytes(path, f"a TOML file with {lines}")
    try:
        return tomllib.loads(data.decode("utf-8-sig"))  # some editors put a mark in front
    except (ValueError, RecursionError) as error:  # the latter for thousands of brackets
        raise InputError(
            f"{path}: found text that is not TOML ({one_line(error)}), allowed: lines {lines}"
        ) from error


# --- Data frames and records ---------------------------------------------------------------------


def _table_of_frame(frame: Frame) -> TextTable:
    """The table of a pandas or polars DataFrame, whose rows count from 0, as in `iloc`."""
    library = type(frame).__module__.partition(".")[0]
    source = f"{library} {type(frame).__name__}"
    names = [str(name).strip() for name in frame.columns]
    columns = {}
    for index, name in enumerate(names):
        series = frame.iloc[:, index] if hasattr(frame, "iloc") else frame.to_series(index)
        # to_list makes doubles: 0.1 in single precision would read 0.10000000149.
        is_single = str(series.dtype).lower() == "float32"
        values = np.asarray(series, np.float32) if is_single else series.to_list()
        columns[name] = Column.from_texts(name, map(value_text, values))
    rows = np.arange(len(frame))
    return TextTable(source, "", "columns", names, columns, rows, Problems(source))


def _table_of_fields(
    source: str, form: str, head: str, fields_of_records: Iterable[Mapping[str, object]]
) -> TextTable:
    """The table with a column for each key of records, and a row for each record, from 1 on.

    `head` is the place of the names of columns in messages.
    """
    records = []
    names: dict[str, object] = {}  # keys, in the order in which records have them
    for record in fields_of_records:
        names.update(record)
        records.append(record)
        require_size(source, len(names), len(names) * len(records))

    columns = {}
    for name in names:
        texts = [value_text(record.get(name)) for record in records]
        columns[name] = Column.from_texts(name, texts)
    rows = np.arange(1, len(records) + 1)
    return TextTable(form, "", head, list(names), columns, rows, Problems(source))


# --- Excel ---------------------------------------------------------------------------------------


def _read_excel(source: str, data: bytes, choice: Choice, title: str | None) -> TextTable:
    """The table in the sheet with this title, or in the sheet with most of our columns.

    Several sheets with most of our columns are refused, with a question.
    """
    sheets = _excel_sheets(source, data, title or "*")
    heads = _heads_of_tables(sheets, choice)
    title = max(heads, key=lambda other: len(sheets[other]))  # with most rows
    head_index, header = heads[title]
    if len(heads) > 1 and n_chosen(header, choice):
        remedies = [
            Remedy("sheet", "*", "if all sheets are of one study"),
            Remedy("sheet", "{}", "if each sheet is a subject"),
        ]
        remedies += [Remedy("sheet", other) for other in heads]
        titles = join_words(map(display_name, heads))
        raise InputError(f"{source}: the sheets {titles} have tables.", remedies)

    table = table_of_records(source, EXCEL, "", iter(sheets.pop(title)), head_index, header, choice)
    if sheets:
        note = f"sheet {display_name(title)} read, not {join_display_names(sheets)}"
        table = replace(table, notes=(note, *table.notes))
    return table


def sheet_paths(path: StrPath, pattern: str, choice: Choice) -> list[Path]:
    """The paths of the sheets that have the tables of a study, as in study.xlsx/S01.

    Their titles fit a pattern in which * stands for any text. A sheet of notes has fewer of our
    columns, and is left out.
    """
    sheets = _excel_sheets(display_name(Path(path).name), input_bytes(path), pattern)
    return [Path(path, title) for title in _heads_of_tables(sheets, choice)]


def _heads_of_tables(
    sheets: Mapping[str, Sequence[TableRecord]], choice: Choice
) -> dict[str, tuple[int, list[str]]]:
    """The sheets with most of our columns: the index of the record of the names, and the names."""
    heads = {}
    for title, records in sheets.items():
        names = [record_names(cells) for _, cells in records[:MOST_RECORDS]]
        index = header_place(names, choice)
        heads[title] = index, names[index]
    counts = {title: n_chosen(names, choice) for title, (_, names) in heads.items()}
    highest_count = max(counts.values())
    return {title: head for title, head in heads.items() if counts[title] == highest_count}


def _excel_sheets(source: str, data: bytes, pattern: str) -> dict[str, list[TableRecord]]:
    """The records of every visible sheet that is not empty, and whose title fits a pattern.

    Raises
    ------
    InputError
        If the file cannot be read, or no sheet fits.
    """
    from openpyxl import load_workbook

    sheets = {}
    try:
        with warnings.catch_warnings(action="ignore"):
            book = load_workbook(_without_formats(source, data), read_only=True, data_only=True)
            for sheet in book.worksheets:
                if sheet.sheet_state != "visible" or not fnmatchcase(sheet.title, pattern):
                    continue
                records = _sheet_records(source, sheet)
                if records:
                    sheets[sheet.title] = records
    except InputError:
        raise
    except Exception as error:  # of a damaged file the library raises whatever its parser meets
        raise damaged(source, "Excel", error, "one that opens in Excel") from None

    if sheets:
        return sheets
    if pattern == "*":
        raise NoTrialsError(f"{source}: found no table, allowed: a sheet with names and rows")
    titles = join_display_names(book.sheetnames)
    raise InputError(f"{source}: found the sheets {titles}, allowed: one of them")


def _without_formats(source: str, data: bytes) -> io.BytesIO:
    """A workbook without empty cells that have a format, of which there may be millions.

    Formulas without a value become errors.
    """
    compact = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as book, zipfile.ZipFile(compact, "w") as saved:
        unpacked = sum(part.file_size for part in book.infolist())
        if unpacked > LARGEST_FILE:
            raise InputError(
                f"{source}: found {unpacked} bytes unpacked, allowed: at most {LARGEST_FILE}"
            )

        for name in book.namelist():
            part = book.read(name)
            if name.startswith("xl/worksheets/"):
                # Cells and rows that are empty, such as '<c r="B2" s="1"/>' and '<row r="2"/>'.
                part = re.sub(rb'<c [^<>]*\br="[^<>]*/>', b"", part)
                part = re.sub(rb'<row [^<>]*\br="(?:[^<>]*/>|[^<>]*></row>)', b"", part)
                part = re.sub(_NOT_COMPUTED, _ERROR, part)
            saved.writestr(name, part)
    return compact


def _sheet_records(source: str, sheet: Any) -> list[TableRecord]:
    """The texts of each row that is not blank, all of one width, with the number of the row."""
    sheet.reset_dimensions()  # a size that a program left may be smaller than the sheet
    records = []
    width = 0
    for row, values in enumerate(sheet.iter_rows(values_only=True), 1):
        cells = list(map(value_text, values))
        if "".join(cells).strip():
            records.append((row, cells))
        width = max(width, len(cells))
        require_size(source, width, width * len(records))
    return [(row, cells + [""] * (width - len(cells))) for row, cells in records]


# --- JSON ----------------------------------------------------------------------------------------


def _read_json(source: str, data: bytes, encoding: str | None) -> TextTable:
    """The table in a JSON text, see :func:`_json_records`, or in lines with a trial each.

    Row 1 is the first trial; a key that a trial lacks is an empty cell.
    """
    text, label = decoded(source, data, encoding)
    content = _with_shared_fields(_parse_json(source, text))
    records = map(_with_dotted_names, _json_records(source, content, shared={}))
    return _table_of_fields(source, f"JSON, {label}", "keys", records)


def _parse_json(source: str, text: str) -> object:
    """The content of a file; numbers keep their text."""

    def record_of(pairs: Sequence[tuple[str, object]]) -> object:
        """The record of keys and values, each key once; a list where keys count rows from 0."""
        record: Record = {}
        for key, value in pairs:
            name = key.strip()
            if name in record:
                raise InputError(
                    f"{source}: found the key {quoted(name)} twice in a record, allowed: once"
                )
            record[name] = value
        # pandas writes a column as {"0": 7, "1": 8}.
        is_list = list(record) == list(map(str, range(len(record))))
        return list(record.values()) if record and is_list else record

    # Numbers keep their text, so that 0.10 stays '0.10' and 1008 stays '1008'.
    load = partial(json.loads, parse_int=str, parse_float=str, object_pairs_hook=record_of)
    try:
        try:
            return load(text)
        except json.JSONDecodeError:  # perhaps a trial a line
            return [load(line) for line in re.split("[\r\n]+", text) if line.strip()]
    except InputError:  # it is a ValueError, too
        raise
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{source}: found no JSON ({one_line(error)}), "
            "allowed: a list of trials, or a trial a line"
        ) from None


def _with_shared_fields(value: Any) -> Any:
    """A record with the fields of parts that have single values only.

    {"info": {"id": 7}, "trials": [...]} becomes {"id": 7, "trials": [...]}. A record stays as it is
    if a name would be there twice, and so does any other value.
    """
    if not isinstance(value, dict):
        return value
    record: Record = {}
    for key, item in value.items():
        part = _with_shared_fields(item)
        if not isinstance(part, dict) or any(isinstance(cell, _NESTED) for cell in part.values()):
            part = {key: part}
        if not record.keys().isdisjoint(part):
            return value
        record |= part
    return record


def _json_records(
    source: str, value: object, shared: dict[str, object]
) -> Iterator[dict[str, object]]:
    """The trials in a value: a list of trials, a record of columns, or participants with trials.

    Each trial also has the fields `shared` by all trials of its participant.
    """
    if isinstance(value, list):
        for item in value:
            yield from _json_records(source, item, shared)
        return
    if not isinstance(value, dict):
        raise InputError(
            f"{source}: found {quoted(str(value))} in the place of a trial, allowed: a list of "
            "trials, each with the same keys"
        )

    fields = {**shared, **value}
    lists = {key: item for key, item in fields.items() if isinstance(item, list)}
    lengths = set(map(len, lists.values()))
    # Fields that have trials, such as 'trials' of {"id": 7, "trials": [{...}, {...}]}.
    nested = [key for key, item in fields.items() if _has_records(item)]
    if len(nested) == 1:  # a participant with trials
        single_values = {key: item for key, item in fields.items() if not isinstance(item, _NESTED)}
        yield from _json_records(source, fields[nested[0]], single_values)
    elif len(lists) > 1 and len(lengths) == 1:  # columns, as {"s1": [0, 1], "s2": [1, 0]}
        for cells in zip(*lists.values(), strict=True):
            yield {**fields, **dict(zip(lists, cells, strict=True))}
    else:  # a trial
        yield fields


def _with_dotted_names(fields: Record) -> Record:
    """A trial with the fields of its records.

    Examples
    --------
    >>> _with_dotted_names({"id": 7, "interval1": {"ms": 500, "onset": 0}})
    {'id': 7, 'interval1.ms': 500, 'interval1.onset': 0}
    """
    record: Record = {}
    for key, value in fields.items():
        if isinstance(value, dict):
            record |= {f"{key}.{name}": cell for name, cell in value.items()}
        else:
            record[key] = value
    return record


def _has_records(value: object) -> bool:
    """Whether a value is a record or a list of records."""
    first_value = value[0] if isinstance(value, list) and value else value
    return isinstance(first_value, dict)


# --- MATLAB --------------------------------------------------------------------------------------


def _read_matlab(source: str, data: bytes) -> TextTable:
    """The table of a struct, a struct array, or vectors by name; row 1 is the first trial.

    A single value stands in every row.
    """
    variables = _with_shared_fields(matlab_values(source, data))
    records = list(_json_records(source, variables, shared={}))
    # Variables that are no columns are left as they are, in a single record.
    unread = [name for name, value in records[0].items() if isinstance(value, _NESTED)]
    if len(records) == 1 and (unread or not records[0]):
        raise InputError(
            f"{source}: found {join_display_names(unread) or 'nothing'}, no columns of one length, "
            f"allowed: {SAVED}; or, in Python, a pandas data frame that has the columns"
        )
    return _table_of_fields(source, "MATLAB", "variables", records)


def is_excel(path: StrPath) -> bool:
    """Whether a file is an Excel file by its name."""
    return Path(path).suffix.lower() in _EXCEL_SUFFIXES
