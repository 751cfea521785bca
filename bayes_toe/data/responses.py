"""What a column of answers says: words tell the task, numbers never do.

Right and wrong become answers by the sign of s2 - s1.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.data.column_roles import VOCABULARY, without_accents
from bayes_toe.data.messages import bare, listed, quoted
from bayes_toe.data.options import ReadOptions
from bayes_toe.data.tasks import SAME_DIFFERENT, TASKS, WHICH_STRONGER, Task, task_named
from bayes_toe.data.text_table import Column, TextTable
from bayes_toe.data.validation import MISSING_WORDS, is_no_response
from bayes_toe.errors import InputError, Remedy

if TYPE_CHECKING:
    from bayes_toe.data.study import Study

_YES, _NO, _MISSING, _UNKNOWN = 1, 0, -1, -2
#: The words of each task's two answers, in any case; and those of columns that say right or wrong.
_WORDS: dict[Task, tuple[tuple[str, ...], tuple[str, ...]]] = {
    SAME_DIFFERENT: (("equal", "same"), ("different",)),
    WHICH_STRONGER: (("second", "s2", "2nd"), ("first", "s1", "1st")),
}
_RIGHT_WRONG = (
    ("1", "true", "yes", "correct", "right", "hit"),
    ("0", "false", "no", "incorrect", "wrong", "error", "miss"),
)
#: The text that is the other answer where one was said to be an answer.
_OTHER = {"1": "0", "0": "1", "2": "1", "true": "false", "false": "true", "yes": "no", "no": "yes"}
_DIGIT = re.compile(r"(\d)[.,]0*")


class Responses(NamedTuple):
    """The answers of trials.

    `yes` where the one was given that the task counts, `asked` where there is an answer, shape
    (rows,) each.

    `no_answer` is where stimuli were equal, so that a right or wrong answer is none of the task's;
    `said` is how the texts were read.
    """

    task: Task
    yes: BoolArray
    asked: BoolArray
    no_answer: BoolArray
    said: str


def responses(
    table: TextTable, column: Column, options: ReadOptions, difference: FloatArray
) -> Responses:
    """The answers in a column, of trials with these differences s2 - s1.

    What cannot be read is noted in the table.

    Where no word is known, one line says so of the column, and another task than the one of the
    result may have been meant.
    """
    judged = options.correct is not None
    untold, remedies = "", list[Remedy]()
    if options.task is None and options.comparison_code is None:
        untold, remedies = _untold(column, difference)
    task = options.task or next((task for task in TASKS if _words_of(task, column)), SAME_DIFFERENT)
    names, words = (task.yes, task.no), _WORDS[task]
    if judged:
        names, words = ("right", "wrong"), _RIGHT_WRONG
    codes = _both_codes(column, options.codes(task))
    answer = column.map(lambda text: _answer(text, codes, words), np.int64)
    if untold:
        table.problems.add([(0, f"column {bare(column.name)}: {untold}")])
        table.problems.remedies += remedies
    else:
        shown = zip(options.codes(task), words, names, strict=True)
        texts = " or ".join(
            f"{', '.join(some) if code is None else quoted(code)} ({name})"
            for code, some, name in shown
        )
        python = f"ReadOptions({', '.join(f'{name}_code=...' for name in names)})"
        others = (
            ""
            if judged
            else f"; other codes by {python if table.python else ', '.join(f'--{name}-code' for name in names)}"
        )
        table.fault(column, answer == _UNKNOWN, f"{texts}, or empty{others}")
    said = f"responses {' / '.join(_as_answered(column, answer == value, word) for value, word in zip((_YES, _NO), names, strict=True))}"
    yes, asked, none = answer == _YES, answer != _MISSING, np.zeros(len(answer), np.bool_)
    if judged:
        said += f", '{task.yes}' or '{task.no}' by the sign of s2 - s1"
        none = asked & (task.right(difference) == 0)
        yes = yes == (task.right(difference) > 0)
    return Responses(task, yes & asked & ~none, asked & ~none, none, said)


def require_task(table: TextTable, task: Task, column: Column | None) -> None:
    """Refuse a column `task` that tells another task, or two.

    What tells none, such as the name of an experiment, is not looked at.
    """
    told = (
        {}
        if column is None
        else {named: text for text in column.texts if (named := task_named(text)) is not None}
    )
    if column is None or not told.keys() - {task}:
        return
    found = f"{table.source}: column {bare(column.name)}: found {' and '.join(quoted(text) for text in told.values())}"
    some = (
        f"ReadOptions(where={{{column.name!r}: ...}})"
        if table.python
        else f"--where {bare(column.name)}=TEXT"
    )
    allowed = (
        f"one task, which {some} chooses"
        if len(told) > 1
        else f"{task.name!r}, which the answers are of"
    )
    raise InputError(f"{found}, allowed: {allowed}")


def _words_of(task: Task, column: Column) -> list[str]:
    """The texts of a column that are words of a task."""
    known = {word for words in _WORDS[task] for word in words}
    return [text for text in column.texts if _english(text.lower()) in known]


def _english(word: str) -> str:
    """The word of a task that a word of another language stands for; else the word itself.

    Examples
    --------
    >>> _english("deuxi\u00e8me"), _english("j")
    ('second', 'j')
    """
    plain = without_accents(word)
    for english, translations in VOCABULARY["responses"].items():
        if plain in translations:
            return english
    return word


def without_missed(
    found: Responses, column: Column, signs: Sequence[Column]
) -> tuple[Responses, list[str]]:
    """Responses without trials that nobody answered, and the columns that say so.

    Experiment programs score a missed trial as wrong. An empty key or reaction time shows it: a
    column is a sign where some of its cells are empty, and no response in these rows is right.
    """
    if not signs:
        return found, []
    is_right = column.map(lambda text: _answer(text, (None, None), _RIGHT_WRONG) == _YES, np.bool_)
    is_missed = np.zeros(len(found.asked), np.bool_)
    names = []
    for sign in signs:
        is_empty = sign.map(lambda text: text.lower() in MISSING_WORDS, np.bool_)
        some = is_empty.any() and not is_empty.all()
        if some and not (is_empty & is_right).any():
            is_missed |= is_empty
            names.append(sign.name)
    is_there = ~is_missed
    answered = found._replace(
        yes=found.yes & is_there,
        asked=found.asked & is_there,
        no_answer=found.no_answer & is_there,
    )
    return answered, names


def _both_codes(
    column: Column, given: tuple[str | None, str | None]
) -> tuple[str | None, str | None]:
    """The codes of both responses; of two codes in a column the one not given is the other."""
    yes, no = given
    texts = {_plain(text) for text in column.texts if not is_no_response(text)}
    known = _plain(yes or no or "")
    if (yes is None) == (no is None) or len(texts) != 2 or known not in texts:
        return given
    (other,) = texts - {known}
    if other.lower() == known.lower():
        return given
    return (yes, other) if no is None else (other, no)


def _untold(column: Column, difference: FloatArray) -> tuple[str, list[Remedy]]:
    """What is said of a column whose words tell no task, or two, and what to type."""
    texts = [text for text in column.texts if not is_no_response(text)]
    told = [_words_of(task, column) for task in TASKS]
    if all(told):
        both = " and ".join(quoted(words[0]) for words in told)
        problem = (
            f"found {both}, words of two tasks, allowed: one task, such as the rows that "
            "--where COLUMN=TEXT chooses"
        )
        return problem, []
    if any(told) or not texts:
        return "", []
    plain = dict.fromkeys(_plain(text) for text in texts)
    by_word = {text.lower(): text for text in plain}
    likely = next((by_word[word] for word in ("1", "true", "yes") if word in by_word), texts[0])
    stronger = _commoner_for_stronger_second(column, difference) or likely
    ending = ""
    if len(plain) > 2:
        ending = "; name the other code too"
    remedies = [
        Remedy("equal_code", likely, f"if {likely} is 'equal' in a same-different task{ending}"),
        Remedy(
            "second_code", stronger, f"if {stronger} is 'the second was stronger' (2AFC){ending}"
        ),
    ]
    if by_word.keys() <= {*_RIGHT_WRONG[0], *_RIGHT_WRONG[1]}:
        meaning = f"if {likely} is a correct response (2AFC)"
        remedies.append(Remedy("correct", column.name, meaning))
    counts = np.bincount(column.codes, minlength=len(column.texts)).tolist()
    few = listed(
        [
            f"{quoted(text)} ({count:,})"
            for text, count in zip(column.texts, counts, strict=True)
            if text in texts
        ],
        4,
    )
    if len(texts) == 1:
        return f"the only code is {few}. The program does not know what it means.", remedies
    return f"the codes are {few}. The program does not know what they mean.", remedies


def _commoner_for_stronger_second(column: Column, difference: FloatArray) -> str:
    """The code that is commoner the larger s2 - s1 is; empty where no stimulus can be read."""
    is_number = np.isfinite(difference)
    if not is_number.any():
        return ""
    away = difference[is_number] - difference[is_number].mean()
    sums = np.bincount(column.codes[is_number], away, len(column.texts))
    for code in np.argsort(-sums, kind="stable").tolist():
        text = column.texts[code]
        if not is_no_response(text):
            return _plain(text)
    return ""


def _plain(text: str) -> str:
    """A cell without what spreadsheets do to it: the decimals of 1.0 and 0,0."""
    whole = _DIGIT.fullmatch(text)
    return text if whole is None else whole[1]


def _answer(text: str, given: Sequence[str | None], words: Sequence[Sequence[str]]) -> int:
    """The answer that a cell stands for: by the given codes, else by words."""
    plain, codes = _plain(text), [None if code is None else _plain(code) for code in given]
    if plain in codes:
        return (_YES, _NO)[codes.index(plain)]
    word = plain.lower()
    if is_no_response(word):
        return _MISSING
    if any(code is not None and word == code.lower() for code in codes):
        # where 'Different' was declared to mean equal, 'different' must not count as different by
        # default
        return _UNKNOWN
    for code, other, known, answer in zip(codes, codes[::-1], words, (_YES, _NO), strict=True):
        if code is None and (
            _english(word) in known or (other is not None and word == _OTHER.get(other.lower()))
        ):
            return answer
    return _UNKNOWN


def _as_answered(column: Column, chosen: BoolArray, word: str) -> str:
    """Which texts were read as an answer, and how often it was given."""
    texts = [column.texts[code] for code in np.unique(column.codes[chosen]).tolist()]
    meaning = "" if all(text.lower() == word for text in texts) else f" as {word}"
    return f"{listed([quoted(text) for text in texts]) if texts else repr(word)}{meaning} ({np.count_nonzero(chosen)})"


_REVERSED, _STRAIGHT = -5.0, 3.0  # z scores that nobody has by chance


def refuse_reversed(study: Study, remedy: str) -> None:
    """Refuse answers 'second' that are rarer the larger s2 - s1 is, in all of a study.

    They mean the opposite of what they say. Where that holds of some subjects while it does not
    of others, it is a finding of :mod:`bayes_toe.checks.answer_checks`.
    """
    if study.task != WHICH_STRONGER:
        return
    covariance = variance = squares = answer_variance = 0.0
    largest_z = -np.inf
    for subject in study:
        difference = subject.s2 - subject.s1
        x = difference - np.average(difference, weights=subject.n_trials)
        share = subject.fraction_yes
        own_squares = float(np.square(x) @ subject.n_trials)
        own_variance = own_squares * share * (1.0 - share)
        if own_variance == 0.0:  # one answer only, or one difference
            continue
        own_covariance = float(x @ subject.n_yes)
        covariance += own_covariance
        variance += own_variance
        squares += own_squares
        answer_variance += share * (1.0 - share) * subject.total_trials
        largest_z = max(largest_z, own_covariance / np.sqrt(own_variance))
    if covariance < _REVERSED * np.sqrt(variance) and largest_z < _STRAIGHT:
        correlation = covariance / np.sqrt(squares * answer_variance)
        found = f"found 'second' less often the larger s2 - s1 is (correlation {correlation:.2f})"
        allowed = "allowed: 'second' where the second stimulus was called the stronger"
        raise InputError(f"{study.source}: {found}, {allowed}; {remedy}")
