"""Which column of a table holds what: by our names, by similar names, or by options.

`with_likely_columns` finds columns with similar names. `columns_to_read` has the columns to read,
the problems of their names, and the options that solve them. `VOCABULARY` has the words of other
labs. A role is our name of a column, such as 's1'; a name is that in the file.

A subject, a response or a count is read from a column with another name if exactly one name is
similar. Stimuli are not: a column such as `stim1` may hold intensities or their logarithms.
"""

from __future__ import annotations

import re
import tomllib
import unicodedata
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from heapq import nlargest
from importlib.resources import files
from itertools import chain, combinations, filterfalse, pairwise, product
from typing import Any, NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray, combination_counts, run_starts
from bayes_toe.data.messages import Texts, display_name, join_names, join_words
from bayes_toe.data.options import COLUMNS, HISTORY_COLUMNS, ReadOptions
from bayes_toe.data.stimulus_unit import ANY_UNIT, LOG_UNITS
from bayes_toe.data.tasks import tasks_named
from bayes_toe.data.text_table import Column, repeated_columns
from bayes_toe.data.validation import MISSING_WORDS, empty, number
from bayes_toe.errors import Remedy, option_values

#: Words of other labs by section and key.
VOCABULARY: dict[str, dict[str, Any]] = tomllib.loads(
    (files("bayes_toe.data") / "vocabulary.toml").read_text(encoding="utf-8")
)


#: What a cell says where something holds.
TRUE_WORDS = frozenset(VOCABULARY["flags"]["yes"])
#: What a cell says where something does not hold.
FALSE_WORDS = frozenset(VOCABULARY["flags"]["no"])
#: The stimulus or the place that a word means: 'std' is 'standard', and '1st' is 'first'.
_MEANINGS: dict[str, str] = {}
for _meaning, _words in (VOCABULARY["stimuli"] | VOCABULARY["places"]).items():
    _MEANINGS |= dict.fromkeys(_words, _meaning)
#: The answer, or the stimulus called the stronger, that a word means.
_ANSWERS: dict[str, str] = {}
for _meaning, _words in (VOCABULARY["stimuli"] | VOCABULARY["responses"]).items():
    _ANSWERS |= dict.fromkeys(_words, _meaning)
#: How a cell begins that marks a row as practice: 'Block 2: demo', 'train2'.
_PRACTICE = re.compile(
    "([0-9]|{words_before})*({texts}|({whole})[0-9]*$)".format_map(
        {key: "|".join(words) for key, words in VOCABULARY["practice"].items()}
    )
)
# The longest words first, so that 'standardreiz' is not read as 'standard' and more.
_KNOWN_WORDS = re.compile("|".join(sorted(_MEANINGS, key=len, reverse=True)))


@lru_cache(maxsize=2**16)
def plain_name(name: str) -> str:
    """A name in small letters of any script and digits, without accents.

    Examples
    --------
    >>> plain_name("R\u00e9ponse"), plain_name("key_resp.rt")
    ('reponse', 'keyresprt')
    """
    return re.sub(r"[\W_]", "", without_accents(name.lower()))


def without_accents(text: str) -> str:
    """A text whose letters have lost their accents."""
    letters_and_accents = unicodedata.normalize("NFKD", text)  # '\u00e9' is 'e' and an accent
    # NFKD also takes Korean and Japanese letters apart, which NFC joins again.
    return unicodedata.normalize("NFC", re.sub("[\u0300-\u036f]", "", letters_and_accents))


def looks_like(name: str, role: str) -> bool:
    """Whether a column of a file has a role by its name, also in another spelling.

    Examples
    --------
    >>> looks_like("key_resp.keys", "response"), looks_like("amp_standard", "standard")
    (True, True)
    >>> looks_like("Comp_Time", "comparison"), looks_like("comp_onset_time", "comparison")
    (True, False)
    """
    plain = plain_name(name.removeprefix("values."))  # as Inquisit writes it
    if plain == role.replace("_", "") or plain in VOCABULARY["columns"].get(role, ()):
        return True
    if role == f"n_{_counted_answer(name)}":  # 'First longer' is n_first
        return True

    # PsychoPy and E-Prime write columns such as key_resp.keys. Those of practice and instructions,
    # such as practice_resp.keys, do not have the role.
    _, dot, ending = name.rpartition(".")
    if dot and ending in VOCABULARY["psychopy"].get(role, ()):
        parts = (*VOCABULARY["psychopy"]["other_parts"], *VOCABULARY["practice"]["texts"])
        return re.search("|".join(parts), plain) is None

    # The standard or the comparison itself, which may be a time, not its position or a response.
    words = named_places(name)
    without_time = re.sub("(?i)time", "", name)
    return words.stimuli == [role] and not words.places and _may_be_stimulus(without_time)


def names_like(names: Iterable[str], role: str) -> list[str]:
    """The names that a column with this role may have."""
    return [name for name in names if looks_like(name, role)]


class NamedPlaces(NamedTuple):
    """What the words in the name of a column, or in a cell, say of the stimuli."""

    stimuli: list[str]  # 'standard' and 'comparison'
    places: list[str]  # in a trial: 'first' and 'second'
    other_words: set[str]


@lru_cache(maxsize=2**16)
def named_places(text: str) -> NamedPlaces:
    """The stimuli in the name of a column or in a cell, their places in a trial, and other words.

    Examples
    --------
    >>> tuple(named_places("standard_first")), tuple(named_places("SC"))
    ((['standard'], ['first'], set()), (['standard', 'comparison'], [], set()))
    >>> tuple(named_places("left")), tuple(named_places("testInterval"))
    (([], [], {'left'}), (['comparison'], [], {'interval'}))
    """
    plain = without_accents(re.sub("(?<=[a-z])(?=[A-Z])", " ", text)).lower()  # 'testInterval'
    words: list[str] = []
    # 'test', '1st' or '-1.0', but not the 'st' of 'stim1.started'
    for word in re.findall(
        r"[^\W\d_]+|-?[.,]?[0-9][0-9.,]*(?:(?:st|nd|e|er|re|ere|eme)(?![a-z0-9]))?", plain
    ):
        word = re.sub("[.,]0*$", "", word)  # '1.0' is '1'
        parts = _KNOWN_WORDS.findall(word)
        # A word such as 'testinterval' is several words if they are all of it.
        words += parts if "".join(parts) == word else [word]

    # Two letters, such as SC: the standard came first. Letters of other words have no meaning.
    initials = [VOCABULARY["letters"].get(letter, "") for letter in "".join(words)]
    if sorted(initials) == ["comparison", "standard"]:
        return NamedPlaces(initials, [], set())

    meanings = [_MEANINGS.get(word, "") for word in words]
    stimuli = list(filter(VOCABULARY["stimuli"].__contains__, meanings))
    places = list(filter(VOCABULARY["places"].__contains__, meanings))
    return NamedPlaces(stimuli, places, set(words) - _MEANINGS.keys())


@lru_cache(maxsize=2**16)
def _counted_answer(name: str) -> str:
    """The answer that a column counts by the words of its name; empty if it names none.

    Examples
    --------
    >>> _counted_answer("First longer"), _counted_answer("n_said_same")
    ('first', 'equal')
    >>> _counted_answer("First weight"), _counted_answer("second_stimulus"), _counted_answer("n2")
    ('', '', '')
    >>> _counted_answer("n_first1"), _counted_answer("first,longer")
    ('', '')
    """
    # A digit or a comma counts as a word, so that 'n_first1', where 1 is the number of a response,
    # and 'first,longer', which is a whole row, count no answer.
    words = re.findall("[A-Z]?[a-z]+|[A-Z]+|[0-9;,]", without_accents(name))
    other_words = set(map(str.lower, words)).difference(VOCABULARY["words"]["counting"])
    if len(words) < 2 or len(other_words) != 1:  # 'first' alone may be a stimulus
        return ""
    return _ANSWERS.get(other_words.pop(), "")


def is_no_response(text: str) -> bool:
    """Whether a cell of responses says that nobody responded."""
    word = text.lower()
    return word in MISSING_WORDS or word in VOCABULARY["missed"]["responses"]


def filled_texts(column: Column) -> list[str]:
    """The texts of a column, without those that say that nobody responded."""
    return list(filterfalse(is_no_response, column.texts))


def is_response_sign(name: str) -> bool:
    """Whether a column has keys or reaction times.

    Examples
    --------
    >>> is_response_sign("key_resp_2.rt"), is_response_sign("keyPress"), is_response_sign("start")
    (True, True, False)
    """
    return not {plain_name(name), *named_places(name).other_words}.isdisjoint(
        VOCABULARY["missed"]["columns"]
    )


def is_missed_flag(column: Column) -> bool:
    """Whether a column says yes where nobody responded."""
    flags = VOCABULARY["missed"]["flags"]
    return is_flag(column.texts) and any(map(plain_name(column.name).__contains__, flags))


def practice_texts(name: str, texts: Texts) -> Texts:
    """The texts of a column that say that a row is practice.

    A column such as `is_practice` may hold 1 and 0. If it holds other numbers too, it counts
    trials.

    Examples
    --------
    >>> practice_texts("phase", ["Practice 1", "1"]), practice_texts("practice", ["TRUE", "FALSE"])
    (['Practice 1'], ['TRUE'])
    >>> practice_texts("practice", ["1", "2", "3"]), practice_texts("part", ["0_training", "TRAIN"])
    ([], ['0_training', 'TRAIN'])
    """
    plain = plain_name(name)
    is_of_practice = any(map(plain.__contains__, VOCABULARY["practice"]["texts"]))
    # PsychoPy counts the trials of a loop in columns such as 'practice.thisN', empty elsewhere.
    if is_of_practice and ".this" in name:
        return list(filter(None, texts))
    has_flags = is_of_practice and is_flag(texts)  # such as 'TRUE' in `is_practice`

    marks = []
    for text in texts:
        is_true = has_flags and text.lower() in TRUE_WORDS
        # Not a path such as './demo'.
        if is_true or (_PRACTICE.match(plain_name(text)) and text[:1].isalnum()):
            marks.append(text)
    return marks


def taken_out_texts(name: str, texts: Texts) -> Texts:
    """The texts of a column that say that a trial does not count.

    Examples
    --------
    >>> taken_out_texts("exclude", ["0", "1"]), taken_out_texts("is_valid", ["yes", "no"])
    (['1'], ['no'])
    >>> taken_out_texts("excluded", ["x", ""]), taken_out_texts("keep", ["x", ""])
    (['x'], [''])
    >>> taken_out_texts("status", ["ok", "aborted"]), taken_out_texts("rejected", ["0", "3"])
    (['aborted'], [])
    >>> taken_out_texts("TrialError", ["0", "6", "8"])
    ['8']
    """
    taken_out = VOCABULARY["taken_out"]
    plain = plain_name(name)
    # A cell 'aborted' takes a trial out in any column, but a code such as '8' in one of codes only.
    words = {*taken_out["by_1"], *taken_out["codes"].get(plain, ())}
    flag = re.sub("^(is|was|trial)+|trials?$", "", plain)  # 'is_valid' is 'valid'
    if is_flag(texts) and flag in taken_out["by_1"]:  # such as 'rejected'
        words |= TRUE_WORDS
    elif is_flag(texts) and flag in taken_out["by_0"]:  # such as 'valid'
        words |= FALSE_WORDS  # also the empty cell, where valid trials are crossed
    # The cell itself, for '1.0', or its plain form, for 'Fixation break'.
    return [text for text in texts if {text.lower(), plain_name(text)} & words]


def from_left_to_right(keys: Iterable[str]) -> list[str]:
    """Keys in the order in which they stand for the first and for the second stimulus.

    Letters have the order of the keyboard, and other texts that of the alphabet.

    Examples
    --------
    >>> from_left_to_right(["m", "z"]), from_left_to_right(["right", "left"])
    (['z', 'm'], ['left', 'right'])
    """
    letters = "qazwsxedcrfvtgbyhnujmikolp"
    return sorted(keys, key=lambda key: (letters.find(key.lower()), key))


def is_flag(texts: Iterable[str]) -> bool:
    """Whether the cells of a column say yes or no."""
    return set(map(str.lower, texts)) <= TRUE_WORDS | FALSE_WORDS


def unit_in(name: str) -> str:
    """The unit of stimuli in the name of a column; empty where the name has none.

    A unit of one letter stands at the end, or in brackets: 's1' is a stimulus.

    Examples
    --------
    >>> unit_in("level1 (dB SPL)"), unit_in("dB2"), unit_in("log10_s1"), unit_in("feedback")
    ('dB', 'dB', 'log10', '')
    >>> unit_in("pitch1_cents"), unit_in("semitone2"), unit_in("percent")
    ('cents', 'semitones', '')
    >>> unit_in("amp1_\u00b5m"), unit_in("hz1"), unit_in("force_1 [N]"), unit_in("s1")
    ('\u00b5m', 'Hz', 'N', '')
    >>> unit_in("1 n/a"), unit_in("1 N.A."), unit_in("data.s1"), unit_in("log2_f1")
    ('', '', '', 'octaves')
    >>> unit_in("lum1_cd_m2"), unit_in("luminance (cd/m\u00b2)")
    ('cd/m2', 'cd/m2')
    """
    plain = re.sub("cd_?m2", "cd/m2", _folded(name))
    words = re.findall(r"cd/m2|log10|log2|[^\W\d_]+", plain)  # other units have no digits

    for unit, unit_words in VOCABULARY["units"]["logarithms"].items():
        if not set(words).isdisjoint(unit_words):
            return unit

    # A letter alone, after a sign and at the end or before a sign: 'g' of 'force1_g', or 'N' of
    # 'force_1 [N]', but no letter of 'n/a', 'N.A.' and 'data.s1', which is a first stimulus.
    last_letters = re.findall(r"(?<=_|[^\w/])[^\W\d_](?=[\W_]*$|[^\w/.])", plain)
    for unit in VOCABULARY["units"]["intensity"]:
        if _folded(unit) in (words if len(unit) > 1 else last_letters):
            return unit
    return ""


def _folded(text: str) -> str:
    """A text in small letters, in which both signs of micro are the same."""
    return unicodedata.normalize("NFKC", text).lower()


def is_percentage(name: str) -> bool:
    """Whether a column holds percentages or shares by its name.

    Examples
    --------
    >>> is_percentage("p_second"), is_percentage("% second"), is_percentage("n_second")
    (True, True, False)
    """
    words = VOCABULARY["units"]["percentage"]
    return "%" in name or any(map(plain_name(name.replace("resp", "")).__contains__, words))


# --- Roles ----------------------------------------------------------------------------------------

_UNIT_MEANINGS = {
    "dB": "20 dB are a factor of ten",
    "dB-power": "10 dB are a factor of ten",
    "log10": "they are decadic logs",
    "octaves": "they are octaves",
    "semitones": "they are semitones",
    "cents": "they are cents, 1200 to an octave",
    "ln": "the numbers are natural logs",
    ANY_UNIT: "they are intensities; better with the name of their unit, such as Hz",
    "NAME": "it is a unit of logarithms; if numbers are differences from a base, add the base in "
    "the file; if their signs are directions, write them without signs",
}
#: Patterns of the sign of the first of two stimuli in names of columns, with the sign of the second
#: stimulus: the last digit, apart from those of m2 and of a level such as 're 1 uPa', or a word.
_NUMBERS = {r"1(?=[^0-9]*(?:m2|re\W?\w+.*)?$)": "2", **VOCABULARY["pairs"]}
#: The same for signs that may not say which stimulus came first.
_LETTERS = {
    r"(?<![^\W\d_])a(?![^\W\d_])": "b",
    r"(?<![A-Z])A(?![^\W\d_])": "B",
    "(?<![0-9])0(?=[^0-9]*$)": "1",
    "left": "right",
    "Left": "Right",
}
#: Names of columns that are numbers, or end in the number of a question, trial or subject, as
#: 'b1_t1', 'Q1_3' and 'w1_s1'.
_NUMBER_OF_TRIAL = (
    r"(?i)\d+|.*\d_(?:[pqrst]|rep|trial|item|vpn?|sub|subj|subject|participant)_?\d+|q\d+_\d+"
)
#: Numbers in names, and initials in capitals, but no name that is a number.
_NUMBERED = re.compile(r"[\W_]*(\d+(?=\D)|(?<=\D)\d+|(?<![^\W_])[A-Z]{1,2}(?![^\W_]))")
#: A number of a pair of stimuli. In '[440,460]' the comma stands between two numbers, and in
#: 'X200.240.1', which R writes for '200-240-1', so does each point.
_NUMBER_OF_PAIR = r"(?<!\d\.)\d+\.\d+(?!\.?\d)|\d+(?:,\d+(?![\d.]*[\])]))?"
#: Shapes of names with two numbers, neither of which belongs to a question, trial or subject, as in
#: 'Q{}_{}', to the name of a value, as in 'F{}={}', to a hexadecimal number, as in '{}c{}', or to
#: times and counts of PsychoPy.
_PAIR_SHAPE = (
    r"(?i)(?!.*(?<![rt]){}[-_. ]*(?:q|r|rep|t|trial|run|item|question)[-_. ]*{})"
    r"(?!.*{}_(?:[ps]|vpn?|sub|subj|subject|participant)_?{})"
    r"(?!(?:[^{}]*[-_. ])?(?:q|b|block|question)[-_. ]*{}[^{}]+{}$)"
    r"(?!.*[^\W\d]{} ?= ?{})"
    r"(?!{}[a-f]{}$)(?!.*\.(started|stopped|this\w*)$)"
    r"(\w+{}[^{}]+)?[^{}]*{}[^{}]+{}[^{}]*"  # 'Q5_' may be in front
)
#: By role, another role whose names are proposed for it, but are not read without an option.
_PROPOSED = {"response": "key", "subject": "id"}
#: Counts, any of which makes a table of counts, in the order in which messages name them.
_COUNTS = ("n_equal", "n_second", "n_comparison", "n_trials")
#: The count of an answer, and that of the other answer, whose sum is the number of trials.
OTHER_COUNTS = {"n_second": "n_first", "n_equal": "n_different", "n_comparison": "n_standard"}
#: Counts that may have similar names in a file: these, and the counts of the other answers.
_ALL_COUNTS = (*OTHER_COUNTS.values(), *_COUNTS)
#: The counts of the task with three answers, as a file has them.
_THREE_COUNTS = ("n_first", "n_equal", "n_second")
_STIMULI = ("s1", "s2", "i1", "i2")
#: Rows in which correct answers hardly come from participants.
_MANY = 30
#: Roles whose names in the file are proposed if the columns are missing. Where n_equal is missing,
#: the user says which answer was counted.
_REQUIRED = {"subject", *_STIMULI, "standard", "comparison", "response", *_ALL_COUNTS} - {"n_equal"}


def with_likely_columns(names: Texts, options: ReadOptions) -> ReadOptions:
    """Options that also name the columns of a file with similar names.

    Examples
    --------
    >>> with_likely_columns(["Participant", "s1", "s2", "answer"], ReadOptions()).columns
    {'subject': 'Participant', 'response': 'answer'}
    """
    options = _with_intensities(names, options)
    roles = ["standard", "comparison"] if options.has_standard else list(_STIMULI)
    if options.subject_from is None:
        roles.insert(0, "subject")  # which notes name first
    likely_columns = _likely(names, options, [*roles, "session", "block", "trial"])
    options = replace(options, columns={**likely_columns, **options.columns})  # given names win
    options = _with_unit_in_names(names, options)
    if options.correct is None:  # responses or counts are read
        answers = _likely_answers(names, options)
        # Notes name the columns in this order: likely names come before given ones.
        options = replace(options, columns={**likely_columns, **answers, **options.columns})
    return options


def _with_unit_in_names(names: Texts, options: ReadOptions) -> ReadOptions:
    """Options with the unit in the names of both stimuli, if no option gives another unit.

    Columns with one unit, such as 'weight1_g' and 'weight2_g', are the stimuli if the file has no
    other stimuli.

    Examples
    --------
    >>> options = _with_unit_in_names(["weight1_g", "weight2_g", "rt1_ms"], ReadOptions())
    >>> options.unit, options.stimuli, options.name("i1")
    ('g', ('i1', 'i2'), 'weight1_g')
    >>> _with_unit_in_names(["first_N", "second_N"], ReadOptions()).unit
    'N'
    >>> _with_unit_in_names(["s1_ms", "s2_ms"], ReadOptions(unit="ms")).columns
    {'i1': 's1_ms', 'i2': 's2_ms'}
    """
    if options.intensity is not None:  # given in the unit of the file
        return options
    stimuli = options.stimulus_names
    # Without a column of stimuli, two names such as 'weight1_g' and 'weight2_g' may be the stimuli.
    if not options.has_standard and set(map(options.name, _STIMULI)).isdisjoint(names):
        candidates = [
            name
            for name in filter(_may_be_stimulus, names)
            if name.endswith("_N") or not _counted_answer(name)  # 'first_N' may be a force
        ]
        stimuli = _stimulus_pair(candidates, _NUMBERS)

    units = set(map(unit_in, stimuli))
    is_same_unit = len(units) == 1 and "" not in units
    if not is_same_unit or options.unit not in (None, *units) or not set(stimuli) <= set(names):
        return options
    # Now `stimuli` of the options are i1 and i2, if the unit is one of intensities.
    options = replace(options, unit=units.pop())
    name_of_stimulus = dict(zip(options.stimuli, stimuli, strict=True))
    return replace(options, columns={**options.columns, **name_of_stimulus})


def _may_be_stimulus(name: str) -> bool:
    """Whether a name has no word such as 'onset': a pair of times is not the stimuli.

    Examples
    --------
    >>> [_may_be_stimulus(name) for name in ("interval_1", "dots_interval_1", "interval_1_ms")]
    [False, True, True]
    """
    if has_word(name, "of_quantities") or unit_in(name):  # its interval is a place or a duration
        words = VOCABULARY["words"]["of_interval"]
        name = " ".join(named_places(name).other_words.difference(words))
    return not has_word(name, "about")


def has_word(name: str, kind: str) -> bool:
    """Whether a name has one of the words of a kind in the vocabulary, such as 'of_times'."""
    return not named_places(name).other_words.isdisjoint(VOCABULARY["words"][kind])


def _with_intensities(names: Texts, options: ReadOptions) -> ReadOptions:
    """Options that read s1 and s2 as intensities if there are no i1 and i2, or the other way round.

    The unit of the options asks for i1 and i2, or for s1 and s2. Without a unit, i1 and i2 are read
    as s1 and s2, and :func:`~bayes_toe.data.layouts.require_unit` asks for their unit.

    Examples
    --------
    >>> _with_intensities(["s1", "s2"], ReadOptions(unit="um")).columns
    {'i1': 's1', 'i2': 's2'}
    """
    stimuli = options.stimuli
    other_names = [options.name(role) for role in _STIMULI if role not in stimuli]
    has_stimuli = not set(names).isdisjoint(options.stimulus_names)
    is_reference_alone = options.intensity is not None and options.unit is None
    if (
        options.has_standard
        or has_stimuli
        or is_reference_alone  # --intensity without a unit is about columns i1 and i2
        or not set(other_names) <= set(names)
    ):
        return options
    name_of_stimulus = dict(zip(stimuli, other_names, strict=True))
    return replace(options, columns={**options.columns, **name_of_stimulus})


def _likely_answers(names: Texts, options: ReadOptions) -> dict[str, str]:
    """The file's names for the responses, or for counts, if they are other names than ours.

    The names are empty where the file has our names, or it is not clear which columns count.

    Examples
    --------
    >>> _likely_answers(["s1", "s2", "answer"], ReadOptions())
    {'response': 'answer'}
    >>> _likely_answers(["s1", "s2", "same", "total"], ReadOptions())
    {'n_equal': 'same', 'n_trials': 'total'}
    >>> _likely_answers(["s1", "s2", "First longer", "Second longer"], ReadOptions())
    {'n_first': 'First longer', 'n_second': 'Second longer'}
    """
    roles_in_file = {*_roles_in_file((*_ALL_COUNTS, "n_correct", "response"), names, options)}
    if "response" in roles_in_file or ("n_trials" in roles_in_file and len(roles_in_file) == 2):
        return {}  # the file has our names of responses, or of trials and a count

    counts = _likely(names, options, _ALL_COUNTS)
    count_roles = roles_in_file | counts.keys()  # by our names or by similar ones
    # Trials and one count, perhaps with that of the other answer, are no responses, whatever
    # another column is named.
    if "n_trials" in count_roles and len(count_roles.difference(OTHER_COUNTS.values())) == 2:
        return counts
    response = _likely(names, options, ("response",))
    if response:  # other columns with similar names are then no counts
        return {} if roles_in_file else response  # beside our names of counts it is no response

    # One column such as 'second_longer' or 'same' may have responses, yes or no.
    if len(count_roles) == 1 and not any(map(is_percentage, counts.values())):
        return {}
    return counts


def _likely(names: Texts, options: ReadOptions, roles: Iterable[str]) -> dict[str, str]:
    """The file's names for these roles, without roles that have several candidates or none.

    A role that the options name, or that is itself a name in the file, needs no other name.
    """
    # With a standard and a comparison, nothing is read from columns such as s1.
    unused = _STIMULI if options.has_standard else ()
    names_in_use = {options.name(role) for role in COLUMNS if role not in unused}
    free = [name for name in names if name not in names_in_use]
    name_by_role = {}
    for role in roles:
        candidates = names_like(free, role)
        if len(candidates) == 1 and role not in options.columns and role not in names:
            name_by_role[role] = candidates[0]
    return name_by_role


# --- What is read, and what is wrong with the names -----------------------------------------------


def columns_to_read(
    names: Texts,
    options: ReadOptions,
    columns: Collection[Column] = (),
) -> tuple[list[str], list[str], list[Remedy]]:
    """The roles of the columns that are read, problems of names, and options that solve the last.

    `names` are those of the file, and `columns` its columns, whose cells decide which options are
    proposed.

    Examples
    --------
    >>> columns_to_read(["subject", "s1", "s2", "n_equal", "n_trials", "rt"], ReadOptions())
    (['subject', 's1', 's2', 'n_equal', 'n_trials'], [], [])
    """
    # Options solve the last problem: what is checked after it waits until it is solved.
    roles_read = _roles_read(names, options)
    problems = list(_role_problems(roles_read, options))
    first_name = options.stimulus_names[0]
    third_name = re.sub(r"(?<=\D)1(?=\D*$)", "3", first_name)  # 's3_ms' of 's1_ms'
    if first_name != third_name in names:
        problems.append(
            f"column {display_name(third_name)}: found a third stimulus, allowed: trials with "
            "two stimuli"
        )
    if has_word(first_name, "of_attenuation"):
        problems.append(
            f"column {display_name(first_name)}: found attenuation, whose larger numbers are "
            "weaker stimuli, allowed: levels. Change the signs, and the names of both columns"
        )
    if options.subject_from is not None:
        roles_read.remove("subject")

    response = options.name("response")
    if "response" in roles_read and response in names and looks_like(response, "correct"):
        problems.append(
            f"column {display_name(response)}: found as response, though it seems to say right or "
            "wrong."
        )
        return roles_read, problems, score_remedies([response])

    unordered = unordered_stimuli(names, options, columns)
    if unordered:
        problems.append(
            f"columns {unordered} do not say which stimulus came first, without which no order "
            "effect can be seen. If both were shown at once, there is no order."
        )
        return roles_read, problems, list(_unordered_remedies(unordered, names, options, columns))

    # The names that must be there once: those of --where, those of roles in the order of `COLUMNS`,
    # and those that options give and the file lacks.
    roles = filter(roles_read.__contains__, (*COLUMNS, "correct", "standard_interval"))
    required = dict.fromkeys(
        [
            *options.where,
            *map(options.name, roles),
            *filterfalse(names.__contains__, map(options.name, options.columns)),
        ]
    )
    problems += repeated_columns(names, required)
    missing = list(filterfalse(names.__contains__, required))
    if not missing:
        return roles_read, problems, task_remedies(columns)

    problems.append(_missing_columns(names, missing, columns))
    remedies = list(dict.fromkeys(_remedies(roles_read, options, columns)))
    options_proposed = [remedy.option for remedy in remedies]
    if options_proposed.count("columns") == 1 and _is_evident(remedies[0], columns, options):
        remedies[0] = remedies[0]._replace(is_evident=True)
    return roles_read, problems, remedies


def _is_evident(remedy: Remedy, columns: Iterable[Column], options: ReadOptions) -> bool:
    """Whether names and cells say that columns have the roles that a remedy gives them.

    The names of the stimuli differ by numbers or words such as first and second. The options name
    no other columns for these roles.

    Examples
    --------
    >>> ids = Column.from_texts("id", "aaaaabbbbb")
    >>> tones = [Column.from_texts(name, "1234512345") for name in ("tone1", "tone2")]
    >>> names = (("subject", "id"), ("s1", "tone1"), ("s2", "tone2"))
    >>> _is_evident(Remedy("columns", names), [ids, *tones], ReadOptions())
    True
    """
    if remedy.option != "columns":
        return False
    name_by_role = option_values([remedy])["columns"]
    stimuli = tuple(name for role, name in name_by_role.items() if role in _STIMULI)
    if stimuli != _stimulus_pair(stimuli, _NUMBERS) or not all(map(_may_be_stimulus, stimuli)):
        return False
    for column in columns:
        if column.name == name_by_role.get("subject") and not _has_evident_subjects(column):
            return False
    free_roles = {"subject", "response", *_STIMULI} - options.columns.keys()
    return name_by_role.keys() <= free_roles


def _has_evident_subjects(column: Column) -> bool:
    """Whether a column is called id or similarly, with runs of five rows or more on average."""
    is_named = looks_like(column.name, "id") and not has_word(column.name, "of_unclear_ids")
    return is_named and len(run_starts(column.codes)) <= len(column.codes) / 5


def _unordered_remedies(
    unordered: str, names: Texts, options: ReadOptions, columns: Iterable[Column]
) -> Iterator[Remedy]:
    """Options that say which of the `unordered` stimuli came first."""
    interval_names = _interval_names(columns)
    yield from _order_remedies(interval_names or ["NAME"])
    if "left" not in unordered.lower():  # sides are no order
        yield Remedy("standard_first", "", "if the standard was always first")
    pair = names_like(names, "comparison")[:1] + names_like(names, "standard")[:1]
    if len(pair) == 2 and not interval_names and "standard" not in options.columns:
        places = tuple(zip(options.stimuli, pair, strict=True))
        yield Remedy("columns", places, "if the comparison was always first")


def _missing_columns(names: Texts, missing: Texts, columns: Collection[Column]) -> str:
    """What is missing, what the file has instead, and what may help."""
    names_shown = join_names(map(display_name, filter(None, names)), max_items=30)
    absent = join_words([f"no column {display_name(name)}" for name in missing])
    absent = absent.replace("n_equal", "n_equal or n_second")  # either may be meant
    problem = f"there is {absent}. The columns are {names_shown}."
    if "n_equal" in missing:
        problem += (
            " --columns n_second=NAME names the column that counts 'second'; in the same way, name "
            "n_first, n_equal, n_different or, of right answers in 2AFC, n_correct."
        )
    if "".join(names).isdigit():  # numbers take the place of the names
        problem += " The file has no header, so these are the numbers of its columns."
    if "NAME" in missing:
        problem += " In the place of NAME, type one of them."
    if {"standard", "comparison", *_STIMULI}.isdisjoint(missing):
        return problem
    difference = next(filter(_is_difference, names), None)
    if difference is not None:
        problem += (
            f" If {display_name(difference)} is a difference from a standard, or a ratio to it,"
            " add columns standard and comparison with the stimuli. With a difference in per cent, "
            "the comparison is standard * (1 + difference / 100)."
        )
    series = _series(names)
    if series:
        problem += (
            f" If each of the {len(series)} columns such as {display_name(series[0])} belongs to a "
            "trial, write a row for each trial with columns subject, s1, s2 and response. If their "
            "names have both stimuli, type --wide with the pattern, such as '*{first}_{second}'."
        )
    # A column has no name, or that of the column before it, as where a cell was merged.
    if re.search(r"\n\n.|(?m:^(\D.*)\n\1$)", "\n".join(names)):
        problem += " If names stand in two rows, write them in one row."
    # An interval that differs from row to row, 1, 2, 1, 2, is that of the stimulus in the row.
    alternating = [
        column for column in columns if len(run_starts(column.codes)) == len(column.codes) > 9
    ]
    if names_like(names, "event") or _interval_names(alternating):
        problem += (
            " If a row is one event, such as a stimulus or a response, write a row for each trial "
            "with columns s1, s2 and response."
        )
    if names_like(names, "comparison") and not names_like(names, "standard"):
        problem += (
            " If one standard was in all trials, add a column standard with its level. Type "
            "--standard-first if it always came first."
        )
    return problem


def _is_difference(name: str) -> bool:
    """Whether a name says how much one stimulus differs from the other."""
    return looks_like(name, "difference") or has_word(name, "of_differences")


def _role_problems(roles_read: Texts, options: ReadOptions) -> Iterator[str]:
    """Problems of two columns for the subject or the answers, and of a column with two meanings."""
    # Two columns are allowed: a count and n_trials, or responses and n_trials, which are
    # frequencies. Three counts are allowed with n_first, which is not in `_COUNTS`.
    answers = [role for role in ("response", *_COUNTS) if role in roles_read]
    if len(answers) > 2 or answers in (["response", "n_equal"], ["response", "n_second"]):
        first, *other_columns = [display_name(options.name(role)) for role in answers]
        yield (
            f"column {first}: found together with {' and '.join(other_columns)}, allowed: "
            "responses (one row per trial), counts of one response (one row per pair), or n_first, "
            "n_equal and n_second"
        )

    names_read = [options.name(role) for role in roles_read]
    for name in dict.fromkeys(names_read):
        if names_read.count(name) > 1:
            roles = " and as ".join(role for role in roles_read if options.name(role) == name)
            yield f"column {display_name(name)}: found as {roles}, allowed: one meaning per column"

    if options.comparison_code is not None and not options.has_standard:
        yield "--comparison-code: found alone, allowed: with --standard-interval COLUMN"


def _roles_read(names: Texts, options: ReadOptions) -> list[str]:
    """The roles of the columns that must be read, and of optional ones that the file has."""
    roles_read = ["subject", *options.stimuli]
    if options.interval_column is not None:
        roles_read.append("standard_interval")
    roles_read += _answer_roles(names, options)
    # A column called 'condition' may be what an option takes it for, such as the order.
    condition = options.name("condition")
    is_free = condition not in map(options.name, roles_read)
    if options.condition or (condition in names and is_free):
        roles_read.append("condition")

    # A column of the history, such as block, is optional. It is not read if its name is there
    # twice, or if an option gives that name another role.
    names_taken = [options.name(role) for role in COLUMNS if role not in HISTORY_COLUMNS]
    names_taken.append(options.name("standard_interval"))
    for role in HISTORY_COLUMNS:
        name = options.name(role)
        if name not in names_taken and names.count(name) == 1:
            roles_read.append(role)
    return [role for role in roles_read if role not in options.ignore]


def _answer_roles(names: Texts, options: ReadOptions) -> Texts:
    """The roles of the columns of responses or counts, also of those that are missing.

    Examples
    --------
    >>> _answer_roles(["n_second"], ReadOptions()), _answer_roles(["rt"], ReadOptions())
    (['n_second', 'n_trials'], ['response'])
    >>> _answer_roles(["n_first", "n_equal"], ReadOptions())
    ['n_first', 'n_equal', 'n_second']
    >>> _answer_roles(["n_first", "n_second", "n_trials"], ReadOptions())
    ['n_second', 'n_first']
    >>> _answer_roles(["n_first", "n_trials"], ReadOptions())
    ['n_first', 'n_trials']
    """
    # What an option takes as a stimulus is no count: n_first and n_second may be numbers of dots.
    names = list(filterfalse(set(options.stimulus_names).__contains__, names))
    if options.correct is not None:
        return ["correct"]
    if "n_correct" in options.columns:  # only by the option: it may count a same-different task
        return ["n_correct", "n_trials"]
    counts = _roles_in_file(_COUNTS, names, options)
    response = options.name("response")
    if not counts or (response in names and response not in map(options.name, counts)):
        return ["response", *counts]

    other_counts = _roles_in_file([*OTHER_COUNTS.values()], names, options)
    if counts == ["n_trials"]:
        # Without these n_equal is missing, so that what was counted is asked for.
        return [*(other_counts[:1] or ["n_equal"]), "n_trials"]
    count = counts[0]
    has_one_count = counts[1:] in ([], ["n_trials"]) and not is_percentage(options.name(count))
    if has_one_count and OTHER_COUNTS[count] in other_counts:  # both counts make the trials
        return [count, OTHER_COUNTS[count]]
    n_answers = len(_roles_in_file(_THREE_COUNTS, names, options))
    # With the counts of two of three answers and without the trials, the third count is missing.
    if n_answers == 3 or (n_answers == 2 and "n_trials" not in counts):
        return list(_THREE_COUNTS)
    return list(dict.fromkeys([*counts, "n_trials"]))


def _roles_in_file(roles: Texts, names: Texts, options: ReadOptions) -> list[str]:
    """Those of the roles whose columns the file has."""
    return [role for role in roles if options.name(role) in names]


def unordered_stimuli(names: Texts, options: ReadOptions, columns: Iterable[Column] = ()) -> str:
    """The names of two columns of stimuli where nothing says which came first, as 'std and test'.

    The columns are a standard and a comparison, if there are these. If some other column may have
    the order, they may also be a standard and a column that the user names, stimuli 1 and 2, or
    stimuli A and B. Stimuli 1 and 2 are in order unless that other column changes from trial to
    trial. Left and right need no column that may have the order. The text is empty where the order
    is known, or a column is missing.
    """
    if options.has_standard:
        return ""
    if {"standard", "comparison"} <= options.columns.keys():  # the user names them
        return f"{options.columns['standard']} and {options.columns['comparison']}"
    candidates = options.stimulus_names
    are_unknown = set(names).isdisjoint(candidates)
    if are_unknown:  # the file lacks these names, so that all its columns may be stimuli
        candidates = names
    standards = names_like(candidates, "standard")
    comparisons = names_like(candidates, "comparison")
    interval_names = _interval_names(columns)
    # Without a column of their order, the user may name them as the first and the second stimulus.
    if standards and comparisons and (are_unknown or interval_names):
        return f"{display_name(standards[0])} and {display_name(comparisons[0])}"
    pair = _stimulus_pair(candidates, _NUMBERS)
    interval_names = _orders_of_labels(pair, interval_names, columns)
    if standards and interval_names:
        return f"{display_name(standards[0])} and NAME"
    pair = pair or _stimulus_pair(candidates, _LETTERS)
    # Sides are no order, but the user may say that the left one was always first.
    are_sides = are_unknown and "left" in str(pair).lower()
    return " and ".join(map(display_name, pair)) if interval_names or are_sides else ""


def _orders_of_labels(
    pair: Texts, interval_names: list[str], columns: Iterable[Column]
) -> list[str]:
    """The columns of order without which nobody knows which of two stimuli came first.

    `pair` has stimuli 1 and 2, which are places unless a column says another order.
    """
    if not pair:
        return interval_names
    return [name for name in interval_names if _are_labels(pair, name, columns)]


def _are_labels(pair: Texts, order: str, columns: Iterable[Column]) -> bool:
    """Whether 1 and 2 are labels of the stimuli, and a column of order says which came first.

    A column of order has both codes for a pair of the same two stimuli, and changes from trial to
    trial, or has cells such as SC and CS. Any other column follows from the stimuli, or
    distinguishes subjects or blocks.
    """
    # 'first_tone' says its place, and a column of order such as 'interval' may have pauses.
    if "first" in pair[0].lower() or looks_like(order, "isi"):
        return False
    column_by_name = {column.name: column for column in columns}
    if not column_by_name.keys() >= set(pair):  # a stimulus is missing, or has too many texts
        return False
    order_column = column_by_name[order]
    order_codes = order_column.codes
    first, second = (column_by_name[name].codes for name in pair)
    n_pairs = len(combination_counts(first, second))
    n_ordered_pairs = len(combination_counts(first, second, order_codes))
    # If the order follows from the stimuli, only equal stimuli have both codes, and are fewer than
    # half of the pairs.
    is_independent = n_ordered_pairs > 1.5 * n_pairs
    # Codes of subjects or blocks have long runs of rows, five or more on average.
    changes = len(run_starts(order_codes)) > 0.2 * len(order_codes)
    return is_independent and (changes or _has_both_orders(order_column))


def _interval_names(columns: Iterable[Column]) -> list[str]:
    """The columns of two codes at most that may say which stimulus came first, by their names."""
    return [
        column.name
        for column in columns
        if len(filled_texts(column)) <= 2
        and (
            looks_like(column.name, "standard_interval")
            or says_interval(column)
            or _has_both_orders(column)
        )
    ]


def _has_both_orders(column: Column) -> bool:
    """Whether the cells of a column name two stimuli in both orders.

    Examples
    --------
    >>> _has_both_orders(Column.from_texts("condition", ["<sc>", "<cs>", "<cs>"]))
    True
    >>> _has_both_orders(Column.from_texts("played", ["tone1,tone2", "tone2,tone1"]))
    True
    """
    words = map(named_places, filled_texts(column))
    orders = {(*stimuli, *places) for stimuli, places, _ in words}
    first_order = max(orders, default=())
    return len(first_order) == 2 and orders == {first_order, first_order[::-1]}


def says_interval(column: Column) -> bool:
    """Whether a column says of some stimulus, not of a response, that it came first or second.

    Examples
    --------
    >>> names = ("Pest_Interval", "Response_Interval", "response")
    >>> [says_interval(Column.from_texts(name, "1221")) for name in names]
    [True, False, False]
    """
    return (
        has_word(column.name, "of_interval")
        and not has_word(column.name, "of_responses")
        and not looks_like(column.name, "key")  # 'longer_interval' is a response
        and not named_places(column.name).places  # as in 'pos_1', beside 'pos_2'
        and named_places(" ".join(sorted(filled_texts(column)))) == ([], ["first", "second"], set())
    )


def _order_remedies(interval_names: Texts) -> Iterator[Remedy]:
    """Options to type if one of these columns says which stimulus came first.

    Examples
    --------
    >>> [remedy.typed for remedy in _order_remedies(["order"])]
    ['--standard-interval order', '--comparison-interval order']
    """
    for name in interval_names:
        for owner in ("standard", "comparison"):
            # 'test_interval' is that of the comparison, and 'order' may be that of either.
            if named_places(name).stimuli in ([], [owner]):
                meaning = f"if {name} says the interval of the {owner}"
                yield Remedy(f"{owner}_interval", name, meaning)


def task_remedies(columns: Iterable[Column]) -> list[Remedy]:
    """Options to type if a column names several tasks: they choose one of them, or compare them."""
    remedies = []
    for column in columns:
        tasks = tasks_named(column.texts) if looks_like(column.name, "task") else {}
        if len(tasks) < 2:
            continue
        for text, task in tasks.items():
            meaning = f"for the task {task.name!r}"
            remedies.append(Remedy("where", ((column.name, text),), meaning))
        meaning = "for contrast, which compares the tasks"
        remedies.append(Remedy("condition", column.name, meaning))
    return remedies


def unit_remedies(unit: str) -> list[Remedy]:
    """Options to type if stimuli seem to be in this unit; for dB, there are two."""
    choices = ("dB", "dB-power") if unit == "dB" else (unit,)
    default = f"they are intensities in {unit}"
    remedies = []
    for choice in choices:
        meaning = f"if {_UNIT_MEANINGS.get(choice, default)}"
        is_intensity = choice not in _UNIT_MEANINGS  # as ms and Hz
        remedies.append(Remedy("unit", choice, meaning, is_evident=is_intensity))
    return remedies


def suggested_unit(name: str, lowest: float) -> str:
    """The unit that the name of a column of stimuli suggests; empty without it.

    `lowest` is the smallest stimulus.

    Examples
    --------
    >>> suggested_unit("standardLevel", 0), suggested_unit("spl1", 60), suggested_unit("logX", 0)
    ('dB', 'dB', 'log10')
    >>> suggested_unit("catalog", 0), suggested_unit("level1", 350), suggested_unit("ln_level", 0)
    ('', '', '')
    >>> suggested_unit("test_freq", 350), suggested_unit("dur1", 0.4)
    ('Hz', '')
    """
    unit = unit_in(name)
    if unit == "ln":  # natural logarithms are read without a unit
        return ""
    if unit in LOG_UNITS:
        return unit
    # Sounds are not all louder than 100 dB, and no tone of 100 is in kHz.
    suggestions = VOCABULARY["units"]["large" if lowest > 100.0 else "suggested"]
    for word in sorted(named_places(name).other_words):  # a set has no order of its own
        for unit, beginnings in suggestions.items():
            if word.startswith(tuple(beginnings)):
                return unit
    return ""


def intensity_remedies(
    stimuli: FloatArray, unit: str = "", *, are_intensities: bool = False
) -> list[Remedy]:
    """Options to type if stimuli may be no natural logs.

    The suggested `unit` comes first, natural logs come last. The first one is evident if the
    stimuli certainly are intensities.

    Examples
    --------
    >>> [remedy.value for remedy in intensity_remedies(np.array([500.0, 700.0]), "ms")]
    ['ms', 'a.u.', 'ln']
    >>> [remedy.value for remedy in intensity_remedies(np.array([-150.0, 200.0]))]
    ['NAME', 'ln']
    """
    remedies = unit_remedies(unit) if unit else []
    low = stimuli.min()
    # Numbers below 0 are no intensities, but logarithms in a unit that the user names. Numbers from
    # 0 may be logarithms, or intensities, of which 0 has no logarithm: no unit is proposed.
    if low != 0.0:
        remedies += unit_remedies(ANY_UNIT if low > 0.0 else "NAME")
    if are_intensities:
        remedies[0] = remedies[0]._replace(is_evident=True)
    return remedies + unit_remedies("ln")


def _stimulus_pair(names: Texts, signs: Mapping[str, str]) -> Texts:
    """The only two names that differ by one of these signs, such as 'stim1' and 'stim2'.

    Examples
    --------
    >>> _stimulus_pair(["rt", "stim1_dB", "stim2_dB"], _NUMBERS)
    ('stim1_dB', 'stim2_dB')
    >>> _stimulus_pair(["1er son (s)", "2e son (s)"], _NUMBERS)
    ('1er son (s)', '2e son (s)')
    >>> _stimulus_pair(["toneA", "toneB"], _LETTERS), _stimulus_pair(["DATA", "DATB"], _LETTERS)
    (('toneA', 'toneB'), ())
    >>> _stimulus_pair(["amp[0]", "amp[1]"], _LETTERS), _stimulus_pair(["q10", "q11"], _LETTERS)
    (('amp[0]', 'amp[1]'), ())
    """
    return next((pairs[0] for pairs in _pairs_by_sign(names, signs) if len(pairs) == 1), ())


def _pairs_by_sign(names: Texts, signs: Mapping[str, str]) -> Iterator[Sequence[Texts]]:
    """The pairs of names that differ by each of these signs."""
    for sign, second_sign in signs.items():
        pairs = []
        for name in names:
            second_name = re.sub(sign, second_sign, name, count=1)
            if second_name != name and second_name in names:
                pairs.append((name, second_name))
        yield pairs


def _series(names: Iterable[str]) -> list[str]:
    """Names that differ from six others or more in numbers only, as those of columns of trials.

    Examples
    --------
    >>> len(_series(["id", "s1", "s2", *map("T{}_a".format, range(20))])), _series("12345678")
    (20, [])
    """
    letters = {}
    for name in filterfalse(str.isdigit, names):  # columns without names have numbers
        letters[name] = re.sub("[0-9]", "", name)
    n_names = Counter(letters.values())
    return [name for name, name_letters in letters.items() if n_names[name_letters] > 6]


def _likely_pairs(columns: Sequence[Column], *, are_positive: bool = False) -> list[Texts]:
    """Pairs of names of columns that may be the stimuli, at most three, the likeliest first.

    Columns without names stand next to each other and have many values in common. The result is
    [()] if there is no pair. Stimuli that are positive have no number of 0 or below.

    Examples
    --------
    >>> texts = {"dur1": "200 200", "dur2": "200 200", "c1": "2 3", "c2": "3 2"}
    >>> columns = [Column.from_texts(name, text.split()) for name, text in texts.items()]
    >>> _likely_pairs(columns)
    [('c1', 'c2'), ('dur1', 'dur2')]
    >>> planned = {"dur1": [40, 50, 60, 70] * 10, "dur2": [70, 40, 50, 60] * 10}
    >>> texts = {**planned, "dur1_ms": range(40, 80), "dur2_ms": range(60, 100)}
    >>> columns = [Column.from_texts(name, map(str, cells)) for name, cells in texts.items()]
    >>> _likely_pairs(columns)
    [('dur1', 'dur2'), ('dur1_ms', 'dur2_ms')]
    >>> _likely_pairs([Column.from_texts(name, "ab") for name in ("on1_ms", "on2_ms")])
    [()]
    """
    texts = {}
    for column in columns:
        is_no_intensity = are_positive and (column.map(number, float) <= 0.0).any()
        name = re.sub(r"(?i)^trials?[\W_]+(?=[si][12]$)", "", column.name)  # 'trial.s1' is s1
        if not (is_no_intensity or has_word(name, "of_times")):
            texts[column.name] = set(column.texts)

    def agreement(pair: Texts) -> float:
        """The share of values in common, which is 1 for two constant durations, times their number.

        The number counts up to 10: of durations as measured, many may be in common by chance.
        """
        first, second = map(texts.__getitem__, pair)
        n_common = len(first & second)
        n_all = max(1, len(first | second))  # a table without rows has no values
        return n_common * min(n_common, 10) / n_all

    def fit(pair: Texts) -> tuple[bool, float, str]:
        """What ranks pairs: a name of a stimulus, the values in common, and a unit in the name."""
        return _may_be_stimulus(pair[0]), agreement(pair), unit_in(pair[0])

    names_to_skip = {*_series(texts), *filter(re.compile(_NUMBER_OF_TRIAL).fullmatch, texts)}
    names = list(filterfalse(names_to_skip.__contains__, texts))
    pairs = list(chain(*_pairs_by_sign(names, _NUMBERS | _LETTERS)))
    # A value for each subject, such as a threshold, is no stimulus.
    by_subject = {column.name for column in columns if role_by_cells(column) == "subject"}
    pairs = [pair for pair in pairs if not by_subject.issuperset(pair)] or pairs
    # Columns without names have their numbers as names. Few values in common may be a chance there.
    neighbours = [pair for pair in pairwise(filter(str.isdigit, texts)) if agreement(pair) > 2.0]
    return nlargest(3, pairs, key=fit) or [max(neighbours, key=fit, default=())]


def _remedies(
    roles_read: Texts, options: ReadOptions, columns: Collection[Column]
) -> Iterator[Remedy]:
    """Options to type if some of these roles have no column in the file.

    `columns` are those of the file.
    """
    names = [column.name for column in columns]
    roles = dict.fromkeys((*roles_read, *options.columns))
    missing = [role for role in roles if options.name(role) not in names]
    unread = [column for column in columns if column.name not in map(options.name, roles_read)]
    pairs = _likely_pairs(unread, are_positive=options.has_intensities)
    no_pair = [()]  # no two columns may be the stimuli
    lacks_stimuli = not {"s1", "i1"}.isdisjoint(missing)
    if pairs == no_pair and lacks_stimuli:  # names or cells may be pairs of stimuli
        # No option makes trials of a log of events, which has no response beside the stimuli.
        if "response" in missing and names_like(names, "event"):
            return
        wide_remedies = list(_wide_remedies(names, columns))
        yield from wide_remedies
        if wide_remedies:  # what else is missing depends on the pairs
            return
        # Columns n_first and n_second may have numbers of dots, and not of answers.
        pairs = _likely_pairs(list(columns), are_positive=options.has_intensities)
        if pairs == no_pair:  # there may be an order of stimuli whose names say nothing
            yield from _order_remedies(_interval_names(filter(says_interval, columns)))

    required = list(filter(_REQUIRED.__contains__, missing))
    for pair in pairs:
        # By role a tuple with its name, {'s1': ('c1',), 's2': ('c2',)}; empty for the pair ().
        stimuli = dict(zip(options.stimuli, zip(pair, strict=True), strict=False))
        names_to_skip = [*pair, *solutions(columns, options, pair)]
        other_columns = sorted(
            filter(lambda column: column.name not in names_to_skip, unread),
            # Of columns that are as full, ratings come last.
            key=lambda column: (empty(column).sum(), len(column.texts) > 3),
        )
        yield from _count_remedies(missing, options, columns, pair)
        yield from _columns_remedies(required, stimuli, other_columns)


def _count_remedies(
    missing: Texts, options: ReadOptions, columns: Collection[Column], pair: Texts
) -> Iterator[Remedy]:
    """Options to type if the answers are missing, and a column may count them.

    Counts are not larger than the numbers of trials, and follow the trend of an answer: 'second' is
    commoner the larger s2 - s1 is, 'first' the smaller it is, 'equal' the nearer the stimuli are,
    and right answers the farther they are. A name of right answers needs no trend. `pair` has the
    names of the stimuli if the options lack them.
    """
    values = {column.name: column.map(number, float) for column in columns}
    names = [*(pair or options.stimulus_names), *names_like(values, "n_trials")]
    # Two stimuli and a single column of trials, all of them in the file.
    has_columns = len(names) == 3 == len(values.keys() & names)
    # Without a column of subjects, each column may have the counts of a subject.
    if (
        not has_columns
        or {"response", "n_equal"}.isdisjoint(missing)
        or "NAME" in _likely_names(columns, "subject")
    ):
        return
    *_, trials = names
    first, second, n = map(values.pop, names)
    rise = second - first
    count = "n_comparison" if options.has_standard else "n_second"
    trends = {count: rise, OTHER_COUNTS[count]: -rise, "n_equal": -abs(rise)}
    if rise.all():  # equal stimuli have no right answer
        trends["n_correct"] = abs(rise)
    for name, counts in values.items():
        if len(set(counts)) > 3 and (is_percentage(name) or (counts <= n).all()):  # no codes
            for role in _counted_roles(name, counts, n, trends):
                stimuli = zip(options.stimuli, pair, strict=False)
                meaning = f"if {name} counts '{role.removeprefix('n_')}'"
                yield Remedy("columns", (*stimuli, (role, name), ("n_trials", trials)), meaning)


def _counted_roles(
    name: str, counts: FloatArray, n: FloatArray, trends: Mapping[str, FloatArray]
) -> list[str]:
    """The roles that a column of counts, or of shares, of n trials may have, by name or trend."""
    if looks_like(name, "n_correct"):  # whatever the trend, as with a constant error
        return ["n_correct"]
    # Shares are divided by the trials too, which are about the same in all rows. Without trials,
    # and of what is constant, r is NaN.
    with np.errstate(all="ignore"):
        correlations = np.corrcoef([counts / n, *trends.values()])[0, 1:]
    # The trend is clear. No other trend is closer, upwards or downwards, as that of 'different' is.
    return [
        role
        for role, r in zip(trends, correlations, strict=True)
        if r > 0.3 and r == np.nanmax(abs(correlations))
    ]


def _wide_remedies(names: Texts, columns: Iterable[Column]) -> Iterator[Remedy]:
    """Options to type if names of columns, or all cells of a column, are pairs such as 100_112."""
    pattern, n_names = _pair_pattern(names)
    if n_names > 2:  # two names are rather two stimuli
        yield Remedy("wide", pattern, f"if the names of {n_names} columns are pairs of stimuli")
    for column in columns:
        pattern, n_texts = _pair_pattern(column.texts)
        if n_texts == len(column.texts) > 1:  # all cells have one shape
            yield Remedy("wide", pattern, f"if the cells of {column} are pairs of stimuli")


def _pair_pattern(texts: Texts) -> tuple[str, int]:
    """The pattern for --wide if the commonest shape of texts has two numbers, and its frequency.

    Examples
    --------
    >>> _pair_pattern(["rt", "440 Hz vs 460 Hz", "460 Hz vs 440 Hz"]), _pair_pattern(["1.5"])
    (('{first} Hz vs {second} Hz', 2), ('', 0))
    >>> _pair_pattern(["Q5_100_112", "Q5_112_100"]), _pair_pattern(["2026-11-30"])
    (('Q*_{first}_{second}', 2), ('', 0))
    >>> _pair_pattern(["p350_500_r1", "p350_500_r2"]), _pair_pattern(["1_Q7", "2_Q7", "3_Q7"])
    (('p{first}_{second}_r*', 2), ('', 0))
    >>> _pair_pattern(["F1=190", "F1=130"]), _pair_pattern(["[400,440]", "[440,400]"])
    (('', 0), ('[{first},{second}]', 2))
    >>> _pair_pattern([f"W{pair}_{i}" for pair in ("50_60", "60_50") for i in range(9)])
    ('W{first}_{second}_*', 18)
    >>> _pair_pattern(["X200.240.1", "X240.200.1"]), _pair_pattern(["01.02.2026", "02.01.2026"])
    (('X{first}.{second}.*', 2), ('', 0))
    """
    # The shape of '440 Hz vs 460 Hz' is '{} Hz vs {} Hz'.
    shape_of_text = {text: re.sub(_NUMBER_OF_PAIR, "{}", text) for text in texts}
    [(shape, n_texts)] = Counter(shape_of_text.values()).most_common(1) or [("", 0)]  # of no texts
    # The number of a repetition may stand behind a pair, as in 'p{}_{}_r{}'.
    shape = re.sub("(?i)({}[^{}]+{}[^{}]*[-_. ](?:r|rep|t|trial|run)[-_. ]?){}$", r"\1*", shape)
    # It also does if it begins at 0 or 1, as no year does, and the two numbers in front of it have
    # more values in common, as in 'W{}_{}_{}'.
    numbers = [re.findall(_NUMBER_OF_PAIR, text) for text in texts if shape_of_text[text] == shape]
    values = list(map(set, zip(*numbers, strict=True)))
    has_repetitions = len(values) == 3 and values[2] & {"0", "1"}
    if has_repetitions and len(values[0] & values[1]) > len(values[1] & values[2]):
        shape = re.sub("{}([^{}]*)$", r"*\1", shape)
    if not re.fullmatch(_PAIR_SHAPE, shape):
        return "", 0
    # The last two numbers are the stimuli; any numbers may take the place of earlier ones.
    pattern = re.sub("{}([^{}]+){}([^{}]*)$", r"{first}\1{second}\2", shape)
    return pattern.replace("{}", "*"), n_texts


def score_remedies(names: Iterable[str]) -> list[Remedy]:
    """Options to type if these columns say right or wrong."""
    return [
        Remedy("correct", name, f"if {display_name(name)} says right or wrong (2AFC)")
        for name in names
    ]


def _columns_remedies(
    roles: Texts, stimuli: Mapping[str, Texts], columns: Sequence[Column]
) -> list[Remedy]:
    """The options that name the columns of roles: those of stimuli, and likely ones of `columns`.

    `stimuli` has the names for the roles of both stimuli. A role that no column seems to have, and
    that another option can stand for, is asked about after other roles.

    Examples
    --------
    >>> stimuli = {"s1": ["stim1"], "s2": ["stim2"]}
    >>> _columns_remedies(["subject", "s1", "s2"], stimuli, [])[0].typed
    '--columns s1=stim1,s2=stim2'
    >>> [remedy.typed for remedy in _columns_remedies(["subject"], stimuli, [])]
    ["--subject-from '{}.*'", '--columns subject=NAME']
    """
    if not roles:
        return []
    replacements = {
        "subject": [Remedy("subject_from", "{}.*", "if the name of the file is the subject")],
        "response": score_remedies(names_like([column.name for column in columns], "correct")),
    }
    names_by_role = {role: stimuli.get(role) or _likely_names(columns, role) for role in roles}
    # Roles that no column seems to have. If other options can stand for all of them, and other
    # roles have columns, they are not asked about now.
    blank_roles = [role for role, names in names_by_role.items() if names == ["NAME"]]
    are_replaceable = all(map(replacements.get, blank_roles))
    if are_replaceable and blank_roles != roles:
        for role in blank_roles:
            del names_by_role[role]

    name_remedies = []
    for names in product(*names_by_role.values()):
        meaning = (
            "with the names in your file; if it has no such column, add one: each row needs one "
            "subject, both stimuli, and a response, or n_second (a count or a share) and n_trials"
            if "NAME" in names
            else ""
        )
        name_remedies.append(
            Remedy("columns", tuple(zip(names_by_role, names, strict=True)), meaning)
        )
    other_remedies = []
    for role in names_by_role:
        other_remedies += replacements.get(role, [])
    if are_replaceable and blank_roles == roles:  # no column is known
        return other_remedies + name_remedies
    return name_remedies + other_remedies


def _likely_names(columns: Collection[Column], role: str) -> list[str]:
    """Three columns that may have a role, by their names or cells; NAME without such a column.

    Examples
    --------
    >>> codes = Column.from_texts("second_was", ["a", "b", "a", "a", "b", "a"])
    >>> blocks = Column.from_texts("Rat", ["x", "x", "x", "y", "y", "y"])
    >>> _likely_names([codes, blocks], "response"), _likely_names([codes, blocks], "subject")
    (['second_was'], ['Rat'])
    """
    names = [column.name for column in columns]
    likely_names = names_like(names, role) + names_like(names, _PROPOSED.get(role, role))
    # Beside a column that is named as the subjects, thresholds of subjects are no names of theirs.
    if role != "subject" or not likely_names:
        likely_names += _names_by_cells(columns, role)
    column_by_name = {column.name: column for column in columns}
    likely_names = list(dict.fromkeys(likely_names))
    likely_names.sort(key=lambda name: _is_unlikely(column_by_name[name], role))
    names_with_words = [name for name in likely_names if _has_answers(column_by_name[name])]
    if role == "response" and len(names_with_words) == 1:
        return names_with_words
    # Columns that are alike may each have another subject, so that no single one is proposed.
    for column, other_column in combinations(columns, 2):
        if likely_names[:1] == [column.name] and are_alike(column, other_column):
            return ["NAME"]
    return likely_names[:3] or ["NAME"]


def _has_answers(column: Column) -> bool:
    """Whether the cells of a column are words such as 'first', 'second interval' and 'equal'."""
    texts = filled_texts(column)
    for text in texts:
        is_answer = plain_name(text) in _ANSWERS or len(named_places(text).places) == 1
        if not is_answer or re.search("[0-9]", text):  # 'list1' and 'list2' are no answers
            return False
    return len(texts) > 1


def _is_unlikely(column: Column, role: str) -> bool:
    """Whether a column hardly has a role, whatever its name, by its cells."""
    if role == "response":  # with one code in all rows, as that of a key that starts a trial
        return len(filled_texts(column)) < 2
    if role in ("standard", "comparison"):  # a word is its side or its order
        return bool(np.isnan(column.map(number, float)).all())
    return role == "subject" and len(column.texts) == len(column.codes)  # it numbers the rows


def _names_by_cells(columns: Iterable[Column], role: str) -> list[str]:
    """The names of columns that may have a role by their cells, the likeliest first."""
    columns_with_role = [column for column in columns if role_by_cells(column) == role]
    columns_with_role.sort(
        key=lambda column: (
            # A name such as 'responded_longer' says more than the cells, as does 'second_longer'.
            not has_word(column.name, "of_responses"),
            not has_word(column.name, "of_answers"),
            # A column with another text in each row numbers the rows.
            len(column.texts) == len(column.codes),
            # A flag is no subject.
            role == "subject" and is_flag(column.texts),
        )
    )
    return [column.name for column in columns_with_role]


def are_alike(column: Column, other: Column) -> bool:
    """Whether two columns have the same codes, and names that differ by numbers or initials.

    In most rows, neither of them is empty.

    Examples
    --------
    >>> texts = {"resp_1": "1212", "resp_2": "2121", "w1": "1212", "resp_KM": "2112"}
    >>> first, *others = [Column.from_texts(name, cells) for name, cells in texts.items()]
    >>> [column.name for column in others if are_alike(first, column)]
    ['resp_2', 'resp_KM']
    """
    return bool(
        _NUMBERED.sub("", column.name) == _NUMBERED.sub("", other.name)
        and all(map(is_no_response, set(column.texts) ^ set(other.texts)))
        and (empty(column) | empty(other)).mean() < 0.5
    )


def role_by_cells(column: Column) -> str:
    """The role that a column may have by its cells, 'subject' or 'response'; empty without a role.

    The name of a subject stands in a block of rows. Responses are two or three codes, and perhaps
    empty cells, that change from trial to trial.

    Examples
    --------
    >>> names = ("Rec_Session_Id", "file", "Session")
    >>> [role_by_cells(Column.from_texts(name, "aaabbb")) for name in names]
    ['subject', 'subject', '']
    """
    # The id of a session or the name of a file may stand for the subject, as an id does.
    pattern = "(?i)^((rec_?)?session_?id|(data|source|log)?_?(file(_?name)?|datei(name)?))$"
    words = named_places(re.sub(pattern, "id", column.name)).other_words
    n_texts = len(column.texts)
    n_rows = len(column.codes)
    n_runs = len(run_starts(column.codes))
    # The name says so, or each text stands in one block, of more than two rows on average.
    is_named = has_word(column.name, "of_subjects") and not has_word(column.name, "of_answers")
    is_subject = is_named or n_texts == n_runs < 0.5 * n_rows
    if has_word(column.name, "of_responses"):  # 'chosen_interval' is a response
        words = words.difference(VOCABULARY["words"]["of_interval"])
    # Three codes and an empty cell are four texts. A code stands in less than five rows on average
    # before another code follows.
    is_response = n_texts < 5 and n_runs > 0.2 * n_rows
    # A name without words of its own, such as 'target' or 'comparison', is that of a stimulus, but
    # a number is what a column without a name has.
    if (
        not (is_subject or is_response)
        or n_texts < 2
        or not (words or column.name.isdigit())
        or not words.isdisjoint(VOCABULARY["words"]["of_others"])
        or is_percentage(column.name)
        or _pair_pattern(column.texts)[1] > 0.5 * n_texts  # '17/20' counts, or is a pair
    ):
        return ""
    return "subject" if is_subject else "response"


def solutions(columns: Collection[Column], options: ReadOptions, pair: Texts = ()) -> list[str]:
    """The names of columns that seem to have correct answers, and not answers of participants.

    Correct answers follow, in all of many rows, from which stimulus is the larger, and from the
    order of a standard and a comparison. `pair` has the names of the stimuli if the options lack
    them.

    Examples
    --------
    >>> texts = {"s1": "1203" * 9, "s2": "2103" * 9, "answer": "jfff" * 9, "key": "jffj" * 9}
    >>> columns = [Column.from_texts(name, cells) for name, cells in texts.items()]
    >>> solutions(columns, ReadOptions())
    ['answer']
    """
    stimuli = (*pair, *options.stimulus_names)
    values = [column.map(number, float) for column in columns if column.name in stimuli]
    # In few rows, answers may follow by chance.
    if len(values) != 2 or len(values[0]) < _MANY:
        return []
    difference = np.subtract(*values)
    rows = ~np.isnan(difference)
    # A side is the larger stimulus; of a standard and a comparison, also their order.
    sides = [np.sign(difference[rows])]
    sides += [column.codes[rows] for column in columns if column.name == options.interval_column]
    n_sides = len(combination_counts(*sides))
    if n_sides < 2:  # or no cell holds a number
        return []
    # Three answers and an empty cell at most. If each side has one text, the texts make no more
    # combinations.
    return [
        column.name
        for column in columns
        if 1 < len(column.texts) < 5
        and len(combination_counts(*sides, column.codes[rows])) == n_sides
    ]
