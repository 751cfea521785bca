"""An optimised design on the stimulus plane, with what each pair that could be shown tells, and beside it what other designs would name."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.planning.optimal import MOVED, OPTIMISED, PAPER, SECOND, OptimalDesign, paper_amid
from bayes_toe.planning.power import NAMED, WRONG
from bayes_toe.plots.style import EQUAL, LETTERS, PAGE, SMALL, STRONGER_FIRST, WEAKER_FIRST, dress, dress_bar, new_figure, panel, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_KINDS = {
    "none": ("no order effect", EQUAL, "D"),
    "constant error": ("constant error", WEAKER_FIRST, "s"),
    "update": ("update", STRONGER_FIRST, "o"),
}
_LARGEST = 160.0  # area of the most frequent pair, square points


def design_figure(found: OptimalDesign) -> Figure:
    """The design on the stimulus plane, and beside it how often it and others name each kind of observers."""
    figure = new_figure(PAGE, 3.5)
    left, right = figure.subplots(1, 2, width_ratios=(1.15, 1.0))
    design_axes(found, ax=left)
    compared_axes(found, ax=right)
    return figure


def design_axes(found: OptimalDesign, *, ax: Axes | None = None) -> Axes:
    """Pairs of the design, as large as they are frequent, over what one more trial of every pair would tell; the paper's as crosses."""
    ax = panel(ax, wide=4.0, high=3.4)
    design, plane = found.design, found.plane
    first, second = np.unique(plane.s1), np.unique(plane.s2)
    values = np.full((len(second), len(first)), np.nan)
    at = np.searchsorted(second, plane.s2), np.searchsorted(first, plane.s1)
    np.fmax.at(values, at, 1000.0 * found.worth)  # of several intervals the best
    mesh = ax.pcolormesh(first, second, values, cmap="Greys", shading="nearest", vmin=0.0, rasterized=True)
    bar = ax.figure.colorbar(mesh, ax=ax, shrink=0.9, pad=0.02)
    dress_bar(bar, "what one more trial adds, thousandths of a nat")
    ax.axline((float(first[0]), float(first[0])), slope=1.0, color=EQUAL, linewidth=0.6, linestyle=":")
    paper = paper_amid(plane)
    name = MOVED if MOVED in found.candidates else PAPER
    ax.plot(paper.s1, paper.s2, "x", color=WEAKER_FIRST, markersize=4.0, markeredgewidth=1.0, label=name)
    area = _LARGEST * design.n_trials / design.n_trials.max()
    ax.scatter(design.s1, design.s2, area, facecolor=STRONGER_FIRST, edgecolor="white", linewidth=0.7, alpha=0.85, zorder=3, clip_on=False)
    ax.scatter([], [], _LARGEST / 3, facecolor=STRONGER_FIRST, label=f"this design (largest: {design.n_trials.max()} trials)")
    ax.set(xlabel="first stimulus (natural log)", ylabel="second stimulus (natural log)", aspect="equal")
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False, fontsize=SMALL, handletextpad=0.3, borderaxespad=0.1)
    return dress(ax)


def compared_axes(found: OptimalDesign, *, ax: Axes | None = None) -> Axes:
    """Share of each kind of observers whom a design names, and misnames, with 95 % intervals of Monte Carlo error."""
    ax = panel(ax, high=3.0)
    names = [name for name in found.candidates if name != SECOND]
    table, trials = found.power, found.design.total
    for index, kind in enumerate(table.kinds):
        label, colour, marker = _KINDS[kind]
        for quantity, filled in ((NAMED, True), (WRONG, False)):
            rows = [table[name, trials, kind, quantity] for name in names]
            y = np.arange(len(names)) + 0.24 * (index - 0.5 * (len(table.kinds) - 1)) + (0.0 if filled else 0.09)
            x = np.array([row.value for row in rows])
            errors = np.array([[row.value - row.low, row.high - row.value] for row in rows]).T
            ax.errorbar(
                x, y, xerr=errors if filled else None, fmt=marker, color=colour, markerfacecolor=colour if filled else "white",
                markersize=4.5 if filled else 3.0, elinewidth=0.8, label=label if filled else None,
            )  # fmt: skip
    ax.set_yticks(np.arange(len(names)), [plain("this design" if name == OPTIMISED else name) for name in names])
    ax.set(xlim=(-0.03, 1.03), ylim=(len(names) - 0.5, -0.5), xlabel="share named, P > 0.95 (hollow: misnamed)")
    ax.set_title(f"{trials:,} trials, observers with", fontsize=LETTERS)
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.08), ncols=3, frameon=False, fontsize=SMALL, handletextpad=0.2, columnspacing=1.0)
    return dress(ax)
