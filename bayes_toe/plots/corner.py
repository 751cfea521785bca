"""Corner plots by the corner package, with areas of our own on its panels.

The areas hold the stated shares of the draws.

A level is a quantile of the density at the draws themselves. The share of the smoothed density that
lies above a level, which corner's own contours take, is another: smoothing spreads a narrow peak,
such as that of mu_1 and sigma_p amid their long tails, and an area that holds half of what was
smoothed held up to 70 % of the draws.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from textwrap import wrap
from typing import Any, NamedTuple, cast

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.ndimage import gaussian_filter, map_coordinates

from bayes_toe.answers.order_effect import percent
from bayes_toe.arrays import FloatArray
from bayes_toe.data.messages import listed
from bayes_toe.errors import InputError
from bayes_toe.inference.draws import Draws, require_draws
from bayes_toe.model.models import model_posterior, model_title, stored_model
from bayes_toe.model.observer import ObserverPosterior
from bayes_toe.model.paper_equations import NATURAL, Natural, quantities
from bayes_toe.model.paper_model import PRIOR_DRAWS, PaperPosterior
from bayes_toe.model.posterior import AnswerPosterior
from bayes_toe.model.prior import Prior
from bayes_toe.plots.style import LABELS, MARKED, POSTERIOR, WEAKER_FIRST, new_figure, plain

Values = Mapping[str, float]
Span = tuple[float, float]

COORDINATES = ("natural", "identified")
#: What a corner plot of the four models of the observer shows.
_ORDER_QUANTITIES = ("constant_error", "contraction", "jnd")
BINS = 40
#: Bins beyond either end of a panel, where contours close.
AROUND = 2
#: Shares of the draws inside the contours; quantiles between which a panel shows its quantity.
LEVELS, SPANNED = (0.5, 0.95), (0.005, 0.995)
#: Differences of natural-log intensities that axes show in per cent of intensity.
IN_PERCENT = ("constant_error", "pse_shift", "jnd", "zone")
#: Bins by which counts are smoothed, times the sixth root of the number of distinct draws: about
#: the normal reference rule where a panel is six standard deviations wide.
_SMOOTHED = 8.0
_WITHOUT_UNIT = ("contraction", "pull", "gain", "gamma", "q0", "lapse_rate")
PRIOR, TRUTH = "#999999", WEAKER_FIRST
#: Of several subjects in the same panels: colour, and the line that tells them apart in grey.
OVERLAID = (
    (POSTERIOR, "solid"),
    ("#B8520A", "dashed"),
    ("#00704F", "dotted"),
    ("#A0458A", "dashdot"),
)
#: Inches: a panel, a lone one, the gap between two; margins; from panels to their labels; the least
#: that words beside them need.
_PANEL, _LONE_PANEL, _GAP, _LEFT, _BELOW, _MARGIN, _LABEL, _WORDS = (
    1.6,
    2.6,
    0.1,
    0.95,
    0.95,
    0.15,
    0.63,
    2.7,
)
_LINE = 1.3 / 72.0  # inches from a line of words to the next, by its points


def corner(
    draws: Draws,
    subject: str | Sequence[str],
    *,
    coordinates: str | Sequence[str] = "natural",
    truths: Values | Mapping[str, Values] | None = None,
    prior: Prior | None = None,
    fig: Figure | None = None,
) -> Figure:
    """Corner plot of one subject: contours hold 50 and 95 % of its draws.

    Dashed lines mark the median and the central 95 % interval. Constant error, PSE shift, JND and
    zone are in per cent of intensity.

    Parameters
    ----------
    draws : Draws
    subject : str or sequence of str
        One, or two to four in the same panels, distinguished by colours and lines; upright lines
        are then their medians.
    coordinates : {"natural", "identified"} or sequence of str
        Which quantities. "natural": of the paper's model (H1) its parameters, of the four models
        those of constant error, contraction and JND that the model has. "identified": what the
        answers depend on. A sequence names quantities, such as `gain` or `zone`.
    truths : mapping of str to float, optional
        Known values of a synthetic subject; of several subjects, such a mapping by name. What
        follows from them is drawn too: natural parameters are enough for any quantity.
    prior : Prior, optional
        Its marginals are drawn in grey on the diagonal, on the scale of the posterior's histograms;
        `draws.prior` is the one that the draws were made under.
    fig : matplotlib Figure or SubFigure, optional
        Drawn into, where given.

    Raises
    ------
    InputError
        For an unknown subject or quantity, no quantity at all, or a true value that cannot be one;
        for more than four subjects.
    """
    require_draws(draws)
    alone = isinstance(subject, str)
    names = [subject] if isinstance(subject, str) else list(subject)
    is_few = 2 <= len(set(names)) == len(names) <= len(OVERLAID)
    if not alone and not is_few:
        found = listed([*map(repr, names)])
        raise InputError(
            f"subjects in one corner plot: found {found}; allowed: 2 to {len(OVERLAID)}, each once"
        )
    known = _truths_by_subject(truths, subject)
    shown = [_Shown.of(draws, name, coordinates, known.get(name)) for name in names]
    limits = np.array([spans_of(one.samples.T, one.names, one.target) for one in shown])
    lowest, highest = limits[..., 0].min(axis=0), limits[..., 1].max(axis=0)
    spans = list(zip(lowest.tolist(), highest.tolist(), strict=True))
    words = _words(draws, shown, spans, alone=alone)
    if prior is not None:
        words.append(_Words("grey: prior"))
    if not set(shown[0].names) <= {*IN_PERCENT, *_WITHOUT_UNIT}:
        words.append(_Words("intensities: natural log"))
    figure = _new_figure(len(spans), words) if fig is None else fig
    counts = []
    for one, (colour, line) in zip(shown, OVERLAID, strict=False):
        _draw_posterior(figure, one, spans, colour, line, alone=alone)
        counts.append(_counts(dict(zip(one.names, one.samples.T, strict=True)), spans))
    diagonal = np.array(figure.axes).reshape(len(spans), len(spans)).diagonal()
    if prior is not None:
        for one, (_, line) in zip(shown, OVERLAID, strict=False):
            drawn = one.prior_values(prior)
            counts.append(_counts(drawn, spans) * (len(one.samples) / PRIOR_DRAWS))
            for ax, heights, span in zip(diagonal, counts[-1], spans, strict=True):
                edges = np.linspace(*span, BINS + 1)
                ax.stairs(heights, edges, color=PRIOR, lw=1.4, ls=line, label="prior")
    for ax, highest in zip(diagonal, np.max(counts, axis=(0, 2)), strict=True):
        ax.set_ylim(0.0, 1.1 * highest)  # the panels were fitted to the last subject
    _lay_out(figure, spans, words)
    return figure


def _counts(columns: Mapping[str, FloatArray], spans: Sequence[Span]) -> FloatArray:
    """Draws in the bins of each panel of the diagonal, shape (quantities, BINS)."""
    counts = [
        np.histogram(values, BINS, span)[0]
        for values, span in zip(columns.values(), spans, strict=True)
    ]
    return np.array(counts, np.float64)


def _truths_by_subject(
    truths: Values | Mapping[str, Values] | None, subject: str | Sequence[str]
) -> Mapping[str, Values]:
    """True values by subject, of one or of several."""
    if truths is None:
        return {}
    by_subject = {subject: truths} if isinstance(subject, str) else truths
    if not all(isinstance(values, Mapping) for values in by_subject.values()):
        raise InputError(
            "truths: found numbers, allowed for several subjects: "
            "a mapping of each one's values by its name"
        )
    return cast("Mapping[str, Values]", by_subject)


# --- what is shown of a subject -------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Shown:
    """Quantities of one subject: their draws, shape (draws, quantities), and true values."""

    subject: str
    target: AnswerPosterior
    model: str
    names: tuple[str, ...]
    samples: FloatArray
    known: Values

    @classmethod
    def of(
        cls, draws: Draws, subject: str, coordinates: str | Sequence[str], truths: Values | None
    ) -> _Shown:
        """What is asked for, refused where it cannot be."""
        target = draws.posterior(subject)
        if len(coordinates) == 0:
            raise InputError(
                f"coordinates: found none, allowed: {', '.join(COORDINATES)} or some of {', '.join(target.names.all)}"
            )
        if isinstance(coordinates, str) and coordinates not in COORDINATES:
            raise InputError(
                f"coordinates {coordinates!r} must be one of: {', '.join(COORDINATES)}"
            )
        names = _shown_names(target, coordinates)
        samples = [axis_values(name, draws.values(subject, name).ravel()) for name in names]
        known = {} if truths is None else known_from(truths, target)
        return cls(subject, target, draws.model, names, np.column_stack(samples), known)

    def prior_values(self, prior: Prior) -> dict[str, FloatArray]:
        """Draws from a prior, as axes show them."""
        subject = self.target.subject
        model = stored_model(self.model, subject.task)
        drawn = prior_values(model_posterior(model, subject, prior))
        return {name: axis_values(name, drawn[name]) for name in self.names}


def _shown_names(target: AnswerPosterior, coordinates: str | Sequence[str]) -> tuple[str, ...]:
    """The quantities of a choice.

    'natural' leaves out what all four models of the observer have.
    """
    if not isinstance(coordinates, str):
        return tuple(coordinates)
    if coordinates == "identified":
        return target.names.identified
    if isinstance(target, ObserverPosterior):
        return tuple(name for name in _ORDER_QUANTITIES if name in target.names.all)
    return target.names.natural


def prior_values(target: AnswerPosterior) -> Mapping[str, FloatArray]:
    """Draws from the prior of a posterior by quantity, shape (PRIOR_DRAWS,) each."""
    return target.quantities(target.sample_prior(np.random.default_rng(0), PRIOR_DRAWS))


def axis_values(name: str, values: npt.ArrayLike) -> FloatArray:
    """Values of a quantity as its axis shows them."""
    values = np.asarray(values, np.float64)
    return percent(values) if name in IN_PERCENT else values


def axis_label(name: str) -> str:
    """What the axis of a quantity is called."""
    label = LABELS.get(name, name)
    return f"{label}, %" if name in IN_PERCENT else label


def spans_of(
    columns: Iterable[FloatArray], names: Sequence[str], target: AnswerPosterior
) -> list[Span]:
    """Axis limits of quantities, within their support.

    A few draws far out in a funnel do not squeeze the rest into one bin.
    """
    spans = []
    for values, name in zip(columns, names, strict=True):
        low, high = np.quantile(values, SPANNED).tolist()
        pad = 0.08 * (high - low) if high > low else 0.5 * abs(low) + 1e-12
        least, most = axis_values(name, support(target, name)).tolist()
        spans.append((max(low - pad, least), min(high + pad, most)))
    return spans


def support(target: AnswerPosterior, name: str) -> Span:
    """Where a quantity can lie."""
    if name in ("mu1", "offset", "pse_shift"):
        return -np.inf, np.inf
    if name in ("gamma", "rho") or name.startswith("q"):
        return 0.0, 1.0
    if name.startswith("sigma") or name in ("width", "jnd", "zone"):
        return 0.0, np.inf
    return target.prior_quantile(name, 0.0), target.prior_quantile(
        name, 1.0
    )  # as far as the model's prior reaches


def known_from(truths: Values, target: AnswerPosterior) -> dict[str, float]:
    """The true values given and all that follow from them, as axes show them."""
    allowed = target.names.all
    for name, value in truths.items():
        if name not in allowed:
            raise InputError(f"truths: unknown quantity {name!r}; there are: {', '.join(allowed)}")
        if not np.isfinite(value) or (name == "sigma_p" and value <= 0):
            raise InputError(
                f"truths: {name}={value!r}, allowed: a {'positive ' if name == 'sigma_p' else ''}finite number"
            )
    # NaN stands for what was not given, and marks what cannot be known without it.
    given = {
        name: np.asarray(truths.get(name, np.nan), np.float64) for name in target.names.natural
    }
    if isinstance(target, PaperPosterior) and set(NATURAL) <= set(
        given
    ):  # the paper's parameters may also lie outside the prior's support
        found = quantities(Natural(*(given[name] for name in NATURAL)), target.sbar)
    else:
        found = target.quantities(target.points(given))
    follow = {name: float(value) for name, value in found.items() if np.isfinite(value)}
    known = {**follow, **truths}
    return {name: float(axis_values(name, value)) for name, value in known.items()}


# --- panels ---------------------------------------------------------------------------------------


class Density(NamedTuple):
    """Smoothed counts of draws in the bins of a panel, and the levels of its contours.

    There are two more bins on every side.

    Middles of the bins, shape (BINS + 4,) each; values, up and across: the outermost bins have the least of all, the next ones those of
    their neighbours within; levels: densities above which the shares :data:`LEVELS` of all draws lie, linear between middles of bins.
    """

    x: FloatArray
    y: FloatArray
    values: FloatArray
    levels: tuple[float, ...]

    @classmethod
    def of(cls, x: FloatArray, y: FloatArray, across: Span, up: Span) -> Density:
        """Of draws, shape (draws,) each, in a panel that reaches so far."""
        counts = np.histogram2d(y, x, BINS, [up, across])[0]
        n_distinct = len(np.unique(x))  # a draw that is repeated says nothing new
        smooth = gaussian_filter(counts, _SMOOTHED * n_distinct ** (-1.0 / 6.0))
        values = np.pad(np.pad(smooth, 1, mode="edge"), 1, constant_values=smooth.min())
        places = [
            (draws - low) / (high - low) * BINS + AROUND - 0.5
            for draws, (low, high) in ((y, up), (x, across))
        ]
        at_draws = map_coordinates(
            values, places, order=1, mode="constant", cval=-1.0
        )  # outside, less than any density
        middles = (np.arange(-AROUND, BINS + AROUND) + 0.5) / BINS
        levels = np.quantile(at_draws, 1.0 - np.array(LEVELS)).tolist()
        middle_x, middle_y = (low + (high - low) * middles for low, high in (across, up))
        return cls(middle_x, middle_y, values, tuple(levels))


def corner_package() -> Any:
    """The corner package, which takes a second to import.

    Who only wants spans and densities need not wait.

    ArviZ 0.23, which it imports, announces its refactoring once a day, and notes the day in a file
    that two processes at once lose.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        try:
            import corner as package
        except FileNotFoundError:
            import corner as package
    return package


def _draw_posterior(
    figure: Figure, one: _Shown, spans: Sequence[Span], colour: str, line: str, *, alone: bool
) -> None:
    """Histograms, contours and true values of one subject.

    In a figure that has panels already, over what is there.
    """
    library, truths = corner_package(), [one.known.get(name, np.nan) for name in one.names]
    library.corner(
        one.samples,
        fig=figure,
        bins=BINS,
        range=list(spans),
        labels=[axis_label(name) for name in one.names],
        label_kwargs={"fontsize": 12},
        max_n_ticks=0,
        color=colour,
        hist_kwargs={"color": colour}
        if alone
        else {"color": colour, "linestyle": line, "linewidth": 1.4},
        quantiles=MARKED if alone else None,
        plot_datapoints=False,
        plot_density=False,
        plot_contours=False,
    )
    axes = np.array(figure.axes).reshape(len(spans), len(spans))
    for j, i in combinations(range(len(spans)), 2):
        _draw_contours(
            axes[i, j],
            Density.of(one.samples[:, j], one.samples[:, i], spans[j], spans[i]),
            colour,
            line,
            filled=alone,
        )
    if alone:  # corner's own lines fail in a figure of one quantity
        for i in np.flatnonzero(np.isfinite(truths)).tolist():
            for ax in axes[i:, i]:
                ax.axvline(truths[i], color=TRUTH)
            for ax in axes[i, :i]:
                ax.axhline(truths[i], color=TRUTH)
        library.overplot_points(figure, [truths], marker="s", color=TRUTH)
    else:  # lines would be taken for medians
        style: dict[str, Any] = {"color": colour, "mec": "black", "mew": 0.8, "zorder": 5}
        library.overplot_points(figure, [truths], marker="s", ms=5, **style)
        for ax, median, value in zip(
            axes.diagonal(), np.median(one.samples, axis=0), truths, strict=True
        ):
            ax.axvline(median, color=colour, lw=1.0, ls=line)
            ax.plot(value, 0.0, "^", ms=7, clip_on=False, **style)


def _draw_contours(ax: Axes, found: Density, colour: str, line: str, *, filled: bool) -> None:
    """Areas or outlines that hold the shares :data:`LEVELS` of the draws.

    Where all draws are one point there is one level.
    """
    levels = np.unique(found.levels)
    if filled:
        colours = [(colour, 1.0 / 3.0), colour][-len(levels) :]
        ax.contourf(
            found.x, found.y, found.values, [*levels, 2.0 * found.values.max()], colors=colours
        )
    ax.contour(
        found.x,
        found.y,
        found.values,
        levels,
        colors=colour,
        linestyles=line,
        linewidths=1.5,
        zorder=1.5,
    )


# --- words and layout -----------------------------------------------------------------------------


class _Words(NamedTuple):
    """A line of the title or the key; its size in points."""

    text: str
    size: float = 10.0
    weight: str = "normal"
    colour: str = "#444444"


def _words(
    draws: Draws, shown: Sequence[_Shown], spans: Sequence[Span], *, alone: bool
) -> list[_Words]:
    """The subjects, with line and colour of each of several; what is drawn; true values."""
    words = []
    for one, (colour, line) in zip(shown, OVERLAID, strict=False):
        if alone:
            words.append(_Words(plain(one.subject, 24), 14.0, "bold", "black"))
        else:
            words.append(_Words(f"{plain(one.subject, 20)} ({line})", 12.0, "bold", colour))
        if one.subject in draws.not_converged:
            words.append(_Words("NOT CONVERGED", 13.0, "bold", "black"))
    synthetic = ", synthetic data" if draws.synthetic else ""
    words.append(_Words(model_title(draws.model) + synthetic, 11.0, colour="black"))
    if len(spans) > 1:
        words.append(_Words("contours: 50 and 95 %"))
    words.append(_Words("dashed: median, 95 % interval" if alone else "upright: medians"))
    outside, n_inside = list[str](), 0
    for one in shown:
        for name, (low, high) in zip(one.names, spans, strict=True):
            value = one.known.get(name, np.nan)
            if low <= value <= high:
                n_inside += 1
            elif np.isfinite(value):
                outside.append(f"{axis_label(name)} = {value:.5g}".replace("-", "−"))
    if n_inside:
        squares = "squares, " if len(spans) > 1 else ""
        words.append(_Words("red: true value" if alone else f"{squares}triangles: true values"))
    if outside:
        words.append(_Words(f"true value outside: {', '.join(outside)}"))
    return words


def _new_figure(count: int, words: Sequence[_Words]) -> Figure:
    """A figure for so many panels a side.

    There is room above the panels for words that have none beside them.
    """
    panel = _LONE_PANEL if count == 1 else _PANEL
    side = count * panel + (count - 1) * _GAP
    wide, high = _LEFT + side + _MARGIN, _BELOW + side + _MARGIN
    return new_figure(wide, high + _header(count, panel, words, wide), layout=None)


def _header(count: int, panel: float, words: Sequence[_Words], wide: float) -> float:
    """Inches of words above the panels: none where they stand beside the topmost one."""
    beside = (count - 1) * (panel + _GAP) >= _WORDS
    return (
        0.0
        if beside
        else _MARGIN + sum(_LINE * one.size for one, _ in _lines(words, wide - 2.0 * _MARGIN))
    )


def _lines(words: Sequence[_Words], room: float) -> list[tuple[_Words, str]]:
    """Words in lines that are no wider than so many inches."""
    letters = [room * 72.0 / ((0.68 if one.weight == "bold" else 0.54) * one.size) for one in words]
    return [
        (one, line)
        for one, most in zip(words, letters, strict=True)
        for line in wrap(one.text, max(8, int(most)))
    ]


def _lay_out(figure: Figure, spans: Sequence[Span], words: Sequence[_Words]) -> None:
    """Place panels, ticks and words; all measures in inches."""
    count = len(spans)
    wide, high = (float(side) / figure.dpi for side in (figure.bbox.width, figure.bbox.height))
    across = (wide - _LEFT - _MARGIN - (count - 1) * _GAP) / count
    header = _header(count, across, words, wide)
    down = (high - _BELOW - _MARGIN - header - (count - 1) * _GAP) / count
    figure.subplots_adjust(
        _LEFT / wide,
        _BELOW / high,
        1.0 - _MARGIN / wide,
        1.0 - (_MARGIN + header) / high,
        _GAP / across,
        _GAP / down,
    )
    axes = np.array(figure.axes).reshape(count, count)
    for i, (start, end) in enumerate(spans):
        found, margin = np.asarray(MaxNLocator(4).tick_values(start, end)), 0.06 * (end - start)
        ticks = found[
            (found >= start + margin) & (found <= end - margin)
        ]  # whose labels do not touch the next panel's
        for ax in axes[i:, i]:
            ax.set_xticks(ticks)
        for ax in axes[i, :i]:
            ax.set_yticks(ticks)
        axes[-1, i].tick_params(axis="x", labelrotation=45)
        axes[-1, i].xaxis.set_label_coords(0.5, -_LABEL / down)
        axes[i, 0].yaxis.set_label_coords(-_LABEL / across, 0.5)
    above, room = (True, wide - 2.0 * _MARGIN) if header else (False, (count - 1) * (across + _GAP))
    y = high - _MARGIN
    for one, line in _lines(words, room):
        x, side = (_MARGIN, "left") if above else (wide - _MARGIN, "right")
        figure.text(
            x / wide,
            y / high,
            line,
            size=one.size,
            weight=one.weight,
            color=one.colour,
            ha=side,
            va="top",
        )
        y -= _LINE * one.size
