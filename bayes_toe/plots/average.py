"""What a space of models says of one subject's answers, each model with its probability."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.classical.frequencies import presentation_order
from bayes_toe.comparison.average import Average, Averages
from bayes_toe.data.study import refuse_intervals
from bayes_toe.plots.curves import answers_figure, distance_panel
from bayes_toe.plots.style import ORDERS, SMALL, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN = {"pull": "pull", "offset": "constant error"}


def plot_average(averages: Averages, subject: str) -> Figure:
    """Answers of one subject in both orders with P(equal) averaged over models: mean, central 60 % and 95 % bands.

    Panels as in :func:`bayes_toe.plots.curves.curves`; with more than six weaker stimuli a single one over the difference of the stimuli,
    where a line is the average for each pair. Below the title: medians (5 and 95 %), and how probable the models without the part are.

    Raises
    ------
    InputError
        For a subject without an average, or with several intervals.
    """
    one = averages[subject]
    refuse_intervals([one.counts], "panel of both orders")
    title = f"{plain(subject)}: average over {len(one.models)} models" + (" (synthetic data)" if averages.synthetic else "")
    said = "\n".join(_said(one, name, words) for name, words in _SHOWN.items())
    return answers_figure(one.counts, one.equal, lambda ax: _difference_panel(ax, one), f"{title}\n{said}")


def _said(one: Average, name: str, words: str) -> str:
    low, middle, high = (0.0 + round(value, 2) for value in np.quantile(one.values(name), [0.05, 0.5, 0.95]).tolist())
    return f"{words} {middle:.2f} ({low:.2f}, {high:.2f}), none: {one.without(name):.2f}".replace("-", "−")


def _difference_panel(ax: Axes, one: Average) -> Axes:
    """Answers over the difference of the stimuli, with the average for each pair."""
    distance_panel(ax, one.counts, None)
    mean = one.equal(one.counts.s1, one.counts.s2).mean(axis=0)
    order, difference = presentation_order(one.counts), one.counts.s2 - one.counts.s1
    for sign, mark in ORDERS.items():
        ax.plot(difference[order == sign], mean[order == sign], "_", color=mark.colour, ms=SMALL)
    return ax
