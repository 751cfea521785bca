"""Searches for the maxima of posteriors, from which their mixtures begin.

`observer_maxima` searches the posteriors of the four models and of conditions, `paper_maxima` those
of the paper's model (H1). `step_of_pairs` is the scale of H1's searches, and `funnel_of_maxima`
makes the funnel of H1 from its maxima.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from scipy.special import logit, ndtri

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.inference.maxima import Ascent, ascend_from
from bayes_toe.model.densities import probit_of_logit
from bayes_toe.model.observer import ObserverRows
from bayes_toe.model.paper_equations import pull
from bayes_toe.model.paper_model import Funnel, PaperPosterior
from bayes_toe.model.parameters import CONSTANT_ERROR, LAPSE_RATE, NOISE, PEAK
from bayes_toe.model.posterior_array import PosteriorArray

#: Constant errors that searches hold, over the D of the prior.
_ERRORS = (0.0, -0.4, 0.4, -0.9, 0.9, -2.0, 2.0, -4.0, 4.0)
#: Normal scores of the lapse rate in its prior that searches hold.
_LAPSE_SCORES = (-1.0, 0.6, 1.8)
#: Normal scores of the noise in its prior at which searches start. With little noise the curve is
#: steep, and with much noise it is flat.
_STEEP = -0.5
_FLAT = 2.0
#: Logit of the peak at which searches start: P('equal') is 0.88.
_PEAK_START = 2.0


def observer_maxima(posteriors: PosteriorArray) -> list[Ascent]:
    """The ends of searches of every posterior with the observer's coordinates."""
    starts, is_held = _observer_starts(posteriors)
    # A model without a constant error does not have the searches that hold another error than 0.
    constant_error = posteriors.names.index(CONSTANT_ERROR.name)
    has_error = posteriors.is_free[:, constant_error]  # (posteriors,)
    is_at_no_error = starts[:, constant_error] == 0.0  # (searches,)
    owners, searches = np.nonzero(has_error[:, None] | is_at_no_error)
    # With millions of trials, 12 steps do not reach a maximum from these starts.
    ends = ascend_from(posteriors, owners, starts[searches], is_held[searches], most_steps=30)
    return [ends.part(owners == i) for i in range(len(posteriors))]


def _observer_starts(posteriors: PosteriorArray) -> tuple[FloatArray, BoolArray]:
    """Starts of the searches of a posterior, and which coordinates they hold, (searches, d) each.

    The last two searches are free: they start at a steep curve and at a flat one. The other
    searches hold a constant error or a lapse rate, because a mixture needs their ends, which are
    beside the maximum. Coordinates without a value start at 0.
    """
    rows = cast(ObserverRows, posteriors.likelihood.rows)
    noise, lapse_rate, constant_error = map(
        posteriors.names.index, (NOISE.name, LAPSE_RATE.name, CONSTANT_ERROR.name)
    )
    # The coordinate that each search holds, and its value.
    held_values = [(constant_error, value / rows.prior.constant_error_scale) for value in _ERRORS]
    held_values += [(lapse_rate, score) for score in _LAPSE_SCORES]

    starts = np.zeros((len(held_values) + 2, len(posteriors.names)))
    is_held = np.zeros(starts.shape, np.bool_)
    for search, (coordinate, value) in enumerate(held_values):
        starts[search, coordinate] = value
        is_held[search, coordinate] = True
    starts[:-1, noise] = _STEEP
    starts[-1, noise] = _FLAT
    if PEAK.name in posteriors.names:
        starts[:, posteriors.names.index(PEAK.name)] = _PEAK_START
    return starts, is_held


# --- The paper's model ---------------------------------------------------------------------------


def step_of_pairs(subject: Subject) -> float:
    """Root mean square of s2 - s1 over pairs of different stimuli: the scale of a search."""
    differences = subject.s2 - subject.s1
    if not differences.any():
        return 0.3  # any value: without different stimuli the width is not determined
    return float(np.sqrt(np.mean(np.square(differences[differences != 0.0]))))


def paper_maxima(posterior: PaperPosterior) -> Ascent:
    """The ends of searches of one posterior, from a grid over offset, gamma, width and share.

    Offset and width count in steps, see :func:`step_of_pairs`.
    """
    subject = posterior.subject
    rows = posterior.rows
    step = step_of_pairs(subject)
    if rows.task.lapses == "q0":  # the largest share of 'equal' of a pair, by Laplace's estimator
        largest_q0 = ((subject.n_yes + 1.0) / (subject.n_trials + 2.0)).max()
        share_logit_values = [logit(largest_q0)]
    else:
        share_logit_values = [-3.0, -0.5]  # lapse rates of 5 and 38 %

    # At a round offset the distance of a pair may be 0, and its slope too.
    offset_values = (-0.93, 0.07, 1.01)
    gamma_values = (0.12, 0.88)
    log_width_values = (-1.0, 0.0, 1.0)
    grid = np.meshgrid(offset_values, gamma_values, log_width_values, share_logit_values)
    offset, gamma, log_width, share_logit = np.reshape(grid, (4, -1))  # (starts,) each

    # The coordinates of each start: scores of mu1 and of the spread, then the probits of gamma and
    # of the share, which is q0 or the lapse rate.
    p = pull(gamma)
    width = step * np.exp(log_width)  # the grid has the log of the width in steps
    mu1 = subject.mean_first + offset * step / p  # as offset = p (mu1 - mean_first)
    mean, sd = rows.prior.mu1_normal
    starts = np.column_stack(
        [
            (mu1 - mean) / sd,
            rows.spread_score(np.log(width), p),
            ndtri(gamma),
            probit_of_logit(share_logit),
        ]
    )
    owners = np.zeros(len(starts), np.intp)  # all searches are of one posterior
    return ascend_from(posterior.array, owners, starts)


def funnel_of_maxima(posterior: PaperPosterior, maxima: Ascent) -> Funnel:
    """The funnel of one posterior by its maxima, the highest first; symbols as in :class:`Funnel`.

    w_0 is the width w at the highest maximum. There the answers leave the offset p mu1 with the SD
    `spread`, and `distance` is the SD of the offset between maxima, so that its precision is to be
    kappa / (w^2 + w_0^2) = 1 / (spread^2 + distance^2). So kappa is 2 w_0^2 / (spread^2 +
    distance^2), or without 2 w_0^2 if the formula has no divisor w^2 + w_0^2.

    Maxima at least 3 nats below the highest one have little of the posterior and do not count.
    """
    rows = posterior.rows
    u = maxima.x[None, maxima.value > maxima.value[0] - 3.0]  # (1, points, 4)
    mean_first = posterior.subject.mean_first
    mean, sd = rows.prior.mu1_normal
    offsets = rows.pull(u)[0] * (rows.mu1(u)[0] - mean_first)
    log_width = rows.log_width(u)[0, 0]  # of the one row, at the highest maximum
    # Of the one row and the one point: the information on the first coordinate, the score of mu1.
    _, _, information_matrices = rows.scoring(u[:, :1])  # (rows, points, 4, 4)
    information = information_matrices[0, 0, 0, 0]

    # The SD of the offset that the answers leave: that of mu1, 1/information^(1/2) scores, times p.
    # If there is no information, the width stands for this SD.
    if information > 0.0:
        spread = rows.pull(u)[0, 0] * sd / np.sqrt(information)
    else:
        spread = np.exp(log_width)

    # With several maxima, the offset is as uncertain as the maxima are apart.
    distance = offsets.std()
    log_precision = 2.0 * (np.log(sd) - np.log(np.hypot(spread, distance)))  # of kappa sd^2
    depends_on_width = bool(distance < spread)
    if depends_on_width:
        log_precision += 2.0 * log_width + np.log(2.0)  # the factor 2 w_0^2

    centre = (mean_first - mean) / sd
    return Funnel(rows, centre, offsets.mean() / sd, log_precision, log_width, depends_on_width)
