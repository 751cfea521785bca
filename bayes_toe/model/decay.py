"""Exponential decay with two derivatives: log(1 - e^(-l f)), what a memory has lost, without cancellation however little that is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import bernoulli, expit, factorial

from bayes_toe.arrays import BoolArray, FloatArray

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
    """Derivatives of E = log(1 - exp(-factor l f)) in (l's coordinate, f's), shapes (2, ...) and (2, 2, ...).

    Where l is small, those of log l are left out of them (:func:`small`): a difference of two E does not have them, and there they would
    be nearly all. With y = factor l f, E' = 1/(e^y - 1) = 1/y + h(y) and E'' = -1/(4 sinh(y/2)^2) = -1/y^2 + h'(y).
    """
    across, f = factor * lost.value, exponent.value
    y = across * f
    (h, h1), (rate, bend) = smooth_rate(y), plain_rate(np.maximum(y, 1e-100))
    left_out, near = small(lost), y < 1.0
    along, along_bend = factor * f * np.where(left_out, h, rate), np.square(factor * f) * np.where(left_out, h1, bend)
    full = np.where(near, h * across + 1.0 / f, rate * across)
    steep = np.square(across * exponent.first)
    full_bend = np.where(near, h1 * steep - np.square(exponent.first / f), bend * steep)
    mixed = lost.first * factor * exponent.first * np.where(near, h + y * h1, rate + y * bend)
    first = lost.first * along, full * exponent.first
    second = lost.second * along + np.square(lost.first) * along_bend, mixed, mixed, full * exponent.second + full_bend
    return np.stack(np.broadcast_arrays(*first)), np.stack(np.broadcast_arrays(*second)).reshape(2, 2, *np.shape(h))


def small(lost: Jet) -> BoolArray:
    """Where log l is left out."""
    return np.asarray(lost.value < 1.0)


def plain_rate(y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """1/(e^y - 1) and its derivative, y > 0; 0 where e^-y is below the smallest float, infinite where y is."""
    within = np.minimum(y, 700.0)
    there = np.where(y > 700.0, 0.0, 1.0)
    with np.errstate(over="ignore", divide="ignore"):
        return there / np.expm1(within), -0.25 * there / np.square(np.sinh(0.5 * within))


def smooth_rate(y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """h(y) = 1/(e^y - 1) - 1/y and its derivative, y > 0; near 0 by the series with Bernoulli numbers."""
    low = np.minimum(y, 1.0)
    square = np.square(low)
    series, slope = np.zeros_like(low), np.zeros_like(low)
    for j in range(len(_BERNOULLI), 0, -1):
        series = series * square + _BERNOULLI[j - 1]
        slope = slope * square + (2 * j - 1) * _BERNOULLI[j - 1]
    rate, bend = plain_rate(np.maximum(y, 1.0))
    inverse = 1.0 / np.maximum(y, 1.0)
    return np.where(y < 1.0, series * low - 0.5, rate - inverse), np.where(y < 1.0, slope, bend + np.square(inverse))
