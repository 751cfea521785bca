"""Fitting of a proposal to a posterior: adaptive importance sampling.

`fit_proposal` adapts a proposal to a posterior and judges it by fresh draws; `adapt_proposal` does
the adapting alone. `refreshed` adapts a proposal to a few more answers, and `with_trusted_draws`
adds draws for an evidence.

Fitting alternates between drawing from the current proposal and EM steps on the draws of the last
rounds, weighted against the average of the proposals that made them (deterministic-mixture weights,
Cornuet et al. 2012). While weights are uneven they are tempered. If the efficiency stays low, the
fit goes on with more draws and more components.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np
from scipy.special import logsumexp

from bayes_toe.arrays import FloatArray, Rng
from bayes_toe.inference.diagnostics import pareto_k
from bayes_toe.inference.maxima import Maxima, find_maxima
from bayes_toe.inference.proposal import (
    FittedProposal,
    Proposal,
    StudentMixture,
    WeightedDraws,
    efficiency,
    importance_draws,
    joined_draws,
    tempered,
)
from bayes_toe.model.posterior import SampledPosterior

#: With what a fit may begin.
Start: TypeAlias = Maxima | FittedProposal | None
# Degrees of freedom; one more in an odd number of dimensions, because the sum of both is even.
_COVER_DF = 4
_DF = 8
_COVERS = 4  # components of the cover
_FLAT = 0.3  # the power by which the posterior is flattened for them
_PATCH_SHARE, _PATCHES = 0.01, 8
_HISTORY = 4  # rounds whose draws are pooled
_LARGE = 4000  # draws of the round after these, which shows more of the tails


@dataclass(frozen=True)
class Stage:
    """The effort of one stage of the adaptation, and the efficiency that ends it."""

    components: int
    draws: int
    rounds: int
    least_efficiency: float
    cover_share: float


#: Most posteriors are good after two or three rounds of the first stage; the second is for funnels
#: and prior-dominated ones.
STAGES = (
    Stage(components=12, draws=1000, rounds=8, least_efficiency=0.75, cover_share=0.05),
    Stage(components=24, draws=4000, rounds=10, least_efficiency=0.6, cover_share=0.1),
)
_POOR = 0.5  # efficiency below which the second stage runs
_REFITS = 5
_HARD = 2  # times the judging draws, where refits were needed
#: Independent draws behind an evidence, unless more are asked for.
EVIDENCE_DRAWS = 20_000
#: A weight that leads to a refit: a walker stays at such a point for as many steps, so a tail would
#: come in lumps; and where 20,000 draws hold one such point, there are others that they missed, and
#: the evidence is too low by more than its standard error says.
_HEAVY = 6.0
_CALM = 0.5  # Pareto k-hat above which other draws may well have one that is not trusted


def fit_proposal(
    posterior: SampledPosterior,
    rng: Rng,
    *,
    start: Start = None,
    draws: int = 20_000,
) -> FittedProposal:
    """Adapt a proposal to a posterior and judge it by draws that are independent of it.

    There are `draws` of them, or twice as many if refits were needed. The fit may start from known
    maxima. It may also start from a proposal that was fitted to a similar posterior, and its draws
    with the densities of this posterior. The proposal is then refitted to these draws before the
    first round, and no maxima are searched for.
    """
    return with_fresh_draws(adapt_proposal(posterior, rng, start=start, draws=draws), rng)


def adapt_proposal(
    posterior: SampledPosterior,
    rng: Rng,
    *,
    start: Start = None,
    draws: int = 20_000,
) -> FittedProposal:
    """:func:`fit_proposal` without its last step.

    The proposal is judged by fresh draws. If these reveal a gap, it is refitted to them, a few
    times at most. A sampler needs no more. An evidence needs draws that the fit has not used.
    """
    stage = STAGES[0]
    if start is None:
        start = find_maxima(posterior)
    if isinstance(start, Maxima):
        proposal = _first(posterior, start, rng)
    else:
        proposal = _refitted([start], stage)
    history = _adapt(proposal, stage, rng)
    if max(entry.efficiency for entry in history) < _POOR:
        stage = STAGES[1]
        history = _adapt(_refitted(history[-_HISTORY:], stage), stage, rng)
    best = max(entry.efficiency for entry in history)
    sharper = _round(_refitted(history[-_HISTORY:], stage), rng, _LARGE)
    candidates = [_assessed(_refitted([sharper], stage, _PATCHES), rng, draws)]
    while len(candidates) <= _REFITS and not _is_good(candidates[-1], best):
        candidates.append(_assessed(_refitted(candidates[-1:], stage, _PATCHES), rng, draws))
    chosen = candidates[-1]
    if not _is_good(chosen, best):
        chosen = max(candidates, key=lambda fitted: fitted.efficiency)
    return replace(chosen, independent=len(candidates) == 1)


def with_fresh_draws(fitted: FittedProposal, rng: Rng) -> FittedProposal:
    """The proposal with draws that are independent of it.

    If the draws that it has are not independent, twice as many new ones replace them: refits were
    needed, so the tails are difficult.
    """
    if fitted.independent:
        return fitted
    return _assessed(fitted.proposal, rng, _HARD * len(fitted.draws.x))


def redrawn(fitted: FittedProposal, rng: Rng, size: int) -> FittedProposal:
    """The same proposal with so many new draws."""
    return _assessed(fitted.proposal, rng, size)


def with_trusted_draws(fitted: FittedProposal, rng: Rng) -> FittedProposal:
    """The proposal with independent draws whose weights can be trusted, if there is one.

    If its own weights cannot be trusted, it is refitted to its draws. If that does not help, it is
    fitted anew. At least 20,000 draws judge either fit. If neither can be trusted, the result is
    the first proposal.
    """
    first = with_fresh_draws(fitted, rng)
    if first.trusted:
        return first
    size = max(EVIDENCE_DRAWS, _HARD * len(first.draws.x))
    for start in (first, None):
        refit = fit_proposal(first.proposal.posterior, rng, start=start, draws=size)
        if refit.trusted:
            return refit
    return first


def refreshed(
    fitted: FittedProposal,
    posterior: SampledPosterior,
    log_posterior: FloatArray,
    rng: Rng,
) -> FittedProposal:
    """A proposal for a posterior like the one that it was fitted to.

    It comes from one round of EM on the old draws, and has new draws, which tell how good it is.
    `log_posterior` has the log density of the new posterior at the old draws, shape (draws,). The
    centre and the prior are the same. This saves most of the work of a fit if only a few answers
    were added.
    """
    proposal = replace(fitted.proposal, posterior=posterior)
    draws = replace(fitted.draws, log_posterior=log_posterior)
    start = replace(fitted, proposal=proposal, draws=draws)
    return _assessed(_refitted([start], STAGES[0]), rng, len(draws.x))


def _is_good(fitted: FittedProposal, promised: float) -> bool:
    return (
        fitted.pareto_k < _CALM
        and fitted.trusted
        and fitted.efficiency > 0.5 * promised
        and fitted.heaviest < _HEAVY
    )


def _assessed(proposal: Proposal, rng: Rng, size: int) -> FittedProposal:
    sample = _round(proposal, rng, size)
    k_hat = pareto_k(sample.draws.log_weights)
    return FittedProposal(proposal, sample.draws, sample.efficiency, k_hat)


class _Round(NamedTuple):
    proposal: Proposal
    draws: WeightedDraws
    efficiency: float


def _round(proposal: Proposal, rng: Rng, size: int) -> _Round:
    draws = importance_draws(proposal, rng, size)
    return _Round(proposal, draws, efficiency(draws.log_weights))


def _adapt(proposal: Proposal, stage: Stage, rng: Rng) -> list[_Round]:
    """Rounds of drawing and refitting, until the efficiency is enough."""
    history = [_round(proposal, rng, stage.draws)]
    while len(history) < stage.rounds and history[-1].efficiency < stage.least_efficiency:
        history.append(_round(_refitted(history[-_HISTORY:], stage), rng, stage.draws))
    return history


def _first(posterior: SampledPosterior, maxima: Maxima, rng: Rng) -> Proposal:
    """Tempered prior draws, of which two hundred count, and a cloud at each proper maximum."""
    stage = STAGES[0]
    transform = posterior.transform(maxima.x[maxima.value > maxima.value[0] - 3.0])
    x = posterior.sample_prior(rng, 2 * stage.draws)
    x = x[np.isfinite(x).all(axis=1)]
    weights = tempered(posterior.log_likelihood(x), least=200.0)
    y = transform.forward(x)[0]
    spread = _covariance(y, weights)
    n_prior = stage.components // 2
    means = [y[rng.choice(len(y), n_prior, p=weights)]]
    scales = [_repeated(spread, n_prior)]
    n_each = stage.components // len(maxima.x) + 1
    for mode, curvature in zip(maxima.x, maxima.curvature, strict=True):
        # Flatter than ten units is a ridge that runs to infinity, no use as a scale.
        if np.linalg.eigvalsh(curvature)[0] <= 0.01:
            continue
        factor = np.linalg.inv(np.linalg.cholesky(curvature))
        cloud = transform.forward(mode + rng.standard_normal((500, len(mode))) @ factor)[0]
        centre = cloud.mean(axis=0)
        means.append(centre + 0.7 * (cloud[:n_each] - centre))
        scales.append(_repeated(1.5 * _covariance(cloud), n_each))
    mixture = _equal_weights(np.concatenate(means), np.concatenate(scales), _DF)
    wide = y[rng.choice(len(y), _COVERS, p=weights)]
    cover = _equal_weights(wide, _repeated(4.0 * spread, _COVERS), _COVER_DF)
    return Proposal(posterior, transform, mixture, cover, stage.cover_share)


def _repeated(scale: FloatArray, times: int) -> FloatArray:
    """One scale for each of so many components."""
    return np.repeat(scale[None], times, axis=0)


def _equal_weights(means: FloatArray, scales: FloatArray, least_df: int) -> StudentMixture:
    """A mixture of components of equal weight."""
    n_components, k = means.shape
    weights = np.full(n_components, 1.0 / n_components)
    return StudentMixture(weights, means, scales, _even(least_df, k))


def _covariance(y: FloatArray, weights: FloatArray | None = None) -> FloatArray:
    """The covariance of points, shape (N, D) -> (D, D), also where D is 1."""
    return np.atleast_2d(np.cov(y.T, aweights=weights, ddof=1 if weights is None else 0))


def _refitted(
    rounds: Sequence[_Round | FittedProposal], stage: Stage, patches: int = 0
) -> Proposal:
    """EM on the pooled draws of rounds of one size, then new components.

    These are so many, or as many as EM dropped if these are more.
    """
    draws = joined_draws(entry.draws for entry in rounds)
    last = rounds[-1].proposal
    y, log_volume = last.transform.forward(draws.x)  # one for all rounds of a fit
    densities = [
        entry.proposal.transformed_log_density(y, log_volume, draws.log_prior) for entry in rounds
    ]
    log_proposal = np.logaddexp.reduce(densities) - np.log(len(rounds))
    draws = replace(draws, log_proposal=log_proposal)
    flattened = _FLAT * (draws.log_posterior - log_volume) - (log_proposal - log_volume)
    weights = tempered(draws.log_weights, least=0.05 * len(y))
    flat = tempered(flattened, least=0.02 * len(y))
    mixture, cover = last.mixture, last.cover
    for _ in range(3):
        mixture, cover = mixture.updated(y, weights), cover.updated(y, flat)
    proposal = Proposal(last.posterior, last.transform, mixture, cover, stage.cover_share)
    return _patched(
        proposal, draws, y, log_volume, max(patches, stage.components - len(mixture.weights))
    )


def _patched(
    proposal: Proposal, draws: WeightedDraws, y: FloatArray, log_volume: FloatArray, patches: int
) -> Proposal:
    """The proposal with more components, each where it falls shortest of the posterior.

    Source: Raftery and Bao 2010. y and log_volume are the draws in nearly normal coordinates.
    """
    of_mixture, of_cover = proposal.mixture.log_density(y), proposal.cover.log_density(y)
    white = y @ np.linalg.inv(np.linalg.cholesky(proposal.cover.covariance)).T
    components: list[StudentMixture] = []
    size = max(100, len(y) // 50)
    for _ in range(patches):
        log_proposal = proposal.combined(of_mixture, of_cover, log_volume, draws.log_prior)
        shortfall = draws.log_posterior - log_proposal
        worst = shortfall.argmax()
        # A component there, shaped like the points around it.
        offsets = white - white[worst]
        distance = np.einsum("nd,nd->n", offsets, offsets)
        near = np.argpartition(distance, size)[:size]
        shares = np.exp(shortfall[near] - logsumexp(shortfall[near]))
        weights = 0.5 * shares + 0.5 / size
        around = y[near] - y[worst]
        scale = (weights[:, None] * around).T @ around
        df = _even(_DF, y.shape[1])
        component = StudentMixture(np.ones(1), y[worst][None], scale[None], df)
        components.append(component)
        of_component = np.log(_PATCH_SHARE) + component.log_density(y)
        of_mixture = np.logaddexp(np.log1p(-_PATCH_SHARE) + of_mixture, of_component)
    return replace(proposal, mixture=proposal.mixture.joined(components, _PATCH_SHARE))


def _even(least: int, dim: int) -> int:
    return least + (least + dim) % 2
