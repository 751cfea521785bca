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

from bayes_toe.answers.order_effect import decimals_of
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
from bayes_toe.plots.style import MARKED_QUANTILES, POSTERIOR, WEAKER_FIRST, Style, plain

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
    names = quantity_names(draws.posterior(subject_names[0]), coordinates)
    samples = _samples(draws, subject_names, names, truths)

    limits = np.array([sample.limits for sample in samples])  # (subjects, quantities, 2)
    # A panel has the lowest and the highest limit of all subjects.
    spans = np.column_stack([limits[..., 0].min(axis=0), limits[..., 1].max(axis=0)]).tolist()

    fig = fig or _new_figure(len(names))
    for sample in samples:  # All subjects share the panels, which every call returns.
        axes = _draw_posterior(fig, sample, spans, is_single=len(samples) == 1)
    if prior is not None:
        for sample in samples:
            subject_in_unit = sample.target.subject
            values = prior_values(model_posterior(draws.model, subject_in_unit, prior))
            for ax, name, span in zip(axes.diagonal(), names, spans, strict=True):
                prior_draws = axis_values(name, values[name], subject_in_unit.unit)
                ax.plot(*_smooth_density(prior_draws, span), color=PRIOR, lw=1.4, ls=sample.line)
    _arrange_axes(axes)
    _write_key(fig, draws, samples, has_prior=prior is not None)
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

    `columns` has the draws of each quantity, (draws,) each. `truth` has the true values of the
    quantities, NaN for unknown ones, and `limits` the limits of their axes.
    """

    target: SubjectPosterior
    columns: NamedArrays
    truth: Sequence[float]
    limits: Sequence[Span]
    colour: str
    line: str


def _samples(
    draws: Draws, subject_names: Sequence[str], names: Texts, truths: Mapping[str, Values]
) -> list[_Sample]:
    """The sample of each subject; `names` has the quantities, and all axes have one unit."""
    log_draws = []  # draws of each subject by quantity, (draws,) each, in natural logs
    for subject_name in subject_names:
        log_draws.append({name: draws.values(subject_name, name).ravel() for name in names})
    unit = shown_unit(draws.subject(subject_names[0]).unit, log_draws)

    samples = []
    # OVERLAID has four styles. If there are fewer subjects, they take the first styles.
    styles = zip(subject_names, log_draws, OVERLAID, strict=False)
    for subject_name, values, (colour, line) in styles:
        target = in_unit(draws.posterior(subject_name), unit)
        columns = {name: axis_values(name, values[name], unit) for name in names}
        true_values = all_true_values(truths.get(target.subject.name, {}), target)
        truth = [true_values.get(name, np.nan) for name in names]
        limits = axis_limits(columns, target, true_values)
        samples.append(_Sample(target, columns, truth, limits, colour, line))
    return samples


def quantity_names(target: SubjectPosterior, coordinates: str | Sequence[str]) -> Texts:
    """The names of the quantities of 'natural' or 'identified', or those in a sequence.

    For the four models, 'natural' has constant error, contraction and JND, if the model has them.
    An unknown quantity, or one that is named twice, is refused.
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
    `draws_by_subject` has the draws of each subject by quantity, (draws,) each, in natural logs.
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


def axis_label(text: str, name: str, unit: StimulusUnit) -> str:
    """A text for a quantity with the unit of its axis, as in 'JND, %'; a pure number has none."""
    quantity = QUANTITY_BY_NAME[name]
    if quantity.display == STIMULUS and unit.stimulus_unit:
        axis_unit = unit.stimulus_unit
    elif quantity.display == PERCENT:
        axis_unit = "%"
    elif _is_difference(name, unit):
        axis_unit = unit.difference_unit
    else:
        # Quantities that stay in natural logs where the unit of the stimuli is not known. Any other
        # quantity is a pure number.
        axis_unit = {LOG_INTENSITY_UNIT: "ln", PER_LOG_INTENSITY: "per ln"}.get(quantity.unit, "")
    return f"{text}, {axis_unit}" if axis_unit else text


def axis_limits(columns: NamedArrays, target: SubjectPosterior, truth: Values) -> list[Span]:
    """The limits of the axis of each quantity, which hold its true value if `truth` has one.

    `columns` has the draws of each quantity, (draws,) each. Draws, true values and limits are as
    axes show them. Limits are at quantiles of the draws, not at the smallest and the largest draw:
    a few draws far out in a funnel would squeeze all other draws into one bin.
    """
    spans = []
    for name, values in columns.items():
        low, high = np.quantile(values, SPAN_QUANTILES).tolist()
        low = min(low, truth.get(name, low))
        high = max(high, truth.get(name, high))

        if high > low:  # room for a mark at either end
            pad = 0.08 * (high - low)
        else:  # all draws are equal, perhaps 0, and an axis needs a width
            pad = 0.5 * abs(low) + 1e-12
        # No axis goes beyond the values that its quantity can have.
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


def all_true_values(true_values: Values, target: SubjectPosterior) -> dict[str, float]:
    """True values and all that follow from them, by quantity, as axes show them.

    A true value that the quantity cannot have is refused.
    """
    _require_possible(true_values, target)
    parameters = {}  # the natural parameters; an unknown one is NaN
    for name in target.names.natural:
        parameters[name] = np.asarray(true_values.get(name, np.nan), np.float64)
    with np.errstate(invalid="ignore"):  # The paper's prior excludes a sigma_l above sigma_p.
        quantities = target.quantities(target.points(parameters))

    all_values = {}
    for name, value in quantities.items():
        # A given value goes before one that follows, which is NaN if it depends on an unknown one.
        true_value = true_values.get(name, float(value))
        if np.isfinite(true_value):
            all_values[name] = float(axis_values(name, true_value, target.subject.unit))
    return all_values


def _require_possible(true_values: Values, target: SubjectPosterior) -> None:
    """Refuse an unknown quantity, and a true value that a quantity cannot have."""
    for name, value in true_values.items():
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
        is_finite = np.isfinite(axis_values(name, value, target.subject.unit))
        if not (is_finite and low <= value <= high):
            raise InputError(f"truths: {name}={value!r}, allowed: {rule}")


# --- panels ---------------------------------------------------------------------------------------


def contour_grid(
    x: FloatArray, y: FloatArray, x_span: Span, y_span: Span
) -> tuple[FloatArray, ...]:
    """What contours of draws `x`, `y` need in a panel with the limits `x_span` and `y_span`.

    Returns, with the two bins that are added beyond each side of a panel of BINS bins:

    * the middles of the bins across, shape (BINS + 4,), and of the bins upward,
    * the smoothed counts of the draws, shape (bins upward, bins across),
    * the levels of contours, ascending, one for each share in :data:`CONTOUR_SHARES`: this share
      of the draws has a density above the level. If all draws are one point, there is one level.
    """
    counts, _, _ = np.histogram2d(y, x, BINS, [y_span, x_span])  # (upward, across)
    # A draw that the sampler repeats says nothing new. Draws with one x are such repetitions: other
    # draws differ in x, because x is continuous.
    n_distinct = len(np.unique(x))
    # The power is that of the normal reference rule in two dimensions.
    smooth = gaussian_filter(counts, _SMOOTHING * n_distinct ** (-1.0 / 6.0))

    # EDGE_BINS are the two bins that follow on each side: one repeats the edge, and one has the
    # lowest density, so that contours close there.
    continued = np.pad(smooth, 1, mode="edge")
    padded = np.pad(continued, 1, constant_values=smooth.min())
    middle_x = _bin_middles(x_span)
    middle_y = _bin_middles(y_span)

    # Draws beyond the added bins get a density below that of all other draws.
    density = RegularGridInterpolator(
        (middle_y, middle_x), padded, bounds_error=False, fill_value=-1.0
    )
    density_at_draws = density((y, x))  # (draws,)
    # A share S of the draws has a density above its (1 - S) quantile.
    levels = np.unique(np.quantile(density_at_draws, 1.0 - np.array(CONTOUR_SHARES)))
    return middle_x, middle_y, padded, levels


def _bin_middles(span: Span) -> FloatArray:
    """The middles of the bins of a panel, and of the bins that are added beyond either end."""
    low, high = span
    position = (np.arange(-EDGE_BINS, BINS + EDGE_BINS) + 0.5) / BINS  # 0 to 1 in the panel
    return low + (high - low) * position


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
    unit = sample.target.subject.unit
    corner_package().corner(
        np.column_stack(list(sample.columns.values())),  # (draws, quantities)
        fig=figure,
        range=spans,
        labels=[axis_label(QUANTITY_BY_NAME[name].symbol, name, unit) for name in sample.columns],
        label_kwargs={"fontsize": 9.5},
        labelpad=0.05,
        max_n_ticks=4,
        use_math_text=True,
        color=sample.colour,
        hist_kwargs={"alpha": 0.0},  # no histograms: `_draw_curves` draws curves
        quantiles=MARKED_QUANTILES if is_single else None,  # as dashed lines
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
    columns = list(sample.columns.values())
    for column, row in combinations(range(len(spans)), 2):  # column < row: below the diagonal
        ax = axes[row, column]
        *middles, counts, levels = contour_grid(
            columns[column], columns[row], spans[column], spans[row]
        )
        ax.contour(*middles, counts, levels, linewidths=1.5, zorder=1.5, **lines)
        if is_single:
            # Areas from level to level, the last area up to a bound that no count reaches. The
            # outer area, between the two levels, is light. If all draws are one point, there is one
            # level, and no outer area.
            bounds = [*levels, 2.0 * counts.max()]
            colours = [(sample.colour, 1.0 / 3.0), sample.colour][-len(levels) :]
            ax.contourf(*middles, counts, bounds, colors=colours)

        true_x = sample.truth[column]
        true_y = sample.truth[row]
        if is_single:
            ax.plot(true_x, true_y, "s", color=TRUTH)
            ax.axvline(true_x, color=TRUTH)
            ax.axhline(true_y, color=TRUTH)
        else:  # only a mark, because lines would be taken for medians
            ax.plot(true_x, true_y, "s", ms=5, color=sample.colour, **_TRUTH_MARKS)


def _draw_curves(
    diagonal: Panels, sample: _Sample, spans: Sequence[Span], *, is_single: bool
) -> None:
    """Draw densities and true values on the diagonal, with the median and interval above it.

    Of several subjects, an upright line is the median, and no interval is drawn.
    """
    panels = zip(diagonal, sample.columns.values(), spans, sample.truth, strict=True)
    for ax, values, span, true_value in panels:
        ax.plot(*_smooth_density(values, span), color=sample.colour, lw=1.4, ls=sample.line)
        low, median, high = np.quantile(values, MARKED_QUANTILES)
        if is_single:
            # Two digits of the width of the interval, or of each number, if all draws are equal or
            # the median is too long for the panel. A "z" leaves no -0.0.
            form = f"z.{decimals_of(high - low)}f"
            if low == high or len(f"{median:{form}}") > 9:
                form = "z.2g"
            texts = [f"{value:{form}}".replace("-", "−") for value in (low, median, high)]
            ax.set_title(format_estimate(*texts), fontsize=9.0)
            ax.axvline(true_value, color=TRUTH)
        else:
            ax.axvline(median, color=sample.colour, lw=1.0, ls=sample.line)
            # A triangle, because a further upright line would be taken for a median.
            ax.plot(true_value, 0.0, "^", ms=7, clip_on=False, color=sample.colour, **_TRUTH_MARKS)


def _smooth_density(values: FloatArray, span: Span) -> ArrayPair:
    """Middles of the bins of a curve on the diagonal, and the smoothed share of draws in each bin.

    `values` are the draws, and both arrays have the shape (_CURVE_BINS,).
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
    figure: Figure, draws: Draws, samples: Sequence[_Sample], *, has_prior: bool
) -> None:
    """Write what lines and marks mean.

    The key stands above the panels if there are few. More panels leave a corner free for the key.
    """
    n_panels = len(samples[0].columns)  # a side
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

    has_contours = n_panels > 1
    entries: list[Artist] = []
    if len(samples) == 1:
        style |= {"title": names[0], "title_fontproperties": {"size": 14.0, "weight": "bold"}}
        if has_contours:
            entries.append(Patch(color=POSTERIOR, label="50 % of the draws"))
            entries.append(Patch(fc=(POSTERIOR, 1.0 / 3.0), ec=POSTERIOR, label="95 %"))
        entries.append(_line("median, 95 % interval", color=POSTERIOR, ls="dashed"))
        truth = _line("true value", color=TRUTH, marker="s")
    else:
        for sample, name in zip(samples, names, strict=True):
            entries.append(_line(f"{name}, median", color=sample.colour, ls=sample.line))
        mark: Style = {"ls": "", "mec": "black"}
        if has_contours:
            entries.append(_line("50 and 95 % of the draws", marker="o", ms=8, mfc="none", **mark))
        truth = _line("true values", marker="^", ms=7, mfc="white", **mark)

    if has_prior:
        entries.append(_line("prior", color=PRIOR))
    if np.isfinite([sample.truth for sample in samples]).any():
        entries.append(truth)
    synthetic = ", synthetic data" if draws.synthetic else ""
    entries.append(_line(fill(model_title(draws.model) + synthetic, 40), ls=""))
    figure.legend(handles=entries, **style)


def _line(label: str, **style: Any) -> Line2D:
    """A line or a mark of the key, which no panel shows; `style` is matplotlib's."""
    return Line2D([], [], label=label, **style)
