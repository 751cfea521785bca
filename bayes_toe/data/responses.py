"""A column of responses as answers.

`responses` reads words or codes. Known words tell the task too; codes such as 1 and 2 need an
option. A column of right and wrong becomes answers by the sign of s2 - s1. `without_missed` drops
trials that nobody answered. `require_direction` refuses a study whose answers mean the opposite.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import chain, compress, permutations
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray, IntArray
from bayes_toe.data.column_roles import (
    TRUE_WORDS,
    VOCABULARY,
    is_missed_flag,
    is_no_response,
    named_places,
    without_accents,
)
from bayes_toe.data.messages import (
    Texts,
    display_name,
    join_names,
    join_words,
    plural,
    quoted,
)
from bayes_toe.data.options import ReadOptions
from bayes_toe.data.tasks import (
    SAME_DIFFERENT,
    THREE_ANSWERS,
    Task,
    task_named,
    task_with,
    tasks_named,
)
from bayes_toe.data.text_table import CELL, Column, TextTable
from bayes_toe.data.validation import MISSING_WORDS, number
from bayes_toe.errors import InputError, Remedy, with_remedies

if TYPE_CHECKING:
    from bayes_toe.data.layouts import StandardOrder
    from bayes_toe.data.study import Study, Subject

#: What a text stands for: the index of an answer of the task, of which the first one is counted, or
#: no response, or nothing known.
_YES = 0
_MISSING = -1
_UNKNOWN = -2
#: The words of each answer, in any case; and those of columns that say right or wrong.
_WORDS: dict[str, tuple[str, ...]] = {
    "equal": ("equal", "same"),
    "different": ("different",),
    "second": ("second", "s2", "2nd"),
    "first": ("first", "s1", "1st"),
}
_RIGHT_WRONG = (
    ("1", "true", "yes", "correct", "right", "hit"),
    ("0", "false", "no", "incorrect", "wrong", "error", "miss"),
)
_CODE_MEANINGS = {
    "equal_code": "'equal' in a same-different task",
    "second_code": "'the second was stronger' (2AFC)",
    "comparison_code": "'the comparison was stronger' (2AFC)",
}

#: Largest share of the trials that are mistakes, and that nobody answered.
_MOST_MISTAKES = 0.05
_MOST_MISSED = 0.2
#: Largest share of pairs of equal stimuli in 2AFC. Each of three levels with each makes a third.
_MOST_EQUAL = 0.35

_ALL_WORDS = (*_WORDS.values(), *VOCABULARY["stimuli"].values())
#: The text that options give for each answer of a task.
Codes: TypeAlias = Sequence[str | None]
#: What is wrong with a column, empty if nothing is, and options to type.
Question: TypeAlias = tuple[str, list[Remedy]]


class Responses(NamedTuple):
    """The responses of trials, shape (rows,) each."""

    task: Task
    is_yes: BoolArray  # the response that the task counts
    is_second: BoolArray  # of three responses: 'second'
    is_answered: BoolArray
    is_unscorable: BoolArray  # right or wrong, where equal stimuli have no right answer
    note: list[object]  # how the texts were read, as the parts of a Note


def responses(
    table: TextTable,
    column: Column,
    task_column: Column | None,
    options: ReadOptions,
    difference: FloatArray,
    order: StandardOrder,
) -> Responses:
    """The responses in a column, of trials with these s2 - s1; missed ones are empty.

    What cannot be read is a problem of the table. Where no word is known, there is one problem for
    the whole column, and the task of the result is a guess.
    """
    has_scores = options.correct is not None
    stated_task = _stated_task(column, task_column, options)
    task = stated_task or task_with(_words_by_answer(column)) or SAME_DIFFERENT
    names = task.answers
    words = tuple(_WORDS[answer] for answer in task.answers)
    if has_scores:
        names = ("right", "wrong")
        words = _RIGHT_WRONG
    codes = _all_codes(column, options.codes(task))
    answer_index = column.map(lambda text: _answer_index(text, codes, words), np.int64)

    # What makes an answer likelier, by the option that names its code.
    trends = {"equal_code": -abs(difference), "second_code": difference}
    if options.has_standard:
        trends["comparison_code"] = np.where(order.is_first, difference, -difference)
    problem = ""
    remedies = list[Remedy]()
    if stated_task is None and options.comparison_code is None:
        problem, remedies = _unknown_meaning(column, task_column, trends)
    if not problem:
        problem, remedies = _unknown_texts(column, answer_index, codes, names)
    three_answers = _three_answers(column, answer_index, names, options, trends)
    remedies = _remedies_of_third(column, answer_index, names, three_answers) or (
        three_answers + remedies
    )

    if problem:
        table.problems.ask(f"{column}: {problem}", remedies)
    else:
        rule = _allowed_texts(options.codes(task), words, names)
        if not has_scores:
            rule += f"; other codes by {', '.join(f'--{name}-code' for name in names)}"
        table.fault(column, answer_index == _UNKNOWN, rule)
        table.problems.remedies += remedies

    note = _reading_note(column, answer_index, names)
    is_yes = answer_index == _YES
    is_answered = answer_index != _MISSING
    is_unscorable = np.zeros(len(answer_index), bool)
    if has_scores:  # the first answer is then 'right'
        note[-1] = f"), '{task.yes}' or '{task.no}' by the sign of s2 - s1"
        right_answer = task.right(difference)
        is_unscorable = is_answered & (right_answer == 0)
        _require_two_answers(table, column, is_yes[is_unscorable], is_answered)
        is_yes = is_yes == (right_answer > 0)
    is_answered &= ~is_unscorable
    is_second = (answer_index == THREE_ANSWERS.answers.index("second")) & (task == THREE_ANSWERS)
    return Responses(task, is_yes & is_answered, is_second, is_answered, is_unscorable, note)


def _require_two_answers(
    table: TextTable, column: Column, is_right: BoolArray, is_answered: BoolArray
) -> None:
    """Refuse scores of 2AFC if many answers are to equal stimuli, and both right and wrong.

    `is_right` has those answers.
    """
    n_right = is_right.sum()
    if 0 < n_right < len(is_right) and len(is_right) > _MOST_EQUAL * is_answered.sum():
        problem = (
            f"{column}: found {n_right} right and {len(is_right) - n_right} wrong answers to equal "
            "stimuli, allowed: answers to which was stronger, of which none is right there. If "
            "participants said whether stimuli were equal, add a column response with 'equal' or "
            "'different', and leave --correct out; if not, remove these rows"
        )
        table.problems.ask(problem, [])


def _reading_note(column: Column, answer_index: IntArray, names: Texts) -> list[object]:
    """The parts of a note such as "responses 'j' as second (20) / 'f' as first (20)"."""
    note: list[object] = ["responses"]
    for i, name in enumerate(names):
        is_answer = answer_index == i
        texts = column.only(is_answer).texts
        words = join_names(map(quoted, texts or [name]))
        if any(text.lower() != name for text in texts):
            words += f" as {name}"
        note += [f" {words} (", is_answer.sum(), ") /"]
    note[-1] = ")"  # no slash after the last answer
    return note


def _allowed_texts(codes: Codes, words: Sequence[Texts], names: Texts) -> str:
    """The texts that stand for all answers: "'j' (second) or 'f' (first), or empty"."""
    parts = []
    for code, known_words, name in zip(codes, words, names, strict=True):
        texts = ", ".join(known_words) if code is None else quoted(code)
        parts.append(f"{texts} ({name})")
    return f"{' or '.join(parts)}, or empty"


def require_task(table: TextTable, task: Task, column: Column | None) -> None:
    """Refuse a column `task` that names another task.

    A text that names none, such as that of an experiment, is ignored.
    """
    for text, other_task in _tasks_in(column).items():
        if other_task != task:
            raise InputError(
                f"{table.source}: {column}: found {quoted(text)}, allowed: {task.name!r}, which "
                "the answers are of; --where COLUMN=TEXT chooses rows"
            )


def _stated_task(column: Column, task_column: Column | None, options: ReadOptions) -> Task | None:
    """The task of the options; else the one that all rows name, if a response is a word of it."""
    if options.task is not None or task_column is None:
        return options.task

    tasks = {task_named(text) for text in task_column.texts}  # None if a text names no task
    if len(tasks) != 1:
        return None
    (task,) = tasks
    if task is None or _words_by_answer(column).keys().isdisjoint(task.answers):
        return None
    return task


def _words_by_answer(column: Column) -> dict[str, str]:
    """By answer, the first text of a column that is a word of it: {'second': 'zweiter'}."""
    word_by_answer = dict[str, str]()
    for text in column.texts:
        for answer, words in _WORDS.items():
            if _english(text.lower()) in words:
                word_by_answer.setdefault(answer, text)
    return word_by_answer


def _english(word: str) -> str:
    """The answer that a word of another language, or several words, stand for; else the word.

    Examples
    --------
    >>> _english("deuxi\u00e8me"), _english("j")
    ('second', 'j')
    >>> _english("interval 1"), _english("second heavier"), _english("second lighter")
    ('first', 'second', 'second lighter')
    """
    plain = without_accents(word)
    for answer, translations in VOCABULARY["responses"].items():
        if plain in translations:
            return answer
    _, places, other_words = named_places(word)
    if len(places) == 1 and other_words and other_words <= {*VOCABULARY["words"]["answer"]}:
        return places[0]
    return word


def blank_missed(
    column: Column, options: ReadOptions, has_stimuli: BoolArray
) -> tuple[Column, list[str]]:
    """A column of responses whose missed trials are empty, and the texts that say so.

    Texts that only rows without stimuli have, such as units or the subject's age, become empty too.
    """
    trials = column.only(has_stimuli)
    missed = _missed_texts(trials, options)
    # Without any stimuli, the columns of the stimuli are the problem, and not the responses.
    answers = {*(trials.texts or column.texts)}.difference(missed)
    texts = [text if text in answers else "" for text in column.texts]
    texts_to_name = [text for text in missed if text.lower() not in MISSING_WORDS]
    return Column.from_texts(column.name, texts, column.codes), cells_of(column, texts_to_name)


def _missed_texts(column: Column, options: ReadOptions) -> Texts:
    """The texts that say that nobody responded.

    -1 is one, as jsPsych writes it, if two other texts or more are words or given codes, and all
    answers of the task are among the others. A number or a sign that is as frequent as an answer is
    none.

    Examples
    --------
    >>> _missed_texts(Column.from_texts("response", ["first", "-1", "none", "2nd"]), ReadOptions())
    ['none', '-1']
    """
    given_codes = (*options.code_by_answer.values(), options.comparison_code)
    codes = {*map(_plain, filter(None, given_codes))}
    declared = {*map(_plain, options.missed)}
    missed = []
    answers = set()
    is_filled = ~column.map(lambda text: text.lower() in MISSING_WORDS)
    is_frequent = np.bincount(column.codes, is_filled) > 1 + _MOST_MISSED * is_filled.sum()
    frequent = {*map(_plain, compress(column.texts, is_frequent))}
    for text in column.texts:
        plain = _plain(text)
        if plain in declared or (plain not in codes | frequent and is_no_response(plain)):
            missed.append(text)
        else:
            answers.add(plain)

    words_of_answers = _ALL_WORDS if options.correct is None else _RIGHT_WRONG
    known_words = {*chain(*words_of_answers)}
    words = answers - codes - {"-1"}
    has_known_words = known_words.issuperset(_english(word.lower()) for word in words)
    n_answers = len((options.task or SAME_DIFFERENT).answers)
    if "-1" in answers - codes - frequent and len(answers) > n_answers and has_known_words:
        missed += [text for text in column.texts if _plain(text) == "-1"]
    return missed


def without_missed(
    answers: Responses, column: Column, signs: Sequence[Column], declared: Texts
) -> tuple[Responses, list[str]]:
    """Responses without trials that nobody answered, and the texts that say so.

    Experiment programs score a missed trial as wrong. The `signs` of one are its key, its reaction
    time or a column such as `timed_out`. `declared` are texts that the options name.
    """
    is_right = column.map(lambda text: _answer_index(text, (None, None), _RIGHT_WRONG) == _YES)
    causes = []
    for sign in signs:
        texts = []
        for text in sign.texts:
            if text in declared or _shows_missed(sign, text, is_right):
                texts.append(text)
        causes += cells_of(sign, texts)
        is_valid = ~sign.matches(texts)
        answers = answers._replace(
            is_yes=answers.is_yes & is_valid,
            is_answered=answers.is_answered & is_valid,
            is_unscorable=answers.is_unscorable & is_valid,
        )
    return answers, causes


def cells_of(column: Column, texts: Texts) -> list[str]:
    """Texts and their column, such as ["'-1', empty in column rt"]; nothing without texts."""
    if not texts:
        return []
    cells = [quoted(text) if text else "empty" for text in texts]
    return [f"{join_names(cells)} in {column}"]


def _shows_missed(sign: Column, text: str, is_right: BoolArray) -> bool:
    """Whether a text in a column says that nobody responded, and no response beside it is right.

    Examples
    --------
    >>> times = Column.from_texts("rt", ["512", "-1", "377"])
    >>> _shows_missed(times, "-1", np.array([True, False, True]))
    True
    """
    word = _plain(text).lower()
    is_sign = is_no_response(word) or word in VOCABULARY["missed"]["signs"]
    if is_missed_flag(sign):
        is_sign = word in TRUE_WORDS
    has_text = sign.matches([text])
    if not is_sign or has_text.all() or (has_text & is_right).any():
        return False
    if word == "0":
        return len(sign.texts) > 2  # of two keys, 0 may be one
    if word not in VOCABULARY["missed"]["unclear"]:
        return True
    # A time of 999 ms may be a reaction, if others are longer than a tenth of it. It is a sign all
    # the same if so many responses with it are all wrong by chance with a probability below .01.
    is_as_large = sign.map(lambda other: number(other) > 0.1 * number(word))
    share_wrong = 1.0 - is_right[~has_text].mean()
    may_be_chance = share_wrong ** has_text.sum() > 0.01
    return not (may_be_chance and (is_as_large & ~has_text).any())


def _all_codes(column: Column, codes: Codes) -> Codes:
    """The codes of all answers; one that is not given is the only other text of the column.

    Examples
    --------
    >>> _all_codes(Column.from_texts("response", ["j", "f"]), ("j", None))
    ('j', 'f')
    """
    given_codes = {*map(_plain, filter(None, codes))}
    texts = {*map(_plain, column.texts)} - {""}
    other_texts = texts - given_codes
    if codes.count(None) != 1 or len(other_texts) != 1:
        return codes

    (other,) = other_texts
    # Neither a word instead of a code, nor the given code in another case.
    has_words = given_codes.isdisjoint(texts) and _words_by_answer(column)
    if has_words or other.lower() in map(str.lower, given_codes):
        return codes
    return tuple(code or other for code in codes)


def _unknown_meaning(
    column: Column, task_column: Column | None, trends: Mapping[str, FloatArray]
) -> Question:
    """The problem of a column whose words tell no task, or two; empty without a problem.

    The trends are by option.
    """
    tasks_by_text = _tasks_in(task_column)
    texts = list(filter(None, column.texts))
    shares = join_names(column.counts(texts), 4)
    words_by_answer = _words_by_answer(column)
    if words_by_answer:
        if task_with(words_by_answer) is not None:
            return "", []
        words = join_words(list(map(quoted, words_by_answer.values())))
        return _two_tasks(f"found {words}, words of two tasks", task_column)
    if len({*tasks_by_text.values()}) > 1:
        tasks = join_words(list(map(quoted, tasks_by_text)))
        return _two_tasks(f"found {shares} of the tasks {tasks}", task_column)
    if not texts:
        return "", []

    counts = _count_remedies(column, texts)
    if counts:
        return f"found numbers: {shares}. What do they count?", counts
    problem = f"the codes are {shares}. The program does not know what they mean."
    if len(texts) == 1:
        problem = f"the only code is {shares}. The program does not know what it means."
    remedies = []
    task_answers = {*chain.from_iterable(task.answers for task in tasks_by_text.values())}
    for remedy in _code_remedies(column, texts, trends):
        # The other remedies, such as --correct, are about which was stronger.
        answer = "equal" if remedy.option == "equal_code" else "second"
        if not task_answers or answer in task_answers:
            remedies.append(remedy)
    return problem, remedies


def _count_remedies(column: Column, texts: Texts) -> list[Remedy]:
    """Options to type if the cells of a wide table are counts or proportions."""
    remedies = []
    if column.name == CELL and len(texts) > 3 and all(text[0].isdecimal() for text in texts):
        for answer in ("second", "equal"):
            meaning = f"if they count '{answer}' or are its proportions"
            remedies.append(Remedy("columns", ((f"n_{answer}", CELL),), meaning))
    return remedies


def _two_tasks(finding: str, task_column: Column | None) -> Question:
    """The problem of a column with responses to two tasks, and options that choose one of them."""
    problem = (
        f"{finding}, allowed: one task, such as the rows that --where COLUMN=TEXT chooses; "
        "contrast compares the tasks that --condition COLUMN names"
    )
    remedies = []
    if task_column is not None:
        for text, task in tasks_named(task_column.texts).items():
            meaning = f"for the task {task.name!r}"
            remedies.append(Remedy("where", ((task_column.name, text),), meaning))
    return problem, remedies


def _tasks_in(column: Column | None) -> dict[str, Task]:
    """The tasks that a column `task` names, by its texts."""
    return {} if column is None else tasks_named(column.texts)


def _unknown_texts(
    column: Column,
    answer_index: IntArray,
    codes: Codes,
    names: Texts,
) -> Question:
    """The problem of a column with several unknown texts, if the code of one answer is missing."""
    unknown = column.only(answer_index == _UNKNOWN)
    n_answers = len({*answer_index.tolist()} - {_MISSING, _UNKNOWN})
    if n_answers == len(names) or len(unknown.texts) < 2 or codes.count(None) != 1:
        return "", []

    other = names[codes.index(None)]
    shares = join_names(unknown.counts(unknown.texts), 4)
    if not n_answers:
        return f"the codes are {shares}. None of them is the code that was given.", []
    commonest = unknown.texts[int(np.bincount(unknown.codes).argmax())]
    remedies = [Remedy(f"{other}_code", commonest, f"if {commonest} is '{other}'")]
    return f"the other codes are {shares}. Which of them is '{other}'?", remedies


def _remedies_of_third(
    column: Column, answer_index: IntArray, names: Texts, three_answers: list[Remedy]
) -> list[Remedy]:
    """Options to type if a column has one text too many, and the rarest may be a missed trial.

    They are empty where the column has other questions first.
    """
    unknown = column.only(answer_index == _UNKNOWN)
    counts = np.bincount(unknown.codes)
    n_answers = len({*answer_index.tolist()} - {_MISSING, _UNKNOWN})
    most_missed = _MOST_MISSED * np.count_nonzero(answer_index != _MISSING)
    n_rarest = int(counts.min(initial=len(answer_index)))
    if n_answers + len(counts) != len(names) + 1 or n_rarest >= most_missed:
        return []

    text = unknown.texts[counts.argmin()]
    meaning = f"only if nobody responded in these {plural(n_rarest, 'trial')}; it drops them"
    remedies = [*three_answers, Remedy("missed", text, meaning)]
    # Beside -1, 0 is the middle one of three answers.
    if text[0] in "-9" or (text == "0" and "-1" not in column.texts):
        return remedies[::-1]
    return remedies if len(counts) == 1 else []  # a word is asked about after the answers


def _three_answers(
    column: Column,
    answer_index: IntArray,
    names: Texts,
    options: ReadOptions,
    trends: Mapping[str, FloatArray],
) -> list[Remedy]:
    """Options to type if three frequent texts, not all known, are those of three answers."""
    words = _words_by_answer(column)
    is_two_answers = len(names) == 2 and options.correct is None and "different" not in words
    n_answered = np.count_nonzero(answer_index != _MISSING)
    is_frequent = np.bincount(column.codes) > _MOST_MISTAKES * n_answered
    texts = [_plain(text) for text in compress(column.texts, is_frequent) if text]
    if len(texts) != 3 or not is_two_answers or _UNKNOWN not in answer_index:
        return []

    codes = {**words, **options.code_by_answer}
    different_code = codes.pop("different", None)  # no answer of three
    for answer in ("equal", "second"):
        if answer not in codes:
            free_texts = [text for text in texts if text not in codes.values()]
            likeliest, _ = _commonest_with(column, free_texts, trends[f"{answer}_code"])
            codes[answer] = likeliest or free_texts[0]

    equal = codes["equal"]
    second = codes["second"]
    meaning = f"if {equal} is 'equal' and {second} is 'second' of three answers"
    if different_code is not None:
        meaning += ", in place of --different-code"
    return [Remedy("equal_code", equal, meaning, together=(Remedy("second_code", second),))]


def _code_remedies(column: Column, texts: Texts, trends: Mapping[str, FloatArray]) -> list[Remedy]:
    """Options to type if these codes tell no task, the likeliest first."""
    by_word = {text.lower(): text for text in map(_plain, texts)}
    likely = next(filter(None, map(by_word.get, ("1", "true", "yes"))), texts[0])
    correlations = dict[Remedy, float]()
    for option, trend in trends.items():
        code, correlation = _commonest_with(column, texts, trend)
        code = code or likely
        remedy = Remedy(option, code, f"if {code} is {_CODE_MEANINGS[option]}")
        correlations[remedy] = correlation
    remedies = sorted(correlations, key=correlations.__getitem__, reverse=True)

    if by_word.keys() <= {*chain(*_RIGHT_WRONG)}:
        meaning = f"if {likely} is a correct response (2AFC)"
        remedies.append(Remedy("correct", column.name, meaning))
    return remedies


def _commonest_with(column: Column, texts: Texts, trend: FloatArray) -> tuple[str, float]:
    """The text with the largest positive correlation with a trend, and this correlation.

    The text is empty if no correlation is positive, or no stimulus can be read.
    """
    is_number = np.isfinite(trend)
    trend = trend[is_number]
    best = ""
    largest = 0.0
    for text in texts:
        is_code = column.matches([text])[is_number]
        if is_code.any() and not is_code.all() and np.ptp(trend):
            correlation = float(np.corrcoef(is_code, trend)[0, 1])
            if correlation > largest:
                best = _plain(text)
                largest = correlation
    return best, largest


def _plain(text: str) -> str:
    """A cell without what spreadsheets add to whole numbers: '1.0' is '1', and '0,0' is '0'."""
    match = re.fullmatch(r"([-+]?\d+)[.,]0*", text)
    return match[1] if match else text


def _answer_index(text: str, codes: Codes, words: Sequence[Texts]) -> int:
    """The index of the answer that a cell stands for, or `_MISSING`, or `_UNKNOWN`.

    An answer has a code, or words if its code is None.
    """
    plain = _plain(text)
    codes = [code and _plain(code) for code in codes]
    if plain in codes:
        return codes.index(plain)
    word = plain.lower()
    if not word:
        return _MISSING
    # Where 'Different' was declared to mean equal, 'different' is not read by default.
    if word not in map(str.lower, filter(None, codes)):
        for index, (code, known_words) in enumerate(zip(codes, words, strict=True)):
            if code is None and _english(word) in known_words:
                return index
    return _UNKNOWN


def response_trend(subject: Subject, x: FloatArray) -> tuple[float, float]:
    """Sum over trials of the counted response times centred x, and its variance by chance.

    `x` has a value for each pair, shape (pairs,).
    """
    centred = x - np.average(x, weights=subject.n_trials)
    share = subject.fraction_yes
    variance = share * (1.0 - share) * (np.square(centred) @ subject.n_trials)
    return float(centred @ subject.n_yes), float(variance)


def direction(study: Study) -> int:
    """Whether 'second' is commoner (1) or rarer (-1) the larger s2 - s1 is, in all of a study.

    It is 0 unless the sum over subjects is beyond chance (z of 5), more than half of the subjects
    with both answers have a z of more than 1, and none has the opposite (a z of 3). A study of
    subjects who guess is called reversed once in three million times. If some subjects of many are
    reversed, :mod:`bayes_toe.checks.answer_checks` finds them.
    """
    covariances = []
    variances = []
    for unit in study:
        subject = unit.two_answers if unit.task.has_direction else None
        if subject is None:
            continue
        covariance, variance = response_trend(subject, subject.s2 - subject.s1)
        if variance > 0.0:  # both answers, and two differences
            covariances.append(covariance)
            variances.append(variance)
    z = np.array(covariances) / np.sqrt(variances)
    z_of_study = sum(covariances) / np.sqrt(sum(variances) or 1.0)
    sign = int(np.sign(z_of_study))
    is_shared = np.count_nonzero(sign * z > 1.0) > 0.5 * len(z)
    is_clear = abs(z_of_study) > 5.0 and is_shared and (sign * z > -3.0).all()
    return sign if is_clear else 0


def require_direction(
    study: Study, options: ReadOptions, read: Callable[[ReadOptions], Study]
) -> None:
    """Refuse reversed answers, with the options under which a new reading has none."""
    if direction(study) >= 0:
        return

    rule = "'second' where the second stimulus was called the stronger"
    if options.correct:
        rule += f"; column {display_name(options.correct)} says right of those"
    elif "n_trials" in study.reading.read:
        rule += f"; {display_name(options.name('n_second'))} counts those"

    candidates = []
    if options.interval_column is not None:
        owner = "standard" if options.comparison_interval else "comparison"
        meaning = f"if it says the interval of the {owner}, in place of what is typed"
        candidates.append(Remedy(f"{owner}_interval", options.interval_column, meaning))
    for code, other in permutations(study.reading.codes, 2):
        first = Remedy("first_code", other)
        second = Remedy("second_code", code, f"if {code} is 'second'", together=(first,))
        candidates += [second, Remedy("comparison_code", code, f"if {code} is 'comparison'")]

    remedies = []
    for remedy in candidates:
        before = options
        if remedy.option == "standard_interval":
            before = replace(options, comparison_interval=None)
        with suppress(InputError):  # the options may not fit the file
            if direction(read(with_remedies(before, [remedy, *remedy.together]))) > 0:
                remedies.append(remedy)
    raise InputError(
        f"{study.source}: found 'second' less often the larger s2 - s1 is, allowed: {rule}.",
        remedies,
    )
