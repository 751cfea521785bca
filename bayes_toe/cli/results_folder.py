"""The results folder of one analysis: draws, tables, corner plots and report, all of them or none."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bayes_toe.api import Analysis
from bayes_toe.classical.asymmetry import AsymmetryTable, subject_asymmetry
from bayes_toe.cli.report import Facts, Pictures, write_report
from bayes_toe.comparison.evidence_table import EvidenceTable
from bayes_toe.comparison.predictive_checks import FitSummary, summarise_fit
from bayes_toe.data.file_names import file_stems
from bayes_toe.data.tables import write_table
from bayes_toe.data.whole_folders import whole_folder
from bayes_toe.inference.draws import Draws
from bayes_toe.model.coordinates import Natural, unconstrained
from bayes_toe.model.interval_posterior import posterior_of
from bayes_toe.model.prior import Prior
from bayes_toe.plots.asymmetry import asymmetry_axes, asymmetry_height
from bayes_toe.plots.corner import corner
from bayes_toe.plots.intervals import interval_curves
from bayes_toe.plots.map import study_map_axes, without_pointwise
from bayes_toe.plots.style import curves, evidence_figure, new_figure, png
from bayes_toe.workers import Progress, run_jobs

Truth = Mapping[str, Mapping[str, float]]

#: What a results folder holds.
PRODUCTS = ("posterior.nc", "summary.csv", "evidence.csv", "corner", "report.html")


@dataclass(frozen=True, eq=False)
class _Drawing:
    """Everything that the pictures of one subject need; small enough to send to another process."""

    draws: Draws
    subject: str
    coordinates: str
    prior: Prior | None
    truth: Mapping[str, float] | None
    for_report: bool


@dataclass(frozen=True, eq=False)
class _Drawn:
    """Corner plot and, for a report, fitted curves and goodness of fit of one subject."""

    corner: bytes
    curves: bytes = b""
    fit: FitSummary | None = None


@dataclass(frozen=True, eq=False)
class _Overview:
    """A picture of all subjects, by the function that draws it and what that takes."""

    draw: Callable[[Any], bytes]
    material: Any


def write_results(
    analysis: Analysis,
    folder: str | Path,
    *,
    overwrite: bool = False,
    truth: Truth | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Path:
    """Write posterior.nc, summary.csv, evidence.csv, corner/*.png and report.html into `folder`.

    Parameters
    ----------
    analysis : Analysis
    folder : path
        Made where it is missing; other files in it are left alone.
    overwrite : bool
        Whether existing products may be replaced.
    truth : mapping, optional
        True natural parameters by subject, for synthetic studies; shown in the corner plots.
    workers, progress
        As in :func:`bayes_toe.api.run`.

    Raises
    ------
    OutputError
        If the folder cannot be written or holds products already; nothing is changed then.
    """
    names = analysis.draws.names
    with whole_folder(folder, PRODUCTS, overwrite=overwrite) as target:
        analysis.draws.save(target / "posterior.nc")
        summary = analysis.draws.summary()
        write_table(summary, target / "summary.csv")
        analysis.evidence.save(target / "evidence.csv")
        asymmetry = AsymmetryTable(tuple(subject_asymmetry(subject) for subject in analysis.study))
        jobs = [_drawing(analysis.draws, name, prior=analysis.settings.prior, truth=truth, for_report=True) for name in names]
        drawn, overviews = _draw_all(jobs, _overviews(analysis, asymmetry), workers, progress)
        corners = {name: found.corner for name, found in drawn.items()}
        write_corners(corners, target / "corner", corner_files(analysis.draws, names))
        evidence, effects, subjects_map = overviews
        pictures = Pictures(evidence, effects, subjects_map, {name: found.curves for name, found in drawn.items()}, corners)
        facts = Facts(summary, asymmetry, {name: found.fit for name, found in drawn.items() if found.fit is not None})
        write_report(analysis, facts, pictures, target / "report.html")
    return Path(folder)


def draw_corners(
    draws: Draws,
    subjects: Sequence[str],
    *,
    coordinates: str = "natural",
    workers: int | None = None,
    progress: Progress | None = None,
) -> dict[str, bytes]:
    """Corner plots of some subjects as PNG, by subject."""
    jobs = [_drawing(draws, name, coordinates=coordinates) for name in subjects]
    return {name: found.corner for name, found in _draw_all(jobs, (), workers, progress)[0].items()}


def write_corners(pictures: Mapping[str, bytes], folder: Path, files: Mapping[str, str]) -> None:
    """Write one PNG a subject under the names of :func:`corner_files`."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, picture in pictures.items():
        (folder / files[name]).write_bytes(picture)


def corner_files(draws: Draws, subjects: Sequence[str]) -> dict[str, str]:
    """File name of each subject's corner plot: safe, and the same whether one subject is drawn or all."""
    stems = file_stems(draws.names)
    return {name: f"{stems[name]}.png" for name in subjects}


def _drawing(
    draws: Draws,
    subject: str,
    *,
    coordinates: str = "natural",
    prior: Prior | None = None,
    truth: Truth | None = None,
    for_report: bool = False,
) -> _Drawing:
    of_subject = None if truth is None else truth.get(subject)
    return _Drawing(draws.select(subject), subject, coordinates, prior, of_subject, for_report)


def _overviews(analysis: Analysis, asymmetry: AsymmetryTable) -> tuple[_Overview, _Overview, _Overview]:
    """Evidence, asymmetry and map, in the order of :class:`Pictures`."""
    return (
        _Overview(_draw_evidence, (analysis.evidence, analysis.study.synthetic)),
        _Overview(_draw_asymmetry, asymmetry),
        _Overview(_draw_map, without_pointwise(analysis.draws)),
    )


def _draw_all(
    jobs: Sequence[_Drawing], overviews: Sequence[_Overview], workers: int | None, progress: Progress | None
) -> tuple[dict[str, _Drawn], list[bytes]]:
    """Every subject's pictures by name, and the overviews in their order."""
    drawn: dict[int, _Drawn] = {}
    wide: dict[int, bytes] = {}
    everything: list[_Drawing | _Overview] = [*overviews, *jobs]
    for index, found in run_jobs(_draw, everything, workers):
        if isinstance(found, _Drawn):
            drawn[index - len(overviews)] = found
            if progress is not None:
                progress(jobs[index - len(overviews)].subject)
        else:
            wide[index] = found
    return {job.subject: drawn[index] for index, job in enumerate(jobs)}, [wide[index] for index in range(len(overviews))]


def _draw(job: _Drawing | _Overview) -> _Drawn | bytes:
    return job.draw(job.material) if isinstance(job, _Overview) else _draw_one(job)


def _draw_one(job: _Drawing) -> _Drawn:
    picture = png(corner(job.draws, job.subject, coordinates=job.coordinates, truths=job.truth, prior=job.prior), dpi=110)
    if not job.for_report:
        return _Drawn(picture)
    fitted = interval_curves if job.draws.intervals else curves
    return _Drawn(picture, png(fitted(job.draws, job.subject), dpi=120), _fit(job.draws, job.subject))


def _fit(draws: Draws, subject: str) -> FitSummary:
    posterior = posterior_of(draws.subject(subject), draws.prior)
    theta = Natural(*map(np.ravel, draws.natural(subject)))
    return summarise_fit(posterior, unconstrained(theta, posterior.sbar), draws.seed)


def _draw_evidence(material: tuple[EvidenceTable, bool]) -> bytes:
    return png(evidence_figure(material[0], synthetic=material[1]))


def _draw_asymmetry(table: AsymmetryTable) -> bytes:
    """Empty where no pair was presented in both orders."""
    if not any(row.comparisons for row in table):
        return b""
    figure = new_figure(4.8, asymmetry_height(table))
    asymmetry_axes(table, figure.subplots())
    return png(figure, dpi=120)


def _draw_map(draws: Draws) -> bytes:
    figure = new_figure(5.4, 4.0)
    study_map_axes(draws, figure.subplots())
    return png(figure, dpi=120)
