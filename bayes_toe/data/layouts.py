"""Stimuli in another layout: a standard and a comparison, or pairs in the names of columns.

The order of presentation is what an order effect is about. A table that has a standard and a
comparison must therefore say which of them came first: a column names the interval of the standard
(1 or 2), or the standard was always first. In a wide table the name of a column, or a cell, tells
both stimuli by a pattern, such as '100_112'.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.data.column_roles import VOCABULARY
from bayes_toe.data.messages import bare, listed, quoted
from bayes_toe.data.options import WIDE_PARTS, ReadOptions
from bayes_toe.data.text_table import Column, TextTable
from bayes_toe.data.validation import is_no_response
from bayes_toe.errors import InputError

_STANDARD_WORDS = VOCABULARY["stimuli"]["standard"]
_COMPARISON_WORDS = VOCABULARY["stimuli"]["comparison"]
_STANDARD_FIRST = frozenset({"1", "1.0", "first", "1st", *_STANDARD_WORDS})
_STANDARD_SECOND = frozenset({"2", "2.0", "second", "2nd", *_COMPARISON_WORDS})
#: What the column of the interval may hold.
ALLOWED_INTERVALS = "1 or 2, the interval of the standard (also first or second)"


class StandardOrder:
    """In which trials the standard came first; s1 is the standard where nothing else is said.

    Parameters
    ----------
    n_rows : int
    column : Column or None
        The interval of the standard; None where the standard was always first.

    Attributes
    ----------
    is_first : ndarray of bool, shape (rows,)
    is_unknown : ndarray of bool, shape (rows,)
        Rows in which the column does not say it.
    """

    def __init__(self, n_rows: int, column: Column | None) -> None:
        self.column = column
        self.is_first = np.ones(n_rows, np.bool_)
        self.is_unknown = np.zeros(n_rows, np.bool_)
        if self.column is not None:
            self.is_first = self.column.map(lambda text: text.lower() in _STANDARD_FIRST, np.bool_)
            is_second = self.column.map(lambda text: text.lower() in _STANDARD_SECOND, np.bool_)
            self.is_unknown = ~(self.is_first | is_second)

    def in_order(self, standard: FloatArray, comparison: FloatArray) -> list[FloatArray]:
        """First and second stimuli of every row."""
        return [
            np.where(self.is_first, standard, comparison),
            np.where(self.is_first, comparison, standard),
        ]

    def by_interval(self, table: TextTable, column: Column, comparison_code: str | None) -> Column:
        """Responses 'comparison' and 'standard' as 'second' and 'first'; other texts stay.

        With the code of 'comparison', the other code of the column is 'standard'.

        Raises
        ------
        InputError
            If no response has the code, or if there are three codes.
        """
        texts = [text for text in column.texts if not is_no_response(text)]
        if comparison_code is not None and (comparison_code not in texts or len(texts) > 2):
            codes = listed([quoted(text) for text in texts])
            raise InputError(
                f"{table.source}: column {bare(column.name)}: found {codes}, allowed: "
                f"{quoted(comparison_code)} for 'comparison' and one other code for 'standard'"
            )
        is_comparison = {}
        for text in texts:
            if comparison_code is not None:
                is_comparison[text] = text == comparison_code
            elif text.lower() in (*_COMPARISON_WORDS, *_STANDARD_WORDS):
                is_comparison[text] = text.lower() in _COMPARISON_WORDS
        is_word = column.map(is_comparison.__contains__, np.bool_)
        is_second = column.map(is_comparison.get, np.bool_) == self.is_first
        n_texts = len(column.texts)
        by_row = np.where(is_word, np.where(is_second, n_texts, n_texts + 1), column.codes)
        return Column.of(column.name, [*column.texts, "second", "first"], by_row)


# --- Pairs in the names of columns ----------------------------------------------------------------

#: The column of the cells of a wide table.
CELL = "cell"
_WIDE_REGEX = {"{first}": r"(?P<first>-?[\d.,]+)", "{second}": r"(?P<second>-?[\d.,]+)", "*": ".*?"}


def pair_of(text: str, pattern: str) -> tuple[str, str] | None:
    """The stimuli that a name or a cell tells by a pattern; None where it does not fit.

    Examples
    --------
    >>> pair_of("q_100_112", "*{first}_{second}"), pair_of("note", "{first}_{second}")
    (('100', '112'), None)
    """
    parts = [_WIDE_REGEX.get(part) or re.escape(part) for part in WIDE_PARTS.split(pattern)]
    match = re.fullmatch("".join(parts), text)
    return None if match is None else (match["first"], match["second"])


def wide_columns(names: Sequence[str], pattern: str) -> list[str]:
    """The columns whose names tell a pair."""
    return [name for name in names if pair_of(name, pattern) is not None]


def with_pairs(table: TextTable, options: ReadOptions) -> tuple[TextTable, ReadOptions]:
    """A wide table with a row for each pair, and options that read it.

    Columns whose names tell a pair become rows, in the order of the columns; their cells are in the
    column `cell`. Where no name tells one, the cells of a single column must tell pairs.

    Raises
    ------
    InputError
        If neither names nor the cells of one column fit the pattern, or a name is there twice.
    """
    pattern = options.wide or ""
    names = wide_columns(table.names, pattern)
    if not names:
        return _with_split_cells(table, options), options
    for name in names:
        if names.count(name) > 1:
            finding = f"found {names.count(name)} columns of this name"
            raise InputError(f"{table.source}: column {bare(name)}: {finding}, allowed: one")
    columns = {}
    for name, column in table.columns.items():
        if name not in names:
            columns[name] = Column(name, column.texts, np.repeat(column.codes, len(names)))
    texts, codes = list[str](), []
    for name in names:
        codes.append(table.columns[name].codes + len(texts))
        texts += table.columns[name].texts
    columns[CELL] = Column.of(CELL, texts, np.column_stack(codes).ravel())
    which_pair = np.tile(np.arange(len(names)), len(table.rows))
    rows = np.repeat(table.rows, len(names))
    if CELL not in (*options.columns.values(), options.correct):
        options = replace(options, columns={**options.columns, "response": CELL})
    note = f"{len(names)} columns named as {quoted(pattern)} read as pairs"
    other_names = [name for name in table.names if name not in names]
    table = replace(
        table, names=[*other_names, CELL], columns=columns, rows=rows, notes=(*table.notes, note)
    )
    return _with_stimuli(table, options, names, which_pair), options


def _with_split_cells(table: TextTable, options: ReadOptions) -> TextTable:
    """The table with the stimuli that the cells of one column tell."""
    pattern = options.wide or ""
    fitting = []
    for name, column in table.columns.items():
        if all(pair_of(text, pattern) is not None for text in column.texts):
            fitting.append(name)
    if len(fitting) != 1:
        finding = f"{len(fitting)} columns" if fitting else "no column"
        raise InputError(
            f"{table.source}: found {finding} with names or cells as --wide {quoted(pattern)}, "
            "allowed: columns whose names tell the pair, or one whose cells do"
        )
    column = table.columns[fitting[0]]
    names = [name for name in table.names if name != column.name]
    note = f"cells of column {bare(column.name)} read as pairs"
    table = replace(table, names=names, notes=(*table.notes, note))
    return _with_stimuli(table, options, column.texts, column.codes)


def _with_stimuli(
    table: TextTable, options: ReadOptions, texts: Sequence[str], codes: IntArray
) -> TextTable:
    """The table with columns of the stimuli that these texts tell."""
    pairs = [pair_of(text, options.wide or "") or ("", "") for text in texts]
    columns = dict(table.columns)
    names = [options.name(ours) for ours in options.stimuli]
    for name, stimuli in zip(names, zip(*pairs, strict=True), strict=True):
        columns[name] = Column.of(name, stimuli, codes)
    return replace(table, names=[*table.names, *names], columns=columns)
