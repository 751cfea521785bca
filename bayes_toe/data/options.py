"""The options with which a file is read: intensities, codes of responses, names of columns.

`ReadOptions` has and checks them. `parse_pairs` and `parse_columns` read NAME=TEXT from the command
line. `changed` swaps answers and excludes subjects. `subject_in` finds the subject in the name of a
file.
"""

from __future__ import annotations

import math
import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, product
from numbers import Real
from pathlib import Path
from typing import Any

from bayes_toe.arrays import StrPath
from bayes_toe.data.messages import Texts, display_name, join_display_names, quoted
from bayes_toe.data.stimulus_unit import LOG_UNITS, StimulusUnit
from bayes_toe.data.study import Study, units_by_subject
from bayes_toe.data.tasks import WHICH_STRONGER, Task, task_with
from bayes_toe.data.text_table import plain_code, value_text
from bayes_toe.errors import InputError, require_kind

COLUMNS = (
    "subject", "s1", "s2", "i1", "i2", "standard", "comparison", "response",
    "n_first", "n_equal", "n_different", "n_second", "n_comparison", "n_standard", "n_correct",
    "n_trials",
    "session", "block", "trial", "condition",
)  # fmt: skip
#: Columns that say which trial came after which. They change no count: checks before answers are
#: pooled and models of history use them.
HISTORY_COLUMNS = ("session", "block", "trial")
_MAY_BE_IGNORED = ("isi", *HISTORY_COLUMNS, "condition", "practice")
_ANSWERS = ("equal", "different", "second", "first")
#: Fields whose texts must not be empty.
_TEXT_FIELDS = (
    "equal_code", "different_code", "second_code", "first_code", "correct", "condition",
    "reference", "unit", "wide", "comparison_code", "standard_interval", "comparison_interval",
    "standard_first_code", "subject_from", "encoding", "sheet",
)  # fmt: skip


@dataclass(frozen=True)
class ReadOptions:
    """Options for files whose layout is not the default.

    Parameters
    ----------
    intensity : float, optional
        REF: columns i1, i2 hold raw intensities i and are read as s = ln(i / REF). Positive, in the
        unit of the columns.
    unit : str, optional
        Of the stimuli: "ln" (natural logs, the default), "log10", "dB" (20 per factor of ten of
        the amplitude), "dB-power" (10 per factor of ten), "octaves", "semitones" or "cents". Other
        names of logarithms, such as "dB SPL", are refused. Any other text, such as "g" or "Hz",
        is the unit of raw intensities in i1 and i2, or in s1 and s2 if these are there alone; REF
        is then 1 where no other number is given.
        Screens and figures show stimuli in this unit, and their differences in dB or per cent.
        The unit may also stand in each cell, such as "7.0%".
    equal_code, different_code, second_code, first_code : str, optional
        The text that stands for this answer, or several with commas between them, as of ratings:
        "4,5,6". The options also decide the task: with 'equal' and 'second' or 'first', it has
        three answers. Other texts for the answer are then refused.
    correct : str, optional
        A column that says whether the question which stimulus was the stronger was answered
        rightly: 'second' or 'first' then follows from the sign of s2 - s1.
    columns : mapping of str to str
        Our column names to those of the file, for columns that the file names otherwise.
    missed : str or sequence of str
        Texts in the column of responses that say that nobody responded, also several with commas
        between them; with `correct`, in columns of keys and reaction times, too.
    ignore : str or sequence of str
        Columns session, block, trial or condition that are not read although they are there.
        With "isi", checks do not remark that answers at all intervals are pooled. With "practice",
        rows that are marked as practice are read.
    where : mapping of str to str
        Columns of the file to the exact text that a row must have there to be read, for files in
        which not every row is a trial. An empty text stands for an empty cell.
    subject_from : str, optional
        The pattern of file names with the subject, with {} where the subject stands and * for any
        other text, such as "sub-{}_*.tsv"; with / the last folders are looked at, too. With {}
        twice, the subject of old/1.csv is 'old_1'. A column of subjects is then ignored.
    condition : str, optional
        The column of a condition that differs within subjects; by default a column that is called
        condition, where there is one.
    reference : str, optional
        The level with which other levels are compared; by default the first in sorted order.
    categorical : bool
        Whether levels that are numbers are names all the same, and not numbers of which there is a
        slope.
    decimal : {".", ","}, optional
        The decimal sign of the stimuli, where '1.050' may be 1050; the other sign groups thousands.
    standard_interval : str, optional
        For columns `standard` and `comparison` in the place of s1 and s2: the column that says in
        which interval the standard was, 1 or 2. A response 'comparison' is 'second' where the
        comparison was second, and else 'first'.
    comparison_interval : str, optional
        The same for a column with the interval of the comparison, test, target or signal. It holds
        if both options name one column.
    standard_first_code : str, optional
        The text in this column that stands for trials in which the standard was first.
    standard_first : bool
        For the same columns: the standard was the first stimulus in all trials.
    comparison_code : str, optional
        The text that stands for the response 'comparison'; the other text is 'standard'.
    wide : str, optional
        For tables with a column for each pair: the pattern of the names of these columns, such as
        "{first}_{second}", where * stands for any other text. The cells are responses. They may be
        something else, such as counts: columns={"n_second": "cell"}. If no name of a column fits
        the pattern, the cells of one column must fit it, such as "{first} vs {second}".
    encoding : str, optional
        Of a text that is neither UTF-8 nor UTF-16, such as 'cp1252'.
    sheet : str, optional
        The sheet of an Excel file of which several have tables. Or a pattern, with {} where the
        name of the sheet has the subject and * for any other text: "{}", "*", "session *".

    Raises
    ------
    InputError
        If REF is not positive and finite, a code is empty, both codes are one text, codes are of
        two tasks, a column name is unknown or repeated, or the name of files has not one {}.

    Examples
    --------
    >>> ReadOptions(equal_code=" f ", different_code="j").equal_code
    'f'
    """

    intensity: float | None = None
    unit: str | None = None
    equal_code: str | None = None
    different_code: str | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    where: Mapping[str, str] = field(default_factory=dict)
    subject_from: str | None = None
    second_code: str | None = None
    first_code: str | None = None
    correct: str | None = None
    ignore: Sequence[str] | str = ()
    missed: Sequence[str] | str = ()
    condition: str | None = None
    reference: str | None = None
    categorical: bool = False
    decimal: str | None = None
    standard_interval: str | None = None
    comparison_interval: str | None = None
    standard_first_code: str | None = None
    standard_first: bool = False
    comparison_code: str | None = None
    wide: str | None = None
    encoding: str | None = None
    sheet: str | None = None

    def __post_init__(self) -> None:
        self._strip_texts()
        problems = list(self._value_problems())
        # Where a condition is named, its levels may be two tasks, each with its codes. Each task is
        # then read with options of its own, which have no condition, and are checked here.
        if self.condition is None:
            problems += self._code_problems()
        problems += self._name_problems()
        if problems:
            raise InputError(problems)

    def _strip_texts(self) -> None:
        """Replace all values by texts without spaces around them."""
        values: dict[str, Any] = vars(self)  # a frozen dataclass refuses assignments
        for key in _TEXT_FIELDS:
            if values[key] is None:
                continue
            values[key] = _as_text(values[key])
            # A code is as in the cells of responses, unless it is a list, such as '1,0'.
            if key.endswith("_code") and "," not in values[key]:
                values[key] = plain_code(values[key])

        for key in ("columns", "where"):
            texts = values[key]
            require_kind(key, texts, Mapping, "texts by name, such as {'subject': 'participant'}")
            values[key] = {_as_text(name): _as_text(text) for name, text in texts.items()}

        for key in ("ignore", "missed"):
            entries = values[key]
            if isinstance(entries, str | int | float):
                entries = [entries]
            require_kind(key, entries, Iterable, "a text, or several in a list")
            values[key] = tuple(map(_as_text, entries))

    def _value_problems(self) -> Iterator[str]:
        """Problems of texts, numbers, and options that exclude or need each other, a line each."""
        for key in _TEXT_FIELDS:
            if getattr(self, key) == "":
                yield f"--{key.replace('_', '-')}: found '', allowed: a text that is not empty"

        intensity = 1.0 if self.intensity is None else self.intensity
        is_number = isinstance(intensity, Real)
        if not is_number or not 0.0 < intensity < sys.float_info.max:
            yield f"--intensity: found {self.intensity!r}, allowed: a positive finite number"

        try:
            StimulusUnit(self.unit or "")
        except InputError as error:
            yield from error.problems

        if self.intensity is not None and self.unit in LOG_UNITS:
            yield (
                f"--intensity: found with --unit {self.unit}, allowed: --unit alone for logarithms"
            )

        if self.decimal not in (None, ".", ","):
            yield f"--decimal: found {self.decimal!r}, allowed: '.' or ','"

        interval_columns = {self.standard_interval, self.comparison_interval} - {None}
        if len(interval_columns) + self.standard_first > 1:
            yield (
                "--standard-first, --standard-interval, --comparison-interval: found together, "
                "allowed: one of them"
            )
        if self.standard_first_code is not None and not interval_columns:
            yield "--standard-first-code: found alone, allowed: with --standard-interval COLUMN"

    def _code_problems(self) -> Iterator[str]:
        """Problems of the codes of responses: one code of two answers, and codes of two tasks."""
        codes = self.code_by_answer
        options = [f"--{answer}-code" for answer in codes]
        for other, answer in combinations(codes, 2):
            if codes[other] == codes[answer]:
                yield (
                    f"--{answer}-code: found {quoted(codes[answer])} as --{other}-code, allowed: "
                    "different texts"
                )

        if self.correct is not None:
            options.append("--correct")
        # Scores need no codes. A single code always tells a task.
        if len(options) > 1 and (self.correct is not None or self.task is None):
            yield f"{', '.join(options)}: found together, allowed: what tells one task in one way"

    def _name_problems(self) -> Iterator[str]:
        """Problems of the names of columns and files, a line each."""
        for role, name in self.columns.items():
            if role not in COLUMNS or not name:
                yield (
                    f"--columns: found {quoted(f'{role}={name}')}, allowed: OURS=NAME with OURS "
                    f"one of {', '.join(COLUMNS)}; proportions are named as counts"
                )

        for role in self.ignore:
            if role not in _MAY_BE_IGNORED:
                yield f"--ignore: found {quoted(role)}, allowed: {', '.join(_MAY_BE_IGNORED)}"

        if self.wide is not None:
            stimuli = re.findall(r"\{(?:first|second)\}", self.wide)
            if stimuli != ["{first}", "{second}"] or "{first}{second}" in self.wide:
                yield (
                    f"--wide: found {quoted(self.wide)}, allowed: {{first}}, some text, "
                    "{second}, such as '{first}_{second}'"
                )

        if self.subject_from is not None and "{}" not in self.subject_from:
            yield (
                f"--subject-from: found {quoted(self.subject_from)}, allowed: a file's name with "
                "{}, such as 'sub-{}_*.tsv'"
            )

    @property
    def code_by_answer(self) -> dict[str, str]:
        """The codes of responses that are given, such as {'equal': 'f'}."""
        codes = {}
        for answer in _ANSWERS:
            code = getattr(self, f"{answer}_code")
            if code is not None:
                codes[answer] = code
        return codes

    @property
    def task(self) -> Task | None:
        """The task that codes or scores tell; None without them."""
        if self.correct is not None:
            return WHICH_STRONGER
        answers = set(self.code_by_answer)
        if answers and self.comparison_code is not None:
            answers.add("second")  # or 'first', by the order of the stimuli
        return task_with(answers)

    @property
    def without_condition(self) -> ReadOptions:
        """The options without a condition, also where a column has its name."""
        return replace(self, condition=None, ignore=(*self.ignore, "condition"))

    def of_task(self, task: Task, where: Mapping[str, str]) -> ReadOptions:
        """The options for the rows of one task: those that have the texts of `where` by column.

        The options have no codes of other tasks, and no condition.
        """
        other_codes = {f"{answer}_code": None for answer in _ANSWERS if answer not in task.answers}
        if task != WHICH_STRONGER:
            other_codes["correct"] = None
        options = replace(self, where={**self.where, **where}, **other_codes)  # type: ignore[arg-type]
        return options.without_condition

    def codes(self, task: Task) -> tuple[str | None, ...]:
        """The code of each answer of a task, in the order of its answers."""
        return tuple(map(self.code_by_answer.get, task.answers))

    def name(self, role: str) -> str:
        """The name in the file of the column with this role."""
        chosen_by_role = {
            "correct": self.correct,
            "condition": self.condition,
            "standard_interval": self.interval_column,
        }
        return self.columns.get(role) or chosen_by_role.get(role) or role

    @property
    def has_standard(self) -> bool:
        """Whether the stimuli are a standard and a comparison."""
        return self.standard_first or self.interval_column is not None

    @property
    def interval_column(self) -> str | None:
        """The column that says which of standard and comparison came first."""
        return self.comparison_interval or self.standard_interval

    @property
    def stimuli(self) -> tuple[str, str]:
        """Our names of the columns of the two stimuli."""
        if self.has_standard:
            return "standard", "comparison"
        return ("i1", "i2") if self.has_intensities else ("s1", "s2")

    @property
    def stimulus_names(self) -> Texts:
        """The names in the file of the columns of the two stimuli."""
        return list(map(self.name, self.stimuli))

    @property
    def stimulus_unit(self) -> StimulusUnit:
        """The unit in which stimuli and their differences are shown."""
        return StimulusUnit(self.unit or "", math.log(self.intensity or 1.0))

    @property
    def unit_in_words(self) -> str:
        """The unit of the stimuli in words; empty for natural logs that no option names."""
        unit = "" if self.unit is None else display_name(self.unit)
        if self.intensity is not None:
            return f"intensity in units of {float(self.intensity)!r} {unit}".rstrip()
        return f"intensity in {unit}" if self.has_intensities else unit

    @property
    def has_intensities(self) -> bool:
        """Whether the stimuli are raw intensities."""
        return self.intensity is not None or self.unit not in (None, *LOG_UNITS)


def _as_text(value: object) -> str:
    """A text without spaces around it; a number is as in a table, so that 1.0 is '1'."""
    return value_text(value).strip()


def parse_columns(text: str) -> dict[str, str]:
    """The file's names of columns by ours, from OURS=NAME,OURS=NAME.

    A name may have commas and signs of equality.

    Examples
    --------
    >>> parse_columns("s1=first,response=key (1=first, 2=second)")
    {'s1': 'first', 'response': 'key (1=first, 2=second)'}
    """
    # At a comma before 's1 =', or at the end.
    entries = re.split(r",(?=\s*[^\W\d]\w*\s*=)|,$", text)
    return parse_pairs("--columns", filter(None, entries), "OURS=NAME")


def parse_pairs(
    option: str, entries: Iterable[str], form: str, may_be_empty: bool = False
) -> dict[str, str]:
    """Texts by name, as on the command line, where each entry is NAME=TEXT.

    Raises
    ------
    InputError
        For the first entry of another form, or with the name of an earlier entry.

    Examples
    --------
    >>> parse_pairs("--columns", ["subject=participant", "s1 = first"], "OURS=NAME")
    {'subject': 'participant', 's1': 'first'}
    """
    pairs = {}
    for entry in entries:
        name, sign, text = map(str.strip, entry.partition("="))
        has_text = text or (sign and may_be_empty)
        if not name or not has_text or name in pairs:
            raise InputError(
                f"{option}: found {quoted(entry.strip())}, allowed: {form}, each name once"
            )
        pairs[name] = text
    return pairs


def changed(study: Study, swap: Iterable[str] = (), exclude: Iterable[str] = ()) -> Study:
    """The study with responses swapped, then subjects or blocks excluded.

    Each text is SUBJECT or SUBJECT:BLOCK,BLOCK as on the command line.

    Raises
    ------
    InputError
        As :meth:`~bayes_toe.data.study.Study.swap`, and if a subject or block is named twice.
    """
    for option, texts, change in (
        ("--swap", swap, Study.swap),
        ("--exclude", exclude, Study.exclude),
    ):
        # Units with their blocks. '--swap A:3 --swap A' swaps all blocks but 3.
        earlier_targets = Counter[tuple[str, str]]()
        for text in texts:
            units, blocks = _units_and_blocks(text, study, option)
            earlier_targets.update(product(units, blocks or [""]))
            if max(earlier_targets.values()) > 1:
                raise InputError(f"{option} {text}: named twice; name each subject or block once")
            study = change(study, units, blocks)
    return study


def _units_and_blocks(text: str, study: Study, option: str) -> tuple[list[str], list[str]]:
    """The names of the units and blocks in a text SUBJECT:BLOCK,BLOCK; SUBJECT alone has no blocks.

    SUBJECT may be a unit, which is a subject in one condition. `option` is for messages.
    """
    units_by_name = units_by_subject(study) | {unit.name: (unit,) for unit in study}
    names = [name for name in units_by_name if f"{text}:".startswith(f"{name}:")]
    if not names:
        unknown_name = quoted(text.partition(":")[0])
        raise InputError(
            f"{option} {text}: no subject {unknown_name}; the subjects are "
            f"{join_display_names(study.names)}"
        )

    name = max(names, key=len)  # 'S:1' before 'S', as names may have colons
    unit_names = [unit.name for unit in units_by_name[name]]
    if text == name:
        return unit_names, []
    return unit_names, [block.strip() for block in text[len(name) + 1 :].split(",")]


def subject_in(path: object, pattern: str) -> str | None:
    """The subject that the path of a file tells; None if it does not fit, and for a data frame.

    Examples
    --------
    >>> subject_in(Path("sub-07/beh/sub-07_task-same_events.tsv"), "sub-{}_*")
    '07'
    >>> subject_in(Path("S1/trials.csv"), "{}/trials.csv")
    'S1'
    >>> subject_in(Path("old/1.csv"), "{}/{}.*")
    'old_1'
    """
    if not isinstance(path, StrPath):
        return None
    n_folders = pattern.count("/")
    end_of_path = "/".join(Path(path).absolute().parts[-1 - n_folders :])
    # 'sub-{}_*' becomes 'sub-([^/]+?)_[^/]*'.
    regex = re.escape(pattern).replace(r"\{\}", "([^/]+?)").replace(r"\*", "[^/]*")
    match = re.fullmatch(regex, end_of_path)
    return match and "_".join(match.groups())
