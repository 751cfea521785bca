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
from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import LN2, noise_ratio, require_natural, variance_ratio


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
        return np.asarray(np.exp(-0.5 * ((np.asarray(s, np.float64) - self.mean) / self.sd) ** 2) / (self.sd * np.sqrt(2.0 * np.pi)))


def steady_prior(mu1: npt.ArrayLike, sigma_p: npt.ArrayLike, sigma_l: npt.ArrayLike) -> Gaussian:
    """The self-consistent prior: mean mu_1, variance G sigma_p^2, which one stimulus and one interval leave as it is. Source: Eq. axis1.

    Examples
    --------
    >>> round(float(steady_prior(0.0, 1.0, 2**0.5).variance), 12)
    2.0
    """
    variance = variance_ratio(noise_ratio(sigma_p, sigma_l)) * np.square(np.asarray(sigma_p, np.float64))
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
    return Gaussian(np.asarray(stimulus + kept * (belief.mean - stimulus)), np.asarray(kept * belief.variance))


def evolve(belief: Gaussian, sigma_p: npt.ArrayLike, interval: npt.ArrayLike = 1.0) -> Gaussian:
    """Belief after an interval, in units of the experiment's own: the variance grows by interval sigma_p^2. Source: Eq. integrales."""
    mean, variance = np.broadcast_arrays(belief.mean, belief.variance + np.asarray(interval, np.float64) * np.square(sigma_p))
    return Gaussian(np.asarray(mean), np.asarray(variance))


def comparison_distance(belief: Gaussian, s: npt.ArrayLike, sigma_l: npt.ArrayLike) -> FloatArray:
    """Shift that a stimulus s causes, in units of the belief's sd: (mu_f - mu)/sigma = (s - mu)/(sigma + sigma_l^2/sigma); no unit.

    Source: Eq. mod:qdphi. P(equal) = q0 2^(-distance^2).
    """
    return np.asarray((np.asarray(s, np.float64) - belief.mean) / (belief.sd + np.square(np.asarray(sigma_l, np.float64)) / belief.sd))


@dataclass(frozen=True, eq=False)
class TrialView:
    """The four beliefs of one trial and its likelihood noise. Source: Fig. 2."""

    prior: Gaussian
    after_first: Gaussian
    evolved: Gaussian
    after_second: Gaussian
    distance: FloatArray


def trial_view(s1: npt.ArrayLike, s2: npt.ArrayLike, mu1: npt.ArrayLike, sigma_p: npt.ArrayLike, sigma_l: npt.ArrayLike) -> TrialView:
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
    return TrialView(prior, after_first, evolved, update(evolved, s2, sigma_l), comparison_distance(evolved, s2, sigma_l))


@dataclass(frozen=True, eq=False)
class SequenceView:
    """Beliefs along a sequence of stimuli; the last axis is time.

    Attributes
    ----------
    stimuli : array, shape (..., times)
        Natural-log intensities.
    before, after : Gaussian
        Beliefs just before and just after each stimulus.
    distance : array, shape (..., times)
        Shift that each stimulus causes in units of the sd before it; from the second on, P(equal to what was expected) =
        q0 2^(-distance^2).
    """

    stimuli: FloatArray
    before: Gaussian
    after: Gaussian
    distance: FloatArray


def sequence_view(
    stimuli: npt.ArrayLike,
    mu1: npt.ArrayLike,
    sigma_p: npt.ArrayLike,
    sigma_l: npt.ArrayLike,
    *,
    intervals: npt.ArrayLike | None = None,
    prior: Gaussian | None = None,
) -> SequenceView:
    """Filter a sequence of stimuli.

    Parameters
    ----------
    stimuli : array_like, shape (times,) or (..., times)
        Natural-log intensities; leading axes broadcast with the parameters.
    mu1, sigma_p, sigma_l : array_like, shape (...)
    intervals : array_like, shape (times - 1,), optional
        Pauses in units of the interval that sigma_p^2 belongs to; all 1 by default.
    prior : Gaussian, optional
        Belief before the first stimulus; by default the self-consistent one, which with intervals of 1 keeps the variance before every
        stimulus at G sigma_p^2.

    Raises
    ------
    InputError
        If there is no stimulus, or intervals are negative or not one fewer than stimuli.
    NumericalError
        If a parameter is outside its range.

    Examples
    --------
    >>> view = sequence_view([0.0, 0.4, 0.4], mu1=1.0, sigma_p=1.0, sigma_l=2**0.5)
    >>> view.before.mean.round(6).tolist(), view.before.variance.round(6).tolist()
    ([1.0, 0.5, 0.45], [2.0, 2.0, 2.0])
    """
    require_natural(mu1, sigma_p, sigma_l, 1.0)
    shown = np.atleast_1d(np.asarray(stimuli, np.float64))
    pauses = _require_intervals(shown, intervals)
    belief = steady_prior(mu1, sigma_p, sigma_l) if prior is None else prior
    before: list[Gaussian] = []
    after: list[Gaussian] = []
    for t in range(shown.shape[-1]):
        before.append(evolve(after[-1], sigma_p, pauses[t - 1]) if t else belief)
        after.append(update(before[-1], shown[..., t], sigma_l))
    distance = [comparison_distance(one, shown[..., t], sigma_l) for t, one in enumerate(before)]
    return SequenceView(shown, _in_time(before), _in_time(after), np.stack(np.broadcast_arrays(*distance), axis=-1))


def noticed(
    stimuli: npt.ArrayLike,
    mu1: npt.ArrayLike,
    sigma_p: npt.ArrayLike,
    sigma_l: npt.ArrayLike,
    q0: npt.ArrayLike,
    *,
    intervals: npt.ArrayLike | None = None,
    prior: Gaussian | None = None,
) -> FloatArray:
    """Probability that each stimulus after the first is noticed as different from what was expected, shape (..., times - 1); no unit.

    With mu and sigma^2 the mean and variance of the evolved belief just before a stimulus s,

        1 - q = 1 - q0 2^(-z^2),  z = (s - mu)/w,  w = sigma + sigma_l^2/sigma,

    in the form (1 - q0) + q0 (1 - 2^(-z^2)), in which nothing cancels. Every stimulus updates the belief, noticed or not. Two stimuli with
    the default prior and an interval of 1 are the paper's model.

    Source: Eqs. mod:qdphi and mod:q, at every stimulus.

    Parameters
    ----------
    stimuli : array_like, shape (times,) or (..., times)
        At least two natural-log intensities.
    mu1, sigma_p, sigma_l, q0 : array_like, shape (...)
        Natural-log intensities, and the chance of 'equal' where nothing differs. Posterior draws go in as they are; quantiles of the result
        over draws are its bands.
    intervals : array_like, shape (times - 1,), optional
        Pauses before every stimulus but the first, in units of the interval that sigma_p^2 belongs to; all 1 by default.
    prior : Gaussian, optional
        Belief before the first stimulus; by default the one that is self-consistent at intervals of 1. For a stream of stimuli an interval
        d apart it is ``steady_prior(mu1, sigma_p * d**0.5, sigma_l)``.

    Raises
    ------
    InputError
        If there are fewer than two stimuli, or intervals do not fit.
    NumericalError
        If a parameter is outside its range.

    Examples
    --------
    >>> noticed([0.0, 0.0, 0.0, 0.4], mu1=0.0, sigma_p=0.3, sigma_l=0.2, q0=0.9).round(3).tolist()
    [0.1, 0.1, 0.465]
    """
    require_natural(mu1, sigma_p, sigma_l, q0)
    if np.atleast_1d(np.asarray(stimuli, np.float64)).shape[-1] < 2:
        raise InputError("a stimulus is compared with the ones before it: allowed are at least two stimuli")
    z = sequence_view(stimuli, mu1, sigma_p, sigma_l, intervals=intervals, prior=prior).distance[..., 1:]
    top = np.asarray(q0, np.float64)[..., None]
    return np.asarray((1.0 - top) - top * np.expm1(-LN2 * np.square(z)))


def _in_time(beliefs: list[Gaussian]) -> Gaussian:
    means, variances = (np.stack(np.broadcast_arrays(*values), axis=-1) for values in zip(*beliefs, strict=True))
    return Gaussian(*np.broadcast_arrays(means, variances))


def _require_intervals(stimuli: FloatArray, intervals: npt.ArrayLike | None) -> FloatArray:
    times = stimuli.shape[-1]
    if times == 0 or not np.isfinite(stimuli).all():
        raise InputError("a sequence needs at least one stimulus, all finite")
    pauses = np.ones(times - 1) if intervals is None else np.asarray(intervals, np.float64)
    if pauses.shape != (times - 1,) or not np.all((pauses >= 0) & np.isfinite(pauses)):
        raise InputError(f"intervals: {times} stimuli need {times - 1} finite numbers that are not negative")
    return pauses
