"""A column of responses as answers.

`responses` reads words or codes. Known words tell the task too; codes such as 1 and 2 need an
option. A column of right and wrong becomes answers by the sign of s2 - s1. `without_missed` drops
trials that nobody answered. `require_direction` refuses a study whose answers mean the opposite.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
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
    MAX_LINES,
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
    task_with,
    tasks_named,
)
from bayes_toe.data.text_table import CELL, Column, TextTable
from bayes_toe.data.validation import MISSING_WORDS, number
from bayes_toe.errors import InputError, Remedy, with_remedies

if TYPE_CHECKING:
    from bayes_toe.data.layouts import StandardOrder
    from bayes_toe.data.study import Study, Subject

#: What a text stands for: the answer of a task at this position, such as the first one, no
#: response, or nothing known.
_YES, _MISSING, _UNKNOWN = 0, -1, -2
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

#: Share of the trials that a mistake has at most, and that missed trials have at most.
_RARE, _MANY = 0.05, 0.2

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

    What cannot be read is noted in the table. Where no word is known, one line says so of the
    column, and another task than the one of the result may have been meant.
    """
    has_scores = options.correct is not None
    task_told = _task_told(column, task_column, options)
    task = task_told or task_with(_words_by_answer(column)) or SAME_DIFFERENT
    names, words = task.answers, tuple(_WORDS[answer] for answer in task.answers)
    if has_scores:
        names, words = ("right", "wrong"), _RIGHT_WRONG
    codes = _all_codes(column, options.codes(task))
    answer = column.map(lambda text: _answer(text, codes, words), np.int64)

    problem, remedies = "", list[Remedy]()
    if task_told is None and options.comparison_code is None:
        # What makes an answer likelier, by the option that names its code.
        trends = {"equal_code": -abs(difference), "second_code": difference}
        if options.has_standard:
            trends["comparison_code"] = np.where(order.is_first, difference, -difference)
        problem, remedies = _unknown_meaning(column, task_column, trends)
    if not problem:
        problem, remedies = _unknown_texts(column, answer, codes, names)
    remedies = _three_answers(column, answer, names, options, difference) + remedies

    if problem:
        table.problems.ask(f"{column}: {problem}", remedies)
    else:
        rule = _allowed_texts(options.codes(task), words, names)
        if not has_scores:
            rule += f"; other codes by {', '.join(f'--{name}-code' for name in names)}"
        table.fault(column, answer == _UNKNOWN, rule)
        table.problems.remedies += remedies

    note: list[object] = ["responses"]
    for i, name in enumerate(names):  # `answer` has positions among the names
        is_answer = answer == i
        note += [f" {_texts_read(column, is_answer, name)} (", is_answer.sum(), ") /"]
    note[-1] = ")"  # no slash after the last answer

    is_yes, is_answered = answer == _YES, answer != _MISSING
    is_unscorable = np.zeros(len(answer), bool)
    if has_scores:  # then `_YES` stands for 'right'
        note[-1] = f"), '{task.yes}' or '{task.no}' by the sign of s2 - s1"
        right_answer = task.right(difference)  # above 0 where it is the counted one, 0 without one
        is_unscorable = is_answered & (right_answer == 0)
        is_yes = is_yes == (right_answer > 0)
    is_answered &= ~is_unscorable
    is_second = (answer == THREE_ANSWERS.answers.index("second")) & (task == THREE_ANSWERS)
    return Responses(task, is_yes & is_answered, is_second, is_answered, is_unscorable, note)


def _allowed_texts(codes: Codes, words: Sequence[Texts], names: Texts) -> str:
    """The texts that stand for all answers, in words."""
    parts = []
    for code, known_words, name in zip(codes, words, names, strict=True):
        texts = ", ".join(known_words) if code is None else quoted(code)
        parts.append(f"{texts} ({name})")
    return f"{' or '.join(parts)}, or empty"


def require_task(table: TextTable, task: Task, column: Column | None) -> None:
    """Refuse a column `task` that tells another task.

    What tells none, such as the name of an experiment, is not looked at.
    """
    for text, other_task in _tasks_in(column).items():
        if other_task != task:
            raise InputError(
                f"{table.source}: {column}: found {quoted(text)}, allowed: {task.name!r}, which "
                "the answers are of; --where COLUMN=TEXT chooses rows"
            )


def _task_told(column: Column, task_column: Column | None, options: ReadOptions) -> Task | None:
    """The task of the options; else the one that all rows name, if a response is a word of it."""
    if options.task is not None or task_column is None:
        return options.task

    task_by_text = _tasks_in(task_column)
    tasks_of_rows = {task_by_text.get(text) for text in task_column.texts}  # None: names no task
    if len(tasks_of_rows) != 1:
        return None
    (task,) = tasks_of_rows
    if task is None or _words_by_answer(column).keys().isdisjoint(task.answers):
        return None
    return task


def _words_by_answer(column: Column) -> dict[str, str]:
    """The first text of a column that is a word of an answer, by the answer."""
    word_by_answer = dict[str, str]()
    for text in column.texts:
        for answer, words in _WORDS.items():
            if _english(text.lower()) in words:
                word_by_answer.setdefault(answer, text)
    return word_by_answer


def _english(word: str) -> str:
    """The word of a task that a word of another language, or several words, stand for.

    Without one it is the word itself.

    Examples
    --------
    >>> _english("deuxi\u00e8me"), _english("j")
    ('second', 'j')
    >>> _english("interval 1"), _english("second heavier"), _english("second lighter")
    ('first', 'second', 'second lighter')
    """
    plain = without_accents(word)
    for english, translations in VOCABULARY["responses"].items():
        if plain in translations:
            return english
    _, places, other_words = named_places(word)
    if len(places) == 1 and other_words and other_words <= {*VOCABULARY["words"]["answer"]}:
        return places[0]
    return word


def blank_missed(
    column: Column, options: ReadOptions, has_stimuli: BoolArray
) -> tuple[Column, list[str]]:
    """A column of responses whose missed trials are empty, and the texts that say so.

    Texts of other rows, such as units or questions about the subject, are empty, too.
    """
    trials = column.only(has_stimuli)
    missed = _missed_texts(trials, options)
    answers = {*(trials.texts or column.texts)}.difference(missed)
    texts = [text if text in answers else "" for text in column.texts]
    texts_to_name = [text for text in missed if text.lower() not in MISSING_WORDS]
    return Column.from_texts(column.name, texts, column.codes), cells_of(column, texts_to_name)


def _missed_texts(column: Column, options: ReadOptions) -> Texts:
    """The texts that say that nobody responded.

    -1 is one, as jsPsych has it, beside two texts that are words or given codes.
    """
    given_codes = (*options.code_by_answer.values(), options.comparison_code)
    codes = {*map(_plain, filter(None, given_codes))}
    declared = {*map(_plain, options.missed)}
    missed, answers = [], set()
    for text in column.texts:
        plain = _plain(text)
        if plain in declared or (plain not in codes and is_no_response(plain)):
            missed.append(text)
        else:
            answers.add(plain)

    other_answers = answers - codes - {"-1"}
    known_words = {*chain(*(_ALL_WORDS if options.correct is None else _RIGHT_WRONG))}
    is_known = known_words.issuperset(_english(answer.lower()) for answer in other_answers)
    if "-1" in answers - codes and len(answers) > 2 and is_known:
        missed += [text for text in column.texts if _plain(text) == "-1"]
    return list(dict.fromkeys(missed))


def without_missed(
    answers: Responses, column: Column, signs: Sequence[Column], declared: Texts
) -> tuple[Responses, list[str]]:
    """Responses without trials that nobody answered, and what says so.

    Experiment programs score a missed trial as wrong. Its key, its reaction time or a column such
    as `timed_out` shows it. `declared` are the texts that the options name.
    """
    is_right = column.map(lambda text: _answer(text, (None, None), _RIGHT_WRONG) == _YES)
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
    """Texts and their column, as a note names them; nothing where there is no text."""
    if not texts:
        return []
    shown_texts = [quoted(text) if text else "empty" for text in texts]
    return [f"{join_names(shown_texts)} in {column}"]


def _shows_missed(sign: Column, text: str, is_right: BoolArray) -> bool:
    """Whether a text in a column says that nobody responded, and no response beside it is right."""
    word = _plain(text).lower()
    is_sign = is_no_response(word) or word in VOCABULARY["missed"]["signs"]
    if is_missed_flag(sign):
        is_sign = word in TRUE_WORDS
    is_chosen = sign.matches([text])
    if not is_sign or is_chosen.all() or (is_chosen & is_right).any():
        return False
    if word == "0":
        return len(sign.texts) > 2  # of two keys, 0 may be one
    if word not in VOCABULARY["missed"]["unclear"]:
        return True
    # A time of 999 ms may be a reaction, beside others of its size. It is a sign all the same if so
    # many responses with it would not all be wrong by chance.
    is_as_large = sign.map(lambda other: number(other) > 0.1 * number(word))
    share_wrong = 1.0 - is_right[~is_chosen].mean()
    is_chance = share_wrong ** is_chosen.sum() > 0.01
    return not (is_chance and (is_as_large & ~is_chosen).any())


def _all_codes(column: Column, codes: Codes) -> Codes:
    """The codes of all responses; if one is missing, it is the only other code of a column."""
    chosen = {*map(_plain, filter(None, codes))}
    texts = {*map(_plain, column.texts)} - {""}
    other_texts = texts - chosen
    if codes.count(None) != 1 or len(other_texts) != 1:
        return codes

    (other,) = other_texts
    has_words = chosen.isdisjoint(texts) and _words_by_answer(column)
    if has_words or other.lower() in map(str.lower, chosen):  # a word, or a code in other case
        return codes
    return tuple(code or other for code in codes)


def _unknown_meaning(
    column: Column, task_column: Column | None, trends: Mapping[str, FloatArray]
) -> Question:
    """Problems of a column whose words tell no task, or two, with options to type.

    `trends` are what makes an answer likelier, by the option that names its code.
    """
    tasks_by_text = _tasks_in(task_column)
    texts = list(filter(None, column.texts))
    shares = join_names(column.counts(texts), 4)
    words_by_answer = _words_by_answer(column)
    if words_by_answer and task_with(words_by_answer) is None:
        words = join_words(list(map(quoted, words_by_answer.values())))
        return _two_tasks(f"found {words}, words of two tasks", task_column)
    if not words_by_answer and len({*tasks_by_text.values()}) > 1:
        tasks = join_words(list(map(quoted, tasks_by_text)))
        return _two_tasks(f"found {shares} of the tasks {tasks}", task_column)
    if words_by_answer or not texts:
        return "", []

    counts = _count_remedies(column, texts)
    if counts:
        return f"found numbers: {shares}. What do they count?", counts
    problem = f"the codes are {shares}. The program does not know what they mean."
    if len(texts) == 1:
        problem = f"the only code is {shares}. The program does not know what it means."
    remedies = []
    answers = {*chain.from_iterable(task.answers for task in tasks_by_text.values())}
    for remedy in _code_remedies(column, texts, trends):
        answer = "equal" if remedy.option == "equal_code" else "second"
        if not answers or answer in answers:
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
    """The problem of a column with responses to two tasks, with what chooses one of them."""
    problem = (
        f"{finding}, allowed: one task, such as the rows that --where COLUMN=TEXT chooses; "
        "contrast compares the tasks that --condition COLUMN names"
    )
    remedies = []
    for text, task in _tasks_in(task_column).items():
        name = "" if task_column is None else task_column.name
        remedies.append(Remedy("where", ((name, text),), f"for the task {task.name!r}"))
    return problem, remedies


def _tasks_in(column: Column | None) -> dict[str, Task]:
    """The tasks that a column `task` tells, by its texts."""
    return {} if column is None else tasks_named(column.texts)


def _unknown_texts(
    column: Column,
    answer: IntArray,
    codes: Codes,
    names: Texts,
) -> Question:
    """The problem of several codes of which one is known; what to type for texts of no answer.

    One text beside both answers has no problem of its own: it may be a missed trial, or 'equal'.
    """
    unknown = column.only(answer == _UNKNOWN)
    n_answers = len({*answer.tolist()} - {_MISSING, _UNKNOWN})
    is_complete = n_answers == len(names)
    n_unknown, n_answered = len(unknown.codes), np.count_nonzero(answer != _MISSING)
    if is_complete and len(unknown.texts) == 1 and n_unknown < _MANY * n_answered:
        meaning = f"only if nobody responded in these {plural(n_unknown, 'trial')}; it drops them"
        return "", [Remedy("missed", unknown.texts[0], meaning)]
    if is_complete or len(unknown.texts) < 2 or codes.count(None) != 1:
        return "", []
    other = names[codes.index(None)]
    shares = join_names(unknown.counts(unknown.texts), 4)
    if not n_answers:
        return f"the codes are {shares}. None of them is the code that was given.", []
    commonest = unknown.texts[int(np.bincount(unknown.codes).argmax())]
    remedies = [Remedy(f"{other}_code", commonest, f"if {commonest} is '{other}'")]
    return f"the other codes are {shares}. Which of them is '{other}'?", remedies


def _three_answers(
    column: Column, answers: IntArray, names: Texts, options: ReadOptions, difference: FloatArray
) -> list[Remedy]:
    """Options to type if three frequent texts, not all known, are those of three answers."""
    words = _words_by_answer(column)
    is_two_answers = len(names) == 2 and options.correct is None and "different" not in words
    is_frequent = np.bincount(column.codes) > _RARE * np.count_nonzero(answers != _MISSING)
    texts = [_plain(text) for text in compress(column.texts, is_frequent) if text]
    if len(texts) != 3 or not is_two_answers or _UNKNOWN not in answers:
        return []
    codes = {**words, **options.code_by_answer}
    replaced = codes.pop("different", None)
    for answer, trend in (("equal", -abs(difference)), ("second", difference)):
        if answer not in codes:
            others = [text for text in texts if text not in codes.values()]
            codes[answer] = _commonest_with(column, others, trend)[0] or others[0]
    equal, second = codes["equal"], codes["second"]
    meaning = f"if {equal} is 'equal' and {second} is 'second' of three answers"
    if replaced is not None:
        meaning += ", in place of --different-code"
    # The second option is typed together with the first one, never alone.
    return [
        Remedy("equal_code", equal, meaning),
        Remedy("second_code", second, "", MAX_LINES, step=1),
    ]


def _code_remedies(column: Column, texts: Texts, trends: Mapping[str, FloatArray]) -> list[Remedy]:
    """Options to type if these codes tell no task, the likeliest first."""
    by_word = {text.lower(): text for text in map(_plain, texts)}
    likely = [*filter(None, map(by_word.get, ("1", "true", "yes"))), texts[0]][0]
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
    """The code that is commoner the larger a trend is, and its correlation with the trend.

    It is empty where no code is, or no stimulus can be read.
    """
    is_number = np.isfinite(trend)
    trend = trend[is_number]
    best, largest = "", 0.0
    for text in texts:
        is_code = column.matches([text])[is_number]
        if is_code.any() and not is_code.all() and np.ptp(trend):
            correlation = float(np.corrcoef(is_code, trend)[0, 1])
            if correlation > largest:
                best, largest = _plain(text), correlation
    return best, largest


def _plain(text: str) -> str:
    """A cell without what spreadsheets do to it: the decimals of 1.0 and 0,0."""
    match = re.fullmatch(r"([-+]?\d+)[.,]0*", text)
    return text if match is None else match[1]


def _answer(text: str, given: Codes, words: Sequence[Texts]) -> int:
    """The answer that a cell stands for: by the given codes, else by words."""
    plain = _plain(text)
    codes = [code and _plain(code) for code in given]
    if plain in codes:
        return codes.index(plain)
    word = plain.lower()
    if not word:
        return _MISSING
    # Where 'Different' was declared to mean equal, 'different' is not read by default.
    if word not in map(str.lower, filter(None, codes)):
        for answer, (code, known_words) in enumerate(zip(codes, words, strict=True)):
            if code is None and _english(word) in known_words:
                return answer
    return _UNKNOWN


def _texts_read(column: Column, chosen: BoolArray, word: str) -> str:
    """The texts that were read as an answer, in words."""
    texts = column.only(chosen).texts
    shown_texts = join_names(map(quoted, texts or [word]))
    if any(text.lower() != word for text in texts):
        shown_texts += f" as {word}"
    return shown_texts


def response_trend(subject: Subject, x: FloatArray) -> tuple[float, float]:
    """Covariance of the counted response with x, shape (pairs,), and its variance by chance."""
    centred = x - np.average(x, weights=subject.n_trials)
    share = subject.fraction_yes
    variance = share * (1.0 - share) * (np.square(centred) @ subject.n_trials)
    return float(centred @ subject.n_yes), float(variance)


def direction(study: Study) -> int:
    """Whether 'second' is commoner (1) or rarer (-1) the larger s2 - s1 is, in all of a study.

    It is 0 unless the sum over subjects is beyond chance (z of 5), more than half of the subjects
    with both answers have a z of more than 1, and none has the opposite (a z of 3). A study of
    subjects who guess is called reversed once in three million times. Three reversed subjects of
    13 are findings of :mod:`bayes_toe.checks.answer_checks`.
    """
    covariances, variances = [], []
    for unit in study:
        subject = unit.two_answers if unit.task.has_direction else None
        if subject is None:
            continue
        covariance, variance = response_trend(subject, subject.s2 - subject.s1)
        if variance > 0.0:  # both answers, and two differences
            covariances.append(covariance)
            variances.append(variance)
    z = np.array(covariances) / np.sqrt(variances)
    total = sum(covariances) / np.sqrt(sum(variances) or 1.0)
    for sign in (-1, 1):
        is_shared = np.count_nonzero(sign * z > 1.0) > 0.5 * len(z)
        if sign * total > 5.0 and is_shared and (sign * z > -3.0).all():
            return sign
    return 0


def require_direction(
    study: Study, options: ReadOptions, read: Callable[[ReadOptions], Study]
) -> None:
    """Refuse reversed answers, with the options under which `read` finds none."""
    if direction(study) >= 0:
        return
    rule = "'second' where the second stimulus was called the stronger"
    if options.correct:
        rule += f"; column {display_name(options.correct)} says right of those"
    elif "n_trials" in study.reading.read:
        rule += f"; {display_name(options.name('n_second'))} counts those"
    candidates = []
    for code, other in permutations(study.reading.codes, 2):
        second = Remedy("second_code", code, f"if {code} is 'second'", 0)
        comparison = Remedy("comparison_code", code, f"if {code} is 'comparison'", 0)
        first = Remedy("first_code", other, "", 1, step=1)  # goes with `second` alone
        candidates += [[second, first], [comparison]]
    if options.standard_interval is not None:
        meaning = "if it says the interval of the comparison"
        candidates.append([Remedy("comparison_interval", options.standard_interval, meaning, 0)])
    remedies = []
    for candidate in candidates:
        with suppress(InputError):
            if direction(read(with_remedies(options, candidate))) > 0:
                remedies += candidate
    raise InputError(
        f"{study.source}: found 'second' less often the larger s2 - s1 is, allowed: {rule}.",
        remedies,
    )
