"""Ranks, normal scores and quantiles of draws, all from one sort.

Source: Vehtari, Gelman, Simpson, Carpenter, Buerkner 2021, Rank-normalization, folding, and localization, Bayesian Analysis 16, 667-718.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from bayes_toe.arrays import FloatArray, IntArray


class Ordered(NamedTuple):
    """Draws in ascending order: `values[i]` is draw number `order[i]`; both of shape (draws,)."""

    values: FloatArray
    order: IntArray


def split_chains(draws: FloatArray) -> FloatArray:
    """The two halves of every chain, shape (2 chains, draws // 2); the middle one of an odd number of draws belongs to neither."""
    half = draws.shape[1] // 2
    return np.concatenate([draws[:, :half], draws[:, draws.shape[1] - half :]])


def in_order(draws: FloatArray) -> Ordered:
    """Draws of any shape, numbered as in memory.

    Examples
    --------
    >>> in_order(np.array([3.0, 1.0, 2.0])).order.tolist()
    [1, 2, 0]
    """
    flat = draws.ravel()
    order = np.argsort(flat)
    return Ordered(flat[order], order)


def folded(ordered: Ordered) -> Ordered:
    """Distances to the median. Those below it and those above are in order already, and two runs are merged sooner than sorted."""
    values, middle = ordered.values, ordered.values.size // 2
    median = float((values[middle] + values[-middle - 1]) / 2.0)
    distances, turn = np.abs(values - median), np.searchsorted(values, median)
    runs = np.concatenate([np.arange(turn)[::-1], np.arange(turn, values.size)])
    merged = runs[np.argsort(distances[runs], kind="stable")]
    return Ordered(distances[merged], ordered.order[merged])


def normal_scores(ordered: Ordered) -> FloatArray:
    """Normal scores of average ranks, shape (draws,), each in the place of its draw: the normal quantile at (rank - 3/8) / (draws + 1/4).

    Source: Vehtari et al. 2021, equation (14).

    Examples
    --------
    >>> normal_scores(in_order(np.array([5.0, 1.0, 3.0, 3.0]))).round(3).tolist()
    [1.049, -1.049, 0.0, 0.0]
    """
    values = ordered.values
    ends = np.append(np.flatnonzero(values[1:] != values[:-1]) + 1, values.size)
    starts = np.append(0, ends[:-1])
    scores = np.empty(values.size)
    scores[ordered.order] = np.repeat(_scores_of_half_ranks(values.size)[starts + ends - 1], ends - starts)
    return scores


@lru_cache(maxsize=1)  # the quantities of a study have one size
def _scores_of_half_ranks(size: int) -> FloatArray:
    """Normal scores of the ranks 1, 1.5, 2 ... `size`: average ranks of ties are whole or half numbers."""
    scores = np.asarray(ndtri((np.arange(2.0, 2.0 * size + 1.0) / 2.0 - 0.375) / (size + 0.25)), np.float64)
    scores.flags.writeable = False
    return scores


def quantiles(ascending: FloatArray, probabilities: npt.ArrayLike) -> FloatArray:
    """Quantiles of ascending draws, to the bit as numpy's: straight between neighbours, equal draws are their own; NaN where a draw is.

    Examples
    --------
    >>> quantiles(np.array([1.0, 2.0, 4.0]), [0.0, 0.5, 0.75]).tolist()
    [1.0, 2.0, 3.0]
    """
    if np.isnan(ascending[-1]):
        return np.full(np.shape(probabilities), np.nan)
    position = np.asarray(probabilities, np.float64) * (ascending.size - 1)
    below = np.floor(position).astype(int)
    low, high, share = ascending[below], ascending[np.minimum(below + 1, ascending.size - 1)], position - below
    with np.errstate(invalid="ignore"):  # between infinite draws there is no quantile, which NaN says
        step = high - low
        return np.asarray(np.where(share < 0.5, low + step * share, high - step * (1.0 - share)))
