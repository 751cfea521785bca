"""Model frequencies in a population by sampling assignments of models to subjects, where there are too many to be summed.

The comparison of :mod:`bayes_toe.comparison.exact_random_effects`, with drawn terms in the place of all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import softmax

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.comparison.exceedance import GroupFrequencies, central_tails, group_evidence, log_evidence_equal_frequencies
from bayes_toe.seeds import generator

_REPEATS, _PARTICLES = 20, 1000  # repeats tell the error, particles keep the bias of each below it
_DRAWS = 20  # of frequencies, for each particle


@dataclass(frozen=True, eq=False, kw_only=True)
class SampledFrequencies(GroupFrequencies):
    """The comparison without the variational approximation, up to Monte Carlo errors, which come from independent repeats.

    Attributes
    ----------
    draws : array, shape (draws, models)
        Frequencies drawn from their posterior, in no order.
    expected_se, exceedance_se : array, shape (models,)
        Standard errors of `expected` and `exceedance`.
    log_evidence_se : float
        Of `log_evidence`, nats.
    """

    how: ClassVar[str] = "sampled"
    draws: FloatArray
    expected_se: FloatArray
    exceedance_se: FloatArray
    log_evidence_se: float

    @property
    def omnibus_risk_se(self) -> float:
        """Standard error of :attr:`omnibus_risk`."""
        return self.omnibus_risk * (1.0 - self.omnibus_risk) * self.log_evidence_se

    def interval(self, level: float = 0.95) -> FloatArray:
        """Central interval of every frequency, shape (models, 2), by quantiles of the draws.

        Raises
        ------
        InputError
            If the level is not between 0 and 1.
        """
        return np.asarray(np.quantile(self.draws, central_tails(level), axis=0).T)


def sampled_random_effects(
    log_evidence: npt.ArrayLike,
    *,
    models: Sequence[str] | None = None,
    subjects: Sequence[str] | None = None,
    prior: float = 1.0,
    leave_out: bool = False,
    seed: int = 0,
) -> SampledFrequencies:
    """Model frequencies by sequential imputation: subjects join one by one, each particle draws a model for them from its own counts.

    A particle with n_k subjects under model k expects that model with r_k = (prior + n_k) / (K prior + n). The next subject multiplies its
    weight by sum_k r_k exp(L_k) and follows model k with probability ~ r_k exp(L_k). Particles are resampled by their weights where fewer
    than half of them are effective. In the end the posterior of the frequencies is the mixture of their Dirichlet posteriors, and the mean
    weight estimates the evidence without bias. Subjects who say clearly which model they follow come first: they leave all particles alike.

    Source: Kong, Liu & Wong 1994 (J. Am. Stat. Assoc. 89:278); resampling before drawing as in Pitt & Shephard 1999 (94:590).

    Parameters and errors as for :func:`bayes_toe.comparison.random_effects.random_effects`.

    Examples
    --------
    >>> found = sampled_random_effects([[0.0, 3.0], [0.0, 4.0], [0.0, -1.0], [0.0, 5.0]])
    >>> found.expected.round(2).tolist(), round(found.omnibus_risk, 2)
    ([0.24, 0.76], 0.42)
    """
    table = group_evidence(log_evidence, models, subjects, prior, leave_out)
    repeats = [_repeat(table.values, prior, generator(seed, "model frequencies", i)) for i in range(_REPEATS)]
    logs = np.array([one.log_evidence for one in repeats])
    shares, scaled = softmax(logs), np.exp(logs - logs.max())
    expected, expected_se = _pooled(shares, np.array([one.expected for one in repeats]))
    exceedance, exceedance_se = _pooled(shares, np.array([one.exceedance for one in repeats]))
    rng = generator(seed, "model frequencies", "draws")
    whose = rng.choice(_REPEATS, size=_REPEATS * _PARTICLES, p=shares)
    return SampledFrequencies(
        models=table.models,
        subjects=table.subjects,
        left_out=table.left_out,
        expected=expected,
        exceedance=exceedance,
        exceedance_error=float(abs(exceedance.sum() - 1.0)),
        log_evidence=float(logs.max() + np.log(scaled.mean())),
        log_evidence_equal=log_evidence_equal_frequencies(table.values),
        draws=np.array([one.frequencies for one in repeats])[whose, rng.integers(_PARTICLES, size=len(whose))],
        expected_se=expected_se,
        exceedance_se=exceedance_se,
        log_evidence_se=float(scaled.std(ddof=1) / scaled.mean() / np.sqrt(_REPEATS)),
    )


class _Repeat(NamedTuple):
    """What one population of particles says; frequencies drawn, shape (particles, models)."""

    log_evidence: float
    expected: FloatArray
    exceedance: FloatArray
    frequencies: FloatArray


def _repeat(log_l: FloatArray, prior: float, rng: np.random.Generator) -> _Repeat:
    log_evidence, alpha = _imputed(log_l, prior, rng)
    gammas = rng.standard_gamma(alpha, size=(_DRAWS, *alpha.shape))
    largest = np.bincount(gammas.argmax(axis=1).ravel(), minlength=len(alpha)) / (_DRAWS * _PARTICLES)
    return _Repeat(log_evidence, alpha.mean(axis=1) / alpha[:, 0].sum(), largest, (gammas[0] / gammas[0].sum(axis=0)).T)


def _imputed(log_l: FloatArray, prior: float, rng: np.random.Generator) -> tuple[float, FloatArray]:
    """Log evidence, and the Dirichlet posteriors of equally weighted particles, shape (models, particles)."""
    tops = log_l.max(axis=1)
    order = np.argsort(-softmax(log_l, axis=1).max(axis=1), kind="stable")
    likelihood = np.exp(log_l - tops[:, None])[order, :, None]
    alpha, each = np.full((log_l.shape[1], _PARTICLES), prior), np.arange(_PARTICLES)
    weights, log_evidence, total = np.ones(_PARTICLES), float(tops.sum()), log_l.shape[1] * prior
    for one in likelihood:
        below = np.cumsum(alpha * one, axis=0)
        weights *= below[-1] / total
        mean, total = weights.mean(), total + 1.0
        weights, log_evidence = weights / mean, log_evidence + np.log(mean)
        if weights @ weights > 2.0 * _PARTICLES:
            kept = _resampled(weights, rng)
            alpha, below, weights = alpha[:, kept], below[:, kept], np.ones(_PARTICLES)
        alpha[(below[:-1] <= rng.uniform(size=_PARTICLES) * below[-1]).sum(axis=0), each] += 1.0
    return float(log_evidence), alpha[:, _resampled(weights, rng)]


def _resampled(weights: FloatArray, rng: np.random.Generator) -> IntArray:
    """Which particles go on, each about as often as its weight, the mean of which is 1, says; systematic resampling."""
    return np.searchsorted(np.cumsum(weights)[:-1], np.arange(_PARTICLES) + rng.uniform())


def _pooled(shares: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean of repeats, shape (repeats, models), which have shares of the evidence; and its standard error."""
    mean = shares @ values
    return mean, np.sqrt(shares**2 @ (values - mean) ** 2 * (_REPEATS / (_REPEATS - 1.0)))
