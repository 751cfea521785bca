"""Commands for a study that is still to be made: power, design and simulate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import bayes_toe as bt
from bayes_toe.cli.options import Question, rare, writes
from bayes_toe.cli.task import MODEL, Takes, Task
from bayes_toe.cli.terminal import safe
from bayes_toe.data.messages import counted, listed, quoted

if TYPE_CHECKING:
    from bayes_toe.arrays import FloatArray
    from bayes_toe.design.optimal_pairs import DesignGoal
    from bayes_toe.design.study_design import StudyDesign

_POWER_FILES = ("power.csv", "power_data_sets.csv", "power.png", "power.pdf")
Observers = Annotated[
    str | None,
    typer.Option(
        "--observers",
        metavar="KIND|people.toml|posterior.nc|prior",
        help="Whom to plan for; default: the kinds of docs/planning.md.",
    ),
]


# --- power ----------------------------------------------------------------------------------------


def power(
    *,
    design: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[DESIGN.csv]...",
            help="Columns s1,s2,n_trials (and isi); none means the paper's pairs.",
        ),
    ] = None,
    output: Annotated[Path, writes("DIR", "Folder for tables and figure.")] = Path("power"),
    question: Question = "same/different",
    trials: Annotated[
        str,
        typer.Option(
            "--trials", help="Trials of a subject, shared among the pairs as in the design."
        ),
    ] = "325,650,1300",
    data_sets: Annotated[
        int, typer.Option("--data-sets", min=1, help="Simulated observers of each kind.")
    ] = 50,
    observers: Observers = None,
    task: Annotated[Task, Takes(*MODEL, "spreadsheet_safe")],
) -> None:
    """How often a design shows the order effect of assumed observers, and how often wrongly.

    [bold]Example[/bold]: bayes-toe power design.csv --trials 325,650,1300 -o power --seed 1
    """
    from bayes_toe.data.tables import write_table
    from bayes_toe.data.whole_files import whole_folder
    from bayes_toe.design.observers import assume_observers

    task.require_folder(output, _POWER_FILES)
    designs, numbers = _read_designs(design, question), _whole_numbers("--trials", trials)
    # Refuses a bad file before any work.
    kinds = {one.kind for one in assume_observers(observers, 1, 0, list(designs.values()))}
    total = len(designs) * len(numbers) * len(kinds) * data_sets
    table = task.work(
        "simulating and analysing",
        total,
        bt.design.power,
        designs,
        numbers,
        observers,
        data_sets=data_sets,
        prior=task.prior,
    )
    with whole_folder(
        output, _POWER_FILES, required=_POWER_FILES, overwrite=task.overwrite
    ) as target:
        table.save(target / _POWER_FILES[0], spreadsheet_safe=task.spreadsheet_safe)
        write_table(
            table.data_sets_frame(),
            target / _POWER_FILES[1],
            spreadsheet_safe=task.spreadsheet_safe,
        )
        for name in _POWER_FILES[2:]:
            bt.plots.save_figure(bt.plots.power_figure(table), target / name)
    for line in table.sentences():
        task.out.line(safe(line))
    task.done("tables and figure in", output, seed=table.seed)


def _read_designs(files: list[Path] | None, question: str) -> Mapping[str, StudyDesign]:
    """Designs by the names of their files; the paper's where there is none."""
    from bayes_toe.design.power import name_designs

    if not files:
        return name_designs(None, question)
    if len(files) == 1:
        return name_designs(bt.design.read_study_design(files[0], question))
    designs = {}
    for file in files:
        if file.stem in designs:
            raise bt.InputError(
                f"designs: found {quoted(file.stem)} twice, allowed: files with different names"
            )
        designs[file.stem] = bt.design.read_study_design(file, question)
    return designs


def _whole_numbers(option: str, text: str) -> list[int]:
    """Whole numbers of an option, ascending, each once."""
    try:
        numbers = sorted({int(part) for part in text.split(",")})
    except ValueError:
        numbers = []
    if not numbers or numbers[0] < 1:
        raise bt.InputError(
            f"{option}: found {quoted(text)}, allowed: whole numbers of at least 1, separated by "
            "commas"
        )
    return numbers


# --- design ---------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class GoalOptions:
    """What a design is for, and which pairs can be shown."""

    lowest: Annotated[
        float | None, typer.Option("--lowest", help="Weakest stimulus, natural-log intensity.")
    ] = None
    highest: Annotated[float | None, typer.Option("--highest", help="Strongest stimulus.")] = None
    step: Annotated[
        float, typer.Option("--step", help="Between levels, natural-log intensity.")
    ] = 0.05
    levels: Annotated[
        Path | None,
        rare(
            "--levels",
            metavar="levels.csv",
            help="What hardware can show, column s, or i with --intensity.",
        ),
    ] = None
    intensity: Annotated[
        float | None,
        rare(
            "--intensity",
            metavar="REF",
            help="Amplitudes, s = ln(i / REF): those of --levels, and i1,i2 in --list.",
        ),
    ] = None
    max_pairs: Annotated[int, typer.Option("--max-pairs", help="Different pairs.")] = 26
    aim: Annotated[
        str,
        typer.Option(
            "--for",
            metavar="order-effect|constant-error|contraction",
            help="What is to be known as well as can be.",
        ),
    ] = "order-effect"
    keep: Annotated[
        Path | None,
        rare("--keep", metavar="DESIGN.csv", help="Pairs that stay, with their trials."),
    ] = None

    def require(self, given: Path | None, has_list: bool) -> None:
        """Refuse an intensity of nothing, and a design beside what another one is looked for."""
        if self.intensity is not None and not 0.0 < self.intensity < float("inf"):
            raise bt.InputError(
                f"--intensity: found {self.intensity!r}, allowed: a positive finite number"
            )
        if self.intensity is not None and self.levels is None and not has_list:
            raise bt.InputError(
                "--intensity: allowed with --levels levels.csv, or with --list trials.csv"
            )
        is_search = (self.lowest, self.highest, self.levels) != (None, None, None)
        if given is not None and (not has_list or is_search):
            raise bt.InputError(
                f"{given}: allowed with --list trials.csv, and without --lowest, --highest, "
                "--levels"
            )

    def log_levels(self) -> FloatArray:
        """Levels, natural-log intensity."""
        from bayes_toe.design.optimal_pairs import grid, read_levels

        if self.levels is not None:
            if self.lowest is not None or self.highest is not None:
                raise bt.InputError(
                    "--levels and --lowest, --highest: allowed is one of the two ways to say what "
                    "can be shown"
                )
            return read_levels(self.levels, self.intensity)
        if self.lowest is None or self.highest is None:
            raise bt.InputError(
                "allowed: --lowest and --highest, natural-log intensity, or --levels levels.csv "
                "(with --intensity REF)"
            )
        return grid(self.lowest, self.highest, self.step)

    def goal(self, question: str) -> DesignGoal:
        """What the design is for."""
        from bayes_toe.data.tasks import task_of

        keep = None if self.keep is None else bt.design.read_study_design(self.keep, question)
        return bt.design.DesignGoal(self.aim, self.max_pairs, keep, task_of(question))


@dataclass(frozen=True, kw_only=True)
class ListOptions:
    """A list of the trials of a design, in their order."""

    list_output: Annotated[
        Path | None,
        typer.Option(
            "--list",
            metavar="trials.csv",
            help="Trials to show, for PsychoPy or jsPsych; the column response is empty.",
        ),
    ] = None
    blocks: Annotated[
        int, rare("--blocks", min=1, help="Of --list: blocks of as many trials as can be.")
    ] = 10
    subjects: Annotated[
        int,
        typer.Option(
            "--subjects",
            min=1,
            help="Of --list: how many, each with an order of trials of its own.",
        ),
    ] = 1
    conditions: Annotated[
        str | None,
        typer.Option(
            "--conditions",
            metavar="left,right",
            help="Of --list: a condition, each level with its share of --trials.",
        ),
    ] = None

    def levels(self) -> tuple[str, ...]:
        """Those of the condition, none without one."""
        from bayes_toe.design.simulate import read_differences

        if self.conditions is not None and self.list_output is None:
            raise bt.InputError(
                "--conditions: allowed with --list trials.csv, in which trials are split over them"
            )
        differences = read_differences(self.conditions, None)
        return () if differences is None else differences.conditions.levels

    def write(self, design: StudyDesign, seed: int, reference: float | None, task: Task) -> None:
        """A randomised, counterbalanced list, which run reads once the answers are filled in."""
        from bayes_toe.design.simulate import subject_names
        from bayes_toe.design.trial_list import MOST_EQUAL, save_trials

        if self.list_output is None:
            return
        levels = self.levels()
        lists = []
        for name in subject_names(self.subjects):
            lists.append(
                bt.design.trial_list(
                    design, blocks=self.blocks, subject=name, seed=seed, conditions=levels
                )
            )
        save_trials(lists, self.list_output, reference=reference, overwrite=task.overwrite)
        split = ""
        if levels:
            split = f" ({design.total} in each of {listed([*levels])}, mixed within blocks)"
        n_trials = design.total * max(1, len(levels))
        task.out.line(
            f"{counted(self.subjects, 'subject')}, {n_trials} trials each in {self.blocks} blocks"
            f"{split}: both orders of two stimuli equally often in a block where the design has "
            f"them so, at most {MOST_EQUAL} equal pairs in a row"
        )
        task.done("trials in", self.list_output, seed=seed)


def design(
    *,
    given: Annotated[
        Path | None,
        typer.Argument(
            metavar="[DESIGN.csv]",
            help="For --list: a design that exists; none is looked for then.",
        ),
    ] = None,
    output: Annotated[
        Path, writes("design.csv", "Design to write; NAME_compared.csv, .md and .png beside it.")
    ] = Path("design.csv"),
    trials: Annotated[int, typer.Option("--trials", min=1, help="Trials of a subject.")] = 650,
    question: Question = "same/different",
    wanted: GoalOptions,
    data_sets: Annotated[
        int,
        rare(
            "--data-sets",
            min=1,
            help="Simulated observers of each kind who judge it and its rivals.",
        ),
    ] = 16,
    observers: Observers = None,
    lists: ListOptions,
    task: Annotated[Task, Takes(*MODEL, "spreadsheet_safe")],
) -> None:
    """The pairs that tell most of an order effect, beside other designs; a list of trials.

    [bold]Example[/bold]: bayes-toe design -o design.csv --trials 650 --lowest -0.75 --highest 1.25 --list trials.csv --seed 1
    """
    from bayes_toe.seeds import root_seed

    list_files = [] if lists.list_output is None else [lists.list_output]
    n_levels = max(1, len(lists.levels()))
    wanted.require(given, bool(list_files))
    if given is not None:
        task.require_files(*list_files)
        seed = root_seed(task.seed)
        lists.write(bt.design.read_study_design(given), seed, wanted.intensity, task)
        return
    if output.suffix != ".csv":
        raise bt.InputError(
            f"{output}: found the ending {output.suffix!r}, allowed: .csv, for a design"
        )
    compared = output.with_name(f"{output.stem}_compared.csv")
    files = (output, compared, output.with_suffix(".md"), output.with_suffix(".png"))
    task.require_files(*files, *list_files)
    levels, goal = wanted.log_levels(), wanted.goal(question)
    found = task.work(
        "simulating and analysing",
        4 * 6 * data_sets,
        bt.design.optimal_design,
        levels,
        trials // n_levels,
        goal,
        observers,
        data_sets=data_sets,
        prior=task.prior,
    )
    written = (
        found.design.save,
        partial(found.power.save, spreadsheet_safe=task.spreadsheet_safe),
        lambda file: file.write_text(found.text(), encoding="utf-8"),
        partial(bt.plots.save_figure, bt.plots.design_figure(found)),
    )
    task.write(dict(zip(files, written, strict=True)))
    for line in found.sentences():
        task.out.line(safe(line))
    lists.write(found.design, found.seed, wanted.intensity, task)
    task.done("written:", *files, seed=found.seed)


# --- simulate -------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class PopulationOptions:
    """Who answers what."""

    subjects: Annotated[
        int, typer.Option("--subjects", min=1, help="How many, unless --population names a file.")
    ] = 16
    population: Annotated[
        str,
        typer.Option(
            "--population",
            metavar="paper|KIND|prior|FILE.csv",
            help="paper: the paper's model; none, small or large constant error, contraction, "
            "repulsion, both; or a CSV of subject and parameters.",
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
            metavar="contraction=0.2:0.05,...",
            help="By how much the last condition differs from the first: constant_error, "
            "contraction, noise (log); after a colon the sd between subjects.",
        ),
    ] = None
    question: Question = "same/different"


def simulate(
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
    ] = "1,1.15,1.36,1.55,1.66",
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
    observers: PopulationOptions,
    task: Annotated[Task, Takes("seed", "spreadsheet_safe", "overwrite")],
) -> None:
    """A synthetic study for any design, population and seed.

    [bold]Example[/bold]: bayes-toe simulate -o study.csv --truth truth.csv --subjects 8 --seed 1
    """
    from bayes_toe.data.tables import write_table
    from bayes_toe.data.tasks import task_of
    from bayes_toe.design.simulate import (
        draw_population,
        make_batch_design,
        read_differences,
        simulate_trials,
        trial_frame,
        truth_frame,
    )
    from bayes_toe.seeds import root_seed

    files = [output] if truth_output is None else [output, truth_output]
    task.require_files(*files)
    seed = root_seed(task.seed)
    pairs = make_batch_design(design, amplitudes, batches, isi)
    simulated = draw_population(
        observers.population, observers.subjects, seed, pairs, task_of(observers.question)
    )
    trials = simulate_trials(
        simulated,
        pairs,
        seed,
        carry_over=observers.carry_over,
        missed=observers.missed,
        differences=read_differences(observers.conditions, observers.differ),
    )
    frames = dict(zip(files, (trial_frame(trials), truth_frame(trials)), strict=False))
    for folder in {file.parent for file in files}:
        task.write(
            {
                file: partial(write_table, frame, **task.saving)
                for file, frame in frames.items()
                if file.parent == folder
            }
        )
    total = sum(len(answered.yes) for answered in trials)
    what = f"{len(simulated)} synthetic subjects, {total} trials in"
    task.done(what, output, ending=f"; seed {seed}")
