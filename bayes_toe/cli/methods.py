"""methods.md: the paragraph that a journal prints, a table, and the citations."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Sequence
from importlib.resources import files
from math import exp
from pathlib import Path
from textwrap import fill

from bayes_toe.analysis import Analysis
from bayes_toe.answers.order_effect import (
    QUESTIONS,
    SIZE_OF,
    OrderEffect,
    Size,
    format_bayes_factor,
    format_decimals,
    format_percent,
    format_share,
)
from bayes_toe.answers.study_summary import (
    FEWEST_FOR_GROUP,
    count_all,
    count_words,
    describe_directions,
    frequency_line,
)
from bayes_toe.answers.words import (
    NO_UP_TO,
    PROBABLY_FROM,
    PROBABLY_NOT_LOG_BAYES_FACTOR,
    PROBABLY_NOT_UP_TO,
    YES_FROM,
    Word,
)
from bayes_toe.checks.identification import identify
from bayes_toe.cli.within_screens import contrast_lines
from bayes_toe.data.messages import capitalized, counted, listed, visible
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.groups.population import GroupEffect, PopulationResult

_MOST_NAMED = 10
_WIDTH = 95
#: What notes of reading a study say if something was done to the data.
_DONE = re.compile("dropped|excluded|merged|swapped|only rows|only pairs")
#: Letters that mean something in Markdown.
_ESCAPED = str.maketrans({letter: f"\\{letter}" for letter in "\\`*_[]<>|#~$"})
#: What participants report.
_QUESTION_OF_TASK = {
    WHICH_STRONGER: "which of two successive stimuli was stronger",
    SAME_DIFFERENT: "whether two successive stimuli were equal or different",
}
#: Parameters that are free in every model, by task.
_NUISANCE = {
    True: "noise, noise slope over intensity, and lapse rate",
    False: "noise, indecision zone, their slopes over intensity, and lapse rate",
}


def write_methods(analysis: Analysis, group: PopulationResult | None, path: Path) -> None:
    """Write the document in Markdown, and its citations as NAME.bib."""
    paragraph = " ".join([*_methods(analysis), *_results(analysis, group)])
    table = "\n".join(_table(analysis.answers))
    parts = ["# Methods and results", _wrap(paragraph), table, _wrap(_table_note(analysis))]
    text = "\n\n".join(parts) + "\n"
    path.write_text(text, encoding="utf-8")
    path.with_suffix(".bib").write_text(_citations(text, analysis), encoding="utf-8")


def _wrap(paragraph: str) -> str:
    return fill(paragraph, _WIDTH, break_long_words=False, break_on_hyphens=False)


def _citations(text: str, analysis: Analysis) -> str:
    """Entries of the references that the text cites."""
    bibliography = (files("bayes_toe") / "cli" / "references.bib").read_text(encoding="utf-8")
    cited = []
    for entry in bibliography.split("\n\n"):
        key = entry.partition("{")[2].partition(",")[0]
        if f"@{key}" in text:
            cited.append(entry.strip())
    version = json.loads(analysis.draws.attrs["versions"])["bayes_toe"]
    return "\n\n".join(cited).replace("VERSION", version) + "\n"


# --- What was done ------------------------------------------------------------------------------


def _methods(analysis: Analysis) -> list[str]:
    """Sentences about data, models and computation."""
    draws = analysis.draws
    is_2afc = analysis.study.task == WHICH_STRONGER
    version = json.loads(draws.attrs["versions"])["bayes_toe"]
    sentences = _data(analysis)
    sentences.append(
        "For each participant we estimated whether the point of subjective equality (PSE) "
        "depended on presentation order through a constant error, a contraction bias, or both. "
        "A constant error shifts the PSE by the same amount at every intensity; the shift is "
        "positive if the first stimulus is overestimated. Contraction moves the remembered first "
        "stimulus by a share p toward the mean first stimulus. We compared four models: no order "
        "effect (prior probability 1/2), constant error, contraction, and both (1/6 each), all "
        f"with free {_NUISANCE[is_2afc]}."
    )
    sentences.append(
        "Marginal likelihoods were computed by adaptive importance sampling [@cornuet2012] in "
        f"bayes_toe {version} [@bayes_toe; @avetta2026], seed {draws.seed}."
    )
    sentences.append(
        "An effect was called present ('yes') if its posterior probability was at least "
        f"{format_decimals(YES_FROM)}, 'probably' from {format_decimals(PROBABLY_FROM)}, 'no' up to "
        f"{format_decimals(NO_UP_TO)}, and 'probably not' up to "
        f"{format_decimals(PROBABLY_NOT_UP_TO)} with a Bayes factor (BF) of at most "
        f"{format_decimals(exp(PROBABLY_NOT_LOG_BAYES_FACTOR))}; otherwise 'undecided'. "
        "Estimates are posterior medians [95 % intervals]."
    )
    if analysis.contrast is not None:
        sentences.append(
            "Conditions were compared within participants by joint fits in which constant error, "
            "contraction and JND may differ."
        )
    return sentences


def _data(analysis: Analysis) -> list[str]:
    """What participants did, how much there is, and what was done to it."""
    study = analysis.study
    trials = [subject.total_trials for subject in study.without_conditions()]
    each = f"{min(trials):,} to {max(trials):,} each"
    if len(set(trials)) == 1:
        each = f"{trials[0]:,} each"
    participants = counted(len(trials), "participant")
    total = f"{sum(trials):,} trials"
    amount = total if len(trials) == 1 else f"{total}, {each}"
    sentences = [f"{participants} reported {_QUESTION_OF_TASK[study.task]} ({amount})."]
    if study.synthetic:
        sentences.append("These data are synthetic.")
    changes = [note for note in study.notes if _DONE.search(note)]
    if changes:
        sentences.append(f"Before the analysis: {_text('; '.join(changes))}.")
    return sentences


# --- What came out ------------------------------------------------------------------------------


def _results(analysis: Analysis, group: PopulationResult | None) -> list[str]:
    """Sentences about the conclusions, the group, and their limits."""
    answers = [answer for answer in analysis.answers if answer.is_interpretable]
    is_by_unit = analysis.study.conditions is not None
    sentences = []
    whole = f" of {count_all(answers, 'participant', is_by_unit)}"
    if len(answers) == 1:
        sentences.append(answers[0].describe())
    for question in QUESTIONS if len(answers) > 1 else ():
        if any(answer.words[question] is not Word.CANNOT_BE_TOLD for answer in answers):
            sentences.append(_count_present(answers, question, whole))
            whole = ""
    if group is not None:
        sentences += _group(group)
    elif len(answers) < FEWEST_FOR_GROUP and not is_by_unit:
        frequencies = frequency_line(answers)
        if frequencies:
            sentences.append(f"{frequencies[:-1]} [@penny2010].")
    if analysis.contrast is not None:
        _, *differences = contrast_lines(analysis.contrast)
        sentences += [_text(line) for line in differences]
    sentences += _limits(analysis)
    return sentences


def _count_present(answers: Sequence[OrderEffect], question: str, whole: str) -> str:
    """In how many participants an effect is present, with directions, and the other words."""
    words = [str(answer.words[question].value) for answer in answers]
    name = question.replace("_", " ")
    article = "An" if name.startswith("order") else "A"
    text = f"{article} {name} was present in {words.count(Word.YES.value)}{whole}"
    directions = describe_directions(answers, question, Word.YES)
    if directions:
        text += f" ({directions})"
    others = [word for word in words if word != Word.YES.value]
    if others:
        text += f"; the others: {count_words(others)}"
    return f"{text}."


def _group(group: PopulationResult) -> list[str]:
    """Means of the group with intervals and Bayes factors."""
    means = []
    error, contraction = group.effect("constant_error"), group.effect("contraction")
    if "constant_error" in group.identified and error.percent is not None:
        low, median, high = error.percent
        means.append(f"PSE shift of {format_percent(Size(low, median, high))} {_factor(error)}")
    if "contraction" in group.identified:
        low, median, high = contraction.mean
        share = format_share(Size(low, median, high))
        means.append(f"contraction of {share} {_factor(contraction)}")
    sentences = []
    if means:
        both = " and a mean ".join(means)
        sentences.append(f"In a hierarchical model with both effects, the group had a mean {both}.")
    if not group.is_reliable:
        sentences.append(f"The draws of the group are NOT RELIABLE: {group.draws.shortfall}.")
    return sentences


def _factor(effect: GroupEffect) -> str:
    """The Bayes factor of a mean that is not 0, in brackets."""
    return f"(Bayes factor against 0: {format_bayes_factor(-effect.zero_mean.log_bf)})"


def _limits(analysis: Analysis) -> list[str]:
    """What the design cannot identify, and which conclusions must not be used as they stand."""
    sentences = _limits_of_design(analysis)
    answers, not_interpreted = [], []
    poor, untestable, dependent = [], [], []
    for answer in analysis.answers:
        if not answer.is_interpretable:
            not_interpreted.append(answer.subject)
            continue
        answers.append(answer)
        if answer.fits is None:
            untestable.append(answer.subject)
        elif not answer.fits:
            poor.append(answer.subject)
        if answer.depends_on_previous_trial:
            dependent.append(answer.subject)
    for sentence, names in (
        ("The model does not fit {}.", poor),
        ("The fit is not testable for {}.", untestable),
        ("Not interpreted: {}.", not_interpreted),
        ("Responses depend on the previous trial for {}.", dependent),
        ("There are no results for {}.", list(analysis.draws.failed)),
    ):
        if len(names) == len(answers) > 1:
            sentences.append(sentence.format("any participant"))
        elif names:
            sentences.append(sentence.format(_text(listed(names, _MOST_NAMED))))
    n_on_prior = sum(answer.depends_on_prior for answer in answers)
    if n_on_prior and len(answers) > 1:
        share = f"{n_on_prior} of {len(answers)}"
        sentences.append(
            f"For {share}, a prior half or twice as wide moves a probability past .25 or .75."
        )
    return sentences


def _limits_of_design(analysis: Analysis) -> list[str]:
    """What the pairs and the order of trials cannot identify, and for how many participants."""
    subjects = analysis.study.subjects
    limits = Counter[str]()
    for subject in subjects:
        identification = identify(subject)
        reasons = dict[str, list[str]]()
        for question, reason in identification.reasons.items():
            reasons.setdefault(reason, []).append(question.replace("_", " "))
        for reason, questions in reasons.items():
            limits[f"the design cannot identify {' or '.join(questions)}, because {reason}"] += 1
        limits.update(identification.notes)
    sentences = []
    for limit, count in limits.items():
        whose = "" if count == len(subjects) else f" ({count} of {len(subjects)})"
        sentences.append(f"{capitalized(limit)}{whose}.")
    return sentences


def _table(answers: Sequence[OrderEffect]) -> list[str]:
    """The conclusions and sizes of every participant, in Markdown."""
    heads = ["participant", "order effect", "constant error", "contraction"]
    heads += ["PSE shift [95 %]", "contraction p [95 %]"]
    lines = [f"| {' | '.join(heads)} |", f"|{'---|' * len(heads)}"]
    for answer in answers:
        cells = [_text(answer.subject)]
        if answer.is_interpretable:
            cells += [answer.marked_word(question) for question in QUESTIONS]
            cells.append(_estimate(answer, "constant_error", format_percent))
            cells.append(_estimate(answer, "contraction", format_share))
        else:
            cells += ["not interpreted", *[""] * (len(heads) - 2)]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _table_note(analysis: Analysis) -> str:
    """What the table's signs and marks mean, and the priors."""
    draws = analysis.draws
    sentences = [
        "Note. Estimates are averaged over the models that have the effect. p above 0 is "
        "contraction, below 0 repulsion."
    ]
    if any(answer.fits is False for answer in analysis.answers):
        sentences.append("!: the model does not fit.")
    if any(answer.depends_on_prior for answer in analysis.answers):
        sentences.append("?: a prior half or twice as wide moves a probability past .25 or .75.")
    sentences.append(f"Priors: `{draws.prior.observer.describe(analysis.study.task)}`.")
    return " ".join(sentences)


def _estimate(answer: OrderEffect, question: str, form: Callable[[Size], str]) -> str:
    """The size of an effect; empty if the design cannot show it."""
    if answer.words[question] is Word.CANNOT_BE_TOLD:
        return ""
    return form(answer.sizes[SIZE_OF[question]])


def _text(text: str) -> str:
    """A text from outside, so that it is no markup."""
    return visible(text).translate(_ESCAPED)
