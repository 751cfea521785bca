"""Figures of more subjects than can be named: sorted, one thin line a subject, of one height however many they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray, IntArray
from bayes_toe.plots.style import BAD, EQUAL

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Subjects beyond which figures of a study sort them and name none.
MOST_NAMED = 60
#: Inches of such a panel.
HIGH = 5.6
_LINES = 200  # of error bars that can be told apart


def stacked_shares(ax: Axes, share: FloatArray, kinds: Sequence[str], colours: Sequence[str], marked: BoolArray) -> None:
    """Shares of kinds, shape (subjects, kinds), as a stack of areas: subjects by their likeliest kind, then by its share.

    Those without shares (NaN) come last. `marked`, shape (subjects,), get a red line at the right edge. The legend counts all.
    """
    order, kind = sorted_by_kind(share)
    known = int((kind >= 0).sum())
    edges = np.concatenate([np.zeros((known, 1)), np.cumsum(share[order[:known]], axis=1)], axis=1)
    ends = np.repeat(np.arange(known + 1) - 0.5, 2)[1:-1]  # doubled: steps that begin and end where the subject does
    for k, (word, colour) in enumerate(zip(kinds, colours, strict=True)):
        left, right = (np.repeat(edges[:, at], 2) for at in (k, k + 1))
        ax.fill_betweenx(ends, left, right, color=colour, lw=0, label=f"{word}: likeliest for {(kind == k).sum():,}")
    for end in np.cumsum([(kind == k).sum() for k in range(len(kinds) - 1)]):
        ax.axhline(end - 0.5, color="white", lw=1.5)
    at = np.flatnonzero(marked[order])
    if len(at):
        ax.hlines(at, 1.01, 1.06, color=BAD, lw=0.8, clip_on=False, label=f"misfit of H1: {len(at):,}")
    if known < len(share):
        ax.fill_betweenx([], [], color="white", ec=EQUAL, lw=0.5, label=f"no reliable estimate: {len(share) - known:,}")
    ax.set(ylim=(len(share) - 0.5, -0.5), yticks=[], ylabel=f"{len(share):,} subjects, sorted by their likeliest kind")


def sorted_by_kind(share: FloatArray) -> tuple[IntArray, IntArray]:
    """Places of subjects by their likeliest kind, then by its share, those without shares last; and the likeliest kinds, -1 for none."""
    absent = np.isnan(share[:, 0])
    kind = np.where(absent, -1, np.where(np.isnan(share), -np.inf, share).argmax(axis=1))
    best = np.where(absent, 0.0, share.max(axis=1))
    return np.lexsort((-best, np.where(absent, share.shape[1], kind))), kind


def ranked(ax: Axes, value: FloatArray, error: FloatArray, label: str, colour: str) -> None:
    """Values from the largest to the smallest, with error bars where these can be told apart.

    Subjects without a value (NaN) come last.
    """
    order = np.argsort(-value, kind="stable")  # NaN is sorted to the end
    y = np.arange(len(value))
    if len(value) <= _LINES:
        ax.hlines(y, (value - error)[order], (value + error)[order], color=colour, lw=0.6)
    ax.plot(value[order], y, "o", ms=3.0 if len(value) <= _LINES else 1.8, color=colour, label=label)
    ax.set(ylim=(len(value) - 0.5, -0.5), yticks=[])
