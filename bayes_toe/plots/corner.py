"""Corner plots of one subject's draws; the only module that imports corner.

The panels are laid out in inches, so that key and tick labels stay clear of them and of each other whatever their number. Few
panels leave no room beside them: the key then stands above. :mod:`bayes_toe.plots.corner_sheet` draws the same without Axes.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bayes_toe.inference.draws import Draws
from bayes_toe.model.prior import Prior
from bayes_toe.plots import corner_content as shown
from bayes_toe.plots.corner_content import BOTTOM, GAP, LEFT, RIGHT, TOP, TRUTH, Content, Values, content
from bayes_toe.plots.style import POSTERIOR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def corner(
    draws: Draws,
    subject: str,
    *,
    coordinates: str | Sequence[str] = "natural",
    truths: Values | None = None,
    prior: Prior | None = None,
    fig: Figure | None = None,
) -> Figure:
    """Corner plot of one subject: contours hold 50 % and 90 % of the posterior, dashed lines mark 5, 50 and 95 %.

    Parameters
    ----------
    draws : Draws
    subject : str
    coordinates : {"natural", "identified"} or sequence of str
        Which quantities; a sequence names quantities of the model, such as `gain`, `offset` or `pull`.
    truths : mapping of str to float, optional
        Known values of a synthetic subject. What follows from them is drawn too: natural parameters are enough for any quantity.
    prior : Prior, optional
        Its marginals are drawn in grey on the diagonal, on the scale of the posterior's histograms; `draws.prior` is the one
        that the draws were made under.
    fig : matplotlib Figure or SubFigure, optional
        Drawn into, where given.

    Raises
    ------
    InputError
        For an unknown subject or quantity, no quantity at all, or a true value that cannot be one.
    """
    found = content(draws, subject, coordinates, truths, prior)
    figure = shown.figure_for(found) if fig is None else fig
    axes = _panels(figure, found)
    _draw_prior(axes, found)
    _draw_truths(axes, found)
    for i, span in enumerate(found.spans):
        _draw_ticks(axes, i, span)
    _lay_out(figure, axes, found.lines)
    return figure


def _panels(figure: Figure, found: Content) -> npt.NDArray[Any]:
    """Histograms and contours; returns the Axes, of which those above the diagonal are empty."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # corner imports ArviZ, which announces its refactoring
        import corner as corner_package

    corner_package.corner(
        found.samples,
        fig=figure,
        bins=shown.BINS,
        range=list(found.spans),
        labels=found.labels,
        quantiles=shown.MARKED,
        levels=shown.LEVELS,
        color=POSTERIOR,
        smooth=1.0,
        plot_datapoints=False,
        fill_contours=True,
        label_kwargs={"fontsize": 13},
    )
    return np.array(figure.axes).reshape(len(found.names), len(found.names))


def _draw_prior(axes: npt.NDArray[Any], found: Content) -> None:
    for ax, span, counts in zip(axes.diagonal(), found.spans, found.believed, strict=False):
        ax.stairs(counts, np.linspace(*span, shown.BINS + 1), color=shown.PRIOR, lw=1.4, label="prior")
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
