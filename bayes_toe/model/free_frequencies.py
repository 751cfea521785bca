"""H0 as a model that predictive checks can ask: one free frequency per pair, uniform prior, posterior in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import log_expit

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject


@dataclass(frozen=True, eq=False)
class FrequencyModel:
    """Free frequencies of one subject; x, shape (points, pairs), holds their logits.

    Examples
    --------
    >>> model = FrequencyModel(Subject("S01", [0.0, 0.0], [0.0, 0.3], [49, 20], [50, 50]))
    >>> model.sample(np.random.default_rng(0), 5).shape
    (5, 2)
    """

    subject: Subject

    @property
    def coordinates(self) -> tuple[str, ...]:
        """One logit per pair."""
        return tuple(f"logit_q_{i + 1}" for i in range(self.subject.n_pairs))

    def log_answers(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Log P(equal) and log P(different) of every pair, (points, pairs) each."""
        logits = np.asarray(x, np.float64)
        return np.asarray(log_expit(logits)), np.asarray(log_expit(-logits))

    def log_likelihood(self, x: npt.ArrayLike) -> FloatArray:
        """Log likelihood without binomial coefficients, (points, pairs) -> (points,)."""
        log_equal, log_different = self.log_answers(x)
        n_equal, n_trials = self.subject.n_equal, self.subject.n_trials
        return np.asarray((n_equal * log_equal + (n_trials - n_equal) * log_different).sum(axis=1))

    def sample(self, rng: np.random.Generator, size: int) -> FloatArray:
        """Independent posterior draws, shape (size, pairs); Beta(n_Eq + 1, n_Diff + 1) as a ratio of gammas, whose logit is exact."""
        n_equal, n_trials = self.subject.n_equal, self.subject.n_trials
        shape = (size, self.subject.n_pairs)
        return np.asarray(np.log(rng.standard_gamma(n_equal + 1.0, shape)) - np.log(rng.standard_gamma(n_trials - n_equal + 1.0, shape)))
