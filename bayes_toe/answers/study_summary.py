"""The sentences about a whole study.

`study_lines` says what the answers mean, and counts how many subjects have which word.
`describe_pair` describes a pair that the model does not fit.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence

from bayes_toe.answers.order_effect import QUESTIONS, OrderEffect
from bayes_toe.answers.words import Word, claim
from bayes_toe.checks.alarm_rate import FALSE_ALARM_SHARE
from bayes_toe.data.messages import capitalized, join_names, plural
from bayes_toe.data.stimulus_unit import UNKNOWN_UNIT, StimulusUnit
from bayes_toe.data.validation import CONDITION_SEPARATOR
from bayes_toe.inference.goodness_of_fit import PairResidual
from bayes_toe.model.parameters import CONSTANT_ERROR, CONTRACTION

#: Fewest interpretable subjects with which `run` fits the population.
FEWEST_FOR_GROUP = 6
#: One sentence on the table of Appendix C.
APPENDIX_C = "The comparison of H1 with H0 does not test for an order effect"


def study_lines(
    answers: Sequence[OrderEffect],
    *,
    synthetic: bool = False,
    by_condition: bool = False,
) -> list[str]:
    """The answer of a study: its meaning, then for each question how many subjects have each word.

    Subjects that are not interpreted do not count.

    Parameters
    ----------
    answers : sequence of OrderEffect
    synthetic : bool
        Whether the subjects are simulated.
    by_condition : bool
        Whether each answer is that of a subject in one condition.
    """
    meaning = describe_meaning(answers, "condition" if by_condition else "subject")
    interpretable = [answer for answer in answers if answer.is_interpretable]
    if len(answers) == 1:  # the words of the subject take the place of counts
        texts = [answers[0].describe()]
        if interpretable:  # else `describe` already says why the subject is not interpreted
            texts = [meaning, *texts]
        return [f"{answers[0].subject}: {text}" for text in texts] + misfit_lines(answers)
    if not interpretable:
        return [meaning]

    # For each question, how many subjects have each word.
    lines = [meaning]
    noun = "synthetic subject" if synthetic else "subject"
    of_total = f" of {count_all(interpretable, noun, by_condition)}"
    for question in QUESTIONS:
        words = [answer.word(question) for answer in interpretable]
        if set(words) == {Word.CANNOT_BE_TOLD}:  # clearer than a count of all subjects
            text = f"{Word.CANNOT_BE_TOLD} in any subject"
        else:
            text = count_words(words, of_total)
        lines.append(f"{capitalized(question.replace('_', ' '))}: {text}.")
        of_total = ""  # only the first line has the total
    return lines + misfit_lines(interpretable)


# --- What the answer means ------------------------------------------------------------------------

#: How the first stimulus seems by an effect: if its sign is positive, and if it is negative.
_DIRECTIONS = {
    CONSTANT_ERROR.name: ("overestimated", "underestimated"),
    CONTRACTION.name: (
        "remembered as nearer to the mean",
        "remembered as farther from the mean",
    ),
}


def describe_meaning(answers: Sequence[OrderEffect], noun: str = "subject") -> str:
    """What the answers say of perception, in a few sentences.

    Subjects that are not interpreted do not count.

    Parameters
    ----------
    answers : sequence of OrderEffect
    noun : str
        What each answer is about.
    """
    interpretable = [answer for answer in answers if answer.is_interpretable]
    if not interpretable:
        return f"No {noun} can be interpreted."
    if len(interpretable) == 1:
        # Beside other answers, the subject is named.
        name = f"{interpretable[0].subject}: " if len(answers) > 1 else ""
        return name + _describe_subject(interpretable[0])

    sentences = _order_sentences(interpretable, noun)
    for effect in _DIRECTIONS:
        sentences += _direction_sentences(interpretable, effect, noun)
    return " ".join(sentences)


def _describe_subject(answer: OrderEffect) -> str:
    """The meaning of one answer: whether the order matters, and how the first stimulus seems.

    As in 'The order changes the response: the first stimulus is overestimated.'
    """
    word = answer.words["order_effect"]
    text = capitalized(claim(word, "the order", "change", "the response"))
    if not word.is_positive:
        return f"{text}."

    effects = []
    for effect in _DIRECTIONS:
        direction = _direction(answer, effect)
        if direction:
            probably = "probably " if answer.words[effect] is Word.PROBABLY else ""
            effects.append(probably + direction)
    if effects:
        return f"{text}: the first stimulus is {' and '.join(effects)}."
    return f"{text}. The data do not show by which effect."


def _order_sentences(answers: Sequence[OrderEffect], noun: str) -> list[str]:
    """Sentences on the subjects for whom the order matters, and for whom it does not matter.

    If some subjects have an effect, another word has a sentence only if more than half of all
    subjects have it.
    """
    counts = Counter(answer.words["order_effect"] for answer in answers)
    # 'No' and 'probably not' have one sentence, with the less sure word.
    if counts[Word.PROBABLY_NOT]:
        counts[Word.PROBABLY_NOT] += counts.pop(Word.NO, 0)
    n_total = len(answers)
    has_effects = counts[Word.YES] + counts[Word.PROBABLY] > 0

    clauses: list[str] = []
    for word in Word:  # 'yes' and then 'probably' come first
        count = counts[word]
        is_reported = word.is_positive or not has_effects or count > n_total / 2
        if count == 0 or not is_reported:
            continue
        if word is Word.PROBABLY and clauses:  # added to the clause of 'yes'
            clauses[0] += f", and probably in {count} more"
        else:
            text = claim(word, "the order", "change", "the response")
            clauses.append(f"{_in_subjects(count, n_total, noun)} {text}")
    return [f"{clause}." for clause in clauses]


def _in_subjects(count: int, n_total: int, noun: str) -> str:
    """The words for `count` of so many subjects at the head of a sentence.

    Examples
    --------
    >>> [_in_subjects(count, 12, "subject") for count in (12, 9, 4)]
    ['In all 12 subjects', 'In most subjects (9 of 12)', 'In 4 of 12 subjects']
    """
    if count == n_total:
        return f"In both {noun}s" if count == 2 else f"In all {count} {noun}s"
    if count > n_total / 2:
        return f"In most {noun}s ({count} of {n_total})"
    return f"In {count} of {n_total} {noun}s"


def _direction(answer: OrderEffect, effect: str) -> str:
    """How the first stimulus seems by an effect, as in 'overestimated'.

    It is empty without the effect, and if the interval of the PSE shift holds 0.
    """
    if not answer.words[effect].is_positive:
        return ""
    if effect == CONSTANT_ERROR.name:
        has_positive_sign = answer.first_is_overestimated
    else:
        has_positive_sign = answer.direction == "contraction"
    if has_positive_sign is None:  # the interval of the PSE shift holds 0
        return ""

    positive, negative = _DIRECTIONS[effect]
    return positive if has_positive_sign else negative


def _direction_sentences(answers: Sequence[OrderEffect], effect: str, noun: str) -> list[str]:
    """A list with the sentence on how many subjects have which direction of an effect.

    As in 'The first stimulus is overestimated in 3 subjects and underestimated in 2.' It counts the
    subjects with a 'yes', or with a 'probably' if there is no 'yes'.
    """
    words = [answer.words[effect] for answer in answers]
    word = Word.YES if Word.YES in words else Word.PROBABLY
    counts = Counter[str]()  # subjects with each direction, which is '' if it is not known
    for answer in answers:
        if answer.words[effect] is word:
            counts[_direction(answer, effect)] += 1

    texts: list[str] = []
    for direction in _DIRECTIONS[effect]:
        count = counts[direction]
        if count and not texts:
            texts.append(f"{direction} in {plural(count, noun)}")
        elif count:  # the verb is not repeated
            texts.append(f"{direction.removeprefix('remembered ')} in {count}")
    if not texts:
        return []
    probably = "probably " if word is Word.PROBABLY else ""
    return [f"The first stimulus is {probably}{' and '.join(texts)}."]


def misfit_lines(answers: Sequence[OrderEffect]) -> list[str]:
    """A list with the sentence that names the subjects whom the model does not fit.

    The list is empty if the model fits all subjects.
    """
    # The fit is None where it is not testable, which is not poor.
    names = [answer.subject for answer in answers if answer.fits is False]
    if not names:
        return []
    subjects = f"{plural(len(names), 'subject')}: {join_names(names, max_items=5)}"
    return [
        f"The model does not fit {subjects}. "
        f"By chance, {100 * FALSE_ALARM_SHARE:.0f} % of sound studies have a poor fit."
    ]


def count_words(words: Iterable[str], of_total: str = "") -> str:
    """How often each word is given, in the order of certainty, with its directions.

    Parameters
    ----------
    words : iterable of str
        Each is a :class:`Word`, perhaps with its direction in brackets.
    of_total : str
        Follows the first count, as in ' of 7 subjects'.

    Examples
    --------
    >>> words = ["no", "yes (repulsion)", "yes (contraction)", "yes (contraction)"]
    >>> count_words(words, " of 4 subjects")
    '3 of 4 subjects yes (2 contraction, 1 repulsion), 1 no'
    """
    directions_by_word = defaultdict(list)  # '' where a word has no direction
    for text in sorted(words):
        # 'yes (repulsion)' -> 'yes' and 'repulsion'
        word, _, direction = text.removesuffix(")").partition(" (")
        directions_by_word[word].append(direction)

    texts = []
    for word in Word:
        if word not in directions_by_word:
            continue
        directions = directions_by_word[word]
        text = f"{len(directions)}{of_total} {word}"
        counts = Counter(filter(None, directions))  # without ''
        if len(counts) == 1:  # all have this direction, so that no number is needed
            text += f" ({', '.join(counts)})"
        elif counts:
            text += f" ({', '.join(f'{count} {name}' for name, count in counts.items())})"
        texts.append(text)
        of_total = ""  # only the first count has the total
    return ", ".join(texts)


def count_all(answers: Sequence[OrderEffect], noun: str, by_condition: bool) -> str:
    """The number of all answers, as in '12 subjects' or '24 conditions of 12 subjects'."""
    if not by_condition:
        return plural(len(answers), noun)
    # The name of a unit is that of its subject and of its condition, as in 'S01@left'.
    n_subjects = len({answer.subject.rpartition(CONDITION_SEPARATOR)[0] for answer in answers})
    return f"{plural(len(answers), 'condition')} of {plural(n_subjects, noun)}"


# --- Poor fits -----------------------------------------------------------------------------------


def describe_pair(pair: PairResidual, unit: StimulusUnit = UNKNOWN_UNIT) -> str:
    """A pair with the observed and the expected share of the response that the task counts.

    Examples
    --------
    >>> describe_pair(PairResidual(3.688879, 3.296837, 0.95, 0.7))
    "For (s1, s2) = (3.69, 3.3), 95 % of the responses are 'equal', and the model expects 70 %."
    """
    observed = 100.0 * pair.observed
    expected = 100.0 * pair.expected
    response = f"{observed:.0f} % of the responses are {pair.answer!r}"
    stimuli = f"({unit.describe(pair.s1)}, {unit.describe(pair.s2)})"
    return f"For (s1, s2) = {stimuli}, {response}, and the model expects {expected:.0f} %."
