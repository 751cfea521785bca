"""What a design will tell: how often order effects of assumed observers are named, how narrow intervals get, and the optimised design."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import FixedLocator, FormatStrFormatter, LogLocator, NullLocator

from bayes_toe.arrays import FloatArray
from bayes_toe.planning.optimal import MOVED, OPTIMISED, PAPER, SECOND, OptimalDesign, paper_amid
from bayes_toe.planning.power import NAMED, WIDTHS, WRONG, Counted, PowerTable
from bayes_toe.planning.power_of_studies import ON_AVERAGE, SOMEWHERE, PopulationPower
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
    panel,
    plain,
)

_KINDS = {
    "none": ("no order effect", EQUAL, "D"),
    "constant error": ("constant error", WEAKER_FIRST, "s"),
    "update": ("update", STRONGER_FIRST, "o"),
}
_LARGEST = 160.0  # area of the most frequent pair, square points
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
    ax, beside, [trials] = panel(ax), _beside(table.subjects, table.designs), table.trials
    for index, design in enumerate(table.designs):
        for quantity, style in ((SOMEWHERE, "-"), (ON_AVERAGE, ":")):
            found = [table.counted[design, trials, kind, size, quantity] for size in table.subjects]
            _line(ax, index, next(beside), found, f"order effect {quantity}, {plain(design)}", style)
    ax.set(ylim=(-0.04, 1.04), title=_TITLES[kind], ylabel="share of studies", xlabel=f"subjects of {trials:,} trials")
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


def _line(ax: Axes, index: int, x: FloatArray, found: Sequence[Counted], label: str, style: str = "-") -> None:
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


# --- an optimised design ------------------------------------------------------------------------------------------------------------


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
