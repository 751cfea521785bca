"""The results folder of an analysis: draws, tables, figures and report, all of them or none."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from bayes_toe import plots
from bayes_toe.analysis import Analysis
from bayes_toe.answers.evidence_table import EvidenceTable
from bayes_toe.classical.asymmetry import AsymmetryTable, asymmetry_table
from bayes_toe.cli.answers import flagged
from bayes_toe.cli.methods import write_methods
from bayes_toe.cli.report import Facts, Group, write_report
from bayes_toe.data.read_study import Truth
from bayes_toe.data.study import Study
from bayes_toe.data.tables import file_stems, write_table
from bayes_toe.data.whole_files import whole_folder
from bayes_toe.errors import InputError
from bayes_toe.explorer.page import explore
from bayes_toe.inference.draws import Draws, load_draws
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.prior import Prior
from bayes_toe.plots.asymmetry import asymmetry_height
from bayes_toe.plots.corner import corner
from bayes_toe.plots.curves import fitted_figure
from bayes_toe.plots.figure_files import png
from bayes_toe.plots.order_effect import evidence_axes, forest_height
from bayes_toe.plots.paper_figures import write_figures
from bayes_toe.plots.style import LETTERS, legend_below, new_figure
from bayes_toe.workers import Progress, Workers, of_this_machine, run_in_order

if TYPE_CHECKING:
    import pandas as pd

Figure = Any  # of matplotlib, which is of another room
#: What a results folder has of a group and of conditions.
GROUP_PRODUCTS = ("population.csv", "population_subjects.csv", "population.png", "population.nc")
CONTRAST_PRODUCTS = ("contrast.csv", "contrast.png")
#: What each results folder has beside the draws.
ALWAYS = ("summary.csv", "evidence.csv", "report.html", "methods.md", "methods.bib")
#: What a results folder may hold: draws, the group, corner plots, an explorer, pages of very many
#: subjects.
PRODUCTS = (
    "posterior.nc",
    *ALWAYS,
    *CONTRAST_PRODUCTS,
    *GROUP_PRODUCTS,
    "corner",
    "explorer.html",
    "subjects",
    "paper_figures",
)
#: Subjects whose figures may be drawn, and about how many bytes a subject takes in all.
FIGURE_BYTES = {"all": 400_000, "flagged": 60_000, "none": 20_000}
_WIDE, _DOTS = 4.8, 160  # inches of a picture, legible on a telephone, and dots in an inch


@dataclass(frozen=True)
class FigureChoice:
    """Which figures a results folder has.

    Attributes
    ----------
    which : str
        Subjects with corner plot and curves: "all", "none", or "flagged", those that need action.
    truth : dict
        True values by subject, marked in corner plots.
    explorer : bool
        Whether there is explorer.html.
    paper_figures : bool
        Whether there is a folder with the figures of the paper.
    """

    which: str = "all"
    truth: Truth = field(default_factory=dict)
    explorer: bool = False
    paper_figures: bool = False

    def __post_init__(self) -> None:
        if self.which not in FIGURE_BYTES:
            raise InputError(
                f"--figures is {self.which!r}. It must be one of {', '.join(FIGURE_BYTES)}."
            )


ALL = FigureChoice()


def write_results(
    analysis: Analysis,
    folder: str | Path,
    *,
    overwrite: bool = False,
    figures: FigureChoice = ALL,
    workers: Workers = None,
    progress: Progress | None = None,
    spreadsheet_safe: bool = False,
    group: Group | None = None,
) -> Path:
    """Write draws, tables, figures, report and methods of an analysis: all of them, or none.

    Other files of the folder stay. If the folder holds products that may not be replaced, or cannot
    be written, nothing is changed. `progress` is called with each subject whose figures are drawn.
    """
    draws = analysis.draws
    marked = flagged(analysis.answers, draws.not_converged)
    drawn = {"all": draws.names, "flagged": tuple(marked), "none": ()}[figures.which]
    stems = file_stems(draws.names)
    corner_plots = {name: f"corner/{stems[name]}.png" for name in drawn}
    required = ["posterior.nc", *ALWAYS, *corner_plots.values()]
    if analysis.contrast is not None:
        required += CONTRAST_PRODUCTS
    if group is not None:
        required += GROUP_PRODUCTS
    if figures.explorer:
        required.append("explorer.html")
    with (
        whole_folder(folder, PRODUCTS, required=required, overwrite=overwrite) as new,
        TemporaryDirectory(dir=new.absolute()) as temporary,
    ):
        # Absolute, since a worker may be in another folder than this process.
        target, pictures = new.absolute(), Path(temporary)
        draws.save(target / "posterior.nc")
        summary = analysis.summary()
        _write_tables(analysis, summary, group, target, spreadsheet_safe=spreadsheet_safe)
        write_methods(analysis, None if group is None else group.found, target / "methods.md")
        if figures.paper_figures:
            write_figures(analysis, target / "paper_figures")
        if figures.explorer:
            explore(draws, truths=figures.truth or None).save(target / "explorer.html")
        asymmetry = asymmetry_table(analysis.study)
        if drawn:
            (target / "corner").mkdir()
        corner_files = {name: target / file for name, file in corner_plots.items()}
        curve_files = {name: pictures / f"curve_{stems[name]}.png" for name in drawn}
        jobs = _overview_jobs(analysis, asymmetry, pictures)
        names: list[tuple[str, ...]] = [()] * len(jobs)
        saved = partial(
            opened, target / "posterior.nc", (target / "posterior.nc").stat().st_mtime_ns
        )
        curves = {curve.target.subject.name: curve for curve in analysis.curves}
        for name in drawn:
            files = corner_files[name], curve_files[name]
            truth = figures.truth.get(name)
            prior = analysis.settings.prior
            jobs.append(partial(_draw_subject, saved, name, prior, truth, curves[name], *files))
            names.append((name,))
        run_in_order(jobs, of_this_machine(workers), progress, names)
        opened.cache_clear()
        facts = Facts(asymmetry, marked, group, pictures, curve_files, corner_files, figures.which)
        write_report(analysis, facts, target)
    return Path(folder)


def _overview_jobs(
    analysis: Analysis, asymmetry: AsymmetryTable, folder: Path
) -> list[Callable[[], None]]:
    """Jobs that draw the figures of all subjects."""
    title = _title(analysis.study)
    jobs: list[Callable[[], None]] = [
        partial(_draw_evidence, folder / "evidence.png", analysis.evidence, title)
    ]
    if any(row.comparisons for row in asymmetry):  # else no pair was presented in both orders
        jobs.append(partial(_draw_asymmetry, folder / "asymmetry.png", asymmetry))
    return jobs


@lru_cache(maxsize=1)
def opened(posterior: Path, changed: int) -> Draws:
    """A file of draws, which a process opens once for all its jobs.

    By the time of its last change, since another may get its name.
    """
    return load_draws(posterior)


def _write_tables(
    analysis: Analysis,
    summary: pd.DataFrame,
    group: Group | None,
    folder: Path,
    *,
    spreadsheet_safe: bool,
) -> None:
    """All tables, with the figures and draws that go with those of conditions and of the group."""
    study = analysis.study
    of_units: dict[str, Any] = {
        "spreadsheet_safe": spreadsheet_safe,
        "units": study.conditions is not None,
    }
    write_table(summary, folder / "summary.csv", **of_units)
    analysis.evidence.save(folder / "evidence.csv", **of_units)
    if analysis.contrast is not None:
        analysis.contrast.save(folder / "contrast.csv", spreadsheet_safe=spreadsheet_safe)
        of_group = None if group is None else group.found
        figure = plots.contrast(analysis.contrast, of_group, synthetic=study.synthetic)
        (folder / "contrast.png").write_bytes(png(figure))
    if group is not None:
        group.found.table.save(folder / "population.csv", spreadsheet_safe=spreadsheet_safe)
        group.found.subject_table.save(
            folder / "population_subjects.csv", spreadsheet_safe=spreadsheet_safe
        )
        (folder / "population.png").write_bytes(png(plots.population(group.found, group.check)))
        group.found.save(folder / "population.nc")


# --- pictures, each drawn wherever there is a worker ----------------------------------------------


def _draw_evidence(file: Path, evidence: EvidenceTable, title: str) -> None:
    figure = new_figure(_WIDE, forest_height(len(evidence)))
    ax = figure.subplots()
    evidence_axes(ax, evidence)
    ax.set_title(title, fontsize=LETTERS, loc="right")
    legend_below(figure, size=LETTERS, columns=2)
    file.write_bytes(png(figure, dpi=_DOTS))


def _draw_asymmetry(file: Path, asymmetry: AsymmetryTable) -> None:
    figure = new_figure(_WIDE, asymmetry_height(asymmetry))
    plots.asymmetry(asymmetry, figure.subplots())
    file.write_bytes(png(figure, dpi=_DOTS))


def _draw_subject(
    saved: Callable[[], Draws],
    name: str,
    prior: Prior,
    truth: Mapping[str, float] | None,
    fitted: Predictor,
    corner_file: Path,
    curve_file: Path,
) -> None:
    draws = saved()
    corner_file.write_bytes(png(corner(draws, name, truths=truth, prior=prior), dpi=110))
    curve_file.write_bytes(png(fitted_figure(fitted, _title(draws)), dpi=120))


def _title(source: Study | Draws) -> str:
    """The title of a picture that stands under a heading."""
    return "synthetic data" if source.synthetic else ""
