"""Digits that a Monte Carlo error allows."""

import math

import numpy as np
import pytest

from bayes_toe.cli.terminal import allowed, allowed_in_order


@pytest.mark.parametrize(
    ("value", "error", "most", "shown"),
    [
        (0.123456, 0.004, 6, "0.123"),
        (0.123456, 0.004, 2, "0.12"),  # never more than asked for
        (0.123456, 0.0096, 6, "0.12"),  # 0.01 to one digit
        (0.123456, 0.0094, 6, "0.123"),
        (-1.2345, 0.1, 3, "-1.2"),
        (9.96, 0.2, 3, "10.0"),
        (-0.03, 0.2, 3, "0.0"),  # no minus before nothing
        (12.6, 3.0, 3, "13"),
        (1234.5, 30.0, 3, "1230"),
        (-1.0e20, 1.0e18, 2, "-100000000000000000000"),
        (12.0, 300.0, 2, "0"),
        (1.5, math.nan, 3, "1.500"),
        (1.5, 0.0, 3, "1.500"),
        (1.5, math.inf, 3, "1.500"),
        (1.5, 1e-300, 3, "1.500"),
        (np.float64(0.98765), np.float64(0.02), 3, "0.99"),
        (math.nan, 0.1, 2, "nan"),
    ],
)
def test_digits_end_where_the_error_begins(value, error, most, shown):
    assert allowed(value, error, most) == shown


@pytest.mark.parametrize(
    ("values", "errors", "shown"),
    [
        ([0.12, 0.51, 2.34], [0.01, 0.002, 0.2], ["0.12", "0.51", "2.3"]),  # each by its own error, in their order
        ([49.6, 40_213.0, 86_443.6], [20.0, 3e5, 0.004], ["0", "40000", "90000"]),  # not 50, 0, 86443.60
        ([0.0, 77.3, 345_678.0], [3e4, 1.0, 9e4], ["0", "77", "350000"]),
        ([0.12, 0.123, 0.15], [0.1, 0.1, 0.01], ["0.12", "0.12", "0.15"]),  # alike with all the decimals that there may be
        ([0.0, 0.0, 0.0], [math.nan] * 3, ["0.00"] * 3),
    ],
)
def test_a_median_is_shown_between_its_limits(values, errors, shown):
    assert allowed_in_order(values, errors, 2) == shown
    assert [float(text) for text in shown] == sorted(float(text) for text in shown)
