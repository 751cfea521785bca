"""The report of one analysis: a single HTML file that needs nothing else."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_toe.analysis import Analysis
from bayes_toe.classical.asymmetry import LEVEL, AsymmetryTable
from bayes_toe.classical.fit_table import SubjectFit
from bayes_toe.cli.digits import allowed
from bayes_toe.cli.headline import APPENDIX_C, FIT, NEXT, deviance, misfit, misfits, p_value, tally
from bayes_toe.comparison.presets import say_presets
from bayes_toe.comparison.words import STATED, conclusion, order_effect_and_probability
from bayes_toe.data.cells import visible
from bayes_toe.data.study import said_intervals
from bayes_toe.data.whole_files import whole_file
from bayes_toe.experiments.answers_check import check_answers
from bayes_toe.experiments.checks import Finding, check_study
from bayes_toe.inference.predictive_checks import FitSummary
from bayes_toe.model.contraction import DOMINATED
from bayes_toe.model.coordinates import NATURAL

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Pictures:
    """PNG figures of a report: evidence, asymmetry (may be empty), map of all subjects, prior; per subject its curves and corner plot."""

    evidence: bytes
    asymmetry: bytes
    map: bytes
    prior: bytes
    curves: Mapping[str, bytes]
    corner: Mapping[str, bytes]


@dataclass(frozen=True, eq=False)
class Facts:
    """What a report says besides the analysis: summary of the draws, model-free asymmetries."""

    summary: pd.DataFrame
    asymmetry: AsymmetryTable


def prior_dominated(summary: pd.DataFrame, subject: str) -> list[str]:
    """Parameters of which the data taught little: contraction below :data:`~bayes_toe.model.contraction.DOMINATED`."""
    rows = summary[(summary["subject"] == subject) & summary["parameter"].isin([*NATURAL, "gamma"])]
    return [str(name) for name in rows["parameter"][rows["contraction"] < DOMINATED]]


def write_report(analysis: Analysis, facts: Facts, pictures: Pictures, path: str | Path, *, overwrite: bool = False) -> Path:
    """Render the report to `path`, whole or not at all."""
    text = render(analysis, facts, pictures)
    with whole_file(path, overwrite=overwrite) as target:
        target.write_text(text, encoding="utf-8")
    return Path(path)


def render(analysis: Analysis, facts: Facts, pictures: Pictures) -> str:
    """The report as HTML; every text from outside is escaped by the template engine, its control characters too."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, finalize=_visible)
    environment.filters.update(number=_number, signed=_signed, p_value=p_value, data_uri=_data_uri, deviance=deviance, misfit=misfit)
    environment.filters.update(order_effect=order_effect_and_probability, conclusion=conclusion)
    source = (files("bayes_toe.cli") / "report.html").read_text(encoding="utf-8")
    return environment.from_string(source).render(_context(analysis, facts, pictures))


def _context(analysis: Analysis, facts: Facts, pictures: Pictures) -> dict[str, Any]:
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
        "said": {"scale": STATED, "fit": FIT, "appendix_c": APPENDIX_C, "next": NEXT[0].upper() + NEXT[1:]},
        "failed": analysis.draws.failed,
        "not_converged": analysis.draws.not_converged,
        "study_findings": [finding for finding in findings if finding.subject == ""],
        "before_pooling": check_answers(analysis.study, analysis.settings.prior),
        "pictures": pictures,
        "effects": facts.asymmetry.rows,
        "population": facts.asymmetry.population(),
        "asymmetry_notes": facts.asymmetry.notes,
        "level": LEVEL,
        "dominated": DOMINATED,
        "subjects": [_subject_context(analysis, facts, pictures, index, findings) for index in range(len(analysis.study))],
    }


def _subject_context(analysis: Analysis, facts: Facts, pictures: Pictures, index: int, findings: Sequence[Finding]) -> dict[str, Any]:
    counts = analysis.study.subjects[index]
    name = counts.name
    stats = analysis.draws.group("sample_stats").sel(subject=name)
    row = analysis.evidence[name]
    fitted = None if counts.isi is not None else analysis.fits[name]
    return {
        "anchor": f"subject-{index + 1}",
        "counts": counts,
        "parameters": _parameters(facts.summary[facts.summary["subject"] == name], fitted, analysis.fits.level),
        "curves": pictures.curves[name],
        "corner": pictures.corner[name],
        "shortfall": analysis.draws.not_converged.get(name, ""),
        "diagnostics": {
            "smallest effective sample size": f"{float(stats['min_ess']):.0f}",
            "largest R-hat": f"{float(stats['max_r_hat']):.4f}",
            "acceptance": f"{float(stats['acceptance_rate'].mean()):.2f}",
            "steps of each walker": _kept(analysis, int(stats["steps"]), int(stats["thin"])),
            "proposal efficiency": f"{row.efficiency:.2f}",
            "Pareto k-hat": f"{row.pareto_k:.2f}",
            **({} if fitted is None else {"maximum likelihood at an edge": fitted.at_edge or "no"}),
            **({} if row.fit is None else _fit(row.fit)),
        },
        "remarks": [finding.message for finding in findings if finding.subject == name] + list(row.notes),
        "row": row,
        "prior_dominated": prior_dominated(facts.summary, name),
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


def _data_uri(picture: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(picture).decode("ascii")
