"""The results folder of one analysis: draws, tables, corner plots and report, all of them or none."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from bayes_toe.analysis import Analysis
from bayes_toe.classical.asymmetry import AsymmetryTable, subject_asymmetry
from bayes_toe.cli.report import Facts, Pictures, write_report
from bayes_toe.comparison.evidence_table import EvidenceTable
from bayes_toe.data.file_names import file_stems
from bayes_toe.data.study import Study
from bayes_toe.data.tables import write_table
from bayes_toe.data.whole_folders import whole_folder
from bayes_toe.errors import InputError
from bayes_toe.inference.draws import Draws
from bayes_toe.inference.subject import Settings
from bayes_toe.model.prior import Prior
from bayes_toe.plots.asymmetry import asymmetry_axes, asymmetry_height
from bayes_toe.plots.corner import corner
from bayes_toe.plots.curves import curves
from bayes_toe.plots.evidence import evidence_figure
from bayes_toe.plots.figure_files import png
from bayes_toe.plots.intervals import interval_curves
from bayes_toe.plots.map import study_map_axes, without_pointwise
from bayes_toe.plots.prior_predictive import prior_predictive_figure
from bayes_toe.plots.style import new_figure
from bayes_toe.workers import Progress, Workers, run_in_order

Truth = Mapping[str, Mapping[str, float]]

#: What a results folder may hold; draws in one of two ways.
PRODUCTS = ("posterior.nc", "posterior.zarr", "summary.csv", "evidence.csv", "corner", "report.html")
#: Of a subject, about: two pictures, and both again in the report.
PICTURE_BYTES = 400_000


class _Drawn(NamedTuple):
    """Corner plot and fitted curves of one subject."""

    corner: bytes
    curves: bytes


def write_results(
    analysis: Analysis,
    folder: str | Path,
    *,
    overwrite: bool = False,
    store: str = "nc",
    truth: Truth | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    spreadsheet_safe: bool = False,
) -> Path:
    """Write posterior.nc (or .zarr), summary.csv, evidence.csv, corner/*.png and report.html into `folder`.

    Parameters
    ----------
    analysis : Analysis
    folder : path
        Made where it is missing; other files in it are left alone.
    overwrite : bool
        Whether existing products may be replaced.
    store : str
        "nc" or "zarr".
    truth : mapping, optional
        True natural parameters by subject, for synthetic studies; shown in the corner plots.
    workers, progress
        As in :func:`bayes_toe.analysis.run`.
    spreadsheet_safe : bool
        As in :func:`bayes_toe.data.tables.write_table`.

    Raises
    ------
    OutputError
        If the folder cannot be written or holds products already; nothing is changed then.
    """
    names = analysis.draws.names
    corner_names = corner_files(analysis.draws, names)
    posterior = draws_in(Path(), store).name
    required = (posterior, "summary.csv", "evidence.csv", "report.html", *(f"corner/{name}" for name in corner_names.values()))
    with whole_folder(folder, PRODUCTS, required=required, overwrite=overwrite) as target:
        analysis.draws.save(target / posterior)
        summary = analysis.summary()
        write_table(summary, target / "summary.csv", spreadsheet_safe=spreadsheet_safe)
        analysis.evidence.save(target / "evidence.csv", spreadsheet_safe=spreadsheet_safe)
        asymmetry = AsymmetryTable(tuple(subject_asymmetry(subject) for subject in analysis.study))
        wide, of_subjects = _overviews(analysis, asymmetry), _pictures_of_subjects(analysis, {} if truth is None else truth)
        done = run_in_order([*wide, *of_subjects], workers, progress, [*((),) * len(wide), *((name,) for name in names)])
        evidence, effects, study_map, prior = (found for found in done if isinstance(found, bytes))
        drawn = dict(zip(names, (found for found in done if isinstance(found, _Drawn)), strict=True))
        corners = {name: found.corner for name, found in drawn.items()}
        write_corners(corners, target / "corner", corner_names)
        pictures = Pictures(evidence, effects, study_map, prior, {name: found.curves for name, found in drawn.items()}, corners)
        facts = Facts(summary, asymmetry)
        write_report(analysis, facts, pictures, target / "report.html")
    return Path(folder)


def draws_in(folder: Path, store: str) -> Path:
    """Where the draws of a results folder are, "nc" or "zarr"."""
    if store not in ("nc", "zarr"):
        raise InputError(f"--store {store}: allowed: nc, zarr")
    return folder / f"posterior.{store}"


def draw_corners(
    draws: Draws,
    subjects: Sequence[str],
    *,
    coordinates: str = "natural",
    workers: Workers = None,
    progress: Progress | None = None,
) -> dict[str, bytes]:
    """Corner plots of some subjects as PNG, by subject."""
    jobs = [partial(_corner, draws.select(name), name, coordinates=coordinates) for name in subjects]
    return dict(zip(subjects, run_in_order(jobs, workers, progress, [(name,) for name in subjects]), strict=True))


def write_corners(pictures: Mapping[str, bytes], folder: Path, files: Mapping[str, str]) -> None:
    """Write one PNG a subject under the names of :func:`corner_files`."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, picture in pictures.items():
        (folder / files[name]).write_bytes(picture)


def corner_files(draws: Draws, subjects: Sequence[str]) -> dict[str, str]:
    """File name of each subject's corner plot: safe, and the same whether one subject is drawn or all."""
    stems = file_stems(draws.names)
    return {name: f"{stems[name]}.png" for name in subjects}


def _overviews(analysis: Analysis, asymmetry: AsymmetryTable) -> list[Callable[[], bytes]]:
    """Calls that draw evidence, asymmetry, map and prior, in the order of :class:`Pictures`."""
    return [
        partial(_draw_evidence, analysis.evidence, synthetic=analysis.study.synthetic),
        partial(_draw_asymmetry, asymmetry),
        partial(_draw_map, without_pointwise(analysis.draws)),
        partial(_draw_prior, analysis.study, analysis.settings),
    ]


def _pictures_of_subjects(analysis: Analysis, truth: Truth) -> list[Callable[[], _Drawn]]:
    """Calls that draw one subject each; a call takes the draws of its subject only, small enough to send to another process."""
    draws, prior = analysis.draws, analysis.settings.prior
    return [partial(_draw_subject, draws.select(name), name, prior, truth.get(name)) for name in draws.names]


def _draw_subject(draws: Draws, subject: str, prior: Prior, truth: Mapping[str, float] | None) -> _Drawn:
    fitted = interval_curves if draws.intervals else curves
    return _Drawn(_corner(draws, subject, prior=prior, truth=truth), png(fitted(draws, subject), dpi=120))


def _corner(
    draws: Draws, subject: str, *, coordinates: str = "natural", prior: Prior | None = None, truth: Mapping[str, float] | None = None
) -> bytes:
    return png(corner(draws, subject, coordinates=coordinates, truths=truth, prior=prior), dpi=110)


def _draw_evidence(table: EvidenceTable, *, synthetic: bool) -> bytes:
    return png(evidence_figure(table, synthetic=synthetic))


def _draw_asymmetry(table: AsymmetryTable) -> bytes:
    """Empty where no pair was presented in both orders."""
    if not any(row.comparisons for row in table):
        return b""
    figure = new_figure(4.8, asymmetry_height(table))
    asymmetry_axes(table, figure.subplots())
    return png(figure, dpi=120)


def _draw_prior(study: Study, settings: Settings) -> bytes:
    return png(prior_predictive_figure(study, settings.prior, seed=settings.seed))


def _draw_map(draws: Draws) -> bytes:
    figure = new_figure(5.4, 4.0)
    study_map_axes(draws, figure.subplots())
    return png(figure, dpi=120)
