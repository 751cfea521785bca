"""Columns that every reader of a CSV file checks alike: numbers, names, and the rows where they are not."""

from __future__ import annotations

import math

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.data.cells import Cells, Column, Fault, fault_in, number

#: What a cell may say, in any case, where there is nothing to say.
MISSING_WORDS = frozenset({"", "na", "n/a", "nan", "none", "null"})


def numbers(cells: Cells, column: Column) -> FloatArray:
    """The finite number of every row, NaN where the cell holds none."""
    return column.spread([number(text, cells.header.decimal_comma) for text in column.texts], np.float64)


def number_fault(cells: Cells, column: Column, bad: BoolArray, kind: str = "a finite number") -> Fault:
    """Cells that hold no number of this kind, with the way out where the comma is to blame."""

    def allowed(index: int) -> str:
        text = column.text(index)
        if cells.header.delimiter == "," and "," in text and not math.isnan(number(text, True)):
            return f"{kind}; decimal commas need ';' or tab between cells"
        if "," in text or text.count(".") > 1:
            return f"{kind}, without thousands separators"
        return kind

    return fault_in(cells, column, bad, allowed)


def is_empty(column: Column) -> BoolArray:
    """Whether the cell of each row is empty."""
    return column.spread([text == "" for text in column.texts], np.bool_)


def empty_fault(cells: Cells, column: Column, bad: BoolArray) -> Fault:
    """Cells that are empty and must not be."""
    return fault_in(cells, column, bad, lambda _: "a text that is not empty")


def name_faults(cells: Cells, column: Column) -> list[Fault]:
    """Names that are empty, and names that an earlier row has."""
    first = np.unique(column.codes, return_index=True)[1][column.codes]
    empty, later = is_empty(column), np.arange(len(first)) > first
    repeated = fault_in(cells, column, later & ~empty, lambda index: f"each name once, and row {cells.rows[first[index]]} has it")
    return [empty_fault(cells, column, empty), repeated]
