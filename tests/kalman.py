"""A scalar Kalman filter with a random walk, written from its textbook equations.

A reference for the closed forms of the model.
"""

from typing import NamedTuple

import numpy as np


class Belief(NamedTuple):
    """Mean and variance of a Gaussian."""

    mean: float
    variance: float


def update(belief, stimulus, noise):
    """The belief after a measurement with this standard deviation."""
    gain = belief.variance / (belief.variance + noise**2)
    mean = belief.mean + gain * (stimulus - belief.mean)
    return Belief(mean, (1.0 - gain) * belief.variance)


def evolve(belief, diffusion, interval=1.0):
    """The belief after an interval of a random walk."""
    return Belief(belief.mean, belief.variance + interval * diffusion**2)


def settled(mean, diffusion, noise, interval=1.0):
    """The belief whose variance a stimulus and an interval leave as it is.

    The positive root of a quadratic equation.
    """
    step = interval * diffusion**2
    return Belief(mean, 0.5 * (step + np.sqrt(step**2 + 4.0 * step * noise**2)))


def shift(belief, stimulus, noise):
    """How far a stimulus moves the mean, in standard deviations of the belief."""
    return (update(belief, stimulus, noise).mean - belief.mean) / np.sqrt(belief.variance)
