"""Array types that everyone uses, and the size of temporary arrays."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
IndexArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]

#: Values of one temporary array: small enough for a processor's cache, so memory stays flat however many pairs or points there are.
BLOCK = 1 << 16
