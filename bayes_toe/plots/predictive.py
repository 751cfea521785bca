"""Posterior predictive checks: observed shares over their 95 % predictive intervals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.analysis import Analysis
from bayes_toe.arrays import FloatArray, IndexArray
from bayes_toe.classical.frequencies import presentation_order
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.inference.prediction import Predictor
from bayes_toe.plots.curves import mean_first
from bayes_toe.plots.style import (
    COLUMN,
    LETTERS,
    MARKED,
    PAGE,
    SMALL,
    Style,
    grid_panels,
    label_outer,
    legend_below,
    mark_synthetic,
    n_rows,
    new_figure,
    plain,
    rows_by_order,
)
from bayes_toe.seeds import generator

#: Subjects that a page has room for.
MOST_SUBJECTS = 40
_MOST_OF_FOUR_COLUMNS = 12
#: By columns of panels: inches across the figure and down a row, characters of a name.
_PANEL_SIZES = {
    1: (COLUMN, 2.1, 20),
    2: (COLUMN, 1.6, 20),
    3: (PAGE, 1.5, 20),
    4: (PAGE, 1.5, 20),
    5: (PAGE, 1.0, 14),
}
_REPLICATES_PER_DRAW = 10  # replicated studies for each draw
_LABEL_WIDE = 0.1  # inches of a pair with its label
_INTERVAL = "#BDBDBD"


def posterior_predictive(analysis: Analysis, subjects: Sequence[str] | None = None) -> Figure:
    """Draw observed shares of every ordered pair before the 95 % posterior predictive interval.

    The interval is that of a replicated study under the average of the four models. A model that
    describes a subject leaves about one point in twenty outside.

    Parameters
    ----------
    analysis : Analysis
    subjects : sequence of str, optional
        By default all, of whom there may be 40.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        For an unknown subject, or more than 40 subjects.
    """
    selected = _select_subjects(analysis, subjects)
    figure, panels = _small_multiples(analysis, selected)
    n_columns = _n_columns(len(panels))
    for ax, counts in zip(panels, selected, strict=True):
        fitted = analysis.curve(counts.name)
        _draw_pairs(ax, counts, predictive_interval(fitted, analysis.settings.seed))
        ax.set_ylabel(f"share '{counts.task.yes}'")
    labels = _pair_labels(selected, figure.get_figwidth() / n_columns - 0.3)
    for ax in panels[-n_columns:]:
        ax.set_xticks(range(len(labels)), labels, rotation=90)
        unit = selected[0].unit.of_stimuli or "% of mean"
        ax.set_xlabel(f"first, second stimulus ({unit})" if labels else "pairs by order")
    label_outer(panels, n_columns)
    legend_below(figure, size=SMALL, columns=4 if figure.get_figwidth() > COLUMN else 2)
    return figure


def predictive_interval(fitted: Predictor, seed: int) -> FloatArray:
    """Ends of the 95 % posterior predictive interval of every pair's share, shape (2, pairs)."""
    counts = fitted.target.subject
    share = np.exp(fitted.target.log_answers(fitted.x).yes)
    rng = generator(seed, counts.name, "posterior predictive interval")
    replicated = rng.binomial(counts.n_trials, np.tile(share, (_REPLICATES_PER_DRAW, 1)))
    ends = np.quantile(replicated, [MARKED[0], MARKED[2]], axis=0, method="inverted_cdf")
    return ends / counts.n_trials


# --- Panels --------------------------------------------------------------------------------------


def _select_subjects(analysis: Analysis, subjects: Sequence[str] | None) -> list[Subject]:
    """The subjects asked for, at most as many as a page has room for."""
    names = analysis.study.names if subjects is None else subjects
    if not 1 <= len(names) <= MOST_SUBJECTS:
        raise InputError(
            f"subjects: found {len(names)}, allowed: 1 to {MOST_SUBJECTS}; "
            "choose some, as in subjects=['S01', 'S02']"
        )
    return [analysis.study[name] for name in names]


def _n_columns(n_subjects: int) -> int:
    if n_subjects > _MOST_OF_FOUR_COLUMNS:
        return 5
    return min(n_subjects, 4)


def _small_multiples(analysis: Analysis, subjects: Sequence[Subject]) -> tuple[Figure, list[Axes]]:
    """A figure as wide as a column or a page, and a panel for each subject."""
    n_columns = _n_columns(len(subjects))
    width, row_height, name_length = _PANEL_SIZES[n_columns]
    figure = new_figure(width, n_rows(len(subjects), n_columns) * row_height + 0.8)
    panels = grid_panels(figure, len(subjects), n_columns, sharey=True)
    answers = {answer.subject: answer for answer in analysis.answers}
    for ax, counts in zip(panels, subjects, strict=True):
        title = plain(counts.name, name_length)
        answer = answers.get(counts.name)
        if answer is not None and not answer.is_interpretable:
            title += "\nnot interpreted"
        ax.set_title(title, loc="left", fontsize=LETTERS)
    mark_synthetic(figure, analysis.study.synthetic)
    return figure, panels


def _in_order(counts: Subject) -> IndexArray:
    """Pairs by their order, weaker first to stronger first, and then by their intensity."""
    return np.lexsort((counts.s1 + counts.s2, presentation_order(counts)))


def _draw_pairs(ax: Axes, counts: Subject, ends: FloatArray) -> None:
    """Observed shares in the colour of their order, before the intervals."""
    index = _in_order(counts)
    share = (counts.n_yes / counts.n_trials)[index]
    order = presentation_order(counts)[index]
    x = np.arange(len(index))
    low, high = ends[:, index]
    ax.bar(x, high - low, 0.7, low, color=_INTERVAL, lw=0, label="95 % predictive interval")
    # A bar of no height would not be seen.
    ax.hlines(0.5 * (low + high), x - 0.35, x + 0.35, color=_INTERVAL, lw=1.0)
    size = 4.0 if len(index) <= 20 else 2.0
    style: Style = {"ms": size, "mec": "white", "mew": 0.3, "clip_on": False, "zorder": 3}
    for mark, rows in rows_by_order(order):
        style |= {"color": mark.colour, "label": mark.label}
        ax.plot(x[rows], share[rows], mark.marker, **style)
    ax.set(ylim=(-0.03, 1.03), yticks=[0.0, 0.5, 1.0], xlim=(-0.7, len(index) - 0.3), xticks=[])


def _pair_labels(subjects: Sequence[Subject], width: float) -> list[str]:
    """Labels of the pairs, if all subjects have the same ones and there is room, in inches."""
    first = subjects[0]
    pairs = np.array([first.s1, first.s2])
    index = _in_order(first)
    has_same_pairs = all(np.array_equal([subject.s1, subject.s2], pairs) for subject in subjects)
    if not has_same_pairs or len(index) * _LABEL_WIDE > width:
        return []
    stimuli = first.unit.or_percent_of(mean_first(first)).stimuli(pairs[:, index])
    digits = ".3g" if first.unit.of_stimuli else ".0f"
    return [f"{s1:{digits}}, {s2:{digits}}" for s1, s2 in stimuli.T]
