"""The posterior of one model while answers come one by one: draws whose weights change, made anew when too few of them count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.inference.adaptation import adapt_proposal, redrawn, refreshed
from bayes_toe.inference.proposal import FittedProposal, efficiency
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.record import Model
from bayes_toe.planning.study_design import nobody

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

    `centre` is that of offsets (natural-log intensity), `interval` that of pull and width (seconds). `log_posterior` is the joint density
    of draws and answers, `log_weight` the same over the density that draws came from, both -inf outside of the support, shape (draws,);
    `generation` counts how often they were made anew.
    """

    model: Model
    prior: Prior
    centre: float
    interval: float
    x: FloatArray
    log_posterior: FloatArray
    log_weight: FloatArray
    fitted: FittedProposal | None = None
    generation: int = 0

    @classmethod
    def of_prior(cls, model: Model, prior: Prior, centre: float, interval: float, draws: int, rng: np.random.Generator) -> Particles:
        """Before any answer."""
        target = Posterior(nobody(model.task), model, prior, centre, interval)
        x = target.sample_prior(rng, draws)
        return cls(model, prior, centre, interval, x, target.log_prior(x), np.zeros(draws))

    def target(self, pairs: Subject) -> Posterior:
        """The posterior of these answers, or the rule by which these pairs are answered."""
        return Posterior(pairs, self.model, self.prior, self.centre, self.interval)

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

    def allows(self, more: Subject) -> bool:
        """Whether the model can have given these answers too."""
        return bool((self.log_weight + self.target(more).log_likelihood(self.x)).max() > -np.inf)

    def answered(self, more: Subject) -> None:
        """Take in further answers."""
        gained = self.target(more).log_likelihood(self.x)
        self.log_posterior, self.log_weight = self.log_posterior + gained, self.log_weight + gained

    @property
    def left(self) -> float:
        """Share of the draws that counted when they were made, that count still."""
        return self.effective / (len(self.x) * (1.0 if self.fitted is None else self.fitted.efficiency))

    def renew(self, subject: Subject, rng: np.random.Generator) -> None:
        """Make the draws anew, for all answers so far; where it can be, the old proposal is brought up to date."""
        target, size = self.target(subject), len(self.x)
        fitted = None if self.fitted is None else refreshed(self.fitted, target, self.log_posterior, rng)
        if fitted is None or not fitted.trusted or fitted.efficiency < _POOR:
            fitted = adapt_proposal(target, rng, draws=size)
            fitted = fitted if fitted.independent else redrawn(fitted, rng, size)
        draws = fitted.draws
        self.x, self.log_posterior, self.log_weight, self.fitted = draws.x, draws.log_posterior, draws.log_weights, fitted
        self.generation += 1
