"""The maxima of posteriors, with which their mixtures begin.

`observer_maxima` searches the posteriors of the four models and of conditions, `paper_maxima` those
of the paper's model (H1). `funnel_of_maxima` has the funnel about the maxima of H1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
from scipy.special import logit, ndtri

from bayes_toe.arrays import BoolArray, FloatArray, IndexArray
from bayes_toe.inference.maxima import Ascent, ascend_from
from bayes_toe.model.densities import probit_of_logit
from bayes_toe.model.funnel import Funnel
from bayes_toe.model.observer import ObserverRows
from bayes_toe.model.paper_equations import pull
from bayes_toe.model.paper_rows import PaperRows
from bayes_toe.model.parameters import CONSTANT_ERROR, LAPSE_RATE
from bayes_toe.model.posterior_array import PosteriorArray


def observer_maxima(array: PosteriorArray) -> list[Ascent]:
    """The maxima of every posterior with the observer's coordinates, as a mixture begins with.

    A search starts at several constant errors and from a flat curve, then at several lapse rates.
    A posterior without constant error must have its neighbour with it next to it.
    """
    profile, profile_owners, errors = _profile(array)
    starts, owners, is_held = _second_starts(array, profile, profile_owners, errors)
    second = ascend_from(array, owners, starts, is_held)
    return profile.joined(second).by_owner(np.concatenate([profile_owners, owners]))


def _start(array: PosteriorArray, noise: float) -> FloatArray:
    """A point from which to search, (d,), from the score of the noise."""
    values = {"noise": noise, "q0": 2.0}
    return np.array([values.get(name, 0.0) for name in array.names])


def _profile(array: PosteriorArray) -> tuple[Ascent, IndexArray, FloatArray]:
    """Maxima at several constant errors, and one from a flat curve for every posterior.

    The first searches hold the constant error. The second value has the posterior of each search,
    and the third one the constant errors that are held, in D.
    """
    rows = cast(ObserverRows, array.likelihood.rows)
    error = array.names.index(CONSTANT_ERROR.name)
    errors_in_d = (0.0, -0.4, 0.4, -0.9, 0.9, -2.0, 2.0, -4.0, 4.0)

    with_error = np.flatnonzero(array.is_free[:, error])
    held_owners = np.repeat(with_error, len(errors_in_d))
    errors = np.tile(errors_in_d, len(with_error))
    # A steep curve shows more than a flat one.
    starts = np.tile(_start(array, noise=-0.5), (len(held_owners), 1))
    starts[:, error] = errors / rows.prior.constant_error_scale

    flat = np.tile(_start(array, noise=2.0), (len(array), 1))
    is_held = np.zeros((len(starts) + len(flat), len(array.names)), np.bool_)
    is_held[: len(starts), error] = True

    owners = np.concatenate([held_owners, np.arange(len(array))])
    maxima = ascend_from(array, owners, np.concatenate([starts, flat]), is_held)
    return maxima, owners, errors


def _second_starts(
    array: PosteriorArray,
    profile: Ascent,
    owners: IndexArray,
    errors: FloatArray,
    lapse_scores: tuple[float, ...] = (-1.0, 0.6, 1.8),
) -> tuple[FloatArray, IndexArray, BoolArray]:
    """Starts of free searches at the maxima of a profile, and of searches with lapse rates held.

    The other values are the posterior of each search, and which coordinates it holds.
    """
    n_held = len(errors)  # the searches after these start from a flat curve
    lapse = array.names.index(LAPSE_RATE.name)

    starts: list[FloatArray] = []
    start_owners: list[int] = []
    lapse_is_held: list[bool] = []
    for i in range(len(array)):
        candidates = _profile_maxima(array, i, owners[:n_held], errors, profile)
        flat = n_held + i
        best = flat if profile.value[flat] > profile.value[candidates[0]] else candidates[0]

        free = profile.x[candidates]
        with_lapse = np.tile(profile.x[best], (len(lapse_scores), 1))
        with_lapse[:, lapse] = lapse_scores

        starts += [*free, *with_lapse]
        start_owners += [i] * (len(free) + len(with_lapse))
        lapse_is_held += [False] * len(free) + [True] * len(with_lapse)

    is_held = np.zeros((len(starts), len(array.names)), np.bool_)
    is_held[:, lapse] = lapse_is_held
    return np.array(starts), np.array(start_owners), is_held


def _profile_maxima(
    array: PosteriorArray, i: int, owners: IndexArray, errors: FloatArray, profile: Ascent
) -> IndexArray:
    """The searches of a profile at whose ends a posterior starts, the best first.

    A posterior without constant error starts at the maximum of its neighbour with c = 0.
    """
    if array.is_free[i, array.names.index(CONSTANT_ERROR.name)]:
        searches = np.flatnonzero(owners == i)
        return searches[_two_best_local(errors[searches], profile.value[searches])]
    searches = np.flatnonzero(owners == i + 1)
    return searches[errors[searches] == 0.0]


def _two_best_local(values: FloatArray, heights: FloatArray) -> IndexArray:
    """Indices of the two highest local maxima along ascending values, the highest first."""
    order = np.argsort(values)
    padded = np.concatenate([[-np.inf], heights[order], [-np.inf]])
    is_local = (padded[1:-1] >= padded[:-2]) & (padded[1:-1] >= padded[2:])

    local = order[is_local]
    ranked = local[np.argsort(-heights[local])]
    if len(ranked) < 2:
        by_height = np.argsort(-heights)
        ranked = np.concatenate([ranked, by_height[by_height != ranked[0]]])
    return ranked[:2]


# --- The paper's model ---------------------------------------------------------------------------


def paper_maxima(array: PosteriorArray) -> list[Ascent]:
    """The ends of searches of every posterior, from a grid on the scale of its stimuli."""
    rows = cast(PaperRows, array.likelihood.rows)
    starts = []
    owners = []
    for i in range(len(array)):
        points = _starts(rows.part(np.array([i])))
        starts.append(points)
        owners += [i] * len(points)
    owner_array = np.array(owners)
    return ascend_from(array, owner_array, np.concatenate(starts)).by_owner(owner_array)


def _starts(row: PaperRows) -> FloatArray:
    """A grid over offset, pull, width and lapses of one subject, shape (starts, 4)."""
    n_yes = row.n_yes[0, 0]
    n_trials = (row.n_yes + row.n_no)[0, 0]
    has_trials = n_trials > 0.0
    steps = np.abs(row.difference[0, 0, has_trials])
    step = 0.3  # stands for D where no pair has different stimuli
    if steps.any():
        step = float(np.sqrt(np.mean(np.square(steps[steps > 0.0]))))

    lapse_logits: tuple[float, ...] = (-3.0, -0.5)  # of the lapse rate
    if row.task.lapses == "q0":
        largest_q0 = ((n_yes + 1.0) / (n_trials + 2.0))[has_trials].max()
        lapse_logits = (float(logit(largest_q0)),)

    # Offsets, in D, are off the round numbers at which a distance may be 0.
    offsets = (-0.93, 0.07, 1.01)
    noise_ratios = (0.12, 0.88)
    log_widths = (-1.0, 0.0, 1.0)  # over D
    axes = np.meshgrid(offsets, noise_ratios, log_widths, lapse_logits)
    offset, gamma, log_width, lapse_logit = np.reshape(axes, (4, -1))

    share_pulled = pull(gamma)
    width = step * np.exp(log_width)
    mu1 = _mean_first(row) + offset * step / share_pulled
    spread = row.spread_score(np.log(width), share_pulled)[0]
    probits = ndtri(gamma), probit_of_logit(lapse_logit)
    return np.stack([(mu1 - row.mu1_mean[0]) / row.mu1_sd[0], spread, *probits], -1)


def _mean_first(row: PaperRows) -> float:
    """The mean first stimulus of one subject, natural-log intensity."""
    return float(np.average(row.first[0, 0], weights=(row.n_yes + row.n_no)[0, 0]))


def funnel_of_maxima(array: PosteriorArray, maxima: Sequence[Ascent]) -> Funnel:
    """The funnel of every posterior about its maxima, the highest first."""
    rows = cast(PaperRows, array.likelihood.rows)
    columns = np.empty((5, len(array), 1))
    for i, ends in enumerate(maxima):
        # A maximum that is 3 nats lower says nothing of the funnel.
        near = ends.part(ends.value > ends.value[0] - 3.0)
        columns[:, i, 0] = _funnel_numbers(rows.part(np.array([i])), near.x[None])
    return Funnel(rows, *columns)


def _funnel_numbers(row: PaperRows, u: FloatArray) -> tuple[float, ...]:
    """The numbers of :class:`Funnel` from maxima, (1, maxima, 4), the highest first."""
    mean_first = _mean_first(row)
    sd = float(row.mu1_sd[0, 0])
    offsets = row.pull(u)[0] * (row.mu1(u)[0] - mean_first)
    log_width = float(row.log_width(u)[0, 0])
    information = float(row.scoring(u[:, :1])[2][0, 0, 0, 0])  # of the score of mu1

    # Where the answers say little of the offset, one width stands in for its spread.
    spread = np.exp(log_width)
    if information > 0.0:
        spread = float(row.pull(u)[0, 0]) * sd / np.sqrt(information)

    # Several maxima: the answers leave the offset as open as the maxima are apart.
    distance = float(offsets.std())
    follows_width = 1.0 if distance < spread else 0.0
    log_precision = 2.0 * (np.log(sd) - np.log(np.hypot(spread, distance)))
    log_precision += follows_width * (2.0 * log_width + np.log(2.0))

    centre = (mean_first - float(row.mu1_mean[0, 0])) / sd
    return centre, float(offsets.mean()) / sd, log_precision, log_width, follows_width
