"""Commands for a study that is still to be made: power, design, trials."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from bayes_toe.cli import terminal
from bayes_toe.cli.options import Seed, writes
from bayes_toe.cli.task import KeepingTableTask, ModelTask, TableTask, WritingTask, leave_unless_whole
from bayes_toe.data.messages import quoted
from bayes_toe.errors import InputError
from bayes_toe.planning.aims import AIMS

if TYPE_CHECKING:
    from bayes_toe.arrays import FloatArray
    from bayes_toe.planning.power_of_populations import PopulationPower
    from bayes_toe.planning.power_of_studies import StudyPower
    from bayes_toe.planning.power_table import PowerTable
    from bayes_toe.planning.stopping import StoppingTable
    from bayes_toe.planning.study_design import StudyDesign

_POWER = ("power.csv", "power_data_sets.csv", "power_subjects.csv", "power.png", "power.pdf")
_STOPPING, _POPULATION = "power_stopping.csv", "power_population.csv"
Found = TypeVar("Found")
Observers = Annotated[
    str | None,
    typer.Option("--observers", metavar="population.toml|posterior.nc|prior", help="Whom to plan for; default: those of docs/planning.md."),
]


@dataclass(frozen=True, kw_only=True)
class PlanningTask(KeepingTableTask):
    """Simulation for assumed observers."""

    observers: Observers = None


@dataclass(frozen=True, kw_only=True)
class DesignTask(TableTask, ModelTask):
    """Search and simulation for assumed observers."""

    observers: Observers = None


@dataclass(frozen=True, kw_only=True)
class LevelOptions:
    """Which pairs can be shown."""

    lowest: Annotated[float | None, typer.Option("--lowest", help="Weakest stimulus, natural-log intensity.")] = None
    highest: Annotated[float | None, typer.Option("--highest", help="Strongest stimulus.")] = None
    step: Annotated[float, typer.Option("--step", help="Between levels, natural-log intensity.")] = 0.05
    levels: Annotated[
        Path | None,
        typer.Option("--levels", metavar="levels.csv", help="What hardware can show, column s, or i with --intensity."),
    ] = None
    intensity: Annotated[float | None, typer.Option("--intensity", metavar="REF", help="Of --levels: amplitudes, s = ln(i / REF).")] = None
    max_pairs: Annotated[int, typer.Option("--max-pairs", help="Different pairs.")] = 25
    isi: Annotated[str | None, typer.Option("--isi", help="Inter-stimulus intervals to choose from, seconds, e.g. 0.5,2.")] = None

    def levels_in_log(self) -> FloatArray:
        """Levels, natural-log intensity."""
        from bayes_toe.planning.optimal import grid, read_levels

        if self.levels is not None:
            if self.lowest is not None or self.highest is not None:
                raise InputError("--levels and --lowest, --highest: allowed is one of the two ways to say what can be shown")
            return read_levels(self.levels, self.intensity)
        if self.lowest is None or self.highest is None or self.intensity is not None:
            raise InputError("allowed: --lowest and --highest, natural-log intensity, or --levels levels.csv (with --intensity REF)")
        return grid(self.lowest, self.highest, self.step)

    def intervals(self) -> tuple[float, ...]:
        """Inter-stimulus intervals, seconds."""
        try:
            found = () if self.isi is None else tuple(sorted({float(part) for part in self.isi.split(",")}))
        except ValueError:
            found = (0.0,)
        if any(not 0.0 < one < float("inf") for one in found):
            raise InputError(f"--isi: found {quoted(str(self.isi))}, allowed: positive numbers of seconds, separated by commas")
        return found


@dataclass(frozen=True, kw_only=True)
class GroupOptions:
    """Whole studies by the analysis of groups."""

    population: Annotated[
        bool,
        typer.Option("--population", help="Also whole studies by the analysis of groups, population: about 1 s a subject of each."),
    ] = False
    studies: Annotated[
        int, typer.Option("--studies", min=1, help="With --population: of each kind and number of --subjects, at the most --trials.")
    ] = 20


@dataclass(frozen=True, kw_only=True)
class ListingTask(WritingTask):
    """A random order."""

    seed: Seed = None


def power(
    *,
    design: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[DESIGN.csv]...", help="Columns s1,s2,n_trials (and isi); none means the paper's pairs."),
    ] = None,
    output: Annotated[Path, writes("DIR", "Folder for tables and figure.")] = Path("power"),
    trials: Annotated[str, typer.Option("--trials", help="Trials of a subject, shared among the pairs as in the design.")] = "325,650,1300",
    data_sets: Annotated[int, typer.Option("--data-sets", min=1, help="Simulated observers of each kind.")] = 100,
    subjects: Annotated[str, typer.Option("--subjects", help="Also whole studies of so many simulated subjects.")] = "4,8,16",
    stop: Annotated[
        float | None, typer.Option("--stop", metavar="P", help="Also sessions that stop when a kind is so probable, e.g. 0.95.")
    ] = None,
    look: Annotated[
        int, typer.Option("--look", min=1, help="With --stop: after every so many trials, at most the largest of --trials.")
    ] = 50,
    groups: GroupOptions,
    task: PlanningTask,
) -> None:
    """What a design will tell: how often the order effect of assumed observers is named, by simulation with the program's own analysis.

    [bold]Example[/bold]: bayes-toe power design.csv --trials 325,650,1300 -o power --seed 1
    """
    from bayes_toe.model.prior_file import preset_or_file
    from bayes_toe.planning.observers import observers_from, shares_from
    from bayes_toe.planning.power import power as simulate
    from bayes_toe.planning.power_of_populations import power_of_populations
    from bayes_toe.planning.power_of_studies import power_of_studies
    from bayes_toe.planning.stopping import StoppingRule, stopping

    task.require_folder(output, (*_POWER, _STOPPING, _POPULATION))
    keep = task.partial(output)
    prior = preset_or_file(task.prior)
    designs, numbers, sizes = _designs(design), _numbers("--trials", trials), _numbers("--subjects", subjects)
    rule = None if stop is None else StoppingRule(stop, numbers[-1], look)
    kinds = len({one.kind for one in observers_from(task.observers, 1, 0)})  # refuses a bad file before any work

    def simulated(what: str, total: int, work: Callable[..., Found], *asked: object, **more: object) -> Found:
        with task.progress(what, total) as tick:
            return work(*asked, task.observers, prior=prior, workers=task.workers, progress=tick, keep=keep, **more)

    total = len(designs) * len(numbers) * kinds * data_sets
    table = simulated("simulating and analysing", total, simulate, designs, numbers, data_sets=data_sets, seed=task.seed)
    shares = shares_from(task.observers)
    of_studies, stopped, grouped = power_of_studies(table, sizes, shares), None, None
    if rule is not None:
        total = len(designs) * kinds * data_sets
        stopped = simulated("simulating sessions", total, stopping, designs, rule, data_sets=data_sets, seed=table.seed)
    if groups.population:
        longest = {name: one.with_total(numbers[-1]) for name, one in designs.items()}
        total = len(designs) * (kinds + bool(shares)) * sum(size > 1 for size in sizes) * groups.studies
        grouped = simulated("simulating studies", total, power_of_populations, longest, sizes, studies=groups.studies, seed=table.seed)
    _write_power(table, of_studies, stopped, grouped, output, task)
    task.say_taken(keep)
    done = [one for one in (table, stopped, grouped) if one is not None]
    failed = {name: reason for one in done for name, reason in one.failed.items()}
    task.finish(keep, failed)
    for line in (line for one in (table, of_studies, *done[1:]) for line in one.sentences()):
        terminal.say(task.console, terminal.safe(line))
    task.say_written("tables and figure in", output, seed=table.seed)
    leave_unless_whole(task, failed, {})


def _write_power(
    table: PowerTable, studies: StudyPower, stopped: StoppingTable | None, grouped: PopulationPower | None, output: Path, task: PlanningTask
) -> None:
    from bayes_toe.data.tables import write_table
    from bayes_toe.data.whole_folders import whole_folder
    from bayes_toe.plots.figure_files import save_figure
    from bayes_toe.plots.power import power_figure

    asked = {name: one for name, one in ((_STOPPING, stopped), (_POPULATION, grouped)) if one is not None}
    with whole_folder(output, (*_POWER, _STOPPING, _POPULATION), required=(*_POWER, *asked), overwrite=task.overwrite) as target:
        counted, data_sets, of_studies, *figures = (target / name for name in _POWER)
        table.save(counted, spreadsheet_safe=task.spreadsheet_safe)
        write_table(table.data_sets_frame(), data_sets, spreadsheet_safe=task.spreadsheet_safe)
        for path, one in {of_studies: studies, **{target / name: one for name, one in asked.items()}}.items():
            one.save(path, spreadsheet_safe=task.spreadsheet_safe)
        for path in figures:
            save_figure(power_figure(table, grouped), path)


def design(
    *,
    output: Annotated[Path, writes("design.csv", "Design to write; NAME_compared.csv, .md and .png beside it.")] = Path("design.csv"),
    trials: Annotated[int, typer.Option("--trials", min=1, help="Trials of a subject.")] = 650,
    space: LevelOptions,
    aim: Annotated[str, typer.Option("--for", metavar="|".join(AIMS), help="Name the update, or know a quantity, or all.")] = "update",
    keep: Annotated[Path | None, typer.Option("--keep", metavar="DESIGN.csv", help="Pairs that stay, with their trials.")] = None,
    data_sets: Annotated[int, typer.Option("--data-sets", min=1, help="Simulated observers of each kind who judge the finalists.")] = 20,
    task: DesignTask,
) -> None:
    """The pairs that tell most of what is asked, among those that can be shown, beside the paper's, all, and random ones.

    [bold]Example[/bold]: bayes-toe design -o design.csv --trials 650 --lowest -0.75 --highest 1.25 --seed 1
    """
    from bayes_toe.model.prior_file import preset_or_file
    from bayes_toe.planning.optimal import DesignGoal, optimal_design
    from bayes_toe.planning.study_design import read_study_design
    from bayes_toe.plots.design import design_figure
    from bayes_toe.plots.figure_files import save_figure

    files = _beside(output)
    task.require_files(*files)
    prior, levels = preset_or_file(task.prior), space.levels_in_log()
    goal = DesignGoal(aim, space.max_pairs, None if keep is None else read_study_design(keep), space.intervals())
    with task.progress("simulating finalists", 5 * 3 * data_sets) as tick:
        found = optimal_design(
            levels, trials, goal, task.observers, data_sets=data_sets, seed=task.seed, prior=prior, workers=task.workers, progress=tick
        )
    with task.together(*files) as folder:
        found.design.save(folder / files[0].name)
        found.power.save(folder / files[1].name, spreadsheet_safe=task.spreadsheet_safe)
        (folder / files[2].name).write_text(found.text(), encoding="utf-8")
        save_figure(design_figure(found), folder / files[3].name)
    for line in found.said():
        terminal.say(task.console, terminal.safe(line))
    task.say_written("written:", *files, seed=found.seed)
    leave_unless_whole(task, found.power.failed, {})


def trials(
    *,
    design: Annotated[Path, typer.Argument(metavar="DESIGN.csv", help="Columns s1,s2,n_trials (and isi).")],
    output: Annotated[Path, writes("trials.csv", "Trials to show, for PsychoPy or jsPsych; its column response is empty.")] = Path(
        "trials.csv"
    ),
    blocks: Annotated[int, typer.Option("--blocks", min=1, help="Blocks of as many trials as can be.")] = 10,
    subjects: Annotated[int, typer.Option("--subjects", min=1, help="How many, each with an order of trials of its own.")] = 1,
    intensity: Annotated[
        float | None, typer.Option("--intensity", metavar="REF", help="Columns i1,i2 with raw amplitudes, i = REF e^s, beside s1,s2.")
    ] = None,
    task: ListingTask,
) -> None:
    """A randomised, counterbalanced list of trials, which run reads once the answers are filled in.

    [bold]Example[/bold]: bayes-toe trials design.csv -o trials.csv --blocks 10 --seed 1
    """
    from bayes_toe.experiments.recipes import subject_names
    from bayes_toe.planning.study_design import read_study_design
    from bayes_toe.planning.trial_list import MOST_EQUAL, save_trials, trial_list
    from bayes_toe.seeds import root_seed

    task.require_files(output)
    if intensity is not None and not 0.0 < intensity < float("inf"):
        raise InputError(f"--intensity: found {intensity!r}, allowed: a positive finite number")
    seed, read = root_seed(task.seed), read_study_design(design)
    lists = [trial_list(read, blocks=blocks, subject=name, seed=seed) for name in subject_names(subjects)]
    save_trials(lists, output, reference=intensity, overwrite=task.overwrite)
    who = f"{subjects} subject{'' if subjects == 1 else 's'}, {read.total} trials each in {blocks} blocks"
    terminal.say(task.console, f"{who}: both orders of two stimuli equally often in a block where the design has them so, at most "
                 f"{MOST_EQUAL} equal pairs in a row")  # fmt: skip
    task.say_written("trials in", output, seed=seed)


def _beside(output: Path) -> tuple[Path, ...]:
    """The design, what it was compared with, why it is so, the figure."""
    if output.suffix != ".csv":
        raise InputError(f"{output}: found the ending {output.suffix!r}, allowed: .csv, for a design")
    compared = output.with_name(f"{output.stem}_compared.csv")
    return output, compared, output.with_suffix(".md"), output.with_suffix(".png")


def _designs(files: list[Path] | None) -> Mapping[str, StudyDesign]:
    """Designs by the names of their files; the paper's where there is none."""
    from bayes_toe.planning.power import named_designs
    from bayes_toe.planning.study_design import read_study_design

    if not files or len(files) == 1:
        return named_designs(read_study_design(files[0]) if files else None)
    names = [file.stem for file in files]
    repeated = [name for name in names if names.count(name) > 1]
    if repeated:
        raise InputError(f"designs: found {quoted(repeated[0])} twice, allowed: files with different names")
    return {name: read_study_design(file) for name, file in zip(names, files, strict=True)}


def _numbers(option: str, text: str) -> list[int]:
    try:
        numbers = [int(part) for part in text.split(",")]
    except ValueError:
        numbers = [0]
    if min(numbers) < 1:
        raise InputError(f"{option}: found {quoted(text)}, allowed: whole numbers of at least 1, separated by commas")
    return sorted(set(numbers))
