"""Where a cloud of points in a plane is densest: the ellipse that holds a stated share of them, as in Fig. 4.

The covariance of all points would not do: where gamma may vanish, mu_1 has tails as wide as its prior, and the ellipse of a normal
distribution with that covariance holds far more or far less than it says, and not around the peak.
"""

from __future__ import annotations

from numbers import Real
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray
from bayes_toe.errors import InputError, require_kind

#: Share of the points in an ellipse of the paper's map.
MASS = 0.2
_STEPS = 200
#: Share of the points that decides centre and shape: small enough to stay around the peak of a skewed cloud, large enough to be steady.
_CORE = 0.35
#: Fewer points than this inside say nothing of a shape.
_FEWEST = 5


class Ellipse(NamedTuple):
    """Centre (2,), half axes (2,) and the angle of the first one from the horizontal, radians; in the units of the points."""

    centre: FloatArray
    half_axes: FloatArray
    angle: float

    def outline(self, points: int = 100) -> FloatArray:
        """Closed curve, shape (points, 2)."""
        t = np.linspace(0.0, 2.0 * np.pi, points)
        turn = np.array(
            [[np.cos(self.angle), -np.sin(self.angle)], [np.sin(self.angle), np.cos(self.angle)]]
        )
        return np.asarray(
            self.centre + (np.stack([np.cos(t), np.sin(t)], axis=-1) * self.half_axes) @ turn.T
        )


def mass_ellipse(x: npt.ArrayLike, y: npt.ArrayLike, mass: float = MASS) -> Ellipse | None:
    """A tight ellipse around the peak that holds `mass` of the points: in Fig. 4, draws or bootstrap replicates of (mu_1, sigma_p).

    Centre and shape are those of the densest 35 % (or `mass`, if more): starting with the points nearest the medians, repeatedly mean and
    covariance of the points inside, then as many points nearest by that covariance; its determinant falls with every step. For a normal
    cloud this is the level curve that the paper draws. Source: caption of Fig. 4.

    Coordinates have the shape (points,); infinite and missing ones count as points outside. None where too few are finite, or all inside
    lie on one line.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> found = mass_ellipse(rng.normal(3.0, 9.0, 40_000), rng.normal(0.0, 1.0, 40_000), mass=0.2)
    >>> round(float(found.half_axes[0]))  # sqrt(-2 ln 0.8) = 0.67 standard deviations
    6
    """
    every = np.stack(
        [np.ravel(np.asarray(x, np.float64)), np.ravel(np.asarray(y, np.float64))], axis=-1
    )
    require_share("mass", mass)
    inside, points = int(np.ceil(mass * len(every))), every[np.isfinite(every).all(axis=1)]
    if inside < _FEWEST or len(points) < inside:
        return None
    middle, spread = (
        np.median(points, axis=0),
        np.diff(np.quantile(points, [0.25, 0.75], axis=0), axis=0)[0],
    )
    if not np.all(spread > 0):
        return None
    scaled = (
        points - middle
    ) / spread  # both coordinates of one size: the determinants below keep their digits
    core = min(len(points), max(inside, int(_CORE * len(points)), _FEWEST))
    distance, nearest = np.square(scaled).sum(axis=1), np.empty(0, np.intp)
    for _ in range(_STEPS):
        again = np.sort(np.argpartition(distance, core - 1)[:core])
        if np.array_equal(again, nearest):
            break
        nearest = again
        centre, shape = scaled[nearest].mean(axis=0), np.cov(scaled[nearest].T)
        if np.linalg.det(shape) <= 1e-12 * np.prod(np.diag(shape)):
            return None
        away = scaled - centre
        distance = np.einsum("ij,ij->i", away @ np.linalg.inv(shape), away)
    scale, radius = np.diag(spread), np.partition(distance, inside - 1)[inside - 1]
    variances, axes = np.linalg.eigh(scale @ shape @ scale * radius)
    return Ellipse(
        middle + spread * centre,
        np.sqrt(variances[::-1]),
        float(np.arctan2(axes[1, 1], axes[0, 1])),
    )


def require_share(name: str, given: float) -> None:
    """Raise InputError, with the name of what was given, unless it lies between 0 and 1."""
    require_kind(name, given, Real, "a number between 0 and 1")
    if not 0.0 < given < 1.0:
        raise InputError(f"{name}={given:g} must lie between 0 and 1")
