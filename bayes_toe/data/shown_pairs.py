"""Which stimuli were shown, row by row."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.data.cells import Cells, Column, Fault, fault_in, number
from bayes_toe.data.columns import empty_fault, is_empty, number_fault, numbers
from bayes_toe.data.read_options import ReadOptions
from bayes_toe.data.study_columns import ISI, stimuli


@dataclass(frozen=True)
class ShownPairs:
    """Who met which stimuli, row by row; s1 and s2 are natural-log intensities, isi seconds, NaN where a cell cannot be read."""

    subject: Column
    first: Column
    second: Column
    s1: FloatArray
    s2: FloatArray
    interval: Column | None = None
    isi: FloatArray | None = None

    @property
    def keys(self) -> list[FloatArray]:
        """What makes a pair."""
        return [self.s1, self.s2, *([] if self.isi is None else [self.isi])]

    @property
    def columns(self) -> list[Column]:
        """The columns of numbers."""
        return [self.first, self.second, *([] if self.interval is None else [self.interval])]


def shown_pairs(cells: Cells, options: ReadOptions) -> ShownPairs:
    """Those of a file; what cannot be read of them :func:`pair_faults` tells."""
    first, second = (cells.columns[ours] for ours in stimuli(options))
    s1, s2 = (_log_intensity(cells, column, options) for column in (first, second))
    interval = cells.columns.get(ISI)
    isi = None if interval is None else _seconds(cells, interval)
    return ShownPairs(cells.columns["subject"], first, second, s1, s2, interval, isi)


def _seconds(cells: Cells, column: Column) -> FloatArray:
    values = numbers(cells, column)
    return np.where(values > 0, values, math.nan)


def _log_intensity(cells: Cells, column: Column, options: ReadOptions) -> FloatArray:
    if options.intensity is None:
        return numbers(cells, column)
    values = [number(text, cells.header.decimal_comma) for text in column.texts]
    return column.spread([_log_ratio(value, options.intensity) for value in values], np.float64)


def _log_ratio(value: float, reference: float) -> float:
    # The difference of logs, because the ratio itself may overflow.
    return math.log(value) - math.log(reference) if value > 0 else math.nan


def pair_faults(cells: Cells, pairs: ShownPairs, asked: BoolArray, options: ReadOptions) -> list[Fault]:
    """Subjects without a name, stimuli and intervals without a number, in the rows that have an answer."""
    kind = "a finite number" if options.intensity is None else "a positive finite number"
    return [
        empty_fault(cells, pairs.subject, asked & is_empty(pairs.subject)),
        number_fault(cells, pairs.first, asked & np.isnan(pairs.s1), kind),
        number_fault(cells, pairs.second, asked & np.isnan(pairs.s2), kind),
        *([] if pairs.interval is None or pairs.isi is None else [_interval_fault(cells, pairs.interval, asked & np.isnan(pairs.isi))]),
    ]


def _interval_fault(cells: Cells, column: Column, bad: BoolArray) -> Fault:
    return fault_in(cells, column, bad, lambda _: "a positive finite number of seconds, in every row or no such column")
