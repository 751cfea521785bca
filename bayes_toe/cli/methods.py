"""methods.md: the paragraph that a journal prints, a table, and the citations.

`write_methods` writes methods.md and methods.bib.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Sequence
from importlib.resources import files
from math import exp
from pathlib import Path
from textwrap import fill

from bayes_toe.analysis import Analysis
from bayes_toe.answers.order_effect import (
    QUESTIONS,
    SIZE_OF,
    OrderEffect,
    format_bayes_factor,
    format_decimals,
)
from bayes_toe.answers.study_summary import (
    count_all,
    count_words,
    describe_meaning,
    few_subjects_lines,
    misfit_lines,
)
from bayes_toe.answers.words import (
    NO_UP_TO,
    PROBABLY_FROM,
    PROBABLY_NOT_LOG_BAYES_FACTOR,
    PROBABLY_NOT_UP_TO,
    YES_FROM,
    Word,
)
from bayes_toe.checks.alarm_rate import FALSE_ALARM_SHARE
from bayes_toe.checks.identification import identify
from bayes_toe.cli.answer_screen import doubtful_subjects
from bayes_toe.cli.group_screen import (
    good_fits_answer,
    group_estimate,
    log_factor_of_mean,
    mean_words,
)
from bayes_toe.data.messages import capitalized, join_names, plural, visible
from bayes_toe.data.study import Study, units_by_subject
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.groups.population import PopulationResult

_WIDTH = 95
#: What notes of reading a study say if something was done to the data.
_CHANGE = re.compile("dropped|excluded|merged|swapped|only rows|only pairs")
#: Letters that mean something in Markdown.
_ESCAPED = str.maketrans({letter: f"\\{letter}" for letter in "\\`*_[]<>|#~$"})
#: Parameters that are free in every model, by task.
_NUISANCE = {
    True: "noise, noise slope over intensity, and lapse rate",
    False: "noise, indecision zone, their slopes over intensity, and lapse rate",
}


def write_methods(analysis: Analysis, path: Path) -> None:
    """Write the document in Markdown, and its citations as NAME.bib."""
    version = json.loads(analysis.draws.attrs["versions"])["bayes_toe"]
    paragraph = " ".join([*_methods(analysis, version), *_results(analysis)])
    table = "\n".join(_table(analysis.answers))
    parts = ["# Methods and results", _wrap(paragraph), table, _wrap(_table_note(analysis))]
    text = "\n\n".join(parts) + "\n"
    path.write_text(text, encoding="utf-8")
    path.with_suffix(".bib").write_text(_citations(text, version), encoding="utf-8")


def _wrap(paragraph: str) -> str:
    return fill(paragraph, _WIDTH, break_long_words=False, break_on_hyphens=False)


def _citations(text: str, version: str) -> str:
    """Entries of the references that the text cites."""
    bibliography = (files("bayes_toe") / "cli" / "references.bib").read_text(encoding="utf-8")
    cited = []
    for entry in bibliography.strip().split("\n\n"):
        key = entry.partition("{")[2].partition(",")[0]
        if f"@{key}" in text:
            cited.append(entry)
    return "\n\n".join(cited).replace("VERSION", version) + "\n"


# --- What was done ------------------------------------------------------------------------------


def _methods(analysis: Analysis, version: str) -> list[str]:
    """Sentences about data, models and computation."""
    is_2afc = analysis.study.task == WHICH_STRONGER
    sentences = [
        *_data(analysis.study),
        "For each participant we estimated whether the point of subjective equality (PSE) "
        "depended on presentation order through a constant error, a contraction bias, or both. "
        "A constant error shifts the PSE by the same amount at every intensity; the shift is "
        "positive if the first stimulus is overestimated. Contraction moves the remembered first "
        "stimulus toward the mean first stimulus, by a percentage of the way. We compared four "
        "models: no order effect (prior probability 1/2), constant error, contraction, and both "
        f"(1/6 each), all with free {_NUISANCE[is_2afc]}.",
        "Marginal likelihoods were computed by adaptive importance sampling [@cornuet2012] in "
        f"bayes_toe {version} [@bayes_toe; @avetta2026], seed {analysis.draws.seed}.",
        "An effect was called present ('yes') if its posterior probability was at least "
        f"{format_decimals(YES_FROM)}, 'probably' from {format_decimals(PROBABLY_FROM)}, 'no' up "
        f"to {format_decimals(NO_UP_TO)}, and 'probably not' up to "
        f"{format_decimals(PROBABLY_NOT_UP_TO)} with a Bayes factor (BF) of at most "
        f"{format_decimals(exp(PROBABLY_NOT_LOG_BAYES_FACTOR))}; otherwise '{Word.UNDECIDED}'. "
        "Estimates are posterior medians [95 % intervals]. The best model fits poorly if the "
        f"p-value of its deviance is below {format_decimals(FALSE_ALARM_SHARE)} divided by the "
        "number of participants.",
    ]
    if analysis.contrast is not None:
        sentences.append(
            "Conditions were compared within participants by joint fits in which constant error, "
            "contraction and JND may differ."
        )
    return sentences


def _data(study: Study) -> list[str]:
    """The task, the amount of data, and the changes that were made to them."""
    trials = []
    for units in units_by_subject(study).values():
        trials.append(sum(unit.total_trials for unit in units))
    amount = f"{sum(trials):,} trials"
    if len(trials) > 1:
        smallest, largest = min(trials), max(trials)
        number = f"{largest:,}" if smallest == largest else f"{smallest:,} to {largest:,}"
        amount += f", {number} each"
    participants = plural(len(trials), "participant")
    sentences = [f"{participants} reported {study.task.question} ({amount})."]
    if study.synthetic:
        sentences.append("These data are synthetic.")
    changes = [note for note in study.notes if _CHANGE.search(note)]
    if changes:
        sentences.append(f"Before the analysis: {_text('; '.join(changes))}.")
    return sentences


# --- What came out ------------------------------------------------------------------------------


def _results(analysis: Analysis) -> list[str]:
    """Sentences about the conclusions, the group, and their limits."""
    answers = [answer for answer in analysis.answers if answer.is_interpretable]
    is_by_unit = analysis.study.conditions is not None
    sentences = []
    if answers:
        noun = "condition" if is_by_unit else "participant"
        sentences.append(describe_meaning(answers, mean_words(analysis.group), noun))
    if len(answers) == 1:
        sentences.append(answers[0].describe())
    elif answers:
        sentences += _count_present(answers, f" of {count_all(answers, 'participant', is_by_unit)}")
        sentences += map(_text, misfit_lines(answers)[1:])
    if analysis.group is not None:
        sentences += _group(analysis.group)
        sentences += good_fits_answer(analysis.group, analysis.group_of_good_fits)
    elif not is_by_unit:
        for line in few_subjects_lines(answers):
            sentences.append(f"{line[:-1]} [@penny2010].")
    if analysis.contrast is not None:
        _, *differences = analysis.contrast.sentences()
        sentences += [*map(_text, differences)]
    return [*sentences, *_limits_of_design(analysis.study), *_limits(analysis)]


def _count_present(answers: Sequence[OrderEffect], of_total: str) -> list[str]:
    """The number of participants with each effect, and with the other words."""
    sentences = []
    for question in QUESTIONS:
        words = [str(answer.words[question]) for answer in answers]
        if set(words) == {Word.CANNOT_BE_TOLD}:
            continue
        other_words = [word for word in words if word != Word.YES]
        name = question.replace("_", " ")
        article = "An" if name.startswith("order") else "A"
        text = f"{article} {name} was present in {len(words) - len(other_words)}{of_total}"
        if other_words:
            text += f"; the others: {count_words(other_words)}"
        sentences.append(f"{text}.")
        of_total = ""
    return sentences


def _group(group: PopulationResult) -> list[str]:
    """Means of the group with intervals and Bayes factors."""
    means = []
    for name, label in (("constant_error", "PSE shift"), ("contraction", "contraction")):
        if name in group.identified:
            factor = format_bayes_factor(log_factor_of_mean(group, name))
            estimate = group_estimate(group, name)
            means.append(f"{label} of {estimate} (Bayes factor against 0: {factor})")
    sentences = []
    if means:
        effects = " and a mean ".join(means)
        sentences.append(
            f"In a hierarchical model with both effects, the group had a mean {effects}."
        )
    if not group.is_reliable:
        sentences.append(f"The draws of the group are NOT RELIABLE: {group.draws.shortfall}.")
    return sentences


def _limits(analysis: Analysis) -> list[str]:
    """The conclusions that must not be used as they are."""
    answers = [answer for answer in analysis.answers if answer.is_interpretable]
    names_of = doubtful_subjects(answers)
    of_interpreted = set(names_of)
    excluded = [answer.subject for answer in analysis.answers if not answer.is_interpretable]
    names_of["Not interpreted: {}."] = excluded
    names_of["There are no results for {}."] = list(analysis.draws.failed)
    sentences = []
    for sentence, names in names_of.items():
        if sentence in of_interpreted and len(names) == len(answers) > 1:
            sentences.append(sentence.format("any participant"))
        elif names:
            sentences.append(sentence.format(_text(join_names(names))))
    n_on_prior = sum(answer.depends_on_prior for answer in answers)
    if n_on_prior and len(answers) > 1:
        share = f"{n_on_prior} of {len(answers)}"
        sentences.append(
            f"For {share}, a prior half or twice as wide leaves a 'yes' or a 'no' undecided."
        )
    return sentences


def _limits_of_design(study: Study) -> list[str]:
    """The effects that pairs and order of trials cannot identify, with numbers of participants."""
    limits = Counter[str]()
    for subject in study:
        identification = identify(subject)
        for reason, names in identification.questions_by_reason.items():
            limits[f"the design cannot identify {' or '.join(names)}, because {reason}"] += 1
        limits.update(identification.notes)
    sentences = []
    for limit, count in limits.items():
        share = "" if count == len(study) else f" ({count} of {len(study)})"
        sentences.append(f"{capitalized(limit)}{share}.")
    return sentences


def _table(answers: Sequence[OrderEffect]) -> list[str]:
    """The conclusions and sizes of every participant, in Markdown."""
    heads = "participant | order effect | constant error | contraction | PSE shift [95 %]"
    lines = [f"| {heads} | contraction [95 %] |", f"|{'---|' * 6}"]
    for answer in answers:
        cells = ["not interpreted", "", "", "", ""]
        if answer.is_interpretable:
            cells = [answer.marked_word(question) for question in QUESTIONS]
            for question, size in SIZE_OF.items():
                can_be_told = answer.words[question] is not Word.CANNOT_BE_TOLD
                cells.append(answer.format_size(size) if can_be_told else "")
        lines.append(f"| {' | '.join([_text(answer.subject), *cells])} |")
    return lines


def _table_note(analysis: Analysis) -> str:
    """The note of the table: signs, marks and priors."""
    note = (
        "Note. Estimates are averaged over the models that have the effect. Contraction is in per "
        "cent of the way to the mean first stimulus, below 0 repulsion."
    )
    if any(answer.fits is False for answer in analysis.answers):
        note += " !: the model does not fit."
    if any(answer.depends_on_prior for answer in analysis.answers):
        note += " ?: undecided with a prior half or twice as wide."
    return f"{note} Priors: `{analysis.draws.prior.observer.describe(analysis.study.task)}`."


def _text(text: str) -> str:
    """A text from outside, so that it is no markup."""
    return visible(text).translate(_ESCAPED)
