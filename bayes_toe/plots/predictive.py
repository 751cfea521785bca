"""Posterior predictive checks: observed proportions and their 95 % predictive intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.analysis import Analysis
from bayes_toe.arrays import FloatArray, IndexArray
from bayes_toe.classical.frequencies import presentation_order
from bayes_toe.data.study import Subject, name_list
from bayes_toe.errors import InputError, require_kind
from bayes_toe.inference.prediction import Predictor
from bayes_toe.plots.style import (
    BAD,
    COLUMN,
    LETTERS,
    MARKED_QUANTILES,
    PAGE,
    Style,
    grid_panels,
    grid_rows,
    label_outer,
    legend_outside,
    new_figure,
    plain,
    rows_by_order,
)
from bayes_toe.seeds import generator

#: Subjects that a page has room for.
MOST_SUBJECTS = 40
_PAIR = 0.15  # inches of a pair that has a label
_TITLE_AND_LEGEND = 1.0  # inches
_INTERVAL = "#C8C8C8"  # colour of the predictive intervals


def posterior_predictive(analysis: Analysis, subjects: Sequence[str] | None = None) -> Figure:
    """Draw the observed proportion and the 95 % predictive interval of every ordered pair.

    The interval is that of a replicated study under the average of the four models. A model that
    describes a subject leaves about one pair in twenty outside; these have a red ring.

    Parameters
    ----------
    analysis : Analysis
    subjects : sequence of str, optional
        By default all subjects of the study, of which there may be 40.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        For an unknown subject, or more than 40 subjects.
    """
    require_kind("analysis", analysis, Analysis, "Analysis")
    names = analysis.study.names if subjects is None else name_list(subjects)
    n_subjects = len(names)
    if not 1 <= n_subjects <= MOST_SUBJECTS:
        raise InputError(
            f"subjects: found {n_subjects}, allowed: 1 to {MOST_SUBJECTS}; "
            "choose some, as in subjects=['S01', 'S02']"
        )
    selected_subjects = [analysis.study[name] for name in names]
    # A few subjects have one row of panels, which are higher for more pairs. Many subjects have
    # small panels.
    has_room = n_subjects <= 4
    if has_room:
        n_columns = n_subjects
        n_pairs = max(subject.n_pairs for subject in selected_subjects)
        # Inches of a panel: at least what can be read, at most what a page has room for.
        height = min(max(_PAIR * n_pairs, 1.2), 6.0)
    else:
        n_columns = 5
        height = 1.0

    width = COLUMN if n_columns == 1 else PAGE
    figure = new_figure(width, grid_rows(n_subjects, n_columns) * height + _TITLE_AND_LEGEND)
    # The legend of a subfigure stands below the title of its figure.
    subfigure: Any = figure.subfigures()  # a single subfigure
    panels = grid_panels(subfigure, n_subjects, n_columns, sharex=True)
    for ax, subject in zip(panels, selected_subjects, strict=True):
        # The pair in each row: weaker first to stronger first, and then by their intensity.
        pair_of_row = np.lexsort((subject.s1 + subject.s2, presentation_order(subject)))
        _draw_subject(ax, analysis, subject, pair_of_row, has_room=has_room)
        if has_room and _PAIR * subject.n_pairs <= height:
            _label_pairs(ax, subject, pair_of_row)
    label_outer(panels, n_columns)
    # The legend has five entries at most; beside a single panel there is room for two in a row.
    legend_outside(subfigure, columns=2 if n_columns == 1 else 5, side="upper")
    if analysis.study.synthetic:
        figure.suptitle("synthetic data", fontsize=LETTERS)
    return figure


def predictive_interval(fitted: Predictor, seed: int) -> FloatArray:
    """Ends of the 95 % posterior predictive interval of every pair's share, shape (2, pairs)."""
    subject = fitted.target.subject
    log_yes, *_ = fitted.target.log_answers(fitted.x)  # of the counted answer, (draws, pairs)
    p_yes = np.exp(log_yes)
    rng = generator(seed, subject.name, "posterior predictive interval")
    # Ten replicated numbers of answers for each draw, (10 draws, pairs).
    replicated = rng.binomial(subject.n_trials, np.tile(p_yes, (10, 1)))
    # The marked quantiles without the median. Each end is one of the replicated numbers, not a
    # mean of two.
    ends = np.quantile(replicated, MARKED_QUANTILES[::2], axis=0, method="inverted_cdf")
    return ends / subject.n_trials


# --- Panels --------------------------------------------------------------------------------------


def _label_pairs(ax: Axes, subject: Subject, pair_of_row: IndexArray) -> None:
    """Label every row of a panel with its pair, as '100, 112'; `pair_of_row` has pair numbers."""
    firsts, unit = subject.unit.numbers(subject.s1, subject.mean_first)
    seconds, _ = subject.unit.numbers(subject.s2, subject.mean_first)
    rows = range(len(pair_of_row))
    ax.set_yticks(rows, [f"{firsts[pair]}, {seconds[pair]}" for pair in pair_of_row])
    ax.set_ylabel(f"first, second\n({unit})")


def _draw_subject(
    ax: Axes, analysis: Analysis, subject: Subject, pair_of_row: IndexArray, *, has_room: bool
) -> None:
    """Draw intervals and, in front of them, observed proportions in the colour of their order.

    `pair_of_row` has the number of the pair in each row. With `has_room` marks are larger, and the
    title counts the pairs that are outside.
    """
    # All arrays have a value for each row.
    share = (subject.n_yes / subject.n_trials)[pair_of_row]  # of the counted answer
    order = presentation_order(subject)[pair_of_row]
    ends = predictive_interval(analysis.curve(subject.name), analysis.settings.seed)
    low, high = ends[:, pair_of_row]
    n_rows = len(pair_of_row)
    y = np.arange(n_rows)

    ax.barh(
        y,
        width=high - low,
        height=0.7,
        left=low,
        color=_INTERVAL,
        lw=0,
        label="95 % predictive interval",
    )
    # A bar without length is not seen, but a line in its middle is.
    ax.vlines(0.5 * (low + high), y - 0.35, y + 0.35, color=_INTERVAL, lw=1.0)
    size = 4.5 if has_room and n_rows <= 40 else 2.8  # of marks, smaller if they are close
    for mark, rows in rows_by_order(order):
        style: Style = {"color": mark.colour, "mec": "white", "mew": 0.4, "label": mark.label}
        ax.plot(share[rows], y[rows], mark.marker, ms=size, zorder=3, **style)
    is_outside = (share < low) | (share > high)
    style = {"ms": 2.0 * size, "mfc": "none", "mec": BAD, "mew": 1.0}
    ax.plot(share[is_outside], y[is_outside], "o", label="outside", **style)

    title = plain(subject.name, limit=20)
    if not analysis.evidence[subject.name].answer.is_interpretable:
        title += "\nnot interpreted"
    elif has_room:
        title += f"\n{is_outside.sum()} of {n_rows} pairs outside"
    ax.set_title(title, loc="left", fontsize=LETTERS)
    ax.set(xlim=(-0.06, 1.06), xticks=[0.0, 0.5, 1.0], ylim=(n_rows - 0.3, -0.7), yticks=[])
    ax.set(xlabel=f"proportion '{subject.task.yes}'", ylabel="pairs by order")
