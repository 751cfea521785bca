"""From logits to probits and back, accurate in both tails.

Where data leave a share open its logit has exponential tails, its probit normal ones.
"""

from __future__ import annotations

import numpy as np
from scipy.special import log_expit, log_ndtr, ndtri_exp

from bayes_toe.arrays import FloatArray
from bayes_toe.model.distributions import LOG_2PI


def probit_of_logit(logit: FloatArray) -> FloatArray:
    """Standard normal quantile of expit(logit), shape (...).

    Examples
    --------
    >>> probit_of_logit(np.array([1.0, -700.0])).round(4).tolist()
    [0.616, -37.2951]
    """
    return np.asarray(np.sign(logit) * -ndtri_exp(log_expit(-np.abs(logit))))


def logit_of_probit(probit: FloatArray) -> FloatArray:
    """Inverse of :func:`probit_of_logit`."""
    return np.asarray(log_ndtr(probit) - log_ndtr(-probit))


def log_slope(logit: FloatArray, probit: FloatArray) -> FloatArray:
    """Log d(probit)/d(logit) = log [expit(logit) expit(-logit) / phi(probit)] where both stand for one share."""
    return np.asarray(log_expit(logit) + log_expit(-logit) + 0.5 * (np.square(probit) + LOG_2PI))
