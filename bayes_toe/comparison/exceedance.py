"""Exceedance probabilities of Dirichlet distributions, and the table of evidences that comparisons of subjects start from.

All evidences are natural logs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from scipy.special import betainc, expit, gammainc, gammainccinv, gammaincinv, gammaln, logsumexp

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.errors import InputError, NumericalError

#: Smallest concentration of the Dirichlet prior: below it the gamma variables of the exceedance integral spread over too many decades.
SMALLEST_PRIOR = 0.01

_TAIL = 1e-17  # probability outside the integration range
_CHUNK = 256  # count vectors done together: their arrays stay in the processor's cache


def exceedance_probabilities(alpha: npt.ArrayLike) -> tuple[FloatArray, float]:
    """P(r_k is the largest) for r ~ Dirichlet(alpha), shape (models,), and the error of their sum.

    Two models: the incomplete Beta function. More: the r are gamma variables over their sum, so
    P_k = integral of f_k(x) prod_(j != k) F_j(x) dx with their densities f and distribution functions F; the trapezoidal rule in ln x
    converges exponentially.

    Raises
    ------
    InputError
        If alpha is not a vector of at least two numbers of at least 0.01.

    Examples
    --------
    >>> exceedance_probabilities([1.0, 1.0, 1.0])[0].round(12).tolist() == [round(1 / 3, 12)] * 3
    True
    """
    a = np.asarray(alpha, np.float64)
    if a.ndim != 1 or len(a) < 2 or not np.all((a >= SMALLEST_PRIOR) & np.isfinite(a)):
        raise InputError(f"alpha: allowed are at least two finite numbers of at least {SMALLEST_PRIOR}")
    if len(a) == 2:
        found = np.array([betainc(a[1], a[0], 0.5), betainc(a[0], a[1], 0.5)])
        return found, float(abs(found.sum() - 1.0))
    grid, step = _log_grid(len(a), float(a.max()), float(a.max()))
    below = gammainc(a[:, None], np.exp(grid))
    density = np.exp(_log_gamma_density(grid, a[:, None]))
    others = _products_of_others(list(below))
    return require_sum(np.array([density[k] @ others[k] * step for k in range(len(a))]))


def exceedance_of_counts(counts: IntArray, prior: float) -> FloatArray:
    """Exceedance probabilities of several Dirichlet posteriors, shape as the counts: densities are looked up, not computed."""
    n, n_models = int(counts[0].sum()), counts.shape[1]
    shapes = np.arange(n + 1, dtype=np.float64) + prior
    grid, step = _log_grid(n_models, prior + -(-n // n_models), prior + n)
    below = gammainc(shapes[:, None], np.exp(grid))
    density = np.exp(_log_gamma_density(grid, shapes[:, None]))
    found = np.empty(counts.shape)
    for start in range(0, len(counts), _CHUNK):
        some = counts[start : start + _CHUNK]
        others = _products_of_others([below[some[:, k]] for k in range(n_models)])
        for k in range(n_models):
            found[start : start + _CHUNK, k] = step * np.einsum("cx,cx->c", density[some[:, k]], others[k])
    return found


def _products_of_others(factors: Sequence[FloatArray]) -> list[FloatArray]:
    """Product of all factors but one, for each one; by running products, so that a factor of 0 does no harm."""
    before, after = np.ones_like(factors[0]), np.ones_like(factors[0])
    products = []
    for factor in factors:
        products.append(before)
        before = before * factor
    for k in range(len(factors) - 1, -1, -1):
        products[k] = products[k] * after
        after = after * factors[k]
    return products


def _log_grid(n_models: int, smallest_top: float, largest: float) -> tuple[FloatArray, float]:
    """Even grid of ln x that holds the largest of some gamma variables, whose largest shape lies between the two given."""
    # F(x) <= x^a / Gamma(a + 1) bounds the lower end also where the quantile underflows.
    low = (np.log(_TAIL) + gammaln(smallest_top + 1.0)) / smallest_top
    quantile = float(gammaincinv(smallest_top, _TAIL))
    low = max(low, np.log(quantile)) if quantile > 0 else low
    high = np.log(gammainccinv(largest, _TAIL / 100.0))
    # Error of the rule: exp(-2 pi^2 / (step^2 K a)), since each of the K factors has a width of 1/sqrt(a) at least and grows like
    # exp(a y^2 / 2) with the imaginary part y; and exp(-pi^2 / step), since exp(-e^t) falls for |y| < pi/2 only. Both below rounding.
    points = int(np.ceil((high - low) / min(0.25, 0.7 / np.sqrt(n_models * largest)))) + 2
    grid = np.linspace(low, high, points)
    return grid, float(grid[1] - grid[0])


def _log_gamma_density(t: FloatArray, shape: FloatArray) -> FloatArray:
    """Log density of ln x for a gamma variable x of unit scale."""
    return np.asarray(shape * t - np.exp(t) - gammaln(shape))


def require_sum(found: FloatArray) -> tuple[FloatArray, float]:
    """Exceedance probabilities, and by how much their sum misses 1.

    Raises
    ------
    NumericalError
        If that is more than 1e-8.
    """
    error = float(abs(found.sum() - 1.0))
    if not error < 1e-8:
        raise NumericalError(f"exceedance probabilities add up to 1 but for {error:.1e}")
    return found, error


# --- what the comparisons share -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, kw_only=True)
class GroupFrequencies:
    """What every random-effects comparison of K models over N subjects says.

    Attributes
    ----------
    models, subjects : tuple of str
        Names; subjects only those that count.
    left_out : tuple of str
        Subjects without an evidence for every model, which do not count.
    expected : array, shape (models,)
        Expected frequencies.
    exceedance : array, shape (models,)
        Probability that a model is the most frequent one, if frequencies differ.
    exceedance_error : float
        By how much their sum misses 1 before anything is done about it, which nothing is: the error of the quadrature.
    log_evidence, log_evidence_equal : float
        Log evidence of the answers of all subjects, frequencies free, and exactly where all are equal to 1/K. Nats.
    """

    how: ClassVar[str]  #: By which method, in a word or two.
    models: tuple[str, ...]
    subjects: tuple[str, ...]
    left_out: tuple[str, ...]
    expected: FloatArray
    exceedance: FloatArray
    exceedance_error: float
    log_evidence: float
    log_evidence_equal: float

    @property
    def omnibus_risk(self) -> float:
        """Posterior probability that all models are equally frequent, against the alternative that they differ, at prior odds of 1."""
        return float(expit(self.log_evidence_equal - self.log_evidence))

    @property
    def protected(self) -> FloatArray:
        """Exceedance probability averaged over both: (1 - omnibus_risk) exceedance + omnibus_risk / K, shape (models,)."""
        return (1.0 - self.omnibus_risk) * self.exceedance + self.omnibus_risk / len(self.models)


@dataclass(frozen=True, eq=False)
class GroupEvidence:
    """Log evidences of the subjects that count, with names."""

    values: FloatArray
    models: tuple[str, ...]
    subjects: tuple[str, ...]
    left_out: tuple[str, ...]


def group_evidence(
    log_evidence: npt.ArrayLike, models: Sequence[str] | None, subjects: Sequence[str] | None, prior: float, leave_out: bool
) -> GroupEvidence:
    """The table of evidences that a comparison was given, checked; parameters as in `random_effects.random_effects`.

    Raises
    ------
    InputError
        If evidences are missing, infinite, or not a table of at least one subject and two models; or the prior is below 0.01.
    """
    values = np.asarray(log_evidence, np.float64)
    if values.ndim != 2 or values.shape[0] < 1 or values.shape[1] < 2:
        raise InputError(f"log evidences of shape {values.shape}: allowed is (subjects, models) with at least two models")
    if not (np.isfinite(prior) and prior >= SMALLEST_PRIOR):
        raise InputError(f"prior={prior}: allowed is a number of at least {SMALLEST_PRIOR}")
    who, what = _names("subjects", subjects, values.shape[0]), _names("models", models, values.shape[1])
    missing = np.asarray(np.isnan(values).any(axis=1))
    problems = [] if leave_out else [_missing(who[n], what, values[n]) for n in np.flatnonzero(missing)]
    wrong = np.any(values == np.inf, axis=1) | np.all(values == -np.inf, axis=1)
    problems += [f"subject {who[n]}: a log evidence is +inf, or all are -inf" for n in np.flatnonzero(wrong)]
    if missing.all() and leave_out:
        problems.append("no subject has an evidence for every model")
    if problems:
        raise InputError(problems)
    kept = tuple(name for name, gone in zip(who, missing, strict=True) if not gone)
    return GroupEvidence(values[~missing], what, kept, tuple(name for name in who if name not in kept))


def _missing(subject: str, models: tuple[str, ...], row: FloatArray) -> str:
    names = ", ".join(name for name, gone in zip(models, np.isnan(row), strict=True) if gone)
    return f"subject {subject}: no evidence for model {names}; leave_out=True compares the others without this subject"


def _names(what: str, given: Sequence[str] | None, size: int) -> tuple[str, ...]:
    names = tuple(str(i + 1) for i in range(size)) if given is None else tuple(given)
    if len(names) != size or len(set(names)) != size:
        raise InputError(f"{what}: {len(names)} names, allowed are {size} different ones")
    return names


def central_tails(level: float) -> FloatArray:
    """Probabilities below both ends of a central interval."""
    if not 0.0 < level < 1.0:
        raise InputError(f"level={level}: allowed is a number between 0 and 1")
    return np.array([0.5 - 0.5 * level, 0.5 + 0.5 * level])


def log_beta(alpha: FloatArray) -> FloatArray:
    """Log of the multivariate Beta function over the last axis."""
    return np.asarray(gammaln(alpha).sum(axis=-1) - gammaln(alpha.sum(axis=-1)))


def log_evidence_equal_frequencies(log_l: FloatArray) -> float:
    """Log evidence of all subjects if every model has frequency 1/K."""
    return float((logsumexp(log_l, axis=1) - np.log(log_l.shape[1])).sum())
