"""The observer's beliefs in time, as Gaussians: prior, posterior after a stimulus, that posterior evolved, posterior after the next.

A Kalman filter with a random walk: a measurement of s with noise sigma_l moves the belief, an interval adds sigma_p^2 to its variance. With
the paper's self-consistent prior, sigma_1^2 = G sigma_p^2, each stimulus finds the same variance. Two stimuli give the paper's model.

All means are natural-log intensities, variances their squares. Errata: in Eq. axis0 and in the second form of mu_2 in Appendix B; the forms
here are the corrected ones, m + K (s - m) written as s + (1 - K)(m - s).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray
from bayes_toe.model.closed_form import noise_ratio, require_natural, variance_ratio


class Gaussian(NamedTuple):
    """A belief: mean (natural-log intensity) and variance; arrays broadcast."""

    mean: FloatArray
    variance: FloatArray

    @property
    def sd(self) -> FloatArray:
        """Standard deviation, natural-log intensity."""
        return np.sqrt(self.variance)

    def density(self, s: npt.ArrayLike) -> FloatArray:
        """Density at s, for figures."""
        return np.asarray(
            np.exp(-0.5 * ((np.asarray(s, np.float64) - self.mean) / self.sd) ** 2)
            / (self.sd * np.sqrt(2.0 * np.pi))
        )


def steady_prior(mu1: npt.ArrayLike, sigma_p: npt.ArrayLike, sigma_l: npt.ArrayLike) -> Gaussian:
    """The self-consistent prior: mean mu_1, variance G sigma_p^2, which one stimulus and one interval leave as it is. Source: Eq. axis1.

    Examples
    --------
    >>> round(float(steady_prior(0.0, 1.0, 2**0.5).variance), 12)
    2.0
    """
    variance = variance_ratio(noise_ratio(sigma_p, sigma_l)) * np.square(
        np.asarray(sigma_p, np.float64)
    )
    mean, variance = np.broadcast_arrays(np.asarray(mu1, np.float64), variance)
    return Gaussian(np.asarray(mean), np.asarray(variance))


def update(belief: Gaussian, s: npt.ArrayLike, sigma_l: npt.ArrayLike) -> Gaussian:
    """Belief after a stimulus s measured with noise sigma_l. Source: Methods, sigma_f^-2 = sigma_2^-2 + sigma_l^-2.

    Examples
    --------
    >>> after = update(Gaussian(np.array(0.0), np.array(2.0)), 1.0, 2**0.5)
    >>> [round(float(v), 12) for v in after]
    [0.5, 1.0]
    """
    stimulus, noise = np.asarray(s, np.float64), np.square(np.asarray(sigma_l, np.float64))
    kept = noise / (belief.variance + noise)
    return Gaussian(
        np.asarray(stimulus + kept * (belief.mean - stimulus)), np.asarray(kept * belief.variance)
    )


def evolve(belief: Gaussian, sigma_p: npt.ArrayLike, interval: npt.ArrayLike = 1.0) -> Gaussian:
    """Belief after an interval, in units of the experiment's own: the variance grows by interval sigma_p^2. Source: Eq. integrales."""
    mean, variance = np.broadcast_arrays(
        belief.mean, belief.variance + np.asarray(interval, np.float64) * np.square(sigma_p)
    )
    return Gaussian(np.asarray(mean), np.asarray(variance))


def comparison_distance(belief: Gaussian, s: npt.ArrayLike, sigma_l: npt.ArrayLike) -> FloatArray:
    """Shift that a stimulus s causes, in units of the belief's sd: (mu_f - mu)/sigma = (s - mu)/(sigma + sigma_l^2/sigma); no unit.

    Source: Eq. mod:qdphi. P(equal) = q0 2^(-distance^2).
    """
    return np.asarray(
        (np.asarray(s, np.float64) - belief.mean)
        / (belief.sd + np.square(np.asarray(sigma_l, np.float64)) / belief.sd)
    )


@dataclass(frozen=True, eq=False)
class TrialView:
    """The four beliefs of one trial and its likelihood noise. Source: Fig. 2."""

    prior: Gaussian
    after_first: Gaussian
    evolved: Gaussian
    after_second: Gaussian
    distance: FloatArray


def trial_view(
    s1: npt.ArrayLike,
    s2: npt.ArrayLike,
    mu1: npt.ArrayLike,
    sigma_p: npt.ArrayLike,
    sigma_l: npt.ArrayLike,
) -> TrialView:
    """Prior, posterior after s1, evolved prior, posterior after s2, and the normalised distance z of the comparison.

    Arguments broadcast, so draws go in as they are.

    Raises
    ------
    NumericalError
        If a parameter is outside its range.

    Examples
    --------
    >>> view = trial_view(0.0, 0.4, mu1=1.0, sigma_p=1.0, sigma_l=2**0.5)
    >>> [round(float(belief.mean), 6) for belief in (view.prior, view.after_first, view.evolved, view.after_second)]
    [1.0, 0.5, 0.5, 0.45]
    """
    require_natural(mu1, sigma_p, sigma_l, 1.0)
    prior = steady_prior(mu1, sigma_p, sigma_l)
    after_first = update(prior, s1, sigma_l)
    evolved = evolve(after_first, sigma_p)
    return TrialView(
        prior,
        after_first,
        evolved,
        update(evolved, s2, sigma_l),
        comparison_distance(evolved, s2, sigma_l),
    )
