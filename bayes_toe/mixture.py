"""A mixture of multivariate Student-t densities: evaluate, draw, and fit to weighted points by EM."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.special import gammaln

FloatArray = npt.NDArray[np.float64]
_BLOCK = 512  # points done together: with some tens of components the temporary arrays stay in the processor's cache


@dataclass(frozen=True, eq=False)
class StudentMixture:
    """Mixture of J Student-t components in D dimensions.

    Parameters
    ----------
    weights : array, shape (J,)
        Positive, summing to 1.
    means : array, shape (J, D)
    scales : array, shape (J, D, D)
        Scale matrices (not covariances), positive definite.
    df : float
        Degrees of freedom, common to all components.

    Examples
    --------
    >>> one = StudentMixture(np.ones(1), np.zeros((1, 1)), np.ones((1, 1, 1)), df=1.0)
    >>> bool(np.isclose(np.exp(one.log_density(np.zeros((1, 1))))[0], 1 / np.pi))
    True
    """

    weights: FloatArray
    means: FloatArray
    scales: FloatArray
    df: float
    _factors: FloatArray = field(init=False, repr=False)
    _whiteners: FloatArray = field(init=False, repr=False)
    _log_tops: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        factors = np.linalg.cholesky(self.scales)
        dim = self.means.shape[1]
        log_volume = np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
        log_norm = gammaln((self.df + dim) / 2) - gammaln(self.df / 2) - dim / 2 * np.log(self.df * np.pi)
        object.__setattr__(self, "_factors", factors)
        object.__setattr__(self, "_whiteners", np.linalg.inv(factors))
        object.__setattr__(self, "_log_tops", np.log(self.weights) + log_norm - log_volume)

    def log_density(self, x: FloatArray) -> FloatArray:
        """Log density at x, shape (N, D) -> (N,)."""
        blocks = [x[i : i + _BLOCK] for i in range(0, max(1, len(x)), _BLOCK)]
        return np.concatenate([_log_sum(self._log_terms(self.square_distances(block))) for block in blocks])

    def sample(self, rng: np.random.Generator | np.random.RandomState, size: int) -> FloatArray:
        """Draws, shape (size, D); works with numpy's old and new generators."""
        which = np.searchsorted(np.cumsum(self.weights)[:-1], rng.uniform(size=size), side="right")
        normal = rng.standard_normal((size, self.means.shape[1]))
        stretch = np.sqrt(self.df / rng.chisquare(self.df, size=size))
        return np.asarray(self.means[which] + np.einsum("nij,nj->ni", self._factors[which], normal) * stretch[:, None])

    def updated(self, x: FloatArray, weights: FloatArray) -> StudentMixture:
        """One EM step toward the density that points x, shape (N, D), with normalised weights (N,) stand for.

        Components that no longer hold any weight are dropped.
        """
        distances = self.square_distances(x)
        log_terms = self._log_terms(distances)
        shares = np.exp(log_terms - _log_sum(log_terms)) * weights
        held = shares.sum(axis=1)
        # A component needs some points of its own for a covariance: the effective number behind its share.
        effective = held**2 / np.maximum((shares**2).sum(axis=1), 1e-300)
        kept = (held > 1e-4) & (effective > 3 * x.shape[1])
        if not kept.any():
            return self
        shares, held = shares[kept], held[kept]
        heavy = shares * (self.df + x.shape[1]) / (self.df + distances[kept])
        means = heavy @ x / heavy.sum(axis=1)[:, None]
        apart = x[None] - means[:, None]
        scales = (heavy[:, None] * apart.transpose(0, 2, 1)) @ apart / held[:, None, None]
        return StudentMixture(held / held.sum(), means, _safeguarded(scales, x, weights), self.df)

    def joined(self, other: StudentMixture, share: float) -> StudentMixture:
        """This mixture with another one of the same degrees of freedom taking a share of it."""
        return StudentMixture(
            np.concatenate([self.weights * (1.0 - share), other.weights * share]),
            np.concatenate([self.means, other.means]),
            np.concatenate([self.scales, other.scales]),
            self.df,
        )

    def square_distances(self, x: FloatArray) -> FloatArray:
        """Squared Mahalanobis distance to every component, shape (J, N)."""
        # Points on the last axis: numpy sums over the few dimensions many points at a time, not point by point.
        apart = np.ascontiguousarray(x.T) - self.means[:, :, None]
        return np.asarray(np.square(self._whiteners @ apart).sum(axis=1))

    def _log_terms(self, distances: FloatArray) -> FloatArray:
        dim = self.means.shape[1]
        return np.asarray(self._log_tops[:, None] - (self.df + dim) / 2 * np.log1p(distances / self.df))


def _log_sum(log_terms: FloatArray) -> FloatArray:
    """Log of the sum of exp(log_terms) over the first axis; terms are finite. scipy's is slower on small arrays, which these are."""
    top = log_terms.max(axis=0)
    return np.asarray(top + np.log(np.exp(log_terms - top).sum(axis=0)))


def _safeguarded(scales: FloatArray, x: FloatArray, weights: FloatArray) -> FloatArray:
    """Scale matrices with a thousandth of the overall spread added, so that none collapses onto a few points."""
    mean = weights @ x
    spread = weights @ np.square(x - mean)
    return np.asarray(scales + 1e-3 * np.diag(spread))
