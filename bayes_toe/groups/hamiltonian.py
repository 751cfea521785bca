"""Hamiltonian Monte Carlo of many chains in step: every leapfrog is one call of the log density for all of them.

A gradient in NumPy costs much the same for one point as for dozens, so chains are many and short. In coordinates in which the posterior is
nearly standard normal a trajectory of a quarter period makes the next draw nearly independent, and all trajectories may have one length. It
is drawn anew for each, from half a quarter to two and a half, so that slower coordinates move too and no frequency is ever in step with it.
The length is known beforehand, so chains need not wait for each other as they would where each finds its own turning point; where draws are
much alike all the same, it is doubled before the last round of warming up.

While chains settle, the step is that of the slowest, because it may have started where the posterior is narrow. Step size, and the scale of
every coordinate, are learnt while warming up, from all chains together; then both are fixed, and each trajectory is an exact Metropolis
step. Trajectories on which energy grows by more than 1000 nats are given up: refused, and counted as divergent.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray

Density = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
_ACCEPTED = 0.85
_LENGTH, _ALIKE = 0.75 * np.pi, 0.6  # of a trajectory on average; autocorrelation of draws from which on it is doubled
_LOST, _FAST = 1000.0, 1000.0  # energy gained, and momentum, at which a trajectory is given up
_MOST_STEPS = 256
_SETTLING, _SHORT = 40, 8  # draws, of so many steps at most, with the step that the slowest chain needs
_CAREFUL = 0.125


class Trace(NamedTuple):
    """Draws, shape (draws, chains, D), the share of proposals accepted, (draws, chains), and which ones diverged, (draws, chains)."""

    x: FloatArray
    accepted: FloatArray
    divergent: BoolArray


class Hamiltonian:
    """Chains that go through a density together.

    Parameters
    ----------
    density : callable
        Points, (chains, D) -> log density, (chains,), and gradient, (chains, D).
    start : array, shape (chains, D)
    scale : array, shape (D,)
        Roughly, the standard deviation of every coordinate.
    together : int
        So many coordinates, the first ones, may be correlated with each other; the others are taken one by one.
    rng : numpy.random.Generator

    Attributes
    ----------
    gradients, draws : int
        Gradients of single chains, and draws of each after warming up, so far.
    """

    def __init__(self, density: Density, start: FloatArray, scale: FloatArray, together: int, rng: np.random.Generator) -> None:
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
        self, size: int, judge: Callable[[FloatArray], float] = lambda accepted: float(accepted.mean()), most: int = _MOST_STEPS
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
        self._root = np.linalg.cholesky(weight * covariance + (1.0 - weight) * self._root @ self._root.T)
        self._scale = np.sqrt(weight * np.square(flat[:, together:]).mean(axis=0) + (1.0 - weight) * np.square(self._scale))

    def _alike(self, draws: FloatArray) -> float:
        """The largest autocorrelation of one draw and the next, (draws, chains, D), of the coordinates that may be correlated."""
        some = draws[..., : len(self._root)]
        some = some - some.mean(axis=(0, 1))
        return float(((some[1:] * some[:-1]).mean(axis=(0, 1)) / np.square(some).mean(axis=(0, 1))).max(initial=0.0))

    def _trajectory(self, factor: float = 1.0, most: int = _MOST_STEPS) -> tuple[FloatArray, FloatArray, BoolArray]:
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
        self._value, self._gradient = np.where(moved, value, self._value), np.where(moved[:, None], gradient, self._gradient)
        return self._x, chance, lost

    def _to_place(self, momentum: FloatArray) -> FloatArray:
        """How far momenta carry, (chains, D)."""
        together = len(self._root)
        return np.concatenate([momentum[:, :together] @ self._root.T, momentum[:, together:] * self._scale], axis=1)

    def _to_momentum(self, gradient: FloatArray) -> FloatArray:
        """What slopes do to momenta, (chains, D)."""
        together = len(self._root)
        return np.concatenate([gradient[:, :together] @ self._root, gradient[:, together:] * self._scale], axis=1)


def _kinetic(momentum: FloatArray) -> FloatArray:
    """Kinetic energy, (chains,)."""
    with np.errstate(over="ignore"):  # where the density is 0 its slope may be anything; such a trajectory is given up
        return np.asarray(0.5 * np.square(momentum).sum(axis=1))
