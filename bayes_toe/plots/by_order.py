"""Figures for a paper that compare the two orders of presentation.

`curves_by_order` draws responses with fitted curves, `posterior_predictive` observed shares over
their 95 % predictive intervals, and `jnd_by_order` the JND with the standard second against that
with the standard first. The figures of arXiv 2604.19662 are in `paper_figures.py`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.analysis import Analysis
from bayes_toe.answers.words import Word
from bayes_toe.arrays import ArrayPair, FloatArray, IndexArray
from bayes_toe.classical.frequencies import presentation_order
from bayes_toe.data.messages import plural
from bayes_toe.data.stimulus_unit import percent
from bayes_toe.data.study import Subject, refuse_intervals
from bayes_toe.errors import InputError
from bayes_toe.inference.prediction import Predictor
from bayes_toe.plots.curves import mean_first
from bayes_toe.plots.order_effect import QUESTION_STYLES, WITHOUT_SIZE, marker_style
from bayes_toe.plots.report_figure import responses_panel
from bayes_toe.plots.style import (
    COLUMN,
    EQUAL,
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
    plain_log_axis,
    rows_by_order,
    style_axes,
    write_note,
)
from bayes_toe.seeds import generator

#: Subjects that a page has room for.
MOST_SUBJECTS = 40
_MOST_OF_FOUR_COLUMNS = 12
_REPLICATES_PER_DRAW = 10  # replicated studies for each draw
_BEYOND_MEDIANS = 1.8  # how far axes of medians reach, as a factor
_LABEL_WIDE = 0.1  # inches of a pair with its label
_INTERVAL = "#BDBDBD"
_LABELS = {Word.YES: "contraction: yes", Word.PROBABLY: "probably", Word.UNDECIDED: "other"}


def curves_by_order(analysis: Analysis, subjects: Sequence[str] | None = None) -> Figure:
    """Draw responses and model-averaged curves in both orders, a panel for each subject.

    Points are Laplace estimates with their standard deviation. Curves are posterior means with
    95 % bands, and in 'same or different' with 50 % bands too. In 'which was
    stronger', designs with more than two sizes of step have a curve for each first stimulus.

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
        For an unknown subject, more than 40 subjects, or several inter-stimulus intervals.
    """
    selected = _select_subjects(analysis, subjects)
    refuse_intervals(selected, "curves by order")
    figure, panels = _small_multiples(analysis, selected)
    for ax, counts in zip(panels, selected, strict=True):
        responses_panel(ax, counts, analysis.curve(counts.name).yes)
    label_outer(panels, _n_columns(len(panels)))
    _legend(figure)
    return figure


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
    _legend(figure)
    return figure


def jnd_by_order(analysis: Analysis) -> Figure:
    """Draw every subject's JND where the standard came second against where it came first.

    The standard is a stimulus at the mean first intensity. Where it comes first, the JND is that
    of the noise. Where it comes second, the varied stimulus is remembered and contracted, so that
    the JND is larger by 1/(1 - p). A contraction lies above the diagonal and a repulsion below it;
    a constant error does not change the JND. Points are medians with 95 % intervals, averaged over
    the four models.

    Parameters
    ----------
    analysis : Analysis

    Returns
    -------
    matplotlib.figure.Figure
    """
    question = QUESTION_STYLES[2]
    figure = new_figure(COLUMN, COLUMN + 0.3)
    ax = figure.subplots()
    for word, label in _LABELS.items():
        ax.plot([], [], label=label, **marker_style(question, word, 4.5))
    words, quantiles = [], []
    for answer in analysis.answers:
        word = answer.words[question.name]
        if word in WITHOUT_SIZE or not answer.is_interpretable:
            continue
        words.append(word)
        jnds = jnds_by_order(analysis.curve(answer.subject))
        quantiles.append(np.quantile(jnds, MARKED, axis=1).T)
    logs = np.array(quantiles).reshape(-1, 2, len(MARKED))
    unit = analysis.study.unit.for_percent(_BEYOND_MEDIANS * percent(logs[..., 1]))
    for word, ((left, x, right), (low, y, high)) in zip(words, unit.differences(logs), strict=True):
        line: Style = {"color": question.colour, "lw": 0.7, "alpha": 0.5}
        ax.plot([left, right], [y, y], **line)
        ax.plot([x, x], [low, high], **line)
        ax.plot(x, y, **marker_style(question, word, 4.5))
    medians = unit.differences(logs[..., 1])
    _square_axes(ax, medians)
    ax.set_xlabel(f"JND, standard first ({unit.of_differences})")
    ax.set_ylabel(f"JND, standard second ({unit.of_differences})")
    n_left_out = len(analysis.answers) - len(medians)
    if n_left_out:
        write_note(ax, f"{plural(n_left_out, 'subject')} without an estimate of contraction")
    mark_synthetic(figure, analysis.study.synthetic)
    style_axes(ax)
    legend_below(figure, size=SMALL)
    return figure


def jnds_by_order(fitted: Predictor) -> ArrayPair:
    """Draws of the JND where the standard came first, and second, natural-log intensity."""
    quantities = fitted.target.quantities(fitted.x)
    jnd, contraction = quantities["jnd"], quantities["contraction"]
    return jnd, jnd / (1.0 - contraction)


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
    return min(n_subjects, 4) if n_subjects <= _MOST_OF_FOUR_COLUMNS else 5


def _small_multiples(analysis: Analysis, subjects: Sequence[Subject]) -> tuple[Figure, list[Axes]]:
    """A figure as wide as a column or a page, and a panel for each subject."""
    n_columns = _n_columns(len(subjects))
    width = COLUMN if n_columns <= 2 else PAGE
    row_height = {1: 2.1, 2: 1.6, 3: 1.5, 4: 1.5, 5: 1.0}[n_columns]
    figure = new_figure(width, n_rows(len(subjects), n_columns) * row_height + 0.8)
    panels = grid_panels(figure, len(subjects), n_columns, sharey=True)
    answers = {answer.subject: answer for answer in analysis.answers}
    for ax, counts in zip(panels, subjects, strict=True):
        title = plain(counts.name, 20 if n_columns < 5 else 14)
        answer = answers.get(counts.name)
        if answer is not None and not answer.is_interpretable:
            title += ", not interpreted" if n_columns < 3 else "\nnot interpreted"
        ax.set_title(title, loc="left", fontsize=LETTERS)
    mark_synthetic(figure, analysis.study.synthetic)
    return figure, panels


def _legend(figure: Figure) -> None:
    """One legend below the panels, in as many columns as the figure has room for."""
    legend_below(figure, size=SMALL, columns=4 if figure.get_figwidth() > COLUMN else 2)


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


def _square_axes(ax: Axes, medians: FloatArray) -> None:
    """Equal logarithmic axes in plain numbers about the medians, with the diagonal."""
    low, high = 5.0, 20.0
    if len(medians):
        low = float(medians.min()) / _BEYOND_MEDIANS
        high = float(medians.max()) * _BEYOND_MEDIANS
    ax.plot([low, high], [low, high], color=EQUAL, lw=0.8, ls="--", zorder=0)
    ax.set(xscale="log", yscale="log", xlim=(low, high), ylim=(low, high))
    ax.set_aspect("equal")
    plain_log_axis(ax.xaxis)
    plain_log_axis(ax.yaxis)
