"""Commands for a study that is still to be made: power."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bayes_toe.cli import terminal
from bayes_toe.cli.options import writes
from bayes_toe.cli.task import KeepingTableTask, leave_unless_whole
from bayes_toe.data.messages import quoted
from bayes_toe.errors import InputError

if TYPE_CHECKING:
    from bayes_toe.planning.study_design import StudyDesign

_POWER = ("power.csv", "power_data_sets.csv", "power.png", "power.pdf")
Observers = Annotated[
    str | None,
    typer.Option("--observers", metavar="population.toml|posterior.nc|prior", help="Whom to plan for; default: those of docs/planning.md."),
]


@dataclass(frozen=True, kw_only=True)
class PlanningTask(KeepingTableTask):
    """Simulation for assumed observers."""

    observers: Observers = None


def power(
    *,
    design: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[DESIGN.csv]...", help="Columns s1,s2,n_trials (and isi); none means the paper's pairs."),
    ] = None,
    output: Annotated[Path, writes("DIR", "Folder for tables and figure.")] = Path("power"),
    trials: Annotated[str, typer.Option("--trials", help="Trials of a subject, shared among the pairs as in the design.")] = "325,650,1300",
    data_sets: Annotated[int, typer.Option("--data-sets", min=1, help="Simulated observers of each kind.")] = 100,
    task: PlanningTask,
) -> None:
    """What a design will tell: how often the order effect of assumed observers is named, by simulation with the program's own analysis.

    [bold]Example[/bold]: bayes-toe power design.csv --trials 325,650,1300 -o power --seed 1
    """
    from bayes_toe.data.tables import write_table
    from bayes_toe.data.whole_folders import whole_folder
    from bayes_toe.model.prior_file import preset_or_file
    from bayes_toe.planning.observers import observers_from
    from bayes_toe.planning.power import power as simulate
    from bayes_toe.plots.figure_files import save_figure
    from bayes_toe.plots.power import power_figure

    task.require_folder(output, _POWER)
    keep = task.partial(output)
    prior = preset_or_file(task.prior)
    designs, numbers = _designs(design), _numbers(trials)
    kinds = dict.fromkeys(one.kind for one in observers_from(task.observers, 1, 0))  # refuses a bad file before any work
    with task.progress("simulating and analysing", len(designs) * len(numbers) * len(kinds) * data_sets) as tick:
        table = simulate(
            designs, numbers, task.observers,
            data_sets=data_sets, seed=task.seed, prior=prior, workers=task.workers, progress=tick, keep=keep,
        )  # fmt: skip
    with whole_folder(output, _POWER, required=_POWER, overwrite=task.overwrite) as target:
        table.save(target / _POWER[0], spreadsheet_safe=task.spreadsheet_safe)
        write_table(table.data_sets_frame(), target / _POWER[1], spreadsheet_safe=task.spreadsheet_safe)
        for name in _POWER[2:]:
            save_figure(power_figure(table), target / name)
    task.say_taken(keep)
    task.finish(keep, table.failed)
    for line in table.sentences():
        terminal.say(task.console, terminal.safe(line))
    task.say_written("tables and figure in", output, seed=table.seed)
    leave_unless_whole(task, table.failed, {})


def _designs(files: list[Path] | None) -> Mapping[str, StudyDesign]:
    """Designs by the names of their files; the paper's where there is none."""
    from bayes_toe.planning.study_design import paper_study_design, read_study_design

    if not files:
        return {"the paper's pairs": paper_study_design()}
    if len(files) == 1:
        return {"these pairs": read_study_design(files[0])}
    names = [file.stem for file in files]
    repeated = [name for name in names if names.count(name) > 1]
    if repeated:
        raise InputError(f"designs: found {quoted(repeated[0])} twice, allowed: files with different names")
    return {name: read_study_design(file) for name, file in zip(names, files, strict=True)}


def _numbers(text: str) -> list[int]:
    try:
        numbers = [int(part) for part in text.split(",")]
    except ValueError:
        numbers = [0]
    if min(numbers) < 1:
        raise InputError(f"--trials: found {quoted(text)}, allowed: whole numbers of at least 1, separated by commas")
    return sorted(set(numbers))
