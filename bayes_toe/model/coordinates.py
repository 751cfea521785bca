"""Natural, identified and unconstrained coordinates of one observer, and the Jacobian between them.

natural        (mu1, sigma_p, sigma_l, q0)      what the paper reports
identified     (offset c, pull p, width w, q0)  what the data see: z = ((s2 - s1) - c + p (s1 - sbar)) / w
unconstrained  (c, logit(p / p_max), log w, logit q0)  where samplers and optimisers work; arrays have it on their last axis

c = p (mu1 - sbar), and sbar is the trial-weighted mean first stimulus of the subject. The map is a bijection for
0 < gamma < 1; in natural coordinates only p (mu1 - s1) enters the likelihood, so gamma and mu1 form a funnel as gamma -> 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import erfcx, expit, log_expit, log_ndtr, logit, ndtri_exp

from bayes_toe.arrays import FloatArray
from bayes_toe.data.tasks import Task
from bayes_toe.model.closed_form import MAX_PULL, noise_ratio, pull, variance_ratio, width

NATURAL = ("mu1", "sigma_p", "sigma_l", "q0")
IDENTIFIED = ("offset", "pull", "width", "q0")
#: Every quantity that has a name.
QUANTITIES = (*NATURAL, "gamma", "sigma1", "gain", "width", "offset", "pull")
#: By so much, relatively, sigma_l may come out above sigma_p though gamma is below 1.
_ROUNDING = 1e-15


def natural_names(task: Task) -> tuple[str, ...]:
    """What a task calls the paper's four parameters."""
    return (*NATURAL[:3], task.lapses)


class Natural(NamedTuple):
    """Prior mean mu1, memory diffusion sigma_p, measurement noise sigma_l (natural-log units) and q0."""

    mu1: FloatArray
    sigma_p: FloatArray
    sigma_l: FloatArray
    q0: FloatArray

    @property
    def gamma(self) -> FloatArray:
        """Noise ratio sigma_l^2 / sigma_p^2."""
        return noise_ratio(self.sigma_p, self.sigma_l)


def reach(x: npt.ArrayLike, top: float = MAX_PULL) -> FloatArray:
    """Distance of the prior mean from the mean first stimulus, mu1 - sbar = c / p, natural-log units; infinite past the largest float."""
    points = np.asarray(x, np.float64)
    c, a = points[..., 0], points[..., 1]
    with np.errstate(over="ignore", invalid="ignore"):
        return np.where(c == 0.0, 0.0, c * inverse_pull(a, top))


def inverse_pull(a: npt.ArrayLike, top: float = MAX_PULL) -> FloatArray:
    """1/p at a = logit(p/top); infinite past the largest float."""
    with np.errstate(over="ignore"):
        return np.asarray((1.0 + np.exp(-np.asarray(a, np.float64))) / top)


def unconstrained(theta: Natural, sbar: float) -> FloatArray:
    """Natural coordinates, each of shape (...), to unconstrained ones of shape (..., 4); needs 0 < gamma < 1, 0 < q0 < 1.

    Notes
    -----
    Where sigma_l and sigma_p differ by rounding only, gamma = 1 and the logit is infinite: such a point is on the edge, outside the open
    support. Draws come there: from logit(p / p_max) = 36 on no pair of floats tells it.
    """
    gamma = theta.gamma
    p = pull(gamma)
    with np.errstate(divide="ignore"):
        columns = (
            p * (theta.mu1 - sbar),
            _logit_pull(theta, p),
            np.log(width(theta.sigma_p, gamma)),
            logit(theta.q0),
        )
    return np.stack(np.broadcast_arrays(*columns), axis=-1)


def _logit_pull(theta: Natural, p: FloatArray) -> FloatArray:
    """logit(p / p_max), with p_max - p by 1 - gamma (see :func:`log_noise_ratio`), and that by the difference of sigma_p and sigma_l."""
    apart = (theta.sigma_p - theta.sigma_l) / theta.sigma_p
    rest = np.where(
        (apart < 0.0) & (apart >= -_ROUNDING), 0.0, apart * (1.0 + theta.sigma_l / theta.sigma_p)
    )
    return np.asarray(np.log(p) + np.log(1.0 / MAX_PULL - p) - 2.0 * np.log1p(-p) - np.log(rest))


def log_jacobian(x: npt.ArrayLike) -> FloatArray:
    """Log |d(mu1, sigma_p, gamma, q0) / dx| at unconstrained x, shape (..., 4) -> (...).

    |d(mu1, sigma_p, gamma) / d(c, w, p)| = (1 + p) / (p (1 - p)^(3/2)); with dp/da = p expit(-a) the factor p cancels, so the
    result stays finite however small the pull.
    """
    _, a, b, top = np.moveaxis(np.asarray(x, np.float64), -1, 0)
    return np.asarray(log_jacobian_of_pull(a) + b + log_expit(top) + log_expit(-top))


def log_jacobian_of_pull(a: FloatArray) -> FloatArray:
    """The part of :func:`log_jacobian` that depends on a = logit(p / p_max), shape (...)."""
    p = MAX_PULL * expit(a)
    return np.asarray(np.log1p(p) - 1.5 * np.log1p(-p) + log_expit(-a))


def log_jacobian_slope_of_pull(a: FloatArray) -> FloatArray:
    """Derivative of :func:`log_jacobian_of_pull`, shape (...)."""
    p, fall = MAX_PULL * expit(a), expit(-a)
    return np.asarray(p * fall / (1.0 + p) + 1.5 * p * fall / (1.0 - p) - expit(a))


def log_noise_ratio(a: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Log gamma and log(1 - gamma) at a = logit(p / p_max), gamma = p/(1 - p)^2; neither cancels.

    p_max and 1/p_max are the roots of (1 - p)^2 = p, so 1 - gamma = (p_max - p) (1/p_max - p) / (1 - p)^2 with p_max - p = p_max expit(-a).
    """
    p = MAX_PULL * expit(a)
    log_gamma = np.log(MAX_PULL) + log_expit(a) - 2.0 * np.log1p(-p)
    near = np.log(MAX_PULL) + log_expit(-a) + np.log(1.0 / MAX_PULL - p) - 2.0 * np.log1p(-p)
    return np.asarray(log_gamma), np.where(
        a < 0.0, np.log1p(-np.exp(np.minimum(log_gamma, -0.1))), near
    )


def quantities(theta: Natural, sbar: float) -> dict[str, FloatArray]:
    """Every named quantity that follows from natural coordinates: they themselves, gamma, sigma1, gain and width, offset and pull."""
    gamma = theta.gamma
    ratio, p = variance_ratio(gamma), pull(gamma)
    spreads = np.sqrt(ratio) * theta.sigma_p, 1.0 / ratio, width(theta.sigma_p, gamma)
    return dict(
        zip(
            QUANTITIES,
            map(np.asarray, (*theta, gamma, *spreads, p * (theta.mu1 - sbar), p)),
            strict=True,
        )
    )


def probit_of_logit(logit: FloatArray) -> FloatArray:
    """Standard normal quantile of expit(logit), shape (...)."""
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
