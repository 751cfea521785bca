"""Commands that show saved draws, explore and corner, and the web page, app."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import bayes_toe as bt
from bayes_toe.cli.options import (
    NUMBER,
    SavedDraws,
    TrueValues,
    flag,
    rare,
    writes,
)
from bayes_toe.cli.task import WORKERS, Takes, Task
from bayes_toe.data.messages import bare, counted, listed, quoted

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
    output: Annotated[Path, writes("FILE.html", "Page.")] = Path("explorer.html"),
    subject: Annotated[
        list[str] | None,
        typer.Option("--subject", metavar="NAME", help="Only this subject; repeatable."),
    ] = None,
    truth: TrueValues = None,
    task: Annotated[Task, Takes("overwrite")],
) -> None:
    """Write a page that shows saved draws in a browser.

    [bold]Example[/bold]: bayes-toe explore posterior.nc -o explorer.html
    """
    from bayes_toe.explorer.page import entries, page, require_bokeh
    from bayes_toe.inference.draws import load_draws

    require_bokeh()
    task.require_files(output)
    loaded = [load_draws(path) for path in posteriors]
    known = (
        None
        if truth is None
        else read_truth(truth, loaded, subject or [name for one in loaded for name in one.names])
    )
    found = entries(loaded, subject, known)
    with task.out.progress("packing", len(found)) as tick:
        made = page(found, tick)
    made.save(output, overwrite=task.overwrite)
    task.done(
        "explorer in",
        output,
        ending=f": {len(made.html.encode()) / 1e6:.1f} MB, open it in a browser",
    )


def read_truth(path: Path, draws: Sequence[bt.Draws], subjects: Sequence[str]) -> Truth:
    """True values by subject, to draw marks at.

    A column subject, and one for each quantity that is known, empty where it is not.

    With intervals sigma_p is per square root of a second in the file, as `simulate` writes it, and
    over the draws' reference interval here. Refused with a line per problem, also where there is no
    true value of any of these subjects that a model of these draws has.
    """
    from bayes_toe.data.validation import read_numbers

    quantities = list(
        dict.fromkeys(name for one in draws for name in one.posterior(one.names[0]).names.all)
    )
    names, columns = read_numbers(path, (), "subject", optional=quantities, gaps=True)
    interval = next((one.prior.reference_interval for one in draws if one.intervals), None)
    if interval is not None and "sigma_p" in columns:
        columns["sigma_p"] = columns["sigma_p"] * interval**0.5
    values = {key: column.tolist() for key, column in columns.items()}
    found = {
        name: {key: cells[row] for key, cells in values.items() if cells[row] == cells[row]}
        for row, name in enumerate(names)
    }
    if not any(found.get(name) for name in subjects):
        raise bt.InputError(
            f"{bare(path.name)}: there are no true values of "
            f"{listed([*map(quoted, subjects)], 3)}. Each subject needs a row."
        )
    return found


def corner(
    *,
    posterior: SavedDraws,
    output: Annotated[Path, writes("DIR", "Folder.")] = Path("corner"),
    subject: Annotated[
        list[str] | None,
        typer.Option(
            "--subject", metavar="NAME", help="Only this subject; repeatable, 2 to 4 in one figure."
        ),
    ] = None,
    parameters: Annotated[
        str | None,
        typer.Option(
            "--parameters",
            metavar="gain,mu1",
            help="Parameters to show.",
        ),
    ] = None,
    coordinates: Annotated[
        str | None, rare("--coordinates", metavar="NAME", help="natural (default) or identified.")
    ] = None,
    show_prior: Annotated[bool, flag("--show-prior", help="Show the prior in grey.")] = False,
    truth: TrueValues = None,
    formats: Annotated[
        list[str] | None,
        typer.Option("--format", metavar="NAME", help="png (default), pdf or svg; repeatable."),
    ] = None,
    task: Annotated[Task, Takes(*WORKERS)],
) -> None:
    """Draw corner plots of saved draws.

    [bold]Example[/bold]: bayes-toe corner posterior.nc -o corner --subject S01
    """
    from bayes_toe.cli.results_folder import opened
    from bayes_toe.data.tables import file_stems
    from bayes_toe.data.whole_files import whole_folder
    from bayes_toe.inference.draws import load_draws
    from bayes_toe.plots.figure_files import require_formats
    from bayes_toe.workers import of_this_machine, run_in_order

    endings, draws = require_formats(["png"] if formats is None else formats), load_draws(posterior)
    chosen = draws.names if subject is None else tuple(subject)
    for name in chosen:
        draws.subject(name)  # refuses who is not there
    known = {} if truth is None else read_truth(truth, [draws], chosen)
    look = {
        "coordinates": _quantities(coordinates, parameters, draws),
        "prior": draws.prior if show_prior else None,
    }
    stems, together = file_stems(draws.names), subject is not None and len(chosen) > 1
    pictures = {
        names: "+".join(stems[name] for name in names)
        for names in ([chosen] if together else [(name,) for name in chosen])
    }
    files = [f"{stem}.{ending}" for stem in pictures.values() for ending in endings]
    task.require_folder(output, files)
    made = whole_folder(output, files, required=files, overwrite=task.overwrite)
    with made as target, task.out.progress("drawing", len(pictures)) as tick:
        here = partial(
            _draw_corner,
            partial(opened, posterior.absolute(), posterior.stat().st_mtime_ns),
            endings=endings,
            look=look,
        )
        jobs = [
            partial(here, {name: known.get(name) for name in names}, target.absolute() / stem)
            for names, stem in pictures.items()
        ]
        run_in_order(jobs, of_this_machine(task.workers), tick, [(names[0],) for names in pictures])
    task.done(f"{counted(len(pictures), 'corner plot')} in", output)


def _quantities(
    coordinates: str | None, parameters: str | None, draws: bt.Draws
) -> str | tuple[str, ...]:
    """Which quantities are drawn, from --coordinates or --parameters."""
    if parameters is None:
        return "natural" if coordinates is None else coordinates
    if coordinates is not None:
        raise bt.InputError(
            f"--parameters {parameters} and --coordinates {coordinates} exclude each other."
        )
    names, allowed = (
        tuple(name.strip() for name in parameters.split(",")),
        draws.posterior(draws.names[0]).names.all,
    )
    wrong = [name for name in names if name not in allowed or names.count(name) > 1]
    if wrong:
        raise bt.InputError(
            f"--parameters {parameters}: {quoted(wrong[0])} is unknown or named twice. The "
            f"parameters are {', '.join(allowed)}."
        )
    return names


def _draw_corner(
    draws: Any,
    truths: Mapping[str, Any],
    stem: Path,
    *,
    endings: Sequence[str],
    look: Mapping[str, Any],
) -> None:
    """One picture of one subject or of several, in every format; `draws` opens them where this is run."""
    from bayes_toe.plots.figure_files import picture, png

    names, known = tuple(truths), {name: true for name, true in truths.items() if true is not None}
    one = len(names) == 1
    figure = bt.plots.corner(
        draws(), names[0] if one else names, truths=known.get(names[0]) if one else known, **look
    )
    for ending in endings:
        stem.with_name(f"{stem.name}.{ending}").write_bytes(
            png(figure, dpi=110) if ending == "png" else picture(figure, ending)
        )


def app(
    *,
    folder: Annotated[
        Path, typer.Option("--folder", metavar="DIR", help="Folder of the page's studies.")
    ] = Path("~/bayes_toe_app"),
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, metavar=NUMBER, help="Port; 0: a free one.")
    ] = 8750,
    task: Annotated[Task, Takes()],
) -> None:
    """Analyse studies on a web page of this computer.

    [bold]Example[/bold]: bayes-toe app
    """
    from importlib.util import find_spec

    if find_spec("tornado") is None:
        raise bt.InputError("app needs Tornado: pip install 'bayes_toe[app]'")
    from bayes_toe.app.server import serve

    def ready(address: str) -> None:
        typer.echo(f"Open this address in a browser on this computer:\n{address}")
        typer.echo("Ctrl+C ends the program. Finished subjects stay.")
        sys.stdout.flush()

    raise typer.Exit(128 + serve(folder.expanduser(), port, ready))
