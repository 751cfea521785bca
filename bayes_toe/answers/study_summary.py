"""The sentences about a whole study.

`study_lines` counts how many subjects have which answer. `effect_frequency` estimates how
frequent an effect is in the population. `describe_pair` describes a pair that the model does not
fit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from operator import itemgetter

import numpy as np
from scipy.special import logsumexp, softmax

from bayes_toe.answers.order_effect import QUESTIONS, OrderEffect
from bayes_toe.answers.words import Word
from bayes_toe.checks.alarm_rate import FALSE_ALARM_SHARE
from bayes_toe.data.messages import capitalized, join_names, plural
from bayes_toe.data.stimulus_unit import UNKNOWN_UNIT, StimulusUnit
from bayes_toe.data.validation import CONDITION_SEPARATOR
from bayes_toe.inference.goodness_of_fit import PairResidual
from bayes_toe.model.parameters import CONSTANT_ERROR, CONTRACTION, ORDER_MODELS

#: Interpretable subjects from which on `run` fits the population.
FEWEST_FOR_GROUP = 6
_MOST_NAMES = 5  # of subjects in a line
#: How often a test of every subject flags one by chance.
FALSE_ALARMS = (
    f"A sound study of this size has such a subject in {100 * FALSE_ALARM_SHARE:.0f} % of cases."
)
_SHARES = np.linspace(0.0, 1.0, 401)  # frequencies over which random effects are summed
#: One sentence on the table of Appendix C.
APPENDIX_C = (
    "This compares a smooth function with one free probability per pair. It does not test for an "
    "order effect"
)


def study_lines(
    answers: Sequence[OrderEffect], *, synthetic: bool = False, units: bool = False
) -> list[str]:
    """The answer of a study: for each question how many subjects have which word.

    Subjects that are not interpreted do not count.

    Parameters
    ----------
    answers : sequence of OrderEffect
    synthetic : bool
        Whether the subjects are simulated.
    units : bool
        Whether each is a subject in one condition.
    """
    if len(answers) == 1:
        return [f"{answers[0].subject}: {answers[0].describe()}", *misfit_lines(answers)]
    counted_answers = [answer for answer in answers if answer.is_interpretable]
    if not counted_answers:
        return ["No subject can be interpreted."]
    noun = "synthetic subject" if synthetic else "subject"
    of_total = f" of {count_all(counted_answers, noun, units)}"
    lines = []
    for question in QUESTIONS:
        text = _count_answers(counted_answers, question, of_total)
        lines.append(f"{capitalized(question.replace('_', ' '))}: {text}.")
        of_total = ""
    return lines + misfit_lines(counted_answers)


def misfit_lines(answers: Sequence[OrderEffect]) -> list[str]:
    """The subjects whom the model does not fit, and the effects that are fewer without them."""
    misfits, good_fits = list[OrderEffect](), list[OrderEffect]()
    for answer in answers:
        if answer.fits is False:
            misfits.append(answer)
        else:
            good_fits.append(answer)
    if not misfits:
        return []
    subjects = plural(len(misfits), "subject")
    names = join_names([answer.subject for answer in misfits], _MOST_NAMES)
    lines = [f"The model does not fit {subjects}: {names}. {FALSE_ALARMS}"]
    counts = []
    for question in QUESTIONS:
        if good_fits and _count_positive(misfits, question):
            n_positive = _count_positive(good_fits, question)
            counts.append(f"{question.replace('_', ' ')} {n_positive} of {len(good_fits)}")
    if counts:
        lines.append(f"Without {names}, yes or probably: {', '.join(counts)}.")
    return lines


def _count_positive(answers: Sequence[OrderEffect], question: str) -> int:
    """How many subjects have an effect, for sure or probably."""
    return sum(answer.words[question].is_positive for answer in answers)


def count_words(
    words: Iterable[str], of_total: str = "", directions: Mapping[str, str] | None = None
) -> str:
    """How often each word is given, in the order of certainty.

    Parameters
    ----------
    words : iterable of str
    of_total : str
        Follows the first count, as in ' of 7 subjects'.
    directions : mapping of str to str, optional
        What follows a word in brackets.

    Examples
    --------
    >>> count_words(["no", "yes", "yes"], " of 3 subjects", {"yes": "1 contraction, 1 repulsion"})
    '2 of 3 subjects yes (1 contraction, 1 repulsion), 1 no'
    """
    counts = Counter(words)
    in_order = dict.fromkeys([*map(str, Word), *counts])
    parts = list[str]()
    for word in in_order:
        if not counts[word]:
            continue
        text = f"{counts[word]}{of_total} {word}"
        direction = (directions or {}).get(word, "")
        if direction:
            text += f" ({direction})"
        parts.append(text)
        of_total = ""
    return ", ".join(parts)


def _count_answers(answers: Sequence[OrderEffect], question: str, of_total: str) -> str:
    """How many subjects have each word, as in '4 of 7 subjects yes, 1 probably'."""
    words = [str(answer.words[question]) for answer in answers]
    if set(words) == {Word.CANNOT_BE_TOLD}:
        return f"{Word.CANNOT_BE_TOLD} in any subject"
    directions = {str(word): describe_directions(answers, question, word) for word in Word}
    return count_words(words, of_total, directions)


def count_all(answers: Sequence[OrderEffect], noun: str, units: bool) -> str:
    """All that count, as in '12 subjects' or '24 conditions of 12 subjects'."""
    if not units:
        return plural(len(answers), noun)
    n_subjects = len({answer.subject.rpartition(CONDITION_SEPARATOR)[0] for answer in answers})
    return f"{plural(len(answers), 'condition')} of {plural(n_subjects, noun)}"


def describe_directions(answers: Sequence[OrderEffect], question: str, word: Word) -> str:
    """The directions of the effects of a word, with their numbers; empty if they need no saying."""
    chosen = [answer for answer in answers if answer.words[question] is word]
    if not word.is_positive or question == "order_effect":
        return ""
    if question == "contraction":
        return _contraction_directions(chosen)
    return _error_directions(chosen)


def _contraction_directions(chosen: Sequence[OrderEffect]) -> str:
    counts = Counter(sorted(answer.direction for answer in chosen))
    if not counts["repulsion"]:
        return ""
    return ", ".join(f"{count} {direction}" for direction, count in counts.items())


def _error_directions(chosen: Sequence[OrderEffect]) -> str:
    parts = []
    stimulus = "the first stimulus"
    for is_over, verb in ((True, "overestimate"), (False, "underestimate")):
        count = sum(answer.first_is_overestimated is is_over for answer in chosen)
        if count:
            parts.append(f"{count} {verb}{'s' if count == 1 else ''} {stimulus}")
            stimulus = "it"
    return ", ".join(parts)


# --- Few subjects: how frequent an effect is ------------------------------------------------------


def effect_frequency(answers: Sequence[OrderEffect], question: str) -> float:
    """The expected frequency in the population of a constant error, or of a contraction.

    A subject has the effect with an unknown frequency, uniform beforehand, which is summed over.
    Source: Penny et al. 2010 (PLoS Comput. Biol. 6:e1000709), with two families.
    """
    evidences_of = itemgetter(*ORDER_MODELS)
    log_evidence = np.array([evidences_of(answer.log_evidence) for answer in answers])
    with np.errstate(divide="ignore"):
        log_share, log_other_share = np.log(_SHARES), np.log1p(-_SHARES)
    # Half of the four models have the effect.
    has_effect = QUESTIONS[question]
    log_with = logsumexp(log_evidence[:, has_effect], axis=1, keepdims=True)
    log_without = logsumexp(log_evidence[:, ~has_effect], axis=1, keepdims=True)
    log_likelihoods = np.logaddexp(log_share + log_with, log_other_share + log_without)
    return float(_SHARES @ softmax(log_likelihoods.sum(axis=0)))


def few_subjects_lines(answers: Sequence[OrderEffect]) -> list[str]:
    """The sentence about too few subjects for a group, with the effects that the design can show.

    A list of at most that sentence.
    """
    interpretable = [answer for answer in answers if answer.is_interpretable]
    if not 2 <= len(interpretable) < FEWEST_FOR_GROUP:
        return []
    shares = []
    for question in (CONSTANT_ERROR.name, CONTRACTION.name):
        told = [answer for answer in interpretable if answer.words[question] != Word.CANNOT_BE_TOLD]
        if told:
            share = 100.0 * effect_frequency(told, question)
            subjects = plural(len(told), "subject")
            shares.append(f"{question.replace('_', ' ')} {share:.0f} % ({subjects})")
    if not shares:
        return []
    return [
        f"Expected share of subjects with an effect: {', '.join(shares)}. These shares do not say "
        "how large the effects are."
    ]


# --- Poor fits -----------------------------------------------------------------------------------


def describe_pair(pair: PairResidual, unit: StimulusUnit = UNKNOWN_UNIT) -> str:
    """A pair with the observed and the expected share of the response that the task counts.

    Examples
    --------
    >>> describe_pair(PairResidual(3.688879, 3.296837, 0.95, 0.7))
    "(3.69, 3.3): 'equal' in 95 %, expected 70 %"
    """
    observed, expected = 100.0 * pair.observed, 100.0 * pair.expected
    response = f"{pair.answer!r} in {observed:.0f} %, expected {expected:.0f} %"
    return f"({unit.describe(pair.s1)}, {unit.describe(pair.s2)}): {response}"
