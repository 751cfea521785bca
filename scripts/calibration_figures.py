"""Figures of a calibration run: ranks with bands, and reliability of probabilities."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from reference.calibration import (
    DEFAULT,
    DESIGNS,
    ESTIMATORS,
    FALSE_ALARM,
    RANKED,
    Calibration,
    log_odds,
)
from reference.calibration_statistics import POINTS, band, ecdf_difference, reliability_bins

from bayes_toe.model.parameters import QUANTITY_BY_NAME
from bayes_toe.plots.style import (
    EQUAL,
    LETTERS,
    PAGE,
    SMALL,
    STRONGER_FIRST,
    WEAKER_FIRST,
    legend_below,
    new_figure,
    style_axes,
)

#: Colour, line and marker of each design: two that colour-blind readers can tell apart.
STYLE = {"paper": (STRONGER_FIRST, "-", "o"), "sparse": (WEAKER_FIRST, (0, (3, 1.2)), "s")}
_ENDS = np.concatenate([[0.0], POINTS, [1.0]])  # with 0 and 1, where every difference is 0


def ranks_figure(table: Calibration) -> Figure:
    """Distribution functions of ranks minus the uniform one, with their 99 % band."""
    designs = list(table.ranks.groupby("design", sort=False))
    threshold = table.rank_verdicts["threshold"].iloc[0]
    bands = [
        band(size, 1.0 - threshold).differences()
        for size in dict.fromkeys(len(found) for _, found in designs)
    ]

    def draw(quantity: str, ax: Axes) -> None:
        for lower, upper in bands:
            label = f"band (all lines inside with {100 * (1 - FALSE_ALARM):g} %)"
            ax.fill_between(
                _ENDS,
                np.pad(lower, 1),
                np.pad(upper, 1),
                color=EQUAL,
                alpha=0.18,
                lw=0,
                label=label,
            )
        for design, found in designs:
            colour, line, _ = STYLE[design]
            label = f"{design} design: {DESIGNS[design]} batches, {len(found)} studies"
            ax.plot(
                _ENDS,
                np.pad(ecdf_difference(found[quantity]), 1),
                color=colour,
                ls=line,
                lw=1.1,
                label=label,
            )
        ax.axhline(0.0, color="black", lw=0.5)
        title = quantity.replace("_", " ")
        if quantity in QUANTITY_BY_NAME:
            title = QUANTITY_BY_NAME[quantity].symbol
        ax.set_title(title, fontsize=LETTERS)
        ax.set_xlim(0.0, 1.0)
        ax.set_xticks([0.0, 0.5, 1.0], ["0", "0.5", "1"])

    return _two_rows(3.7, RANKED, draw, "rank of the true value", "ECDF difference")


def reliability_figure(table: Calibration) -> Figure:
    """Share of data sets of H1 by its probability, in bins with exact 95 % intervals."""

    def draw(estimator: str, ax: Axes) -> None:
        ax.plot([0, 1], [0, 1], color="black", lw=0.5)
        rows = table.evidence_verdicts
        for line, row in enumerate(rows[rows["estimator"] == estimator].itertuples()):
            colour, _, marker = STYLE[row.design]
            note = _none(row.missing_h1 + row.missing_h0, row.data_sets)
            odds, from_h1 = log_odds(
                table.data_sets[table.data_sets["design"] == row.design], estimator
            )
            said = (
                ", ".join(filter(None, [f"ECE {row.error:.3f}", note]))
                if len(odds)
                else "none exists"
            )
            ax.text(0.0, 1.25 - 0.11 * line, said, color=colour, fontsize=SMALL, va="center")
            if len(odds):
                bins = reliability_bins(odds, from_h1)
                at = bins.stated + (
                    0.012 if row.design == "sparse" else -0.012
                )  # so that the two designs do not hide each other
                ax.vlines(at, bins.lower, bins.upper, color=colour, lw=0.9)
                size = 6.0 + 60.0 * bins.count / row.data_sets
                ax.scatter(
                    at,
                    bins.observed,
                    s=size,
                    color=colour,
                    marker=marker,
                    lw=0,
                    zorder=3,
                    label=_sets(row.design, row.data_sets),
                )
        ax.set_title(estimator + (" (default)" if estimator == DEFAULT else ""), fontsize=LETTERS)
        ax.set(xlim=(-0.05, 1.05), ylim=(-0.05, 1.32), aspect="equal")
        ax.set_xticks([0.0, 0.5, 1.0], ["0", "0.5", "1"])
        ax.set_yticks([0.0, 0.5, 1.0], ["0", "0.5", "1"])

    return _two_rows(5.7, list(ESTIMATORS), draw, "stated P(H1 | data)", "share that came from H1")


def _two_rows(
    high: float, kinds: Sequence[str], draw: Callable[[str, Axes], None], across: str, up: str
) -> Figure:
    """One panel a kind, half of them above the others, with words at the outer axes only."""
    figure, n_columns = new_figure(PAGE, high), (len(kinds) + 1) // 2
    axes = figure.subplots(2, n_columns, sharex=True, sharey=True).ravel()
    for ax, kind in zip(axes[: len(kinds)], kinds, strict=True):
        draw(kind, ax)
        ax.set(xlabel=across, ylabel=up)
        style_axes(ax).label_outer()
    if len(kinds) % 2:
        axes[-1].remove()
        above = axes[n_columns - 1]
        above.set_xlabel(across)
        above.tick_params(labelbottom=True)
    legend_below(figure)
    return figure


def _sets(design: str, size: int) -> str:
    return f"{design} design: {DESIGNS[design]} batches, {size} data sets"


def _none(missing: int, total: int) -> str:
    """The share of data sets for which there is no number; empty where there is one for each."""
    share = 100 * missing / total
    return "" if missing == 0 else "none: < 1 %" if share < 1 else f"none: {share:.0f} %"
