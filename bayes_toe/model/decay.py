"""Exponential decay with two derivatives: log(1 - e^(-l f)), what a memory has lost, without cancellation however little that is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import bernoulli, expit, factorial

from bayes_toe.arrays import FloatArray

#: B_2j/(2j)!: the series of y/(e^y - 1) + y/2 - 1 in y^2 beyond its constant term, to rounding for y <= 1.
_BERNOULLI = tuple(float(number) / factorial(2 * j) for j, number in enumerate(bernoulli(24)[2::2], start=1))


class Jet(NamedTuple):
    """A function of one coordinate: value, first and second derivative, of one shape."""

    value: FloatArray
    first: FloatArray
    second: FloatArray


def softplus_jet(a: FloatArray) -> Jet:
    """log(1 + e^a), which is -log(1 - expit(a))."""
    return Jet(np.logaddexp(0.0, a), expit(a), expit(a) * expit(-a))


def expit_jet(a: FloatArray) -> Jet:
    """1/(1 + e^-a)."""
    slope = expit(a) * expit(-a)
    return Jet(expit(a), slope, -slope * np.tanh(0.5 * a))


def log_lost_growth(lost: Jet, exponent: Jet, factor: float) -> tuple[FloatArray, FloatArray]:
    """Derivatives of log(1 - exp(-factor l f)) in (l's coordinate, f's), less those of log l: shapes (2, ...) and (2, 2, ...).

    With y = factor l f: E' = 1/y + h(y), E'' = -1/y^2 + h'(y). In f's coordinate the terms in 1/y are kept.
    """
    across, f = factor * lost.value, exponent.value
    h, h1 = smooth_rate(across * f)
    along, along_bend = factor * f * h, np.square(factor * f) * h1
    first = lost.first * along, (h * across + 1.0 / f) * exponent.first
    mixed = lost.first * factor * exponent.first * (h + across * f * h1)
    bend = (h * across + 1.0 / f) * exponent.second + h1 * np.square(across * exponent.first) - np.square(exponent.first / f)
    second = lost.second * along + np.square(lost.first) * along_bend, mixed, mixed, bend
    return np.stack(np.broadcast_arrays(*first)), np.stack(np.broadcast_arrays(*second)).reshape(2, 2, *np.shape(h))


def smooth_rate(y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """h(y) = 1/(e^y - 1) - 1/y and its derivative, y > 0; near 0 by the series with Bernoulli numbers."""
    small = np.minimum(y, 1.0)
    square = np.square(small)
    series, slope = np.zeros_like(small), np.zeros_like(small)
    for j in range(len(_BERNOULLI), 0, -1):
        series = series * square + _BERNOULLI[j - 1]
        slope = slope * square + (2 * j - 1) * _BERNOULLI[j - 1]
    large = np.clip(y, 1.0, 700.0)
    half = np.sinh(0.5 * large)
    beyond = np.where(y > 700.0, 0.0, 1.0)  # there e^-y is below the smallest float
    with np.errstate(over="ignore"):
        direct = beyond / np.expm1(large) - 1.0 / np.maximum(y, 1.0)
        direct_slope = np.square(1.0 / np.maximum(y, 1.0)) - beyond * 0.25 / np.square(half)
    return np.where(y < 1.0, series * small - 0.5, direct), np.where(y < 1.0, slope, direct_slope)
