"""A global proposal for one posterior: a Student-t mixture, a cover with wide tails and the prior; draws from it, and their weights.

The cover, a few Student-t components fitted to the posterior flattened by a power, shows long thin tails that hold little mass. With the
prior in the mixture, importance weights are bounded by the largest likelihood over the prior's share: their variance is finite, their error
bars mean something, and no region that the prior reaches is closed to the sampler. How the mixture is fitted:
:mod:`bayes_toe.inference.adaptation`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.inference.mixture import StudentMixture
from bayes_toe.model.distributions import Random
from bayes_toe.model.target import Levels, Target, require_defined

#: Pareto k-hat above which, and efficiency below which, a proposal is not trusted.
TRUSTED_K, TRUSTED_EFFICIENCY = 0.7, 0.02
_PRIOR_SHARE = 0.01


@dataclass(frozen=True, eq=False)
class Proposal:
    """Density over unconstrained coordinates: shares of the prior, of a cover with wide tails, and the rest of a fitted mixture.

    Mixture and cover live in levelled coordinates, in which the posterior has no funnel.
    """

    posterior: Target
    levelling: Levels
    mixture: StudentMixture
    cover: StudentMixture
    cover_share: float

    def log_density(self, x: FloatArray, log_prior: FloatArray) -> FloatArray:
        """Log density at x, shape (points, k) -> (points,); log_prior is the prior's log density there."""
        return self.levelled_log_density(*self.levelling.level(x), log_prior)

    def levelled_log_density(self, y: FloatArray, log_volume: FloatArray, log_prior: FloatArray) -> FloatArray:
        """The same where the levelled coordinates y and log |dy/dx| are known already."""
        return self.combined(self.mixture.log_density(y), self.cover.log_density(y), log_volume, log_prior)

    def combined(self, of_mixture: FloatArray, of_cover: FloatArray, log_volume: FloatArray, log_prior: FloatArray) -> FloatArray:
        """Log density where mixture, cover (both in levelled coordinates) and prior have these log densities."""
        fitted = np.logaddexp(np.log1p(-_PRIOR_SHARE - self.cover_share) + of_mixture, np.log(self.cover_share) + of_cover)
        return np.asarray(np.logaddexp(fitted + log_volume, np.log(_PRIOR_SHARE) + log_prior))


@dataclass(frozen=True, eq=False)
class WeightedDraws:
    """Draws from one proposal with the log densities that their weights need, each of shape (draws,)."""

    x: FloatArray
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
        return np.asarray(weights / weights.sum())

    def part(self, which: slice) -> WeightedDraws:
        """Some of them, without a copy."""
        return WeightedDraws(self.x[which], self.log_prior[which], self.log_posterior[which], self.log_proposal[which])


def efficiency(log_weights: FloatArray) -> float:
    """Importance-sampling efficiency, (sum w)^2 / (n sum w^2), in 0..1.

    Examples
    --------
    >>> round(efficiency(np.zeros(10)), 12), round(efficiency(np.array([0.0, -np.inf])), 12)
    (1.0, 0.5)
    """
    return float(effective_number(np.exp(log_weights - log_weights.max())) / len(log_weights))


def effective_number(weights: FloatArray) -> float:
    """Effective number of weights, (sum w)^2 / sum w^2."""
    return float(weights.sum() ** 2 / (weights @ weights))


def importance_draws(proposal: Proposal, rng: Random, size: int) -> WeightedDraws:
    """Independent draws from the proposal with everything their weights need.

    Raises
    ------
    NumericalError
        If the log posterior is NaN somewhere.
    """
    target, mark, y = proposal.posterior, rng.uniform(size=size), proposal.mixture.sample(rng, size)
    from_prior, from_cover = mark < _PRIOR_SHARE, mark > 1.0 - proposal.cover_share
    y[from_cover] = proposal.cover.sample(rng, int(from_cover.sum()))
    x, log_volume = proposal.levelling.unlevel(y)
    x[from_prior] = target.sample_prior(rng, int(from_prior.sum()))
    y[from_prior], log_volume[from_prior] = proposal.levelling.level(x[from_prior])
    log_prior = target.log_prior(x)
    log_proposal = proposal.levelled_log_density(y, log_volume, log_prior)  # cheaper than to begin with x
    log_posterior = target.log_likelihood(x) + log_prior
    require_defined(log_posterior, target)
    return WeightedDraws(x, log_prior, log_posterior, log_proposal)


@dataclass(frozen=True, eq=False)
class FittedProposal:
    """A fitted proposal and what a large independent sample from it says of its quality.

    Attributes
    ----------
    proposal : Proposal
    draws : WeightedDraws
        Made after fitting; the diagnostics come from these.
    efficiency : float
        Importance-sampling efficiency, 0..1.
    pareto_k : float
        Pareto k-hat of the weights; above 0.7 neither averages nor their error bars can be trusted.
    independent : bool
        Whether the draws are independent of the fit. Where they had a say in which of several proposals it is, an evidence from them
        would be biased, because those were taken that look good; for the start of a sampler they serve. See
        :func:`bayes_toe.inference.adaptation.with_fresh_draws`.
    """

    proposal: Proposal
    draws: WeightedDraws
    efficiency: float
    pareto_k: float
    independent: bool = True

    @property
    def trusted(self) -> bool:
        """Whether the weights behave well enough for importance sampling and for a mostly global sampler."""
        return self.pareto_k < TRUSTED_K and self.efficiency > TRUSTED_EFFICIENCY

    @property
    def heaviest(self) -> float:
        """The largest weight over the mean weight: about the number of steps for which a global sampler can stay at one point."""
        log_weights = self.draws.log_weights
        return float(len(log_weights) / np.exp(log_weights - log_weights.max()).sum())
