"""Differences between conditions: of every subject, one below the other; and the curves of one subject condition by condition."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.comparison.contrast import ORDER_EFFECT, WORDS, ContrastTable, Difference
from bayes_toe.data.study import Study
from bayes_toe.errors import InputError
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.ladder import model_named
from bayes_toe.model.record import Model
from bayes_toe.plots.curves import main_weaker, order_panel, which_weaker
from bayes_toe.plots.style import (
    BELIEF,
    EQUAL,
    HIGH,
    LETTERS,
    MOST_NAMED,
    PAGE,
    POSTERIOR,
    SMALL,
    chance,
    dress,
    first_panels,
    legend_below,
    new_figure,
    plain,
)

#: Low, middle and high of the group's mean difference, by quantity and comparison.
Group = Mapping[tuple[str, str], tuple[float, float, float]]
_UNITS = {"constant error": "ln intensity", "pull": "no unit", "width": "ln intensity"}
#: How a difference is drawn by its word: face of the mark, colour, words of the legend.
_MARKS = {
    WORDS[0]: (POSTERIOR, POSTERIOR, WORDS[0]),
    WORDS[1]: ("#9CC4E4", POSTERIOR, WORDS[1]),
    WORDS[2]: ("white", EQUAL, WORDS[2]),
    WORDS[3]: ("#C9C9C9", EQUAL, "no difference, or probably none"),
    WORDS[4]: ("#C9C9C9", EQUAL, "no difference, or probably none"),
    "": ("white", "#C9C9C9", "no evidence"),
}
_MOST_PANELS = 6


def contrast_figure(
    table: ContrastTable, group: Group | None = None, *, synthetic: bool = False
) -> Figure:
    """Every subject's difference in every quantity, 5, 50 and 95 % if it differs, marked by its word; a row of panels a comparison.

    Parameters
    ----------
    table : ContrastTable
    group : mapping, optional
        5, 50 and 95 % of the group's mean difference by quantity and comparison: a band.
    synthetic : bool
        Whether the title says so.
    """
    quantities = [name for name in table.quantities if name != ORDER_EFFECT]
    comparisons = [f"{level} - {reference}" for level, reference in table.conditions.comparisons]
    subjects = [one.subject for one in table.subjects]
    height = 0.9 + (0.6 * HIGH if len(subjects) > MOST_NAMED else max(0.7, 0.16 * len(subjects)))
    figure = new_figure(PAGE, 0.7 + height * len(comparisons))
    panels = first_panels(
        figure.add_gridspec(len(comparisons), len(quantities)), len(comparisons) * len(quantities)
    )
    for i, ax in enumerate(panels):
        comparison, quantity = comparisons[i // len(quantities)], quantities[i % len(quantities)]
        _forest(
            ax,
            table.some(quantity, comparison),
            subjects,
            None if group is None else group.get((quantity, comparison)),
        )
        ax.set_xlabel(
            f"{quantity}, {plain(comparison)} ({_UNITS[quantity]})".replace(" - ", " − "),
            fontsize=LETTERS,
        )
        ax.tick_params(labelleft=i % len(quantities) == 0)
    made = " (synthetic data)" if synthetic else ""
    marks = (
        "\nmarks: whether it differs between any of the conditions" if len(comparisons) > 1 else ""
    )
    figure.suptitle(
        f"What differs by {plain(table.conditions.name)}{made}: 5, 50 and 95 % if it differs{marks}",
        fontsize=LETTERS + 1.0,
    )
    words = {row.word for row in table}
    for face, colour, label in (mark for word, mark in _MARKS.items() if word in words):
        panels[0].plot([], [], "o", ms=3.4, mfc=face, mec=colour, mew=0.7, label=label)
    legend_below(figure, size=SMALL, columns=len(_MARKS))
    return figure


def _forest(
    ax: Axes,
    rows: Sequence[Difference],
    subjects: Sequence[str],
    group: tuple[float, float, float] | None,
) -> None:
    """One quantity of every subject, sorted where they are too many for their names."""
    named = len(subjects) <= MOST_NAMED
    shown = list(rows) if named else sorted(rows, key=lambda row: row.q50)
    y = np.array([subjects.index(row.subject) for row in shown]) if named else np.arange(len(shown))
    if group is not None:
        ax.axvspan(group[0], group[2], color="#BDB3DD", lw=0, label="group's mean (5-50-95 %)")
        ax.axvline(group[1], color=BELIEF, lw=0.9)
    ax.axvline(0.0, color=EQUAL, lw=0.8, ls=":")
    low, middle, high = np.array([(row.q05, row.q50, row.q95) for row in shown]).reshape(-1, 3).T
    faces, colours = ([_MARKS[row.word][place] for row in shown] for place in (0, 1))
    ax.hlines(y, low, high, colors=colours, lw=1.0)
    ax.scatter(middle, y, 3.4**2, faces, edgecolors=colours, linewidths=0.7, zorder=2)
    ax.set_yticks(
        y if named else [],
        [plain(row.subject, 16) for row in shown] if named else [],
        fontsize=SMALL,
    )
    ax.set_ylim(len(subjects) - 0.4, -0.6)
    ax.locator_params(axis="x", nbins=4)
    dress(ax).tick_params(axis="y", length=0)


def contrast_curves(study: Study, table: ContrastTable, subject: str) -> Figure:
    """The answers of one subject in every condition beside each other, with the curves of the joint fit, averaged over what differs.

    Raises
    ------
    InputError
        If the subject has no contrast.
    """
    found = next((one for one in table.subjects if one.subject == subject), None)
    record = model_named(table.model, table.task)
    if found is None or not isinstance(record, Model):
        raise InputError(
            f"no contrast of subject {subject!r}; there are: {', '.join(one.subject for one in table.subjects)}"
        )
    units = [one for one in study if one.person == subject and one.condition in found.levels][
        :_MOST_PANELS
    ]
    figure = new_figure(PAGE, 3.2)
    panels = first_panels(figure.add_gridspec(1, len(units)), len(units), sharey=True)
    for unit, ax in zip(units, panels, strict=True):
        x, weaker = found.x[:, found.levels.index(unit.condition)], main_weaker(unit)
        fitted = Predictor(record.posterior(unit, table.prior), x)
        order_panel(ax, unit, fitted.yes, 0.0 if weaker is None else weaker, size=4.0)
        said = which_weaker(unit, weaker)
        ax.set_title(
            f"{plain(table.conditions.name)} {plain(unit.condition)}"
            + (f"\n{said}" if said else ""),
            fontsize=LETTERS,
        )
        dress(ax)
    panels[0].set_ylabel(chance(table.task))
    figure.suptitle(
        plain(subject) + (" (synthetic data)" if study.synthetic else ""), fontsize=LETTERS + 1.0
    )
    legend_below(figure, size=LETTERS)
    return figure
