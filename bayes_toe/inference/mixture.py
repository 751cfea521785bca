"""Mixtures of Student-t densities, and weighted draws.

`StudentMixture` is the proposal of every posterior, and `WeightedDraws` are draws of a proposal
with the densities that their weights need.

Two choices make a mixture cheap, and fitting a proposal is mostly this. Points are whitened for all
components by one matrix product. And half the sum of degrees of freedom and dimension is a whole
number, so that each density is a power by multiplication, without a logarithm.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import gammaln, logsumexp

from bayes_toe.arrays import AnyRng, FloatArray, IndexArray

_TINY = 1e-300  # weight of a component that no point comes near
# points done together: with some tens of components the temporary arrays stay in the processor's
# cache
_BLOCK = 1024


@dataclass(frozen=True, eq=False)
class StudentMixture:
    """Mixture of J Student-t components in D dimensions, with common degrees of freedom df.

    df + D is even.

    Examples
    --------
    >>> cauchy = StudentMixture(np.ones(1), np.zeros((1, 1)), np.ones((1, 1, 1)), df=1)
    >>> bool(np.isclose(np.exp(cauchy.log_density(np.zeros((1, 1))))[0], 1 / np.pi))
    True
    """

    weights: FloatArray  # (J,): positive, summing to 1
    means: FloatArray  # (J, D)
    scales: FloatArray  # (J, D, D): scale matrices, not covariances, positive definite
    df: int

    @cached_property
    def _factors(self) -> FloatArray:
        """Cholesky factors of the scales, (J, D, D)."""
        return np.asarray(np.linalg.cholesky(self.scales))

    @cached_property
    def _whiteners(self) -> FloatArray:
        """A matrix, (D J, 1 + D): times (1, x), it is x whitened for each component, over df^(1/2).

        The first J rows are the first coordinate.
        """
        inverse = np.linalg.inv(self._factors)
        shifts = -np.einsum("jab,jb->aj", inverse, self.means)[:, :, None]
        whiteners = np.concatenate([shifts, inverse.transpose(1, 0, 2)], axis=2)
        return whiteners.reshape(-1, whiteners.shape[2]) / np.sqrt(self.df)

    @cached_property
    def _log_tops(self) -> FloatArray:
        """Log of the weighted density at the mean of each component, (J,)."""
        dim = self.means.shape[1]
        log_volume = np.log(np.diagonal(self._factors, axis1=1, axis2=2)).sum(axis=1)
        log_norm = (
            gammaln((self.df + dim) / 2) - gammaln(self.df / 2) - dim / 2 * np.log(self.df * np.pi)
        )
        return np.log(self.weights) + log_norm - log_volume

    @cached_property
    def _tops(self) -> FloatArray:
        """The densities at the means over the highest of them, (J,)."""
        return np.exp(self._log_tops - self._log_tops.max())

    def log_density(self, x: FloatArray) -> FloatArray:
        """Log density at x, shape (N, D) -> (N,)."""
        density = np.empty(len(x))
        for block in _blocks(len(x)):
            density[block] = self._tops @ self._kernel(self._distances(x[block]))
        return np.log(density) + self._log_tops.max()

    def sample_components(self, rng: AnyRng, size: int) -> IndexArray:
        """Random components of the draws, shape (size,)."""
        bounds = np.cumsum(self.weights)[:-1]
        return np.searchsorted(bounds, rng.uniform(size=size), side="right")

    def offset(self, component: IndexArray, normal: FloatArray, rng: AnyRng) -> FloatArray:
        """Draws from these components, shape (size,), by standard normal numbers, (size, D)."""
        stretch = np.sqrt(self.df / rng.chisquare(self.df, size=len(component)))
        offsets = np.einsum("nij,nj->ni", self._factors[component], normal)
        return self.means[component] + offsets * stretch[:, None]

    def em_step(
        self, x: FloatArray, weights: FloatArray, floor: float, inertia: float
    ) -> StudentMixture:
        """One EM step toward points x, shape (N, D), with normalised weights, (N,).

        Every component stays, and shares `floor` with all others. One that holds `inertia`
        effective points goes half the way from its old shape.
        """
        weight, inner_weight, new_means, new_scales = self._sums(x, weights)
        effective = weight * effective_number(weights)
        trust = effective / (effective + inertia)

        means = self.means + trust[:, None] * (new_means - self.means)
        shift_scatter = _outer(new_means - means) * (inner_weight / weight)[:, None, None]
        scales = self.scales + trust[:, None, None] * (new_scales + shift_scatter - self.scales)
        scales += 1e-9 * scales * np.eye(x.shape[1])

        shares = weight + floor / len(means)
        return StudentMixture(shares / shares.sum(), means, scales, self.df)

    def _sums(self, x: FloatArray, weights: FloatArray) -> tuple[FloatArray, ...]:
        """Sums over weighted points for each component.

        The weight, (J,); the same where near points count more, (J,); means of the points, (J, D);
        and their scales about these, (J, D, D).
        """
        dim = x.shape[1]
        n = len(self.means)

        # Moments are counted from the points' mean: a component that is kept is at most 100 of
        # their standard deviations away, and what is subtracted below costs at most that squared in
        # rounding errors, far less than the safeguard adds.
        centre = weights @ x
        weight = np.zeros(n)
        moments = np.zeros((n, 1 + dim + dim * dim))

        for block in _blocks(len(x)):
            u = self._distances(x[block])
            shares = self._tops[:, None] * self._kernel(u)
            shares *= weights[block] / shares.sum(axis=0)
            weight += shares.sum(axis=1)
            y = x[block] - centre
            powers = np.column_stack([np.ones(len(y)), y, _outer(y).reshape(len(y), -1)])
            moments += (shares / u) @ powers

        moments *= (self.df + dim) / self.df
        weight = np.maximum(weight, _TINY)
        inner_weight = np.maximum(moments[:, 0], _TINY)
        offsets = moments[:, 1 : dim + 1] / inner_weight[:, None]
        around = moments[:, dim + 1 :].reshape(-1, dim, dim)
        scales = (around - inner_weight[:, None, None] * _outer(offsets)) / weight[:, None, None]
        return weight, inner_weight, centre + offsets, scales

    def joined(self, other: StudentMixture, share: float) -> StudentMixture:
        """This mixture with another one, of the same degrees of freedom, which takes a share."""
        return StudentMixture(
            np.concatenate([(1.0 - share) * self.weights, share * other.weights]),
            np.concatenate([self.means, other.means]),
            np.concatenate([self.scales, other.scales]),
            self.df,
        )

    def _distances(self, x: FloatArray) -> FloatArray:
        """1 + (squared Mahalanobis distance) / df to every component, shape (J, N)."""
        dim = x.shape[1]
        points = np.empty((dim + 1, len(x)))
        points[0] = 1.0
        points[1:] = x.T
        white = (self._whiteners @ points).reshape(dim, -1, len(x))
        return np.einsum("djn,djn->jn", white, white) + 1.0

    def _kernel(self, u: FloatArray) -> FloatArray:
        """The density over that at the mean, from :meth:`_distances`."""
        return 1.0 / _power(u, (self.df + self.means.shape[1]) // 2)


def _blocks(size: int) -> list[slice]:
    return [slice(i, i + _BLOCK) for i in range(0, size, _BLOCK)]


def _power(u: FloatArray, exponent: int) -> FloatArray:
    """Whole power, at least 1, by repeated squaring.

    A few multiplications, where numpy's own power takes a logarithm.
    """
    if exponent == 1:
        return u
    half = _power(u, exponent // 2)
    return half * half * u if exponent % 2 else half * half


def _outer(vectors: FloatArray) -> FloatArray:
    return vectors[:, :, None] * vectors[:, None, :]


@dataclass(frozen=True, eq=False)
class WeightedDraws:
    """Draws with the log densities that their weights need, each of shape (draws,)."""

    x: FloatArray  # (draws, k)
    log_prior: FloatArray
    log_posterior: FloatArray
    log_proposal: FloatArray

    @property
    def columns(self) -> tuple[FloatArray, ...]:
        """The four arrays, in their order."""
        return self.x, self.log_prior, self.log_posterior, self.log_proposal

    @property
    def log_weights(self) -> FloatArray:
        """Log of posterior over proposal density, unnormalised, shape (draws,)."""
        return self.log_posterior - self.log_proposal

    @cached_property
    def shares(self) -> FloatArray:
        """The same as numbers that sum to 1."""
        log_weights = self.log_weights
        weights = np.exp(log_weights - log_weights.max())
        return weights / weights.sum()

    @property
    def effective_number(self) -> float:
        """Effective number of draws."""
        return effective_number(self.shares)

    @property
    def efficiency(self) -> float:
        """Efficiency of importance sampling, (sum w)^2 / (n sum w^2), 0 to 1."""
        return self.effective_number / len(self.x)

    @cached_property
    def log_evidence(self) -> float:
        """Log of the mean weight, which estimates the evidence."""
        return float(logsumexp(self.log_weights) - np.log(len(self.x)))

    @property
    def standard_error(self) -> float:
        """Standard error of the mean weight, relative to it."""
        # 1/(effective number) - 1/size without its cancellation.
        deviations = self.shares - 1.0 / len(self.x)
        return float(np.linalg.norm(deviations))

    def resampled(self, rng: AnyRng, size: int) -> FloatArray:
        """Draws by their shares, so of equal weight, shape (size, k)."""
        return self.x[rng.choice(len(self.x), size, p=self.shares)]

    def joined(self, other: WeightedDraws) -> WeightedDraws:
        """These draws, then other ones."""
        return WeightedDraws(*map(np.concatenate, zip(self.columns, other.columns, strict=True)))

    def part(self, rows: slice) -> WeightedDraws:
        """Some of the draws, without a copy."""
        return WeightedDraws(*(column[rows] for column in self.columns))


def effective_number(weights: FloatArray) -> float:
    """Effective number of weights, (sum w)^2 / sum w^2."""
    return float(weights.sum() ** 2 / (weights @ weights))


def tempered(log_weights: FloatArray, least: float) -> FloatArray:
    """Normalised weights w^beta.

    beta is the largest number up to 1, on a geometric grid, that leaves `least` effective draws.
    """
    below = log_weights - log_weights.max()
    for power in 0.8 ** np.arange(200):
        weights = np.exp(power * below)
        if effective_number(weights) >= least:
            break
    return weights / weights.sum()
