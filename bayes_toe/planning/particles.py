"""The posterior of one model while answers come one by one: draws whose weights change, made anew when too few of them count."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.inference.adaptation import adapt_proposal, redrawn, refreshed
from bayes_toe.inference.proposal import FittedProposal, efficiency
from bayes_toe.model.posterior import Posterior

#: Share of the draws that counted when they were made, below which they are made anew.
ENOUGH = 0.5
#: Efficiency below which a proposal that was brought up to date is fitted from the beginning.
_POOR = 0.25


@dataclass(eq=False)
class Particles:
    """Draws of one model with their weights.

    The first ones are of the prior. When an answer comes their weights change; when fewer than half of those count that did, the mixture
    that they came from is refitted to them and all are drawn from it again, each with its weight: the program's global move without
    rejections, so that no error is handed on from one generation to the next.

    `rule` is the model's posterior of pairs without answers, of which others have prior, centre and interval. `log_posterior` is the joint
    density of draws and answers, `log_weight` the same over the density that draws came from, both -inf outside of the support, shape
    (draws,); `generation` counts how often they were made anew.
    """

    rule: Posterior
    x: FloatArray
    log_posterior: FloatArray
    log_weight: FloatArray
    fitted: FittedProposal | None = None
    generation: int = 0

    @classmethod
    def of_prior(cls, rule: Posterior, draws: int, rng: np.random.Generator) -> Particles:
        """Before any answer."""
        x = rule.sample_prior(rng, draws)
        return cls(rule, x, rule.log_prior(x), np.zeros(draws))

    def target(self, subject: Subject) -> Posterior:
        """The posterior of these answers."""
        return replace(self.rule, subject=subject)

    @property
    def shares(self) -> FloatArray:
        """Weights that sum to 1, shape (draws,)."""
        return np.asarray(np.exp(self.log_weight - logsumexp(self.log_weight)))

    @property
    def log_evidence(self) -> float:
        """Of all answers, nats."""
        return float(logsumexp(self.log_weight) - np.log(len(self.x)))

    @property
    def possible(self) -> bool:
        """Whether the model can have given all answers; one without lapses never calls identical stimuli different."""
        return bool(self.log_weight.max() > -np.inf)

    @property
    def effective(self) -> float:
        """How many draws count; none where the answers are impossible."""
        return efficiency(self.log_weight) * len(self.x) if self.possible else 0.0

    def gain(self, more: Subject) -> FloatArray:
        """Log likelihood of further answers, (draws,)."""
        return self.target(more).log_likelihood(self.x)

    def add(self, gained: FloatArray) -> None:
        """Take in answers of this log likelihood."""
        self.log_posterior, self.log_weight = self.log_posterior + gained, self.log_weight + gained

    @property
    def left(self) -> float:
        """Share of the draws that counted when they were made, that count still."""
        return self.effective / (
            len(self.x) * (1.0 if self.fitted is None else self.fitted.efficiency)
        )

    def renew(self, subject: Subject, rng: np.random.Generator) -> None:
        """Make the draws anew, for all answers so far; where it can be, the old proposal is brought up to date."""
        target, size = self.target(subject), len(self.x)
        fitted = (
            None if self.fitted is None else refreshed(self.fitted, target, self.log_posterior, rng)
        )
        if fitted is None or not fitted.trusted or fitted.efficiency < _POOR:
            fitted = adapt_proposal(target, rng, draws=size)
            fitted = fitted if fitted.independent else redrawn(fitted, rng, size)
        draws = fitted.draws
        self.x, self.log_posterior, self.log_weight, self.fitted = (
            draws.x,
            draws.log_posterior,
            draws.log_weights,
            fitted,
        )
        self.generation += 1
