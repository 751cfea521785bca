"""What a design will tell, by trials: how often the order effect of assumed observers is named, and how narrow intervals get."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bayes_toe.planning.power_table import NAMED, WIDTHS, WRONG, Counted, PowerTable
from bayes_toe.plots.style import EQUAL, LETTERS, PAGE, STRONGER_FIRST, WEAKER_FIRST, dress, legend_below, new_figure, panel, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TITLES = {"none": "observers without order effect", "constant error": "with a constant error", "update": "who update"}
_COLOURS = (STRONGER_FIRST, WEAKER_FIRST, "#009E73", "#CC79A7", EQUAL)
_MARKERS = "osD^v"


def power_figure(table: PowerTable) -> Figure:
    """How often each kind of observers is named, and the expected 90 % intervals of the update's quantities."""
    kinds = table.kinds
    told = "update" in kinds and any(name.startswith("90 % width") for name in table.quantities)
    figure = new_figure(PAGE, (4.5 if told else 2.5) + 0.17 * len(table.designs))  # a line of the legend each
    above, *below = figure.subfigures(2 if told else 1, 1, squeeze=False).ravel()
    for column, (ax, kind) in enumerate(zip(above.subplots(1, len(kinds), sharey=True, squeeze=False).ravel(), kinds, strict=True)):
        power_axes(table, kind, ax=ax)
        ax.set_ylabel("share of observers" if column == 0 else "")
        ax.label_outer()
    for rest in below:
        for ax, quantity in zip(rest.subplots(1, len(WIDTHS)), WIDTHS, strict=True):
            interval_width_axes(table, quantity, ax=ax)
    legend_below(figure, size=LETTERS, columns=2)
    return figure


def power_axes(table: PowerTable, kind: str = "update", *, ax: Axes | None = None) -> Axes:
    """Share of one kind of observers whose order effect is named (P > 0.95), and for whom another is, with 95 % Monte Carlo intervals."""
    ax = panel(ax)
    for index, design in enumerate(table.designs):
        label = plain(design)
        _line(ax, 2 * index, [table[design, trials, kind, NAMED] for trials in table.trials], f"named, {label}")
        _line(ax, 2 * index + 1, [table[design, trials, kind, WRONG] for trials in table.trials], f"another named, {label}", ":")
    ax.set(ylim=(-0.04, 1.04), title=_TITLES[kind], ylabel="share of observers")
    return _by_trials(ax, table)


def interval_width_axes(table: PowerTable, quantity: str, *, ax: Axes | None = None) -> Axes:
    """Expected width of the 90 % interval of gain, mu1 or width of observers who update."""
    ax = panel(ax)
    for index, design in enumerate(table.designs):
        found = [table[design, trials, "update", f"90 % width of {quantity}"] for trials in table.trials]
        _line(ax, 2 * index, found, "")
    ax.set_yscale("log")
    ax.set_ylabel(f"90 % interval of {quantity}")
    return _by_trials(ax, table)


def _line(ax: Axes, place: int, found: list[Counted], label: str, style: str = "-") -> None:
    """A line with error bars, next to those of other places."""
    x, y = [one.trials * (1.0 + 0.025 * place) for one in found], [one.value for one in found]
    errors = [[one.value - one.low for one in found], [one.high - one.value for one in found]]
    colour, marker = _COLOURS[place // 2 % len(_COLOURS)], _MARKERS[place // 2 % len(_MARKERS)]
    filled = colour if style == "-" else "white"
    ax.errorbar(
        x, y, errors, fmt=marker, linestyle=style, color=colour, markerfacecolor=filled, markersize=4.0, linewidth=1.1, elinewidth=0.8,
        label=label,
    )  # fmt: skip


def _by_trials(ax: Axes, table: PowerTable) -> Axes:
    from matplotlib.ticker import FixedLocator, FormatStrFormatter, LogLocator, NullLocator

    ax.set_xscale("log")
    ax.set_xlim(min(table.trials) / 1.25, max(table.trials) * 1.25)
    ax.xaxis.set_major_locator(FixedLocator(list(table.trials)))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.set_xticklabels([f"{number:,}" for number in table.trials])
    if ax.get_yscale() == "log":
        ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0)))
        ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
        ax.yaxis.set_minor_locator(NullLocator())
    ax.set_xlabel("trials of a subject")
    return dress(ax)
