"""Commands on data of known origin: simulate, calibrate."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from bayes_toe.cli import summaries
from bayes_toe.cli.options import PriorFile, Seed, writes
from bayes_toe.cli.task import INCOMPLETE, SharedTask, TableTask


@dataclass(frozen=True, kw_only=True)
class SimulatingTask(TableTask):
    """Design and population of a synthetic study."""

    subjects: Annotated[int, typer.Option("--subjects", min=1, help="How many, unless --population names a file.")] = 16
    batches: Annotated[int, typer.Option("--batches", min=1, help="Repetitions of the whole set of pairs.")] = 50
    amplitudes: Annotated[str, typer.Option("--amplitudes", help="Stimuli in units of the reference, weakest first.")] = (
        "1,1.15,1.36,1.55,1.66"
    )
    design: Annotated[
        str, typer.Option("--design", help="reference (the paper's), full (all ordered pairs), or a CSV with s1,s2 (and isi).")
    ] = "reference"
    isi: Annotated[str | None, typer.Option("--isi", help="Inter-stimulus intervals in seconds, e.g. 0.5,1,2: every pair at each.")] = None
    population: Annotated[str, typer.Option("--population", help="paper, prior, or a CSV with subject,mu1,sigma_p,sigma_l,q0.")] = "paper"
    seed: Seed = None
    prior: PriorFile = None


def simulate(
    *,
    output: Annotated[Path, writes("STUDY.csv", "Trials to write.")],
    truth_output: Annotated[Path | None, typer.Option("--truth", metavar="truth.csv", help="Where to write the true parameters.")] = None,
    task: SimulatingTask,
) -> None:
    """A synthetic study for any design, population and seed.

    [bold]Example[/bold]: bayes-toe simulate -o study.csv --truth truth.csv --subjects 8 --seed 1
    """
    from bayes_toe.data.tables import write_table
    from bayes_toe.experiments.recipes import design_from, population_from, trial_frame, truth_frame
    from bayes_toe.experiments.simulate import simulate_trials
    from bayes_toe.model.prior_file import preset_or_file
    from bayes_toe.seeds import root_seed

    files = [output] if truth_output is None else [output, truth_output]
    task.require_files(*files)
    prior, seed = None if task.prior is None else preset_or_file(task.prior), root_seed(task.seed)
    design = design_from(task.design, task.amplitudes, task.batches, task.isi)
    names, observers = population_from(task.population, task.subjects, seed, design, prior=prior)
    trials = simulate_trials(names, observers, design, seed)
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


@dataclass(frozen=True, kw_only=True)
class CalibratingTask(SharedTask):
    """A command that simulates and analyses many studies."""

    seed: Seed = None


def calibrate(
    *,
    output: Annotated[Path, writes("DIR", "Folder for tables, figures and verdict.")],
    studies: Annotated[int, typer.Option("--studies", min=0, help="Studies a design for the ranks; 0 leaves them out.")] = 1000,
    data_sets: Annotated[int, typer.Option("--data-sets", min=0, help="Data sets a design for the evidence; 0 leaves it out.")] = 2000,
    task: CalibratingTask,
) -> None:
    """Whether posteriors and evidences are calibrated, on simulated data of known origin.

    [bold]Example[/bold]: bayes-toe calibrate -o calibration --studies 200 --data-sets 0 --seed 1
    """
    from bayes_toe.cli.calibration_folder import PRODUCTS, write_calibration
    from bayes_toe.experiments.calibration import Plan, simulate_and_analyse
    from bayes_toe.experiments.calibration_table import judge
    from bayes_toe.seeds import root_seed

    plan = Plan(studies, data_sets, root_seed(task.seed))
    task.require_folder(output, PRODUCTS)
    with task.progress("simulating and analysing", plan.total) as tick:
        table = judge(simulate_and_analyse(plan, workers=task.workers, progress=tick))
    write_calibration(table, output, overwrite=task.overwrite)
    summaries.say_calibration(task.console, table)
    task.say_written("results in", output, seed=plan.seed)
    if not table.passed:
        raise typer.Exit(INCOMPLETE)
