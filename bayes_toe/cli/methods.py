"""methods.md: the paragraphs of a paper on methods and results, a table, and the citations.

`write_methods` fills methods_template.md with what was done. The other functions write what was
found, in the past tense.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Sequence
from importlib.resources import files
from itertools import chain
from math import exp
from pathlib import Path
from textwrap import fill

import numpy as np
import numpy.typing as npt
from jinja2 import Environment, StrictUndefined

from bayes_toe.analysis import Analysis
from bayes_toe.answers import words
from bayes_toe.answers.group_answer import (
    good_fits_answer,
    group_answer,
)
from bayes_toe.answers.order_effect import (
    COUNTS_WITHIN,
    QUESTIONS,
    SIZE_OF,
    OrderEffect,
    format_decimals,
    format_number,
    short_direction,
)
from bayes_toe.answers.study_summary import (
    count_all,
    describe_meaning,
    misfit_lines,
    with_article,
)
from bayes_toe.arrays import Record
from bayes_toe.checks.alarm_rate import FALSE_ALARM_SHARE
from bayes_toe.data.messages import (
    capitalized,
    describe_p_value,
    join_words,
    visible,
)
from bayes_toe.data.study import Study
from bayes_toe.groups.population import study_scales
from bayes_toe.inference.diagnostics import worst

#: Letters that mean something in Markdown.
_ESCAPED = str.maketrans({letter: f"\\{letter}" for letter in "\\`*_[]<>|#~$"})
#: Words of the screens in a paper. Sentences with names from outside are not changed by them.
_IN_PAPER = {
    "subject": "participant",
    "directions differ": "directions differed",
    "differs:": "differed between conditions:",
    "differs": "differed",
    "changes": "changed",
    "does not": "did not",
    "do not": "did not",
    "cannot": "could not",
    "can be": "could be",
    "be told": "be identified",
    " is ": " was ",
}
#: What the words say of an effect.
_CLAIMS = {
    words.Word.YES: "present",
    "yes (repulsion)": "reversed (repulsion)",
    words.Word.PROBABLY: "probably present",
    "probably (repulsion)": "probably reversed (repulsion)",
    words.Word.UNDECIDED: "undecided",
    words.Word.PROBABLY_NOT: "probably absent",
    words.Word.NO: "absent",
    words.Word.CANNOT_BE_TOLD: "not identifiable",
}


def write_methods(analysis: Analysis, path: Path) -> None:
    """Write the document in Markdown, and its references as NAME.bib."""
    version = json.loads(analysis.draws.tree.attrs["versions"])["bayes_toe"]
    template = (files("bayes_toe") / "cli" / "methods_template.md").read_text(encoding="utf-8")
    environment = Environment(undefined=StrictUndefined, trim_blocks=True)
    environment.filters.update(
        capitalized=capitalized,
        decimals=format_decimals,
        escaped=_escaped,
        exp=exp,
        p_value=describe_p_value,
        range=_range,
        short_direction=short_direction,
    )

    context = {"version": version, **_methods(analysis), **_results(analysis)}
    filled = environment.from_string(template).render(context)
    text = "\n\n".join(map(_wrap, filled.split("\n\n"))) + "\n"
    path.write_text(text, encoding="utf-8")

    references = (files("bayes_toe") / "cli" / "references.bib").read_text(encoding="utf-8")
    path.with_suffix(".bib").write_text(references.replace("VERSION", version), encoding="utf-8")


def _wrap(paragraph: str) -> str:
    """A paragraph in short lines; the lines of a table stay."""
    if paragraph.startswith("|"):
        return paragraph
    return fill(" ".join(paragraph.split()), 88, break_long_words=False, break_on_hyphens=False)


def _escaped(text: str) -> str:
    """A text from outside, so that it is no markup."""
    return visible(text).translate(_ESCAPED)


# --- What was done ------------------------------------------------------------------------------


def _methods(analysis: Analysis) -> Record:
    """What the template says of data, models and computation."""
    study, group = analysis.study, analysis.group
    words_of_changes = "dropped|excluded|merged|swapped|only rows|only pairs"
    changes = [note for note in study.notes if re.search(words_of_changes, note)]
    trials_by_subject: Counter[str] = Counter()
    for unit in study:
        trials_by_subject[unit.subject_name] += unit.total_trials
    stimuli = np.concatenate([subject.stimuli for subject in study])
    (lowest, highest), stimulus_unit = _numbers(study, [stimuli.min(), stimuli.max()])

    context = {
        "analysis": analysis,
        "study": study,
        "trials": list(trials_by_subject.values()),
        "lowest": lowest,
        "highest": highest,
        "stimulus_unit": stimulus_unit,
        "changes": _escaped("; ".join(changes)),
        "unit": "participant",
        "priors": analysis.draws.prior.observer.describe(study.task).partition(";")[0],
        "largest_error": format_number(_largest_error(analysis.answers)),
        "within": COUNTS_WITHIN,
        "words": words,
        "fit_limit": format_decimals(FALSE_ALARM_SHARE),
        "pairs": _list_pairs(study),
    }

    if study.conditions is not None:
        context["unit"] = "participant in each condition"
        context["conditions"] = _escaped(study.conditions.about)
    if group is not None:
        hyperpriors = group.settings.hyperprior.describe(study.task)
        context["hyperpriors"] = _in_paper(", ".join(f"`{line}`" for line in hyperpriors))
        (_, n_effective), (_, r_hat) = worst(group.draws.convergence)
        context |= {"n_effective": n_effective, "r_hat": r_hat}
    return context


def _range(counts: Sequence[int]) -> str:
    """A count that all share, or the smallest and the largest one."""
    smallest, largest = min(counts), max(counts)
    return f"{largest:,}" if smallest == largest else f"{smallest:,} to {largest:,}"


def _numbers(study: Study, logs: npt.ArrayLike) -> tuple[list[str], str]:
    """Stimuli in the unit of the study, or in per cent of their mean, and the unit in words."""
    texts, unit = study.unit.numbers(logs, study_scales(study).mean)
    in_words = {"ln": "in natural-log intensity", "% of mean": "% of the geometric mean stimulus"}
    return texts, in_words.get(unit, unit)


def _list_pairs(study: Study) -> str:
    """The pairs of stimuli, if they are few and the same for everybody."""
    first_subject = study.subjects[0]
    n_pairs = first_subject.n_pairs
    if n_pairs > 30 or any(subject.pairs != first_subject.pairs for subject in study):
        return ""
    texts, unit = _numbers(study, first_subject.stimuli)
    pairs = [f"({s1}, {s2})" for s1, s2 in zip(texts, texts[n_pairs:], strict=False)]
    return f"Pairs (s1, s2), {unit}: {', '.join(pairs)}."


def _largest_error(answers: Sequence[OrderEffect]) -> float:
    """The largest standard error of a log marginal likelihood near the best of its subject."""
    errors = [0.0]
    for answer in answers:
        best = answer.log_evidence[answer.best_model]
        for model, value in answer.log_evidence.items():
            if value > best - COUNTS_WITHIN:
                errors.append(answer.standard_error[model])
    return max(errors)


# --- What was found -----------------------------------------------------------------------------


def _results(analysis: Analysis) -> Record:
    """What the template says of the conclusions and their limits."""
    answers = [answer for answer in analysis.answers if answer.is_interpretable]
    without_poor = misfit_lines(answers)[1:]
    if analysis.group is not None:
        without_poor += good_fits_answer(analysis.group, analysis.group_of_good_fits)
    limits = Counter(chain.from_iterable(answer.notes for answer in analysis.answers))
    return {
        "interpreted": answers,
        "results": " ".join(_conclusions(analysis, answers)),
        "without_poor": _in_paper(" ".join(without_poor)),
        "limits_of_design": limits,
        "sizes": SIZE_OF,
    }


def _conclusions(analysis: Analysis, answers: Sequence[OrderEffect]) -> list[str]:
    """Sentences about participants, the group, and conditions."""
    is_by_unit = analysis.study.conditions is not None
    noun = "condition" if is_by_unit else "participant"
    sentences = [_in_paper(describe_meaning(answers, analysis.group, noun))]
    if len(answers) > 1:
        sentences += _count_effects(answers, count_all(answers, "participant", is_by_unit))
    if analysis.group is not None:
        for line in group_answer(analysis.group):
            heading, colon, text = line.rpartition(": ")
            sentences.append(f"{_escaped(heading)}{colon}{_in_paper(text)}")
    if analysis.contrast is not None:
        _, *differences = analysis.contrast.sentences()
        sentences += map(_in_paper, differences)
    return sentences


def _in_paper(sentence: str) -> str:
    """A sentence of the screens in the past tense; it has no names from outside."""
    for word, paper_word in _IN_PAPER.items():
        sentence = sentence.replace(word, paper_word)
    return sentence


def _count_effects(answers: Sequence[OrderEffect], total: str) -> list[str]:
    """In how many participants each effect was present, absent or undecided."""
    sentences = []
    of_total = f" of {total}"
    for question in QUESTIONS:
        counts = Counter(answer.word(question) for answer in answers)
        if set(counts) == {words.Word.CANNOT_BE_TOLD}:
            continue
        parts = []
        for word, claim in _CLAIMS.items():
            count = counts[word] + counts[f"{word} (contraction)"]
            if count:
                parts.append(f"{claim} in {count}{of_total}")
                of_total = ""
        sentences.append(f"{capitalized(with_article(question))} was {join_words(parts)}.")
    return sentences
