"""Commands that draw: figures, corner."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bayes_toe.cli import summaries
from bayes_toe.cli.options import InTheirPlace, OneSubject, SavedDraws, StudyFileOrExample, writes
from bayes_toe.cli.saved import saved_draws
from bayes_toe.cli.task import SamplingTask, SharedTask, leave_unless_whole

if TYPE_CHECKING:
    from bayes_toe.analysis import Analysis


def figures(
    *,
    study: StudyFileOrExample,
    output: Annotated[Path, writes("DIR", "Folder for the figures.")] = Path("figures"),
    subject: Annotated[
        list[str] | None,
        typer.Option("--subject", help="In Figs. 3 and 5, the first also in Fig. 2; repeat for more. Default: three kinds."),
    ] = None,
    formats: Annotated[list[str] | None, typer.Option("--format", help="pdf, png or svg; repeat for more. Default: pdf and png.")] = None,
    posterior: InTheirPlace = None,
    task: SamplingTask,
) -> None:
    """The paper's figures of a study, with captions: 1C, 2 to 6 and Appendix C's.

    [bold]Example[/bold]: bayes-toe figures --posterior results/posterior.nc -o figures --subject S06 --subject S04
    """
    from bayes_toe.inference.draws import Draws
    from bayes_toe.plots.paper_figures import FIGURES, products, write_figures

    chosen = ["pdf", "png"] if formats is None else formats
    task.require_folder(output, products(chosen))
    found = _sampled(study, subject, task) if posterior is None else saved_draws(posterior, study, task)
    draws = found if isinstance(found, Draws) else found.draws
    summaries.say_draws(task.console, draws)
    with task.progress("drawing", len(FIGURES)) as tick:
        write_figures(found, output, subjects=subject, formats=chosen, overwrite=task.overwrite, workers=task.processes, progress=tick)
    task.say_written("figures and captions in", output, seed=draws.seed)
    leave_unless_whole(task, draws.failed, draws.not_converged)


def _sampled(study: StudyFileOrExample, subjects: list[str] | None, task: SamplingTask) -> Analysis:
    """The study, analysed; refused before the sampling where the figures could not be drawn."""
    from bayes_toe.analysis import run as analyse
    from bayes_toe.data.study import refuse_intervals
    from bayes_toe.plots.paper_figures import require_subjects

    read, prior = task.read(study)
    refuse_intervals(read, "the paper's figures")
    if subjects is not None:
        require_subjects(subjects, read.names)
    task.introduce(read, prior)
    with task.progress("sampling", len(read)) as tick:
        return analyse(read, draws=task.draws, seed=task.seed, prior=prior, workers=task.workers, progress=tick)


def corner(
    *,
    posterior: SavedDraws,
    output: Annotated[Path, writes("DIR", "Folder for one PNG a subject.")] = Path("corner"),
    subject: OneSubject = None,
    coordinates: Annotated[str, typer.Option("--coordinates", help="natural or identified.")] = "natural",
    task: SharedTask,
) -> None:
    """Corner plots of saved draws, one PNG a subject.

    [bold]Example[/bold]: bayes-toe corner posterior.nc -o corner --subject S01
    """
    from bayes_toe.cli.results_folder import corner_files, draw_corners
    from bayes_toe.data.whole_folders import whole_folder
    from bayes_toe.inference.draws import load

    loaded = load(posterior)
    chosen = loaded.names if subject is None else (loaded.select(subject).names[0],)
    files = corner_files(loaded, chosen)
    task.require_folder(output, list(files.values()))
    made = whole_folder(output, list(files.values()), required=list(files.values()), overwrite=task.overwrite)
    with made as target, task.progress("drawing", len(chosen)) as tick:
        draw_corners(posterior, files, target, coordinates=coordinates, workers=task.workers, progress=tick)
    task.say_written(f"{len(files)} corner plot{'' if len(files) == 1 else 's'} in", output)
