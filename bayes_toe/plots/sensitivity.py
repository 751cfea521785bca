"""Figures of prior sensitivity: the log Bayes factor of a subject against the scales of the prior, and where its conclusion turns."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_toe.comparison.prior_sensitivity import SensitivityRow, SensitivityTable
from bayes_toe.comparison.reweighting import REWEIGHTED
from bayes_toe.comparison.words import STRONG
from bayes_toe.plots.figure_files import save_figure
from bayes_toe.plots.style import EQUAL, LETTERS, SMALL, STRONGER_FIRST, dress, first_panels, legend_above, new_figure, panel, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


#: Of the scales and shapes of a prior in their order; a prior with more of them starts anew.
_COLOURS, _MARKERS = (STRONGER_FIRST, "#CC79A7", "#009E73", "#E69F00"), ("o", "s", "^", "D")
_ACROSS, _WIDE, _HIGH = 4, 1.9, 1.75  # panels beside each other, inches of each
_NEAR = 25.0  # a panel shows 0 if its values come this close to it, in nats


def sensitivity_axes(table: SensitivityTable, subject: str, ax: Axes | None = None) -> Axes:
    """Log Bayes factor (nats) of one subject against the factor on each scale of the prior, the other values as given.

    Bands: two standard errors. Filled marks: re-weighted draws; open ones: draws made anew under that prior. Dotted line: the prior given.
    Grey: less than 3 nats, not strong. A cross marks where the sign turns, with the value of the prior there.

    Parameters
    ----------
    table : SensitivityTable
    subject : str
    ax : matplotlib Axes, optional
        Drawn into and titled, where given; its own Axes have a legend.
    """
    own = ax is None
    ax = panel(ax, high=2.6)
    ax.axhspan(-STRONG, STRONG, color="#EEEEEE", lw=0, zorder=0)
    ax.axhline(0.0, color="black", lw=0.8, zorder=1)
    ax.axvline(1.0, color=EQUAL, lw=0.8, ls=":", zorder=1)
    ax.set_xscale("log")
    for place, varied in enumerate(table.scales):
        _draw_scale(ax, table.of(subject, varied), place)
        _mark_turns(ax, table, subject, place)
    factors = [row.factor for row in table.of(subject, table.scales[0]) if row.factor is not None]
    _dress_factors(ax, min(factors), max(factors))
    _set_limits(ax, [row for varied in table.scales for row in table.of(subject, varied)])
    ax.set(xlabel="factor on the prior's scale", ylabel="log Bayes factor (nats)")
    if own:
        legend_above(ax, columns=2)
    else:
        ax.set_title(plain(subject, 20))
    return dress(ax)


def sensitivity_figure(table: SensitivityTable, *, synthetic: bool = False) -> Figure:
    """All subjects of :func:`sensitivity_axes`, each with an axis of its own, four beside each other."""
    names = table.names
    across = min(_ACROSS, len(names))
    down = -(-len(names) // across)
    figure = new_figure(max(_WIDE * across + 0.4, 3.4), _HIGH * down + 1.0)
    for ax, name in zip(first_panels(figure.add_gridspec(down, across), len(names)), names, strict=True):
        sensitivity_axes(table, name, ax).set(xlabel="", ylabel="")
    figure.supylabel("log Bayes factor, H1 minus H0 (nats)", fontsize=LETTERS)
    figure.supxlabel("factor on the prior's scale" + (" (synthetic data)" if synthetic else ""), fontsize=LETTERS)
    found = {label: handle for ax in figure.axes for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    columns = 2 if across > 1 else 1
    figure.legend(found.values(), found.keys(), loc="outside upper center", ncols=columns, frameon=False, fontsize=LETTERS)
    return figure


def save_sensitivity(table: SensitivityTable, path: str | Path, *, synthetic: bool = False, overwrite: bool = False) -> Path:
    """Draw :func:`sensitivity_figure` and write it, whole or not at all; errors as in :func:`bayes_toe.plots.figure_files.save_figure`."""
    return save_figure(sensitivity_figure(table, synthetic=synthetic), path, overwrite=overwrite)


def _draw_scale(ax: Axes, rows: Sequence[SensitivityRow], place: int) -> None:
    colour, marker = _COLOURS[place % len(_COLOURS)], _MARKERS[place % len(_MARKERS)]
    label = rows[0].prior.declared_as(rows[0].varied).label
    factor = np.array([row.factor for row in rows], np.float64)
    value = np.array([row.log_bayes_factor for row in rows], np.float64)  # None becomes NaN: a gap
    error = np.array([row.se for row in rows], np.float64)
    ax.fill_between(factor, value - 2.0 * error, value + 2.0 * error, color=colour, alpha=0.3, lw=0)
    ax.plot(factor, value, "-", color=colour, lw=1.0)
    for old in (True, False):
        at = np.array([(row.method == REWEIGHTED) == old for row in rows])
        said = f"{label}, {'re-weighted' if old else 'sampled anew'}"
        ax.plot(
            factor[at], value[at], marker, ms=3.2, color=colour, mfc=colour if old else "white", mew=0.8, label=said if at.any() else None
        )


def _mark_turns(ax: Axes, table: SensitivityTable, subject: str, place: int) -> None:
    varied, colour, above = table.scales[place], _COLOURS[place % len(_COLOURS)], place % 2 == 0
    given = getattr(table.prior, varied)
    for value in table.turns(subject, varied):
        ax.plot(value / given, 0.0, "x", ms=6.5, mew=1.6, color=colour, zorder=4)
        style: dict[str, Any] = {"ha": "center", "va": "bottom" if above else "top", "textcoords": "offset points"}
        ax.annotate(f"{value:.2g}", (value / given, 0.0), (0, 5 if above else -5), fontsize=SMALL, color=colour, **style)


def _dress_factors(ax: Axes, low: float, high: float) -> None:
    """Powers of two (of ten on a long axis) as ticks."""
    base = 2.0 if high / low <= 64.0 else 10.0
    first, last = np.ceil(np.log(low) / np.log(base) - 1e-9), np.floor(np.log(high) / np.log(base) + 1e-9)
    ticks = base ** np.arange(first, last + 1)
    ax.set_xticks(ticks, [f"{tick:g}" if tick >= 1 or base > 2 else f"1/{1 / tick:g}" for tick in ticks])
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
        ax.text(0.5, 0.5, "no reliable estimate", transform=ax.transAxes, ha="center", va="center", fontsize=SMALL, color=EQUAL)
