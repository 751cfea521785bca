"""A table as columns of text, and the reader of CSV files.

`TextTable` has the columns and collects problems with row and column. `read_csv` finds the
encoding, the delimiter and the row of names. Cells stay text, so that subject '01' stays '01' and
subject 'NA' stays 'NA'. :mod:`bayes_toe.data.validation` makes numbers of them.
"""

from __future__ import annotations

import codecs
import csv
import io
import itertools
import re
from array import array
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from operator import itemgetter
from sys import intern
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import BoolArray, IndexArray, IntArray, run_starts
from bayes_toe.data.messages import MAX_LINES, Note, Texts, display_name, one_line, plural, quoted
from bayes_toe.errors import InputError, NoTrialsError, Remedy

#: A pandas or polars DataFrame, neither of which is imported to know one.
Frame: TypeAlias = Any
#: Which columns are read, of the names in a header.
Choice: TypeAlias = Callable[[Texts], Collection[str]]
#: The first row of a record, and its cells; none if its quotes cannot be read.
TableRecord: TypeAlias = tuple[int, list[str]]
#: The form of a spreadsheet.
EXCEL = "Excel"
#: In a table whose columns were pairs: the name of the old column of each cell, and the cell.
PAIR = "name of the pair"
CELL = "cell"
DELIMITERS = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar", " ": "space"}

#: The largest table; Excel has as many columns. A larger table would fill the memory.
_MOST_COLUMNS = 2**14
_MOST_CELLS = 5 * 10**7
#: How texts begin in which trials are no rows, by what they are and what is read in their place.
#: Presentation writes the first line of its log above other tables, too.
_NO_TABLES = {
    "a web page, allowed: its table as CSV": r"(?i)\s*<(?:!doctype|html|table)",
    "a log of E-Prime, allowed: its trials as CSV, which E-DataAid exports": (
        r"\*\*\* Header Start \*\*\*"
    ),
    "a log of Presentation, allowed: its trials as CSV, such as those that a scenario prints to an "
    "output_file, since the rows of a log are events": "Scenario - [^\0]{0,2000}\tEvent Type\t",
}
#: Records among which the names are looked for.
MOST_RECORDS = 10
#: A column that is not chosen and has more texts marks no rows, and is left out.
_MOST_TEXTS = 2**14

#: NUL, and halves of characters, which no file can hold.
_NO_TEXT = re.compile("[\0\ud800-\udfff]")

_TEXT_ALLOWED = (
    "text in UTF-8 or UTF-16, or the encoding that --encoding names, such as shift_jis, gb18030, "
    "euc_kr, cp1251, cp1254 or mac_roman"
)
#: Lines below the last row, also those that saveAsText of PsychoPy writes there, and lines between
#: rows such as '# session 2'; '#2,' may begin a row. The group is the end of the line above, which
#: stays; a pattern that began with a lookbehind would be tried at each character of the file.
_REMARKS = (
    r"(?i)([\r\n])(?:(?:(?<=[\r\n])(?:#[^\r\n]*|\W*(?:end of|eof)\b[^,;\t\r\n]*|"
    r"extraInfo[,;\t]*[\r\n][^\0]*)\s*)+\Z|"
    r"#(?:[ #][^\r\n]*)?(?=[\r\n]))"
)
#: Finds, among names in lines, a name that two or more columns without names follow, and then
#: another name. Each of these columns has a trial of the row, as saveAsText of PsychoPy writes it.
_TRIALS_IN_A_ROW = r"(?m)^(.+_raw)(\n{3,})(?=.)"
#: What else may be wrong where rows have too many cells.
_DECIMAL_COMMA = "Between commas, a number with a decimal comma needs quotation marks"


#: A cell that holds a number, and is no name of a column.
_NUMBER = re.compile(r"[-+]?[\d.,]*\d(?:[eE][-+]?\d+)?")

#: Types of pandas' own missing values. They equal nothing, and comparisons with them give no truth
#: values.
_MISSING = ("NAType", "NaTType")


@dataclass(frozen=True)
class Column:
    """One column: its name, its distinct texts, and which of them each row has."""

    name: str
    texts: list[str]
    codes: IntArray

    @classmethod
    def from_texts(cls, name: str, texts: Iterable[str], codes: IntArray | None = None) -> Column:
        """The column of texts without the space around them, which may make some of them equal.

        `codes` are the index of the text of each row; without them, each row has its own text.
        """
        code_of_text: dict[str, int] = {}  # a new text has the next code
        new_codes = np.array(
            [code_of_text.setdefault(text.strip(), len(code_of_text)) for text in texts], np.int64
        )
        if codes is not None:
            new_codes = new_codes[codes]
        return cls(name, list(code_of_text), new_codes)

    def with_plain_codes(self) -> Column:
        """The column with codes such as '1' in the place of '1.0', see :func:`plain_code`."""
        return Column.from_texts(self.name, map(plain_code, self.texts), self.codes)

    def __str__(self) -> str:
        return f"column {display_name(self.name)}"

    def map(self, convert: Callable[[str], object], dtype: type = bool) -> npt.NDArray[Any]:
        """One value per row; each distinct text is converted once."""
        return np.array(list(map(convert, self.texts)), dtype)[self.codes]

    def matches(self, texts: Collection[str]) -> BoolArray:
        """Whether each row has one of these texts."""
        return self.map(texts.__contains__)

    def only(self, rows: BoolArray | IndexArray) -> Column:
        """The column of these rows, without the texts that only others have."""
        codes = self.codes[rows]
        used_codes = np.flatnonzero(np.bincount(codes))
        texts = [self.texts[code] for code in used_codes]
        return Column(self.name, texts, np.searchsorted(used_codes, codes))

    def rows_by_text(self, rows: IndexArray) -> dict[str, IndexArray]:
        """The rows with each text, of these rows; texts that no row has are left out."""
        sorted_rows = rows[np.argsort(self.codes[rows], kind="stable")]
        # A split needs the starts of all parts but the first; of no rows it makes an empty part.
        parts = np.split(sorted_rows, run_starts(self.codes[sorted_rows])[1:])
        return {self.text(part[0]): part for part in parts if len(part)}

    def text(self, index: int) -> str:
        """The text of one row."""
        return self.texts[self.codes[index]]

    def counts(self, texts: Iterable[str]) -> Texts:
        """Texts with the number of their rows, as messages show them: "'j' (40)"."""
        n_rows = Counter(self.codes.tolist())
        return [f"{quoted(text)} ({n_rows[self.texts.index(text)]:,})" for text in texts]


def plain_code(text: str) -> str:
    """A code without what pandas, spreadsheets and PsychoPy add to it.

    Examples
    --------
    >>> plain_code("1.0"), plain_code("0,0"), plain_code("['j']"), plain_code("['j', 'k']")
    ('1', '0', 'j', "['j', 'k']")
    """
    match = re.fullmatch(r"\['([^']+)'\]|([-+]?\d+)[.,]0*", text)
    return match[1] or match[2] if match else text


def value_text(value: object) -> str:
    """The text of a value, as pandas writes it into a CSV file.

    A missing value is an empty text. A character that no file can hold becomes U+FFFD.

    Examples
    --------
    >>> value_text(2.0), value_text(True), value_text(None), value_text(np.float32(0.1))
    ('2', '1', '', '0.1')
    """
    if isinstance(value, np.float32):
        value = float(str(value))  # as it is written, not its nearest neighbour among the doubles
    elif isinstance(value, np.generic):
        value = value.item()
    if value is None or type(value).__name__ in _MISSING:
        return ""

    if isinstance(value, float | Decimal) and value != value:  # NaN
        return ""
    if isinstance(value, bool | float) and value % 1 == 0:
        value = int(value)  # True is '1', and 2.0 is '2'
    return _NO_TEXT.sub("\ufffd", str(value))


#: In the place of a row, for problems of a whole table, which come first.
_HEAD_ROW = -1


class Problems:
    """Problems of a source, reported together in the order of its rows."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.count = 0
        self._first_lines = list[tuple[int, str]]()  # a row and a problem each
        self.remedies: list[Remedy] = []

    def add(self, lines: Iterable[tuple[int, str]], count: int = 1) -> None:
        """Add `count` problems; `lines` has the first of them with their rows."""
        # Messages have the first problems only.
        self._first_lines = sorted([*self._first_lines, *lines], key=itemgetter(0))[:MAX_LINES]
        self.count += count

    def ask(self, question: str, remedies: Iterable[Remedy]) -> None:
        """Add a problem of the whole table, with options that solve it."""
        # Questions come before the problems of rows, so that this is the index of the problem.
        index = sum(row == _HEAD_ROW for row, _ in self._first_lines)
        self.remedies += [remedy._replace(question=index) for remedy in remedies]
        self.add([(_HEAD_ROW, question)])

    def refuse(self) -> None:
        """Raise the first ten problems as one InputError, with the number of further problems."""
        if not self.count:
            return
        problems = [f"{self.source}: {text}" for _, text in self._first_lines]
        n_more = self.count - len(problems)
        if n_more > 0:
            problems.append(f"... and {plural(n_more, 'more problem')}")
        raise InputError(problems, self.remedies)


def damaged(source: str, form: str, error: Exception | str, allowed: str) -> InputError:
    """The refusal of a file that its library cannot read."""
    return InputError(
        f"{source}: found a damaged {form} file ({one_line(error)}), allowed: {allowed}"
    )


#: Columns by their names in a source, or by ours.
Columns: TypeAlias = Mapping[str, Column]


@dataclass(frozen=True)
class TextTable:
    """The columns that were asked for, and the row at which each record starts.

    `columns` has the columns by their names in the source. `form` is an encoding, a format or a
    library. `delimiter` is empty if the source is no CSV file. `head` is the place of the names in
    messages.
    """

    form: str
    delimiter: str
    head: str
    names: list[str]
    columns: Columns
    rows: IntArray
    problems: Problems
    notes: Texts = ()

    @property
    def source(self) -> str:
        """The name of the file, or of the frame, in messages."""
        return self.problems.source

    @property
    def decimal_comma(self) -> bool:
        """Whether the delimiter leaves the comma free to be a decimal sign."""
        return self.delimiter not in ("", ",") or self.form == EXCEL

    @property
    def grouping_sign(self) -> str:
        """The sign that may group thousands where the other one is decimal; empty if none may."""
        if self.form == EXCEL:
            return ","
        # Programs in languages with a decimal comma separate cells by semicolons. Between commas a
        # cell with a comma stands in quotation marks.
        return {";": ".", ",": ",", "\t": ",", " ": ","}.get(self.delimiter, "")

    def only(self, rows: BoolArray | IndexArray, *notes: str) -> TextTable:
        """The table of these rows, with more notes; a row may come more than once."""
        columns = {name: column.only(rows) for name, column in self.columns.items()}
        return replace(self, rows=self.rows[rows], columns=columns, notes=(*self.notes, *notes))

    def require(self, lines: Texts, remedies: Iterable[Remedy] = ()) -> None:
        """Refuse a table with problems of its head, or without rows.

        `lines` are the problems of the head, the row of names. `remedies` solve the last of these.
        Rows that cannot be split are reported later, with the problems of cells.
        """
        for line in lines:
            separator = ", " if line.startswith("column") else ": "
            options = remedies if line == lines[-1] else ()
            self.problems.ask(f"{self.head}{separator}{line}", options)

        if lines:
            self.problems.refuse()
        if not len(self.rows) and self.problems.count == 0:
            raise NoTrialsError(
                f"{self.source}: {self.head}: found no row below it, allowed: at least one row"
            )

    def fault(self, column: Column, is_bad: BoolArray, rule: str | Callable[[int], str]) -> None:
        """Note the distinct cells of a column that are bad, with their count and first row.

        `is_bad` has the shape (records,). `rule` says what is allowed; it is a function if this
        depends on the index of the record.
        """
        records_of_text = column.rows_by_text(np.flatnonzero(is_bad))
        lines = []
        for records in sorted(records_of_text.values(), key=itemgetter(0))[:MAX_LINES]:
            index = records[0]
            row = self.rows[index]
            allowed = rule if isinstance(rule, str) else rule(index)

            finding = quoted(column.text(index))
            location = str(column)
            if column.name == CELL and PAIR in self.columns:
                # The file has the cell in a column that is named after the pair.
                location = f"column {display_name(self.columns[PAIR].text(index))}"
            if len(records) > 1:
                finding += f" in {len(records):,} rows, the first is row {row}"
            else:
                location = f"row {row}, {location}"
            lines.append((row, f"{location}: found {finding}, allowed: {allowed}"))
        self.problems.add(lines, len(records_of_text))


def require_size(source: str, n_columns: int, n_cells: int) -> None:
    """Refuse a table that is too large, before its cells are made."""
    if n_columns > _MOST_COLUMNS or n_cells > _MOST_CELLS:
        raise InputError(
            f"{source}: found {n_columns:,} columns with {n_cells:,} cells, allowed: at most "
            f"{_MOST_COLUMNS:,} columns and {_MOST_CELLS:,} cells"
        )


def repeated_columns(names: Texts, wanted: Iterable[str]) -> list[str]:
    """Problems of wanted columns that a table has more than once, a line each."""
    return [
        f"column {display_name(name)}: found {names.count(name)} columns of this name, allowed: one"
        for name in wanted
        if names.count(name) > 1
    ]


def n_chosen(names: Texts, choice: Choice) -> int:
    """How many distinct names are read, of these, by a choice; numbers are no names."""
    chosen_names = set(names).intersection(choice(names))
    return sum(not _NUMBER.fullmatch(name) for name in chosen_names)


def names_or_numbers(cells: list[str], choice: Choice) -> list[str]:
    """The names of columns in a record, or their numbers where it is a row of the table.

    A row has several numbers, and at most one of the names that are read, which may be a response.
    """
    numbers = list(filter(_NUMBER.fullmatch, cells))
    # pandas numbers columns without names from 0, and these numbers are then names. The column of
    # its numbers of rows has no name.
    names = list(filter(None, cells))
    is_numbered = names == list(map(str, range(len(names))))
    if len(numbers) < 2 or n_chosen(cells, choice) > 1 or is_numbered:
        return cells
    return list(map(str, range(1, len(cells) + 1)))


# --- CSV ------------------------------------------------------------------------------------------


def read_csv(source: str, data: bytes, choice: Choice, encoding: str | None = None) -> TextTable:
    """The table in a text; the delimiter is the one under which most columns are chosen."""
    text, label = decoded(source, data, encoding)
    text, n_remarks = _without_remarks(source, text)
    delimiter, head_index, header = _layout(text, choice)
    records = _records(text, delimiter)
    table = table_of_records(source, label, delimiter, records, head_index, header, choice)
    if n_remarks:
        table = replace(table, notes=(*table.notes, "remarks below rows left out"))
    return table


def table_of_records(
    source: str,
    form: str,
    delimiter: str,
    records: Iterator[TableRecord],
    head_index: int,
    header: list[str],
    choice: Choice,
) -> TextTable:
    """The table in records that are not blank, of which one has the names in `header`.

    The record with the names has the index `head_index`; records above it are left out.
    """
    records = itertools.islice(records, head_index, None)
    first_row, head = next(records, (0, []))
    if first_row == 0:
        raise NoTrialsError(
            f"{source}: found an empty file, allowed: a header and at least one row"
        )
    if not head:
        raise InputError(f"{source}: {_broken(first_row, head, width=0)}")
    require_size(source, len(head), len(head))
    names = names_or_numbers(header, choice)
    if names != header:  # the header is a row of the table
        records = itertools.chain([(first_row, head)], records)

    problems = Problems(source)
    # By the name of columns of several trials, a line end for each trial in a row.
    newlines = dict(re.findall(_TRIALS_IN_A_ROW, "\n".join(names)))
    rows, texts = _texts_by_name(records, names, newlines, problems)
    if delimiter == "," and problems.count > max(MAX_LINES, len(rows)):  # most rows
        raise InputError(
            f"{source}: {problems.count} rows have another number of cells than row {first_row}, "
            f"which has the names. {_DECIMAL_COMMA}"
        )
    if len(names) > len(head) and not _are_row_numbers(texts[names[0]]):
        advice = f". {_DECIMAL_COMMA}" if delimiter == "," else ""
        raise InputError(
            f"{source}: row {rows[0]}: found {len(names)} cells below {len(head)} names, "
            f"allowed: a name for each column{advice}"
        )

    chosen_names = {*choice(names), ""}  # also the numbers of rows, which have no name
    columns = {}
    for name in list(texts):
        column = Column.from_texts(name, texts.pop(name))  # a large file fits into memory once
        if name in chosen_names or len(column.texts) <= _MOST_TEXTS:
            columns[name] = column

    notes: list[str] = []
    if head_index:
        notes.append(f"rows above row {first_row} left out")
    if newlines:
        notes.append("columns without names read as further trials of a row")
    table = TextTable(form, delimiter, f"row {first_row}", names, columns, rows, problems, notes)
    return _without_headers(table)


def _without_headers(table: TextTable) -> TextTable:
    """The table without rows that repeat its names, as where files stand below each other."""
    is_header = np.all([column.matches([name]) for name, column in table.columns.items()], axis=0)
    if not is_header.any():
        return table
    return table.only(~is_header, Note((is_header.sum(), "repeated header"), " left out"))


def _are_row_numbers(texts: list[str]) -> bool:
    """Whether texts in front of several rows number them from 1, as R does, or from 0.

    Other texts may be a cell too many.
    """
    from_0 = list(map(str, range(len(texts) + 1)))
    return texts == from_0[1:] or (len(texts) > 1 and texts == from_0[:-1])


def _without_remarks(source: str, text: str) -> tuple[str, int]:
    """The text without lines that are no part of a table, and how many remarks below names it had.

    Logs and web pages, whose lines are no trials, are refused.
    """
    for finding, pattern in _NO_TABLES.items():
        if re.match(pattern, text):
            raise InputError(f"{source}: found {finding}")
    # Spreadsheets name the delimiter in a first line, such as 'sep=;'. It becomes an empty line, so
    # that rows keep their numbers.
    text = re.sub(r"\Asep=[,;\t]?(?=\r|\n)", "", text)
    # The same with remarks above the names, as of Expyriment: '#e Experiment'. A single line that
    # begins with '#' may have the names.
    text = re.sub(r"\A(?:#.*[\r\n]+){2,}", lambda lines: re.sub("[^\r\n]", "", lines[0]), text)
    # Remarks below or between rows, such as 'END OF FILE' of Gorilla. Line ends before them stay.
    return re.subn(_REMARKS, r"\1", text)


def _texts_by_name(
    records: Iterable[TableRecord], names: Texts, newlines: Mapping[str, str], problems: Problems
) -> tuple[IntArray, dict[str, list[str]]]:
    """The row of each record, and the texts by name; of columns with one name, the last is read.

    A record has one trial, or several where PsychoPy writes each trial in a column without a name
    behind a name such as 'key.keys_raw'; `newlines` are what :data:`_TRIALS_IN_A_ROW` finds.
    Records that cannot be split into a cell for each name are problems. Empty cells behind these
    cells do not count, since loops write a delimiter behind each cell.
    """
    index_of_name = {name: index for index, name in enumerate(names)}
    texts = {name: list[str]() for name in index_of_name}
    indices_of_trials = []  # of each trial of a record, the index of the cell by name
    for i in range(min(map(len, newlines.values()), default=1)):
        own_indices = {name: index_of_name[name] + i for name in newlines}
        indices_of_trials.append(index_of_name | own_indices)
    rows = array("q")
    width = len(names)
    for row, cells in records:
        if len(cells) < width or any(cells[width:]):
            problems.add([(row, _broken(row, cells, width))])
            continue

        for indices in indices_of_trials:
            rows.append(row)
            for name, index in indices.items():
                texts[name].append(intern(cells[index]))  # most texts are there many times
    return np.array(rows, np.int64), texts


def _layout(text: str, choice: Choice) -> tuple[str, int, list[str]]:
    """The delimiter, the index of the record with the names, and the names.

    Under this delimiter most names are chosen; of several such delimiters, it makes most cells. R
    writes names of rows without a name of their own, so that the next record has one cell more. A
    loop that writes a delimiter behind each name makes a last name that is empty, and has no cells
    below.
    """
    beginning = text[: 2**22]  # a large text is not copied for each delimiter
    layouts = []
    for delimiter in DELIMITERS:
        first_records = itertools.islice(_records(beginning, delimiter), MOST_RECORDS + 1)
        records = [record_names(cells) for _, cells in first_records] or [[]]
        index = header_place(records[:MOST_RECORDS], choice)
        names = records[index]
        next_cells = [*records, names][index + 1]
        cells = names
        # Spaces in a name make no cells. Numbers have no spaces: those around numbers do.
        if delimiter == " ":
            cells = list(filter(_NUMBER.fullmatch, names)) or list(
                filter(_NUMBER.fullmatch, next_cells)
            )
        fit = n_chosen(names, choice), len(cells)

        width = len(next_cells)
        if width == len(names) + 1 and next_cells[-1]:
            names = ["", *names]
        elif not any(names[width:]):
            names = names[:width]
        layouts.append((fit, (delimiter, index, names)))
    _, layout = max(layouts, key=itemgetter(0))  # the first of delimiters that fit equally well
    return layout


def record_names(cells: Texts) -> list[str]:
    """The cells of a record as names of columns."""
    return [" ".join(cell.split()) for cell in cells]


def header_place(records: Sequence[Texts], choice: Choice) -> int:
    """The index of the record with the names: the first one, unless a later one is clearer."""
    counts = [n_chosen(record, choice) for record in records]
    if counts[0] > 1:  # a single name may be a word of a title
        return 0
    if max(counts) >= counts[0] + 2:
        return counts.index(max(counts))

    # Below titles and lines such as 'date,1 May', the names are the fullest of the records that are
    # as long as the last record. If the fullest record has a number, it is a row of the table.
    rows = [record for record in records if len(record) == len(records[-1])]
    names = max(rows, key=lambda cells: len(list(filter(None, cells))))
    return 0 if any(map(_NUMBER.fullmatch, names)) else records.index(names)


def decoded(source: str, data: bytes, encoding: str | None = None) -> tuple[str, str]:
    """The text of a file and its encoding.

    Without `encoding` a byte-order mark decides. Without a mark the file is UTF-16 if every other
    of its first bytes is NUL, else UTF-8 if it can be decoded so, and Windows-1252 if nothing in it
    looks like UTF-8. Bytes that cannot be decoded and NUL characters are refused.
    """
    if data.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise InputError(
            f"{source}: found a spreadsheet or an archive, allowed: its sheet saved as .xlsx or CSV"
        )

    codec, label = _encoding_of(data) if encoding is None else (encoding, encoding)
    try:
        text = data.decode(codec)
    except UnicodeDecodeError as error:
        finding = f"byte 0x{error.object[error.start]:02x}, not {label}"
        text_before = error.object[: error.start].decode(codec, errors="ignore")
    except (LookupError, ValueError):  # no encoding, or an encoding that decodes nothing
        raise InputError(
            f"--encoding: found {quoted(codec)}, allowed: a name such as utf-8, cp1252 or latin-1"
        ) from None
    else:
        # Only a given encoding may leave halves of characters. Without it, the slow search is for
        # NUL alone.
        match = _NO_TEXT.search(text) if encoding or "\0" in text else None
        if match is None:
            return text, label
        finding = f"the character {quoted(match[0])}"
        text_before = text[: match.start()]

    row = 1 + len(re.findall(r"\r\n|\r|\n", text_before))
    raise InputError(f"{source}: row {row}: found {finding}, allowed: {_TEXT_ALLOWED}")


def _encoding_of(data: bytes) -> tuple[str, str]:
    """The codec of the bytes, and the name of the encoding in messages."""
    if data.startswith(codecs.BOM_UTF8):
        return "utf-8-sig", "UTF-8"
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16", "UTF-16"

    # In UTF-16, every other byte of Latin letters is NUL.
    for codec, zeros in (("utf-16-le", data[1:8:2]), ("utf-16-be", data[:8:2])):
        if zeros == bytes(4):
            return codec, "UTF-16"

    try:
        data.decode("utf-8")
    except UnicodeDecodeError:
        # A damaged UTF-8 file has other characters that are valid there.
        is_damaged = not data.decode("utf-8", errors="ignore").isascii()
        if not is_damaged and b"\0" not in data:
            return "cp1252", "Windows-1252 (--encoding NAME if that is wrong)"
    return "utf-8", "UTF-8"


def _records(text: str, delimiter: str) -> Iterator[TableRecord]:
    """First physical row and cells of every record that is not blank.

    A record whose quotes cannot be read has no cells.
    """
    if delimiter == " ":
        # Spaces that fill up a row are no cell; spaces in front of a cell are skipped.
        text = re.sub(r" +(?=[\r\n]|\Z)", "", text)

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
        except csv.Error:
            yield row, []
            continue
        if "".join(cells).strip():
            yield row, cells


def _broken(row: int, cells: Texts, width: int) -> str:
    """The problem of a row that cannot be split into as many cells as the header has."""
    if not cells:
        return (
            f"row {row}: found a quote that is never closed, or text after it, "
            "allowed: quotes around whole cells, doubled inside"
        )
    n_cells = plural(len(cells), "cell")
    problem = f"row {row}: found {n_cells}, allowed: {plural(width, 'cell')} as in the header"
    if len(cells) == 1:
        problem += ". Delete notes below the table"
    return problem
