"""Maximum-likelihood fit of the four parameters with the paper's penalty on mu1, for one count vector or thousands at once.

Maximised is log likelihood - (mu1 - mean)^2 / (2 V_1) over 0 <= gamma <= 1, 0 <= q0 <= 1 and any width. The supremum often lies on an
edge, sometimes where a parameter is infinite or 0 or does not matter: each of these is found and said. Source: Eq. mod:logp_grouped.
(The paper calls it minimising the log-likelihood; it is maximising.)

Edges and how they are found: gamma = 1 and q0 = 1 are bounds that the Newton ascent can rest on; gamma = 0 (mu1 at the penalty's mean,
no order effect) is fitted on its own; an infinite width (the pair does not matter) and a vanishing one (only identical stimuli were ever
called 'equal') are limits that have their own, smaller problem.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import xlogy

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.classical.penalised_likelihood import Counts, Design, PenalisedLikelihood, first_starts
from bayes_toe.data.study import Subject
from bayes_toe.inference.maxima import ascend
from bayes_toe.model.closed_form import LN2, MAX_PULL
from bayes_toe.model.prior import DEFAULT, Prior

#: Logarithmic curvature, in nats, below which a direction counts as flat: a change by a factor e costs nothing that could be seen.
_FLAT = 1e-6
#: A pull or a width may change this little along a flat direction and still count as determined.
_STILL = 1e-3
_ITERATIONS = 40  # after which only the best start of each row goes on
_NO_PULL = 1e-6  # a pull below it is on its way to gamma = 0 where that edge is as good
#: Where a maximum may lie beyond the open domain, in the order in which `at_edge` names them.
EDGES = ("gamma=0", "gamma=1", "q0=0", "q0=1", "sigma_p=0", "sigma_p=inf", "not unique")


@dataclass(frozen=True, eq=False)
class Fits:
    """Maximum-likelihood fits of one design to one or many count vectors.

    Attributes
    ----------
    parameters : array, shape (rows, 4)
        mu1, sigma_p, sigma_l (natural-log intensity) and q0; NaN where the data leave the parameter open ("not unique").
    log_likelihood : array, shape (rows,)
        At the maximum, without binomial coefficients and without the penalty, nats.
    objective : array, shape (rows,)
        Log likelihood minus penalty: what was maximised.
    edges : array of bool, shape (rows, len(EDGES))
        On which edges the maximum lies.
    arrived : array of bool, shape (rows,)
        False where the ascent did not meet its criterion; the row is then the best point found.
    identified : array, shape (rows, 4)
        Offset c, pull p, width w and q0, from which curves follow also where a natural parameter has no value.
    sbar : float
        Mean first stimulus, natural-log intensity; mu1 = sbar + c/p.
    """

    parameters: FloatArray
    log_likelihood: FloatArray
    objective: FloatArray
    edges: BoolArray
    arrived: BoolArray
    identified: FloatArray
    sbar: float

    def __len__(self) -> int:
        return len(self.objective)

    @property
    def at_edge(self) -> tuple[str, ...]:
        """The edges of every row as text, joined with ';', empty for a maximum inside."""
        return tuple(";".join(name for name, here in zip(EDGES, row, strict=True) if here) for row in self.edges)

    def equal_probability(self, s1: npt.ArrayLike, s2: npt.ArrayLike) -> FloatArray:
        """P(equal) of pairs by every row; s1, s2 natural-log intensities of shape (pairs,); returns (rows, pairs).

        Source: Eq. mod:q.
        """
        first, second = np.atleast_1d(np.asarray(s1, np.float64)), np.atleast_1d(np.asarray(s2, np.float64))
        c, p, w, q0 = (column[:, None] for column in self.identified.T)
        z = ((second - first) + p * (first - self.sbar) - c) / w
        return np.asarray(q0 * np.exp(-LN2 * np.square(z)))


def fit_subject(subject: Subject, prior: Prior | None = None) -> Fits:
    """The maximum-likelihood fit of one subject, as a batch of one row.

    Examples
    --------
    >>> found = fit_subject(Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50]))
    >>> found.at_edge, bool(found.arrived[0])
    (('q0=1',), True)
    """
    design = Design.of(subject, DEFAULT if prior is None else prior)
    counts = Counts.of(subject.n_yes, subject.n_trials)
    return fit_counts(design, counts, first_starts(design, counts))


def fit_counts(design: Design, counts: Counts, starts: FloatArray) -> Fits:
    """Fit every row from its starts (offset, log(p/p_max), log w, log q0), shape (4, rows, starts), all in one batch of Newton ascents."""
    # Where identical stimuli alone were called 'equal' and others were shown, the width falls to 0: the other pairs have P(equal) = 0 and
    # are out of play; identical ones still differ by p (mu1 - s1) / w.
    apart = design.s1 != design.s2
    asked, called = (counts.different[:, apart] > 0).any(axis=1), (counts.equal[:, apart] > 0).any(axis=1)
    narrow = np.asarray(asked & ~called & (counts.equal > 0).any(axis=1))
    used = Counts(*(np.where(narrow[:, None] & apart, 0.0, part) for part in counts))
    best = _best_ascents(design, used, starts, narrow)
    return _describe(design, counts, used, _Found(best, narrow, *_flat_maximum(design, used, best, narrow)))


class _Best(NamedTuple):
    """The best ascent of every row: where, how high, its Hessian, which coordinates were free, whether it arrived, its penalty."""

    y: FloatArray
    value: FloatArray
    hessian: FloatArray
    free: BoolArray
    arrived: BoolArray
    penalty: FloatArray


class _Found(NamedTuple):
    """The best ascents, which rows have no width, or an infinite one, and the value at that."""

    best: _Best
    narrow: BoolArray
    flat: BoolArray
    flat_value: FloatArray


def _flat_maximum(design: Design, counts: Counts, best: _Best, narrow: BoolArray) -> tuple[BoolArray, FloatArray]:
    """Rows whose supremum lies at infinite width, where every pair is answered alike, and the value there.

    With v = 1/w^2 the objective is smooth at v = 0 (mu1 then rests at the penalty's mean). The edge is a maximum where the slope in v is
    negative for every pull, or 0 with a negative curvature; where both are 0 the width does not matter at all.
    """
    k, d = (part.sum(axis=1) for part in counts)
    value = np.asarray(xlogy(k, k / (k + d)) + xlogy(d, d / (k + d)))
    with np.errstate(divide="ignore", invalid="ignore"):  # d = 0: every answer is 'equal', and no term below is used
        odds = np.where(d > 0, k / d, 0.0)[:, None]
    score, curve = counts.equal - counts.different * odds, counts.different * odds * (1.0 + odds)
    step, lever = design.s2 - design.s1, design.s1 - design.penalty.mean
    squares = np.stack([np.square(step), 2.0 * step * lever, np.square(lever)], axis=-1)  # of s2 - mu_2, as a quadratic in the pull
    rise = _largest_quadratic(-score @ squares, np.where(narrow, MAX_PULL, 0.0))
    size = (counts.equal + counts.different) @ (np.square(step) + np.square(lever))
    falls = (rise < -1e-9 * size) | ((rise <= 1e-9 * size) & (_least_spread(curve, squares, narrow) > 1e-9))
    return np.asarray((k > 0) & falls & (value >= best.value - _same(value))), value


def _least_spread(weight: FloatArray, squares: FloatArray, narrow: BoolArray) -> FloatArray:
    """Smallest relative weighted variance of the squared displacement over three pulls, (rows,); 0 where the width cannot matter."""
    pulls = np.array([0.0, 0.5 * MAX_PULL, MAX_PULL])
    x = squares @ np.power(pulls, np.arange(3)[:, None])  # (pairs, pulls)
    total = np.maximum(weight.sum(axis=1, keepdims=True), np.finfo(float).tiny)
    mean, square = weight @ x / total, weight @ np.square(x) / total
    spread = np.divide(square - mean**2, square, out=np.zeros_like(mean), where=square > 0.0)
    return np.asarray(np.where(narrow, spread[:, -1], spread.min(axis=1)))


def _largest_quadratic(coefficients: FloatArray, lowest: FloatArray) -> FloatArray:
    """Largest value of a + b p + c p^2 for p in lowest..p_max, coefficients (rows, 3) -> (rows,)."""
    a, b, c = coefficients.T
    vertex = np.clip(np.divide(-b, 2.0 * c, out=np.zeros_like(b), where=c < 0), lowest, MAX_PULL)
    return np.asarray(np.max([a + b * p + c * p**2 for p in (lowest, vertex, np.full_like(a, MAX_PULL))], axis=0))


def _best_ascents(design: Design, counts: Counts, starts: FloatArray, narrow: BoolArray) -> _Best:
    """Newton from every start of every row, and on the edge gamma = 0, in one batch; the best of each row, led to the end.

    Of equals one that arrived, and rather inside than on gamma = 0 than on its way there.
    """
    x, rows = starts.copy(), len(counts.equal)
    fixed = np.zeros(x.shape, bool)
    fixed[:2] = np.isneginf(x[1])
    # With identical stimuli alone only p/w matters: p rests at its largest value.
    x[0, narrow], x[1, narrow] = np.where(np.isneginf(x[1, narrow]), design.scale, x[0, narrow]), 0.0
    fixed[:, narrow] = np.array([False, True, False, False])[:, None, None]
    upper = np.array([np.inf, 0.0, np.log(design.scale) + 20.0, 0.0])[:, None]
    row, held = np.repeat(np.arange(rows), x.shape[2]), fixed.reshape(4, -1)
    equal, different = (np.ascontiguousarray(part.T) for part in counts)
    objective = PenalisedLikelihood(design, equal, different, row)
    found = ascend(objective, x.reshape(4, -1), upper=upper, fixed=held, most=3.0, iterations=_ITERATIONS, rivals=row)
    value, pull = found.value.reshape(rows, -1), found.x[1].reshape(rows, -1)
    most = value.max(axis=1, keepdims=True)
    near = (value - most) / _same(most)
    rank = np.where(pull > np.log(_NO_PULL), 2.0, np.isneginf(pull)) + 0.5 * near
    rank = np.where((near >= -1.0) & found.arrived.reshape(rows, -1), rank, near - 9.0)
    chosen = rank.argmax(axis=1) + np.arange(rows) * value.shape[1]
    best, held = found.take(chosen), held[:, chosen]
    late = np.flatnonzero(~best.arrived)
    rest = replace(objective, row=row[chosen[late]])
    best.put(late, ascend(rest, best.x[:, late], upper=upper, fixed=held[:, late], most=3.0, iterations=10 * _ITERATIONS))
    free = ~held & ~((best.x >= np.array([np.inf, 0.0, np.inf, 0.0])[:, None]) & (best.gradient > _FLAT))
    return _Best(best.x.T, best.value, np.moveaxis(best.hessian, -1, 0), free.T, best.arrived, objective.penalty(best.x))


def _same(value: FloatArray) -> FloatArray:
    """Differences up to this are rounding, nats: two such values are one maximum, found twice."""
    return np.asarray(1e-9 + 4e-15 * np.abs(value))


def _describe(design: Design, counts: Counts, used: Counts, found: _Found) -> Fits:
    """Natural parameters, edges and what stays open, all rows at once."""
    best, narrow, flat = found.best, found.narrow, found.flat
    never = np.asarray(~(counts.equal > 0).any(axis=1))  # q0 = 0: nothing else matters
    where = _identified(design, used, found, never)
    c, p, w, q0 = where.T
    open_ = _left_open(best, narrow) & ~(flat | never)[:, None]
    open_[never, 1:3] = True
    # Without a pull mu1 is at the penalty's mean; sigma_p and sigma_l are 0 or infinite as the width is.
    mu1 = np.where(p > 0.0, design.sbar + np.divide(c, p, out=np.zeros_like(c), where=p > 0.0), design.penalty.mean)
    wide = np.where(np.isinf(w), 1.0, w)
    sigmas = (np.where(narrow, 0.0, np.where(np.isinf(w), w, wide * part)) for part in ((1.0 - p) ** 1.5, np.sqrt((1.0 - p) * p)))
    plain = ~(flat | narrow | never)
    no_pull, whole_pull = (plain & (p == 0.0)) | narrow, plain & (best.y[:, 1] == 0.0) & ~open_[:, 2]
    edges = (no_pull, whole_pull, never, (q0 == 1.0) & ~open_[:, 3], narrow, flat & ~narrow, open_.any(axis=1))
    return Fits(
        parameters=np.where(open_, np.nan, np.stack([mu1, *sigmas, q0], axis=-1)),
        log_likelihood=np.where(never, 0.0, np.where(flat, found.flat_value, best.value + best.penalty)),
        objective=np.where(never, 0.0, np.where(flat, found.flat_value, best.value)),
        edges=np.stack(edges, axis=-1),
        arrived=best.arrived | flat | never,
        identified=where,
        sbar=design.sbar,
    )


def _identified(design: Design, used: Counts, found: _Found, never: BoolArray) -> FloatArray:
    """Offset, pull, width and q0, (rows, 4); a width that vanishes is stood for by one so small that only p / w still shows."""
    where = np.exp(found.best.y)
    where[:, 0], where[:, 1] = found.best.y[:, 0], MAX_PULL * where[:, 1]
    steps, (k, d) = np.abs(design.s2 - design.s1), (part.sum(axis=1)[found.flat] for part in used)
    least = 1e-3 * float(np.min(steps, where=steps > 0, initial=1.0))
    where[found.narrow, :3] *= least / where[found.narrow, 1:3].sum(axis=1, keepdims=True)
    width = np.where(found.narrow, least, np.inf)[found.flat]
    where[found.flat] = np.stack([0.0 * k, 0.0 * k, width, k / (k + d)], axis=-1)
    where[never] = 0.0, 0.0, 1.0, 0.0
    return where


def _left_open(best: _Best, narrow: BoolArray) -> BoolArray:
    """Which natural parameters can change along a flat direction of the objective, (rows, 4).

    Directions count in units of the width for the offset and logarithmically for the rest.
    """
    p, w = MAX_PULL * np.exp(best.y[:, 1]), np.exp(best.y[:, 2])
    unit = np.stack([w, np.ones_like(w), np.ones_like(w), np.ones_like(w)], axis=-1)
    free = best.free[:, :, None] & best.free[:, None, :]
    values, vectors = np.linalg.eigh(np.where(free, -best.hessian * unit[:, :, None] * unit[:, None, :], np.eye(4)))
    # Slopes of (mu1, log sigma_p, log sigma_l, q0) in (c / w, log p, log w, log q0); none in p where p = 0.
    slopes, inverse = np.zeros((len(p), 4, 4)), np.divide(1.0, p, out=np.zeros_like(p), where=p > 0.0)
    slopes[:, 0, 0], slopes[:, 0, 1] = w * inverse, -best.y[:, 0] * inverse
    slopes[:, 1, 1], slopes[:, 1, 2] = -1.5 * p / (1.0 - p), 1.0
    slopes[:, 2, 1], slopes[:, 2, 2] = 0.5 - 0.5 * p / (1.0 - p), 1.0
    slopes[:, 3, 3] = np.exp(best.y[:, 3])
    along = slopes @ vectors  # (rows, parameters, directions)
    along[narrow, 1:3] = 0.0
    return np.asarray((np.where(values[:, None, :] < _FLAT, np.abs(along), 0.0) > _STILL).any(axis=2))
