"""Which models the subjects of a population follow, from the log evidence of every model for every subject.

Random effects: each subject follows one of K models, drawn with unknown frequencies r that have a Dirichlet prior,

    p(y | r) = prod_n sum_k r_k exp(L_nk),     L_nk the log evidence of model k for subject n.

The field's variational scheme (Stephan et al. 2009, NeuroImage 46:1004; omnibus risk and protected exceedance probabilities: Rigoux et al.
2014, 84:971) bounds the evidence from below, and so overstates the risk that all models are equally frequent: 0.50 for the bundled study
under eight models, where it is 0.16. Here assignments of models to subjects are sampled, and the error is stated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.special import expit, logsumexp, softmax

from bayes_toe.arrays import FloatArray
from bayes_toe.errors import InputError
from bayes_toe.seeds import generator

if TYPE_CHECKING:
    import pandas as pd

_SMALLEST_PRIOR = 0.01
_REPEATS, _PARTICLES = 20, 1000  # repeats tell the error, particles keep the bias of each below it
_DRAWS = 5  # of frequencies, for each particle


@dataclass(frozen=True, eq=False, kw_only=True)
class ModelFrequencies:
    """How frequent K models are in the population of N subjects, up to Monte Carlo errors, which come from independent repeats.

    Attributes
    ----------
    models, subjects : tuple of str
        Names; subjects only those that count.
    left_out : tuple of str
        Subjects without an evidence for every model, which do not count.
    expected, expected_se : array, shape (models,)
        Expected frequencies, and their standard errors.
    exceedance, exceedance_se : array, shape (models,)
        Probability that a model is the most frequent one, if frequencies differ.
    log_evidence, log_evidence_se : float
        Log evidence of the answers of all subjects, frequencies free. Nats.
    log_evidence_equal : float
        The same, exactly, where all frequencies are 1/K.
    draws : array, shape (draws, models)
        Frequencies drawn from their posterior, in no order.
    """

    models: tuple[str, ...]
    subjects: tuple[str, ...]
    left_out: tuple[str, ...]
    expected: FloatArray
    expected_se: FloatArray
    exceedance: FloatArray
    exceedance_se: FloatArray
    log_evidence: float
    log_evidence_se: float
    log_evidence_equal: float
    draws: FloatArray

    @property
    def omnibus_risk(self) -> float:
        """Posterior probability that all models are equally frequent, against the alternative that they differ, at prior odds of 1."""
        return float(expit(self.log_evidence_equal - self.log_evidence))

    @property
    def omnibus_risk_se(self) -> float:
        """Standard error of :attr:`omnibus_risk`."""
        return self.omnibus_risk * (1.0 - self.omnibus_risk) * self.log_evidence_se

    @property
    def protected(self) -> FloatArray:
        """Exceedance probability averaged over both: (1 - omnibus_risk) exceedance + omnibus_risk / K, shape (models,)."""
        return (1.0 - self.omnibus_risk) * self.exceedance + self.omnibus_risk / len(self.models)

    def interval(self, level: float = 0.95) -> FloatArray:
        """Central interval of every frequency, shape (models, 2), by quantiles of the draws.

        Raises
        ------
        InputError
            If the level is not between 0 and 1.
        """
        if not 0.0 < level < 1.0:
            raise InputError(f"level={level}: allowed is a number between 0 and 1")
        return np.asarray(np.quantile(self.draws, [0.5 - 0.5 * level, 0.5 + 0.5 * level], axis=0).T)

    def frame(self) -> pd.DataFrame:
        """One row per model: model, expected, exceedance, protected, omnibus_risk, and the standard errors of all but the third."""
        import pandas as pd

        frame = pd.DataFrame({"model": self.models, "expected": self.expected, "exceedance": self.exceedance, "protected": self.protected})
        errors = {f"{name}_se": getattr(self, f"{name}_se") for name in ("expected", "exceedance", "omnibus_risk")}
        return frame.assign(omnibus_risk=self.omnibus_risk, **errors)


def random_effects(
    log_evidence: npt.ArrayLike,
    *,
    models: Sequence[str] | None = None,
    subjects: Sequence[str] | None = None,
    prior: float = 1.0,
    leave_out: bool = False,
    seed: int = 0,
) -> ModelFrequencies:
    """Model frequencies in the population, by sequential imputation: subjects join one by one, each particle draws a model for them.

    A particle with n_k subjects under model k expects that model with r_k = (prior + n_k) / (K prior + n). The next subject multiplies its
    weight by sum_k r_k exp(L_k) and follows model k with probability ~ r_k exp(L_k). Particles are resampled by their weights where fewer
    than half of them are effective. In the end the posterior of the frequencies is the mixture of their Dirichlet posteriors, and the mean
    weight estimates the evidence without bias. Subjects who say clearly which model they follow come first: they leave all particles alike.

    Source: Kong, Liu & Wong 1994 (J. Am. Stat. Assoc. 89:278); resampling before drawing as in Pitt & Shephard 1999 (94:590).

    Parameters
    ----------
    log_evidence : array_like, shape (subjects, models)
        Natural logs; -inf where a model rules a subject's answers out, NaN where a value was withheld.
    models, subjects : sequence of str, optional
        Names; numbers from 1 by default.
    prior : float
        Concentration of the Dirichlet prior, the same for every model; 1 is uniform.
    leave_out : bool
        Subjects with a NaN are left out and named in the result; by default they are refused.
    seed : int

    Raises
    ------
    InputError
        If evidences are missing, infinite, or not a table of at least one subject and two models; or the prior is below 0.01.

    Examples
    --------
    >>> found = random_effects([[0.0, 3.0], [0.0, 4.0], [0.0, -1.0], [0.0, 5.0]], models=["H0", "H1"])
    >>> found.expected.round(2).tolist(), found.exceedance.round(1).tolist(), round(found.omnibus_risk, 2)
    ([0.24, 0.76], [0.1, 0.9], 0.42)
    """
    values = np.asarray(log_evidence, np.float64)
    if values.ndim != 2 or values.shape[0] < 1 or values.shape[1] < 2:
        raise InputError(f"log evidences of shape {values.shape}: allowed is (subjects, models) with at least two models")
    if not (np.isfinite(prior) and prior >= _SMALLEST_PRIOR):
        raise InputError(f"prior={prior}: allowed is a number of at least {_SMALLEST_PRIOR}")
    who, what = _names("subjects", subjects, len(values)), _names("models", models, values.shape[1])
    _require_evidence(values, who, what, leave_out)
    missing = np.asarray(np.isnan(values).any(axis=1))
    values, rng = values[~missing], generator(seed, "model frequencies")
    logs, alpha = _assigned(values, prior, rng)
    shares, scaled = softmax(logs), np.exp(logs - logs.max())
    gammas, largest = alpha, np.zeros((_REPEATS, len(what)))
    for _ in range(_DRAWS):
        gammas = rng.standard_gamma(alpha)
        largest += np.eye(len(what))[gammas.argmax(axis=0)].mean(axis=1) / _DRAWS
    whose = rng.choice(_REPEATS, size=_REPEATS * _PARTICLES, p=shares)
    drawn = gammas[:, whose, rng.integers(_PARTICLES, size=len(whose))].T
    expected, expected_se = _pooled(shares, alpha.mean(axis=2).T / alpha[:, 0, 0].sum())
    exceedance, exceedance_se = _pooled(shares, largest)
    return ModelFrequencies(
        models=what,
        subjects=tuple(name for name, gone in zip(who, missing, strict=True) if not gone),
        left_out=tuple(name for name, gone in zip(who, missing, strict=True) if gone),
        expected=expected,
        expected_se=expected_se,
        exceedance=exceedance,
        exceedance_se=exceedance_se,
        log_evidence=float(logs.max() + np.log(scaled.mean())),
        log_evidence_se=float(scaled.std(ddof=1) / scaled.mean() / np.sqrt(_REPEATS)),
        log_evidence_equal=float((logsumexp(values, axis=1) - np.log(len(what))).sum()),
        draws=drawn / drawn.sum(axis=1, keepdims=True),
    )


def _names(what: str, given: Sequence[str] | None, size: int) -> tuple[str, ...]:
    names = tuple(str(i + 1) for i in range(size)) if given is None else tuple(given)
    if len(names) != size or len(set(names)) != size:
        raise InputError(f"{what}: {len(names)} names, allowed are {size} different ones")
    return names


def _require_evidence(values: FloatArray, who: Sequence[str], what: Sequence[str], leave_out: bool) -> None:
    """Refuse infinite evidences, and missing ones unless their subjects may be left out."""
    problems = []
    for name, row in zip(who, values, strict=True):
        gone = ", ".join(model for model, value in zip(what, row, strict=True) if np.isnan(value))
        if gone and not leave_out:
            problems.append(f"subject {name}: no evidence for model {gone}; leave_out=True compares the others without this subject")
        if np.any(row == np.inf) or np.all(row == -np.inf):
            problems.append(f"subject {name}: a log evidence is +inf, or all are -inf")
    if leave_out and np.isnan(values).any(axis=1).all():
        problems.append("no subject has an evidence for every model")
    if problems:
        raise InputError(problems)


def _assigned(log_l: FloatArray, prior: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Log evidence of every repeat, and the Dirichlet posteriors of its equally weighted particles, shape (models, repeats, particles)."""
    order = np.argsort(-softmax(log_l, axis=1).max(axis=1), kind="stable")
    likelihood = np.exp(log_l - log_l.max(axis=1, keepdims=True))[order, :, None, None]
    size, models = (_REPEATS, _PARTICLES), np.arange(log_l.shape[1])[:, None, None]
    alpha, weights = np.full((len(models), *size), prior), np.ones(size)
    logs, total = np.full(_REPEATS, log_l.max(axis=1).sum()), len(models) * prior
    for one in likelihood:
        below = np.cumsum(alpha * one, axis=0)
        weights *= below[-1] / total
        mean, total = weights.mean(axis=1, keepdims=True), total + 1.0
        weights, logs = weights / mean, logs + np.log(mean[:, 0])
        for i in np.flatnonzero(np.square(weights).mean(axis=1) > 2.0):
            kept = _resampled(weights[i], rng)
            alpha[:, i], below[:, i], weights[i] = alpha[:, i, kept], below[:, i, kept], 1.0
        shares = rng.permuted((np.arange(_PARTICLES) + rng.uniform(size=size)) / _PARTICLES, axis=1)  # of all particles evenly
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
