"""Commands for a study that is still to be made: power and design."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

import bayes_toe as bt
from bayes_toe import planning
from bayes_toe.cli.options import Question, rare, writes
from bayes_toe.cli.task import MODEL, Takes, Task
from bayes_toe.cli.terminal import safe
from bayes_toe.data.messages import counted, listed, quoted

if TYPE_CHECKING:
    from bayes_toe.arrays import FloatArray

Number = TypeVar("Number", int, float)
_POWER, _STUDIES = "power.csv", "power_subjects.csv"
_BESIDE = ("power_data_sets.csv", "power.png", "power.pdf")
Observers = Annotated[
    str | None,
    typer.Option(
        "--observers",
        metavar="population.toml|posterior.nc|prior",
        help="Whom to plan for; default: those of docs/planning.md.",
    ),
]


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
    max_pairs: Annotated[int, typer.Option("--max-pairs", help="Different pairs.")] = 25
    isi: Annotated[
        str | None,
        rare("--isi", help="Inter-stimulus intervals to choose from, seconds, e.g. 0.5,2."),
    ] = None
    aim: Annotated[
        str,
        typer.Option(
            "--for",
            metavar="update|gain|mu1|width|parameters",
            help="Name the update, or know a quantity, or all.",
        ),
    ] = "update"
    keep: Annotated[
        Path | None,
        rare("--keep", metavar="DESIGN.csv", help="Pairs that stay, with their trials."),
    ] = None

    def require(self, given: Path | None, listed: bool) -> None:
        """Refuse an intensity of nothing, and a design that is given beside what another one would be looked for among."""
        if self.intensity is not None and not 0.0 < self.intensity < float("inf"):
            raise bt.InputError(
                f"--intensity: found {self.intensity!r}, allowed: a positive finite number"
            )
        if self.intensity is not None and self.levels is None and not listed:
            raise bt.InputError(
                "--intensity: allowed with --levels levels.csv, or with --list trials.csv"
            )
        if given is not None and (
            not listed or (self.lowest, self.highest, self.levels) != (None, None, None)
        ):
            raise bt.InputError(
                f"{given}: allowed with --list trials.csv, and without --lowest, --highest, --levels"
            )

    def levels_in_log(self) -> FloatArray:
        """Levels, natural-log intensity."""
        from bayes_toe.planning.optimal import grid, read_levels

        if self.levels is not None:
            if self.lowest is not None or self.highest is not None:
                raise bt.InputError(
                    "--levels and --lowest, --highest: allowed is one of the two ways to say what can be shown"
                )
            return read_levels(self.levels, self.intensity)
        if self.lowest is None or self.highest is None:
            raise bt.InputError(
                "allowed: --lowest and --highest, natural-log intensity, or --levels levels.csv (with --intensity REF)"
            )
        return grid(self.lowest, self.highest, self.step)

    def goal(self, question: str) -> planning.DesignGoal:
        """What the design is for."""
        from bayes_toe.data.tasks import task_of

        found = (
            ()
            if self.isi is None
            else tuple(_numbers("--isi", self.isi, float, "positive numbers of seconds"))
        )
        keep = None if self.keep is None else planning.read_study_design(self.keep, question)
        return planning.DesignGoal(self.aim, self.max_pairs, keep, found, task_of(question))


@dataclass(frozen=True, kw_only=True)
class SimulationOptions:
    """What is simulated, and of how many observers."""

    trials: Annotated[
        str,
        typer.Option(
            "--trials", help="Trials of a subject, shared among the pairs as in the design."
        ),
    ] = "325,650,1300"
    data_sets: Annotated[
        int, rare("--data-sets", min=1, help="Simulated observers of each kind.")
    ] = 100
    subjects: Annotated[
        str, typer.Option("--subjects", help="Also whole studies of so many simulated subjects.")
    ] = "4,8,16"
    observers: Observers = None

    def tables(
        self, designs: Mapping[str, planning.StudyDesign], task: Task, keep: Path
    ) -> dict[str, Any]:
        """What was simulated, by the file of it."""
        from bayes_toe.model.study_prior import preset_or_file
        from bayes_toe.planning.observers import observers_from, shares_from
        from bayes_toe.planning.power_of_studies import power_of_studies

        whole, prior = "whole numbers of at least 1", preset_or_file(task.prior)
        numbers = _numbers("--trials", self.trials, int, whole)
        sizes = _numbers("--subjects", self.subjects, int, whole)
        asked = next(iter(designs.values())).task
        people = observers_from(
            self.observers, 1, 0, task=asked
        )  # refuses a bad file before any work
        kinds = len({one.kind for one in people})
        shares, seed = shares_from(self.observers, asked), task.seed

        def simulated(
            what: str, total: int, work: Callable[..., Any], *given: object, **more: object
        ) -> Any:
            return task.work(
                what,
                len(designs) * total,
                work,
                *given,
                self.observers,
                seed=seed,
                prior=prior,
                keep=keep,
                **more,
            )

        total = kinds * self.data_sets
        table = simulated(
            "simulating and analysing",
            len(numbers) * total,
            planning.power,
            designs,
            numbers,
            data_sets=self.data_sets,
        )
        found, seed = {_POWER: table, _STUDIES: power_of_studies(table, sizes, shares)}, table.seed
        return found


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
    asked: SimulationOptions,
    task: Annotated[Task, Takes(*MODEL, "spreadsheet_safe", "resume")],
) -> None:
    """What a design will tell: how often the verdict finds and names the order effect of assumed observers, by simulation.

    [bold]Example[/bold]: bayes-toe power design.csv --trials 325,650,1300 -o power --seed 1
    """
    from bayes_toe.data.tables import write_table
    from bayes_toe.data.whole_files import whole_folder

    products = (_POWER, _STUDIES, *_BESIDE)
    task.require_folder(output, products)
    keep = task.partial(output)
    tables = asked.tables(_designs(design, question), task, keep)
    table = tables[_POWER]
    with whole_folder(
        output, products, required=(*tables, *_BESIDE), overwrite=task.overwrite
    ) as target:
        write_table(
            table.data_sets_frame(), target / _BESIDE[0], spreadsheet_safe=task.spreadsheet_safe
        )
        for name, one in tables.items():
            one.save(target / name, spreadsheet_safe=task.spreadsheet_safe)
        for name in _BESIDE[1:]:
            bt.plots.save_figure(bt.plots.power_figure(table), target / name)
    failed = {name: reason for one in tables.values() for name, reason in one.failed.items()}
    task.finish(keep, failed)
    for line in (line for one in tables.values() for line in one.sentences()):
        task.out.line(safe(line))
    task.done("tables and figure in", output, seed=table.seed, failed=failed)


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
        from bayes_toe.experiments.conditions import differing_from

        if self.conditions is not None and self.list_output is None:
            raise bt.InputError(
                "--conditions: allowed with --list trials.csv, in which trials are split over them"
            )
        differing = differing_from(self.conditions, None)
        return () if differing is None else differing.conditions.levels

    def write(
        self, made: planning.StudyDesign, seed: int, reference: float | None, task: Task
    ) -> None:
        """A randomised, counterbalanced list of trials, which run reads once the answers are filled in."""
        from bayes_toe.experiments.populations import subject_names
        from bayes_toe.planning.study_design import MOST_EQUAL, save_trials

        if self.list_output is None:
            return
        levels, names = self.levels(), subject_names(self.subjects)
        lists = [
            planning.trial_list(
                made, blocks=self.blocks, subject=name, seed=seed, conditions=levels
            )
            for name in names
        ]
        save_trials(lists, self.list_output, reference=reference, overwrite=task.overwrite)
        split = (
            f" ({made.total} in each of {listed([*levels])}, mixed within blocks)" if levels else ""
        )
        who = f"{counted(self.subjects, 'subject')}, {made.total * max(1, len(levels))} trials each in {self.blocks} blocks{split}"
        both = "both orders of two stimuli equally often in a block where the design has them so"
        task.out.line(f"{who}: {both}, at most {MOST_EQUAL} equal pairs in a row")
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
    ] = 20,
    observers: Observers = None,
    lists: ListOptions,
    task: Annotated[Task, Takes(*MODEL, "spreadsheet_safe")],
) -> None:
    """The pairs that tell most of what is asked, among those that can be shown, beside the paper's, all, and random ones; in which order.

    [bold]Example[/bold]: bayes-toe design -o design.csv --trials 650 --lowest -0.75 --highest 1.25 --list trials.csv --seed 1
    """
    from bayes_toe.model.study_prior import preset_or_file
    from bayes_toe.seeds import root_seed

    listed, levels = (
        [] if lists.list_output is None else [lists.list_output],
        max(1, len(lists.levels())),
    )
    wanted.require(given, bool(listed))
    if given is not None:
        task.require_files(*listed)
        lists.write(planning.read_study_design(given), root_seed(task.seed), wanted.intensity, task)
        return
    if output.suffix != ".csv":
        raise bt.InputError(
            f"{output}: found the ending {output.suffix!r}, allowed: .csv, for a design"
        )
    files = (
        output,
        output.with_name(f"{output.stem}_compared.csv"),
        output.with_suffix(".md"),
        output.with_suffix(".png"),
    )
    task.require_files(*files, *listed)
    prior, shown, goal = preset_or_file(task.prior), wanted.levels_in_log(), wanted.goal(question)
    about, find = (shown, trials // levels, goal, observers), planning.optimal_design
    found = task.work(
        "simulating and analysing",
        4 * 3 * data_sets,
        find,
        *about,
        data_sets=data_sets,
        prior=prior,
    )
    written = (
        found.design.save,
        partial(found.power.save, spreadsheet_safe=task.spreadsheet_safe),
        lambda file: file.write_text(found.text(), encoding="utf-8"),
        partial(bt.plots.save_figure, bt.plots.design_figure(found)),
    )
    task.write(dict(zip(files, written, strict=True)))
    for line in found.said():
        task.out.line(safe(line))
    lists.write(found.design, found.seed, wanted.intensity, task)
    task.done("written:", *files, seed=found.seed, failed=found.power.failed)


def _designs(files: list[Path] | None, question: str) -> Mapping[str, planning.StudyDesign]:
    """Designs by the names of their files; the paper's where there is none."""
    from bayes_toe.planning.power import named_designs

    if not files or len(files) == 1:
        return named_designs(
            planning.read_study_design(files[0], question) if files else None, question
        )
    names = [file.stem for file in files]
    repeated = [name for name in names if names.count(name) > 1]
    if repeated:
        raise bt.InputError(
            f"designs: found {quoted(repeated[0])} twice, allowed: files with different names"
        )
    return {
        name: planning.read_study_design(file, question)
        for name, file in zip(names, files, strict=True)
    }


def _numbers(option: str, text: str, kind: Callable[[str], Number], allowed: str) -> list[Number]:
    """Positive numbers of an option, ascending, each once."""
    try:
        numbers = sorted({kind(part) for part in text.split(",")})
    except ValueError:
        numbers = []
    if not numbers or not all(0 < one < float("inf") for one in numbers):
        raise bt.InputError(
            f"{option}: found {quoted(text)}, allowed: {allowed}, separated by commas"
        )
    return numbers
