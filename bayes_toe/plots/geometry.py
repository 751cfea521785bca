"""Figure of the plane of stimulus pairs: q with its symmetry axis and the pairs presented (Fig. 5)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from bayes_toe.classical.frequencies import presentation_order
from bayes_toe.data.study import refuse_intervals
from bayes_toe.inference.draws import Draws
from bayes_toe.model.paper_equations import evolved_mean
from bayes_toe.plots.curves import fitted_curve, over_panel
from bayes_toe.plots.style import (
    LETTERS,
    ORDERS,
    PAGE,
    SMALL,
    chance,
    dress,
    dress_bar,
    even_columns,
    first_panels,
    legend_below,
    new_figure,
)

_CELLS = 120
_ACROSS = 3
# Inches of figures and rows with so many columns.
_WIDTHS = {1: 3.6, 2: 5.6, 3: PAGE}
_HEIGHTS = {1: 3.2, 2: 2.5, 3: 2.15}
_CROWDED = 60  # pairs, beyond which marks are small
AXIS = "#111111"
#: Greys without the darkest, on which a black axis would be lost.
GREYS = ListedColormap(colormaps["Greys"](np.linspace(0.0, 0.62, 256)))


def plane_axes(draws: Draws, subject: str, ax: Axes) -> Axes:
    """P('equal'), or P('second'), of any pair in grey, with the symmetry axis and the pairs.

    Source: Fig. 5. Grey is the posterior mean on a scale from 0 (white) to 1, thin lines are its
    levels 0.25, 0.5 and 0.75. The axis has its central 60 %. Dashed: the diagonal, which would be
    the axis without an order effect. Open marks: pairs presented, in the colour of their order.
    """
    counts, fitted = draws.subject(subject), fitted_curve(draws, subject)
    refuse_intervals([counts], "plane of pairs")
    both = np.concatenate([counts.s1, counts.s2])
    pad = max(0.18 * float(np.ptp(both)), 0.1)
    low, high = float(both.min()) - pad, float(both.max()) + pad
    side = np.linspace(low, high, _CELLS)
    mean = np.stack([fitted(np.full(_CELLS, s1), side).mean(axis=0) for s1 in side], axis=1)
    ax.pcolormesh(side, side, mean, cmap=GREYS, vmin=0.0, vmax=1.0, rasterized=True, zorder=0)
    levels: dict[str, Any] = {"colors": "#FFFFFF", "linewidths": 0.5, "zorder": 1}
    ax.contour(side, side, mean, levels=[0.25, 0.5, 0.75], **levels)
    ax.plot([low, high], [low, high], "--", color="#444444", lw=0.8, label="diagonal")
    mu1, gamma = (draws.values(subject, name).ravel() for name in ("mu1", "gamma"))
    axis = np.quantile(evolved_mean(side[:, None], mu1, gamma), [0.2, 0.5, 0.8], axis=1)
    ax.plot(side, axis[1], color=AXIS, lw=1.5, label="symmetry axis")
    ax.plot(side, axis[[0, 2]].T, ":", color=AXIS, lw=0.9)
    order = presentation_order(counts)
    style: dict[str, Any] = {"ms": 4.6, "mew": 1.2, "mfc": "white", "zorder": 4, "ls": ""}
    if counts.n_pairs > _CROWDED:
        style |= {"ms": 2.0, "mew": 0.6}
    for kind, mark in ORDERS.items():
        at = order == kind
        if at.any():
            s1, s2 = counts.s1[at], counts.s2[at]
            ax.plot(s1, s2, marker=mark.marker, mec=mark.colour, label=mark.label, **style)
    ax.set(xlabel="first stimulus $s_1$ (ln intensity)")
    ax.set(ylabel="second stimulus $s_2$ (ln intensity)")
    ax.set(xlim=(low, high), ylim=(low, high), aspect="equal")
    ticks = [tick for tick in ax.get_xticks() if low <= tick <= high]  # the same to both sides
    ax.set(xticks=ticks, yticks=ticks)
    return dress(ax)


def plane_figure(draws: Draws, subjects: Sequence[str]) -> Figure:
    """One :func:`plane_axes` a subject, at most three in a row, with the scale of grey."""
    across = even_columns(len(subjects), _ACROSS)
    down = -(-len(subjects) // across)
    figure = new_figure(_WIDTHS[across], _HEIGHTS[across] * down + 0.6)
    panels = first_panels(figure.add_gridspec(down, across), len(subjects))
    for i, (ax, subject) in enumerate(zip(panels, subjects, strict=True)):
        plane_axes(draws, subject, ax)
        ax.set_title(over_panel(draws, subject), fontsize=LETTERS)
        if i % across:
            ax.set_ylabel("")
    scale = ScalarMappable(cmap=GREYS)
    bar = figure.colorbar(scale, ax=panels, fraction=0.02, pad=0.01, aspect=30, shrink=0.85)
    dress_bar(bar, chance(draws.task))
    legend_below(figure, size=SMALL, columns=5 if across > 2 else 3)
    return figure
