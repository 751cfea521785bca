"""What a trial leaves to the next: answers by the trial before, and the expectation over the trials of a session."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.comparison.history import QUANTITIES, HistoryTable, SubjectHistory
from bayes_toe.comparison.words import compared
from bayes_toe.errors import InputError
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.history import Trials
from bayes_toe.model.posterior import Posterior
from bayes_toe.plots.style import (
    BELIEF,
    EQUAL,
    PAGE,
    POSTERIOR,
    SMALL,
    draw_band,
    dress,
    legend_below,
    new_figure,
    plain,
)

#: Groups of the trial before, and trials of the session that are drawn.
_GROUPS, _TRIALS = 5, 80
#: Subjects that one figure shows.
MOST_ROWS = 6
_HIGH = 2.1  # inches of a row
_BAND = ((0.05, 0.95, 0.25),)


def history(table: HistoryTable, *subjects: str) -> Figure:
    """One row a subject: those that are named, or at most six, those whose history has the most evidence.

    Left: how much oftener the answer that is counted was given after trials of low to high mean stimulus than the best model without
    history expects, with one binomial standard error; the line and its 90 % band are what the best history says. Right: the expectation of
    that model, mean and 90 % band, over the first 80 trials of the longest session; points are the mean stimulus of each trial.

    Raises
    ------
    InputError
        If no row has draws to show, or a subject has none.
    """
    given = [table[name] for name in subjects] or table.rows
    shown = sorted(
        (row for row in given if row.shown), key=lambda row: -row.log_bayes_factor_history
    )
    shown = shown if subjects else shown[:MOST_ROWS]
    if not shown:
        raise InputError(
            "history: found no subject with draws, allowed: rows of bt.compare_history that have them"
        )
    figure = new_figure(PAGE, _HIGH * len(shown) + 0.5)
    axes = figure.subplots(len(shown), 2, squeeze=False, width_ratios=(1.0, 1.6))
    for row, (left, right) in zip(shown, axes, strict=True):
        static, best = table.predictors(row)
        _by_trial_before(left, row, static, best)
        _over_trials(right, row, best)
    for ax in axes[:-1].ravel():
        ax.set_xlabel("")
    mark = "synthetic data" if table.study.synthetic else ""
    more = (
        f"{len(shown)} of {len(given)} subjects, most evidence first"
        if len(shown) < len(given)
        else ""
    )
    if mark or more:
        figure.suptitle("; ".join(filter(None, (more, mark))), fontsize=SMALL)
    legend_below(figure, size=SMALL, columns=5)
    return figure


def _by_trial_before(ax: Axes, row: SubjectHistory, static: Predictor, best: Predictor) -> None:
    trials = Trials.of(best.target.subject)
    preceded = np.flatnonzero(~np.isnan(trials.previous))
    edges = np.unique(
        np.quantile(trials.previous[preceded], np.linspace(0.0, 1.0, _GROUPS + 1)[1:-1])
    )
    group = np.searchsorted(edges, trials.previous[preceded], side="right")
    members = [preceded[group == one] for one in range(len(edges) + 1) if (group == one).any()]
    at = np.array([trials.previous[some].mean() for some in members])
    assert isinstance(static.target, Posterior)
    assert isinstance(best.target, Posterior)
    before = np.exp(static.target.trial_answers(static.x))
    after = np.exp(best.target.trial_answers(best.x))
    expected = before.mean(axis=0)
    found = np.array([(trials.n_yes - expected)[some].mean() for some in members])
    error = np.array(
        [np.sqrt((expected * (1.0 - expected))[some].sum()) / len(some) for some in members]
    )
    lines = np.stack([(after - expected)[:, some].mean(axis=1) for some in members], axis=1)
    task = best.target.subject.task
    ax.axhline(0.0, color=EQUAL, linestyle="--", linewidth=0.8, label="without history")
    draw_band(ax, at, lines, POSTERIOR, 1.2, _BAND, "with history")
    ax.errorbar(
        at,
        found,
        error,
        fmt="o",
        color="black",
        markersize=3.5,
        linewidth=0.8,
        label="answers, 1 s.e.",
    )
    ax.set(
        xlabel="mean stimulus of the trial before (ln intensity)",
        ylabel=f"P({task.yes}) less\nthat without history",
    )
    known = f"{QUANTITIES[row.parameter]}: {row.q50:.2g} ({row.q05:.2g}, {row.q95:.2g})"
    ax.set_title(
        f"{plain(row.subject, 24)}, P of a history {compared(1.0 - (row.p_static or 0.0))}\n{known}",
        fontsize=SMALL,
    )
    dress(ax)


def _over_trials(ax: Axes, row: SubjectHistory, best: Predictor) -> None:
    assert isinstance(best.target, Posterior)
    felt = best.target.expectation(best.x)
    assert felt is not None  # a model with a history, of trials in their order
    answers = best.target.subject.answers
    assert answers is not None
    starts = np.r_[np.flatnonzero(answers.begins), len(answers.begins)]
    longest = int(np.argmax(np.diff(starts)))
    rows = slice(
        int(starts[longest]), min(int(starts[longest + 1]), int(starts[longest]) + _TRIALS)
    )
    count = rows.stop - rows.start
    mu0, own = float(answers.keys[:, :2].mean()), best.target.quantities(best.x).get("mu1")
    level = np.full(len(best.x), mu0) if own is None else own
    number = np.arange(1.0, count + 1.0)
    middle = answers.keys[rows, :2].mean(axis=1)
    ax.plot(number, middle, ".", color=EQUAL, markersize=2.5, label="mean stimulus of a trial")
    # What is known of mu1 itself moves all trials alike: the band is about its median.
    draw_band(ax, number, float(np.median(level)) + felt[:count, longest].T, POSTERIOR, 1.2, _BAND)
    ax.axhline(float(np.median(level)), color=BELIEF, linestyle=":", linewidth=0.8, label="at rest")
    ax.set(xlabel="trial of the session", ylabel="expectation\n(ln intensity)", xlim=(0, count + 1))
    ax.set_title(row.best_model, fontsize=SMALL)
    dress(ax)
