"""H0: one free frequency per pair, uniform prior; posterior and evidence are known in closed form, so no MCMC is needed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
from scipy.special import betaln, expit, log_expit, logit

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.model.distributions import Random
from bayes_toe.model.prior import DEFAULT, Prior
from bayes_toe.model.target import Names, log_likelihoods, require_points


@dataclass(frozen=True)
class FreeFrequencies:
    """The record of H0; its attributes are those of :class:`bayes_toe.model.record.Model`."""

    name: str = "free frequencies"
    about: str = "H0: one frequency per pair, and nothing that connects them"
    knows_intervals: bool = False
    by_trial: bool = False
    of_intervals: str = "one frequency for each pair at each interval"
    levels: tuple[tuple[str, str], ...] = ()

    def units_at_intervals(self, reference: float) -> Mapping[str, str]:
        """None: a frequency has no unit."""
        return MappingProxyType({})

    def describe(self, prior: Prior) -> str:
        """The prior in words; it has no value to choose."""
        return "every frequency ~ Uniform(0, 1)"

    def posterior(self, subject: Subject, prior: Prior | None = None) -> FrequencyPosterior:
        """The posterior of a subject."""
        return FrequencyPosterior(subject, self, DEFAULT if prior is None else prior)


FREE_FREQUENCIES = FreeFrequencies()


def frequency_evidence(subject: Subject) -> float:
    """Exact log evidence of H0, nats: one frequency per pair, uniform prior; sum of ln B(n_Eq + 1, n_Diff + 1)."""
    return float(betaln(subject.n_yes + 1.0, subject.n_trials - subject.n_yes + 1.0).sum())


@dataclass(frozen=True, eq=False)
class FrequencyPosterior:
    """Free frequencies of one subject; x, shape (points, pairs), holds their logits."""

    subject: Subject
    model: FreeFrequencies = FREE_FREQUENCIES
    prior: Prior = DEFAULT

    @property
    def coordinates(self) -> tuple[str, ...]:
        """One logit per pair."""
        return tuple(f"logit_{name}" for name in self._names)

    @property
    def _names(self) -> tuple[str, ...]:
        return tuple(f"q_{i + 1}" for i in range(self.subject.n_pairs))

    @property
    def log_evidence(self) -> float:
        """Exact log evidence, nats: :func:`frequency_evidence`."""
        return frequency_evidence(self.subject)

    def log_answers(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Log P(equal) and log P(different) of every pair, (points, pairs) each."""
        logits = require_points(x, self.subject.n_pairs)
        return np.asarray(log_expit(logits)), np.asarray(log_expit(-logits))

    def answers_given_the_rest(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """The same: answers are independent."""
        return self.log_answers(x)

    def realised_answers(
        self, rng: Random, x: npt.ArrayLike, answers: tuple[FloatArray, FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """The same."""
        return answers

    def pair_log_likelihood(
        self, x: npt.ArrayLike, answers: tuple[FloatArray, FloatArray] | None = None
    ) -> FloatArray:
        """Log likelihood of each pair, (points, pairs) each."""
        return log_likelihoods(self.subject, self.log_answers(x) if answers is None else answers)

    def log_likelihood(self, x: npt.ArrayLike) -> FloatArray:
        """Log likelihood without binomial coefficients, (points, pairs) -> (points,)."""
        return np.asarray(self.pair_log_likelihood(x).sum(axis=1))

    def log_prior(self, x: npt.ArrayLike) -> FloatArray:
        """Log prior density with respect to the logits, (points, pairs) -> (points,)."""
        log_equal, log_different = self.log_answers(x)
        return np.asarray((log_equal + log_different).sum(axis=1))

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """Their sum, (points, pairs) -> (points,)."""
        return self.log_likelihood(x) + self.log_prior(x)

    def sample(self, rng: Random, size: int) -> FloatArray:
        """Independent posterior draws, shape (size, pairs); Beta(n_Eq + 1, n_Diff + 1) as a ratio of gammas, whose logit is exact."""
        n_yes, n_trials = self.subject.n_yes, self.subject.n_trials
        shape = (size, self.subject.n_pairs)
        return np.asarray(
            np.log(rng.standard_gamma(n_yes + 1.0, shape))
            - np.log(rng.standard_gamma(n_trials - n_yes + 1.0, shape))
        )

    @property
    def names(self) -> Names:
        """q_1, q_2 ...: the frequencies of the pairs, in the subject's order."""
        return Names(self._names, self._names)

    def sample_prior(self, rng: Random, size: int) -> FloatArray:
        """Independent draws from the prior, shape (size, pairs)."""
        return np.asarray(logit(rng.uniform(size=(size, self.subject.n_pairs))))

    def quantities(self, x: FloatArray) -> dict[str, FloatArray]:
        """Every frequency, each with the shape of x without its last axis."""
        return {name: expit(x[..., i]) for i, name in enumerate(self._names)}

    def judged(self, x: FloatArray) -> dict[str, FloatArray]:
        """The same: no frequency follows from another."""
        return self.quantities(x)

    def points(self, quantities: Mapping[str, FloatArray]) -> FloatArray:
        """Logits of the frequencies."""
        return np.stack([logit(quantities[name]) for name in self._names], axis=-1)

    def prior_quantile(self, name: str, probability: float) -> float:
        """Of a uniform."""
        return probability
