"""A global proposal for one posterior: Student-t components that adaptive importance sampling has fitted, and two safety nets.

Fitting alternates between drawing from the current proposal and EM steps on the draws of the last rounds, weighted against the
average of the proposals that made them (deterministic-mixture weights, Cornuet et al. 2012). While weights are uneven they are
tempered; where eight components stay poor, sixteen take over.

The nets are a wide Student-t with the posterior's overall mean and spread, and the prior itself. With the prior in the mixture,
importance weights are bounded by the largest likelihood over the prior's share: their variance is finite, their error bars mean
something, and no region that the prior reaches is closed to the sampler.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp

from bayes_toe.diagnostics import pareto_k
from bayes_toe.errors import NumericalError
from bayes_toe.maximum import Maxima, find_maxima
from bayes_toe.mixture import StudentMixture
from bayes_toe.target import Levels, Target

FloatArray = npt.NDArray[np.float64]

_PRIOR_SHARE = 0.01
_COVER_DF, _DF = 3.0, 30.0
_PATCH_SHARE, _PATCHES = 0.01, 8
_HISTORY = 4  # rounds whose draws are pooled


@dataclass(frozen=True)
class Stage:
    """How hard one stage of the adaptation works, and the efficiency that ends it."""

    components: int
    draws: int
    rounds: int
    enough: float
    cover_share: float


#: Most posteriors are good after two or three rounds of the first stage; the second is for funnels and prior-dominated ones.
STAGES = (
    Stage(components=8, draws=2000, rounds=6, enough=0.75, cover_share=0.03),
    Stage(components=16, draws=4000, rounds=10, enough=0.6, cover_share=0.1),
)
_POOR = 0.5  # efficiency below which the second stage runs
_REFITS = 5
_HARD = 2  # times the judging draws, where refits were needed
#: A weight that leads to a refit: a walker stays at such a point for as many steps, so a tail would come in lumps; and where 20,000 draws
#: hold one such point, there are others that they missed, and the evidence is too low by more than its standard error says.
_HEAVY = 6.0
#: Pareto k-hat above which, and efficiency below which, a proposal is not trusted.
TRUSTED_K, TRUSTED_EFFICIENCY = 0.7, 0.02


@dataclass(frozen=True, eq=False)
class Proposal:
    """Density over unconstrained coordinates: shares of the prior, of a wide cover, and the rest of a fitted mixture.

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

    def sample(self, rng: np.random.Generator | np.random.RandomState, size: int) -> ProposalDraws:
        """Independent draws with their densities under the prior and under this proposal; cheaper than one after the other."""
        mark = rng.uniform(size=size)
        y = self.mixture.sample(rng, size)
        from_prior, from_cover = mark < _PRIOR_SHARE, mark > 1.0 - self.cover_share
        y[from_cover] = self.cover.sample(rng, int(from_cover.sum()))
        x, log_volume = self.levelling.unlevel(y)
        x[from_prior] = self.posterior.sample_prior(rng, int(from_prior.sum()))
        y[from_prior], log_volume[from_prior] = self.levelling.level(x[from_prior])
        log_prior = self.posterior.log_prior(x)
        return ProposalDraws(x, log_prior, self.levelled_log_density(y, log_volume, log_prior))


class ProposalDraws(NamedTuple):
    """Draws x, shape (draws, k), their log prior and log proposal densities, each of shape (draws,)."""

    x: FloatArray
    log_prior: FloatArray
    log_proposal: FloatArray


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


def efficiency(log_weights: FloatArray) -> float:
    """Importance-sampling efficiency, (sum w)^2 / (n sum w^2), in 0..1.

    Examples
    --------
    >>> round(efficiency(np.zeros(10)), 12), round(efficiency(np.array([0.0, -np.inf])), 12)
    (1.0, 0.5)
    """
    return float(np.exp(2.0 * logsumexp(log_weights) - logsumexp(2.0 * log_weights)) / len(log_weights))


def importance_draws(proposal: Proposal, rng: np.random.Generator, size: int) -> WeightedDraws:
    """Independent draws from the proposal with everything their weights need.

    Raises
    ------
    NumericalError
        If the log posterior is NaN somewhere.
    """
    x, log_prior, log_proposal = proposal.sample(rng, size)
    log_posterior = proposal.posterior.log_likelihood(x) + log_prior
    if np.isnan(log_posterior).any():
        raise NumericalError(f"subject {proposal.posterior.subject.name!r}: log posterior is NaN")
    return WeightedDraws(x, log_prior, log_posterior, log_proposal)


@dataclass(frozen=True, eq=False)
class FittedProposal:
    """A fitted proposal and what a large independent sample from it says of its quality.

    Attributes
    ----------
    proposal : Proposal
    draws : WeightedDraws
        Made after fitting, independent of it: the evidence and the diagnostics come from these.
    efficiency : float
        Importance-sampling efficiency, 0..1.
    pareto_k : float
        Pareto k-hat of the weights; above 0.7 neither averages nor their error bars can be trusted.
    """

    proposal: Proposal
    draws: WeightedDraws
    efficiency: float
    pareto_k: float

    @property
    def trusted(self) -> bool:
        """Whether the weights behave well enough for importance sampling and for a mostly global sampler."""
        return self.pareto_k < TRUSTED_K and self.efficiency > TRUSTED_EFFICIENCY

    @property
    def heaviest(self) -> float:
        """The largest weight over the mean weight: about the number of steps for which a global sampler can stay at one point."""
        log_weights = self.draws.log_weights
        return float(np.exp(log_weights.max() - logsumexp(log_weights)) * len(log_weights))


def fit_proposal(posterior: Target, rng: np.random.Generator, *, maxima: Maxima | None = None, draws: int = 20_000) -> FittedProposal:
    """Adapt a proposal to a posterior, then judge it on fresh draws; refit on those where they reveal a gap, a few times.

    Parameters
    ----------
    posterior : Target
        A model of one subject.
    rng : numpy.random.Generator
    maxima : Maxima, optional
        Local maxima, where they are known already.
    draws : int
        Size of the judging sample; twice as many where refits were needed.

    Examples
    --------
    >>> from bayes_toe.posterior import Posterior
    >>> from bayes_toe.study import Subject
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> fit_proposal(Posterior(subject), np.random.default_rng(1)).trusted
    True
    """
    found = find_maxima(posterior) if maxima is None else maxima
    history = _adapt(_first(posterior, found, rng), STAGES[0], rng)
    if _best(history).efficiency < _POOR:
        history = _adapt(_refitted(history, STAGES[1]), STAGES[1], rng)
    promised = _best(history).efficiency
    judged = [_judged(_best(history).proposal, rng, draws)]
    if _good(judged[0], promised):
        return judged[0]
    while len(judged) <= _REFITS and not _good(judged[-1], promised):
        judged.append(_judged(_mended(judged[-1], history), rng, draws))
    # Chosen for its draws, a proposal must not be judged by the same draws: the evidence would be biased. Its tails are hard: more draws.
    chosen = judged[-1] if _good(judged[-1], promised) else max(judged, key=lambda fitted: fitted.efficiency)
    return _judged(chosen.proposal, rng, _HARD * draws)


def _mended(fitted: FittedProposal, history: list[_Round]) -> Proposal:
    """A proposal that has learnt from its judging draws what the fitting draws had missed; anew from all of them where it is poor."""
    if fitted.efficiency > _POOR:
        return _patched(fitted.proposal, fitted.draws, *fitted.proposal.levelling.level(fitted.draws.x), _PATCHES)
    history.append(_Round(fitted.proposal, fitted.draws, fitted.efficiency))
    return _refitted(history, STAGES[1])


def _good(fitted: FittedProposal, promised: float) -> bool:
    return fitted.trusted and fitted.efficiency > 0.5 * promised and fitted.heaviest < _HEAVY


def _judged(proposal: Proposal, rng: np.random.Generator, size: int) -> FittedProposal:
    draws = importance_draws(proposal, rng, size)
    return FittedProposal(proposal, draws, efficiency(draws.log_weights), pareto_k(draws.log_weights))


@dataclass(frozen=True, eq=False)
class _Round:
    proposal: Proposal
    draws: WeightedDraws
    efficiency: float


def _adapt(proposal: Proposal, stage: Stage, rng: np.random.Generator) -> list[_Round]:
    """Rounds of drawing and refitting; two more once the efficiency is enough, because they are cheap and sharpen."""
    history: list[_Round] = []
    left = stage.rounds
    while left > 0:
        draws = importance_draws(proposal, rng, stage.draws)
        history.append(_Round(proposal, draws, efficiency(draws.log_weights)))
        left = min(left - 1, 2) if history[-1].efficiency > stage.enough and left > 2 else left - 1
        if left > 0:
            proposal = _refitted(history, stage)
    return history


def _best(history: list[_Round]) -> _Round:
    return max(history, key=lambda entry: entry.efficiency)


def _first(posterior: Target, maxima: Maxima, rng: np.random.Generator) -> Proposal:
    """Prior draws, tempered until two hundred count, and Laplace approximations at proper maxima."""
    levelling = posterior.levelling(maxima.x[maxima.value > maxima.value[0] - 3.0])
    x = posterior.sample_prior(rng, 2 * STAGES[0].draws)
    x = x[np.isfinite(x).all(axis=1)]
    weights = _tempered(posterior.log_likelihood(x), least=200.0)
    y = levelling.level(x)[0]
    cover = _cover(y, weights)
    few = STAGES[0].components // 2
    centres, scales = [y[rng.choice(len(y), few, p=weights)]], [np.repeat(cover.scales / 4.0, few, axis=0)]
    around = STAGES[0].components // len(maxima.x) + 1
    for mode, curvature in zip(maxima.x, maxima.curvature, strict=True):
        if np.linalg.eigvalsh(curvature)[0] > 0.01:  # flatter than ten units: a ridge running to infinity, no use as a scale
            cloud = mode + rng.standard_normal((500, len(mode))) @ np.linalg.inv(np.linalg.cholesky(curvature))
            levelled = levelling.level(cloud)[0]
            centres.append(levelled.mean(axis=0) + 0.7 * (levelled[:around] - levelled.mean(axis=0)))
            scales.append(np.repeat(1.5 * np.cov(levelled.T)[None], around, axis=0))
    means = np.concatenate(centres)
    mixture = StudentMixture(np.full(len(means), 1 / len(means)), means, np.concatenate(scales), _DF)
    return Proposal(posterior, levelling, mixture, cover, STAGES[0].cover_share)


def _cover(y: FloatArray, weights: FloatArray) -> StudentMixture:
    """One wide component: the weighted mean, and twice the weighted spread in every direction."""
    mean = weights @ y
    spread = np.einsum("n,ni,nj->ij", weights, y - mean, y - mean)
    return StudentMixture(np.ones(1), mean[None], 4.0 * spread[None], _COVER_DF)


def _tempered(log_weights: FloatArray, least: float) -> FloatArray:
    """Normalised weights w^beta with the largest beta <= 1 (on a geometric grid) that leaves `least` effective draws."""
    for power in 0.8 ** np.arange(200):
        if efficiency(power * log_weights) * len(log_weights) >= least:
            break
    return np.asarray(np.exp(power * log_weights - logsumexp(power * log_weights)))


def _refitted(history: list[_Round], stage: Stage) -> Proposal:
    """EM on the pooled draws of the last rounds, then new components in the places of those that it dropped."""
    rounds = history[-_HISTORY:]
    x, log_prior, log_posterior = (
        np.concatenate([getattr(entry.draws, key) for entry in rounds]) for key in ("x", "log_prior", "log_posterior")
    )
    last = rounds[-1].proposal
    y, log_volume = last.levelling.level(x)  # one for all rounds of a fit
    made = np.logaddexp.reduce([entry.proposal.levelled_log_density(y, log_volume, log_prior) for entry in rounds]) - np.log(len(rounds))
    weights = _tempered(log_posterior - made, least=0.05 * len(x))
    mixture = last.mixture
    for _ in range(3):
        mixture = mixture.updated(y, weights)
    proposal = Proposal(last.posterior, last.levelling, mixture, _cover(y, weights), stage.cover_share)
    draws = WeightedDraws(x, log_prior, log_posterior, made)
    return _patched(proposal, draws, y, log_volume, stage.components - len(mixture.weights))


def _patched(proposal: Proposal, draws: WeightedDraws, y: FloatArray, log_volume: FloatArray, patches: int) -> Proposal:
    """The proposal with some components more, one after the other where it falls shortest of the posterior (Raftery and Bao 2010).

    y and log_volume are the draws in levelled coordinates.
    """
    mixture, cover = proposal.mixture, proposal.cover
    of_mixture, of_cover = mixture.log_density(y), cover.log_density(y)
    for _ in range(patches):
        short = draws.log_posterior - proposal.combined(of_mixture, of_cover, log_volume, draws.log_prior)
        patch = _patch(y, short, cover)
        mixture = mixture.joined(patch, _PATCH_SHARE)
        of_mixture = np.logaddexp(np.log1p(-_PATCH_SHARE) + of_mixture, np.log(_PATCH_SHARE) + patch.log_density(y))
    return replace(proposal, mixture=mixture)


def _patch(y: FloatArray, short: FloatArray, cover: StudentMixture) -> StudentMixture:
    """A component at the point of the largest shortfall, shaped like the points around it."""
    worst = y[short.argmax()]
    distance = cover.square_distances(y - worst + cover.means[0])[0]
    near = np.argpartition(distance, size := max(100, len(y) // 50))[:size]
    weights = 0.5 * np.exp(short[near] - logsumexp(short[near])) + 0.5 / size
    apart = y[near] - worst
    scale = (weights[:, None] * apart).T @ apart
    return StudentMixture(np.ones(1), worst[None], scale[None], _DF)
