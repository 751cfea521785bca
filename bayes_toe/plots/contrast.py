"""Figure of the differences between conditions of all subjects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.answers.contrast import (
    ORDER_EFFECT,
    ContrastTable,
    Difference,
    observer_name,
)
from bayes_toe.answers.words import Word
from bayes_toe.data.stimulus_unit import UNKNOWN_UNIT, StimulusUnit
from bayes_toe.errors import require_kind
from bayes_toe.plots.style import (
    EQUAL,
    LETTERS,
    MAX_NAMES,
    PAGE,
    POSTERIOR,
    UNNAMED_HEIGHT,
    draw_intervals,
    legend_outside,
    name_rows,
    new_figure,
    plain,
    quantity_ticks,
    zero_line,
)

_NO_DIFFERENCE = "no difference, or probably none"
#: Face of the mark, colour, and words of the legend.
_MARKS = {
    Word.YES: (POSTERIOR, POSTERIOR, "differs"),
    Word.PROBABLY: ("#9CC4E4", POSTERIOR, "probably differs"),
    Word.UNDECIDED: ("white", EQUAL, "undecided"),
    Word.PROBABLY_NOT: ("#C9C9C9", EQUAL, _NO_DIFFERENCE),
    Word.NO: ("#C9C9C9", EQUAL, _NO_DIFFERENCE),
}


def contrast(table: ContrastTable, *, synthetic: bool = False) -> Figure:
    """Draw the differences between conditions of every subject. The marker shows the word.

    A row of panels for each comparison; median and 95 % interval if the quantity differs.

    Parameters
    ----------
    table : ContrastTable
    synthetic : bool
        Whether the subjects are simulated, which the title then says.
    """
    require_kind("table", table, ContrastTable, "ContrastTable")
    quantities = [name for name in table.quantities if name != ORDER_EFFECT]
    comparisons = [f"{level} - {reference}" for level, reference in table.conditions.comparisons]
    n_subjects = len(table.subjects)
    # Inches, 0.16 for a subject.
    if n_subjects > MAX_NAMES:
        panel_height = 0.6 * UNNAMED_HEIGHT  # lower, because several comparisons share the page
    else:
        panel_height = max(0.7, 0.16 * n_subjects)
    # 0.7 for title and legend, and 0.9 for the axis and label of each panel.
    figure = new_figure(PAGE, 0.7 + (0.9 + panel_height) * len(comparisons))
    panels = figure.subplots(len(comparisons), len(quantities), squeeze=False, sharey="row")
    for (i, j), ax in np.ndenumerate(panels):
        quantity = quantities[j]
        comparison = comparisons[i]
        rows = table.select(quantity, comparison)
        # In the unknown unit, intervals are per cents, and from these follows the unit shown.
        # The intervals of a contraction are shares, too small to change the unit.
        percents = [row.interval(UNKNOWN_UNIT) for row in rows]
        unit = table.unit.with_logs_if_large(percents)
        _draw_subjects(ax, table, rows, unit)

        quantity_ticks(ax, observer_name(quantity))
        # A contraction is a share.
        unit_name = "%" if quantity == "contraction" else unit.difference_unit
        label = f"{quantity} ({unit_name}),\n{plain(comparison)}"
        ax.set_xlabel(label.replace(" - ", " − "), fontsize=LETTERS)

    title = f"What differs by {plain(table.conditions.name)}"
    if synthetic:
        title += " (synthetic data)"
    title += ": median and 95 % interval if it differs"
    if len(comparisons) > 1:
        title += "\nmarks: whether it differs between any of the conditions"
    figure.suptitle(title, fontsize=LETTERS + 1.0)

    legend_outside(figure, columns=len(_MARKS))
    return figure


def _draw_subjects(
    ax: Axes, table: ContrastTable, rows: Sequence[Difference], unit: StimulusUnit
) -> None:
    """Draw one quantity of every subject; more subjects than have names are sorted by size."""
    if len(table.subjects) > MAX_NAMES:
        subjects = [row.subject for row in sorted(rows, key=lambda row: row.q50)]
        names = []
    else:
        subjects = list(table.subjects)
        names = [plain(name, limit=16) for name in subjects]

    zero_line(ax)
    # The legend explains each word of the table, which this panel may lack.
    words = {row.word for row in table}
    for word, (face, colour, label) in _MARKS.items():
        if word not in words:
            continue
        rows_of_word = [row for row in rows if row.word == word]
        y = [subjects.index(row.subject) for row in rows_of_word]
        # (rows of this word, 3); a word that no row has draws nothing but an entry of the legend.
        quantiles = np.array([row.interval(unit) for row in rows_of_word]).reshape(-1, 3)
        draw_intervals(ax, y, quantiles.T, colour=colour, line=1.0, mfc=face, mew=0.7, label=label)
    name_rows(ax, len(subjects), names)
