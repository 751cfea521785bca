"""What the prior says that observers do on a study's pairs, beside what its subjects did: a look before the evidence is believed."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.data.study import Study
from bayes_toe.experiments.prior_predictive import RARELY, PriorPrediction, prior_predictive
from bayes_toe.model.ladder import PREDICTIVE_UPDATE, Record
from bayes_toe.model.prior import Prior
from bayes_toe.plots.style import LETTERS, ORDERS, PAGE, chance, dress, legend_above, new_figure

_OUTER, _INNER = "#E3E3E3", "#BDBDBD"
_BANDS = ((0.05, 0.95, _OUTER, "prior, 5 to 95 %"), (0.25, 0.75, _INNER, "prior, 25 to 75 %"))


def prior_predictive_figure(
    study: Study,
    prior: Prior | str | None = None,
    model: str | Record = PREDICTIVE_UPDATE.name,
    *,
    seed: int = 0,
) -> Figure:
    """P('equal'), or P('second'), of every pair over observers drawn from the prior, beside what the subjects did.

    Left: median and central 50 and 90 %; points: each subject's frequency; pairs from left to right by s2 - s1, so the stronger stimulus
    first on the left. In designs of more than 40 pairs those of one order with similar distances are taken together. Right: each observer's
    largest P against the subjects' largest shares; its words count who gives that answer to every pair in less than 5 %.

    Parameters
    ----------
    study : Study
    prior : Prior or str, optional
        As :func:`bayes_toe.prior_for` takes it.
    model : str
        A model's name or composition.
    seed : int
        Of the draws from the prior.

    Raises
    ------
    InputError
        If there is no such prior or model.
    """
    found = prior_predictive(study, prior, model, seed=seed)
    figure = new_figure(PAGE, 3.3)
    left, right = figure.subplots(1, 2, width_ratios=(2.4, 1.0))
    _bands(found, left)
    _largest(found, right)
    synthetic = " (synthetic data)" if found.synthetic else ""
    figure.suptitle(
        f"{found.model}: observers drawn from the prior, and the subjects{synthetic}",
        fontsize=LETTERS,
    )
    return figure


def _bands(found: PriorPrediction, ax: Axes) -> None:
    x = np.arange(found.equal.shape[1])
    for low, high, colour, label in _BANDS:
        bottom, top = np.quantile(found.equal, [low, high], axis=0)
        ax.bar(x, top - bottom, 0.86, bottom, color=colour, label=label, zorder=1)
    ax.hlines(
        np.median(found.equal, axis=0),
        x - 0.43,
        x + 0.43,
        color="black",
        lw=0.9,
        label="prior, median",
        zorder=2,
    )
    subjects = len(found.n_trials)
    beside = np.linspace(-0.3, 0.3, subjects) if subjects > 1 else np.zeros(1)
    met, order = found.n_trials > 0, -np.sign(found.distance)
    for sign in (1, 0, -1):  # as they come from left to right
        mark = ORDERS[sign]
        who, where = np.nonzero(met & (order == sign))
        if len(who):
            share = found.n_yes[who, where] / found.n_trials[who, where]
            size = 4.5 if subjects == 1 else 3.2 if subjects <= 16 else 2.2
            style: dict[str, Any] = {"color": mark.colour, "mec": "white", "mew": 0.3}
            ax.plot(
                where + beside[who],
                share,
                mark.marker,
                ms=size,
                clip_on=False,
                label=mark.label,
                zorder=3,
                **style,
            )
    ax.set(xlim=(-0.6, len(x) - 0.4), ylim=(0.0, 1.0), ylabel=chance(found.pairs.task))
    ax.set_xticks(x, _names(found), rotation=90 if len(x) > 6 else 0)
    ax.set_xlabel(
        "mean $s_2 - s_1$ of pairs taken together"
        if found.grouped
        else "pair, $s_1$ then $s_2$, ordered by $s_2 - s_1$"
    )
    legend_above(ax, columns=3)
    dress(ax)


def _names(found: PriorPrediction) -> list[str]:
    """A name for each group: its pair, with its interval where there are such, or the mean distance."""
    if found.grouped:
        return [
            f"{distance:+.2g}".replace("-", "−") if distance else "0" for distance in found.distance
        ]
    pairs, first = found.pairs, np.argsort(found.group)
    seconds = [""] * pairs.n_pairs if pairs.isi is None else [f" ({isi:g} s)" for isi in pairs.isi]
    return [f"{pairs.s1[i]:.3g}, {pairs.s2[i]:.3g}{seconds[i]}".replace("-", "−") for i in first]


def _largest(found: PriorPrediction, ax: Axes) -> None:
    edges = np.linspace(0.0, 1.0, 21)  # the first bar is those below 5 %
    share = 100.0 * np.histogram(found.largest, edges)[0] / len(found.largest)
    observed, top = found.largest_observed, share.max()
    ax.bar(
        edges[:-1],
        share,
        np.diff(edges),
        align="edge",
        color=_INNER,
        edgecolor="white",
        lw=0.4,
        label="prior",
    )
    ax.plot(
        observed,
        np.full(len(observed), 1.08 * top),
        "|",
        ms=7.0,
        mew=0.9,
        color="black",
        label="subjects",
    )
    ax.set(
        xlim=(-0.02, 1.02),
        ylim=(0.0, 1.15 * top),
        xlabel=f"largest {chance(found.pairs.task)} over pairs",
        ylabel="prior's observers (%)",
    )
    silent = float(
        f"{100 * np.mean(found.largest < RARELY):.2g}"
    )  # two digits: what draws of a few thousand observers tell
    subjects = (
        f"{np.sum(observed < RARELY)} of {len(observed)} subject{'' if len(observed) == 1 else 's'}"
    )
    said = f"all pairs '{found.pairs.task.yes}' in < {100 * RARELY:g} %:\n{silent:g} % of the prior's observers,\n{subjects}"
    legend_above(ax, columns=2, title=said)
    dress(ax)
