"""Forest plot of PSE shift and contraction of every subject, with the group: `order_effect`.

:data:`QUESTION_STYLES` has the colours and markers of the two effects.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.answers.evidence_table import EvidenceTable
from bayes_toe.answers.group_answer import mean_word
from bayes_toe.answers.order_effect import SIZE_OF, OrderEffect
from bayes_toe.answers.words import Word
from bayes_toe.arrays import FloatArray
from bayes_toe.data.messages import plural
from bayes_toe.data.stimulus_unit import StimulusUnit
from bayes_toe.errors import require_kind
from bayes_toe.groups.population import PopulationResult
from bayes_toe.plots.style import (
    EQUAL,
    LETTERS,
    MAX_NAMES,
    PAGE,
    SMALL,
    UNNAMED_HEIGHT,
    Style,
    draw_intervals,
    name_rows,
    new_figure,
    plain,
    quantity_ticks,
    write_note,
    zero_line,
)


class QuestionStyle(NamedTuple):
    """How the forest of an effect looks, and the name of its size in the table of a group."""

    name: str
    colour: str
    marker: str
    group_size: str
    title: str
    axis: str


#: The colours differ in lightness too.
QUESTION_STYLES = (
    QuestionStyle(
        "constant_error",
        "#00805D",
        "s",
        "pse_shift_percent",
        "Constant error: PSE shift",
        "PSE shift ({unit})\nabove 0: first stimulus overestimated",
    ),
    QuestionStyle(
        "contraction",
        "#C06A9B",
        "D",
        "contraction",
        "Contraction",
        "% of the way to the mean\nbelow 0: repulsion",
    ),
)
#: How much of a marker is filled, by the word; other words have no size.
_FILLS = {
    Word.YES: "full",
    Word.PROBABLY: "left",
    Word.UNDECIDED: "none",
    Word.PROBABLY_NOT: "none",
    Word.NO: "none",
}


def order_effect(
    table: EvidenceTable, group: PopulationResult | None = None, *, synthetic: bool = False
) -> Figure:
    """Draw PSE shift and contraction of every subject, and of the group in the last row.

    Points are posterior medians with 95 % intervals, averaged over the models that have the effect.
    A marker is full for the word 'yes', half for 'probably', and empty otherwise. The words stand
    right of the rows. More than 60 subjects have neither names nor words, and are sorted by the
    Bayes factor of an order effect.

    Parameters
    ----------
    table : EvidenceTable
    group : PopulationResult, optional
        Its means with 95 % intervals stand in the last row.
    synthetic : bool
        Whether the subjects are simulated, which the figure then states.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> table = bt.evidence(study, seed=1)                        # doctest: +SKIP
    >>> bt.plots.order_effect(table, bt.population(study, seed=1))  # doctest: +SKIP
    """
    require_kind("table", table, EvidenceTable, "EvidenceTable")
    figure = new_figure(PAGE, forest_height(len(table)))
    forests(figure.subplots(1, 2, sharey=True), table, group)
    if synthetic:
        figure.suptitle("synthetic data", fontsize=LETTERS)
    return figure


def forest_height(subjects: int) -> float:
    """Inches that a figure of so many subjects needs, with 1.2 for title and labels."""
    if subjects > MAX_NAMES:
        return 1.2 + UNNAMED_HEIGHT
    return 1.2 + 0.17 * (subjects + 2)  # two rows for the group


def forests(panels: Sequence[Axes], table: EvidenceTable, group: PopulationResult | None) -> None:
    """Draw PSE shifts and contractions, a row a subject, into two panels.

    Rows are at 0, 1, ... from above; the group is in the last row.
    """
    answers = list(table.answers)
    names = []  # of the last rows
    is_crowded = len(answers) > MAX_NAMES
    if is_crowded:
        answers.sort(key=lambda answer: -answer.log_bayes_factors["order_effect"])
        label = f"{len(answers):,} subjects, sorted by the Bayes factor of an order effect"
        panels[0].set_ylabel(label, fontsize=LETTERS)
    else:
        names = [plain(answer.subject, limit=20) for answer in answers]
    if group is not None:
        reliable = "" if group.is_reliable else "\nNOT RELIABLE"
        names.append(f"group of {len(group.subjects)}{reliable}")

    n_rows = len(answers) + (group is not None)
    for ax, question in zip(panels, QUESTION_STYLES, strict=True):
        words = [answer.words[question.name] for answer in answers]
        sizes, unit = _sizes(answers, group, question)
        _draw_sizes(ax, words, sizes, question)
        if group is not None:
            ax.axhline(len(answers) - 0.5, color=EQUAL, lw=0.5)  # between subjects and group
            if question.name in group.identified:
                draw_intervals(
                    ax,
                    len(answers),
                    sizes[-1],
                    colour=question.colour,
                    line=2.2,
                    marker="d",
                    ms=8.0,
                    mec="black",
                    mew=0.6,
                    fillstyle=_FILLS[mean_word(group, question.name)],
                    markerfacecoloralt="white",
                )
        zero_line(ax)
        start, end = _limits(sizes)
        low, _, high = sizes.T  # A row without a size has NaN, which is not beyond any limit.
        n_cut = int(np.sum((low < start) | (high > end)))
        if n_cut:
            write_note(ax, f"{plural(n_cut, 'interval')} beyond the panel")

        title = question.title
        if is_crowded:
            title += f"\n{words.count(Word.YES)} yes, {words.count(Word.PROBABLY)} probably"
        ax.set_title(title, loc="left", fontsize=LETTERS)
        label = question.axis.format(unit=unit.difference_unit)
        ax.set(xlabel=label, xlim=(start, end))
        name_rows(ax, n_rows, names)
        quantity_ticks(ax, question.name)

        if is_crowded:
            continue
        # Words stand right of the panel, whose width is 1, at the height of their row.
        transform = ax.get_yaxis_transform()
        for row, answer in enumerate(answers):
            line = answer.lines[question.name]
            ax.text(
                1.02,
                row,
                line.word + line.marks,
                transform=transform,
                va="center",
                fontsize=SMALL,
            )


def _sizes(
    answers: Sequence[OrderEffect], group: PopulationResult | None, question: QuestionStyle
) -> tuple[FloatArray, StimulusUnit]:
    """Sizes of the subjects and, in the last row, of the group; and the unit of constant errors.

    The sizes have the shape (subjects + 1, 3). The columns are low end, median and high end of the
    95 % interval; NaN where there is no size.
    """
    sizes = np.full((len(answers) + 1, 3), np.nan)
    for row, answer in enumerate(answers):
        if answer.words[question.name] in _FILLS:  # another word has no size
            sizes[row] = answer.sizes[SIZE_OF[question.name]]
    # All subjects of a study have the same unit. Sizes are in per cent so far. If the axis would
    # need per cents that are too large, it has natural logs.
    unit = answers[0].unit.with_logs_if_large(_limits(sizes))

    if group is not None and question.name in group.identified:
        sizes[-1] = group.table.row("mean", question.group_size).interval
    if question.name == "constant_error":
        sizes = unit.from_percent(sizes)
    return sizes, unit


def _draw_sizes(
    ax: Axes, words: Sequence[Word], sizes: FloatArray, question: QuestionStyle
) -> None:
    """Draw the sizes of subjects, with markers filled by the word.

    `sizes` are those of :func:`_sizes`. The line of a 'yes' or 'probably' is twice as thick as
    other lines.
    """
    colour = question.colour
    marker_size = 2.5 if len(words) > MAX_NAMES else 4.5
    style: Style = {"marker": question.marker, "ms": marker_size, "markerfacecoloralt": "white"}
    for word, fill in _FILLS.items():
        rows = [row for row, word_of_row in enumerate(words) if word_of_row is word]
        if rows:
            width = marker_size * (0.3 if word.is_positive else 0.15)
            draw_intervals(
                ax, rows, sizes[rows].T, colour=colour, line=width, fillstyle=fill, **style
            )


def _limits(sizes: FloatArray) -> tuple[float, float]:
    """Limits of an axis that holds 0, every median and ordinary intervals.

    `sizes` are those of :func:`_sizes`. An interval is cut if it
    extends farther from all medians than twice the ordinary width.
    """
    sizes = sizes[~np.isnan(sizes[:, 1])]  # without rows that have no size
    if len(sizes) == 0:
        return -1.0, 1.0
    low, median, high = sizes.T
    margin = 2.0 * np.median(high - low)  # twice the ordinary width
    start = min(0.0, max(low.min(), median.min() - margin))
    end = max(0.0, min(high.max(), median.max() + margin))
    pad = 0.05 * (end - start)
    return start - pad, end + pad
