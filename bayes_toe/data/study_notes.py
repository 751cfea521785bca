"""What is said of a study that was read: what was detected, dropped and merged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bayes_toe.arrays import BoolArray, IntArray
from bayes_toe.data.cells import DELIMITERS, Cells, Column
from bayes_toe.data.messages import bare, counted, listed
from bayes_toe.data.read_options import ReadOptions
from bayes_toe.data.shown_pairs import ShownPairs
from bayes_toe.data.study import Subject, distinct_intervals, said_intervals


def format_note(cells: Cells, pairs: ShownPairs) -> str:
    """How the file is written, as it was detected."""
    header = cells.header
    if not header.delimiter:
        return header.encoding
    comma = header.decimal_comma and any("," in text for column in pairs.columns for text in column.texts)
    return f"{DELIMITERS[header.delimiter]}-separated, {header.encoding}{', decimal comma' if comma else ''}"


def interval_notes(pairs: ShownPairs, subjects: Sequence[Subject]) -> list[str]:
    """Which intervals were read: a column that has a meaning is never read in silence."""
    if pairs.interval is None:
        return []
    distinct = distinct_intervals(subjects)
    return [f"{counted(len(distinct), 'interval')} in column {bare(pairs.interval.name)}: {said_intervals(distinct)}"]


def layout_notes(pairs: ShownPairs, options: ReadOptions) -> list[str]:
    """Which rows were asked for, and which columns have another name or another unit."""
    notes = [f"only rows with {bare(text)} in column {bare(name)}" for name, text in options.where.items()]
    notes += [f"column {bare(theirs)} read as {ours}" for ours, theirs in options.columns.items() if theirs != ours]
    if options.intensity is None:
        return notes
    names = [bare(column.name) for column in (pairs.first, pairs.second)]
    return notes + [f"column {name} read as amplitude in units of {float(options.intensity)!r}" for name in names]


def dropped_notes(subject: Column, dropped: BoolArray) -> list[str]:
    """How many trials without a response each subject has, and who has no other."""
    count = np.bincount(subject.codes[dropped], minlength=len(subject.texts))
    total = np.bincount(subject.codes, minlength=len(subject.texts))
    names = ["(no subject)" if text == "" else bare(text) for text in subject.texts]
    each = [f"{names[code]} {count[code]}" for code in np.flatnonzero(count).tolist()]
    gone = [names[code] for code in np.flatnonzero(count == total).tolist() if subject.texts[code]]
    notes = [f"{counted(int(count.sum()), 'trial')} without a response dropped: {listed(each)}"] if each else []
    return notes + ([f"{counted(len(gone), 'subject')} without any response left out: {listed(gone)}"] if gone else [])


def grouping_notes(subject: Column, subjects: Sequence[Subject], n: IntArray) -> list[str]:
    """How many rows of counts were empty, and how many repeated a pair of the same subject."""
    zero = int(np.count_nonzero(n == 0))
    rows = np.bincount(subject.codes[n > 0], minlength=len(subject.texts)).tolist()
    merged = {one.name: count - one.n_pairs for one, count in zip(subjects, rows, strict=True)}
    each = [f"{bare(name)} {count}" for name, count in merged.items() if count]
    notes = [f"{counted(zero, 'row')} with n_trials = 0 left out"] if zero else []
    return notes + ([f"{counted(sum(merged.values()), 'repeated row')} merged: {listed(each)}"] if each else [])
