"""One quantity of every subject of a group, alone and in the light of the others."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.groups.population import Population
from bayes_toe.plots.said_interval import said_interval
from bayes_toe.plots.sorted import HIGH
from bayes_toe.plots.style import BAND, BELIEF, LABELS, MARKED, POSTERIOR, SMALL, dress, panel, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Subjects beyond which they have no names, and no interval of their own beside that in the group.
MOST_NAMED_IN_GROUP = 40
LONGEST = 14  # letters of a name
_DRAWS = 1000  # of each subject, for quantiles
_ALONE, _MEAN = "#8C8C8C", "#BDB3DD"


class Marked(NamedTuple):
    """Quantiles 5, 50 and 95 % of one quantity, first axis, of every subject alone and in the group, of the mean, and of a new subject."""

    alone: FloatArray
    group: FloatArray
    mean: FloatArray
    new: FloatArray


def main_quantities(found: Population) -> tuple[str, ...]:
    """What the answers depend on, with mu1 in the place of the offset that follows from it."""
    names = found.posterior(found.study.names[0]).names
    return tuple("mu1" if name == "offset" and "mu1" in names.natural else name for name in names.identified)


def marked(found: Population) -> dict[str, Marked]:
    """Quantiles of every quantity, by its name."""
    k, members = len(found.names), found.chains.eta.reshape(-1, len(found.study), len(found.names))
    of = (found.unpooled, members), (found.chains.mean.reshape(-1, k), found.new_subject().reshape(-1, k))
    thinned = [eta[:: max(1, len(eta) // _DRAWS)] for eta in of[0]]
    quantiles = [
        {name: np.quantile(values, MARKED, axis=0) for name, values in found.quantities(eta).items()} for eta in (*thinned, *of[1])
    ]
    return {name: Marked(*(one[name] for one in quantiles)) for name in quantiles[0]}


def forest_axes(found: Population, quantity: str, ax: Axes | None = None, *, values: Marked | None = None) -> Axes:
    """One quantity of every subject, alone (thin) and in the group (bold), 5, 50 and 95 %, before the population's mean and a new subject.

    More than :data:`MOST_NAMED_IN_GROUP` subjects are sorted by their median in the group, and drawn as they are in it alone.

    Parameters
    ----------
    found : Population
    quantity : str
    ax : matplotlib Axes, optional
        Drawn into, where given.
    values : Marked, optional
        Made here where they are not given.
    """
    shown = marked(found)[quantity] if values is None else values
    ax = panel(ax, wide=2.4, high=forest_height(found))
    at = " at reference" if found.regressors.columns else ""
    ax.axvspan(shown.new[0], shown.new[2], color=BAND, lw=0, label=f"new subject{at}")
    ax.axvspan(
        shown.mean[0], shown.mean[2], color=_MEAN, lw=0, label=f"typical subject (mean{' at reference' * bool(found.regressors.columns)})"
    )
    ax.axvline(shown.mean[1], color=BELIEF, lw=0.8)
    if len(found.study) > MOST_NAMED_IN_GROUP:
        _draw_ranked(ax, shown.group)
    else:
        _limit(ax, shown)
        _draw_named(ax, shown, [plain(name, LONGEST) for name in found.study.names])
    ax.set_xlabel(LABELS.get(quantity, quantity))
    ax.locator_params(axis="x", nbins=4)
    dress(ax).tick_params(axis="y", length=0)
    ax.set_title(said_interval(shown.mean), fontsize=SMALL, color=BELIEF)
    return ax


def _draw_named(ax: Axes, shown: Marked, names: list[str]) -> None:
    y = np.arange(len(names))
    low, high = ax.get_xlim()
    ax.hlines(y - 0.2, shown.alone[0], shown.alone[2], color=_ALONE, lw=0.7)
    ax.plot(shown.alone[1], y - 0.2, "o", ms=2.6, mfc="white", mec=_ALONE, mew=0.7, label="subject alone (5-50-95 %)")
    for edge, marker, beyond in ((low, "<", shown.alone[0] < low), (high, ">", shown.alone[2] > high)):
        ax.plot(np.full(beyond.sum(), edge), y[beyond] - 0.2, marker, ms=2.6, color=_ALONE, mew=0, clip_on=False)
    ax.hlines(y + 0.15, shown.group[0], shown.group[2], color=POSTERIOR, lw=1.6)
    ax.plot(shown.group[1], y + 0.15, "o", ms=3.4, color=POSTERIOR, mec="white", mew=0.4, label="in the group")
    ax.set_yticks(y, names)
    ax.set_ylim(len(names) - 0.5, -0.6)


def _draw_ranked(ax: Axes, group: FloatArray) -> None:
    low, middle, high = group[:, np.argsort(group[1], kind="stable")]
    y = np.arange(len(middle))
    ax.hlines(y, low, high, color=POSTERIOR, lw=min(1.2, 160.0 / len(y)), alpha=0.6)
    ax.plot(middle, y, "o", ms=1.8 if len(y) <= 100 else 1.2, color=POSTERIOR, label="subjects in the group (5-50-95 %)")
    ax.set(ylim=(len(y) - 0.5, -0.5), yticks=[])


def _limit(ax: Axes, shown: Marked) -> None:
    """The group with room for what subjects alone say, but no more than half as much again: a subject alone may say nothing."""
    inner = float(min(shown.group[0].min(), shown.new[0])), float(max(shown.group[2].max(), shown.new[2]))
    more = 0.25 * (inner[1] - inner[0])
    low, high = max(inner[0] - more, float(shown.alone[0].min())), min(inner[1] + more, float(shown.alone[2].max()))
    low, high = min(low, inner[0]), max(high, inner[1])
    pad = 0.03 * (high - low)
    ax.set_xlim(low - pad, high + pad)


def forest_height(found: Population) -> float:
    """Inches of a forest."""
    subjects = len(found.study)
    return 0.75 + (0.6 * HIGH if subjects > MOST_NAMED_IN_GROUP else max(0.8, subjects * (0.2 if subjects <= 20 else 0.16)))
