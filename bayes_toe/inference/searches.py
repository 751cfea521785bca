"""The maxima of posteriors, with which their mixtures begin.

`observer_maxima` searches the posteriors of the four models and of conditions, `paper_maxima` those
of the paper's model (H1). `funnel_of_maxima` has the funnel about the maxima of H1.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from scipy.special import logit, ndtri

from bayes_toe.arrays import BoolArray, FloatArray, IndexArray
from bayes_toe.inference.maxima import Ascent, ascend_from
from bayes_toe.model.densities import probit_of_logit
from bayes_toe.model.observer import ObserverRows
from bayes_toe.model.paper_equations import pull
from bayes_toe.model.paper_model import Funnel, PaperRows
from bayes_toe.model.parameters import CONSTANT_ERROR, LAPSE_RATE, NOISE, PEAK
from bayes_toe.model.posterior_array import PosteriorArray

#: Constant errors in D at which searches start; the first one is that of a model without them.
_ERRORS = np.array([0.0, -0.4, 0.4, -0.9, 0.9, -2.0, 2.0, -4.0, 4.0])
#: Normal scores of the lapse rate in its prior, at which searches hold it.
_LAPSE_STARTS = (-1.0, 0.6, 1.8)
#: Normal scores of the noise in its prior at which searches start. With little noise the curve is
#: steep, and answers show most; with much it is flat.
_STEEP, _FLAT = -0.5, 2.0
#: Logit of the peak at which searches start: P('equal') is 0.88.
_PEAK_START = 2.0


def observer_maxima(array: PosteriorArray) -> list[Ascent]:
    """The maxima of every posterior with the observer's coordinates, as a mixture begins with.

    A search starts at several constant errors and from a flat curve, then at several lapse rates.
    A posterior without constant error must stand right before the same one with it.
    """
    has_error = array.is_free[:, array.names.index(CONSTANT_ERROR.name)]
    lapse = array.names.index(LAPSE_RATE.name)
    profile, profile_owners = _profile(array, has_error)
    n_at_errors = len(profile.x) - len(array)

    parts = []
    for i, first in enumerate(_first_searches(has_error)):
        candidates = np.array([first])
        if has_error[i]:
            candidates = first + _two_best_local(profile.value[first : first + len(_ERRORS)])
        best = candidates[0]
        from_flat = n_at_errors + i
        if profile.value[from_flat] > profile.value[best]:
            best = from_flat

        # Free searches from the candidates, then those from the best one that hold a lapse rate.
        n_free = len(candidates)
        starts = profile.x[np.append(candidates, [best] * len(_LAPSE_STARTS))]
        starts[n_free:, lapse] = _LAPSE_STARTS
        is_held = np.zeros(starts.shape, np.bool_)
        is_held[n_free:, lapse] = True
        parts.append((np.full(len(starts), i), starts, is_held))

    owners, starts, is_held = map(np.concatenate, zip(*parts, strict=True))
    searches = profile.joined(ascend_from(array, owners, starts, is_held))
    all_owners = np.append(profile_owners, owners)
    return [searches.part(all_owners == i) for i in range(len(array))]


def _first_searches(has_error: BoolArray) -> IndexArray:
    """The search of :func:`_profile` at the constant error 0, of every posterior.

    For a posterior without constant error it is that of the next posterior, which has one.
    """
    n_searches = np.where(has_error, len(_ERRORS), 0)
    return np.cumsum(n_searches) - n_searches


def _profile(array: PosteriorArray, has_error: BoolArray) -> tuple[Ascent, IndexArray]:
    """Maxima at several constant errors, then one from a flat curve for every posterior.

    Searches at constant errors hold these. The second value has the posterior of each search.
    """
    rows = cast(ObserverRows, array.likelihood.rows)
    noise, error = map(array.names.index, (NOISE.name, CONSTANT_ERROR.name))
    with_error = np.flatnonzero(has_error)

    at_errors = np.zeros((len(with_error) * len(_ERRORS), len(array.names)))
    at_errors[:, noise] = _STEEP
    at_errors[:, error] = np.tile(_ERRORS / rows.prior.constant_error_scale, len(with_error))
    from_flat = np.zeros((len(array), len(array.names)))
    from_flat[:, noise] = _FLAT

    owners = np.append(np.repeat(with_error, len(_ERRORS)), np.arange(len(array)))
    starts = np.concatenate([at_errors, from_flat])
    if PEAK.name in array.names:
        starts[:, array.names.index(PEAK.name)] = _PEAK_START
    is_held = np.zeros(starts.shape, np.bool_)
    is_held[: len(at_errors), error] = True
    return ascend_from(array, owners, starts, is_held), owners


def _two_best_local(heights: FloatArray) -> IndexArray:
    """Indices of the two highest local maxima along the constant errors, the highest first."""
    order = np.argsort(_ERRORS)
    ascending = heights[order]
    padded = np.pad(ascending, 1, constant_values=-np.inf)
    is_local = (ascending >= padded[:-2]) & (ascending >= padded[2:])
    # Local maxima first, then the others, each by height: where there is one local maximum, the
    # next highest value follows.
    return order[np.lexsort((-ascending, ~is_local))[:2]]


# --- The paper's model ---------------------------------------------------------------------------


def paper_maxima(array: PosteriorArray) -> Ascent:
    """The ends of searches of one posterior, from a grid over offset, pull, width and lapses."""
    row = cast(PaperRows, array.likelihood.rows)
    n_yes = row.n_yes[0, 0]
    n_trials = (row.n_yes + row.n_no)[0, 0]
    has_trials = n_trials > 0.0
    steps = np.abs(row.difference[0, 0, has_trials])
    step = 0.3  # stands for D where no pair has different stimuli
    if steps.any():
        step = float(np.sqrt(np.mean(np.square(steps[steps > 0.0]))))

    lapse_logits: tuple[float, ...] = (-3.0, -0.5)  # lapse rates of 5 and 38 %
    if row.task.lapses == "q0":  # the largest share of 'equal' tells it
        largest_q0 = ((n_yes + 1.0) / (n_trials + 2.0))[has_trials].max()
        lapse_logits = (logit(largest_q0),)

    # Offsets, in D, are off the round numbers at which a distance may be 0.
    offsets = (-0.93, 0.07, 1.01)
    noise_ratios = (0.12, 0.88)
    log_widths = (-1.0, 0.0, 1.0)  # over D
    axes = np.meshgrid(offsets, noise_ratios, log_widths, lapse_logits)
    offset, gamma, log_width, lapse_logit = np.reshape(axes, (4, -1))

    share_pulled = pull(gamma)
    width = step * np.exp(log_width)
    mu1 = _mean_first(row) + offset * step / share_pulled
    spread = row.spread_score(np.log(width), share_pulled)
    probits = ndtri(gamma), probit_of_logit(lapse_logit)
    mean, sd = row.prior.mu1_normal
    starts = np.stack([(mu1 - mean) / sd, spread, *probits], -1)
    return ascend_from(array, np.zeros(len(starts), np.intp), starts)


def _mean_first(row: PaperRows) -> float:
    """The mean first stimulus of one subject, natural-log intensity."""
    return float(np.average(row.first[0, 0], weights=(row.n_yes + row.n_no)[0, 0]))


def funnel_of_maxima(row: PaperRows, maxima: Ascent) -> Funnel:
    """The funnel of one posterior about its maxima, the highest first."""
    # A maximum that is 3 nats lower says nothing of the funnel. The axes: row, points, coordinates.
    u = maxima.x[None, maxima.value > maxima.value[0] - 3.0]
    mean_first = _mean_first(row)
    mean, sd = row.prior.mu1_normal
    offsets = row.pull(u)[0] * (row.mu1(u)[0] - mean_first)
    log_width = row.log_width(u)[0, 0]
    _, _, informations = row.scoring(u[:, :1])
    information = informations[0, 0, 0, 0]  # on the score of mu1, at the highest maximum

    # Where the answers say little of the offset, one width stands in for its spread.
    spread = np.exp(log_width)
    if information > 0.0:
        spread = row.pull(u)[0, 0] * sd / np.sqrt(information)

    # Several maxima: the answers leave the offset as open as the maxima are apart.
    distance = offsets.std()
    follows_width = 1.0 if distance < spread else 0.0
    log_precision = 2.0 * (np.log(sd) - np.log(np.hypot(spread, distance)))
    log_precision += follows_width * (2.0 * log_width + np.log(2.0))

    centre = (mean_first - mean) / sd
    return Funnel(row, centre, offsets.mean() / sd, log_precision, log_width, follows_width)
