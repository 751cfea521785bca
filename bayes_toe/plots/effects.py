"""What covariates do to the mean of a population."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.words import compared
from bayes_toe.errors import InputError
from bayes_toe.groups.hyperprior_fields import GROUP_PARAMETERS
from bayes_toe.groups.population import Population
from bayes_toe.plots.style import COLUMN, MARKED, POSTERIOR, SMALL, dress, panel, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: The name under which :func:`effects_axes` knows the difference of both orders.
ASYMMETRY = "asymmetry"


def effects_axes(found: Population, parameter: str, ax: Axes | None = None) -> Axes:
    """What covariates do to one parameter, on the scale on which subjects scatter: 5, 50 and 95 %, and the probability of the direction.

    Parameters
    ----------
    found : Population
    parameter : str
        One of `found.names`, or :data:`ASYMMETRY`.
    ax : matplotlib Axes, optional
        Drawn into, where given.

    Raises
    ------
    InputError
        If there is none of this name.
    """
    known = _effects(found)
    if parameter not in known:
        raise InputError(f"effects of covariates: found {parameter!r}, allowed: {', '.join(known)}")
    ax = panel(ax, wide=COLUMN, high=1.0 + 0.4 * len(found.regressors.columns))
    _draw_intervals(ax, known[parameter])
    ax.set_yticks(range(len(found.regressors.columns)), [plain(fill(column.about, 22), 70) for column in found.regressors.columns])
    ax.set_xlabel("asymmetry" if parameter == ASYMMETRY else GROUP_PARAMETERS[parameter].label)
    dress(ax).tick_params(axis="y", length=0)
    ax.spines["left"].set_visible(False)
    return ax


def _effects(found: Population) -> dict[str, FloatArray]:
    """Draws of the effects on everything, shape (draws, r): parameters, and the asymmetry where it can be seen."""
    columns = found.regressors.columns
    if not columns:
        return {}
    of_parameters = {name: found.chains.effects[..., i].reshape(-1, len(columns)) for i, name in enumerate(found.names)}
    if found.asymmetries is None:
        return of_parameters
    of_answers = found.asymmetries.draws[:, :, np.flatnonzero(found.asymmetries.differences), 0]  # in the order of the columns
    return of_parameters | {ASYMMETRY: of_answers.reshape(-1, len(columns))}


def _draw_intervals(ax: Axes, draws: FloatArray) -> None:
    """A row for each column, with its direction over it."""
    low, middle, high = np.quantile(draws, MARKED, axis=0)
    y = np.arange(draws.shape[1])
    ax.axvline(0.0, color="black", lw=0.8)
    ax.hlines(y, low, high, color=POSTERIOR, lw=1.6)
    ax.plot(middle, y, "o", ms=3.4, color=POSTERIOR)
    behind = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
    for i, above in enumerate((draws > 0.0).mean(axis=0).tolist()):
        where = ax.get_yaxis_transform()
        ax.text(0.5, i - 0.18, direction(above), transform=where, ha="center", va="bottom", fontsize=SMALL, bbox=behind)
    reach = 1.08 * float(max(np.abs(low).max(), np.abs(high).max()))
    ax.set(xlim=(-reach, reach), ylim=(len(y) - 0.6, -0.7))
    ax.locator_params(axis="x", nbins=4)


def direction(above: float) -> str:
    """The probability of the sign that is the likelier one."""
    return f"P(> 0) {compared(above)}" if above >= 0.5 else f"P(< 0) {compared(1.0 - above)}"
