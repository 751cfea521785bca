"""The report of an analysis as HTML.

`write_report` fills the Jinja templates of this folder. Up to :data:`MAX_SUBJECTS` subjects are in
one file. With more, report.html is an index, and each subject has a page in subjects/. The other
functions prepare texts, tables and figures.
"""

from __future__ import annotations

import base64
import json
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from bayes_toe.analysis import Analysis
from bayes_toe.answers import words
from bayes_toe.answers.contrast import LEGEND
from bayes_toe.answers.group_answer import group_answer, group_tables
from bayes_toe.answers.order_effect import (
    MISFIT_FLAG,
    PRIOR_FLAG,
    describe_fit,
    format_decimals,
    format_draws,
    format_probability,
)
from bayes_toe.answers.study_summary import (
    APPENDIX_C,
    describe_pair,
)
from bayes_toe.arrays import Record
from bayes_toe.checks.alarm_rate import flag_limit
from bayes_toe.checks.answer_checks import FLAG_WORDS, Findings
from bayes_toe.checks.design_checks import NOTES, check
from bayes_toe.classical.asymmetry import AsymmetryTable, asymmetry_table
from bayes_toe.cli.answer_screen import answer_lines, not_counted
from bayes_toe.cli.terminal import describe_amount, merge_notes, notes_of
from bayes_toe.data.messages import (
    capitalized,
    describe_p_value,
    format_p_value,
    join_names,
    plural,
    visible,
    with_policy,
)
from bayes_toe.data.stimulus_unit import percent
from bayes_toe.inference.model_set import ModelSet
from bayes_toe.inference.order_evidence import PRIOR_PROBABILITIES
from bayes_toe.model.posterior import DOMINATED
from bayes_toe.plots.figure_files import png
from bayes_toe.plots.report_figure import (
    inline_svg,
    report_height,
    responses_figure,
    shown_subjects,
    sizes_figure,
)
from bayes_toe.plots.style import MAX_NAMES

#: Subjects up to which the report is one file.
MAX_SUBJECTS = 200


def write_report(analysis: Analysis, facts: Record, folder: Path) -> None:
    """Write report.html, and subjects/*.html of more than :data:`MAX_SUBJECTS` subjects.

    `facts` is what a report has besides the analysis: the subjects that need action with the
    reasons, what contradicts a normal group, the names of files by subject, the curves of the
    subjects with figures, and the choice of these subjects: "all", "flagged" or "none".

    Every text from outside is escaped by the template engine, its control characters too. Pages
    are written piece by piece: with its figures a report may be larger than memory.
    """
    names = analysis.study.names
    is_paged = len(names) > MAX_SUBJECTS
    answers = list(analysis.answers)
    # By subject: the page or the section of the subject.
    if is_paged:
        # The index begins with the subjects that need action.
        answers.sort(key=lambda answer: answer.subject not in facts["flagged"])
        links = {name: f"subjects/{stem}.html" for name, stem in facts["stems"].items()}
    else:
        links = {name: f"#subject-{i}" for i, name in enumerate(names, 1)}

    findings = check(analysis.study)
    asymmetry = asymmetry_table(analysis.study)
    context = {
        **_context(analysis, facts),
        "asymmetry": asymmetry,
        "findings": findings,
        "note_codes": NOTES,
        "pooling_codes": FLAG_WORDS,
        "folder": folder,
        "products": {path.name for path in folder.iterdir()},  # files to which pages link
        "links": links,
        "is_paged": is_paged,
        "answers": answers,
    }

    sections = _sections(analysis, asymmetry, findings)  # one for each subject
    templates = _environment()
    if is_paged:
        (folder / "subjects").mkdir()
        page = templates.get_template("page.html")
        for section in sections:
            path = folder / links[section["data"].name]
            _write(page, {**context, "subject": section}, path)
    context["subjects"] = sections  # The report shows them if it is one file, and not an index.
    _write(templates.get_template("report.html"), context, folder / "report.html")


def _write(template: Template, context: Mapping[str, Any], path: Path) -> None:
    """Write a page with a security policy."""
    path.write_text(with_policy(template.render(context)), encoding="utf-8")


def _environment() -> Environment:
    """Templates, with the filters that they use."""
    environment = Environment(
        loader=PackageLoader("bayes_toe", "cli"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=_without_control_characters,
    )
    environment.filters.update(
        capitalized=capitalized,
        decimals=format_decimals,
        png=png,
        png_uri=_png_uri,
        describe_fit=describe_fit,
        describe_p=describe_p_value,
        describe_pair=describe_pair,
        group_answer=group_answer,
        group_tables=group_tables,
        join_names=join_names,
        number=_number,
        p_value=format_p_value,
        plural=plural,
        report_height=report_height,
        responses_figure=responses_figure,
        sizes_figure=sizes_figure,
        inline_svg=inline_svg,
        probability=format_probability,
        typeset=_typeset,
    )
    return environment


def _without_control_characters(value: object) -> object:
    """A value of a template: a text without control characters; Markup, a subclass, stays."""
    return visible(value) if type(value) is str else value


def _png_uri(content: bytes) -> str:
    """A PNG file as the address of an image, so that the page holds the image."""
    return f"data:image/png;base64,{base64.b64encode(content).decode('ascii')}"


def _number(value: float | None, digits: int = 2) -> str:
    """A number with some decimals; a dash for None and NaN."""
    if value is None or isnan(value):
        return "–"
    return _typeset(f"{value:.{digits}f}")


def _context(analysis: Analysis, facts: Record) -> Record:
    """The values that all pages of the report share."""
    study = analysis.study
    group = analysis.group
    return {
        "analysis": analysis,
        "study": study,
        "draws": analysis.draws,
        "facts": facts,
        "group": group,
        "contrast": analysis.contrast,
        "fit_limit": flag_limit(len(study)),
        "amount": describe_amount(study),
        "answer": answer_lines(study, analysis.answers) + not_counted(analysis.answers),
        "design_notes": merge_notes(notes_of(analysis.answers)),
        "versions": json.loads(analysis.draws.tree.attrs["versions"]),
        "sampler": asdict(analysis.settings.sampler),
        "words": words,
        "appendix_c": APPENDIX_C,
        "marked_flags": (MISFIT_FLAG, PRIOR_FLAG),
        "shown_names": shown_subjects(analysis.answers),
        "dominated": DOMINATED,
        "max_names": MAX_NAMES,
        "legend": LEGEND,
    }


def _sections(
    analysis: Analysis, asymmetries: AsymmetryTable, findings: Findings
) -> Iterator[Record]:
    """Yield the values of the section of each subject, by the names in the template.

    They are computed when the section is written, because those of all subjects need much memory.
    """
    stats = analysis.draws.group("sample_stats")
    messages = defaultdict(list)  # by subject
    for finding in findings:
        if finding.code not in NOTES:
            messages[finding.subject].append(finding.message)

    summaries = dict(list(analysis.summary().groupby("subject", sort=False)))  # by subject
    results = zip(analysis.study, analysis.evidence, analysis.answers, asymmetries, strict=True)
    for i, (subject, evidence_row, answer, asymmetry) in enumerate(results):
        name = subject.name
        remarks = []
        # A finding names a subject, or a subject in a condition, which has a name of its own.
        # Without conditions both names are the same, and a dict has it once.
        for label in dict.fromkeys([name, subject.subject_name]):
            remarks += messages[label]

        log_evidence = np.array(list(answer.log_evidence.values()))  # of the four models
        yield {
            "anchor": f"subject-{i + 1}",
            "data": subject,
            "row": evidence_row,
            "answer": answer,
            "probabilities": ModelSet(log_evidence, PRIOR_PROBABILITIES).probabilities.tolist(),
            "asymmetry": asymmetry,
            "stats": stats.isel(subject=i),
            "parameters": [_parameter(analysis, row) for row in summaries[name].itertuples()],
            # The page names the natural parameters that the prior determines. gamma follows from
            # two of these parameters.
            "natural": (*analysis.draws.posterior(name).names.natural, "gamma"),
            "remarks": [*remarks, *evidence_row.notes],
        }


def _parameter(analysis: Analysis, row: Any) -> tuple[Any, str, str]:
    """A row of the summary, its estimate, and its estimate in the unit of differences, or ''.

    The texts have the digits that are certain: '0.112 [0.041, 0.183]' and '12 % [4, 20]'.
    """
    draws = analysis.draws.values(row.subject, row.parameter)
    n_effective = min(row.ess_bulk, row.ess_tail)  # of the median and of the interval's ends
    difference = ""
    if row.parameter in ("pse_shift", "jnd"):
        # The unit is natural logs where per cents would be too large.
        unit = analysis.study.unit.with_logs_if_large(percent(np.quantile(draws, (0.025, 0.975))))
        difference = format_draws(
            unit.to_differences(draws), n_effective, most_decimals=1, unit=unit.difference_unit
        )
    return row, format_draws(draws, n_effective, most_decimals=3), difference


def _typeset(words: str) -> str:
    """Words with minus signs before numbers: '-.5', but not in 'two-sided', '1-2' or '1e-5'."""
    return re.sub(r"(?<![\w.])-(?=\.?\d)", "−", words)
