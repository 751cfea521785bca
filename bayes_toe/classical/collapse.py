"""The collapse of both orders on one curve of the normalised distance (Fig. 3, lower row)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import log_expit

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.classical.frequencies import frequencies
from bayes_toe.inference.predictive_checks import require_draws
from bayes_toe.model.closed_form import LN2
from bayes_toe.model.posterior import Posterior


@dataclass(frozen=True, eq=False)
class Collapse:
    """Model-free frequencies on the normalised distance, where both orders fall on q/q0 = 2^(-z^2). Source: Fig. 3, lower row.

    Arrays have shape (pairs,). Bands are quantiles over the draws that were given.

    Attributes
    ----------
    order : array of int
        -1 weaker stimulus first, 0 equal stimuli, 1 stronger first.
    z, z_low, z_high : array
        Normalised distance (s2 - mu_2)/w: median, lower and upper quantile; no unit.
    ratio, error : array
        qhat/q0 and sigmahat_q/q0 at the median q0. Source: Eq. e:2b.
    """

    order: IntArray
    z: FloatArray
    z_low: FloatArray
    z_high: FloatArray
    ratio: FloatArray
    error: FloatArray


def collapse(posterior: Posterior, x: npt.ArrayLike, *, mass: float = 0.9) -> Collapse:
    """Data of Fig. 3's lower row at unconstrained points x, shape (draws, 4) or (4,); bands hold `mass` of the draws.

    Examples
    --------
    >>> from bayes_toe.data.study import Subject
    >>> from bayes_toe.model.ladder import posterior_of
    >>> posterior = posterior_of(Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [45, 20, 15], [50, 50, 50]))
    >>> collapse(posterior, [0.0, 0.0, -1.0, 2.2]).order.tolist()
    [0, -1, 1]
    """
    points = require_draws(np.atleast_2d(np.asarray(x, np.float64)), posterior)
    low, middle, high = np.quantile(posterior.distance(points), [0.5 - 0.5 * mass, 0.5, 0.5 + 0.5 * mass], axis=0)
    top = float(np.exp(log_expit(np.median(points[:, 3]))))
    free = frequencies(posterior.subject)
    return Collapse(free.order, middle, low, high, free.q / top, free.error / top)


def universal_curve(z: npt.ArrayLike) -> FloatArray:
    """The curve on which the data collapse, q/q0 = 2^(-z^2). Source: Eq. mod:q."""
    return np.asarray(np.exp(-LN2 * np.square(np.asarray(z, np.float64))))
