"""How many digits of a number people are shown: no more than its Monte Carlo error allows."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

_QUANTILES = ("q05", "q50", "q95")


def allowed(value: float, error: float, most: int) -> str:
    """A number down to the decimal in which its standard error begins, and to no more than `most` decimals.

    Where the error is larger than 1, tens or hundreds are what is left. An error of 0 or NaN allows all.

    Examples
    --------
    >>> allowed(0.123456, 0.004, 5), allowed(0.123456, 0.04, 5), allowed(1234.5, 30.0, 2), allowed(0.123456, float("nan"), 2)
    ('0.123', '0.12', '1230', '0.12')
    """
    if not 0.0 < error < math.inf:
        return f"{value:.{most}f}"
    return _rounded(value, min(most, _decimals(error)))


def allowed_in_order(values: Sequence[float], errors: Sequence[float], most: int) -> list[str]:
    """Numbers that ascend, such as a median between its limits, each as :func:`allowed` has it; the order is still there to be seen.

    Where each by itself would hide it, because errors differ by orders of magnitude as they do before sampling has converged, all end where
    the largest error begins or, where they would be alike there, with the first decimal in which they differ.

    Examples
    --------
    >>> allowed_in_order([49.6, 40_213.0, 86_443.6], [20.0, 3e5, 0.004], 2), allowed_in_order([0.12, 0.51, 2.3], [0.01, 0.02, 0.2], 2)
    (['0', '40000', '90000'], ['0.12', '0.51', '2.3'])
    """
    shown = [allowed(value, error, most) for value, error in zip(values, errors, strict=True)]
    if all(float(low) < float(high) for low, high in itertools.pairwise(shown)):
        return shown
    decimals = min([most, *(_decimals(error) for error in errors if 0.0 < error < math.inf)])
    while decimals < most and len({round(value, decimals) for value in values}) < len(set(values)):
        decimals += 1
    return [_rounded(value, decimals) for value in values]


def allowed_quantiles(row: Mapping[Any, Any], most: int) -> list[str]:
    """The 5 % quantile, median and 95 % quantile of a row of a summary as :func:`allowed_in_order` has them."""
    return allowed_in_order([row[key] for key in _QUANTILES], [row[f"mcse_{key}"] for key in _QUANTILES], most)


def _decimals(error: float) -> int:
    # As it is printed with one digit: 0.0096 is 0.01 and begins in the second decimal.
    return -int(f"{error:.0e}".partition("e")[2])


def _rounded(value: float, decimals: int) -> str:
    return f"{round(value, decimals) + 0.0:.{max(decimals, 0)}f}"  # - 0.0 becomes 0
