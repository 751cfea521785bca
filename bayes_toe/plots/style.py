"""What all figures share: colours, sizes, names and numbers as words, panels, legends.

Functions take Axes or make a Figure of their own, return it, never show it and never touch global
settings. Colours keep the paper's meaning in a palette safe for colour-blind readers: orange weaker
stimulus first, blue stronger first, grey equal stimuli; markers differ too.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure, SubFigure
from matplotlib.gridspec import GridSpecBase
from matplotlib.ticker import MaxNLocator

from bayes_toe.arrays import FloatArray
from bayes_toe.data.tasks import Task

WEAKER_FIRST, STRONGER_FIRST, EQUAL = "#D55E00", "#0072B2", "#6E6E6E"
POSTERIOR = "#0072B2"
BELIEF = "#4B3B8F"
#: What is wrong, and bands behind what is drawn.
BAD, BAND = "#C00000", "#EDEDED"
#: Inches of one and of two columns of a journal's page; points of small and of ordinary letters on
#: it.
COLUMN, PAGE = 85.0 / 25.4, 175.0 / 25.4
SMALL, LETTERS = 7.0, 8.0
#: Subjects beyond which figures of a study sort them and name none; inches of such a panel.
MOST_NAMED, HIGH = 60, 5.6
#: Quantiles that lines and intervals mark.
MARKED = (0.025, 0.5, 0.975)
Band = tuple[float, float, float]
#: Of fitted curves: lower and upper quantile, opacity.
BANDS: tuple[Band, ...] = ((0.025, 0.975, 0.15), (0.25, 0.75, 0.35))
LABELS = {
    "mu1": r"$\mu_1$",
    "sigma_p": r"$\sigma_p$",
    "sigma_l": r"$\sigma_\ell$",
    "q0": r"$q_0$",
    "gamma": r"$\gamma$",
    "sigma1": r"$\sigma_1$",
    "gain": r"gain $K$",
    "width": r"width $w$",
    "offset": r"offset $c$",
    "pull": r"contraction $p$",
    "noise": r"noise $\sigma_d$",
    "criterion_slope": r"criterion slope $g$",
    "constant_error": r"constant error $c$",
    "contraction": r"contraction $p$",
    "zone": "zone",
    "pse_shift": "PSE shift",
    "jnd": "JND",
    "noise_slope": r"noise slope $b$",
    "lapse_rate": r"lapse rate $\lambda$",
}


def chance(task: Task) -> str:
    """What an axis of probabilities of the answer that a task counts is called."""
    return f"P('{task.yes}')"


class Mark(NamedTuple):
    """How the answers of one kind are drawn: colour, marker, words."""

    colour: str
    marker: str
    label: str


#: By the order of the stimuli, as `presentation_order` has it: the sign of s1 - s2.
ORDERS = {
    -1: Mark(WEAKER_FIRST, "o", "weaker first"),
    1: Mark(STRONGER_FIRST, "s", "stronger first"),
    0: Mark(EQUAL, "D", "equal stimuli"),
}


# --- words ----------------------------------------------------------------------------------------


def plain(name: str, limit: int = 32) -> str:
    r"""A subject's name as matplotlib may draw it, shortened in the middle.

    rNo dollar sign is read as mathematics.

    Names of a study begin alike and end with what tells them apart.

    Examples
    --------
    >>> plain("a$b"), plain("participant_0007", 12)
    ('a\\$b', 'partic…_0007')
    """
    last = (limit - 2) // 2
    short = name if len(name) <= limit else f"{name[: limit - 1 - last]}…{name[-last:]}"
    return short.replace("$", r"\$")


def rounded(low: float, high: float, *values: float) -> list[str]:
    """Numbers with two digits of the distance between two others."""
    digits = max(0, 1 - int(np.floor(np.log10(high - low)))) if high > low else 3
    return [
        f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−") for value in values
    ]  # never -0.0


@contextmanager
def any_characters() -> Iterator[None]:
    """Lay out or draw without a warning for characters that the font lacks: they become boxes."""
    with warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", message="Glyph .* missing from font", category=UserWarning
        )
        yield


# --- panels ---------------------------------------------------------------------------------------


def new_figure(
    wide: float, high: float, layout: Literal["constrained"] | None = "constrained"
) -> Figure:
    """A figure that no global state knows of: nothing to close, nothing pops up."""
    return Figure(figsize=(wide, high), layout=layout)


def panel(ax: Axes | None, *, wide: float = COLUMN, high: float = 2.6) -> Axes:
    """The Axes given, or those of a new figure of so many inches."""
    return new_figure(wide, high).subplots() if ax is None else ax


def even_columns(panels: int, most: int) -> int:
    """Columns, at most so many, with which the rows of a grid of panels are as even as they can be.

    Examples
    --------
    >>> even_columns(4, most=3), even_columns(7, most=3), even_columns(2, most=3)
    (2, 3, 2)
    """
    return -(-panels // -(-panels // most))


def first_panels(grid: GridSpecBase, panels: int, *, sharey: bool = False) -> list[Axes]:
    """So many panels of a grid, row by row; those left over are removed."""
    axes = grid.subplots(squeeze=False, sharey=sharey).ravel()
    for ax in axes[panels:]:
        ax.remove()
    return list(axes[:panels])


def percent_axis(ax: Axes, label: str, reference: float) -> None:
    """Label an axis of natural logs in per cent of a reference, at round numbers."""
    low, high = ax.get_xlim()
    ends = 100.0 * np.exp(np.array([low, high]) - reference)
    percent = MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]).tick_values(*ends)
    shown = percent[(percent >= ends[0]) & (percent <= ends[1])]
    ax.set_xticks(reference + np.log(shown / 100.0), [f"{value:g}" for value in shown])
    ax.set(xlim=(low, high), xlabel=label)


def dress(ax: Axes) -> Axes:
    """Letters and lines of a panel as a journal prints them.

    7 points for numbers, 8 for words, no box.
    """
    ax.tick_params(labelsize=SMALL, width=0.6, length=2.5, pad=2.0)
    for text in (ax.xaxis.label, ax.yaxis.label, ax.title):
        text.set_fontsize(LETTERS)
    ax.spines[:].set_linewidth(0.6)
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def dress_bar(bar: Colorbar, label: str) -> None:
    """Label, letters and lines of a bar of colours, as :func:`dress` has them."""
    bar.set_label(label, fontsize=LETTERS)
    bar.ax.tick_params(labelsize=SMALL, width=0.6, length=2.5)
    bar.outline.set_linewidth(0.6)


def draw_band(
    ax: Axes,
    x: FloatArray,
    values: FloatArray,
    colour: str,
    line: float = 1.6,
    bands: Sequence[Band] = BANDS,
    label: str | None = None,
) -> None:
    """Draw the mean over draws and bands between quantiles, by default of 50 % and 95 %.

    Draws are the first axis of `values`.
    """
    for low, high, opacity in bands:
        ax.fill_between(
            x, *np.quantile(values, [low, high], axis=0), color=colour, alpha=opacity, lw=0
        )
    ax.plot(x, values.mean(axis=0), color=colour, lw=line, label=label)


# --- legends --------------------------------------------------------------------------------------


def legend_below(
    figure: Figure | SubFigure,
    *,
    size: float = 10.0,
    columns: int = 3,
    side: Literal["lower", "upper"] = "lower",
) -> None:
    """Put one legend outside the panels, below or above them.

    Points may be anywhere in the panels. `size` is that of the letters in points.
    """
    found = {label: handle for ax in figure.axes for handle, label in _main_first(ax)}
    style: dict[str, Any] = (
        {"handletextpad": 0.3, "columnspacing": 1.2, "borderaxespad": 0.2}
        if size <= LETTERS
        else {}
    )
    style |= {"loc": f"outside {side} center", "ncols": columns, "frameon": False, "fontsize": size}
    figure.legend(found.values(), found.keys(), **style)


def legend_above(ax: Axes, *, columns: int = 1, title: str | None = None) -> None:
    """One legend for a panel, above it, in small letters, perhaps with words over it.

    Estimates with error bars come first.
    """
    handles, labels = zip(*_main_first(ax), strict=True)
    place: dict[str, Any] = {
        "loc": "lower center",
        "bbox_to_anchor": (0.5, 1.0),
        "borderaxespad": 0.2,
    }
    space: dict[str, Any] = {"handletextpad": 0.3, "columnspacing": 1.0, "labelspacing": 0.25}
    ax.legend(
        handles,
        labels,
        ncols=columns,
        frameon=False,
        fontsize=SMALL,
        title=title,
        title_fontsize=SMALL,
        **place,
        **space,
    )


def _main_first(ax: Axes) -> list[tuple[Any, str]]:
    """Handles and labels, estimates with error bars before plain points.

    Matplotlib itself lists all lines first.
    """
    pairs = list(zip(*ax.get_legend_handles_labels(), strict=True))
    return sorted(pairs, key=lambda pair: not isinstance(pair[0], tuple))
