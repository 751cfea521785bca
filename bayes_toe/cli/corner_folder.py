"""The folder of the command `corner`: pictures of saved draws, one a subject or several subjects in one, in any of three formats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from bayes_toe.cli.results_folder import Drawing, corner_files
from bayes_toe.data.messages import quoted
from bayes_toe.data.read_study import Truth
from bayes_toe.errors import InputError
from bayes_toe.inference.draws import Draws
from bayes_toe.plots.corner import corner
from bayes_toe.plots.figure_files import picture, png
from bayes_toe.workers import Progress, Workers, of_this_machine, run_in_order


@dataclass(frozen=True)
class Look:
    """What corner plots show.

    Parameters
    ----------
    coordinates : str or tuple of str
        As :func:`bayes_toe.plots.corner` has them.
    prior : bool
        Whether the prior is drawn that the draws were made under.
    truth : mapping
        True values by subject.
    formats : tuple of str
        Of pdf, png and svg.
    """

    coordinates: str | tuple[str, ...] = "natural"
    prior: bool = False
    truth: Truth = field(default_factory=dict)
    formats: tuple[str, ...] = ("png",)


PLAIN = Look()


def coordinates_of(coordinates: str | None, parameters: str | None, draws: Draws) -> str | tuple[str, ...]:
    """Which quantities are drawn, from --coordinates or --parameters.

    Raises
    ------
    InputError
        If both are given, or a quantity is unknown, repeated or empty.
    """
    if parameters is None:
        return "natural" if coordinates is None else coordinates
    if coordinates is not None:
        raise InputError(f"--parameters {parameters}: found --coordinates {coordinates} too, allowed: one of them")
    names, allowed = tuple(name.strip() for name in parameters.split(",")), draws.posterior(draws.names[0]).names.all
    wrong = [name for name in names if name not in allowed or names.count(name) > 1]
    if wrong:
        raise InputError(f"--parameters {parameters}: found {quoted(wrong[0])}, allowed: each once, of {', '.join(allowed)}")
    return names


def corner_pictures(draws: Draws, chosen: Sequence[str], *, together: bool) -> dict[tuple[str, ...], str]:
    """File names without suffix, by who is in the picture: one subject each, or all of them together."""
    stems = {name: Path(file).stem for name, file in corner_files(draws, tuple(chosen)).items()}
    return {tuple(chosen): "+".join(stems.values())} if together else {(name,): stem for name, stem in stems.items()}


def draw_corners(
    posterior: Path,
    pictures: Mapping[tuple[str, ...], str],
    folder: Path,
    *,
    look: Look = PLAIN,
    workers: Workers = None,
    progress: Progress | None = None,
) -> None:
    """Corner plots from a file of draws, into a folder under the names of :func:`corner_pictures`."""
    here = partial(Drawing, posterior.absolute(), posterior.stat().st_mtime_ns)
    jobs = [partial(_draw_corner, here(names[0]), names, look, folder.absolute() / stem) for names, stem in pictures.items()]
    run_in_order(jobs, of_this_machine(workers), progress, [(names[0],) for names in pictures])


def _draw_corner(one: Drawing, names: tuple[str, ...], look: Look, stem: Path) -> None:
    truths = {name: look.truth[name] for name in names if name in look.truth}
    figure = corner(
        one.draws,
        names if len(names) > 1 else names[0],
        coordinates=look.coordinates,
        truths=truths if len(names) > 1 else truths.get(names[0]),
        prior=one.draws.prior if look.prior else None,
    )
    for suffix in look.formats:
        stem.with_name(f"{stem.name}.{suffix}").write_bytes(png(figure, dpi=110) if suffix == "png" else picture(figure, suffix))
