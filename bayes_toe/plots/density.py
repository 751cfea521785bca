"""Where draws of two quantities are dense, and above which density stated shares of them lie.

A level is a quantile of the density at the draws themselves. The share of the smoothed density that lies above a level, which the corner
package takes, is another: smoothing spreads a narrow peak, such as that of mu_1 and sigma_p amid their long tails, and an area that holds
half of what was smoothed held up to 70 % of the draws.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.plots.corner_content import BINS, LEVELS

if TYPE_CHECKING:
    from matplotlib.path import Path

#: Bins beyond either end of a span, where contours close.
AROUND = 2
_CENTRES = (np.arange(-AROUND, BINS + AROUND) + 0.5) / BINS  # of bins, those beyond included, in parts of the span
_OUTSIDE = -1.0  # less than any density


class Density(NamedTuple):
    """Smoothed counts of draws in the bins of a panel, two more bins on every side, and the levels of its contours.

    Attributes
    ----------
    values : array, shape (BINS + 4 up, BINS + 4 across)
        The outermost bins have the least of all values, the next ones those of their neighbours within.
    levels : tuple of float
        Densities above which the shares :data:`~bayes_toe.plots.corner_content.LEVELS` of all draws lie, linear between middles of bins.
    """

    values: FloatArray
    levels: tuple[float, ...]

    @classmethod
    def of(cls, x: FloatArray, y: FloatArray, across: tuple[float, float], up: tuple[float, float]) -> Density:
        """Of draws, shape (draws,) each, in a panel that reaches so far."""
        from scipy.ndimage import gaussian_filter, map_coordinates

        counts = np.histogram2d(y, x, [np.linspace(*up, BINS + 1), np.linspace(*across, BINS + 1)])[0]
        smooth = gaussian_filter(counts, 1.0)
        values = np.pad(np.pad(smooth, 1, mode="edge"), 1, constant_values=smooth.min())
        places = [(draws - low) / (high - low) * BINS + AROUND - 0.5 for draws, (low, high) in ((y, up), (x, across))]
        at_draws = map_coordinates(values, places, order=1, mode="constant", cval=_OUTSIDE)
        return cls(values, tuple(np.quantile(at_draws, 1.0 - np.array(LEVELS)).tolist()))

    def areas(self, across: tuple[float, float], up: tuple[float, float]) -> list[Path]:
        """Where the density is above its levels, the largest area first, in a panel that reaches so far."""
        from contourpy import FillType, contour_generator
        from matplotlib.path import Path

        x, y = (low + (high - low) * _CENTRES for low, high in (across, up))
        contours: Any = contour_generator(x, y, self.values, fill_type=FillType.OuterCode)
        found = (contours.filled(level, 2.0 * self.values.max()) for level in reversed(self.levels))
        nothing = Path(np.empty((0, 2)))  # where all draws are one point, no density is above that point's
        return [Path(np.concatenate(points), np.concatenate(codes)) if points else nothing for points, codes in found]
