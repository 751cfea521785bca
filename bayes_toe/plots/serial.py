"""The figure of serial dependence: `serial`.

It draws how far responses lie above or below the model without history, by the stimuli of the trial
before (left) and by its response (right).
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.answers.serial_dependence import SerialDependence, SubjectDependence
from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.errors import InputError, require_kind
from bayes_toe.plots.style import (
    EQUAL,
    PAGE,
    POSTERIOR,
    SMALL,
    draw_band,
    explain_curves,
    legend_outside,
    new_figure,
    plain,
    stimulus_axis,
    style_axes,
)

#: Largest number of subjects in a figure.
MOST_ROWS = 6


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
    require_kind("table", table, SerialDependence, "SerialDependence")
    candidates = [table[name] for name in subjects] or list(table.rows)
    rows = [row for row in candidates if row.has_result]
    if not rows:
        raise InputError("serial: no subject has a result; allowed: rows of bt.serial_dependence")
    if not subjects:
        # Strongest evidence first: the log evidence of the best model over that of the first model,
        # which has no history.
        rows.sort(key=lambda row: row.log_evidence[0] - row.log_evidence.max())
        rows = rows[:MOST_ROWS]

    figure = new_figure(PAGE, 2.1 * len(rows) + 0.5)
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
    legend_outside(figure, columns=2)
    return figure


def _draw_row(left: Axes, right: Axes, table: SerialDependence, row: SubjectDependence) -> None:
    """Draw both panels of a subject, of the trials that have a trial before."""
    static_model = table.posterior(row, "static")  # the model without history
    best_model = table.posterior(row, row.best_history)
    static_draws, best_draws = row.draws
    trials = static_model.rows.trials
    answered = np.flatnonzero(trials.is_answered)  # numbers of the answered trials

    # P of the counted response without history, (answered,), and by how much the best model
    # changes P, (draws, answered).
    expected = static_model.trial_probabilities(static_draws).mean(axis=0)
    change = best_model.trial_probabilities(best_draws) - expected
    # 1 for the counted response, whose code is above 0, or 0 for any other response, minus P.
    residual = (trials.answer[answered] > 0.0) - expected
    variance = expected * (1.0 - expected)

    # Both panels show the same trials, each panel in groups of its own.
    has_previous = trials.previous[answered] >= 0  # the first trial of a session has -1
    panel_data = residual[has_previous], variance[has_previous], change[:, has_previous]
    previous = trials.previous[answered][has_previous]  # numbers of the trials before
    mean_stimulus = 0.5 * (trials.first + trials.second)  # of every trial
    previous_mean = mean_stimulus[previous]
    _draw_residuals(left, previous_mean, _stimulus_groups(previous_mean), *panel_data)
    # The response in the trial before; 1, the counted response, is at the right.
    previous_response = trials.answer[previous]
    codes = np.unique(previous_response[previous_response != 0.0])  # 0 is a missing response
    has_code = previous_response == codes[:, None]  # (codes, trials)
    _draw_residuals(right, previous_response, has_code, *panel_data)

    subject = static_model.subject
    mean = float(mean_stimulus.mean())
    stimulus_axis(left, "mean stimulus of the trial before", subject.unit, mean)
    # The last two answers of a task. With three answers, they are 'second' and 'first'.
    *_, yes, no = subject.task.answers
    left.set(ylabel=f"P({yes}), difference\nfrom no history")
    right.set_xticks([-1.0, 1.0], [no, yes])
    right.set(xlabel="response in the trial before", xlim=(-1.6, 1.6))
    left.set_title(
        f"{plain(row.subject, limit=24)}, carry-over: {row.word('carry_over')}\n"
        f"rho {row.size('carry_over')}"
    )
    right.set_title(
        f"previous response: {row.word('previous_response')}\nkappa {row.size('previous_response')}"
    )
    style_axes(left)
    style_axes(right)


def _stimulus_groups(mean: FloatArray) -> BoolArray:
    """Groups of trials by the mean stimulus of the trial before, shape (groups, trials).

    Up to eight different means are a group each; more means are binned into five groups.
    """
    starts = np.unique(mean)  # the lowest mean of each group
    if len(starts) > 8:
        starts = np.unique(np.quantile(mean, [0.0, 0.2, 0.4, 0.6, 0.8]))
    group_of_trial = np.searchsorted(starts, mean, side="right")  # (trials,)
    return group_of_trial == np.unique(group_of_trial)[:, None]  # without groups without a trial


def _draw_residuals(
    ax: Axes,
    position: FloatArray,
    groups: BoolArray,
    residual: FloatArray,
    variance: FloatArray,
    change: FloatArray,
) -> None:
    """Draw the mean residual of each group of trials with its standard error, and the prediction.

    `groups` has the shape (groups, trials). `residual` is the response minus P in the model without
    history, and `variance` is P (1 - P), shape (trials,) each. `change` is P in the best model
    minus P without history, shape (draws, trials). A group stands at its mean `position`.
    """
    n_trials = groups.sum(axis=1)  # (groups,)
    x = groups @ position / n_trials
    mean_change = change @ groups.T / n_trials  # (draws, groups)
    mean_residual = groups @ residual / n_trials
    error = np.sqrt(groups @ variance) / n_trials
    ax.axhline(0.0, color=EQUAL, linestyle="--", linewidth=0.8, label="no history")
    draw_band(ax, x, mean_change, POSTERIOR)
    ax.errorbar(x, mean_residual, error, fmt="o", color="black", ms=3.5, lw=0.8, label="responses")
