"""The plane of stimulus pairs (s1, s2) as one observer sees it: its symmetry axis, and the classes of pairs with equal probability.

q depends on a pair through the displacement d = s2 - mu_2(s1) alone, and on its size only. The line d = 0 is the symmetry axis; it passes
through (mu_1, mu_1) with slope K. Erratum: Eq. axis0 must read (1 - sigma_p^2/sigma^2) [...]; Eq. axis2 is right and is what is used.

All intensities are natural logs. Parameters broadcast against the stimuli, so arrays of draws go in as they are. Over the whole plane two
observers give the same q only if K, p mu_1, w and q0 agree: classes of parameters with the same answers exist on single pairs, not on
designs with two or more first stimuli, though they come close as gamma -> 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray
from bayes_toe.model.closed_form import gain, pull, variance_ratio


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


def displacement(
    s1: npt.ArrayLike, s2: npt.ArrayLike, mu1: npt.ArrayLike, gamma: npt.ArrayLike
) -> FloatArray:
    """Signed label of a pair's class, d = s2 - mu_2(s1), natural-log units; q depends on its magnitude. Source: Results, New symmetries.

    Examples
    --------
    >>> float(displacement(0.0, 1.0, mu1=0.0, gamma=2.0))
    1.0
    """
    first = np.asarray(s1, np.float64)
    return np.asarray(
        (np.asarray(s2, np.float64) - first) - pull(gamma) * (np.asarray(mu1, np.float64) - first)
    )
