"""Studies as they come in: CSV files of trials or of counts, read strictly and reported by row.

Nothing is guessed in silence: what was detected, dropped or merged is in the study's notes, and what cannot be used is
refused with all problems of the file at once.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from bayes_toe.arrays import BoolArray, IntArray, run_starts
from bayes_toe.data.answers import Answers, Reading, order_of_trials
from bayes_toe.data.cells import (
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
from bayes_toe.data.columns import MISSING_WORDS, numbers
from bayes_toe.data.messages import MOST_SHOWN, bare, listed, quoted
from bayes_toe.data.read_options import COLUMNS, ReadOptions
from bayes_toe.data.repeats import repeat_note, repeats
from bayes_toe.data.several_files import read_together
from bayes_toe.data.shown_pairs import ShownPairs, pair_faults, shown_pairs
from bayes_toe.data.study import Study, Subject, subjects_of_rows
from bayes_toe.data.study_columns import SYNTHETIC, rows_asked_for, study_columns, subject_of_file
from bayes_toe.data.study_notes import dropped_notes, format_note, grouping_notes, interval_notes, layout_notes
from bayes_toe.errors import InputError

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
    places, problems = study_columns(header, options)
    subject = subject_of_file(header, path, options)
    cells = rows_asked_for(read_cells(header, text, places, problems), options)
    if subject is not None:
        cells.columns["subject"] = Column("subject", [subject], np.zeros(len(cells.rows), np.int64))
    return _trial_study(cells, options) if "response" in cells.columns else _count_study(cells, options)


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
    pairs, response = shown_pairs(cells, options), cells.columns["response"]
    answer = response.spread([_answer(text, options) for text in response.texts], np.int64)
    asked = answer != _MISSING  # rows without an answer, such as instruction screens, may hold anything else
    unknown = fault_in(cells, response, answer == _UNKNOWN, lambda _: _allowed_answers(options, cells.header))
    refuse(cells.header.source, [cells.fault, *pair_faults(cells, pairs, asked, options), unknown])
    _require_answers(cells, asked)
    notes = [
        f"trial rows, {format_note(cells, pairs)}, responses {_answers_note(response, answer)}",
        *layout_notes(pairs, options),
        *dropped_notes(pairs.subject, ~asked),
    ]
    # A trial is a count of one, a trial without an answer a count of none.
    counts = (np.where(answer == _EQUAL, 1, 0), np.where(asked, 1, 0))
    subjects = _subjects(pairs, *counts)
    answers, order_note = _answers(cells, pairs, *counts)
    doubts = _repeated(cells, pairs, *counts) if order_note else []  # no trial is there twice where the order is known
    reading = _reading(cells, answers, doubts)
    return _study(cells, subjects, [*notes, *interval_notes(pairs, subjects), *order_note], reading)


def _require_answers(cells: Cells, asked: BoolArray) -> None:
    if not asked.any():
        what = f"found no response in any of {len(asked)} rows, allowed: at least one answered trial"
        raise InputError(f"{cells.header.source}: {what}")


def _answers_note(response: Column, answer: IntArray) -> str:
    return " / ".join(_side_note(response, answer, *side) for side in ((_EQUAL, "equal"), (_DIFFERENT, "different")))


def _side_note(response: Column, answer: IntArray, value: int, word: str) -> str:
    """Which texts were read as this answer, and how often it was given."""
    chosen = answer == value
    texts = [response.texts[code] for code in np.unique(response.codes[chosen]).tolist()]
    meaning = "" if all(text.lower() == word for text in texts) else f" as {word}"
    shown = listed([quoted(text) for text in texts]) if texts else f"'{word}'"
    return f"{shown}{meaning} ({np.count_nonzero(chosen)})"


# --- Counts ---------------------------------------------------------------------------------------


def _count_study(cells: Cells, options: ReadOptions) -> Study:
    pairs, equal, trials = shown_pairs(cells, options), cells.columns["n_equal"], cells.columns["n_trials"]
    k, n = (_whole_numbers(cells, column) for column in (equal, trials))
    every = np.ones(len(n), np.bool_)
    faults = [*_count_faults(cells, equal, trials, k, n), _total_fault(cells, pairs.subject, trials, n)]
    refuse(cells.header.source, [cells.fault, *pair_faults(cells, pairs, every, options), *faults])
    subjects = _subjects(pairs, k, n)
    notes = [
        f"grouped rows, {format_note(cells, pairs)}, {k.sum()} of {n.sum()} trials answered 'equal'",
        *layout_notes(pairs, options),
        *grouping_notes(pairs.subject, subjects, n),
        *interval_notes(pairs, subjects),
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


# --- The study ------------------------------------------------------------------------------------


def _subjects(pairs: ShownPairs, n_equal: IntArray, n_trials: IntArray) -> tuple[Subject, ...]:
    """Subjects with an answered trial, in order of first appearance."""
    return subjects_of_rows(pairs.subject.texts, pairs.subject.codes, pairs.keys, n_equal, n_trials)


def _answers(cells: Cells, pairs: ShownPairs, n_equal: IntArray, n_trials: IntArray) -> tuple[dict[str, Answers], list[str]]:
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


def _repeated(cells: Cells, pairs: ShownPairs, n_equal: IntArray, n_trials: IntArray) -> list[str]:
    """What is said of answered trials that are there twice."""
    block, rows = cells.columns.get("block"), np.flatnonzero(n_trials > 0)
    others = [column.codes[rows] for column in (pairs.subject, block) if column is not None]
    again, of = (rows[found] for found in repeats(numbers(cells, cells.columns["trial"])[rows], *others))
    if not len(again):
        return []
    same = np.logical_and.reduce([key[again] == key[of] for key in (*pairs.keys, n_equal)])
    first = int(cells.rows[again[0]]), int(cells.rows[of[0]])
    return repeat_note(first, pairs.subject.text(again[0]), same, blocks=block is not None)


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


def _reading(cells: Cells, answers: Mapping[str, Answers], doubts: Sequence[str] = ()) -> Reading:
    read = {column.name for column in cells.columns.values()}
    ignored = dict.fromkeys(name for name in cells.header.names if name and name not in read)
    return Reading(answers, tuple(cells.columns), tuple(ignored), tuple(f"{cells.header.source}: {one}" for one in doubts))


def _study(cells: Cells, subjects: Sequence[Subject], notes: Sequence[str], reading: Reading) -> Study:
    synthetic, note = _synthetic(cells)
    return Study(tuple(subjects), cells.header.source, synthetic, (*notes, *note), reading)


def _synthetic(cells: Cells) -> tuple[bool, list[str]]:
    """Whether the file says that its data were simulated, and the note about it."""
    if SYNTHETIC not in cells.columns:
        return False, []
    marks = [_word(text) in _TRUE_WORDS for text in cells.columns[SYNTHETIC].texts]
    if all(marks):
        return True, ["synthetic data: column synthetic says so in every row"]
    return False, ["column synthetic says so in some rows only: not marked synthetic"] if any(marks) else []
