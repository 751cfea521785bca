"""The population from the subjects' own posteriors, by weighting their draws anew: exact only where enough draws count.

    log L(phi) = sum_i log mean_s [posterior_is / proposal_is  g(eta_is | phi) / pi0(eta_is)],

with draws s of subject i from its proposal, its own prior pi0 and the population's density g. With N_i(phi) draws that count, of S,

    v(phi) = sum_i (1/N_i(phi) - 1/S)

is the variance of log L, whose bias is about -v/2. Where the scatter is far below what single subjects' answers tell, a few draws make the
whole likelihood, and its noise looks like a signal: above v = 1 there is no answer, above 0.1 none to be trusted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import emcee
import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.errors import NumericalError
from bayes_toe.groups.alone import Alone
from bayes_toe.groups.chains import GroupChains, judged, shortfall
from bayes_toe.groups.hyperprior import HyperpriorNumbers
from bayes_toe.groups.joint import Joint
from bayes_toe.groups.shared import Shared, log_hyperprior, split_shared
from bayes_toe.groups.starting import starts
from bayes_toe.model.distributions import LOG_2PI
from bayes_toe.seeds import stream

#: Independent draws of each subject that are weighted.
WEIGHTED = 5000
TRUSTED, HOPELESS = 0.1, 1.0  # variances of the log likelihood
_ENSEMBLES, _WALKERS, _THIN = 4, 32, 8
_BURN_IN, _STEPS, _MOST_STEPS = 200, 50, 800  # steps before, steps kept of a first pass, and of a last one


@dataclass(frozen=True, eq=False)
class Reweighted:
    """Log density of what is shared, (m, log tau, beta), given all answers; of a normal population.

    Parameters
    ----------
    members : sequence of Alone
    x : array, shape (N, r)
        Regressors.
    hyperprior : HyperpriorNumbers
    """

    members: Sequence[Alone]
    x: FloatArray
    hyperprior: HyperpriorNumbers

    def log_density(self, phi: FloatArray) -> FloatArray:
        """At points, (points, k (2 + r)) -> (points,)."""
        shared = self.shared(phi)
        found = log_hyperprior(shared, self.hyperprior)[0]
        for i, one in enumerate(self.members):
            weights, top = self._weights(i, shared)
            found += top + np.log(weights.sum(axis=0) / len(one.eta))
        return found

    def shared(self, phi: FloatArray) -> Shared:
        """What is shared, of points, (points, k (2 + r))."""
        return split_shared(phi, len(self.hyperprior.mean), self.x.shape[1])

    def variance(self, phi: FloatArray) -> FloatArray:
        """V of the log likelihood, member by member, (points, k (2 + r)) -> (points, N)."""
        shared = self.shared(phi)
        weights = (self._weights(i, shared)[0] for i in range(len(self.members)))
        return np.stack([np.square(one).sum(axis=0) / np.square(one.sum(axis=0)) - 1.0 / len(one) for one in weights], axis=1)

    def eta(self, phi: FloatArray, rng: np.random.Generator) -> FloatArray:
        """A draw of every member given what is shared, (points, k (2 + r)) -> (points, N, k)."""
        shared, found = self.shared(phi), []
        for i, one in enumerate(self.members):
            sums = np.cumsum(self._weights(i, shared)[0], axis=0)
            at = (sums < rng.uniform(size=len(phi)) * sums[-1]).sum(axis=0)
            found.append(one.eta[at])
        return np.stack(found, axis=1)

    def _weights(self, i: int, shared: Shared) -> tuple[FloatArray, FloatArray]:
        """Posterior over proposal times g over pi0 of a member's draws, (draws, points), over the largest, and the log of this one.

        The log of g is a quadratic form in eta.
        """
        one, expected = self.members[i], shared.expected(self.x[i : i + 1])[:, 0]
        precision = np.exp(-2.0 * shared.log_scatter)
        constant = -(0.5 * np.square(expected) * precision + shared.log_scatter + 0.5 * LOG_2PI).sum(axis=1)
        log_weights = (
            np.concatenate([one.eta, -0.5 * np.square(one.eta)], axis=1) @ np.concatenate([expected * precision, precision], axis=1).T
        )
        log_weights += (one.log_weights - one.log_prior)[:, None]
        top = log_weights.max(axis=0)
        log_weights -= top
        return np.exp(log_weights, out=log_weights), top + constant


def reweight_group(density: Reweighted, joint: Joint, names: Sequence[str], draws: int, seed: int) -> GroupChains:
    """Draws of what is shared by emcee, and of members given it; judged as :func:`bayes_toe.groups.chains.sample_group` does.

    Raises
    ------
    NumericalError
        If the draws of a subject are too few for the population: v above 1.
    """
    ensembles = [_ensemble(density, joint, stream(seed, "population", "reweight", i)) for i in range(_ENSEMBLES)]
    steps, members = _STEPS, [one.name for one in density.members]
    while True:
        phi = np.stack([_advanced(one, steps) for one in ensembles])
        flat = phi.reshape(-1, phi.shape[2])
        trust = _trust(density, flat[:: max(1, len(flat) // 256)], members)
        eta = density.eta(flat, np.random.default_rng(stream(seed, "population", "members")))
        found = judged(density.shared(flat), eta.reshape(*phi.shape[:2], len(members), len(names)))
        reason = shortfall(*found.worst(names, members), draws)
        if steps >= _MOST_STEPS or not reason:
            return replace(found, reason="; ".join(part for part in (trust, reason) if part))
        steps *= 2


def _ensemble(density: Reweighted, joint: Joint, seeds: np.random.SeedSequence) -> Any:
    """An emcee ensemble that has left its starts, by differential evolution alone.

    Against integration, tails are too thin with emcee 3.1's DESnookerMove, which takes half the log of the ratio of distances, and too
    thick with its KDEMove.
    """
    random = np.random.RandomState(np.random.MT19937(seeds))
    shared, _ = joint.split(starts(joint, _WALKERS, np.random.default_rng(seeds)))
    start = np.concatenate([part.reshape(_WALKERS, -1) for part in shared], axis=1)
    moves = emcee.moves.DEMove()
    sampler = emcee.EnsembleSampler(_WALKERS, joint.size, density.log_density, vectorize=True, moves=moves)
    sampler.random_state = random.get_state()
    sampler.run_mcmc(start, _BURN_IN, store=True)
    return sampler


def _advanced(sampler: Any, steps: int) -> FloatArray:
    """So many draws of each walker from where the ensemble is, walker after walker, (walkers x steps, D)."""
    state = sampler._previous_state
    sampler.reset()
    sampler.run_mcmc(state, steps, thin_by=_THIN)
    chain = sampler.get_chain()
    return np.asarray(chain.transpose(1, 0, 2).reshape(-1, chain.shape[2]))


def _trust(density: Reweighted, phi: FloatArray, members: Sequence[str]) -> str:
    """What is to be said of the variance of the log likelihood; empty where it is small."""
    of_members = density.variance(phi).mean(axis=0)
    v, worst = float(of_members.sum()), members[int(of_members.argmax())]
    if v < TRUSTED:
        return ""
    said = f"the log likelihood of the population has a variance of {v:.2g}, below {TRUSTED:g} required, most of it from {worst!r}"
    if v > HOPELESS:
        raise NumericalError(f"method 'reweight': {said}: too few of its own draws are where the population is; allowed: method 'joint'")
    return said
