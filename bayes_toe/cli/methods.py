"""methods.md: the paragraph that a journal prints, a table, and the citations."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from importlib.resources import files
from math import exp
from pathlib import Path
from textwrap import fill

from bayes_toe.analysis import Analysis
from bayes_toe.answers.order_effect import (
    QUESTIONS,
    OrderEffect,
    format_number,
    format_percent,
    format_share,
)
from bayes_toe.answers.study_summary import FEWEST_FOR_GROUP, frequency_line
from bayes_toe.answers.words import (
    NO_UP_TO,
    PROBABLY_FROM,
    PROBABLY_NOT_LOG_BAYES_FACTOR,
    PROBABLY_NOT_UP_TO,
    YES_FROM,
    Word,
)
from bayes_toe.checks.identification import identify
from bayes_toe.data.messages import counted, listed, visible
from bayes_toe.data.tasks import WHICH_STRONGER, Task
from bayes_toe.groups.population import PopulationResult

_MOST_NAMED = 10
_WIDTH = 95
#: What notes of reading a study say if something was done to the data.
_DONE = ("dropped", "excluded", "merged", "swapped", "only rows", "only pairs")
#: Letters that mean something in Markdown.
_ESCAPED = str.maketrans({letter: f"\\{letter}" for letter in "\\`*_[]<>|#~$"})
#: Parameters that are free in every model, by task.
_NUISANCE = {
    True: "Noise, its slope over intensity, and the lapse rate",
    False: "Noise, the indecision zone, their slopes over intensity, and the lapse rate",
}


def write_methods(analysis: Analysis, group: PopulationResult | None, path: Path) -> None:
    """Write the document in Markdown, and its citations as NAME.bib."""
    paragraphs = [
        f"**Methods.** {' '.join(_methods(analysis, group))}",
        f"**Results.** {' '.join(_results(analysis, group))}",
    ]
    wrapped = [
        fill(text, _WIDTH, break_long_words=False, break_on_hyphens=False) for text in paragraphs
    ]
    table = "\n".join(_table(analysis.answers))
    text = "\n\n".join(["# Methods and results", *wrapped, table]) + "\n"
    path.write_text(text, encoding="utf-8")
    path.with_suffix(".bib").write_text(_citations(text, analysis), encoding="utf-8")


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


def _methods(analysis: Analysis, group: PopulationResult | None) -> list[str]:
    """Sentences about data, models, priors and computation."""
    study, draws = analysis.study, analysis.draws
    versions = json.loads(draws.attrs["versions"])
    sentences = [*_data(analysis), _task(study.task)]
    sentences.append(
        "For each participant we estimated whether the response depended on presentation order "
        "through a constant error, a contraction bias, or both. A constant error shifts the point "
        "of subjective equality (PSE) by the same amount at every intensity. Contraction moves the "
        "remembered first stimulus by a share p toward the mean first stimulus. Four models of "
        "one observer were compared: no order effect, constant error, contraction, both. "
        f"{_NUISANCE[study.task == WHICH_STRONGER]} were free in every model."
    )
    prior = draws.prior.observer.describe(study.task)
    sentences.append(
        f"Priors were `{prior}`; the prior probability was 1/2 for no order effect and 1/6 for "
        "each other model. Marginal likelihoods were computed by adaptive importance sampling "
        f"[@cornuet2012] with bayes_toe {versions['bayes_toe']} [@bayes_toe], seed {draws.seed}."
    )
    sentences.append(
        f"We call an effect present ('yes') from a posterior probability of {_share(YES_FROM)} "
        f"on, probable from {_share(PROBABLY_FROM)}, absent ('no') up to {_share(NO_UP_TO)}, and "
        f"probably absent up to {_share(PROBABLY_NOT_UP_TO)} if the Bayes factor is at most "
        f"{_share(exp(PROBABLY_NOT_LOG_BAYES_FACTOR))}. Estimates are posterior medians with "
        "95 % intervals, averaged over the models that have the effect."
    )
    if group is not None:
        sentences.append(
            "Group means come from a hierarchical model with both effects, sampled by "
            "Hamiltonian Monte Carlo."
        )
    if analysis.contrast is not None:
        sentences.append(
            "Conditions were compared within participants by joint fits in which constant error, "
            "contraction and JND may differ."
        )
    return sentences


def _data(analysis: Analysis) -> list[str]:
    """How much there is, and what was done to it."""
    study = analysis.study
    trials = [subject.total_trials for subject in study.without_conditions()]
    each = f"{min(trials):,} to {max(trials):,} each"
    if len(set(trials)) == 1:
        each = f"{trials[0]:,} each"
    whole = f"{counted(len(trials), 'participant')} gave {sum(trials):,} responses ({each})."
    sentences = [whole]
    if study.synthetic:
        sentences.append("These data are synthetic.")
    done = [note for note in study.notes if any(word in note for word in _DONE)]
    if done:
        sentences.append(f"Before the analysis: {_text('; '.join(done))}.")
    return sentences


def _task(task: Task) -> str:
    """The question that participants answered."""
    if task == WHICH_STRONGER:
        return "They said which of two successive stimuli was the stronger one."
    return "They said whether two successive stimuli were equal or different."


# --- What came out ------------------------------------------------------------------------------


def _results(analysis: Analysis, group: PopulationResult | None) -> list[str]:
    """Sentences about the conclusions, the group, and their limits."""
    answers = analysis.answers
    is_by_unit = analysis.study.conditions is not None
    sentences = [_counts(answers, question, is_by_unit) for question in QUESTIONS]
    if group is not None:
        sentences += _group(group)
    elif len(answers) < FEWEST_FOR_GROUP and not is_by_unit:
        frequencies = frequency_line(answers)
        if frequencies:
            sentences.append(f"{frequencies} [@penny2010]")
    if analysis.contrast is not None:
        differing = "; ".join(analysis.contrast.sentences())
        sentences.append(f"Differences between conditions: {_text(differing)}.")
    sentences += _limits(analysis)
    sentences += _paper_model(analysis)
    return sentences


def _counts(answers: Sequence[OrderEffect], question: str, is_by_unit: bool) -> str:
    """In how many participants an effect is present, probable and absent."""
    counts = Counter(answer.words[question] for answer in answers)
    of_all = f"{counts[Word.YES]} of {len(answers)}"
    noun = "participant" if len(answers) == 1 else "participants"
    if is_by_unit:
        noun = f"{noun[:-1] if len(answers) > 1 else noun} x condition"
    name = question.replace("_", " ")
    article = "An" if name.startswith("order") else "A"
    others = {
        Word.PROBABLY: "probable",
        Word.UNDECIDED: "undecided",
        Word.PROBABLY_NOT: "probably absent",
        Word.NO: "absent",
        Word.CANNOT_BE_TOLD: "not identified",
        Word.NOT_INTERPRETABLE: "not interpreted",
    }
    parts = [f"{text} in {counts[word]}" for word, text in others.items() if counts[word]]
    text = f"{article} {name} was present in {of_all} {noun}"
    if counts[Word.YES]:
        text += f" (posterior probability > {_share(YES_FROM)})"
    return ", ".join([text, *parts]) + "."


def _group(group: PopulationResult) -> list[str]:
    """Means of the group with intervals and Bayes factors."""
    error, contraction = group.effect("constant_error"), group.effect("contraction")
    percent = error.percent
    assert percent is not None  # The constant error has one.
    low, median, high = percent
    shift = (
        f"The group's mean PSE shift was {format_number(median, '+')} % (95 % interval "
        f"{format_number(low, '+')} to {format_number(high, '+')}), BF "
        f"{bayes_factor(error.zero_mean.log_bf)}."
    )
    low, median, high = contraction.mean
    share = (
        f"Its mean contraction was p = {_share(median)} ({_share(low)} to {_share(high)}), BF "
        f"{bayes_factor(contraction.zero_mean.log_bf)}."
    )
    sentences = [shift, share]
    if not group.is_reliable:
        sentences.append(f"The draws of the group are NOT RELIABLE: {group.draws.shortfall}.")
    return sentences


def bayes_factor(log_bf_of_zero: float) -> str:
    """The Bayes factor of a mean that is not 0, from the log Bayes factor of 0.

    Examples
    --------
    >>> bayes_factor(-2.9), bayes_factor(0.9), bayes_factor(-20.0), bayes_factor(9.0)
    ('18', '0.41', '> 100', '< 1/100')
    """
    if log_bf_of_zero < -4.605:
        return "> 100"
    if log_bf_of_zero > 4.605:
        return "< 1/100"
    return format_number(exp(-log_bf_of_zero))


def _limits(analysis: Analysis) -> list[str]:
    """What the design cannot identify, and which conclusions must not be used as they stand."""
    answers = analysis.answers
    sentences = []
    limits = Counter[str]()
    for subject in analysis.study:
        identification = identify(subject)
        limits.update({*identification.notes, *identification.reasons.values()})
    for note, count in limits.items():
        whose = ""
        if count < len(analysis.study):
            whose = f" ({count} of {len(analysis.study)})"
        sentences.append(f"Limit of the design{whose}: {note}.")
    groups = {
        "The model does not fit {}.": [a.subject for a in answers if a.fits is False],
        "The fit is not testable for {}.": [a.subject for a in answers if a.fits is None],
        "Not interpreted: {}.": [a.subject for a in answers if not a.is_interpretable],
        "A conclusion depends on the scale of the prior for {}.": [
            a.subject for a in answers if a.depends_on_prior
        ],
        "Responses depend on the previous trial for {}.": [
            a.subject for a in answers if a.depends_on_previous_trial
        ],
        "There are no results for {}.": list(analysis.draws.failed),
    }
    for sentence, names in groups.items():
        if len(names) == len(answers) > 1:
            sentences.append(sentence.format("any participant"))
        elif names:
            sentences.append(sentence.format(_text(listed(names, _MOST_NAMED))))
    return sentences


def _paper_model(analysis: Analysis) -> list[str]:
    """The paper's model: its draws, and its evidence against one free probability per pair."""
    draws = analysis.draws
    stats = draws.group("sample_stats")
    sentences = [
        "The model of [@avetta2026] (H1), which always includes contraction, was sampled with "
        f"emcee [@emcee]: effective sample sizes of at least {float(stats['min_ess'].min()):,.0f}, "
        f"R-hat [@vehtari2021] up to {float(stats['max_r_hat'].max()):.3f}."
    ]
    if draws.not_converged:
        names = _text(listed(list(draws.not_converged), _MOST_NAMED))
        sentences.append(f"Draws did NOT CONVERGE for {names}.")
    factors = analysis.evidence.frame()["log_bayes_factor"].dropna()
    if len(factors):
        n_favoured = int((factors > 0.0).sum())
        sentences.append(
            "It predicted better than one free probability per pair (H0) for "
            f"{n_favoured} of {len(factors)} (median ln BF {factors.median():.1f}); this does not "
            "test for an order effect."
        )
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
            cells.append(format_percent(answer.sizes["pse_shift_percent"]))
            cells.append(format_share(answer.sizes["contraction_p"]))
        else:
            cells += ["not interpreted", *[""] * (len(heads) - 2)]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _share(value: float) -> str:
    """A number with two decimals and no zero before its point."""
    return f"{value + 0.0:.2f}".replace("0.", ".", 1)


def _text(text: str) -> str:
    """A text from outside, so that it is no markup."""
    return visible(text).translate(_ESCAPED)
