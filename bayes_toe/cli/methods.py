"""methods.md: the paragraphs of a paper on methods and results, a table, and the citations.

`write_methods` fills methods_template.md with what was done and what was found.
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

import numpy as np
import numpy.typing as npt
from jinja2 import Environment, StrictUndefined

from bayes_toe.analysis import Analysis
from bayes_toe.answers import words
from bayes_toe.answers.group_answer import (
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
#: Words of the screens, and the words of a paper in their place. They are replaced in this order.
_IN_PAPER = {
    "subject": "participant",
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


def write_methods(analysis: Analysis, path: Path) -> None:
    """Write the document in Markdown, and its references as NAME.bib."""
    version = json.loads(analysis.draws.tree.attrs["versions"])["bayes_toe"]
    template = (files("bayes_toe.cli") / "methods_template.md").read_text(encoding="utf-8")
    environment = Environment(undefined=StrictUndefined, trim_blocks=True)
    environment.filters.update(
        capitalized=capitalized,
        count_all=count_all,
        decimals=format_decimals,
        describe_meaning=describe_meaning,
        escaped=_escaped,
        exp=exp,
        group_answer=group_answer,
        in_paper=_in_paper,
        join_words=join_words,
        numbers=_numbers,
        p_value=describe_p_value,
        short_direction=short_direction,
        worst=worst,
    )

    filled = environment.from_string(template).render(_methods(analysis), version=version)
    text = "\n\n".join(map(_wrap, filled.split("\n\n"))) + "\n"
    path.write_text(text, encoding="utf-8")

    references = (files("bayes_toe.cli") / "references.bib").read_text(encoding="utf-8")
    path.with_suffix(".bib").write_text(references.replace("VERSION", version), encoding="utf-8")


def _wrap(paragraph: str) -> str:
    """A paragraph in lines of at most 88 characters; the lines of a table stay."""
    if paragraph.startswith("|"):
        return paragraph
    return fill(" ".join(paragraph.split()), 88, break_long_words=False, break_on_hyphens=False)


def _escaped(text: str) -> str:
    r"""A text from outside without markup: 'a*b' -> 'a\*b'."""
    return visible(text).translate(_ESCAPED)


def _methods(analysis: Analysis) -> Record:
    """The values of the template by name: data, changes of the data, limits and words."""
    study = analysis.study
    # The notes on trials that are left out or changed, of all notes of reading.
    words_of_changes = "dropped|excluded|merged|swapped|only rows|only pairs"
    changes = [note for note in study.notes if re.search(words_of_changes, note)]

    trials_by_subject: Counter[str] = Counter()
    for unit in study:  # a subject, or a subject in one condition
        trials_by_subject[unit.subject_name] += unit.total_trials
    stimuli = np.concatenate([subject.stimuli for subject in study])  # natural logs
    (lowest, highest), stimulus_unit = _numbers(study, [stimuli.min(), stimuli.max()])

    return {
        "analysis": analysis,
        "study": study,
        "trials": list(trials_by_subject.values()),
        "lowest": lowest,
        "highest": highest,
        "stimulus_unit": stimulus_unit,
        "changes": _escaped("; ".join(changes)),
        "largest_error": format_number(_largest_error(analysis.answers)),
        "within": COUNTS_WITHIN,
        "words": words,
        "fit_limit": format_decimals(FALSE_ALARM_SHARE),
        "questions": QUESTIONS,
        "sizes": SIZE_OF,
    }


def _numbers(study: Study, logs: npt.ArrayLike) -> tuple[list[str], str]:
    """Stimuli (natural logs) in the unit of the study, or in per cent of their mean; the unit.

    Without a unit, as in (['80', '125'], '% of the geometric mean stimulus').
    """
    texts, unit = study.unit.numbers(logs, study_scales(study).mean)
    in_words = {"ln": "in natural-log intensity", "% of mean": "% of the geometric mean stimulus"}
    return texts, in_words.get(unit, unit)


def _largest_error(answers: Sequence[OrderEffect]) -> float:
    """The largest standard error of the log evidences that count for the answer of a subject.

    A model that is far behind the best model has no weight in the answer, nor has its error.
    """
    errors = [0.0]
    for answer in answers:
        highest = answer.log_evidence[answer.best_model]
        for model, value in answer.log_evidence.items():
            if value > highest - COUNTS_WITHIN:  # in nats
                errors.append(answer.standard_error[model])
    return max(errors)


def _in_paper(sentence: str) -> str:
    """A sentence of the screens as a paper has it, in the past tense: 'differs' -> 'differed'.

    The sentence has no names from outside, in which words could be replaced.
    """
    for word, paper_word in _IN_PAPER.items():
        sentence = sentence.replace(word, paper_word)
    return sentence
