"""From noisy neural activity to the observer's posterior over stimuli (Appendix A), numerically for any density.

A stimulus s* causes activity phi with density p(phi | s*). An ideal observer who knows this noise model and holds the prior p(s) infers
p(s | phi) = p(phi | s) p(s)/p(phi), and over repetitions of the same stimulus

    p_post(s | s*) = integral of p(s | phi) p(phi | s*) over phi.      Source: Eq. actualcalculation.

Both integrals are trapezoid sums on even grids: for densities that are smooth and vanish at the ends of the grid, the error falls
exponentially with the number of nodes; for others the stated error says how far it fell. Everything is summed in log space.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp

from bayes_toe.arrays import FloatArray
from bayes_toe.errors import InputError, NumericalError

#: log p(phi | s) for broadcast arrays phi and s; normalised over phi.
LogNoise = Callable[[FloatArray, FloatArray], npt.ArrayLike]
#: log p(s) for an array s; normalised or not, since p_post does not depend on its constant.
LogPrior = Callable[[FloatArray], npt.ArrayLike]


@dataclass(frozen=True, eq=False)
class Perception:
    """Posterior of an ideal observer for some stimuli.

    Attributes
    ----------
    s_star : array, shape (stimuli,)
        Presented stimuli, natural-log intensity.
    s : array, shape (nodes,)
        Grid of inferred stimuli, natural-log intensity.
    log_density : array, shape (stimuli, nodes)
        ln p_post(s | s*), as the sum gives it: not rescaled to mass 1.
    log_prior : array, shape (nodes,)
        ln p(s), normalised on the grid.
    error : array, shape (stimuli,)
        Largest difference of p_post from its value on grids of half the nodes, relative to its peak: an upper estimate of the error.
    """

    s_star: FloatArray
    s: FloatArray
    log_density: FloatArray
    log_prior: FloatArray
    error: FloatArray

    @property
    def density(self) -> FloatArray:
        """p_post(s | s*), shape (stimuli, nodes)."""
        return np.exp(self.log_density)

    @property
    def mass(self) -> FloatArray:
        """Integral of p_post over s, shape (stimuli,): the mass of p(phi | s*) on the grid of phi, 1 where that is wide enough."""
        return np.asarray(np.exp(logsumexp(self.log_density + _log_weights(self.s), axis=1)))

    @property
    def mean(self) -> FloatArray:
        """Mean of p_post, shape (stimuli,), natural-log intensity."""
        return np.asarray((self._shares * self.s).sum(axis=1))

    @property
    def variance(self) -> FloatArray:
        """Variance of p_post, shape (stimuli,)."""
        return np.asarray((self._shares * np.square(self.s - self.mean[:, None])).sum(axis=1))

    def log_likelihood(self, log_external: npt.ArrayLike) -> FloatArray:
        """Log p_lik(s* | s) = ln p_post(s | s*) + ln p*(s*) - ln p(s), shape (stimuli, nodes), given ln p*(s*), shape (stimuli,).

        Source: Eq. link.
        """
        external = np.broadcast_to(np.asarray(log_external, np.float64), self.s_star.shape)
        with np.errstate(invalid="ignore"):
            result = self.log_density + external[:, None] - self.log_prior
        return np.where(self.log_prior == -np.inf, -np.inf, result)

    @property
    def _shares(self) -> FloatArray:
        log_mass = self.log_density + _log_weights(self.s)
        return np.asarray(np.exp(log_mass - logsumexp(log_mass, axis=1, keepdims=True)))


def perceive(
    s_star: npt.ArrayLike,
    log_noise: LogNoise,
    log_prior: LogPrior,
    *,
    s_range: tuple[float, float],
    phi_range: tuple[float, float],
    nodes: int = 513,
) -> Perception:
    """p_post(s | s*) for a noise model and a prior.

    Parameters
    ----------
    s_star : array_like, shape (stimuli,)
        Presented stimuli, natural-log intensity.
    log_noise : callable
        ln p(phi | s), called with phi of shape (nodes, 1) and s of shape (1, points); normalised over phi, in any unit of phi.
    log_prior : callable
        ln p(s), called with s of shape (nodes,); -inf where s is impossible.
    s_range, phi_range : tuple of float
        Ends of the grids: wide enough that both densities are negligible outside, see :attr:`Perception.mass`.
    nodes : int
        Of each grid; odd and at least 5, so that every other node is a grid as well.

    Raises
    ------
    InputError
        If a range is empty or not finite, or the number of nodes is even or below 5.
    NumericalError
        If a log density is NaN or +inf, or a stimulus causes activity that no stimulus of the prior causes.

    Examples
    --------
    >>> def normal(x, mean, sd):
    ...     return -0.5 * ((x - mean) / sd) ** 2 - np.log(sd * np.sqrt(2 * np.pi))
    >>> seen = perceive([0.5], lambda phi, s: normal(phi, s, 0.2), lambda s: normal(s, 0.0, 0.3), s_range=(-4, 4), phi_range=(-4, 4))
    >>> bool(abs(seen.mean[0] - gaussian_perception(0.5, 0.0, 0.3**2, 0.2**2)[0]) < 1e-12)
    True
    """
    stimuli = np.atleast_1d(np.asarray(s_star, np.float64))
    s, phi = (_grid(ends, nodes) for ends in (s_range, phi_range))
    noise = _evaluated("log_noise", log_noise(phi[:, None], s[None, :]), (nodes, nodes))
    shown = _evaluated("log_noise", log_noise(phi[:, None], stimuli[None, :]), (nodes, len(stimuli)))
    prior = _evaluated("log_prior", log_prior(s), (nodes,))
    prior = prior - logsumexp(prior + _log_weights(s))
    _require_inferable(noise + prior, shown)
    fine = _log_posterior(phi, s, noise, shown, prior)
    coarse = _log_posterior(phi[::2], s[::2], noise[::2, ::2], shown[::2], prior[::2])
    difference = np.abs(np.exp(fine[:, ::2]) - np.exp(coarse)).max(axis=1)
    return Perception(stimuli, s, fine, prior, difference / np.exp(fine.max(axis=1)))


def gaussian_perception(
    s_star: npt.ArrayLike, prior_mean: npt.ArrayLike, prior_variance: npt.ArrayLike, noise_variance: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Mean and variance of p_post for a Gaussian prior and p(phi | s) = Normal(s, noise_variance), in closed form.

    With k = v/(v + n): mean m + k (s* - m), variance k n + k^2 n. The first term is the width of each inference, the second the scatter of
    inferences over repetitions.

    Examples
    --------
    >>> [float(v) for v in gaussian_perception(1.0, 0.0, 1.0, 1.0)]
    [0.5, 0.75]
    """
    mean, prior, noise = (np.asarray(values, np.float64) for values in (prior_mean, prior_variance, noise_variance))
    k = prior / (prior + noise)
    return np.asarray(mean + k * (np.asarray(s_star, np.float64) - mean)), np.asarray(k * noise * (1.0 + k))


def induced_prior(seen: Perception, log_external: npt.ArrayLike) -> FloatArray:
    """Distribution of inferred stimuli, p_prior(s) = integral of p_post(s | s*) p*(s*) over s*, shape (nodes,).

    The stimuli of `seen` are the even grid of this integral and ln p*(s*), shape (stimuli,), is given on it; p* is normalised there.
    Source: Eq. newprior. An observer whose prior is p* itself gets it back.

    Raises
    ------
    InputError
        If the stimuli are not an even, rising grid of at least two.
    """
    steps = np.diff(seen.s_star)
    if not len(steps) or steps[0] <= 0 or not np.allclose(steps, steps[0], rtol=1e-6, atol=0.0):
        raise InputError("the induced prior needs stimuli on an even, rising grid")
    weights = np.asarray(log_external, np.float64) + _log_weights(seen.s_star)
    return np.asarray(np.exp(logsumexp(seen.log_density + (weights - logsumexp(weights))[:, None], axis=0)))


def _log_posterior(phi: FloatArray, s: FloatArray, noise: FloatArray, shown: FloatArray, prior: FloatArray) -> FloatArray:
    """Log p_post, shape (stimuli, nodes), from the noise (phi, s), the noise of the stimuli (phi, stimuli) and the prior (s,)."""
    joint = noise + prior
    evidence = logsumexp(joint + _log_weights(s), axis=1)
    possible = evidence > -np.inf
    inferred = joint[possible] - evidence[possible, None]
    weighted = shown[possible] + _log_weights(phi)[possible, None]
    return np.stack([logsumexp(inferred + weighted[:, [j]], axis=0) for j in range(shown.shape[1])])


def _require_inferable(joint: FloatArray, shown: FloatArray) -> None:
    impossible = joint.max(axis=1) == -np.inf
    if np.any(shown[impossible] > -np.inf):
        raise NumericalError("a stimulus causes activity that has probability 0 under the prior: no posterior exists for it")


def _grid(ends: tuple[float, float], nodes: int) -> FloatArray:
    low, high = ends
    if not (np.isfinite([low, high]).all() and low < high):
        raise InputError(f"range {ends}: allowed are two finite numbers, the lower first")
    if nodes < 5 or nodes % 2 == 0:
        raise InputError(f"nodes={nodes}: allowed is an odd number of at least 5")
    return np.linspace(low, high, nodes)


def _log_weights(grid: FloatArray) -> FloatArray:
    """Logs of the trapezoid weights of an even grid."""
    weights = np.full(len(grid), np.log(grid[1] - grid[0]))
    weights[[0, -1]] -= np.log(2.0)
    return weights


def _evaluated(name: str, values: npt.ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    array = np.broadcast_to(np.asarray(values, np.float64), shape)
    if np.isnan(array).any() or np.any(array == np.inf):
        raise NumericalError(f"{name} returned NaN or +inf")
    return np.asarray(array)
