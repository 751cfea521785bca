"""The moves of a sampler: a global one from the fitted proposal, and the local ones of emcee."""

from __future__ import annotations

from typing import Any

import emcee
import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.inference.proposal import FittedProposal, Proposal, WeightedDraws, importance_draws


class Stock:
    """Draws from a proposal with all that a step needs of them.

    The first ones are those by which the proposal was judged, whose posterior densities are known; when they are used up, more are made in
    large batches. That these draws let the proposal pass leaves out of them no more than points of a weight for which it would have been
    fitted again: some ten-thousandths of the posterior, far below the Monte Carlo error of as many draws.
    """

    _BATCH = 1024

    def __init__(self, proposal: Proposal, first: WeightedDraws) -> None:
        self.proposal, self._left = proposal, first

    def take(self, size: int, random: np.random.RandomState) -> WeightedDraws:
        """The next draws."""
        if len(self._left.x) < size:
            self._left = importance_draws(self.proposal, random, max(size, self._BATCH))
        taken, self._left = self._left.part(slice(size)), self._left.part(slice(size, None))
        return taken

    def log_density(self, x: FloatArray) -> FloatArray:
        """Log density of the proposal at x, shape (points, k) -> (points,)."""
        return self.proposal.log_density(x, self.proposal.posterior.log_prior(x))


def moves(fitted: FittedProposal, stock: Stock) -> list[tuple[Any, float]]:
    """Emcee moves and their weights: the better the proposal, the fewer local moves; mostly local ones where it may not be trusted.

    emcee's snooker move is never used: in release 3.1.6 it is biased.
    """
    local = 0.02 + 0.3 * (1.0 - fitted.efficiency) if fitted.trusted else 0.8
    return [(GlobalMove(stock), 1.0 - local), (emcee.moves.DEMove(), 0.8 * local), (emcee.moves.StretchMove(), 0.2 * local)]


def GlobalMove(stock: Stock) -> emcee.moves.Move:  # noqa: N802 (named like emcee's own moves)
    """Independence Metropolis move: all walkers propose from the fitted proposal at once."""

    class Global(emcee.moves.Move):  # type: ignore[misc]  # emcee has no types
        def __init__(self) -> None:
            self._known = np.empty((0, 0)), np.empty(0)

        def propose(self, model: Any, state: Any) -> tuple[Any, Any]:
            x = state.coords
            fresh, log_old = stock.take(len(x), model.random), self.log_proposal(x)
            accepted = np.log(model.random.rand(len(x))) < fresh.log_weights - (state.log_prob - log_old)
            self._known = np.where(accepted[:, None], fresh.x, x), np.where(accepted, fresh.log_proposal, log_old)
            return self.update(state, emcee.State(fresh.x, log_prob=fresh.log_posterior), accepted), accepted

        def log_proposal(self, x: FloatArray) -> FloatArray:
            """Log proposal density at the walkers: they stand where the last global step left them, but for few that were moved since."""
            points, values = self._known
            if points.shape != x.shape:
                return stock.log_density(x)
            moved = (points != x).any(axis=1)
            if moved.any():
                values[moved] = stock.log_density(x[moved])
            return values

    return Global()
