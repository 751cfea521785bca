"""The figure of serial dependence: `serial`.

It draws how far responses lie above or below the model without history, by the stimuli of the trial
before (left) and by its response (right).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.answers.serial_dependence import SerialDependence, SubjectDependence
from bayes_toe.arrays import FloatArray, IndexArray
from bayes_toe.errors import InputError
from bayes_toe.model.trial_history import TrialSequence
from bayes_toe.plots.style import (
    EQUAL,
    PAGE,
    POSTERIOR,
    SMALL,
    Style,
    draw_band,
    explain_curves,
    legend_below,
    new_figure,
    plain,
    stimulus_axis,
    style_axes,
)

#: Up to so many mean stimuli of the trial before each is a group; more are binned into groups.
_MOST_DISTINCT, _GROUPS = 8, 5
#: Subjects that one figure shows.
MOST_ROWS = 6
_HIGH = 2.1  # inches of a row


def serial(table: SerialDependence, *subjects: str) -> Figure:
    """Draw the serial dependence of the named subjects, one row for each subject.

    Without names, it shows up to six subjects with the strongest evidence.

    Points show by how much P of the counted response differs from the model without history, with
    one binomial standard error: at the left by the mean stimulus of the trial before, at the right
    by its response. The line and its 95 % band show the best of the four models.

    Raises
    ------
    InputError
        If there is no result to show.
    """
    candidates = [table[name] for name in subjects] or list(table.rows)
    rows = [row for row in candidates if row.has_result]
    if not rows:
        raise InputError("serial: no subject has a result; allowed: rows of bt.serial_dependence")
    if not subjects:
        rows = sorted(rows, key=_log_evidence_gain, reverse=True)[:MOST_ROWS]

    figure = new_figure(PAGE, _HIGH * len(rows) + 0.5)
    axes = figure.subplots(len(rows), 2, squeeze=False, sharey=True, width_ratios=(1.6, 1.0))
    for row, (left, right) in zip(rows, axes, strict=True):
        _draw_row(left, right, table, row)
    for ax in axes[:-1].ravel():
        ax.set_xlabel("")

    notes = []
    if len(rows) < len(candidates) and not subjects:
        notes.append(f"{len(rows)} of {len(candidates)} subjects, strongest evidence first")
    if table.study.synthetic:
        notes.append("synthetic data")
    if notes:
        figure.suptitle("; ".join(notes), fontsize=SMALL)
    explain_curves(axes[0, 0], "best of the four models", POSTERIOR)
    legend_below(figure, columns=2)
    return figure


class _Residuals(NamedTuple):
    """Responses less the model without history, their variance, and the change by the best model.

    Shapes are (trials,), (trials,) and (draws, trials).
    """

    residual: FloatArray
    variance: FloatArray
    change: FloatArray

    def draw(self, ax: Axes, groups: list[IndexArray], x: FloatArray) -> None:
        """Mean residual of each group with its standard error, and what the model says of it."""
        means = np.array([self.residual[group].mean() for group in groups])
        errors = [np.sqrt(self.variance[group].sum()) / len(group) for group in groups]
        lines = np.stack([self.change[:, group].mean(axis=1) for group in groups], axis=1)
        ax.axhline(0.0, color=EQUAL, linestyle="--", linewidth=0.8, label="no history")
        draw_band(ax, x, lines, POSTERIOR)
        style: Style = {"fmt": "o", "color": "black", "ms": 3.5, "lw": 0.8}
        ax.errorbar(x, means, errors, label="responses", **style)


def _log_evidence_gain(row: SubjectDependence) -> float:
    """By how much the best history exceeds none, nats."""
    return float(row.log_evidence.max() - row.log_evidence[0])


def _draw_row(left: Axes, right: Axes, table: SerialDependence, row: SubjectDependence) -> None:
    """Draw both panels of a subject."""
    static = table.posterior(row, "static")
    best = table.posterior(row, row.best_history)
    expected = static.trial_probabilities(row.draws[0]).mean(axis=0)
    change = best.trial_probabilities(row.draws[1]) - expected
    trials = static.rows.trials
    answered = np.flatnonzero(trials.is_answered)
    residual = (trials.answer[answered] > 0.0) - expected
    residuals = _Residuals(residual, expected * (1.0 - expected), change)
    previous = trials.previous[answered]
    rows = np.flatnonzero(previous >= 0)
    previous = previous[rows]

    groups, means = _stimulus_groups(trials, previous)
    residuals.draw(left, [rows[group] for group in groups], means)
    *_, yes, no = static.subject.task.answers
    response = trials.answer[previous]
    values = np.unique(response[response != 0.0])
    residuals.draw(right, [rows[response == value] for value in values], values)

    overall = float(np.average(0.5 * (trials.first + trials.second)))
    unit = static.subject.unit
    stimulus_axis(left, "mean stimulus of the trial before", unit, overall)
    left.set(ylabel=f"P({yes}), difference\nfrom no history")
    left.set_title(
        f"{plain(row.subject, 24)}, carry-over: {row.word('carry_over')}\n"
        f"rho {row.size('carry_over')}",
        fontsize=SMALL,
    )
    right.set_xticks([-1.0, 1.0], [no, yes])
    right.set(xlabel="response in the trial before", xlim=(-1.6, 1.6))
    right.set_title(
        f"previous response: {row.word('previous_response')}\n"
        f"kappa {row.size('previous_response')}",
        fontsize=SMALL,
    )
    style_axes(left)
    style_axes(right)


def _stimulus_groups(
    trials: TrialSequence, previous: IndexArray
) -> tuple[list[IndexArray], FloatArray]:
    """Trials by the mean stimulus of the trial before, and the mean of each group."""
    mean = 0.5 * (trials.first[previous] + trials.second[previous])
    edges = np.unique(mean)[1:]
    if len(edges) >= _MOST_DISTINCT:
        edges = np.unique(np.quantile(mean, np.linspace(0.0, 1.0, _GROUPS + 1)[1:-1]))
    number = np.searchsorted(edges, mean, side="right")
    groups = [np.flatnonzero(number == i) for i in range(len(edges) + 1)]
    groups = [group for group in groups if len(group)]
    return groups, np.array([mean[group].mean() for group in groups])
