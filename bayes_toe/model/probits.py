"""From logits to probits and back, accurate in both tails.

Where data leave a share open its logit has exponential tails, its probit normal ones.
"""

from __future__ import annotations

import numpy as np
from scipy.special import erfcx, log_expit, log_ndtr, ndtri_exp

from bayes_toe.arrays import FloatArray


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


def log_slope(probit: FloatArray) -> FloatArray:
    """Log d(probit)/d(logit) = log [Phi(y) Phi(-y) / phi(y)] at the probit y, by Mills' ratio: far out nothing cancels.

    Examples
    --------
    >>> log_slope(np.array([0.0, 1e12])).round(3).tolist()
    [-0.467, -27.631]
    """
    far = np.abs(probit)
    return np.asarray(log_ndtr(far) + np.log(erfcx(far * np.sqrt(0.5))) + 0.5 * np.log(0.5 * np.pi))
