"""Style of all figures: colours, sizes, names and numbers as words, panels, legends.

Functions take Axes or make a Figure of their own, return it, never show it and never touch global
settings. Colours keep the paper's meaning in a palette safe for colour-blind readers: orange weaker
stimulus first, blue stronger first, grey equal stimuli; markers differ too.
"""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.container import Container, ErrorbarContainer
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from bayes_toe.arrays import FloatArray
from bayes_toe.data.stimulus_unit import UNKNOWN_UNIT, StimulusUnit, percent
from bayes_toe.model.parameters import QUANTITY_BY_NAME

WEAKER_FIRST = "#D55E00"
STRONGER_FIRST = "#0072B2"
EQUAL = "#6E6E6E"
POSTERIOR = "#0072B2"
BELIEF = "#4B3B8F"
#: Colour of a warning, and of marks of a problem.
BAD = "#C00000"
#: Colour of bands behind lines and marks.
BAND = "#EDEDED"
#: Width of one column of a journal's page, inches.
COLUMN = 85.0 / 25.4
#: Width of two columns, the whole page, inches.
PAGE = 175.0 / 25.4
#: Size of the letters of numbers and notes, points.
SMALL = 7.0
#: Size of all other letters, points.
LETTERS = 8.0
#: Figures with more subjects than this sort the subjects and name none.
MAX_NAMES = 60
#: Height of a panel without names, inches.
UNNAMED_HEIGHT = 5.6
#: Quantiles that lines and intervals mark.
MARKED_QUANTILES = (0.025, 0.5, 0.975)
#: Arguments that several calls of matplotlib share.
Style = dict[str, Any]


class Mark(NamedTuple):
    """Style of the answers of one kind: colour, marker, words."""

    colour: str
    marker: str
    label: str


#: Marks by the order of the stimuli, which is the sign of s1 - s2, as in `presentation_order`.
ORDERS = {
    -1: Mark(WEAKER_FIRST, "o", "weaker first"),
    1: Mark(STRONGER_FIRST, "s", "stronger first"),
    0: Mark(EQUAL, "D", "equal stimuli"),
}


# --- words ----------------------------------------------------------------------------------------


def plain(name: str | int, limit: int = 32) -> str:
    r"""A subject's name as matplotlib may draw it, shortened in the middle to `limit` characters.

    No dollar sign is read as mathematics. Names of a study begin alike and end with what
    distinguishes them.

    Examples
    --------
    >>> plain("a$b"), plain("participant_0007", 12)
    ('a\\$b', 'partic…_0007')
    """
    text = str(name)
    if len(text) > limit:
        # One character is the ellipsis. The start is one or two characters longer than the end.
        n_end = (limit - 2) // 2
        text = f"{text[: limit - 1 - n_end]}…{text[-n_end:]}"
    return text.replace("$", r"\$")


# --- panels ---------------------------------------------------------------------------------------


def new_figure(width: float, height: float) -> Figure:
    """A figure that no global state knows of: nothing to close, nothing pops up."""
    return Figure(figsize=(width, height), layout="constrained")


def grid_rows(n_panels: int, n_columns: int) -> int:
    """The number of rows of a grid of panels.

    Examples
    --------
    >>> grid_rows(4, 3)
    2
    """
    return -(-n_panels // n_columns)  # rounded up


def grid_panels(figure: Figure | SubFigure, n_panels: int, n_columns: int) -> list[Axes]:
    """Panels in a grid, row by row, which share the y axis."""
    axes = figure.subplots(grid_rows(n_panels, n_columns), n_columns, squeeze=False, sharey=True)
    panels = axes.ravel().tolist()
    for ax in panels[n_panels:]:  # the last row may be shorter
        ax.remove()
    return panels[:n_panels]


def label_outer(panels: Sequence[Axes], n_columns: int) -> None:
    """Keep the labels left of each row and below the last panel of each column only."""
    for i, ax in enumerate(panels):
        if i % n_columns:  # not the first panel of its row
            ax.set_ylabel("")
        if i + n_columns < len(panels):  # not the last panel of its column
            ax.set_xlabel("")
        figure = ax.get_figure(root=True)
        # Panels below 2.3 inches have no room for a label of one line.
        if figure is not None and figure.get_figwidth() < 2.3 * n_columns:
            # With a space that does not break, no line ends before a %.
            unbroken = ax.get_xlabel().replace("% ", "%\u00a0")
            ax.set_xlabel(fill(unbroken, 20).replace("\u00a0", " "))
        style_axes(ax)


class Scale(NamedTuple):
    """How an axis of natural logs is labelled.

    Attributes
    ----------
    label : str
    unit : StimulusUnit or None
        The unit of its numbers; None for natural logs.
    """

    label: str
    unit: StimulusUnit | None = None

    def ticks(self, low: float, high: float) -> tuple[FloatArray, list[str]]:
        """Natural logs of round numbers in the unit between two natural logs, and the numbers.

        The scale has a unit.
        """
        assert self.unit is not None
        start, end = self.unit.to_stimuli([low, high])
        # Multiples of powers of ten are tried first, and equal steps last.
        choices: list[FloatArray] = []
        if not self.unit.is_decibel:
            exponents = np.arange(np.floor(np.log10(start)), np.ceil(np.log10(end)) + 1.0)
            powers = 10.0 ** exponents[:, None]
            for multiples in ((1.0,), (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)):
                choices.append((powers * multiples).ravel())
        choices.append(np.asarray(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]).tick_values(start, end)))
        for choice in choices:
            numbers = choice[(choice >= start) & (choice <= end)]
            if len(numbers) >= 3:
                break

        # Twelve digits hide the error of rounding.
        texts = [f"{number:.12g}".replace("-", "−") for number in numbers]
        return self.unit.to_logs(numbers), texts

    def draw(self, ax: Axes) -> None:
        """Label the horizontal axis, which has natural logs."""
        ax.set_xlabel(self.label)
        if self.unit is not None:
            low, high = ax.get_xlim()
            ax.set_xticks(*self.ticks(low, high))
            ax.set_xlim(low, high)  # ticks may widen the limits


def stimulus_scale(
    stimulus: str, unit: StimulusUnit, mean: float, limits: Sequence[float]
) -> Scale:
    """An axis of stimuli in their unit; without a unit in per cent of their mean, or as logs.

    `mean` and `limits`, the ends of the axis, are natural logs.
    """
    if unit.stimulus_unit:
        return Scale(f"{stimulus}, {unit.stimulus_unit}", unit)
    # Logs stand in place of per cents that would be too large.
    if unit.with_logs_if_large(percent(np.asarray(limits) - mean)) != unit:
        return Scale(f"{stimulus}, ln")
    return Scale(f"{stimulus}, % of the mean", unit.or_percent_of(mean))


def difference_scale(unit: StimulusUnit, limits: Sequence[float]) -> Scale:
    """An axis of s2 - s1 in decibels, as the ratio of the stimuli in per cent, or as logs.

    `limits`, the ends of the axis, are natural logs.
    """
    if unit.is_decibel:
        return Scale("second minus first stimulus, dB", unit)
    unit_for_limits = unit.with_logs_if_large(percent(limits))
    if unit_for_limits.difference_unit == "ln":
        return Scale("second minus first stimulus, ln")
    return Scale("second stimulus, % of the first", UNKNOWN_UNIT.or_percent_of(0.0))


def stimulus_axis(ax: Axes, stimulus: str, unit: StimulusUnit, mean: float) -> None:
    """Label an axis of natural logs in the unit of the stimuli, or in per cent of their mean."""
    stimulus_scale(stimulus, unit, mean, ax.get_xlim()).draw(ax)


def difference_axis(ax: Axes, unit: StimulusUnit) -> None:
    """Label an axis of s2 - s1 in natural logs in the unit of differences, with a line at 0."""
    zero_line(ax)
    difference_scale(unit, ax.get_xlim()).draw(ax)


def proportion_axis(ax: Axes) -> None:
    """Set limits and ticks of proportions: from 0, or from below the lowest if it is .3 or more."""
    lowest, _ = ax.get_ylim()
    if lowest >= 0.3:
        start = np.floor(10.0 * lowest) / 10.0  # the tenth below
    else:
        start = 0.0
    ax.set_ylim(start - 0.03, 1.03)  # room for half a mark
    ax.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))


def quantity_ticks(ax: Axes, name: str) -> None:
    """Write the ticks of the horizontal axis in per cent, if the quantity is a share."""
    scale = QUANTITY_BY_NAME[name].scale  # 100 for a share
    if scale != 1.0:
        ax.xaxis.set_major_formatter(lambda value, _: f"{scale * value:g}".replace("-", "−"))


def zero_line(ax: Axes) -> None:
    """A dotted vertical line at 0, behind the marks."""
    ax.axvline(0.0, color=EQUAL, lw=0.8, ls=":", zorder=0)


def write_note(ax: Axes, text: str) -> None:
    """A note in small grey letters, in the lower right corner of a panel."""
    box = ax.transAxes  # in which a panel goes from 0 to 1
    ax.text(0.99, 0.01, text, ha="right", va="bottom", fontsize=SMALL, color=EQUAL, transform=box)


def style_axes(ax: Axes) -> Axes:
    """Set fonts and lines of a panel as a journal prints them, and return the panel.

    Numbers have the size :data:`SMALL`, words the size :data:`LETTERS`. The panel has no box.
    """
    ax.tick_params(labelsize=SMALL, width=0.6, length=2.5, pad=2.0)
    for text in (ax.xaxis.label, ax.yaxis.label, ax.title):
        text.set_fontsize(LETTERS)
    ax.spines[:].set_linewidth(0.6)
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def _band_style(colour: str) -> Style:
    """A band with edges, which are seen where bands lie over each other."""
    return {"fc": (colour, 0.15), "ec": (colour, 0.5), "lw": 0.5}


def draw_band(
    ax: Axes, x: FloatArray, values: FloatArray, colour: str, *, is_joined: bool = True
) -> None:
    """Draw the mean and the central 95 % interval of `values`, shape (draws, x), at each `x`.

    They are joined as a curve on its band, or stand alone as bars.
    """
    low, _, high = np.quantile(values, MARKED_QUANTILES, axis=0)
    mean = values.mean(axis=0)
    if is_joined:
        ax.fill_between(x, low, high, **_band_style(colour))
        ax.plot(x, mean, color=colour, lw=1.2)
    else:
        ax.vlines(x, low, high, color=colour, lw=5.0, alpha=0.25)
        ax.plot(x, mean, "_", color=colour, ms=8.0)


def explain_curves(ax: Axes, model: str = "model", colour: str = EQUAL) -> None:
    """Add entries to the legend of a panel: the curve on its band, and the error bar."""
    band_and_curve = Patch(**_band_style(colour)), Line2D([], [], color=colour, lw=1.2)
    # The legend shows a container as one entry.
    ax.add_container(Container(band_and_curve, label=f"{model}, 95 % band"))
    ax.plot([], [], "|", color=EQUAL, ms=9.0, mew=0.9, label="standard error")


def draw_intervals(
    ax: Axes,
    y: npt.ArrayLike,
    quantiles: FloatArray,
    *,
    colour: str = POSTERIOR,
    line: float = 1.6,
    **marker: Any,
) -> None:
    """Draw medians with intervals at the heights `y`, shape (rows,).

    `quantiles` has low ends, medians and high ends, shape (3, rows). `line` is the width of the
    intervals; `marker` has matplotlib's arguments for the medians.
    """
    low, middle, high = quantiles
    ax.hlines(y, low, high, color=colour, lw=line)
    style: Style = {"marker": "o", "ms": 3.4, "color": colour, "ls": ""}
    ax.plot(middle, y, **style | marker)


def name_rows(ax: Axes, n_rows: int, names: Sequence[str]) -> None:
    """Put the first row of a forest on top, and the names of its last rows, if any, at the left."""
    ax.set_yticks(range(n_rows - len(names), n_rows), names)
    ax.set_ylim(n_rows - 0.4, -0.6)  # rows are at 0, 1, ..., with half a row around them
    ax.locator_params(axis="x", nbins=4)
    style_axes(ax).tick_params(axis="y", length=0)


# --- legends --------------------------------------------------------------------------------------


def legend_outside(figure: Figure | SubFigure, *, columns: int = 3, side: str = "lower") -> None:
    """Put one legend in small letters below the panels, or above them ("upper").

    Points may be anywhere in the panels. Each label stands once, error bars first, because
    matplotlib itself lists all lines first.
    """
    handles: dict[str, Any] = {}  # what the legend shows, by label
    for ax in figure.axes:
        handles_of_panel, labels_of_panel = ax.get_legend_handles_labels()
        handles |= zip(labels_of_panel, handles_of_panel, strict=True)
    # Sorting keeps the order among equal keys, and False comes before True.
    labels = sorted(handles, key=lambda label: not isinstance(handles[label], ErrorbarContainer))
    loc: Any = f"outside {side} center"
    figure.legend(
        [handles[label] for label in labels],
        labels,
        loc=loc,
        ncols=columns,
        columnspacing=1.2,
        fontsize=SMALL,
        handletextpad=0.3,
        borderaxespad=0.2,
        frameon=False,
    )
