"""The results folder of one analysis: draws, tables, corner plots and report, all of them or none."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from bayes_toe.api import Analysis
from bayes_toe.corner_plot import corner
from bayes_toe.draws import Draws
from bayes_toe.outputs import file_stems, whole_folder, write_table
from bayes_toe.parallel import run_jobs
from bayes_toe.plots import curves, evidence_figure, png
from bayes_toe.prior import Prior
from bayes_toe.report import Pictures, write_report

Progress = Callable[[str], None]
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
    with_curves: bool


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
        prior = analysis.settings.prior
        jobs = [_drawing(analysis.draws, name, prior=prior, truth=truth, with_curves=True) for name in names]
        drawn = _draw_all(jobs, workers, progress)
        corners = {name: pictures[0] for name, pictures in drawn.items()}
        write_corners(corners, target / "corner", corner_files(analysis.draws, names))
        overview = png(evidence_figure(analysis.evidence, synthetic=analysis.study.synthetic))
        pictures = Pictures(overview, {name: found[1] for name, found in drawn.items()}, corners)
        write_report(analysis, summary, pictures, target / "report.html")
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
    return {name: pictures[0] for name, pictures in _draw_all(jobs, workers, progress).items()}


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
    with_curves: bool = False,
) -> _Drawing:
    of_subject = None if truth is None else truth.get(subject)
    return _Drawing(draws.select(subject), subject, coordinates, prior, of_subject, with_curves)


def _draw_all(jobs: Sequence[_Drawing], workers: int | None, progress: Progress | None) -> dict[str, tuple[bytes, bytes]]:
    drawn: dict[int, tuple[bytes, bytes]] = {}
    for index, pictures in run_jobs(_draw_one, jobs, workers):
        drawn[index] = pictures
        if progress is not None:
            progress(jobs[index].subject)
    return {job.subject: drawn[index] for index, job in enumerate(jobs)}


def _draw_one(job: _Drawing) -> tuple[bytes, bytes]:
    figure = corner(job.draws, job.subject, coordinates=job.coordinates, truths=job.truth, prior=job.prior)
    return png(figure, dpi=110), png(curves(job.draws, job.subject), dpi=120) if job.with_curves else b""
