"""What is known of each subject besides the answers, and whether it goes with how the subject answered.

A covariate with two values splits the subjects: Welch's two-sample t-test. A numeric one with more values: Pearson's correlation.
Nothing is corrected for the number of covariates and outcomes.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import pearsonr, ttest_ind

from bayes_toe.arrays import FloatArray
from bayes_toe.data.covariates import Covariates, level_words, levels
from bayes_toe.data.messages import listed, quoted
from bayes_toe.data.tables import Table, frame_of
from bayes_toe.errors import InputError

COVARIATE_COLUMNS = (
    "covariate",
    "outcome",
    "test",
    "groups",
    "n",
    "difference_or_r",
    "statistic",
    "df",
    "p_value",
    "note",
)


@dataclass(frozen=True)
class CovariateTest:
    """One outcome held against one covariate; numbers are None where the test does not exist, and `note` says why.

    Attributes
    ----------
    covariate, outcome : str
    test : str
        "t" (Welch) or "pearson".
    groups : str
        The two values as 'first - second', empty for a correlation.
    n : str
        Number of subjects used; for a t-test of both groups, as '10 + 6'.
    difference_or_r : float or None
        Difference of means, first minus second, in the unit of the outcome; or the correlation.
    statistic, df, p_value : float or None
        Student's t, its degrees of freedom and the two-sided p-value.
    """

    covariate: str
    outcome: str
    test: str
    groups: str
    n: str
    difference_or_r: float | None = None
    statistic: float | None = None
    df: float | None = None
    p_value: float | None = None
    note: str = ""


@dataclass(frozen=True)
class CovariateTable(Table[CovariateTest]):
    """Every outcome against every covariate."""

    notes: tuple[str, ...] = ()

    def frame(self) -> pd.DataFrame:
        """One row per covariate and outcome; empty where a test does not exist."""
        return frame_of(self.rows, COVARIATE_COLUMNS)


def covariate_tests(
    covariates: Covariates, outcomes: Mapping[str, Mapping[str, float]]
) -> CovariateTable:
    """Test every outcome (by name and subject) against every covariate.

    Raises
    ------
    InputError
        If no subject has both an outcome and a covariate.

    Examples
    --------
    >>> age = Covariates({"age": {"a": 20.0, "b": 30.0, "c": 40.0, "d": 50.0}})
    >>> row = covariate_tests(age, {"accuracy": {"a": 0.6, "b": 0.7, "c": 0.7, "d": 0.8}}).rows[0]
    >>> row.test, round(row.difference_or_r, 4), round(row.p_value, 4)
    ('pearson', 0.9487, 0.0513)
    """
    known = {name for column in covariates.values.values() for name in column}
    studied = {name for column in outcomes.values() for name in column}

    def said(names: set[str]) -> str:
        return listed([quoted(name) for name in sorted(names)])

    if not known & studied:
        raise InputError(
            f"no subject of the study has a covariate; the study has {said(studied)}, the covariates {said(known)}"
        )
    rows = [
        _row(key, column, outcome, values)
        for key, column in covariates.values.items()
        for outcome, values in outcomes.items()
    ]
    gaps = (
        ("covariates of subjects that are not in the study ignored", known - studied),
        ("subjects without covariates", studied - known),
    )
    return CovariateTable(
        tuple(rows), tuple(f"{about}: {said(names)}" for about, names in gaps if names)
    )


def _row(
    covariate: str, column: Mapping[str, str | float], outcome: str, values: Mapping[str, float]
) -> CovariateTest:
    names = [name for name in values if name in column]
    y, x = np.array([values[name] for name in names]), [column[name] for name in names]
    kinds = levels(column.values())
    if len(kinds) > 2 and isinstance(kinds[-1], str):
        return CovariateTest(
            covariate,
            outcome,
            "t",
            "",
            str(len(x)),
            note=f"{len(kinds)} groups: Welch's t-test compares two",
        )
    if len(kinds) > 2:
        return _pearson_row(
            (covariate, outcome, "pearson", "", str(len(x))), np.array(x, np.float64), y
        )
    groups = [y[[value == kind for value in x]] if len(y) else y for kind in kinds]
    sizes = " + ".join(str(len(some)) for some in groups)
    return _welch_row((covariate, outcome, "t", " - ".join(level_words(kinds)), sizes), groups)


def _welch_row(
    about: tuple[str, str, str, str, str], groups: Sequence[FloatArray]
) -> CovariateTest:
    lacks = {
        "one value only: nothing to compare": len(groups) < 2,
        "a group of fewer than two subjects has no variance": min(map(len, groups)) < 2,
        "the outcome does not vary within the groups": all(
            len(values) == 0 or np.ptp(values) == 0 for values in groups
        ),
    }
    for note, lacking in lacks.items():
        if lacking:
            return CovariateTest(*about, note=note)
    with warnings.catch_warnings():
        # One group whose values are all alike is no loss of precision.
        warnings.filterwarnings("ignore", message="Precision loss", category=RuntimeWarning)
        found = ttest_ind(*groups, equal_var=False)
    difference = float(groups[0].mean() - groups[1].mean())
    return CovariateTest(
        *about, difference, float(found.statistic), float(found.df), float(found.pvalue)
    )


def _pearson_row(
    about: tuple[str, str, str, str, str], x: FloatArray, y: FloatArray
) -> CovariateTest:
    if len(x) < 3:
        return CovariateTest(*about, note="fewer than three subjects: no correlation")
    if np.ptp(x) == 0 or np.ptp(y) == 0:
        return CovariateTest(*about, note="covariate or outcome does not vary over these subjects")
    found, df = pearsonr(x, y), len(x) - 2.0
    r = float(found.statistic)
    t = r * math.sqrt(df / (1.0 - r * r)) if abs(r) < 1.0 else math.copysign(math.inf, r)
    return CovariateTest(*about, r, t, df, float(found.pvalue))
