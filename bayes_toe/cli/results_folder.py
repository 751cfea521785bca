"""The results folder of an analysis: draws, tables, figures and report."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from bayes_toe import plots
from bayes_toe.analysis import Analysis
from bayes_toe.arrays import Texts
from bayes_toe.cli.answer_screen import flagged
from bayes_toe.cli.methods import write_methods
from bayes_toe.cli.report import write_report
from bayes_toe.cli.run_context import RunContext
from bayes_toe.data.read_study import Truth, example_truth
from bayes_toe.data.tables import file_stems, write_table
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.data.whole_files import whole_folder
from bayes_toe.explorer.page import EXAMPLE, explore
from bayes_toe.inference.draws import Draws
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.prior import Prior
from bayes_toe.plots.corner import corner
from bayes_toe.plots.curves import fitted_figure
from bayes_toe.plots.figure_files import png

#: What a results folder may hold: draws, tables, the group, corner plots, an explorer, pages of
#: very many subjects.
PRODUCTS = (
    "posterior.nc",
    "summary.csv",
    "evidence.csv",
    "report.html",
    "methods.md",
    "methods.bib",
    "contrast.csv",
    "contrast.png",
    "population.csv",
    "population_subjects.csv",
    "population.png",
    "population.nc",
    "corner",
    "explorer.html",
    "subjects",
)


def write_results(
    analysis: Analysis,
    folder: Path,
    context: RunContext,
    contradictions: Texts = (),
    *,
    figures: str = "all",
    has_explorer: bool = False,
) -> Path:
    """Write draws, tables, figures, report and methods of an analysis; return their folder.

    All files are complete before a first file replaces another file. With `--overwrite`, files that
    an earlier analysis of these subjects has left are removed; other files of the folder stay.
    `figures` says which subjects have corner plots and curves: "all", "flagged" (they need action)
    or "none". `contradictions` has sentences on how the responses contradict a normal group.
    """
    draws = analysis.draws
    stems = file_stems(analysis.study.names)  # of the files of each subject
    flagged_subjects = flagged(analysis.answers, draws.not_converged)
    names = {"all": draws.names, "flagged": flagged_subjects, "none": ()}[figures]
    products = list(PRODUCTS)
    for stem in stems.values():
        products += [f"corner/{stem}.png", f"subjects/{stem}.html"]
    with whole_folder(folder, products, overwrite=context.overwrite) as new_folder:
        # An absolute path, since a worker may be in another folder than this process.
        target = new_folder.absolute()
        draws.save(target / "posterior.nc")
        _write_tables(analysis, target)
        write_methods(analysis, target / "methods.md")
        if has_explorer:
            explore(draws).save(target / "explorer.html")
        jobs = _drawing_jobs(analysis, {name: stems[name] for name in names}, target)
        curves = context.draw(jobs, names)
        facts = {
            "flagged": flagged_subjects,
            "contradictions": contradictions,
            "choice": figures,
            "stems": stems,
            # Curves stand within the report alone, and have no files of their own.
            "curves": dict(zip(names, curves, strict=True)),
        }
        write_report(analysis, facts, target)
    return folder


def _write_tables(analysis: Analysis, folder: Path) -> None:
    """Write the tables of subjects, and tables, figures and draws of conditions and the group."""
    study = analysis.study
    contrast = analysis.contrast
    group = analysis.group
    units = study.conditions is not None  # With conditions, a row is a subject in a condition.
    write_table(analysis.summary(), folder / "summary.csv", analysis.settings.seed, units=units)
    analysis.evidence.save(folder / "evidence.csv", units=units)
    if contrast is not None:
        contrast.save(folder / "contrast.csv")
        figure = plots.contrast(contrast, synthetic=study.synthetic)
        (folder / "contrast.png").write_bytes(png(figure))
    if group is not None:
        group.table.save(folder / "population.csv")
        write_table(group.subject_table, folder / "population_subjects.csv", group.settings.seed)
        (folder / "population.png").write_bytes(png(plots.population(group)))
        group.save(folder / "population.nc")


def _drawing_jobs(
    analysis: Analysis, stems: Mapping[str, str], folder: Path
) -> list[partial[bytes]]:
    """A call of :func:`_draw_subject` for each subject of `stems`, which names the corner plots."""
    study = analysis.study
    truths: Truth = {}  # known only of the bundled example
    if study.source == EXAMPLE and study.task == SAME_DIFFERENT:
        truths = example_truth(SAME_DIFFERENT)

    if stems:
        (folder / "corner").mkdir()
    jobs = []
    for name, stem in stems.items():
        jobs.append(
            partial(
                _draw_subject,
                analysis.draws[name],
                analysis.settings.prior,
                truths,
                analysis.curve(name),
                folder / "corner" / f"{stem}.png",
            )
        )
    return jobs


def _draw_subject(
    draws: Draws, prior: Prior, truths: Truth, fitted: Predictor, corner_file: Path
) -> bytes:
    """Write the corner plot of the only subject of the draws; return its curves as a PNG file."""
    [name] = draws.names  # one subject, since a worker gets only the draws that it needs
    corner_file.write_bytes(png(corner(draws, name, truths=truths, prior=prior)))
    title = "synthetic data" if draws.synthetic else ""
    return png(fitted_figure(fitted, title))
