"""Studies as they come in: CSV files of trials or of counts, read strictly and reported by row.

Nothing is guessed in silence: what was detected, dropped or merged is in the study's notes, and what cannot be used is
refused with all problems of the file at once.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray, IntArray, run_starts
from bayes_toe.data.answers import Answers, Reading, order_of_trials
from bayes_toe.data.cells import (
    DELIMITERS,
    LARGEST_COUNT,
    LARGEST_STUDY,
    Cells,
    Column,
    Fault,
    Frame,
    Header,
    fault_in,
    number,
    read_cells,
    read_header,
    refuse,
    whole_number,
)
from bayes_toe.data.columns import MISSING_WORDS, empty_fault, is_empty, number_fault, numbers
from bayes_toe.data.messages import MOST_SHOWN, bare, counted, listed, quoted
from bayes_toe.data.read_options import COLUMNS, LOOKED_AT, ReadOptions, looks_like, subject_in
from bayes_toe.data.several_files import read_together
from bayes_toe.data.study import Study, Subject, distinct_intervals, said_intervals, subjects_of_rows
from bayes_toe.errors import InputError

_SYNTHETIC, _ISI = "synthetic", "isi"
_EQUAL_WORDS = frozenset({"equal", "same", "1"})
_DIFFERENT_WORDS = frozenset({"different", "0"})
_TRUE_WORDS = frozenset({"1", "true", "yes"})
_EQUAL, _DIFFERENT, _MISSING, _UNKNOWN = 1, 0, -1, -2
_SWITCH = re.compile(r"([01])[.,]0*")


def read_study(path: str | Path | Frame | Sequence[str | Path | Frame], options: ReadOptions | None = None) -> Study:
    r"""The study in a CSV file, or a data frame, of trials or of counts; the header tells which.

    Trials: ``subject,s1,s2,response``, the response 'equal' or 'different' (also same/different, 1/0). Counts:
    ``subject,s1,s2,n_equal,n_trials``. s1 and s2 are natural-log intensities. A column ``isi`` is the inter-stimulus interval in seconds,
    and makes the same stimuli at another interval another pair. Columns ``block`` (any text) and ``trial`` (numbers, over all blocks or
    within each) change no count: they tell how answers are looked at before they are pooled. Other columns are ignored.

    Parameters
    ----------
    path : str, Path, pandas.DataFrame or polars.DataFrame
        Comma, semicolon or tab between cells; UTF-8, or UTF-16 with a byte-order mark. Or a Parquet file by its suffix, .parquet (pyarrow,
        the extra `parquet`): the same columns, of text or numbers; its rows count from 1. Or MATLAB trials by their suffix, .mat, see
        :mod:`bayes_toe.data.matlab`. Rows of a frame count from 0. Several files or frames in a list make one study, see
        :mod:`bayes_toe.data.several_files`.
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
    if isinstance(path, list | tuple):
        return read_together(path, lambda one: read_study(one, options))
    header, text = read_header(path, frozenset(options.columns.get(ours, ours) for ours in COLUMNS), LARGEST_STUDY)
    places, problems = _places(header, options)
    subject = _subject_of_file(header, path, options)
    cells = _rows_asked_for(read_cells(header, text, places, problems), options)
    if subject is not None:
        cells.columns["subject"] = Column("subject", [subject], np.zeros(len(cells.rows), np.int64))
    return _trial_study(cells, options) if "response" in cells.columns else _count_study(cells, options)


# --- Which columns --------------------------------------------------------------------------------


def _places(header: Header, options: ReadOptions) -> tuple[dict[str, int], list[str]]:
    """Where each column that we read is, and what is wrong with the header."""
    named = {ours: options.columns.get(ours, ours) for ours in COLUMNS}
    needed = _needed(header.names, named, options)
    lines = [*_conflict(named, needed), *_read_twice(named, needed), *_where_problems(header, options)]
    if options.subject_from is not None:
        needed.remove("subject")
        if named["subject"] in header.names:
            lines.append(f"column {bare(named['subject'])}: found together with --subject-from, allowed: one of them")
    for ours in COLUMNS:
        count = header.names.count(named[ours])
        if count == 0 and (ours in needed or ours in options.columns):
            lines.append(_missing(header, named, ours))
        elif count > 1 and ours in needed:
            lines.append(f"column {bare(named[ours])}: found {count} columns of this name, allowed: one")
    places = {ours: header.names.index(named[ours]) for ours in needed if named[ours] in header.names}
    marked = {_SYNTHETIC: header.names.index(_SYNTHETIC)} if _SYNTHETIC in header.names else {}
    asked = {_asked(name): header.names.index(name) for name in options.where if name in header.names}
    return places | marked | asked, [f"{header.place}, {line}" for line in lines]


def _where_problems(header: Header, options: ReadOptions) -> list[str]:
    found, missing = listed([quoted(name) for name in header.names]), [name for name in options.where if header.names.count(name) != 1]
    return [f"column {bare(name)}: --where needs one column of this name, found {found}, allowed: one of these" for name in missing]


def _asked(name: str) -> str:
    """The key of a column by which rows are chosen; no column of ours has such a name."""
    return f"where {name}"


def _subject_of_file(header: Header, path: object, options: ReadOptions) -> str | None:
    """The subject where the name of the file tells it; None where a column does."""
    if options.subject_from is None:
        return None
    found = None if header.python else subject_in(Path(str(path)), options.subject_from)
    if found is None:
        raise InputError(f"{header.source}: found no subject in its name, allowed: a file named as --subject-from {options.subject_from}")
    return found


def _rows_asked_for(cells: Cells, options: ReadOptions) -> Cells:
    """The rows that are to be read; all but them are left out before anything is checked.

    Raises
    ------
    InputError
        Where a column has the text that is asked for in no row.
    """
    kept = np.ones(len(cells.rows), np.bool_)
    columns = dict(cells.columns)
    for name, text in options.where.items():
        column = columns.pop(_asked(name))
        if text not in column.texts:
            found = listed([*map(quoted, column.texts)])
            raise InputError(
                f"{cells.header.source}: column {bare(name)}: found {found}, allowed: {quoted(text)}, as --where has it, in some row"
            )
        kept &= column.spread([one == text for one in column.texts], np.bool_)
    if options.where and not kept.any():
        raise InputError(f"{cells.header.source}: found no row that is as --where has it in all of {', '.join(options.where)}")
    return (
        cells
        if not options.where
        else Cells(cells.header, {ours: one.only(kept) for ours, one in columns.items()}, cells.rows[kept], cells.fault)
    )


def _needed(names: Sequence[str], named: Mapping[str, str], options: ReadOptions) -> list[str]:
    """Our names of the columns that this header calls for, and of those that it may have."""
    extra = [_ISI] if named[_ISI] in names else []
    # No inference reads these: twice in the header or named as something else, they are left out like any other column.
    others = [named[ours] for ours in COLUMNS if ours not in LOOKED_AT]
    extra += [ours for ours in LOOKED_AT if named[ours] not in others and names.count(named[ours]) == 1]
    counts = [ours for ours in ("n_equal", "n_trials") if named[ours] in names]
    if named["response"] in names:
        return ["subject", *_stimuli(options), "response", *counts, *extra]
    return ["subject", *_stimuli(options), *(("n_equal", "n_trials") if counts else ("response",)), *extra]


def _stimuli(options: ReadOptions) -> tuple[str, str]:
    return ("s1", "s2") if options.intensity is None else ("i1", "i2")


def _conflict(named: Mapping[str, str], needed: Sequence[str]) -> list[str]:
    counts = [bare(named[ours]) for ours in needed if ours in ("n_equal", "n_trials")]
    if "response" not in needed or not counts:
        return []
    response, both = bare(named["response"]), f"{bare(named['n_equal'])} and {bare(named['n_trials'])}"
    allowed = f"{response} alone (one row per trial) or {both} alone (one row per pair)"
    return [f"column {response}: found together with {' and '.join(counts)}, allowed: {allowed}"]


def _missing(header: Header, named: Mapping[str, str], ours: str) -> str:
    """What is said about a column that the header lacks, with the way out that fits."""
    names, found = header.names, listed([quoted(name) for name in header.names])
    theirs = next((bare(name) for name in names if name not in named.values() and looks_like(name, ours)), "NAME")
    hint = "a column of this name, or " + (
        f"ReadOptions(columns={{{ours!r}: {theirs!r}}})" if header.python else f"--columns {ours}={theirs}"
    )
    if ours in ("s1", "s2") and any(named[other] in names for other in ("i1", "i2")):
        hint += f"; the amplitudes {bare(named['i1'])}, {bare(named['i2'])} need " + (
            "ReadOptions(intensity=REF)" if header.python else "--intensity REF"
        )
    if ours in ("i1", "i2") and any(named[other] in names for other in ("s1", "s2")):
        hint += f"; the log intensities {bare(named['s1'])}, {bare(named['s2'])} are read without " + (
            "intensity" if header.python else "--intensity"
        )
    if ours == "subject" and theirs == "NAME" and not header.python:
        hint += "; or --subject-from '{}.csv', where the name of the file tells it"
    if ours == "response":
        hint += f"; or counts in {bare(named['n_equal'])} and {bare(named['n_trials'])}"
    return f"column {bare(named[ours])}: missing, found {found}, allowed: {hint}"


def _read_twice(named: Mapping[str, str], needed: Sequence[str]) -> list[str]:
    """Columns of the file that --columns would have stand for two of ours."""
    lines = []
    for theirs in dict.fromkeys(named[ours] for ours in needed):
        roles = [ours for ours in needed if named[ours] == theirs]
        if len(roles) > 1:
            lines.append(f"column {bare(theirs)}: found as {' and as '.join(roles)}, allowed: one meaning per column")
    return lines


# --- Pairs ----------------------------------------------------------------------------------------


def _log_ratio(value: float, reference: float) -> float:
    # The difference of logs, because the ratio itself may overflow.
    return math.log(value) - math.log(reference) if value > 0 else math.nan


@dataclass(frozen=True)
class _Pairs:
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


def _pairs(cells: Cells, options: ReadOptions) -> _Pairs:
    first, second = (cells.columns[ours] for ours in _stimuli(options))
    s1, s2 = (_log_intensity(cells, column, options) for column in (first, second))
    interval = cells.columns.get(_ISI)
    isi = None if interval is None else _seconds(cells, interval)
    return _Pairs(cells.columns["subject"], first, second, s1, s2, interval, isi)


def _seconds(cells: Cells, column: Column) -> FloatArray:
    values = numbers(cells, column)
    return np.where(values > 0, values, math.nan)


def _log_intensity(cells: Cells, column: Column, options: ReadOptions) -> FloatArray:
    if options.intensity is None:
        return numbers(cells, column)
    values = [number(text, cells.header.decimal_comma) for text in column.texts]
    return column.spread([_log_ratio(value, options.intensity) for value in values], np.float64)


def _pair_faults(cells: Cells, pairs: _Pairs, asked: BoolArray, options: ReadOptions) -> list[Fault]:
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
    if word in MISSING_WORDS:
        return _MISSING
    # Where '0' was declared to mean equal, '0.0' must not count as different by default.
    if any(word == _word(code) for code in codes if code is not None):
        return _UNKNOWN
    if word in _EQUAL_WORDS and options.equal_code is None:
        return _EQUAL
    return _DIFFERENT if word in _DIFFERENT_WORDS and options.different_code is None else _UNKNOWN


def _allowed_answers(options: ReadOptions, header: Header) -> str:
    equal = "equal, same, 1" if options.equal_code is None else quoted(options.equal_code)
    different = "different, 0" if options.different_code is None else quoted(options.different_code)
    codes = "ReadOptions(equal_code=..., different_code=...)" if header.python else "--equal-code, --different-code"
    return f"{equal} (equal) or {different} (different), or empty; other codes by {codes}"


def _trial_study(cells: Cells, options: ReadOptions) -> Study:
    pairs, response = _pairs(cells, options), cells.columns["response"]
    answer = response.spread([_answer(text, options) for text in response.texts], np.int64)
    asked = answer != _MISSING  # rows without an answer, such as instruction screens, may hold anything else
    unknown = fault_in(cells, response, answer == _UNKNOWN, lambda _: _allowed_answers(options, cells.header))
    refuse(cells.header.source, [cells.fault, *_pair_faults(cells, pairs, asked, options), unknown])
    _require_answers(cells, asked)
    notes = [
        f"trial rows, {_format(cells, _numbers_of(pairs))}, responses {_answers_note(response, answer)}",
        *_layout_notes(pairs, options),
        *_dropped_notes(pairs.subject, ~asked),
    ]
    # A trial is a count of one, a trial without an answer a count of none.
    counts = (np.where(answer == _EQUAL, 1, 0), np.where(asked, 1, 0))
    subjects = _subjects(pairs, *counts)
    answers, order_note = _answers(cells, pairs, *counts)
    return _study(cells, subjects, [*notes, *_interval_notes(pairs, subjects), *order_note], _reading(cells, answers))


def _require_answers(cells: Cells, asked: BoolArray) -> None:
    if not asked.any():
        what = f"found no response in any of {len(asked)} rows, allowed: at least one answered trial"
        raise InputError(f"{cells.header.source}: {what}")


# --- Counts ---------------------------------------------------------------------------------------


def _count_study(cells: Cells, options: ReadOptions) -> Study:
    pairs, equal, trials = _pairs(cells, options), cells.columns["n_equal"], cells.columns["n_trials"]
    k, n = (_whole_numbers(cells, column) for column in (equal, trials))
    every = np.ones(len(n), np.bool_)
    faults = [*_count_faults(cells, equal, trials, k, n), _total_fault(cells, pairs.subject, trials, n)]
    refuse(cells.header.source, [cells.fault, *_pair_faults(cells, pairs, every, options), *faults])
    subjects = _subjects(pairs, k, n)
    notes = [
        f"grouped rows, {_format(cells, _numbers_of(pairs))}, {k.sum()} of {n.sum()} trials answered 'equal'",
        *_layout_notes(pairs, options),
        *_grouping_notes(pairs.subject, subjects, n),
        *_interval_notes(pairs, subjects),
    ]
    answers = _answers(cells, pairs, k, n)[0] if "block" in cells.columns else {}
    return _study(cells, subjects, notes, _reading(cells, answers))


def _whole_numbers(cells: Cells, column: Column) -> IntArray:
    return column.spread([whole_number(text, cells.header.decimal_comma) for text in column.texts], np.int64)


def _count_faults(cells: Cells, equal: Column, trials: Column, k: IntArray, n: IntArray) -> list[Fault]:
    return [
        fault_in(cells, equal, k < 0, _allowed_count),
        fault_in(cells, trials, n < 0, _allowed_count),
        fault_in(cells, equal, (n >= 0) & (k > n), lambda index: f"0 to {bare(trials.name)} = {n[index]}"),
    ]


def _allowed_count(_: int) -> str:
    return "a whole number from 0 to 2**53, without thousands separators"


def _total_fault(cells: Cells, subject: Column, trials: Column, n: IntArray) -> Fault:
    """Subjects whose trials add up to nothing, or to more than can be counted exactly."""
    # A bad count makes the sum NaN, for which both comparisons are false.
    total = np.bincount(subject.codes, np.where(n < 0, np.nan, n), minlength=len(subject.texts))
    named = np.array([text != "" for text in subject.texts], np.bool_)
    bad = np.flatnonzero(named & ((total == 0) | (total > LARGEST_COUNT)))
    shown = []
    for code in bad[:MOST_SHOWN].tolist():
        row, name = int(cells.rows[np.argmax(subject.codes == code)]), quoted(subject.texts[code])
        what = "0 in all rows" if total[code] == 0 else f"a sum of {total[code]:.0f} over the rows"
        where = f"row {row}, column {bare(trials.name)}"
        shown.append((row, f"{where}: found {what} of subject {name}, allowed: 1 to 2**53 trials per subject"))
    return Fault(len(bad), tuple(shown))


# --- Notes ----------------------------------------------------------------------------------------


def _format(cells: Cells, numbers: Sequence[Column]) -> str:
    header = cells.header
    if not header.delimiter:
        return header.encoding
    comma = header.decimal_comma and any("," in text for column in numbers for text in column.texts)
    return f"{DELIMITERS[header.delimiter]}-separated, {header.encoding}{', decimal comma' if comma else ''}"


def _numbers_of(pairs: _Pairs) -> list[Column]:
    return [pairs.first, pairs.second, *([] if pairs.interval is None else [pairs.interval])]


def _interval_notes(pairs: _Pairs, subjects: Sequence[Subject]) -> list[str]:
    """Which intervals were read: a column that has a meaning is never read in silence."""
    if pairs.interval is None:
        return []
    distinct = distinct_intervals(subjects)
    return [f"{counted(len(distinct), 'interval')} in column {bare(pairs.interval.name)}: {said_intervals(distinct)}"]


def _answers_note(response: Column, answer: IntArray) -> str:
    return " / ".join(_side_note(response, answer, *side) for side in ((_EQUAL, "equal"), (_DIFFERENT, "different")))


def _side_note(response: Column, answer: IntArray, value: int, word: str) -> str:
    """Which texts were read as this answer, and how often it was given."""
    chosen = answer == value
    texts = [response.texts[code] for code in np.unique(response.codes[chosen]).tolist()]
    meaning = "" if all(text.lower() == word for text in texts) else f" as {word}"
    shown = listed([quoted(text) for text in texts]) if texts else f"'{word}'"
    return f"{shown}{meaning} ({np.count_nonzero(chosen)})"


def _layout_notes(pairs: _Pairs, options: ReadOptions) -> list[str]:
    notes = [f"only rows with {bare(text)} in column {bare(name)}" for name, text in options.where.items()]
    notes += [f"column {bare(theirs)} read as {ours}" for ours, theirs in options.columns.items() if theirs != ours]
    if options.intensity is None:
        return notes
    names = [bare(column.name) for column in (pairs.first, pairs.second)]
    return notes + [f"column {name} read as amplitude in units of {float(options.intensity)!r}" for name in names]


def _dropped_notes(subject: Column, dropped: BoolArray) -> list[str]:
    """How many trials without a response each subject has, and who has no other."""
    count = np.bincount(subject.codes[dropped], minlength=len(subject.texts))
    total = np.bincount(subject.codes, minlength=len(subject.texts))
    names = ["(no subject)" if text == "" else bare(text) for text in subject.texts]
    each = [f"{names[code]} {count[code]}" for code in np.flatnonzero(count).tolist()]
    gone = [names[code] for code in np.flatnonzero(count == total).tolist() if subject.texts[code]]
    notes = [f"{counted(int(count.sum()), 'trial')} without a response dropped: {listed(each)}"] if each else []
    return notes + ([f"{counted(len(gone), 'subject')} without any response left out: {listed(gone)}"] if gone else [])


def _grouping_notes(subject: Column, subjects: Sequence[Subject], n: IntArray) -> list[str]:
    """How many rows of counts were empty, and how many repeated a pair of the same subject."""
    zero = int(np.count_nonzero(n == 0))
    rows = np.bincount(subject.codes[n > 0], minlength=len(subject.texts)).tolist()
    merged = {one.name: count - one.n_pairs for one, count in zip(subjects, rows, strict=True)}
    each = [f"{bare(name)} {count}" for name, count in merged.items() if count]
    notes = [f"{counted(zero, 'row')} with n_trials = 0 left out"] if zero else []
    return notes + ([f"{counted(sum(merged.values()), 'repeated row')} merged: {listed(each)}"] if each else [])


# --- The study ------------------------------------------------------------------------------------


def _subjects(pairs: _Pairs, n_equal: IntArray, n_trials: IntArray) -> tuple[Subject, ...]:
    """Subjects with an answered trial, in order of first appearance."""
    return subjects_of_rows(pairs.subject.texts, pairs.subject.codes, pairs.keys, n_equal, n_trials)


def _answers(cells: Cells, pairs: _Pairs, n_equal: IntArray, n_trials: IntArray) -> tuple[dict[str, Answers], list[str]]:
    """What each subject answered, in order, and a note where column trial does not tell the order."""
    trials, block, trial = "response" in cells.columns, cells.columns.get("block"), cells.columns.get("trial")
    rank = np.zeros(len(n_trials), np.int64) if block is None else _rank_of_blocks(cells, block)
    rows = np.flatnonzero(n_trials > 0)
    rows = rows[np.argsort(pairs.subject.codes[rows], kind="stable")]
    starts = run_starts(pairs.subject.codes[rows])
    names, notes = [pairs.subject.text(row) for row in rows[starts]], list[str]()
    owner = np.repeat(np.arange(len(names)), np.diff(starts, append=len(rows)))
    if trial is not None and trials:
        order, unknown = order_of_trials(owner, numbers(cells, trial)[rows], rank[rows])
        rows, who = rows[order], listed([bare(names[one]) for one in np.flatnonzero(unknown)])
        notes = [f"column {bare(trial.name)} does not tell the order of all trials, so that of the file stands: {who}"] if who else []
    keys, k, n = np.column_stack(pairs.keys)[rows], n_equal[rows], n_trials[rows]
    place, blocks = (None, [()] * len(names)) if block is None else _blocks(block, rows, owner, rank[rows])
    found = {}
    for name, start, end, called in zip(names, starts.tolist(), [*starts[1:].tolist(), len(rows)], blocks, strict=True):
        at = slice(start, end)
        found[name] = Answers(keys[at], k[at], n[at], None if place is None else place[at], called, trials)
    return found, notes


def _blocks(block: Column, rows: IntArray, owner: IntArray, rank: IntArray) -> tuple[IntArray, list[tuple[str, ...]]]:
    """The place of each row's block among those of its subject, by rank, and of each subject their names."""
    order = np.lexsort((rank, owner))
    first = run_starts(owner[order], rank[order])
    begins = run_starts(owner[order][first])
    number = np.empty(len(owner), np.int64)
    number[order] = np.repeat(np.arange(len(first)), np.diff(first, append=len(owner)))
    names = [block.text(row) for row in rows[order[first]]]
    ends = zip(begins.tolist(), [*begins[1:].tolist(), len(first)], strict=True)
    return number - begins[owner], [tuple(names[start:end]) for start, end in ends]


def _rank_of_blocks(cells: Cells, block: Column) -> IntArray:
    """The rank of each row's block: by number where all are numbers, else by appearance."""
    value = [number(text, cells.header.decimal_comma) for text in block.texts]
    order = range(len(value)) if any(map(math.isnan, value)) else np.argsort(np.argsort(value, kind="stable"))
    return block.spread(list(order), np.int64)


def _reading(cells: Cells, answers: Mapping[str, Answers]) -> Reading:
    read = {column.name for column in cells.columns.values()}
    ignored = dict.fromkeys(name for name in cells.header.names if name and name not in read)
    return Reading(answers, tuple(cells.columns), tuple(ignored))


def _study(cells: Cells, subjects: Sequence[Subject], notes: Sequence[str], reading: Reading) -> Study:
    synthetic, note = _synthetic(cells)
    return Study(tuple(subjects), cells.header.source, synthetic, (*notes, *note), reading)


def _synthetic(cells: Cells) -> tuple[bool, list[str]]:
    """Whether the file says that its data were simulated, and the note about it."""
    if _SYNTHETIC not in cells.columns:
        return False, []
    marks = [_word(text) in _TRUE_WORDS for text in cells.columns[_SYNTHETIC].texts]
    if all(marks):
        return True, ["synthetic data: column synthetic says so in every row"]
    return False, ["column synthetic says so in some rows only: not marked synthetic"] if any(marks) else []
