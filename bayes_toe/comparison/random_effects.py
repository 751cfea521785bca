"""Which models the subjects of a population follow, from the log evidence of every model for every subject.

Random effects: each subject follows one of K models, drawn with unknown frequencies r that have a Dirichlet prior,

    p(y | r) = prod_n sum_k r_k exp(L_nk),     L_nk the log evidence of model k for subject n.

:func:`random_effects` is the variational scheme that the field quotes (Stephan et al. 2009, NeuroImage 46:1004) with the omnibus risk and
the protected exceedance probabilities of Rigoux et al. 2014 (NeuroImage 84:971); :func:`exact_random_effects` sums over all assignments of
models to subjects. Where single subjects say little, the variational bound lies below the exact log evidence, and the omnibus risk is then
overstated: 0.66 on average where half the simulated populations of 16 had equal frequencies (log Bayes factors of 0.5 +- 1), against 0.50
exactly. Fixed effects (:func:`fixed_effects`): all subjects follow the same model.

All evidences are natural logs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.special import betainc, betaincinv, digamma, expit, gammainc, gammainccinv, gammaincinv, gammaln, logsumexp, softmax

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.errors import InputError, NumericalError

if TYPE_CHECKING:
    import pandas as pd


#: Smallest concentration of the Dirichlet prior: below it the gamma variables of the exceedance integral spread over too many decades.
SMALLEST_PRIOR = 0.01
#: Count vectors (subjects per model) beyond which the exact sum is refused: 20 subjects and 8 models have 888,030.
LARGEST_SUM = 1_000_000
#: The same times subjects: what limits two or three models.
LARGEST_WORK = 200_000_000

_TAIL = 1e-17  # probability outside the integration range
_TOLERANCE, _MOST_STEPS = 1e-12, 200_000
_BLOCK = 1 << 16  # count vectors put in order together: what that needs of memory
_CHUNK = 256  # count vectors done together: their arrays stay in the processor's cache
_HALVINGS = 60  # of an interval that holds a quantile: to the last bit


@dataclass(frozen=True, eq=False)
class ModelFrequencies:
    """Random-effects comparison of K models over N subjects by the variational scheme.

    Attributes
    ----------
    models, subjects : tuple of str
        Names; subjects only those that count.
    left_out : tuple of str
        Subjects without an evidence for every model, which do not count.
    alpha : array, shape (models,)
        Dirichlet posterior of the model frequencies.
    expected : array, shape (models,)
        Expected frequencies, alpha / sum(alpha).
    exceedance : array, shape (models,)
        Probability that a model is the most frequent one, if frequencies differ.
    exceedance_error : float
        By how much their sum misses 1 before anything is done about it, which nothing is: the error of the quadrature.
    omnibus_risk : float
        Posterior probability that all models are equally frequent, against the alternative that they differ, at prior odds of 1.
    protected : array, shape (models,)
        Exceedance probability averaged over both: (1 - omnibus_risk) exceedance + omnibus_risk / K.
    responsibilities : array, shape (subjects, models)
        Probability that a subject follows a model.
    log_evidence, log_evidence_equal : float
        Variational lower bound on the log evidence of the answers of all subjects, frequencies free; exact one, all equal to 1/K. Nats.
    group_log_evidence : array, shape (models,)
        Fixed effects: sum over subjects. Nats.
    """

    models: tuple[str, ...]
    subjects: tuple[str, ...]
    left_out: tuple[str, ...]
    alpha: FloatArray
    expected: FloatArray
    exceedance: FloatArray
    exceedance_error: float
    omnibus_risk: float
    protected: FloatArray
    responsibilities: FloatArray
    log_evidence: float
    log_evidence_equal: float
    group_log_evidence: FloatArray

    def interval(self, level: float = 0.95) -> FloatArray:
        """Central interval of every frequency, shape (models, 2).

        Raises
        ------
        InputError
            If the level is not between 0 and 1.
        """
        tails = _tails(level)
        return np.asarray(betaincinv(self.alpha[:, None], (self.alpha.sum() - self.alpha)[:, None], tails))

    def frame(self) -> pd.DataFrame:
        """One row per model: model, alpha, expected, exceedance, protected, group_log_evidence, omnibus_risk."""
        import pandas as pd

        columns = ("alpha", "expected", "exceedance", "protected", "group_log_evidence")
        frame = pd.DataFrame({"model": self.models} | {name: getattr(self, name) for name in columns})
        return frame.assign(omnibus_risk=self.omnibus_risk)


@dataclass(frozen=True, eq=False)
class ExactFrequencies:
    """The same comparison without the variational approximation; fields as in :class:`ModelFrequencies`.

    The posterior of the frequencies is a mixture of Dirichlet distributions, so it has no single alpha.

    Attributes
    ----------
    count_probability : array, shape (models, subjects + 1)
        Posterior probability that so many of these subjects follow a model.
    prior : float
        Concentration of the Dirichlet prior.
    """

    models: tuple[str, ...]
    subjects: tuple[str, ...]
    left_out: tuple[str, ...]
    expected: FloatArray
    exceedance: FloatArray
    exceedance_error: float
    omnibus_risk: float
    protected: FloatArray
    log_evidence: float
    log_evidence_equal: float
    count_probability: FloatArray
    prior: float

    def interval(self, level: float = 0.95) -> FloatArray:
        """Central interval of every frequency, shape (models, 2): given its count, a frequency has a Beta distribution.

        Raises
        ------
        InputError
            If the level is not between 0 and 1.
        """
        n_models, n = len(self.models), len(self.subjects)
        a = np.arange(n + 1) + self.prior
        b = n + n_models * self.prior - a
        tails = np.broadcast_to(_tails(level), (n_models, 2))
        low, high = np.zeros((n_models, 2)), np.ones((n_models, 2))
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            below = np.einsum("kj,ktj->kt", self.count_probability, betainc(a, b, middle[:, :, None])) < tails
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.asarray(0.5 * (low + high))


def random_effects(
    log_evidence: npt.ArrayLike,
    *,
    models: Sequence[str] | None = None,
    subjects: Sequence[str] | None = None,
    prior: float = 1.0,
    leave_out: bool = False,
) -> ModelFrequencies:
    """Model frequencies in the population, by the variational scheme.

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

    Raises
    ------
    InputError
        If evidences are missing, infinite, or not a table of at least one subject and two models; or the prior is below 0.01.
    NumericalError
        If the scheme does not settle.

    Examples
    --------
    >>> found = random_effects([[0.0, 3.0], [0.0, 4.0], [0.0, -1.0], [0.0, 5.0]], models=["H0", "H1"])
    >>> found.expected.round(2).tolist(), found.exceedance.round(2).tolist(), round(found.omnibus_risk, 2)
    ([0.23, 0.77], [0.07, 0.93], 0.46)
    """
    table = _table(log_evidence, models, subjects, prior, leave_out)
    log_l, n_models = table.values, len(table.models)
    alpha, shares = _settle(log_l, prior)
    bound = _bound(log_l, shares, alpha, prior)
    equal = _log_evidence_equal(log_l)
    risk = float(expit(equal - bound))
    exceedance, error = exceedance_probabilities(alpha)
    return ModelFrequencies(
        models=table.models,
        subjects=table.subjects,
        left_out=table.left_out,
        alpha=alpha,
        expected=alpha / alpha.sum(),
        exceedance=exceedance,
        exceedance_error=error,
        omnibus_risk=risk,
        protected=(1.0 - risk) * exceedance + risk / n_models,
        responsibilities=shares,
        log_evidence=bound,
        log_evidence_equal=equal,
        group_log_evidence=log_l.sum(axis=0),
    )


def exact_terms(subjects: int, models: int) -> int:
    """Terms of the exact sum: ways to share out subjects among models, binom(N + K - 1, K - 1).

    Examples
    --------
    >>> exact_terms(16, 8)
    245157
    """
    return comb(subjects + models - 1, models - 1)


def is_affordable(subjects: int, models: int) -> bool:
    """Whether the exact sum is done: up to a million terms, and 200 million times subjects; within seconds.

    Examples
    --------
    >>> is_affordable(20, 8), is_affordable(21, 8), is_affordable(735, 3), is_affordable(736, 3)
    (True, False, True, False)
    """
    terms = exact_terms(subjects, models)
    return terms <= LARGEST_SUM and subjects * terms <= LARGEST_WORK


def exact_random_effects(
    log_evidence: npt.ArrayLike,
    *,
    models: Sequence[str] | None = None,
    subjects: Sequence[str] | None = None,
    prior: float = 1.0,
    leave_out: bool = False,
) -> ExactFrequencies:
    """Model frequencies by the sum over all K^N assignments of models to subjects.

    Assignments that give every model the same number of subjects share one Dirichlet posterior, so the sum has binom(N + K - 1, K - 1)
    terms, and their weights follow from adding one subject after the other.

    Parameters and errors as for :func:`random_effects`; an InputError too if the sum is too long: see :func:`is_affordable`.

    Examples
    --------
    >>> found = exact_random_effects([[0.0, 3.0], [0.0, 4.0], [0.0, -1.0], [0.0, 5.0]])
    >>> found.expected.round(2).tolist(), round(found.omnibus_risk, 2)
    ([0.24, 0.76], 0.42)
    """
    table = _table(log_evidence, models, subjects, prior, leave_out)
    log_l, n_models = table.values, len(table.models)
    if not is_affordable(len(log_l), n_models):
        terms, said = exact_terms(len(log_l), n_models), f"allowed are {LARGEST_SUM}, and {LARGEST_WORK} times subjects"
        raise InputError(f"{len(log_l)} subjects and {n_models} models: the exact sum has {terms} terms, {said}")
    counts, log_weights = _count_weights(log_l)
    alpha = counts.astype(np.float64) + prior
    log_terms = log_weights + _log_beta(alpha) - _log_beta(np.full(n_models, prior))
    total, equal = float(logsumexp(log_terms)), _log_evidence_equal(log_l)
    weights = np.exp(log_terms - total)
    exceedance, error = _mixture_exceedance(counts, weights, prior)
    risk = float(expit(equal - total))
    return ExactFrequencies(
        models=table.models,
        subjects=table.subjects,
        left_out=table.left_out,
        expected=np.asarray(weights @ (alpha / alpha[0].sum())),
        exceedance=exceedance,
        exceedance_error=error,
        omnibus_risk=risk,
        protected=(1.0 - risk) * exceedance + risk / n_models,
        log_evidence=total,
        log_evidence_equal=equal,
        count_probability=np.array([np.bincount(of_one, weights, minlength=len(log_l) + 1) for of_one in counts.T]),
        prior=prior,
    )


def fixed_effects(log_evidence: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Group log evidence of every model if all subjects follow the same one, and its posterior probability at equal prior odds.

    Parameters
    ----------
    log_evidence : array_like, shape (subjects, models)
        Natural logs. One subject can decide alone: compare with :func:`random_effects`.

    Raises
    ------
    InputError
        As for :func:`random_effects`.

    Examples
    --------
    >>> group, probability = fixed_effects([[0.0, 3.0], [0.0, -1.0]])
    >>> group.tolist(), probability.round(3).tolist()
    ([0.0, 2.0], [0.119, 0.881])
    """
    group = _table(log_evidence, None, None, 1.0, False).values.sum(axis=0)
    if not np.isfinite(group).any():
        raise InputError("every model rules out some subject: none can be the model of all of them")
    return group, np.asarray(softmax(group))


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
    return _checked(np.array([density[k] @ others[k] * step for k in range(len(a))]))


@dataclass(frozen=True, eq=False)
class _Table:
    """Log evidences of the subjects that count, with names."""

    values: FloatArray
    models: tuple[str, ...]
    subjects: tuple[str, ...]
    left_out: tuple[str, ...]


def _table(
    log_evidence: npt.ArrayLike, models: Sequence[str] | None, subjects: Sequence[str] | None, prior: float, leave_out: bool
) -> _Table:
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
    return _Table(values[~missing], what, kept, tuple(name for name in who if name not in kept))


def _tails(level: float) -> FloatArray:
    """Probabilities below both ends of a central interval."""
    if not 0.0 < level < 1.0:
        raise InputError(f"level={level}: allowed is a number between 0 and 1")
    return np.array([0.5 - 0.5 * level, 0.5 + 0.5 * level])


def _missing(subject: str, models: tuple[str, ...], row: FloatArray) -> str:
    names = ", ".join(name for name, gone in zip(models, np.isnan(row), strict=True) if gone)
    return f"subject {subject}: no evidence for model {names}; leave_out=True compares the others without this subject"


def _names(what: str, given: Sequence[str] | None, size: int) -> tuple[str, ...]:
    names = tuple(str(i + 1) for i in range(size)) if given is None else tuple(given)
    if len(names) != size or len(set(names)) != size:
        raise InputError(f"{what}: {len(names)} names, allowed are {size} different ones")
    return names


def _settle(log_l: FloatArray, prior: float) -> tuple[FloatArray, FloatArray]:
    """Fixed point of the variational scheme: g_nk ~ exp(L_nk + digamma(alpha_k)), alpha_k = prior + sum_n g_nk."""
    alpha = np.full(log_l.shape[1], prior)
    for _ in range(_MOST_STEPS):
        shares = softmax(log_l + digamma(alpha), axis=1)
        after = prior + shares.sum(axis=0)
        # Without information steps shrink by 1 - O(1/N) only: the tolerance is far below the digits that anyone reads.
        if np.abs(after - alpha).max() <= _TOLERANCE * len(log_l):
            return after, np.asarray(shares)
        alpha = after
    raise NumericalError(f"model frequencies: no fixed point after {_MOST_STEPS} steps")


def _bound(log_l: FloatArray, shares: FloatArray, alpha: FloatArray, prior: float) -> float:
    """Free energy at alpha = prior + sum of shares: sum g (L - ln g) + ln B(alpha) - ln B(prior)."""
    used = shares > 0  # g ln g and g L are 0 where g is
    fit = (shares[used] * (log_l[used] - np.log(shares[used]))).sum()
    return float(fit + _log_beta(alpha) - _log_beta(np.full(len(alpha), prior)))


def _log_evidence_equal(log_l: FloatArray) -> float:
    """Log evidence of all subjects if every model has frequency 1/K."""
    return float((logsumexp(log_l, axis=1) - np.log(log_l.shape[1])).sum())


def _log_beta(alpha: FloatArray) -> FloatArray:
    """Log of the multivariate Beta function over the last axis."""
    return np.asarray(gammaln(alpha).sum(axis=-1) - gammaln(alpha.sum(axis=-1)))


def _count_weights(log_l: FloatArray) -> tuple[IntArray, FloatArray]:
    """All vectors of subjects per model, and the log of the summed likelihood of the assignments that give each.

    A vector n of sum m has the place sum over j < K of binom(c_j, j) with c_j = n_1 + ... + n_j + j - 1 (the combinatorial number system),
    so the vectors of fewer subjects come first. One more subject under the last model leaves the place, one under model k adds
    binom(c_j, j - 1) for each j >= k.
    """
    n_subjects, n_models = log_l.shape
    c = _increasing(n_subjects, n_models - 1)
    shift = np.array([_binomials(n_subjects + n_models, j)[c[:, j]] for j in range(n_models - 1)])
    shift = np.cumsum(shift[::-1], axis=0)[::-1]
    weights = np.zeros(1)
    for done, row in enumerate(log_l):
        size = len(weights)
        grown = np.full(exact_terms(done + 1, n_models), -np.inf)
        grown[:size] = weights + row[-1]
        for k in range(n_models - 1):  # within one model no two vectors meet
            where = np.arange(size) + shift[k, :size]
            grown[where] = np.logaddexp(grown[where], weights + row[k])
        weights = grown
    sums = np.pad(c - np.arange(n_models - 1), ((0, 0), (1, 0)))
    return np.diff(sums, axis=1, append=n_subjects), weights


def _increasing(n: int, length: int) -> IntArray:
    """All rows c_1 < c_2 < ... of whole numbers with 0 <= c_j < n + j, the last one varying slowest."""
    rows = np.arange(n + 1)[:, None]
    for j in range(2, length + 1):
        tops = np.arange(j - 1, n + j)
        sizes = _binomials(n + j, j - 1)[tops]  # below each top stand the first rows of the shorter ones
        within = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        rows = np.column_stack([rows[within], np.repeat(tops, sizes)])
    return rows


def _binomials(largest: int, k: int) -> IntArray:
    """binom(0, k), ..., binom(largest, k)."""
    return np.array([comb(n, k) for n in range(largest + 1)], np.int64)


def _mixture_exceedance(counts: IntArray, weights: FloatArray, prior: float) -> tuple[FloatArray, float]:
    """Exceedance probabilities averaged over Dirichlet posteriors of whole counts, computed once for counts in any order."""
    sorted_ones = np.flatnonzero((np.diff(counts, axis=1) >= 0).all(axis=1))
    of_sorted = _exceedance_of_counts(counts[sorted_ones], prior)
    found = np.zeros(counts.shape[1])
    for start in range(0, len(counts), _BLOCK):
        block, share = counts[start : start + _BLOCK], weights[start : start + _BLOCK]
        order = np.argsort(block, axis=1)
        same = np.searchsorted(sorted_ones, _places(np.take_along_axis(block, order, axis=1)))
        found += share @ of_sorted[same[:, None], np.argsort(order, axis=1)]
    return _checked(found)


def _places(counts: IntArray) -> IntArray:
    """Where vectors of the same sum stand in the order of :func:`_count_weights`."""
    n, n_models = int(counts[0].sum()), counts.shape[1]
    c = np.cumsum(counts[:, :-1], axis=1) + np.arange(n_models - 1)
    return np.asarray(np.sum([_binomials(n + n_models, j + 1)[c[:, j]] for j in range(n_models - 1)], axis=0), np.int64)


def _exceedance_of_counts(counts: IntArray, prior: float) -> FloatArray:
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


def _checked(found: FloatArray) -> tuple[FloatArray, float]:
    error = float(abs(found.sum() - 1.0))
    if not error < 1e-8:
        raise NumericalError(f"exceedance probabilities add up to 1 but for {error:.1e}")
    return found, error
