"""Any source of a table as columns of text: CSV files, Parquet, MATLAB, data frames of pandas or polars.

Everything is read as text first, so that subject '01' stays '01' and subject 'NA' stays 'NA'
whatever the source. What the columns mean, and what of it is allowed, is for
:mod:`bayes_toe.data.validation` and its users to say, once for all sources.

MATLAB files hold trials as fields of one struct, of vectors or of a struct array, or else vectors
of one length, by name; a single value stands in every row, such as the subject whose file it is.
MATLAB's own table objects are in no documented format: they are refused, with what to save instead.
"""

from __future__ import annotations

import codecs
import csv
import errno
import importlib.util
import io
import itertools
import os
import re
import stat
import warnings
from array import array
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from operator import itemgetter
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import BoolArray, IntArray
from bayes_toe.data.messages import MOST_SHOWN, bare, counted, listed, quoted, visible
from bayes_toe.data.whole_files import require_settled
from bayes_toe.errors import InputError, Remedy

#: A pandas or polars DataFrame, neither of which is imported to know one.
Frame: TypeAlias = Any
#: Which columns are read, of the names in a header.
Choice: TypeAlias = Callable[[Sequence[str]], Collection[str]]
DELIMITERS = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar"}
#: Bytes. A study of 10^7 trials has some 300 million, pairs and covariates of 10^5 subjects some 5
#: million.
LARGEST_STUDY, LARGEST_SMALL_FILE = 2**30, 2**25

_ENCODINGS = (
    (codecs.BOM_UTF8, "utf-8", "UTF-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le", "UTF-16"),
    (codecs.BOM_UTF16_BE, "utf-16-be", "UTF-16"),
    (b"", "utf-8", "UTF-8"),
)
_DELIMITER_LINE = re.compile(r"\Asep=[,;\t]?(?=\r|\n)")
_TEXT_ALLOWED = "text in UTF-8, or in UTF-16 that starts with its byte-order mark"
# What the csv module says, and what we say.
_SPLIT_ERRORS = {
    "end of data": "a quote that is never closed",
    "expected after": "text after a closing quote",
    "field larger": "a cell of more than 131072 characters (a quote that is never closed?)",
}
_MISSING = (
    "NAType",
    "NaTType",
)  # pandas' own; they equal nothing, and say so in words that are no truth values
_SAVED = "one struct, or vectors of one length: S = table2struct(T, 'ToScalar', true); save('trials.mat', '-struct', 'S', '-v7')"


@dataclass(frozen=True)
class Column:
    """One column: its name in the source, its distinct texts, and the place of each row's text among them."""

    name: str
    texts: list[str]
    codes: IntArray

    @classmethod
    def of(cls, name: str, texts: Iterable[str], codes: npt.ArrayLike) -> Column:
        """The column whose texts have space around them, so that some may be the same."""
        seen: dict[str, int] = {}
        places = np.array([seen.setdefault(text.strip(), len(seen)) for text in texts], np.int64)
        return cls(name, list(seen), places[np.asarray(codes, np.int64)])

    def map(self, convert: Callable[[str], object], dtype: type) -> npt.NDArray[Any]:
        """One value per row; each distinct text is converted once."""
        return np.asarray(np.array([convert(text) for text in self.texts], dtype)[self.codes])

    def only(self, rows: BoolArray) -> Column:
        """The column of these rows, without the texts that only others have."""
        codes, places = np.unique(self.codes[rows], return_inverse=True)
        return Column(
            self.name, [self.texts[code] for code in codes.tolist()], places.astype(np.int64)
        )

    def text(self, index: int) -> str:
        """The text of one row."""
        return self.texts[int(self.codes[index])]


class Problems:
    """What is wrong with a source, to be told at once in the order of its rows."""

    def __init__(self, source: str) -> None:
        self.source, self.count, self._shown = source, 0, list[tuple[int, str]]()
        self.remedies: list[Remedy] = []

    def add(self, lines: Iterable[tuple[int, str]], count: int | None = None) -> None:
        """Rows and what is said of them; the first of `count`."""
        some = list(lines)
        self._shown += some
        self.count += len(some) if count is None else count

    def refuse(self) -> None:
        """Raise ten of them as one InputError, and how many more there are."""
        if self.count == 0:
            return
        shown = sorted(self._shown, key=itemgetter(0))[:MOST_SHOWN]
        more = (
            [f"... and {counted(self.count - len(shown), 'more problem')}"]
            if self.count > len(shown)
            else []
        )
        problems = [f"{self.source}: {text}" for _, text in shown]
        raise InputError([*problems, *more], self.remedies)


@dataclass(frozen=True)
class TextTable:
    """The columns that were asked for, by their names in the source, and the row that each record starts at there.

    `form` is an encoding, a format or a library, `delimiter` empty where it is no CSV file; `head`
    is the place of the names in messages.
    """

    form: str
    delimiter: str
    head: str
    names: list[str]
    columns: dict[str, Column]
    rows: IntArray
    problems: Problems

    @property
    def source(self) -> str:
        """What messages call the file, or the frame."""
        return self.problems.source

    @property
    def python(self) -> bool:
        """Whether it is a frame, so that messages name arguments and not options of the command line."""
        return self.head == "columns"

    @property
    def decimal_comma(self) -> bool:
        """Whether the delimiter leaves the comma free to be a decimal sign."""
        return self.delimiter in (";", "\t", "|")

    def require(self, lines: Sequence[str]) -> None:
        """Refuse a head of which something is to be said, together with the rows that cannot be split; and a table without rows."""
        if lines:
            self.problems.add(
                (0, f"{self.head}{', ' if line.startswith('column') else ': '}{line}")
                for line in lines
            )
            self.problems.refuse()
        if not len(self.rows) and self.problems.count == 0:
            found = "a header only" if self.delimiter else "no row below it"
            raise InputError(
                f"{self.source}: {self.head}: found {found}, allowed: at least one "
                f"row{' below it' if self.delimiter else ''}"
            )

    def fault(self, column: Column, bad: BoolArray, allowed: str | Callable[[int], str]) -> None:
        """Note the cells of a column that are bad; `allowed` says what would have been right, of the index of a record where it differs."""
        wrong = np.flatnonzero(bad)
        lines = []
        for index in wrong[:MOST_SHOWN].tolist():
            right = allowed if isinstance(allowed, str) else allowed(index)
            row, found = int(self.rows[index]), quoted(column.text(index))
            lines.append(
                (row, f"row {row}, column {bare(column.name)}: found {found}, allowed: {right}")
            )
        self.problems.add(lines, len(wrong))


def read_table(
    source: str | Path | Frame, choice: Choice, largest: int = LARGEST_SMALL_FILE
) -> TextTable:
    """The columns that are chosen of a CSV file, a file whose name ends in .parquet or .mat, or a data frame.

    The delimiter of a CSV file, comma, semicolon or tab, is the one under which most columns of its
    first record are chosen. An InputError where the source cannot be read, has more than `largest`
    bytes, is not text in UTF-8 or marked UTF-16, is empty, or its head cannot be split.
    """
    if hasattr(source, "collect") and not hasattr(source, "to_series"):
        raise InputError(
            f"{type(source).__name__}: found a lazy frame, allowed: a frame, which its collect() "
            "gives"
        )
    if hasattr(source, "columns") and (hasattr(source, "iloc") or hasattr(source, "to_series")):
        return _of_frame(source, choice)
    if not isinstance(source, str | os.PathLike):
        raise InputError(
            f"found {quoted(type(source).__name__)}, allowed: the path of a file, or a pandas or "
            "polars DataFrame"
        )
    path = Path(source)
    require_parquet(path)
    require_settled(path)
    try:
        data = input_bytes(path, largest)
    except (OSError, ValueError) as error:  # a value where there is a NUL character in the path
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(
            f"{visible(str(path))}: cannot be read ({reason}), allowed: a CSV file that exists and "
            "may be read"
        ) from error
    kinds = {".parquet": _of_parquet, ".mat": _of_matlab}
    return kinds.get(path.suffix.lower(), _of_csv)(bare(path.name), data, choice)


def _places(found: Sequence[str], choice: Choice) -> dict[str, int]:
    """Where the first column of each chosen name is."""
    chosen = choice(found)
    return {name: found.index(name) for name in dict.fromkeys(found) if name in chosen}


def input_bytes(path: str | Path, largest: int = LARGEST_STUDY) -> bytes:
    """The content of a file.

    An OSError where it is larger than `largest`, or a pipe or a device, which may have no end.
    """
    status = os.stat(path)
    if not stat.S_ISREG(status.st_mode) and not stat.S_ISDIR(status.st_mode):
        raise OSError(errno.EINVAL, "a pipe or device, not a file")
    if status.st_size > largest:
        raise OSError(errno.EFBIG, f"{status.st_size} bytes, more than {largest}")
    return Path(path).read_bytes()


# --- CSV ------------------------------------------------------------------------------------------


def _of_csv(source: str, data: bytes, choice: Choice) -> TextTable:
    text, label = _decoded(source, data)
    # Spreadsheets name the delimiter in a line of its own; an empty line leaves row numbers as they
    # are.
    text = _DELIMITER_LINE.sub("", text, count=1)
    heads = {delimiter: next(_records(text, delimiter), (0, [])) for delimiter in DELIMITERS}
    cells = {
        one: [] if isinstance(head, csv.Error) else [cell.strip() for cell in head]
        for one, (_, head) in heads.items()
    }

    def fit(one: str) -> tuple[int, int]:
        return len(_places(cells[one], choice)), len(cells[one])

    delimiter = max(cells, key=fit)
    (first, head), found, problems = heads[delimiter], cells[delimiter], Problems(source)
    if isinstance(head, csv.Error):
        raise InputError(f"{source}: {_broken(first, head, 0)}")
    if not first:
        raise InputError(f"{source}: found an empty file, allowed: a header and at least one row")
    places = _places(found, choice)
    # Files of experiments are much wider than what is read of them, and most texts are there many
    # times.
    rows, codes = array("q"), {name: array("q") for name in places}
    texts: dict[str, dict[str, int]] = {
        name: defaultdict(itertools.count().__next__) for name in places
    }
    wanted = [(codes[name].append, texts[name], place) for name, place in places.items()]
    for row, record in itertools.islice(_records(text, delimiter), 1, None):
        if isinstance(record, csv.Error) or len(record) != len(found):
            problems.add(
                [(row, _broken(row, record, len(found)))] if problems.count < MOST_SHOWN else [], 1
            )
            continue
        rows.append(row)
        for append, code, place in wanted:
            append(code[record[place]])
    columns = {name: Column.of(name, texts[name], codes[name]) for name in places}
    return TextTable(
        label, delimiter, f"row {first}", found, columns, np.array(rows, np.int64), problems
    )


def _decoded(source: str, data: bytes) -> tuple[str, str]:
    """The text of a file and its encoding; what cannot be decoded, and NUL characters, are refused.

    So are Excel's and other archives.
    """
    if data.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise InputError(
            f"{source}: found a spreadsheet or an archive, allowed: {_TEXT_ALLOWED}; save its "
            "sheet as CSV"
        )
    mark, codec, label = next(entry for entry in _ENCODINGS if data.startswith(entry[0]))
    try:
        text = data[len(mark) :].decode(codec)
    except UnicodeDecodeError as error:
        offset = len(mark) + error.start
        before = data[len(mark) : offset].decode(codec, errors="ignore")
        what = f"byte 0x{data[offset]:02x} at offset {offset}, not {label}"
    else:
        if "\0" not in text:
            return text, label
        before = text.partition("\0")[0]
        what = f"a NUL character at offset {len(mark) + len(before.encode(codec))}"
    row = 1 + len(re.findall(r"\r\n|\r|\n", before))
    raise InputError(f"{source}: row {row}: found {what}, allowed: {_TEXT_ALLOWED}")


def _records(text: str, delimiter: str) -> Iterator[tuple[int, list[str] | csv.Error]]:
    """First physical row and cells of every record that is not blank.

    The error where a row cannot be split.
    """
    # Not strict, the csv module would read '"12"3' as 123 and a quote left open as one giant cell,
    # without a word.
    reader = csv.reader(
        io.StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=True, strict=True
    )
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


def _broken(row: int, record: list[str] | csv.Error, width: int) -> str:
    """What is said about a row that cannot be split, or not into as many cells as the header has."""
    if not isinstance(record, csv.Error):
        return f"row {row}: found {counted(len(record), 'cell')}, allowed: {counted(width, 'cell')} as in the header"
    found = next((said for part, said in _SPLIT_ERRORS.items() if part in str(record)), str(record))
    return f"row {row}: found {found}, allowed: quotes around whole cells, doubled inside"


# --- Frames, MATLAB, Parquet: values --------------------------------------------------------------


def _of_values(
    named: tuple[str, str, str], names: list[str], values: dict[str, list[Any]], rows: Sequence[int]
) -> TextTable:
    """The table of values by column; `named` are its source, its form and its head."""
    source, form, head = named
    columns, problems = {}, Problems(source)
    for name, some in values.items():
        texts = [_text(value) for value in some]
        if None in texts:
            at = texts.index(None)
            found = f"found {quoted(str(some[at]))} of type {type(some[at]).__name__}"
            problems.add(
                [
                    (
                        rows[at],
                        f"row {rows[at]}, column {bare(name)}: {found}, allowed: text, numbers or "
                        "truth values",
                    )
                ]
            )
        columns[name] = Column.of(
            name, ("" if text is None else text for text in texts), range(len(texts))
        )
    problems.refuse()
    return TextTable(form, "", head, names, columns, np.array(rows, np.int64), problems)


def _of_frame(frame: Any, choice: Choice) -> TextTable:
    """Rows count from 0, as in `frame.iloc`."""
    source = f"{type(frame).__module__.partition('.')[0]} {type(frame).__name__}"
    found, values = [str(name).strip() for name in frame.columns], {}
    for name, place in _places(found, choice).items():
        values[name] = (
            frame.iloc[:, place].tolist()
            if hasattr(frame, "iloc")
            else frame.to_series(place).to_list()
        )
    return _of_values((source, source, "columns"), found, values, range(len(frame)))


def _of_matlab(source: str, data: bytes, choice: Choice) -> TextTable:
    """Row 1 is the first trial; a single value stands in every row."""
    columns = _matlab_columns(source, _matlab_variables(source, data))
    rows = max(map(len, columns.values()))
    values = {
        name: columns[name] * (rows // len(columns[name])) for name in _places([*columns], choice)
    }
    return _of_values((source, "MATLAB", "variables"), [*columns], values, range(1, rows + 1))


def _matlab_variables(source: str, data: bytes) -> dict[str, Any]:
    from scipy.io import loadmat

    try:
        with warnings.catch_warnings(action="ignore"):
            found = loadmat(io.BytesIO(data), simplify_cells=True)
    except NotImplementedError:
        raise InputError(
            f"{source}: found a file of version 7.3, allowed: one saved with '-v7'"
        ) from None
    except Exception as error:  # of a damaged file the library raises whatever its parser meets
        said = bare(" ".join(str(error).split())[:200])
        raise InputError(
            f"{source}: found a damaged MATLAB file ({said}), allowed: one that MATLAB has saved "
            "with '-v7'"
        ) from None
    if "__function_workspace__" in found:
        raise InputError(
            f"{source}: found a table or another object of MATLAB's own, allowed: {_SAVED}"
        )
    return {name: value for name, value in found.items() if not name.startswith("__")}


def _matlab_columns(source: str, found: dict[str, Any]) -> dict[str, list[Any]]:
    """Columns of one length or of one value."""
    structs = {name: value for name, value in found.items() if isinstance(value, dict)}
    arrays = {
        name: value
        for name, value in found.items()
        if np.ndim(value) == 1 and len(value) and isinstance(value[0], dict)
    }
    if len(structs) + len(arrays) > 1:
        several = listed([bare(name) for name in found if name in {**structs, **arrays}])
        raise InputError(f"{source}: found the structs {several}, allowed: {_SAVED}")
    for struct in structs.values():
        found = struct
    for trials in arrays.values():
        found = {name: np.array([trial[name] for trial in trials], object) for name in trials[0]}
    columns = {name: np.atleast_1d(np.asarray(value, object)) for name, value in found.items()}
    lengths = {
        name: column.size if column.size == max(column.shape) else 0
        for name, column in columns.items()
    }
    most = max(lengths.values(), default=0)
    wrong = [
        bare(name) for name, length in lengths.items() if length not in (1, most) or not length
    ]
    if wrong or not most:
        raise InputError(
            f"{source}: found "
            f"{f'{listed(wrong)}, not a column of {most}' if wrong else 'nothing'}, allowed: "
            f"{_SAVED}"
        )
    return {name: column.ravel().tolist() for name, column in columns.items()}


def _of_parquet(source: str, data: bytes, choice: Choice) -> TextTable:
    """The schema stands for a header.

    Row 1 is the first record; a missing value is an empty cell.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(pa.BufferReader(data), page_checksum_verification=True)
        found, values = [name.strip() for name in table.column_names], {}
        for name, place in _places(found, choice).items():
            column = table.column(place)
            # In double precision 0.1 of single precision is another number.
            values[name] = (
                column.cast(pa.string()) if pa.types.is_float32(column.type) else column
            ).to_pylist()
    except (
        pa.ArrowException,
        OSError,
        ValueError,
        KeyError,
        IndexError,
        OverflowError,
        MemoryError,
    ) as error:
        said = bare(" ".join(str(error).split())[:200])
        raise InputError(
            f"{source}: found a damaged Parquet file ({said}), allowed: one that a Parquet writer "
            "has finished"
        ) from None
    return _of_values((source, "Parquet", "schema"), found, values, range(1, table.num_rows + 1))


def _text(value: object) -> str | None:
    """What a CSV file would have; None where a value has no text."""
    plain = value.item() if isinstance(value, np.generic) else value
    if plain is None or type(plain).__name__ in _MISSING or plain != plain:
        return ""
    if isinstance(plain, bool):
        return str(int(plain))
    if isinstance(plain, float):
        return str(int(plain)) if plain.is_integer() else repr(plain)
    text = str(plain) if isinstance(plain, str | int | Decimal) else None
    return None if text is not None and "\0" in text else text


def is_parquet(path: str | Path) -> bool:
    """Whether a file is one by its name."""
    return Path(path).suffix.lower() == ".parquet"


def require_parquet(path: str | Path) -> None:
    """Refuse a Parquet file, to be read or written, where there is no pyarrow, with what to install; any other file passes."""
    if is_parquet(path) and importlib.util.find_spec("pyarrow") is None:
        found = "found a Parquet file and no pyarrow"
        raise InputError(
            f"{bare(Path(path).name)}: {found}, allowed: pip install 'bayes_toe[parquet]', or a "
            "CSV file"
        )
