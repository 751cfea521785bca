"""Figures of a comparison of models: its parts, log evidence of every subject and model, model frequencies over the subjects."""

from __future__ import annotations

from itertools import chain
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.model_comparison import STUDY, ModelComparison, PartTable
from bayes_toe.comparison.random_effects import ModelFrequencies
from bayes_toe.inference.predictive_checks import MISFIT
from bayes_toe.plots.style import (
    EQUAL,
    LETTERS,
    SMALL,
    STRONGER_FIRST,
    WEAKER_FIRST,
    dress,
    new_figure,
    plain,
)

#: Nats below the best model up to which a class of cells goes, what it is called, its colour (even steps of lightness), that of its number.
CLASSES = (
    (0.0, "best", "#08306B", "white"),
    (1.0, "up to 1", "#3674AE", "white"),
    (3.0, "1 to 3", "#8FBBDD", "black"),
    (10.0, "3 to 10", "#D0E1F1", "black"),
    (np.inf, "more than 10", "#FFFFFF", "#555555"),
)
#: Colours of levels and of the letters on them, told apart by their lightness too: of the order part, and of the others.
ORDER_COLOURS = (
    ("#E9E9E9", "black"),
    ("#E5A84B", "black"),
    ("#0B3C74", "white"),
    ("#C0628F", "black"),
    ("#3F7F5F", "white"),
)
OTHER_COLOURS = (("#E9E9E9", "black"), ("#5F8F8B", "black"), ("#1F4E4A", "white"))
_HIDDEN: dict[str, Any] = {
    "facecolor": "white",
    "edgecolor": EQUAL,
    "hatch": "//////",
}  # of an evidence that is withheld
_LEGEND: dict[str, Any] = {
    "frameon": False,
    "fontsize": SMALL,
    "handletextpad": 0.4,
    "columnspacing": 1.2,
    "borderaxespad": 0.2,
}
_ROW, _BETWEEN = 0.17, 0.45  # inches of a row; rows between the subjects and the study
_MOST_MODELS = 16  # that are drawn one by one
_MOST_ROWS = 600  # beyond, rows get narrower and lose their numbers
_CELL = 6.5  # points of a number
_COLUMN, _WORDS = 0.66, 3.2  # inches of a cell, of the panel of words
_LABELS, _AROUND, _STUDY = (
    0.95,
    0.6,
    2.05,
)  # inches left of the cells, around them but for their heads, and of the panel below likewise
_NEEDED = 0.23  # inches of a bar that holds its number
_SHIFT = 0.24  # between marks of one model
_LEVEL = 0.95


def comparison_figure(table: ModelComparison, *, synthetic: bool = False) -> Figure:
    """Probabilities of the levels of every part that varies, and best compositions; evidence of every subject and model; frequencies.

    Above, one bar a subject and part (%), averaged over the other parts, hatched where evidence is withheld; the row set apart, '*', is
    that of a new subject, by random effects over families of models. In words, the best composition of each subject, its log evidence less
    that of free frequencies (nats), its posterior predictive p; bold where it does not describe the answers.

    In the middle, log evidence (nats) below the best model of each subject, the darker the better; ∞ where a bound on a withheld evidence
    leaves it no weight. Hatched: evidence otherwise withheld; such a subject, in grey letters, has its best among the other models and does
    not count for the study. The last row, set apart, is the sum over the subjects that count, as if all followed one model.

    Below, expected frequency of every model among people, with its central 95 % interval, and exceedance probabilities: plain, that a model
    is the most frequent one, if frequencies differ; protected, averaged over whether they do; and the probability that all models are
    equally frequent. A single subject has no frequencies: its model probabilities are drawn.

    Of more than 16 models, as in the space of 48, the parts alone say what matters; the table of the models has the rest.
    """
    cells, parts, few = (
        _cells_height(table),
        table.parts,
        len(table.models) <= _MOST_MODELS or not table.parts,
    )
    bars = [_bars_height(table)] if parts else []
    heads = 0.115 * max(
        _broken(name).count("\n") + 1 for name in table.models
    )  # of the longest name of a model
    models_wide = _LABELS + _COLUMN * max(len(table.models), 5) if few else 0.0
    wide = max(models_wide, _LABELS + sum(map(_part_width, parts)) + _WORDS + 0.2 if parts else 0.0)
    heights = [*bars, *([_AROUND + heads + cells, _STUDY + heads] if few else [])]
    figure = new_figure(wide, sum(heights))
    grid = figure.add_gridspec(
        len(heights), 1, height_ratios=[*bars, *([cells, 1.25] if few else [])]
    )
    if parts:
        inner = grid[0].subgridspec(
            1, len(parts) + 1, width_ratios=[*map(_part_width, parts), _WORDS]
        )
        for i, part in enumerate(parts):
            _draw_part(figure.add_subplot(inner[i]), table, part)
            figure.axes[i].tick_params(labelleft=i == 0)
        _draw_best(figure.add_subplot(inner[-1]), table)
    heading = (
        "parts: probability of each level (%), whatever the other parts are"
        if parts
        else "comparison of models"
    )
    figure.suptitle(heading + (" (synthetic data)" if synthetic else ""), fontsize=LETTERS + 1.0)
    if not few:
        return figure
    upper, lower = (figure.add_subplot(grid[place]) for place in (-2, -1))
    _draw_cells(upper, table)
    _draw_study(lower, table)
    marks, labels = lower.get_legend_handles_labels()
    if marks:  # in as many columns as stay within the figure
        figure.legend(
            marks,
            labels,
            loc="outside lower center",
            ncols=4 if len(table.models) > 6 else 2,
            **_LEGEND,
        )
    return figure


# --- evidence of every subject and model --------------------------------------------------------------------------------------------


def _draw_cells(ax: Axes, table: ModelComparison) -> None:
    """Log evidence below the best model of each subject: one row a subject, one column a model."""
    evidence = table.weighed
    counted = np.asarray(~np.isnan(evidence).any(axis=1))
    for i, row in enumerate(evidence):
        _draw_row(ax, i, row, numbers=len(evidence) <= _MOST_ROWS)
    labels, places = (
        [plain(name, 16) for name in table.subjects],
        [float(i) for i in range(len(evidence))],
    )
    if counted.sum() > 1:
        places.append(len(labels) + _BETWEEN)
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
    _name_classes(ax, table)


def _draw_row(ax: Axes, at: float, evidence: FloatArray, *, numbers: bool = True) -> None:
    """The cells of one subject, or of the sum, each with its number and in the class of the number as it is printed; only the best is 0."""
    best = np.nanmax(evidence) if not np.isnan(evidence).all() else np.nan
    for j, below in enumerate((best - evidence).tolist()):
        known = not np.isnan(below)
        _, _, colour, letters = next(
            one for one in CLASSES[int(below > 0) :] if not known or round(below, 1) <= one[0]
        )
        style = {"facecolor": colour, "edgecolor": "#C8C8C8"} if known else _HIDDEN
        ax.add_patch(
            Rectangle((j - 0.5, at - 0.5), 1.0, 1.0, clip_on=False, linewidth=0.4, **style)
        )
        if numbers and known:
            number = (
                "best"
                if below == 0
                else f"{below:.1f}"
                if below < 99.95
                else f"{below:.0f}"
                if np.isfinite(below)
                else "∞"
            )
            weight = "bold" if below == 0 else "normal"
            ax.text(
                j,
                at,
                number,
                ha="center",
                va="center_baseline",
                fontsize=_CELL,
                color=letters,
                weight=weight,
            )


def _name_classes(ax: Axes, table: ModelComparison) -> None:
    """Keys of the cells, below them; of withheld evidences where there are any."""
    handles = [
        Patch(label=label, facecolor=colour, edgecolor="#C8C8C8", linewidth=0.4)
        for _, label, colour, _ in CLASSES
    ]
    if np.isnan(table.weighed).any():
        handles.append(Patch(label="withheld: subject not counted", linewidth=0.4, **_HIDDEN))
    style = _LEGEND | {
        "title": "log evidence below the subject's best model (nats)",
        "title_fontsize": LETTERS,
    }
    columns = len(handles) if len(table.models) > 6 else 3
    ax.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=columns, **style
    )


# --- the study ----------------------------------------------------------------------------------------------------------------------


def _draw_study(ax: Axes, table: ModelComparison) -> None:
    """Frequencies of the models, or the model probabilities of a single subject, or why there are neither."""
    found, alone, even = table.frequencies(), len(table.subjects) == 1, 1.0 / len(table.models)
    shares = np.array([row.model_probability for row in table], np.float64)
    said = ""
    if alone and np.isnan(shares).any():
        said = "no model probabilities: an evidence is withheld"
    elif alone:
        label = "model probability, equal prior odds"
        ax.plot(
            np.arange(len(shares)),
            shares,
            "o",
            ms=5,
            color=STRONGER_FIRST,
            clip_on=False,
            label=label,
        )
        ax.set_ylabel("probability")
    elif found is None:
        why = (
            "one model only"
            if len(table.models) < 2
            else "no subject has an evidence under every model"
        )
        said = f"no model frequencies:\n{why}"
    else:
        _draw_frequencies(ax, table, found)
    if said:
        ax.tick_params(left=False, labelleft=False)
        ax.text(
            0.5,
            0.5,
            said,
            transform=ax.transAxes,
            ha="center",
            va="center",
            fontsize=SMALL,
            color=EQUAL,
        )
    else:  # where every model would be if none were preferred; shading parts the models
        ax.axhline(even, color=EQUAL, lw=0.8, ls=":", zorder=1, label="none preferred")
        for j in range(1, len(table.models), 2):
            ax.axvspan(j - 0.5, j + 0.5, color="#F3F3F3", lw=0, zorder=0)
    ax.set(xlim=(-0.5, len(table.models) - 0.5), ylim=(0.0, 1.0), yticks=[0.0, 0.5, 1.0])
    ax.set_xticks(range(len(table.models)), [_broken(name) for name in table.models])
    dress(ax).tick_params(axis="x", length=0)


def _draw_frequencies(ax: Axes, table: ModelComparison, found: ModelFrequencies) -> None:
    """Frequencies of all models, of how many subjects, and the probability that all are equally frequent."""
    x = np.arange(len(found.models))
    style: dict[str, Any] = {"ms": 4.5, "mew": 1.1, "clip_on": False}
    ax.vlines(x - _SHIFT, *found.interval(_LEVEL).T, color=STRONGER_FIRST, lw=1.2)
    ax.plot(
        x - _SHIFT,
        found.expected,
        "o",
        color=STRONGER_FIRST,
        label=f"expected frequency, {100 * _LEVEL:g} % interval",
        **style,
    )
    ax.plot(
        x,
        found.exceedance,
        "s",
        mfc="white",
        color=WEAKER_FIRST,
        label="most frequent (exceedance)",
        **style,
    )
    ax.plot(
        x + _SHIFT,
        found.protected,
        "D",
        color="black",
        label="the same, protected",
        **style | {"ms": 3.8},
    )
    risk = (
        f"{found.omnibus_risk:.2f}"
        if found.omnibus_risk >= 0.01
        else f"{found.omnibus_risk:.1g}".replace("-", "−")
    )
    who = f"{len(found.subjects)} of {len(table.subjects)} subjects, random effects, sampled"
    ax.set_title(
        f"{who}\nall models equally frequent with probability {risk}", loc="left", fontsize=SMALL
    )
    ax.set_ylabel("frequency, probability")


# --- parts --------------------------------------------------------------------------------------------------------------------------


def _draw_part(ax: Axes, table: ModelComparison, found: PartTable) -> None:
    """Probabilities (%) of the levels of one part, one bar a subject."""
    places, colours = _row_places(table), ORDER_COLOURS if found.part == "order" else OTHER_COLOURS
    rows = [*found.probability, *([] if found.study is None else [found.study])]
    least = _NEEDED / _part_width(found) if len(rows) <= _MOST_ROWS else 2.0
    for at, shares in zip(places, rows, strict=True):
        if np.isnan(shares).any():
            ax.barh(at, 1.0, height=0.82, lw=0.5, **_HIDDEN)
            continue
        for left, share, (colour, letters) in zip(
            np.cumsum(shares) - shares, shares, colours, strict=False
        ):
            ax.barh(
                at, share, left=left, height=0.82, lw=0.5, facecolor=colour, edgecolor="#8C8C8C"
            )
            if share >= least:
                ax.text(
                    left + 0.5 * share,
                    at,
                    f"{100 * share:.0f}",
                    ha="center",
                    va="center_baseline",
                    fontsize=_CELL,
                    color=letters,
                )
    ax.set_yticks(places, [*(plain(name, 16) for name in table.subjects), STUDY][: len(places)])
    _dress_rows(ax, places)
    keys = zip(found.levels, colours, strict=False)
    handles = [
        Patch(facecolor=colour, edgecolor="#8C8C8C", lw=0.5, label=level)
        for level, (colour, _) in keys
    ]
    style = _LEGEND | {
        "handlelength": 1.0,
        "columnspacing": 0.9,
        "title": found.part,
        "title_fontsize": LETTERS,
        "borderpad": 0.0,
    }
    ax.legend(
        handles=handles,
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=min(3, len(handles)),
        **style,
    )


def _draw_best(ax: Axes, table: ModelComparison) -> None:
    """In words, the best composition of each subject; bold: p below 0.01, or a composition that free frequencies beat."""
    best, places = table.best_compositions(), _row_places(table)
    heads = (
        (0.0, "left", "best composition"),
        (0.76, "right", "less H0"),
        (1.0, "right", "fit $p$"),
    )
    for name, at in zip(table.subjects, places, strict=False):
        row, against = best.get(name, (None, None))
        fit = None if row is None else row.checks.p_predictive
        words = (
            "withheld" if row is None else row.model,
            "–" if against is None else f"{against:+.1f}".replace("-", "−"),
            "–"
            if fit is None
            else f"{fit:.2f}"
            if fit >= MISFIT
            else "misfit"
            if fit < 0.001
            else f"misfit {fit:.1g}",
        )
        bad = (False, against is not None and against < 0, fit is not None and fit < MISFIT)
        for (x, side, _), text, bold in zip(heads, words, bad, strict=True):
            ax.text(
                x,
                at,
                text,
                ha=side,
                va="center_baseline",
                fontsize=_CELL,
                weight="bold" if bold else "normal",
            )
    if len(places) > len(table.subjects):
        words_below = f"a new subject, random effects over {table.parts[0].counted} subjects"
        ax.text(0.0, places[-1], words_below, va="center_baseline", fontsize=_CELL, color=EQUAL)
    for x, side, head in heads:
        ax.text(x, -0.75, head, ha=side, va="bottom", fontsize=SMALL)
    ax.set_yticks([])
    _dress_rows(ax, places)


def _row_places(table: ModelComparison) -> list[float]:
    """Heights of the rows of all subjects, and of the study."""
    places = [float(i) for i in range(len(table.subjects))]
    study = bool(table.parts) and table.parts[0].study is not None
    return [*places, len(places) + _BETWEEN] if study else places


def _dress_rows(ax: Axes, places: list[float]) -> None:
    ax.set(xlim=(0.0, 1.0), ylim=(places[-1] + 0.5, -0.5), xticks=[])
    dress(ax).tick_params(length=0)
    ax.spines[:].set_visible(False)


# --- sizes, inches ------------------------------------------------------------------------------------------------------------------


def _cells_height(table: ModelComparison) -> float:
    counted = (~np.isnan(table.weighed).any(axis=1)).sum()
    return _ROW * (min(len(table.subjects), _MOST_ROWS) + (1.0 + _BETWEEN if counted > 1 else 0.0))


def _part_width(part: PartTable) -> float:
    return 1.65 if len(part.levels) == 2 else 2.6


def _bars_height(table: ModelComparison) -> float:
    """Of the rows of all subjects and the study, and what stands above them."""
    return (
        _ROW * (_row_places(table)[-1] + 1.0)
        + 0.3
        + 0.15 * max((-(-len(part.levels) // 3) for part in table.parts), default=0)
    )


def _broken(name: str) -> str:
    """A model's name as a narrow column heads it."""
    first, *others = name.split(" + ")
    return "\n".join(
        chain.from_iterable(
            wrap(part, 11, break_long_words=False)
            for part in (first, *(f"+ {one}" for one in others))
        )
    )
