"""Figure of how conclusions on a part of the model depend on the prior: one line a level, one column a number of the prior."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.comparison.model_comparison import STUDY
from bayes_toe.comparison.parts_sensitivity import PartsSensitivity
from bayes_toe.plots.figure_files import save_figure
from bayes_toe.plots.style import EQUAL, LETTERS, SMALL, STRONGER_FIRST, WEAKER_FIRST, dress, new_figure, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LINES = ((EQUAL, "D"), (WEAKER_FIRST, "o"), (STRONGER_FIRST, "s"), ("#CC79A7", "^"), ("#009E73", "v"))
_WIDE, _HIGH = 1.05, 0.72  # inches of a panel
_MOST = 12


def parts_sensitivity_figure(table: PartsSensitivity, part: str = "order", *, synthetic: bool = False) -> Figure:
    """Probabilities of a part's levels against each number of the prior, the others as given (dotted line).

    One row for the study, where there is one, then one for each subject whose most probable level changes within the range, at most 12 (the
    first of them); where it changes for none, the first subjects. A gap: an evidence that is withheld.
    """
    shown = _shown(table, part)
    columns = len(table.varied)
    figure = new_figure(max(_WIDE * columns + 0.9, 3.4), _HIGH * len(shown) + 0.95)
    axes = figure.subplots(len(shown), columns, squeeze=False, sharey=True)
    for row, subject in zip(axes, shown, strict=True):
        for ax, varied in zip(row, table.varied, strict=True):
            _panel(ax, table, subject, varied, part)
        row[0].set_ylabel("study" if subject == STUDY else plain(subject, 10), rotation=0, ha="right", va="center", fontsize=LETTERS)
    for ax, varied in zip(axes[-1], table.varied, strict=True):
        ax.set_xlabel(varied, fontsize=SMALL)
        ax.tick_params(labelbottom=True)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False, fontsize=LETTERS)
    figure.supxlabel("value of the prior" + (" (synthetic data)" if synthetic else ""), fontsize=LETTERS)
    figure.supylabel("probability", fontsize=LETTERS)
    return figure


def save_parts_sensitivity(table: PartsSensitivity, path: str | Path, *, synthetic: bool = False, overwrite: bool = False) -> Path:
    """Draw :func:`parts_sensitivity_figure` and write it, whole or not at all."""
    return save_figure(parts_sensitivity_figure(table, synthetic=synthetic), path, overwrite=overwrite)


def _shown(table: PartsSensitivity, part: str) -> list[str]:
    own = [name for name in table.subjects if name != STUDY]
    turning = [name for name in own if table.turns(name, part)] or own
    return [*((STUDY,) if STUDY in table.subjects else ()), *turning[:_MOST]]


def _panel(ax: Axes, table: PartsSensitivity, subject: str, varied: str, part: str) -> None:
    positive = table.prior.declared_as(varied).positive
    given = float(getattr(table.prior, varied))
    for (level, rows), (colour, marker) in zip(table.of(subject, varied, part).items(), _LINES, strict=False):
        values = np.array([row.probability for row in rows], np.float64)  # None becomes NaN: a gap
        ax.plot([row.value for row in rows], values, "-", marker=marker, ms=2.6, lw=0.9, color=colour, label=level)
    ax.axvline(given, color="black", lw=0.6, ls=":", zorder=0)
    if positive:
        ax.set_xscale("log")
    ticks = [rows[0].value, given, rows[-1].value]
    ax.set_xticks(ticks, [f"{value:.3g}".replace("-", "−") for value in ticks])
    ax.minorticks_off()
    ax.set_yticks([0.0, 1.0])
    ax.set_ylim(-0.06, 1.06)
    ax.tick_params(labelbottom=False)
    dress(ax)
