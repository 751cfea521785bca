"""Integrals over the offset c at many (a, b, l) at once, by adaptive Clenshaw-Curtis panels.

The inner part of the reference quadrature.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.polynomial import chebyshev
from scipy.special import expit

from bayes_toe.arrays import BoolArray, FloatArray, IntArray
from bayes_toe.errors import NumericalError
from bayes_toe.model.paper_equations import MAX_PULL, Natural

_DROP = 18.0  # nats below its own maximum at which an inner integral ends
# nats by which the points fall about a local maximum, above which they may miss its top by 1 nat
_SHARP = 3.0
_ROWS = 1 << 18  # points of one call of the log density
_ORDER = 16
_EDGES = np.array([-7.0, -3.5, 0.0, 3.5, 7.0])


def _clenshaw_curtis(order: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points on [-1, 1], weights, and the matrix from values to Chebyshev coefficients."""
    points: FloatArray = -np.cos(np.pi * np.arange(order + 1) / order)
    to_coefficients = np.linalg.inv(chebyshev.chebvander(points, order))
    j = np.arange(0, order + 1, 2)
    integrals = np.zeros(order + 1)
    integrals[j] = 2.0 / (1.0 - j**2)
    return points, np.asarray(integrals @ to_coefficients), np.asarray(to_coefficients, np.float64)


POINTS, WEIGHTS, COEFFICIENTS = _clenshaw_curtis(_ORDER)
_COARSE_WEIGHTS = _clenshaw_curtis(_ORDER // 2)[1]


class Density(Protocol):
    """What is integrated: a log density of x = (c, a, b, l) and the natural parameters at x.

    As in :mod:`reference.paper_density`, log sigma_p and log sigma_l are linear in b with slope
    1, and mu1 = sbar + c/p. A `subject` is optional; its stimuli show where the likelihood has
    features in c.
    """

    @property
    def sbar(self) -> float:
        """Mean first stimulus, natural-log units."""

    def log_density(self, x: FloatArray, /) -> FloatArray:
        """Log density at x, shape (points, 4) -> (points,)."""

    def natural(self, x: FloatArray, /) -> Natural:
        """Natural parameters at x, shape (points, 4), each of shape (points,)."""


class Panels(NamedTuple):
    """Intervals in c with the log density at their 17 points; `node` is the outer point of each."""

    node: IntArray
    low: FloatArray
    width: FloatArray
    values: FloatArray

    def some(self, which: BoolArray | IntArray) -> Panels:
        """The panels of a mask or of indices."""
        return Panels(self.node[which], self.low[which], self.width[which], self.values[which])


class Lines(NamedTuple):
    """Inner integrals: log of integral and error, mean and SD of c, (nodes,) each."""

    log_mass: FloatArray
    log_error: FloatArray
    mean: FloatArray
    sd: FloatArray
    panels: Panels


@dataclass(eq=False)
class Inner:
    """Integrates the density over c at many (a, b, l) at once."""

    density: Density
    tolerance: float
    evaluations: int = 0

    def __post_init__(self) -> None:
        subject = getattr(self.density, "subject", None)
        steps = np.zeros(0) if subject is None else subject.s2 - subject.s1
        levers = np.zeros(0) if subject is None else subject.s1 - self.density.sbar
        kept = (
            np.unique(np.linspace(0, len(steps) - 1, 16).astype(int))
            if len(steps)
            else np.zeros(0, int)
        )
        order = np.argsort(steps)[kept]
        self._steps, self._levers = steps[order], levers[order]

    def lines(
        self, outer: FloatArray, centre: FloatArray, scale: FloatArray, floor: float
    ) -> Lines:
        """Integrals at outer (nodes, 3); centre and scale are guesses.

        Floor is the log of a mass too small to be exact about.
        """
        panels = self._cut(outer, self._window(outer, centre, scale))
        finished: list[Panels] = []
        for halvings in range(60):
            mass, error, best = _masses(panels, len(outer))
            total = np.bincount(panels.node, mass, len(outer))
            some = (
                best > -np.inf
            )  # a line on which the density is 0 throughout has mass 0, and no error
            with np.errstate(over="ignore"):
                spare = np.exp(
                    np.subtract(floor, best, where=some, out=np.full(len(best), -np.inf))
                )
            allowed = self.tolerance * np.maximum(total, spare)
            bad = (error > allowed[panels.node]) | (
                _unresolved(panels, best) & (halvings < 30)
            )  # an edge is sharp for ever
            open_nodes = np.zeros(len(outer), bool)
            open_nodes[panels.node[bad]] = True
            still = open_nodes[panels.node]
            finished.append(panels.some(~still))
            if not bad.any():
                return _summary(joined(finished), outer, centre, scale)
            panels = joined([panels.some(still & ~bad), self._halves(outer, panels.some(bad))])
        raise NumericalError("the log density has a feature in c too narrow to integrate")

    def _evaluate(
        self, outer: FloatArray, node: IntArray, low: FloatArray, width: FloatArray
    ) -> Panels:
        """Panels with the log density at their points."""
        x = np.empty((len(node), _ORDER + 1, 4))
        x[..., 0] = low[:, None] + 0.5 * (POINTS + 1.0) * width[:, None]
        x[..., 1:] = outer[node, None, :]
        flat = x.reshape(-1, 4)
        parts = [self.density.log_density(flat[i : i + _ROWS]) for i in range(0, len(flat), _ROWS)]
        self.evaluations += len(flat)
        return Panels(
            node, low, width, np.concatenate([np.zeros(0), *parts]).reshape(-1, _ORDER + 1)
        )

    def _window(self, outer: FloatArray, centre: FloatArray, scale: FloatArray) -> Panels:
        """Four panels about the centre, and on each side doubled ones until the density drops."""
        edges = centre[:, None] + scale[:, None] * _EDGES
        node = np.arange(len(outer))
        found = [
            self._evaluate(
                outer, np.repeat(node, 4), edges[:, :-1].ravel(), np.diff(edges, axis=1).ravel()
            )
        ]
        values = found[0].values.reshape(len(outer), -1)
        best = values.max(axis=1)
        for side, edge, goal in zip(
            (-1, 1), (edges[:, 0], edges[:, -1]), self._goals(outer, edges, best), strict=True
        ):
            at, width = edge.copy(), edges[:, -1] - edges[:, 0]
            active = node[_outermost(values, side) > best - _DROP]
            active = np.union1d(active, node[side * goal > side * at])
            while len(active):
                low = at[active] - width[active] * (side < 0)
                found.append(self._evaluate(outer, active, low, width[active]))
                at[active] += side * width[active]
                width[active] *= 2.0
                best[active] = np.maximum(best[active], found[-1].values.max(axis=1))
                more = (_outermost(found[-1].values, side) > best[active] - _DROP) | (
                    side * goal > side * at
                )[active]
                active = active[more]
        return joined(found)

    def _goals(
        self, outer: FloatArray, edges: FloatArray, best: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The least reach of the window, left and right: past every hump that a probe finds.

        The likelihood has its humps in c within a few widths of where distances vanish; 17 points
        there show each as a rise and a fall, however narrow it is. The window's own hump takes part
        as one more point.
        """
        n = len(outer)
        if not len(self._steps):
            return np.full(n, np.inf), np.full(n, -np.inf)
        zeros, margin = self._zeros(outer), 6.0 * np.exp(outer[:, 1])
        low, high = zeros.min(axis=1) - margin, zeros.max(axis=1) + margin
        probe = self._evaluate(outer, np.arange(n), low, high - low)
        c = np.column_stack(
            [
                low[:, None] + 0.5 * (POINTS + 1.0) * (high - low)[:, None],
                0.5 * (edges[:, 0] + edges[:, -1]),
            ]
        )
        order = np.argsort(c, axis=1)
        c = np.take_along_axis(c, order, axis=1)
        values = np.take_along_axis(np.column_stack([probe.values, best]), order, axis=1)
        seen = (c < edges[:, :1]) | (c > edges[:, -1:])
        seen &= np.isfinite(values) & (
            (_sharpness(values) >= 0.0) | (values > best[:, None] - _DROP)
        )
        before, after = np.column_stack([c[:, 0], c[:, :-1]]), np.column_stack([c[:, 1:], c[:, -1]])
        return np.where(seen, before, np.inf).min(axis=1), np.where(seen, after, -np.inf).max(
            axis=1
        )

    def _zeros(self, outer: FloatArray) -> FloatArray:
        """Values of c at which the distance of a pair vanishes, (nodes, pairs)."""
        return np.asarray(self._steps + MAX_PULL * expit(outer[:, 0, None]) * self._levers)

    def _cut(self, outer: FloatArray, panels: Panels) -> Panels:
        """Wide panels are cut where a pair's distance z vanishes.

        There the likelihood has features of width w.
        """
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
        return joined(
            [panels.some(~split), self._evaluate(outer, node[real], low[real], width[real])]
        )

    def _halves(self, outer: FloatArray, panels: Panels) -> Panels:
        half = 0.5 * panels.width
        low = np.concatenate([panels.low, panels.low + half])
        return self._evaluate(outer, np.tile(panels.node, 2), low, np.tile(half, 2))


def _outermost(values: FloatArray, side: int) -> FloatArray:
    """Highest value among the last points on a side, (nodes,).

    Values (nodes, points) are in order of c.
    """
    return np.asarray((values[:, :6] if side < 0 else values[:, -6:]).max(axis=1))


def _sharpness(values: FloatArray) -> FloatArray:
    """Drop on both sides of local maxima within three points, nats; -1 without a maximum.

    Three, because the top may lie half-way between two equal points; ends count as if what is
    beyond were mirrored.
    """
    padded = np.column_stack([values[:, [2, 1]], values, values[:, [-2, -3]]])
    with np.errstate(invalid="ignore"):
        further, left, right, beyond = (
            values - padded[:, i : i + values.shape[1]] for i in (0, 1, 3, 4)
        )
        top = (left >= 0.0) & (right >= 0.0) & (values > -np.inf)
        return np.where(top, np.maximum(np.minimum(left, beyond), np.minimum(further, right)), -1.0)


def _unresolved(panels: Panels, best: FloatArray) -> BoolArray:
    """Panels with a peak that is high, and so sharp that its top may lie between the points."""
    sharp = _sharpness(panels.values)
    return np.asarray(
        ((sharp > _SHARP) & (panels.values + sharp > best[panels.node, None] - _DROP)).any(axis=1)
    )


def joined(panels: list[Panels]) -> Panels:
    """Several sets of panels as one."""
    return Panels(*(np.concatenate(columns) for columns in zip(*panels, strict=True)))


def _masses(panels: Panels, nodes: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Integral and error of panels in units of exp(best of the node), and the best."""
    best = np.full(nodes, -np.inf)
    np.maximum.at(best, panels.node, panels.values.max(axis=1))
    if np.isnan(best).any():
        raise NumericalError("the log density is NaN")
    value = _relative(panels, best)
    mass = 0.5 * panels.width * (value @ WEIGHTS)
    return mass, np.abs(mass - 0.5 * panels.width * (value[:, ::2] @ _COARSE_WEIGHTS)), best


def _relative(panels: Panels, best: FloatArray) -> FloatArray:
    """Density in units of its maximum along the line; 0 where the whole line is 0."""
    return np.asarray(
        np.exp(panels.values - np.where(np.isfinite(best), best, 0.0)[panels.node, None])
    )


def _summary(panels: Panels, outer: FloatArray, centre: FloatArray, scale: FloatArray) -> Lines:
    """Mass, error, mean and standard deviation of every line."""
    n = len(outer)
    mass, error, best = _masses(panels, n)
    weight = 0.5 * panels.width[:, None] * _relative(panels, best) * WEIGHTS
    offset = (panels.low - centre[panels.node])[:, None] + 0.5 * (POINTS + 1.0) * panels.width[
        :, None
    ]
    total = np.bincount(panels.node, mass, n)
    safe = np.where(total > 0, total, 1.0)
    shift = np.bincount(panels.node, (weight * offset).sum(axis=1), n) / safe
    square = (
        np.bincount(panels.node, (weight * (offset - shift[panels.node, None]) ** 2).sum(axis=1), n)
        / safe
    )
    sd = np.where(total > 0, np.sqrt(square), scale)
    with np.errstate(divide="ignore"):
        log_mass, log_error = (
            np.log(total) + best,
            np.log(np.bincount(panels.node, error, n)) + best,
        )
    return Lines(
        log_mass, log_error, centre + shift, sd, panels.some(mass > 1e-10 * total[panels.node])
    )
