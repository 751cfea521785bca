"""Types that many modules use, the size of temporary arrays, and rows with equal values."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
IndexArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]
NamedArrays = dict[str, FloatArray]
ArrayPair = tuple[FloatArray, FloatArray]
Rng = np.random.Generator
#: Also the generator that emcee gives to its moves.
AnyRng = Rng | np.random.RandomState
StrPath = str | Path
#: Names, notes or lines, in order.
Texts = tuple[str, ...]
#: Values by name, as a file or a page has them.
Record = dict[str, Any]

#: Values of one temporary array: small enough for a processor's cache, so memory stays flat however
#: many pairs or points there are.
BLOCK = 1 << 16

# The C library of Linux gives memory of more than 128 KiB back to the system as soon as it is free,
# and fetches it anew, page by page, for the next temporary array, until a larger piece was freed
# once. This array is freed at once. It is never written to, so it costs nothing.
np.empty(1 << 21)


def thinned(points: FloatArray, n_points: float) -> FloatArray:
    """At most `n_points` of the points, shape (points, ...): every n-th point from the first on."""
    return points[:: max(1, math.ceil(len(points) / n_points))]


def run_starts(*sorted_keys: npt.NDArray[np.generic]) -> IndexArray:
    """The first row of every run of rows with equal keys, which have the shape (rows,) each.

    Examples
    --------
    >>> run_starts(np.array([1, 1, 1, 2]), np.array([0.0, 0.0, 0.5, 0.5])).tolist()
    [0, 2, 3]
    """
    is_start = np.ones(len(sorted_keys[0]), np.bool_)
    is_start[1:] = np.any([key[1:] != key[:-1] for key in sorted_keys], axis=0)
    return np.flatnonzero(is_start)


def combination_counts(*columns: npt.NDArray[np.generic]) -> IndexArray:
    """How many rows have each combination of values in these columns, shape (rows,) each.

    Examples
    --------
    >>> combination_counts(np.array([1, 2, 1, 1]), np.array([0.5, 0.0, 0.5, 0.0])).tolist()
    [1, 1, 2]
    """
    # (columns, rows), with rows of the same values side by side
    sorted_columns = np.array(columns)[:, np.lexsort(columns)]
    # The rows of a combination end where the next combination starts, or with the last row: its
    # count is the difference of two starts.
    return np.diff(run_starts(*sorted_columns), append=len(columns[0]))
