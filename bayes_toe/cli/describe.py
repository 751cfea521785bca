"""Commands that need no posterior, check and fit, and what they print."""

from __future__ import annotations

from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import bayes_toe as bt
from bayes_toe.cli.options import NUMBER, StudyFile, rare, writes
from bayes_toe.cli.task import MODEL, Takes, Task
from bayes_toe.cli.terminal import Terminal, number, safe

if TYPE_CHECKING:
    from bayes_toe.classical.asymmetry import AsymmetryTable
    from bayes_toe.classical.fit import FitTable


def check(*, study: StudyFile, task: Annotated[Task, Takes("prior")]) -> None:
    """Check a study: what was read, its design, and its responses.

    [bold]Example[/bold]: bayes-toe check study.csv
    """
    from bayes_toe.checks.design_checks import NOTES, describe_design
    from bayes_toe.model.study_prior import preset_or_file

    prior, read = (
        preset_or_file(task.prior),
        study.read(),
    )  # whatever the stimuli are: what cannot be analysed is said here
    task.out.study(read)
    task.out.line(f"  prior: {safe(prior.describe_orders(read.task))}")
    share = f"fraction_{read.task.yes}"
    rows = [{**row, share: f"{row[share]:.3f}"} for row in map(describe_design, read)]
    task.out.table("subjects", rows)
    findings = bt.check(read, prior)
    warnings = [finding for finding in findings if finding.code not in NOTES]
    task.out.findings(warnings)
    task.out.findings((finding for finding in findings if finding.code in NOTES), "note")
    if not warnings:
        task.out.line("no warnings")


def fit(
    *,
    study: StudyFile,
    output: Annotated[Path, writes("FILE.csv", "Table.")] = Path("fit.csv"),
    replicates: Annotated[
        int,
        rare(
            "--replicates",
            min=1,
            max=10**6,
            metavar=NUMBER,
            help="Bootstrap replicates of each subject.",
        ),
    ] = 1000,
    level: Annotated[
        float, rare("--level", metavar=NUMBER, help="Coverage of the intervals.")
    ] = 0.95,
    asymmetry_output: Annotated[
        Path | None,
        typer.Option("--asymmetry", metavar="FILE.csv", help="Write the asymmetries, too."),
    ] = None,
    task: Annotated[Task, Takes(*MODEL, "spreadsheet_safe")],
) -> None:
    """Fit the paper's model by maximum likelihood; test asymmetries.

    [bold]Example[/bold]: bayes-toe fit study.csv -o fit.csv --seed 1
    """
    from bayes_toe.errors import require_share

    require_share("level", level)
    outputs = [output] if asymmetry_output is None else [output, asymmetry_output]
    task.require_files(*outputs)
    read, prior = task.read(study)
    asymmetries, why_none = None, ""
    try:
        asymmetries = bt.asymmetry(read)
    except bt.InputError as error:
        if asymmetry_output is not None:
            raise
        why_none = str(error)
    task.out.introduce(read, said=f"penalty: {prior.describe_penalty()}")
    table = task.work(
        "fitting", len(read), bt.fit, read, replicates=replicates, level=level, prior=prior
    )
    table.save(output, **task.saving_of(read))
    say_fits(task.out, table)
    if asymmetries is None:
        task.out.note(f"No test of asymmetry: {why_none}")
    else:
        say_asymmetry(task.out, asymmetries)
        if asymmetry_output is not None:
            asymmetries.save(asymmetry_output, **task.saving_of(read))
    task.done("table in", *outputs, seed=table.seed)


def say_asymmetry(out: Terminal, table: AsymmetryTable) -> None:
    """The largest asymmetry of each subject, and the counts over subjects."""
    rows: list[dict[Any, Any]] = []
    for row in table:
        shown: dict[Any, Any] = {
            "subject": row.subject,
            "comparisons": len(row.comparisons),
            "accuracy": f"{row.accuracy:.2f}",
        }
        one = row.maximal
        if one is not None:
            shown["maximal asymmetry"] = f"{one.asymmetry:+.2f} ± {one.asymmetry_se:.2f}"
            shown["at (r, c)"] = f"({one.s_weak:.3g}, {one.s_strong:.3g})"
            shown |= {"p": f"{one.p_value:.2g}", "p (Holm)": f"{one.p_adjusted:.2g}"}
            shown["P(q_cr > q_rc)"] = f"{one.probability_of_direction:.3f}"
        rows.append(shown)
    rows.sort(
        key=len, reverse=True
    )  # subjects without a comparison come last; the first row names the columns
    filled = [{**dict.fromkeys(rows[0], "-"), **row} for row in rows]
    out.table("asymmetry: q(c, r) - q(r, c), largest of each subject", filled)
    out.line(safe(table.population().describe()))
    for note in table.notes:
        out.note(note)


def say_fits(out: Terminal, table: FitTable) -> None:
    """Maximum-likelihood fits with their bootstrap intervals."""
    rows: list[dict[Any, Any]] = []
    for one in table:
        row: dict[Any, Any] = {"subject": one.subject}
        limits = one.bootstrap.intervals(table.level).tolist()
        for name, value, (low, high) in zip(
            one.fitted.names, one.parameters.tolist(), limits, strict=True
        ):
            row[name] = number(value) + (
                "" if isnan(value) or isnan(low) else f" ({low:.2f}, {high:.2f})"
            )
        rows.append({**row, "log likelihood": f"{one.log_likelihood:.2f}", "at edge": one.at_edge})
    title = f"maximum likelihood ({100 * table.level:g} % percentile intervals of {table.replicates} bootstrap replicates)"
    out.table(title, rows)
    out.notes(f"{one.subject}: {note}" for one in table for note in one.notes)
