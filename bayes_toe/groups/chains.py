"""Draws of a group's joint posterior by Hamiltonian Monte Carlo, and a stated rule for stopping.

Chains go in step: every leapfrog is one call of the log density for all of them. A gradient in NumPy costs much the same for one point as
for dozens, so chains are many and short. In coordinates in which the posterior is nearly standard normal a trajectory of a quarter period
makes the next draw nearly independent, and all trajectories may have one length. It is drawn anew for each, from half a quarter to two and
a half, so that slower coordinates move too and no frequency is ever in step with it. The length is known beforehand, so chains need not
wait for each other as they would where each finds its own turning point; where draws are much alike all the same, it is doubled before the
last round of warming up.

While chains settle, the step is that of the slowest, because it may have started where the posterior is narrow. Step size, and the scale of
every coordinate, are learnt while warming up, from all chains together; then both are fixed, and each trajectory is an exact Metropolis
step. Trajectories on which energy grows by more than 1000 nats are given up: refused, and counted as divergent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.groups.joint import Joint, Root, pairs
from bayes_toe.groups.subjects import population_moments
from bayes_toe.inference.diagnostics import Convergence, convergence_of, shortfall, worst

Density = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
_ACCEPTED = 0.85
_LENGTH, _ALIKE = (
    0.75 * np.pi,
    0.6,
)  # of a trajectory on average; autocorrelation of draws from which on it is doubled
_LOST, _FAST = 1000.0, 1000.0  # energy gained, and momentum, at which a trajectory is given up
_MOST_STEPS = 256
_SETTLING, _SHORT = (
    40,
    8,
)  # draws, of so many steps at most, with the step that the slowest chain needs
_CAREFUL = 0.125


class Trace(NamedTuple):
    """Draws, shape (draws, chains, D), the share of proposals accepted, (draws, chains), and which ones diverged, (draws, chains)."""

    x: FloatArray
    accepted: FloatArray
    divergent: BoolArray


class Hamiltonian:
    """Chains that go through a density together: points, (chains, D) -> log density, (chains,), and gradient, (chains, D).

    They begin at `start`, (chains, D). `scale`, (D,), is roughly the standard deviation of every coordinate, of which the first `together`
    may be correlated with each other. So far there were so many `gradients` of single chains, and `draws` of each after warming up.
    """

    def __init__(
        self,
        density: Density,
        start: FloatArray,
        scale: FloatArray,
        together: int,
        rng: np.random.Generator,
    ) -> None:
        self._density, self._rng, self._x = density, rng, start.copy()
        self._value, self._gradient = density(start)
        self._root, self._scale = np.diag(scale[:together]), scale[together:]
        self.step, self.gradients, self.draws = 0.5 * start.shape[1] ** -0.25, len(start), 0
        self._length = _LENGTH

    def warm_up(self, rounds: tuple[int, ...] = (40, 40, 60, 80)) -> None:
        """Let the chains settle, then learn step and scales over rounds of so many draws, each with the scales of the one before."""
        self._adapt_step(_SETTLING, lambda accepted: float(accepted.min()), most=_SHORT)
        for left, size in zip(reversed(range(len(rounds))), rounds, strict=True):
            draws = self._adapt_step(size)[size // 4 :]
            self._learn(draws)
            if left == 1 and self._alike(draws) > _ALIKE:
                self._length *= 2.0
        self._adapt_step(rounds[0])

    def advance(self, draws: int) -> Trace:
        """So many more draws of every chain.

        One trajectory in eight has steps of a fifth, so that a chain that came to where the common step is too long does not stay there.
        """
        self.draws += draws
        short = self._rng.uniform(size=draws) < _CAREFUL
        made = [self._trajectory(factor) for factor in np.where(short, 0.2, 1.0)]
        return Trace(*map(np.stack, zip(*made, strict=True)))

    def _adapt_step(
        self,
        size: int,
        judge: Callable[[FloatArray], float] = lambda accepted: float(accepted.mean()),
        most: int = _MOST_STEPS,
    ) -> FloatArray:
        """Draws during which the step follows the acceptance by dual averaging (Hoffman & Gelman 2014, section 3.2)."""
        anchor, error, averaged, made = np.log(2.0 * self.step), 0.0, np.log(self.step), []
        for t in range(1, size + 1):
            x, accepted, _ = self._trajectory(most=most)
            made.append(x)
            error += (_ACCEPTED - judge(accepted) - error) / (t + 10.0)
            now = anchor - error * np.sqrt(t) / 0.1
            averaged += t**-0.75 * (now - averaged)
            self.step = float(np.exp(now))
        self.step = float(np.exp(averaged))
        return np.stack(made)

    def _learn(self, draws: FloatArray) -> None:
        """Scales from draws, (draws, chains, D), shrunk to those there are as if these were a few draws more."""
        flat = draws.reshape(-1, draws.shape[-1])
        flat = flat - flat.mean(axis=0)
        together, weight = len(self._root), len(flat) / (len(flat) + 5.0)
        covariance = flat[:, :together].T @ flat[:, :together] / len(flat)
        self._root = np.linalg.cholesky(
            weight * covariance + (1.0 - weight) * self._root @ self._root.T
        )
        self._scale = np.sqrt(
            weight * np.square(flat[:, together:]).mean(axis=0)
            + (1.0 - weight) * np.square(self._scale)
        )

    def _alike(self, draws: FloatArray) -> float:
        """The largest autocorrelation of one draw and the next, (draws, chains, D), of the coordinates that may be correlated."""
        some = draws[..., : len(self._root)]
        some = some - some.mean(axis=(0, 1))
        return float(
            ((some[1:] * some[:-1]).mean(axis=(0, 1)) / np.square(some).mean(axis=(0, 1))).max(
                initial=0.0
            )
        )

    def _trajectory(
        self, factor: float = 1.0, most: int = _MOST_STEPS
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """One trajectory of every chain: where they are then, chance to be accepted, lost or not."""
        length = self._length * self._rng.uniform(1.0 / 3.0, 5.0 / 3.0)
        steps = min(most, max(1, round(length / self.step)))
        step = factor * min(length / steps, self.step)
        momentum = self._rng.standard_normal(self._x.shape)
        x, value, gradient, kinetic = self._x, self._value, self._gradient, _kinetic(momentum)
        lost, start = np.zeros(len(x), bool), kinetic - value
        for _ in range(steps):
            momentum = momentum + 0.5 * step * self._to_momentum(gradient)
            lost |= ~(np.abs(momentum).max(axis=1) < _FAST)
            momentum[lost] = 0.0
            x = x + step * self._to_place(momentum)
            value, gradient = self._density(x)
            momentum = momentum + 0.5 * step * self._to_momentum(gradient)
            lost |= ~(_kinetic(momentum) - value - start < _LOST)
        self.gradients += steps * len(x)
        gained = np.where(lost, -np.inf, value - _kinetic(momentum) + start)
        chance = np.exp(np.minimum(gained, 0.0))
        moved = self._rng.uniform(size=len(x)) < chance
        self._x = np.where(moved[:, None], x, self._x)
        self._value, self._gradient = (
            np.where(moved, value, self._value),
            np.where(moved[:, None], gradient, self._gradient),
        )
        return self._x, chance, lost

    def _to_place(self, momentum: FloatArray) -> FloatArray:
        """How far momenta carry, (chains, D)."""
        together = len(self._root)
        return np.concatenate(
            [momentum[:, :together] @ self._root.T, momentum[:, together:] * self._scale], axis=1
        )

    def _to_momentum(self, gradient: FloatArray) -> FloatArray:
        """What slopes do to momenta, (chains, D)."""
        together = len(self._root)
        return np.concatenate(
            [gradient[:, :together] @ self._root, gradient[:, together:] * self._scale], axis=1
        )


def _kinetic(momentum: FloatArray) -> FloatArray:
    """Kinetic energy, (chains,)."""
    with np.errstate(
        over="ignore"
    ):  # where the density is 0 its slope may be anything; such a trajectory is given up
        return np.asarray(0.5 * np.square(momentum).sum(axis=1))


MAX_R_HAT = 1.01
_NOT_MIXED = 1.1  # an R-hat above which draws are burn-in
_FIRST, _MORE, MOST = (
    1.5,
    1.15,
    24,
)  # draws for each effective one: at first, beyond what seems to be enough, at most
LIMIT = 40_000  # draws that may be made in any case
CORRELATION = "correlation"
_APART = 2.0  # how many times farther apart than the posterior would have them chains start

#: Quantity ("mean", "sd", "effect", "correlation"), place of the regressor or of the other parameter (-1: none), and of the parameter.
Key: TypeAlias = tuple[str, int, int]


@dataclass(frozen=True, eq=False)
class GroupChains:
    """Draws of hyperparameters and of every subject; r regressors, N subjects, k parameters on their group scales."""

    mean: FloatArray  # (chains, draws, k), as scatter
    scatter: FloatArray
    effects: FloatArray  # (chains, draws, r, k)
    eta: FloatArray  # (chains, draws, N, k)
    z: FloatArray  # (chains, draws, c): coordinates of the correlations, see :mod:`bayes_toe.groups.joint`; c is 0 without
    convergence: dict[Key, Convergence]  # of hyperparameters
    subject_convergence: FloatArray  # (N, k, 3): bulk and tail effective draws and R-hat of every subject's parameters
    divergent: int = 0  # trajectories that were given up
    reason: str = ""  # what was not reached; empty where converged

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
            found |= {
                f"{name} of {subject!r}": Convergence(*row)
                for name, row in zip(names, rows, strict=True)
            }
        return found


def chain_count(subjects: int) -> int:
    """Chains in step: many where one gradient costs much the same as a dozen, fewer where subjects are many.

    Each costs its warm-up, and its share of the draws from which an R-hat below 1.01 can be told.
    """
    return 16 if subjects <= 32 else 8 if subjects <= 64 else 4


def sample_group(
    joint: Joint,
    names: Sequence[str],
    subjects: Sequence[str],
    draws: int,
    rng: np.random.Generator,
) -> GroupChains:
    """Draw until all hyperparameters and every subject's parameters have so many effective draws and an R-hat below 1.01, or to a limit.

    Each pass adds as many draws as the last look says are missing. Where chains have not mixed at all, what was drawn so far is burn-in.
    The density is one for :func:`chain_count` points; names of parameters and subjects are for words.
    """
    chains = chain_count(len(subjects))
    sampler = Hamiltonian(joint, *_start(joint, chains, rng), joint.size, rng)
    sampler.warm_up()
    x, divergent, more = (
        np.empty((0, chains, joint.dimension)),
        0,
        int(np.ceil(_FIRST * draws / chains)),
    )
    while True:
        trace = sampler.advance(more)
        x, divergent = np.concatenate([x, trace.x]), divergent + int(trace.divergent.sum())
        found = replace(_chains(joint, x), divergent=divergent)
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
    scales[k : 2 * k] = (
        2.0 * n
    ) ** -0.5  # of what tells of scatters it goes with the number of subjects
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
