"""How many digits of a number people are shown: no more than its Monte Carlo error allows."""

from __future__ import annotations

import math


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
    # As it is printed with one digit: 0.0096 is 0.01 and begins in the second decimal.
    decimals = min(most, -int(f"{error:.0e}".partition("e")[2]))
    return f"{round(value, decimals) + 0.0:.{max(decimals, 0)}f}"  # - 0.0 becomes 0
