"""Asymmetry between the two orders of a pair, without a model.

`asymmetry` gives an `AsymmetryTable` with estimates, exact tests and counts. A comparison is a pair
of different stimuli in both orders; r is the weaker and c the stronger one. The asymmetry is
q(c, r) - q(r, c), where q(a, b) is the probability of 'equal' with a first and b second. In 'which
is stronger?' q is the probability of a wrong answer. 'Equal' is wrong for different stimuli too, so
the sign means the same in both tasks: where it is positive, the subject is more accurate with the
weaker stimulus first, as the model predicts for a prior mean below the stimuli.

The exact test is Boschloo's. The number of trials of each order is set by the experimenter and the
number of 'equal' answers by nobody, so the data are two independent binomials. Fisher's test
conditions on the total of 'equal' answers as well and is conservative; Boschloo's takes Fisher's
p-value as its statistic and computes that statistic's exact distribution under the two binomials,
at the common probability that is least favourable. It never exceeds its level and its p-value is
never above Fisher's, which it comes close to where trials are many. Two-sided p-values are twice
the smaller one-sided ones: an order effect has a sign, and half the level is spent on each.

Erratum: the paper's sentence on its panel A ('more accurate when the weaker stimulus was presented
first, in which case the blue curve lies below the red one') follows the swapped colours of Fig. 3's
caption. With red = weaker first, as in the text and Fig. 1C, the red curve lies below the blue one
there.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.stats import boschloo_exact, hypergeom

from bayes_toe.arrays import FloatArray
from bayes_toe.classical.frequencies import accuracy, laplace_error, laplace_estimate
from bayes_toe.data.messages import plural
from bayes_toe.data.stimulus_unit import UNKNOWN_UNIT, StimulusUnit
from bayes_toe.data.study import (
    Study,
    Subject,
    pairs_in_both_orders,
    require_study,
)
from bayes_toe.data.tables import SubjectTable
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.errors import InputError

#: Level at which an asymmetry is called significant.
LEVEL = 0.05


@dataclass(frozen=True)
class Comparison:
    """One pair of different stimuli in both orders, and the responses of one subject.

    Attributes
    ----------
    subject : str
    s_weak, s_strong : float
        Natural-log intensities r < c.
    n_equal_weak_first, n_trials_weak_first : int
        Responses 'equal' to (r, c), with the weaker stimulus first (red in the paper). In 'which
        was stronger?', the fields count wrong responses, and the names of the columns say so.
    n_equal_strong_first, n_trials_strong_first : int
        Responses 'equal' to (c, r), with the stronger stimulus first (blue in the paper).
    q_weak_first, q_weak_first_se : float
        Laplace estimator of q(r, c), with the weaker stimulus first, and its uncertainty. Source:
        Eq. e:2b.
    q_strong_first, q_strong_first_se : float
        Laplace estimator of q(c, r), with the stronger stimulus first, and its uncertainty.
    asymmetry : float
        Posterior mean of q(c, r) - q(r, c), from -1 to 1.
    asymmetry_se : float
        Posterior standard deviation of `asymmetry`. The two orders are independent.
    p_value : float
        P-value of the exact two-sided `test`. The null hypothesis is that both orders have the
        same probability of 'equal'.
    p_adjusted : float
        P-value adjusted by Holm's method over the comparisons of this subject.
    test : {"boschloo", "fisher"}
    probability_of_direction : float
        Posterior P(q(c, r) > q(r, c)) with independent uniform priors. The value is near 1 for
        a positive asymmetry, and near 0 for a negative asymmetry.
    is_maximal : bool
        True for the comparison with the largest absolute asymmetry of the subject.
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


ASYMMETRY_COLUMNS = (*(field.name for field in fields(Comparison)), "accuracy")


@dataclass(frozen=True)
class SubjectAsymmetry:
    """Asymmetries of one subject.

    Attributes
    ----------
    subject : str
    accuracy : float
        Share of correct responses over all pairs, from 0 to 1.
    comparisons : tuple of Comparison
        By (s_weak, s_strong); empty where no pair was presented in both orders.
    n_one_order : int
        Pairs of different stimuli left out because they were presented in one order only.
    """

    subject: str
    accuracy: float
    comparisons: tuple[Comparison, ...]
    n_one_order: int

    @property
    def maximal(self) -> Comparison | None:
        """The comparison with the largest absolute asymmetry."""
        return next((row for row in self.comparisons if row.is_maximal), None)


@dataclass(frozen=True)
class AsymmetryTable(SubjectTable[SubjectAsymmetry]):
    """Asymmetries of every subject of a study, in the study's order."""

    task: Task = SAME_DIFFERENT
    unit: StimulusUnit = UNKNOWN_UNIT
    short_columns = ("subject", "s_weak", "s_strong", "asymmetry", "asymmetry_se", "p_adjusted")

    @property
    def has_comparison(self) -> bool:
        """Whether some subject met a pair of different stimuli in both orders."""
        return any(row.comparisons for row in self.rows)

    @property
    def share_of(self) -> str:
        """The responses of which q is the share, in words."""
        answer = self.task.compared_answer
        return f"'{answer}'" if answer == self.task.yes else answer

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the pairs that were presented in one order only."""
        notes = []
        for row in self.rows:
            if not row.comparisons:
                notes.append(
                    f"{row.subject}: no pair of different stimuli was presented in both orders; "
                    "its asymmetry cannot be observed"
                )
            elif row.n_one_order:
                pairs = "pair was" if row.n_one_order == 1 else "pairs were"
                notes.append(
                    f"{row.subject}: {row.n_one_order} {pairs} presented in one order only "
                    "and left out"
                )
        return tuple(notes)

    def _full_frame(self) -> pd.DataFrame:
        """One row per subject and comparison, with the columns of asymmetry.csv.

        In 'which is stronger?' the columns n_wrong take the place of the columns n_equal.
        """
        rows = []
        for row in self.rows:
            for comparison in row.comparisons:
                values = [getattr(comparison, key) for key in ASYMMETRY_COLUMNS[:-1]]
                rows.append([*values, row.accuracy])
        columns = [key.replace("equal", self.task.compared_answer) for key in ASYMMETRY_COLUMNS]
        return pd.DataFrame(rows, columns=columns)

    def describe(self) -> str:
        """The numbers of positive and negative maximal asymmetries, in sentences.

        Source: Results, 'Across participants, 6 showed positive maximal asymmetries (5 significant
        at p < 0.05) ...'. The data choose the maximum, so 'significant' means Holm's p-value over
        the subject's comparisons. There is no correction over subjects.
        """
        maxima = [row.maximal for row in self.rows if row.maximal is not None]
        level, total = f"{LEVEL:g}".removeprefix("0"), plural(len(maxima), "subject")
        sentences = ["The counts are for the pair of each subject whose two orders differ most."]
        for sign, stimulus in ((1, "stronger"), (-1, "weaker")):
            side = [row for row in maxima if sign * row.asymmetry > 0]
            significant = sum(row.p_value < LEVEL for row in side)
            corrected = sum(row.p_adjusted < LEVEL for row in side)
            sentences.append(
                f"{len(side)} of {total} gave more {self.share_of} responses with the {stimulus} "
                "stimulus first than in the other order. The difference is significant "
                f"(p < {level}) in {significant} of them, in {corrected} after Holm's correction."
            )
        return " ".join(sentences)


def asymmetry(study: Study) -> AsymmetryTable:
    """For every subject, compare the two orders of each pair without a model.

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
        If no subject met a pair of different stimuli in both orders.

    Examples
    --------
    >>> one = Subject("S01", [0.0, 0.3], [0.3, 0.0], [12, 25], [50, 50])
    >>> found = asymmetry(Study([one]))["S01"].maximal
    >>> round(found.asymmetry, 3), round(found.p_value, 4), round(found.probability_of_direction, 4)
    (0.25, 0.0073, 0.9963)
    """
    require_study(study)
    table = asymmetry_table(study)
    if not table.has_comparison:
        raise InputError(
            f"{study.source}: no pair of different stimuli was presented in both orders to one "
            "subject, so its asymmetry cannot be observed; sample the posterior for what the model "
            "predicts"
        )
    return table


def asymmetry_table(study: Study) -> AsymmetryTable:
    """The table of :func:`asymmetry`, perhaps without a comparison."""
    return AsymmetryTable(tuple(map(subject_asymmetry, study)), study.task, study.unit)


def subject_asymmetry(subject: Subject) -> SubjectAsymmetry:
    """Asymmetries of one subject.

    There is no comparison if no pair was presented in both orders.
    """
    weak_rows, strong_rows = pairs_in_both_orders(subject).T
    n_wrong = subject.task.wrong(subject.s2 - subject.s1, subject.n_yes, subject.n_trials)
    counts = np.stack([n_wrong, subject.n_trials])
    weak, strong = counts[:, weak_rows], counts[:, strong_rows]
    tests = equality_test(*strong, *weak)
    q_weak, q_strong = laplace_estimate(*weak), laplace_estimate(*strong)
    se_weak, se_strong = laplace_error(*weak), laplace_error(*strong)
    difference = q_strong - q_weak
    # Of two alike, the one with the smaller p-value.
    largest_first = np.lexsort((tests.p_value, -np.abs(difference).round(12)))
    is_maximal = np.zeros(len(weak_rows), bool)
    is_maximal[largest_first[:1]] = True
    # In the order of the fields of a comparison.
    stimuli = (subject.s1[weak_rows], subject.s2[weak_rows])
    frequencies = (q_weak, se_weak, q_strong, se_strong, difference, np.hypot(se_weak, se_strong))
    test = (tests.p_value, holm(tests.p_value), tests.test, probability_greater(*strong, *weak))
    columns = (*stimuli, *weak, *strong, *frequencies, *test, is_maximal)
    lists = [column.tolist() for column in columns]
    comparisons = tuple(Comparison(subject.name, *values) for values in zip(*lists, strict=True))
    different = {frozenset(pair) for pair in subject.pairs if pair[0] != pair[1]}
    n_one_order = len(different) - len(comparisons)
    return SubjectAsymmetry(subject.name, accuracy(subject), comparisons, n_one_order)


#: Most trials n1 + n2 of Boschloo's test, which takes 6 ms at 100 and 25 ms at 150; beyond it,
#: Fisher's test is used.
BOSCHLOO_TRIALS = 150


class ExactTest(NamedTuple):
    """Two-sided p-values and the test of each, 'boschloo' or 'fisher'."""

    p_value: FloatArray
    test: npt.NDArray[np.str_]


def equality_test(
    k1: npt.ArrayLike, n1: npt.ArrayLike, k2: npt.ArrayLike, n2: npt.ArrayLike
) -> ExactTest:
    """Exact two-sided test that k1 of n1 and k2 of n2 have one probability, arrays of one shape.

    Boschloo's test; Fisher's, doubled one-sided, for more than :data:`BOSCHLOO_TRIALS` trials.

    Examples
    --------
    >>> found = equality_test([7, 25], [12, 50], [8, 45], [8, 50])
    >>> [round(float(p), 6) for p in found.p_value]
    [0.036824, 1.3e-05]
    """
    tables = np.stack([k1, n1, k2, n2], axis=-1)
    a, n, b, m = np.moveaxis(tables, -1, 0)
    is_small = (n + m <= BOSCHLOO_TRIALS) & (n > 0) & (m > 0)
    tails = np.minimum(hypergeom.cdf(a, n + m, n, a + b), hypergeom.cdf(b, n + m, m, a + b))
    p_value = np.array(np.minimum(1.0, 2.0 * tails))
    p_value[is_small] = [_boschloo(*table) for table in tables[is_small].tolist()]
    return ExactTest(p_value, np.where(is_small, "boschloo", "fisher"))


def probability_greater(
    k1: npt.ArrayLike, n1: npt.ArrayLike, k2: npt.ArrayLike, n2: npt.ArrayLike
) -> FloatArray:
    """Posterior P(q1 > q2) under independent uniform priors.

    q1 ~ Beta(k1 + 1, n1 - k1 + 1), q2 ~ Beta(k2 + 1, n2 - k2 + 1); P(q1 > q2) = P(H <= k1) with H
    the number of marked items among k1 + k2 + 1 drawn from n1 + n2 + 2 of which n1 + 1 are marked.
    (q1 is an order statistic of n1 + 1 uniform numbers, q2 one of n2 + 1; q1 is the larger where at
    most k1 of the k1 + k2 + 1 smallest numbers of all are among the first.)

    Examples
    --------
    >>> float(probability_greater(0, 0, 0, 0)), round(float(probability_greater(1, 1, 0, 1)), 12)
    (0.5, 0.833333333333)
    """
    k1, n1, k2, n2 = map(np.asarray, (k1, n1, k2, n2))
    return hypergeom.cdf(k1, n1 + n2 + 2, n1 + 1, k1 + k2 + 1)


def holm(p_values: npt.ArrayLike) -> FloatArray:
    """Holm's adjustment of p-values, shape (tests,), which controls the chance of any false claim.

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


@lru_cache(maxsize=1 << 16)
def _boschloo(k1: int, n1: int, k2: int, n2: int) -> float:
    """Twice the smaller one-sided p-value; the same with orders, or answers, exchanged."""
    l1, l2 = n1 - k1, n2 - k2
    smallest = min((k1, n1, k2, n2), (k2, n2, k1, n1), (l1, n1, l2, n2), (l2, n2, l1, n1))
    if smallest != (k1, n1, k2, n2):
        return _boschloo(*smallest)
    side = "less" if k1 * n2 < k2 * n1 else "greater"
    # Of 32 points, rarely, none leads to the supremum.
    p_value = boschloo_exact([[k1, k2], [l1, l2]], alternative=side, n=64).pvalue
    return min(1.0, 2.0 * float(p_value))
