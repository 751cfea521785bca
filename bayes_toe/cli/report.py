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

from jinja2 import Environment, PackageLoader, StrictUndefined

from bayes_toe.analysis import Analysis
from bayes_toe.answers.contrast import LEGEND, ContrastTable, Difference
from bayes_toe.checks.answer_checks import FLAG_KINDS, Finding
from bayes_toe.checks.design_checks import NOTES, check
from bayes_toe.classical.asymmetry import AsymmetryTable
from bayes_toe.cli import headline
from bayes_toe.cli.population import answer, tables
from bayes_toe.cli.terminal import allowed, allowed_in_order, allowed_quantiles, said_subjects
from bayes_toe.comparison.study_answer import APPENDIX_C, of_new_subject, study_sentence, way_on
from bayes_toe.comparison.words import STATED, conclusion
from bayes_toe.data.messages import said_intervals, visible
from bayes_toe.data.tables import file_stems
from bayes_toe.data.tasks import Task
from bayes_toe.groups.population import Population
from bayes_toe.groups.predictive_check import PredictiveCheck
from bayes_toe.model.ladder import models_of
from bayes_toe.model.target import DOMINATED
from bayes_toe.plots.style import MOST_NAMED

if TYPE_CHECKING:
    import pandas as pd

#: Subjects up to which the report is one file.
MOST_IN_ONE = 200
#: Differences of natural logs that are published in per cent too.
_PUBLISHED = ("pse_shift", "jnd")
_MOST_LISTED = 10  # names or findings that a list of an index shows
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
    r"(?<![\w.])-(?=\d)"
)  # of a number; not the hyphen of a word, a range or an exponent


@dataclass(frozen=True, eq=False)
class Group:
    """What the subjects have in common, and whether a population of this form can be believed."""

    found: Population
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
            analysis.verdicts, key=lambda one: paged and one.subject not in facts.flagged
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
        conclusion=conclusion,
        data_uri=lambda picture: (
            f"data:image/png;base64,{base64.b64encode(picture.read_bytes()).decode('ascii')}"
        ),
        deviance=headline.deviance,
        head=_head,
        misfit=headline.misfit,
        number=lambda value, digits=2, error=nan: (
            "–" if value is None or value != value else _typeset(allowed(value, error, digits))
        ),
        p_value=lambda value: "–" if value is None or value != value else headline.p_value(value),
        told=lambda value: "–" if value is None else headline.told(value),
        typeset=_typeset,
        way_on=way_on,
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
        "in_natural": any(
            row.log_evidence_h1_laplace_natural is not None for row in analysis.evidence
        ),
        "failed": analysis.draws.failed,
        "not_converged": analysis.draws.not_converged,
        "imprecise": analysis.draws.imprecise,
        "seed": attrs["seed"],
        "sampler": analysis.settings.sampler,
        "who": said_subjects(study),
        "answer": study_sentence(
            analysis.verdicts, synthetic=study.synthetic, units=study.conditions is not None
        ),
        "new_subject": of_new_subject(
            analysis.verdicts, analysis.settings.seed, units=study.conditions is not None
        ),
        "reference": f"{prior.reference_interval or 1.0:g} s",
        "intervals": said_intervals(study.intervals) if study.intervals else "",
        "models": len(models_of(study.task).space),
        "settings": {
            "model": settings["model"],
            "prior": prior.describe_orders(study.task),
            "seed": str(attrs["seed"]),
            **{_SAMPLER.get(key, key): str(value) for key, value in settings["sampler"].items()},
            "versions": ", ".join(f"{name} {version}" for name, version in versions.items()),
        },
        "said": {
            "scale": STATED,
            "legend": headline.legend(study.task),
            "curves": headline.CURVES[study.task],
            "limits": headline.LIMITS,
            "flagged": headline.FLAGGED,
            "appendix_c": APPENDIX_C,
        },
        "asymmetry_drawn": (facts.place / "asymmetry.png").exists(),
        "dominated": DOMINATED,
        "crowded": len(study) > MOST_NAMED,
        "group": None if facts.group is None else _group(facts.group),
        "contrast": None if analysis.contrast is None else _by_condition(analysis.contrast),
    }


def _by_condition(table: ContrastTable) -> dict[str, Any]:
    """What the section of conditions says: a row for every subject and comparison, a column for every quantity."""
    rows = defaultdict[tuple[str, str], list[Difference]](list)
    for row in table:
        rows[row.subject, row.comparison].append(row)
    return {
        **{
            "about": table.conditions.about,
            "sentences": table.sentences(),
            "legend": LEGEND,
        },
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
        "converged": found.converged,
        "answer": [_typeset(line) for line in answer(found)],
        "tables": tables(found),
        "hyperprior": found.settings.hyperprior.describe(
            found.names, correlations=found.settings.correlations
        ),
        "scatter": found.settings.scatter,
        "subjects": len(found.study),
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
            "verdict": row.verdict,
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
                if one["parameter"] in (*natural, "gamma") and one["contraction"] < DOMINATED
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
