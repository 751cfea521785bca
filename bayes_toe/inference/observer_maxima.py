"""The maxima of posteriors with the observer's coordinates, with which their mixtures begin."""

from __future__ import annotations

from typing import cast

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray, IndexArray
from bayes_toe.inference.maxima import Ascent, ascend_from
from bayes_toe.model.observer import ObserverRows
from bayes_toe.model.parameters import CONSTANT_ERROR, LAPSE_RATE
from bayes_toe.model.posterior_array import PosteriorArray

#: Constant errors, in D, at which the other coordinates are maximised.
_CONSTANT_ERRORS = (0.0, -0.4, 0.4, -0.9, 0.9, -2.0, 2.0, -4.0, 4.0)
#: Normal scores of the lapse rate at which the other coordinates are maximised.
_LAPSE_SCORES = (-1.0, 0.6, 1.8)
_START_PEAK = 2.0  # logit of q0 where a search begins
_START_NOISE = -0.5  # score of the noise there; a steep curve shows more than a flat one
_FLAT_NOISE = 2.0  # score of the noise of a flat curve


def observer_maxima(array: PosteriorArray) -> list[Ascent]:
    """The maxima of every posterior with the observer's coordinates, as a mixture begins with.

    A search starts at several constant errors and from a flat curve, then at several lapse rates.
    A posterior without constant error must have its neighbour with it next to it.
    """
    profile, profile_owners, values = _profile(array)
    starts, owners, is_held = _second_starts(array, profile, profile_owners, values)
    second = ascend_from(array, owners, starts, is_held)
    # A search along the constant error is of the posteriors that have it.
    return profile.joined(second).by_owner(np.concatenate([profile_owners, owners]))


def _start(array: PosteriorArray, noise: float) -> FloatArray:
    """A point from which to search, (d,)."""
    values = {"noise": noise, "q0": _START_PEAK}
    return np.array([values.get(name, 0.0) for name in array.names])


def _profile(array: PosteriorArray) -> tuple[Ascent, IndexArray, FloatArray]:
    """Maxima along the constant error, and one from a flat curve for every posterior."""
    rows = cast(ObserverRows, array.likelihood.rows)
    error, n_values = array.names.index(CONSTANT_ERROR.name), len(_CONSTANT_ERRORS)
    with_error = np.flatnonzero(array.is_free[:, error])
    held_owners = np.repeat(with_error, n_values)
    values = np.tile(_CONSTANT_ERRORS, len(with_error))
    starts = np.tile(_start(array, _START_NOISE), (len(held_owners), 1))
    starts[:, error] = values / rows.prior.constant_error_scale

    flat = np.tile(_start(array, _FLAT_NOISE), (len(array), 1))
    is_held = np.zeros((len(starts) + len(flat), len(array.names)), np.bool_)
    is_held[: len(starts), error] = True
    owners = np.concatenate([held_owners, np.arange(len(array))])
    maxima = ascend_from(array, owners, np.concatenate([starts, flat]), is_held)
    return maxima, owners, values


def _second_starts(
    array: PosteriorArray, profile: Ascent, owners: IndexArray, values: FloatArray
) -> tuple[FloatArray, IndexArray, BoolArray]:
    """Starts of free maxima, and of those with lapse rates held."""
    n_held = len(values)  # the searches after these start from a flat curve
    lapse = array.names.index(LAPSE_RATE.name)
    starts: list[FloatArray] = []
    start_owners: list[int] = []
    lapse_is_held: list[bool] = []
    for i in range(len(array)):
        candidates = _profile_maxima(array, i, owners[:n_held], values, profile)
        flat = n_held + i
        best = flat if profile.value[flat] > profile.value[candidates[0]] else candidates[0]
        free = profile.x[candidates]
        with_lapse = np.tile(profile.x[best], (len(_LAPSE_SCORES), 1))
        with_lapse[:, lapse] = _LAPSE_SCORES
        starts += [*free, *with_lapse]
        start_owners += [i] * (len(free) + len(with_lapse))
        lapse_is_held += [False] * len(free) + [True] * len(with_lapse)
    is_held = np.zeros((len(starts), len(array.names)), np.bool_)
    is_held[:, lapse] = lapse_is_held
    return np.array(starts), np.array(start_owners), is_held


def _profile_maxima(
    array: PosteriorArray, i: int, owners: IndexArray, values: FloatArray, profile: Ascent
) -> IndexArray:
    """The maxima of a profile from which a posterior starts, the best first.

    A posterior without constant error starts at the maximum of its neighbour with c = 0.
    """
    if array.is_free[i, array.names.index(CONSTANT_ERROR.name)]:
        searches = np.flatnonzero(owners == i)
        return searches[_two_best_local(values[searches], profile.value[searches])]
    searches = np.flatnonzero(owners == i + 1)
    return searches[values[searches] == 0.0]


def _two_best_local(values: FloatArray, heights: FloatArray) -> IndexArray:
    """Places of the two highest local maxima along sorted values, the highest first."""
    order = np.argsort(values)
    padded = np.concatenate([[-np.inf], heights[order], [-np.inf]])
    is_local = (padded[1:-1] >= padded[:-2]) & (padded[1:-1] >= padded[2:])
    local = order[is_local]
    ranked = local[np.argsort(-heights[local])]
    if len(ranked) < 2:
        by_height = np.argsort(-heights)
        ranked = np.concatenate([ranked, by_height[by_height != ranked[0]]])
    return ranked[:2]
