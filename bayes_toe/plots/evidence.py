"""Figures of the evidence: log Bayes factor of every subject, and H1 against H0 as in Appendix C."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.evidence_table import EvidenceTable
from bayes_toe.plots.style import COLUMN, EQUAL, POSTERIOR, SMALL, WEAKER_FIRST, dress, legend_above, legend_below, new_figure, panel, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def evidence_figure(table: EvidenceTable, *, synthetic: bool = False) -> Figure:
    """Log Bayes factor of every subject: the default estimate with twice its standard error, and Laplace's.

    Parameters
    ----------
    table : EvidenceTable
    synthetic : bool
        Whether to say that the data are synthetic.
    """
    figure = new_figure(7.2, 1.7 + 0.27 * len(table.rows))
    axes = evidence_axes(figure.subplots(), table)
    if synthetic:
        axes.set_title("synthetic data", fontsize=10, loc="right")
    legend_below(figure)
    return figure


def evidence_axes(ax: Axes, table: EvidenceTable) -> Axes:
    """The panel of :func:`evidence_figure`."""
    rows = table.rows
    y = list(range(len(rows)))
    value = np.array([np.nan if row.log_bayes_factor is None else row.log_bayes_factor for row in rows])
    error = np.array([np.nan if row.log_evidence_h1_se is None else row.log_evidence_h1_se for row in rows])
    laplace = np.array([np.nan if row.log_bayes_factor_laplace is None else row.log_bayes_factor_laplace for row in rows])
    ax.axvline(0.0, color="black", lw=1.0)
    for i in y:
        ax.axhline(i, color="#EEEEEE", lw=0.8, zorder=0)
    ax.errorbar(value, y, xerr=2.0 * error, fmt="o", ms=6, color=POSTERIOR, label="importance sampling, 2 s.e.")
    ax.plot(laplace, y, "D", ms=5, mfc="none", color=WEAKER_FIRST, label="Laplace (both models)")
    ax.set_yticks(y, [plain(row.subject, 24) for row in rows])
    ax.set_ylim(len(rows) - 0.5, -0.5)
    ax.set_xlabel("log Bayes factor (nats)\n$\\leftarrow$ free frequencies (H0)  |  predictive update (H1) $\\rightarrow$")
    ax.margins(x=0.08)
    _say_missing(ax, rows, value, laplace)
    return ax


def evidence_plane_axes(table: EvidenceTable, ax: Axes | None = None) -> Axes:
    """Log evidence of H1 (upward) against H0 (to the right), one point a subject, as the paper's figure in Appendix C.

    Per trial, so that studies and subjects of any length share one scale; above the diagonal the predictive update is favoured.
    Subjects without a reliable estimate are left out and counted in the panel.
    """
    ax = panel(ax, high=COLUMN)
    known = [(row.log_evidence_h0, row.log_evidence_h1, row.n_trials) for row in table.rows if row.log_evidence_h1 is not None]
    points = np.array([(h0 / trials, h1 / trials) for h0, h1, trials in known], np.float64).reshape(-1, 2)
    ax.axline((0.0, 0.0), slope=1.0, color="black", lw=0.8)
    for favoured, colour, marker, label in ((True, POSTERIOR, "o", "H1 favoured"), (False, WEAKER_FIRST, "s", "H0 favoured")):
        at = (points[:, 1] > points[:, 0]) == favoured
        if at.any():
            ax.plot(*points[at].T, marker, ms=4.5, mfc="none", mew=1.1, color=colour, label=label)
    if len(points):
        pad = max(0.08 * float(np.ptp(points)), 0.02)
        limits = (float(points.min()) - pad, float(points.max()) + pad)
        ax.set(xlim=limits, ylim=limits)
        ax.locator_params(nbins=6)
        legend_above(ax, columns=2)
    if len(points) < len(table.rows):
        said = f"{len(table.rows) - len(points)} without a reliable estimate"
        ax.text(0.98, 0.03, said, transform=ax.transAxes, ha="right", va="bottom", fontsize=SMALL, color=EQUAL)
    ax.set_aspect("equal")
    ax.set(xlabel="log evidence per trial, H0 (nats)", ylabel="log evidence per trial, H1 (nats)")
    return dress(ax)


def _say_missing(ax: Axes, rows: Sequence[Any], value: FloatArray, laplace: FloatArray) -> None:
    """A subject without an estimate gets words in its row, not an empty line."""
    for i in range(len(rows)):
        if np.isnan(value[i]):
            words = "no reliable estimate" if np.isnan(laplace[i]) else "no reliable estimate, Laplace only"
            ax.text(0.99, i, words, transform=ax.get_yaxis_transform(), ha="right", va="center", fontsize=8, color=EQUAL)
