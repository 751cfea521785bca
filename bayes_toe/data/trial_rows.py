"""Rows of a table that are trials: those that options choose, without practice and unfilled rows.

What is left out is counted in the notes of the table. `frequency_column` finds the column of a
table of frequencies, and `with_row_for_each_trial` makes trials of it. `nameless_doubts`,
`taken_out_doubts` and `rare_answer_doubts` are about rows that may be no trials.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import filterfalse

import numpy as np

from bayes_toe.arrays import BoolArray, combination_counts, run_starts
from bayes_toe.data.answers import Counts
from bayes_toe.data.column_roles import (
    are_alike,
    filled_texts,
    is_no_response,
    is_response_sign,
    looks_like,
    names_like,
    practice_texts,
    taken_out_texts,
)
from bayes_toe.data.messages import Note, Texts, join_quoted, named_counts, plural, quoted
from bayes_toe.data.options import ReadOptions
from bayes_toe.data.tasks import THREE_ANSWERS, tasks_named
from bayes_toe.data.text_table import Column, TextTable
from bayes_toe.data.validation import (
    CONDITION_SEPARATOR,
    column_counts,
    empty,
    is_missing,
    numbers,
    whole_number,
)
from bayes_toe.errors import InputError, Remedy

#: How many trials a table of frequencies may have.
_MOST_TRIALS = 10_000_000
#: Share of the trials below which one of three answers is doubted.
_RARE = 0.01


def with_subjects_below(table: TextTable, name: str) -> TextTable:
    """The table whose column of subjects has each name in all rows of the subject.

    In the file each name stands once, with empty cells below it, as merged cells are saved. `name`
    is the column of subjects; other tables stay as they are.
    """
    column = table.columns.get(name)
    if column is None or column.texts[1:2] != [""]:  # the text after the first name
        return table

    # Codes are in the order of the first rows of their texts, so that 1 is the empty text.
    is_name = column.codes != 1
    n_names = len(column.texts) - 1
    # The table stays unless each name stands once, and most cells are empty.
    if is_name.sum() > n_names or n_names >= 0.5 * len(is_name):
        return table

    # As later names have larger codes, the largest code so far is that of the name above, if the
    # code of empty cells becomes 0.
    filled = replace(column, codes=np.maximum.accumulate(column.codes * is_name))
    note = f"{column}: {(~is_name).sum()} empty cells filled with the name above"
    return replace(table, columns={**table.columns, name: filled}, notes=(*table.notes, note))


def chosen_rows(table: TextTable, options: ReadOptions) -> tuple[TextTable, ReadOptions]:
    """The rows that have the texts of `options.where`, and the options for them.

    Columns that are empty in these rows lose their names and their roles. A table that lacks a
    column of `options.where` stays as it is.

    Raises
    ------
    InputError
        If there is no such row.
    """
    where = options.where
    if not where or not len(table.rows) or not set(where) <= table.columns.keys():
        return table, options

    for name, text in where.items():
        column = table.columns[name]  # of the rows that have the texts checked before
        if text not in column.texts:
            raise InputError(
                f"{table.source}: {column}: found {join_quoted(column.texts)}, "
                f"allowed: {quoted(text)}, as --where has it, in some row"
            )
        table = table.only(column.matches([text]))

    # If the rows are those of one task, the columns of another task are empty.
    other_names = table.columns.keys() - where.keys()
    empty_names = [name for name in other_names if table.columns[name].texts == [""]]
    columns = {role: name for role, name in options.columns.items() if name not in empty_names}
    names = list(filterfalse(empty_names.__contains__, table.names))
    return replace(table, names=names), replace(options, columns=columns)


def frequency_column(table: TextTable, options: ReadOptions, roles_read: Texts) -> Column | None:
    """The column that says for how many trials each row stands; None where rows are trials.

    Options name this column. Or it is the only column with a name such as `Freq`, it has whole
    numbers, some of them above 1, and the rows of the table are those of a cross table.

    Raises
    ------
    InputError
        If a column `n_trials` stands beside responses to single trials.
    """
    answer_roles = {"response", "correct"}.intersection(roles_read)
    if not answer_roles:
        return None
    if "n_trials" in options.columns:
        return table.columns[options.name("n_trials")]

    names_read = [options.name(role) for role in roles_read if role != "n_trials"]
    candidates = names_like(table.names, "frequency")
    # A name may have no column in the table: a column of very many texts is not read.
    column = table.columns.get(candidates[0]) if len(candidates) == 1 else None
    if column is not None and column.name not in names_read:
        counts = column.map(whole_number, np.int64)  # -1 where a cell holds no such number
        has_counts = counts.min(initial=0) >= 0 and counts.max(initial=0) > 1
        # In a cross table no two rows are equal in the columns that are read, or in all columns,
        # as where a column of days is not read.
        all_names = list(filter(column.name.__ne__, table.columns))
        answers = list(map(options.name, answer_roles))
        if has_counts and (
            _is_cross_table(table, names_read, answers)
            or _is_cross_table(table, all_names, answers)
        ):
            return column

    if "n_trials" in roles_read:
        table.require(
            [
                "column n_trials: found beside responses, allowed: one row for each response of a "
                "subject to a pair"
            ]
        )
    return None


def _is_cross_table(table: TextTable, names: Texts, answers: Texts) -> bool:
    """Whether rows differ in the columns of these names, and a pair has a row for each response.

    `answers` are the names of the columns of responses. A pair is a combination of the cells in the
    other columns. That a few pairs have several rows may be a chance, but not that five pairs have,
    or the pairs of most rows.
    """
    codes = {name: table.columns[name].codes for name in names}
    n_rows_of_pair = combination_counts(*(codes[name] for name in names if name not in answers))
    n_repeated = n_rows_of_pair[n_rows_of_pair > 1]  # rows of each pair that has several
    has_repeats = len(n_repeated) >= 5 or n_repeated.sum() > 0.5 * len(table.rows)
    return bool(combination_counts(*codes.values()).max() == 1 and has_repeats)


def with_row_for_each_trial(table: TextTable, frequency: Column) -> TextTable:
    """The table in which each row is there as often as its frequency says."""
    counts = column_counts(table, frequency)
    table.problems.refuse()
    n_trials = counts.sum()
    if n_trials > _MOST_TRIALS:
        raise InputError(
            f"{table.source}: {frequency}: found {n_trials:,} trials, allowed: at most "
            f"{_MOST_TRIALS:,}; or counts, such as n_equal and n_trials"
        )
    return table.only(
        np.repeat(np.arange(len(counts)), counts),
        f"{frequency} read as the number of trials of each row",
    )


def without_practice(table: TextTable, options: ReadOptions, roles_read: Texts) -> TextTable:
    """The table without rows that a column marks as practice.

    `roles_read` are our names of the columns that are read. Columns of subjects, stimuli, responses
    and conditions mark no practice. Nor does a column in which no subject has both marked and other
    trials: it names groups, such as trained subjects.
    """
    # The texts of sessions, blocks or trials may say that these are practice.
    roles = set(roles_read) - {"session", "block", "trial"}
    names_to_skip = {*options.where, *map(options.name, (*roles, "condition"))}
    for name in table.columns:
        if name in names_to_skip:
            continue
        column = table.columns[name]
        practice = practice_texts(name, column.texts)
        if not practice:
            continue

        is_marked = column.matches(practice)
        subject = _subjects(table, options).codes
        # A row without a first stimulus is no trial.
        is_other = ~is_marked & ~empty(table.columns[options.stimulus_names[0]])
        subjects_with_both = np.intersect1d(subject[is_marked], subject[is_other])
        if not len(subjects_with_both):
            continue

        reason = (
            f" left out as practice or catch trials ({column}: {join_quoted(practice)}); "
            "--ignore practice reads them"
        )
        table = table.only(~is_marked, Note((is_marked.sum(), "row"), reason))
    return table


def without_unfilled(table: TextTable, options: ReadOptions, answer: str) -> TextTable:
    """The table without the last rows of a subject that are zero in stimuli and response.

    A session that was stopped leaves such rows if a matrix of zeros was made for all its trials.
    `answer` is 'response' or 'correct'. But two stimuli of zero may also be a pair of the study,
    and rows may be sorted by pair. So the last rows stay if an earlier run of one pair is at least
    a third as long.
    """
    names = [*options.stimulus_names, options.name(answer)]
    is_zero = np.all([numbers(table, table.columns[name]) == 0 for name in names], axis=0)
    for name, column in table.columns.items():
        if is_response_sign(name):  # a key or a reaction time shows a trial
            is_zero &= (numbers(table, column) == 0) | column.map(is_no_response)

    pair = [table.columns[name].codes for name in options.stimulus_names]
    is_unfilled = np.zeros(len(is_zero), bool)
    subject = _subjects(table, options)
    for rows in subject.rows_by_text(np.arange(len(is_zero))).values():
        n_filled = int(np.flatnonzero(~is_zero[rows]).max(initial=-1)) + 1
        filled = rows[:n_filled]
        run_lengths = np.diff([*run_starts(*(codes[filled] for codes in pair)), n_filled])
        if len(rows) - n_filled > 3 * run_lengths.max(initial=1):
            is_unfilled[rows[n_filled:]] = True
    if not is_unfilled.any():
        return table

    reason = " left out as unfilled (stimuli and response are 0 in the last rows): "
    return _without(table, is_unfilled, reason, subject)


def _without(table: TextTable, rows: BoolArray, reason: str, subject: Column) -> TextTable:
    """The table without these rows, and with a note that counts them by subject."""
    return table.only(~rows, Note((rows.sum(), "row"), reason, _counts_by_subject(subject, rows)))


def _counts_by_subject(subject: Column, rows: BoolArray) -> Texts:
    """How many of these rows each subject has, such as ['S01 2', 'S03 5']."""
    part = subject.only(rows)
    names = [text or "(no subject)" for text in part.texts]  # empty where the file has none
    return named_counts(dict(zip(names, np.bincount(part.codes).tolist(), strict=True)))


def without_lone_responses(table: TextTable, options: ReadOptions, answer: str) -> TextTable:
    """The table without rows that have an answer and lack a stimulus, such as catch trials.

    `answer` is 'response' or 'correct'. If most rows lack a stimulus, as where each stimulus has a
    row of its own, all rows stay, and the missing stimuli are problems.
    """
    response = table.columns[options.name(answer)]
    stimuli = map(table.columns.__getitem__, options.stimulus_names)
    lacks_stimulus = np.any([column.map(is_missing) for column in stimuli], axis=0)
    # Other texts, such as the key of a start screen, are no answers.
    answers = filled_texts(response.only(~lacks_stimulus))
    is_lone = lacks_stimulus & response.matches(answers)
    if not is_lone.any() or is_lone.mean() > 0.5:
        return table
    reason = " with a response and without both stimuli left out: "
    return _without(table, is_lone, reason, _subjects(table, options))


def dropped_notes(
    subject: Column, is_dropped: BoolArray, reason: str, cells: Texts = ()
) -> Iterator[str]:
    """A note on how many rows of each subject are dropped for a reason, if any row is.

    `cells` are the texts that mark these rows, with their columns.
    """
    if not is_dropped.any():
        return
    # If many rows are dropped, they are hardly trials: programs also write rows of screens, which
    # are about as many as the answers, or more.
    noun = "trial" if is_dropped.mean() < 0.4 else "row"
    finding = f" ({', '.join(cells)})" if cells else ""
    yield Note(
        (is_dropped.sum(), noun),
        f" {reason} dropped{finding}: ",
        _counts_by_subject(subject, is_dropped),
    )


def columns_of_file(table: TextTable) -> dict[str, Column]:
    """The columns `synthetic` and `task`, which say something of the whole file, by our names."""
    columns = {}
    for name, column in table.columns.items():
        if name == "synthetic":
            columns["synthetic"] = column
        # Other texts, such as names of parts of the experiment, are no task of ours.
        if looks_like(name, "task") and tasks_named(column.texts):
            columns["task"] = column
    return columns


def nameless_doubts(subject: Column) -> Iterator[str]:
    """A doubt for each subject with a name such as 'NA', which may say that the name is missing."""
    for code, text in enumerate(subject.texts):
        name, _, _ = text.partition(CONDITION_SEPARATOR)
        if name and is_missing(name):
            yield (
                f"{plural((subject.codes == code).sum(), 'row')} of subject {quoted(text)}, which "
                f"may mean that the name is missing; if so, --exclude {text}"
            )


def taken_out_doubts(
    table: TextTable, options: ReadOptions, names_not_read: Texts
) -> Iterator[str]:
    """A doubt for each column with texts, such as 'aborted', that say that a trial does not count.

    Columns of blocks, of conditions, and those that are not read may have such texts. The doubt
    says how many rows have such a text. Another doubt is about a column with the same codes as
    the responses, which may have the responses of another subject.
    """
    response = table.columns.get(options.name("response"))
    subject = _subjects(table, options)
    for name, column in table.columns.items():
        if name not in (*names_not_read, "block", "condition"):
            continue
        if response and are_alike(response, column):
            yield (
                f"{response} is read, and not {column}, which has the same codes. If there is one "
                "for each subject, make the table long: one column subject and one column response"
            )
            response = None  # one doubt for all
        texts = taken_out_texts(name, column.texts)
        # `without_practice` leaves out the rows with such texts in other columns. If each subject
        # has one level, the levels are groups, such as trained subjects.
        if name == "condition":
            levels = combination_counts(subject.codes, column.codes)
            if len(levels) > len(subject.texts):
                texts = [*texts, *practice_texts(name, column.texts)]
        other_texts = list(filterfalse(texts.__contains__, column.texts))
        if not texts or not other_texts:
            continue

        doubt = (
            f"{plural(column.matches(texts).sum(), 'row')} with {join_quoted(texts)} in {column} "
            "are counted"
        )
        if len(other_texts) == 1:
            remedy = Remedy("where", ((name, other_texts[0]),))
            doubt += f"; {remedy.typed} leaves them out"
        yield doubt


def rare_answer_doubts(counts: Counts) -> Iterator[str]:
    """A doubt about each of three answers that is as rare as stray words in a study of two answers.

    `counts` has the counts of each row.
    """
    n_equal, n_trials, n_second = (counts[name].sum() for name in THREE_ANSWERS.counts)
    sums = {"equal": n_equal, "second": n_second, "first": n_trials - n_equal - n_second}
    for answer, n_answers in sums.items():
        if n_answers < _RARE * n_trials:
            yield (
                f"only {n_answers} of {n_trials} responses are {answer!r}. If participants had two "
                "answers, correct or remove these rows"
            )


def _subjects(table: TextTable, options: ReadOptions) -> Column:
    """The subject of each row.

    If options read the subject from the name of the file, all rows are of one subject.
    """
    if options.subject_from is not None:
        return Column("", [table.source], np.zeros(len(table.rows), np.int64))
    return table.columns[options.name("subject")]
