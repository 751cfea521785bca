"""The report of an analysis: one HTML file; of very many subjects an index and their pages."""

from __future__ import annotations

import base64
import json
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from scipy.special import softmax

from bayes_toe.analysis import Analysis
from bayes_toe.answers.contrast import LEGEND, ContrastTable, Difference
from bayes_toe.answers.model_average import PRIOR_PROBABILITIES
from bayes_toe.answers.order_effect import (
    MISFIT_FLAG,
    PRIOR_FLAG,
    QUESTIONS,
    SIZE_OF,
    OrderEffect,
    format_decimals,
    format_number,
    format_percent,
    format_probability,
    format_share,
    percent,
)
from bayes_toe.answers.study_summary import (
    APPENDIX_C,
    FEWEST_FOR_GROUP,
    describe_pair,
    frequency_line,
    study_lines,
)
from bayes_toe.answers.words import Word
from bayes_toe.arrays import FloatArray
from bayes_toe.checks.answer_checks import FLAG_KINDS, Finding
from bayes_toe.checks.design_checks import NOTES, check
from bayes_toe.classical.asymmetry import AsymmetryTable
from bayes_toe.classical.fit import SubjectFit
from bayes_toe.cli import headline
from bayes_toe.cli.group_screen import group_answer, group_tables
from bayes_toe.cli.terminal import allowed_in_order, describe_amount
from bayes_toe.cli.within_screens import contrast_lines
from bayes_toe.data.messages import (
    capitalized,
    counted,
    describe_p,
    format_p,
    listed,
    said_intervals,
    visible,
)
from bayes_toe.data.tables import file_stems
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.groups.population import PopulationResult
from bayes_toe.groups.predictive_check import PredictiveCheck
from bayes_toe.inference.diagnostics import quantile_errors
from bayes_toe.inference.predictive_checks import MISFIT
from bayes_toe.model.posterior import DOMINATED
from bayes_toe.plots.by_order import posterior_predictive
from bayes_toe.plots.figure_files import png
from bayes_toe.plots.report_figure import (
    has_curves,
    inline_svg,
    is_by_first,
    report_height,
    responses_figure,
    shown_subjects,
    sizes_figure,
)
from bayes_toe.plots.style import MOST_NAMED

if TYPE_CHECKING:
    import pandas as pd

Figure = Any  # of matplotlib, which is of another room

#: Subjects up to which the report is one file.
MOST_IN_ONE = 200
#: Differences of natural logs that are published in per cent too.
_PUBLISHED = ("pse_shift", "jnd")
_MOST_LISTED = 10  # names or findings that a list of an index shows
_MOST_MISFITS = 2  # subjects in the figure of poor fits
_INTERVAL = (0.025, 0.5, 0.975)
#: Words beside which no size stands, and the cell in its place.
_WITHOUT_SIZE = (Word.NO, Word.PROBABLY_NOT, Word.NOT_INTERPRETABLE, Word.CANNOT_BE_TOLD)
_NO_SIZE = (None, "–")
#: Terms of the report, for those who meet them for the first time.
GLOSSARY = {
    "PSE shift": "Second minus first stimulus when both seem equal, at the mean first stimulus. "
    "Above 0, the first stimulus is overestimated.",
    "constant error": "A PSE shift that is the same at every intensity; also time-order error. "
    "In 'which was stronger' it cannot be distinguished from a response bias.",
    "contraction": "The first stimulus is remembered as nearer to the mean by the share p; also "
    "contraction bias, central tendency. Repulsion is the opposite, p below 0.",
    "JND": "Just noticeable difference: from 50 to 75 % 'second' without lapses.",
    "Bayes factor": "Mean evidence of the models with the effect over that of the models without it.",
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
    "max_thin": "largest thinning",
    "max_quantile_error": "largest Monte Carlo error of the 5 and 95 % quantiles, as a share of their distance",
}
#: The minus of a number; not the hyphen of a word, a range or an exponent.
_MINUS = re.compile(r"(?<![\w.])-(?=\.?\d)")


@dataclass(frozen=True, eq=False)
class Group:
    """The group of the subjects, and its predictive check."""

    found: PopulationResult
    check: PredictiveCheck


@dataclass(frozen=True, eq=False)
class Facts:
    """What a report says and shows besides the analysis."""

    summary: pd.DataFrame  # of the draws
    asymmetry: AsymmetryTable
    flagged: Mapping[str, tuple[str, ...]]  # subjects that need action, with the reasons
    group: Group | None
    place: Path  # of evidence.png and asymmetry.png, which may be missing
    curves: Mapping[str, Path]  # figures of the subjects that were drawn
    corner: Mapping[str, Path]
    which: str  # whose these are: "all", "flagged" or "none"


def write_report(analysis: Analysis, facts: Facts, folder: Path) -> None:
    """Write report.html, and subjects/*.html of more than :data:`MOST_IN_ONE` subjects.

    Every text from outside is escaped by the template engine, its control characters too. Pages
    are written piece by piece: with its figures a report may be larger than memory.
    """
    names = analysis.study.names
    is_paged = len(names) > MOST_IN_ONE
    links = {name: f"#subject-{i}" for i, name in enumerate(names, 1)}
    answers = list(analysis.answers)
    if is_paged:
        answers.sort(key=lambda answer: answer.subject not in facts.flagged)
        links = {name: f"subjects/{stem}.html" for name, stem in file_stems(names).items()}
    findings = _findings(analysis, check(analysis.study, analysis.settings.prior))
    context = {
        **_context(analysis, facts),
        **findings,
        "folder": folder,
        "there": {path.name for path in folder.iterdir()},
        "links": links,
        "paged": is_paged,
        "most": _MOST_LISTED if is_paged else None,
        "index": [_overview_row(answer) for answer in answers],
        "beside": "../" if is_paged else "",
    }
    subjects = _subjects(analysis, facts, findings["warnings"])
    templates = _environment(analysis.study.task)
    if is_paged:
        (folder / "subjects").mkdir()
        page = templates.get_template("page.html")
        for subject in subjects:
            path = folder / links[subject["counts"].name]
            _write(page, {**context, "subject": subject}, path)
    report = templates.get_template("report.html")
    _write(report, {**context, "subjects": subjects}, folder / "report.html")


def _write(template: Template, context: Mapping[str, Any], path: Path) -> None:
    with path.open("w", encoding="utf-8") as file:
        file.writelines(template.generate(context))


def _environment(task: Task) -> Environment:
    """Templates, with the filters that they use."""
    environment = Environment(
        loader=PackageLoader("bayes_toe", "cli"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=_finalize,
    )
    environment.filters.update(
        capitalized=capitalized,
        data_uri=_data_uri,
        describe_pair=describe_pair,
        head=_head,
        number=_number,
        p_value=_p_value,
        typeset=_typeset,
    )
    return environment


def _finalize(value: object) -> object:
    """Texts from outside without control characters; markup is the template's own."""
    return visible(value) if type(value) is str else value


def _data_uri(picture: Path) -> str:
    content = base64.b64encode(picture.read_bytes()).decode("ascii")
    return f"data:image/png;base64,{content}"


def _number(value: float | None, digits: int = 2) -> str:
    """A number with some decimals; a dash where there is none."""
    if value is None or isnan(value):
        return "–"
    return _typeset(f"{value:.{digits}f}")


def _p_value(value: float | None) -> str:
    return "–" if value is None or isnan(value) else format_p(value)


def _findings(analysis: Analysis, findings: Sequence[Finding]) -> dict[str, Any]:
    """Findings of the design and of the responses, by the place where they stand."""
    warnings, notes = [], list[str]()
    for finding in findings:
        if finding.code in NOTES:
            notes.append(finding.message.rstrip("."))
        else:
            warnings.append(finding)
    return {
        "warnings": warnings,
        "before_pooling": [finding for finding in warnings if finding.code in FLAG_KINDS],
        "read": [*analysis.study.notes, *dict.fromkeys(notes)],
    }


def _context(analysis: Analysis, facts: Facts) -> dict[str, Any]:
    """What does not depend on a subject, nor on whether there are pages of them."""
    study, prior, draws = analysis.study, analysis.settings.prior, analysis.draws
    group = facts.group
    return {
        "study": study,
        "facts": facts,
        "rows": analysis.evidence.rows,
        "has_fits": bool(analysis.fits.rows),
        "failed": draws.failed,
        "not_converged": draws.not_converged,
        "imprecise": draws.imprecise,
        "seed": draws.seed,
        "amount": describe_amount(study),
        "answer": _answer(analysis),
        "glossary": GLOSSARY,
        "trust": _trust(analysis, group),
        "misfits": _misfit_figure(analysis),
        "reference": f"{prior.reference_interval or 1.0:g} s",
        "intervals": said_intervals(study.intervals) if study.intervals else "",
        "settings": _settings(analysis),
        "texts": {
            "curves": headline.CURVES[study.task],
            "limits": headline.LIMITS,
            "flagged": headline.FLAGGED,
            "appendix_c": APPENDIX_C,
        },
        "figure": _figure(analysis, None if group is None else group.found),
        "caption": _caption(analysis, group),
        "asymmetry_drawn": (facts.place / "asymmetry.png").exists(),
        "dominated": DOMINATED,
        "crowded": len(study) > MOST_NAMED,
        "group": None if group is None else _group(group),
        "contrast": None if analysis.contrast is None else _by_condition(analysis.contrast),
    }


def _settings(analysis: Analysis) -> dict[str, str]:
    """The settings of the analysis, with their names in words."""
    attrs = analysis.draws.attrs
    settings = json.loads(attrs["settings"])
    versions = json.loads(attrs["versions"])
    sampler = {_SAMPLER.get(key, key): str(value) for key, value in settings["sampler"].items()}
    return {
        "sampled model": "the paper's model (H1)",
        "prior": analysis.settings.prior.describe_orders(analysis.study.task),
        "seed": str(attrs["seed"]),
        **sampler,
        "versions": ", ".join(f"{name} {version}" for name, version in versions.items()),
    }


def _figure(analysis: Analysis, group: PopulationResult | None) -> list[tuple[str, str]]:
    """The parts of figure 1 by their classes: responses, sizes in wide and in narrow windows."""
    height = report_height(analysis)
    sizes = "PSE shift and contraction of every subject"
    figures = {
        "sizes wide": (sizes, sizes_figure(analysis, group, height)),
        "sizes narrow": (sizes, sizes_figure(analysis, group, height, is_narrow=True)),
    }
    if has_curves(analysis):
        label = "Responses and curves of some subjects"
        figures = {"responses": (label, responses_figure(analysis, height)), **figures}
    is_crowded = len(analysis.study) > MOST_NAMED
    embed = _inline_png if is_crowded else inline_svg
    return [(name, embed(figure, label)) for name, (label, figure) in figures.items()]


def _inline_png(figure: Figure, label: str) -> str:
    """A figure of very many subjects, whose SVG is too large."""
    content = base64.b64encode(png(figure)).decode("ascii")
    return f'<img alt="{label}" src="data:image/png;base64,{content}">'


def _caption(analysis: Analysis, group: Group | None) -> str:
    """What figure 1 shows."""
    sizes = (
        "PSE shift and contraction p: medians with 95 % intervals, averaged over the models that "
        "have the effect. A full marker of a subject means 'yes', a half marker 'probably'"
    )
    if group is not None:
        sizes += "; the last row is the mean of the group"
    if not has_curves(analysis):
        return f"{sizes}."
    return f"{_responses_caption(analysis)} {sizes}."


def _responses_caption(analysis: Analysis) -> str:
    """What the panels of responses show."""
    shown = [analysis.study[name] for name in shown_subjects(analysis.answers)]
    colours = "orange: weaker stimulus first, blue: stronger stimulus first"
    if analysis.study.task == SAME_DIFFERENT:
        colours += ", grey: equal stimuli"
    if any(is_by_first(counts) for counts in shown):
        colours = "a colour for each first stimulus"
    return (
        "Responses with standard errors, and curves averaged over the four models with 95 % bands "
        f"({colours})."
    )


def _misfit_figure(analysis: Analysis) -> str:
    """Observed and expected shares of the first subjects whom the model does not fit."""
    names = [answer.subject for answer in analysis.answers if answer.fits is False]
    if not names:
        return ""
    figure = posterior_predictive(analysis, names[:_MOST_MISFITS])
    return inline_svg(figure, "Observed shares and posterior predictive intervals")


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
    interpreted = [answer for answer in analysis.answers if answer.is_interpretable]
    return [
        ("Design", _design(analysis.answers)),
        ("Fit", _fit(interpreted)),
        ("Prior", _prior(interpreted)),
        ("Convergence", _convergence(analysis, group)),
        ("Serial dependence", _serial_dependence(interpreted)),
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
    return " ".join(sentences) or "No subject has a poor fit (p < .01)."


def _prior(answers: Sequence[OrderEffect]) -> str:
    """Subjects of whom another prior scale moves a probability past a limit."""
    dependent = [answer.subject for answer in answers if answer.depends_on_prior]
    change = "A prior half or twice as wide moves"
    if not dependent:
        return f"{change} no probability past .25 or .75."
    return f"{change} a probability past .25 or .75 for {_name_subjects(dependent)}."


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
        return "No subject shows a dependence on the previous trial (p < .01)."
    return (
        f"The responses of {_name_subjects(dependent)} depend on the previous trial. "
        "The command bayes-toe history estimates by how much."
    )


def _name_subjects(names: Sequence[str]) -> str:
    """How many subjects, and which."""
    return f"{counted(len(names), 'subject')} ({listed(names, _MOST_LISTED)})"


def _overview_row(answer: OrderEffect) -> dict[str, Any]:
    """A subject in the table of all subjects; its marks stand for two of the flags."""
    others = [flag for flag in answer.flags if not flag.startswith((MISFIT_FLAG, PRIOR_FLAG))]
    sizes = []
    for question, size in SIZE_OF.items():
        is_hidden = answer.words[question] in _WITHOUT_SIZE
        sizes.append(_NO_SIZE if is_hidden else _size(answer, size))
    sizes.append(_size(answer, "jnd_percent") if answer.is_interpretable else _NO_SIZE)
    words = [(_probability(answer, question), *_word(answer, question)) for question in QUESTIONS]
    return {
        "subject": answer.subject,
        "is_interpretable": answer.is_interpretable,
        "words": words,
        "sizes": sizes,
        "fit": _FITS[answer.fits] if answer.is_interpretable else "",
        "flags": "; ".join(others),
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
    cannot_be_told = {
        size for question, size in SIZE_OF.items() if answer.words[question] is Word.CANNOT_BE_TOLD
    }
    sizes = []
    for name, label in _SIZES.items():
        if name.replace("_jnd", "_percent") in cannot_be_told:
            sizes.append((label, Word.CANNOT_BE_TOLD.value))
        elif name in answer.sizes:
            sizes.append((label, _size(answer, name)[1]))
    return {
        "sentence": answer.describe(),
        "short": ", ".join(words) if answer.is_interpretable else "not interpreted",
        "is_interpretable": answer.is_interpretable,
        "fits": answer.fits,
        "flags": answer.flags,
        "options": answer.options,
        "worst_pairs": answer.worst_pairs,
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
    """Log Bayes factors of the questions, the fit of the best model, and the serial dependence."""
    rows = []
    for question, value in answer.log_bayes_factors.items():
        can_be_told = answer.words[question] is not Word.CANNOT_BE_TOLD
        text = f"{value:+.1f}" if can_be_told else Word.CANNOT_BE_TOLD.value
        rows.append((f"ln BF, {_title(question)}", text))
    fit = _FITS[answer.fits]
    if answer.predictive_p is not None and answer.deviance_p is not None:
        smaller = min(answer.predictive_p, answer.deviance_p)
        fit += f", predictive {describe_p(smaller)} (poor: below {format_decimals(MISFIT)})"
    rows.append(("fit of the best model", fit))
    if answer.history_p is not None:
        rows.append(("effect of the previous trial", describe_p(answer.history_p)))
    return rows


def _title(question: str) -> str:
    return question.replace("_", " ")


def _by_condition(table: ContrastTable) -> dict[str, Any]:
    """The section of conditions, with a row for every subject and comparison."""
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
    stats = analysis.draws.group("sample_stats")
    messages = defaultdict[str, list[str]](list)
    for finding in findings:
        messages[finding.subject].append(finding.message)
    fits = {fit.subject: fit for fit in analysis.fits}
    summaries = dict(list(facts.summary.groupby("subject", sort=False)))
    parts = zip(analysis.study, analysis.evidence, facts.asymmetry, strict=True)
    for i, (counts, row, asymmetry) in enumerate(parts):
        summary = summaries[counts.name].to_dict("records")
        natural = analysis.draws.posterior(counts.name).names.natural
        remarks = list(messages[counts.name])
        if counts.condition:
            remarks += messages[counts.person]
        yield {
            "anchor": f"subject-{i + 1}",
            "counts": counts,
            "row": row,
            "answer": None if row.answer is None else _subject_answer(row.answer),
            "asymmetry": asymmetry,
            "stats": stats.isel(subject=i),
            "fit": fits.get(counts.name),
            "parameters": _parameters(analysis, counts.name, summary, fits.get(counts.name)),
            "remarks": [*remarks, *row.notes],
            "prior_dominated": _prior_dominated(summary, (*natural, "gamma")),
        }


def _prior_dominated(summary: Sequence[Mapping[Any, Any]], names: Sequence[str]) -> list[str]:
    """Parameters whose posterior is hardly narrower than their prior."""
    rows = [row for row in summary if row["parameter"] in names]
    return [row["parameter"] for row in rows if row["posterior_contraction"] < DOMINATED]


def _parameters(
    analysis: Analysis, name: str, summary: Sequence[Mapping[Any, Any]], fit: SubjectFit | None
) -> list[list[str]]:
    """Parameters of the paper's model: estimates, maximum likelihood, and their precision."""
    natural = analysis.draws.posterior(name).names.natural
    fitted = {}
    if fit is not None:
        limits = fit.bootstrap.intervals(analysis.fits.level)
        for parameter, best, (low, high) in zip(natural, fit.parameters, limits, strict=True):
            fitted[parameter] = f"{_number(best, 3)} [{_number(low, 3)}, {_number(high, 3)}]"
    rows = []
    for row in summary:
        parameter = row["parameter"]
        draws = analysis.draws.values(name, parameter)
        n_effective = min(row["ess_bulk"], row["ess_tail"])
        cells = [parameter, _interval(draws, n_effective, 3)]
        is_published = parameter in _PUBLISHED
        cells.append(_interval(percent(draws), n_effective, 1, " %") if is_published else "")
        if analysis.fits.rows:
            cells.append(fitted.get(parameter, ""))
        cells.append(_number(row["posterior_contraction"]))
        cells.append(_number(n_effective, 0))
        cells.append(_number(row["r_hat"], 4))
        rows.append(cells)
    return rows


def _interval(draws: FloatArray, n_effective: float, digits: int, unit: str = "") -> str:
    """Median and 95 % interval with the digits that their Monte Carlo errors allow."""
    quantiles = np.quantile(draws, _INTERVAL).tolist()
    errors = quantile_errors(draws, _INTERVAL, n_effective).tolist()
    low, median, high = allowed_in_order(quantiles, errors, digits)
    return _typeset(f"{median}{unit} [{low}, {high}]")


def _typeset(words: str) -> str:
    """Words with minus signs before numbers."""
    return _MINUS.sub("−", words)


def _head(items: Mapping[Any, Any] | Sequence[Any], most: int | None) -> tuple[list[Any], int]:
    """The first items of a list, or all, and how many there are beyond them."""
    every = list(items.items() if isinstance(items, Mapping) else items)
    shown = every[:most]
    return shown, len(every) - len(shown)
