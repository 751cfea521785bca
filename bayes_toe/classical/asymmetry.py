"""Time-order asymmetry without a model: q(c, r) - q(r, c) of every comparison, its test, its sign, and counts over the population.

A comparison is a pair of different stimuli that was presented in both orders: r the weaker, c the stronger. The asymmetry is positive
where 'equal' is the likelier answer with the stronger stimulus first; the subject is then more accurate with the weaker one first, as the
model predicts for a prior mean below the stimuli.

Erratum: the paper's sentence on its panel A ('more accurate when the weaker stimulus was presented first, in which case the blue curve
lies below the red one') follows the swapped colours of Fig. 3's caption. With red = weaker first, as in the text and Fig. 1C, the red curve
lies below the blue one there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.classical.exact_test import equality_test, holm, probability_greater
from bayes_toe.classical.frequencies import accuracy, laplace_error, laplace_estimate
from bayes_toe.data.study import Study, Subject, refuse_intervals, require_study
from bayes_toe.data.tables import SubjectTable
from bayes_toe.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

#: Level at which an asymmetry is called significant.
LEVEL = 0.05

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
    "probability_of_direction",
    "is_maximal",
    "accuracy",
)


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
    p_value : float
        Exact two-sided test of the null that both orders share one probability; `test` names it (:mod:`bayes_toe.classical.exact_test`).
    p_adjusted : float
        The same by Holm's method over the comparisons of this subject.
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
    p_value: float
    p_adjusted: float
    test: str
    probability_of_direction: float
    is_maximal: bool

    @property
    def q_weak_first(self) -> float:
        """Laplace estimator of q(r, c). Source: Eq. e:2b."""
        return float(laplace_estimate(self.n_equal_weak_first, self.n_trials_weak_first))

    @property
    def q_weak_first_se(self) -> float:
        """Its uncertainty."""
        return float(laplace_error(self.n_equal_weak_first, self.n_trials_weak_first))

    @property
    def q_strong_first(self) -> float:
        """Laplace estimator of q(c, r). Source: Eq. e:2b."""
        return float(laplace_estimate(self.n_equal_strong_first, self.n_trials_strong_first))

    @property
    def q_strong_first_se(self) -> float:
        """Its uncertainty."""
        return float(laplace_error(self.n_equal_strong_first, self.n_trials_strong_first))

    @property
    def asymmetry(self) -> float:
        """q(c, r) - q(r, c), the posterior mean of the difference, -1..1."""
        return self.q_strong_first - self.q_weak_first

    @property
    def asymmetry_se(self) -> float:
        """Posterior standard deviation of the difference; both orders are independent."""
        return float(np.hypot(self.q_weak_first_se, self.q_strong_first_se))


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
        return tuple(note for row in self.rows for note in _notes(row))

    def frame(self) -> pd.DataFrame:
        """One row per subject and comparison, with the columns of asymmetry.csv."""
        import pandas as pd

        rows = [[*(getattr(one, key) for key in ASYMMETRY_COLUMNS[:-1]), row.accuracy] for row in self.rows for one in row.comparisons]
        return pd.DataFrame(rows, columns=list(ASYMMETRY_COLUMNS))

    def subjects(self) -> pd.DataFrame:
        """One row per subject: accuracy, mean and mean absolute asymmetry, and the comparison where it is largest."""
        import pandas as pd

        return pd.DataFrame([_subject_row(row) for row in self.rows])

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
    table = AsymmetryTable(tuple(subject_asymmetry(subject) for subject in study))
    if not any(row.comparisons for row in table):
        raise InputError(
            f"{study.source}: no pair of different stimuli was presented in both orders to one subject, so its asymmetry cannot be "
            "observed; sample the posterior for what the model predicts"
        )
    return table


def subject_asymmetry(subject: Subject) -> SubjectAsymmetry:
    """Model-free asymmetries of one subject; no comparison where no pair was presented in both orders, or with intervals."""
    if subject.isi is not None:
        return SubjectAsymmetry(subject.name, accuracy(subject), (), 0, pooled=False)
    at = {pair: i for i, pair in enumerate(zip(subject.s1.tolist(), subject.s2.tolist(), strict=True))}
    unequal = {(min(pair), max(pair)) for pair in at if pair[0] != pair[1]}
    both = sorted(pair for pair in unequal if pair in at and pair[::-1] in at)
    weak_first, strong_first = [at[pair] for pair in both], [at[pair[::-1]] for pair in both]
    comparisons = _comparisons(subject, weak_first, strong_first) if both else ()
    return SubjectAsymmetry(subject.name, accuracy(subject), comparisons, len(unequal) - len(both))


def _comparisons(subject: Subject, weak_first: list[int], strong_first: list[int]) -> tuple[Comparison, ...]:
    weak = subject.n_equal[weak_first], subject.n_trials[weak_first]
    strong = subject.n_equal[strong_first], subject.n_trials[strong_first]
    tested, direction = equality_test(*strong, *weak), probability_greater(*strong, *weak)
    sizes = np.abs(laplace_estimate(*strong) - laplace_estimate(*weak))
    largest = np.lexsort((tested.p_value, -sizes))[0]  # of two alike, the one that is better established
    adjusted = holm(tested.p_value)
    return tuple(
        Comparison(
            subject=subject.name,
            s_weak=float(subject.s1[i]),
            s_strong=float(subject.s2[i]),
            n_equal_weak_first=int(weak[0][j]),
            n_trials_weak_first=int(weak[1][j]),
            n_equal_strong_first=int(strong[0][j]),
            n_trials_strong_first=int(strong[1][j]),
            p_value=float(tested.p_value[j]),
            p_adjusted=float(adjusted[j]),
            test=str(tested.test[j]),
            probability_of_direction=float(direction[j]),
            is_maximal=bool(j == largest),
        )
        for j, i in enumerate(weak_first)
    )


def _notes(row: SubjectAsymmetry) -> Iterator[str]:
    if not row.pooled:
        return
    if not row.comparisons:
        yield f"{row.subject}: no pair of different stimuli was presented in both orders; its asymmetry cannot be observed"
    elif row.n_one_order:
        what = "pair was" if row.n_one_order == 1 else "pairs were"
        yield f"{row.subject}: {row.n_one_order} {what} presented in one order only and left out"


def _subject_row(row: SubjectAsymmetry) -> dict[str, str | int | float | None]:
    largest = row.maximal
    keys = ("s_weak", "s_strong", "asymmetry", "asymmetry_se", "p_value", "p_adjusted", "probability_of_direction")
    return {
        "subject": row.subject,
        "accuracy": row.accuracy,
        "n_comparisons": len(row.comparisons),
        "mean_asymmetry": row.mean_asymmetry,
        "mean_absolute_asymmetry": row.mean_absolute_asymmetry,
        **{f"maximal_{key}" if key.startswith("asymmetry") else key: None if largest is None else getattr(largest, key) for key in keys},
    }
