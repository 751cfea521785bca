"""Figures of how often a design detects an effect.

`power` draws the share of simulated observers with 'yes' or 'probably' over the number of trials.
"""

from __future__ import annotations

from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.answers.order_effect import QUESTIONS
from bayes_toe.answers.words import Word
from bayes_toe.design.power import DETECTED, PowerTable
from bayes_toe.errors import require_kind
from bayes_toe.plots.style import (
    EQUAL,
    LETTERS,
    PAGE,
    STRONGER_FIRST,
    WEAKER_FIRST,
    Style,
    legend_outside,
    new_figure,
    plain,
    style_axes,
)

#: Colours of the kinds of observers.
_COLOURS = (EQUAL, "#E69F00", WEAKER_FIRST, STRONGER_FIRST, "#009E73", "#CC79A7")
#: Markers of the kinds of observers, one letter each, which distinguish them in grey.
_MARKERS = "Dos^vP"


def power(table: PowerTable) -> Figure:
    """Draw the share of observers with the answer 'yes' or 'probably', by number of trials.

    A row for each design, a panel for each question. Hollow markers: kinds of observers that do not
    have the effect of the question. Bars: 95 % of Monte Carlo error. If a design cannot show an
    effect, the panel says so.
    """
    require_kind("table", table, PowerTable, "PowerTable")
    designs = table.different("design")
    figure = new_figure(PAGE, 2.1 * len(designs) + 0.6)
    axes = figure.subplots(len(designs), len(QUESTIONS), sharey=True, squeeze=False)
    for design, panels in zip(designs, axes, strict=True):
        for question, ax in zip(QUESTIONS, panels, strict=True):
            _draw_question(ax, table, design, question)
        panels[0].set_ylabel(f"proportion, {plain(design)}")
    for question, ax in zip(QUESTIONS, axes[0], strict=True):
        ax.set_title(f"{question.replace('_', ' ')}: yes or probably", fontsize=LETTERS)
    for ax in axes[-1]:
        ax.set_xlabel("trials of a subject")
    # These marks have no points, and are in the legend alone.
    panel = axes[0, 0]
    panel.plot([], [], "o", mec=EQUAL, mfc="white", ms=3.6, label="hollow: without this effect")
    panel.plot([], [], "|", color=EQUAL, ms=9.0, label="95 % interval")
    legend_outside(figure, columns=4, side="upper")
    return figure


def _draw_question(ax: Axes, table: PowerTable, design: str, question: str) -> None:
    """Draw the shares of all kinds of observers in one panel, a line for each kind."""
    trials = [n_trials for name, n_trials in table.different("design", "trials") if name == design]
    # Each number of trials has a place of width 1 on the axis.
    ax.set(xlim=(-0.5, len(trials) - 0.5), ylim=(-0.04, 1.04))
    ax.set_xticks(range(len(trials)), [f"{n_trials:,}" for n_trials in trials])
    style_axes(ax)
    # The places of the numbers of trials with which the design can show the effect.
    places = [i for i, n in enumerate(trials) if not table.is_unknown(design, n, question)]
    if not places:
        words = Word.CANNOT_BE_TOLD.value
        ax.text(0.5, 0.5, words, transform=ax.transAxes, ha="center", fontsize=LETTERS)
        return

    kinds = table.different("observers")
    styles = zip(kinds, cycle(_COLOURS), cycle(_MARKERS), strict=False)
    for index, (kind, colour, marker) in enumerate(styles):
        points = []
        for place in places:
            share = table[design, trials[place], kind, question, DETECTED]
            points.append((share.value, share.low, share.high))
        y, low, high = np.array(points).T
        # The kinds stand side by side in the middle 0.8 of a place.
        x = np.array(places) + 0.8 * ((index + 0.5) / len(kinds) - 0.5)

        style: Style = {"fmt": marker, "color": colour, "ms": 3.6, "ls": "-"}
        if not table.has_effect(kind, question):
            style |= {"ls": ":", "mfc": "white"}
        # The legend has the markers of this question, which are full for most kinds.
        if question == "order_effect":
            style["label"] = plain(kind)
        ax.errorbar(x, y, (y - low, high - y), lw=0.8, elinewidth=0.8, **style)
