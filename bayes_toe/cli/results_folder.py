"""The results folder of one analysis: draws, tables, corner plots and report, all of them or none."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

from bayes_toe.analysis import Analysis
from bayes_toe.classical.asymmetry import AsymmetryTable, subject_asymmetry
from bayes_toe.cli.attention import flagged
from bayes_toe.cli.group_section import GROUP_PRODUCTS, Group, group_section, write_group
from bayes_toe.cli.report import Facts, Pictures, write_report
from bayes_toe.comparison.evidence_table import EvidenceTable
from bayes_toe.data.read_study import Truth
from bayes_toe.data.study import Study
from bayes_toe.data.tables import file_stems, write_table
from bayes_toe.data.whole_folders import whole_folder
from bayes_toe.errors import InputError
from bayes_toe.inference.draws import Draws, load
from bayes_toe.inference.subject import Settings
from bayes_toe.model.prior import Prior
from bayes_toe.plots.asymmetry import asymmetry_axes, asymmetry_height
from bayes_toe.plots.corner_sheet import corner_sheet
from bayes_toe.plots.curves import curves
from bayes_toe.plots.evidence import evidence_axes, evidence_height, order_effect_axes
from bayes_toe.plots.figure_files import png
from bayes_toe.plots.intervals import interval_curves
from bayes_toe.plots.map import study_map_axes
from bayes_toe.plots.prior_predictive import prior_predictive_figure
from bayes_toe.plots.style import LETTERS, legend_below, new_figure
from bayes_toe.workers import Progress, Workers, of_this_machine, run_in_order

#: What a results folder may hold: draws in one of two ways, the group, corner plots, an explorer, pages of very many subjects.
PRODUCTS = (
    "posterior.nc",
    "posterior.zarr",
    "summary.csv",
    "evidence.csv",
    *GROUP_PRODUCTS,
    "corner",
    "explorer.html",
    "report.html",
    "subjects",
)
#: Whose pictures may be drawn, and about how many bytes a subject that takes: two of them, and both again in the report.
PICTURE_BYTES = {"all": 400_000, "flagged": 60_000, "none": 20_000}
_WIDE, _DOTS = 4.8, 160  # inches of a picture, legible on a telephone, and dots in an inch


@dataclass(frozen=True, eq=False)
class Drawing:
    """The draws of one subject by their place: what a job to draw them carries, whatever their size.

    Parameters
    ----------
    posterior : Path
        File of draws.
    changed : int
        When it was last, nanoseconds: under the same name there may be another file one day.
    subject : str
    held : Draws, optional
        All draws of the file, where this process has them already; they stay in it.
    """

    posterior: Path
    changed: int
    subject: str
    held: Draws | None = None

    def __reduce__(self) -> tuple[type[Drawing], tuple[Path, int, str]]:
        return Drawing, (self.posterior, self.changed, self.subject)

    @property
    def draws(self) -> Draws:
        """All draws of the file; a process opens it once for all its jobs."""
        return _opened(self.posterior, self.changed) if self.held is None else self.held


@lru_cache(maxsize=1)
def _opened(posterior: Path, _: int) -> Draws:
    return load(posterior)


@dataclass(frozen=True)
class Drawn:
    """Of which subjects corner plot and curves are drawn, what the corner plots show, and whether there is an explorer.

    Parameters
    ----------
    which : str
        "all", "flagged" (those of :func:`bayes_toe.cli.attention.flagged`) or "none".
    truth : mapping
        True natural parameters by subject, for synthetic studies.
    explorer : bool
        Whether there is explorer.html, too, of all of them: see :func:`bayes_toe.explorer.page.explore`.

    Raises
    ------
    InputError
        If `which` is another word.
    """

    which: str = "all"
    truth: Truth = field(default_factory=dict)
    explorer: bool = False

    def __post_init__(self) -> None:
        if self.which not in PICTURE_BYTES:
            raise InputError(f"pictures={self.which!r}: allowed are {', '.join(PICTURE_BYTES)}")

    def names(self, names: tuple[str, ...], marked: Iterable[str]) -> tuple[str, ...]:
        """Those of all names that are drawn."""
        return {"all": names, "flagged": tuple(marked), "none": ()}[self.which]


ALL = Drawn()


def write_results(
    analysis: Analysis,
    folder: str | Path,
    *,
    overwrite: bool = False,
    store: str = "nc",
    pictures: Drawn = ALL,
    workers: Workers = None,
    progress: Progress | None = None,
    spreadsheet_safe: bool = False,
    group: Group | None = None,
) -> Path:
    """Write posterior.nc (.zarr), summary.csv, evidence.csv, corner/*.png and report.html, of very many subjects also subjects/*.html.

    Where it is asked for, explorer.html too.

    Parameters
    ----------
    analysis : Analysis
    folder : path
        Made where it is missing; other files in it are left alone.
    overwrite : bool
        Whether existing products may be replaced.
    store : str
        "nc" or "zarr".
    pictures : Drawn
        Whose corner plot and curves are drawn; by default everybody's.
    workers, progress
        As in :func:`bayes_toe.analysis.run`; progress is told of the subjects that are drawn.
    spreadsheet_safe : bool
        As in :func:`bayes_toe.data.tables.write_table`.
    group : Group, optional
        What the subjects have in common: its tables, figure and draws, and a section of the report.

    Raises
    ------
    OutputError
        If the folder cannot be written or holds products already; nothing is changed then.
    """
    marked = flagged(analysis.evidence, analysis.draws.not_converged, analysis.presets)
    drawn = pictures.names(analysis.draws.names, marked)
    files, posterior = corner_files(analysis.draws, drawn), draws_in(Path(), store).name
    of_group = () if group is None else GROUP_PRODUCTS
    pages = ("explorer.html", "report.html") if pictures.explorer else ("report.html",)
    required = (posterior, "summary.csv", "evidence.csv", *of_group, *pages, *(f"corner/{name}" for name in files.values()))
    with whole_folder(folder, PRODUCTS, required=required, overwrite=overwrite) as new, _drawing_place(new) as (target, place):
        analysis.draws.save(target / posterior)
        summary = analysis.summary()
        write_table(summary, target / "summary.csv", spreadsheet_safe=spreadsheet_safe)
        analysis.evidence.save(target / "evidence.csv", spreadsheet_safe=spreadsheet_safe)
        if group is not None:
            write_group(group, target, spreadsheet_safe=spreadsheet_safe)
        if pictures.explorer:
            _write_explorer(analysis.draws, group, pictures.truth, target / "explorer.html")
        asymmetry = AsymmetryTable(tuple(subject_asymmetry(subject) for subject in analysis.study))
        here = partial(Drawing, target / posterior, (target / posterior).stat().st_mtime_ns, held=analysis.draws)
        if drawn:
            (target / "corner").mkdir()
        of_study, of_subjects = _overviews(analysis, asymmetry, here(""), place), list[Callable[[], None]]()
        for name, file in files.items():
            into = target / "corner" / file, place / "curves" / file
            of_subjects.append(partial(_draw_subject, here(name), analysis.settings.prior, pictures.truth.get(name), *into))
        names = [*((),) * len(of_study), *((name,) for name in drawn)]
        run_in_order([*of_study, *of_subjects], of_this_machine(workers), progress, names)
        facts = Facts(summary, asymmetry, marked, None if group is None else group_section(group, target))
        curve_files, corner_plots = ({name: home / file for name, file in files.items()} for home in (place / "curves", target / "corner"))
        write_report(analysis, facts, Pictures(place, curve_files, corner_plots, pictures.which), target)
    return Path(folder)


def _write_explorer(draws: Draws, group: Group | None, truth: Truth, file: Path) -> None:
    from bayes_toe.explorer.page import explore

    explore(draws, truths=truth or None, population=None if group is None else group.found).save(file)


def draws_in(folder: Path, store: str) -> Path:
    """Where the draws of a results folder are, "nc" or "zarr"."""
    if store not in ("nc", "zarr"):
        raise InputError(f"--store {store}: allowed: nc, zarr")
    return folder / f"posterior.{store}"


def corner_files(draws: Draws, subjects: tuple[str, ...]) -> dict[str, str]:
    """File name of each subject's corner plot: safe, and the same whether one subject is drawn or all."""
    stems = file_stems(draws.names)
    return {name: f"{stems[name]}.png" for name in subjects}


@contextmanager
def _drawing_place(new: Path) -> Iterator[tuple[Path, Path]]:
    """The new folder and one in it for pictures that go into the report alone; with that one, draws that were opened are forgotten.

    Both names are absolute: a worker may be in another folder than this process.
    """
    with TemporaryDirectory(dir=new.absolute()) as place:
        (Path(place) / "curves").mkdir()
        try:
            yield new.absolute(), Path(place)
        finally:
            _opened.cache_clear()


def _overviews(analysis: Analysis, asymmetry: AsymmetryTable, draws: Drawing, place: Path) -> list[Callable[[], None]]:
    """Calls that draw order effect, evidence, asymmetry, map and prior into files with the names that :class:`Pictures` looks for."""
    return [
        partial(_draw_order_effect, analysis.evidence, place / "order_effect.png", title=_said(analysis.study)),
        partial(_draw_evidence, analysis.evidence, place / "evidence.png", title=_said(analysis.study)),
        partial(_draw_asymmetry, asymmetry, place / "asymmetry.png"),
        partial(_draw_map, draws, place / "map.png"),
        partial(_draw_prior, analysis.study, analysis.settings, place / "prior.png"),
    ]


def _draw_subject(one: Drawing, prior: Prior, truth: Mapping[str, float] | None, corner_file: Path, curve_file: Path) -> None:
    corner_file.write_bytes(png(corner_sheet(one.draws, one.subject, truths=truth, prior=prior), dpi=110))
    fitted = interval_curves if one.draws.intervals else curves
    curve_file.write_bytes(png(fitted(one.draws, one.subject, title=_said(one.draws)), dpi=120))


def _said(of: Study | Draws) -> str:
    """The title of a picture that stands under a heading."""
    return "synthetic data" if of.synthetic else ""


def _draw_order_effect(table: EvidenceTable, file: Path, *, title: str) -> None:
    figure = new_figure(_WIDE, evidence_height(table))
    order_effect_axes(table, figure.subplots()).set_title(title, fontsize=LETTERS, loc="right")
    legend_below(figure, size=LETTERS, columns=2)
    file.write_bytes(png(figure, dpi=_DOTS))


def _draw_evidence(table: EvidenceTable, file: Path, *, title: str) -> None:
    figure = new_figure(_WIDE, evidence_height(table))
    evidence_axes(figure.subplots(), table).set_title(title, fontsize=LETTERS, loc="right")
    legend_below(figure, size=LETTERS, columns=2)
    file.write_bytes(png(figure, dpi=_DOTS))


def _draw_asymmetry(table: AsymmetryTable, file: Path) -> None:
    """Nothing where no pair was presented in both orders."""
    if any(row.comparisons for row in table):
        figure = new_figure(_WIDE, asymmetry_height(table))
        asymmetry_axes(table, figure.subplots())
        file.write_bytes(png(figure, dpi=_DOTS))


def _draw_prior(study: Study, settings: Settings, file: Path) -> None:
    figure = prior_predictive_figure(study, settings.prior, seed=settings.seed)
    figure.suptitle(_said(study), fontsize=LETTERS)
    file.write_bytes(png(figure))


def _draw_map(one: Drawing, file: Path) -> None:
    figure = new_figure(_WIDE, 4.0)
    study_map_axes(one.draws, figure.subplots())
    figure.set_layout_engine("none")  # found already, for the names
    file.write_bytes(png(figure, dpi=_DOTS))
