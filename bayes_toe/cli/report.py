"""The report of one analysis: a single HTML file that needs nothing else; of very many subjects an index with a page for each of them."""

from __future__ import annotations

import base64
import json
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import exp, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from scipy.special import softmax

from bayes_toe.analysis import Analysis
from bayes_toe.answers.contrast import LEGEND, ContrastTable, Difference
from bayes_toe.answers.model_average import PRIOR_PROBABILITIES
from bayes_toe.answers.order_effect import (
    MISFIT_FLAG,
    PRIOR_FLAG,
    QUESTIONS,
    OrderEffect,
    format_number,
    format_percent,
    format_probability,
    format_share,
)
from bayes_toe.answers.study_summary import (
    APPENDIX_C,
    FEWEST_FOR_GROUP,
    describe_pair,
    frequency_line,
    study_lines,
)
from bayes_toe.answers.words import Word
from bayes_toe.checks.answer_checks import FLAG_KINDS, Finding
from bayes_toe.checks.design_checks import NOTES, check
from bayes_toe.classical.asymmetry import AsymmetryTable
from bayes_toe.cli import headline
from bayes_toe.cli.group_screen import group_answer, group_tables
from bayes_toe.cli.terminal import allowed, allowed_in_order, allowed_quantiles, describe_subjects
from bayes_toe.cli.within_screens import contrast_lines
from bayes_toe.data.messages import capitalized, counted, format_p, listed, said_intervals, visible
from bayes_toe.data.tables import file_stems
from bayes_toe.data.tasks import Task
from bayes_toe.groups.population import PopulationResult
from bayes_toe.groups.predictive_check import PredictiveCheck
from bayes_toe.model.posterior import DOMINATED
from bayes_toe.plots.figure_files import png
from bayes_toe.plots.report_figure import (
    has_curves,
    inline_svg,
    report_height,
    responses_figure,
    sizes_figure,
)
from bayes_toe.plots.style import MOST_NAMED

if TYPE_CHECKING:
    import pandas as pd

#: Subjects up to which the report is one file.
MOST_IN_ONE = 200
#: Differences of natural logs that are published in per cent too.
_PUBLISHED = ("pse_shift", "jnd")
_MOST_LISTED = 10  # names or findings that a list of an index shows
#: Terms of the report, for those who meet them for the first time.
GLOSSARY = {
    "PSE shift": "Second minus first stimulus when both seem equal, at the mean first stimulus. "
    "Above 0, the first stimulus is overestimated.",
    "constant error": "A PSE shift that is the same at every intensity; also time-order error. "
    "In 'which was stronger' it cannot be distinguished from a response bias.",
    "contraction": "The first stimulus is remembered as nearer to the mean by the share p; also "
    "contraction bias, central tendency. Repulsion is the opposite, p below 0.",
    "JND": "Just noticeable difference: from 50 to 75 % 'second' without lapses.",
    "Bayes factor": "How much the data change the odds of the models with the effect against "
    "those without it.",
    "serial dependence": "The response depends on earlier trials.",
}
_FITS = {True: "good", False: "poor", None: "not testable"}
#: Sizes of a subject, in words.
_SIZES = {
    "pse_shift_percent": "PSE shift",
    "pse_shift_jnd": "PSE shift, JND",
    "contraction_p": "contraction p",
    "jnd_percent": "JND",
    "zone_percent": "zone of 'equal'",
}
#: What the settings of the sampler are.
_SAMPLER = {
    "draws": "effective draws asked for",
    "ensembles": "ensembles (chains)",
    "walkers": "walkers of an ensemble",
    "max_r_hat": "largest R-hat",
    "max_thin": "thinning at which sampling gives up",
    "max_quantile_error": "largest error of 5 and 95 % quantiles, of the range between them",
}
_MINUS = re.compile(
    r"(?<![\w.])-(?=\.?\d)"
)  # of a number; not the hyphen of a word, a range or an exponent


@dataclass(frozen=True, eq=False)
class Group:
    """What the subjects have in common, and whether a population of this form can be believed."""

    found: PopulationResult
    check: PredictiveCheck


@dataclass(frozen=True, eq=False)
class Facts:
    """What a report says and shows besides the analysis."""

    summary: pd.DataFrame  # of the draws
    asymmetry: AsymmetryTable
    flagged: Mapping[str, tuple[str, ...]]  # who must be looked at, and why
    group: Group | None
    place: Path  # of order_effect.png, evidence.png, asymmetry.png (may be missing) and map.png
    curves: Mapping[str, Path]  # pictures of the subjects that were drawn
    corner: Mapping[str, Path]
    which: str  # whose these are: "all", "flagged" or "none"


def write_report(analysis: Analysis, facts: Facts, folder: Path) -> None:
    """Write report.html into a folder, and subjects/*.html where there are more than :data:`MOST_IN_ONE`.

    Every text from outside is escaped by the template engine, its control characters too. Pages are written piece by piece: with its
    pictures a report may be larger than memory.
    """
    names, paged, there = (
        analysis.study.names,
        len(analysis.study) > MOST_IN_ONE,
        {path.name for path in folder.iterdir()},
    )
    stems = file_stems(names) if paged else {}
    findings = check(analysis.study, analysis.settings.prior)
    warnings = [finding for finding in findings if finding.code not in NOTES]
    notes = [finding.message.rstrip(".") for finding in findings if finding.code in NOTES]
    context = _context(analysis, facts) | {
        "links": {
            name: f"subjects/{stems[name]}.html" if paged else f"#subject-{i + 1}"
            for i, name in enumerate(names)
        },
        "paged": paged,
        "most": _MOST_LISTED if paged else None,
        # Of very many those come first who must be looked at.
        "index": sorted(
            (_overview_row(answer) for answer in analysis.answers),
            key=lambda row: paged and row["subject"] not in facts.flagged,
        ),
        "beside": "../" if paged else "",
        "folder": folder,
        "there": there,
        "posterior": next(
            (name for name in sorted(there) if name.startswith("posterior.")), "posterior.nc"
        ),
        "findings": [finding.message for finding in warnings if finding.subject == ""],
        "before_pooling": [finding for finding in warnings if finding.code in FLAG_KINDS],
        "read": [*analysis.study.notes, *dict.fromkeys(notes)],
    }
    subjects, templates = (
        _subjects(analysis, facts, warnings),
        _environment(analysis.study.task),
    )
    if paged:
        (folder / "subjects").mkdir()
        for subject in subjects:
            with (folder / context["links"][subject["counts"].name]).open(
                "w", encoding="utf-8"
            ) as file:
                file.writelines(
                    templates.get_template("page.html").generate(context | {"subject": subject})
                )
    with (folder / "report.html").open("w", encoding="utf-8") as file:
        file.writelines(
            templates.get_template("report.html").generate(context | {"subjects": subjects})
        )


def _environment(task: Task) -> Environment:
    made = Environment(
        loader=PackageLoader("bayes_toe", "cli"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=lambda value: (
            visible(value) if type(value) is str else value
        ),  # markup is the template's own
    )
    made.filters.update(
        data_uri=lambda picture: (
            f"data:image/png;base64,{base64.b64encode(picture.read_bytes()).decode('ascii')}"
        ),
        capitalized=capitalized,
        deviance=headline.deviance,
        head=_head,
        misfit=headline.misfit,
        number=lambda value, digits=2, error=nan: (
            "–" if value is None or value != value else _typeset(allowed(value, error, digits))
        ),
        p_value=lambda value: "–" if value is None or value != value else format_p(value),
        typeset=_typeset,
    )
    return made


def _context(analysis: Analysis, facts: Facts) -> dict[str, Any]:
    """What does not depend on a subject, nor on whether there are pages of them."""
    study, prior, attrs = analysis.study, analysis.settings.prior, analysis.draws.attrs
    settings, versions = json.loads(attrs["settings"]), json.loads(attrs["versions"])
    return {
        "study": study,
        "facts": facts,
        "rows": analysis.evidence.rows,
        "fitted": bool(analysis.fits.rows),
        "failed": analysis.draws.failed,
        "not_converged": analysis.draws.not_converged,
        "imprecise": analysis.draws.imprecise,
        "seed": attrs["seed"],
        "sampler": analysis.settings.sampler,
        "who": describe_subjects(study),
        "answer": _answer(analysis),
        "glossary": GLOSSARY,
        "trust": _trust(analysis, facts.group),
        "reference": f"{prior.reference_interval or 1.0:g} s",
        "intervals": said_intervals(study.intervals) if study.intervals else "",
        "settings": {
            "model": settings["model"],
            "prior": prior.describe_orders(study.task),
            "seed": str(attrs["seed"]),
            **{_SAMPLER.get(key, key): str(value) for key, value in settings["sampler"].items()},
            "versions": ", ".join(f"{name} {version}" for name, version in versions.items()),
        },
        "texts": {
            "curves": headline.CURVES[study.task],
            "limits": headline.LIMITS,
            "flagged": headline.FLAGGED,
            "appendix_c": APPENDIX_C,
        },
        **_figure(analysis, None if facts.group is None else facts.group.found),
        "asymmetry_drawn": (facts.place / "asymmetry.png").exists(),
        "dominated": DOMINATED,
        "crowded": len(study) > MOST_NAMED,
        "group": None if facts.group is None else _group(facts.group),
        "contrast": None if analysis.contrast is None else _by_condition(analysis.contrast),
    }


def _figure(analysis: Analysis, group: PopulationResult | None) -> dict[str, Any]:
    """Figure 1 in two parts, as SVG with the colours of the page; of very many subjects as PNG."""
    height = report_height(analysis)
    figures = {"PSE shift and contraction of every subject": sizes_figure(analysis, group, height)}
    if has_curves(analysis):
        responses = responses_figure(analysis, height)
        figures = {"Responses and curves of some subjects": responses, **figures}
    parts = []
    for label, figure in figures.items():
        if len(analysis.study) <= MOST_NAMED:
            parts.append(inline_svg(figure, label))
            continue
        content = base64.b64encode(png(figure)).decode("ascii")
        parts.append(f'<img alt="{label}" src="data:image/png;base64,{content}">')
    return {"figure": parts, "has_curves": has_curves(analysis)}


def _answer(analysis: Analysis) -> list[str]:
    """The answer of the study, sentence by sentence."""
    units = analysis.study.conditions is not None
    answers = analysis.answers
    lines = study_lines(answers, synthetic=analysis.study.synthetic, units=units)
    if len(answers) < FEWEST_FOR_GROUP and not units:
        lines.append(frequency_line(answers))
    return [_typeset(line) for line in lines if line]


def _trust(analysis: Analysis, group: Group | None) -> list[tuple[str, str]]:
    """A sentence or two each on design, fit, prior, convergence and serial dependence."""
    return [
        ("Design", _design(analysis.answers)),
        ("Fit", _fit(analysis.answers)),
        ("Prior", _prior(analysis.answers)),
        ("Convergence", _convergence(analysis, group)),
        ("Serial dependence", _serial_dependence(analysis.answers)),
    ]


def _design(answers: Sequence[OrderEffect]) -> str:
    """What the design cannot show."""
    subjects = defaultdict[str, list[str]](list)
    for answer in answers:
        for note in answer.notes:
            subjects[note].append(answer.subject)
    if not subjects:
        return "The design can show a constant error and a contraction."
    sentences = []
    for note, names in subjects.items():
        whom = "" if len(names) == len(answers) else f" This concerns {_name_subjects(names)}."
        sentences.append(f"{capitalized(note.rstrip('.'))}.{whom}")
    return " ".join(sentences)


def _fit(answers: Sequence[OrderEffect]) -> str:
    """Subjects whom the best of the four models does not fit, and subjects without a check."""
    poor = [answer.subject for answer in answers if answer.fits is False]
    untestable = [answer.subject for answer in answers if answer.fits is None]
    sentences = []
    if poor:
        sentences.append(f"The model does not fit {_name_subjects(poor)}.")
    if untestable:
        sentences.append(f"The fit is not testable for {_name_subjects(untestable)}.")
    return " ".join(sentences) or "The fit is good for every subject."


def _prior(answers: Sequence[OrderEffect]) -> str:
    """Subjects whose conclusion another prior scale changes."""
    dependent = [answer.subject for answer in answers if answer.depends_on_prior]
    change = "A prior half or twice as wide changes"
    if not dependent:
        return f"{change} no conclusion."
    return f"{change} the conclusion of {_name_subjects(dependent)}."


def _convergence(analysis: Analysis, group: Group | None) -> str:
    """Whether the draws of the paper's model and of the group can be used."""
    missed = analysis.draws.not_converged
    if missed:
        reasons = [f"{name} ({reason})" for name, reason in missed.items()]
        sentence = (
            f"The draws of {counted(len(reasons), 'subject')} did not converge. Do not report "
            f"their parameters of the paper's model: {listed(reasons, _MOST_LISTED)}."
        )
    else:
        sentence = "The draws of the paper's model converged for every subject."
    if group is None:
        return sentence
    if group.found.is_reliable:
        return f"{sentence} The draws of the group converged."
    return f"{sentence} Do not report the group: {group.found.draws.shortfall}."


def _serial_dependence(answers: Sequence[OrderEffect]) -> str:
    """Subjects whose responses depend on the previous trial."""
    if all(answer.history_p is None for answer in answers):
        return "Not testable: the order of the trials is not known."
    dependent = [answer.subject for answer in answers if answer.depends_on_previous_trial]
    if not dependent:
        return "No subject's responses depend on the previous trial."
    return (
        f"The responses of {_name_subjects(dependent)} depend on the previous trial. "
        "The command bayes-toe history estimates by how much."
    )


def _name_subjects(names: Sequence[str]) -> str:
    """How many subjects, and which."""
    return f"{counted(len(names), 'subject')} ({listed(names, _MOST_LISTED)})"


def _overview_row(answer: OrderEffect) -> dict[str, Any]:
    """A subject in the table of all subjects; its marks stand for two of the flags."""
    marked = [flag for flag in answer.flags if flag.startswith((MISFIT_FLAG, PRIOR_FLAG))]
    sizes = []
    for question, size in (
        ("constant_error", "pse_shift_percent"),
        ("contraction", "contraction_p"),
    ):
        word = answer.words[question]
        is_hidden = word in (Word.NO, Word.PROBABLY_NOT, Word.NOT_INTERPRETABLE)
        is_hidden |= word is Word.CANNOT_BE_TOLD and question == "contraction"
        sizes.append((None, "–") if is_hidden else _size(answer, size))
    sizes.append(_size(answer, "jnd_percent") if answer.is_interpretable else (None, "–"))
    return {
        "subject": answer.subject,
        "is_interpretable": answer.is_interpretable,
        "words": [
            (_probability(answer, question), *_word(answer, question)) for question in QUESTIONS
        ],
        "sizes": sizes,
        "fit": _FITS[answer.fits],
        "flags": "; ".join(flag for flag in answer.flags if flag not in marked),
    }


def _word(answer: OrderEffect, question: str) -> tuple[str, str]:
    """The word with its marks, and its probability with the upper bound of the size."""
    if not answer.is_interpretable:
        return "not interpreted", ""
    word = answer.words[question]
    if word is Word.CANNOT_BE_TOLD:
        return word.value, ""
    detail = f"P {format_probability(answer.probabilities[question])}"
    return answer.marked_word(question), detail


def _probability(answer: OrderEffect, question: str) -> float | None:
    """The probability by which a column of words is sorted."""
    has_none = answer.words[question] in (Word.CANNOT_BE_TOLD, Word.NOT_INTERPRETABLE)
    return None if has_none else answer.probabilities[question]


def _size(answer: OrderEffect, name: str) -> tuple[float, str]:
    """The median of a size, and the size in words."""
    size = answer.sizes[name]
    if name == "contraction_p":
        return size.q50, format_share(size)
    if name == "pse_shift_jnd":
        return size.q50, format_percent(size).replace(" %", "", 1)
    if name == "pse_shift_percent":
        return size.q50, format_percent(size)
    numbers = [format_number(value) for value in (size.q50, size.q025, size.q975)]
    return size.q50, f"{numbers[0]} % [{numbers[1]}, {numbers[2]}]"


def _subject_answer(answer: OrderEffect) -> dict[str, Any]:
    """What the section of a subject says of its answer."""
    words = [f"{_title(question)}: {_word(answer, question)[0]}" for question in QUESTIONS]
    sizes = [
        (label, _size(answer, name)[1]) for name, label in _SIZES.items() if name in answer.sizes
    ]
    return {
        "sentence": answer.describe(),
        "short": ", ".join(words) if answer.is_interpretable else "not interpreted",
        "is_interpretable": answer.is_interpretable,
        "fits": answer.fits,
        "flags": answer.flags,
        "options": answer.options,
        "worst_pairs": [describe_pair(pair) for pair in answer.worst_pairs],
        "notes": answer.notes,
        "sizes": sizes,
        "models": _models(answer),
        "factors": _factors(answer),
    }


def _models(answer: OrderEffect) -> list[tuple[str, str]]:
    """The four models with their posterior probabilities and log evidences."""
    log_evidence = np.array(list(answer.log_evidence.values()))
    probabilities = softmax(log_evidence + np.log(PRIOR_PROBABILITIES)).tolist()
    rows = []
    for (name, value), p in zip(answer.log_evidence.items(), probabilities, strict=True):
        error = answer.standard_error[name]
        label = "no order effect" if name == "none" else name
        rows.append((label, f"P {format_probability(p)}, ln evidence {value:.2f} ± {error:.2f}"))
    return rows


def _factors(answer: OrderEffect) -> list[tuple[str, str]]:
    """Log Bayes factors of the questions, and p-values of the best model."""
    rows = [
        (f"ln BF, {_title(question)}", f"{value:+.1f}")
        for question, value in answer.log_bayes_factors.items()
    ]
    p_values = {
        "predictive p": answer.predictive_p,
        "p of the deviance": answer.deviance_p,
        "p of the trial before": answer.history_p,
    }
    for label, p in p_values.items():
        rows.append((label, "–" if p is None else format_p(p)))
    return rows


def _title(question: str) -> str:
    return question.replace("_", " ")


def _by_condition(table: ContrastTable) -> dict[str, Any]:
    """What the section of conditions says: a row for every subject and comparison, a column for every quantity."""
    rows = defaultdict[tuple[str, str], list[Difference]](list)
    for row in table:
        rows[row.subject, row.comparison].append(row)
    return {
        "answer": contrast_lines(table),
        "legend": LEGEND,
        "several": len(table.conditions.comparisons) > 1,
        "quantities": table.quantities,
        "rows": [(*who, cells) for who, cells in rows.items()],
        "left_out": [f"{name} ({why})" for name, why in (table.left_out | table.failed).items()],
    }


def _group(group: Group) -> dict[str, Any]:
    """What the section of the group says: warnings first, then the answer, tables."""
    found = group.found
    return {
        "problems": [*found.problems, *group.check.warnings],
        "is_reliable": found.is_reliable,
        "answer": [_typeset(line) for line in group_answer(found)],
        "tables": group_tables(found),
        "hyperprior": found.settings.hyperprior.describe(found.study.task),
        "subjects": len(found.subjects),
    }


def _subjects(
    analysis: Analysis, facts: Facts, findings: Sequence[Finding]
) -> Iterator[dict[str, Any]]:
    """What each subject's section says, made when it is written."""
    stats, messages = analysis.draws.group("sample_stats"), defaultdict[str, list[str]](list)
    for finding in findings:
        messages[finding.subject].append(finding.message)
    fits = {fit.subject: fit for fit in analysis.fits}
    summaries = {
        str(name): part.to_dict("records")
        for name, part in facts.summary.groupby("subject", sort=False)
    }
    for i, (counts, row, asymmetry) in enumerate(
        zip(analysis.study, analysis.evidence, facts.asymmetry, strict=True)
    ):
        name, fit = counts.name, fits.get(counts.name)
        natural = analysis.draws.posterior(name).names.natural
        limits = (
            []
            if fit is None
            else zip(
                natural, fit.parameters, fit.bootstrap.intervals(analysis.fits.level), strict=True
            )
        )
        yield {
            "anchor": f"subject-{i + 1}",
            "counts": counts,
            "row": row,
            "answer": None if row.answer is None else _subject_answer(row.answer),
            "asymmetry": asymmetry,
            "stats": stats.isel(subject=i),
            "fit": fit,
            "fitted": {key: (best, *limit) for key, best, limit in limits},
            "parameters": [
                {
                    **one,
                    "quantiles": allowed_quantiles(one, 3),
                    "percent": _in_percent(one) if one["parameter"] in _PUBLISHED else [],
                }
                for one in summaries[name]
            ],
            "remarks": [
                *messages[name],
                *(messages[counts.person] if counts.condition else ()),
                *row.notes,
            ],
            "prior_dominated": [
                one["parameter"]
                for one in summaries[name]
                if one["parameter"] in (*natural, "gamma")
                and one["posterior_contraction"] < DOMINATED
            ],
        }


def _in_percent(row: Mapping[Any, Any]) -> list[str]:
    """The 5 % quantile, median and 95 % quantile of a difference of natural logs, as a change of the intensity, exp - 1, in per cent."""
    keys = ("q05", "q50", "q95")
    factors = [100.0 * exp(row[key]) for key in keys]
    return allowed_in_order(
        [one - 100.0 for one in factors],
        [one * row[f"mcse_{key}"] for one, key in zip(factors, keys, strict=True)],
        1,
    )


def _typeset(words: str) -> str:
    """Words with minus signs before numbers."""
    return _MINUS.sub("−", words)


def _head(items: Mapping[Any, Any] | Sequence[Any], most: int | None) -> tuple[list[Any], int]:
    """The first items of a list, or all, and how many there are beyond them."""
    found = list(items.items() if isinstance(items, Mapping) else items)
    return found[:most], len(found) - len(found[:most])
