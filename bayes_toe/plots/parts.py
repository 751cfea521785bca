"""Which level each part of a model has, subject by subject: bars of probabilities, and the best composition in words beside them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.model_comparison import STUDY, ModelComparison, PartTable
from bayes_toe.errors import InputError
from bayes_toe.inference.predictive_checks import MISFIT
from bayes_toe.plots.style import EQUAL, LETTERS, SMALL, dress, panel, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Colours of levels and of the letters on them, told apart by their lightness too: of the order part, and of the others.
ORDER_COLOURS = (("#E9E9E9", "black"), ("#E5A84B", "black"), ("#0B3C74", "white"), ("#C0628F", "black"), ("#3F7F5F", "white"))
OTHER_COLOURS = (("#E9E9E9", "black"), ("#5F8F8B", "black"), ("#1F4E4A", "white"))
ROW, BETWEEN = 0.17, 0.45  # inches of a row; rows between the subjects and the study
WORDS = 3.2  # inches of the panel of words
_CELL = 6.5  # points of a number
_NEEDED = 0.23  # inches of a bar that holds its number
_MOST_ROWS = 600  # beyond, rows get narrower and lose their letters
_HEADS = ((0.0, "left", "best composition"), (0.76, "right", "less H0"), (1.0, "right", "fit $p$"))


def part_axes(table: ModelComparison, part: str, ax: Axes | None = None) -> Axes:
    """Probabilities (%) of the levels of one part, one bar a subject, averaged over the other parts; hatched where evidence is withheld.

    The row set apart, '*', is that of a new subject, by random effects over families of models.

    Parameters
    ----------
    table : ModelComparison
    part : str
        One that varies among the compositions compared: order, noise, lapses, curve or spread.
    ax : matplotlib Axes, optional

    Raises
    ------
    InputError
        If the part does not vary.
    """
    found = next((one for one in table.parts if one.part == part), None)
    if found is None:
        raise InputError(f"part {part!r}: allowed are those that vary among the models compared: {[one.part for one in table.parts]}")
    ax = panel(ax, wide=part_width(found) + 0.9, high=rows_height(table) + heads_height(table))
    places = _row_places(table)
    colours = ORDER_COLOURS if part == "order" else OTHER_COLOURS
    rows = [*found.probability, *([] if found.study is None else [found.study])]
    for at, shares in zip(places, rows, strict=True):
        _draw_bar(ax, at, shares, colours, _NEEDED / part_width(found) if len(rows) <= _MOST_ROWS else 2.0)
    labels = [*(plain(name, 16) for name in table.subjects), STUDY][: len(places)]
    ax.set_yticks(places, labels)
    _dress_rows(ax, places)
    _name_levels(ax, found, colours)
    return ax


def best_axes(table: ModelComparison, ax: Axes | None = None) -> Axes:
    """In words, the best composition of each subject, its log evidence less that of free frequencies (nats), its posterior predictive p.

    Bold where it does not describe the answers: p below 0.01, or a composition that free frequencies beat.
    """
    ax = panel(ax, wide=WORDS, high=rows_height(table) + heads_height(table))
    best, places = table.best_compositions(), _row_places(table)
    for name, at in zip(table.subjects, places, strict=False):
        row, against = best.get(name, (None, None))
        fit = None if row is None else row.checks.p_predictive
        words = (
            "withheld" if row is None else row.model,
            "–" if against is None else f"{against:+.1f}".replace("-", "−"),
            "–" if fit is None else f"{fit:.2f}" if fit >= MISFIT else "misfit" if fit < 0.001 else f"misfit {fit:.1g}",
        )
        bad = (False, against is not None and against < 0, fit is not None and fit < MISFIT)
        for (x, side, _), text, bold in zip(_HEADS, words, bad, strict=True):
            ax.text(x, at, text, ha=side, va="center_baseline", fontsize=_CELL, weight="bold" if bold else "normal")
    if len(places) > len(table.subjects):
        counted = table.parts[0].counted
        ax.text(
            0.0, places[-1], f"a new subject, random effects over {counted} subjects", va="center_baseline", fontsize=_CELL, color=EQUAL
        )
    for x, side, head in _HEADS:
        ax.text(x, -0.75, head, ha=side, va="bottom", fontsize=SMALL)
    ax.set_yticks([])
    _dress_rows(ax, places)
    return ax


def part_width(part: PartTable) -> float:
    """Inches of the bars of one part."""
    return 1.65 if len(part.levels) == 2 else 2.6


def rows_height(table: ModelComparison) -> float:
    """Inches of the rows of all subjects and the study."""
    return ROW * (_row_places(table)[-1] + 1.0)


def heads_height(table: ModelComparison) -> float:
    """Inches of what stands above the rows."""
    return 0.3 + 0.15 * max((-(-len(part.levels) // 3) for part in table.parts), default=0)


def _row_places(table: ModelComparison) -> list[float]:
    places = [float(i) for i in range(len(table.subjects))]
    study = bool(table.parts) and table.parts[0].study is not None
    return [*places, len(places) + BETWEEN] if study else places


def _draw_bar(ax: Axes, at: float, shares: FloatArray, colours: tuple[tuple[str, str], ...], least: float) -> None:
    style: dict[str, Any] = {"height": 0.82, "lw": 0.5}
    if np.isnan(shares).any():
        ax.barh(at, 1.0, facecolor="white", edgecolor=EQUAL, hatch="//////", **style)
        return
    for left, share, (colour, letters) in zip(np.cumsum(shares) - shares, shares, colours, strict=False):
        ax.barh(at, share, left=left, facecolor=colour, edgecolor="#8C8C8C", **style)
        if share >= least:
            ax.text(left + 0.5 * share, at, f"{100 * share:.0f}", ha="center", va="center_baseline", fontsize=_CELL, color=letters)


def _dress_rows(ax: Axes, places: list[float]) -> None:
    ax.set(xlim=(0.0, 1.0), ylim=(places[-1] + 0.5, -0.5), xticks=[])
    dress(ax).tick_params(length=0)
    ax.spines[:].set_visible(False)


def _name_levels(ax: Axes, part: PartTable, colours: tuple[tuple[str, str], ...]) -> None:
    """The part and its levels above the bars."""
    from matplotlib.patches import Patch

    handles = [
        Patch(facecolor=colour, edgecolor="#8C8C8C", lw=0.5, label=level) for level, (colour, _) in zip(part.levels, colours, strict=False)
    ]
    style: dict[str, Any] = {"frameon": False, "fontsize": SMALL, "handlelength": 1.0, "handletextpad": 0.4, "columnspacing": 0.9}
    style |= {"title": part.part, "title_fontsize": LETTERS, "borderaxespad": 0.3, "borderpad": 0.0}
    ax.legend(handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=min(3, len(handles)), **style)
