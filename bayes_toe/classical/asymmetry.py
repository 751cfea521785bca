"""Time-order asymmetry without a model: q(c, r) - q(r, c) of every comparison, its test, its sign, and counts over the population.

A comparison is a pair of different stimuli that was presented in both orders: r the weaker, c the stronger. The asymmetry is positive
where 'equal' is the likelier answer with the stronger stimulus first; the subject is then more accurate with the weaker one first, as the
model predicts for a prior mean below the stimuli. Of 'which is stronger?' q is the probability of the wrong answer, as 'equal' is one, so
that the sign means the same.

Erratum: the paper's sentence on its panel A ('more accurate when the weaker stimulus was presented first, in which case the blue curve
lies below the red one') follows the swapped colours of Fig. 3's caption. With red = weaker first, as in the text and Fig. 1C, the red curve
lies below the blue one there.

The exact test is Boschloo's. The number of trials of each order is set by the experimenter and the number of 'equal' answers by nobody, so
the data are two independent binomials. Fisher's test conditions on the total of 'equal' answers as well and is conservative; Boschloo's
takes Fisher's p-value as its statistic and computes that statistic's exact distribution under the two binomials, at the common probability
that is least favourable. It never exceeds its level and its p-value is never above Fisher's, which it comes close to where trials are many.
Two-sided p-values are twice the smaller one-sided ones: an order effect has a sign, and half the level is spent on each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.stats import boschloo_exact, hypergeom

from bayes_toe.arrays import FloatArray, IndexArray, IntArray
from bayes_toe.classical.frequencies import accuracy, laplace_error, laplace_estimate
from bayes_toe.data.messages import counted
from bayes_toe.data.study import Study, Subject, refuse_intervals, require_study
from bayes_toe.data.tables import SubjectTable
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER, Task
from bayes_toe.errors import InputError

#: What q is the share of, in words.
SHARE_OF = {SAME_DIFFERENT: "'equal'", WHICH_STRONGER: "wrong"}
#: Level at which an asymmetry is called significant.
LEVEL = 0.05


@dataclass(frozen=True)
class Comparison:
    """One pair of different stimuli in both orders, answered by one subject.

    Attributes
    ----------
    subject : str
    s_weak, s_strong : float
        Natural-log intensities r < c.
    n_equal_weak_first, n_trials_weak_first : int
        Answers to (r, c): the weaker stimulus first, the paper's red. Of 'which is stronger?' the wrong ones, here and below; files say so.
    n_equal_strong_first, n_trials_strong_first : int
        Answers to (c, r): the stronger stimulus first, the paper's blue.
    q_weak_first : float
        Laplace estimator of q(r, c). Source: Eq. e:2b.
    q_strong_first : float
        Laplace estimator of q(c, r). Source: Eq. e:2b.
    q_weak_first_se, q_strong_first_se : float
        Their uncertainties.
    asymmetry : float
        q(c, r) - q(r, c), the posterior mean of the difference, -1..1.
    asymmetry_se : float
        Posterior standard deviation of the difference; both orders are independent.
    p_value : float
        Exact two-sided test of the null that both orders share one probability; `test` names it (:mod:`bayes_toe.classical.asymmetry`).
    p_adjusted : float
        The same by Holm's method over the comparisons of this subject.
    test : {"boschloo", "fisher"}
    probability_of_direction : float
        Posterior P(q(c, r) > q(r, c)) under independent uniform priors: near 1 a positive asymmetry, near 0 a negative one.
    is_maximal : bool
        True for the comparison of the subject with the largest absolute asymmetry.
    """

    subject: str
    s_weak: float
    s_strong: float
    n_equal_weak_first: int
    n_trials_weak_first: int
    n_equal_strong_first: int
    n_trials_strong_first: int
    q_weak_first: float
    q_weak_first_se: float
    q_strong_first: float
    q_strong_first_se: float
    asymmetry: float
    asymmetry_se: float
    p_value: float
    p_adjusted: float
    test: str
    probability_of_direction: float
    is_maximal: bool


ASYMMETRY_COLUMNS = (*(one.name for one in fields(Comparison)), "accuracy")


@dataclass(frozen=True)
class SubjectAsymmetry:
    """Asymmetries of one subject.

    Attributes
    ----------
    subject : str
    accuracy : float
        Share of correct answers, all pairs, 0..1.
    comparisons : tuple of Comparison
        By (s_weak, s_strong); empty where no pair was presented in both orders.
    n_one_order : int
        Pairs of different stimuli left out because they were presented in one order only.
    pooled : bool
        False for a subject with intervals (column isi), whose pairs are not pooled over them: there are no comparisons then.
    """

    subject: str
    accuracy: float
    comparisons: tuple[Comparison, ...]
    n_one_order: int
    pooled: bool = True

    @property
    def maximal(self) -> Comparison | None:
        """The comparison with the largest absolute asymmetry."""
        return next((one for one in self.comparisons if one.is_maximal), None)

    @property
    def mean_asymmetry(self) -> float:
        """Mean of the asymmetries over comparisons; NaN where there is none."""
        return (
            float(np.mean([one.asymmetry for one in self.comparisons]))
            if self.comparisons
            else float("nan")
        )

    @property
    def mean_absolute_asymmetry(self) -> float:
        """Mean of the absolute asymmetries over comparisons; NaN where there is none."""
        return (
            float(np.mean([abs(one.asymmetry) for one in self.comparisons]))
            if self.comparisons
            else float("nan")
        )


@dataclass(frozen=True)
class Population:
    """How many subjects have a positive and a negative maximal asymmetry, and how many of them significantly.

    Source: Results, 'Across participants, 6 showed positive maximal asymmetries (5 significant at p < 0.05) ...'. The maximum is chosen by
    the data, so `significant` means Holm's p-value over the subject's comparisons below `level`; `uncorrected` takes the plain p-value.
    No correction over subjects.
    """

    level: float
    n_subjects: int
    positive: int
    positive_significant: int
    positive_uncorrected: int
    negative: int
    negative_significant: int
    negative_uncorrected: int

    def describe(self) -> str:
        """One line for terminals and reports."""
        positive = (self.positive, "positive", self.positive_significant, self.positive_uncorrected)
        negative = (self.negative, "negative", self.negative_significant, self.negative_uncorrected)
        level = f"{self.level:g}".removeprefix("0")
        words = f"{{}} {{}} ({{}} significant at p < {level}, {{}} before correction)"
        return (
            f"Largest asymmetry of {counted(self.n_subjects, 'subject')}: "
            f"{words.format(*positive)}, {words.format(*negative)}"
        )


@dataclass(frozen=True)
class AsymmetryTable(SubjectTable[SubjectAsymmetry]):
    """Asymmetries of every subject of a study, in the study's order."""

    task: Task = SAME_DIFFERENT

    @property
    def share_of(self) -> str:
        """What q is the share of, in words."""
        return SHARE_OF[self.task]

    @property
    def notes(self) -> tuple[str, ...]:
        """What the design does not show: pairs presented in one order only."""
        found = []
        for row in self.rows:
            if row.pooled and not row.comparisons:
                found.append(
                    f"{row.subject}: no pair of different stimuli was presented in both orders; its asymmetry cannot be observed"
                )
            elif row.pooled and row.n_one_order:
                what = "pair was" if row.n_one_order == 1 else "pairs were"
                found.append(
                    f"{row.subject}: {row.n_one_order} {what} presented in one order only and left out"
                )
        return tuple(found)

    def frame(self) -> pd.DataFrame:
        """One row per subject and comparison, with the columns of asymmetry.csv, n_wrong for n_equal of 'which is stronger?'."""
        rows = [
            [*(getattr(one, key) for key in ASYMMETRY_COLUMNS[:-1]), row.accuracy]
            for row in self.rows
            for one in row.comparisons
        ]
        counted = "n_equal" if self.task == SAME_DIFFERENT else "n_wrong"
        return pd.DataFrame(
            rows, columns=[key.replace("n_equal", counted) for key in ASYMMETRY_COLUMNS]
        )

    def subjects(self) -> pd.DataFrame:
        """One row per subject: accuracy, mean and mean absolute asymmetry, and the comparison where it is largest."""
        keys = (
            "s_weak",
            "s_strong",
            "asymmetry",
            "asymmetry_se",
            "p_value",
            "p_adjusted",
            "probability_of_direction",
        )
        names = [f"maximal_{key}" if key.startswith("asymmetry") else key for key in keys]
        means = ("mean_asymmetry", "mean_absolute_asymmetry")
        rows = [
            (row.subject, row.accuracy, len(row.comparisons), *(getattr(row, key) for key in means),
             *(getattr(row.maximal, key, None) for key in keys))
            for row in self.rows
        ]  # fmt: skip
        return pd.DataFrame(rows, columns=["subject", "accuracy", "n_comparisons", *means, *names])

    def population(self, level: float = LEVEL) -> Population:
        """Signs of the maximal asymmetries over the subjects that have a comparison."""
        found = [row.maximal for row in self.rows if row.maximal is not None]
        sides = [[one for one in found if sign * one.asymmetry > 0] for sign in (1, -1)]
        counts = [
            (
                len(side),
                sum(one.p_adjusted < level for one in side),
                sum(one.p_value < level for one in side),
            )
            for side in sides
        ]
        return Population(level, len(found), *counts[0], *counts[1])


def asymmetry(study: Study) -> AsymmetryTable:
    """Model-free asymmetry of every subject and comparison of a study.

    Parameters
    ----------
    study : Study
        Its stimuli are natural-log intensities.

    Returns
    -------
    AsymmetryTable
        Its notes name the pairs that were presented in one order only.

    Raises
    ------
    InputError
        If no subject met any pair of different stimuli in both orders, or the study has intervals (column isi).

    Examples
    --------
    >>> one = Subject("S01", [0.0, 0.3], [0.3, 0.0], [12, 25], [50, 50])
    >>> found = asymmetry(Study([one]))["S01"].maximal
    >>> round(found.asymmetry, 3), round(found.p_value, 4), round(found.probability_of_direction, 4)
    (0.25, 0.0073, 0.9963)
    """
    require_study(study)
    refuse_intervals(study, "asymmetry")
    table = AsymmetryTable(subject_asymmetries(study.subjects), study.task)
    if not any(row.comparisons for row in table):
        raise InputError(
            f"{study.source}: no pair of different stimuli was presented in both orders to one subject, so its asymmetry cannot be "
            "observed; sample the posterior for what the model predicts"
        )
    return table


def subject_asymmetry(subject: Subject) -> SubjectAsymmetry:
    """Model-free asymmetries of one subject; no comparison where no pair was presented in both orders, or with intervals."""
    return subject_asymmetries([subject])[0]


def subject_asymmetries(subjects: Sequence[Subject]) -> tuple[SubjectAsymmetry, ...]:
    """Those of many subjects, all comparisons in one call of the tests."""
    orders = [_orders(subject) for subject in subjects]
    counts = [
        np.stack([one.task.wrong(one.s2 - one.s1, one.n_yes, one.n_trials), one.n_trials])
        for one in subjects
    ]
    weak, strong = (
        np.concatenate(
            [one[:, at[:, i]] for one, (at, _) in zip(counts, orders, strict=True)], axis=1
        )
        for i in (0, 1)
    )
    tested, direction = equality_test(*strong, *weak), probability_greater(*strong, *weak)
    q, error = ((of(*weak), of(*strong)) for of in (laplace_estimate, laplace_error))
    estimates = [q[0], error[0], q[1], error[1], q[1] - q[0], np.hypot(*error)]
    found, first = [], 0
    for one, (at, left_out) in zip(subjects, orders, strict=True):
        some = slice(first, first := first + len(at))
        p_value, size = tested.p_value[some], np.abs(estimates[4][some])
        maximal = np.zeros(len(at), bool)
        maximal[np.lexsort((p_value, -size))[:1]] = (
            True  # of two alike, the one that is better established
        )
        counted = [
            one.s1[at[:, 0]],
            one.s2[at[:, 0]],
            *weak[:, some],
            *strong[:, some],
            *(values[some] for values in estimates),
        ]
        judged = [p_value, holm(p_value), tested.test[some], direction[some], maximal]
        rows = zip(*(column.tolist() for column in (*counted, *judged)), strict=True)
        comparisons = tuple(Comparison(one.name, *row) for row in rows)
        found.append(
            SubjectAsymmetry(one.name, accuracy(one), comparisons, left_out, pooled=one.isi is None)
        )
    return tuple(found)


def _orders(subject: Subject) -> tuple[IndexArray, int]:
    """Which pairs are the two orders of comparisons, weaker first and stronger first, (comparisons, 2); how many lack an order."""
    if subject.isi is not None:
        return np.empty((0, 2), np.intp), 0
    at = {
        pair: i for i, pair in enumerate(zip(subject.s1.tolist(), subject.s2.tolist(), strict=True))
    }
    unequal = {(min(pair), max(pair)) for pair in at if pair[0] != pair[1]}
    both = sorted(pair for pair in unequal if pair in at and pair[::-1] in at)
    return np.array([(at[pair], at[pair[::-1]]) for pair in both], np.intp).reshape(-1, 2), len(
        unequal
    ) - len(both)


#: Most trials n1 + n2 of Boschloo's test, of which SciPy's takes 6 ms at 100 and 25 ms at 150; beyond it, Fisher's is used.
BOSCHLOO_TRIALS = 150
#: Most trials in one comparison of which tails keep six digits.
LARGEST_TOTAL = 10**10


class ExactTest(NamedTuple):
    """Two-sided p-values and the test that gave each, 'boschloo' or 'fisher', both of the shape of the counts."""

    p_value: FloatArray
    test: npt.NDArray[np.str_]


def equality_test(
    k1: npt.ArrayLike, n1: npt.ArrayLike, k2: npt.ArrayLike, n2: npt.ArrayLike
) -> ExactTest:
    """Exact two-sided test of the null that k1 of n1 and k2 of n2 come from one probability. Arguments broadcast.

    Boschloo's test; Fisher's, doubled one-sided, for more than :data:`BOSCHLOO_TRIALS` trials n1 + n2.

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


def probability_greater(
    k1: npt.ArrayLike, n1: npt.ArrayLike, k2: npt.ArrayLike, n2: npt.ArrayLike
) -> FloatArray:
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
    """Counts, shape (..., 4)."""
    tables = np.stack(
        np.broadcast_arrays(*(np.asarray(values, np.int64) for values in (k1, n1, k2, n2))), axis=-1
    )
    if np.any((total := tables[..., 1] + tables[..., 3]) > LARGEST_TOTAL):
        raise InputError(
            f"{total.max()} trials in one comparison: exact tails are computed for at most {LARGEST_TOTAL}"
        )
    return tables


@lru_cache(maxsize=1 << 16)
def _boschloo(k1: int, n1: int, k2: int, n2: int) -> float:
    """Twice the p-value of the side on which the frequencies differ, the smaller one; the same for orders, or answers, swapped."""
    first = min(
        (k1, n1, k2, n2), (k2, n2, k1, n1), (n1 - k1, n1, n2 - k2, n2), (n2 - k2, n2, n1 - k1, n1)
    )
    if first != (k1, n1, k2, n2):
        return _boschloo(*first)
    side, table = "less" if k1 * n2 < k2 * n1 else "greater", [[k1, k2], [n1 - k1, n2 - k2]]
    return min(
        1.0, 2.0 * float(boschloo_exact(table, alternative=side, n=64).pvalue)
    )  # of 32 points, rarely, none leads to the supremum
