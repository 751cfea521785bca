"""Corner plots of posterior draws by the corner package.

`corner` draws one subject, or two to four in the same panels, with prior and true values if wanted.
The explorer uses `contour_grid`, `axis_limits` and other functions for panels of its own.

Contours are computed here. A contour level is a quantile of the smoothed density at the draws, so
that the contour holds the stated share of the draws. The corner package uses the share of the
smoothed density instead. Smoothing spreads a narrow peak: amid the long tails of mu_1 and sigma_p,
its 50 % contour held up to 70 % of the draws.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from numbers import Real
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import gaussian_filter

from bayes_toe.arrays import ArrayPair, FloatArray, NamedArrays, Texts
from bayes_toe.data.messages import format_estimate, join_names
from bayes_toe.data.stimulus_unit import StimulusUnit, percent
from bayes_toe.data.study import name_list
from bayes_toe.errors import InputError, require_kind
from bayes_toe.inference.draws import Draws, require_draws
from bayes_toe.model.models import ObserverPosterior, model_posterior, model_title
from bayes_toe.model.paper_model import PRIOR_DRAWS, PaperPosterior
from bayes_toe.model.parameters import (
    DIFFERENCE,
    KNOWN_DIFFERENCE,
    LOG_INTENSITY_UNIT,
    PER_LOG_INTENSITY,
    PERCENT,
    QUANTITY_BY_NAME,
    STIMULUS,
)
from bayes_toe.model.posterior import SubjectPosterior
from bayes_toe.model.prior import Prior
from bayes_toe.plots.style import MARKED_QUANTILES, POSTERIOR, WEAKER_FIRST, Style, plain, rounded

Values = Mapping[str, float]
Span = tuple[float, float]
#: The panels of a figure as a matrix, or a row of them.
Panels = npt.NDArray[Any]

COORDINATES = ("natural", "identified")
BINS = 60
#: Bins that are added beyond either end of a panel, so that contours close there.
EDGE_BINS = 2
#: Shares of the draws inside the contours.
CONTOUR_SHARES = (0.5, 0.95)
#: Quantiles between which a panel shows its quantity.
SPAN_QUANTILES = (0.005, 0.995)
#: SD of the kernel that smooths counts, in bins, times the sixth root of the number of distinct
#: draws. The draws of a panel have an SD of about BINS / 6 bins. The normal reference rule has the
#: factor 1 in place of 1.4, but with it contours of few draws wobble.
_SMOOTHING = 1.4 * BINS / 6.0
#: Bins of a curve on the diagonal.
_CURVE_BINS = 240
#: SD of the kernel that smooths a curve, in bins, times the fifth root of the number of distinct
#: draws.
_SMOOTHING_OF_CURVE = 1.2 * _CURVE_BINS / 6.0
PRIOR = "#999999"
TRUTH = WEAKER_FIRST
#: Colour and style of line of each of several subjects in the same panels. The style distinguishes
#: them in print without colours.
OVERLAID = (
    (POSTERIOR, "solid"),
    ("#B8520A", "dashed"),
    ("#00704F", "dotted"),
    ("#A0458A", "dashdot"),
)
#: Style of the true values of several subjects.
_TRUTH_MARKS: Style = {"mec": "black", "mew": 0.8, "zorder": 5}
#: Panels a side up to which no corner is free for the key. The key then stands above the panels.
_FEW_PANELS = 2
#: The share of the height of a figure that is below a key above the panels.
_BELOW_KEY = 0.76


def corner(
    draws: Draws,
    subject: str | int | Sequence[str | int],
    *,
    coordinates: str | Sequence[str] = "natural",
    truths: Mapping[str, Values] | None = None,
    prior: Prior | None = None,
    fig: Figure | None = None,
) -> Figure:
    """Draw the corner plot of a subject. Contours hold 50 and 95 % of the draws.

    Dashed lines mark the median and the central 95 % interval, which are also above the panels of
    the diagonal. Constant error, PSE shift, JND and zone are in per cent of intensity, or in
    decibels if the stimuli are; contraction is in per cent of the way to the mean.

    Parameters
    ----------
    draws : Draws
    subject : str or sequence of str
        One subject, or up to four in the same panels, distinguished by colours and lines. If there
        are several subjects, upright lines are their medians.
    coordinates : {"natural", "identified"} or sequence of str
        Which quantities. "natural" has the parameters of the paper's model (H1). For the four
        models it has constant error, contraction and JND, if the model has them. "identified" has
        the quantities that the answers depend on. A sequence names quantities, such as `gain`.
    truths : mapping of str to (mapping of str to float), optional
        Known values of synthetic subjects, by subject. Quantities that follow from them are drawn
        too: natural parameters are enough for any quantity.
    prior : Prior, optional
        Its marginals are drawn in grey on the diagonal. `draws.prior` is the prior under which the
        draws were made.
    fig : matplotlib Figure or SubFigure, optional
        The figure to draw into; by default a new figure.

    Raises
    ------
    InputError
        For an unknown subject or quantity, no quantity at all, or a true value that the quantity
        cannot have; for more than four subjects.
    """
    require_draws(draws)
    truths = truths or {}
    if not all(isinstance(values, Mapping) for values in truths.values()):
        raise InputError(
            "truths: found numbers, allowed: a mapping of each subject's values by its name"
        )
    subject_names = _subject_names(subject)
    targets = [draws.posterior(name) for name in subject_names]
    names = quantity_names(targets[0], coordinates)
    log_draws = []  # draws of each subject by quantity, in natural logs
    for name in subject_names:
        log_draws.append({key: draws.values(name, key).ravel() for key in names})
    unit = shown_unit(targets[0].subject.unit, log_draws)

    samples = []
    limits = []
    # OVERLAID has four styles. If there are fewer subjects, they take the first styles.
    for target, values, (colour, line) in zip(targets, log_draws, OVERLAID, strict=False):
        target = in_unit(target, unit)
        columns = [axis_values(key, values[key], unit) for key in names]
        true_values = all_true_values(truths.get(target.subject.name, {}), target)
        limits.append(axis_limits(columns, names, target, true_values))
        truth = [true_values.get(key, np.nan) for key in names]
        samples.append(_Sample(target, names, np.stack(columns), truth, colour, line))

    # The limits have the shape (subjects, quantities, 2).
    lowest = np.min(limits, axis=0)[:, 0]
    highest = np.max(limits, axis=0)[:, 1]
    spans = np.column_stack([lowest, highest]).tolist()
    fig = fig or _new_figure(len(spans))
    for sample in samples:  # All subjects share the panels, which every call returns.
        axes = _draw_posterior(fig, sample, spans, is_single=len(samples) == 1)
    if prior is not None:  # The marginals of the prior are shares of the same bins.
        for sample in samples:
            values = prior_values(model_posterior(draws.model, sample.target.subject, prior))
            for ax, name, span in zip(axes.diagonal(), names, spans, strict=True):
                prior_draws = axis_values(name, values[name], unit)
                ax.plot(*_smooth_density(prior_draws, span), color=PRIOR, lw=1.4, ls=sample.line)
    _arrange_axes(axes)
    _write_key(fig, draws, samples, len(spans), has_prior=prior is not None)
    return fig


def _subject_names(subject: str | int | Sequence[str | int]) -> list[str]:
    """The names of the subjects of a plot.

    No name, more than four names and a repeated name are refused.
    """
    names = name_list(subject)
    if not 1 <= len(names) <= len(OVERLAID) or len(set(names)) < len(names):
        raise InputError(
            f"subjects in one corner plot: found {join_names([*map(repr, names)])}; "
            f"allowed: 1 to {len(OVERLAID)}, each once"
        )
    return names


# --- quantities -----------------------------------------------------------------------------------


class _Sample(NamedTuple):
    """Draws of a subject as axes show them, with true values, colour and style of line.

    `columns` has the shape (quantities, draws). The true value of a quantity is NaN if it is not
    known.
    """

    target: SubjectPosterior
    names: Texts
    columns: FloatArray
    truth: Sequence[float]
    colour: str
    line: str


def quantity_names(target: SubjectPosterior, coordinates: str | Sequence[str]) -> Texts:
    """The names of the quantities of 'natural' or 'identified', or those in a sequence.

    For the four models, 'natural' has constant error, contraction and JND, if the model has them.
    """
    if coordinates == "identified":
        return target.names.identified
    if coordinates == "natural" and isinstance(target, ObserverPosterior):
        effects_and_jnd = ("constant_error", "contraction", "jnd")
        return tuple(name for name in effects_and_jnd if name in target.names.all)
    if coordinates == "natural":
        return target.names.natural

    all_names = ", ".join(target.names.all)
    if isinstance(coordinates, str) or len(coordinates) == 0:
        raise InputError(
            f"coordinates {coordinates!r}, allowed: {', '.join(COORDINATES)} or some of {all_names}"
        )
    names = tuple(coordinates)
    for name in names:
        if name not in target.names.all or names.count(name) > 1:
            raise InputError(
                f"parameters {', '.join(names)}: {name!r} is unknown or named twice; there are: "
                f"{all_names}"
            )
    return names


def shown_unit(unit: StimulusUnit, draws_by_subject: Iterable[NamedArrays]) -> StimulusUnit:
    """The unit in which axes show differences.

    It is `unit`, or natural logs if an axis would have per cents that are too large to be read.
    The draws of each subject, by quantity, are in natural logs.
    """
    ends = []  # of all axes of differences
    for draws in draws_by_subject:
        for name, values in draws.items():
            if _is_difference(name, unit):
                ends += np.nanquantile(values, SPAN_QUANTILES).tolist()
    return unit.with_logs_if_large(percent(ends))


def in_unit(
    target: ObserverPosterior | PaperPosterior, unit: StimulusUnit
) -> ObserverPosterior | PaperPosterior:
    """A posterior whose stimuli and quantities are shown in a unit."""
    return replace(target, subject=replace(target.subject, unit=unit))


def _is_difference(name: str, unit: StimulusUnit) -> bool:
    """Whether an axis shows a quantity in the unit of differences.

    Quantities of the kind KNOWN_DIFFERENCE are shown in this unit if the unit of the stimuli is
    known, and else in natural logs.
    """
    display = QUANTITY_BY_NAME[name].display
    return display == DIFFERENCE or (display == KNOWN_DIFFERENCE and unit.stimulus_unit != "")


def prior_values(target: SubjectPosterior) -> NamedArrays:
    """Draws from the prior of a posterior by quantity, shape (PRIOR_DRAWS,) each."""
    return target.quantities(target.sample_prior(np.random.default_rng(0), PRIOR_DRAWS))


def axis_values(name: str, values: npt.ArrayLike, unit: StimulusUnit) -> FloatArray:
    """Values of a quantity as its axis shows them."""
    values = np.asarray(values, np.float64)
    quantity = QUANTITY_BY_NAME[name]
    if quantity.display == STIMULUS and unit.stimulus_unit:
        return unit.to_stimuli(values)
    if _is_difference(name, unit):
        return unit.to_differences(values)
    return quantity.scale * values


def axis_label(name: str, unit: StimulusUnit) -> str:
    """Symbol and unit of a quantity, as in 'JND, %'; a pure number has no unit."""
    # `filter` leaves out an empty unit with its comma.
    return ", ".join(filter(None, (QUANTITY_BY_NAME[name].symbol, axis_unit(name, unit))))


def axis_unit(name: str, unit: StimulusUnit) -> str:
    """The unit of the axis of a quantity; empty for pure numbers."""
    quantity = QUANTITY_BY_NAME[name]
    if quantity.display == STIMULUS and unit.stimulus_unit:
        return unit.stimulus_unit
    if quantity.display == PERCENT:
        return "%"
    if _is_difference(name, unit):
        return unit.difference_unit
    # Quantities that stay in natural logs where the unit of the stimuli is not known. Any other
    # quantity is a pure number.
    return {LOG_INTENSITY_UNIT: "ln", PER_LOG_INTENSITY: "per ln"}.get(quantity.unit, "")


def axis_limits(
    columns: Iterable[FloatArray], names: Sequence[str], target: SubjectPosterior, truth: Values
) -> list[Span]:
    """Axis limits of quantities, within their support, with the true values that are known.

    Draws, true values and limits are as axes show them. Limits are at quantiles of the draws, not
    at the smallest and the largest draw: a few draws far out in a funnel would squeeze all other
    draws into one bin.
    """
    spans = []
    for values, name in zip(columns, names, strict=True):
        low, high = np.quantile(values, SPAN_QUANTILES).tolist()
        low = min(low, truth.get(name, low))
        high = max(high, truth.get(name, high))
        if high > low:  # room for a mark at either end
            pad = 0.08 * (high - low)
        else:  # all draws are equal, perhaps 0, and an axis needs a width
            pad = 0.5 * abs(low) + 1e-12
        lowest, highest = axis_values(name, support(target, name), target.subject.unit).tolist()
        spans.append((max(low - pad, lowest), min(high + pad, highest)))
    return spans


def support(target: SubjectPosterior, name: str) -> Span:
    """The smallest and the largest possible value of a quantity, in natural logs."""
    # A quantity that several parameters determine has no prior quantiles of its own.
    if name in ("offset", "pse_shift"):
        return -np.inf, np.inf
    if name in ("zone", "width", "jnd") or name.startswith("sigma"):
        return 0.0, np.inf
    # The quantiles at 0 and at 1 are the ends of the prior.
    return target.prior_quantile(name, 0.0), target.prior_quantile(name, 1.0)


def all_true_values(truths: Values, target: SubjectPosterior) -> dict[str, float]:
    """True values, and all quantities that follow from them, as axes show them.

    A true value that the quantity cannot have is refused.
    """
    unit = target.subject.unit
    for name, value in truths.items():
        if name not in target.names.all:
            raise InputError(
                f"truths: unknown quantity {name!r}; there are: {', '.join(target.names.all)}"
            )
        low, high = support(target, name)
        if name == "sigma_p":  # gamma = (sigma_l / sigma_p)^2 does not exist at 0
            low = np.nextafter(0.0, 1.0)  # the smallest positive number
            rule = "a positive finite number"
        else:
            rule = f"a finite number from {low:g} to {high:g}"
        require_kind(f"truths: {name}", value, Real, rule)
        # A finite log may be an infinite intensity.
        if not (np.isfinite(axis_values(name, value, unit)) and low <= value <= high):
            raise InputError(f"truths: {name}={value!r}, allowed: {rule}")

    # An unknown value is NaN, and so is every quantity that depends on it.
    parameters = {
        name: np.asarray(truths.get(name, np.nan), np.float64) for name in target.names.natural
    }
    with np.errstate(invalid="ignore"):  # The paper's prior excludes a sigma_l above sigma_p.
        quantities = target.quantities(target.points(parameters))

    true_values = {name: float(value) for name, value in quantities.items() if np.isfinite(value)}
    true_values |= truths  # a given value goes before a value that follows from others
    return {name: float(axis_values(name, value, unit)) for name, value in true_values.items()}


# --- panels ---------------------------------------------------------------------------------------


def contour_grid(
    x: FloatArray, y: FloatArray, x_span: Span, y_span: Span
) -> tuple[FloatArray, ...]:
    """Smoothed counts of draws `x`, `y` in and around a panel, and levels of contours.

    `x_span` and `y_span` are the limits of the panel. It has BINS bins across and BINS bins upward,
    and EDGE_BINS bins are added beyond each of its sides. Returns the middles of the bins across
    and those upward, shape (BINS + 4,) each; the counts, shape (BINS + 4, BINS + 4), upward and
    across; and the levels in ascending order. For each share in :data:`CONTOUR_SHARES` there is a
    level: the density at this share of the draws is above it. If all draws are one point, there is
    one level.
    """
    counts, _, _ = np.histogram2d(y, x, BINS, [y_span, x_span])
    # A draw that the sampler repeats says nothing new. Draws with one x are such repetitions: other
    # draws differ in x, because x is continuous.
    n_distinct = len(np.unique(x))
    # The power is that of the normal reference rule in two dimensions.
    smooth = gaussian_filter(counts, _SMOOTHING * n_distinct ** (-1.0 / 6.0))

    # EDGE_BINS are the two bins that follow on each side: one repeats the edge, and one has the
    # lowest density, so that contours close there.
    continued = np.pad(smooth, 1, mode="edge")
    padded = np.pad(continued, 1, constant_values=smooth.min())
    # Middles of the bins in units of the panel, below 0 and above 1 in the added bins.
    middles = (np.arange(-EDGE_BINS, BINS + EDGE_BINS) + 0.5) / BINS
    middle_x = x_span[0] + (x_span[1] - x_span[0]) * middles
    middle_y = y_span[0] + (y_span[1] - y_span[0]) * middles

    # Draws beyond the added bins get a density below that of all other draws.
    density = RegularGridInterpolator(
        (middle_y, middle_x), padded, bounds_error=False, fill_value=-1.0
    )
    # A share S of the draws has a density above the (1 - S) quantile of the density at the draws.
    # All quantiles are the same if all draws are one point.
    levels = np.unique(np.quantile(density((y, x)), 1.0 - np.array(CONTOUR_SHARES)))
    return middle_x, middle_y, padded, levels


def corner_package() -> Any:
    """The corner package, imported here because the import takes a second.

    It imports ArviZ. ArviZ 0.23 writes the day of an announcement to a file, which two processes
    can remove at the same time; then the import is repeated.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        try:
            import corner as package
        except FileNotFoundError:
            import corner as package
    return package


def _draw_posterior(
    figure: Figure, sample: _Sample, spans: Sequence[Span], *, is_single: bool
) -> Panels:
    """Draw densities, contours and true values of one subject; return the panels as a matrix.

    Later subjects are drawn over the panels of the first subject.
    """
    corner_package().corner(
        sample.columns.T,
        fig=figure,
        range=spans,
        labels=[axis_label(name, sample.target.subject.unit) for name in sample.names],
        label_kwargs={"fontsize": 9.5},
        labelpad=0.05,
        max_n_ticks=4,
        use_math_text=True,
        color=sample.colour,
        hist_kwargs={"alpha": 0.0},  # no histograms: `_draw_curves` draws curves
        quantiles=MARKED_QUANTILES if is_single else None,
        plot_datapoints=False,
        plot_density=False,
        plot_contours=False,
    )

    axes = np.array(figure.axes).reshape(len(spans), len(spans))
    _draw_contours(axes, sample, spans, is_single=is_single)
    _draw_curves(axes.diagonal(), sample, spans, is_single=is_single)
    return axes


def _draw_contours(
    axes: Panels, sample: _Sample, spans: Sequence[Span], *, is_single: bool
) -> None:
    """Draw contours and true values of one subject in the panels below the diagonal."""
    lines: Style = {"colors": sample.colour, "linestyles": sample.line}
    for column, row in combinations(range(len(spans)), 2):  # column < row: below the diagonal
        ax = axes[row, column]
        *middles, counts, levels = contour_grid(
            sample.columns[column], sample.columns[row], spans[column], spans[row]
        )
        ax.contour(*middles, counts, levels, linewidths=1.5, zorder=1.5, **lines)
        x = sample.truth[column]
        y = sample.truth[row]
        if is_single:
            # Areas from level to level, the last area up to a bound that no count reaches. The
            # outer area, between the two levels, is light. If all draws are one point, there is one
            # level, and no outer area.
            bounds = [*levels, 2.0 * counts.max()]
            colours = [(sample.colour, 1.0 / 3.0), sample.colour][-len(levels) :]
            ax.contourf(*middles, counts, bounds, colors=colours)
            ax.plot(x, y, "s", color=TRUTH)
            ax.axvline(x, color=TRUTH)
            ax.axhline(y, color=TRUTH)
        else:  # only a mark, because lines would be taken for medians
            ax.plot(x, y, "s", ms=5, color=sample.colour, **_TRUTH_MARKS)


def _draw_curves(
    diagonal: Panels, sample: _Sample, spans: Sequence[Span], *, is_single: bool
) -> None:
    """Draw densities and true values on the diagonal, with the median and interval above it.

    Of several subjects, an upright line is the median, and no interval is drawn.
    """
    panels = zip(diagonal, sample.columns, spans, sample.truth, strict=True)
    for ax, values, span, true_value in panels:
        ax.plot(*_smooth_density(values, span), color=sample.colour, lw=1.4, ls=sample.line)
        low, median, high = np.quantile(values, MARKED_QUANTILES)
        if is_single:
            # The width of the interval determines the decimals of the median and of both ends.
            texts = rounded(low, high, low, median, high)
            if len(texts[1]) > 9:  # The median is too long for the width of a panel.
                texts = list(map("{:.2g}".format, (low, median, high)))
            ax.set_title(format_estimate(*texts), fontsize=9.0)
            ax.axvline(true_value, color=TRUTH)
        else:
            ax.axvline(median, color=sample.colour, lw=1.0, ls=sample.line)
            # A triangle, because a further upright line would be taken for a median.
            ax.plot(true_value, 0.0, "^", ms=7, clip_on=False, color=sample.colour, **_TRUTH_MARKS)


def _smooth_density(values: FloatArray, span: Span) -> ArrayPair:
    """Middles of the bins of a curve on the diagonal, and the smoothed share of draws in each bin.

    Both have the shape (_CURVE_BINS,).
    """
    counts, edges = np.histogram(values, _CURVE_BINS, span)
    n_distinct = len(np.unique(values))  # a repeated draw says nothing new, see `contour_grid`
    smooth = gaussian_filter(counts / len(values), _SMOOTHING_OF_CURVE * n_distinct**-0.2)
    return 0.5 * (edges[1:] + edges[:-1]), smooth


# --- key and layout -------------------------------------------------------------------------------


def _arrange_axes(axes: Panels) -> None:
    """Set limits, ticks and labels of the panels, which have their curves."""
    # Room above the curves, which have _CURVE_BINS points. Other lines are quantiles and true
    # values, which have fewer points.
    for ax in axes.diagonal():
        densities = [line.get_ydata() for line in ax.lines if len(line.get_xdata()) == _CURVE_BINS]
        ax.set_ylim(0.0, 1.1 * np.max(densities))

    # No ticks near an end, where their labels touch those of the next panel.
    for ax in axes.flat:
        for axis in (ax.xaxis, ax.yaxis):
            low, high = axis.get_view_interval()
            margin = 0.06 * (high - low)
            ticks = np.asarray(axis.get_majorticklocs())
            axis.set_ticks(ticks[(ticks >= low + margin) & (ticks <= high - margin)])

    # An offset or a power of ten stands beside the name of its axis. Only panels of the last row
    # and of the first column name an axis; the upward axis of the first panel is a density.
    for axis in [*(ax.xaxis for ax in axes[-1]), *(ax.yaxis for ax in axes[1:, 0])]:
        formatter = axis.get_major_formatter()
        formatter.format_ticks(axis.get_majorticklocs())  # computes the offset
        offset = formatter.get_offset()
        axis.get_offset_text().set_visible(False)
        if offset:
            axis.set_label_text(f"{axis.get_label_text()} {offset}", fontsize=7.0)


def _new_figure(n_panels: int) -> Figure:
    """A figure for so many panels a side, with room above few panels for the key."""
    # Inches: 1.68 for each panel, and 1.1 for the margins that the corner package leaves.
    width = 3.7 if n_panels == 1 else 1.68 * n_panels + 1.1
    height = width / _BELOW_KEY if n_panels <= _FEW_PANELS else width
    return Figure(figsize=(width, height))


def _write_key(
    figure: Figure,
    draws: Draws,
    samples: Sequence[_Sample],
    n_panels: int,
    *,
    has_prior: bool,
) -> None:
    """Write what lines and marks mean.

    The key stands above the panels if there are few. More panels leave a corner free for the key.
    """
    style: Style = {
        "loc": "upper right",
        "alignment": "left",
        "frameon": False,
        "borderaxespad": 0.4,
        "labelspacing": 0.35,
    }
    if n_panels <= _FEW_PANELS:
        style["loc"] = "upper left"
        margins = figure.subplotpars  # the panels give up the height of the key
        figure.subplots_adjust(bottom=_BELOW_KEY * margins.bottom, top=_BELOW_KEY * margins.top)

    names = []
    for sample in samples:
        name = sample.target.subject.name
        warning = "\nNOT CONVERGED" if name in draws.not_converged else ""
        names.append(plain(name, limit=24) + warning)

    handles: list[Artist] = []
    if len(names) == 1:
        style |= {"title": names[0], "title_fontproperties": {"size": 14.0, "weight": "bold"}}
        if n_panels > 1:  # there are contours
            handles.append(Patch(color=POSTERIOR, label="50 % of the draws"))
            handles.append(Patch(fc=(POSTERIOR, 1.0 / 3.0), ec=POSTERIOR, label="95 %"))
        handles.append(_line("median, 95 % interval", color=POSTERIOR, ls="dashed"))
        truth = _line("true value", color=TRUTH, marker="s")
    else:
        for sample, name in zip(samples, names, strict=True):
            handles.append(_line(f"{name}, median", color=sample.colour, ls=sample.line))
        mark: Style = {"ls": "", "mec": "black"}
        if n_panels > 1:
            handles.append(_line("50 and 95 % of the draws", marker="o", ms=8, mfc="none", **mark))
        truth = _line("true values", marker="^", ms=7, mfc="white", **mark)

    if has_prior:
        handles.append(_line("prior", color=PRIOR))
    if np.isfinite([sample.truth for sample in samples]).any():
        handles.append(truth)
    synthetic = ", synthetic data" if draws.synthetic else ""
    handles.append(_line(fill(model_title(draws.model) + synthetic, 40), ls=""))
    figure.legend(handles=handles, **style)


def _line(label: str, **style: Any) -> Line2D:
    """A line or a mark of the key, which no panel shows; `style` is matplotlib's."""
    return Line2D([], [], label=label, **style)
