"""The report of one analysis: a single HTML file that needs nothing else; of very many subjects an index with a page for each of them."""

from __future__ import annotations

import base64
import json
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
from bayes_toe.cli.digits import allowed, allowed_quantiles
from bayes_toe.cli.glossary import TERMS, anchor, linked
from bayes_toe.cli.headline import APPENDIX_C, FIT, NEXT, deviance, in_short, misfit, misfits, p_value, scale_first, tally
from bayes_toe.comparison.evidence_table import SubjectEvidence
from bayes_toe.comparison.presets import say_presets
from bayes_toe.comparison.words import STATED, conclusion, order_effect, order_effect_and_probability
from bayes_toe.data.messages import visible
from bayes_toe.data.study import said_intervals
from bayes_toe.data.tables import file_stems
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
_REPORT = "../report.html"  # from a subject's page
#: What may stand in the results folder, in the order of the list; what does not is not listed.
_FILES = {
    "explorer.html": "posteriors to drag over, in a browser",
    "summary.csv": "quantiles, moments and diagnostics of every parameter",
    "evidence.csv": "order effect, fit and evidence of every subject",
    "population.csv": "the group",
    "population_subjects.csv": "each subject alone and in the group",
    "population.nc": "draws of the group, for `explore --population` and `methods`",
    "population.png": "the group's figure",
    "corner": "corner plots, one a subject",
    "posterior.nc": "all draws, for ArviZ, explore, corner, predict and figures",
    "posterior.zarr": "all draws, for ArviZ, explore, corner, predict and figures",
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


@dataclass(frozen=True)
class Pictures:
    """Where the PNG figures of a report are, to be read one at a time.

    Attributes
    ----------
    place : Path
        Folder of order_effect.png, evidence.png, asymmetry.png (may be missing), map.png and prior.png.
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
    context = _context(analysis, facts, pictures, links) | _places(paged, folder) | {"most": _MOST_LISTED if paged else None}
    context["contents"] = _contents(context)
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
    made.filters.update(order_effect=order_effect_and_probability, head=_head, kind=order_effect, linked=linked, anchor=anchor)
    return made


def _write(template: Template, context: Mapping[str, Any], path: Path) -> None:
    """Piece by piece: with its pictures a report may be larger than memory."""
    with path.open("w", encoding="utf-8") as file:
        file.writelines(template.generate(context))


def _links(names: Sequence[str], paged: bool) -> dict[str, str]:
    """Where each subject is found from the report: on its page, or below."""
    stems = file_stems(names) if paged else {}
    return {name: f"subjects/{stems[name]}.html" if paged else f"#subject-{i + 1}" for i, name in enumerate(names)}


def _places(paged: bool, folder: Path) -> dict[str, Any]:
    """What stands in the results folder, and where a subject's section finds that and the report."""
    written = {name: words for name, words in _FILES.items() if (folder / name).exists()}
    posterior = next((name for name in written if name.startswith("posterior")), "posterior.nc")
    return {"paged": paged, "written": written, "posterior": posterior, "home": _REPORT if paged else "", "beside": "../" if paged else ""}


def _contents(context: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Anchors of the sections that there are, and what the list of contents calls them."""
    sections = {
        "read": "How to read this",
        "evidence": "Order effect, fit, evidence",
        "order": "Without a model",
        "map": "Map",
        "group": "The group" if context["group"] else "",
        "appendix-c": "Appendix C",
        "pooling": "Before pooling" if context["before_pooling"] else "",
        "subjects": "" if context["paged"] else "Subjects",
        "prior": "Prior",
        "method": "Method and settings",
        "files": "Files",
    }
    return [(place, words) for place, words in sections.items() if words]


def _settings(attrs: Mapping[str, Any], prior: str) -> dict[str, str]:
    """What was asked for, and with what it was computed."""
    settings, versions = json.loads(attrs["settings"]), json.loads(attrs["versions"])
    return {
        "model": settings["model"],
        "prior": prior,
        "seed": str(attrs["seed"]),
        **{_SAMPLER.get(key, key): str(value) for key, value in settings["sampler"].items()},
        "versions": ", ".join(f"{name} {version}" for name, version in versions.items()),
    }


def _context(analysis: Analysis, facts: Facts, pictures: Pictures, links: Mapping[str, str]) -> dict[str, Any]:
    """What does not depend on a subject."""
    prior, table = analysis.settings.prior, analysis.evidence
    findings, first = check_study(analysis.study, prior), scale_first(analysis.study, prior)
    following = first + NEXT
    return {
        "study": analysis.study,
        "reference": f"{prior.reference_interval or 1.0:g} s",
        "intervals": said_intervals(analysis.study.intervals) if analysis.study.intervals else "",
        "attrs": analysis.draws.attrs,
        "rows": table.rows,
        "in_short": first + in_short(table, synthetic=analysis.study.synthetic, presets=analysis.presets),
        "terms": TERMS,
        "settings": _settings(analysis.draws.attrs, prior.describe_orders()),
        "tally": tally(table),
        "misfits": misfits(table),
        "presets": say_presets(analysis.presets),
        "said": {"scale": STATED, "fit": FIT, "appendix_c": APPENDIX_C, "next": following[0].upper() + following[1:], "flagged": FLAGGED},
        "failed": analysis.draws.failed,
        "not_converged": analysis.draws.not_converged,
        "findings": findings,
        "study_findings": [finding for finding in findings if finding.subject == ""],
        "before_pooling": check_answers(analysis.study, prior),
        "pictures": pictures,
        "drawn": len(pictures.corner),
        "asymmetry_drawn": pictures.of_study("asymmetry").exists(),
        "population": facts.asymmetry.population(),
        "asymmetry_notes": facts.asymmetry.notes,
        "level": LEVEL,
        "dominated": DOMINATED,
        "links": links,
        "crowded": len(analysis.study) > MOST_NAMED,
        "flagged": facts.flagged,
        "group": facts.group,
        "index": _index(analysis, facts),
    }


def _index(analysis: Analysis, facts: Facts) -> list[tuple[SubjectEvidence, SubjectAsymmetry]]:
    """Rows of the table of subjects in the order of the study; of very many, those first who must be looked at."""
    rows = list(zip(analysis.evidence, facts.asymmetry, strict=True))
    return sorted(rows, key=lambda row: len(rows) > MOST_IN_ONE and row[0].subject not in facts.flagged)


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
            "numbers": [
                ("order effect", _orders(row)),
                ("without a model", _asymmetry(effect)),
                ("fit of H1", {} if row.fit is None else _fit(row.fit)),
                ("H1 against H0", _evidences(row)),
                ("sampling", _diagnostics(analysis, stats.isel(subject=i), row, fitted)),
            ],
            "remarks": [*messages[name], *row.notes],
            "moved": moved.get(name, ""),
            "row": row,
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
        "Pareto k-hat": _number(row.pareto_k),
        **({} if fitted is None else {"maximum likelihood at an edge": fitted.at_edge or "no"}),
    }


def _orders(row: SubjectEvidence) -> dict[str, str]:
    shares = {"P(none)": row.p_none, "P(constant error)": row.p_constant_error, "P(update)": row.p_update}
    return {key: _number(value) for key, value in shares.items()}


def _asymmetry(effect: SubjectAsymmetry) -> dict[str, str]:
    one = effect.maximal
    largest = {} if one is None else {
        "largest asymmetry": f"{_signed(one.asymmetry)} ± {_number(one.asymmetry_se)}",
        "at (r, c)": f"({one.s_weak:.3g}, {one.s_strong:.3g})".replace("-", "−"),
        "p, exact": p_value(one.p_value),
        "p, Holm": p_value(one.p_adjusted),
    }  # fmt: skip
    return {"accuracy": _number(effect.accuracy), **largest}


def _evidences(row: SubjectEvidence) -> dict[str, str]:
    """Evidences, then their approximations."""
    error = "" if row.log_evidence_h1_se is None else f" ± {_number(row.log_evidence_h1_se, 4)}"
    return {
        "log Bayes factor": f"{_number(row.log_bayes_factor)} ({conclusion(row.log_bayes_factor)})",
        "log evidence, H1": f"{_number(row.log_evidence_h1)}{error}",
        "log evidence, H0": _number(row.log_evidence_h0),
        "log Bayes factor, Laplace": _number(row.log_bayes_factor_laplace),
        "H1, Laplace": _number(row.log_evidence_h1_laplace),
        "H0, Laplace": _number(row.log_evidence_h0_laplace),
        "H1, Laplace, paper's coordinates": _number(row.log_evidence_h1_laplace_natural),
        "H1, bootstrap": _number(row.log_evidence_h1_bootstrap),
    }


def _parameters(summary: pd.DataFrame, fit: SubjectFit | None, level: float) -> list[dict[str, Any]]:
    """Rows of the parameter table: the posterior's summary and, for natural parameters, the fit (if any) with its bootstrap interval."""
    natural = {} if fit is None else dict(zip(NATURAL, zip(fit.parameters, fit.bootstrap.intervals(level), strict=True), strict=True))
    rows = []
    for row in summary.to_dict("records"):
        best, (lower, upper) = natural.get(row["parameter"], (None, (None, None)))
        quantiles = [text.replace("-", "−") for text in allowed_quantiles(row, 3)]
        fitted = {"fit": best, "fit_lower": lower, "fit_upper": upper}
        rows.append({**{str(key): value for key, value in row.items()}, "quantiles": quantiles, **fitted})
    return rows


def _fit(fit: FitSummary) -> dict[str, str]:
    interval = "" if fit.worst_isi is None else f" at {fit.worst_isi:g} s"
    return {
        "deviance (d.f.)": deviance(fit),
        "p of the deviance": "–" if np.isnan(fit.p_deviance) else p_value(fit.p_deviance),
        "predictive p": p_value(fit.p_overall),
        "predictive p, worst pair": p_value(fit.worst_p),
        "worst pair (s1, s2)": f"({fit.worst_s1:.3g}, {fit.worst_s2:.3g})".replace("-", "−") + interval,
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
