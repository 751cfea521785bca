"""Draws of a group's joint posterior, and a stated rule for stopping."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.groups.correlations import Root, pairs
from bayes_toe.groups.hamiltonian import Hamiltonian
from bayes_toe.groups.joint import Joint
from bayes_toe.groups.shared import Shared
from bayes_toe.groups.starting import scales, starts
from bayes_toe.inference.diagnostics import Convergence, convergence

_CHAINS = ((32, 16), (64, 8))  # up to so many members, so many chains
_FEWEST = 4
MAX_R_HAT = 1.01
_NOT_MIXED = 1.1  # an R-hat above which draws are burn-in
_FIRST, _MORE, _MOST = 1.5, 1.15, 24  # draws for each effective one: at first, beyond what seems to be enough, at most
_LIMIT = 40_000  # draws that may be made in any case
CORRELATION = "correlation"

#: Quantity ("mean", "sd", "effect", "correlation"), place of the regressor or of the other parameter (-1: none), and of the parameter.
Key: TypeAlias = tuple[str, int, int]


@dataclass(frozen=True, eq=False)
class GroupChains:
    """Draws of what is shared and of every member; r regressors, N members, k parameters on their group scales.

    Attributes
    ----------
    mean, scatter : array, shape (chains, draws, k)
    effects : array, shape (chains, draws, r, k)
    eta : array, shape (chains, draws, N, k)
    z : array, shape (chains, draws, c)
        Coordinates of the correlations of a member's parameters, see :mod:`bayes_toe.groups.correlations`; c is 0 without.
    shared : dict of Key to Convergence
        Of what is shared.
    members : array, shape (N, k, 3)
        Bulk and tail effective draws and R-hat of every member's parameters.
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
    shared: dict[Key, Convergence]
    members: FloatArray
    divergent: int = 0
    reason: str = ""
    gradients: int = 0

    @cached_property
    def root(self) -> FloatArray:
        """Cholesky factors of the correlations, of scores within a member, shape (chains, draws, k, k)."""
        (*lead, k) = self.mean.shape
        return Root.at(self.z.reshape(int(np.prod(lead)), -1), k).factor.reshape(*lead, k, k)

    @cached_property
    def correlation(self) -> FloatArray:
        """Correlations of parameters between members, shape (chains, draws, k, k)."""
        return self.root @ self.root.swapaxes(-1, -2)

    @property
    def correlated(self) -> tuple[tuple[int, int], ...]:
        """Pairs of parameters that may be."""
        return pairs(self.mean.shape[2])[: self.z.shape[2]]

    @property
    def converged(self) -> bool:
        """Whether everything was reached."""
        return not self.reason

    def worst(self, names: Sequence[str], members: Sequence[str]) -> tuple[tuple[str, float], tuple[str, float]]:
        """What has the fewest effective draws, bulk or tail, and how many; what has the largest R-hat, and which. NaN is worst."""
        found = {_words(key, names): one for key, one in self.shared.items()}
        for member, rows in zip(members, self.members.tolist(), strict=True):
            found |= {f"{name} of {member!r}": Convergence(*row) for name, row in zip(names, rows, strict=True)}
        ess = {name: float(np.nan_to_num(np.min(one[:2]))) for name, one in found.items()}
        r_hat = {name: float(np.nan_to_num(one.r_hat, nan=np.inf)) for name, one in found.items()}
        lowest, highest = min(ess, key=ess.__getitem__), max(r_hat, key=r_hat.__getitem__)
        return (lowest, ess[lowest]), (highest, r_hat[highest])


def _words(key: Key, names: Sequence[str]) -> str:
    kind, other, one = key
    return f"the {kind} of {names[other]} and {names[one]}" if kind == CORRELATION else f"the {kind} of {names[one]}"


def chain_count(members: int) -> int:
    """Chains in step: many where one gradient costs much the same as a dozen, fewer where members are many.

    Each costs its warm-up, and its share of the draws from which an R-hat below 1.01 can be told.

    Examples
    --------
    >>> chain_count(16), chain_count(60), chain_count(200)
    (16, 8, 4)
    """
    return next((chains for most, chains in _CHAINS if members <= most), _FEWEST)


def sample_group(joint: Joint, names: Sequence[str], members: Sequence[str], draws: int, rng: np.random.Generator) -> GroupChains:
    """Draw until all that is shared and every member's parameters have so many effective draws and an R-hat below 1.01, or up to a limit.

    Each pass adds as many draws as the last look says are missing. Where chains have not mixed at all, what was drawn so far is burn-in.

    Parameters
    ----------
    joint : Joint
        For :func:`chain_count` points.
    names, members : sequence of str
        Of parameters and members, for words.
    draws : int
        Bulk and tail effective draws to reach.
    """
    chains = chain_count(len(members))
    sampler = Hamiltonian(joint, starts(joint, chains, rng), scales(joint), joint.size, rng)
    sampler.warm_up()
    x, divergent, more = np.empty((0, chains, joint.dimension)), 0, int(np.ceil(_FIRST * draws / chains))
    while True:
        trace = sampler.advance(more)
        x, divergent = np.concatenate([x, trace.x]), divergent + int(trace.divergent.sum())
        found = replace(_judged(joint, x), divergent=divergent, gradients=sampler.gradients)
        lowest, highest = found.worst(names, members)
        reason = shortfall(lowest, highest, draws)
        if not reason or sampler.draws * chains >= max(_LIMIT, _MOST * draws):
            return replace(found, reason=reason)
        if not highest[1] < _NOT_MIXED:
            x, more = x[:0], 2 * len(x)
        else:
            missing = _MORE * draws / max(lowest[1], 1.0) - 1.0 if highest[1] < MAX_R_HAT else 1.0
            more = int(np.ceil(len(x) * max(0.25, min(1.0, missing))))


def _judged(joint: Joint, x: FloatArray) -> GroupChains:
    """Draws (draws, chains, D) with their diagnostics."""
    (n, k), chains = joint.told.place.shape, np.ascontiguousarray(x.transpose(1, 0, 2))
    flat = chains.reshape(-1, joint.dimension)
    return judged(joint.split(flat)[0], joint.eta(flat).reshape(*chains.shape[:2], n, k))


def judged(shared: Shared, eta: FloatArray) -> GroupChains:
    """Draws with their diagnostics; eta has shape (chains, draws, N, k), what is shared has all draws on one axis, chain by chain."""
    (*lead, n, k) = eta.shape
    mean, scatter = shared.mean.reshape(*lead, k), np.exp(shared.log_scatter).reshape(*lead, k)
    effects, z = shared.effects.reshape(*lead, -1, k), shared.z.reshape(*lead, -1)
    of_members = np.array([[convergence(eta[:, :, i, j]) for j in range(k)] for i in range(n)])
    found = GroupChains(mean, scatter, effects, eta, z, {}, of_members)
    return replace(found, shared=judged_shared(found))


def judged_shared(found: GroupChains) -> dict[Key, Convergence]:
    """Diagnostics of what is shared."""
    draws = dict[Key, FloatArray]()
    for j in range(found.mean.shape[2]):
        draws |= {("mean", -1, j): found.mean[..., j], ("sd", -1, j): found.scatter[..., j]}
        draws |= {("effect", i, j): found.effects[..., i, j] for i in range(found.effects.shape[2])}
    draws |= {(CORRELATION, j, i): found.correlation[..., i, j] for j, i in found.correlated}
    return {key: convergence(values) for key, values in draws.items()}


def shortfall(lowest: tuple[str, float], highest: tuple[str, float], draws: int) -> str:
    """What was not reached, in words; a diagnostic that is NaN was not."""
    problems = []
    if not lowest[1] >= draws:
        problems.append(f"{lowest[1]:.0f} effective draws of {lowest[0]}, {draws} required")
    if not highest[1] < MAX_R_HAT:
        problems.append(f"R-hat {highest[1]:.3f} of {highest[0]}, below {MAX_R_HAT:g} required")
    return "; ".join(problems)
