"""The maxima of posteriors of the paper's model (H1), and the funnels about them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
from scipy.special import logit, ndtri

from bayes_toe.arrays import FloatArray
from bayes_toe.inference.maxima import Ascent, ascend_from
from bayes_toe.model.densities import half_normal_score, probit_of_logit
from bayes_toe.model.funnel import Funnel
from bayes_toe.model.paper_rows import PaperRows, pull_at
from bayes_toe.model.posterior_array import PosteriorArray

# Where searches begin. Offsets, in D, are off the round numbers at which a distance may be 0.
_OFFSETS = (-0.93, 0.07, 1.01)
_NOISE_RATIOS = (0.12, 0.88)
_LOG_WIDTHS = (-1.0, 0.0, 1.0)  # over D
_LOGITS_OF_LAPSE_RATE = (-3.0, -0.5)
_STEP_OF_EQUAL_PAIRS = 0.3  # stands for D where no pair has different stimuli
#: Nats below the highest at which a maximum says nothing of the funnel.
_LOW = 3.0


def paper_maxima(array: PosteriorArray) -> list[Ascent]:
    """The ends of searches of every posterior, from a grid on the scale of its stimuli."""
    rows = cast(PaperRows, array.likelihood.rows)
    starts = [_starts(rows.part(np.array([i]))) for i in range(len(array))]
    owners = np.repeat(np.arange(len(array)), [len(points) for points in starts])
    searches = ascend_from(array, owners, np.concatenate(starts))
    return [searches.part(owners == i) for i in range(len(array))]


def _starts(row: PaperRows) -> FloatArray:
    """A grid over offset, pull, width and share of one subject, shape (starts, 4)."""
    n_yes, n_trials = row.n_yes[0, 0], (row.n_yes + row.n_no)[0, 0]
    has_trials = n_trials > 0.0
    steps = np.abs(row.difference[0, 0, has_trials])
    step = _STEP_OF_EQUAL_PAIRS
    if steps.any():
        step = float(np.sqrt(np.mean(np.square(steps[steps > 0.0]))))
    shares: tuple[float, ...] = _LOGITS_OF_LAPSE_RATE
    if row.task.lapses == "q0":
        largest_share = ((n_yes + 1.0) / (n_trials + 2.0))[has_trials].max()
        shares = (float(logit(largest_share)),)

    axes = np.meshgrid(_OFFSETS, _NOISE_RATIOS, _LOG_WIDTHS, shares)
    offset, gamma, log_width, logit_share = (axis.ravel() for axis in axes)
    pull, width = pull_at(gamma), step * np.exp(log_width)
    mu1 = _mean_first(row) + offset * step / pull
    if row.prior.spread == "width":
        spread = np.log(width / row.spread_scale[0]) / row.prior.width_sd
    else:
        sigma_p = width * (1.0 - pull) ** row.power
        spread = half_normal_score(sigma_p / row.spread_scale[0])
    probits = ndtri(gamma), probit_of_logit(logit_share)
    return np.stack([(mu1 - row.mu1_mean[0]) / row.mu1_sd[0], spread, *probits], -1)


def _mean_first(row: PaperRows) -> float:
    """The mean first stimulus of one subject, natural-log intensity."""
    return float(np.average(row.first[0, 0], weights=(row.n_yes + row.n_no)[0, 0]))


def funnel_of_maxima(array: PosteriorArray, maxima: Sequence[Ascent]) -> Funnel:
    """The funnel of every posterior about its maxima, the highest first."""
    rows = cast(PaperRows, array.likelihood.rows)
    columns = np.empty((5, len(array), 1))
    for i, ends in enumerate(maxima):
        near = ends.part(ends.value > ends.value[0] - _LOW)
        columns[:, i, 0] = _funnel_numbers(rows.part(np.array([i])), near.x[None])
    return Funnel(rows, *columns)


def _funnel_numbers(row: PaperRows, u: FloatArray) -> tuple[float, ...]:
    """The numbers of :class:`Funnel` from maxima, (1, maxima, 4), the highest first."""
    mean_first, sd = _mean_first(row), float(row.mu1_sd[0, 0])
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
