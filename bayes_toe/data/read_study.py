"""Reading of studies: tables of trials or of counts, with problems reported by row.

Nothing is guessed in silence: what was detected, dropped or merged is in the study's notes, and
what cannot be used is refused with all problems of the file at once. The bundled studies are here
too.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray, IntArray, StrPath
from bayes_toe.data.answers import Counts, Reading
from bayes_toe.data.column_roles import (
    TRUE_WORDS,
    columns_to_read,
    filled_texts,
    is_missed_flag,
    is_percentage,
    is_response_sign,
    names_like,
    solutions,
    with_likely_columns,
)
from bayes_toe.data.covariates import read_covariates
from bayes_toe.data.layouts import (
    ALLOWED_INTERVALS,
    StandardOrder,
    known_names,
    require_unit,
    stimulus_logs,
    with_known_order,
    with_pairs,
)
from bayes_toe.data.messages import Note, Texts, display_name, join_names, named_counts
from bayes_toe.data.options import ReadOptions, subject_in
from bayes_toe.data.read_table import read_table
from bayes_toe.data.responses import (
    ask_for_third_count,
    blank_missed,
    follows_stimuli,
    missed_codes_found,
    notes_without_effect,
    repeats_stimuli,
    require_direction,
    require_task,
    responses,
    with_joined_codes,
    without_missed,
)
from bayes_toe.data.stimulus_unit import (
    ALLOWED_STIMULI,
    log_doubts,
    merge_rounded,
    out_of_range,
)
from bayes_toe.data.study import Study, Subject, units_by_subject
from bayes_toe.data.study_files import read_files, table_files, with_sheets
from bayes_toe.data.tasks import (
    SAME_DIFFERENT,
    THREE_ANSWERS,
    WHICH_STRONGER,
    Task,
    are_trials,
    task_counted,
    task_of,
)
from bayes_toe.data.text_table import DELIMITERS, Column, Columns, Frame, TextTable
from bayes_toe.data.trial_order import answers_in_order
from bayes_toe.data.trial_rows import (
    chosen_rows,
    columns_of_file,
    dropped_notes,
    frequency_column,
    nameless_doubts,
    rare_answer_doubts,
    taken_out_doubts,
    with_row_for_each_trial,
    with_subjects_below,
    without_lone_responses,
    without_practice,
    without_unfilled,
)
from bayes_toe.data.units import (
    follows_from_pairs,
    options_by_task,
    pooled_conditions,
    study_of_tasks,
    unit_column,
    with_conditions,
)
from bayes_toe.data.validation import (
    bare_names,
    column_counts,
    counts_of_shares,
    empty,
    has_shares,
    require_numbers,
    require_texts,
)
from bayes_toe.errors import (
    InputError,
    NoTrialsError,
    Remedy,
    option_values,
    require_kind,
    with_next_questions,
    with_remedies,
)

#: What made the bundled files: the default example, and the study in the paper's design.
COMMANDS = (
    "bayes-toe simulate -o example_study.csv --task 2afc --design example_pairs.csv "
    "--observers example_truth.csv --trials 400 --seed 2602",
    "bayes-toe simulate -o example_same_different_study.csv "
    "--truth example_same_different_truth.csv --task same/different --subjects 16 "
    "--seed 2604",
)
#: By task, how the names of the files of its example begin.
_EXAMPLES = {
    WHICH_STRONGER: Path(__file__).with_name("example"),
    SAME_DIFFERENT: Path(__file__).with_name("example_same_different"),
}
#: True parameters by subject.
Truth: TypeAlias = Mapping[str, Mapping[str, float]]


def read_study(
    path: StrPath | Frame | Sequence[StrPath | Frame], options: ReadOptions | None = None
) -> Study:
    r"""Read a study from a file or a data frame.

    The column names show whether the rows are trials or counts.

    Trials: ``subject,s1,s2,response``, the response 'equal' or 'different' (also same), or 'second'
    or 'first' (also s2/s1, 2nd/1st), or 'first', 'equal' and 'second', which decides the task;
    numbers do not. Counts: ``subject,s1,s2,n_equal,n_trials``, or ``n_second``, or
    ``n_first,n_equal,n_second``, or ``n_comparison`` of a standard and a comparison. An option
    names a count of right responses (2AFC). s1 and s2 are natural-log intensities.
    Columns ``trial`` (numbers, over all trials or within each block or session), ``block`` and
    ``session`` (any text) change no count. Checks of the responses and models of serial dependence
    use them. These models also use trials without an answer. A column ``condition`` (or another one
    that the options name) makes each subject at each of its levels a unit, ``S01@left``; see
    :mod:`bayes_toe.data.conditions`. Other columns are ignored.

    Parameters
    ----------
    path : str, Path, pandas.DataFrame or polars.DataFrame
        Comma, semicolon or tab between cells; UTF-8, or UTF-16 with a byte-order mark. Or MATLAB
        trials by their suffix, .mat, see :mod:`bayes_toe.data.text_table`. Rows of a frame count
        from 0. Several files or frames in a list make one study: the answers of a subject who is in
        more than one of them are put together, file by file a block. A folder stands for the tables
        in it. Files without a trial are left out beside others, with a note.
    options : ReadOptions, optional
        For raw intensities, other answer codes or other column names.

    Returns
    -------
    Study
        Subjects in order of first appearance; its notes say what was detected, dropped and merged.

    Raises
    ------
    InputError
        If a file cannot be used: one line per problem, ten at most, with row and column. If there
        is no file, a file is given twice, or the answers are to two tasks. If 'second' is rarer the
        larger s2 - s1 is, in the whole study.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pilot = Path(folder, "pilot.csv")
    ...     rows = "subject,s1,s2,response\n01,0,0.3,equal\n01,0.3,0,different\n"
    ...     _ = pilot.write_text(rows, encoding="utf-8")
    ...     study = read_study(pilot)
    >>> study.names, study.notes[0].partition("responses ")[2]
    (('01',), "'equal' (1) / 'different' (1), stimuli as natural logs")
    """
    options = ReadOptions() if options is None else options
    rule = "a ReadOptions, such as bt.ReadOptions(columns={'subject': 'participant'})"
    require_kind("options", options, ReadOptions, rule)
    paths = list(path) if isinstance(path, list | tuple) else [path]
    paths, notes_on_folders = table_files(paths)

    def read(with_options: ReadOptions) -> Study:
        choice = partial(known_names, options=with_options)
        sheets, sheet_options = with_sheets(paths, with_options, choice)
        studies, notes_left_out = read_files(sheets, partial(_read, options=sheet_options))
        study = study_of_tasks(studies, sheet_options)
        return replace(study, notes=(*notes_on_folders, *notes_left_out, *study.notes))

    try:
        study = read(options)
    except InputError as error:
        study, options = _read_evident(error, options, read)
    notes = (*study.notes, *notes_without_effect(study, options))
    study = with_conditions(replace(study, notes=notes), options)
    # A column that is called condition, and that no option names, may hold no condition.
    is_chosen = options.categorical or options.condition or options.reference
    is_by_name = study.conditions is not None and not is_chosen
    if is_by_name and follows_from_pairs(units_by_subject(study).values()):
        name = display_name(options.name("condition"))
        study = read_study(path, options.without_condition)
        note = (
            f"column {name}: found no pair with one answer at two of its levels, as where it names "
            f"pairs, their order or the outcome, so that it is no condition: not used; --condition "
            f"{name} takes it all the same"
        )
        return replace(study, notes=(*study.notes, note))
    require_direction(study, options, read)
    return study


def _read_evident(
    first_error: InputError, options: ReadOptions, read: Callable[[ReadOptions], Study]
) -> tuple[Study, ReadOptions]:
    """The study as names and cells suggest it, and the options that say so.

    `read` raised the error with the given options.

    Raises
    ------
    InputError
        If names and cells leave a question open, or if the study has doubts, does not follow the
        stimuli or does not repeat them. The error asks all questions.
    """
    error, study = with_next_questions(first_error, options, read)
    if study is None:
        raise error from None
    answers, _ = error.choices[0]
    reading = study.reading
    is_evident = all(answer.is_evident for answer in answers)
    # Names that are not ours do not say that numbers are natural logs.
    are_logs = "s1" in reading.read and "s1" in option_values(answers).get("columns", {})
    has_doubts = reading.doubts or reading.pooled
    is_study = follows_stimuli(study) and repeats_stimuli(study)
    if has_doubts or are_logs or not is_evident or not is_study:
        raise error from None

    reading = replace(reading, evident=tuple(answers))
    note = f"options that names and cells suggest: {reading.options_found}"
    first_note, *other_notes = study.notes  # the first one says what the files are
    study = replace(study, notes=(first_note, note, *other_notes), reading=reading)
    return study, with_remedies(options, answers)


def _read(path: StrPath | Frame, options: ReadOptions) -> list[Study]:
    """The study in a file; a study for each task, where tasks are the condition."""
    choice = partial(known_names, options=options)
    table = read_table(path, choice, encoding=options.encoding, sheet=options.sheet)

    table, options_of_tasks = options_by_task(table, options)
    studies = []
    for task_options in options_of_tasks:
        rows = _rows(table, path, task_options)
        task = task_counted(rows.columns)
        if task is None:
            studies.append(_trial_study(rows))
        else:
            studies.append(_count_study(rows, task))
    return studies


def example_study(task: Task | str = WHICH_STRONGER, options: ReadOptions | None = None) -> Study:
    """Return a bundled study. Its subjects are synthetic.

    "2afc", the default: 12 subjects were asked which stimulus was stronger, 40 times for each of
    ten ordered pairs of neighbouring levels. They have constant errors and contractions of both
    signs; one subject has neither. Its seed was chosen among seven for few flags. "same/different":
    16 subjects in the paper's design, simulated by the paper's model (H1). The paper's own data are
    not public. :data:`COMMANDS` has the commands that made both.

    Parameters
    ----------
    task : Task or str
    options : ReadOptions, optional
        Such as the rows to read.

    Returns
    -------
    Study

    Examples
    --------
    >>> study = example_study()
    >>> len(study), study.synthetic, study.subjects[0].total_trials
    (12, True, 400)
    >>> example_study("same/different")["S01"].task.yes
    'equal'
    """
    study = read_study(f"{_example(task)}_study.csv", options)
    return replace(study, source="bundled example (synthetic)", reading=Reading())


def example_truth(task: Task | str = WHICH_STRONGER) -> Truth:
    """Return the true parameters of each subject of a bundled study.

    "2afc": the parameters of the observer. "same/different": those of the paper's model (H1).

    Parameters
    ----------
    task : Task or str

    Returns
    -------
    mapping of str to (mapping of str to float)

    Examples
    --------
    >>> truth = example_truth()["S01"]
    >>> truth["constant_error"], truth["contraction"]
    (0.13, 0.28)
    >>> sorted(example_truth("same/different")["S01"])
    ['mu1', 'q0', 'sigma_l', 'sigma_p']
    """
    truth: dict[str, dict[str, float]] = {}
    for parameter, values in read_covariates(f"{_example(task)}_truth.csv").items():
        for subject, value in values.items():
            truth.setdefault(subject, {})[parameter] = float(value)
    return truth


def _example(task_name: Task | str) -> Path:
    """How the paths of an example's files begin; some tasks have no example."""
    task = task_of(task_name)
    if task not in _EXAMPLES:
        names = join_names([task.name for task in _EXAMPLES])
        raise InputError(f"--example: found {task.name!r}, which has no example, allowed: {names}")
    return _EXAMPLES[task]


# --- Rows of trials or of counts ------------------------------------------------------------------


@dataclass(frozen=True)
class _Rows:
    """Rows that are asked for: columns by our names, and the stimuli of each row.

    `stimuli` are natural logs, shape (rows, 2), NaN where a cell cannot be read: s1 and s2, or the
    standard and the comparison. `rounding` has doubts about stimuli that differed by rounding only.
    """

    table: TextTable
    columns: Columns
    options: ReadOptions
    stimuli: FloatArray
    order: StandardOrder
    rounding: list[str]

    @property
    def pairs(self) -> FloatArray:
        """s1 and s2 of each row, natural-log intensities, shape (rows, 2)."""
        return self.order.in_order(self.stimuli)

    @property
    def stimulus_columns(self) -> list[Column]:
        """The columns of the stimuli."""
        return [self.columns[role] for role in self.options.stimuli]

    @property
    def subject(self) -> Column:
        """The subject of each row."""
        return self.columns["subject"]

    @property
    def response_signs(self) -> Iterator[Column]:
        """Columns that may show that nobody responded to a trial; none if trials are not scored.

        Programs score a missed trial as wrong, so that another column must show the miss, such as a
        reaction time. Without scores, an empty response shows it. A column that is read for
        something else does not count.
        """
        if self.options.correct is None:
            return
        names_read = {column.name for column in self.columns.values()}
        for name, column in self.table.columns.items():
            may_show = is_response_sign(name) or is_missed_flag(column)
            if may_show and name not in names_read:
                yield column

    @property
    def columns_read(self) -> list[Column]:
        """The columns that are read, with those that may show that nobody responded."""
        return [*self.columns.values(), *self.response_signs]

    @property
    def names_not_read(self) -> Texts:
        """The columns that are not read, without those that the options ignore."""
        names_to_skip = {"", *self.options.where, *(column.name for column in self.columns_read)}
        for role in self.options.ignore:
            names_to_skip |= {self.options.name(role), *names_like(self.table.names, role)}
        return [name for name in dict.fromkeys(self.table.names) if name not in names_to_skip]

    def require_pairs(self, rows: BoolArray) -> None:
        """Note what is wrong with subjects, conditions and stimuli in these rows."""
        for role in ("subject", "condition"):
            if role in self.columns:
                require_texts(self.table, self.columns[role], rows)

        if self.order.column is not None:
            self.table.fault(self.order.column, rows & self.order.is_unknown, ALLOWED_INTERVALS)
        for column, values in zip(self.stimulus_columns, self.stimuli.T, strict=True):
            kind = "a positive finite number" if self.options.has_intensities else "a finite number"
            require_numbers(self.table, column, rows & np.isnan(values), kind)
            self.table.fault(column, rows & out_of_range(values), ALLOWED_STIMULI)

        if self.options.unit is None:
            require_unit(self.table, self.stimulus_columns, self.stimuli, rows, self.options)
        elif self.options.has_intensities:
            # A factor of e^5, which is 148, is more than in any lab: a cell has another unit.
            self.table.fault(
                self.stimulus_columns[0],
                rows & (abs(np.subtract(*self.stimuli.T)) > 5.0),
                "a stimulus within a factor of 148 of the other one, all cells in one unit",
            )

    def layout(self, form: str, answers: Iterable[object]) -> list[str]:
        """Notes on the form of the table, its rows, and columns with another name or unit.

        `answers` are parts of the first note: 'trial rows, UTF-8, 20 of 40 trials ...'.
        """
        table = self.table
        stimulus_texts = "".join(["".join(column.texts) for column in self.stimulus_columns])
        parts = [f"{form} rows", table.form]
        if table.delimiter:
            parts.insert(1, f"{DELIMITERS[table.delimiter]}-separated")
        if self.options.decimal != "." and "," in stimulus_texts:
            parts.append("decimal comma")
        unit = self.options.unit_in_words
        scale = "" if unit else ", stimuli as natural logs"
        notes = [Note(f"{', '.join(parts)}, ", *answers, scale), *self.order.notes, *table.notes]
        for name, text in self.options.where.items():
            notes.append(f"only rows with {display_name(text)} in {table.columns[name]}")

        # By name in the file, what a column is read as: our name, and the unit of stimuli.
        read_as = {}
        for role, name in self.options.columns.items():
            if name != role and role in self.columns:
                read_as[name] = [role]
        if unit:
            for column in self.stimulus_columns:
                read_as.setdefault(column.name, []).append(unit)
        for name, meanings in read_as.items():
            notes.append(f"column {display_name(name)} read as {', '.join(meanings)}")
        return notes


def _rows(table: TextTable, path: StrPath | Frame, options: ReadOptions) -> _Rows:
    """The rows that are asked for; all others are left out before anything is checked."""
    table = with_subjects_below(table, with_likely_columns(table.names, options).name("subject"))
    if options.wide is not None:
        table = with_pairs(table, options)
    table, options = chosen_rows(table, options)

    has_response_name = "response" in options.columns  # by an option, and not by a likely name
    options = with_likely_columns(table.names, options)
    table, options = with_known_order(table, options)
    all_columns = table.columns.values()
    if not has_response_name and options.name("response") in solutions(all_columns, options):
        # The likely column has the correct answers. It loses its role here, so that the program
        # asks for the column of the responses.
        options = replace(options, columns={**options.columns, "response": "response"})
    roles_read, problems, remedies = columns_to_read(table.names, options, all_columns)
    if not isinstance(path, StrPath):  # a frame has no name that may have the subject
        remedies = [remedy for remedy in remedies if remedy.option != "subject_from"]
    table.require(problems, remedies)

    if "practice" not in options.ignore:
        table = without_practice(table, options, roles_read)
    for answer in ("response", "correct"):
        if answer in roles_read:
            table = without_unfilled(table, options, answer)
            table = without_lone_responses(table, options, answer)
    frequency = frequency_column(table, options, roles_read)
    if frequency is not None:
        table = with_row_for_each_trial(table, frequency)

    columns = _columns(table, path, options, roles_read)
    if frequency is not None:  # then the rows are no single trials, see `are_trials`
        columns["n_trials"] = table.columns[frequency.name]

    stimuli = stimulus_logs(table, [columns[role] for role in options.stimuli], options)
    stimuli, rounding = merge_rounded(stimuli, columns["subject"], options.stimulus_unit)
    order = StandardOrder(table, columns.get("standard_interval"), options)
    return _Rows(table, columns, options, stimuli, order, rounding)


def _columns(
    table: TextTable, path: StrPath | Frame, options: ReadOptions, roles_read: Texts
) -> dict[str, Column]:
    """The columns that are read by our names, and those that say something of the whole file."""
    columns = {role: table.columns[options.name(role)] for role in roles_read}
    columns |= columns_of_file(table)
    # These counts stand under the names of others until `_count_study` knows the order of each row,
    # and so which of them are counts of 'second'.
    for role in ("n_comparison", "n_correct", "n_standard"):
        if role in columns:
            columns["n_first" if role == "n_standard" else "n_second"] = columns[role]
    for role in ("response", "correct", "standard_interval"):  # cells may be codes, such as '1.0'
        if role in columns:
            columns[role] = columns[role].with_plain_codes()
    if "response" in columns:
        columns["response"] = with_joined_codes(columns["response"], options)

    if options.subject_from is not None:
        subject = subject_in(path, options.subject_from)
        if subject is None:
            raise InputError(
                f"{table.source}: found no subject in its name, allowed: a file named as "
                f"--subject-from {options.subject_from}"
            )
        row_codes = np.zeros(len(table.rows), np.int64)
        columns["subject"] = Column("name of the file", [subject], row_codes)
    else:
        columns["subject"] = bare_names(table, columns["subject"])
    if "condition" in columns:
        columns["subject"] = unit_column(table, columns, options.categorical)
    return columns


def _study(rows: _Rows, notes: list[str], counts: Counts, task: Task) -> Study:
    """The study of valid rows, with the counts of each by their names in :class:`Answers`.

    `notes` say how the rows were read. Subjects have answers in order if the rows are trials or
    have blocks.
    """
    rows_of_units = rows.subject.rows_by_text(np.flatnonzero(counts["n_trials"] > 0))
    answers, order_notes, doubts = answers_in_order(
        rows.table, rows.columns, rows.pairs, rows_of_units, counts
    )
    has_order = are_trials(rows.columns) or "block" in rows.columns
    subjects = []
    for name, in_order in answers.items():
        subject = Subject.from_answers(name, in_order, task, rows.options.stimulus_unit)
        subjects.append(subject if has_order else replace(subject, answers=None))

    if task_counted(rows.columns) is not None:  # counts: rows of one pair are merged
        n_merged = {unit.name: len(rows_of_units[unit.name]) - unit.n_pairs for unit in subjects}
        n_all_merged = sum(n_merged.values())
        if n_all_merged:
            notes.append(Note((n_all_merged, "repeated row"), " merged: ", named_counts(n_merged)))
    notes += order_notes
    marks = rows.columns["synthetic"].texts if "synthetic" in rows.columns else [""]
    is_marked = [text.lower() in TRUE_WORDS for text in marks]
    if all(is_marked):
        notes.append("synthetic data: the column synthetic marks every row")
    elif any(is_marked):
        notes.append("the column synthetic marks only some rows, so the study is not marked")

    doubts += _doubts(rows, task, counts)
    pooled: list[str] = []
    if "condition" not in rows.columns:
        columns_not_read = filter(None, map(rows.table.columns.get, rows.names_not_read))
        pooled += pooled_conditions(columns_not_read, rows.subject, counts, rows.pairs)
    codes = []
    if "response" in rows.columns:
        codes = filled_texts(rows.columns["response"])

    source = rows.table.source
    reading = Reading(
        read=tuple(rows.columns),
        ignored=tuple(rows.names_not_read),
        doubts=tuple(f"{source}: {doubt}" for doubt in doubts),
        pooled=pooled,
        codes=codes,
        missed=tuple(missed_codes_found(rows.columns_read, rows.options)),
    )
    return Study(
        tuple(subjects), source, synthetic=all(is_marked), notes=tuple(notes), reading=reading
    )


def _doubts(rows: _Rows, task: Task, counts: Counts) -> list[str]:
    """What is probably wrong with the rows, a sentence each."""
    n = counts["n_trials"]
    doubts = list(rows.rounding)
    if not rows.options.unit_in_words:
        doubts += log_doubts(rows.stimuli)
    if task == THREE_ANSWERS:
        doubts += rare_answer_doubts(counts)
    if len(n) >= 4 and (n == 100).all():  # in fewer rows it may be a chance
        doubts.append(
            "each row has 100 trials, as in a table of percentages. If there were fewer, write "
            "their number"
        )

    doubts += nameless_doubts(rows.subject)
    # The reader has left this note if the table had repeated headers.
    if rows.options.subject_from is not None and "repeated header" in " ".join(rows.table.notes):
        doubts.append(
            "repeated headers may begin other subjects, but all rows are read as one subject. If "
            "there are several, add a column subject"
        )
    doubts += taken_out_doubts(rows.table.only(n > 0), rows.options, rows.names_not_read)

    response = rows.columns.get("response")
    names_of_solutions = solutions(rows.table.columns.values(), rows.options)
    if response is not None and response.name in names_of_solutions:
        doubts.append(
            f"{response} says the same wherever the same stimulus is the larger. If it has "
            "correct answers, --columns response=NAME names the responses"
        )
    return doubts


# --- Trials ---------------------------------------------------------------------------------------


def _trial_study(rows: _Rows) -> Study:
    """The study of a table whose rows are trials."""
    table = rows.table
    options = rows.options
    task_column = rows.columns.get("task")
    answer_role = "correct" if options.correct else "response"
    # A digit shows a stimulus, also a stimulus that cannot be read.
    has_digit = re.compile("[0-9]").search
    has_stimuli = np.any([column.map(has_digit) for column in rows.stimulus_columns], axis=0)
    column, missed_texts = blank_missed(rows.columns[answer_role], options, has_stimuli)
    if options.has_standard and "response" in rows.columns:
        column = rows.order.answers_by_interval(table, column, options)
    difference = np.diff(rows.pairs)[:, 0]
    answers = responses(table, column, task_column, options, rows.subject, difference, rows.order)
    answers, missed_signs = without_missed(answers, column, rows.response_signs, options.missed)

    # Rows without a response, such as instruction screens, may hold anything else.
    has_response = answers.is_answered | answers.is_unscorable
    rows.require_pairs(has_response)
    table.problems.refuse()
    require_task(table, answers.task, task_column)
    if not answers.is_answered.any():
        remedy = Remedy("columns", (("response", "NAME"),), "if another column has the responses")
        remedies = [remedy] if options.correct is None else []
        # A file with few trials and no response is left out beside other files, see `read_files`.
        # In a file with more trials, the responses are rather in another column.
        kind = NoTrialsError if has_stimuli.sum() < 10 else InputError
        raise kind(
            f"{table.source}: {column}: found no response in any of {len(table.rows)} rows, "
            "allowed: at least one answered trial",
            remedies,
        )

    notes = rows.layout("trial" if are_trials(rows.columns) else "frequency", answers.note)
    n_blank = (~has_response & ~has_stimuli).sum()
    if n_blank:
        notes.append(Note((n_blank, "row"), " without stimuli and response left out"))
    causes = missed_texts + missed_signs
    notes += dropped_notes(rows.subject, ~has_response & has_stimuli, "without a response", causes)
    equal_stimuli = "with equal stimuli, of which no answer is right in 2AFC,"
    notes += dropped_notes(rows.subject, answers.is_unscorable, equal_stimuli)
    responding_subjects = {"", *rows.subject.only(answers.is_answered).texts}
    absent_subjects = [
        display_name(text) for text in rows.subject.texts if text not in responding_subjects
    ]
    if absent_subjects:
        notes.append(
            Note(
                (len(absent_subjects), "subject"),
                " without any response left out: ",
                absent_subjects,
            )
        )

    # A trial counts each answer once or not at all. A task of two answers has no third count.
    columns = np.array([answers.is_yes, answers.is_answered, answers.is_second], np.int64)
    counts = dict(zip(answers.task.counts, columns, strict=False))
    return _study(rows, notes, counts, answers.task)


# --- Counts ---------------------------------------------------------------------------------------


def _count_study(rows: _Rows, task: Task) -> Study:
    """The study of a table of counts of one answer, or of all.

    `counts` are those of the task's answers, shape (answers, rows), and `n` the trials of each row.
    Both are invalid where a cell has no number, which is a problem of the table.
    """
    table = rows.table
    if "n_trials" in rows.columns:
        n = column_counts(table, rows.columns["n_trials"])
        counts, share_notes = _counts_of_trials(rows, n, task)
    else:
        counts = _counts_of_answers(rows, task)
        n = counts.sum(axis=0)
        share_notes = []

    # Counts of 'comparison' or of right answers are those of 'second' where the standard came
    # first, or where s2 is larger, and those of 'first' in other rows.
    if not {"n_comparison", "n_standard"}.isdisjoint(rows.columns):
        counts = np.where(rows.order.is_first, counts, counts[::-1])
    elif "n_correct" in rows.columns:
        difference = np.diff(rows.pairs)[:, 0]
        counts = np.where(difference > 0.0, counts, counts[::-1])
        rule = "0 where stimuli are equal, of which no answer is right: remove these rows"
        table.fault(rows.columns["n_trials"], (difference == 0.0) & (n > 0), rule)

    rows.require_pairs(np.ones(len(n), bool))  # in all rows
    subject = rows.subject
    has_trials = np.isin(subject.codes, subject.codes[n != 0])  # in this row or another
    table.fault(
        subject, ~has_trials & ~empty(subject), "a subject with at least 1 trial in some row"
    )
    table.problems.refuse()
    require_task(table, task, rows.columns.get("task"))

    answer_note: list[object] = [n.sum(), " trials"]
    for answer, count in zip(task.answers, counts, strict=True):
        answer_note += [", ", count.sum(), f" '{answer}'"]
    notes = rows.layout("grouped", answer_note) + share_notes
    n_empty = (n == 0).sum()
    if n_empty:
        notes.append(Note((n_empty, "row"), " with n_trials = 0 left out"))
    # The task counts its first answer; of three answers, 'second' is the second of them.
    columns = (counts[0], n, counts[1])
    return _study(rows, notes, dict(zip(task.counts, columns, strict=False)), task)


def _counts_of_trials(rows: _Rows, n: IntArray, task: Task) -> tuple[IntArray, list[str]]:
    """Counts of two answers from a column that counts one of them, or has its shares, of n trials.

    The second value is a note on shares.
    """
    table = rows.table
    counts_other = task.count not in rows.columns  # such as n_first in the place of n_second
    column = rows.columns[f"n_{task.no}" if counts_other else task.count]
    name = display_name(rows.columns["n_trials"].name)
    notes = []
    if is_percentage(column.name) or has_shares(table, column):
        notes.append(f"{column} read as shares of {name}")
        k = counts_of_shares(table, column, n)
    else:
        k = column_counts(table, column)
    table.fault(column, (n >= 0) & (k > n), lambda index: f"0 to {name} = {n[index]}")
    return np.array([n - k, k] if counts_other else [k, n - k]), notes


def _counts_of_answers(rows: _Rows, task: Task) -> IntArray:
    """Counts of all answers from a column for each, which add up to the trials of a row."""
    counts = np.array(
        [column_counts(rows.table, rows.columns[f"n_{answer}"]) for answer in task.answers]
    )
    n = counts.sum(axis=0)
    trials = rows.table.columns.get(rows.options.name("n_trials"))
    if trials is not None:
        is_wrong = column_counts(rows.table, trials) != n
        rows.table.fault(trials, is_wrong, lambda index: f"the sum of its counts, {n[index]}")
    ask_for_third_count(rows.table, n, rows.names_not_read)
    return counts
