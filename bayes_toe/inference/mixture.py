"""Mixtures of Student-t densities, and weighted draws.

`StudentMixture` is the proposal of every posterior, and `WeightedDraws` are draws of a proposal
with the densities that their weights need.

Most of the time of a fit goes to the density of a mixture. Two choices make it fast. One matrix
product whitens points for all components. And half the sum of degrees of freedom and dimension is a
whole number, so that each density is a power by multiplication, without a logarithm.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import gammaln, logsumexp, softmax

from bayes_toe.arrays import AnyRng, FloatArray, IndexArray

_TINY = 1e-300  # weight of a component that no point comes near
_BLOCK = 1024  # points at a time, so that temporary arrays stay in the processor's cache


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
        """The matrix that whitens points x for all components at once, (D J, 1 + D).

        Its product with (1, x) is L^-1 (x - mean) / df^(1/2), L the Cholesky factor of a component:
        the first coordinate for each of the J components, then the second one, and so on.
        """
        inverse = np.linalg.inv(self._factors)  # (J, D, D)
        white_means = np.einsum("jab,jb->aj", inverse, self.means)[:, :, None]  # (D, J, 1)
        whiteners = np.concatenate([-white_means, inverse.transpose(1, 0, 2)], axis=2)
        # From (D, J, 1 + D).
        return whiteners.reshape(-1, whiteners.shape[2]) / np.sqrt(self.df)

    @cached_property
    def _log_tops(self) -> FloatArray:
        """Log of the weighted density at the mean of each component, (J,).

        That is w Gamma((df + D)/2) / (Gamma(df/2) (df pi)^(D/2) |scale|^(1/2)).
        """
        dim = self.means.shape[1]
        # The root of the determinant of a scale is the product of the diagonal of its factor.
        log_volume = np.log(np.diagonal(self._factors, axis1=1, axis2=2)).sum(axis=1)
        log_norm = (
            gammaln((self.df + dim) / 2) - gammaln(self.df / 2) - dim / 2 * np.log(self.df * np.pi)
        )
        return np.log(self.weights) + log_norm - log_volume

    @cached_property
    def _tops(self) -> FloatArray:
        """The weighted densities at the means, over the highest of them, (J,)."""
        return np.exp(self._log_tops - self._log_tops.max())

    def log_density(self, x: FloatArray) -> FloatArray:
        """Log density at x, shape (N, D) -> (N,)."""
        density = np.empty(len(x))  # over the highest top
        for block in _blocks(len(x)):
            density[block] = self._tops @ self._kernel(self._density_bases(x[block]))
        return np.log(density) + self._log_tops.max()

    def sample_components(self, rng: AnyRng, size: int) -> IndexArray:
        """Random components by their weights, shape (size,)."""
        # Bounds between the components; the last sum is 1 but for rounding, and bounds nothing.
        bounds = np.cumsum(self.weights)[:-1]
        return np.searchsorted(bounds, rng.uniform(size=size), side="right")

    def draws_from(self, component: IndexArray, normal: FloatArray, rng: AnyRng) -> FloatArray:
        """Draws from these components, (size,), by standard normal numbers, (size, D).

        The draws have the shape (size, D). A Student-t vector is a normal one times
        (df / chi-square)^(1/2).
        """
        stretch = np.sqrt(self.df / rng.chisquare(self.df, size=len(component)))
        deviations = np.einsum("nij,nj->ni", self._factors[component], normal)
        return self.means[component] + deviations * stretch[:, None]

    def em_step(
        self, x: FloatArray, weights: FloatArray, floor: float, inertia: float
    ) -> StudentMixture:
        """One EM step toward points x, shape (N, D), with normalised weights, (N,).

        All components share the further weight `floor` equally, so none disappears. A component
        goes from its old shape toward the new one, half of the way if it holds as many effective
        points as `inertia`.
        """
        component_weight, scale_weight, new_means, new_scales = self._em_moments(x, weights)
        n_effective = component_weight * effective_number(weights)  # points of each component
        way = n_effective / (n_effective + inertia)  # the share of the way to the new shape

        means = self.means + way[:, None] * (new_means - self.means)
        # The new scales are about the new means. The means go only a part of the way there, and the
        # rest of the way adds to the scales. A scale divides a sum with weights of `scale_weight`
        # by `component_weight`.
        shift_scatter = _outer(new_means - means) * (scale_weight / component_weight)[:, None, None]
        scales = self.scales + way[:, None, None] * (new_scales + shift_scatter - self.scales)
        scales += 1e-9 * scales * np.eye(x.shape[1])  # positive definite in spite of rounding

        shares = component_weight + floor / len(means)
        return StudentMixture(shares / shares.sum(), means, scales, self.df)

    def _em_moments(self, x: FloatArray, weights: FloatArray) -> tuple[FloatArray, ...]:
        """Sums over points x, (N, D), of each component, as EM for Student-t densities has them.

        A point with the weight w, for which a component has the share r of the density, counts

            w r                          for the weight of the component,
            w r (df + D) / (df + d^2)    for its mean and scale, d the Mahalanobis distance.

        Returns the two sums of these numbers, `component_weight` and `scale_weight`, (J,) each; the
        means by the second sum, (J, D); and the scales about these means, (J, D, D).
        """
        dim = x.shape[1]
        n = len(self.means)
        component_weight = np.zeros(n)
        # Moments of order 0, 1 and 2 side by side, (J, 1 + D + D^2), about the mean of all points.
        # No component is so far from it that the subtraction below loses as much as `em_step` adds
        # to a scale.
        centre = weights @ x
        moments = np.zeros((n, 1 + dim + dim * dim))

        for block in _blocks(len(x)):
            bases = self._density_bases(x[block])
            shares = self._tops[:, None] * self._kernel(bases)  # (J, points)
            shares *= weights[block] / shares.sum(axis=0)  # w r
            component_weight += shares.sum(axis=1)
            y = x[block] - centre
            powers = np.column_stack([np.ones(len(y)), y, _outer(y).reshape(len(y), -1)])
            moments += (shares / bases) @ powers

        # `bases` are 1 + d^2 / df, so that a factor of (df + D) / df is left.
        moments *= (self.df + dim) / self.df
        component_weight = np.maximum(component_weight, _TINY)
        order_0, order_1, order_2 = np.split(moments, [1, 1 + dim], axis=1)
        scale_weight = np.maximum(order_0[:, 0], _TINY)
        from_centre = order_1 / scale_weight[:, None]
        # About the mean of the component, not about the centre.
        scatter = order_2.reshape(-1, dim, dim) - scale_weight[:, None, None] * _outer(from_centre)
        return (
            component_weight,
            scale_weight,
            centre + from_centre,
            scatter / component_weight[:, None, None],
        )

    def joined(self, other: StudentMixture, share: float) -> StudentMixture:
        """This mixture with another mixture of the same degrees of freedom, which gets `share`."""
        return StudentMixture(
            np.concatenate([(1.0 - share) * self.weights, share * other.weights]),
            np.concatenate([self.means, other.means]),
            np.concatenate([self.scales, other.scales]),
            self.df,
        )

    def _density_bases(self, x: FloatArray) -> FloatArray:
        """1 + (squared Mahalanobis distance) / df to every component, shape (J, N).

        The density of the component is proportional to a negative power of this base. The whiteners
        subtract the mean of each component and divide by df^(1/2).
        """
        dim = x.shape[1]
        points = np.empty((dim + 1, len(x)))  # columns (1, x)
        points[0] = 1.0
        points[1:] = x.T
        white = (self._whiteners @ points).reshape(dim, -1, len(x))  # (D, J, N)
        return np.einsum("djn,djn->jn", white, white) + 1.0

    @np.errstate(over="ignore")  # the density of a point that is far away is 0
    def _kernel(self, bases: FloatArray) -> FloatArray:
        """The density over the density at the mean, from :meth:`_density_bases`."""
        return 1.0 / _power(bases, (self.df + self.means.shape[1]) // 2)


def _blocks(size: int) -> list[slice]:
    """Slices of at most `_BLOCK` rows that cover `size` rows."""
    return [slice(i, i + _BLOCK) for i in range(0, size, _BLOCK)]


def _power(base: FloatArray, exponent: int) -> FloatArray:
    """A whole power, at least the first power, by repeated squaring.

    It takes a few multiplications, where numpy's own power takes a logarithm.
    """
    if exponent == 1:
        return base
    half = _power(base, exponent // 2)
    return half * half * base if exponent % 2 else half * half


def _outer(vectors: FloatArray) -> FloatArray:
    """The matrix v v' of each vector, (n, d) -> (n, d, d)."""
    return vectors[:, :, None] * vectors[:, None, :]


@dataclass(frozen=True, eq=False)
class WeightedDraws:
    """Draws with the log densities that their weights need, shape (draws,) each."""

    x: FloatArray  # (draws, k)
    log_prior: FloatArray
    log_posterior: FloatArray
    log_proposal: FloatArray

    @property
    def columns(self) -> tuple[FloatArray, ...]:
        """The points and the three log densities, in the order of the attributes."""
        return self.x, self.log_prior, self.log_posterior, self.log_proposal

    @property
    def log_weights(self) -> FloatArray:
        """Log of posterior over proposal density, unnormalised, shape (draws,)."""
        return self.log_posterior - self.log_proposal

    @cached_property
    def shares(self) -> FloatArray:
        """The weights, divided by their sum, shape (draws,)."""
        return np.asarray(softmax(self.log_weights))

    @property
    def effective_number(self) -> float:
        """Effective number of draws, see :func:`effective_number`."""
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
        """Standard error of the log evidence: the relative standard error of the mean weight.

        Its square is 1/(effective number) - 1/(number of draws), here without cancellation.
        """
        deviations = self.shares - 1.0 / len(self.x)
        return float(np.linalg.norm(deviations))

    def resampled(self, rng: AnyRng, size: int) -> FloatArray:
        """Draws of equal weight, shape (size, k), chosen by their shares; a draw may come again."""
        return self.x[rng.choice(len(self.x), size, p=self.shares)]

    def joined(self, other: WeightedDraws) -> WeightedDraws:
        """These draws, followed by other draws."""
        pairs = zip(self.columns, other.columns, strict=True)
        return WeightedDraws(*map(np.concatenate, pairs))

    def part(self, rows: slice) -> WeightedDraws:
        """Some of the draws, as views of the arrays."""
        return WeightedDraws(*(column[rows] for column in self.columns))


def effective_number(weights: FloatArray) -> float:
    """Effective number of weights, (sum w)^2 / sum w^2."""
    return float(weights.sum() ** 2 / (weights @ weights))


def flattened_weights(log_weights: FloatArray, least: float) -> FloatArray:
    """Weights to a power beta that leaves at least `least` effective draws, divided by their sum.

    beta is the first of 1, 0.8, 0.8^2 and so on.
    """
    below_largest = log_weights - log_weights.max()  # the largest weight becomes 1, no overflow
    for beta in 0.8 ** np.arange(200):  # the last beta is 1e-19: all weights are equal
        weights = np.exp(beta * below_largest)
        if effective_number(weights) >= least:
            break
    return weights / weights.sum()
