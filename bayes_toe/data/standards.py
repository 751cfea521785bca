"""Tables of a standard and a comparison: which of the two stimuli came first.

The order of presentation is what an order effect is about. A table that has a standard and a
comparison must therefore say which of them came first: a column names the interval of the standard
(1 or 2), or the standard was always first.
"""

from __future__ import annotations

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.data.column_roles import VOCABULARY
from bayes_toe.data.messages import bare, listed, quoted
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
