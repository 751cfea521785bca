"""A calibration run as a folder: tables, figures, and the verdict in words."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from pathlib import Path

from bayes_toe.data.tables import write_table
from bayes_toe.data.whole_folders import whole_folder
from bayes_toe.experiments.calibration import DESIGNS, DRAWS
from bayes_toe.experiments.calibration_table import ABOUT, DEFAULT, FALSE_ALARM, CalibrationTable, EvidenceRow, RankRow
from bayes_toe.experiments.reliability import MARGIN
from bayes_toe.model.prior import Prior
from bayes_toe.plots.calibration import differences_figure, ranks_figure, reliability_figure
from bayes_toe.plots.figure_files import save_figure
from bayes_toe.version import library_versions

_OF_RANKS = ("calibration.csv", "calibration_ranks.csv", "calibration_ranks.png", "calibration_ranks.pdf")
_OF_EVIDENCE = (
    "evidence_calibration.csv",
    "evidence_data_sets.csv",
    "evidence_reliability.png",
    "evidence_reliability.pdf",
    "evidence_differences.png",
    "evidence_differences.pdf",
)
#: What the folder may hold.
PRODUCTS = ("calibration.md", *_OF_RANKS, *_OF_EVIDENCE)


def write_calibration(table: CalibrationTable, folder: str | Path, *, overwrite: bool = False) -> Path:
    """Write tables, figures (PNG and PDF) and calibration.md into `folder`, all or none.

    Raises
    ------
    OutputError
        If the folder cannot be written or holds products already; nothing is changed then.
    """
    required = ("calibration.md", *(_OF_RANKS if table.ranks else ()), *(_OF_EVIDENCE if table.evidence else ()))
    with whole_folder(folder, PRODUCTS, required=required, overwrite=overwrite) as target:
        (target / "calibration.md").write_text(calibration_text(table), encoding="utf-8")
        figures = {}
        if table.ranks:
            write_table(table.rank_frame(), target / "calibration.csv")
            write_table(table.subject_ranks_frame(), target / "calibration_ranks.csv")
            figures["calibration_ranks"] = ranks_figure(table)
        if table.evidence:
            write_table(table.evidence_frame(), target / "evidence_calibration.csv")
            write_table(table.data_sets_frame(), target / "evidence_data_sets.csv")
            figures["evidence_reliability"] = reliability_figure(table)
            figures["evidence_differences"] = differences_figure(table)
        for stem, figure in figures.items():
            for suffix in ("png", "pdf"):
                save_figure(figure, target / f"{stem}.{suffix}")
    return Path(folder)


def verdict_lines(table: CalibrationTable) -> list[str]:
    """The verdict in a few lines: what failed, or that nothing did; what did not converge; what was withheld."""
    lines = [f"NOT calibrated: {failure}" for failure in table.failures]
    if table.ranks:
        inside = sum(row.inside for row in table.ranks)
        lines.append(f"ranks: {inside} of {len(table.ranks)} inside their bands (all of them with {100 * (1 - FALSE_ALARM):g} % if right)")
    lines += [_evidence_line(row) for row in table.evidence if row.estimator == DEFAULT]
    missed = table.not_converged
    if table.ranks:
        named = f": {', '.join(missed)}" if missed else ""
        lines.append(f"not converged, ranked with the others: {len(missed)} of {len(table.outcome.ranks)} studies{named}")
    if table.withheld:
        lines.append(f"evidence withheld by the default estimator: {', '.join(table.withheld)}")
    return lines


def calibration_text(table: CalibrationTable) -> str:
    """calibration.md: verdict, tables, figures, how it was made."""
    plan = table.outcome.plan
    parts = ["# Calibration", "", *(f"* {line}" for line in verdict_lines(table)), ""]
    if table.ranks:
        parts += _rank_section(table)
    if table.evidence:
        parts += _evidence_section(table)
    versions = ", ".join(map(" ".join, library_versions().items()))
    command = f"bayes-toe calibrate -o DIR --studies {plan.studies} --data-sets {plan.data_sets} --seed {plan.seed}"
    parts += ["## To make it again", "", f"`{command}`; this one with Python {platform.python_version()}, {versions}.", ""]
    return "\n".join(parts)


def _rank_section(table: CalibrationTable) -> list[str]:
    designs = " and ".join(f"{name} ({batches} batches)" for name, batches in DESIGNS.items())
    return [
        "## Posteriors",
        "",
        f"Observers are drawn from the prior ({Prior().describe()}), answer the paper's 13 pairs in the designs {designs}, and are "
        f"analysed as `bayes-toe sample --draws {DRAWS}` does. Each true value is ranked among the last stored draws of all walkers (256 "
        "that are as good as independent); ties and the place within a rank are drawn at random, so that ranks are uniform on 0..1 where "
        "everything is right, from the trials to the stored draws. The p-value is that of the largest deviation of their distribution "
        "function at 1/100 to 99/100, exact for all points at once (Sailynoja, Buerkner and Vehtari 2022). A quantity is outside where it "
        f"falls below {FALSE_ALARM:g} shared among all quantities and designs (Bonferroni).",
        "",
        "![Ranks](calibration_ranks.png)",
        "",
        *_table(
            ("design", "quantity", "studies", "not converged", "largest difference", "at", "p", "verdict"),
            [_rank_cells(row) for row in table.ranks],
        ),
        "",
    ]


def _rank_cells(row: RankRow) -> list[str]:
    difference, at = f"{row.largest_difference:+.3f}", f"{row.at:.2f}"
    verdict = "inside" if row.inside else "**outside**"
    return [row.design, row.quantity, str(row.studies), str(row.not_converged), difference, at, f"{row.p_value:.2g}", verdict]


def _evidence_section(table: CalibrationTable) -> list[str]:
    scores = ("ECE", "floor", "p", "Brier", "log score", "default's", "median shift", "largest shift")
    heads = ("design", "estimator", "none (H1, H0)", *scores)
    return [
        "## Evidence",
        "",
        "Data sets come from H1 (observers drawn from the prior) or from H0 (a uniform frequency for each pair), with probability one "
        "half each. ECE is the expected calibration error of P(H1 | data) over ten bins; its floor is the mean that right probabilities "
        "would show, by simulation, and p the share of those simulations with an error as large. Calibrated: at most "
        f"{MARGIN:g} above the floor. The scores are means, smaller is better; `default's` is the log score of the default estimator on "
        "the same data sets. Shifts are those of the log Bayes factor against the default estimator's, nats. `none` counts data sets for "
        "which there is no number; the rest of the row is about the others.",
        "",
        *(f"* {name}: {about}" for name, about in ABOUT.items()),
        "",
        "![Reliability](evidence_reliability.png)",
        "",
        "![Differences](evidence_differences.png)",
        "",
        *_table(heads, [_evidence_cells(row) for row in table.evidence]),
        "",
        *[f"* {_unsure_line(row)}" for row in table.evidence if row.estimator == DEFAULT and row.judged is not None],
        "",
        "What the other estimators get wrong:",
        "",
        *[f"* {wrong_line(row)}" for row in table.evidence if row.estimator != DEFAULT],
        "",
    ]


def _evidence_cells(row: EvidenceRow) -> list[str]:
    name = f"**{row.estimator}**" if row.estimator == DEFAULT else row.estimator
    missing = f"{row.missing_h1}, {row.missing_h0} of {row.data_sets}"
    if row.judged is None:
        return [row.design, name, missing, *8 * ["-"]]
    one = row.judged
    errors, scores = (one.error, one.floor), (one.brier, one.log_score, row.log_score_default)
    shifts = (row.median_shift, row.largest_shift)
    cells = [*(_number(value, 4) for value in errors), f"{one.p_value:.2g}", *(_number(value, 4) for value in scores)]
    return [row.design, name, missing, *cells, *(_number(value, 2) for value in shifts)]


def _evidence_line(row: EvidenceRow) -> str:
    if row.judged is None:
        return f"evidence, {row.design} design: the default estimator gives no number"
    verdict = "calibrated" if row.calibrated else "NOT calibrated"
    return f"evidence, {row.design} design: {verdict}, ECE {row.judged.error:.4f}, floor {row.judged.floor:.4f}, allowed {MARGIN:g} more"


def _unsure_line(row: EvidenceRow) -> str:
    share = 0.0 if row.judged is None else row.judged.unsure
    return f"In the {row.design} design {100 * share:.1f} % of the probabilities lie between 0.02 and 0.98; only these can be off by much."


def wrong_line(row: EvidenceRow) -> str:
    """What an estimator other than the default gets wrong in one design, in words."""
    about = f"{row.estimator}, {row.design} design: "
    missing = row.missing_h1 + row.missing_h0
    if row.judged is None or row.median_shift is None or row.largest_shift is None:
        return f"{about}no number for any of {row.data_sets} data sets."
    found = f"no number for {missing} of {row.data_sets} data sets; " if missing else ""
    toward = "toward H1" if row.median_shift > 0 else "toward H0"
    off = f"the log Bayes factor is off by a median of {row.median_shift:+.2f} nats ({toward}), at most {row.largest_shift:+.1f}"
    error = "" if row.calibrated else f"; probabilities are not calibrated (ECE {row.judged.error:.3f}, floor {row.judged.floor:.3f})"
    return f"{about}{found}{off}{error}."


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(cells)} |" for cells in (heads, ["---"] * len(heads), *rows)]
