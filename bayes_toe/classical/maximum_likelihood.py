"""Maximum-likelihood fit of the paper's observer with its penalty on mu1.

`fit_counts` fits one vector of counts, or thousands at once, in either task.

The fit maximises log likelihood (no binomial coefficients) - (mu1 - mean)^2 / (2 V_1), over 0 <=
gamma <= 1, any width w, and a share of 0 to 1: q0, or 1 - lambda. The supremum often lies on an
edge, sometimes one where a parameter is infinite, 0 or without effect. The fit finds and reports
each of these edges. Source: Eq. mod:logp_grouped. (The paper calls it minimising the
log-likelihood; it is maximising.)

A search moves in u = (c, -log(p/p_max), -log w, -log share), where c is the offset and p the pull.
gamma = 1 and a share of 1 are the bounds u_1 = 0 and u_3 = 0, on which a search can end. gamma = 0
(no order effect, mu1 at the penalty's mean) is fitted separately. All other edges lie at infinity:
the maximum is on such an edge if the edge is as high as the end of the search, and an ordinary
point in the same direction is lower.

Searches start at the highest points of the parts of a grid. Several maxima differ in the pull: a
vanishing one with the prior mean far to either side, a middle one, and the largest. A pull nearly
determines the other coordinates, so the highest grid point of a range of pulls lies close to the
maximum. The probabilities at grid points are the same for all rows, so that one matrix product
gives all likelihoods there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import ArrayPair, BoolArray, FloatArray, IndexArray, IntArray
from bayes_toe.classical.identified_curve import PaperPosterior, paper_posterior
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import TASKS, Task
from bayes_toe.inference.maxima import Ascent, Differenced, ascend
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.answer_curves import log_likelihoods
from bayes_toe.model.paper_equations import MAX_PULL, natural_names
from bayes_toe.model.prior import DEFAULT, Prior

#: Where a maximum may lie beyond the open domain, in the order in which `at_edge` names them.
EDGES: Mapping[Task, tuple[str, ...]] = {
    task: (
        "gamma=0",
        "gamma=1",
        f"{task.lapses}=0",
        f"{task.lapses}=1",
        "sigma_p=0",
        "sigma_p=inf",
        "not unique",
    )
    for task in TASKS
}
_BLOCK = 1 << 14  # values of a temporary array; some tens of them fit into the processor's cache
_FULL = 1e-15  # -log of a share that is 1 to all digits
_EMPTY = 80.0  # -log of a share that is 0 to all digits
_FAR = 30.0  # largest log ratio of a width to the steps between stimuli
_FLAT = 1e-6  # nats: a direction with less curvature is flat
_ROUGH = 1e-7  # error of a curvature by differences, over the curvature of its coordinates
_STILL = 1e-3  # a parameter is determined if it changes less than this along a flat direction
_STEP = 1e-4  # step along a flat direction
_MOST_STEPS = 40  # of the first searches; after them only the best one of each row goes on
_LEAST_GAIN = 1e-9  # nats: the first searches end where a step promises less
#: Parts of the grid: pulls as shares of the largest one, and signs of the offset. The edge gamma =
#: 0 comes last.
_PARTS = (
    ((0.003, 0.01, 0.03), (-1.0,)),
    ((0.003, 0.01, 0.03), (1.0,)),
    ((0.1, 0.2, 0.4), (-1.0, 1.0)),
    ((1.0,), (-1.0, 1.0)),
    ((0.0,), (0.0,)),
)
#: Offsets and log widths of the grid on the scale of the design, and its shares.
_OFFSETS = (0.05, 0.15, 0.4, 1.0, 2.0)
_LOG_WIDTHS = np.arange(-2.0, 1.6, 0.5)
_SHARES = (0.05, 0.2, 0.5, 0.8, 0.95, 0.99)
#: Offset and pull without an order effect.
_NO_PULL = (0.0, _EMPTY)
#: The coordinates that the edge gamma = 0 holds: offset and pull.
_HELD_WITHOUT_PULL = np.array([True, True, False, False])


@dataclass(frozen=True, eq=False)
class PenalisedLikelihood:
    """The function that a fit maximises, for the counts of many rows, (rows, pairs).

    Points u have the shape (points, 4); `row`, (points,), tells the counts of each point. The
    likelihood is that of the paper's model. The normal prior of mu1 is the penalty; the paper's has
    mean 0 and V_1 = 10^2.
    """

    posterior: PaperPosterior
    n_yes: IntArray

    @cached_property
    def scale(self) -> float:
        """Root mean square step between the stimuli of a pair, natural-log intensity."""
        subject = self.posterior.subject
        steps = np.abs(subject.s2 - subject.s1)
        steps = steps[steps > 0.0]
        if len(steps) == 0:
            steps = np.abs(subject.s1 - self.posterior.sbar)
        if not steps.any():
            return 0.3
        return float(np.sqrt(np.mean(np.square(steps))))

    @cached_property
    def sign(self) -> float:
        """1 if the last coordinate of the posterior rises with the share, -1 if it falls."""
        return -1.0 if self.posterior.share == "lapse_rate" else 1.0

    def coordinates(self, u: FloatArray) -> FloatArray:
        """The coordinates of the posterior at points, (points, 4)."""
        logits = -u - np.log(-np.expm1(-np.maximum(u, _FULL)))
        return np.stack([u[:, 0], logits[:, 1], -u[:, 2], self.sign * logits[:, 3]], axis=-1)

    def value(self, u: FloatArray, row: IndexArray) -> FloatArray:
        """The objective, (points,)."""
        x = self.coordinates(u)
        parts = []
        for block in self._blocks(len(u)):
            parts.append(self._log_likelihood(x[block], self.n_yes[row[block]]))
        return np.concatenate(parts) - self.penalty(u)

    def gradient(self, u: FloatArray, row: IndexArray) -> ArrayPair:
        """The objective, (points,), and its gradient, (points, 4).

        The gradient of the penalty follows from mu1 = sbar + c/p and d(1/p)/du_1 = 1/p.
        """
        x = self.coordinates(u)
        parts = []
        for block in self._blocks(len(u)):
            parts.append(self.posterior.likelihood_gradient(x[block], self.n_yes[row[block]]))
        value, slopes = map(np.concatenate, zip(*parts, strict=True))
        logit_slopes = 1.0 / np.expm1(-np.maximum(u, _FULL))
        slopes[:, 1] *= logit_slopes[:, 1]
        slopes[:, 2] *= -1.0
        slopes[:, 3] *= self.sign * logit_slopes[:, 3]
        offset_slope = self._penalty_slope(u) * np.exp(u[:, 1]) / MAX_PULL
        slopes[:, 0] -= offset_slope
        slopes[:, 1] -= offset_slope * u[:, 0]
        return value - self.penalty(u), slopes

    def penalty(self, u: FloatArray) -> FloatArray:
        """(mu1 - mean)^2 / (2 V_1), (points,).

        At p = 0 the offset is 0, and mu1 is the mean.
        """
        sd = self.posterior.prior.penalty.sd
        return 0.5 * np.square(self._penalty_slope(u) * sd)

    def _penalty_slope(self, u: FloatArray) -> FloatArray:
        """The derivative of the penalty in mu1: (mu1 - mean) / V_1, (points,)."""
        penalty = self.posterior.prior.penalty
        deviation = self.posterior.sbar - penalty.mean + u[:, 0] * np.exp(u[:, 1]) / MAX_PULL
        return np.where(u[:, 1] < _EMPTY, deviation, 0.0) / penalty.sd**2

    def highest_points(self, u: FloatArray) -> FloatArray:
        """The highest one of some points for each row, (points, 4) -> (rows, 4)."""
        log_answers = np.concatenate(self.posterior.log_answers(self.coordinates(u)), axis=1).T
        n_no = self.posterior.subject.n_trials - self.n_yes
        answers = np.concatenate([self.n_yes, n_no], axis=1)
        penalty = self.penalty(u)
        size = max(1, 32 * _BLOCK // len(u))
        best = []
        for i in range(0, len(answers), size):
            objective = answers[i : i + size] @ log_answers - penalty
            best.append(objective.argmax(axis=1))
        return u[np.concatenate(best)]

    def _blocks(self, n_points: int) -> list[slice]:
        size = max(1, _BLOCK // self.n_yes.shape[1])
        return [slice(i, i + size) for i in range(0, max(1, n_points), size)]

    def _log_likelihood(self, x: FloatArray, n_yes: IntArray) -> FloatArray:
        """Log likelihood of points with counts of their own, (points, pairs) -> (points,)."""
        answers = self.posterior.log_answers(x)
        pairs = log_likelihoods(n_yes, self.posterior.subject.n_trials, answers)
        return pairs.sum(axis=1)


@dataclass(frozen=True, eq=False)
class MaximumLikelihoodFits:
    """Maximum-likelihood fits of one design to one or many vectors of counts.

    Attributes
    ----------
    parameters : ndarray, shape (rows, 4)
        mu1, sigma_p, sigma_l (natural-log intensity), and q0 or the lapse rate. NaN where the data
        leave one open ("not unique").
    log_likelihood : ndarray, shape (rows,)
        At the maximum, without binomial coefficients and penalty, nats.
    objective : ndarray, shape (rows,)
        Log likelihood minus penalty, which is maximised.
    edges : ndarray, shape (rows, edges)
        On which of the task's :data:`EDGES` the maximum lies.
    arrived : ndarray, shape (rows,)
        False where the search did not converge; the row is then the best point that it found.
    points : ndarray, shape (rows, 4)
        The maximum in the coordinates of the posterior, also where a parameter is open.
    subject : Subject
        The pairs.
    """

    parameters: FloatArray
    log_likelihood: FloatArray
    objective: FloatArray
    edges: BoolArray
    arrived: BoolArray
    points: FloatArray
    subject: Subject

    def __len__(self) -> int:
        return len(self.objective)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return natural_names(self.subject.task)

    @property
    def edge_names(self) -> tuple[str, ...]:
        """Names of the columns of `edges`."""
        return EDGES[self.subject.task]

    @property
    def curves(self) -> Predictor:
        """The predictions of every row."""
        return Predictor(paper_posterior(self.subject), self.points)

    @property
    def at_edge(self) -> tuple[str, ...]:
        """The edges of every row as text, joined with ';', empty for a maximum inside."""
        names = np.array(self.edge_names)
        return tuple(";".join(names[row]) for row in self.edges)


def fit_counts(
    subject: Subject, prior: Prior = DEFAULT, n_yes: npt.ArrayLike | None = None
) -> MaximumLikelihoodFits:
    """Fit counts, (rows, pairs), over a subject's pairs, by default its own.

    The prior's normal of mu1 is the penalty.

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> fits = fit_counts(subject)
    >>> fits.at_edge, bool(fits.arrived[0])
    (('q0=1',), True)
    """
    posterior = paper_posterior(subject, prior)
    posterior = replace(posterior, centre=posterior.sbar)
    counts = np.atleast_2d(np.asarray(subject.n_yes if n_yes is None else n_yes))
    likelihood = PenalisedLikelihood(posterior, counts)
    rows, starts = np.arange(len(counts)), _grid_starts(likelihood)
    n_starts = starts.shape[1]
    _, first = _search(
        likelihood,
        np.repeat(rows, n_starts),
        starts.reshape(-1, 4),
        most_steps=_MOST_STEPS,
        least_gain=_LEAST_GAIN,
    )
    value = first.value.reshape(-1, n_starts)
    is_highest = value > value.max(axis=1, keepdims=True) - _rounding(value)
    # Of equal ones the first, so that gamma = 0 is chosen only where it is higher.
    best = is_highest.argmax(axis=1) + rows * n_starts
    density, ended = _search(likelihood, rows, first.x[best], most_steps=10 * _MOST_STEPS)
    suprema = _find_suprema(likelihood, ended.x, ended.value)
    is_flat = _flat_parameters(likelihood, ended, density.curvature(ended.x, rows))
    return _make_fits(likelihood, ended, suprema, is_flat)


def _grid_starts(likelihood: PenalisedLikelihood) -> FloatArray:
    """The highest points of the parts of the grid, (rows, parts, 4).

    Searches from them missed the best known maximum in 3 of 6,400 rows (replicates of 16 subjects,
    most of them with few or extreme counts).
    """
    scale = likelihood.scale
    minus_log_widths = -np.log(scale) - _LOG_WIDTHS
    starts = []
    for shares, signs in _PARTS:
        pulls = [_EMPTY if share == 0.0 else max(-np.log(share), _FULL) for share in shares]
        offsets = scale * np.unique(np.outer(signs, _OFFSETS))
        axes = np.meshgrid(offsets, pulls, minus_log_widths, -np.log(_SHARES))
        grid = np.stack([axis.ravel() for axis in axes], axis=-1)
        starts.append(likelihood.highest_points(grid))
    return np.stack(starts, axis=1)


def _search(
    likelihood: PenalisedLikelihood,
    row: IndexArray,
    start: FloatArray,
    *,
    most_steps: int,
    least_gain: float = 0.0,
) -> tuple[Differenced, Ascent]:
    """Newton's method from starts, (points, 4), of rows, (points,)."""
    lower = np.array([-np.inf, _FULL, -np.log(likelihood.scale) - _FAR, _FULL])
    density = Differenced(lambda u, index: likelihood.gradient(u, row[index]), *start.shape)
    return density, ascend(
        density.expand,
        start,
        lower=lower,
        is_held=_held_coordinates(start),
        largest_step=3.0,
        most_steps=most_steps,
        least_gain=least_gain,
    )


def _held_coordinates(u: FloatArray) -> BoolArray:
    """The coordinates that are not searched, (points, 4): offset and pull where gamma is 0."""
    return (u[:, 1:2] == _EMPTY) & _HELD_WITHOUT_PULL


def _rounding(value: FloatArray) -> FloatArray:
    """The rounding error of values, nats; two maxima that differ by less are one."""
    return 1e-9 + 4e-15 * np.abs(value)


class _Suprema(NamedTuple):
    """The suprema, (rows, 4), and the edges at infinity on which they lie, (rows,) each."""

    u: FloatArray
    has_infinite_width: BoolArray
    has_no_share: BoolArray
    has_no_width: BoolArray
    has_no_pull_and_width: BoolArray


def _find_suprema(likelihood: PenalisedLikelihood, u: FloatArray, value: FloatArray) -> _Suprema:
    """The suprema from the points at which searches ended, (rows, 4), and their values, (rows,).

    A supremum lies on an edge if the edge is as high as the end of the search, and another point in
    the same direction is lower.
    """
    (c, pull, width, share), rows = u.T, np.arange(len(u))
    subject, penalty = likelihood.posterior.subject, likelihood.posterior.prior.penalty
    usual_width = -np.log(likelihood.scale)

    def point(*coordinates: npt.ArrayLike) -> FloatArray:
        return np.stack(np.broadcast_arrays(*coordinates, rows)[:4], axis=-1)

    def is_as_high(points: FloatArray) -> BoolArray:
        return likelihood.value(points, rows) >= value - _rounding(value)

    infinite_width = point(*_NO_PULL, usual_width - _FAR, share)
    finite_width = point(*_NO_PULL, usual_width, share)
    is_wide = is_as_high(infinite_width) & ~is_as_high(finite_width)

    no_share = point(*_NO_PULL, width, _EMPTY)
    half_share = point(*_NO_PULL, usual_width, np.log(2.0))
    is_never = ~is_wide & is_as_high(no_share) & ~is_as_high(half_share)

    # Without a width different stimuli are told apart for certain; equal ones still differ by
    # p (mu1 - s1) / w.
    can_narrow = ~(is_wide | is_never) & (subject.s1 != subject.s2).any()
    no_pull_and_width = point(c * np.exp(-_FAR), pull + _FAR, width + _FAR, share)
    no_width = point(c, pull, width + _FAR, share)
    is_vanishing = can_narrow & is_as_high(no_pull_and_width)
    is_narrow_only = can_narrow & ~is_vanishing & is_as_high(no_width)

    # gamma = 0, where the largest pull with the same mu1 is lower.
    is_inside = ~(is_wide | is_never | is_vanishing | is_narrow_only)
    offset_at_mean = MAX_PULL * (penalty.mean - likelihood.posterior.sbar)
    offset = np.where(pull < _EMPTY, c * np.exp(np.minimum(pull, _EMPTY)), offset_at_mean)
    no_pull = point(*_NO_PULL, width, share)
    largest_pull = point(offset, _FULL, width, share)
    has_no_pull = is_inside & is_as_high(no_pull) & ~is_as_high(largest_pull)

    suprema = u.copy()
    for is_edge, points in (
        (is_wide, infinite_width),
        (is_never, no_share),
        (is_vanishing, no_pull_and_width),
        (is_narrow_only, no_width),
        (has_no_pull, no_pull),
    ):
        suprema[is_edge] = points[is_edge]
    return _Suprema(suprema, is_wide, is_never, is_narrow_only | is_vanishing, is_vanishing)


def _flat_parameters(
    likelihood: PenalisedLikelihood, ended: Ascent, curvature: FloatArray
) -> BoolArray:
    """The natural parameters that change along a flat direction of the objective, (rows, 4).

    Directions are in units of the width for the offset, and logarithmic for the other coordinates.
    """
    u = ended.x
    is_at_bound = (u <= _FULL) & (ended.gradient < -_FLAT) & [False, True, False, True]
    is_free = ~(_held_coordinates(u) | is_at_bound)
    unit = np.ones(u.shape)
    unit[:, 0] = np.exp(-u[:, 2])
    both_free = is_free[:, :, None] & is_free[:, None, :]
    scaled = curvature * unit[:, :, None] * unit[:, None, :]
    scaled = np.where(both_free, scaled, np.eye(4))
    values, vectors = np.linalg.eigh(scaled)
    error = _ROUGH * np.einsum("rcd,rcc->rd", np.square(vectors), np.abs(scaled))
    is_flat = values < np.maximum(_FLAT, error)
    is_open = np.zeros(u.shape, bool)
    for i in range(4):
        step = _STEP * vectors[:, :, i] * unit
        change = _log_parameters(likelihood, u + step) - _log_parameters(likelihood, u - step)
        is_open |= is_flat[:, i, None] & (np.abs(change) / (2.0 * _STEP) > _STILL)
    return is_open


def _log_parameters(likelihood: PenalisedLikelihood, u: FloatArray) -> FloatArray:
    """mu1, log sigma_p, log sigma_l and the last natural parameter at points, (points, 4)."""
    values = _natural_parameters(likelihood, likelihood.coordinates(u))
    values[:, 1:3] = np.log(values[:, 1:3])
    return values


def _natural_parameters(likelihood: PenalisedLikelihood, x: FloatArray) -> FloatArray:
    """The natural parameters at points in the coordinates of the posterior, (points, 4)."""
    quantities = likelihood.posterior.quantities(x)
    return np.stack([quantities[name] for name in likelihood.posterior.names.natural], axis=-1)


def _make_fits(
    likelihood: PenalisedLikelihood, ended: Ascent, suprema: _Suprema, is_flat: BoolArray
) -> MaximumLikelihoodFits:
    """Natural parameters, edges and what stays open, for all rows."""
    u, is_wide, is_never, is_narrow, is_vanishing = suprema
    has_no_pull, has_largest_pull = u[:, 1] >= _EMPTY, u[:, 1] <= _FULL
    is_outside = is_wide | is_never
    is_inside = ~(is_outside | is_narrow)

    # Parameters that the counts leave open: mu1, sigma_p, sigma_l and the share.
    is_open = is_flat.copy()
    is_open[is_outside, :3] = False
    is_open[is_narrow, 1:3] = False
    is_open[is_never] = [False, True, True, False]
    has_full_share = (u[:, 3] <= _FULL) & ~is_open[:, 3]
    # A share of 1 is q0 = 1, or a lapse rate of 0.
    is_zero, is_one = is_never, has_full_share
    if likelihood.sign < 0.0:
        is_zero, is_one = has_full_share, is_never

    x, posterior = likelihood.coordinates(u), likelihood.posterior
    parameters = _natural_parameters(likelihood, x)
    parameters[has_no_pull, 0] = posterior.prior.penalty.mean
    parameters[has_no_pull, 2] = 0.0
    parameters[is_narrow, 1:3] = 0.0
    parameters[is_wide, 1:3] = np.inf
    parameters[is_zero, 3] = 0.0
    parameters[is_one, 3] = 1.0

    # In the order of EDGES.
    is_gamma_0 = (is_inside & has_no_pull) | is_vanishing
    is_gamma_1 = is_inside & has_largest_pull & ~is_open[:, 2]
    is_not_unique = is_open.any(axis=1)
    edges = (is_gamma_0, is_gamma_1, is_zero, is_one, is_narrow, is_wide, is_not_unique)
    objective = np.maximum(ended.value, likelihood.value(u, np.arange(len(u))))
    return MaximumLikelihoodFits(
        parameters=np.where(is_open, np.nan, parameters),
        log_likelihood=objective + likelihood.penalty(u),
        objective=objective,
        edges=np.stack(edges, axis=-1),
        arrived=ended.has_converged | is_outside,
        points=x,
        subject=posterior.subject,
    )
