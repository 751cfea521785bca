"""Figures of a comparison of models: its parts, log evidence of every subject and model, model frequencies over the subjects."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.model_comparison import ModelComparison
from bayes_toe.comparison.random_effects import ModelFrequencies
from bayes_toe.plots.figure_files import save_figure
from bayes_toe.plots.parts import BETWEEN, ROW, WORDS, best_axes, heads_height, part_axes, part_width, rows_height
from bayes_toe.plots.style import EQUAL, LETTERS, SMALL, STRONGER_FIRST, WEAKER_FIRST, dress, new_figure, panel, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Nats below the best model up to which a class of cells goes, what it is called, its colour (even steps of lightness), that of its number.
CLASSES = (
    (0.0, "best", "#08306B", "white"),
    (1.0, "up to 1", "#3674AE", "white"),
    (3.0, "1 to 3", "#8FBBDD", "black"),
    (10.0, "3 to 10", "#D0E1F1", "black"),
    (np.inf, "more than 10", "#FFFFFF", "#555555"),
)
_GRID = "#C8C8C8"
_TITLE = "log evidence below the subject's best model (nats)"
_HEADING = ("parts: probability of each level (%), whatever the other parts are", "comparison of models")
_WITHHELD = "withheld: subject not counted"
_COLUMN = 0.66  # inches of a cell
_LABELS, _AROUND, _STUDY = 0.95, 0.6, 2.05  # inches left of the cells, around them but for their heads, and of the panel below likewise
_LINE = 0.115  # inches of a line of a model's name
_MOST_ROWS = 600  # beyond, rows get narrower and lose their numbers
_CELL = 6.5  # points of a number
_SHIFT = 0.24  # between marks of one model
_LEVEL = 0.95


def comparison_axes(table: ModelComparison, ax: Axes | None = None) -> Axes:
    """Log evidence (nats) below the best model of each subject: one row a subject, one column a model, the darker the better.

    Numbers are nats below the best. Hatched: evidence withheld; such a subject, in grey letters, has its best among the other models and
    does not count for the study. The last row, set apart, is the sum over the subjects that count, as if all followed one model.

    Parameters
    ----------
    table : ModelComparison
    ax : matplotlib Axes, optional
        Drawn into, where given; its own Axes have a legend.
    """
    own = ax is None
    ax = panel(ax, wide=_width(table), high=_height(table) + _AROUND + _heads(table))
    evidence = table.log_evidence
    counted = np.asarray(~np.isnan(evidence).any(axis=1))
    for i, row in enumerate(evidence):
        _draw_row(ax, i, row, numbers=len(evidence) <= _MOST_ROWS)
    labels = [plain(name, 16) for name in table.subjects]
    places = [float(i) for i in range(len(labels))]
    if _has_sum(table):
        places.append(len(labels) + BETWEEN)
        labels.append(f"sum of {counted.sum()}")
        _draw_row(ax, places[-1], evidence[counted].sum(axis=0))
    ax.set(xlim=(-0.5, len(table.models) - 0.5), ylim=(places[-1] + 0.5, -0.5))
    ax.set_yticks(places, labels)
    ax.set_xticks(range(len(table.models)), [_broken(name) for name in table.models])
    ax.xaxis.tick_top()
    dress(ax).tick_params(length=0)
    ax.spines[:].set_visible(False)
    for label, known in zip(ax.get_yticklabels(), counted, strict=False):
        label.set_color("black" if known else EQUAL)
    if own:
        _name_classes(ax, table)
    return ax


def model_frequency_axes(table: ModelComparison, ax: Axes | None = None) -> Axes:
    """Expected frequency of every model among people, with its central 95 % interval, and exceedance probabilities.

    Plain: that a model is the most frequent one, if frequencies differ; protected: averaged over whether they do. The panel also says the
    probability that all models are equally frequent. A single subject has no frequencies: its model probabilities are drawn.

    Parameters
    ----------
    table : ModelComparison
    ax : matplotlib Axes, optional
        Drawn into, where given; its own Axes have a legend.
    """
    own = ax is None
    ax = panel(ax, wide=_width(table), high=_STUDY + _heads(table))
    found = table.frequencies()
    if len(table.subjects) == 1:
        _draw_probabilities(ax, table)
    elif found is None:
        why = "one model only" if len(table.models) < 2 else "no subject has an evidence under every model"
        _say(ax, f"no model frequencies:\n{why}")
    else:
        _draw_frequencies(ax, found)
        ax.set_title(_risk(table, found), loc="left", fontsize=SMALL)
        ax.set_ylabel("frequency, probability")
    ax.set(xlim=(-0.5, len(table.models) - 0.5), ylim=(0.0, 1.0), yticks=[0.0, 0.5, 1.0])
    ax.set_xticks(range(len(table.models)), [_broken(name) for name in table.models])
    dress(ax)
    ax.tick_params(axis="x", length=0)
    if own and ax.get_legend_handles_labels()[0]:
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.3), ncols=_columns_below(table), **_legend_style())
    return ax


def comparison_figure(table: ModelComparison, *, synthetic: bool = False) -> Figure:
    """Parts and best compositions, then :func:`comparison_axes` above :func:`model_frequency_axes`, model under model.

    Where no part varies among the models compared, without the first.
    """
    cells, parts = _height(table), table.parts
    bars = [rows_height(table) + heads_height(table)] if parts else []
    wide = max(_width(table), _LABELS + sum(map(part_width, parts)) + WORDS + 0.2 if parts else 0.0)
    heights = [*bars, _AROUND + _heads(table) + cells, _STUDY + _heads(table)]
    figure = new_figure(wide, sum(heights))
    grid = figure.add_gridspec(len(heights), 1, height_ratios=[*bars, cells, 1.25])
    if parts:
        inner = grid[0].subgridspec(1, len(parts) + 1, width_ratios=[*map(part_width, parts), WORDS])
        for i, part in enumerate(parts):
            ax = part_axes(table, part.part, figure.add_subplot(inner[i]))
            ax.tick_params(labelleft=i == 0)
        best_axes(table, figure.add_subplot(inner[-1]))
    figure.suptitle(_HEADING[not parts] + (" (synthetic data)" if synthetic else ""), fontsize=LETTERS + 1.0)
    upper = comparison_axes(table, figure.add_subplot(grid[-2]))
    lower = model_frequency_axes(table, figure.add_subplot(grid[-1]))
    _name_classes(upper, table)
    marks, labels = lower.get_legend_handles_labels()
    if marks:
        figure.legend(marks, labels, loc="outside lower center", ncols=_columns_below(table), **_legend_style())
    return figure


def save_comparison(table: ModelComparison, path: str | Path, *, synthetic: bool = False, overwrite: bool = False) -> Path:
    """Draw :func:`comparison_figure` and write it, whole or not at all; errors as in :func:`bayes_toe.plots.figure_files.save_figure`."""
    return save_figure(comparison_figure(table, synthetic=synthetic), path, overwrite=overwrite)


# --- cells --------------------------------------------------------------------------------------------------------------------------


def _draw_row(ax: Axes, at: float, evidence: FloatArray, *, numbers: bool = True) -> None:
    """The cells of one subject, or of the sum."""
    from matplotlib.patches import Rectangle

    best = np.nanmax(evidence) if not np.isnan(evidence).all() else np.nan
    for j, below in enumerate(best - evidence):
        ax.add_patch(Rectangle((j - 0.5, at - 0.5), 1.0, 1.0, clip_on=False, **_cell_style(below)))
        if numbers and not np.isnan(below):
            weight = "bold" if below == 0 else "normal"
            ax.text(j, at, _number(below), ha="center", va="center_baseline", fontsize=_CELL, color=_class_of(below)[3], weight=weight)


def _number(below: float) -> str:
    return "best" if below == 0 else f"{below:.1f}" if below < 99.95 else f"{below:.0f}"


def _class_of(below: float) -> tuple[float, str, str, str]:
    """The class of the number as it is printed; only the best is 0."""
    return next(one for one in CLASSES[int(below > 0) :] if round(below, 1) <= one[0])


def _cell_style(below: float) -> dict[str, Any]:
    if np.isnan(below):
        return {"facecolor": "white", "edgecolor": EQUAL, "hatch": "//////", "linewidth": 0.4}
    return {"facecolor": _class_of(below)[2], "edgecolor": _GRID, "linewidth": 0.4}


def _name_classes(ax: Axes, table: ModelComparison) -> None:
    """Keys of the cells, below them."""
    handles = _class_handles(table)
    style = _legend_style() | {"title": _TITLE, "title_fontsize": LETTERS}
    columns = len(handles) if len(table.models) > 6 else 3
    ax.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=columns, **style)


def _class_handles(table: ModelComparison) -> list[Any]:
    """Keys of the classes, and of withheld evidences where there are any."""
    from matplotlib.patches import Patch

    handles = [Patch(label=label, **_cell_style(limit)) for limit, label, *_ in CLASSES]
    if np.isnan(table.log_evidence).any():
        handles.append(Patch(label=_WITHHELD, **_cell_style(np.nan)))
    return handles


def _has_sum(table: ModelComparison) -> bool:
    return int((~np.isnan(table.log_evidence).any(axis=1)).sum()) > 1


# --- the study ----------------------------------------------------------------------------------------------------------------------


def _draw_frequencies(ax: Axes, found: ModelFrequencies) -> None:
    x = np.arange(len(found.models))
    style: dict[str, Any] = {"ms": 4.5, "mew": 1.1, "clip_on": False}
    ax.vlines(x - _SHIFT, *found.interval(_LEVEL).T, color=STRONGER_FIRST, lw=1.2)
    ax.plot(x - _SHIFT, found.expected, "o", color=STRONGER_FIRST, label=f"expected frequency, {100 * _LEVEL:g} % interval", **style)
    ax.plot(x, found.exceedance, "s", mfc="white", color=WEAKER_FIRST, label="most frequent (exceedance)", **style)
    ax.plot(x + _SHIFT, found.protected, "D", color="black", label="the same, protected", **style | {"ms": 3.8})
    _rule(ax, 1.0 / len(x))


def _draw_probabilities(ax: Axes, table: ModelComparison) -> None:
    """Model probabilities of the only subject."""
    shares = np.array([row.model_probability for row in table], np.float64)
    if np.isnan(shares).any():
        return _say(ax, "no model probabilities: an evidence is withheld")
    ax.plot(np.arange(len(shares)), shares, "o", ms=5, color=STRONGER_FIRST, clip_on=False, label="model probability, equal prior odds")
    _rule(ax, 1.0 / len(shares))
    ax.set_ylabel("probability")
    return None


def _risk(table: ModelComparison, found: ModelFrequencies) -> str:
    """How many subjects, and the probability that all models are equally frequent."""
    who = f"{len(found.subjects)} of {len(table.subjects)} subjects, random effects, sampled"
    return f"{who}\nall models equally frequent with probability {_short(found.omnibus_risk)}"


def _short(probability: float) -> str:
    return f"{probability:.2f}" if probability >= 0.01 else f"{probability:.1g}".replace("-", "−")


def _rule(ax: Axes, even: float) -> None:
    """Where every model would be if none were preferred; shading parts the models."""
    ax.axhline(even, color=EQUAL, lw=0.8, ls=":", zorder=1, label="none preferred")
    for j in range(1, round(1.0 / even), 2):
        ax.axvspan(j - 0.5, j + 0.5, color="#F3F3F3", lw=0, zorder=0)


def _say(ax: Axes, words: str) -> None:
    ax.tick_params(left=False, labelleft=False)
    ax.text(0.5, 0.5, words, transform=ax.transAxes, ha="center", va="center", fontsize=SMALL, color=EQUAL)


# --- sizes --------------------------------------------------------------------------------------------------------------------------


def _width(table: ModelComparison) -> float:
    return _LABELS + _COLUMN * max(len(table.models), 5)


def _height(table: ModelComparison) -> float:
    """Of the cells, inches."""
    return ROW * (min(len(table.subjects), _MOST_ROWS) + (1.0 + BETWEEN if _has_sum(table) else 0.0))


def _heads(table: ModelComparison) -> float:
    """Of the longest name of a model, inches."""
    return _LINE * max(_broken(name).count("\n") + 1 for name in table.models)


def _columns_below(table: ModelComparison) -> int:
    """Of the legend below, so that it stays within the figure."""
    return 4 if len(table.models) > 6 else 2


def _broken(name: str) -> str:
    """A model's name as a narrow column heads it."""
    first, *others = name.split(" + ")
    return "\n".join(chain.from_iterable(wrap(part, 11, break_long_words=False) for part in (first, *(f"+ {one}" for one in others))))


def _legend_style() -> dict[str, Any]:
    return {"frameon": False, "fontsize": SMALL, "handletextpad": 0.4, "columnspacing": 1.2, "borderaxespad": 0.2}
