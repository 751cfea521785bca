"""Corner plots of one subject's draws.

The panels are laid out in inches, so that key and tick labels stay clear of them and of each other whatever their number. Few
panels leave no room beside them: the key then stands above. :mod:`bayes_toe.plots.corner_sheet` draws the same without Axes.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt

from bayes_toe.errors import InputError
from bayes_toe.inference.draws import Draws
from bayes_toe.model.prior import Prior
from bayes_toe.plots import corner_content as shown
from bayes_toe.plots.corner_content import BOTTOM, GAP, LEFT, OVERLAID, RIGHT, TOP, TRUTH, Content, Values, content, overlaid
from bayes_toe.plots.density import Density
from bayes_toe.plots.style import POSTERIOR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def corner(
    draws: Draws,
    subject: str | Sequence[str],
    *,
    coordinates: str | Sequence[str] = "natural",
    truths: Values | Mapping[str, Values] | None = None,
    prior: Prior | None = None,
    fig: Figure | None = None,
) -> Figure:
    """Corner plot of one subject: contours hold 50 % and 90 % of the posterior, dashed lines mark 5, 50 and 95 %.

    Parameters
    ----------
    draws : Draws
    subject : str or sequence of str
        One, or two to four in the same panels, told apart by colours and lines; upright lines are then their medians.
    coordinates : {"natural", "identified"} or sequence of str
        Which quantities; a sequence names quantities of the model, such as `gain`, `offset` or `pull`.
    truths : mapping of str to float, optional
        Known values of a synthetic subject; of several subjects, such a mapping by name. What follows from them is drawn too: natural
        parameters are enough for any quantity.
    prior : Prior, optional
        Its marginals are drawn in grey on the diagonal, on the scale of the posterior's histograms; `draws.prior` is the one
        that the draws were made under.
    fig : matplotlib Figure or SubFigure, optional
        Drawn into, where given.

    Raises
    ------
    InputError
        For an unknown subject or quantity, no quantity at all, or a true value that cannot be one; for more than four subjects.
    """
    if not isinstance(subject, str):
        return _overlay(overlaid(draws, subject, coordinates, _by_subject(truths), prior), fig)
    found = content(draws, subject, coordinates, _of_one(truths), prior)
    figure = shown.figure_for(found) if fig is None else fig
    axes = _panels(figure, found, quantiles=shown.MARKED, color=POSTERIOR)
    _draw_contours(axes, found, **shown.AREAS)
    _draw_prior(axes, found)
    _draw_truths(axes, found)
    for i, span in enumerate(found.spans):
        _draw_ticks(axes, i, span)
    _lay_out(figure, axes, found.lines)
    return figure


def _overlay(found: Sequence[Content], fig: Figure | None) -> Figure:
    """Several subjects in the same panels: outlines without areas."""
    figure = shown.figure_for(found[0]) if fig is None else fig
    for one, (colour, line) in zip(found, OVERLAID, strict=False):
        axes = _panels(figure, one, color=colour, hist_kwargs={"color": colour, "linestyle": line, "linewidth": 1.4})
        _draw_contours(axes, one, facecolors="none", edgecolors=colour, linestyles=line, linewidths=1.6)
        for ax, median in zip(axes.diagonal(), one.marked[1], strict=True):
            ax.axvline(median, color=colour, lw=1.0, ls=line)
    for i, (ax, span) in enumerate(zip(axes.diagonal(), found[0].spans, strict=True)):
        edges = np.linspace(*span, shown.BINS + 1)
        ax.set_ylim(0.0, 1.1 * float(max(np.histogram(one.samples[:, i], edges)[0].max() for one in found)))  # each call fits its own
    for one, (colour, line) in zip(found, OVERLAID, strict=False):
        if one is found[0] or any(not np.array_equal(mine, first) for mine, first in zip(one.believed, found[0].believed, strict=True)):
            _draw_prior(axes, one, line)
        _draw_overlaid_truths(axes, one, colour)
    for i, span in enumerate(found[0].spans):
        _draw_ticks(axes, i, span)
    _lay_out(figure, axes, found[0].lines)
    return figure


def _draw_overlaid_truths(axes: npt.NDArray[Any], found: Content, colour: str) -> None:
    """Squares where two true values cross, triangles below one: lines would be taken for medians."""
    values, style = [found.known.get(name) for name in found.names], {"color": colour, "mec": "black", "mew": 0.8, "zorder": 5}
    for i, below in enumerate(values):
        for j, across in enumerate(values[: i + 1]):
            if across is not None and j == i:
                axes[i, i].plot(across, 0.0, "^", ms=7, clip_on=False, **style)
            elif across is not None and below is not None:
                axes[i, j].plot(across, below, "s", ms=5, **style)


def _of_one(truths: Values | Mapping[str, Values] | None) -> Values | None:
    """True values of one subject, which are numbers."""
    if truths is None:
        return None
    nested = [name for name, value in truths.items() if isinstance(value, Mapping)]
    if nested:
        raise InputError(
            f"truths: found values by subject ({nested[0]!r}), allowed for one subject: its own, such as truths[{nested[0]!r}]"
        )
    return cast("Values", truths)


def _by_subject(truths: Values | Mapping[str, Values] | None) -> Mapping[str, Values] | None:
    """True values of several subjects, by their names."""
    if truths is None or all(isinstance(value, Mapping) for value in truths.values()):
        return cast("Mapping[str, Values] | None", truths)
    raise InputError("truths: found numbers, allowed for several subjects: a mapping of each one's values by its name")


def _panels(figure: Figure, found: Content, **style: Any) -> npt.NDArray[Any]:
    """Histograms, with panels for contours; returns the Axes, of which those above the diagonal are empty."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # ArviZ, which corner imports, announces itself once a day
        from corner import corner as panels

    panels(
        found.samples,
        fig=figure,
        bins=shown.BINS,
        range=list(found.spans),
        labels=found.labels,
        plot_datapoints=False,
        plot_density=False,
        plot_contours=False,
        label_kwargs={"fontsize": 13},
        **style,
    )
    return np.array(figure.axes).reshape(len(found.names), len(found.names))


def _draw_contours(axes: npt.NDArray[Any], found: Content, **style: Any) -> None:
    """Outlines, or areas, that hold the shares :data:`~bayes_toe.plots.corner_content.LEVELS` of the draws."""
    from matplotlib.collections import PathCollection

    for j, i in combinations(range(len(found.names)), 2):
        (x, y), spans = found.samples[:, [j, i]].T, (found.spans[j], found.spans[i])
        areas = Density.of(x, y, *spans).areas(*spans)
        axes[i, j].add_collection(PathCollection(areas, transform=axes[i, j].transData, **style), autolim=False)


def _draw_prior(axes: npt.NDArray[Any], found: Content, line: str = "solid") -> None:
    for ax, span, counts in zip(axes.diagonal(), found.spans, found.believed, strict=False):
        ax.stairs(counts, np.linspace(*span, shown.BINS + 1), color=shown.PRIOR, lw=1.4, ls=line, label="prior")
        ax.set_ylim(top=max(ax.get_ylim()[1], 1.1 * counts.max()))


def _draw_truths(axes: npt.NDArray[Any], found: Content) -> None:
    values = [found.known.get(name) for name in found.names]
    for i, below in enumerate(values):
        for j, across in enumerate(values[: i + 1]):
            _draw_truth(axes[i, j], across, below if j < i else None)


def _draw_truth(ax: Axes, x: float | None, y: float | None) -> None:
    if x is not None:
        ax.axvline(x, color=TRUTH)
    if y is not None:
        ax.axhline(y, color=TRUTH)
    if x is not None and y is not None:
        ax.plot(x, y, "s", color=TRUTH)


def _draw_ticks(axes: npt.NDArray[Any], i: int, span: tuple[float, float]) -> None:
    """Ticks of one quantity: below its column and left of its row."""
    ticks = shown.ticks(*span)
    for ax in axes[i:, i]:
        ax.set_xticks(ticks, [])
    for ax in axes[i, :i]:
        ax.set_yticks(ticks, [])
    axes[-1, i].set_xticks(ticks, shown.tick_labels(ticks), rotation=45, ha="right", va="top", rotation_mode="anchor")
    if i > 0:
        axes[i, 0].set_yticks(ticks, shown.tick_labels(ticks), rotation=0)


def _lay_out(figure: Figure, axes: npt.NDArray[Any], lines: Sequence[shown.Line]) -> None:
    """Place panels, axis labels and words; all measures in inches."""
    count = len(axes)
    wide, high = (float(side) / figure.dpi for side in (figure.bbox.width, figure.bbox.height))
    across = (wide - LEFT - RIGHT - (count - 1) * GAP) / count
    header = shown.header(count, across, lines)
    down = (high - BOTTOM - TOP - header - (count - 1) * GAP) / count
    figure.subplots_adjust(
        left=LEFT / wide,
        right=1.0 - RIGHT / wide,
        bottom=BOTTOM / high,
        top=1.0 - (TOP + header) / high,
        wspace=GAP / across,
        hspace=GAP / down,
    )
    for i in range(count):
        axes[-1, i].xaxis.set_label_coords(0.5, -shown.LABEL_BELOW / down)
        axes[i, 0].yaxis.set_label_coords(-shown.LABEL_LEFT / across, 0.5)
    shown.write(figure, lines, count, across)
