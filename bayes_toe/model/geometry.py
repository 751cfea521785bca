"""The plane of stimulus pairs (s1, s2) as one observer sees it: its symmetry axis, and the classes of pairs with equal probability.

q depends on a pair through the displacement d = s2 - mu_2(s1) alone, and on its size only. The line d = 0 is the symmetry axis; it passes
through (mu_1, mu_1) with slope K. Erratum: Eq. axis0 must read (1 - sigma_p^2/sigma^2) [...]; Eq. axis2 is right and is what is used.

All intensities are natural logs. Parameters broadcast against the stimuli, so arrays of draws go in as they are. Over the whole plane two
observers give the same q only if K, p mu_1, w and q0 agree: classes of parameters with the same answers exist on single pairs, not on
designs with two or more first stimuli, though they come close as gamma -> 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray
from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import equal_probability, gain, pull, variance_ratio
from bayes_toe.model.coordinates import Natural

_BLOCK = 1 << 18  # values of one temporary array


class Axis(NamedTuple):
    """The symmetry axis s2 = slope s1 + intercept; slope without unit, intercept in natural-log intensity."""

    slope: FloatArray
    intercept: FloatArray


def axis(mu1: npt.ArrayLike, gamma: npt.ArrayLike) -> Axis:
    """Symmetry axis s2 = K s1 + p mu_1: slope K = (G - 1)/gamma = 1/G, intercept prefactor p = (G - 1)/G = gamma/G^2.

    Both in the form in which nothing cancels, down to the smallest gamma. Source: Eq. axis2.

    Examples
    --------
    >>> [float(v) for v in axis(mu1=3.0, gamma=2.0)]
    [0.5, 1.5]
    """
    slope, intercept = np.broadcast_arrays(gain(gamma), pull(gamma) * np.asarray(mu1, np.float64))
    return Axis(np.asarray(slope), np.asarray(intercept))


class AxisProperties(NamedTuple):
    """The three panels of Fig. 6 as functions of gamma; no units."""

    gamma: FloatArray
    prior_uncertainty: FloatArray
    slope: FloatArray
    prefactor: FloatArray


def axis_properties(gamma: npt.ArrayLike) -> AxisProperties:
    """Prior variance sigma_1^2/sigma_p^2 = G, slope K and intercept prefactor p of the axis. Source: Fig. 6, Eqs. axis1 and axis2.

    Examples
    --------
    >>> [float(v) for v in axis_properties(2.0)]
    [2.0, 2.0, 0.5, 0.5]
    """
    ratio = np.asarray(gamma, np.float64)
    return AxisProperties(ratio, variance_ratio(ratio), gain(ratio), pull(ratio))


def displacement(s1: npt.ArrayLike, s2: npt.ArrayLike, mu1: npt.ArrayLike, gamma: npt.ArrayLike) -> FloatArray:
    """Signed label of a pair's class, d = s2 - mu_2(s1), natural-log units; q depends on its magnitude. Source: Results, New symmetries.

    Examples
    --------
    >>> float(displacement(0.0, 1.0, mu1=0.0, gamma=2.0))
    1.0
    """
    first = np.asarray(s1, np.float64)
    return np.asarray((np.asarray(s2, np.float64) - first) - pull(gamma) * (np.asarray(mu1, np.float64) - first))


@dataclass(frozen=True, eq=False)
class Plane:
    """P(equal) on a grid of pairs. Source: Fig. 5.

    Attributes
    ----------
    s1, s2 : array, shapes (columns,) and (rows,)
        Natural-log intensities of the first stimulus (to the right) and the second (upward).
    q : array, shape (rows, columns)
        P(equal); for draws, its posterior mean.
    """

    s1: FloatArray
    s2: FloatArray
    q: FloatArray


def plane(s1: npt.ArrayLike, s2: npt.ArrayLike, theta: Natural) -> Plane:
    """P(equal) of every pair of first stimuli s1 (columns,) and second stimuli s2 (rows,), averaged over theta of any shape.

    Raises
    ------
    InputError
        If a side of the grid is empty or not one-dimensional.
    NumericalError
        If a parameter is outside its range.

    Examples
    --------
    >>> theta = Natural(*map(np.asarray, (0.0, 0.3, 0.2, 0.9)))
    >>> plane([0.0, 0.1, 0.2], [0.0, 0.1], theta).q.shape
    (2, 3)
    """
    columns, rows = np.asarray(s1, np.float64), np.asarray(s2, np.float64)
    if columns.ndim != 1 or rows.ndim != 1 or not columns.size or not rows.size:
        raise InputError("a grid needs one-dimensional, non-empty s1 and s2")
    draws = [np.ravel(v)[:, None, None] for v in np.broadcast_arrays(*theta)]
    total, count = np.zeros((len(rows), len(columns))), len(draws[0])
    step = max(1, _BLOCK // total.size)
    for i in range(0, count, step):
        total += equal_probability(columns, rows[:, None], *(v[i : i + step] for v in draws)).sum(axis=0)
    return Plane(columns, rows, total / count)
