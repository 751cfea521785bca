"""Figures of the time-order asymmetry: one comparison in both orders (Fig. 1C), and q(c, r) - q(r, c) of all subjects and comparisons."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from bayes_toe.arrays import FloatArray
from bayes_toe.classical.asymmetry import LEVEL, AsymmetryTable, Comparison
from bayes_toe.plots.style import (
    EQUAL,
    HIGH,
    MOST_NAMED,
    SMALL,
    STRONGER_FIRST,
    WEAKER_FIRST,
    dress,
    legend_above,
    panel,
    plain,
)

#: Colour and marker of the order in which 'equal', or a wrong answer, is likelier, by the sign of the asymmetry.
_MARKS = {1: (STRONGER_FIRST, "s"), -1: (WEAKER_FIRST, "o"), 0: (EQUAL, "D")}
# Inches: a subject's row with up to five comparisons, and what stands above and below the rows.
_ROW, _MARGIN = 0.22, 1.05
#: Comparisons of one subject beyond which the row shows them without error bars.
_CROWDED = 12


def order_axes(
    comparison: Comparison, ax: Axes | None = None, *, share_of: str = "'equal'"
) -> Axes:
    """P('equal'), or P(wrong), of one comparison in its two orders with the p-value of their difference. Source: Fig. 1C, with its colours.

    Laplace estimators and their errors (Eq. e:2b), and the exact test's plain p-value.
    """
    ax = panel(ax, wide=1.8, high=2.2)
    q = (comparison.q_weak_first, comparison.q_strong_first)
    errors = (comparison.q_weak_first_se, comparison.q_strong_first_se)
    for x, (value, error, colour) in enumerate(
        zip(q, errors, (WEAKER_FIRST, STRONGER_FIRST), strict=True)
    ):
        ax.bar(x, value, width=0.62, color=colour, alpha=0.35, lw=0)
        ax.errorbar(x, value, error, fmt="os"[x], ms=4.5, color=colour, elinewidth=1.0, capsize=2.5)
    top = max(value + error for value, error in zip(q, errors, strict=True)) + 0.05
    ax.plot([0, 0, 1, 1], [top, top + 0.02, top + 0.02, top], color="black", lw=0.8)
    ax.text(0.5, top + 0.03, _said(comparison.p_value), ha="center", va="bottom", fontsize=SMALL)
    ax.set_xticks([0, 1], ["weaker\nfirst\n$q(r, c)$", "stronger\nfirst\n$q(c, r)$"])
    ax.set(
        ylabel=f"P({share_of})",
        xlim=(-0.55, 1.55),
        ylim=(0.0, max(1.0, top + 0.14)),
        yticks=[0.0, 0.5, 1.0],
    )
    pair = f"$r$ = {comparison.s_weak:.3g}, $c$ = {comparison.s_strong:.3g}".replace("-", "−")
    ax.set_title(f"{plain(comparison.subject, 20)}\n{pair}")
    dress(ax)
    ax.title.set_fontsize(SMALL)
    return ax


def asymmetry(table: AsymmetryTable, ax: Axes | None = None) -> Axes:
    """Asymmetry q(c, r) - q(r, c) of every subject (rows) and comparison (points), with its standard deviation.

    Blue: 'equal', or a wrong answer, likelier with the stronger stimulus first; red: with the weaker one first. Filled: the orders differ
    (p < 0.05) by the exact test, corrected by Holm's method over the subject's comparisons. Large: the subject's largest asymmetry. Source:
    Fig. 1C and Results, response asymmetries. More than :data:`~bayes_toe.plots.style.MOST_NAMED` subjects are sorted by their largest
    asymmetry, without names and without the other comparisons.

    Parameters
    ----------
    table : AsymmetryTable
    ax : matplotlib Axes, optional
        Drawn into, where given.
    """
    rows = table.rows
    ax = panel(ax, high=asymmetry_height(table))
    ax.axvline(0.0, color="black", lw=0.8)
    ax.set_xlabel("asymmetry  $q(c, r) - q(r, c)$")
    if len(rows) > MOST_NAMED:
        _draw_largest(ax, table)
        return dress(ax)
    for i, row in enumerate(rows):
        if i % 2:
            ax.axhspan(i - 0.5, i + 0.5, color="#F3F3F3", lw=0, zorder=0)
        if not row.comparisons:
            where = ax.get_yaxis_transform()
            ax.text(
                0.99,
                i,
                "no pair in both orders",
                transform=where,
                ha="right",
                va="center",
                fontsize=SMALL,
                color=EQUAL,
            )
    counts = [len(row.comparisons) for row in rows]
    y = np.array(
        [
            i + 0.7 * ((j + 0.5) / count - 0.5)
            for i, count in enumerate(counts)
            for j in range(count)
        ]
    )
    value, error, p, largest = _columns([one for row in rows for one in row.comparisons])
    barred = np.where((np.repeat(counts, counts) > _CROWDED) & (largest == 0), np.nan, error)
    for (sign, (colour, marker)), sure, large in product(
        _MARKS.items(), (False, True), (False, True)
    ):
        at = (np.sign(value) == sign) & ((p < LEVEL) == sure) & (largest == large)
        if at.any():
            style: dict[str, Any] = (
                {"ms": 4.2, "elinewidth": 0.7, "zorder": 3}
                if large
                else {"ms": 2.4, "elinewidth": 0.4, "zorder": 2}
            )
            face = colour if sure else "white"
            ax.errorbar(
                value[at],
                y[at],
                xerr=barred[at],
                fmt=marker,
                color=colour,
                mfc=face,
                mew=0.7,
                **style,
            )
    ax.set_yticks(range(len(rows)), [plain(row.subject, 16) for row in rows])
    reach = (
        min(1.05, 1.08 * float((np.abs(value) + error).max())) if len(value) else 1.0
    )  # zero is in the middle
    ax.set(ylim=(len(rows) - 0.5, -0.5), xlim=(-reach, reach))
    dress(ax).tick_params(axis="y", length=0)
    _draw_key(ax, table.share_of)
    return ax


def asymmetry_height(table: AsymmetryTable) -> float:
    """Inches that a figure of :func:`asymmetry` needs: rows are higher where most subjects have many comparisons."""
    if len(table) > MOST_NAMED:
        return _MARGIN + HIGH
    usual = float(np.median([len(row.comparisons) for row in table.rows])) if table.rows else 0.0
    return _MARGIN + _ROW * len(table.rows) * min(max(1.0, usual / 5.0), 4.0)


def _columns(comparisons: Sequence[Comparison]) -> FloatArray:
    """Asymmetry, its standard deviation, adjusted p-value, and whether it is the subject's largest, shape (4, comparisons)."""
    return (
        np.array(
            [
                (one.asymmetry, one.asymmetry_se, one.p_adjusted, one.is_maximal)
                for one in comparisons
            ],
            np.float64,
        )
        .reshape(-1, 4)
        .T
    )


def _draw_largest(ax: Axes, table: AsymmetryTable) -> None:
    """The largest asymmetry of each subject, sorted, those that are significant in colour."""
    largest, subjects = [row.maximal for row in table if row.maximal is not None], len(table)
    value, error, p, _ = _columns(sorted(largest, key=lambda one: -one.asymmetry))
    y = np.arange(len(value))
    ax.hlines(
        y,
        value - error,
        value + error,
        color="#D9D9D9",
        lw=min(0.8, 250.0 / max(len(value), 1)),
        zorder=1,
    )
    for (sign, (colour, marker)), sure in product(_MARKS.items(), (False, True)):
        at = (np.sign(value) == sign) & ((p < LEVEL) == sure)
        if at.any():
            said = f"p < {LEVEL:g} (Holm)" if sure else f"p ≥ {LEVEL:g}"
            words = (
                f"{table.share_of} likelier {'stronger' if sign > 0 else 'weaker'} first, {said}"
                if sign
                else "neither order"
            )
            style: dict[str, Any] = {
                "ms": 2.6,
                "mew": 0.4,
                "color": colour,
                "mfc": colour if sure else "white",
            }
            ax.plot(value[at], y[at], marker, label=f"{words}: {at.sum():,}", **style)
    if len(value) < subjects:
        words = f"no pair in both orders: {subjects - len(value):,}"
        ax.text(
            0.98,
            0.02,
            words,
            transform=ax.transAxes,
            ha="right",
            va="bottom",
            fontsize=SMALL,
            color=EQUAL,
        )
    reach = min(1.05, 1.08 * float((np.abs(value) + error).max(initial=0.1)))
    ax.set(ylim=(len(value) - 0.5, -0.5), xlim=(-reach, reach), yticks=[])
    ax.set_ylabel(f"{subjects:,} subjects, sorted by their largest asymmetry")
    legend_above(ax)


def _draw_key(ax: Axes, share_of: str) -> None:
    """What colour, filling and size mean; above the panel, where no point can be, and over the names where these are long."""

    def mark(marker: str, colour: str, *, filled: bool, size: float = 4.2) -> Line2D:
        return Line2D(
            [],
            [],
            ls="",
            marker=marker,
            ms=size,
            mec=colour,
            mfc=colour if filled else "white",
            mew=0.7,
        )

    key = {
        f"{share_of} likelier weaker first": mark("o", WEAKER_FIRST, filled=True),
        f"{share_of} likelier stronger first": mark("s", STRONGER_FIRST, filled=True),
        f"filled: p < {LEVEL:g} (Holm)": mark("o", "#333333", filled=True),
        "large: largest of the subject": mark("o", "#333333", filled=False),
    }
    style = {
        "handletextpad": 0.1,
        "columnspacing": 0.8,
        "borderaxespad": 0.2,
        "labelspacing": 0.25,
        "frameon": False,
        "fontsize": SMALL,
    }
    ax.legend(
        key.values(), key.keys(), loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, **style
    )


def _said(p_value: float) -> str:
    """A p-value as text with mathematics."""
    if p_value >= 0.001:
        return f"$p$ = {p_value:.2g}" if p_value < 0.095 else f"$p$ = {p_value:.2f}"
    if p_value < 1e-99:
        return "$p < 10^{-99}$"
    digits, power = f"{p_value:.0e}".split("e")
    return rf"$p$ = ${digits}\cdot10^{{{int(power)}}}$"
