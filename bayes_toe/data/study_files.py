"""The files of a study: folders, and tables that are put together.

`table_files` replaces a folder by the tables in it, `with_sheets` a workbook by its sheets,
`read_files` reads the files, and `together`
makes one study of them. The answers of a subject who is in more than one file are put together,
each file as a block.
"""

from __future__ import annotations

import os
import re
import shlex
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from scipy.special import binom

from bayes_toe.arrays import Record, StrPath
from bayes_toe.data.answers import Answers, Reading
from bayes_toe.data.column_roles import looks_like
from bayes_toe.data.messages import (
    MAX_LINES,
    TWICE,
    Note,
    display_name,
    fixed_texts,
    format_path,
    join_names,
    join_words,
    named_counts,
    plural,
    sum_of_notes,
)
from bayes_toe.data.options import ReadOptions, subject_in
from bayes_toe.data.read_table import TABLE_SUFFIXES, is_excel, sheet_paths
from bayes_toe.data.study import Study, Subject, pooled
from bayes_toe.data.text_table import Choice
from bayes_toe.errors import InputError, NoTrialsError, Remedy

#: A file, by its name or as a study, and a text about it.
Line: TypeAlias = tuple[Any, str]
#: Where the tables of a folder are: in the places of BIDS, else in the folder, else in subfolders,
#: else in logs, beside which other programs write tables. The last place is for an error, which
#: names the files in it.
_IN_FOLDER = (
    "sub-*/**/*_events.tsv", "sub-*/**/*_beh.tsv", "*", "*/*", "*/*/*", "*.log", "*.*",
)  # fmt: skip
#: Where the name of a file or of its folder may have the subject, as patterns of `subject_from`.
_SUBJECT_PLACES = ("{}.*", "{}_*", "{}/*", "{}/*/*")
#: The same for a sheet of an Excel file, as in study.xlsx/S01.
_SUBJECT_IN_SHEET = ("{}", "{}_*")
#: Paths in folders that are subjects, not groups: with a number at the end, as S1/a.csv, or with
#: files of one name.
_SUBJECT_FOLDERS = r"(?m)\d[/\\][^/\\\n]*$|\A.*[/\\](.+)(?:\n.*[/\\]\1)*\Z"
#: The beginning of all lines, up to a sign between words.
_COMMON_BEGINNING = r"\A((?:.*[_. -])?).*(?:\n\1.*)*\Z"


def table_files(paths: Sequence[Any]) -> tuple[list[Any], list[str]]:
    """The files and frames of a study, with the tables of a folder in place of the folder.

    The second value is a note for each folder.

    Raises
    ------
    InputError
        If a folder has no tables, or tables of several suffixes.
    """
    files = []
    notes = []
    for path in paths:
        if isinstance(path, StrPath) and os.path.isdir(path):
            tables, note = _folder_tables(path)
            files += tables
            notes.append(note)
        else:
            files.append(path)
    return files, notes


def _folder_tables(path: StrPath) -> tuple[list[Path], str]:
    """The tables of a folder, in its first places that have some, and a note on them."""
    folder = Path(path)
    name = display_name(str(path))
    for pattern in _IN_FOLDER:  # the last pattern is left if no place has tables
        tables = []
        for file_path in folder.glob(pattern):
            file = file_path.relative_to(folder)
            # Excel makes a lock such as ~$a.xlsx.
            is_hidden = any(part.startswith((".", "~$")) for part in file.parts)
            # A pattern such as '*.log' has a suffix of its own.
            is_table = file.suffix.lower() in TABLE_SUFFIXES or "." in pattern
            if is_table and not is_hidden and file_path.is_file():
                tables.append(file)
        if tables:
            break

    tables.sort()
    counts = Counter(file.suffix.lower() for file in tables)
    finding = join_words([plural(n, f"{suffix} file") for suffix, n in counts.items()])
    if len(counts) != 1 or pattern == "*.*":
        commonest = max(counts, key=counts.__getitem__, default=".csv")
        raise InputError(
            f"{name}: found {finding or 'no table'}, allowed: tables of one suffix, such as "
            f"{shlex.quote(format_path(folder))}/{pattern.replace('*.*', '*')}{commonest}"
        )
    places = " in subfolders" if "/" in pattern else ""
    return list(map(folder.joinpath, tables)), f"folder {name}: {finding}{places} read"


def with_sheets(
    paths: Sequence[Any], options: ReadOptions, choice: Choice
) -> tuple[list[Any], ReadOptions]:
    """Several sheets in the place of each Excel file, where `sheet` is a pattern.

    The pattern is then no longer among the options. It may have {} where the subject stands, and
    becomes the pattern of `subject_from`.
    """
    pattern = options.sheet or ""
    if "*" not in pattern and "{}" not in pattern:
        return list(paths), options
    sheets: list[Any] = []
    for path in paths:
        is_workbook = isinstance(path, StrPath) and is_excel(path) and os.path.isfile(path)
        sheets += sheet_paths(path, pattern.replace("{}", "*"), choice) if is_workbook else [path]
    if "{}" in pattern:
        options = replace(options, subject_from=pattern)
    return sheets, replace(options, sheet=None)


# --- A study in several files ---------------------------------------------------------------------


def read_files(
    paths: Sequence[Any], read: Callable[[Any], Sequence[Study]]
) -> tuple[list[Study], list[str]]:
    """The studies in several files, or frames, each of which `read` reads.

    A file without a trial is left out, unless no file has a trial. The second value is a note on
    each file that is left out.

    Raises
    ------
    InputError
        If there is no file, a file is given twice, or a file has problems. If only some files lack
        columns that the options name, these come first.
    """
    if not paths:
        raise InputError("files: found none, allowed: some")

    absolute_paths = _absolute_paths(paths)
    studies = []
    errors = []
    without_trials = []
    missing_names = []

    for path in paths:
        folder = _distinguishing_folder(path, absolute_paths)
        try:
            studies += [replace(study, source=folder + study.source) for study in read(path)]
        except NoTrialsError as error:
            without_trials.append(error)
        except InputError as error:
            problems = [folder + problem for problem in error.problems]
            errors.append(InputError(problems, error.remedies))
            if error.remedies and not error.remedies[0].is_complete:  # it asks for a name
                missing_names.append(
                    f"{problems[0]} Type the names of the other files, or remove this file."
                )

    if 0 < len(missing_names) < len(paths):  # other files have the names that the options say
        raise InputError(missing_names[:MAX_LINES])
    if errors or not studies:
        raise _refusal(paths, errors or without_trials)
    return studies, [f"left out: {error.problems[0]}" for error in without_trials]


def _absolute_paths(paths: Iterable[Any]) -> list[Path]:
    """The paths of files, without frames; a file that is given twice is refused."""
    absolute_paths = [Path(path).absolute() for path in paths if isinstance(path, StrPath)]
    for path, n_times in Counter(absolute_paths).items():
        if n_times > 1:
            raise InputError(f"{display_name(path.name)}: found twice, allowed: each file once")
    return absolute_paths


def _refusal(paths: Sequence[Any], errors: Sequence[InputError]) -> InputError:
    """One refusal for the errors of several files: problems that are alike are one line."""
    problems = _one_line_each(chain.from_iterable(error.problems for error in errors))
    if len(errors) > 1 and len(problems) > MAX_LINES:
        problems[MAX_LINES:] = ["... and more problems"]

    # Files of one study are alike, so that the options for the first one are those for all.
    remedies: list[Remedy] = []
    for remedy in errors[0].remedies:
        if remedy.option == "subject_from":  # its pattern has to fit the names of all files
            remedies += _subject_remedies(paths, remedy)
        else:
            remedies.append(remedy)
    return InputError(problems, remedies)


def _one_line_each(problems: Iterable[str]) -> list[str]:
    """Lines for problems that begin with the name of their file: a line for those that are alike.

    Examples
    --------
    >>> _one_line_each(["a.csv: row 1 is empty", "b.csv: row 3 is empty", "c.csv: no rows"])
    ['2 files, such as a.csv: row 1 is empty', 'c.csv: no rows']
    """
    lines = []
    for problem in problems:
        file, _, text = problem.partition(": ")
        lines.append((file, text))
    joined_lines = []
    for group in _alike(lines):
        beginning = f"{len(group)} files, such as " if len(group) > 1 else ""
        joined_lines.append(beginning + ": ".join(filter(None, group[0])))  # the text may be empty
    return joined_lines


def _subject_remedies(paths: Sequence[Any], remedy: Remedy) -> list[Remedy]:
    """A remedy for each pattern that finds several subjects in the paths; else the given remedy.

    In a/x.csv and b/x.csv, '{}/*' finds the subjects a and b.
    """
    remedy_by_subjects: dict[tuple[str, ...], Remedy] = {}
    are_sheets = all(isinstance(path, StrPath) and is_excel(Path(path).parent) for path in paths)
    names = list(map(os.path.basename, map(str, paths)))
    # Of toe_A_1.csv and toe_B_1.csv the first pattern is 'toe_{}_*', and of s.A.data.txt and
    # s.B.data.txt it is 's.{}.*'.
    beginning = re.sub(_COMMON_BEGINNING, r"\1", "\n".join(names))
    patterns = [beginning + ("{}.*" if beginning.endswith(".") else "{}_*")]

    patterns += _SUBJECT_IN_SHEET if are_sheets else _SUBJECT_PLACES
    if len(set(names)) < len(names):  # a name in several folders is no subject, so folders go first
        patterns.reverse()
        if not re.search(_SUBJECT_FOLDERS, "\n".join(map(str, paths))):
            patterns.insert(0, "{}/{}.*")  # folders may be groups

    for pattern in patterns:
        subjects = tuple(subject_in(path, pattern) or "" for path in paths)
        if all(subjects) and len(set(subjects)) > 1:
            meaning = f"if the subjects are {join_names(dict.fromkeys(subjects), max_items=3)}"
            # Of patterns with the same subjects, the first is proposed.
            remedy_by_subjects.setdefault(subjects, remedy._replace(value=pattern, meaning=meaning))
    remedies = list(remedy_by_subjects.values()) or [remedy]
    if _begin_with_subject(names):
        remedies[0] = remedies[0]._replace(is_evident=True)
    return remedies


def _begin_with_subject(names: Iterable[str]) -> bool:
    """Whether the names of all files begin with one word for a subject, such as 'sub'.

    Examples
    --------
    >>> _begin_with_subject(["sub-01_beh.tsv", "sub-02_beh.tsv"]), _begin_with_subject(["a1", "b2"])
    (True, False)
    """
    first_word, *other_words = {re.sub(r"(?s)[\W\d_].*", "", name) for name in names}
    names_subject = looks_like(first_word, "subject") or looks_like(first_word, "id")
    return names_subject and not other_words


def _distinguishing_folder(path: Any, paths: Sequence[Path]) -> str:
    """What tells a file from others of its name, such as 'a/' for a/x.csv beside b/x.csv.

    It is empty if no other file has the name, and for a data frame.
    """
    if not isinstance(path, StrPath):
        return ""
    folders = [other.parent for other in paths if other.name == Path(path).name]
    if len(folders) < 2:  # an empty path has the name of no file
        return ""
    folder = Path(path).absolute().parent
    return f"{folder.relative_to(os.path.commonpath(folders)).as_posix()}/"


def _alike(lines: Iterable[Line]) -> list[list[Line]]:
    """Groups of lines that differ in numbers and names only, or in the order of their letters.

    A group has at most one line of a file: second lines of a kind are a group of their own.
    """
    n_of_kind = Counter[Line]()
    groups = defaultdict[tuple[str, int], list[Line]](list)
    for file, text in lines:
        letters = re.sub(r"[\d,]", "", "".join(fixed_texts(text)))
        kind = "".join(sorted(letters))  # the same for columns in another order
        n_of_kind[file, kind] += 1
        groups[kind, n_of_kind[file, kind]].append((file, text))
    return list(groups.values())


def together(studies: Sequence[Study]) -> Study:
    """One study of the subjects of several; a note that all files share appears once.

    Raises
    ------
    InputError
        If the studies are of two tasks.
    """
    first = studies[0]
    copies = list(_copies(studies))
    if len(studies) == 1:
        return replace(
            first, reading=replace(first.reading, doubts=(*first.reading.doubts, *copies))
        )
    # By the name of a subject, its files, each with the answers of the subject in it.
    files_of_subjects = defaultdict[str, list[tuple[str, Subject]]](list)
    for study in studies:
        for subject in study:
            files_of_subjects[subject.name].append((study.source, subject))
        if study.task != first.task and not study.subjects[0].condition:
            raise InputError(
                f"{study.source}: asked {study.task.name}, and {first.source} {first.task.name}; "
                "allowed: files of one task; contrast compares tasks with --condition task"
            )
    reading = _reading_of_all(studies)
    doubts = _one_line_each(reading.doubts) + copies
    subjects = []
    n_files = {}
    for name, files in files_of_subjects.items():
        subjects.append(_subject_of_files(files))
        if len(files) > 1:
            n_files[name] = len(files)

    notes = list(_common_notes(studies))
    if n_files:
        notes.append(
            Note(
                (len(n_files), "subject"),
                " in several files, put together (for conditions, add a column): ",
                named_counts(n_files),
            )
        )
    # All frames are one source, and so are the tasks in a file.
    sources = list(dict.fromkeys(study.source for study in studies))
    source = first.source
    if len(sources) > 1:
        source = f"{len(sources)} files, {first.source} to {sources[-1]}"
    if len(subjects) == 1 and len(sources) > 1:
        # Of a/x.csv the folder may be the subject, as in '{}/*', else the name, as in '{}.*'.
        ending = "/*" * first.source.count("/") or ".*"
        doubts.append(
            f"all {len(sources)} files are of one subject, {display_name(subjects[0].name)}. If "
            f"they are of several, --subject-from '{{}}{ending}' tells them from each other"
        )
    doubts += _condition_doubts(files_of_subjects)
    reading = replace(reading, doubts=tuple(doubts))
    return Study(
        subjects=tuple(subjects),
        source=source,
        synthetic=all(study.synthetic for study in studies),
        notes=tuple(notes),
        reading=reading,
    )


def _reading_of_all(studies: Sequence[Study]) -> Reading:
    """The readings of all studies as one, each entry once."""
    entries = {}
    for key in vars(studies[0].reading):
        entries[key] = tuple(
            dict.fromkeys(chain.from_iterable(getattr(study.reading, key) for study in studies))
        )
    return Reading(**entries)


def _common_notes(studies: Sequence[Study]) -> Iterator[str]:
    """The notes of all files; notes that differ in counts and names only become one note.

    The counts and names of this note are those of all files.
    """
    lines = []
    for study in studies:
        lines += [(study, note) for note in study.notes]

    for group in _alike(lines):
        first_study, first_note = group[0]
        n_files = len(group)
        note = sum_of_notes([note for _, note in group])
        if n_files == 1:
            note = f"{first_study.source}: {note}"
        elif note is None:  # they differ in the order of their words
            note = f"{n_files} files, such as {first_study.source}: {first_note}"
        elif n_files < len(studies):
            note = f"{n_files} of {len(studies)} files: {note}"
        yield note


def _subject_of_files(files: Sequence[tuple[str, Subject]]) -> Subject:
    """The subject in these files: its answers in order, or counts if a file has no order."""
    (_, first), *other_files = files
    if not other_files:
        return first
    answers = [(source, subject.answers) for source, subject in files if subject.answers]
    if len(answers) < len(files):
        whole_subject = pooled([subject for _, subject in files])
    else:
        whole_subject = Subject.from_answers(first.name, _joined(answers), first.task, first.unit)
    return replace(whole_subject, name=first.name, condition=first.condition)


def _copies(studies: Sequence[Study]) -> Iterator[str]:
    """Doubts about subjects, in one file or in several, who have the same answers, trial by trial.

    All subjects may have one list of stimuli, and sure answers to easy pairs. What counts is in how
    many ways the answers to each pair may fall on its trials, since all ways are as likely. A sound
    study has such a doubt with a probability below 2 %, whatever its size.
    """
    name_by_trials: dict[bytes, str] = {}
    n_subjects = sum(map(len, studies))
    for study in studies:
        for subject in study:
            answers = subject.answers
            log_ways = np.log(binom(subject.n_trials, subject.n_yes)).sum()
            # Any two subjects may be the same by chance.
            has_few_ways = log_ways < np.log(50 * n_subjects**2)
            if answers is None or not answers.has_trial_rows or has_few_ways:
                continue

            name = f"{study.source}: subject {display_name(subject.name)}"
            original = name_by_trials.setdefault(
                answers.keys.tobytes() + answers.counts.tobytes(), name
            )
            if original != name:
                yield f"{name} has the same trials and answers as {original}: {TWICE}, remove one"


def _condition_doubts(files_of_subjects: Mapping[str, Sequence[tuple[str, Any]]]) -> list[str]:
    """A doubt if the names of files seem to have a condition within subjects; else none.

    Beside the subject and numbers, which count days and blocks, most subjects have the same
    different names.

    Examples
    --------
    >>> names = {name: [(f"{name}_{level}.csv", "") for level in "ab"] for name in ("S1", "S2")}
    >>> _condition_doubts(names)[0][:42]
    'most subjects have files such as {}_a.csv '
    """
    counts = Counter[str]()
    for subject, files in files_of_subjects.items():
        counts.update({re.sub(r"\d+", "1", name.replace(subject, "{}")) for name, _ in files})
    common = sorted(text for text, n in counts.items() if n > 0.5 * len(files_of_subjects))
    if len(common) < 2 or len(files_of_subjects) < 2:
        return []
    return [
        f"most subjects have files such as {join_words(common)}, which are put together. If these "
        "are conditions, add a column condition with the name of each"
    ]


def _joined(answers: Sequence[tuple[str, Answers]]) -> Answers:
    """The answers of a subject in several files, by the names of the files, in their order.

    Each file is a block, or its blocks stay apart and have its name in theirs: 'b.csv: 1'.
    """
    block_names: list[str] = []
    next_place = 0
    answers_by_file = []
    for source, file_answers in answers:
        block = file_answers.block
        place = file_answers.place
        names = [source]
        if block is None:
            block = np.zeros(len(file_answers.n_trials), np.int64)
        else:
            names = [f"{source}: {name}" for name in file_answers.blocks]
        if place is not None:
            place = place - place[0] + next_place
            next_place = place[-1] + 2  # places with a gap between them begin a session
        block = block + len(block_names)  # their index among the blocks of all files
        answers_by_file.append(replace(file_answers, block=block, place=place))
        block_names += names

    columns: Record = {}
    for key in ("keys", "n_yes", "n_trials", "n_second", "block", "place"):
        arrays = [getattr(file_answers, key) for file_answers in answers_by_file]
        # What one file lacks is not known of the subject.
        if not any(array is None for array in arrays):
            columns[key] = np.concatenate(arrays)
    has_trial_rows = all(file_answers.has_trial_rows for file_answers in answers_by_file)
    return Answers(**columns, blocks=tuple(block_names), has_trial_rows=has_trial_rows)
