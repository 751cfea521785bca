"""Two frequencies compared exactly: whether two sets of yes/no answers share one probability, and which of the two is larger.

The test is Boschloo's. The number of trials of each order is set by the experimenter and the number of 'equal' answers by nobody, so the
data are two independent binomials. Fisher's test conditions on the total of 'equal' answers as well and is conservative; Boschloo's takes
Fisher's p-value as its statistic and computes that statistic's exact distribution under the two binomials, at the common probability that
is least favourable. It never exceeds its level and its p-value is never above Fisher's. Barnard's test, with the score statistic, has
about the same power, but orders tables by an approximation.

Two-sided p-values are twice the smaller one-sided ones: an order effect has a sign, and half the level is spent on each.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import gammaln

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.errors import InputError

#: Largest (n1 + 1)(n2 + 1) for Boschloo's test; beyond it, Fisher's is used, from which it hardly differs there.
LARGEST_TABLE = 1_000_000
#: Most trials in one comparison whose tails are summed term by term.
LARGEST_TOTAL = 10**10
_TIE = 1.0 + 1e-10  # statistics closer than this are one value: ties are exact in theory, not in floating point
_SHORT = 1_000_000  # a distribution with fewer values is summed whole


class ExactTest(NamedTuple):
    """Two-sided p-values and the test that gave each, 'boschloo' or 'fisher', both of the shape of the counts."""

    p_value: FloatArray
    test: npt.NDArray[np.str_]


def equality_test(k1: npt.ArrayLike, n1: npt.ArrayLike, k2: npt.ArrayLike, n2: npt.ArrayLike) -> ExactTest:
    """Exact two-sided test of the null that k1 of n1 and k2 of n2 come from one probability. Arguments broadcast.

    Boschloo's test; Fisher's, doubled one-sided, for tables of more than :data:`LARGEST_TABLE` cells.

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
    found = [_test_one(*(int(value) for value in row)) for row in tables.reshape(-1, 4)]
    shape = tables.shape[:-1]
    return ExactTest(np.array([p for p, _ in found], np.float64).reshape(shape), np.array([test for _, test in found], str).reshape(shape))


def fisher_p_value(k1: npt.ArrayLike, n1: npt.ArrayLike, k2: npt.ArrayLike, n2: npt.ArrayLike) -> FloatArray:
    """Fisher's exact p-value, two-sided by doubling the smaller tail. Arguments broadcast.

    Examples
    --------
    >>> round(float(fisher_p_value(2, 5, 5, 5)), 6) == round(2 * 10 / 120, 6)
    True
    """
    tables = _tables(k1, n1, k2, n2)
    values = [min(1.0, 2.0 * min(hypergeometric_tails(a, n, b + a, m))) for a, n, b, m in tables.reshape(-1, 4).tolist()]
    return np.array(values, np.float64).reshape(tables.shape[:-1])


def probability_greater(k1: npt.ArrayLike, n1: npt.ArrayLike, k2: npt.ArrayLike, n2: npt.ArrayLike) -> FloatArray:
    """Posterior probability that the first probability exceeds the second, under independent uniform priors. Arguments broadcast.

    q1 ~ Beta(k1 + 1, n1 - k1 + 1), q2 ~ Beta(k2 + 1, n2 - k2 + 1); P(q1 > q2) = P(H <= k1) with H the number of marked items among
    k1 + k2 + 1 drawn from n1 + n2 + 2 of which n1 + 1 are marked. (q1 is an order statistic of n1 + 1 uniform numbers, q2 one of
    n2 + 1; q1 is the larger where at most k1 of the k1 + k2 + 1 smallest numbers of all are among the first.) A finite sum of positive
    terms: exact, and accurate in both tails.

    Examples
    --------
    >>> float(probability_greater(0, 0, 0, 0)), round(float(probability_greater(1, 1, 0, 1)), 12)
    (0.5, 0.833333333333)
    """
    tables = _tables(k1, n1, k2, n2)
    values = [hypergeometric_tails(a, n + 1, a + b + 1, m + 1)[0] for a, n, b, m in tables.reshape(-1, 4).tolist()]
    return np.array(values, np.float64).reshape(tables.shape[:-1])


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


def hypergeometric_tails(x: int, marked: int, drawn: int, unmarked: int) -> tuple[float, float]:
    """P(H <= x) and P(H >= x) of the number H of marked items among `drawn`; each a sum of positive terms, accurate when small.

    Terms follow from the ratio of neighbours, starting at the mode, so no factorial is formed.
    """
    if marked + unmarked > LARGEST_TOTAL:
        raise InputError(f"{marked + unmarked} trials in one comparison: exact tails are computed for at most {LARGEST_TOTAL}")
    low, high = _window(marked, drawn, unmarked)
    at = np.arange(low, high, dtype=np.float64)
    steps = np.log((marked - at) / (at + 1.0)) + np.log((drawn - at) / (unmarked - drawn + at + 1.0))
    log_weights = np.concatenate([[0.0], np.cumsum(steps)])
    weights = np.exp(log_weights - log_weights.max())
    split = min(max(x - low, -1), len(weights))
    return _share(weights, split + 1)[0], _share(weights, max(split, 0))[1]


def _share(weights: FloatArray, cut: int) -> tuple[float, float]:
    """Shares of the weights before and from a place on; neither exceeds 1."""
    before, after = float(weights[:cut].sum()), float(weights[cut:].sum())
    return before / (before + after), after / (before + after)


def _window(marked: int, drawn: int, unmarked: int) -> tuple[int, int]:
    """First and last value of H with a probability above the smallest float."""
    low, high = max(0, drawn - unmarked), min(drawn, marked)
    if high - low <= _SHORT:
        return low, high
    total = marked + unmarked
    mean = drawn * (marked / total)
    sd = np.sqrt(mean * (unmarked / total) * ((total - drawn) / (total - 1.0)))
    reach = int(40.0 * sd) + 1000  # the second term is for skewed distributions, whose tails reach farther than a normal one's
    return max(low, int(mean) - reach), min(high, int(mean) + reach)


def _tables(k1: npt.ArrayLike, n1: npt.ArrayLike, k2: npt.ArrayLike, n2: npt.ArrayLike) -> IntArray:
    """Counts as whole numbers, shape (..., 4)."""
    columns = [np.asarray(values) for values in (k1, n1, k2, n2)]
    if any(c.dtype.kind not in "iuf" or not np.isfinite(c).all() or np.any(c != np.floor(c)) for c in columns):
        raise InputError("counts must be whole numbers")
    tables = np.stack(np.broadcast_arrays(*(c.astype(np.int64) for c in columns)), axis=-1)
    if np.any(tables[..., ::2] < 0) or np.any(tables[..., ::2] > tables[..., 1::2]):
        raise InputError("every n_equal must lie in 0..n_trials")
    return tables


def _test_one(k1: int, n1: int, k2: int, n2: int) -> tuple[float, str]:
    if (n1 + 1) * (n2 + 1) > LARGEST_TABLE:
        return float(fisher_p_value(k1, n1, k2, n2)), "fisher"
    smaller = min(_boschloo_less(k1, n1, k2, n2), _boschloo_less(k2, n2, k1, n1))
    return min(1.0, 2.0 * smaller), "boschloo"


# --- Boschloo's test, one side ----------------------------------------------------------------------


def _boschloo_less(k1: int, n1: int, k2: int, n2: int) -> float:
    """One-sided p-value against the first probability being the smaller: sup over pi of P(statistic <= observed | pi)."""
    statistic = _fisher_statistics(n1, n2)
    # Fisher's statistic grows with a and falls with b, so for each b the extreme tables are those with a below a count.
    counts = (statistic <= statistic[k1, k2] * _TIE).sum(axis=0)
    angles = _angles(n1, n2)
    values = _tail(counts, _binomial(n1, angles), _binomial(n2, angles))
    return _refined(counts, (n1, n2), np.asarray(angles), values)


@lru_cache(maxsize=16)
def _fisher_statistics(n1: int, n2: int) -> FloatArray:
    """P(A <= a | A + B = a + b) for all tables, shape (n1 + 1, n2 + 1): Fisher's one-sided p-value."""
    a, total = np.arange(n1 + 1), np.arange(n1 + n2 + 1)[:, None]
    b = total - a
    inside = (b >= 0) & (b <= n2)
    log_choose2 = _log_choose(n2)[np.where(inside, b, 0)]
    mass = np.where(inside, np.exp(_log_choose(n1)[a] + log_choose2 - _log_choose(n1 + n2)[total]), 0.0)
    tails = np.cumsum(mass, axis=1)
    return np.asarray(tails[a[:, None] + np.arange(n2 + 1), a[:, None]])


def _log_choose(n: int) -> FloatArray:
    k = np.arange(n + 1.0)
    return np.asarray(gammaln(n + 1.0) - gammaln(k + 1.0) - gammaln(n - k + 1.0))


@lru_cache(maxsize=16)
def _angles(n1: int, n2: int) -> tuple[float, ...]:
    """Common probabilities sin^2(angle): in the angle, tails vary over 1/sqrt(n1 + n2) everywhere; the grid has a tenth of it."""
    points = 64 + int(16.0 * np.sqrt(n1 + n2))
    return tuple(((np.arange(points) + 0.5) * (0.5 * np.pi / points)).tolist())


@lru_cache(maxsize=16)
def _binomial(n: int, angles: tuple[float, ...]) -> FloatArray:
    return _binomial_mass(n, np.asarray(angles))


def _binomial_mass(n: int, angles: FloatArray) -> FloatArray:
    """P(k | n, sin^2 angle), shape (angles, n + 1)."""
    k = np.arange(n + 1.0)
    return np.exp(_log_choose(n) + 2.0 * (np.outer(np.log(np.sin(angles)), k) + np.outer(np.log(np.cos(angles)), n - k)))


def _tail(counts: IntArray, first: FloatArray, second: FloatArray) -> FloatArray:
    """P(extreme tables) at each probability, from the binomial masses (probabilities, n + 1) of both sides."""
    below = np.concatenate([np.zeros((len(first), 1)), np.cumsum(first, axis=1)], axis=1)
    return np.asarray((below[:, counts] * second).sum(axis=1))


def _refined(counts: IntArray, sizes: tuple[int, int], angles: FloatArray, values: FloatArray) -> float:
    """The largest tail probability, from the three best points of the grid by repeated subdivision of their neighbourhoods."""
    edged = np.concatenate([[-1.0], values, [-1.0]])
    peaks = np.flatnonzero((values >= edged[:-2]) & (values >= edged[2:]))
    centres = angles[peaks[np.argsort(-values[peaks])[:3]]]
    best, reach = float(values.max()), float(angles[1] - angles[0])
    for _ in range(5):
        points = np.clip(centres[:, None] + reach * np.linspace(-1.0, 1.0, 17), 1e-9, 0.5 * np.pi - 1e-9)
        flat = points.ravel()
        found = _tail(counts, _binomial_mass(sizes[0], flat), _binomial_mass(sizes[1], flat)).reshape(points.shape)
        centres = points[np.arange(len(points)), found.argmax(axis=1)]
        best, reach = max(best, float(found.max())), reach / 8.0
    return best
