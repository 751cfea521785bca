"""The density from which importance samples of one posterior are drawn.

`Proposal` is a sum of three parts: a Student-t mixture that is fitted to the posterior, a wider
mixture (the cover) for its tails, and the prior. `importance_draws` makes `WeightedDraws` from it,
and `FittedProposal` has both with their quality.

The cover, a few Student-t components fitted to the posterior flattened by a power, shows long thin
tails that hold little mass. With the prior in the mixture, importance weights are bounded by the
largest likelihood over the prior's share. So their variance is finite, their error bars mean
something, and the sampler reaches every region that the prior reaches. How the mixture is fitted:
:mod:`bayes_toe.inference.adaptation`.

Two choices make the mixture cheap, and fitting a proposal is mostly this. Points are whitened for
all components by one matrix product. And half the sum of degrees of freedom and dimension is a
whole number, so that each density is a power by multiplication, without a logarithm.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import gammaln, logsumexp

from bayes_toe.arrays import AnyRng, FloatArray, IndexArray
from bayes_toe.model.posterior import SampledPosterior, Transform, require_defined

_LEAST_SHARE = 1e-4  # of a component
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
    _factors: FloatArray = field(init=False, repr=False)
    _whiteners: FloatArray = field(
        init=False, repr=False
    )  # times 1 and the coordinates: D x J whitened ones over df^(1/2)
    _tops: FloatArray = field(
        init=False, repr=False
    )  # of the components' densities, over the highest
    _log_highest: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        dim = self.means.shape[1]
        if (self.df + dim) % 2:
            raise ValueError(f"df={self.df} and dimension {dim}: their sum must be even")
        factors = np.linalg.cholesky(self.scales)
        log_volume = np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
        log_norm = (
            gammaln((self.df + dim) / 2) - gammaln(self.df / 2) - dim / 2 * np.log(self.df * np.pi)
        )
        log_tops = np.log(self.weights) + log_norm - log_volume
        inverse = np.linalg.inv(factors)
        shifts = -np.einsum("jab,jb->aj", inverse, self.means)[:, :, None]
        whiteners = np.concatenate(
            [shifts, inverse.transpose(1, 0, 2)], axis=2
        )  # dimension by dimension
        for key, value in {
            "_factors": factors,
            "_whiteners": whiteners.reshape(-1, 1 + dim) / np.sqrt(self.df),
            "_tops": np.exp(log_tops - log_tops.max()),
            "_log_highest": float(log_tops.max()),
        }.items():
            object.__setattr__(self, key, value)

    def log_density(self, x: FloatArray) -> FloatArray:
        """Log density at x, shape (N, D) -> (N,)."""
        density = np.empty(len(x))
        for block in _blocks(len(x)):
            density[block] = self._tops @ self._kernel(self._distances(x[block]))
        return np.log(density) + self._log_highest

    def sample(self, rng: AnyRng, size: int) -> FloatArray:
        """Draws, shape (size, D); works with numpy's old and new generators."""
        component = self.sample_components(rng, size)
        return self.offset(component, rng.standard_normal((size, self.means.shape[1])), rng)

    def sample_components(self, rng: AnyRng, size: int) -> IndexArray:
        """Random components of the draws, shape (size,)."""
        bounds = np.cumsum(self.weights)[:-1]
        return np.searchsorted(bounds, rng.uniform(size=size), side="right")

    def offset(self, component: IndexArray, normal: FloatArray, rng: AnyRng) -> FloatArray:
        """Draws from these components, shape (size,), by standard normal numbers, (size, D)."""
        stretch = np.sqrt(self.df / rng.chisquare(self.df, size=len(component)))
        offsets = np.einsum("nij,nj->ni", self._factors[component], normal)
        return self.means[component] + offsets * stretch[:, None]

    def updated(self, x: FloatArray, weights: FloatArray) -> StudentMixture:
        """One EM step toward points x, shape (N, D), with normalised weights, (N,).

        Components that no longer hold any weight are dropped.
        """
        dim = x.shape[1]
        sums = self._sums(x, weights)
        # A component needs some points of its own for a covariance: the effective number behind its
        # share.
        has_points = (sums.weight > _LEAST_SHARE) & (sums.weight**2 > 3 * dim * sums.squares)
        if not has_points.any():
            return self
        weight, means = sums.weight[has_points], sums.means[has_points]
        scales = sums.scales[has_points]
        centre = weights @ x
        spread = weights @ np.square(x - centre)
        # A thousandth of the overall spread is added, so that no component collapses onto a few
        # points.
        return StudentMixture(
            weight / weight.sum(), means, scales + 1e-3 * np.diag(spread), self.df
        )

    def drawn_toward(
        self, x: FloatArray, weights: FloatArray, floor: float, inertia: float
    ) -> StudentMixture:
        """The same step for few points: every component stays, and shares `floor` with all others.

        A component that holds `inertia` effective points goes half the way from its old shape.
        """
        sums = self._sums(x, weights)
        effective = sums.weight * effective_number(weights)
        trust = effective / (effective + inertia)
        means = self.means + trust[:, None] * (sums.means - self.means)
        moved = _outer(sums.means - means) * (sums.pulls / sums.weight)[:, None, None]
        change = sums.scales + moved - self.scales
        scales = self.scales + trust[:, None, None] * change
        scales += 1e-9 * scales * np.eye(x.shape[1])
        shares = sums.weight + floor / len(means)
        return StudentMixture(shares / shares.sum(), means, scales, self.df)

    def _sums(self, x: FloatArray, weights: FloatArray) -> _Sums:
        """The sums over weighted points for each component."""
        dim, n = x.shape[1], len(self.means)
        # Moments are counted from the points' mean: a component that is kept is at most 100 of
        # their standard deviations away, and what is subtracted below costs at most that squared in
        # rounding errors, far less than the safeguard adds.
        centre = weights @ x
        weight, squares = np.zeros(n), np.zeros(n)
        moments = np.zeros((n, 1 + dim + dim * dim))
        for block in _blocks(len(x)):
            u = self._distances(x[block])
            shares = self._tops[:, None] * self._kernel(u)
            shares *= weights[block] / shares.sum(axis=0)
            weight += shares.sum(axis=1)
            squares += np.einsum("jn,jn->j", shares, shares)
            y = x[block] - centre
            powers = np.column_stack([np.ones(len(y)), y, _outer(y).reshape(len(y), -1)])
            moments += (shares / u) @ powers
        moments *= (self.df + dim) / self.df
        weight, pulls = np.maximum(weight, _TINY), np.maximum(moments[:, 0], _TINY)
        offsets = moments[:, 1 : dim + 1] / pulls[:, None]
        around = moments[:, dim + 1 :].reshape(-1, dim, dim)
        scales = (around - pulls[:, None, None] * _outer(offsets)) / weight[:, None, None]
        return _Sums(weight, squares, pulls, centre + offsets, scales)

    def joined(self, mixtures: Sequence[StudentMixture], share: float) -> StudentMixture:
        """This mixture with others of the same degrees of freedom.

        Each takes a share of what was before it.
        """
        n_left = np.arange(len(mixtures), -1, -1)
        shares = (1.0 - share) ** n_left * [1.0, *[share] * len(mixtures)]
        parts = [self, *mixtures]
        weights = [
            part.weights * part_share for part, part_share in zip(parts, shares, strict=True)
        ]
        return StudentMixture(
            np.concatenate(weights),
            np.concatenate([part.means for part in parts]),
            np.concatenate([part.scales for part in parts]),
            self.df,
        )

    @property
    def covariance(self) -> FloatArray:
        """Covariance, shape (D, D); df is above 2."""
        offsets = self.means - self.weights @ self.means
        second = self.scales * (self.df / (self.df - 2)) + _outer(offsets)
        return np.einsum("j,jab->ab", self.weights, second)

    def _distances(self, x: FloatArray) -> FloatArray:
        """1 + (squared Mahalanobis distance) / df to every component, shape (J, N)."""
        dim = x.shape[1]
        points = np.empty((dim + 1, len(x)))
        points[0] = 1.0
        points[1:] = x.T
        white = (self._whiteners @ points).reshape(dim, -1, len(x))
        return np.einsum("djn,djn->jn", white, white) + 1.0

    def _kernel(self, u: FloatArray) -> FloatArray:
        return 1.0 / _power(u, (self.df + self.means.shape[1]) // 2)


class _Sums(NamedTuple):
    """Sums over weighted points for each of J components."""

    weight: FloatArray  # (J,)
    squares: FloatArray  # (J,): sum of squared weights
    pulls: FloatArray  # (J,): weight where near points count more
    means: FloatArray  # (J, D): of the points
    scales: FloatArray  # (J, D, D): of the points about these means


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


#: Pareto k-hat above which, and efficiency below which, a proposal is not trusted.
TRUSTED_K, TRUSTED_EFFICIENCY = 0.7, 0.02
_PRIOR_SHARE = 0.01


@dataclass(frozen=True, eq=False)
class Proposal:
    """Density over unconstrained coordinates: a fitted mixture, with shares of prior and cover.

    Mixture and cover live in the coordinates of the transform, in which the posterior has no
    funnel.
    """

    posterior: SampledPosterior
    transform: Transform
    mixture: StudentMixture
    cover: StudentMixture
    cover_share: float

    def log_density(self, x: FloatArray, log_prior: FloatArray) -> FloatArray:
        """Log density at x, (points, k) -> (points,), where the prior has this log density."""
        return self.transformed_log_density(*self.transform.forward(x), log_prior)

    def transformed_log_density(
        self, y: FloatArray, log_volume: FloatArray, log_prior: FloatArray
    ) -> FloatArray:
        """The same where the coordinates y and log |dy/dx| are known already."""
        return self.combined(
            self.mixture.log_density(y), self.cover.log_density(y), log_volume, log_prior
        )

    def combined(
        self,
        of_mixture: FloatArray,
        of_cover: FloatArray,
        log_volume: FloatArray,
        log_prior: FloatArray,
    ) -> FloatArray:
        """Log density from those of mixture and cover, in the coordinates y, and of the prior."""
        fitted = np.logaddexp(
            np.log1p(-_PRIOR_SHARE - self.cover_share) + of_mixture,
            np.log(self.cover_share) + of_cover,
        )
        return np.logaddexp(fitted + log_volume, np.log(_PRIOR_SHARE) + log_prior)


@dataclass(frozen=True, eq=False)
class WeightedDraws:
    """Draws with the log densities that their weights need, each of shape (draws,)."""

    x: FloatArray  # (draws, k)
    log_prior: FloatArray
    log_posterior: FloatArray
    log_proposal: FloatArray

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

    def part(self, rows: slice) -> WeightedDraws:
        """Some of the draws, without a copy."""
        return WeightedDraws(
            self.x[rows],
            self.log_prior[rows],
            self.log_posterior[rows],
            self.log_proposal[rows],
        )


def joined_draws(parts: Iterable[WeightedDraws]) -> WeightedDraws:
    """The draws of all parts, in order."""
    columns = [(part.x, part.log_prior, part.log_posterior, part.log_proposal) for part in parts]
    return WeightedDraws(*map(np.concatenate, zip(*columns, strict=True)))


def efficiency(log_weights: FloatArray) -> float:
    """Importance-sampling efficiency, (sum w)^2 / (n sum w^2), in 0..1."""
    return effective_number(np.exp(log_weights - log_weights.max())) / len(log_weights)


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


def importance_draws(proposal: Proposal, rng: AnyRng, size: int) -> WeightedDraws:
    """Independent draws from the proposal with everything their weights need."""
    target = proposal.posterior
    mark = rng.uniform(size=size)
    y = proposal.mixture.sample(rng, size)
    from_prior, from_cover = mark < _PRIOR_SHARE, mark > 1.0 - proposal.cover_share
    y[from_cover] = proposal.cover.sample(rng, int(from_cover.sum()))
    x, log_volume = proposal.transform.inverse(y)
    x[from_prior] = target.sample_prior(rng, int(from_prior.sum()))
    y[from_prior], log_volume[from_prior] = proposal.transform.forward(x[from_prior])
    log_prior = target.log_prior(x)
    # From y, which is cheaper than from x.
    log_proposal = proposal.transformed_log_density(y, log_volume, log_prior)
    log_posterior = target.log_likelihood(x) + log_prior
    require_defined(log_posterior, target)
    return WeightedDraws(x, log_prior, log_posterior, log_proposal)


@dataclass(frozen=True, eq=False)
class FittedProposal:
    """A fitted proposal and what a large sample from it, made after fitting, says of its quality.

    If these draws decided which of several proposals it is, they are not `independent`. An evidence
    from them would be biased, because the proposal was chosen for its good draws. A sampler may
    start from them. See :func:`bayes_toe.inference.adaptation.with_fresh_draws`.
    """

    proposal: Proposal
    draws: WeightedDraws
    efficiency: float  # of importance sampling, 0..1
    # of the weights; above 0.7 neither averages nor their error bars can be trusted
    pareto_k: float
    independent: bool = True

    @property
    def trusted(self) -> bool:
        """Whether the weights suffice for importance sampling and a mostly global sampler."""
        return self.pareto_k < TRUSTED_K and self.efficiency > TRUSTED_EFFICIENCY

    @property
    def heaviest(self) -> float:
        """The largest weight over the mean weight.

        About the number of steps for which a global sampler can stay at one point.
        """
        log_weights = self.draws.log_weights
        return float(len(log_weights) / np.exp(log_weights - log_weights.max()).sum())
