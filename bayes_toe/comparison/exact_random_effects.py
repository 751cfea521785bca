"""Model frequencies in a population by the exact sum over all assignments of models to subjects.

The comparison of :mod:`bayes_toe.comparison.random_effects` without its variational approximation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from scipy.special import betainc, logsumexp

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.comparison.exceedance import (
    GroupFrequencies,
    central_tails,
    exceedance_of_counts,
    group_evidence,
    log_beta,
    log_evidence_equal_frequencies,
    require_sum,
)
from bayes_toe.errors import InputError

#: Count vectors (subjects per model) beyond which the exact sum is refused: 20 subjects and 8 models have 888,030.
LARGEST_SUM = 1_000_000
#: The same times subjects: what limits two or three models.
LARGEST_WORK = 200_000_000

_BLOCK = 1 << 16  # count vectors put in order together: what that needs of memory
_HALVINGS = 60  # of an interval that holds a quantile: to the last bit


@dataclass(frozen=True, eq=False, kw_only=True)
class ExactFrequencies(GroupFrequencies):
    """The comparison without the variational approximation.

    The posterior of the frequencies is a mixture of Dirichlet distributions, so it has no single alpha.

    Attributes
    ----------
    count_probability : array, shape (models, subjects + 1)
        Posterior probability that so many of these subjects follow a model.
    prior : float
        Concentration of the Dirichlet prior.
    """

    how: ClassVar[str] = "exact sum"
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
        tails = np.broadcast_to(central_tails(level), (n_models, 2))
        low, high = np.zeros((n_models, 2)), np.ones((n_models, 2))
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            below = np.einsum("kj,ktj->kt", self.count_probability, betainc(a, b, middle[:, :, None])) < tails
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.asarray(0.5 * (low + high))


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

    Parameters and errors as for :func:`bayes_toe.comparison.random_effects.random_effects`; an InputError too if the sum is too long: see
    :func:`is_affordable`.

    Examples
    --------
    >>> found = exact_random_effects([[0.0, 3.0], [0.0, 4.0], [0.0, -1.0], [0.0, 5.0]])
    >>> found.expected.round(2).tolist(), round(found.omnibus_risk, 2)
    ([0.24, 0.76], 0.42)
    """
    table = group_evidence(log_evidence, models, subjects, prior, leave_out)
    log_l, n_models = table.values, len(table.models)
    if not is_affordable(len(log_l), n_models):
        terms, said = exact_terms(len(log_l), n_models), f"allowed are {LARGEST_SUM}, and {LARGEST_WORK} times subjects"
        raise InputError(f"{len(log_l)} subjects and {n_models} models: the exact sum has {terms} terms, {said}")
    counts, log_weights = _count_weights(log_l)
    alpha = counts.astype(np.float64) + prior
    log_terms = log_weights + log_beta(alpha) - log_beta(np.full(n_models, prior))
    total = float(logsumexp(log_terms))
    weights = np.exp(log_terms - total)
    exceedance, error = _mixture_exceedance(counts, weights, prior)
    return ExactFrequencies(
        models=table.models,
        subjects=table.subjects,
        left_out=table.left_out,
        expected=np.asarray(weights @ (alpha / alpha[0].sum())),
        exceedance=exceedance,
        exceedance_error=error,
        log_evidence=total,
        log_evidence_equal=log_evidence_equal_frequencies(log_l),
        count_probability=np.array([np.bincount(of_one, weights, minlength=len(log_l) + 1) for of_one in counts.T]),
        prior=prior,
    )


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
    of_sorted = exceedance_of_counts(counts[sorted_ones], prior)
    found = np.zeros(counts.shape[1])
    for start in range(0, len(counts), _BLOCK):
        block, share = counts[start : start + _BLOCK], weights[start : start + _BLOCK]
        order = np.argsort(block, axis=1)
        same = np.searchsorted(sorted_ones, _places(np.take_along_axis(block, order, axis=1)))
        found += share @ of_sorted[same[:, None], np.argsort(order, axis=1)]
    return require_sum(found)


def _places(counts: IntArray) -> IntArray:
    """Where vectors of the same sum stand in the order of :func:`_count_weights`."""
    n, n_models = int(counts[0].sum()), counts.shape[1]
    c = np.cumsum(counts[:, :-1], axis=1) + np.arange(n_models - 1)
    return np.asarray(np.sum([_binomials(n + n_models, j + 1)[c[:, j]] for j in range(n_models - 1)], axis=0), np.int64)
