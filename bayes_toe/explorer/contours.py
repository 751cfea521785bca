"""Contours that hold shares of the draws in the plane of two quantities, small enough for a file of hundreds of subjects."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.explorer.packing import FRAME, shorts
from bayes_toe.plots.corner import AROUND, BINS, Density, Span


def contours(samples: FloatArray, spans: list[Span]) -> list[str]:
    """Of every two quantities in base64: line after line, each its level's place, its length, x, y.

    Parameters
    ----------
    samples : array, shape (draws, quantities)
    spans : list of (float, float)
        From where to where the density is counted.
    """
    bins = [_places(values, span) for values, span in zip(samples.T, spans, strict=True)]
    return [_packed(bins[j], bins[i]) for j, i in pairs(len(spans))]


def frame(span: Span) -> Span:
    """Between the middles of the outermost bins: in so many parts of this frame the coordinates of contours are counted."""
    beyond = (AROUND - 0.5) / BINS * (span[1] - span[0])
    return span[0] - beyond, span[1] + beyond


def pairs(count: int) -> list[tuple[int, int]]:
    """Columns and rows of the panels below the diagonal, in the order of :func:`contours`.

    Examples
    --------
    >>> pairs(3)
    [(0, 1), (0, 2), (1, 2)]
    """
    return list(combinations(range(count), 2))


def _places(values: FloatArray, span: Span) -> FloatArray:
    """In bins from the lower end of the span."""
    return np.asarray((values - span[0]) / (span[1] - span[0]) * BINS)


def _packed(x: FloatArray, y: FloatArray) -> str:
    from contourpy import LineType, contour_generator

    density = Density.of(x, y, (0.0, BINS), (0.0, BINS))
    found = contour_generator(z=density.values, line_type=LineType.Separate)
    parts = []
    for place, level in enumerate(density.levels):
        for line in found.lines(level):
            at = np.rint(np.asarray(line) / (BINS + 2 * AROUND - 1) * FRAME).astype(np.int64)
            parts.append(np.concatenate([[place, len(at)], at.ravel()]))
    return shorts(np.concatenate(parts) if parts else [])
