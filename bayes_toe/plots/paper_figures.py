"""The paper's figures of any study: composed from the panels of the plot modules, and written as files, all of them or none."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from bayes_toe.analysis import Analysis, smooth_curve_evidence
from bayes_toe.answers.evidence_table import EvidenceTable
from bayes_toe.classical.asymmetry import (
    LEVEL,
    AsymmetryTable,
    subject_asymmetries,
)
from bayes_toe.data.messages import capitalized
from bayes_toe.data.read_study import Truth
from bayes_toe.data.study import refuse_intervals
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.data.whole_files import whole_folder
from bayes_toe.errors import InputError
from bayes_toe.inference.draws import Draws, require_paper_model
from bayes_toe.plots.asymmetry import asymmetry, asymmetry_height, order_axes
from bayes_toe.plots.figure_files import picture, require_formats
from bayes_toe.plots.geometry import plane_figure
from bayes_toe.plots.map import map_figure
from bayes_toe.plots.order_effect import evidence_axes, evidence_plane_axes
from bayes_toe.plots.style import (
    COLUMN,
    PAGE,
    SMALL,
    any_characters,
    chance,
    dress,
    legend_above,
    new_figure,
)
from bayes_toe.plots.subject import examples_figure
from bayes_toe.workers import Progress, Workers, run_in_order

CAPTIONS = "captions.md"
#: How many subjects the figures of single subjects show, where none are chosen.
_EXAMPLES = 3
_DPI = 300
_HIGHEST = 9.0  # inches of a page


@dataclass(frozen=True, eq=False)
class Material:
    """All that the figures need; small enough to send to another process."""

    draws: Draws
    evidence: EvidenceTable
    asymmetry: AsymmetryTable
    subjects: tuple[str, ...]
    truth: Truth | None = None


def material_of(
    analysis: Analysis | Draws,
    subjects: Sequence[str] | None = None,
    *,
    truth: Truth | None = None,
    workers: Workers = None,
) -> Material:
    """What the figures need of an analysis, or of saved draws, with the errors of :func:`paper_figures`.

    Of saved draws Appendix C's evidence is then computed, and nothing sampled.
    """
    draws, study = analysis if isinstance(analysis, Draws) else analysis.draws, analysis.study
    require_paper_model(draws, "the paper's figures")
    refuse_intervals(study, "the paper's figures")
    table = AsymmetryTable(subject_asymmetries(study.subjects), study.task)
    chosen = representative(table) if subjects is None else require_subjects(subjects, study.names)
    evidence = (
        smooth_curve_evidence(analysis, workers=workers)
        if isinstance(analysis, Draws)
        else analysis.evidence
    )
    # Pointwise groups are most of the size, and no figure needs them.
    slim = Draws(
        draws.tree.filter(
            lambda group: group.name not in ("log_likelihood", "posterior_predictive")
        )
    )
    return Material(slim, evidence, table, chosen, truth)


def require_subjects(subjects: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    """The subjects asked for, refused where one is unknown or repeated, or there is none."""
    unknown = [name for name in subjects if name not in known]
    if unknown:
        raise InputError(f"no subject {unknown[0]!r}; there are: {', '.join(map(repr, known))}")
    if not subjects or len(set(subjects)) < len(subjects):
        raise InputError("subjects: allowed is at least one, each once")
    return tuple(subjects)


def representative(table: AsymmetryTable) -> tuple[str, ...]:
    """Three subjects in the roles of the paper's Fig. 3: mean asymmetry most positive (A), most negative (B), nearest to zero (C)."""
    rows = [row for row in table if row.comparisons]
    if len(table.rows) <= _EXAMPLES or len(rows) < _EXAMPLES:
        return tuple(row.subject for row in table.rows[:_EXAMPLES])
    ordered = sorted(rows, key=lambda row: row.mean_asymmetry)
    middle = min(ordered[1:-1], key=lambda row: row.mean_absolute_asymmetry)
    return ordered[-1].subject, ordered[0].subject, middle.subject


# --- single figures -----------------------------------------------------------------------------------------------------------------


def asymmetry_figure(table: AsymmetryTable, *, synthetic: bool = False) -> Figure:
    """Fig. 1C and its kin: the clearest comparison in both orders, and the asymmetries of all subjects and comparisons."""
    high = min(_HIGHEST, max(2.7, asymmetry_height(table) + 0.15))
    figure = new_figure(1.9 + COLUMN, high)
    grid = figure.add_gridspec(
        2, 2, width_ratios=(1.0, 2.1), height_ratios=(2.4, max(0.01, high - 2.4))
    )
    clearest = min((one for row in table for one in row.comparisons), key=lambda one: one.p_value)
    order_axes(
        clearest,
        figure.add_subplot(grid[0, 0] if high > 3.2 else grid[:, 0]),
        share_of=table.share_of,
    )
    asymmetry(table, figure.add_subplot(grid[:, 1]))
    figure.suptitle("synthetic data" if synthetic else "", fontsize=SMALL)
    return figure


def evidence_pair_figure(table: EvidenceTable, *, synthetic: bool = False) -> Figure:
    """Appendix C's figure, evidence of H1 against H0, beside the log Bayes factor of every subject."""
    figure = new_figure(PAGE, min(_HIGHEST, max(3.0, 1.1 + 0.17 * len(table.rows))))
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.1))
    evidence_plane_axes(table, left)
    legend_above(dress(evidence_axes(right, table)))
    right.xaxis.label.set_fontsize(SMALL)
    figure.suptitle("synthetic data" if synthetic else "", fontsize=SMALL)
    return figure


# --- all figures --------------------------------------------------------------------------------------------------------------------


#: Figures by file name, without suffix, in the paper's order.
FIGURES: Mapping[str, Callable[[Material], Figure]] = {
    "figure_1c_asymmetry": lambda of: asymmetry_figure(of.asymmetry, synthetic=of.draws.synthetic),
    "figure_3_examples": lambda of: examples_figure(of.draws, of.subjects),
    "figure_4_map": lambda of: map_figure(of.draws, truth=of.truth),
    "figure_5_plane": lambda of: plane_figure(of.draws, of.subjects),
    "appendix_c_evidence": lambda of: evidence_pair_figure(
        of.evidence, synthetic=of.draws.synthetic
    ),
}


def left_out(material: Material) -> dict[str, str]:
    """Figures that this study does not allow, with the reason."""
    if any(row.comparisons for row in material.asymmetry):
        return {}
    return {
        "figure_1c_asymmetry": "no pair of different stimuli was presented in both orders to one subject"
    }


def paper_figures(
    analysis: Analysis | Draws,
    subjects: Sequence[str] | None = None,
    *,
    truth: Truth | None = None,
) -> dict[str, Figure]:
    """The paper's figures of an analysed study, by file name.

    Parameters
    ----------
    analysis : Analysis or Draws
        From :func:`bayes_toe.run`, or draws that it saved, from :func:`bayes_toe.load`: nothing is sampled again.
    subjects : sequence of str, optional
        Shown in Figs. 3 and 5; by default three in the paper's roles, see :func:`representative`.
    truth : mapping, optional
        True natural parameters by subject, such as ``bt.example_truth("same/different")`` has them: squares in Fig. 4.

    Raises
    ------
    InputError
        For an unknown or repeated subject.
    """
    material = material_of(analysis, subjects, truth=truth)
    return {
        name: draw(material) for name, draw in FIGURES.items() if name not in left_out(material)
    }


def products(formats: Sequence[str]) -> tuple[str, ...]:
    """Every file that :func:`write_figures` may make in formats of which none is unknown."""
    return (
        *(f"{name}.{suffix}" for name in FIGURES for suffix in require_formats(formats)),
        CAPTIONS,
    )


def write_figures(
    analysis: Analysis | Draws,
    folder: str | Path,
    *,
    subjects: Sequence[str] | None = None,
    formats: Sequence[str] = ("pdf", "png"),
    truth: Truth | None = None,
    overwrite: bool = False,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Path:
    """Write all figures and their captions into `folder`.

    Parameters
    ----------
    analysis : Analysis or Draws
        As in :func:`paper_figures`.
    folder : path
        Made where it is missing; other files in it are left alone.
    subjects, truth
        As in :func:`paper_figures`.
    formats : sequence of str
        Of pdf, png (300 dots an inch) and svg.
    overwrite : bool
        Whether existing products may be replaced.
    workers : int, optional
        Processes; by default one per processor. The files do not depend on it.
    progress : callable, optional
        Called with a figure's name when that figure is done.

    Raises
    ------
    InputError
        For an unknown subject or format.
    OutputError
        If the folder cannot be written or holds products already; nothing is changed then.
    """
    names, material = (
        products(formats),
        material_of(analysis, subjects, truth=truth, workers=workers),
    )
    shown = [name for name in FIGURES if name not in left_out(material)]
    jobs = [partial(_draw, name, material, tuple(dict.fromkeys(formats))) for name in shown]
    required = (CAPTIONS, *(f"{name}.{suffix}" for name in shown for suffix in formats))
    with whole_folder(folder, names, required=required, overwrite=overwrite) as target:
        for name, files in zip(
            shown, run_in_order(jobs, workers, progress, [(name,) for name in shown]), strict=True
        ):
            for suffix, content in files.items():
                (target / f"{name}.{suffix}").write_bytes(content)
        (target / CAPTIONS).write_text(captions(material), encoding="utf-8")
    return Path(folder)


def _draw(name: str, material: Material, formats: Sequence[str]) -> dict[str, bytes]:
    """One figure in every format, by suffix."""
    figure = FIGURES[name](material)
    with any_characters():
        figure.draw_without_rendering()
    figure.set_layout_engine("none")  # laid out once, so that every format has it alike
    return {suffix: picture(figure, suffix, dpi=_DPI) for suffix in formats}


# --- captions -----------------------------------------------------------------------------------------------------------------------


def captions(material: Material) -> str:
    """What each figure shows, with every level and band, as Markdown."""
    missing, draws = left_out(material), material.draws
    lines = [
        f"# Figures: {draws.attrs['source']}{' (synthetic data)' if draws.synthetic else ''}",
        f"{len(draws.names)} subjects, seed {draws.seed}. Prior: {draws.attrs['prior']}. Stimuli "
        "and all parameters but "
        f"{draws.task.lapses} and gamma are "
        "in natural-log intensity. Orange: weaker stimulus first, (r, c); blue: stronger first, (c, "
        "r); grey: equal stimuli.",
        capitalized(material.asymmetry.population().describe()) + ".",
    ]
    if draws.not_converged:
        lines.append(
            "Draws NOT CONVERGED, not to be reported as they stand: "
            f"{', '.join(draws.not_converged)}."
        )
    words = {
        "subjects": ", ".join(material.subjects),
        "truth": " Squares: true values." if material.truth else "",
        "chance": chance(draws.task),
        "share_of": material.asymmetry.share_of,
        **_OF_TASK[draws.task],
    }
    for name, text in _CAPTIONS.items():
        lines.append(
            f"**{name}.** "
            + (f"Left out: {missing[name]}." if name in missing else text.format(**words))
        )
    return "\n\n".join(lines) + "\n"


#: What captions say of either task.
_OF_TASK = {
    SAME_DIFFERENT: {
        "curves": f"bands: central 50 % and 95 % of the posterior; stars: the orders differ at p < {LEVEL:g} (exact test, Holm)",
        "divided": ", divided by the median q0, and the curve 2^(-z^2),",
    },
    WHICH_STRONGER: {
        "curves": "bands: central 50 % of the posterior; a curve for each first stimulus, which crosses one half (dotted) at its point of "
        "subjective equality (PSE)",
        "divided": " and the curve at the medians",
    },
}
_CAPTIONS = {
    "figure_1c_asymmetry": "Left: P({share_of}) of the comparison with the smallest p-value in its two orders, Laplace estimator with its "
    "standard deviation (Eq. e:2b), plain p-value of the exact test. Right: q(c, r) - q(r, c) of "
    "every comparison with its standard "
    "deviation; within a subject from the weakest pair above to the strongest below. Filled: p < "
    f"{LEVEL:g}, Holm's correction over the "
    "subject's comparisons.",
    "figure_3_examples": "Subjects {subjects}. Top: Laplace estimators with standard deviations; lines: posterior mean; {curves}. "
    "Middle: prior at the medians of the identified coordinates (thick) and at some draws (thin); "
    "triangles: stimuli; bar: two sigma_l "
    "wide. Bottom: the same answers{divided} over the normalised distance (posterior median, "
    "horizontal bars 60 % of the draws). Colours follow the text and Fig. 1C; those of the paper's "
    "caption are swapped.",
    "figure_4_map": "Dots: posterior medians of (mu_1, sigma_p); bars: their central 60 %; "
    "colour: sigma_l at the medians of the identified coordinates. Grey range and lines: the "
    "stimuli.{truth}",
    "figure_5_plane": "Subjects {subjects}. Grey: posterior mean of {chance}, with its levels 0.25, 0.5 and 0.75; solid: median of the "
    "symmetry axis s2 = mu_2(s1), dotted: its central 60 %; marks: pairs presented.",
    "appendix_c_evidence": "Left: log evidence per trial of the paper's model (H1) against free frequencies (H0). Right: log Bayes "
    "factors by importance sampling with twice their standard error, and by Laplace's "
    "approximation.",
}
