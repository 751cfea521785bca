"""The moves of a sampler: a global one from the fitted proposal, and the local ones of emcee.

This module and :mod:`bayes_toe.inference.sampling` are the only ones that import emcee.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.inference.proposal import FittedProposal, Proposal

if TYPE_CHECKING:
    import emcee


def moves(fitted: FittedProposal) -> list[tuple[Any, float]]:
    """Emcee moves and their weights: the better the proposal, the fewer local moves; mostly local ones where it may not be trusted.

    emcee's snooker move is never used: in release 3.1.6 it is biased.
    """
    from emcee.moves import DEMove, StretchMove

    local = 0.02 + 0.3 * (1.0 - fitted.efficiency) if fitted.trusted else 0.8
    return [(GlobalMove(fitted.proposal), 1.0 - local), (DEMove(), 0.8 * local), (StretchMove(), 0.2 * local)]


def GlobalMove(proposal: Proposal) -> emcee.moves.MHMove:  # noqa: N802 (named like emcee's own moves)
    """Independence Metropolis move: all walkers propose from the fitted proposal at once."""
    from emcee.moves import MHMove

    stock, known = _Stock(proposal), _Known()

    def propose(x: FloatArray, random: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
        fresh, log_fresh = stock.take(len(x), random)
        log_old = known.values(x, stock.log_density)
        known.keep((x.copy(), log_old), (fresh, log_fresh))
        return fresh, log_old - log_fresh

    return MHMove(propose, ndim=proposal.mixture.means.shape[1])


class _Known:
    """Log proposal densities of the last step: most walkers stand where they stood then or where it sent them, few were moved since."""

    def __init__(self) -> None:
        self._pairs: tuple[tuple[FloatArray, FloatArray], ...] = ()

    def values(self, x: FloatArray, log_density: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """Log density at x, shape (walkers, k); evaluated only where it is not known."""
        result, unknown = np.empty(len(x)), np.ones(len(x), bool)
        for points, values in self._pairs:
            same = (points == x).all(axis=1)
            result[same] = values[same]
            unknown &= ~same
        if unknown.any():
            result[unknown] = log_density(x[unknown])
        return result

    def keep(self, *pairs: tuple[FloatArray, FloatArray]) -> None:
        self._pairs = pairs


class _Stock:
    """Draws from a proposal with their log densities, made in large batches: for a few walkers at a time, overhead would be most of it."""

    _BATCH = 2048

    def __init__(self, proposal: Proposal) -> None:
        self._proposal = proposal
        self._x, self._log_density = np.empty((0, proposal.mixture.means.shape[1])), np.empty(0)

    def log_density(self, x: FloatArray) -> FloatArray:
        return self._proposal.log_density(x, self._proposal.posterior.log_prior(x))

    def take(self, size: int, random: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
        """The next draws, shape (size, k), and their log densities, shape (size,)."""
        if len(self._x) < size:
            self._x, _, self._log_density = self._proposal.sample(random, max(size, self._BATCH))
        taken = self._x[:size], self._log_density[:size]
        self._x, self._log_density = self._x[size:], self._log_density[size:]
        return taken
