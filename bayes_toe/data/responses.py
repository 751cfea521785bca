"""A column of responses as answers.

`responses` reads words or codes. Known words tell the task too; codes such as 1 and 2 need an
option. A column of right and wrong becomes answers by the sign of s2 - s1. `without_missed` drops
trials that nobody answered. `require_direction` refuses a study whose answers mean the opposite.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from difflib import get_close_matches
from itertools import chain, compress, filterfalse, permutations, product
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray, IntArray, combination_counts
from bayes_toe.data.column_roles import (
    FALSE_WORDS,
    OTHER_COUNTS,
    TRUE_WORDS,
    VOCABULARY,
    from_left_to_right,
    has_word,
    is_missed_flag,
    is_no_response,
    looks_like,
    named_places,
    names_like,
    score_remedies,
    task_remedies,
    without_accents,
)
from bayes_toe.data.messages import (
    Texts,
    display_name,
    join_names,
    join_quoted,
    join_words,
    plural,
    quoted,
)
from bayes_toe.data.options import ReadOptions
from bayes_toe.data.tasks import (
    SAME_DIFFERENT,
    WHICH_STRONGER,
    Task,
    task_named,
    task_with,
    tasks_named,
)
from bayes_toe.data.text_table import CELL, Column, TextTable, plain_code
from bayes_toe.data.validation import MISSING_WORDS, number, whole_number
from bayes_toe.errors import InputError, Remedy, with_remedies

if TYPE_CHECKING:
    from bayes_toe.data.layouts import StandardOrder
    from bayes_toe.data.study import Study, Subject

#: What a text stands for: the index of an answer, of which the task counts the first, or no
#: response, or nothing known.
_YES = 0
_SECOND = 1  # of three answers
_MISSING = -1
_UNKNOWN = -2
#: The words of each answer, in any case.
_WORDS: dict[str, tuple[str, ...]] = {
    "equal": ("equal", "same"),
    "different": ("different",),
    "second": ("second", "s2", "2nd"),
    "first": ("first", "s1", "1st"),
}
#: The words of columns that say right or wrong. They are not all of TRUE_WORDS: 'x' and 'y' may be
#: keys, and messages list these words.
_RIGHT_WRONG = (
    ("1", "true", "yes", "correct", "right", "hit"),
    ("0", "false", "no", "incorrect", "wrong", "error", "miss"),
)
_CODE_MEANINGS = {
    "equal_code": "'equal' in a same-different task",
    "second_code": "'the second was stronger' (2AFC)",
    "comparison_code": "'the comparison was stronger' (2AFC)",
}
#: Largest share of the trials that are mistakes.
_MOST_MISTAKES = 0.05
#: Largest share of the trials that nobody answered.
_MOST_MISSED = 0.2
#: A letter that could not be decoded, or an error of Excel such as '#N/A'.
_DAMAGED = re.compile("\ufffd|^#[A-Z]")
#: Largest share of trials with equal stimuli in 2AFC. Of all pairs of three levels, a third are
#: equal.
_MOST_EQUAL = 0.35

#: The text that options give for each answer of a task.
Codes: TypeAlias = Sequence[str | None]
#: What makes an answer likelier, shape (rows,), by the option that names its code: s2 - s1 for
#: 'second_code'.
Trends: TypeAlias = Mapping[str, FloatArray]
#: What is wrong with a column, empty if nothing is, and options to type.
Question: TypeAlias = tuple[str, list[Remedy]]


class Responses(NamedTuple):
    """The responses of trials, shape (rows,) each."""

    task: Task
    is_yes: BoolArray  # the response that the task counts
    is_second: BoolArray  # of three: 'second'; of two, the response that is not counted
    is_answered: BoolArray
    is_unscorable: BoolArray  # right or wrong, where equal stimuli have no right answer
    note: list[object]  # how the texts were read, as the parts of a Note


def responses(
    table: TextTable,
    column: Column,
    task_column: Column | None,
    options: ReadOptions,
    subject: Column,
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
    if not has_scores:
        names = task.answers
        words = tuple(map(_WORDS.__getitem__, names))
        advice = f"; other codes by --{'-code, --'.join(names)}-code"
    else:  # the column says right or wrong
        names = ("right", "wrong")
        words = _RIGHT_WRONG
        advice = ""
    codes = _all_codes(column, options.codes(task))
    answer_index = column.map(lambda text: _answer_index(text, codes, words), np.int64)

    # What the codes mean is asked for, or else which code is missing.
    rise = np.nan_to_num(difference)
    is_opposite = _has_opposite_keys(column, subject, rise)
    trends = {"equal_code": -abs(rise), "second_code": rise * ~is_opposite}
    if options.has_standard:
        trends["comparison_code"] = np.where(order.is_first, rise, -rise)
    problem = ""
    remedies: list[Remedy] = []
    if stated_task is None and options.comparison_code is None:
        problem, remedies = _unknown_meaning(table, column, task_column, trends)
    if not problem:
        problem, remedies = _unknown_texts(column, answer_index, codes, names)
    if _UNKNOWN in answer_index:
        remedies = _proposals(table, column, answer_index, names, options, trends, remedies)
        remedies = _with_mirrored(remedies, column, order, options)

    if problem:
        _ask_meaning(table, f"{column}: {problem}", remedies, subject.only(is_opposite).texts)
    else:  # each unknown text is a problem of its rows
        rule = _allowed_texts(options.codes(task), words, names) + advice
        table.fault(column, answer_index == _UNKNOWN, rule)
        table.problems.remedies += remedies

    note = _reading_note(column, answer_index, names)
    is_yes = answer_index == _YES
    is_answered = answer_index != _MISSING
    is_unscorable = np.zeros(len(answer_index), bool)
    if has_scores:  # 'yes' is 'right' so far, and becomes the answer that the task counts
        task, by_what = _task_of_scores(table.columns.values(), is_yes, difference == 0.0)
        note[-1] = f"), '{task.yes}' or '{task.no}' by {by_what}"
        right_answer = task.right(difference)
        is_unscorable = is_answered & (right_answer == 0)
        _require_two_answers(table, column, is_yes[is_unscorable], is_answered)
        is_yes = is_yes == (right_answer > 0)  # a wrong answer is the other answer
    is_answered &= ~is_unscorable
    is_second = answer_index == _SECOND
    return Responses(task, is_yes & is_answered, is_second, is_answered, is_unscorable, note)


def _ask_meaning(table: TextTable, problem: str, remedies: list[Remedy], opposite: Texts) -> None:
    """Ask what codes mean, which seem to mean the opposite for the subjects `opposite`."""
    if opposite and remedies and remedies[0].option == "second_code":
        problem += (
            f" In {join_names(opposite, max_items=4)} they seem to mean the opposite, as where "
            "keys are counterbalanced: --correct COLUMN needs no codes; if there is none, check "
            "then proposes --swap for these subjects."
        )
        remedies = [*score_remedies(names_like(table.columns, "correct")), remedies[0]]
    table.problems.ask(problem, remedies)


def _has_opposite_keys(column: Column, subject: Column, rise: FloatArray) -> BoolArray:
    """Whether each row is of a subject whose responses follow s2 - s1 the other way round.

    In all rows together, the responses follow s2 - s1 the usual way. Subjects have the opposite way
    where keys are counterbalanced between subjects. Of subjects who guess, one in 700 seems to.

    Examples
    --------
    >>> column = Column.from_texts("key", "jjjfff" * 4 + "fffjjj" * 3)
    >>> subject = Column.from_texts("subject", "a" * 24 + "b" * 18)
    >>> rise = np.array([1, 2, 3, -1, -2, -3] * 7)
    >>> subject.only(_has_opposite_keys(column, subject, rise)).texts
    ['b']
    """
    deviation = rise - rise.sum() / max(len(rise), 1)  # there may be no rows
    is_code = column.matches(_frequent(column)[:1])
    trend = np.bincount(subject.codes, deviation * (is_code - 0.5))  # of each subject
    sd_of_guesses = 0.5 * np.bincount(subject.codes, deviation**2) ** 0.5
    usual_sign = np.copysign(1.0, trend.sum())
    is_opposite = usual_sign * trend < -3.0 * sd_of_guesses
    return is_opposite[subject.codes]


def _task_of_scores(
    columns: Iterable[Column], is_right: BoolArray, is_equal: BoolArray
) -> tuple[Task, str]:
    """The task of responses that are right or wrong, and the fact that makes answers of scores.

    The task is same/different if a column says 'same' where stimuli are equal, 'different' or
    nothing elsewhere, and some response to equal stimuli is right. In 2AFC no such response is.
    """
    for column in columns:
        words = _words_by_answer(column)
        is_same = column.matches([words.get("equal", "")])
        tells_equal = task_with(words) == SAME_DIFFERENT and (is_same == is_equal).all()
        if tells_equal and is_right[is_same].any():
            return SAME_DIFFERENT, f"whether stimuli are equal, as {column} does"
    return WHICH_STRONGER, "the sign of s2 - s1"


def _require_two_answers(
    table: TextTable, column: Column, is_right: BoolArray, is_answered: BoolArray
) -> None:
    """Refuse scores of 2AFC if those of equal stimuli seem to say which answers were 'equal'.

    `is_right` has the scores of responses to equal stimuli. 2AFC has no right answer to these: a
    program scores all of them as wrong, or guesses. In a same-different task equal stimuli are
    frequent, or most responses to them are right.
    """
    n = len(is_right)
    n_right = is_right.sum()
    # Of n guesses n/2 are right, with a standard deviation of n**0.5 / 2.
    is_beyond_chance = n_right > 0.5 * n + n**0.5
    if 0 < n_right < n and (n > _MOST_EQUAL * is_answered.sum() or is_beyond_chance):
        problem = (
            f"{column}: found {n_right} right and {n - n_right} wrong answers to equal "
            "stimuli, allowed: answers to which was stronger, of which none is right there. If "
            "participants said whether stimuli were equal, add a column with 'same' in these rows "
            "and 'different' in all others; if not, remove these rows"
        )
        table.problems.ask(problem, [])


def _reading_note(column: Column, answer_index: IntArray, names: Texts) -> list[object]:
    """The parts of a note such as "responses 'j' as second (20) / 'f' as first (20)"."""
    note: list[object] = ["responses"]
    for i, name in enumerate(names):
        is_answer = answer_index == i
        texts = column.only(is_answer).texts
        words = join_quoted(texts or [name])
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

    A text that names no task, such as that of an experiment, is ignored.
    """
    if column is None:
        return
    for text, other_task in tasks_named(column.texts).items():
        if other_task != task:
            raise InputError(
                f"{table.source}: {column}: found {quoted(text)}, allowed: {task.name!r}, which "
                "the answers are of; --where COLUMN=TEXT chooses rows"
            )


def _stated_task(column: Column, task_column: Column | None, options: ReadOptions) -> Task | None:
    """The task of the options; else the task that all rows name, if a response is a word of it."""
    if options.task is not None or task_column is None:
        return options.task

    # A text that names no task gives None.
    task, *other_tasks = {task_named(text) for text in task_column.texts} or [None]
    if other_tasks or task is None or _words_by_answer(column).keys().isdisjoint(task.answers):
        return None
    return task


def _words_by_answer(column: Column) -> dict[str, str]:
    """By answer, the first text of a column that is a word of it: {'second': 'zweiter'}."""
    word_by_answer: dict[str, str] = {}
    for text in column.texts:
        for answer, words in _WORDS.items():
            if _english(text) in words:
                word_by_answer.setdefault(answer, text)
    return word_by_answer


def _english(word: str) -> str:
    """The answer that a word of another language, or several words, stand for; else the word.

    Examples
    --------
    >>> _english("deuxi\u00e8me"), _english("j")
    ('second', 'j')
    >>> _english("interval 1"), _english("SecondHeavier"), _english("second lighter")
    ('first', 'second', 'second lighter')
    """
    plain = without_accents(word.lower())
    for answer, translations in VOCABULARY["responses"].items():
        if plain in translations:
            return answer
    _, places, other_words = named_places(word)
    if len(places) == 1 and other_words and other_words <= set(VOCABULARY["words"]["answer"]):
        return places[0]
    return word.lower()


def with_joined_codes(column: Column, options: ReadOptions) -> Column:
    """A column in which the texts that a code lists, such as '4' and '5' of '4,5', become the code.

    Codes of missed trials may be such lists, too. A text that two codes list stays as it is, and is
    then unknown.

    Examples
    --------
    >>> column = Column.from_texts("response", ["4", "5", "1"])
    >>> with_joined_codes(column, ReadOptions(second_code="4,5")).texts
    ['4,5', '1']
    """
    # A cell such as 'f,escape' is no list of missed responses.
    missed = set(options.missed).difference(column.texts)
    lists = [code for code in (*options.code_by_answer.values(), *missed) if "," in code]
    texts = []
    for text in column.texts:
        codes = [code for code in lists if text in code.split(",")]
        texts.append(codes[0] if len(codes) == 1 else text)
    return Column.from_texts(column.name, texts, column.codes)


def blank_missed(
    column: Column, options: ReadOptions, has_stimuli: BoolArray
) -> tuple[Column, list[str]]:
    """A column of responses whose missed trials are empty, and the texts that mark these trials.

    Texts that only rows without stimuli have, such as units or the subject's age, become empty too.
    """
    trials = column.only(has_stimuli)
    missed = _missed_texts(trials, options)
    # Without any stimuli, the columns of the stimuli are the problem, and not the responses.
    answers = set(trials.texts or column.texts).difference(missed)
    texts = [text if text in answers else "" for text in column.texts]
    texts_to_name = [text for text in missed if text.lower() not in MISSING_WORDS]
    return Column.from_texts(column.name, texts, column.codes), cells_of(column, texts_to_name)


def _missed_texts(column: Column, options: ReadOptions) -> Texts:
    """The texts that say that nobody responded.

    A number or a sign, such as '0' or '.', that is as frequent as an answer does not say it.

    Examples
    --------
    >>> _missed_texts(Column.from_texts("response", ["first", "-99", "2nd"]), ReadOptions())
    ['-99']
    """
    given_codes = (*options.code_by_answer.values(), options.comparison_code)
    codes = set(filter(None, given_codes))
    declared = set(map(plain_code, options.missed))
    frequent = set(_frequent(column, share=_MOST_MISSED, least=1.0))

    missed = []
    for text in column.texts:
        # A code or a frequent text is an answer, even if it is '.' or '999'.
        if text in declared or (text not in (codes | frequent) and is_no_response(text)):
            missed.append(text)
    return missed


def missed_codes_found(columns: Iterable[Column], options: ReadOptions) -> Iterator[str]:
    """The codes of missed trials that the options name and cells have."""
    for column, code in product(columns, options.missed):
        if plain_code(code) in map(plain_code, column.texts):
            yield code


def notes_without_effect(study: Study, options: ReadOptions) -> list[str]:
    """A note on codes that no file of the study has.

    They are not refused, as one command may read the files of several subjects, one by one. The
    question about unknown responses asks for codes that no response has. Counts have no codes.
    """
    codes = [*options.missed]
    if "response" not in study.reading.read:
        codes += options.code_by_answer.values()
    absent = [code for code in codes if code not in study.reading.missed]
    return [f"no effect of {join_quoted(absent)}, which the table lacks"] if absent else []


def without_missed(
    answers: Responses, column: Column, signs: Iterable[Column], declared: Texts
) -> tuple[Responses, list[str]]:
    """Responses without trials that nobody answered, and the texts that mark these trials.

    Experiment programs score a missed trial as wrong. `signs` are columns that may show a missed
    trial: keys, reaction times, or a column such as `timed_out`. `declared` are texts that the
    options name.
    """
    is_right = column.map(lambda text: text.lower() in _RIGHT_WRONG[0])
    causes = []
    for sign in signs:
        texts = [t for t in sign.texts if t in declared or _shows_missed(sign, t, is_right)]
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
    word = plain_code(text).lower()
    if is_missed_flag(sign):
        is_sign = word in TRUE_WORDS
    else:
        is_sign = is_no_response(word) or word in VOCABULARY["missed"]["signs"]
    has_text = sign.matches([text])
    if not is_sign or has_text.all() or (has_text & is_right).any():
        return False
    if word == "0":
        return len(sign.texts) > 2  # else 0 may be one of two keys
    if word not in VOCABULARY["missed"]["unclear"]:
        return True
    # 999 may be a reaction time in ms, if other times are longer than a tenth of it. It shows a
    # missed trial all the same if it is no chance (p < .01) that all responses beside it are wrong.
    is_as_large = sign.map(lambda other: number(other) > 0.1 * number(word))
    share_wrong = 1.0 - is_right[~has_text].mean()
    may_be_chance = share_wrong ** has_text.sum() > 0.01
    return not (may_be_chance and (is_as_large & ~has_text).any())


def _all_codes(column: Column, codes: Codes) -> Codes:
    """The codes of all answers; a code that is not given is the only other text of the column.

    If there is no such text, or several, `codes` stay as they are.

    Examples
    --------
    >>> _all_codes(Column.from_texts("response", ["j", "f"]), ("j", None))
    ('j', 'f')
    """
    given_codes = set(filter(None, codes))
    texts = set(column.texts) - {""}
    other_texts = texts - given_codes
    if codes.count(None) != 1 or len(other_texts) != 1:
        return codes

    (other_code,) = other_texts
    # Words in the place of a code are read as they are. In another case, a given code is no other
    # code.
    has_words = given_codes.isdisjoint(texts) and _words_by_answer(column)
    if has_words or other_code.lower() in map(str.lower, given_codes):
        return codes
    return tuple(code or other_code for code in codes)


def _unknown_meaning(
    table: TextTable,
    column: Column,
    task_column: Column | None,
    trends: Trends,
) -> Question:
    """The problem of a column whose words tell no task, or two; empty without a problem."""
    words_by_answer = _words_by_answer(column)
    if words_by_answer:
        if task_with(words_by_answer) is not None:  # the words say what the responses mean
            return "", []
        return _two_tasks(
            f"found {join_words(map(quoted, words_by_answer.values()))}, words of two tasks",
            task_column,
        )

    tasks_by_text = {} if task_column is None else tasks_named(task_column.texts)
    tasks = set(tasks_by_text.values())
    texts = list(filter(None, column.texts))
    counts_shown = join_names(column.counts(texts), max_items=4)
    if len(tasks) > 1:
        return _two_tasks(
            f"found {counts_shown} of the tasks {join_words(map(quoted, tasks_by_text))}",
            task_column,
        )
    if not texts:
        return "", []

    if _are_counts(table, column):
        problem = f"found numbers: {counts_shown}. What do they count?"
        return problem, list(_cell_count_remedies(table, column, trends))
    problem = (
        f"the codes are {counts_shown}. The program does not know what they mean: choose by the "
        "question that participants answered."
    )
    key_remedies = []
    if len(texts) > 3:
        problem += (
            " If they say how sure participants were, --columns response=NAME names the column of "
            "their answers."
        )
        key_remedies = _keys_beside(table, column)
    # Of two codes, the rare one is no mistake: with a large constant error, an answer may be rare.
    frequent = texts if len(texts) == 2 else _frequent(column)
    if not frequent:  # as of many numbers, such as those of a slider
        return problem, key_remedies
    remedies = _code_remedies(column, frequent, trends)
    if tasks:
        (task,) = tasks  # two tasks are refused above
        # --equal-code is about answers of which one is 'equal'. All other options, also --correct,
        # are about which stimulus was stronger.
        remedies = [
            remedy
            for remedy in remedies
            if (remedy.option == "equal_code") == task.has_criterion or task.has_three_answers
        ]
    return problem, _evident_first(table, column, trends, key_remedies + remedies)


def _evident_first(
    table: TextTable, column: Column, trends: Trends, remedies: list[Remedy]
) -> list[Remedy]:
    """The remedies for codes; the first one is evident if names or other columns prove it."""
    texts = list(filter(None, column.texts))
    if len(texts) != 2:
        return remedies
    option, code = _code_by_name(column, texts)
    if not code:
        option, code = _code_by_scores(table, column, texts, trends)
    if option not in trends:
        return remedies
    other_remedies = [remedy for remedy in remedies if remedy[:2] != (option, code)]
    meaning = f"if {code} is {_CODE_MEANINGS[option]}"
    return [Remedy(option, code, meaning, is_evident=True), *other_remedies]


def _code_by_name(column: Column, texts: Texts) -> tuple[str, str]:
    """The option for the code that the name of a column explains; empty texts without such a code.

    Examples
    --------
    >>> columns = {"louder": "1221", "tone2.louder": "0110", "different": "ynyn", "key": "fjfj"}
    >>> for name, cells in columns.items():
    ...     print(_code_by_name(Column.from_texts(name, cells), sorted(set(cells))))
    ('second_code', '2')
    ('second_code', '1')
    ('equal_code', 'n')
    ('', '')
    """
    first_text, second_text = sorted(texts)
    if first_text == "1":  # the numbers of the stimuli, if the question is which was louder
        has_names = has_word(column.name, "of_strength")
    else:  # T1 and T2 name the stimuli, but button1 and button2 do not
        has_names = not has_word(first_text, "of_answers")
    if has_names and first_text != second_text == first_text.replace("1", "2"):
        return "second_code", second_text

    true_texts = [text for text in texts if text.lower() in TRUE_WORDS]
    false_texts = [text for text in texts if text.lower() in FALSE_WORDS]
    if len(true_texts) == len(false_texts) == 1:
        name = column.name
        stimuli, places, _ = named_places(name)
        if has_word(name, "of_strength") and len(stimuli + places) == 1:
            (answer,) = stimuli + places
            name = f"n_{answer}"  # a yes in 'tone2.louder' is 'second'
        for role, other_role in OTHER_COUNTS.items():
            option = role.replace("n_", "") + "_code"
            if looks_like(name, role):
                return option, true_texts[0]
            if looks_like(name, other_role):
                return option, false_texts[0]
    return "", ""


def _code_by_scores(
    table: TextTable, column: Column, texts: Texts, trends: Trends
) -> tuple[str, str]:
    """The option for the code that columns of scores or of correct answers prove.

    The code of 'second' is right in all rows in which s2 is larger, and wrong where s1 is larger;
    that of 'equal' is right where the stimuli are equal. The empty texts stand for no proof.
    """
    is_answered = column.matches(texts)
    for other in table.columns.values():
        if looks_like(other.name, "correct"):
            words = [text for text in other.texts if text.lower() in _RIGHT_WRONG[0]]
            is_right = other.matches(words)
        elif other.name != column.name and set(filter(None, other.texts)) == set(texts):
            is_right = np.array(other.map(str, object) == column.map(str, object))
        else:
            continue
        for option, trend in trends.items():
            is_code_right = trend > 0.0
            rows = is_answered & (trend != 0.0)
            if option == "equal_code":
                is_code_right = trend == 0.0
                rows = is_answered
            # Right and wrong responses, in trials of both kinds, leave no other rule.
            is_proof = len(combination_counts(is_code_right[rows], is_right[rows])) > 2
            for code in texts:
                is_expected = column.matches([code]) == is_code_right
                if is_proof and (is_expected == is_right)[rows].all():
                    return option, code
    return "", ""


def _keys_beside(table: TextTable, ratings: Column) -> list[Remedy]:
    """Options to type if another column has keys, and the cells of `ratings` are no answers."""
    remedies = []
    for name in names_like(table.columns, "key") + names_like(table.columns, "response"):
        if 1 < len(table.columns[name].texts) < 4:  # two keys, and an empty cell
            meaning = f"if {ratings} says how sure participants were"
            remedies.append(Remedy("columns", (("response", name),), meaning))
    return remedies


def _complement(table: TextTable, counts: IntArray) -> str:
    """The column with which counts add up to one number in all rows; empty if no column does.

    Counts that are the same in all rows have no such column: any constant column would do.
    """
    if len(np.unique(counts)) < 2:
        return ""
    for name, column in table.columns.items():
        if np.ptp(counts + column.map(whole_number, np.int64)) == 0:
            return name
    return ""


def ask_for_third_count(table: TextTable, sums: IntArray, names_not_read: Texts) -> None:
    """Ask whether a column counts a third answer: only with it do all rows have the same sum.

    `sums` are those of the counts that are read.
    """
    third = _complement(table, sums)
    if third in names_not_read and not looks_like(third, "n_missed"):
        table.problems.ask(
            f"column {display_name(third)} seems to count a third answer, since it makes the sums "
            "of all rows equal. If it counts trials without an answer, remove it",
            [Remedy("columns", (("n_equal", third),), "if it counts 'equal'")],
        )


def _are_counts(table: TextTable, column: Column) -> bool:
    """Whether cells are counts, or proportions in a wide table."""
    texts = list(filter(None, column.texts))
    if len(texts) < 4 or not all(text[0].isdecimal() for text in texts):
        return False
    return column.name == CELL or _complement(table, column.map(whole_number, np.int64)) != ""


def _cell_count_remedies(
    table: TextTable, column: Column, trends: Container[str]
) -> Iterator[Remedy]:
    """Options to type if cells are counts or proportions of an answer.

    `trends` have 'comparison_code' if the stimuli are a standard and a comparison.
    """
    other_column = _complement(table, column.map(whole_number, np.int64))
    for count in ("n_comparison" if "comparison_code" in trends else "n_second", "n_equal"):
        names = [(count, column.name)]
        if other_column:
            names.append((OTHER_COUNTS[count], other_column))
        meaning = f"if they count '{count.removeprefix('n_')}' or are its proportions"
        yield Remedy("columns", tuple(names), meaning)


def _two_tasks(finding: str, task_column: Column | None) -> Question:
    """The problem of responses to two tasks, and options that choose one task, or compare both."""
    problem = (
        f"{finding}, allowed: one task, such as the rows that --where COLUMN=TEXT chooses; "
        "contrast compares tasks if the texts of --condition COLUMN are 2afc and same/different"
    )
    return problem, [] if task_column is None else task_remedies([task_column])


def _unknown_texts(
    column: Column,
    answer_index: IntArray,
    codes: Codes,
    names: Texts,
) -> Question:
    """The problem of a column with several unknown texts, if the code of one answer is missing."""
    unknown = column.only(answer_index == _UNKNOWN)
    n_answers = len(set(answer_index.tolist()) - {_MISSING, _UNKNOWN})
    # If all answers have texts, or one text alone is unknown, unknown texts are problems of rows.
    if n_answers == len(names) or len(unknown.texts) < 2 or codes.count(None) != 1:
        return "", []

    answer = names[codes.index(None)]  # whose code is missing
    shares = join_names(unknown.counts(unknown.texts), max_items=4)
    if not n_answers:
        return f"the codes are {shares}. None of them is the code that was given.", []
    if "," in "".join(filter(None, codes)):  # one answer has several codes, such as '1,2'
        code = _joined(unknown.texts)
    else:
        code = unknown.texts[np.bincount(unknown.codes).argmax()]  # the most frequent code
    remedies = [Remedy(f"{answer}_code", code, f"if {code} is '{answer}'")]
    return f"the other codes are {shares}. Which of them is '{answer}'?", remedies


def _frequent(column: Column, share: float = _MOST_MISTAKES, least: float = 0.0) -> list[str]:
    """The texts that more rows have than this share of the filled ones plus `least` rows.

    Damaged texts are left out.
    """
    is_filled = column.map(lambda text: text.lower() not in MISSING_WORDS)
    counts = np.bincount(column.codes, weights=is_filled)
    frequent = compress(column.texts, counts > least + share * counts.sum())
    return list(filterfalse(_DAMAGED.search, frequent))


def _proposals(
    table: TextTable,
    column: Column,
    answer_index: IntArray,
    names: Texts,
    options: ReadOptions,
    trends: Trends,
    remedies: list[Remedy],
) -> list[Remedy]:
    """Options to type if texts are unknown, the likeliest first.

    `names` are the answers of the task, or 'right' and 'wrong'. The given `remedies` are about two
    answers, or about counts. An odd number of frequent texts may be three answers; options for
    these come first.
    """
    if remedies and remedies[0].option == "columns":  # for counts, or keys beside ratings
        return remedies
    unknown = column.only(answer_index == _UNKNOWN)
    given_codes = options.code_by_answer
    frequent = _frequent(column)
    has_lists = "," in "".join(given_codes.values())  # such as '4,5'
    has_two_answers = names in (SAME_DIFFERENT.answers, WHICH_STRONGER.answers)
    # If all frequent texts are known words, no text needs a code.
    if has_two_answers and not has_lists and set(frequent).intersection(unknown.texts):
        # Two codes whose meaning no word and no option says.
        if len(frequent) == 2 and not given_codes and not remedies:
            remedies = _code_remedies(column, frequent, trends)
        remedies = _three_answers(table, column, frequent, options, trends) + remedies

    missed = _missed_remedy(column, unknown, len(names))
    if missed is None:
        return remedies
    are_ratings = len(frequent) > 3
    if not has_lists and _looks_missed(str(missed.value), column.texts, are_ratings):
        return [missed, *remedies[:1]]  # other texts are asked about next, without this one
    if missed.value == ",".join(unknown.texts):  # all answers have other texts
        return [*remedies, missed]
    return remedies


def _with_mirrored(
    remedies: list[Remedy], column: Column, order: StandardOrder, options: ReadOptions
) -> list[Remedy]:
    """The remedies with the opposite order and the other response as 'second', if both are codes.

    Responses fit this and the likeliest remedy alike, but order effects have opposite signs. The
    reading comes first in which the right key is 'second'.
    """
    if not order.is_open or not options.standard_interval or options.standard_first_code:
        return remedies
    keys = from_left_to_right(_frequent(column))
    if len(keys) != 2 or not remedies or remedies[0].option != "second_code":
        return remedies

    left_key, right_key = keys
    # The key that is not 'second' in the likeliest remedy.
    code = right_key if remedies[0].value == left_key else left_key
    mirrored = Remedy(
        "comparison_interval",
        str(options.standard_interval),
        f"if it is rather that of the comparison, and {code} is 'second': responses fit this, too, "
        "and order effects change their sign",
        together=(Remedy("second_code", code),),
        replaces="standard_interval",
    )
    index = 0 if code == right_key else 1  # first if its code is the right key, else second
    return [*remedies[:index], mirrored, *remedies[index:]]


def _three_answers(
    table: TextTable, column: Column, texts: Texts, options: ReadOptions, trends: Trends
) -> list[Remedy]:
    """An option to type if these texts may be three answers; none if they are two.

    Three codes of which no subject has all are refused: their meaning differs between subjects.
    """
    subject = table.columns.get(options.name("subject"))
    if subject and len(texts) == 3 and not _words_by_answer(column):
        users = {text: subject.only(column.matches([text])).texts for text in texts}
        if not set.intersection(*map(set, users.values())):
            codes = "; ".join(f"{text} of {join_names(users[text])}" for text in texts)
            raise InputError(
                f"{table.source}: {column}: codes differ between subjects, {codes}. Write the same "
                "codes for all subjects"
            )
    # 'second', or 'comparison' if there is a standard: what the responses follow more closely.
    sides = {key: _sides(column, texts, trends[key]) for key in trends if key != "equal_code"}
    option = max(sides, key=sides.__getitem__)  # by the rise, which stands first in a tuple
    _, middle_code, code = sides[option]
    if not middle_code or "different" in _words_by_answer(column):
        return []
    answer = option.removesuffix("_code")
    meaning = f"if {middle_code} is 'equal' and {code} is '{answer}' of three answers"
    return [Remedy("equal_code", middle_code, meaning, together=(Remedy(option, code),))]


def _missed_remedy(column: Column, unknown: Column, n_answers: int) -> Remedy | None:
    """The option to type if nobody gave the rare unknown texts as responses.

    None unless less than 15 % of the responses are these texts, and there are more texts than
    answers of the task. None for a damaged text, or a word such as 'secnd', which is like a
    frequent word.
    """
    most = 0.15  # of the responses
    texts = list(filterfalse(_frequent(column, most).__contains__, unknown.texts))
    n_missed = column.matches(texts).sum()
    is_rare = 0 < n_missed < most * column.map(bool).sum()
    if not is_rare or sum(map(bool, column.texts)) <= n_answers:
        return None
    for text in texts:
        is_misspelt = text.isalpha() and get_close_matches(text, _frequent(column))
        if is_misspelt or _DAMAGED.search(text):
            return None
    meaning = f"only if nobody responded in these {plural(n_missed, 'trial')}; it drops them"
    return Remedy("missed", ",".join(texts), meaning)


def _looks_missed(text: str, texts: Texts, are_ratings: bool) -> bool:
    """Whether a rare text of these looks like the code of a missed trial, and not like an answer.

    Examples
    --------
    >>> _looks_missed("-9", ["1", "2", "-9"], False), _looks_missed("01", ["01", "02"], False)
    (True, False)
    >>> _looks_missed("0", ["-1", "0", "1"], False), _looks_missed("-1", ["-1", "0", "1"], True)
    (False, False)
    """
    if not text.strip("0"):
        return "-1" not in texts  # beside -1, 0 is the middle answer of three
    if text.startswith("-"):
        return not are_ratings or text[1:] not in texts  # a scale from -2 to 2 has 2 and -2
    if text.startswith("9"):
        return not are_ratings or "8" not in texts  # a scale of nine steps or more has 8 and 9
    return False


def _sides(column: Column, texts: Texts, trend: FloatArray) -> tuple[float, str, str]:
    """How far the mean trend rises over the codes; the middle code; the upper half of the codes.

    The codes are in the order of their mean trend, or in that of ratings such as 1 to 7. The codes
    of the upper half may be an answer that is likelier where the trend is large. An even number of
    codes has no middle code.
    """
    means = {text: trend[column.matches([text])].mean() for text in column.texts}
    order = sorted(sorted(texts), key=means.__getitem__)
    ratings = list(filter(None, column.texts))  # also rare ratings, such as the highest
    if len(texts) > 3 and re.fullmatch("(,?[-+]?(10|[0-9]))+", _joined(ratings)):
        is_falling = float(order[0]) > float(order[-1])  # high ratings where the trend is small
        order = sorted(ratings, key=float, reverse=is_falling)
    half = len(order) // 2 or 1  # a single code is one answer, and no middle code
    rise = means[order[-1]] - means[order[0]]
    return rise, _joined(order[half:-half]), _joined(order[-half:])


def _code_remedies(column: Column, texts: Texts, trends: Trends) -> list[Remedy]:
    """Options to type if these codes tell no task, the likeliest first.

    The codes follow the trend of the likeliest option most closely. If there are more than three
    codes, each answer has several.
    """
    rises = {"correct": -1.0}
    remedies = []
    is_code = column.matches(texts[:1])
    smallest_rise = 3.0 / (is_code.std() * len(is_code) ** 0.5 or 1.0)  # beyond chance, a z of 3
    for option, trend in trends.items():
        rise, _, likely_code = _sides(column, texts, trend)
        # In SDs, since s2 - s1 spreads more than -|s2 - s1|, the trend of 'equal'.
        rises[option] = rise / (float(np.std(trend)) or 1.0)
        codes = [likely_code]
        # With a large constant error, the code of 'equal' may be commoner where stimuli differ.
        # Of two codes it may be either, as may the code of a response without a trend.
        if len(texts) == 2 and (option == "equal_code" or rises[option] < smallest_rise):
            codes += set(texts) - {likely_code}
        for code in codes:
            remedies.append(Remedy(option, code, f"if {code} is {_CODE_MEANINGS[option]}"))
    # A name such as 'said_same' says the task, and so do keys such as s and d.
    if has_word(f"{column.name} {_joined(texts).replace(',', '')}", "sameness"):
        rises["equal_code"] = np.inf

    if set(map(str.lower, texts)) <= set(chain(*_RIGHT_WRONG)):
        remedies += score_remedies([column.name])
    # Without equal stimuli, participants were hardly asked which are equal. But right responses are
    # commoner the farther stimuli are from each other. Only rows with a code count: rows without
    # stimuli, such as those of screens, have the trend 0, as equal stimuli have.
    if trends["equal_code"][column.matches(texts)].all() and rises["equal_code"] < np.inf:
        if str(remedies[0].value).lower() not in _RIGHT_WRONG[0]:  # the code of near stimuli
            rises["correct"] = rises["equal_code"]
        rises["equal_code"] = -1.0
    if max(rises.values()) < smallest_rise:  # no response depends on the stimuli
        rises["equal_code"] = -1.0

    # Of keys such as s and d, s is 'same'.
    remedies.sort(
        key=lambda remedy: (rises[remedy.option], str(remedy.value) in "sSgG"), reverse=True
    )
    return remedies


def _joined(texts: Texts) -> str:
    """The codes of an answer as an option lists them: ['5', '4'] -> '4,5'."""
    return ",".join(sorted(texts))


def _answer_index(text: str, codes: Codes, words: Sequence[Texts]) -> int:
    """The index of the answer that a cell stands for, or `_MISSING`, or `_UNKNOWN`.

    An answer has a code, or words if its code is None.
    """
    if text in codes:
        return codes.index(text)
    word = text.lower()
    if not word:
        return _MISSING
    # Where 'Different' was declared to mean equal, 'different' is not read by default.
    if word not in map(str.lower, filter(None, codes)):
        for index, (code, known_words) in enumerate(zip(codes, words, strict=True)):
            if code is None and _english(text) in known_words:
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

    The result is 0 without a clear direction. A study of subjects who guess is called reversed once
    in three million times. If some subjects of many are reversed,
    :mod:`bayes_toe.checks.answer_checks` finds them.
    """
    trends = []
    for unit in study:
        subject = unit.two_answers if unit.task.has_direction else None
        if subject is not None:
            trends.append(response_trend(subject, subject.s2 - subject.s1))
    return _shared_direction(trends, least_z=5.0)


def follows_stimuli(study: Study) -> bool:
    """Whether 'second' is commoner the larger s2 - s1 is, or 'equal' the smaller |s2 - s1| is."""
    trends = []
    for unit in study:
        subject = unit.two_answers if unit.task.has_direction else unit
        if subject is not None:
            difference = subject.s2 - subject.s1
            x = difference if unit.task.has_direction else -np.abs(difference)
            trends.append(response_trend(subject, x))
    return _shared_direction(trends, least_z=3.0) > 0


def repeats_stimuli(study: Study) -> bool:
    """Whether some subject has no more different stimuli than trials, as in a design.

    Measured quantities, such as forces or durations of fixations, differ in nearly every row.
    """
    for subject in study:
        n_stimuli = len(np.unique([subject.s1, subject.s2]))
        if n_stimuli <= subject.n_trials.sum():
            return True
    return False


def _shared_direction(trends: Sequence[tuple[float, float]], least_z: float) -> int:
    """The sign that the trends of all subjects share; 0 without a clear one.

    It is clear if the sum over subjects is beyond chance (a z of `least_z`), more than half of the
    subjects with a variance have a z of more than 1, and no subject has the opposite (a z of 3).
    """
    # A subject without both answers, or with a single difference, has no variance.
    covariances, variances = (
        np.array([trend for trend in trends if trend[1] > 0.0]).reshape(-1, 2).T
    )
    z = covariances / np.sqrt(variances)
    z_of_study = covariances.sum() / np.sqrt(variances.sum() or 1.0)  # 0 without subjects
    sign = int(np.sign(z_of_study))
    is_shared = np.count_nonzero(sign * z > 1.0) > 0.5 * len(z)
    is_clear = abs(z_of_study) > least_z and is_shared and (sign * z > -3.0).all()
    return sign if is_clear else 0


def require_direction(
    study: Study, options: ReadOptions, read: Callable[[ReadOptions], Study]
) -> None:
    """Refuse reversed answers, with the options under which a new reading has no reversed answers.

    `options` are those with which the study was read; `read` reads it again.
    """
    if direction(study) >= 0:
        return

    rule = "'second' where the second stimulus was called the stronger"
    if options.correct:
        rule += f"; column {display_name(options.correct)} says right of those"

    candidates = []
    if options.interval_column is not None:
        owner = "standard" if options.comparison_interval else "comparison"
        meaning = f"if it says the interval of the {owner}, in place of what is typed"
        candidates.append(Remedy(f"{owner}_interval", options.interval_column, meaning))
    for code, other_code in permutations(study.reading.codes, 2):
        first = Remedy("first_code", other_code)
        candidates += [
            Remedy("second_code", code, f"if {code} means 'second stronger'", together=(first,)),
            Remedy("comparison_code", code, f"if {code} means 'comparison stronger'"),
        ]

    remedies = []
    for remedy in candidates:
        new_options = options
        if remedy.option == "standard_interval":  # --comparison-interval would win
            new_options = replace(options, comparison_interval=None)
        with suppress(InputError):  # the options may not fit the file
            new_options = with_remedies(new_options, [remedy, *remedy.together])
            if direction(read(new_options)) > 0:
                remedies.append(remedy)
    raise InputError(
        f"{study.source}: found 'second' less often the larger s2 - s1 is, allowed: {rule}. If "
        "larger numbers are weaker stimuli, as in dB of attenuation, change the signs.",
        remedies,
    )
