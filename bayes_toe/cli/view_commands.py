"""The commands `explore`, `corner` and `app`.

`explore` writes an HTML page of saved draws, and `corner` draws corner plots of them. `app` starts
the web page that analyses studies.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import bayes_toe as bt
from bayes_toe.cli.options import (
    NUMBER,
    OutputFolder,
    Texts,
    TrueValues,
    flag,
    option,
    writes,
)
from bayes_toe.cli.run_context import WORKERS, RunContext
from bayes_toe.data.messages import display_name, join_names, plural, quoted

if TYPE_CHECKING:
    from bayes_toe.data.read_study import Truth


def explore(
    *,
    posteriors: Annotated[
        list[Path],
        typer.Argument(
            metavar="posterior.nc...",
            help="Draws saved by run or sample.",
        ),
    ],
    output: Annotated[Path, writes("FILE.html", "Output page.")] = Path("explorer.html"),
    subject: Annotated[Texts, option("--subject", "NAME", "Only this subject; repeatable.")] = None,
    truth: TrueValues = None,
    context: Annotated[RunContext, "overwrite"],
) -> None:
    """Write a page that shows saved draws in a browser.

    [bold]Example[/bold]: bayes-toe explore posterior.nc -o explorer.html
    """
    from bayes_toe.explorer.page import entries, page, require_bokeh
    from bayes_toe.inference.draws import load_draws

    require_bokeh()
    context.require_files(output)

    loaded = list(map(load_draws, posteriors))
    names = subject or list(chain.from_iterable(draws.names for draws in loaded))
    page_entries = entries(loaded, subject, read_truth(truth, loaded, names))

    with context.out.progress("packing", len(page_entries)) as tick:
        explorer = page(page_entries, tick)
    explorer.save(output, overwrite=context.overwrite)
    megabytes = len(explorer.html.encode()) / 1e6
    context.print_written(f"Explorer in {output}: {megabytes:.1f} MB, open it in a browser")


def read_truth(path: Path | None, draws: Sequence[bt.Draws], subjects: Sequence[str]) -> Truth:
    """Read the true values of each subject, which figures mark; {} without a file.

    The file has a column subject and one for each quantity that is known. Unknown values are empty.
    An InputError is raised if no subject has a true value of a quantity of the draws.
    """
    from bayes_toe.design.simulate import read_parameters

    if path is None:
        return {}

    # All subjects of a file have the same quantities.
    quantities = chain.from_iterable(part.posterior(part.names[0]).names.all for part in draws)
    # Each quantity once, because several files of draws may have the same quantities.
    truth = read_parameters(path, tuple(dict.fromkeys(quantities)), gaps=True)  # by subject
    if not any(truth.get(name) for name in subjects):
        raise bt.InputError(
            f"{display_name(path.name)}: there are no true values of "
            f"{join_names(list(map(quoted, subjects)), max_items=3)}. Each subject needs a row."
        )
    return truth


def corner(
    *,
    posterior: Annotated[
        Path, typer.Argument(metavar="posterior.nc", help="Draws saved by run or sample.")
    ],
    output: OutputFolder = Path("corner"),
    subject: Annotated[
        Texts,
        option("--subject", "NAME", "Only this subject; repeatable, 2 to 4 in one figure."),
    ] = None,
    parameters: Annotated[
        str,
        option("--parameters", "gain,mu1", "Parameters: natural, identified, or their names."),
    ] = "natural",
    show_prior: Annotated[bool, flag("--show-prior", "Show the prior in grey.")] = False,
    truth: TrueValues = None,
    ending: Annotated[str, option("--format", "NAME", "Format: png, pdf or svg.")] = "png",
    context: Annotated[RunContext, *WORKERS],
) -> None:
    """Draw corner plots of saved draws.

    [bold]Example[/bold]: bayes-toe corner posterior.nc -o corner --subject S01
    """
    from bayes_toe.data.tables import file_stems
    from bayes_toe.data.whole_files import whole_folder
    from bayes_toe.inference.draws import load_draws
    from bayes_toe.plots.corner import COORDINATES, quantity_names
    from bayes_toe.plots.figure_files import require_suffix

    # Unknown formats, subjects and quantities are refused before the work.
    require_suffix(f"corner.{ending}")
    draws = load_draws(posterior)
    names = tuple(subject or draws.names)
    for name in names:
        draws.subject(name)
    truths = read_truth(truth, [draws], names)
    coordinates: str | list[str] = parameters
    if parameters not in COORDINATES:
        coordinates = [name.strip() for name in parameters.split(",")]
    quantity_names(draws.posterior(names[0]), coordinates)

    # Subjects that are named share a figure, such as S01+S02.png; otherwise each has one.
    groups = [names] if subject else [(name,) for name in names]
    stems = file_stems(draws.names)
    subjects_by_file = {}
    for group in groups:
        joint_stem = "+".join(stems[name] for name in group)
        subjects_by_file[f"{joint_stem}.{ending}"] = group

    files = list(subjects_by_file)
    context.require_folder(output, files)
    with whole_folder(output, files, overwrite=context.overwrite) as folder:
        folder = folder.absolute()  # A worker may be in another folder than this process.
        jobs = [
            partial(
                _save_corner,
                folder / file,
                # Draws are copied to the worker. A figure of one subject needs the draws of this
                # subject alone.
                draws[group[0]] if len(group) == 1 else draws,
                group,
                coordinates=coordinates,
                prior=draws.prior if show_prior else None,
                truths=truths,
            )
            for file, group in subjects_by_file.items()
        ]
        context.draw(jobs, files)
    context.print_written(f"{plural(len(files), 'corner plot')} in {output}")


def _save_corner(file: Path, draws: bt.Draws, subjects: Sequence[str], **options: Any) -> None:
    """Draw the corner plot of subjects, and write it; `options` are those of `bt.plots.corner`."""
    bt.plots.save_figure(bt.plots.corner(draws, subjects, **options), file, dpi=150)


def app(
    *,
    folder: Annotated[Path, option("--folder", "DIR", "Folder of the studies.")] = Path(
        "~/bayes_toe_app"
    ),
    port: Annotated[
        int, option("--port", NUMBER, "Port of the page. 0 means a free port.", min=0, max=65535)
    ] = 8750,
    context: RunContext,
) -> None:
    """Analyse studies on a web page of this computer.

    [bold]Example[/bold]: bayes-toe app
    """
    from importlib.util import find_spec

    if find_spec("tornado") is None:
        raise bt.InputError("app needs Tornado: pip install 'bayes_toe[app]'")
    from bayes_toe.app.server import serve

    def ready(address: str) -> None:
        """Print the address of the page when it can be opened."""
        typer.echo(f"Open this address in a browser on this computer:\n{address}")
        typer.echo("Ctrl+C ends the program. Finished subjects stay.")
        sys.stdout.flush()

    raise typer.Exit(128 + serve(folder, port, ready))
