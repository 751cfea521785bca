"""Time-order asymmetry without a model: q(c, r) - q(r, c) of every comparison, its test, its sign, and counts over the population.

A comparison is a pair of different stimuli that was presented in both orders: r the weaker, c the stronger. The asymmetry is positive
where 'equal' is the likelier answer with the stronger stimulus first; the subject is then more accurate with the weaker one first, as the
model predicts for a prior mean below the stimuli.

Erratum: the paper's sentence on its panel A ('more accurate when the weaker stimulus was presented first, in which case the blue curve
lies below the red one') follows the swapped colours of Fig. 3's caption. With red = weaker first, as in the text and Fig. 1C, the red curve
lies below the blue one there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import pandas as pd

from bayes_toe.arrays import IndexArray
from bayes_toe.classical.exact_test import equality_test, holm, probability_greater
from bayes_toe.classical.frequencies import accuracy, laplace_error, laplace_estimate
from bayes_toe.data.study import Study, Subject, refuse_intervals, require_study
from bayes_toe.data.tables import SubjectTable
from bayes_toe.errors import InputError

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
        Answers to (r, c): the weaker stimulus first, the paper's red.
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
        Exact two-sided test of the null that both orders share one probability; `test` names it (:mod:`bayes_toe.classical.exact_test`).
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
        return float(np.mean([one.asymmetry for one in self.comparisons])) if self.comparisons else float("nan")

    @property
    def mean_absolute_asymmetry(self) -> float:
        """Mean of the absolute asymmetries over comparisons; NaN where there is none."""
        return float(np.mean([abs(one.asymmetry) for one in self.comparisons])) if self.comparisons else float("nan")


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
        said = f"maximal asymmetry of {self.n_subjects} subject{'' if self.n_subjects == 1 else 's'}: "
        signs = [
            f"{count} {sign} ({significant} significant at p < {self.level:g}, {plain} before correction)"
            for sign, count, significant, plain in (
                ("positive", self.positive, self.positive_significant, self.positive_uncorrected),
                ("negative", self.negative, self.negative_significant, self.negative_uncorrected),
            )
        ]
        return said + ", ".join(signs)


@dataclass(frozen=True)
class AsymmetryTable(SubjectTable[SubjectAsymmetry]):
    """Asymmetries of every subject of a study, in the study's order."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What the design does not show: pairs presented in one order only."""
        found = []
        for row in self.rows:
            if row.pooled and not row.comparisons:
                found.append(f"{row.subject}: no pair of different stimuli was presented in both orders; its asymmetry cannot be observed")
            elif row.pooled and row.n_one_order:
                what = "pair was" if row.n_one_order == 1 else "pairs were"
                found.append(f"{row.subject}: {row.n_one_order} {what} presented in one order only and left out")
        return tuple(found)

    def frame(self) -> pd.DataFrame:
        """One row per subject and comparison, with the columns of asymmetry.csv."""
        rows = [[*(getattr(one, key) for key in ASYMMETRY_COLUMNS[:-1]), row.accuracy] for row in self.rows for one in row.comparisons]
        return pd.DataFrame(rows, columns=list(ASYMMETRY_COLUMNS))

    def subjects(self) -> pd.DataFrame:
        """One row per subject: accuracy, mean and mean absolute asymmetry, and the comparison where it is largest."""
        keys = ("s_weak", "s_strong", "asymmetry", "asymmetry_se", "p_value", "p_adjusted", "probability_of_direction")
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
        counts = [(len(side), sum(one.p_adjusted < level for one in side), sum(one.p_value < level for one in side)) for side in sides]
        return Population(level, len(found), *counts[0], *counts[1])

    def outcomes(self) -> dict[str, dict[str, float]]:
        """What covariates are held against, by outcome and subject: mean and mean absolute asymmetry, accuracy."""
        some = [row for row in self.rows if row.comparisons]
        keys = ("mean_asymmetry", "mean_absolute_asymmetry", "accuracy")
        return {key: {row.subject: getattr(row, key) for row in some} for key in keys}


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
    table = AsymmetryTable(subject_asymmetries(study.subjects))
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
    weak, strong = (
        np.concatenate([(one.n_equal[at[:, i]], one.n_trials[at[:, i]]) for one, (at, _) in zip(subjects, orders, strict=True)], axis=1)
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
        maximal[np.lexsort((p_value, -size))[:1]] = True  # of two alike, the one that is better established
        counted = [one.s1[at[:, 0]], one.s2[at[:, 0]], *weak[:, some], *strong[:, some], *(values[some] for values in estimates)]
        judged = [p_value, holm(p_value), tested.test[some], direction[some], maximal]
        rows = zip(*(column.tolist() for column in (*counted, *judged)), strict=True)
        comparisons = tuple(Comparison(one.name, *row) for row in rows)
        found.append(SubjectAsymmetry(one.name, accuracy(one), comparisons, left_out, pooled=one.isi is None))
    return tuple(found)


def _orders(subject: Subject) -> tuple[IndexArray, int]:
    """Which pairs are the two orders of comparisons, weaker first and stronger first, (comparisons, 2); how many lack an order."""
    if subject.isi is not None:
        return np.empty((0, 2), np.intp), 0
    at = {pair: i for i, pair in enumerate(zip(subject.s1.tolist(), subject.s2.tolist(), strict=True))}
    unequal = {(min(pair), max(pair)) for pair in at if pair[0] != pair[1]}
    both = sorted(pair for pair in unequal if pair in at and pair[::-1] in at)
    return np.array([(at[pair], at[pair[::-1]]) for pair in both], np.intp).reshape(-1, 2), len(unequal) - len(both)
