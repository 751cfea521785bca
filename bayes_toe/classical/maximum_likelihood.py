"""Maximum-likelihood fit of the paper's observer with its penalty on mu1.

It takes one count vector or thousands at once, in either task.

Maximised is log likelihood (no binomial coefficients) - (mu1 - mean)^2 / (2 V_1) over 0 <= gamma <=
1, a share of 0..1 of answers that lapses leave, q0 or 1 - lambda, and any width. The supremum often
lies on an edge, sometimes where a parameter is infinite or 0 or does not matter: each of these is
found and said. Source: Eq. mod:logp_grouped. (The paper calls it minimising the log-likelihood; it
is maximising.)

The likelihood is that of the task's predictive update, ascended in u = (c, -log(p/p_max), -log w,
-log share): gamma = 1 and a whole share are the bounds u_1 = 0 and u_3 = 0, on which Newton can
rest. gamma = 0 (mu1 at the penalty's mean, no order effect) is fitted on its own. Other edges lie
at infinity: an ascent that ends where going there costs nothing, and going elsewhere does, is on
its way there.

Ascents start at the highest points of the parts of a grid. Several maxima differ in the pull: a
vanishing one with the prior mean far to either side, a middle one, the largest. At each pull the
rest is nearly determined, so that the highest grid point of a range of pulls lies close to the
ridge. At points of a grid the probabilities are the same for all rows: their likelihoods there are
one matrix product.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import ArrayPair, BoolArray, FloatArray, IndexArray, IntArray
from bayes_toe.data.study import Subject, refuse_intervals
from bayes_toe.data.tasks import TASKS, Task
from bayes_toe.inference.maxima import Ascent, Differenced, ascend
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.answer_curves import log_likelihoods
from bayes_toe.model.paper_equations import MAX_PULL, natural_names
from bayes_toe.model.paper_model import PaperPosterior, paper_posterior
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
#: Values of one temporary array: of some tens together they stay in the processor's cache.
_BLOCK = 1 << 14
#: -log of a share that is 1 or 0 to all digits; how far a width may be from the steps between
#: stimuli, natural log.
_FULL, _EMPTY, _FAR = 1e-15, 80.0, 30.0
#: Curvatures below which a direction counts as flat: nats, and what differences can tell of those
#: of its coordinates.
_FLAT, _ROUGH = 1e-6, 1e-7
#: A parameter may change this little along a flat direction and still count as determined; the step
#: by which that is seen.
_STILL, _STEP = 1e-3, 1e-4
#: When only the best start of each row goes on: after this many steps, or where a step promises
#: fewer nats than this.
_MOST_STEPS, _LEAST_GAIN = 40, 1e-9
#: The grid: pulls as shares of the largest with sides of the offset, the edge gamma = 0 last;
#: offsets and log widths on the scale of the design; shares of answers that lapses leave.
_PARTS = (
    ((0.003, 0.01, 0.03), (-1.0,)),
    ((0.003, 0.01, 0.03), (1.0,)),
    ((0.1, 0.2, 0.4), (-1.0, 1.0)),
    ((1.0,), (-1.0, 1.0)),
    ((0.0,), (0.0,)),
)
_OFFSETS, _WIDTHS, _SHARES = (
    (0.05, 0.15, 0.4, 1.0, 2.0),
    np.arange(-2.0, 1.6, 0.5),
    (0.05, 0.2, 0.5, 0.8, 0.95, 0.99),
)


@dataclass(frozen=True, eq=False)
class PenalisedLikelihood:
    """What a fit maximises, for the counts of many rows, (rows, pairs).

    Points u have the shape (points, 4) and belong to rows (points,).

    It is the likelihood of a subject's predictive update; of its prior the normal of mu1 is the
    penalty, the paper's has mean 0 and V_1 = 10^2.
    """

    posterior: PaperPosterior
    n_yes: npt.NDArray[np.int64]

    @cached_property
    def scale(self) -> float:
        """Root mean square step between the stimuli of a pair, natural-log intensity."""
        subject = self.posterior.subject
        steps = np.abs(subject.s2 - subject.s1)
        moved = steps[steps > 0] if np.any(steps > 0) else np.abs(subject.s1 - self.posterior.sbar)
        return float(np.sqrt(np.mean(np.square(moved)))) if np.any(moved > 0) else 0.3

    @cached_property
    def sign(self) -> float:
        """Of the logit of q0 the share's is the logit, of that of a lapse rate minus it."""
        return -1.0 if self.posterior.share == "lapse_rate" else 1.0

    def coordinates(self, u: FloatArray) -> FloatArray:
        """Those of the posterior, (points, 4)."""
        logits = -u - np.log(-np.expm1(-np.maximum(u, _FULL)))
        return np.stack([u[:, 0], logits[:, 1], -u[:, 2], self.sign * logits[:, 3]], axis=-1)

    def value(self, u: FloatArray, row: IndexArray) -> FloatArray:
        """What is maximised, (points,)."""
        x, blocks = self.coordinates(u), self._blocks(len(u))
        return np.concatenate(
            [self._log_likelihood(x[at], self.n_yes[row[at]]) for at in blocks]
        ) - self.penalty(u)

    def gradient(self, u: FloatArray, row: IndexArray) -> ArrayPair:
        """What is maximised, (points,), and its gradient, (points, 4).

        That of the penalty follows from mu1 = sbar + c/p and d(1/p)/du_1 = 1/p.
        """
        x, unit = self.coordinates(u), np.ones(len(u))
        parts = []
        for block in self._blocks(len(u)):
            parts.append(self.posterior.likelihood_gradient(x[block], self.n_yes[row[block]]))
        value, slopes = map(np.concatenate, zip(*parts, strict=True))
        of_logits = 1.0 / np.expm1(-np.maximum(u, _FULL))
        slopes *= np.stack([unit, of_logits[:, 1], -unit, self.sign * of_logits[:, 3]], axis=-1)
        by_mu1 = self._far(u) * np.exp(u[:, 1]) / MAX_PULL
        slopes[:, :2] -= by_mu1[:, None] * np.stack([unit, u[:, 0]], axis=-1)
        return value - self.penalty(u), slopes

    def penalty(self, u: FloatArray) -> FloatArray:
        """(mu1 - mean)^2 / (2 V_1), (points,).

        At p = 0 the offset is 0 and mu1 rests at the mean.
        """
        sd = self.posterior.prior.penalty.sd
        return 0.5 * np.square(self._far(u) * sd)

    def _far(self, u: FloatArray) -> FloatArray:
        """(mu1 - mean) / V_1."""
        penalty = self.posterior.prior.penalty
        far = self.posterior.sbar - penalty.mean + u[:, 0] * np.exp(u[:, 1]) / MAX_PULL
        return np.where(u[:, 1] < _EMPTY, far, 0.0) / penalty.sd**2

    def highest(self, u: FloatArray) -> FloatArray:
        """Of points, (points, 4), the one that is highest for each row, (rows, 4)."""
        table = np.concatenate(self.posterior.log_answers(self.coordinates(u)), axis=1).T
        answers = np.concatenate([self.n_yes, self.posterior.subject.n_trials - self.n_yes], axis=1)
        penalty, size = self.penalty(u), max(1, 32 * _BLOCK // len(u))
        best = [
            (answers[i : i + size] @ table - penalty).argmax(axis=1)
            for i in range(0, len(answers), size)
        ]
        return u[np.concatenate(best)]

    def _blocks(self, points: int) -> list[slice]:
        size = max(1, _BLOCK // self.n_yes.shape[1])
        return [slice(i, i + size) for i in range(0, max(1, points), size)]

    def _log_likelihood(self, x: FloatArray, n_yes: IntArray) -> FloatArray:
        """Log likelihood of points of which each has counts of its own, (points, pairs)."""
        answers = self.posterior.log_answers(x)
        pairs = log_likelihoods(n_yes, self.posterior.subject.n_trials, answers)
        return pairs.sum(axis=1)


@dataclass(frozen=True, eq=False)
class Fits:
    """Maximum-likelihood fits of one design to one or many count vectors.

    Parameters, (rows, 4), are mu1, sigma_p, sigma_l (natural-log intensity) and q0 or the lapse
    rate; NaN where the data leave one open ("not unique"). Curves follow from the points, (rows,
    4), in the coordinates of the posterior, also where this has no value.
    """

    parameters: FloatArray
    # (rows,): at the maximum, without binomial coefficients and without the penalty, nats
    log_likelihood: FloatArray
    objective: FloatArray  # (rows,): log likelihood minus penalty: what was maximised
    edges: BoolArray  # (rows, edges): on which of the task's :data:`EDGES` the maximum lies
    # (rows,): False where the ascent did not meet its criterion; the row is then the best point
    # found
    arrived: BoolArray
    points: FloatArray
    subject: Subject  # whose pairs they are

    def __len__(self) -> int:
        return len(self.objective)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters."""
        return natural_names(self.subject.task)

    @property
    def edge_names(self) -> tuple[str, ...]:
        """Of the columns of `edges`."""
        return EDGES[self.subject.task]

    @property
    def curves(self) -> Predictor:
        """What every row predicts."""
        return Predictor(paper_posterior(self.subject), self.points)

    @property
    def at_edge(self) -> tuple[str, ...]:
        """The edges of every row as text, joined with ';', empty for a maximum inside."""
        names = np.array(self.edge_names)
        return tuple(";".join(names[row]) for row in self.edges)


def fit_counts(
    subject: Subject, prior: Prior = DEFAULT, n_yes: npt.ArrayLike | None = None
) -> Fits:
    """Fit counts, (rows, pairs), over a subject's pairs at one interval, by default its own.

    All in one batch of Newton ascents. The prior's normal of mu1 is the penalty.

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> fits = fit_counts(subject)
    >>> fits.at_edge, bool(fits.arrived[0])
    (('q0=1',), True)
    """
    refuse_intervals([subject], "maximum-likelihood fit")
    posterior = paper_posterior(subject, prior)
    posterior = replace(posterior, centre=posterior.sbar)
    counts = np.atleast_2d(np.asarray(subject.n_yes if n_yes is None else n_yes))
    fitted = PenalisedLikelihood(posterior, counts)
    starts, rows = _starts(fitted), np.arange(len(fitted.n_yes))
    row_of_start = np.repeat(rows, starts.shape[1])
    _, ascent = _ascended(
        fitted,
        row_of_start,
        starts.reshape(-1, 4),
        most_steps=_MOST_STEPS,
        least_gain=_LEAST_GAIN,
    )
    value = ascent.value.reshape(len(rows), -1)
    is_highest = value > value.max(axis=1, keepdims=True) - _rounding(value)
    # Of equal ones the first: rather inside than on gamma = 0.
    best = is_highest.argmax(axis=1) + rows * starts.shape[1]
    density, ended = _ascended(fitted, rows, ascent.x[best], most_steps=10 * _MOST_STEPS)
    return _described(fitted, ended, density.curvature(ended.x, rows))


def _starts(fitted: PenalisedLikelihood) -> FloatArray:
    """The highest points of the parts of the grid, (rows, parts, 4).

    Of 6,400 rows (replicates of 16 subjects, blunt and hard ones most) 3 stayed below the best that
    these or other grids led to.
    """
    starts = []
    for shares, sides in _PARTS:
        pulls = np.array(
            [_EMPTY if share == 0.0 else max(-np.log(share), _FULL) for share in shares]
        )
        offsets = fitted.scale * np.unique(np.outer(sides, _OFFSETS))
        axes = np.meshgrid(offsets, pulls, -np.log(fitted.scale) - _WIDTHS, -np.log(_SHARES))
        starts.append(fitted.highest(np.stack([axis.ravel() for axis in axes], axis=-1)))
    return np.stack(starts, axis=1)


def _ascended(
    fitted: PenalisedLikelihood,
    row: IndexArray,
    start: FloatArray,
    *,
    most_steps: int,
    least_gain: float = 0.0,
) -> tuple[Differenced, Ascent]:
    """Newton from starts, (points, 4), of rows, (points,).

    On the edge gamma = 0 offset and pull stay.
    """
    is_held = (start[:, 1:2] == _EMPTY) & [True, True, False, False]
    lower = np.array([-np.inf, _FULL, -np.log(fitted.scale) - _FAR, _FULL])
    density = Differenced(lambda u, index: fitted.gradient(u, row[index]), *start.shape)
    return density, ascend(
        density.expand,
        start,
        lower=lower,
        is_held=is_held,
        largest_step=3.0,
        most_steps=most_steps,
        least_gain=least_gain,
        value_at=lambda u, index: fitted.value(u, row[index]),
    )


def _rounding(value: FloatArray) -> FloatArray:
    """Differences up to this are rounding, nats: two such values are one maximum, found twice."""
    return 1e-9 + 4e-15 * np.abs(value)


def _described(fitted: PenalisedLikelihood, ended: Ascent, curvature: FloatArray) -> Fits:
    """Natural parameters, edges and what stays open, all rows at once."""
    sup = _suprema(fitted, ended.x, ended.value)
    _, pull, _, share = sup.u.T
    beyond = sup.wide | sup.never
    open_ = _left_open(fitted, ended, curvature)
    open_[:, :3] &= ~beyond[:, None]
    open_[:, 1:3] = (open_[:, 1:3] & ~sup.narrow[:, None]) | sup.never[:, None]
    open_[:, 3] &= ~sup.never
    x, posterior = fitted.coordinates(sup.u), fitted.posterior
    quantities = posterior.quantities(x)
    is_full, no_pull = (share <= _FULL) & ~open_[:, 3], pull >= _EMPTY
    parameters = np.stack([quantities[name] for name in posterior.names.natural], axis=-1)
    parameters[no_pull, 0] = posterior.prior.penalty.mean
    parameters[no_pull, 2] = 0.0
    parameters[sup.narrow, 1:3], parameters[sup.wide, 1:3] = 0.0, np.inf
    parameters[is_full, 3], parameters[sup.never, 3] = (1.0, 0.0)[:: int(fitted.sign)]
    plain = ~(beyond | sup.narrow)
    edges = (
        *((plain & no_pull) | sup.vanished, plain & (pull <= _FULL) & ~open_[:, 2]),
        *(sup.never, is_full)[:: int(fitted.sign)],
        *(sup.narrow, sup.wide, open_.any(axis=1)),
    )
    objective = np.maximum(ended.value, fitted.value(sup.u, np.arange(len(x))))
    return Fits(
        parameters=np.where(open_, np.nan, parameters),
        log_likelihood=objective + fitted.penalty(sup.u),
        objective=objective,
        edges=np.stack(edges, axis=-1),
        arrived=ended.has_converged | beyond,
        points=x,
        subject=posterior.subject,
    )


class _Suprema(NamedTuple):
    """Where suprema lie, (rows, 4), and which of them lie at an edge.

    The edges are an infinite width, a share of 0, no width, and no width with no pull.
    """

    u: FloatArray
    wide: BoolArray
    never: BoolArray
    narrow: BoolArray
    vanished: BoolArray


def _suprema(fitted: PenalisedLikelihood, u: FloatArray, value: FloatArray) -> _Suprema:
    """From where ascents ended, (rows, 4).

    The edge where going there costs nothing and going elsewhere does.
    """
    (c, pull, width, share), row, end = u.T, np.arange(len(u)), u.copy()
    design, middle, penalty = (
        fitted.posterior.subject,
        -np.log(fitted.scale),
        fitted.posterior.prior.penalty,
    )

    def goes(
        rows: BoolArray, toward: Sequence[npt.ArrayLike], against: Sequence[npt.ArrayLike] = ()
    ) -> BoolArray:
        """Which rows go there, of some."""
        points = [
            np.stack(np.broadcast_arrays(*where, row)[:4], axis=-1)
            for where in (toward, against)
            if where
        ]
        high, *others = (fitted.value(at, row) >= value - _rounding(value) for at in points)
        has_gone = np.asarray(rows & high & ~np.any(others, axis=0))
        end[has_gone] = points[0][has_gone]
        return has_gone

    no_pull = (0.0, _EMPTY)
    wide = goes(np.ones(len(u), bool), (*no_pull, middle - _FAR, share), (*no_pull, middle, share))
    never = goes(~wide, (*no_pull, width, _EMPTY), (*no_pull, middle, np.log(2.0)))
    # Without a width different stimuli are told apart for certain; identical ones still differ by p
    # (mu1 - s1) / w.
    is_open = ~(wide | never) & bool(np.any(design.s1 != design.s2))
    vanished = goes(is_open, (c * np.exp(-_FAR), pull + _FAR, width + _FAR, share))
    narrow = goes(is_open & ~vanished, (c, pull, width + _FAR, share)) | vanished
    far = np.where(
        pull < _EMPTY,
        c * np.exp(np.minimum(pull, _EMPTY)),
        MAX_PULL * (penalty.mean - fitted.posterior.sbar),
    )
    goes(~(wide | never | narrow), (*no_pull, width, share), (far, _FULL, width, share))
    return _Suprema(end, wide, never, narrow, vanished)


def _left_open(fitted: PenalisedLikelihood, ended: Ascent, curvature: FloatArray) -> BoolArray:
    """Which natural parameters can change along a flat direction of the objective, (rows, 4).

    Directions count in units of the width for the offset and logarithmically for the rest.
    """
    u = ended.x
    held = (u[:, 1:2] == _EMPTY) & [True, True, False, False]
    bound = (u <= _FULL) & (ended.gradient < -_FLAT) & [False, True, False, True]
    free, unit = ~(held | bound), np.ones(u.shape)
    unit[:, 0] = np.exp(-u[:, 2])
    both_free = free[:, :, None] & free[:, None, :]
    bend = np.where(both_free, curvature * unit[:, :, None] * unit[:, None, :], np.eye(4))
    values, vectors = np.linalg.eigh(bend)
    flat = values < np.maximum(
        _FLAT, _ROUGH * np.einsum("rcd,rcc->rd", np.square(vectors), np.abs(bend))
    )

    def described(points: FloatArray) -> FloatArray:
        quantities = fitted.posterior.quantities(fitted.coordinates(points))
        first, *sigmas, last = (quantities[name] for name in fitted.posterior.names.natural)
        return np.stack([first, *map(np.log, sigmas), last], axis=-1)

    steps = _STEP * np.moveaxis(vectors * unit[:, :, None], 2, 0)  # (directions, rows, coordinates)
    along = np.abs(
        np.stack([described(u + step) - described(u - step) for step in steps], axis=-1)
    ) / (2.0 * _STEP)
    return (flat[:, None, :] & (along > _STILL)).any(axis=2)
