"""Figures of prior sensitivity: the log Bayes factor of a subject against the scales of the prior, and where its conclusion turns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.comparison.prior_sensitivity import REWEIGHTED, SensitivityRow, SensitivityTable
from bayes_toe.comparison.words import STRONG
from bayes_toe.model.prior_fields import STIMULI
from bayes_toe.plots.style import (
    EQUAL,
    LETTERS,
    SMALL,
    STRONGER_FIRST,
    dress,
    first_panels,
    new_figure,
    plain,
)

#: Of the values of a prior in their order; a prior with more of them starts anew.
_COLOURS = (
    STRONGER_FIRST,
    "#CC79A7",
    "#009E73",
    "#E69F00",
    "#333333",
    "#56B4E9",
    "#7B3294",
    "#8B4513",
)
_MARKERS = ("o", "s", "^", "D", "v", "<", ">", "P")
_GIVEN, _WEAK = "the prior given", f"within {STRONG:g} nats of 0: not strong"
_ANEW, _TURNS = "open: sampled anew, not re-weighted", "the sign turns, at this value of the prior"
_EXPLAINED = (_GIVEN, _WEAK, _TURNS, _ANEW)
_ACROSS, _WIDE, _HIGH = 4, 1.9, 1.75  # panels beside each other, inches of each
_BESIDE = 3.1  # inches that words beside few panels take
_LETTERS_AN_INCH = 15.0  # of words below
_NEAR = 25.0  # a panel shows 0 if its values come this close to it, in nats


def _draw_subject(ax: Axes, table: SensitivityTable, subject: str) -> None:
    """Log Bayes factor (nats) of one subject against the factor on each scale of the prior, the other values as given."""
    ax.axhspan(-STRONG, STRONG, color="#EEEEEE", lw=0, zorder=0, label=_WEAK)
    ax.axhline(0.0, color="black", lw=0.8, zorder=1)
    ax.axvline(1.0, color=EQUAL, lw=0.8, ls=":", zorder=1, label=_GIVEN)
    ax.set_xscale("log")
    factors = [row.factor for row in table.of(subject, table.scales[0]) if row.factor is not None]
    low, high = min(factors), max(factors)
    scans = {varied: _scan(table, subject, varied, high) for varied in table.varied}
    for place, scan in enumerate(scans.values()):
        _draw_scan(ax, scan, place)
    _dress_factors(ax, low, high)
    _set_limits(ax, [row for scan in scans.values() for row in scan.rows])
    turns = {
        place: (scan, found)
        for place, (varied, scan) in enumerate(scans.items())
        if (found := table.turns(subject, varied))
    }
    for rank, (place, (scan, found)) in enumerate(turns.items()):
        _mark_turns(ax, scan, found, _COLOURS[place % len(_COLOURS)], rank)
    ax.set_title(plain(subject, 20))
    dress(ax)


def sensitivity_figure(table: SensitivityTable, *, synthetic: bool = False) -> Figure:
    """Log Bayes factor (nats) of every subject against the factor on each scale of the prior, the other values as given.

    Locations are shifted from left to right, by one prior standard deviation at the ends. Bands: two standard errors. Filled marks:
    re-weighted draws; open ones: draws made anew under that prior. Dotted line: the prior given. Grey: less than 3 nats, no strong
    evidence for either side. A cross marks where the sign turns, with the value of the prior there.
    """
    names = table.names
    across = min(_ACROSS, len(names))
    down = -(-len(names) // across)
    beside = across < 3  # words beside few panels, above many
    figure = new_figure(_WIDE * across + (_BESIDE if beside else 0.4), _HIGH * down + 1.0)
    for ax, name in zip(
        first_panels(figure.add_gridspec(down, across), len(names)), names, strict=True
    ):
        _draw_subject(ax, table, name)
    figure.supylabel("log Bayes factor, H1 minus H0 (nats)", fontsize=LETTERS)
    words = "factor on the prior's scale; its mean of mu1 is shifted instead" + (
        " (synthetic data)" if synthetic else ""
    )
    figure.supxlabel(fill(words, int(_LETTERS_AN_INCH * figure.get_figwidth())), fontsize=LETTERS)
    found = {
        label: handle
        for ax in figure.axes
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)
    }
    scans = [
        label for label in found if label not in _EXPLAINED
    ]  # first, whichever subject has which of the others
    order = [*scans, *(label for label in _EXPLAINED if label in found)]
    place: dict[str, Any] = (
        {"loc": "outside right center"} if beside else {"loc": "outside upper center", "ncols": 3}
    )
    figure.legend([found[label] for label in order], order, frameon=False, fontsize=SMALL, **place)
    return figure


class _Scan(NamedTuple):
    """One value of the prior, varied: what it is called, its rows, and where a value of the prior stands across, as a factor."""

    label: str
    rows: Sequence[SensitivityRow]
    across: Callable[[float], float]


def _scan(table: SensitivityTable, subject: str, varied: str, reach: float) -> _Scan:
    """A scale stands at its factor, a location as far to the side as it is shifted, up to `reach`."""
    rows, given = table.of(subject, varied), table.given(subject, varied)
    declared, half = rows[0].prior.declared_as(varied), max(abs(row.value - given) for row in rows)
    if declared.positive:
        return _Scan(declared.label, rows, lambda value: value / given)
    ends = "shifted by its sd"  # another one for each subject
    if getattr(table.prior, varied) != STIMULI:
        ends = f"from {rows[0].value:.3g} to {rows[-1].value:.3g}".replace("-", "−")
    return _Scan(
        f"{declared.label}, {ends}",
        rows,
        lambda value: reach ** ((value - given) / half) if half > 0.0 else 1.0,
    )


def _draw_scan(ax: Axes, scan: _Scan, place: int) -> None:
    colour, marker = _COLOURS[place % len(_COLOURS)], _MARKERS[place % len(_MARKERS)]
    at = np.array([scan.across(row.value) for row in scan.rows])
    value = np.array(
        [row.log_bayes_factor for row in scan.rows], np.float64
    )  # None becomes NaN: a gap
    error = np.array([row.se for row in scan.rows], np.float64)
    anew = np.array([row.method != REWEIGHTED for row in scan.rows])
    style: dict[str, Any] = {"ms": 3.2, "color": colour, "mew": 0.8}
    ax.fill_between(at, value - 2.0 * error, value + 2.0 * error, color=colour, alpha=0.3, lw=0)
    ax.plot(at, value, "-", color=colour, lw=1.0)
    ax.plot(at[~anew], value[~anew], marker, mfc=colour, label=scan.label, **style)
    if anew.any():
        ax.plot(at[anew], value[anew], marker, mfc="white", **style)
        ax.plot([], [], "o", ms=3.2, color=EQUAL, mfc="white", mew=0.8, label=_ANEW)


def _mark_turns(ax: Axes, scan: _Scan, turns: Sequence[float], colour: str, rank: int) -> None:
    """Crosses with the value of the prior; words of each scan at a height of their own, on the side where the panel has room."""
    bottom, top = ax.get_ylim()
    way, away = (1 if top > -bottom else -1), 5 + 8 * rank
    for value in turns:
        at = scan.across(value)
        ax.plot(at, 0.0, "x", ms=6.5, mew=1.6, color=colour, zorder=4)
        style: dict[str, Any] = {
            "ha": "center",
            "va": "bottom" if way > 0 else "top",
            "textcoords": "offset points",
        }
        ax.annotate(
            f"{value:.2g}".replace("-", "−"),
            (at, 0.0),
            (0, way * away),
            fontsize=SMALL,
            color=colour,
            **style,
        )
    ax.plot([], [], "x", ms=6.5, mew=1.6, color=EQUAL, label=_TURNS)


def _dress_factors(ax: Axes, low: float, high: float) -> None:
    """Powers of two (of ten on a long axis) as ticks."""
    base = 2.0 if high / low <= 64.0 else 10.0
    first, last = (
        np.ceil(np.log(low) / np.log(base) - 1e-9),
        np.floor(np.log(high) / np.log(base) + 1e-9),
    )
    ticks = base ** np.arange(first, last + 1)
    ax.set_xticks(
        ticks, [f"{tick:g}" if tick >= 1 or base > 2 else f"1/{1 / tick:g}" for tick in ticks]
    )
    ax.minorticks_off()


def _set_limits(ax: Axes, rows: Sequence[SensitivityRow]) -> None:
    """Room around the values; with 0 where they come near it, so that the reader sees how near."""
    known = [row.log_bayes_factor for row in rows if row.log_bayes_factor is not None]
    low, high = (min(known), max(known)) if known else (-STRONG, STRONG)
    if min(abs(low), abs(high)) < _NEAR:
        low, high = min(low, -1.0), max(high, 1.0)
    pad = max(0.08 * (high - low), 0.5)
    ax.set_ylim(low - pad, high + pad)
    if not known:
        ax.text(
            0.5,
            0.5,
            "no reliable estimate",
            transform=ax.transAxes,
            ha="center",
            va="center",
            fontsize=SMALL,
            color=EQUAL,
        )
