"""Asymmetry between the two orders of a pair, without a model.

`asymmetry` gives an `AsymmetryTable` with estimates, exact tests and counts. A comparison is a pair
of different stimuli in both orders; r is the weaker and c the stronger stimulus. The asymmetry is
q(c, r) - q(r, c), where q(a, b) is the probability of 'equal' with a first and b second. In 'which
is stronger?' q is the probability of a wrong answer. 'Equal' is wrong for different stimuli too, so
the sign means the same in both tasks: where it is positive, the subject is more accurate with the
weaker stimulus first, as the model predicts for a prior mean below the stimuli.

The exact test is Boschloo's. The number of trials of each order is set by the experimenter and the
number of 'equal' answers by nobody, so the data are two independent binomials. Fisher's test
conditions on the total of 'equal' answers as well and is conservative; Boschloo's takes Fisher's
p-value as its statistic and computes that statistic's exact distribution under the two binomials,
at the common probability that is least favourable. The test never exceeds its level, and its
p-value is never above Fisher's. With many trials the two p-values are close. A two-sided p-value is
twice the smaller one-sided p-value: an order effect has a sign, and each sign has half the level.

Erratum: the paper's sentence on its panel A ('more accurate when the weaker stimulus was presented
first, in which case the blue curve lies below the red one') follows the swapped colours of Fig. 3's
caption. With red = weaker first, as in the text and Fig. 1C, the red curve lies below the blue one
there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import starmap
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.stats import boschloo_exact, fisher_exact

from bayes_toe.arrays import FloatArray
from bayes_toe.classical.frequencies import accuracy, laplace_error, laplace_estimate
from bayes_toe.data.messages import plural
from bayes_toe.data.stimulus_unit import StimulusUnit
from bayes_toe.data.study import (
    Study,
    Subject,
    pairs_in_both_orders,
    require_study,
)
from bayes_toe.data.tables import SubjectTable
from bayes_toe.data.tasks import Task
from bayes_toe.errors import InputError

#: Columns of asymmetry.csv, see docs/data_dictionary.md. In 'which was stronger?', the columns
#: n_wrong take the place of the columns n_equal.
ASYMMETRY_COLUMNS = (
    "subject",
    "s_weak",
    "s_strong",
    "n_equal_weak_first",
    "n_trials_weak_first",
    "n_equal_strong_first",
    "n_trials_strong_first",
    "q_weak_first",
    "q_weak_first_se",
    "q_strong_first",
    "q_strong_first_se",
    "asymmetry",
    "asymmetry_se",
    "p_value",
    "p_adjusted",
    "test",
    "is_maximal",
    "accuracy",
)


@dataclass(frozen=True, eq=False)
class SubjectAsymmetry:
    """Asymmetries of one subject.

    Attributes
    ----------
    subject : str
    accuracy : float
        Share of correct responses over all pairs, from 0 to 1.
    comparisons : DataFrame
        A row for each pair that was presented in both orders, with :data:`ASYMMETRY_COLUMNS`.
    """

    subject: str
    accuracy: float
    comparisons: pd.DataFrame

    @property
    def maximal(self) -> Any:
        """The row with the largest absolute asymmetry, a named tuple; None without comparisons."""
        return next(self.comparisons[self.comparisons["is_maximal"]].itertuples(), None)


@dataclass(frozen=True)
class AsymmetryTable(SubjectTable[SubjectAsymmetry]):
    """Asymmetries of every subject of a study, in the study's order."""

    task: Task
    unit: StimulusUnit
    short_columns = ("subject", "s_weak", "s_strong", "asymmetry", "asymmetry_se", "p_adjusted")

    @property
    def has_comparison(self) -> bool:
        """Whether any subject met a pair of different stimuli in both orders."""
        return any(len(row.comparisons) for row in self.rows)

    @property
    def share_of(self) -> str:
        """The responses whose share is q: 'equal', with quotes, or wrong, without quotes."""
        answer = self.task.compared_answer
        return f"'{answer}'" if answer == self.task.yes else answer

    def _full_frame(self) -> pd.DataFrame:
        """One row per subject and comparison, with the columns of asymmetry.csv."""
        frame = pd.concat([row.comparisons for row in self.rows], ignore_index=True)
        return frame.rename(columns=lambda key: key.replace("equal", self.task.compared_answer))

    def describe(self) -> str:
        """The numbers of positive and negative maximal asymmetries, in sentences.

        Source: Results, 'Across participants, 6 showed positive maximal asymmetries (5 significant
        at p < 0.05) ...'. The data choose the maximum, so the sentences also count the p-values
        that Holm's method adjusts over the subject's comparisons. There is no correction over
        subjects.
        """
        maxima = [subject.maximal for subject in self.rows if subject.maximal is not None]
        n_subjects = plural(len(maxima), "subject")
        sentences = ["The counts are for the pair of each subject whose two orders differ most."]

        # The asymmetry is above 0 if there are more such responses with the stronger stimulus
        # first, and below 0 if there are more with the weaker stimulus first.
        for sign, stimulus in ((1, "stronger"), (-1, "weaker")):
            maxima_of_sign = [maximum for maximum in maxima if sign * maximum.asymmetry > 0]
            n_significant = sum(maximum.p_value < 0.05 for maximum in maxima_of_sign)
            n_corrected = sum(maximum.p_adjusted < 0.05 for maximum in maxima_of_sign)
            sentences.append(
                f"{len(maxima_of_sign)} of {n_subjects} gave more {self.share_of} responses with "
                f"the {stimulus} stimulus first than in the other order. The difference is "
                f"significant (p < .05) in {n_significant} of them, in {n_corrected} after Holm's "
                "correction."
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
        It lacks pairs that were presented in one order only, which `check` names.

    Raises
    ------
    InputError
        If no subject met a pair of different stimuli in both orders.

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.3], [0.3, 0.0], [12, 25], [50, 50])
    >>> comparison = asymmetry(Study([subject]))["S01"].maximal
    >>> round(comparison.asymmetry, 3), round(comparison.p_value, 4)
    (0.25, 0.0073)
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
    # For each comparison, the index of (r, c) and that of (c, r) among the pairs of the subject.
    weak_first, strong_first = pairs_in_both_orders(subject).T
    # In 'same or different?', the wrong responses to different stimuli are those with 'equal'.
    n_wrong = subject.task.wrong(subject.s2 - subject.s1, subject.n_yes, subject.n_trials)
    q = laplace_estimate(n_wrong, subject.n_trials)  # (pairs,)
    error = laplace_error(n_wrong, subject.n_trials)
    difference = q[strong_first] - q[weak_first]  # (comparisons,)

    # The test of each comparison, from k1, n1, k2 and n2.
    counts = np.column_stack([n_wrong, subject.n_trials])
    tables = np.hstack([counts[strong_first], counts[weak_first]]).tolist()
    tests = pd.DataFrame(starmap(equality_test, tables), columns=["p_value", "test"])
    p_values = tests["p_value"].to_numpy(np.float64)
    # The largest difference comes first, and among differences that are equal up to rounding, the
    # difference with the smallest p-value. The last key of a lexsort counts first.
    largest_first = np.lexsort((p_values, -np.abs(difference).round(12)))

    subject_accuracy = accuracy(subject)
    columns = {
        "subject": np.full(len(tests), subject.name, object),
        "s_weak": subject.s1[weak_first],
        "s_strong": subject.s2[weak_first],
        "n_equal_weak_first": n_wrong[weak_first],
        "n_trials_weak_first": subject.n_trials[weak_first],
        "n_equal_strong_first": n_wrong[strong_first],
        "n_trials_strong_first": subject.n_trials[strong_first],
        "q_weak_first": q[weak_first],
        "q_weak_first_se": error[weak_first],
        "q_strong_first": q[strong_first],
        "q_strong_first_se": error[strong_first],
        "asymmetry": difference,
        "asymmetry_se": np.hypot(error[weak_first], error[strong_first]),
        "p_value": p_values,
        "p_adjusted": holm(p_values),
        "test": tests["test"],
        "is_maximal": np.arange(len(tests)) == largest_first[:1],  # [:1], not [0]: may be empty
    }
    comparisons = pd.DataFrame(columns).assign(accuracy=subject_accuracy)
    return SubjectAsymmetry(subject.name, subject_accuracy, comparisons)


@lru_cache(maxsize=1 << 16)
def equality_test(k1: int, n1: int, k2: int, n2: int) -> tuple[float, str]:
    """Exact two-sided test that k1 of n1 and k2 of n2 have one probability: p-value and name.

    Boschloo's test up to 150 trials, where it takes 25 ms; for more trials Fisher's, which is
    faster.

    Examples
    --------
    >>> p_value, test = equality_test(7, 12, 8, 45)
    >>> round(p_value, 6), test
    (0.008382, 'boschloo')
    """
    table = [[k1, k2], [n1 - k1, n2 - k2]]
    # The p-value of the side on which the data lie is the smaller p-value, which is doubled.
    side = "less" if k1 * n2 < k2 * n1 else "greater"  # k1/n1 < k2/n2
    if n1 + n2 > 150:
        name = "fisher"
        result = fisher_exact(table, side)
    else:
        name = "boschloo"
        # The p-value is a supremum over the common probability, searched from n points. With
        # SciPy's default, 32 points, the supremum is missed in rare cases.
        result = boschloo_exact(table, side, n=64)
    return min(1.0, 2.0 * float(result.pvalue)), name


def holm(p_values: npt.ArrayLike) -> FloatArray:
    """Holm's adjustment of p-values, shape (tests,), which controls the chance of any false claim.

    Examples
    --------
    >>> holm([0.01, 0.04, 0.03]).tolist()
    [0.03, 0.06, 0.06]
    """
    p = np.asarray(p_values, np.float64)
    order = np.argsort(p, kind="stable")
    # The smallest of n p-values is multiplied by n, and the next one by n - 1. No product is below
    # the product before it.
    products = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(products, 1.0)
    return adjusted
