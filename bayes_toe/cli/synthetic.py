"""Commands on data of known origin: simulate, calibrate; and the folder in which a calibration says what it found."""

from __future__ import annotations

import platform
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bayes_toe.cli.options import writes
from bayes_toe.cli.task import INCOMPLETE, WORKERS, Takes, Task
from bayes_toe.cli.terminal import number, safe, say, say_table

if TYPE_CHECKING:
    from rich.console import Console

    from bayes_toe.experiments.calibration_table import CalibrationTable, EvidenceRow

_OF_RANKS = ("calibration.csv", "calibration_ranks.csv", "calibration_ranks.png", "calibration_ranks.pdf")
_OF_EVIDENCE = (
    "evidence_calibration.csv",
    "evidence_data_sets.csv",
    "evidence_reliability.png",
    "evidence_reliability.pdf",
    "evidence_differences.png",
    "evidence_differences.pdf",
)
#: What the folder of a calibration may hold.
PRODUCTS = ("calibration.md", *_OF_RANKS, *_OF_EVIDENCE)


def simulate(  # each is a choice of its own, and has a default
    *,
    output: Annotated[Path, writes("STUDY.csv", "Trials to write.")],
    truth_output: Annotated[Path | None, typer.Option("--truth", metavar="truth.csv", help="Where to write the true parameters.")] = None,
    subjects: Annotated[int, typer.Option("--subjects", min=1, help="How many, unless --population names a file.")] = 16,
    batches: Annotated[int, typer.Option("--batches", min=1, help="Repetitions of the whole set of pairs.")] = 50,
    amplitudes: Annotated[str, typer.Option("--amplitudes", help="Stimuli in units of the reference, weakest first.")] = (
        "1,1.15,1.36,1.55,1.66"
    ),
    design: Annotated[
        str, typer.Option("--design", help="reference (the paper's), full (all ordered pairs), or a CSV with s1,s2 (and isi).")
    ] = "reference",
    isi: Annotated[str | None, typer.Option("--isi", help="Inter-stimulus intervals in seconds, e.g. 0.5,1,2: every pair at each.")] = None,
    population: Annotated[str, typer.Option("--population", help="paper, prior, or a CSV with subject,mu1,sigma_p,sigma_l,q0.")] = "paper",
    task: Annotated[Task, Takes("seed", "prior", "spreadsheet_safe", "overwrite")],
) -> None:
    """A synthetic study for any design, population and seed.

    [bold]Example[/bold]: bayes-toe simulate -o study.csv --truth truth.csv --subjects 8 --seed 1
    """
    from bayes_toe.data.tables import write_table
    from bayes_toe.experiments.simulate import design_from, population_from, simulate_trials, trial_frame, truth_frame
    from bayes_toe.model.study_prior import preset_or_file
    from bayes_toe.seeds import root_seed

    files = [output] if truth_output is None else [output, truth_output]
    task.require_files(*files)
    prior, seed = None if task.prior is None else preset_or_file(task.prior), root_seed(task.seed)
    pairs = design_from(design, amplitudes, batches, isi)
    names, observers = population_from(population, subjects, seed, pairs, prior=prior)
    trials = simulate_trials(names, observers, pairs, seed)
    with ExitStack() as places:  # one where both files are in one folder
        folders = {
            parent: places.enter_context(task.together(*(one for one in files if one.parent == parent)))
            for parent in {one.parent for one in files}
        }
        write_table(trial_frame(trials), folders[output.parent] / output.name, **task.saving)
        if truth_output is not None:
            write_table(truth_frame(names, observers), folders[truth_output.parent] / truth_output.name, **task.saving)
    total = sum(len(one.equal) for one in trials)
    task.say_written(f"{len(names)} synthetic subjects, {total} trials in", output, ending=f"; seed {seed}")


def calibrate(
    *,
    output: Annotated[Path, writes("DIR", "Folder for tables, figures and verdict.")],
    studies: Annotated[int, typer.Option("--studies", min=0, help="Studies a design for the ranks; 0 leaves them out.")] = 1000,
    data_sets: Annotated[int, typer.Option("--data-sets", min=0, help="Data sets a design for the evidence; 0 leaves it out.")] = 2000,
    task: Annotated[Task, Takes("seed", *WORKERS)],
) -> None:
    """Whether posteriors and evidences are calibrated, on simulated data of known origin.

    [bold]Example[/bold]: bayes-toe calibrate -o calibration --studies 200 --data-sets 0 --seed 1
    """
    from bayes_toe.experiments.calibration import Plan, simulate_and_analyse
    from bayes_toe.experiments.calibration_table import judge
    from bayes_toe.seeds import root_seed

    plan = Plan(studies, data_sets, root_seed(task.seed))
    task.require_folder(output, PRODUCTS)
    with task.progress("simulating and analysing", plan.total) as tick:
        table = judge(simulate_and_analyse(plan, workers=task.workers, progress=tick))
    write_calibration(table, output, overwrite=task.overwrite)
    say_calibration(task.console, table)
    task.say_written("results in", output, seed=plan.seed)
    if not table.passed:
        raise typer.Exit(INCOMPLETE)


def write_calibration(table: CalibrationTable, folder: str | Path, *, overwrite: bool = False) -> Path:
    """Write tables, figures (PNG and PDF) and calibration.md into `folder`, all or none.

    Raises
    ------
    OutputError
        If the folder cannot be written or holds products already; nothing is changed then.
    """
    from bayes_toe.data.tables import write_table
    from bayes_toe.data.whole_files import whole_folder
    from bayes_toe.plots.calibration import differences_figure, ranks_figure, reliability_figure
    from bayes_toe.plots.figure_files import save_figure

    required = ("calibration.md", *(_OF_RANKS if table.ranks else ()), *(_OF_EVIDENCE if table.evidence else ()))
    with whole_folder(folder, PRODUCTS, required=required, overwrite=overwrite) as target:
        (target / "calibration.md").write_text(_calibration_text(table) + "\n", encoding="utf-8")
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


def _calibration_text(table: CalibrationTable) -> str:
    """calibration.md: verdict, tables, figures, how it was made."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    from bayes_toe.experiments.calibration import DESIGNS, DRAWS
    from bayes_toe.experiments.calibration_statistics import MARGIN
    from bayes_toe.experiments.calibration_table import ABOUT, DEFAULT, FALSE_ALARM
    from bayes_toe.model.prior import Prior
    from bayes_toe.version import library_versions

    environment = Environment(loader=PackageLoader("bayes_toe", "cli"), undefined=StrictUndefined, trim_blocks=True)
    environment.filters.update(number=number, wrong=_wrong)
    return environment.get_template("calibration.md").render(
        table=table,
        plan=table.outcome.plan,
        verdict=verdict_lines(table),
        prior=Prior().describe(),
        designs=" and ".join(f"{name} ({batches} batches)" for name, batches in DESIGNS.items()),
        draws=DRAWS,
        about=ABOUT,
        default=DEFAULT,
        false_alarm=f"{FALSE_ALARM:g}",
        margin=f"{MARGIN:g}",
        python=platform.python_version(),
        versions=", ".join(map(" ".join, library_versions().items())),
    )


def _wrong(row: EvidenceRow) -> str:
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


def say_calibration(console: Console, table: CalibrationTable) -> None:
    """Verdicts on ranks and on evidence estimators, then all in words."""
    ranks: list[dict[Any, Any]] = [
        {
            "quantity": row.quantity,
            "design": row.design,
            "largest difference": f"{row.largest_difference:+.3f}",
            "p": f"{row.p_value:.2g}",
            "verdict": "inside" if row.inside else "OUTSIDE",
        }
        for row in table.ranks
    ]
    if ranks:
        say_table(console, f"ranks of true values: outside where p < {table.ranks[0].threshold:.2g}", ranks)
    rows: list[dict[Any, Any]] = [
        {
            "estimator": row.estimator,
            "design": row.design,
            "none": row.missing_h1 + row.missing_h0,
            "ECE": number(getattr(row.judged, "error", None), 4),
            "floor": number(getattr(row.judged, "floor", None), 4),
            "log score": number(getattr(row.judged, "log_score", None), 4),
            "median shift": number(row.median_shift, 3),
            "largest shift": number(row.largest_shift),
        }
        for row in table.evidence
    ]
    if rows:
        say_table(console, "probability of H1: calibration error, and shift of the log Bayes factor against the default", rows)
    for line in verdict_lines(table):
        say(console, safe(line), "red" if line.startswith("NOT") else None)


def verdict_lines(table: CalibrationTable) -> list[str]:
    """The verdict in a few lines: what failed, or that nothing did; what did not converge; what was withheld."""
    from bayes_toe.experiments.calibration_statistics import MARGIN
    from bayes_toe.experiments.calibration_table import DEFAULT, FALSE_ALARM

    lines = [f"NOT calibrated: {failure}" for failure in table.failures]
    if table.ranks:
        inside = sum(row.inside for row in table.ranks)
        lines.append(f"ranks: {inside} of {len(table.ranks)} inside their bands (all of them with {100 * (1 - FALSE_ALARM):g} % if right)")
    for row in (row for row in table.evidence if row.estimator == DEFAULT):
        found = "the default estimator gives no number"
        if row.judged is not None:
            verdict = "calibrated" if row.calibrated else "NOT calibrated"
            found = f"{verdict}, ECE {row.judged.error:.4f}, floor {row.judged.floor:.4f}, allowed {MARGIN:g} more"
        lines.append(f"evidence, {row.design} design: {found}")
    if table.ranks:
        missed = table.not_converged
        named = f": {', '.join(missed)}" if missed else ""
        lines.append(f"not converged, ranked with the others: {len(missed)} of {len(table.outcome.ranks)} studies{named}")
    if table.withheld:
        lines.append(f"evidence withheld by the default estimator: {', '.join(table.withheld)}")
    return lines
