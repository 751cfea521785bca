"""Figures of how often a design detects an effect.

`power` draws the share of simulated observers with 'yes' or 'probably' over the number of trials.
`design` draws the pairs of an optimised design.
"""

from __future__ import annotations

from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.answers.order_effect import QUESTIONS
from bayes_toe.answers.words import Word
from bayes_toe.design.optimal_pairs import OptimalDesign
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
    stimulus_scale,
    style_axes,
)

#: Colours of the kinds of observers.
_COLOURS = (EQUAL, "#E69F00", WEAKER_FIRST, STRONGER_FIRST, "#009E73", "#CC79A7")
#: Markers of the kinds of observers, one letter each, which distinguish them in grey.
_MARKERS = "Dos^vP"
#: Area of the mark of the most frequent pair, square points.
_LARGEST_AREA = 160.0


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


# --- An optimised design --------------------------------------------------------------------------


def design(optimal: OptimalDesign) -> Figure:
    """Draw the pairs of a design over the information that one more trial of any pair would add.

    The area of a mark is in proportion to the trials of its pair.
    """
    require_kind("optimal", optimal, OptimalDesign, "OptimalDesign")
    figure = new_figure(4.4, 3.5)
    ax = figure.subplots()
    pairs = optimal.design
    plane = optimal.plane  # all pairs that can be presented
    first_stimuli, column = np.unique(plane.s1, return_inverse=True)
    second_stimuli, row = np.unique(plane.s2, return_inverse=True)
    # The information of each pair, shape (second stimuli, first stimuli); NaN where the plane has
    # no such pair.
    worth = np.full((len(second_stimuli), len(first_stimuli)), np.nan)
    worth[row, column] = optimal.worth

    mesh = ax.pcolormesh(
        first_stimuli,
        second_stimuli,
        1000.0 * worth,
        cmap="Greys",
        shading="nearest",
        vmin=0.0,
        rasterized=True,
    )
    bar = figure.colorbar(mesh, ax=ax, shrink=0.9, pad=0.02)
    bar.set_label("what one more trial adds,\nthousandths of a nat")
    style_axes(bar.ax)
    # A line of equal stimuli.
    lowest = float(first_stimuli[0])
    ax.axline((lowest, lowest), slope=1.0, color=EQUAL, linewidth=0.6, linestyle=":")

    # The pairs: areas in proportion to their trials.
    ax.scatter(
        pairs.s1,
        pairs.s2,
        _LARGEST_AREA * pairs.n_trials / pairs.n_trials.max(),
        facecolor=STRONGER_FIRST,
        edgecolor="white",
        linewidth=0.7,
        alpha=0.85,
        zorder=3,
        clip_on=False,
    )
    # A mark for the legend alone, with a third of the area of the largest mark.
    label = f"this design (largest: {pairs.n_trials.max()} trials)"
    ax.scatter([], [], _LARGEST_AREA / 3, facecolor=STRONGER_FIRST, label=label)

    ax.set_aspect("equal")
    ax.set(xlabel="first stimulus (natural log)", ylabel="second stimulus (natural log)")
    if optimal.unit.stimulus_unit:
        limits = ax.get_xlim()
        scale = stimulus_scale("stimulus", optimal.unit, mean=0.0, limits=limits)
        ticks, texts = scale.ticks(*limits)
        ax.set_xticks(ticks, texts)
        ax.set_yticks(ticks, texts)
        ax.set(xlabel=f"first {scale.label}", ylabel=f"second {scale.label}")
    style_axes(ax)
    legend_outside(figure, side="upper")
    return figure
