"""Figures of studies with several inter-stimulus intervals: gain and P(equal) over the interval, and the fitted curves at each.

Bands are central 60 % and 95 % of the posterior; between and beyond the tested intervals they are predictions of the random walk.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.inference.draws import Draws
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.intervals import require_intervals
from bayes_toe.plots.curves import CURVE_DRAWS, draw_band, draw_points, order_panel, subject_and_model
from bayes_toe.plots.style import (
    EQUAL,
    ORDERS,
    POSTERIOR,
    dress,
    legend_below,
    new_figure,
    panel,
)
from bayes_toe.plots.subject import main_weaker, which_weaker

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_BEYOND = 2.0  # the default range goes so many times below the shortest and above the longest tested interval
_MAX_PANELS = 6
_SIZE = 4.5  # of marks, points
_APART = 0.006  # of the width of a panel, by which answers of either order stand beside their interval, so that none hides the other


def interval_gain_axes(draws: Draws, subject: str, ax: Axes | None = None, *, isi: npt.ArrayLike | None = None) -> Axes:
    """Kalman gain of a subject over the interval: the weight of the first stimulus; 1 means no order effect. Short bars: tested intervals.

    Parameters
    ----------
    draws : Draws
        Of a study with intervals.
    subject : str
    ax : matplotlib Axes, optional
        Drawn into, where given.
    isi : array_like, optional
        Intervals to draw at, seconds; by default from half the shortest to twice the longest tested one.

    Raises
    ------
    InputError
        For an unknown subject, draws without intervals, or an interval that is not positive and finite.
    """
    tested = _tested(draws, subject)
    ax, x = panel(ax), _range(tested, isi)
    draw_band(ax, x, _fitted(draws, subject).gain(x), POSTERIOR, 1.3)
    ax.axhline(1.0, color=EQUAL, lw=0.8, ls=":")
    _dress(ax, x, tested)
    ax.set(ylabel="gain K", ylim=(min(0.5, ax.get_ylim()[0]), 1.03))
    return dress(ax)


def interval_answers_axes(
    draws: Draws, subject: str, ax: Axes | None = None, *, pair: tuple[float, float] | None = None, isi: npt.ArrayLike | None = None
) -> Axes:
    """P(equal) of one pair of stimuli in both orders over the interval, with the answers at the tested ones (Laplace estimator).

    Answers of the two orders stand a little beside their interval, so that none hides the other.

    Parameters
    ----------
    draws : Draws
        Of a study with intervals.
    subject : str
    ax : matplotlib Axes, optional
        Drawn into, where given.
    pair : tuple of float, optional
        The two stimuli, natural-log intensity; by default the pair met at most intervals whose answers are nearest to half 'equal'.
    isi : array_like, optional
        As in :func:`interval_gain_axes`, and so are the errors.
    """
    counts, tested = draws.subject(subject), _tested(draws, subject)
    ax, x, fitted = panel(ax), _range(tested, isi), _fitted(draws, subject)
    weak, strong = sorted(_shown_pair(counts) if pair is None else pair)
    orders = {-1: (weak, strong), 1: (strong, weak)} if weak < strong else {0: (weak, strong)}
    for order, (s1, s2) in orders.items():
        mark = ORDERS[order]
        draw_band(ax, x, fitted.equal(np.full(len(x), s1), np.full(len(x), s2), x), mark.colour, 1.3)
        at = (counts.s1 == s1) & (counts.s2 == s2)
        if counts.isi is not None and at.any():
            shown = Subject(subject, counts.s1[at], counts.s2[at], counts.n_equal[at], counts.n_trials[at], counts.isi[at])
            beside = (x[-1] / x[0]) ** (_APART * order)
            draw_points(ax, counts.isi[at] * beside, shown, np.ones(shown.n_pairs, np.bool_), mark, size=_SIZE)
    _dress(ax, x, tested)
    about = f"{weak:.3g} and {strong:.3g}" if weak != strong else f"{weak:.3g} twice"
    ax.set(ylabel="P('equal')", ylim=(-0.03, 1.03), yticks=[0.0, 0.5, 1.0])
    ax.set_title(f"stimuli {about}".replace("-", "−"))
    return dress(ax)


def interval_curves(draws: Draws, subject: str, *, title: str | None = None) -> Figure:
    """Answers and fitted curves of a subject at each of up to six intervals, and below, gain and P(equal) over the interval.

    The title is, by default, subject and model.

    Raises
    ------
    InputError
        For an unknown subject or draws without intervals.
    """
    counts, tested = draws.subject(subject), _tested(draws, subject)
    weaker = main_weaker(counts)
    shown = tested if weaker is not None and len(tested) <= _MAX_PANELS else ()
    across = min(3, max(1, len(shown)))
    rows = -(-len(shown) // across)
    figure = new_figure(6.6, 2.3 * rows + 2.9)
    grid = figure.add_gridspec(rows + 1, 6)
    first: Axes | None = None
    for i, isi in enumerate(shown):
        wide = 6 // across
        ax = figure.add_subplot(grid[i // across, wide * (i % across) : wide * (i % across + 1)], sharey=first)
        first = ax if first is None else first
        _draw_interval(ax, counts, _fitted(draws, subject), isi, weaker)
        ax.set_ylabel("P('equal')" if i % across == 0 else "")
        dress(ax)
    if rows:
        legend_below(figure, size=8.0)
    interval_gain_axes(draws, subject, figure.add_subplot(grid[rows, :3]))
    interval_answers_axes(draws, subject, figure.add_subplot(grid[rows, 3:]))
    figure.suptitle(subject_and_model(draws, subject) if title is None else title, fontsize=11)
    return figure


def _draw_interval(ax: Axes, counts: Subject, fitted: Predictor, isi: float, weaker: float | None) -> None:
    """One panel of both orders at one interval."""
    here = counts.at_isi(isi)
    low = weaker if weaker in np.minimum(here.s1, here.s2) else main_weaker(here)
    if low is None:
        low = float(here.s1.min())
    order_panel(ax, here, lambda s1, s2: fitted.equal(s1, s2, np.full(len(s1), isi)), low, size=_SIZE)
    about = which_weaker(counts, low)
    ax.set(title=f"{isi:g} s" + (about and f", {about}"), xlabel="stronger stimulus (ln)", yticks=[0.0, 0.5, 1.0])


def _fitted(draws: Draws, subject: str) -> Predictor:
    return Predictor.of(draws, subject, most=CURVE_DRAWS)


def _tested(draws: Draws, subject: str) -> tuple[float, ...]:
    tested = draws.subject(subject).intervals
    if not tested:
        raise InputError(f"subject {subject!r} has no intervals (column isi): there is nothing to draw over them")
    return tested


def _range(tested: tuple[float, ...], isi: npt.ArrayLike | None) -> FloatArray:
    if isi is not None:
        return np.unique(require_intervals(isi))
    return np.geomspace(tested[0] / _BEYOND, tested[-1] * _BEYOND, 120)


def _dress(ax: Axes, x: FloatArray, tested: tuple[float, ...]) -> None:
    """A logarithmic axis in plain numbers, with a mark at every tested interval."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    ax.set_xscale("log")
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if x[-1] / x[0] < 300.0 else (1.0,)))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.set(xlabel="inter-stimulus interval (s)", xlim=(x[0], x[-1]))
    ax.plot(tested, np.full(len(tested), 0.03), "|", color="#111111", ms=7, mew=1.2, transform=ax.get_xaxis_transform())


def _shown_pair(counts: Subject) -> tuple[float, float]:
    """Of the pairs of different stimuli met at most intervals, the one whose answers are nearest to half 'equal'; else an equal pair."""
    low, high = np.minimum(counts.s1, counts.s2), np.maximum(counts.s1, counts.s2)
    found = []
    for weak, strong in sorted(set(zip(low.tolist(), high.tolist(), strict=True))):
        at = (low == weak) & (high == strong)
        share = counts.n_equal[at].sum() / counts.n_trials[at].sum()
        found.append((weak == strong, -int(at.sum()), abs(share - 0.5), weak, strong))
    _, _, _, weak, strong = min(found)
    return weak, strong
