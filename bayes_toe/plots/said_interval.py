"""Numbers as the words of a figure have them: with the digits that the width of their interval asks for."""

from __future__ import annotations

import numpy as np

from bayes_toe.arrays import FloatArray


def said_interval(quantiles: FloatArray) -> str:
    """Quantiles 5, 50, 95 % as words have them: with the digits that the width of the interval asks for.

    Examples
    --------
    >>> said_interval(np.array([-0.0312, 0.0154, 0.41])), said_interval(np.array([0.8891, 0.91, 0.93]))
    ('0.02 (−0.03, 0.41)', '0.910 (0.889, 0.930)')
    """
    low, middle, high = rounded(quantiles[0], quantiles[2], *quantiles.tolist())
    return f"{middle} ({low}, {high})"


def rounded(low: float, high: float, *values: float) -> list[str]:
    """Numbers with two digits of the distance between two others."""
    digits = max(0, 1 - int(np.floor(np.log10(high - low)))) if high > low else 3
    return [f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−") for value in values]  # never -0.0
