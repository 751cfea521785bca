"""The command that makes data of known origin: simulate."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from bayes_toe.cli.options import Question, rare, writes
from bayes_toe.cli.task import Takes, Task


@dataclass(frozen=True, kw_only=True)
class Observers:
    """Who answers what."""

    subjects: Annotated[
        int, typer.Option("--subjects", min=1, help="How many, unless --population names a file.")
    ] = 16
    population: Annotated[
        str,
        typer.Option(
            "--population",
            help="paper, prior, or a CSV with subject,mu1,sigma_p,sigma_l and q0, of 2afc lapse_rate.",
        ),
    ] = "paper"
    carry_over: Annotated[
        float,
        rare(
            "--carry-over",
            help="Share of what is expected after a trial that is left at the next, 0 to below 1.",
        ),
    ] = 0.0
    missed: Annotated[
        float, rare("--missed", help="Share of trials that nobody answers in time.")
    ] = 0.0
    conditions: Annotated[
        str | None,
        typer.Option(
            "--conditions",
            metavar="left,right",
            help="Levels of a condition: all pairs are shown at each.",
        ),
    ] = None
    differ: Annotated[
        str | None,
        typer.Option(
            "--differ",
            metavar="pull=0.5:0.1,...",
            help="By how much the last condition differs from the first: constant error "
            "(natural-log intensity), pull (probit), width (log); after a colon the sd between subjects.",
        ),
    ] = None
    question: Question = "same/different"


def simulate(  # each is a choice of its own, and has a default
    *,
    output: Annotated[Path, writes("STUDY.csv", "Trials to write.")],
    truth_output: Annotated[
        Path | None,
        typer.Option("--truth", metavar="truth.csv", help="Where to write the true parameters."),
    ] = None,
    batches: Annotated[
        int, typer.Option("--batches", min=1, help="Repetitions of the whole set of pairs.")
    ] = 50,
    amplitudes: Annotated[
        str, rare("--amplitudes", help="Stimuli in units of the reference, weakest first.")
    ] = ("1,1.15,1.36,1.55,1.66"),
    design: Annotated[
        str,
        typer.Option(
            "--design",
            help="reference (the paper's), full (all ordered pairs), or a CSV with s1,s2 (and isi).",
        ),
    ] = "reference",
    isi: Annotated[
        str | None,
        rare(
            "--isi", help="Inter-stimulus intervals in seconds, e.g. 0.5,1,2: every pair at each."
        ),
    ] = None,
    observers: Observers,
    task: Annotated[Task, Takes("seed", "prior", "spreadsheet_safe", "overwrite")],
) -> None:
    """A synthetic study for any design, population and seed.

    [bold]Example[/bold]: bayes-toe simulate -o study.csv --truth truth.csv --subjects 8 --seed 1
    """
    from bayes_toe.data.tables import write_table
    from bayes_toe.data.tasks import task_of
    from bayes_toe.experiments.conditions import differing_from
    from bayes_toe.experiments.populations import population_from
    from bayes_toe.experiments.simulate import (
        design_from,
        simulate_trials,
        trial_frame,
        truth_frame,
    )
    from bayes_toe.model.study_prior import preset_or_file
    from bayes_toe.seeds import root_seed

    asked, files = (
        task_of(observers.question),
        [output] if truth_output is None else [output, truth_output],
    )
    task.require_files(*files)
    prior, seed = None if task.prior is None else preset_or_file(task.prior), root_seed(task.seed)
    pairs = design_from(design, amplitudes, batches, isi)
    names, known = population_from(
        observers.population, observers.subjects, seed, pairs, prior=prior, task=asked
    )
    differing = differing_from(observers.conditions, observers.differ)
    trials = simulate_trials(
        names,
        known,
        pairs,
        seed,
        asked,
        carried=observers.carry_over,
        missed=observers.missed,
        differing=differing,
    )
    frames = dict(zip(files, (trial_frame(trials), truth_frame(trials)), strict=False))
    for folder in {one.parent for one in files}:
        task.write(
            {
                one: partial(write_table, frames[one], **task.saving)
                for one in files
                if one.parent == folder
            }
        )
    total = sum(len(one.yes) for one in trials)
    task.done(
        f"{len(names)} synthetic subjects, {total} trials in", output, ending=f"; seed {seed}"
    )
