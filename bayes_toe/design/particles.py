"""The posterior of one model while answers come one by one: draws whose weights change.

The first draws are of the prior. When an answer comes their weights change; when fewer than half of
those count that did, the mixture that they came from is refitted to them and all are drawn again,
each with its weight, so that no error is handed on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.inference.adaptation import adapt_proposal, redrawn, refreshed
from bayes_toe.inference.proposal import FittedProposal, efficiency
from bayes_toe.model.observer import ObserverPosterior

#: Share of the draws that counted when they were made, below which they are made anew.
ENOUGH = 0.5
#: Efficiency below which a proposal that was brought up to date is fitted from the beginning.
_POOR = 0.25


@dataclass(eq=False)
class Particles:
    """Draws of one model with their weights.

    Attributes
    ----------
    rule : ObserverPosterior
        That of the pairs without answers: prior and scales.
    x : ndarray, shape (draws, k)
    log_posterior : ndarray, shape (draws,)
        Joint log density of draws and answers.
    log_weight : ndarray, shape (draws,)
        The same over the density that draws came from.
    fitted : FittedProposal, optional
        The mixture that they came from; none before the first renewal.
    generation : int
        How often they were made anew.
    """

    rule: ObserverPosterior
    x: FloatArray
    log_posterior: FloatArray
    log_weight: FloatArray
    fitted: FittedProposal | None = None
    generation: int = 0

    @classmethod
    def from_prior(cls, rule: ObserverPosterior, draws: int, rng: np.random.Generator) -> Particles:
        """Before any answer."""
        x = rule.sample_prior(rng, draws)
        return cls(rule, x, rule.log_prior(x), np.zeros(draws))

    @property
    def shares(self) -> FloatArray:
        """Weights that sum to 1, shape (draws,)."""
        return np.asarray(np.exp(self.log_weight - logsumexp(self.log_weight)))

    @property
    def log_evidence(self) -> float:
        """Of all answers, nats."""
        return float(logsumexp(self.log_weight) - np.log(len(self.x)))

    @property
    def effective(self) -> float:
        """How many draws count."""
        return efficiency(self.log_weight) * len(self.x)

    @property
    def left(self) -> float:
        """Share of the draws that counted when they were made, that count still."""
        first_efficiency = 1.0 if self.fitted is None else self.fitted.efficiency
        return self.effective / (len(self.x) * first_efficiency)

    def add(self, answer: Subject) -> None:
        """Take in further answers."""
        gained = self.rule.for_subject(answer).log_likelihood(self.x)
        self.log_posterior = self.log_posterior + gained
        self.log_weight = self.log_weight + gained

    def renew(self, subject: Subject, rng: np.random.Generator) -> None:
        """Make the draws anew, for all answers so far."""
        posterior, size = self.rule.for_subject(subject), len(self.x)
        fitted = None
        if self.fitted is not None:
            fitted = refreshed(self.fitted, posterior, self.log_posterior, rng)
        if fitted is None or not fitted.trusted or fitted.efficiency < _POOR:
            fitted = adapt_proposal(posterior, rng, draws=size)
            if not fitted.independent:
                fitted = redrawn(fitted, rng, size)
        self.x = fitted.draws.x
        self.log_posterior = fitted.draws.log_posterior
        self.log_weight = fitted.draws.log_weights
        self.fitted = fitted
        self.generation += 1
