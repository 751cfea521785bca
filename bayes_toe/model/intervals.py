"""The model at several inter-stimulus intervals: memory diffuses by sigma_p^2 per second.

The propagator is a random walk, so over an interval of t seconds its variance is sigma_p^2 t. sigma_p is then in natural-log intensity per
square root of a second, and everything that the paper derives for one interval holds with sigma_p sqrt(t) in the place of sigma_p:

    gamma_t = sigma_l^2 / (sigma_p^2 t),   G_t = (1 + sqrt(1 + 4 gamma_t)) / 2,
    gain K_t = 1/G_t,   pull p_t = gamma_t / G_t^2,   width w_t = sigma_p sqrt(t) G_t^(3/2).

Assumption: each interval has its own self-consistent prior, of variance G_t sigma_p^2 t, as it has when its trials are run in a block. Were
intervals mixed at random and the prior one for all of them, the first stimulus would be weighted alike at every interval, and only the
width would depend on it; data from mixed intervals can tell, and disagree with the model here if that is so.

mu_1, sigma_l and q0 are common to all intervals. Here sigma_p is per root second; what is fitted, its prior and everything that is stored
refer to a reference interval t_0, by default the geometric mean of a study's: sigma_p is then that over t_0, per root second
sigma_p / sqrt(t_0), and gamma is gamma_t0. The longer the interval, the smaller gamma_t: the gain goes to 1, and forgetting shows in the
width alone (erratum 6; see docs/errata.md). The width is least, 2 sigma_l, at the interval where gamma_t = 2; at shorter ones the memory
is so narrow that the second stimulus moves it little.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray
from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import equal_probability, gain
from bayes_toe.model.coordinates import Natural


def at_interval(theta: Natural, isi: npt.ArrayLike) -> Natural:
    """The parameters of the one-interval model that describe an interval: sigma_p sqrt(isi) in the place of sigma_p.

    Parameters
    ----------
    theta : Natural
        mu1, sigma_l (natural-log intensity), sigma_p (natural-log intensity per square root of a second), q0; broadcast with isi.
    isi : array_like
        Intervals, seconds.

    Raises
    ------
    InputError
        If an interval is not positive and finite.

    Examples
    --------
    >>> theta = Natural(*map(np.asarray, (0.0, 0.2, 0.2, 0.9)))
    >>> [round(float(at_interval(theta, isi).gamma), 12) for isi in (0.5, 1.0, 4.0)]
    [2.0, 1.0, 0.25]
    """
    interval = require_intervals(isi)
    return theta._replace(sigma_p=np.asarray(np.asarray(theta.sigma_p, np.float64) * np.sqrt(interval)))


def gain_at(theta: Natural, isi: npt.ArrayLike) -> FloatArray:
    """Kalman gain at an interval (seconds), K_t = 1/G_t: the weight of the first stimulus. Arguments broadcast.

    Examples
    --------
    >>> theta = Natural(*map(np.asarray, (0.0, 1.0, 1.0, 0.9)))
    >>> round(float(gain_at(theta, 0.5)), 12)
    0.5
    """
    return gain(at_interval(theta, isi).gamma)


def equal_probability_at(s1: npt.ArrayLike, s2: npt.ArrayLike, isi: npt.ArrayLike, theta: Natural) -> FloatArray:
    """P(equal) of pairs s1, s2 (natural-log intensity) at intervals isi (seconds). Arguments broadcast.

    Source: Eq. mod:q with the propagator of the interval.

    Raises
    ------
    InputError
        If an interval is not positive and finite.
    NumericalError
        If a parameter is NaN or out of range.

    Examples
    --------
    >>> theta = Natural(*map(np.asarray, (0.0, 0.15, 0.0, 0.9)))
    >>> round(float(equal_probability_at(0.0, 0.3, 4.0, theta)), 12)
    0.45
    """
    return equal_probability(s1, s2, *at_interval(theta, isi))


def require_intervals(isi: npt.ArrayLike) -> FloatArray:
    """Intervals as an array of seconds.

    Raises
    ------
    InputError
        If one is not positive and finite.
    """
    intervals = np.asarray(isi, np.float64)
    if not (np.isfinite(intervals) & (intervals > 0)).all():
        raise InputError("isi: intervals must be positive finite numbers of seconds")
    return intervals
