"""Does a model describe how answers follow the trial before? A posterior predictive check that can see it.

Deviances of pairs cannot: every pair is preceded by all others. The statistic here is Pearson's X^2 of the answers over pair times third of
the mean stimulus of the trial before, against answers replicated from the same draws.
"""

from __future__ import annotations

import numpy as np

from bayes_toe.arrays import FloatArray, IndexArray
from bayes_toe.inference.predictive_checks import MISFIT
from bayes_toe.model.history import Trials
from bayes_toe.model.posterior import Posterior
from bayes_toe.seeds import generator

#: Draws of a check: its standard error is then 0.016 at most, 0.003 at 0.01.
HISTORY_DRAWS = 1000
#: Below this p-value, that of every misfit, a verdict says so and `run` tries histories.
SCREEN = MISFIT
_FEWEST, _MOST = 200, 1 << 26  # draws that are taken in any case; draws times trials beyond which others are left out


def history_p(posterior: Posterior, x: FloatArray, seed: int) -> float:
    """Posterior predictive p-value of the answers by pair and third of the trial before; NaN where no trial has one.

    Parameters
    ----------
    posterior : Posterior
        Of a subject whose order of trials is known.
    x : array, shape (draws, k)
        Independent posterior draws.
    seed : int
    """
    trials, rng = Trials.of(posterior.subject), generator(seed, posterior.subject.name, posterior.model.name, "history")
    known = ~np.isnan(trials.previous)
    if not known.any():
        return float("nan")
    cell = previous_third(trials)[known] + 3 * np.repeat(np.arange(len(trials.starts)), np.diff(np.r_[trials.starts, len(known)]))[known]
    cells = np.unique(cell, return_inverse=True)[1]
    order = np.argsort(cells, kind="stable")
    starts = np.flatnonzero(np.diff(cells[order], prepend=-1))
    yes, more = trials.n_yes[known][order].astype(np.float64), 0
    x = x[: max(_FEWEST, _MOST // len(yes))]
    for points in np.array_split(x, max(1, x.shape[0] * len(yes) >> 18)):
        p = np.exp(posterior.trial_answers(points))[:, known][:, order]
        expected, variance = (np.add.reduceat(values, starts, axis=1) for values in (p, p * (1.0 - p)))
        found, again = (
            np.square(np.add.reduceat(answers, starts, axis=1) - expected)
            for answers in (yes[None] + 0.0 * p, (rng.random(p.shape) < p).astype(np.float64))
        )
        told = variance > 0.0  # answers that are certain add nothing
        observed, replicated = (np.divide(one, variance, out=np.zeros_like(one), where=told).sum(axis=1) for one in (found, again))
        more += int(np.count_nonzero(replicated >= observed))
    return more / len(x)


def previous_third(trials: Trials) -> IndexArray:
    """Into which third of them the mean stimulus of the trial before falls, 0 to 2; 2 where there is none."""
    edges = np.nanquantile(trials.previous, [1 / 3, 2 / 3])
    return np.searchsorted(edges, trials.previous, side="right")
