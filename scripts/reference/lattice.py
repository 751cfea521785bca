"""The sheared lattice over (a, b, l) on which the reference quadrature sums.

Where it starts, and which of its points matter.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize

from bayes_toe.arrays import BoolArray, FloatArray, IntArray
from bayes_toe.errors import NumericalError
from reference.panels import Density, Inner, Panels

MAX_NODES = 600_000
_STEP = 0.8  # first lattice step in units of the local standard deviation
_BATCH = 4096  # lattice points whose inner integrals are done together


@dataclass(eq=False)
class Lattice:
    """Lattice points outer = origin + (step * index) @ basis.T, and the inner integral at each.

    The rows of `columns`: log of the integral and of its error, mean and standard deviation of c,
    guess of the latter for neighbours.
    """

    inner: Inner
    origin: FloatArray
    basis: FloatArray
    step: FloatArray
    index: IntArray = field(default_factory=lambda: np.zeros((0, 3), np.int64))
    columns: FloatArray = field(default_factory=lambda: np.zeros((5, 0)))
    expanded: BoolArray = field(default_factory=lambda: np.zeros(0, bool))
    panels: list[Panels] = field(default_factory=list)

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
            sd = np.maximum(
                lines.sd, 0.3 * scale[some]
            )  # as a guess for the neighbours it may shrink, not collapse
            columns = np.stack([lines.log_mass, lines.log_error, lines.mean, lines.sd, sd])
            self._append(index[some], columns, lines.panels, floor)

    def _append(self, index: IntArray, columns: FloatArray, panels: Panels, floor: float) -> None:
        first = len(self.index)
        best = columns[0]
        kept = best[panels.node] > floor - 30.0
        panels = panels.some(kept)
        values = np.exp(panels.values - best[panels.node, None]).astype(np.float32)
        self.panels.append(Panels(panels.node + first, panels.low, panels.width, values))
        self.index = np.concatenate([self.index, index])
        self.columns = np.concatenate([self.columns, columns], axis=1)
        self.expanded = np.concatenate([self.expanded, np.zeros(len(index), bool)])

    def walk(self, depth: float) -> None:
        """Add neighbours of every point within depth nats of the highest until none is missing."""
        while len(self.index) <= MAX_NODES:
            active = np.flatnonzero(~self.expanded & (self.log_mass > self.log_mass.max() - depth))
            if not len(active):
                return
            self.expanded[active] = True
            moves = np.concatenate([np.eye(3, dtype=np.int64), -np.eye(3, dtype=np.int64)])
            neighbours = (self.index[active, None, :] + moves).reshape(-1, 3)
            found, first = np.unique(keys(neighbours), return_index=True)
            first = first[~np.isin(found, keys(self.index))]
            parent = active[first // len(moves)]
            self.add(neighbours[first], self.columns[2, parent], self.columns[4, parent])

    def halve(self, direction: int) -> None:
        """Halve the step along one direction; what is known stays."""
        self.step[direction] *= 0.5
        self.index[:, direction] *= 2
        self.expanded[:] = False


def keys(index: IntArray) -> IntArray:
    """One integer for each triple of integers below a million."""
    base = np.int64(1 << 20)
    return np.asarray(
        ((index[:, 0] + base) * 2 * base + index[:, 1] + base) * 2 * base + index[:, 2] + base
    )


def start(density: Density, tolerance: float) -> Lattice:
    """A lattice with the shape of the density at its highest maximum, and all maxima."""
    inner = Inner(density, 0.05 * tolerance)
    peaks = _peaks(inner)
    curvature = _curvature(inner, peaks[0])
    spread = 1.0 / np.sqrt(np.abs(curvature[0, 0]) + 1e-300)
    lattice = Lattice(inner, peaks[0, 1:].copy(), _shape(curvature), np.full(3, _STEP))
    steps = np.linalg.solve(lattice.basis, (peaks[:, 1:] - lattice.origin).T).T / lattice.step
    index, which = np.unique(np.rint(steps).astype(np.int64), axis=0, return_inverse=True)
    ends = np.array(
        [(peaks[which == i, 0].min(), peaks[which == i, 0].max()) for i in range(len(index))]
    )
    lattice.add(index, ends.mean(axis=1), spread + 0.5 * np.diff(ends, axis=1)[:, 0])
    return lattice


def _shape(curvature: FloatArray) -> FloatArray:
    """Lower triangular factor of the covariance of (a, b, l), at most 1 in any direction."""
    outer = curvature[1:, 1:] - np.outer(curvature[1:, 0], curvature[0, 1:]) / curvature[0, 0]
    values, vectors = np.linalg.eigh(0.5 * (outer + outer.T))
    return np.asarray(np.linalg.cholesky((vectors / np.maximum(np.abs(values), 1.0)) @ vectors.T))


def _peaks(inner: Inner, points: int = 1 << 14, climbs: int = 24) -> FloatArray:
    """Maxima of the density, best first, (climbs, 4), by simplex climbs from points of a scan."""

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
        if all(
            np.abs(np.arcsinh(scan[i] * [3, 1, 1, 1]) - np.arcsinh(scan[j] * [3, 1, 1, 1])).max()
            > 0.5
            for j in chosen
        ):
            chosen.append(int(i))
    if not chosen:
        raise NumericalError("the density is 0 wherever it was looked at")
    peaks = scan[chosen]
    for _ in range(4):
        options = {"maxfev": 800, "xatol": 1e-9, "fatol": 1e-3}
        peaks = np.stack(
            [minimize(depth, x, method="Nelder-Mead", options=options).x for x in peaks]
        )
    return np.asarray(peaks[np.argsort(-height(peaks), kind="stable")])


def _scan(points: int) -> FloatArray:
    """Points, (points, 4), over all that posteriors can cover; c spans orders of magnitude."""
    root = 1.1673039782614187  # of x^5 = x + 1: the generalised golden ratio of 4 dimensions
    unit = (0.5 + np.arange(1, points + 1)[:, None] * root ** -np.arange(1.0, 5.0)) % 1.0
    side = 2.0 * unit[:, 0] - 1.0
    c = np.sign(side) * np.exp(np.log(1e-3) + np.abs(side) * np.log(50.0 / 1e-3))
    return np.column_stack(
        [c, -10.0 + 16.0 * unit[:, 1], -6.0 + 9.0 * unit[:, 2], -6.0 + 18.0 * unit[:, 3]]
    )


def _curvature(inner: Inner, x: FloatArray) -> FloatArray:
    """Negative Hessian, (4, 4), by steps of 1, or over which the log density drops by 1 nat."""

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
