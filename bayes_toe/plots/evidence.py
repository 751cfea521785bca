"""Figures of the evidence: which order effect every subject has, its log Bayes factor, and H1 against H0 as in Appendix C."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.answers.evidence_table import EvidenceTable
from bayes_toe.arrays import BoolArray, FloatArray, IntArray
from bayes_toe.plots.style import (
    BAD,
    COLUMN,
    EQUAL,
    HIGH,
    MOST_NAMED,
    POSTERIOR,
    SMALL,
    WEAKER_FIRST,
    dress,
    legend_above,
    legend_below,
    new_figure,
    panel,
    plain,
)

#: What the kinds of order effect are called, and their colours, told apart by their lightness too.
KIND_COLOURS = {"none": "#DEDEDE", "constant error": "#E69F00", "pull": POSTERIOR}
_LINEAR = 50.0  # nats, beyond which a sorted axis is logarithmic
_UNDESCRIBED = "no model describes the answers"
_LINES = 200  # of error bars that can be told apart


def evidence_figure(table: EvidenceTable, *, synthetic: bool = False) -> Figure:
    """Which order effect every subject has; beside it the log Bayes factor of the paper's model (H1) against free frequencies (H0)."""
    crowded = len(table) > MOST_NAMED
    figure = new_figure(9.6, evidence_height(table))
    left, right = figure.subplots(1, 2, sharey=not crowded, width_ratios=(1.0, 0.8))
    order_effect_axes(table, left)
    evidence_axes(right, table)
    right.tick_params(labelleft=False)
    left.set_title("order effect", fontsize=10, loc="left")
    right.set_title("Appendix C: one smooth curve?", fontsize=10, loc="left")
    if synthetic:
        left.set_title("synthetic data", fontsize=10, loc="right")
    legend_below(figure)
    return figure


def evidence_height(table: EvidenceTable) -> float:
    """Inches that a figure of either panel needs, with its legend below."""
    return 1.6 + HIGH if len(table) > MOST_NAMED else 2.2 + 0.27 * len(table)


def order_effect_axes(table: EvidenceTable, ax: Axes | None = None) -> Axes:
    """Probabilities of none, constant error and pull, one bar a subject, hatched where no model describes the answers.

    A subject of whom an evidence is withheld has words in the place of the bar. More than :data:`~bayes_toe.plots.style.MOST_NAMED`
    subjects have no names and are sorted by their likeliest kind.
    """
    crowded = len(table) > MOST_NAMED
    ax = panel(
        ax, wide=COLUMN + 1.0, high=1.2 + (HIGH if crowded else 0.2 * len(table))
    )  # with room for names
    said = [row.verdict for row in table]
    share = np.array(
        [(np.nan,) * 3 if one is None or one.p_orders is None else one.p_orders for one in said]
    ).reshape(-1, 3)
    undescribed = np.array([one is not None and one.fit == "not described" for one in said], bool)
    ax.set(
        xlim=(0.0, 1.07 if crowded else 1.0),
        xlabel="probability of each kind",
        xticks=np.linspace(0.0, 1.0, 6),
    )
    if crowded:
        stacked_shares(ax, share, KIND_COLOURS, undescribed)
        return ax
    y, ends = np.arange(len(said)), np.cumsum(share, axis=1)
    for (kind, colour), values, end in zip(KIND_COLOURS.items(), share.T, ends.T, strict=True):
        ax.barh(y, values, left=end - values, height=0.62, color=colour, label=kind)
    if undescribed.any():
        hatched: dict[str, Any] = {
            "fc": "none",
            "ec": "#1C1C1C",
            "hatch": "/////",
            "hatch_linewidth": 0.5,
            "lw": 0.0,
        }
        ax.barh(y[undescribed], 1.0, height=0.62, label=_UNDESCRIBED, **hatched)
    for i in np.flatnonzero(np.isnan(ends[:, -1])).tolist():
        ax.text(0.5, i, "no reliable estimate", ha="center", va="center", fontsize=8, color=EQUAL)
    ax.set_yticks(y, [plain(row.subject, 24) for row in table])
    ax.set_ylim(len(y) - 0.5, -0.5)
    return ax


def stacked_shares(
    ax: Axes, share: FloatArray, colours: Mapping[str, str], marked: BoolArray
) -> None:
    """Shares of kinds, shape (subjects, kinds), as a stack of areas in their colours: subjects by their likeliest kind, then by its share.

    Those without shares (NaN) come last. `marked`, shape (subjects,), get a red line at the right edge. The legend counts all.
    """
    order, kind = sorted_by_kind(share)
    known = int((kind >= 0).sum())
    edges = np.concatenate([np.zeros((known, 1)), np.cumsum(share[order[:known]], axis=1)], axis=1)
    ends = np.repeat(np.arange(known + 1) - 0.5, 2)[
        1:-1
    ]  # doubled: steps that begin and end where the subject does
    for k, (word, colour) in enumerate(colours.items()):
        left, right = (np.repeat(edges[:, at], 2) for at in (k, k + 1))
        ax.fill_betweenx(
            ends,
            left,
            right,
            color=colour,
            lw=0,
            label=f"{word}: likeliest for {(kind == k).sum():,}",
        )
    for end in np.cumsum([(kind == k).sum() for k in range(len(colours) - 1)]):
        ax.axhline(end - 0.5, color="white", lw=1.5)
    at = np.flatnonzero(marked[order])
    if len(at):
        ax.hlines(
            at, 1.01, 1.06, color=BAD, lw=0.8, clip_on=False, label=f"{_UNDESCRIBED}: {len(at):,}"
        )
    if known < len(share):
        ax.fill_betweenx(
            [],
            [],
            color="white",
            ec=EQUAL,
            lw=0.5,
            label=f"no reliable estimate: {len(share) - known:,}",
        )
    ax.set(
        ylim=(len(share) - 0.5, -0.5),
        yticks=[],
        ylabel=f"{len(share):,} subjects, sorted by their likeliest kind",
    )


def sorted_by_kind(share: FloatArray) -> tuple[IntArray, IntArray]:
    """Places of subjects by their likeliest kind, then by its share, those without shares last; and the likeliest kinds, -1 for none."""
    absent = np.isnan(share[:, 0])
    kind = np.where(absent, -1, np.where(np.isnan(share), -np.inf, share).argmax(axis=1))
    best = np.where(absent, 0.0, share.max(axis=1))
    return np.lexsort((-best, np.where(absent, share.shape[1], kind))), kind


def evidence_axes(ax: Axes, table: EvidenceTable) -> Axes:
    """Log Bayes factor of H1 against H0 of every subject: the default estimate with twice its standard error, and Laplace's.

    More than :data:`~bayes_toe.plots.style.MOST_NAMED` subjects are sorted by it, without names and without Laplace's.
    """
    rows = table.rows
    y = range(len(rows))
    keys = ("log_bayes_factor", "log_evidence_h1_se", "log_bayes_factor_laplace")
    value, error, laplace = (
        np.array([getattr(row, key) for row in rows], np.float64) for key in keys
    )  # None becomes NaN
    ax.axvline(0.0, color="black", lw=1.0)
    ax.set_xlabel(
        "log Bayes factor (nats)\nbelow 0: free frequencies (H0)\nabove 0: the paper's model (H1)"
    )
    if len(rows) > MOST_NAMED:
        _draw_ranked(ax, value, error)
        return ax
    for i in y:
        ax.axhline(i, color="#EEEEEE", lw=0.8, zorder=0)
    ax.errorbar(
        value,
        y,
        xerr=2.0 * error,
        fmt="o",
        ms=6,
        color=POSTERIOR,
        label="importance sampling, 2 s.e.",
    )
    ax.plot(laplace, y, "D", ms=5, mfc="none", color=WEAKER_FIRST, label="Laplace (both models)")
    ax.set_yticks(y, [plain(row.subject, 24) for row in rows])
    ax.set_ylim(len(rows) - 0.5, -0.5)
    ax.margins(x=0.08)
    for i in np.flatnonzero(np.isnan(value)).tolist():  # words in its row, not an empty line
        words = (
            "no reliable estimate" if np.isnan(laplace[i]) else "no reliable estimate, Laplace only"
        )
        ax.text(
            0.99,
            i,
            words,
            transform=ax.get_yaxis_transform(),
            ha="right",
            va="center",
            fontsize=8,
            color=EQUAL,
        )
    return ax


def _draw_ranked(ax: Axes, value: FloatArray, error: FloatArray) -> None:
    """Values of many subjects from the largest to the smallest, NaN last; what lies far out is drawn nearer."""
    known = np.abs(value[~np.isnan(value)])
    order, few, y = np.argsort(-value, kind="stable"), len(value) <= _LINES, np.arange(len(value))
    if few:
        ax.hlines(
            y, (value - 2.0 * error)[order], (value + 2.0 * error)[order], color=POSTERIOR, lw=0.6
        )
    label = f"importance sampling, above 0 for {int((value > 0).sum()):,} of {len(known):,}"
    ax.plot(value[order], y, "o", ms=3.0 if few else 1.8, color=POSTERIOR, label=label)
    ax.set(
        ylim=(len(value) - 0.5, -0.5),
        yticks=[],
        ylabel="subjects, sorted by their log Bayes factor",
    )
    if len(known) and known.max() > _LINEAR:
        ax.set_xscale("symlog", linthresh=_LINEAR)
    ax.margins(x=0.08)


def evidence_plane_axes(table: EvidenceTable, ax: Axes) -> Axes:
    """Log evidence of the paper's model (H1, upward) against free frequencies (H0, to the right), as the paper's figure in Appendix C.

    Per trial, so that studies and subjects of any length share one scale; above the diagonal one smooth curve does better than free
    frequencies. Subjects without a reliable estimate are counted in the panel.
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
        (False, WEAKER_FIRST, "s", "free frequencies (H0)"),
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
