r"""Evidence and posterior moments of one subject by deterministic integration: a reference that shares no code with the samplers.

The integral over x = (c, a, b, l), with a = logit(p/p_max), b = log w, l = logit q0, is nested:

inside   g(a, b, l) = \int exp(log posterior) dc: adaptive Clenshaw-Curtis panels, so that the funnel (the spread of c shrinks with
         p) and several humps in c cost more panels and nothing else;
outside  Z = h_1 h_2 h_3 |L| sum_k g(o + L (h k)): the trapezoidal rule, whose error falls exponentially because g is smooth and
         decays on the whole space, on a sheared lattice (L lower triangular, the local shape of g at its highest point). Only
         points with g > e^-depth max g are kept; they are found by walking from neighbour to neighbour, from every maximum.

Quantiles use the same two representations: along a lattice direction the integral of the band-limited interpolant, whose
cumulative weight is S(x) = 1/2 + Si(pi x)/pi, and along c the integral of the panels' polynomials.

Errors are measured, not assumed, and add up from: the sums with alternating signs along every lattice direction and diagonal (what
halving the number of points would change), the outermost shell of 2 nats (what moving the limits in would change), and the panels'
difference between 17 and 9 points. Each is the error of a coarser rule than the one whose value is returned.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import product
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from numpy.polynomial import chebyshev
from scipy.optimize import brentq, minimize
from scipy.special import expit, logsumexp, sici

from bayes_toe.coordinates import NATURAL, Natural, reach
from bayes_toe.errors import NumericalError
from bayes_toe.model import MAX_PULL

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

QUANTITIES = (*NATURAL, "gain")
LEVELS = (0.05, 0.5, 0.95)
TOLERANCE = 1e-4
#: Changes whenever a change of this file can change a number; stored references carry it.
METHOD = "nested 2"

_STEP = 0.8  # first lattice step in units of the local standard deviation
_DEPTH, _DEEPER = 15.0, 3.0  # nats below the highest lattice value at which the walk turns back; what is added if that is not enough
_SHELL = 2.0  # nats: thickness of the outermost shell whose weight bounds what lies outside
_DROP = 18.0  # nats below its own maximum at which an inner integral ends
_SHARP = 3.0  # nats by which the points fall about a local maximum, above which they may miss its top by 1 nat
_MAX_NODES = 600_000
_BATCH = 4096  # lattice points whose inner integrals are done together
_ROWS = 1 << 18  # points of one call of the log density
_ORDER = 16
_EDGES = np.array([-7.0, -3.5, 0.0, 3.5, 7.0])
_CHARACTERS = tuple(sign for sign in product((0, 1), repeat=3) if any(sign))


def _clenshaw_curtis(order: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points on [-1, 1], weights, and the matrix from values to Chebyshev coefficients."""
    points: FloatArray = -np.cos(np.pi * np.arange(order + 1) / order)
    to_coefficients = np.linalg.inv(chebyshev.chebvander(points, order))
    j = np.arange(0, order + 1, 2)
    integrals = np.zeros(order + 1)
    integrals[j] = 2.0 / (1.0 - j**2)
    return points, np.asarray(integrals @ to_coefficients), np.asarray(to_coefficients, np.float64)


_POINTS, _WEIGHTS, _COEFFICIENTS = _clenshaw_curtis(_ORDER)
_COARSE_WEIGHTS = _clenshaw_curtis(_ORDER // 2)[1]


class Density(Protocol):
    """What is integrated: a log density of x = (c, a, b, l) and the natural parameters at x.

    log sigma_p and log sigma_l must be linear in b with slope 1, and mu1 = sbar + c/p: so they are in
    :mod:`bayes_toe.coordinates`. A `subject` is optional; its stimuli say where the likelihood has features in c.
    """

    @property
    def sbar(self) -> float:
        """Mean first stimulus, natural-log units."""

    def log_density(self, x: FloatArray, /) -> FloatArray:
        """Log density at x, shape (points, 4) -> (points,)."""

    def natural(self, x: FloatArray, /) -> Natural:
        """Natural parameters at x, shape (points, 4), each of shape (points,)."""


@dataclass(frozen=True, eq=False)
class Reference:
    """Evidence and posterior moments by quadrature; every error is an estimate from above.

    Attributes
    ----------
    log_evidence, log_evidence_error : float
        Natural logarithm of the integral, nats.
    means, means_error, sds, sds_error : array, shape (5,)
        Of :data:`QUANTITIES`: mu1, sigma_p, sigma_l (natural-log units), q0 and the Kalman gain.
    quantiles, quantiles_error : array, shape (5, 3)
        At the :data:`LEVELS` 5, 50 and 95 %.
    evaluations : int
        Points at which the log density was computed.
    """

    log_evidence: float
    log_evidence_error: float
    means: FloatArray
    means_error: FloatArray
    sds: FloatArray
    sds_error: FloatArray
    quantiles: FloatArray
    quantiles_error: FloatArray
    evaluations: int


def integrate(posterior: Density, *, tolerance: float = TOLERANCE) -> Reference:
    """Integrate a posterior until the estimated errors meet the tolerance, or the lattice has 600,000 points.

    Parameters
    ----------
    posterior : Density
        A :class:`bayes_toe.posterior.Posterior` or anything with its `sbar`, `log_density` and `natural`.
    tolerance : float
        Error allowed for the log evidence, nats; means and standard deviations may have 10 times that in units of the posterior
        standard deviation.

    Returns
    -------
    Reference
        With the errors that were reached: they say so if the tolerance was not.

    Raises
    ------
    NumericalError
        If the density is zero wherever it was looked at, or an inner integral finds no end.
    """
    lattice = _start(posterior, tolerance)
    depth = _DEPTH
    while True:
        lattice.walk(depth)
        audit = _Audit(lattice, depth)
        full = len(lattice.index) > _MAX_NODES
        if not full and audit.total > tolerance:
            if audit.outside > audit.worst.max():
                depth += _DEEPER
            else:
                lattice.halve(int(np.argmax(audit.worst)))
            continue
        quantiles = _quantiles(audit)
        if full or quantiles.worst.max() < 50.0 * tolerance:
            return audit.reference(quantiles)
        lattice.halve(int(np.argmax(quantiles.worst)))


# --- The inner integral over c ------------------------------------------------------------------------------------------------


class _Panels(NamedTuple):
    """Intervals in c with the log density at their 17 points; `node` says to which outer point an interval belongs."""

    node: IntArray
    low: FloatArray
    width: FloatArray
    values: FloatArray

    def some(self, which: BoolArray | IntArray) -> _Panels:
        """The panels of a mask or of indices."""
        return _Panels(self.node[which], self.low[which], self.width[which], self.values[which])


class _Lines(NamedTuple):
    """Inner integrals of a batch: log of integral and of its error, mean and standard deviation of c, each (nodes,); the panels."""

    log_mass: FloatArray
    log_error: FloatArray
    mean: FloatArray
    sd: FloatArray
    panels: _Panels


@dataclass(eq=False)
class _Inner:
    """Integrates the density over c at many (a, b, l) at once."""

    density: Density
    tolerance: float
    evaluations: int = 0

    def __post_init__(self) -> None:
        subject = getattr(self.density, "subject", None)
        steps = np.zeros(0) if subject is None else subject.s2 - subject.s1
        levers = np.zeros(0) if subject is None else subject.s1 - self.density.sbar
        kept = np.unique(np.linspace(0, len(steps) - 1, 16).astype(int)) if len(steps) else np.zeros(0, int)
        order = np.argsort(steps)[kept]
        self._steps, self._levers = steps[order], levers[order]

    def lines(self, outer: FloatArray, centre: FloatArray, scale: FloatArray, floor: float) -> _Lines:
        """Integrals at outer (nodes, 3); centre and scale are guesses; floor is the log of a mass too small to be exact about."""
        panels = self._cut(outer, self._window(outer, centre, scale))
        finished: list[_Panels] = []
        for halvings in range(60):
            mass, error, best = _masses(panels, len(outer))
            total = np.bincount(panels.node, mass, len(outer))
            some = best > -np.inf  # a line on which the density is 0 throughout has mass 0, and no error
            with np.errstate(over="ignore"):
                spare = np.exp(np.subtract(floor, best, where=some, out=np.full(len(best), -np.inf)))
            allowed = self.tolerance * np.maximum(total, spare)
            bad = (error > allowed[panels.node]) | (_unresolved(panels, best) & (halvings < 30))  # an edge is sharp for ever
            open_nodes = np.zeros(len(outer), bool)
            open_nodes[panels.node[bad]] = True
            still = open_nodes[panels.node]
            finished.append(panels.some(~still))
            if not bad.any():
                return _summary(_joined(finished), outer, centre, scale)
            panels = _joined([panels.some(still & ~bad), self._halves(outer, panels.some(bad))])
        raise NumericalError("the log density has a feature in c too narrow to integrate")

    def _evaluate(self, outer: FloatArray, node: IntArray, low: FloatArray, width: FloatArray) -> _Panels:
        """Panels with the log density at their points."""
        x = np.empty((len(node), _ORDER + 1, 4))
        x[..., 0] = low[:, None] + 0.5 * (_POINTS + 1.0) * width[:, None]
        x[..., 1:] = outer[node, None, :]
        flat = x.reshape(-1, 4)
        parts = [self.density.log_density(flat[i : i + _ROWS]) for i in range(0, len(flat), _ROWS)]
        self.evaluations += len(flat)
        return _Panels(node, low, width, np.concatenate([np.zeros(0), *parts]).reshape(-1, _ORDER + 1))

    def _window(self, outer: FloatArray, centre: FloatArray, scale: FloatArray) -> _Panels:
        """Four panels about the centre and, on either side, doubled ones until the density has dropped."""
        edges = centre[:, None] + scale[:, None] * _EDGES
        node = np.arange(len(outer))
        found = [self._evaluate(outer, np.repeat(node, 4), edges[:, :-1].ravel(), np.diff(edges, axis=1).ravel())]
        values = found[0].values.reshape(len(outer), -1)
        best = values.max(axis=1)
        for side, edge, goal in zip((-1, 1), (edges[:, 0], edges[:, -1]), self._goals(outer, edges, best), strict=True):
            at, width = edge.copy(), edges[:, -1] - edges[:, 0]
            active = node[_outermost(values, side) > best - _DROP]
            active = np.union1d(active, node[side * goal > side * at])
            while len(active):
                low = at[active] - width[active] * (side < 0)
                found.append(self._evaluate(outer, active, low, width[active]))
                at[active] += side * width[active]
                width[active] *= 2.0
                best[active] = np.maximum(best[active], found[-1].values.max(axis=1))
                more = (_outermost(found[-1].values, side) > best[active] - _DROP) | (side * goal > side * at)[active]
                active = active[more]
        return _joined(found)

    def _goals(self, outer: FloatArray, edges: FloatArray, best: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far the window must reach at least, left and right: past every hump that a probe finds outside it.

        The likelihood has its humps in c within a few widths of where distances vanish; 17 points there show each as a rise and a fall,
        however narrow it is. The window's own hump takes part as one more point.
        """
        n = len(outer)
        if not len(self._steps):
            return np.full(n, np.inf), np.full(n, -np.inf)
        zeros, margin = self._zeros(outer), 6.0 * np.exp(outer[:, 1])
        low, high = zeros.min(axis=1) - margin, zeros.max(axis=1) + margin
        probe = self._evaluate(outer, np.arange(n), low, high - low)
        c = np.column_stack([low[:, None] + 0.5 * (_POINTS + 1.0) * (high - low)[:, None], 0.5 * (edges[:, 0] + edges[:, -1])])
        order = np.argsort(c, axis=1)
        c = np.take_along_axis(c, order, axis=1)
        values = np.take_along_axis(np.column_stack([probe.values, best]), order, axis=1)
        seen = (c < edges[:, :1]) | (c > edges[:, -1:])
        seen &= np.isfinite(values) & ((_sharpness(values) >= 0.0) | (values > best[:, None] - _DROP))
        before, after = np.column_stack([c[:, 0], c[:, :-1]]), np.column_stack([c[:, 1:], c[:, -1]])
        return np.where(seen, before, np.inf).min(axis=1), np.where(seen, after, -np.inf).max(axis=1)

    def _zeros(self, outer: FloatArray) -> FloatArray:
        """Values of c at which the distance of a pair vanishes, (nodes, pairs)."""
        return np.asarray(self._steps + MAX_PULL * expit(outer[:, 0, None]) * self._levers)

    def _cut(self, outer: FloatArray, panels: _Panels) -> _Panels:
        """Wide panels are cut where a pair's distance z vanishes: there the likelihood has features of width w."""
        high = panels.low + panels.width
        zeros = self._zeros(outer[panels.node])
        wide = panels.width > 4.0 * np.exp(outer[panels.node, 1])
        inside = wide[:, None] & (zeros > panels.low[:, None]) & (zeros < high[:, None])
        split = inside.any(axis=1)
        edges = np.where(inside[split], zeros[split], panels.low[split, None])
        edges = np.sort(np.column_stack([panels.low[split], edges, high[split]]), axis=1)
        width, low = np.diff(edges, axis=1), edges[:, :-1]
        node = np.broadcast_to(panels.node[split, None], low.shape)
        real = width > 0
        return _joined([panels.some(~split), self._evaluate(outer, node[real], low[real], width[real])])

    def _halves(self, outer: FloatArray, panels: _Panels) -> _Panels:
        half = 0.5 * panels.width
        low = np.concatenate([panels.low, panels.low + half])
        return self._evaluate(outer, np.tile(panels.node, 2), low, np.tile(half, 2))


def _outermost(values: FloatArray, side: int) -> FloatArray:
    """Highest value among the last points on a side, (nodes,); values (nodes, points) are in order of c."""
    return np.asarray((values[:, :6] if side < 0 else values[:, -6:]).max(axis=1))


def _sharpness(values: FloatArray) -> FloatArray:
    """How far each row falls on both sides of its local maxima within three points, nats; -1 where there is no maximum.

    Three, because the top may lie half-way between two equal points; ends count as if what is beyond were mirrored.
    """
    padded = np.column_stack([values[:, [2, 1]], values, values[:, [-2, -3]]])
    with np.errstate(invalid="ignore"):
        further, left, right, beyond = (values - padded[:, i : i + values.shape[1]] for i in (0, 1, 3, 4))
        top = (left >= 0.0) & (right >= 0.0) & (values > -np.inf)
        return np.where(top, np.maximum(np.minimum(left, beyond), np.minimum(further, right)), -1.0)


def _unresolved(panels: _Panels, best: FloatArray) -> BoolArray:
    """Panels with a peak so sharp that its top may lie between the points, and so high that it may matter."""
    sharp = _sharpness(panels.values)
    return np.asarray(((sharp > _SHARP) & (panels.values + sharp > best[panels.node, None] - _DROP)).any(axis=1))


def _joined(panels: list[_Panels]) -> _Panels:
    return _Panels(*(np.concatenate(columns) for columns in zip(*panels, strict=True)))


def _masses(panels: _Panels, nodes: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Integral and error of every panel in units of exp(best of its node), and that best, (nodes,)."""
    best = np.full(nodes, -np.inf)
    np.maximum.at(best, panels.node, panels.values.max(axis=1))
    if np.isnan(best).any():
        raise NumericalError("the log density is NaN")
    value = _relative(panels, best)
    mass = 0.5 * panels.width * (value @ _WEIGHTS)
    return mass, np.abs(mass - 0.5 * panels.width * (value[:, ::2] @ _COARSE_WEIGHTS)), best


def _relative(panels: _Panels, best: FloatArray) -> FloatArray:
    """Density in units of its maximum along the line; 0 where the whole line is 0."""
    return np.asarray(np.exp(panels.values - np.where(np.isfinite(best), best, 0.0)[panels.node, None]))


def _summary(panels: _Panels, outer: FloatArray, centre: FloatArray, scale: FloatArray) -> _Lines:
    """Mass, error, mean and standard deviation of every line."""
    n = len(outer)
    mass, error, best = _masses(panels, n)
    weight = 0.5 * panels.width[:, None] * _relative(panels, best) * _WEIGHTS
    offset = (panels.low - centre[panels.node])[:, None] + 0.5 * (_POINTS + 1.0) * panels.width[:, None]
    total = np.bincount(panels.node, mass, n)
    safe = np.where(total > 0, total, 1.0)
    shift = np.bincount(panels.node, (weight * offset).sum(axis=1), n) / safe
    square = np.bincount(panels.node, (weight * (offset - shift[panels.node, None]) ** 2).sum(axis=1), n) / safe
    sd = np.where(total > 0, np.sqrt(square), scale)
    with np.errstate(divide="ignore"):
        log_mass, log_error = np.log(total) + best, np.log(np.bincount(panels.node, error, n)) + best
    return _Lines(log_mass, log_error, centre + shift, sd, panels.some(mass > 1e-10 * total[panels.node]))


# --- The outer lattice over (a, b, l) -----------------------------------------------------------------------------------------


@dataclass(eq=False)
class _Lattice:
    """Lattice points outer = origin + (step * index) @ basis.T that matter, and the inner integral at each.

    The rows of `columns`: log of the integral and of its error, mean and standard deviation of c, guess of the latter for neighbours.
    """

    inner: _Inner
    origin: FloatArray
    basis: FloatArray
    step: FloatArray
    index: IntArray = field(default_factory=lambda: np.zeros((0, 3), np.int64))
    columns: FloatArray = field(default_factory=lambda: np.zeros((5, 0)))
    expanded: BoolArray = field(default_factory=lambda: np.zeros(0, bool))
    panels: list[_Panels] = field(default_factory=list)

    @property
    def log_mass(self) -> FloatArray:
        """Log of the inner integral, (nodes,)."""
        return np.asarray(self.columns[0])

    def outer(self, index: IntArray) -> FloatArray:
        """(a, b, l) of lattice points, (nodes, 3)."""
        return np.asarray(self.origin + (index * self.step) @ self.basis.T)

    def add(self, index: IntArray, centre: FloatArray, scale: FloatArray) -> None:
        """Compute the inner integral at new points."""
        for i in range(0, len(index), _BATCH):
            floor = self.log_mass.max(initial=-np.inf) + np.log(0.02)
            some = slice(i, i + _BATCH)
            lines = self.inner.lines(self.outer(index[some]), centre[some], scale[some], floor)
            sd = np.maximum(lines.sd, 0.3 * scale[some])  # as a guess for the neighbours it may shrink, not collapse
            columns = np.stack([lines.log_mass, lines.log_error, lines.mean, lines.sd, sd])
            self._append(index[some], columns, lines.panels, floor)

    def _append(self, index: IntArray, columns: FloatArray, panels: _Panels, floor: float) -> None:
        first = len(self.index)
        best = columns[0]
        kept = best[panels.node] > floor - 30.0
        panels = panels.some(kept)
        values = np.exp(panels.values - best[panels.node, None]).astype(np.float32)
        self.panels.append(_Panels(panels.node + first, panels.low, panels.width, values))
        self.index = np.concatenate([self.index, index])
        self.columns = np.concatenate([self.columns, columns], axis=1)
        self.expanded = np.concatenate([self.expanded, np.zeros(len(index), bool)])

    def walk(self, depth: float) -> None:
        """Add neighbours of every point within depth nats of the highest until none is missing."""
        while len(self.index) <= _MAX_NODES:
            active = np.flatnonzero(~self.expanded & (self.log_mass > self.log_mass.max() - depth))
            if not len(active):
                return
            self.expanded[active] = True
            moves = np.concatenate([np.eye(3, dtype=np.int64), -np.eye(3, dtype=np.int64)])
            neighbours = (self.index[active, None, :] + moves).reshape(-1, 3)
            keys, first = np.unique(_keys(neighbours), return_index=True)
            first = first[~np.isin(keys, _keys(self.index))]
            parent = active[first // len(moves)]
            self.add(neighbours[first], self.columns[2, parent], self.columns[4, parent])

    def halve(self, direction: int) -> None:
        """Halve the step along one direction; what is known stays."""
        self.step[direction] *= 0.5
        self.index[:, direction] *= 2
        self.expanded[:] = False


def _keys(index: IntArray) -> IntArray:
    """One integer for each triple of integers below a million."""
    base = np.int64(1 << 20)
    return np.asarray(((index[:, 0] + base) * 2 * base + index[:, 1] + base) * 2 * base + index[:, 2] + base)


def _start(density: Density, tolerance: float) -> _Lattice:
    """A lattice shaped like the density at its highest maximum, with a first point near every maximum."""
    inner = _Inner(density, 0.05 * tolerance)
    peaks = _peaks(inner)
    curvature = _curvature(inner, peaks[0])
    spread = 1.0 / np.sqrt(np.abs(curvature[0, 0]) + 1e-300)
    lattice = _Lattice(inner, peaks[0, 1:].copy(), _shape(curvature), np.full(3, _STEP))
    steps = np.linalg.solve(lattice.basis, (peaks[:, 1:] - lattice.origin).T).T / lattice.step
    index, which = np.unique(np.rint(steps).astype(np.int64), axis=0, return_inverse=True)
    ends = np.array([(peaks[which == i, 0].min(), peaks[which == i, 0].max()) for i in range(len(index))])
    lattice.add(index, ends.mean(axis=1), spread + 0.5 * np.diff(ends, axis=1)[:, 0])
    return lattice


def _shape(curvature: FloatArray) -> FloatArray:
    """Lower triangular factor of the covariance of (a, b, l) that the curvature implies, at most 1 in any direction."""
    outer = curvature[1:, 1:] - np.outer(curvature[1:, 0], curvature[0, 1:]) / curvature[0, 0]
    values, vectors = np.linalg.eigh(0.5 * (outer + outer.T))
    return np.asarray(np.linalg.cholesky((vectors / np.maximum(np.abs(values), 1.0)) @ vectors.T))


def _peaks(inner: _Inner, points: int = 1 << 14, climbs: int = 24) -> FloatArray:
    """Maxima of the density, best first, (climbs, 4): simplex climbs from the best, well separated points of a wide scan."""

    def height(x: FloatArray) -> FloatArray:
        inner.evaluations += len(x)
        return inner.density.log_density(x)

    def depth(x: FloatArray) -> float:
        return -float(height(x[None])[0])

    scan = _scan(points)
    value = height(scan)
    chosen: list[int] = []
    for i in np.argsort(-value, kind="stable"):
        if len(chosen) == climbs or not np.isfinite(value[i]):
            break
        if all(np.abs(np.arcsinh(scan[i] * [3, 1, 1, 1]) - np.arcsinh(scan[j] * [3, 1, 1, 1])).max() > 0.5 for j in chosen):
            chosen.append(int(i))
    if not chosen:
        raise NumericalError("the density is 0 wherever it was looked at")
    peaks = scan[chosen]
    for _ in range(4):
        options = {"maxfev": 800, "xatol": 1e-9, "fatol": 1e-3}
        peaks = np.stack([minimize(depth, x, method="Nelder-Mead", options=options).x for x in peaks])
    return np.asarray(peaks[np.argsort(-height(peaks), kind="stable")])


def _scan(points: int) -> FloatArray:
    """Evenly spread points (points, 4) where posteriors of this model can have their weight; c is spread over orders of magnitude."""
    root = 1.1673039782614187  # of x^5 = x + 1: the generalised golden ratio of 4 dimensions
    unit = (0.5 + np.arange(1, points + 1)[:, None] * root ** -np.arange(1.0, 5.0)) % 1.0
    side = 2.0 * unit[:, 0] - 1.0
    c = np.sign(side) * np.exp(np.log(1e-3) + np.abs(side) * np.log(50.0 / 1e-3))
    return np.column_stack([c, -10.0 + 16.0 * unit[:, 1], -6.0 + 9.0 * unit[:, 2], -6.0 + 18.0 * unit[:, 3]])


def _curvature(inner: _Inner, x: FloatArray) -> FloatArray:
    """Negative Hessian (4, 4) by differences over steps on which the log density drops by about 1 nat, or of 1."""

    def height(shift: FloatArray) -> FloatArray:
        inner.evaluations += len(shift)
        return inner.density.log_density(x + shift)

    sizes = np.ones(4)
    for _ in range(60):
        units = np.diag(sizes)
        far = height(units) + height(-units) - 2.0 * height(np.zeros((1, 4))) < -4.0
        if not far.any():
            break
        sizes[far] *= 0.5
    i, j = (0.5 * units[side.ravel()] for side in np.indices((4, 4)))
    mixed = height(i + j) - height(i - j) - height(j - i) + height(-i - j)
    return np.asarray(-mixed.reshape(4, 4) / np.outer(sizes, sizes))


# --- Sums over the lattice and their errors -----------------------------------------------------------------------------------


class _Audit:
    """Weights of the lattice points, moments, and the errors of both.

    Attributes
    ----------
    weight : array, shape (nodes,)
        Normalised weights.
    outside : float
        Bound for what lies outside, in units of the error that is allowed (as `worst`).
    worst : array, shape (3,)
        Error along each lattice direction.
    """

    def __init__(self, lattice: _Lattice, depth: float) -> None:
        self.lattice = lattice
        self.log_total = float(logsumexp(lattice.log_mass))
        self.weight = np.exp(lattice.log_mass - self.log_total)
        outer = lattice.outer(lattice.index)
        self.outer = outer
        self.shell = lattice.log_mass < lattice.log_mass.max() - depth + _SHELL
        self.panel_error = float(np.exp(lattice.columns[1] - self.log_total).sum())
        first, second = self._node_moments()
        self.means = self.weight @ first
        central = second - first**2 + (first - self.means) ** 2
        self.sds = np.sqrt(self.weight @ central)
        # The columns whose sums are reported: 1, theta - mean, and (theta - mean)^2 - variance, the latter two in units of sd.
        scaled = [np.ones(len(outer))[:, None], (first - self.means) / self.sds, 0.5 * (central / self.sds**2 - 1.0)]
        self.errors = self._errors(np.column_stack(scaled))

    def _node_moments(self) -> tuple[FloatArray, FloatArray]:
        """First and second moment of mu1 - sbar, sigma_p, sigma_l, q0 and gain along each line, each (nodes, 5)."""
        mean, sd = self.lattice.columns[2:4]
        x = np.column_stack([mean, self.outer])
        theta = self.lattice.inner.density.natural(x)
        gain = 1.0 - MAX_PULL * expit(self.outer[:, 0])
        first = np.column_stack([reach(x), theta.sigma_p, theta.sigma_l, theta.q0, gain])
        second = first**2
        spread = np.column_stack([sd, self.outer])
        second[:, 0] += reach(spread) ** 2
        return first, second

    def _errors(self, columns: FloatArray) -> FloatArray:
        """Errors of the weighted sums of the columns: along the 7 characters of the lattice, outside, and inside; (9, columns)."""
        rows = [np.abs((self.weight * self.sign(e)) @ columns) for e in _CHARACTERS]
        rows.append(np.abs(self.weight[self.shell]) @ np.abs(columns[self.shell]))
        rows.append(np.full(columns.shape[1], self.panel_error))
        return np.stack(rows)

    def sign(self, character: tuple[int, ...]) -> FloatArray:
        """(-1)^(character . index), (nodes,)."""
        return np.asarray(1.0 - 2.0 * ((self.lattice.index @ np.array(character)) % 2))

    def _in_units(self) -> FloatArray:
        """The rows of `errors` by their worst column, the evidence counting tenfold."""
        allowance = np.where(np.arange(self.errors.shape[1]) == 0, 1.0, 10.0)
        return np.asarray((self.errors / allowance).max(axis=1))

    @property
    def worst(self) -> FloatArray:
        """Sum of the characters that alternate along each direction, (3,)."""
        return np.array(_CHARACTERS).T @ self._in_units()[: len(_CHARACTERS)]

    @property
    def outside(self) -> float:
        """What the outermost shell contributes."""
        return float(self._in_units()[-2])

    @property
    def missed(self) -> float:
        """Probability that the outermost shell and the panels' errors stand for."""
        return float(self.errors[-2:, 0].sum())

    @property
    def total(self) -> float:
        """Sum of all errors, to be compared with the tolerance."""
        return float(self._in_units().sum())

    def reference(self, quantiles: _Quantiles) -> Reference:
        """The result."""
        lattice = self.lattice
        volume = np.log(lattice.step).sum() + np.log(np.diagonal(lattice.basis)).sum()
        error = self.errors.sum(axis=0)
        n = len(QUANTITIES)
        shift = np.zeros(n)
        shift[0] = lattice.inner.density.sbar
        sizes = (error[0], error[1 : n + 1] * self.sds, error[n + 1 :] * self.sds)
        values = (float(self.log_total + volume), float(sizes[0]), self.means + shift, sizes[1], self.sds, sizes[2])
        return Reference(*values, quantiles.values + shift[:, None], quantiles.errors, lattice.inner.evaluations)


# --- Quantiles ----------------------------------------------------------------------------------------------------------------


class _Cumulative(Protocol):
    """P(u < threshold) under signed weights of the lattice points."""

    #: Error along the direction of u itself, as a probability; that direction, or None; the characters that add to it.
    own_error: float
    direction: int | None
    others: tuple[tuple[int, ...], ...]

    def __call__(self, threshold: float, weight: FloatArray, /) -> float:
        """Weighted probability."""


class _AlongLattice:
    """Cumulative probability of a quantity u that grows by one unit with the coordinate of one lattice direction."""

    def __init__(self, audit: _Audit, direction: int, u: FloatArray) -> None:
        index = audit.lattice.index.copy()
        index[:, direction + 1 :] = 0  # what is behind is summed over
        _, first, self._row = np.unique(_keys(index), return_index=True, return_inverse=True)
        self._u = u[first]
        self._unit = audit.lattice.step[direction] * audit.lattice.basis[direction, direction]
        alternating = audit.weight * (1.0 - 2.0 * (index[:, direction] % 2))
        index[:, direction] = 0
        line = np.unique(_keys(index), return_inverse=True)[1]
        self.own_error = float(np.abs(np.bincount(line, alternating)).sum())
        self.direction: int | None = direction
        self.others = tuple(e for e in _CHARACTERS if not e[direction])

    def __call__(self, threshold: float, weight: FloatArray, /) -> float:
        """Sum of weights times S((threshold - u) / unit), S(x) = 1/2 + Si(pi x)/pi."""
        steps = (threshold - self._u) / self._unit
        return float(np.bincount(self._row, weight) @ (0.5 + sici(np.pi * steps)[0] / np.pi))


class _AlongPanels:
    """Cumulative probability of mu1 - sbar = c / p from the panels' polynomials."""

    own_error = 0.0
    direction: int | None = None
    others = _CHARACTERS

    def __init__(self, audit: _Audit) -> None:
        panels = _joined(audit.lattice.panels)
        self._panels = panels.some(audit.weight[panels.node] > 1e-13)
        inverse_pull = reach(np.column_stack([np.ones(len(audit.outer)), audit.outer]))
        self._inverse_pull = inverse_pull[self._panels.node]
        self._mass = 0.5 * self._panels.width * (self._panels.values @ _WEIGHTS)

    def __call__(self, threshold: float, weight: FloatArray, /) -> float:
        """Whole panels below the threshold, and the part of those that contain it."""
        panels = self._panels
        place = 2.0 * (threshold / self._inverse_pull - panels.low) / panels.width - 1.0
        share = np.where(place >= 1.0, self._mass, 0.0)
        cut = np.flatnonzero(np.abs(place) < 1.0)
        primitive = chebyshev.chebint(panels.values[cut] @ _COEFFICIENTS.T, lbnd=-1, axis=1)
        share[cut] = 0.5 * panels.width[cut] * chebyshev.chebval(place[cut], primitive.T, tensor=False)
        return float(weight[panels.node] @ share)


class _Quantiles(NamedTuple):
    """Quantiles of mu1 - sbar, sigma_p, sigma_l, q0, gain and their errors, (5, 3); error along each direction in sds, (3,)."""

    values: FloatArray
    errors: FloatArray
    worst: FloatArray


def _quantiles(audit: _Audit) -> _Quantiles:
    """Quantiles of every quantity at every level."""
    rows = [[_quantile(audit, *each, level) for level in LEVELS] for each in _scales(audit)]
    values, errors, worst = (np.array([[cell[i] for cell in row] for row in rows]) for i in range(3))
    return _Quantiles(values, errors, np.asarray((worst / audit.sds[:, None, None]).max(axis=(0, 1))))


def _scales(audit: _Audit) -> Iterator[tuple[_Cumulative, FloatArray, Callable[[float], float]]]:
    """For each quantity: the cumulative of a monotone function u of it, u at the lattice points, and the way back."""
    x = np.column_stack([audit.lattice.columns[2], audit.outer])
    theta = audit.lattice.inner.density.natural(x)
    yield _AlongPanels(audit), reach(x), float
    for sigma in (theta.sigma_p, theta.sigma_l):
        yield _AlongLattice(audit, 1, np.log(sigma)), np.log(sigma), lambda u: float(np.exp(u))
    yield _AlongLattice(audit, 2, x[:, 3]), x[:, 3], lambda u: float(expit(u))
    yield _AlongLattice(audit, 0, x[:, 1]), x[:, 1], lambda u: float(1.0 - MAX_PULL * expit(u))


def _quantile(
    audit: _Audit, cumulative: _Cumulative, u: FloatArray, back: Callable[[float], float], level: float
) -> tuple[float, float, FloatArray]:
    """One quantile, its error, and what each lattice direction adds to that."""
    weight = audit.weight
    middle = float(weight @ u)
    scale = float(np.sqrt(weight @ (u - middle) ** 2)) + 1e-300
    falling = back(middle + scale) < back(middle - scale)  # the gain falls with u: its lowest values are the highest u
    at = _solve(lambda t: cumulative(t, weight), 1.0 - level if falling else level, middle, scale)
    slope = (cumulative(at + 0.03 * scale, weight) - cumulative(at - 0.03 * scale, weight)) / (0.06 * scale)
    others = np.array([abs(cumulative(at, weight * audit.sign(e))) for e in cumulative.others])
    shift = (cumulative.own_error + others.sum() + audit.missed) / slope
    worst = np.array(cumulative.others).T @ others
    if cumulative.direction is not None:
        worst[cumulative.direction] += cumulative.own_error
    error = max(abs(back(at + side * shift) - back(at)) for side in (-1.0, 1.0))
    return back(at), error, worst / slope * (error / shift)


def _solve(cumulative: Callable[[float], float], level: float, middle: float, scale: float) -> float:
    """Where a cumulative probability reaches a level."""
    low, high = middle - scale, middle + scale
    while cumulative(low) > level:
        low -= high - low
    while cumulative(high) < level:
        high += high - low
    return float(brentq(lambda t: cumulative(t) - level, low, high, xtol=1e-7 * scale))
