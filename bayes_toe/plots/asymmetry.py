"""Figures of the time-order asymmetry.

`order_axes` draws one comparison in both orders (Fig. 1C), `asymmetry` the asymmetry of all
subjects and comparisons. The asymmetry is q(c, r) - q(r, c): q(a, b) is the share of 'equal', or of
wrong, responses with a first and b second, and c is stronger than r.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from bayes_toe.classical.asymmetry import LEVEL, AsymmetryTable, Comparison
from bayes_toe.plots.style import (
    EQUAL,
    HIGH,
    MAX_NAMES,
    SMALL,
    STRONGER_FIRST,
    WEAKER_FIRST,
    Style,
    axes_or_new,
    legend_above,
    plain,
    style_axes,
)

#: Colour and marker by the sign of the asymmetry: 1 if 'equal', or a wrong response, is likelier
#: with the stronger stimulus first.
_MARKS = {1: (STRONGER_FIRST, "s"), -1: (WEAKER_FIRST, "o"), 0: (EQUAL, "D")}
# Inches: a subject's row with up to five comparisons, and what stands above and below the rows.
_ROW, _MARGIN, _HIGHEST = 0.22, 1.05, 9.0
#: Comparisons of one subject beyond which the row shows them without error bars.
_CROWDED = 12


def order_axes(
    comparison: Comparison, ax: Axes | None = None, *, share_of: str = "'equal'"
) -> Axes:
    """Draw P('equal'), or P(wrong), of one comparison in its two orders.

    The p-value is that of their difference. The source is Fig. 1C, with its colours.

    Laplace estimators and their errors (Eq. e:2b), and the exact test's plain p-value.
    """
    ax = axes_or_new(ax, wide=1.8, high=2.2)
    q = (comparison.q_weak_first, comparison.q_strong_first)
    errors = (comparison.q_weak_first_se, comparison.q_strong_first_se)
    for x, colour in enumerate((WEAKER_FIRST, STRONGER_FIRST)):
        style: Style = {"fmt": "os"[x], "color": colour, "elinewidth": 1.0}
        ax.bar(x, q[x], width=0.62, color=colour, alpha=0.35, lw=0)
        ax.errorbar(x, q[x], errors[x], ms=4.5, capsize=2.5, **style)
    top = float(np.add(q, errors).max()) + 0.05
    ax.plot([0, 0, 1, 1], [top, top + 0.02, top + 0.02, top], color="black", lw=0.8)
    text = _p_value_text(comparison.p_value)
    ax.text(0.5, top + 0.03, text, ha="center", va="bottom", fontsize=SMALL)
    ax.set_xticks([0, 1], ["weaker\nfirst\n$q(r, c)$", "stronger\nfirst\n$q(c, r)$"])
    ax.set(
        ylabel=f"P({share_of})",
        xlim=(-0.55, 1.55),
        ylim=(0.0, max(1.0, top + 0.14)),
        yticks=[0.0, 0.5, 1.0],
    )
    pair = f"$r$ = {comparison.s_weak:.3g}, $c$ = {comparison.s_strong:.3g}".replace("-", "−")
    ax.set_title(f"{plain(comparison.subject, 20)}\n{pair}")
    style_axes(ax)
    ax.title.set_fontsize(SMALL)
    return ax


def asymmetry(table: AsymmetryTable, ax: Axes | None = None) -> Axes:
    """Asymmetry q(c, r) - q(r, c) of every subject (rows) and comparison (points), with its SD.

    Blue squares: 'equal', or a wrong response, is likelier with the stronger stimulus first;
    orange circles: with the weaker one first. Filled: the orders differ (p < .05) by the exact
    test, corrected by Holm's method over the subject's comparisons. Source: Fig. 1C and Results,
    response asymmetries. More than 60 subjects are sorted by their largest asymmetry, without
    names and without the other comparisons.

    Parameters
    ----------
    table : AsymmetryTable
    ax : matplotlib Axes, optional
        Drawn into, where given.
    """
    ax = axes_or_new(ax, high=asymmetry_height(table))
    rows = [list(row.comparisons) for row in table]
    has_names = len(table) <= MAX_NAMES
    if not has_names:
        largest = [row.maximal for row in table if row.maximal is not None]
        largest.sort(key=lambda comparison: -comparison.asymmetry)
        rows = [[comparison] for comparison in largest]
    style: Style = {"va": "center", "fontsize": SMALL, "color": EQUAL}
    for i, comparisons in enumerate(rows):
        if has_names and i % 2:
            ax.axhspan(i - 0.5, i + 0.5, color="#F3F3F3", lw=0, zorder=0)
        if not comparisons:
            text = "no pair in both orders"
            ax.text(0.01, i, text, transform=ax.get_yaxis_transform(), **style)
    reach = _draw_comparisons(ax, rows, 4.0 if has_names else 2.6)
    ax.axvline(0.0, color="black", lw=0.8)
    # Zero is in the middle.
    ax.set(xlim=(-reach, reach), ylim=(len(rows) - 0.5, -0.5), yticks=[])
    ax.set_xlabel("asymmetry  $q(c, r) - q(r, c)$")
    ax.locator_params(axis="x", nbins=6)
    if has_names:
        ax.set_yticks(range(len(rows)), [plain(row.subject, 16) for row in table])
    else:
        label = f"{len(rows):,} subjects, sorted by their largest asymmetry"
        if len(rows) < len(table):
            label += f";\n{len(table) - len(rows):,} without a pair in both orders"
        ax.set_ylabel(label)
    style_axes(ax).tick_params(axis="y", length=0)
    _draw_key(ax, table.share_of)
    return ax


def asymmetry_height(table: AsymmetryTable) -> float:
    """Inches of :func:`asymmetry`: rows are higher where most subjects have many comparisons."""
    if len(table) > MAX_NAMES:
        return _MARGIN + HIGH
    usual = float(np.median([len(row.comparisons) for row in table.rows])) if table.rows else 0.0
    return min(_HIGHEST, _MARGIN + _ROW * len(table.rows) * min(max(1.0, usual / 5.0), 4.0))


def _draw_comparisons(ax: Axes, rows: Sequence[Sequence[Comparison]], size: float) -> float:
    """Draw the comparisons of every row, one below the other; return how far they reach from 0."""
    points = []
    for i, comparisons in enumerate(rows):
        n_comparisons = len(comparisons)
        for j, comparison in enumerate(comparisons):
            height = i + 0.7 * ((j + 0.5) / n_comparisons - 0.5)
            bar = error = comparison.asymmetry_se
            if n_comparisons > _CROWDED:
                bar = np.nan  # Bars of many comparisons in one row would hide each other.
            points.append((comparison.asymmetry, height, bar, comparison.p_adjusted, error))
    value, y, bars, p, errors = np.array(points, np.float64).reshape(-1, 5).T
    signs, is_significant = np.sign(value), p < LEVEL
    for sign, (colour, marker) in _MARKS.items():
        for is_filled, face in ((False, "white"), (True, colour)):
            is_selected = (signs == sign) & (is_significant == is_filled)
            style: Style = {"ms": size, "mew": 0.7, "elinewidth": 0.6, "mfc": face}
            if is_selected.any():
                x, half = value[is_selected], bars[is_selected]
                ax.errorbar(x, y[is_selected], None, half, marker, color=colour, **style)
    reach = np.abs(value) + errors
    return min(1.05, 1.08 * float(reach.max(initial=0.1)))


def _draw_key(ax: Axes, share_of: str) -> None:
    """Draw the meaning of colour and filling above the panel and over long names."""
    style: Style = {"ls": "", "ms": 4.2, "mew": 0.7}
    for order, sign in (("weaker", -1), ("stronger", 1)):
        colour, marker = _MARKS[sign]
        label = f"{share_of} likelier {order} first"
        ax.plot([], [], marker=marker, color=colour, label=label, **style)
    label = f"filled: p < {LEVEL:g} (Holm)"
    ax.plot([], [], marker="o", color="#333333", label=label, **style)
    legend_above(ax, side="right")


def _p_value_text(p_value: float) -> str:
    """A p-value as text with mathematics."""
    if p_value >= 0.001:
        return f"$p$ = {p_value:.2g}" if p_value < 0.095 else f"$p$ = {p_value:.2f}"
    if p_value < 1e-99:
        return "$p < 10^{-99}$"
    digits, power = f"{p_value:.0e}".split("e")
    return rf"$p$ = ${digits}\cdot10^{{{int(power)}}}$"
