"""Figures of the answer: three questions of every subject with sizes, and H1 against H0 as in Appendix C."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.answers.evidence_table import EvidenceTable
from bayes_toe.answers.order_effect import OrderEffect
from bayes_toe.answers.words import Word
from bayes_toe.arrays import FloatArray
from bayes_toe.errors import InputError
from bayes_toe.plots.style import (
    EQUAL,
    HIGH,
    LETTERS,
    MOST_NAMED,
    POSTERIOR,
    SMALL,
    WEAKER_FIRST,
    dress,
    legend_above,
    legend_below,
    new_figure,
    plain,
)


class Question(NamedTuple):
    """How one of the three questions is drawn: colour, marker, and the size of a forest."""

    name: str
    colour: str
    marker: str
    size: str = ""
    axis: str = ""

    @property
    def title(self) -> str:
        """The name in words."""
        return self.name.replace("_", " ")


#: The colours differ in lightness too.
QUESTIONS = (
    Question("order_effect", "#1C1C1C", "o"),
    Question(
        "constant_error",
        "#00805D",
        "s",
        "pse_shift_percent",
        "PSE shift (%), 95 % interval\nabove 0: first stimulus overestimated",
    ),
    Question(
        "contraction",
        "#C06A9B",
        "D",
        "contraction_p",
        "p, 95 % interval\nabove 0: contraction, below: repulsion",
    ),
)
#: Bayes factors with a line, and that at which the axis ends.
_MARKS = {
    1 / 30: "1/30",
    1 / 10: "1/10",
    1 / 3: "1/3",
    1.0: "1",
    3.0: "3",
    10.0: "10",
    30.0: "30",
}
_LARGEST = 80.0
_FILLS = {Word.YES: "full", Word.PROBABLY: "left"}
_LINEAR = 50.0  # nats, beyond which a sorted axis is logarithmic


def order_effect(table: EvidenceTable, *, synthetic: bool = False) -> Figure:
    """Answers of every subject; beside them the log Bayes factor of the paper's model (H1) against H0.

    Parameters
    ----------
    table : EvidenceTable
    synthetic : bool
        Whether the subjects are simulated, which the title then says.

    Raises
    ------
    InputError
        If the table has no answers.
    """
    figure = new_figure(11.6, answers_height(len(table)))
    *panels, last = figure.subplots(1, 4, width_ratios=(1.0, 1.0, 1.0, 0.8))
    evidence_axes(last, table)
    last.tick_params(labelleft=False)
    last.set_title("H1 against H0 (Appendix C)", loc="left", fontsize=LETTERS)
    dress(last)
    return _finish(figure, panels, table, synthetic)


def answers_figure(table: EvidenceTable, *, synthetic: bool = False) -> Figure:
    """The answers alone."""
    figure = new_figure(8.8, answers_height(len(table)))
    return _finish(figure, figure.subplots(1, 3).tolist(), table, synthetic)


def _finish(
    figure: Figure, panels: Sequence[Axes], table: EvidenceTable, synthetic: bool
) -> Figure:
    """Draw the answers into three panels, and what belongs to the whole figure."""
    draw_answers(table, panels)
    if synthetic:
        figure.suptitle("synthetic data", fontsize=LETTERS)
    legend_below(figure, size=LETTERS, columns=4)
    return figure


def answers_height(subjects: int) -> float:
    """Inches that a figure of so many subjects needs, with its legend below."""
    if subjects > MOST_NAMED:
        return 1.6 + HIGH
    return 1.6 + 0.21 * subjects


# --- The three questions -------------------------------------------------------------------------


def draw_answers(table: EvidenceTable, panels: Sequence[Axes]) -> None:
    """Bayes factors of the questions, PSE shifts and contractions, a row a subject, in three panels.

    Words stand beside the rows. A marker is full where the word is 'yes', half where it is
    'probably'. More than :data:`~bayes_toe.plots.style.MOST_NAMED` subjects have neither names nor
    words and are sorted by the Bayes factor of an order effect.
    """
    answers = list(table.answers)
    if len(answers) < len(table):
        raise InputError("this table has no answers of order effects; bt.evidence computes them")
    is_crowded = len(answers) > MOST_NAMED
    if is_crowded:
        answers.sort(key=lambda answer: -answer.log_bayes_factors["order_effect"])
    _draw_bayes_factors(panels[0], answers)
    for ax, question in zip(panels[1:], QUESTIONS[1:], strict=True):
        _draw_forest(ax, answers, question)
    for ax, question in zip(panels, QUESTIONS, strict=True):
        ax.set_title(question.title, loc="left", fontsize=LETTERS)
        ax.set(ylim=(len(answers) - 0.5, -0.5), yticks=[])
        dress(ax)
    if is_crowded:
        _count_words(panels, answers)
    else:
        _write_words(panels, answers)


def _draw_bayes_factors(ax: Axes, answers: Sequence[OrderEffect]) -> None:
    """The Bayes factor of each question on one axis; beyond its end a triangle."""
    rows = np.arange(len(answers))
    step = 0.24 if len(answers) <= MOST_NAMED else 0.0
    for number, question in enumerate(QUESTIONS):
        log_factors = _log_bayes_factors(answers, question)
        y = rows + step * (number - 1)
        is_beyond = log_factors > np.log(_LARGEST)
        style: dict[str, Any] = {"color": question.colour, "ms": _marker_size(len(answers))}
        within = np.exp(np.where(is_beyond, np.nan, log_factors))
        ax.plot(within, y, question.marker, label=question.title, **style)
        ax.plot(np.where(is_beyond, _LARGEST, np.nan), y, ">", clip_on=False, **style)
    for mark in _MARKS:
        ax.axvline(mark, color="black" if mark == 1.0 else "#D0D0D0", lw=0.7, zorder=0)
    ax.set_xscale("log")
    ax.minorticks_off()
    ax.set_xticks(list(_MARKS), list(_MARKS.values()))
    ax.set(xlim=(1 / _LARGEST, _LARGEST), xlabel="Bayes factor\nabove 1: for the effect")


def _log_bayes_factors(answers: Sequence[OrderEffect], question: Question) -> FloatArray:
    """Log Bayes factors of a question, NaN where there is no word for it."""
    values = []
    for answer in answers:
        has_word = answer.words[question.name] not in (Word.CANNOT_BE_TOLD, Word.NOT_INTERPRETABLE)
        values.append(answer.log_bayes_factors[question.name] if has_word else np.nan)
    return np.array(values)


def _draw_forest(ax: Axes, answers: Sequence[OrderEffect], question: Question) -> None:
    """Medians and 95 % intervals of a size."""
    ends = []
    marker_size = _marker_size(len(answers))
    for row, answer in enumerate(answers):
        if not answer.is_interpretable:
            continue
        size, word = answer.sizes[question.size], answer.words[question.name]
        width = 0.3 * marker_size if word.is_positive else 0.15 * marker_size
        ax.hlines(row, size.q025, size.q975, color=question.colour, lw=width)
        ax.plot(
            size.q50,
            row,
            question.marker,
            color=question.colour,
            ms=marker_size,
            fillstyle=_FILLS.get(word, "none"),
            markerfacecoloralt="white",
        )
        ends.append((size.q025, size.q50, size.q975))
    ax.axvline(0.0, color="black", lw=0.7, zorder=0)
    ax.set(xlabel=question.axis, xlim=_limits(np.array(ends).reshape(-1, 3)))


def _limits(sizes: FloatArray) -> tuple[float, float]:
    """An axis that holds 0, every median and ordinary intervals; wider intervals are cut."""
    if not len(sizes):
        return -1.0, 1.0
    margin = 2.0 * float(np.median(sizes[:, 2] - sizes[:, 0]))
    low = max(float(sizes[:, 0].min()), float(sizes[:, 1].min()) - margin)
    high = min(float(sizes[:, 2].max()), float(sizes[:, 1].max()) + margin)
    pad = 0.05 * (max(high, 0.0) - min(low, 0.0))
    return min(low, 0.0) - pad, max(high, 0.0) + pad


def _marker_size(subjects: int) -> float:
    return 4.5 if subjects <= MOST_NAMED else 2.5


def _write_words(panels: Sequence[Axes], answers: Sequence[OrderEffect]) -> None:
    """The name of every subject, and its words right of its row."""
    panels[0].set_yticks(range(len(answers)), [plain(answer.subject, 24) for answer in answers])
    panels[-1].plot([], [], " ", label="full marker: yes; half: probably")
    panels[-1].plot([], [], " ", label="!: the model does not fit; ?: depends on the prior")
    style: dict[str, Any] = {"va": "center", "fontsize": SMALL}
    for row, answer in enumerate(answers):
        if not answer.is_interpretable:
            reason = plain(f"not interpreted: {', '.join(answer.flags)}", 70)
            panels[0].text(1 / _LARGEST, row, reason, **style)
            continue
        for ax, question in zip(panels, QUESTIONS, strict=True):
            word = answer.marked_word(question.name)
            ax.text(1.05, row, word, transform=ax.get_yaxis_transform(), **style)


def _count_words(panels: Sequence[Axes], answers: Sequence[OrderEffect]) -> None:
    """How many subjects have an effect, in the titles."""
    label = f"{len(answers):,} subjects, sorted by the Bayes factor of an order effect"
    panels[0].set_ylabel(label, fontsize=LETTERS)
    for ax, question in zip(panels, QUESTIONS, strict=True):
        counts = Counter(answer.words[question.name] for answer in answers)
        yes, probably = counts[Word.YES], counts[Word.PROBABLY]
        title = f"{question.title}\n{yes} yes, {probably} probably"
        ax.set_title(title, loc="left", fontsize=LETTERS)


# --- H1 against H0 -------------------------------------------------------------------------------


def evidence_axes(ax: Axes, table: EvidenceTable) -> Axes:
    """Log Bayes factor of H1 against H0 of every subject, with twice its standard error, and Laplace's.

    More than :data:`~bayes_toe.plots.style.MOST_NAMED` subjects are sorted by it, without names and
    without Laplace's.
    """
    columns = ("log_bayes_factor", "log_evidence_h1_se", "log_bayes_factor_laplace")
    values = [[getattr(row, column) for column in columns] for row in table]
    value, error, laplace = np.array(values, np.float64).reshape(-1, 3).T  # None becomes NaN
    y = np.arange(len(table))
    ax.axvline(0.0, color="black", lw=1.0)
    ax.set_xlabel(
        "ln Bayes factor H1:H0\nbelow 0: saturated model (H0)\nabove 0: paper's model (H1)"
    )
    ax.set(ylim=(len(table) - 0.5, -0.5), yticks=[])
    ax.margins(x=0.08)
    if len(table) > MOST_NAMED:
        n_known, n_above = int((~np.isnan(value)).sum()), int((value > 0.0).sum())
        label = f"importance sampling, above 0 for {n_above:,} of {n_known:,}"
        ax.plot(-np.sort(-value), y, "o", ms=2.0, color=POSTERIOR, label=label)
        ax.set_ylabel("subjects, sorted by their log Bayes factor")
        if np.nanmax(np.abs(value), initial=0.0) > _LINEAR:
            ax.set_xscale("symlog", linthresh=_LINEAR)
        return ax
    ax.hlines(y, 0.0, 1.0, transform=ax.get_yaxis_transform(), color="#EEEEEE", lw=0.8, zorder=0)
    style: dict[str, Any] = {"fmt": "o", "ms": 6, "label": "importance sampling, 2 s.e."}
    ax.errorbar(value, y, xerr=2.0 * error, color=POSTERIOR, **style)
    ax.plot(laplace, y, "D", ms=5, mfc="none", color=WEAKER_FIRST, label="Laplace (both models)")
    ax.set_yticks(y, [plain(row.subject, 24) for row in table])
    for i in np.flatnonzero(np.isnan(value)).tolist():
        words = "no reliable estimate"
        if not np.isnan(laplace[i]):
            words += ", Laplace only"
        place: dict[str, Any] = {"transform": ax.get_yaxis_transform(), "ha": "right"}
        ax.text(0.99, i, words, va="center", fontsize=LETTERS, color=EQUAL, **place)
    return ax


def evidence_plane_axes(table: EvidenceTable, ax: Axes) -> Axes:
    """Log evidence of the paper's model (H1, upward) against the saturated model (H0, to the right), as the paper's figure in Appendix C.

    Per trial, so that studies and subjects of any length share one scale; above the diagonal one smooth curve does better than one free
    probability per pair. Subjects without a reliable estimate are counted in the panel.
    """
    known = [
        (row.log_evidence_h0, row.log_evidence_h1, row.n_trials)
        for row in table.rows
        if row.log_evidence_h1 is not None
    ]
    points = np.array([(h0 / trials, h1 / trials) for h0, h1, trials in known], np.float64).reshape(
        -1, 2
    )
    ax.axline((0.0, 0.0), slope=1.0, color="black", lw=0.8)
    for favoured, colour, marker, label in (
        (True, POSTERIOR, "o", "the paper's model (H1)"),
        (False, WEAKER_FIRST, "s", "saturated model (H0)"),
    ):
        at = (points[:, 1] > points[:, 0]) == favoured
        if at.any():
            ax.plot(*points[at].T, marker, ms=4.5, mfc="none", mew=1.1, color=colour, label=label)
    if len(points):
        pad = max(0.08 * float(np.ptp(points)), 0.02)
        limits = (float(points.min()) - pad, float(points.max()) + pad)
        ax.set(xlim=limits, ylim=limits)
        ax.locator_params(nbins=4)  # so that numbers of three decimals do not touch
        legend_above(ax, columns=2)
    if len(points) < len(table.rows):
        said = f"{len(table.rows) - len(points)} without a reliable estimate"
        ax.text(
            0.98,
            0.03,
            said,
            transform=ax.transAxes,
            ha="right",
            va="bottom",
            fontsize=SMALL,
            color=EQUAL,
        )
    ax.set_aspect("equal")
    ax.set(xlabel="log evidence per trial, H0 (nats)", ylabel="log evidence per trial, H1 (nats)")
    return dress(ax)
