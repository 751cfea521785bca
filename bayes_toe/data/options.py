"""How to read a file whose layout is not the default: intensities, answer codes, column names; and which of its columns are read."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from bayes_toe.data.messages import bare, listed, quoted
from bayes_toe.data.study import Study
from bayes_toe.data.tasks import SAME_DIFFERENT, TASKS, WHICH_STRONGER, Task
from bayes_toe.errors import InputError

COLUMNS = (
    *("subject", "s1", "s2", "i1", "i2", "response", "n_equal", "n_second", "n_trials"),
    *("isi", "session", "block", "trial", "iti", "condition"),
)
#: Columns by which counts are no other: which trial came after which, for a look before answers are pooled and for models of history.
LOOKED_AT = ("session", "block", "trial", "iti")
_COUNTS = ("n_equal", "n_second", "n_trials")
_MAY_BE_IGNORED = ("isi", *LOOKED_AT, "condition")
_ANSWERS = {
    answer: task for task in (SAME_DIFFERENT, WHICH_STRONGER) for answer in (task.yes, task.no)
}
# Other spellings, in small letters and digits alone.
_SPELLINGS = {
    "subject": {
        "subj",
        "subjectid",
        "subjid",
        "participant",
        "participantid",
        "observer",
        "person",
        "vp",
    },
    "response": {"resp", "answer", "judgment", "judgement", "choice"},
    "correct": {
        "accuracy",
        "acc",
        "hit",
        "hits",
        "iscorrect",
        "responsecorrect",
        "respcorr",
        "corr",
        "keyrespcorr",
    },
    "n_equal": {"nsame", "equal", "kequal"},
    "n_second": {"second", "ksecond"},
    "n_trials": {"trials", "ntotal", "total"},
    "isi": {
        "isis",
        "isims",
        "isisec",
        "interval",
        "intervals",
        "intervalms",
        "interstimulusinterval",
        "soa",
        "soams",
        "gap",
        "delay",
    },
    "block": {
        "blocks",
        "blocknr",
        "blockno",
        "blocknum",
        "blocknumber",
        "blockindex",
        "blockid",
        "run",
        "runnr",
    },
    "session": {
        "sessions",
        "sess",
        "sessionnr",
        "sessionno",
        "sessionnum",
        "sessionnumber",
        "sessionid",
        "day",
    },
    "trial": {"trialnr", "trialno", "trialnum", "trialnumber", "trialindex", "trialid", "trialn"},
    "iti": {"itis", "itims", "intertrialinterval", "rsi"},
}


@dataclass(frozen=True)
class ReadOptions:
    """How to read a file whose layout is not the default.

    Parameters
    ----------
    intensity : float, optional
        REF: columns i1, i2 hold raw amplitudes i and are read as s = ln(i / REF). Positive, in the unit of the columns.
    equal_code, different_code, second_code, first_code : str, optional
        The text that stands for this answer, which also decides the task; other texts for it are then refused.
    correct : str, optional
        A column that says whether the question which stimulus was the stronger was answered rightly: 'second' or 'first' then follows from
        the sign of s2 - s1.
    columns : mapping of str to str
        Our column names to those of the file, for columns that the file names otherwise.
    ignore : str or sequence of str
        Columns isi, session, block, trial, iti or condition that are not read although they are there; without isi pairs are pooled over
        the intervals.
    where : mapping of str to str
        Columns of the file to the exact text that a row must have there to be read, for files in which not every row is a trial.
    subject_from : str, optional
        For files without a column of subjects: how they are named, with {} where the subject stands and * for any other text, such as
        "sub-{}_*.tsv"; with / the last folders are looked at, too.
    condition : str, optional
        The column of a condition that differs within subjects; by default one that is called condition, where there is one. With "isi"
        intervals are levels, and no longer times.
    reference : str, optional
        The level with which others are compared; by default the first one, sorted.
    categorical : bool
        Whether levels that are numbers are names all the same, and not numbers of which there is a slope.

    Raises
    ------
    InputError
        If REF is not positive and finite, a code is empty, both codes are one text, codes are of two tasks, a column name is unknown or
        repeated, or the name of files has not one {}.

    Examples
    --------
    >>> ReadOptions(equal_code=" f ", different_code="j").equal_code
    'f'
    """

    intensity: float | None = None
    equal_code: str | None = None
    different_code: str | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    where: Mapping[str, str] = field(default_factory=dict)
    subject_from: str | None = None
    second_code: str | None = None
    first_code: str | None = None
    correct: str | None = None
    ignore: Sequence[str] | str = ()
    condition: str | None = None
    reference: str | None = None
    categorical: bool = False

    def __post_init__(self) -> None:
        for key in (
            *(f"{answer}_code" for answer in _ANSWERS),
            "correct",
            "condition",
            "reference",
        ):
            text = getattr(self, key)
            object.__setattr__(self, key, None if text is None else text.strip())
        for key in ("columns", "where"):
            object.__setattr__(
                self, key, {name.strip(): text.strip() for name, text in getattr(self, key).items()}
            )
        object.__setattr__(
            self, "ignore", (self.ignore,) if isinstance(self.ignore, str) else tuple(self.ignore)
        )
        problems = []
        if self.intensity is not None and not (
            math.isfinite(self.intensity) and self.intensity > 0
        ):
            problems.append(
                f"--intensity: found {self.intensity!r}, allowed: a positive finite number"
            )
        problems += self._code_problems()
        problems += _name_problems(f"{ours}={theirs}" for ours, theirs in self.columns.items())
        unknown = [quoted(one) for one in self.ignore if one not in _MAY_BE_IGNORED]
        problems += [
            f"--ignore: found {one}, allowed: {', '.join(_MAY_BE_IGNORED)}" for one in unknown
        ]
        if self.subject_from is not None and self.subject_from.count("{}") != 1:
            found = quoted(self.subject_from)
            problems.append(
                f"--subject-from: found {found}, allowed: a file's name with one {{}}, such as 'sub-{{}}_*.tsv'"
            )
        if problems:
            raise InputError(problems)

    def _code_problems(self) -> list[str]:
        """What is said of codes that are empty, that are one text, and of what tells the task twice."""
        given = {option: text for option, (_, text) in self._telling().items()}
        problems = [
            f"{name}: found '', allowed: a text that is not empty"
            for name, text in given.items()
            if text == ""
        ]
        for task in TASKS:
            yes, no = self.codes(task)
            if yes and yes == no:
                problems.append(
                    f"--{task.no}-code: found {quoted(yes)} as --{task.yes}-code, allowed: two different texts"
                )
        if len({task for task, _ in self._telling().values()}) > 1 or (
            self.correct is not None and len(given) > 1
        ):
            problems.append(
                f"{', '.join(given)}: found together, allowed: what tells one task in one way"
            )
        return problems

    def _telling(self) -> dict[str, tuple[Task, str]]:
        """What was given that tells the task, by option: the task and the text."""
        codes = {
            f"--{answer}-code": (task, getattr(self, f"{answer}_code"))
            for answer, task in _ANSWERS.items()
        }
        return {
            option: one
            for option, one in {**codes, "--correct": (WHICH_STRONGER, self.correct)}.items()
            if one[1] is not None
        }

    @property
    def task(self) -> Task | None:
        """The task that the options tell, if they do."""
        return next((task for task, _ in self._telling().values()), None)

    def codes(self, task: Task) -> tuple[str | None, str | None]:
        """The texts that were given for the two answers of a task."""
        return getattr(self, f"{task.yes}_code"), getattr(self, f"{task.no}_code")

    def name(self, ours: str) -> str:
        """What the file calls a column of ours."""
        given = {"correct": self.correct, "condition": self.condition}.get(ours)
        return self.columns.get(ours, given if given else ours)

    @property
    def stimuli(self) -> tuple[str, str]:
        """Our names of the columns of the two stimuli."""
        return ("s1", "s2") if self.intensity is None else ("i1", "i2")


def parse_columns(text: str) -> dict[str, str]:
    """Column names as on the command line, ``subject=participant,s1=first``: ours to the file's. An InputError has a line a problem."""
    problems = _name_problems(text.split(","))
    if problems:
        raise InputError(problems)
    return {
        ours.strip(): theirs.strip()
        for ours, _, theirs in (entry.partition("=") for entry in text.split(","))
    }


def parse_where(texts: Iterable[str]) -> dict[str, str]:
    """Which rows are read, as on the command line, each COLUMN=TEXT. An InputError has a line for each that is wrong or named again."""
    pairs = [(text, *(part.strip() for part in text.partition("=")[::2])) for text in texts]
    names = [name for _, name, _ in pairs]
    wrong = [text for text, name, value in pairs if not name or not value or names.count(name) > 1]
    if wrong:
        raise InputError(
            [
                f"--where: found {quoted(text)}, allowed: COLUMN=TEXT, each column once"
                for text in wrong
            ]
        )
    return {name: value for _, name, value in pairs}


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
        blocks_of: dict[str, list[str]] = {}
        for text in texts:
            name, blocks = _subject_and_blocks(text, study, option)
            before = blocks_of.get(name)
            together = [*(before or ()), *blocks]
            is_again = before is not None and not (blocks and before)
            if is_again or len({*together}) < len(together):
                raise InputError(f"{option} {text}: named twice; name each subject or block once")
            blocks_of[name] = together
        for name, blocks in blocks_of.items():
            study = change(study, name, blocks)
    return study


def _subject_and_blocks(text: str, study: Study, option: str) -> tuple[str, list[str]]:
    """The subject and the blocks that SUBJECT:BLOCK,BLOCK names; names may have colons."""
    names = [name for name in study.names if text == name or text.startswith(f"{name}:")]
    name = max(names, key=len, default=text.partition(":")[0])
    if name not in study.names:
        known = listed([bare(other) for other in study.names])
        raise InputError(f"{option} {text}: no subject {quoted(name)}; the subjects are {known}")
    if text == name:
        return name, []
    return name, [block.strip() for block in text[len(name) + 1 :].split(",")]


def subject_in(path: Path, pattern: str) -> str | None:
    """The subject that a file's name tells; None where it does not fit.

    Examples
    --------
    >>> subject_in(Path("bids/sub-07/beh/sub-07_task-same_events.tsv"), "sub-{}_*"), subject_in(Path("S1/trials.csv"), "{}/trials.csv")
    ('07', 'S1')
    """
    tail = "/".join(path.absolute().parts[-1 - pattern.count("/") :])
    kinds = {"{}": "([^/]+?)", "*": "[^/]*"}
    found = re.fullmatch(
        "".join(kinds.get(part, re.escape(part)) for part in re.split(r"(\{\}|\*)", pattern)), tail
    )
    return None if found is None else found[1]


def looks_like(name: str, ours: str) -> bool:
    """Whether a column of a file looks like one of ours in another spelling."""
    plain = re.sub("[^a-z0-9]", "", name.lower())
    return plain == ours.replace("_", "") or plain in _SPELLINGS.get(ours, ())


def _name_problems(entries: Iterable[str]) -> list[str]:
    """What is said of entries OURS=NAME that name no column of ours or of the file, or that name one twice."""
    problems, taken = [], set[tuple[str, str]]()
    for entry in entries:
        ours, theirs = (part.strip() for part in entry.partition("=")[::2])
        known, again = ours in COLUMNS and theirs, taken & {("ours", ours), ("theirs", theirs)}
        if not known or again:
            how = "each name once, as OURS=NAME" if known else "OURS=NAME"
            problems.append(
                f"--columns: found {quoted(entry.strip())}, allowed: {how} with OURS one of {', '.join(COLUMNS)}"
            )
        taken |= {("ours", ours), ("theirs", theirs)}
    return problems


# --- Which columns are read ---------------------------------------------------------------------------


def columns_to_read(
    names: Sequence[str], options: ReadOptions, *, python: bool = False
) -> tuple[list[str], list[str]]:
    """Our names of the columns that a table with these names is read from, and what is wrong with the names.

    Examples
    --------
    >>> columns_to_read(["subject", "s1", "s2", "n_equal", "n_trials", "rt"], ReadOptions())
    (['subject', 's1', 's2', 'n_equal', 'n_trials'], [])
    """
    needed = _needed(names, options)
    theirs = [options.name(ours) for ours in needed]
    lines = [*_answer_problems(names, needed, options, python)]
    for name in dict.fromkeys(name for name in theirs if theirs.count(name) > 1):
        roles = " and as ".join(ours for ours in needed if options.name(ours) == name)
        lines.append(f"column {bare(name)}: found as {roles}, allowed: one meaning per column")
    found = listed([quoted(name) for name in names])
    missing = [name for name in options.where if names.count(name) != 1]
    lines += [
        f"column {bare(name)}: --where needs one column of this name, found {found}, allowed: one of these"
        for name in missing
    ]
    if options.subject_from is not None:
        needed.remove("subject")
        if options.name("subject") in names:
            lines.append(
                f"column {bare(options.name('subject'))}: found together with --subject-from, allowed: one of them"
            )
    for ours in (*COLUMNS, "correct"):
        count = names.count(options.name(ours))
        if count == 0 and (ours in needed or ours in options.columns):
            hint = "; ".join(_ways_out(names, options, ours, python))
            lines.append(
                f"column {bare(options.name(ours))}: missing, found {found}, allowed: a column of this name, or {hint}"
            )
        elif count > 1 and ours in needed:
            lines.append(
                f"column {bare(options.name(ours))}: found {count} columns of this name, allowed: one"
            )
    return needed, lines


def _answer_problems(
    names: Sequence[str], needed: Sequence[str], options: ReadOptions, python: bool
) -> Iterable[str]:
    """What is said where answers are told twice, are of two tasks, or are none."""
    counts, response = (
        [bare(options.name(ours)) for ours in _COUNTS if ours in needed],
        options.name("response"),
    )
    if "response" in needed and counts:
        both = f"{bare(options.name('n_equal'))} and {bare(options.name('n_trials'))}"
        allowed = f"{bare(response)} alone (one row per trial) or {both} alone (one row per pair)"
        yield f"column {bare(response)}: found together with {' and '.join(counts)}, allowed: {allowed}"
    elif len(counts) > 2:
        yield f"column {counts[1]}: found together with {counts[0]}, allowed: one of them, since a study has one task"
    if "response" in needed and response in names and looks_like(response, "correct"):
        how = f"ReadOptions(correct={response!r})" if python else f"--correct {bare(response)}"
        found = "found as response, though it seems to say right or wrong"
        yield f"column {bare(response)}: {found}, allowed: {how} (which is stronger), or a column that has the answers"


def _needed(names: Sequence[str], options: ReadOptions) -> list[str]:
    """Our names of the columns that these names call for, and of those that there may be."""
    # No inference reads block and trial: twice there, or named as something else, they are left out like any other column.
    others = [options.name(ours) for ours in COLUMNS if ours not in LOOKED_AT]
    looked_at = [
        ours
        for ours in LOOKED_AT
        if options.name(ours) not in others and names.count(options.name(ours)) == 1
    ]
    counts = [ours for ours in _COUNTS if options.name(ours) in names]
    if options.correct is not None:
        answers = ["correct"]
    elif options.name("response") in names or not counts:
        answers = ["response", *counts]
    else:
        answers = (
            [*(ours for ours in counts if ours != "n_trials"), "n_trials"]
            if counts != ["n_trials"]
            else ["n_equal", "n_trials"]
        )
    condition = ["condition"] if options.condition or options.name("condition") in names else []
    isi = (
        ["isi"]
        if options.name("isi") in names
        and not (condition and options.name("isi") == options.name("condition"))
        else []
    )
    isi += condition
    return [
        "subject",
        *options.stimuli,
        *answers,
        *(ours for ours in (*isi, *looked_at) if ours not in options.ignore),
    ]


def _ways_out(names: Sequence[str], options: ReadOptions, ours: str, python: bool) -> Iterable[str]:
    """What else is allowed in the place of a column that is missing."""
    taken = [options.name(one) for one in COLUMNS]
    theirs = next(
        (bare(name) for name in names if name not in taken and looks_like(name, ours)), "NAME"
    )
    if ours == "correct":
        yield f"ReadOptions(correct={theirs!r})" if python else f"--correct {theirs}"
    else:
        yield (
            f"ReadOptions(columns={{{ours!r}: {theirs!r}}})"
            if python
            else f"--columns {ours}={theirs}"
        )
    amplitudes, logs = (("i1", "i2"), ("s1", "s2"))
    if ours in logs and any(options.name(other) in names for other in amplitudes):
        how = "ReadOptions(intensity=REF)" if python else "--intensity REF"
        yield f"the amplitudes {bare(options.name('i1'))}, {bare(options.name('i2'))} need {how}"
    if ours in amplitudes and any(options.name(other) in names for other in logs):
        how = "intensity" if python else "--intensity"
        yield f"the log intensities {bare(options.name('s1'))}, {bare(options.name('s2'))} are read without {how}"
    if ours == "subject" and theirs == "NAME" and not python:
        yield "or --subject-from '{}.csv', where the name of the file tells it"
    if ours == "response":
        yield f"or counts in {bare(options.name('n_equal'))} or {bare(options.name('n_second'))}, and {bare(options.name('n_trials'))}"
        right = next((bare(name) for name in names if looks_like(name, "correct")), None)
        yield from (
            [
                f"or {f'correct={right!r}' if python else f'--correct {right}'}, where that says right or wrong"
            ]
            if right
            else []
        )
    if ours == "n_equal":
        yield f"or {bare(options.name('n_second'))}, where the question was which is stronger"
