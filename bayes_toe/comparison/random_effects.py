"""Which models the subjects of a population follow, from the log evidence of every model for every subject.

Random effects: each subject follows one of K models, drawn with unknown frequencies r that have a uniform prior,

    p(y | r) = prod_n sum_k r_k exp(L_nk),     L_nk the log evidence of model k for subject n.

The field's variational scheme (Stephan et al. 2009, NeuroImage 46:1004; omnibus risk and protected exceedance probabilities: Rigoux et al.
2014, 84:971) bounds the evidence from below, and so overstates the risk that all models are equally frequent: 0.50 for the bundled study
under eight models, where it is 0.16. Here assignments of models to subjects are sampled, and the error is stated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import expit, logsumexp, softmax

from bayes_toe.arrays import FloatArray
from bayes_toe.seeds import generator

_REPEATS, _PARTICLES = 20, 1000  # repeats tell the error, particles keep the bias of each below it
_DRAWS = 5  # of frequencies, for each particle


@dataclass(frozen=True, eq=False, kw_only=True)
class ModelFrequencies:
    """How frequent K models are in the population of N subjects, up to Monte Carlo errors, which come from independent repeats.

    Attributes
    ----------
    expected, expected_se : array, shape (models,)
        Expected frequencies, and their standard errors.
    exceedance, exceedance_se : array, shape (models,)
        Probability that a model is the most frequent one, if frequencies differ.
    log_evidence, log_evidence_se : float
        Log evidence of the answers of all subjects, frequencies free. Nats.
    log_evidence_equal : float
        The same, exactly, where all frequencies are 1/K.
    """

    expected: FloatArray
    expected_se: FloatArray
    exceedance: FloatArray
    exceedance_se: FloatArray
    log_evidence: float
    log_evidence_se: float
    log_evidence_equal: float

    @property
    def omnibus_risk(self) -> float:
        """Posterior probability that all models are equally frequent, against the alternative that they differ, at prior odds of 1."""
        return float(expit(self.log_evidence_equal - self.log_evidence))

    @property
    def protected(self) -> FloatArray:
        """Exceedance probability averaged over both: (1 - omnibus_risk) exceedance + omnibus_risk / K, shape (models,)."""
        return (1.0 - self.omnibus_risk) * self.exceedance + self.omnibus_risk / len(self.expected)


def random_effects(log_evidence: npt.ArrayLike, *, seed: int = 0) -> ModelFrequencies:
    """Model frequencies in the population, by sequential imputation: subjects join one by one, each particle draws a model for them.

    A particle with n_k subjects under model k expects that model with r_k = (1 + n_k) / (K + n). The next subject multiplies its
    weight by sum_k r_k exp(L_k) and follows model k with probability ~ r_k exp(L_k). Particles are resampled by their weights where fewer
    than half of them are effective. In the end the posterior of the frequencies is the mixture of their Dirichlet posteriors, and the mean
    weight estimates the evidence without bias. Subjects who say clearly which model they follow come first: they leave all particles alike.

    Source: Kong, Liu & Wong 1994 (J. Am. Stat. Assoc. 89:278); resampling before drawing as in Pitt & Shephard 1999 (94:590).

    Log evidences have the shape (subjects, models), of at least one subject and two models; -inf where a model rules a subject's answers
    out.

    Examples
    --------
    >>> found = random_effects([[0.0, 3.0], [0.0, 4.0], [0.0, -1.0], [0.0, 5.0]])
    >>> found.expected.round(2).tolist(), found.exceedance.round(1).tolist(), round(found.omnibus_risk, 2)
    ([0.24, 0.76], [0.1, 0.9], 0.42)
    """
    values, rng = np.asarray(log_evidence, np.float64), generator(seed, "model frequencies")
    logs, alpha = _assigned(values, rng)
    shares, scaled = softmax(logs), np.exp(logs - logs.max())
    largest = np.zeros((_REPEATS, len(alpha)))
    for _ in range(_DRAWS):
        gammas = rng.standard_gamma(alpha)
        largest += np.eye(len(alpha))[gammas.argmax(axis=0)].mean(axis=1) / _DRAWS
    expected, expected_se = _pooled(shares, alpha.mean(axis=2).T / alpha[:, 0, 0].sum())
    exceedance, exceedance_se = _pooled(shares, largest)
    return ModelFrequencies(
        expected=expected,
        expected_se=expected_se,
        exceedance=exceedance,
        exceedance_se=exceedance_se,
        log_evidence=float(logs.max() + np.log(scaled.mean())),
        log_evidence_se=float(scaled.std(ddof=1) / scaled.mean() / np.sqrt(_REPEATS)),
        log_evidence_equal=float((logsumexp(values, axis=1) - np.log(len(alpha))).sum()),
    )


def _assigned(log_l: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Log evidence of every repeat, and the Dirichlet posteriors of its equally weighted particles, shape (models, repeats, particles)."""
    order = np.argsort(-softmax(log_l, axis=1).max(axis=1), kind="stable")
    likelihood = np.exp(log_l - log_l.max(axis=1, keepdims=True))[order, :, None, None]
    size, models = (_REPEATS, _PARTICLES), np.arange(log_l.shape[1])[:, None, None]
    alpha, weights = np.ones((len(models), *size)), np.ones(size)
    logs, total = np.full(_REPEATS, log_l.max(axis=1).sum()), float(len(models))
    for one in likelihood:
        below = np.cumsum(alpha * one, axis=0)
        weights *= below[-1] / total
        mean, total = weights.mean(axis=1, keepdims=True), total + 1.0
        weights, logs = weights / mean, logs + np.log(mean[:, 0])
        for i in np.flatnonzero(np.square(weights).mean(axis=1) > 2.0):
            kept = _resampled(weights[i], rng)
            alpha[:, i], below[:, i], weights[i] = alpha[:, i, kept], below[:, i, kept], 1.0
        shares = rng.permuted(
            (np.arange(_PARTICLES) + rng.uniform(size=size)) / _PARTICLES, axis=1
        )  # of all particles evenly
        alpha += (below[:-1] <= shares * below[-1]).sum(axis=0) == models
    for repeat, of_one in enumerate(weights):
        alpha[:, repeat] = alpha[:, repeat, _resampled(of_one, rng)]
    return logs, alpha


def _resampled(weights: FloatArray, rng: np.random.Generator) -> npt.NDArray[np.intp]:
    """Which particles go on, each about as often as its weight, the mean of which is 1, says; systematic resampling."""
    return np.searchsorted(np.cumsum(weights)[:-1], np.arange(_PARTICLES) + rng.uniform())


def _pooled(shares: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean of repeats, shape (repeats, models), which have shares of the evidence; and its standard error."""
    mean = shares @ values
    return mean, np.sqrt(shares**2 @ (values - mean) ** 2 * (_REPEATS / (_REPEATS - 1.0)))
