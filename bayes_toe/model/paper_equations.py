"""The equations of the paper's model: arrays in, arrays out.

An observer holds a Gaussian prior over log-intensity, measures the first stimulus with noise
sigma_l, and keeps the result in a memory that diffuses with standard deviation sigma_p until the
second stimulus arrives. With gamma = sigma_l^2 / sigma_p^2 and G = (1 + sqrt(1 + 4 gamma)) / 2
everything has a closed form in which nothing cancels (arXiv 2604.19662, Methods and Appendix B).

All functions broadcast; intensities and standard deviations are in natural-log units.

Errata of the paper that matter here: in Eq. axis0 the factor must read (1 - sigma_p^2/sigma^2), and
in Appendix B the second form of mu_2 lacks a factor sigma_x^2; the code follows the corrected
forms.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from bayes_toe.arrays import FloatArray, Texts
from bayes_toe.data.tasks import Task
from bayes_toe.errors import NumericalError

LN2 = float(np.log(2.0))
#: The four natural parameters.
NATURAL = ("mu1", "sigma_p", "sigma_l", "q0")


def variance_ratio(gamma: npt.ArrayLike) -> FloatArray:
    """Prior variance divided by memory variance, G = (1 + sqrt(1 + 4 gamma))/2.

    Source: Eq. axis1.

    Raises
    ------
    NumericalError
        If a gamma is negative or above 1e306. A NaN gives NaN.

    Examples
    --------
    >>> float(variance_ratio(2.0))
    2.0
    """
    gammas = np.asarray(gamma, np.float64)
    if np.any((gammas < 0.0) | (gammas > 1e306)):  # 4 gamma must be a float
        raise NumericalError(
            "sigma_l / sigma_p must be below 1e153, and gamma must be finite and not negative"
        )
    return 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * gammas))


def gain(gamma: npt.ArrayLike) -> FloatArray:
    """Kalman gain K = sigma_1^2 / (sigma_1^2 + sigma_l^2) = 1/G.

    K is the weight of the first stimulus in `evolved_mean`.

    Source: Eq. axis2, slope, with (G - 1)/gamma = 1/G.

    Examples
    --------
    >>> float(gain(2.0))
    0.5
    """
    return 1.0 / variance_ratio(gamma)


def pull(gamma: npt.ArrayLike) -> FloatArray:
    """Contraction towards the prior mean, p = 1 - K = gamma / G^2.

    The form is accurate down to the smallest gamma.

    Source: Eq. axis2, prefactor of mu_1.

    Examples
    --------
    >>> float(pull(2.0)), float(pull(1e-300))
    (0.5, 1e-300)
    """
    return np.divide(gamma, variance_ratio(gamma) ** 2)


def width(sigma_p: npt.ArrayLike, gamma: npt.ArrayLike) -> FloatArray:
    """Width of the 'equal' curve, w = sigma_2 + sigma_l^2/sigma_2 = sigma_p G^(3/2).

    The width is in natural-log intensity.

    Source: Eq. mod:q, denominator.

    Examples
    --------
    >>> round(float(width(0.5, 2.0)), 12) == round(0.5 * 2**1.5, 12)
    True
    """
    return np.multiply(sigma_p, variance_ratio(gamma) ** 1.5)


def noise_ratio(sigma_p: npt.ArrayLike, sigma_l: npt.ArrayLike) -> FloatArray:
    """Gamma = sigma_l^2 / sigma_p^2; the ratio is squared, because a square alone may be no float.

    Source: Eq. axis1.
    """
    return np.divide(sigma_l, sigma_p) ** 2


class Natural(NamedTuple):
    """Prior mean mu1, diffusion sigma_p, noise sigma_l (natural-log units) and q0."""

    mu1: FloatArray
    sigma_p: FloatArray
    sigma_l: FloatArray
    q0: FloatArray

    @property
    def gamma(self) -> FloatArray:
        """Noise ratio sigma_l^2 / sigma_p^2."""
        return noise_ratio(self.sigma_p, self.sigma_l)


def natural_names(task: Task) -> Texts:
    """The names of the paper's four parameters in a task."""
    return (*NATURAL[:3], task.lapses)


def evolved_mean(s1: npt.ArrayLike, mu1: npt.ArrayLike, gamma: npt.ArrayLike) -> FloatArray:
    """Remembered first stimulus at the time of the second stimulus, mu_2 = s1 + p (mu_1 - s1).

    Source: Eq. mod:update (corrected, see the module's note).

    Examples
    --------
    >>> float(evolved_mean(0.0, 1.0, 2.0))
    0.5
    """
    return np.add(s1, pull(gamma) * np.subtract(mu1, s1))


def normalised_distance(
    s1: npt.ArrayLike,
    s2: npt.ArrayLike,
    mu1: npt.ArrayLike,
    sigma_p: npt.ArrayLike,
    sigma_l: npt.ArrayLike,
) -> FloatArray:
    """Distance of s2 from the remembered first stimulus, divided by the width, z = (s2 - mu_2)/w.

    Source: Eqs. mod:qdphi and mod:q.
    """
    require_natural(mu1, sigma_p, sigma_l, q0=1.0)  # z does not depend on q0
    gamma = noise_ratio(sigma_p, sigma_l)
    displacement = np.subtract(s2, s1) - pull(gamma) * np.subtract(mu1, s1)
    return displacement / width(sigma_p, gamma)


def equal_probability(
    s1: npt.ArrayLike,
    s2: npt.ArrayLike,
    mu1: npt.ArrayLike,
    sigma_p: npt.ArrayLike,
    sigma_l: npt.ArrayLike,
    q0: npt.ArrayLike,
) -> FloatArray:
    """Probability of 'equal', q0 2^(-z^2), from the parameters of the paper's model.

    Intensities and standard deviations in natural-log units.

    Source: Eq. mod:q.

    Raises
    ------
    NumericalError
        If a parameter is NaN or outside sigma_p > 0, sigma_l >= 0, 0 <= q0 <= 1.

    Examples
    --------
    >>> round(float(equal_probability(0.0, 0.3, mu1=0.0, sigma_p=0.3, sigma_l=0.0, q0=0.9)), 12)
    0.45
    """
    require_natural(mu1, sigma_p, sigma_l, q0)
    z = normalised_distance(s1, s2, mu1, sigma_p, sigma_l)
    return np.multiply(q0, np.exp(-LN2 * np.square(z)))


def p_counted(task: Task, s1: npt.ArrayLike, s2: npt.ArrayLike, natural: Natural) -> FloatArray:
    """Probability of the answer that the task counts; in 2AFC the lapse rate is in the place of q0.

    In 2AFC, P(second) = lambda/2 + (1 - lambda) Phi(z) with z = (s2 - mu_2)/(G sigma_p).

    Examples
    --------
    >>> from bayes_toe.data.tasks import WHICH_STRONGER
    >>> observer = Natural(0.0, 0.3, 0.1, 0.1)
    >>> round(float(p_counted(WHICH_STRONGER, 0.0, 9.0, observer)), 12)
    0.95
    """
    if task.lapses == "q0":
        return equal_probability(s1, s2, *natural)
    distance = np.subtract(s2, evolved_mean(s1, natural.mu1, natural.gamma))
    z = distance / (variance_ratio(natural.gamma) * natural.sigma_p)
    return 0.5 * natural.q0 + (1.0 - natural.q0) * ndtr(z)


def require_natural(
    mu1: npt.ArrayLike, sigma_p: npt.ArrayLike, sigma_l: npt.ArrayLike, q0: npt.ArrayLike
) -> None:
    """Raise NumericalError, naming the parameter, unless all natural parameters are usable."""
    sigma_p, sigma_l, q0 = (np.asarray(values, np.float64) for values in (sigma_p, sigma_l, q0))
    rules = {
        "mu1 must be finite": np.isfinite(mu1),
        "sigma_p must be finite and positive": np.isfinite(sigma_p) & (sigma_p > 0),
        "sigma_l must be finite and not negative": np.isfinite(sigma_l) & (sigma_l >= 0),
        "q0 must lie in 0..1": (q0 >= 0) & (q0 <= 1),
    }

    for rule, holds in rules.items():
        if not np.all(holds):
            raise NumericalError(rule)
    with np.errstate(over="ignore"):
        variance_ratio(noise_ratio(sigma_p, sigma_l))  # refuses a ratio that is too large
