"""The figures of arXiv 2604.19662 for any analysed study, and their captions.

`paper_figures` returns the figures, `write_figures` writes them, and `captions` describes them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.transforms import Bbox

from bayes_toe.analysis import Analysis
from bayes_toe.answers.evidence_table import EvidenceTable
from bayes_toe.arrays import ArrayPair, FloatArray, NamedArrays
from bayes_toe.classical.asymmetry import (
    LEVEL,
    AsymmetryTable,
    asymmetry_table,
    subject_asymmetry,
)
from bayes_toe.classical.frequencies import presentation_order
from bayes_toe.data.messages import capitalized, plural
from bayes_toe.data.study import refuse_intervals
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.errors import InputError
from bayes_toe.inference.draws import Draws
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.paper_equations import evolved_mean
from bayes_toe.plots.asymmetry import asymmetry, asymmetry_height, order_axes
from bayes_toe.plots.curves import (
    CURVE_DRAWS,
    distance_panel,
    has_several_weaker,
    lines_along,
    main_weaker,
    order_panel,
    title_of,
)
from bayes_toe.plots.figure_files import figure_bytes
from bayes_toe.plots.order_effect import evidence_axes, evidence_plane_axes
from bayes_toe.plots.style import (
    BAND,
    BELIEF,
    COLUMN,
    LETTERS,
    MAX_NAMES,
    PAGE,
    SMALL,
    Style,
    any_characters,
    even_columns,
    grid_panels,
    legend_above,
    legend_below,
    mark_synthetic,
    n_rows,
    new_figure,
    plain,
    probability_label,
    rows_by_order,
    style_axes,
    style_colour_bar,
)

CAPTIONS = "captions.md"
_SUFFIXES = ("pdf", "png")
#: Draws or replicates of mu_1 and of sigma_p, each of shape (R,), by subject.
Clouds = Mapping[str, tuple[npt.ArrayLike, npt.ArrayLike]]

_EXAMPLES = 3  # subjects in figures of single subjects, where none are chosen
_HIGHEST = 9.0  # inches of a page
_MOST_ACROSS = 3  # columns of panels
_CROWDED = 60  # pairs, beyond which marks are small
_SHADOWS = 40  # draws whose priors are drawn behind the median one
_CENTRAL = (0.2, 0.5, 0.8)  # the median and the ends of the central 60 %
_FARTHEST = 4.0  # the map reaches so many ranges of the stimuli beyond these at most
_CELLS = 120  # of a side of the plane
#: Without the lightest colours, which are lost on paper.
_NOISE_COLOURS = ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.85, 256)))
#: Without the darkest greys, on which a black line would be lost.
_GREYS = ListedColormap(colormaps["Greys"](np.linspace(0.0, 0.62, 256)))
#: Offsets of a name from its dot, in points, with its alignment.
_NAME_OFFSETS = (
    ((3.0, 0.0), "left", "center"),
    ((-3.0, 0.0), "right", "center"),
    ((0.0, 3.0), "center", "bottom"),
    ((0.0, -3.0), "center", "top"),
)


def paper_figures(analysis: Analysis, subjects: Sequence[str] | None = None) -> dict[str, Figure]:
    """The paper's figures of an analysed study, by file name.

    Figure 1C is absent if no pair of different stimuli was presented in both orders.

    Parameters
    ----------
    analysis : Analysis
        From :func:`bayes_toe.run`.
    subjects : sequence of str, optional
        Shown in Figs. 3 and 5; by default three in the paper's roles, see :func:`representative`.

    Raises
    ------
    InputError
        For an unknown or repeated subject, and for a study with intervals.
    """
    refuse_intervals(analysis.study, "the paper's figures")
    draws, is_synthetic = analysis.draws, analysis.draws.synthetic
    table = asymmetry_table(analysis.study)
    names = _shown_subjects(analysis, table, subjects)
    figures = {}
    if any(row.comparisons for row in table):
        figures["figure_1c_asymmetry"] = asymmetry_figure(table, synthetic=is_synthetic)
    figures["figure_3_examples"] = examples_figure(draws, names)
    figures["figure_4_map"] = map_figure(draws)
    figures["figure_5_plane"] = plane_figure(draws, names)
    figures["appendix_c_evidence"] = evidence_figure(analysis.evidence, synthetic=is_synthetic)
    return figures


def write_figures(analysis: Analysis, folder: Path) -> None:
    """Write all figures, as PDF and PNG, and their captions into a new folder."""
    folder.mkdir()
    for name, figure in paper_figures(analysis).items():
        with any_characters():
            figure.draw_without_rendering()
        figure.set_layout_engine("none")  # so that every format has the same layout
        for suffix in _SUFFIXES:
            (folder / f"{name}.{suffix}").write_bytes(figure_bytes(figure, suffix))
    (folder / CAPTIONS).write_text(captions(analysis), encoding="utf-8")


def representative(table: AsymmetryTable) -> tuple[str, ...]:
    """Three subjects in the roles of the paper's Fig. 3.

    Their mean asymmetry is the most positive (A), the most negative (B), the nearest to zero (C).
    """
    rows = [row for row in table if row.comparisons]
    if len(table.rows) <= _EXAMPLES or len(rows) < _EXAMPLES:
        return tuple(row.subject for row in table.rows[:_EXAMPLES])
    ordered = sorted(rows, key=lambda row: row.mean_asymmetry)
    middle = min(ordered[1:-1], key=lambda row: row.mean_absolute_asymmetry)
    return ordered[-1].subject, ordered[0].subject, middle.subject


def _shown_subjects(
    analysis: Analysis, table: AsymmetryTable, subjects: Sequence[str] | None
) -> tuple[str, ...]:
    """The chosen subjects, or else three representative ones."""
    if subjects is None:
        return representative(table)
    for name in subjects:
        analysis.draws.subject(name)  # refuses an unknown name
    if not subjects or len(set(subjects)) < len(subjects):
        raise InputError("subjects: allowed is at least one, each once")
    return tuple(subjects)


# --- Fig. 1C and Appendix C ----------------------------------------------------------------------


def asymmetry_figure(table: AsymmetryTable, *, synthetic: bool = False) -> Figure:
    """Fig. 1C: the clearest comparison in both orders, and all asymmetries beside it."""
    high = min(_HIGHEST, max(2.7, asymmetry_height(table) + 0.15))
    figure = new_figure(1.9 + COLUMN, high)
    heights = (2.4, max(0.01, high - 2.4))
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 2.1), height_ratios=heights)
    comparisons = chain.from_iterable(row.comparisons for row in table)
    clearest = min(comparisons, key=lambda comparison: comparison.p_value)
    left = figure.add_subplot(grid[0, 0] if high > 3.2 else grid[:, 0])
    order_axes(clearest, left, share_of=table.share_of)
    asymmetry(table, figure.add_subplot(grid[:, 1]))
    mark_synthetic(figure, synthetic)
    return figure


def evidence_figure(table: EvidenceTable, *, synthetic: bool = False) -> Figure:
    """Appendix C: evidence of H1 against H0, and the log Bayes factor of every subject."""
    figure = new_figure(PAGE, min(_HIGHEST, max(3.0, 1.1 + 0.17 * len(table.rows))))
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.1))
    evidence_plane_axes(table, left)
    legend_above(style_axes(evidence_axes(right, table)))
    right.xaxis.label.set_fontsize(SMALL)
    mark_synthetic(figure, synthetic)
    return figure


# --- Fig. 3 --------------------------------------------------------------------------------------


def examples_figure(draws: Draws, subjects: Sequence[str]) -> Figure:
    """Fig. 3: responses and curves, the prior, and the common curve; a column for each subject."""
    n_columns = even_columns(len(subjects), _MOST_ACROSS)
    n_blocks = n_rows(len(subjects), n_columns)
    figure = new_figure({1: COLUMN, 2: 5.0}.get(n_columns, PAGE), 5.6 * n_blocks + 0.3)
    heights = (1.25, 0.85, 1.1) * n_blocks
    grid = figure.add_gridspec(3 * n_blocks, n_columns, height_ratios=heights)
    for i, subject in enumerate(subjects):
        block, column = divmod(i, n_columns)
        panels = [figure.add_subplot(grid[3 * block + k, column]) for k in range(3)]
        top, middle, bottom = panels
        fitted = Predictor.from_draws(draws, subject, most=CURVE_DRAWS)
        response_axes(fitted, top)
        top.set_title(_example_title(draws, subject), fontsize=LETTERS)
        prior_axes(draws, subject, middle)
        distance_panel(bottom, fitted)
        bottom.set_ylabel(probability_label(draws.task))
        style_axes(bottom)
        if column:
            for ax in panels:
                ax.set_ylabel("")
    legend_below(figure, size=SMALL)
    return figure


def _example_title(draws: Draws, subject: str) -> str:
    """The subject, and the weaker stimulus where the design has several."""
    title = title_of(draws, subject)
    counts = draws.subject(subject)
    weaker = main_weaker(counts)
    if weaker is not None and has_several_weaker(counts):
        title += f"\nweaker stimulus {weaker:.3g}".replace("-", "−")
    return title


def response_axes(fitted: Predictor, ax: Axes) -> Axes:
    """Responses in both orders with fitted curves, as :func:`order_panel` has them.

    Stars: the orders differ (exact test, Holm's correction over the subject's comparisons).
    """
    counts = fitted.target.subject
    reference = main_weaker(counts)
    low = float(min(counts.s1.min(), counts.s2.min())) if reference is None else reference
    order_panel(ax, counts, fitted.yes, low, size=4.0)
    ends = np.concatenate([line.x for line in lines_along(counts, low, 2)])
    pad = max(0.06 * float(np.ptp(ends)), 0.05)
    ax.set(xlim=(ends.min() - pad, ends.max() + pad), ylim=(-0.03, 1.14))
    ax.set(yticks=[0.0, 0.5, 1.0], ylabel=probability_label(counts.task))
    if counts.task == SAME_DIFFERENT:
        for comparison in subject_asymmetry(counts).comparisons:
            if comparison.s_weak == reference and comparison.p_adjusted < LEVEL:
                ax.text(comparison.s_strong, 1.09, "*", ha="center", va="center_baseline")
    return style_axes(ax)


def prior_axes(draws: Draws, subject: str, ax: Axes) -> Axes:
    """Prior of a subject, Normal(mu_1, sigma_1^2), among the stimuli.

    Thick: at the posterior medians; thin: at some of the draws; triangles: stimuli; bar: likelihood
    noise, 2 sigma_l wide.
    """
    counts = draws.subject(subject)
    stimuli = np.unique(counts.stimuli)
    means, sds = draws.values(subject, "mu1").ravel(), draws.values(subject, "sigma1").ravel()
    mean, sd = float(np.median(means)), float(np.median(sds))
    low, high = _prior_limits(stimuli, mean, sd)
    x = np.linspace(low, high, 400)
    every = max(1, means.size // _SHADOWS)
    some_means, some_sds = means[every // 2 :: every, None], sds[every // 2 :: every, None]
    # Densities are in units of the peak of the median prior.
    shadows = sd / some_sds * np.exp(-0.5 * ((x - some_means) / some_sds) ** 2)
    density = np.exp(-0.5 * ((x - mean) / sd) ** 2)
    ax.plot(x, shadows.T, color=BELIEF, lw=0.4, alpha=0.25)
    ax.fill_between(x, 0.0, density, color=BELIEF, alpha=0.18, lw=0)
    ax.plot(x, density, color=BELIEF, lw=1.4)
    ax.plot(stimuli, np.full_like(stimuli, -0.12), "^", ms=4.0, color="black", mec="white", mew=0.4)
    centre, noise = float(stimuli.mean()), float(np.median(draws.values(subject, "sigma_l")))
    ax.hlines(-0.3, centre - noise, centre + noise, color="#333333", lw=2.2)
    ax.text(centre + noise, -0.3, r" $\sigma_\ell$", va="center", fontsize=SMALL)
    ax.set(xlim=(low, high), ylim=(-0.42, 1.5), yticks=[])
    ax.set(xlabel="stimulus (ln intensity)", ylabel="prior density")
    ax.set_title(rf"$\mu_1$ = {mean:.2f}, $\sigma_1$ = {sd:.2f}".replace("-", "−"))
    style_axes(ax)
    ax.title.set_fontsize(SMALL)
    ax.spines["left"].set_visible(False)
    return ax


def _prior_limits(stimuli: FloatArray, mean: float, sd: float) -> tuple[float, float]:
    """Ends of an axis with the stimuli and the prior, near enough to keep stimuli apart."""
    first, last = float(stimuli.min()), float(stimuli.max())
    span = max(last - first, 1.5 * sd)
    low = np.clip(mean - 2.5 * sd, first - 4.0 * span, first - 0.15 * span)
    high = np.clip(mean + 2.5 * sd, last + 0.15 * span, last + 4.0 * span)
    return float(low), float(high)


# --- Fig. 4 --------------------------------------------------------------------------------------


def map_figure(draws: Draws, *, clouds: Clouds | None = None) -> Figure:
    """Fig. 4: medians of (mu_1, sigma_p), a dot for each subject, with bars over the central 60 %.

    The paper has ellipses. The colour is the posterior median of sigma_l. The title counts names
    without room and subjects too far from the stimuli.

    Parameters
    ----------
    draws : Draws
        Of the paper's model.
    clouds : mapping of str to pair of array_like, shape (R,), optional
        Bootstrap replicates of mu_1 and sigma_p instead of the draws, natural-log intensity.
    """
    if clouds is None:
        clouds = posterior_clouds(draws)
    figure = new_figure(1.4 * COLUMN, COLUMN + 0.2)
    ax = figure.subplots()
    quantiles = {name: _central_quantiles(cloud) for name, cloud in clouds.items()}
    noise = {name: float(np.median(draws.values(name, "sigma_l"))) for name in quantiles}
    scale = ScalarMappable(Normalize(0.0, max(noise.values())), _NOISE_COLOURS)
    bar = figure.colorbar(scale, ax=ax, fraction=0.05, pad=0.02, aspect=30)
    style_colour_bar(bar, r"likelihood noise $\sigma_\ell$ (ln intensity)")
    weight = min(1.0, MAX_NAMES / len(quantiles))
    for name, ((left, bottom), (x, y), (right, top)) in quantiles.items():
        colour = scale.to_rgba(np.array([noise[name]]))[0]
        ax.plot([left, right], [y, y], color=colour, lw=1.1 * weight)
        ax.plot([x, x], [bottom, top], color=colour, lw=1.1 * weight)
        ax.plot(x, y, "o", ms=2.5 + weight, color=colour)
    _set_map_limits(ax, np.concatenate(list(quantiles.values())), draws)
    ax.set_xlabel(r"prior mean $\mu_1$ (ln intensity)")
    ax.set_ylabel(r"memory diffusion $\sigma_p$ (ln intensity)")
    style_axes(ax)
    if draws.synthetic:
        ax.set_title("synthetic data", fontsize=SMALL, loc="right")
    notes = ["bars: 60 %"]
    ax.set_title(notes[0], fontsize=SMALL, loc="left")  # decides where the panel is
    low, high = ax.get_xlim()
    medians = {name: ends[1] for name, ends in quantiles.items()}
    centres = {name: median for name, median in medians.items() if low <= median[0] <= high}
    n_unnamed = write_names(ax, centres)
    if n_unnamed:
        notes.append(f"no room for {plural(n_unnamed, 'name')}")
    if len(centres) < len(medians):
        notes.append(f"{plural(len(medians) - len(centres), 'subject')} beyond the panel")
    ax.set_title("; ".join(notes), fontsize=SMALL, loc="left")
    return figure


def posterior_clouds(draws: Draws) -> dict[str, ArrayPair]:
    """Posterior draws of (mu_1, sigma_p) by subject."""
    clouds = {}
    for name in draws.names:
        clouds[name] = draws.values(name, "mu1").ravel(), draws.values(name, "sigma_p").ravel()
    return clouds


def _central_quantiles(cloud: tuple[npt.ArrayLike, npt.ArrayLike]) -> FloatArray:
    """Lower end, median and upper end of both coordinates, shape (3, 2), of finite points."""
    points = np.stack([np.ravel(np.asarray(values, np.float64)) for values in cloud], axis=-1)
    # Infinite points keep their order only where no two quantiles are averaged.
    ends = np.nanquantile(points, _CENTRAL, axis=0, method="closest_observation")
    return np.asarray(ends)


def _set_map_limits(ax: Axes, points: FloatArray, draws: Draws) -> None:
    """Room for the points that are not too far from the stimuli, which are drawn behind them."""
    stimuli = np.concatenate([subject.stimuli for subject in draws.study])
    first, last = float(stimuli.min()), float(stimuli.max())
    reach = _FARTHEST * max(last - first, 0.5)
    finite = points[np.isfinite(points).all(axis=1)]
    near = finite[(finite[:, 0] >= first - reach) & (finite[:, 0] <= last + reach)]
    x = np.append(near[:, 0], [first, last])
    y = near[:, 1] if len(near) else np.array([0.0, 1.0])
    pad_x = 0.08 * float(np.ptp(x)) + 1e-9
    pad_y = 0.08 * float(np.ptp(y)) + 1e-3 * float(y.max()) + 1e-12
    ax.axvspan(first, last, color=BAND, lw=0, zorder=0)
    for level in np.unique(stimuli):
        ax.axvline(level, color="#CFCFCF", lw=0.4, zorder=0)
    ax.set(xlim=(x.min() - pad_x, x.max() + pad_x))
    ax.set(ylim=(max(0.0, y.min() - pad_y), y.max() + pad_y))


@any_characters()
def write_names(ax: Axes, centres: NamedArrays) -> int:
    """Write each name beside its dot where no other name or dot is; return how many have none."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.draw_without_rendering()  # decides where the panel is
    panel = ax.get_window_extent()
    marks = {name: ax.transData.transform(centre) for name, centre in centres.items()}
    occupied = [Bbox([mark - 2.0, mark + 2.0]) for mark in marks.values()]
    n_unnamed = 0
    for name in sorted(marks, key=lambda name: float(marks[name][0])):
        centre = tuple(centres[name])
        text = ax.annotate(plain(name, 12), centre, (0.0, 0.0), textcoords="offset points")
        text.set(fontsize=SMALL, zorder=6)
        text.set_path_effects([withStroke(linewidth=1.6, foreground="white")])
        for offset, horizontal, vertical in _NAME_OFFSETS:
            text.set(position=offset, ha=horizontal, va=vertical)
            box = text.get_window_extent()
            is_inside = panel.contains(box.x0, box.y0) and panel.contains(box.x1, box.y1)
            if is_inside and not box.count_overlaps(occupied):
                occupied.append(box)
                break
        else:
            text.remove()
            n_unnamed += 1
    return n_unnamed


# --- Fig. 5 --------------------------------------------------------------------------------------


def plane_figure(draws: Draws, subjects: Sequence[str]) -> Figure:
    """Fig. 5: a :func:`plane_axes` for each subject, at most three in a row."""
    n_columns = even_columns(len(subjects), _MOST_ACROSS)
    width, row_height = {1: (3.6, 3.2), 2: (5.6, 2.5), 3: (PAGE, 2.15)}[n_columns]
    figure = new_figure(width, row_height * n_rows(len(subjects), n_columns) + 0.6)
    panels = grid_panels(figure, len(subjects), n_columns)
    for i, (ax, subject) in enumerate(zip(panels, subjects, strict=True)):
        plane_axes(draws, subject, ax)
        ax.set_title(title_of(draws, subject), fontsize=LETTERS)
        if i % n_columns:
            ax.set_ylabel("")
    scale = ScalarMappable(cmap=_GREYS)  # from 0 to 1
    bar = figure.colorbar(scale, ax=panels, fraction=0.02, pad=0.01, aspect=30, shrink=0.85)
    style_colour_bar(bar, probability_label(draws.task))
    legend_below(figure, size=SMALL, columns=5 if n_columns > 2 else 3)
    return figure


def plane_axes(draws: Draws, subject: str, ax: Axes) -> Axes:
    """Probability of the counted response for any pair, in grey, with the symmetry axis.

    Grey is the posterior mean on a scale from 0 (white) to 1, thin lines are its levels 0.25, 0.5
    and 0.75. The axis s2 = mu_2(s1) has its central 60 %. Dashed: the diagonal, which would be the
    axis without an order effect. Open marks: pairs presented, in the colour of their order.
    """
    counts, fitted = draws.subject(subject), Predictor.from_draws(draws, subject, most=CURVE_DRAWS)
    stimuli = counts.stimuli
    pad = max(0.18 * float(np.ptp(stimuli)), 0.1)
    low, high = float(stimuli.min()) - pad, float(stimuli.max()) + pad
    side = np.linspace(low, high, _CELLS)
    columns = [fitted.yes(np.full(_CELLS, s1), side).mean(axis=0) for s1 in side]
    mean = np.stack(columns, axis=1)
    ax.pcolormesh(side, side, mean, cmap=_GREYS, vmin=0.0, vmax=1.0, rasterized=True, zorder=0)
    levels: Style = {"colors": "#FFFFFF", "linewidths": 0.5, "zorder": 1}
    ax.contour(side, side, mean, levels=[0.25, 0.5, 0.75], **levels)
    ax.plot([low, high], [low, high], "--", color="#444444", lw=0.8, label="diagonal")
    mu1, gamma = (draws.values(subject, name).ravel() for name in ("mu1", "gamma"))
    axis = np.quantile(evolved_mean(side[:, None], mu1, gamma), _CENTRAL, axis=1)
    ax.plot(side, axis[1], color="#111111", lw=1.5, label="symmetry axis")
    ax.plot(side, axis[[0, 2]].T, ":", color="#111111", lw=0.9)
    style: Style = {"ms": 4.6, "mew": 1.2, "mfc": "white", "zorder": 4, "ls": ""}
    if counts.n_pairs > _CROWDED:
        style |= {"ms": 2.0, "mew": 0.6}
    for mark, rows in rows_by_order(presentation_order(counts)):
        style |= {"marker": mark.marker, "mec": mark.colour, "label": mark.label}
        ax.plot(counts.s1[rows], counts.s2[rows], **style)
    ax.set(xlabel="first stimulus $s_1$ (ln intensity)")
    ax.set(ylabel="second stimulus $s_2$ (ln intensity)")
    ax.set(xlim=(low, high), ylim=(low, high), aspect="equal")
    ticks = [tick for tick in ax.get_xticks() if low <= tick <= high]  # the same to both sides
    ax.set(xticks=ticks, yticks=ticks)
    return style_axes(ax)


# --- captions ------------------------------------------------------------------------------------

_CURVES = {
    SAME_DIFFERENT: "bands: central 50 % and 95 % of the posterior; stars: the orders differ at "
    f"p < {LEVEL:g} (exact test, Holm's correction)",
    WHICH_STRONGER: "bands: central 50 % of the posterior; a curve for each first stimulus, which "
    "crosses one half (dotted) at its point of subjective equality (PSE)",
}
_CAPTIONS = {
    "figure_1c_asymmetry": "Left: P({share_of}) of the comparison with the smallest p-value in its "
    "two orders, Laplace estimator with its standard deviation (Eq. e:2b), p-value of the exact "
    "test. Right: q(c, r) - q(r, c) of every comparison with its standard deviation; within a "
    "subject from the weakest pair above to the strongest below. Filled: "
    f"p < {LEVEL:g}, Holm's correction over the subject's comparisons.",
    "figure_3_examples": "Subjects {subjects}. Top: Laplace estimators with standard deviations; "
    "lines: posterior mean; {curves}. Middle: prior at the posterior medians of mu_1 and sigma_1 "
    "(thick) and at some draws (thin); triangles: stimuli; bar: two sigma_l wide. Bottom: the same "
    "responses over the normalised distance (posterior median). Colours follow the text and "
    "Fig. 1C; those of the paper's caption are swapped.",
    "figure_4_map": "Dots: posterior medians of (mu_1, sigma_p); bars: their central 60 %; "
    "colour: posterior median of sigma_l. Grey range and lines: the stimuli.",
    "figure_5_plane": "Subjects {subjects}. Grey: posterior mean of {chance}, with its levels "
    "0.25, 0.5 and 0.75; solid: median of the symmetry axis s2 = mu_2(s1), dotted: its central "
    "60 %; marks: pairs presented.",
    "appendix_c_evidence": "Left: log evidence per trial of the paper's model (H1) against the "
    "saturated model (H0). Right: log Bayes factors by importance sampling with twice their "
    "standard error, and by Laplace's approximation.",
}


def captions(analysis: Analysis) -> str:
    """Captions of the figures with every level and band, as Markdown."""
    draws = analysis.draws
    table = asymmetry_table(analysis.study)
    title = f"# Figures: {draws.attrs['source']}"
    if draws.synthetic and "synthetic" not in title:
        title += " (synthetic data)"
    lines = [
        title,
        f"{len(draws.names)} subjects, seed {draws.seed}. Prior: {draws.attrs['prior']}. Stimuli "
        f"and all parameters but {draws.task.lapses} and gamma are in natural-log intensity. "
        "Orange: weaker stimulus first, (r, c); blue: stronger first, (c, r); grey: equal stimuli.",
        capitalized(table.describe()) + ".",
    ]
    if draws.not_converged:
        names = ", ".join(draws.not_converged)
        lines.append(f"Draws NOT CONVERGED, not to be reported as they stand: {names}.")
    words = {
        "subjects": ", ".join(representative(table)),
        "chance": probability_label(draws.task),
        "share_of": table.share_of,
        "curves": _CURVES[draws.task],
    }
    has_comparison = any(row.comparisons for row in table)
    for name, caption in _CAPTIONS.items():
        text = caption.format(**words)
        if name == "figure_1c_asymmetry" and not has_comparison:
            text = "Left out: no pair of different stimuli was presented in both orders."
        lines.append(f"**{name}.** {text}")
    return "\n\n".join(lines) + "\n"
