"""Two frequencies compared exactly: whether two sets of yes/no answers share one probability, and which of the two is larger.

The test is Boschloo's. The number of trials of each order is set by the experimenter and the number of 'equal' answers by nobody, so the
data are two independent binomials. Fisher's test conditions on the total of 'equal' answers as well and is conservative; Boschloo's takes
Fisher's p-value as its statistic and computes that statistic's exact distribution under the two binomials, at the common probability that
is least favourable. It never exceeds its level and its p-value is never above Fisher's, which it comes close to where trials are many.

Two-sided p-values are twice the smaller one-sided ones: an order effect has a sign, and half the level is spent on each.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import boschloo_exact, hypergeom

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.errors import InputError

#: Most trials n1 + n2 of Boschloo's test, of which SciPy's takes 6 ms at 100 and 25 ms at 150; beyond it, Fisher's is used.
BOSCHLOO_TRIALS = 150
#: Most trials in one comparison of which tails keep six digits.
LARGEST_TOTAL = 10**10


class ExactTest(NamedTuple):
    """Two-sided p-values and the test that gave each, 'boschloo' or 'fisher', both of the shape of the counts."""

    p_value: FloatArray
    test: npt.NDArray[np.str_]


def equality_test(k1: npt.ArrayLike, n1: npt.ArrayLike, k2: npt.ArrayLike, n2: npt.ArrayLike) -> ExactTest:
    """Exact two-sided test of the null that k1 of n1 and k2 of n2 come from one probability. Arguments broadcast.

    Boschloo's test; Fisher's, doubled one-sided, for more than :data:`BOSCHLOO_TRIALS` trials n1 + n2.

    Raises
    ------
    InputError
        Unless counts are whole and 0 <= k <= n, or if a comparison has more than :data:`LARGEST_TOTAL` trials.

    Examples
    --------
    >>> found = equality_test([7, 25], [12, 50], [8, 45], [8, 50])
    >>> [round(float(p), 6) for p in found.p_value]
    [0.036824, 1.3e-05]
    """
    tables = _tables(k1, n1, k2, n2)
    a, n, b, m = np.moveaxis(tables, -1, 0)
    few = (n + m <= BOSCHLOO_TRIALS) & (n > 0) & (m > 0)
    tails = np.minimum(hypergeom.cdf(a, n + m, n, a + b), hypergeom.cdf(b, n + m, m, a + b))
    p_value = np.array(np.minimum(1.0, 2.0 * tails))
    p_value[few] = [_boschloo(*row) for row in tables[few].tolist()]
    return ExactTest(p_value, np.where(few, "boschloo", "fisher"))


def probability_greater(k1: npt.ArrayLike, n1: npt.ArrayLike, k2: npt.ArrayLike, n2: npt.ArrayLike) -> FloatArray:
    """Posterior probability that the first probability exceeds the second, under independent uniform priors. Arguments broadcast.

    q1 ~ Beta(k1 + 1, n1 - k1 + 1), q2 ~ Beta(k2 + 1, n2 - k2 + 1); P(q1 > q2) = P(H <= k1) with H the number of marked items among
    k1 + k2 + 1 drawn from n1 + n2 + 2 of which n1 + 1 are marked. (q1 is an order statistic of n1 + 1 uniform numbers, q2 one of
    n2 + 1; q1 is the larger where at most k1 of the k1 + k2 + 1 smallest numbers of all are among the first.)

    Examples
    --------
    >>> float(probability_greater(0, 0, 0, 0)), round(float(probability_greater(1, 1, 0, 1)), 12)
    (0.5, 0.833333333333)
    """
    a, n, b, m = np.moveaxis(_tables(k1, n1, k2, n2), -1, 0)
    return np.asarray(hypergeom.cdf(a, n + m + 2, n + 1, a + b + 1))


def holm(p_values: npt.ArrayLike) -> FloatArray:
    """Holm's step-down adjustment of the p-values of one family, shape (tests,); controls the chance of any false claim.

    Examples
    --------
    >>> holm([0.01, 0.04, 0.03]).tolist()
    [0.03, 0.06, 0.06]
    """
    p = np.asarray(p_values, np.float64)
    order = np.argsort(p, kind="stable")
    raised = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(raised, 1.0)
    return adjusted


def _tables(k1: npt.ArrayLike, n1: npt.ArrayLike, k2: npt.ArrayLike, n2: npt.ArrayLike) -> IntArray:
    """Counts as whole numbers, shape (..., 4)."""
    columns = [np.asarray(values) for values in (k1, n1, k2, n2)]
    if any(c.dtype.kind not in "iuf" or not np.isfinite(c).all() or np.any(c != np.floor(c)) for c in columns):
        raise InputError("counts must be whole numbers")
    tables = np.stack(np.broadcast_arrays(*(c.astype(np.int64) for c in columns)), axis=-1)
    if np.any(tables[..., ::2] < 0) or np.any(tables[..., ::2] > tables[..., 1::2]):
        raise InputError("every n_equal must lie in 0..n_trials")
    if np.any((total := tables[..., 1] + tables[..., 3]) > LARGEST_TOTAL):
        raise InputError(f"{total.max()} trials in one comparison: exact tails are computed for at most {LARGEST_TOTAL}")
    return tables


@lru_cache(maxsize=1 << 16)
def _boschloo(k1: int, n1: int, k2: int, n2: int) -> float:
    """Twice the p-value of the side on which the frequencies differ, the smaller one; the same for orders, or answers, swapped."""
    first = min((k1, n1, k2, n2), (k2, n2, k1, n1), (n1 - k1, n1, n2 - k2, n2), (n2 - k2, n2, n1 - k1, n1))
    if first != (k1, n1, k2, n2):
        return _boschloo(*first)
    side, table = "less" if k1 * n2 < k2 * n1 else "greater", [[k1, k2], [n1 - k1, n2 - k2]]
    return min(1.0, 2.0 * float(boschloo_exact(table, alternative=side, n=64).pvalue))  # of 32 points, rarely, none leads to the supremum
