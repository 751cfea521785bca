"""Commands that draw: figures, corner, explore."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bayes_toe.cli import summaries
from bayes_toe.cli.options import InTheirPlace, SavedDraws, StudyFileOrExample, writes
from bayes_toe.cli.saved import saved_draws
from bayes_toe.cli.task import SamplingTask, SharedTask, WritingTask, leave_unless_whole

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
    mass: Annotated[float, typer.Option("--mass", help="Share of the draws in each ellipse of the map, between 0 and 1.")] = 0.2,
    truth: Annotated[
        Path | None, typer.Option("--truth", metavar="truth.csv", help="True values, columns subject, mu1, sigma_p: squares in the map.")
    ] = None,
    posterior: InTheirPlace = None,
    task: SamplingTask,
) -> None:
    """The paper's figures of a study, with captions: 1C, 2 to 6 and Appendix C's.

    [bold]Example[/bold]: bayes-toe figures --posterior results/posterior.nc -o figures --subject S06 --subject S04
    """
    from bayes_toe.classical.ellipse import require_mass
    from bayes_toe.cli.truth import read_truth
    from bayes_toe.inference.draws import Draws
    from bayes_toe.plots.paper_figures import FIGURES, products, write_figures

    require_mass(mass)
    chosen = ["pdf", "png"] if formats is None else formats
    task.require_folder(output, products(chosen))
    found = _sampled(study, subject, task) if posterior is None else saved_draws(posterior, study, task)
    draws = found if isinstance(found, Draws) else found.draws
    known = None if truth is None else read_truth(truth, [draws], draws.names)
    summaries.say_draws(task.console, draws)
    with task.progress("drawing", len(FIGURES)) as tick:
        write_figures(
            found, output, subjects=subject, formats=chosen, mass=mass, truth=known, overwrite=task.overwrite, workers=task.processes,
            progress=tick,
        )  # fmt: skip
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
    output: Annotated[Path, writes("DIR", "Folder for the pictures, one a subject.")] = Path("corner"),
    subject: Annotated[
        list[str] | None, typer.Option("--subject", help="Only this subject; repeated, two to four subjects in one picture.")
    ] = None,
    parameters: Annotated[
        str | None, typer.Option("--parameters", metavar="gain,mu1", help="Any quantities of the model, natural or identified.")
    ] = None,
    coordinates: Annotated[str | None, typer.Option("--coordinates", help="natural (default) or identified.")] = None,
    show_prior: Annotated[bool, typer.Option("--show-prior", help="The prior of the draws, in grey on the diagonal.")] = False,
    truth: Annotated[
        Path | None, typer.Option("--truth", metavar="truth.csv", help="Known values: columns subject and mu1, gain, ..., marked.")
    ] = None,
    formats: Annotated[list[str] | None, typer.Option("--format", help="pdf, png or svg; repeat for more. Default: png.")] = None,
    task: SharedTask,
) -> None:
    """Corner plots of saved draws, one a subject, or several subjects in one.

    [bold]Example[/bold]: bayes-toe corner posterior.nc -o corner --subject S01 --subject S04 --parameters gain,mu1 --show-prior
    """
    from bayes_toe.cli.corner_folder import Look, coordinates_of, corner_pictures, draw_corners
    from bayes_toe.cli.truth import read_truth
    from bayes_toe.data.whole_folders import whole_folder
    from bayes_toe.inference.draws import load
    from bayes_toe.plots.figure_files import require_formats

    chosen_formats = require_formats(["png"] if formats is None else formats)
    loaded = load(posterior)
    chosen = loaded.names if subject is None else tuple(subject)
    for name in chosen if subject else ():
        loaded.subject(name)  # refuses who is not there
    known = {} if truth is None else read_truth(truth, [loaded], chosen)
    look = Look(coordinates_of(coordinates, parameters, loaded), show_prior, known, chosen_formats)
    pictures = corner_pictures(loaded, chosen, together=subject is not None and len(chosen) > 1)
    files = [f"{stem}.{suffix}" for stem in pictures.values() for suffix in chosen_formats]
    task.require_folder(output, files)
    made = whole_folder(output, files, required=files, overwrite=task.overwrite)
    with made as target, task.progress("drawing", len(pictures)) as tick:
        draw_corners(posterior, pictures, target, look=look, workers=task.workers, progress=tick)
    task.say_written(f"{len(pictures)} corner plot{'' if len(pictures) == 1 else 's'} in", output)


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
    from bayes_toe.cli.truth import read_truth
    from bayes_toe.explorer.page import entries, page, require_bokeh
    from bayes_toe.groups.population_file import load_population
    from bayes_toe.inference.draws import load

    require_bokeh()
    task.require_files(output)
    loaded = [load(path) for path in posteriors]
    known = None if truth is None else read_truth(truth, loaded, subject or [name for one in loaded for name in one.names])
    group = None if population is None else load_population(population)
    found = entries(loaded, subjects=subject, truths=known, population=group)
    with task.progress("packing", len(found)) as tick:
        made = page(found, group, tick)
    made.save(output, overwrite=task.overwrite)
    task.say_written("explorer in", output, ending=f": {len(made.html.encode()) / 1e6:.1f} MB, open it in a browser")
