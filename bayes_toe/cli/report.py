"""The report of one analysis: a single HTML file that needs nothing else; of very many subjects an index with a page for each of them."""

from __future__ import annotations

import base64
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_toe.analysis import Analysis
from bayes_toe.classical.asymmetry import LEVEL, AsymmetryTable, SubjectAsymmetry
from bayes_toe.classical.fit_table import SubjectFit
from bayes_toe.cli.attention import FLAGGED
from bayes_toe.cli.digits import allowed
from bayes_toe.cli.headline import APPENDIX_C, FIT, NEXT, deviance, misfit, misfits, p_value, tally
from bayes_toe.comparison.evidence_table import SubjectEvidence
from bayes_toe.comparison.presets import say_presets
from bayes_toe.comparison.words import STATED, conclusion, order_effect_and_probability
from bayes_toe.data.file_names import file_stems
from bayes_toe.data.messages import visible
from bayes_toe.data.study import said_intervals
from bayes_toe.experiments.answers_check import check_answers
from bayes_toe.experiments.checks import Finding, check_study
from bayes_toe.inference.predictive_checks import FitSummary
from bayes_toe.model.contraction import DOMINATED
from bayes_toe.model.coordinates import NATURAL
from bayes_toe.plots.sorted import MOST_NAMED

if TYPE_CHECKING:
    import pandas as pd
    from jinja2 import Environment, Template


#: Subjects up to which the report is one file.
MOST_IN_ONE = 200
#: Names or findings that a list of an index shows.
_MOST_LISTED = 10


@dataclass(frozen=True)
class Pictures:
    """Where the PNG figures of a report are, to be read one at a time.

    Attributes
    ----------
    place : Path
        Folder of evidence.png, asymmetry.png (may be missing), map.png and prior.png.
    curves, corner : mapping of str to Path
        Of the subjects that were drawn.
    which : str
        Whose these are: "all", "flagged" or "none".
    """

    place: Path
    curves: Mapping[str, Path]
    corner: Mapping[str, Path]
    which: str = "all"

    def of_study(self, name: str) -> Path:
        """The file of a figure of the study."""
        return self.place / f"{name}.png"


@dataclass(frozen=True, eq=False)
class Facts:
    """What a report says besides the analysis: summary of the draws, model-free asymmetries, who must be looked at and why, the group."""

    summary: pd.DataFrame
    asymmetry: AsymmetryTable
    flagged: Mapping[str, tuple[str, ...]]
    group: Mapping[str, Any] | None = None


def write_report(analysis: Analysis, facts: Facts, pictures: Pictures, folder: Path) -> None:
    """Write report.html into a folder, and subjects/*.html where there are more than :data:`MOST_IN_ONE`.

    Every text from outside is escaped by the template engine, its control characters too.
    """
    environment, paged = _environment(), len(analysis.study) > MOST_IN_ONE
    links = _links(analysis.study.names, paged)
    context = _context(analysis, facts, pictures, links) | {"paged": paged, "most": _MOST_LISTED if paged else None}
    subjects = _subject_contexts(analysis, facts, pictures, context["findings"], links)
    if paged:
        (folder / "subjects").mkdir()
        page = environment.get_template("page.html")
        for subject in subjects:
            _write(page, context | {"subject": subject}, folder / links[subject["counts"].name])
    _write(environment.get_template("report.html"), context | {"subjects": subjects}, folder / "report.html")


def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    made = Environment(
        loader=PackageLoader("bayes_toe", "cli"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=_visible,
    )
    made.filters.update(number=_number, signed=_signed, p_value=p_value, data_uri=_data_uri, deviance=deviance, misfit=misfit)
    made.filters.update(order_effect=order_effect_and_probability, conclusion=conclusion, head=_head)
    return made


def _write(template: Template, context: Mapping[str, Any], path: Path) -> None:
    """Piece by piece: with its pictures a report may be larger than memory."""
    with path.open("w", encoding="utf-8") as file:
        file.writelines(template.generate(context))


def _links(names: Sequence[str], paged: bool) -> dict[str, str]:
    """Where each subject is found from the report: on its page, or below."""
    stems = file_stems(names) if paged else {}
    return {name: f"subjects/{stems[name]}.html" if paged else f"#subject-{i + 1}" for i, name in enumerate(names)}


def _context(analysis: Analysis, facts: Facts, pictures: Pictures, links: Mapping[str, str]) -> dict[str, Any]:
    """What does not depend on a subject."""
    findings, table = check_study(analysis.study), analysis.evidence
    return {
        "study": analysis.study,
        "reference": f"{analysis.settings.prior.reference_interval or 1.0:g} s",
        "intervals": said_intervals(analysis.study.intervals) if analysis.study.intervals else "",
        "attrs": analysis.draws.attrs,
        "rows": table.rows,
        "tally": tally(table),
        "misfits": misfits(table),
        "presets": say_presets(analysis.presets),
        "said": {"scale": STATED, "fit": FIT, "appendix_c": APPENDIX_C, "next": NEXT[0].upper() + NEXT[1:], "flagged": FLAGGED},
        "failed": analysis.draws.failed,
        "not_converged": analysis.draws.not_converged,
        "findings": findings,
        "study_findings": [finding for finding in findings if finding.subject == ""],
        "before_pooling": check_answers(analysis.study, analysis.settings.prior),
        "pictures": pictures,
        "drawn": len(pictures.corner),
        "asymmetry_drawn": pictures.of_study("asymmetry").exists(),
        "effects": facts.asymmetry.rows,
        "population": facts.asymmetry.population(),
        "asymmetry_notes": facts.asymmetry.notes,
        "level": LEVEL,
        "dominated": DOMINATED,
        "links": links,
        "crowded": len(analysis.study) > MOST_NAMED,
        "flagged": facts.flagged,
        "group": facts.group,
        "index": _index(analysis, facts) if len(analysis.study) > MOST_IN_ONE else (),
    }


def _index(analysis: Analysis, facts: Facts) -> list[tuple[SubjectEvidence, SubjectAsymmetry]]:
    """Rows of the table of subjects: who must be looked at first, otherwise in the order of the study."""
    rows = list(zip(analysis.evidence, facts.asymmetry, strict=True))
    return sorted(rows, key=lambda row: row[0].subject not in facts.flagged)


def _subject_contexts(
    analysis: Analysis, facts: Facts, pictures: Pictures, findings: Sequence[Finding], links: Mapping[str, str]
) -> Iterator[dict[str, Any]]:
    """What each subject's section says, made when it is written."""
    missed, stats, messages = analysis.draws.not_converged, analysis.draws.group("sample_stats"), defaultdict[str, list[str]](list)
    for finding in findings:
        messages[finding.subject].append(finding.message)
    fits: Mapping[str, SubjectFit] = {fit.subject: fit for fit in analysis.fits}
    moved = {one.subject: one.describe() for one in analysis.presets if one.differ}
    summaries = dict(iter(facts.summary.groupby("subject", sort=False)))
    for i, (counts, row, effect) in enumerate(zip(analysis.study, analysis.evidence, facts.asymmetry, strict=True)):
        name, fitted = counts.name, None if counts.isi is not None else fits[counts.name]
        yield {
            "anchor": links[name].removeprefix("#"),
            "counts": counts,
            "parameters": _parameters(summaries[name], fitted, analysis.fits.level),
            "curves": pictures.curves.get(name),
            "corner": pictures.corner.get(name),
            "shortfall": missed.get(name, ""),
            "diagnostics": _diagnostics(analysis, stats.isel(subject=i), row, fitted),
            "remarks": [*messages[name], *row.notes],
            "moved": moved.get(name, ""),
            "row": row,
            "effect": effect,
            "prior_dominated": prior_dominated(summaries[name]),
        }


def prior_dominated(summary: pd.DataFrame) -> list[str]:
    """Parameters of a subject of which the data taught little: contraction below :data:`~bayes_toe.model.contraction.DOMINATED`."""
    rows = summary[summary["parameter"].isin([*NATURAL, "gamma"])]
    return [str(name) for name in rows["parameter"][rows["contraction"] < DOMINATED]]


def _diagnostics(analysis: Analysis, stats: Any, row: SubjectEvidence, fitted: SubjectFit | None) -> dict[str, str]:
    return {
        "smallest effective sample size": f"{float(stats['min_ess']):.0f}",
        "largest R-hat": f"{float(stats['max_r_hat']):.4f}",
        "acceptance": f"{float(stats['acceptance_rate'].mean()):.2f}",
        "steps of each walker": _kept(analysis, int(stats["steps"]), int(stats["thin"])),
        "proposal efficiency": f"{row.efficiency:.2f}",
        "Pareto k-hat": f"{row.pareto_k:.2f}",
        **({} if fitted is None else {"maximum likelihood at an edge": fitted.at_edge or "no"}),
        **({} if row.fit is None else _fit(row.fit)),
    }


def _parameters(summary: pd.DataFrame, fit: SubjectFit | None, level: float) -> list[dict[str, Any]]:
    """Rows of the parameter table: the posterior's summary and, for natural parameters, the fit (if any) with its bootstrap interval."""
    natural = {} if fit is None else dict(zip(NATURAL, zip(fit.parameters, fit.bootstrap.intervals(level), strict=True), strict=True))
    rows = []
    for row in summary.to_dict("records"):
        best, (lower, upper) = natural.get(row["parameter"], (None, (None, None)))
        rows.append({**{str(key): value for key, value in row.items()}, "fit": best, "fit_lower": lower, "fit_upper": upper})
    return rows


def _fit(fit: FitSummary) -> dict[str, str]:
    interval = "" if fit.worst_isi is None else f" at {fit.worst_isi:g} s"
    return {
        "deviance (d.f.)": deviance(fit),
        "p of the deviance": "–" if np.isnan(fit.p_deviance) else p_value(fit.p_deviance),
        "predictive p": p_value(fit.p_overall),
        "predictive p, worst pair": p_value(fit.worst_p),
        "worst pair (s1, s2)": f"({fit.worst_s1:.3g}, {fit.worst_s2:.3g}){interval}",
    }


def _kept(analysis: Analysis, steps: int, thin: int) -> str:
    last = thin * analysis.settings.sampler.kept_steps
    return f"{steps}, kept: last {last}" + ("" if thin == 1 else f", one in {thin}")


def _number(value: float | None, digits: int = 2, error: float = np.nan) -> str:
    """A number for a table, with no more digits than its Monte Carlo error allows; a dash where there is none."""
    return "–" if value is None or np.isnan(value) else allowed(value, error, digits).replace("-", "−")


def _signed(value: float, digits: int = 2) -> str:
    """A number for a table, with its sign."""
    return f"{value:+.{digits}f}".replace("-", "−")


def _visible(value: object) -> object:
    return visible(value) if type(value) is str else value  # markup is the template's own


def _data_uri(picture: Path) -> str:
    return "data:image/png;base64," + base64.b64encode(picture.read_bytes()).decode("ascii")


def _head(items: Mapping[Any, Any] | Sequence[Any], most: int | None) -> tuple[list[Any], int]:
    """The first items of a list, or all, and how many there are beyond them."""
    found = list(items.items() if isinstance(items, Mapping) else items)
    return found[:most], len(found) - len(found[:most])
