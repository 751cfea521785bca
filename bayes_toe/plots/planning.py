"""What a design will tell: how often order effects of assumed observers are named, how narrow intervals get, and the optimised design."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

from bayes_toe.planning.optimal import MOVED, OPTIMISED, PAPER, OptimalDesign, paper_amid
from bayes_toe.planning.power import FOUND, NAMED, WIDTHS, WRONG, Counted, PowerTable
from bayes_toe.plots.style import (
    EQUAL,
    LETTERS,
    PAGE,
    SMALL,
    STRONGER_FIRST,
    WEAKER_FIRST,
    dress,
    dress_bar,
    legend_below,
    new_figure,
    plain,
)

_KINDS = {
    "none": ("no order effect", EQUAL, "D"),
    "constant error": ("constant error", WEAKER_FIRST, "s"),
    "update": ("pull", STRONGER_FIRST, "o"),
}
_LARGEST = 160.0  # area of the most frequent pair, square points
_TITLES = {
    "none": "observers without order effect",
    "constant error": "with a constant error",
    "update": "with a pull",
    "mixed": "of a mixed population",
}
_COLOURS = (STRONGER_FIRST, WEAKER_FIRST, "#009E73", "#CC79A7", EQUAL)
_MARKERS = "osD^v"
#: Between lines next to each other, in natural logs; of the distance to the next number, how much all of them may take.
_APART, _MOST = 0.025, 0.6
#: Of one design: label, style, and what was counted by number.
_Line = tuple[str, str, Sequence[Counted]]
_MARGIN = 1.25  # factor from the outermost numbers to the ends of a panel


def power_figure(table: PowerTable) -> Figure:
    """How often each kind of observers is named, the expected 90 % intervals of the update's quantities, and what whole studies find.

    Above: share of one kind of observers of whom the verdict says an order effect, and whose kind it names (of those without: none). In
    the middle: expected width of the 90 % interval of gain, mu1 and width of observers who update. Below: share of simulated studies of
    one kind of subjects of which population finds an order effect on average, and names a pull, by their number. Bars: 95 % of Monte Carlo
    error.
    """
    named = {FOUND: "effect found", NAMED: "kind named"}
    rows = [
        partial(_draw_shares, table, "trials", named, ("share of observers", "trials of a subject"))
    ]
    if "update" in table.different("observers") and any(
        name.startswith("90 % width") for name in table.different("quantity")
    ):
        rows.append(partial(_draw_widths, table))
    figure = new_figure(
        PAGE,
        2.25 * len(rows) + 0.17 * len(table.different("design")),
    )  # of the legend
    for part, draw in zip(
        figure.subfigures(len(rows), 1, squeeze=False).ravel(), rows, strict=True
    ):
        draw(part)
    legend_below(figure, size=LETTERS, columns=2)
    return figure


def _draw_shares(
    table: PowerTable,
    by: str,
    what: Mapping[str, str],
    words: tuple[str, str],
    part: SubFigure,
) -> None:
    """One panel a kind of observers with the shares of two quantities, solid and dotted, by the number of trials or of subjects."""
    found = {
        (one.design, one.observers, getattr(one, by), one.quantity): one
        for one in table.counted.values()
    }
    numbers, kinds = table.different(by), table.different("observers")
    for ax, kind in zip(
        part.subplots(1, len(kinds), sharey=True, squeeze=False)[0], kinds, strict=True
    ):
        lines = [
            [
                (
                    f"{label}, {plain(design)}",
                    style,
                    [found[design, kind, number, quantity] for number in numbers],
                )
                for (quantity, label), style in zip(what.items(), "-:", strict=True)
            ]
            for design in table.different("design")
        ]
        _draw_lines(ax, numbers, lines)
        ax.set(ylim=(-0.04, 1.04), ylabel=words[0], xlabel=words[1])
        ax.set_title(_TITLES[kind], fontsize=LETTERS)
        ax.label_outer()


def _draw_widths(table: PowerTable, part: SubFigure) -> None:
    trials, designs = table.different("trials"), table.different("design")
    for ax, quantity in zip(part.subplots(1, len(WIDTHS)), WIDTHS, strict=True):
        found = [
            [table[design, n, "update", f"90 % width of {quantity}"] for n in trials]
            for design in designs
        ]
        _draw_lines(ax, trials, [[("", "-", rows)] for rows in found])
        ax.set(ylabel=f"90 % interval of {quantity}", xlabel="trials of a subject", yscale="log")
        ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0)))
        ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
        ax.yaxis.set_minor_locator(NullLocator())


def _draw_lines(ax: Axes, numbers: Sequence[int], designs: Sequence[Sequence[_Line]]) -> None:
    """The lines of each design, beside each other about their numbers: within the panel and clear of the next number.

    Beyond five designs colours come again, with other markers.
    """
    count, at = sum(map(len, designs)), np.array(numbers, np.float64)
    nearest = float(np.diff(np.log(np.sort(at))).min(initial=2.0 * np.log(_MARGIN)))
    places = iter(min(_APART, _MOST * nearest / count) * (np.arange(count) - 0.5 * (count - 1)))
    for index, lines in enumerate(designs):
        colour, marker = (
            _COLOURS[index % len(_COLOURS)],
            _MARKERS[(index + index // len(_COLOURS)) % len(_MARKERS)],
        )
        for label, style, rows in lines:
            y, errors = (
                [one.value for one in rows],
                np.array([(one.value - one.low, one.high - one.value) for one in rows]).T,
            )
            look: dict[str, Any] = {
                "fmt": marker,
                "ls": style,
                "color": colour,
                "mfc": colour if style == "-" else "white",
                "ms": 4.0,
            }
            ax.errorbar(
                at * np.exp(next(places)), y, errors, lw=1.1, elinewidth=0.8, label=label, **look
            )
    ax.set(xscale="log", xlim=(min(numbers) / _MARGIN, max(numbers) * _MARGIN))
    ax.set_xticks(list(numbers), [f"{number:,}" for number in numbers])
    ax.xaxis.set_minor_locator(NullLocator())
    dress(ax)


# --- an optimised design ------------------------------------------------------------------------------------------------------------


def design_figure(found: OptimalDesign) -> Figure:
    """The design on the stimulus plane, and beside it how often it and others name each kind of observers.

    Left: its pairs, as large as they are frequent, over what one more trial of every pair would tell; the paper's as crosses. Right: share
    of each kind of observers whom a design names, and misnames, with 95 % intervals of Monte Carlo error.
    """
    figure = new_figure(PAGE, 3.5)
    left, right = figure.subplots(1, 2, width_ratios=(1.15, 1.0))
    _draw_pairs(left, found)
    _draw_compared(right, found)
    return figure


def _draw_pairs(ax: Axes, found: OptimalDesign) -> None:
    design, plane = found.design, found.plane
    first, second = np.unique(plane.s1), np.unique(plane.s2)
    values = np.full((len(second), len(first)), np.nan)
    at = np.searchsorted(second, plane.s2), np.searchsorted(first, plane.s1)
    np.fmax.at(values, at, 1000.0 * found.worth)  # of several intervals the best
    mesh = ax.pcolormesh(
        first, second, values, cmap="Greys", shading="nearest", vmin=0.0, rasterized=True
    )
    bar = ax.figure.colorbar(mesh, ax=ax, shrink=0.9, pad=0.02)
    dress_bar(bar, "what one more trial adds, thousandths of a nat")
    ax.axline(
        (float(first[0]), float(first[0])), slope=1.0, color=EQUAL, linewidth=0.6, linestyle=":"
    )
    paper = paper_amid(plane)
    name = MOVED if MOVED in found.candidates else PAPER
    ax.plot(
        paper.s1, paper.s2, "x", color=WEAKER_FIRST, markersize=4.0, markeredgewidth=1.0, label=name
    )
    area = _LARGEST * design.n_trials / design.n_trials.max()
    ax.scatter(
        design.s1,
        design.s2,
        area,
        facecolor=STRONGER_FIRST,
        edgecolor="white",
        linewidth=0.7,
        alpha=0.85,
        zorder=3,
        clip_on=False,
    )
    ax.scatter(
        [],
        [],
        _LARGEST / 3,
        facecolor=STRONGER_FIRST,
        label=f"this design (largest: {design.n_trials.max()} trials)",
    )
    ax.set(
        xlabel="first stimulus (natural log)",
        ylabel="second stimulus (natural log)",
        aspect="equal",
    )
    ax.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        frameon=False,
        fontsize=SMALL,
        handletextpad=0.3,
        borderaxespad=0.1,
    )
    dress(ax)


def _draw_compared(ax: Axes, found: OptimalDesign) -> None:
    names = list(found.candidates)
    table, trials = found.power, found.design.total
    kinds = table.different("observers")
    for index, kind in enumerate(kinds):
        label, colour, marker = _KINDS[kind]
        for quantity, filled in ((NAMED, True), (WRONG, False)):
            rows = [table[name, trials, kind, quantity] for name in names]
            y = (
                np.arange(len(names))
                + 0.24 * (index - 0.5 * (len(kinds) - 1))
                + (0.0 if filled else 0.09)
            )
            x = np.array([row.value for row in rows])
            errors = (
                np.array([[row.value - row.low, row.high - row.value] for row in rows]).T
                if filled
                else None
            )
            look: dict[str, Any] = (
                {"mfc": colour, "ms": 4.5, "label": label}
                if filled
                else {"mfc": "white", "ms": 3.0}
            )
            ax.errorbar(x, y, xerr=errors, fmt=marker, color=colour, elinewidth=0.8, **look)
    ax.set_yticks(
        np.arange(len(names)),
        [plain("this design" if name == OPTIMISED else name) for name in names],
    )
    ax.set(
        xlim=(-0.03, 1.03),
        ylim=(len(names) - 0.5, -0.5),
        xlabel="share whose kind is named (hollow: another)",
    )
    ax.set_title(f"{trials:,} trials, observers with", fontsize=LETTERS)
    ax.legend(
        loc="lower center",
        bbox_to_anchor=(0.5, 1.08),
        ncols=3,
        frameon=False,
        fontsize=SMALL,
        handletextpad=0.2,
        columnspacing=1.0,
    )
    dress(ax)
