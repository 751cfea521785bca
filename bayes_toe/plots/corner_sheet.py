"""The corner plot of the natural parameters as a results folder has it: the panels of :func:`bayes_toe.plots.corner.corner`, cheaply.

Most of what that one costs are its sixteen Axes. Here all panels are lines, areas and words in inches on the figure itself, which is enough
for a picture that nobody draws into. Ranges, bins, contours and quantiles are the same, all of them from all draws.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray
from bayes_toe.inference.draws import Draws
from bayes_toe.model.prior import Prior
from bayes_toe.plots import corner_content as shown
from bayes_toe.plots.corner_content import BINS, BOTTOM, GAP, LEFT, TRUTH, Content, Values, content
from bayes_toe.plots.density import Density
from bayes_toe.plots.style import POSTERIOR

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TICK, _TICK_LABEL = 3.5 / 72.0, 7.0 / 72.0  # inches from a panel to the end of a tick, and to its label


class Panel(NamedTuple):
    """A square on the sheet, in inches from the lower left corner, and from where to where its axes go."""

    left: float
    bottom: float
    side: float
    x: tuple[float, float]
    y: tuple[float, float]

    def place(self, x: npt.ArrayLike, y: npt.ArrayLike) -> FloatArray:
        """Points of the plot on the sheet, shape (points, 2)."""
        shares = [(np.asarray(values) - low) / (high - low) for values, (low, high) in ((x, self.x), (y, self.y))]
        return self.side * np.column_stack(np.broadcast_arrays(*shares)) + (self.left, self.bottom)


def corner_sheet(draws: Draws, subject: str, *, truths: Values | None = None, prior: Prior | None = None) -> Figure:
    """Corner plot of the natural parameters of one subject, without Axes.

    Arguments, errors and what is shown are those of :func:`bayes_toe.plots.corner.corner`.
    """
    found = content(draws, subject, "natural", truths, prior)
    count = len(found.names)
    side = shown.panel_side(count)
    figure = shown.figure_for(found)
    counts = [np.histogram(values, _edges(span))[0] for values, span in zip(found.samples.T, found.spans, strict=True)]
    panels = _panels(found, counts, side)
    for i, row in enumerate(panels):
        for j, panel in enumerate(row[:-1]):
            _draw_contours(figure, panel, found.samples[:, j], found.samples[:, i])
    _draw_histograms(figure, [row[-1] for row in panels], counts, found)
    _draw_truths(figure, panels, [found.known.get(name, np.nan) for name in found.names])
    ticks = [shown.ticks(*span) for span in found.spans]
    _draw_frames(figure, panels, ticks)
    _write_labels(figure, panels, ticks, found.labels)
    shown.write(figure, found.lines, count, side)
    return figure


def _edges(span: tuple[float, float]) -> FloatArray:
    return np.linspace(*span, BINS + 1)


def _panels(found: Content, counts: Sequence[FloatArray], side: float) -> list[list[Panel]]:
    """Row by row; the last one of a row is on the diagonal, where counts of draws go upward."""
    count = len(counts)
    bars = [counts, found.believed] if found.believed else [counts]
    tops = 1.1 * np.max(bars, axis=(0, 2))
    lefts = [LEFT + i * (side + GAP) for i in range(count)]
    bottoms = [BOTTOM + i * (side + GAP) for i in reversed(range(count))]
    return [
        [Panel(lefts[j], bottoms[i], side, found.spans[j], found.spans[i] if j < i else (0.0, tops[i])) for j in range(i + 1)]
        for i in range(count)
    ]


# --- draws --------------------------------------------------------------------------------------------------------------------------


def _draw_histograms(figure: Figure, panels: Sequence[Panel], counts: Sequence[FloatArray], found: Content) -> None:
    for bars, colour, width in ((counts, POSTERIOR, 1.0), (found.believed, shown.PRIOR, 1.4)):
        steps = [panel.place(_edges(panel.x).repeat(2)[1:-1], heights.repeat(2)) for panel, heights in zip(panels, bars, strict=False)]
        _draw_lines(figure, steps, colour, width)
    marked = [panel.place(value, panel.y) for panel, values in zip(panels, found.marked.T, strict=True) for value in values]
    _draw_lines(figure, marked, POSTERIOR, 1.5, linestyles="dashed")


def _draw_contours(figure: Figure, panel: Panel, x: FloatArray, y: FloatArray) -> None:
    """Areas that hold the shares :data:`~bayes_toe.plots.corner_content.LEVELS` of the draws, the larger one lighter."""
    from matplotlib.collections import PathCollection
    from matplotlib.transforms import Bbox, TransformedBbox

    ends = [(start, start + panel.side) for start in (panel.left, panel.bottom)]
    inside = Bbox.from_bounds(panel.left, panel.bottom, panel.side, panel.side)
    areas = PathCollection(Density.of(x, y, panel.x, panel.y).areas(*ends), **shown.AREAS, transform=figure.dpi_scale_trans)
    figure.add_artist(areas)
    areas.set_clip_box(TransformedBbox(inside, figure.dpi_scale_trans))  # the figure has set its own


def _draw_lines(figure: Figure, lines: Sequence[FloatArray], colour: str, width: float, **style: Any) -> None:
    from matplotlib.collections import LineCollection

    figure.add_artist(LineCollection(lines, colors=colour, linewidths=width, transform=figure.dpi_scale_trans, **style))


def _draw_truths(figure: Figure, panels: Sequence[Sequence[Panel]], known: Sequence[float]) -> None:
    """Red lines at true values that lie within the panels, and squares where two of them cross; NaN is not known."""
    from matplotlib.lines import Line2D

    inside = [row[-1].x[0] <= value <= row[-1].x[1] for value, row in zip(known, panels, strict=True)]
    upright = [panel.place(known[j], panel.y) for row in panels for j, panel in enumerate(row) if inside[j]]
    level = [panel.place(panel.x, known[i]) for i, row in enumerate(panels) for panel in row[:-1] if inside[i]]
    crossed = [row[j].place(known[j], known[i]) for i, row in enumerate(panels) for j in range(i) if inside[i] and inside[j]]
    _draw_lines(figure, upright + level, TRUTH, 1.5)
    for point in crossed:
        figure.add_artist(Line2D(*point.T, marker="s", color=TRUTH, transform=figure.dpi_scale_trans))


# --- frames and words ---------------------------------------------------------------------------------------------------------------


def _draw_frames(figure: Figure, panels: Sequence[Sequence[Panel]], ticks: Sequence[FloatArray]) -> None:
    """Outlines of the panels; ticks below and, besides on the diagonal, left of each."""
    lines: list[FloatArray] = []
    for i, row in enumerate(panels):
        for j, panel in enumerate(row):
            (left, right), (bottom, top) = panel.x, panel.y
            lines.append(panel.place([left, right, right, left, left], [bottom, bottom, top, top, bottom]))
            lines += _marks(panel.place(ticks[j], bottom), (0.0, -_TICK))
            lines += _marks(panel.place(left, ticks[i]), (-_TICK, 0.0)) if j < i else []
    _draw_lines(figure, lines, "black", 0.8, zorder=2.5)


def _marks(points: FloatArray, way: tuple[float, float]) -> list[FloatArray]:
    return [np.array([point, point + way]) for point in points]


def _write_labels(figure: Figure, panels: Sequence[Sequence[Panel]], ticks: Sequence[FloatArray], labels: Sequence[str]) -> None:
    """Of ticks and quantities, below the lowest and left of the first panels."""
    for panel, at, name in zip(panels[-1], ticks, labels, strict=True):
        for (x, y), text in zip(panel.place(at, panel.y[0]), shown.tick_labels(at), strict=True):
            _write(figure, x, y - _TICK_LABEL, text, ha="right", va="top", rotation=45, rotation_mode="anchor")
        _write(figure, panel.left + panel.side / 2.0, panel.bottom - shown.LABEL_BELOW, name, fontsize=13, ha="center", va="top")
    for (panel, *_), at, name in zip(panels[1:], ticks[1:], labels[1:], strict=True):
        for (x, y), text in zip(panel.place(panel.x[0], at), shown.tick_labels(at), strict=True):
            _write(figure, x - _TICK_LABEL, y, text, ha="right", va="center_baseline")
        style = {"rotation": 90, "rotation_mode": "anchor"}
        _write(figure, panel.left - shown.LABEL_LEFT, panel.bottom + panel.side / 2.0, name, fontsize=13, ha="center", va="bottom", **style)


def _write(figure: Figure, x: float, y: float, text: str, **style: Any) -> None:
    figure.text(x, y, text, transform=figure.dpi_scale_trans, **style)
