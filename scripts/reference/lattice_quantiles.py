"""Quantiles from the lattice and the panels of the reference quadrature, with their errors."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from scipy.optimize import brentq
from scipy.special import expit, sici

from bayes_toe.arrays import FloatArray
from bayes_toe.model.paper_equations import MAX_PULL
from reference.lattice import keys
from reference.lattice_sums import CHARACTERS, Audit, reach
from reference.panels import COEFFICIENTS, WEIGHTS, joined

LEVELS = (0.05, 0.5, 0.95)


class _AlongLattice:
    """P(u < threshold) by signed weights; u rises by one unit along one lattice direction.

    `own_error` is the error along that direction, as a probability; `others` are the characters
    that add to it.
    """

    def __init__(self, audit: Audit, direction: int, u: FloatArray) -> None:
        index = audit.lattice.index.copy()
        index[:, direction + 1 :] = 0  # what is behind is summed over
        _, first, self._row = np.unique(keys(index), return_index=True, return_inverse=True)
        self._u = u[first]
        self._unit = audit.lattice.step[direction] * audit.lattice.basis[direction, direction]
        alternating = audit.weight * (1.0 - 2.0 * (index[:, direction] % 2))
        index[:, direction] = 0
        line = np.unique(keys(index), return_inverse=True)[1]
        self.own_error = float(np.abs(np.bincount(line, alternating)).sum())
        self.direction: int | None = direction
        self.others = tuple(e for e in CHARACTERS if not e[direction])

    def __call__(self, threshold: float, weight: FloatArray, /) -> float:
        """Sum of weights times S((threshold - u) / unit), S(x) = 1/2 + Si(pi x)/pi."""
        steps = (threshold - self._u) / self._unit
        return float(np.bincount(self._row, weight) @ (0.5 + sici(np.pi * steps)[0] / np.pi))


class _AlongPanels:
    """The same of mu1 - sbar = c / p, from the panels' polynomials."""

    own_error = 0.0
    direction: int | None = None
    others = CHARACTERS

    def __init__(self, audit: Audit) -> None:
        panels = joined(audit.lattice.panels)
        self._panels = panels.some(audit.weight[panels.node] > 1e-13)
        inverse_pull = reach(np.column_stack([np.ones(len(audit.outer)), audit.outer]))
        self._inverse_pull = inverse_pull[self._panels.node]
        self._mass = 0.5 * self._panels.width * (self._panels.values @ WEIGHTS)

    def __call__(self, threshold: float, weight: FloatArray, /) -> float:
        """Whole panels below the threshold, and the part of those that contain it."""
        panels = self._panels
        place = 2.0 * (threshold / self._inverse_pull - panels.low) / panels.width - 1.0
        share = np.where(place >= 1.0, self._mass, 0.0)
        cut = np.flatnonzero(np.abs(place) < 1.0)
        primitive = chebyshev.chebint(panels.values[cut] @ COEFFICIENTS.T, lbnd=-1, axis=1)
        share[cut] = (
            0.5 * panels.width[cut] * chebyshev.chebval(place[cut], primitive.T, tensor=False)
        )
        return float(weight[panels.node] @ share)


_Cumulative = _AlongLattice | _AlongPanels


class Quantiles(NamedTuple):
    """Quantiles of mu1 - sbar, sigma_p, sigma_l, q0, gain and their errors, (5, 3).

    Error along each direction in sds, (3,).
    """

    values: FloatArray
    errors: FloatArray
    worst: FloatArray


def find_quantiles(audit: Audit) -> Quantiles:
    """Quantiles of every quantity at every level."""
    rows = [[_quantile(audit, *each, level) for level in LEVELS] for each in _scales(audit)]
    values, errors, worst = (
        np.array([[cell[i] for cell in row] for row in rows]) for i in range(3)
    )
    return Quantiles(
        values, errors, np.asarray((worst / audit.sds[:, None, None]).max(axis=(0, 1)))
    )


def _scales(audit: Audit) -> Iterator[tuple[_Cumulative, FloatArray, Callable[[float], float]]]:
    """For each quantity a monotone function u: its cumulative, u at the points, and the inverse."""
    x = np.column_stack([audit.lattice.columns[2], audit.outer])
    theta = audit.lattice.inner.density.natural(x)
    yield _AlongPanels(audit), reach(x), float
    for sigma in (theta.sigma_p, theta.sigma_l):
        yield _AlongLattice(audit, 1, np.log(sigma)), np.log(sigma), lambda u: float(np.exp(u))
    yield _AlongLattice(audit, 2, x[:, 3]), x[:, 3], lambda u: float(expit(u))
    yield _AlongLattice(audit, 0, x[:, 1]), x[:, 1], lambda u: float(1.0 - MAX_PULL * expit(u))


def _quantile(
    audit: Audit,
    cumulative: _Cumulative,
    u: FloatArray,
    back: Callable[[float], float],
    level: float,
) -> tuple[float, float, FloatArray]:
    """One quantile, its error, and what each lattice direction adds to that."""
    weight = audit.weight
    middle = float(weight @ u)
    scale = float(np.sqrt(weight @ (u - middle) ** 2)) + 1e-300
    falling = back(middle + scale) < back(
        middle - scale
    )  # the gain falls with u: its lowest values are the highest u
    at = _solve(lambda t: cumulative(t, weight), 1.0 - level if falling else level, middle, scale)
    slope = (cumulative(at + 0.03 * scale, weight) - cumulative(at - 0.03 * scale, weight)) / (
        0.06 * scale
    )
    others = np.array([abs(cumulative(at, weight * audit.sign(e))) for e in cumulative.others])
    shift = (cumulative.own_error + others.sum() + audit.missed) / slope
    worst = np.array(cumulative.others).T @ others
    if cumulative.direction is not None:
        worst[cumulative.direction] += cumulative.own_error
    error = max(abs(back(at + side * shift) - back(at)) for side in (-1.0, 1.0))
    return back(at), error, worst / slope * (error / shift)


def _solve(
    cumulative: Callable[[float], float], level: float, middle: float, scale: float
) -> float:
    """Where a cumulative probability reaches a level."""
    low, high = middle - scale, middle + scale
    while cumulative(low) > level:
        low -= high - low
    while cumulative(high) < level:
        high += high - low
    return float(brentq(lambda t: cumulative(t) - level, low, high, xtol=1e-7 * scale))
