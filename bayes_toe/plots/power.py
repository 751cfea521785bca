"""What a design will tell, by trials: how often the order effect of assumed observers is named, and how narrow intervals get."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.planning.power import NAMED, WIDTHS, WRONG, Counted, PowerTable
from bayes_toe.planning.power_of_studies import ON_AVERAGE, SOMEWHERE
from bayes_toe.plots.style import EQUAL, LETTERS, PAGE, STRONGER_FIRST, WEAKER_FIRST, dress, legend_below, new_figure, panel, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from bayes_toe.planning.power_of_studies import CountedStudies, PopulationPower

_TITLES = {
    "none": "observers without order effect",
    "constant error": "with a constant error",
    "update": "who update",
    "mixed": "of a mixed population",
}
_COLOURS = (STRONGER_FIRST, WEAKER_FIRST, "#009E73", "#CC79A7", EQUAL)
_MARKERS = "osD^v"
#: Between lines next to each other, in natural logs; of the distance to the next number, how much all of them may take.
_APART, _MOST = 0.025, 0.6
_MARGIN = 1.25  # factor from the outermost numbers to the ends of a panel


def power_figure(table: PowerTable, populations: PopulationPower | None = None) -> Figure:
    """How often each kind of observers is named, the expected 90 % intervals of the update's quantities, and what whole studies find."""
    told = "update" in table.kinds and any(name.startswith("90 % width") for name in table.quantities)
    rows = [
        _row(table.kinds, partial(power_axes, table), "share of observers"),
        *([_row(WIDTHS, partial(interval_width_axes, table))] if told else []),
        *([] if populations is None else [_row(populations.kinds, partial(population_power_axes, populations), "share of studies")]),
    ]
    figure = new_figure(PAGE, 2.25 * len(rows) + 0.17 * len(table.designs) * (1 if populations is None else 2))  # of the legend
    for part, draw in zip(figure.subfigures(len(rows), 1, squeeze=False).ravel(), rows, strict=True):
        draw(part)
    legend_below(figure, size=LETTERS, columns=2)
    return figure


def _row(keys: Sequence[str], draw: Callable[..., Axes], shared: str = "") -> Callable[[SubFigure], None]:
    """Panels beside each other; with a word for it they share the axis upward."""

    def made(part: SubFigure) -> None:
        for column, (ax, key) in enumerate(zip(part.subplots(1, len(keys), sharey=bool(shared), squeeze=False).ravel(), keys, strict=True)):
            draw(key, ax=ax)
            if shared:
                ax.set_ylabel(shared if column == 0 else "")
                ax.label_outer()

    return made


def power_axes(table: PowerTable, kind: str = "update", *, ax: Axes | None = None) -> Axes:
    """Share of one kind of observers whose order effect is named (P > 0.95), and for whom another is, with 95 % Monte Carlo intervals."""
    ax = panel(ax)
    beside = _beside(table.trials, table.designs)
    for index, design in enumerate(table.designs):
        for quantity, what, style in ((NAMED, "named", "-"), (WRONG, "another named", ":")):
            found = [table[design, trials, kind, quantity] for trials in table.trials]
            _line(ax, index, next(beside), found, f"{what}, {plain(design)}", style)
    ax.set(ylim=(-0.04, 1.04), title=_TITLES[kind], ylabel="share of observers", xlabel="trials of a subject")
    return _by(ax, table.trials)


def population_power_axes(table: PopulationPower, kind: str = "update", *, ax: Axes | None = None) -> Axes:
    """Share of simulated studies of one kind of subjects whose analysis as a group finds an order effect, by their number."""
    ax, beside = panel(ax), _beside(table.subjects, table.designs)
    for index, design in enumerate(table.designs):
        for quantity, style in ((SOMEWHERE, "-"), (ON_AVERAGE, ":")):
            found = [table.counted[design, kind, size, quantity] for size in table.subjects]
            _line(ax, index, next(beside), found, f"order effect {quantity}, {plain(design)}", style)
    ax.set(ylim=(-0.04, 1.04), title=_TITLES[kind], ylabel="share of studies", xlabel=f"subjects of {table.trials:,} trials")
    return _by(ax, table.subjects)


def interval_width_axes(table: PowerTable, quantity: str, *, ax: Axes | None = None) -> Axes:
    """Expected width of the 90 % interval of gain, mu1 or width of observers who update."""
    ax, beside = panel(ax), _beside(table.trials, table.designs, lines=1)
    for index, design in enumerate(table.designs):
        found = [table[design, trials, "update", f"90 % width of {quantity}"] for trials in table.trials]
        _line(ax, index, next(beside), found, "")
    ax.set_yscale("log")
    ax.set(ylabel=f"90 % interval of {quantity}", xlabel="trials of a subject")
    return _by(ax, table.trials)


def _beside(numbers: Sequence[int], designs: Sequence[str], *, lines: int = 2) -> Iterator[FloatArray]:
    """Where each line's points stand: beside each other about their numbers, within the panel and clear of the next number."""
    count, at = lines * len(designs), np.array(numbers, np.float64)
    nearest = float(np.diff(np.log(np.sort(at))).min(initial=2.0 * np.log(_MARGIN)))
    step = min(_APART, _MOST * nearest / count)
    return (at * np.exp(step * (place - 0.5 * (count - 1))) for place in range(count))


def _line(ax: Axes, index: int, x: FloatArray, found: Sequence[Counted | CountedStudies], label: str, style: str = "-") -> None:
    """A line of a design with error bars; beyond five designs colours come again, with other markers."""
    y = [one.value for one in found]
    errors = [[one.value - one.low for one in found], [one.high - one.value for one in found]]
    colour, marker = _COLOURS[index % len(_COLOURS)], _MARKERS[(index + index // len(_COLOURS)) % len(_MARKERS)]
    filled = colour if style == "-" else "white"
    ax.errorbar(
        x, y, errors, fmt=marker, linestyle=style, color=colour, markerfacecolor=filled, markersize=4.0, linewidth=1.1, elinewidth=0.8,
        label=label,
    )  # fmt: skip


def _by(ax: Axes, numbers: Sequence[int]) -> Axes:
    from matplotlib.ticker import FixedLocator, FormatStrFormatter, LogLocator, NullLocator

    ax.set_xscale("log")
    ax.set_xlim(min(numbers) / _MARGIN, max(numbers) * _MARGIN)
    ax.xaxis.set_major_locator(FixedLocator(list(numbers)))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.set_xticklabels([f"{number:,}" for number in numbers])
    if ax.get_yscale() == "log":
        ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0)))
        ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
        ax.yaxis.set_minor_locator(NullLocator())
    return dress(ax)
