"""The curves of a new subject of a population, over the answers of all that were seen."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.classical.frequencies import presentation_order
from bayes_toe.data.study import Study, Subject
from bayes_toe.groups.population import Population
from bayes_toe.plots.curves import CURVE_DRAWS, Curve, order_panel, pairs_along
from bayes_toe.plots.style import ORDERS, dress, legend_above, panel
from bayes_toe.plots.subject import main_weaker, which_weaker
from bayes_toe.seeds import generator

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def new_subject_axes(found: Population, ax: Axes | None = None) -> Axes:
    """P(equal) of a new subject in both orders, mean and central 50 and 90 % over draws; points: all subjects' answers taken together.

    With covariates, a new subject that has those of a random one of the study. Of pairs at several intervals those at the one that was
    met most often; of several weaker stimuli the one in most pairs, which the panel then names.

    Parameters
    ----------
    found : Population
    ax : matplotlib Axes, optional
        Drawn into, where given.
    """
    ax = panel(ax, high=2.6)
    isi = _main_interval(found.study)
    everyone, equal = _together(found.study if isi is None else found.study.at_isi(isi)), _curve(found, isi)
    reference = main_weaker(everyone)
    low = float(everyone.s1.min()) if reference is None else reference
    order_panel(ax, everyone, None, low, size=4.0)
    for order, (x, s1, s2) in pairs_along(everyone, low, 60).items():
        if (presentation_order(everyone) == order).any():
            _draw_band(ax, x, equal(s1, s2), ORDERS[order].colour)
    ax.set(yticks=[0.0, 0.5, 1.0], ylabel="P('equal')")
    at = "" if isi is None else f" at {isi:g} s"
    who = "new subject with covariates of the study" if found.regressors.columns else "new subject"
    if about := which_weaker(everyone, low):
        ax.set_xlabel(f"stronger stimulus (ln), {about}")
    legend_above(ax, columns=3, title=f"{who}:\nmean, 50 %, dotted 90 %; points: all answers{at}")
    return dress(ax)


def _draw_band(ax: Axes, x: FloatArray, q: FloatArray, colour: str) -> None:
    """Mean and central 50 and 90 % over draws, the latter by their edges alone: bands of both orders lie one over the other."""
    outer, inner, inner_high, outer_high = np.quantile(q, (0.05, 0.25, 0.75, 0.95), axis=0)
    ax.fill_between(x, inner, inner_high, color=colour, alpha=0.2, lw=0)
    ax.plot(x, np.stack([outer, outer_high], axis=1), color=colour, lw=0.9, ls=":")
    ax.plot(x, q.mean(axis=0), color=colour, lw=1.6)


def _curve(found: Population, isi: float | None) -> Curve:
    """P(equal) of pairs for draws of a new subject."""
    posterior, columns, k = found.posterior(found.study.names[0]), found.regressors.x, len(found.names)
    some = slice(None, None, max(1, found.chains.mean[..., 0].size // CURVE_DRAWS))
    eta = found.new_subject().reshape(-1, k)[some]
    effects = found.chains.effects.reshape(len(found.chains.mean) * found.chains.mean.shape[1], -1, k)[some]
    whose = generator(found.settings.seed, "population", "whose covariates").integers(len(columns), size=len(eta))
    x, _ = posterior.from_group(eta + np.einsum("dr,drk->dk", columns[whose], effects))

    def equal(s1: FloatArray, s2: FloatArray) -> FloatArray:
        pairs, which = np.unique(np.column_stack([s1, s2]), axis=0, return_inverse=True)  # a subject has its pairs once, in this order
        once = np.ones(len(pairs), np.int64)
        asked = Subject("new", pairs[:, 0], pairs[:, 1], 0 * once, once, None if isi is None else np.full(len(pairs), isi))
        return np.asarray(np.exp(posterior.for_subject(asked).log_answers(x)[0])[:, which.ravel()])

    return equal


def _together(study: Study) -> Subject:
    """The answers of all subjects as those of one."""
    keys = ("s1", "s2", "n_equal", "n_trials")
    return Subject.from_counts("all", *(np.concatenate([getattr(one, key) for one in study]) for key in keys))


def _main_interval(study: Study) -> float | None:
    if not study.intervals:
        return None
    isi, trials = (np.concatenate([np.asarray(getattr(one, key)) for one in study]) for key in ("isi", "n_trials"))
    return max(study.intervals, key=lambda seconds: int(trials[isi == seconds].sum()))
