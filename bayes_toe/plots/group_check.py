"""Whether a population has the form that was assumed: its subjects beside new groups."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.groups.predictive_check import CONTRADICTED, PredictiveCheck, Statistic
from bayes_toe.plots.said_interval import rounded
from bayes_toe.plots.style import BAD, BAND, EQUAL, SMALL, dress, legend_above, panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def predictive_check_axes(check: PredictiveCheck, ax: Axes | None = None) -> Axes:
    """How subjects differ in what they did (points) beside new groups of the population, whose 5 to 95 % are one bar each.

    Parameters
    ----------
    check : PredictiveCheck
    ax : matplotlib Axes, optional
        Drawn into, where given.
    """
    ax = panel(ax, high=2.6)
    for i, one in enumerate(check.statistics):
        _draw_statistic(ax, i, one)
    y = np.arange(len(check.statistics))
    ax.set_yticks(y, [fill(one.label, 18) for one in check.statistics])
    ax.set(ylim=(len(y) - 0.5, -0.6), xlim=(-2.2, 2.2), xticks=[])
    legend_above(ax, columns=2, title=f"does a {check.scatter} population fit?")
    dress(ax).tick_params(axis="y", length=0)
    ax.spines[:].set_visible(False)
    return ax


def _draw_statistic(ax: Axes, i: int, one: Statistic) -> None:
    """A row with a scale of its own: the median of new groups in the middle, their central 90 % as wide as in any other row."""
    wrong = one.p_value < CONTRADICTED
    side = one.q95 - one.q50 if one.observed > one.q50 else one.q50 - one.q05
    where = (one.observed - one.q50) / side if side > 0.0 else 0.0
    ax.barh(i, 2.0, 0.36, -1.0, color=BAND, label="new groups, 5 to 95 %" if i == 0 else None)
    ax.plot([0.0, 0.0], [i - 0.18, i + 0.18], color=EQUAL, lw=0.8)
    shown = float(np.clip(where, -2.0, 2.0))
    marker = "D" if shown == where else "<" if where < 0.0 else ">"
    ax.plot(shown, i, marker, ms=4.0, color=BAD if wrong else "black", label="observed" if i == 0 else None, ls="")
    low, high = rounded(one.q05, one.q95, one.q05, one.q95)
    words = f"{rounded(one.q05, one.q95, one.observed)[0]}, expected {low} to {high}, p = {one.p_value:.2g}"
    ax.text(0.0, i - 0.24, words, ha="center", va="bottom", fontsize=SMALL - 1.0, color=BAD if wrong else "black")
