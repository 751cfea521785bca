"""The report: machine, ratios, tables, what failed, how to read it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from speed import ensembles, nested, numpyro_models, pymc_models, ratios
from speed.cases import HARD, ORDINARY
from speed.methods import GLOBAL
from speed.race import NOT_RUN, OK, Rules
from speed.summary import common_subjects, medians

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class Report:
    """Everything that one run of the program knows."""

    table: pd.DataFrame
    sizes: pd.DataFrame
    rules: Rules
    command: str
    processor: str
    threads: str
    versions: dict[str, str]
    without_reference: Sequence[str]
    minutes: float


def text(report: Report) -> str:
    """The whole Markdown file."""
    parts = (_opening, _machine, _ratios, _efficiency, _evidence, _kinds, _one_by_one, _troubles, _sizes, _reading)
    return "\n".join(line for part in parts for line in part(report)) + "\n"


def _opening(report: Report) -> Iterator[str]:
    yield from (
        "# Speed against error",
        "",
        "Every method on the same subjects, in one run, on one machine, against deterministic integration"
        " ([tests/reference](../tests/reference/README.md)). Times of one run of one subject; what compiles does so apart."
        " No row is left out because it looks bad; what failed or was not run is listed with its reason.",
        "",
        "![Wall time against error, per method](speed_vs_error.png)",
        "",
        "Large markers: medians over the subjects on which every method ran; a line joins the efforts of one method; faint markers: single"
        " subjects. Lower and further left is better. Every number is in [speed_vs_error.csv](speed_vs_error.csv)"
        " ([figure as SVG](speed_vs_error.svg)).",
        "",
    )


def _machine(report: Report) -> Iterator[str]:
    yield from ("## Machine, versions, seed, command", "")
    yield from (f"- Processor: {report.processor}; {report.threads}.",)
    yield "- " + ", ".join(f"{name} {version}" for name, version in report.versions.items()) + "."
    yield f"- Root seed {report.rules.seed}; every run has a stream of its own. The whole took {report.minutes:.0f} minutes."
    subjects = {kind: list(dict.fromkeys(report.table[report.table.kind == kind].subject)) for kind in (ORDINARY, HARD)}
    yield f"- Ordinary subjects (bundled, synthetic): {_listed(subjects[ORDINARY])}. Hard cases: {_listed(subjects[HARD])}."
    ran = report.table[(report.table.kind == HARD) & report.table.method.isin(_peers(report)) & (report.table.status != NOT_RUN)]
    yield f"- Other libraries ran on these hard cases only: {_listed(dict.fromkeys(ran.subject))}. Hard cases have half the runs."
    if report.without_reference:
        yield f"- Not run, because no reference is stored yet: {_listed(report.without_reference)}."
    yield from ("", "```sh", 'pip install -e ".[peers]"', report.command, "```", "")


def _ratios(report: Report) -> Iterator[str]:
    yield from (
        "## Ratios",
        "",
        "Effective draws per second of the global move (worst of mu1, sigma_p, sigma_l, q0; time from the counts to the draws, fitting"
        " included) over those of each other sampler at the effort that suits it best, subject by subject; medians over subjects."
        " *Claimed*: bulk ESS as ArviZ estimates it (weights' ESS of nested and importance sampling). *True*: from the distance of"
        " independent chains' means from the reference. *Spread*: from the variance of those means about their own average, which"
        " does not see what all chains get wrong alike.",
        "",
    )
    efforts = sorted({int(effort) for effort in report.table[report.table.method == GLOBAL].effort})
    headline = ratios.HEADLINE // report.rules.shrink
    for kind, title in ((ORDINARY, "ordinary subjects"), (HARD, "hard cases")):
        found = list(ratios.ratios(report.table, kind, headline))
        yield from (f"### {title.capitalize()}, {headline:,} effective draws asked for", "")
        yield from _grid(
            ("rival", "asked", "claimed", "worst", "", "true", "worst", "", "spread", "asked", "", "subjects"),
            (_ratio_row(*three) for three in zip(*[iter(found)] * len(ratios.MEASURES), strict=True)),
        )
    yield from ("### Median of the true ratio on ordinary subjects, by effort of the global move", "")
    columns = [[r for r in ratios.ratios(report.table, ORDINARY, effort) if r.by == "true"] for effort in efforts]
    head = ("rival", *(f"{effort:,} draws" for effort in efforts))
    yield from _grid(head, ((row[0].rival, *(_times(one.median) for one in row)) for row in zip(*columns, strict=True)))


def _ratio_row(claimed: ratios.Ratio, true: ratios.Ratio, spread: ratios.Ratio) -> tuple[object, ...]:
    told = [cell for one in (claimed, true) for cell in (_times(one.median), _times(one.worst), one.verdict)]
    return claimed.rival, _bar(claimed.bar), *told, _times(spread.median), _bar(spread.bar), spread.verdict, claimed.subjects


def _efficiency(report: Report) -> Iterator[str]:
    yield from ("## Effective draws per likelihood evaluation, ordinary subjects", "")
    yield "Asked: at least 0.5. *After fitting* counts the evaluations of sampling alone; *all* those of maximum and fit too."
    yield ""
    found = medians(report.table, common_subjects(report.table, ORDINARY))
    chosen = found[found.claimed_ess_per_sampling_evaluation.notna() | found.claimed_ess_per_evaluation.notna()]
    yield from _grid(
        ("method", "effort", "after fitting (claimed)", "all (claimed)", "all (true)"),
        (
            (
                f"{row.method} ({row.coordinates})",
                f"{row.effort:,} {row.effort_unit}",
                _number(row.claimed_ess_per_sampling_evaluation),
                _number(row.claimed_ess_per_evaluation),
                _number(row.true_ess_per_evaluation),
            )
            for row in chosen.itertuples()
        ),
    )


def _evidence(report: Report) -> Iterator[str]:
    yield from ("## Log evidence, ordinary subjects", "")
    yield "Asked of importance sampling: a standard error of at most 0.005 nat in under 0.1 s a subject. Wall time from the counts on."
    yield ""
    found = medians(report.table, common_subjects(report.table, ORDINARY))
    rows = (
        (
            f"{row.method} ({row.coordinates})",
            f"{row.effort:,} {row.effort_unit}",
            *(_number(value) for value in (row.wall_s, row.log_evidence_error, row.log_evidence_se)),
        )
        for row in found[found.log_evidence_error.notna()].itertuples()
    )
    yield from _grid(("method", "effort", "wall (s)", "error (nats)", "its claimed s.e."), rows)


def _kinds(report: Report) -> Iterator[str]:
    for kind, title in ((ORDINARY, "Ordinary subjects"), (HARD, "Hard cases")):
        subjects = common_subjects(report.table, kind)
        yield from (f"## {title}: medians over {len(subjects)}", "")
        yield from (f"Subjects on which every method was run: {_listed(subjects)}.", "")
        head = ("method", "effort", "solved", "says converged", "wall (s)", "compile (s)", "claimed ESS", "true ESS")
        head += ("claimed ESS/s", "true ESS/s", "divergences", "worst error (sd)", "log evidence error", "its claimed s.e.")
        yield from _grid(head, (_medians_row(row, len(subjects)) for row in medians(report.table, subjects).itertuples()))


def _medians_row(row: object, subjects: int) -> tuple[object, ...]:
    value = row._asdict()  # type: ignore[attr-defined]
    keys = ("wall_s", "compile_s", "claimed_ess", "true_ess", "claimed_ess_per_s", "true_ess_per_s", "divergences", "error_worst")
    numbers = (_number(value[key]) for key in (*keys, "log_evidence_error", "log_evidence_se"))
    name = f"{value['method']} ({value['coordinates']})"
    return (
        name,
        f"{value['effort']:,} {value['effort_unit']}",
        f"{value['solved']}/{subjects}",
        f"{value['content']}/{subjects}",
        *numbers,
    )


def _one_by_one(report: Report) -> Iterator[str]:
    yield from (
        "## Hard cases one by one: worst standardised error at the largest effort",
        "",
        "In posterior standard deviations. `*`: at least one run said itself that it had not converged. `-`: not run.",
        "",
    )
    hard = report.table[report.table.kind == HARD]
    peers = _peers(report)
    for ours in (True, False):
        part = hard[hard.method.isin(peers) != ours]
        part = part if ours else part[part.subject.isin(part[part.status != NOT_RUN].subject)]
        if not len(part):
            continue
        columns = list(dict.fromkeys(zip(part.method, part.coordinates, strict=True)))
        rows = ((name, *(_cell(part, str(name), *column) for column in columns)) for name in dict.fromkeys(part.subject))
        yield from _grid(("case", *(f"{method} ({coordinates})" for method, coordinates in columns)), rows)


def _cell(part: pd.DataFrame, subject: str, method: str, coordinates: str) -> str:
    rows = part[(part.subject == subject) & (part.method == method) & (part.coordinates == coordinates)]
    row = rows.sort_values("effort").iloc[-1]
    if not row.runs:
        return "-" if row.status == NOT_RUN else str(row.status)
    return _number(row.error_worst) + ("" if row.converged == 1.0 else "*")


def _troubles(report: Report) -> Iterator[str]:
    yield from ("## What failed, has no result, or was not run", "")
    bad = report.table[report.table.status != OK]
    groups = bad.groupby(["method", "coordinates", "status", "reason"], sort=False).subject.unique()
    rows = [(f"{m} ({c})", status, reason, _listed(names)) for (m, c, status, reason), names in groups.items()]
    yield from _grid(("method", "status", "reason", "subjects"), rows) if rows else ("Nothing.", "")


def _sizes(report: Report) -> Iterator[str]:
    yield from (
        "## Cost grows with distinct pairs, not with trials",
        "",
        "The whole route (maximum, fit, ensembles for 4,000 effective draws) on one ordinary observer.",
        "",
        "![Wall time against distinct pairs and against trials](speed_scaling.png)",
        "",
    )
    head = (
        "pairs",
        "trials",
        "total (s)",
        "maximum",
        "fit",
        "ensembles",
        "evaluations",
        "ns per evaluation and pair",
        "smallest ESS",
        "converged",
    )
    keys = ("total_s", "maxima_s", "fit_s", "chains_s")
    yield from _grid(
        head,
        (
            (
                f"{row.pairs:,}",
                f"{row.trials:,}",
                *(_number(getattr(row, key)) for key in keys),
                f"{row.evaluations:,.0f}",
                _number(row.ns_per_evaluation_and_pair),
                _number(row.smallest_ess),
                "yes" if row.converged == 1.0 else f"{row.converged:.0%} of runs",
            )
            for row in report.sizes.itertuples()
        ),
    )
    yield from ("All sizes are in [speed_scaling.csv](speed_scaling.csv).", "")


def _reading(report: Report) -> Iterator[str]:
    template = Path(__file__).with_name("reading.md").read_text(encoding="utf-8")
    yield template.rstrip().format(
        ensembles=ensembles.ENSEMBLES,
        walkers=ensembles.WALKERS,
        many=ensembles.MANY_WALKERS,
        nutpie_chains=pymc_models.CHAIN_COUNT,
        numpyro_chains=numpyro_models.CHAIN_COUNT,
        warm_up=numpyro_models.WARM_UP,
        calls=nested.MAX_CALLS,
        live=nested.LIVE,
        networks=nested.NETWORKS,
        patience=report.rules.patience_s,
    )


def _peers(report: Report) -> set[str]:
    from speed.methods import METHODS

    return {method.name for method in METHODS if method.library}


def _grid(head: Sequence[str], rows: Iterable[Sequence[object]]) -> Iterator[str]:
    """A Markdown table and an empty line."""
    yield "| " + " | ".join(head) + " |"
    yield "|" + " --- |" * len(head)
    for row in rows:
        yield "| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |"
    yield ""


def _listed(names: Iterable[object]) -> str:
    return ", ".join(map(str, names)) or "none"


def _number(value: float | None) -> str:
    """Three significant digits, thousands with a comma, nothing where there is no number."""
    if value is None or np.isnan(value):
        return ""
    if value == 0.0 or not np.isfinite(value):
        return f"{value:g}"
    if abs(value) >= 100.0:
        return f"{value:,.0f}" if abs(value) < 1e6 else f"{value:.1e}"
    return f"{value:.3g}"


def _times(value: float) -> str:
    return "" if np.isnan(value) else f"{_number(value)}x"


def _bar(bar: float | None) -> str:
    return "" if bar is None else f"{bar:g}x"
