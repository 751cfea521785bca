"""Commands that draw: figures, corner, explore."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bayes_toe.cli import summaries
from bayes_toe.cli.options import OneSubject, SavedDraws, StudyFileOrExample, writes
from bayes_toe.cli.task import SamplingTask, SharedTask, WritingTask, leave_unless_whole


def figures(
    *,
    study: StudyFileOrExample,
    output: Annotated[Path, writes("DIR", "Folder for the figures.")] = Path("figures"),
    subject: Annotated[
        list[str] | None,
        typer.Option("--subject", help="In Figs. 3 and 5, the first also in Fig. 2; repeat for more. Default: three kinds."),
    ] = None,
    formats: Annotated[list[str] | None, typer.Option("--format", help="pdf, png or svg; repeat for more. Default: pdf and png.")] = None,
    task: SamplingTask,
) -> None:
    """The paper's figures of a study, with captions: 1C, 2 to 6 and Appendix C's.

    [bold]Example[/bold]: bayes-toe figures study.csv -o figures --subject S06 --subject S04 --seed 1
    """
    from bayes_toe.analysis import run as analyse
    from bayes_toe.data.study import refuse_intervals
    from bayes_toe.plots.paper_figures import FIGURES, products, require_subjects, write_figures

    chosen = ["pdf", "png"] if formats is None else formats
    task.require_folder(output, products(chosen))
    read, prior = task.read(study)
    refuse_intervals(read, "the paper's figures")  # before the sampling
    if subject is not None:
        require_subjects(subject, read.names)
    task.introduce(read, prior)
    with task.progress("sampling", len(read)) as tick:
        analysis = analyse(read, draws=task.draws, seed=task.seed, prior=prior, workers=task.workers, progress=tick)
    summaries.say_draws(task.console, analysis.draws)
    with task.progress("drawing", len(FIGURES)) as tick:
        write_figures(analysis, output, subjects=subject, formats=chosen, overwrite=task.overwrite, workers=task.processes, progress=tick)
    task.say_written("figures and captions in", output, seed=analysis.settings.seed)
    leave_unless_whole(task, analysis.draws.failed, analysis.draws.not_converged)


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


def explore(
    *,
    posteriors: Annotated[
        list[Path], typer.Argument(metavar="posterior.nc...", help="Draws written by run or sample; of several models, several files.")
    ],
    output: Annotated[Path, writes("FILE", "The page.")] = Path("explorer.html"),
    subject: Annotated[list[str] | None, typer.Option("--subject", help="Only this subject; repeat for more.")] = None,
    truth: Annotated[
        Path | None, typer.Option("--truth", metavar="truth.csv", help="True parameters of synthetic subjects, as simulate writes them.")
    ] = None,
    population: Annotated[
        Path | None, typer.Option("--population", metavar="population.nc", help="The group's posterior, to stand behind its subjects.")
    ] = None,
    task: WritingTask,
) -> None:
    """One page to explore posteriors in a browser: drag over points, and draws, curves and quantiles follow.

    A file for itself: no server, no network. Two subjects, or two models of one, stand against each other.

    [bold]Example[/bold]: bayes-toe explore posterior.nc -o explorer.html
    """
    from bayes_toe.explorer.page import entries, page, require_bokeh
    from bayes_toe.explorer.truth import read_truth
    from bayes_toe.groups.population_file import load_population
    from bayes_toe.inference.draws import load

    require_bokeh()
    task.require_files(output)
    known = None if truth is None else read_truth(truth)
    loaded = [load(path) for path in posteriors]
    group = None if population is None else load_population(population)
    found = entries(loaded, subjects=subject, truths=known, population=group)
    with task.progress("packing", len(found)) as tick:
        made = page(found, group, tick)
    made.save(output, overwrite=task.overwrite)
    task.say_written("explorer in", output, ending=f": {len(made.html.encode()) / 1e6:.1f} MB, open it in a browser")
