"""Draws of a group's joint posterior, and a stated rule for stopping."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.groups.hamiltonian import Hamiltonian
from bayes_toe.groups.joint import Joint
from bayes_toe.groups.scatter import Root, pairs
from bayes_toe.groups.subjects import population_moments
from bayes_toe.inference.diagnostics import Convergence, convergence_of, shortfall, worst

_CHAINS = ((32, 16), (64, 8))  # up to so many subjects, so many chains
_FEWEST = 4
MAX_R_HAT = 1.01
_NOT_MIXED = 1.1  # an R-hat above which draws are burn-in
_FIRST, _MORE, MOST = 1.5, 1.15, 24  # draws for each effective one: at first, beyond what seems to be enough, at most
LIMIT = 40_000  # draws that may be made in any case
CORRELATION = "correlation"
_APART = 2.0  # how many times farther apart than the posterior would have them chains start

#: Quantity ("mean", "sd", "effect", "correlation"), place of the regressor or of the other parameter (-1: none), and of the parameter.
Key: TypeAlias = tuple[str, int, int]


@dataclass(frozen=True, eq=False)
class GroupChains:
    """Draws of hyperparameters and of every subject; r regressors, N subjects, k parameters on their group scales.

    Attributes
    ----------
    mean, scatter : array, shape (chains, draws, k)
    effects : array, shape (chains, draws, r, k)
    eta : array, shape (chains, draws, N, k)
    z : array, shape (chains, draws, c)
        Coordinates of the correlations of a subject's parameters, see :mod:`bayes_toe.groups.scatter`; c is 0 without.
    convergence : dict of Key to Convergence
        Of hyperparameters.
    subject_convergence : array, shape (N, k, 3)
        Bulk and tail effective draws and R-hat of every subject's parameters.
    divergent : int
        Trajectories that were given up.
    reason : str
        What was not reached; empty where converged.
    gradients : int
        Gradients of single chains that all of it took.
    """

    mean: FloatArray
    scatter: FloatArray
    effects: FloatArray
    eta: FloatArray
    z: FloatArray
    convergence: dict[Key, Convergence]
    subject_convergence: FloatArray
    divergent: int = 0
    reason: str = ""
    gradients: int = 0

    @cached_property
    def root(self) -> FloatArray:
        """Cholesky factors of the correlations, of scores within a subject, shape (chains, draws, k, k)."""
        (*lead, k) = self.mean.shape
        return Root.at(self.z.reshape(int(np.prod(lead)), -1), k).factor.reshape(*lead, k, k)

    @cached_property
    def correlation(self) -> FloatArray:
        """Correlations of parameters between subjects, shape (chains, draws, k, k)."""
        return self.root @ self.root.swapaxes(-1, -2)

    @property
    def correlated(self) -> tuple[tuple[int, int], ...]:
        """Pairs of parameters that may be."""
        return pairs(self.mean.shape[2])[: self.z.shape[2]]

    @property
    def converged(self) -> bool:
        """Whether everything was reached."""
        return not self.reason

    def named(self, names: Sequence[str], subjects: Sequence[str]) -> dict[str, Convergence]:
        """Every diagnostic, by the name of what it is of."""
        found = {
            f"the {kind} of {f'{names[other]} and ' if kind == CORRELATION else ''}{names[k]}": one
            for (kind, other, k), one in self.convergence.items()
        }
        for subject, rows in zip(subjects, self.subject_convergence.tolist(), strict=True):
            found |= {f"{name} of {subject!r}": Convergence(*row) for name, row in zip(names, rows, strict=True)}
        return found


def chain_count(subjects: int) -> int:
    """Chains in step: many where one gradient costs much the same as a dozen, fewer where subjects are many.

    Each costs its warm-up, and its share of the draws from which an R-hat below 1.01 can be told.

    Examples
    --------
    >>> chain_count(16), chain_count(60), chain_count(200)
    (16, 8, 4)
    """
    return next((chains for most, chains in _CHAINS if subjects <= most), _FEWEST)


def sample_group(joint: Joint, names: Sequence[str], subjects: Sequence[str], draws: int, rng: np.random.Generator) -> GroupChains:
    """Draw until all hyperparameters and every subject's parameters have so many effective draws and an R-hat below 1.01, or to a limit.

    Each pass adds as many draws as the last look says are missing. Where chains have not mixed at all, what was drawn so far is burn-in.

    Parameters
    ----------
    joint : Joint
        For :func:`chain_count` points.
    names, subjects : sequence of str
        Of parameters and subjects, for words.
    draws : int
        Bulk and tail effective draws to reach.
    """
    chains = chain_count(len(subjects))
    sampler = Hamiltonian(joint, *_start(joint, chains, rng), joint.size, rng)
    sampler.warm_up()
    x, divergent, more = np.empty((0, chains, joint.dimension)), 0, int(np.ceil(_FIRST * draws / chains))
    while True:
        trace = sampler.advance(more)
        x, divergent = np.concatenate([x, trace.x]), divergent + int(trace.divergent.sum())
        found = replace(_chains(joint, x), divergent=divergent, gradients=sampler.gradients)
        known = found.named(names, subjects)
        reason, ((_, ess), (_, r_hat)) = shortfall(known, draws, MAX_R_HAT), worst(known)
        if not reason or sampler.draws * chains >= max(LIMIT, MOST * draws):
            return replace(found, reason=reason)
        if r_hat >= _NOT_MIXED:
            x, more = x[:0], 2 * len(x)
        else:
            missing = _MORE * draws / max(ess, 1.0) - 1.0 if r_hat < MAX_R_HAT else 1.0
            more = int(np.ceil(len(x) * max(0.25, min(1.0, missing))))


def _start(joint: Joint, chains: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Points about the population that the subjects' answers suggest, (chains, D), and about the standard deviation of each coordinate."""
    scales, (n, k) = np.ones(joint.dimension), joint.approximation.location.shape
    scales[k : 2 * k] = (2.0 * n) ** -0.5  # of what tells of scatters it goes with the number of subjects
    scales[k * (2 + joint.x.shape[1]) : joint.size] = n**-0.5
    theta = rng.standard_normal((chains, joint.dimension)) * scales
    theta[:, : joint.size] *= _APART
    theta[:, k : 2 * k] += np.log(population_moments(joint.without_funnel, joint.hyperprior)[1])
    return theta, scales


def _chains(joint: Joint, x: FloatArray) -> GroupChains:
    """Draws (draws, chains, D) with their diagnostics."""
    (n, k), lead = joint.approximation.location.shape, (x.shape[1], len(x))
    flat = np.ascontiguousarray(x.transpose(1, 0, 2)).reshape(-1, joint.dimension)
    hyper, of_all = joint.split(flat)
    eta = of_all.reshape(*lead, n, k)
    mean, scatter = hyper.mean.reshape(*lead, k), np.exp(hyper.log_scatter).reshape(*lead, k)
    effects, z = hyper.effects.reshape(*lead, -1, k), hyper.z.reshape(*lead, -1)
    judged = convergence_of({f"{i}, {j}": eta[:, :, i, j] for i in range(n) for j in range(k)})
    of_subjects = np.array(list(judged.values())).reshape(n, k, 3)
    return with_convergence(GroupChains(mean, scatter, effects, eta, z, {}, of_subjects))


def with_convergence(found: GroupChains) -> GroupChains:
    """The same with diagnostics of means, scatters, effects and correlations."""
    draws = dict[Key, FloatArray]()
    for j in range(found.mean.shape[2]):
        draws |= {("mean", -1, j): found.mean[..., j], ("sd", -1, j): found.scatter[..., j]}
        draws |= {("effect", i, j): found.effects[..., i, j] for i in range(found.effects.shape[2])}
    draws |= {(CORRELATION, j, i): found.correlation[..., i, j] for j, i in found.correlated}
    judged = convergence_of({repr(key): values for key, values in draws.items()})
    return replace(found, convergence=dict(zip(draws, judged.values(), strict=True)))
