"""Numbers, counts and shares of cells; cells without a number are noted as problems.

`read_numbers` reads a small table of numbers.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray, IntArray, StrPath
from bayes_toe.data.messages import Texts, display_name, join_quoted
from bayes_toe.data.read_table import read_table
from bayes_toe.data.text_table import Column, TextTable, repeated_columns

#: Most trials of a subject; with more, a log-likelihood is not exact in double precision.
LARGEST_COUNT = 10**12
#: What stands between a subject and a level in the name of a unit.
CONDITION_SEPARATOR = "@"
#: What a cell may say, in any case, where there is nothing to say.
MISSING_WORDS = frozenset({"", "na", "n/a", "nan", "none", "null", "undefined"})
# Alternatives never overlap, so that a cell of 100,000 digits costs linear time.
_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
# '5.0' is how pandas writes a 5 beside missing cells; '5.000' may be a German five thousand, so it
# is not read at all.
_COUNT = r"\+?0*([0-9]{1,16})(?:\.(?!000$)0*)?"
# Spaces, apostrophes and narrow spaces between groups of three digits: '1 360' or "1'360".
_SPACES = "['\u2019 \u00a0\u2009\u202f]"
_GROUPED_BY_SPACE = re.compile(rf"[+-]?\d{{1,3}}(?:{_SPACES}\d{{3}})+(?![\d' ])")
_ROUNDING = 1e-6  # of a number of trials in double precision
#: How errors of spreadsheets begin.
_ERRORS = ("#N/A", "#REF!", "#VALUE!", "#DIV/0!", "#NAME?", "#NUM!", "#NULL!")
#: A spreadsheet runs a cell that begins so as a formula.
_FORMULA_SIGNS = ("=", "+", "-", "@", "\t", "\r")


def number(text: str, decimal_comma: bool = False) -> float:
    """The finite number that a cell holds; NaN if it holds no such number.

    Examples
    --------
    >>> number("2.5e-1"), number("-0,5", True), number("1_0"), number("1e999")
    (0.25, -0.5, nan, nan)
    >>> number("1'360"), number("\u22120.3")
    (1360.0, -0.3)
    """
    plain = text.replace("\u2212", "-")  # the minus sign of word processors
    if _GROUPED_BY_SPACE.match(plain):
        plain = re.sub(_SPACES, "", plain)
    if decimal_comma:
        plain = plain.replace(",", ".")
    value = float(plain) if _NUMBER.fullmatch(plain) else math.nan
    # 1e999 is infinite, and -0.0 + 0.0 is 0.0.
    return value + 0.0 if math.isfinite(value) else math.nan


def number_by_sign(text: str, decimal: str) -> float:
    """The number in a cell with this decimal sign; the other sign groups thousands.

    Examples
    --------
    >>> number_by_sign("1.050", ","), number_by_sign("1.050", "."), number_by_sign("1.05", ",")
    (1050.0, 1.05, nan)
    """
    grouping = "," if decimal == "." else "."
    # Groups of three digits at the beginning, and no further sign behind them: '1.050' or '1.050,5'
    # where the point groups thousands.
    if re.match(rf"[-+−]?\d{{1,3}}(?:[{grouping}]\d{{3}})+(?!\d)(?!.*[{grouping}])", text):
        text = text.replace(grouping, "")
    return math.nan if grouping in text else number(text, decimal_comma=decimal == ",")


def whole_number(text: str, decimal_comma: bool = False) -> int:
    """The whole number that a cell holds; -1 if it holds no such number.

    Examples
    --------
    >>> whole_number("5"), whole_number("5.0"), whole_number("5.000"), whole_number("5.5")
    (5, 5, -1, -1)
    """
    match = re.fullmatch(_COUNT, text.replace(",", ".") if decimal_comma else text)
    count = int(match[1]) if match else -1
    return count if count <= LARGEST_COUNT else -1


def is_missing(text: str) -> bool:
    """Whether a cell is empty, or says that it has nothing to say."""
    return text.lower() in MISSING_WORDS


def is_formula(text: str) -> bool:
    """Whether a spreadsheet would run a cell without its apostrophes; '-1' is only a number.

    Examples
    --------
    >>> is_formula("=A1"), is_formula("'@left"), is_formula("-1")
    (True, True, False)
    """
    cell = text.lstrip("'")
    return cell.startswith(_FORMULA_SIGNS) and _NUMBER.fullmatch(cell) is None


def bare_names(table: TextTable, column: Column) -> Column:
    """Names of a CSV file without the apostrophe that keeps a spreadsheet from running them.

    All names stay as they are if two of them would become the same.
    """
    if table.delimiter == "":
        return column  # only in a CSV file is the apostrophe a part of the cell
    texts = [text.removeprefix("'") if is_formula(text) else text for text in column.texts]
    return replace(column, texts=texts) if len(set(texts)) == len(texts) else column


def numbers(table: TextTable, column: Column) -> FloatArray:
    """The finite number of every row; NaN where the cell holds no such number."""
    return column.map(lambda text: number(text, table.decimal_comma), float)


def column_counts(table: TextTable, column: Column) -> IntArray:
    """The whole number of every row; -1, and a problem, where the cell holds no such number."""
    counts = column.map(lambda text: whole_number(text, table.decimal_comma), np.int64)
    table.fault(column, counts < 0, "a whole number from 0 to 10^12, without thousands separators")
    return counts


def has_shares(table: TextTable, column: Column) -> bool:
    """Whether a column has numbers from 0 to 1, and not only 0 and 1, or signs of per cent."""
    if "%" in "".join(column.texts):
        return True
    shares = numbers(table, column)
    return bool(((shares >= 0.0) & (shares <= 1.0)).all() and (shares % 1.0 > 0.0).any())


def counts_of_shares(table: TextTable, column: Column, n: IntArray) -> IntArray:
    """The counts that the shares in a column are of n trials, shape (rows,).

    A share of no count is a problem. The shares are percentages if one of them is larger than 1 or
    has a sign of per cent. All shares are rounded to the decimals of the most precise share.
    """
    shares = column.map(lambda text: number(text.rstrip(" %"), table.decimal_comma), float)
    has_percent_sign = "%" in "".join(column.texts)
    largest_share = 100.0 if has_percent_sign or (shares > 1.0).any() else 1.0

    finite = shares[np.isfinite(shares)]
    n_decimals = 0  # of the most precise share; a double has 16 digits
    while n_decimals < 16 and (finite.round(n_decimals) != finite).any():
        n_decimals += 1

    # Rounding changes a share by half a unit of its last decimal at most.
    largest_error = 0.5 * 10.0**-n_decimals / largest_share * n
    exact_counts = shares / largest_share * n
    counts = np.rint(exact_counts)
    # With an error beyond one half, another count has the same share.
    is_precise = largest_error <= 0.5
    is_near = abs(exact_counts - counts) <= largest_error + _ROUNDING
    is_count = is_precise & is_near & (counts >= 0) & (counts <= n)

    table.fault(
        column,
        ~is_count & (n > 0),  # a number of trials that cannot be read has a problem of its own
        lambda index: f"a share that makes a whole number of {n[index]} trials",
    )
    return np.nan_to_num(counts).astype(np.int64)


def empty(column: Column) -> BoolArray:
    """Whether the cell of each row is empty."""
    return column.matches([""])


def require_numbers(
    table: TextTable, column: Column, is_bad: BoolArray, kind: str = "a finite number"
) -> None:
    """Add a problem for each bad cell, which holds no number of this kind."""
    # Of a column of words, such as names of files, the first word is enough.
    if is_bad.all() and len(np.unique(column.codes)) > 3:
        kind += ", which no cell of the column is"
        is_bad = column.matches([column.text(0)])
    elif "," in "".join(column.only(is_bad).texts):
        kind += ", with a decimal point and no thousands separators"
    table.fault(column, is_bad, kind)


def require_texts(
    table: TextTable, column: Column, rows: BoolArray | None = None, *, once: bool = False
) -> None:
    """Add a problem for each empty cell in these rows, or in all.

    If each text may stand only `once`, add a problem for each text that an earlier row has.
    """
    is_checked = np.ones(len(column.codes), bool) if rows is None else rows
    is_error = column.map(lambda text: text.startswith(_ERRORS))
    table.fault(column, is_error & is_checked, "a text, and no error of a spreadsheet")

    is_empty = empty(column)
    rule = "a text that is not empty"
    if 2 * is_empty.sum() > len(is_empty):  # most cells, as where cells are merged
        rule += "; repeat the text of merged cells in each row"
    table.fault(column, is_empty & is_checked, rule)

    if once:
        _, first_row_of_code = np.unique(column.codes, return_index=True)
        first_row = first_row_of_code[column.codes]  # with the text of each row
        is_repeated = np.arange(len(first_row)) > first_row
        table.fault(
            column,
            is_repeated & ~is_empty,
            lambda index: f"each name once, and row {table.rows[first_row[index]]} has it",
        )


# --- Small tables of numbers: a design, a population, pairs to predict, true parameters -----------


def read_numbers(
    source: StrPath | TextTable,
    names: Texts,
    key: str | None = None,
    *,
    optional: Texts = (),
    gaps: bool = False,
) -> tuple[list[str], dict[str, FloatArray]]:
    """The texts of the column `key`, and other columns as numbers by name, shape (rows,) each.

    `source` is a path, or a table with these columns that was read before. The columns `names` must
    be there, and the columns `optional` are read if they are there; other columns are ignored. The
    texts of `key` are distinct; without `key` there are no texts. Numbers are finite; those of the
    column `n_trials` are whole numbers of at least 1. With `gaps` empty cells are NaN. An
    InputError has a line per problem of the file, ten at most, with row and column.
    """
    required = names if key is None else (key, *names)
    table = table_with(source, required, optional)
    # Where all columns but the key are optional, at least one must be there.
    if not names and table.columns.keys() <= {key}:
        table.require(
            [
                f"found {join_quoted(table.names)}, allowed: {', '.join(required)} and "
                f"some of {', '.join(optional)}"
            ]
        )

    if key is not None:
        require_texts(table, table.columns[key], once=True)

    columns = {}
    for name, column in table.columns.items():
        if name == key:
            continue
        values = numbers(table, column)
        if name == "n_trials":
            is_bad = ~((values >= 1) & (values % 1 == 0))  # NaN is bad, too
            kind = "a whole number of at least 1"
        else:
            is_bad = np.isnan(values)
            kind = "a finite number"
        if gaps:
            is_bad &= ~empty(column)
        require_numbers(table, column, is_bad, kind)
        columns[name] = values

    table.problems.refuse()
    if key is None:
        return [], columns
    return bare_names(table, table.columns[key]).map(str, object).tolist(), columns


def table_with(
    source: StrPath | TextTable, required: Texts, optional: Texts | None = None
) -> TextTable:
    """The table of a path, or a table, with columns of these names alone, each of them once.

    A required column that is missing is refused. Without `optional`, all columns with a name stay.
    """
    if isinstance(source, TextTable):
        table = source
    elif optional is None:
        table = read_table(source, set)
    else:
        table = read_table(source, {*required, *optional}.intersection)
    if optional is None:
        optional = list(filter(None, table.names))

    names = dict.fromkeys([*required, *optional])
    problems = repeated_columns(table.names, names)
    for name in required:
        if name not in table.names:
            problems.append(
                f"column {display_name(name)}: missing, found {join_quoted(table.names)}, "
                "allowed: a column of this name"
            )
    table.require(problems)
    columns = {name: column for name, column in table.columns.items() if name in names}
    return replace(table, columns=columns)
