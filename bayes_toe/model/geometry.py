"""The plane of stimulus pairs (s1, s2) as one observer sees it: its symmetry axis, classes of equal probability, and symmetric coordinates.

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
from bayes_toe.model.closed_form import equal_probability, evolved_mean, gain, pull, variance_ratio, width
from bayes_toe.model.coordinates import Natural

_BLOCK = 1 << 18  # values of one temporary array


class Pair(NamedTuple):
    """First and second stimulus, or the two coordinates that stand for them; natural-log units."""

    first: FloatArray
    second: FloatArray


# --- The axis ---------------------------------------------------------------------------------------


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


@dataclass(frozen=True, eq=False)
class AxisBand:
    """Posterior of the symmetry axis: quantiles at `levels` of slope and intercept, and of the line itself.

    Attributes
    ----------
    levels : tuple of float
    slope, intercept : array, shape (levels,)
    s1 : array, shape (points,)
    s2 : array, shape (levels, points)
        Pointwise quantiles of the axis over s1, natural-log intensity; not themselves straight lines.
    """

    levels: tuple[float, ...]
    slope: FloatArray
    intercept: FloatArray
    s1: FloatArray
    s2: FloatArray


def axis_band(theta: Natural, s1: npt.ArrayLike, levels: tuple[float, ...] = (0.05, 0.5, 0.95)) -> AxisBand:
    """Bands of the axis from posterior draws of any shape, over first stimuli s1 (points,).

    Examples
    --------
    >>> theta = Natural(*map(np.asarray, ([0.0, 1.0, 2.0], [1.0, 1.0, 1.0], [2**0.5] * 3, [0.9] * 3)))
    >>> axis_band(theta, [0.0, 1.0], levels=(0.5,)).s2.round(12).tolist()
    [[0.5, 1.0]]
    """
    line, at = axis(np.ravel(theta.mu1), np.ravel(theta.gamma)), np.atleast_1d(np.asarray(s1, np.float64))
    over = [np.quantile(evolved_mean(s, theta.mu1, theta.gamma), levels) for s in at]  # one at a time: memory stays that of the draws
    return AxisBand(levels, np.quantile(line.slope, levels), np.quantile(line.intercept, levels), at, np.stack(over, axis=-1))


# --- Equivalence classes ----------------------------------------------------------------------------


def displacement(s1: npt.ArrayLike, s2: npt.ArrayLike, mu1: npt.ArrayLike, gamma: npt.ArrayLike) -> FloatArray:
    """Signed label of a pair's class, d = s2 - mu_2(s1), natural-log units; q depends on its magnitude. Source: Results, New symmetries.

    Examples
    --------
    >>> float(displacement(0.0, 1.0, mu1=0.0, gamma=2.0))
    1.0
    """
    first = np.asarray(s1, np.float64)
    return np.asarray((np.asarray(s2, np.float64) - first) - pull(gamma) * (np.asarray(mu1, np.float64) - first))


def equivalent(s1: npt.ArrayLike, s2: npt.ArrayLike, step: npt.ArrayLike, gamma: npt.ArrayLike) -> Pair:
    """The pair with first stimulus s1 + step on the same line parallel to the axis, (s1 + step, s2 + K step): q and d are unchanged.

    Examples
    --------
    >>> [float(v) for v in equivalent(0.0, 1.0, step=1.0, gamma=2.0)]
    [1.0, 1.5]
    """
    move = np.asarray(step, np.float64)
    return Pair(np.asarray(np.asarray(s1, np.float64) + move), np.asarray(np.asarray(s2, np.float64) + gain(gamma) * move))


def class_line(s1: npt.ArrayLike, label: npt.ArrayLike, mu1: npt.ArrayLike, gamma: npt.ArrayLike) -> FloatArray:
    """Second stimulus on the line of the class with label d, s2 = mu_2(s1) + d; d and -d have the same q.

    Examples
    --------
    >>> float(class_line(0.0, 1.0, mu1=1.0, gamma=2.0))
    1.5
    """
    return np.asarray(evolved_mean(s1, mu1, gamma) + np.asarray(label, np.float64))


def inverted(s1: npt.ArrayLike, s2: npt.ArrayLike, mu1: npt.ArrayLike, gamma: npt.ArrayLike) -> Pair:
    """The pair presented in the inverse order, s2 first, its other stimulus adjusted so that q is unchanged: (s2, mu_2(s2) - d).

    As gamma -> 0 the adjustment vanishes and the pair is (s2, s1). Source: Results, New symmetries: 'invert the order while
    simultaneously adjusting the intensity of one (or both) stimuli'.

    Examples
    --------
    >>> [float(v) for v in inverted(0.0, 1.0, mu1=0.0, gamma=0.0)]
    [1.0, 0.0]
    """
    first = np.asarray(s2, np.float64)
    second = first - displacement(s1, s2, mu1, gamma) + pull(gamma) * (np.asarray(mu1, np.float64) - first)
    return Pair(np.asarray(np.broadcast_arrays(first, second)[0]), np.asarray(second))


# --- Symmetric coordinates --------------------------------------------------------------------------


def rotation_angle(gamma: npt.ArrayLike) -> FloatArray:
    """Angle that turns the axis to the diagonal, pi/4 - arctan K = arctan(p/(2 - p)), radians; accurate down to the smallest gamma.

    Source: Discussion, 'rigid transformation'.

    Examples
    --------
    >>> float(rotation_angle(0.0))
    0.0
    """
    return np.asarray(np.arctan(_tangent(gamma)))


def to_symmetric(s1: npt.ArrayLike, s2: npt.ArrayLike, mu1: npt.ArrayLike, gamma: npt.ArrayLike) -> Pair:
    """Pair of stimuli in symmetric coordinates, where q(a, b) = q(b, a) and q(a + t, b + t) = q(a, b): a rotation about (mu_1, mu_1).

    Natural-log units; distances are those between stimuli. As gamma -> 0 the coordinates are the stimuli. Source: Discussion.

    Examples
    --------
    >>> a, b = to_symmetric(1.0, 0.5, mu1=0.0, gamma=2.0)  # a point of the axis s2 = s1/2
    >>> round(float(a - b), 12)
    0.0
    """
    return _rotate(s1, s2, mu1, _tangent(gamma))


def from_symmetric(a: npt.ArrayLike, b: npt.ArrayLike, mu1: npt.ArrayLike, gamma: npt.ArrayLike) -> Pair:
    """Stimuli of a pair of symmetric coordinates, the inverse of :func:`to_symmetric`.

    Examples
    --------
    >>> [round(float(v), 12) for v in from_symmetric(*to_symmetric(1.0, 0.2, 0.3, 0.5), 0.3, 0.5)]
    [1.0, 0.2]
    """
    return _rotate(a, b, mu1, -_tangent(gamma))


def reflection(s1: npt.ArrayLike, s2: npt.ArrayLike, mu1: npt.ArrayLike, gamma: npt.ArrayLike) -> Pair:
    """Mirror image of a pair in the axis: swapping the symmetric coordinates, (a, b) -> (b, a). q is unchanged, d changes its sign.

    Examples
    --------
    >>> [round(float(v), 12) for v in reflection(0.0, 1.0, mu1=0.0, gamma=0.0)]
    [1.0, 0.0]
    """
    a, b = to_symmetric(s1, s2, mu1, gamma)
    return from_symmetric(b, a, mu1, gamma)


def symmetric_width(sigma_p: npt.ArrayLike, gamma: npt.ArrayLike) -> FloatArray:
    """Width in symmetric coordinates, q = q0 2^(-((b - a)/width)^2): w sqrt(2/(1 + K^2)), natural-log intensity.

    Examples
    --------
    >>> float(symmetric_width(0.5, 0.0))
    0.5
    """
    return np.asarray(width(sigma_p, gamma) * np.sqrt(2.0 / (1.0 + np.square(gain(gamma)))))


def _tangent(gamma: npt.ArrayLike) -> FloatArray:
    """Tangent of the rotation angle: (1 - K)/(1 + K) = p/(2 - p)."""
    p = pull(gamma)
    return np.asarray(p / (2.0 - p))


def _rotate(first: npt.ArrayLike, second: npt.ArrayLike, centre: npt.ArrayLike, tangent: FloatArray) -> Pair:
    """Rotation about (centre, centre); written as a change of the coordinates, so that a small angle far away costs no digits."""
    x, y, c = (np.asarray(values, np.float64) for values in (first, second, centre))
    length = np.hypot(1.0, tangent)
    sine, versine = tangent / length, np.square(tangent) / (length * (1.0 + length))  # versine is 1 - cosine
    dx, dy = x - c, y - c
    return Pair(np.asarray(x - versine * dx - sine * dy), np.asarray(y - versine * dy + sine * dx))


# --- The plane --------------------------------------------------------------------------------------


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
