"""What is known of each subject besides the answers, and whether it goes with how the subject answered.

A covariate with two values splits the subjects: Welch's two-sample t-test. A numeric one with more values: Pearson's correlation.
Nothing is corrected for the number of covariates and outcomes.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.special import stdtr

from bayes_toe.arrays import FloatArray
from bayes_toe.data.tables import Table
from bayes_toe.errors import InputError

if TYPE_CHECKING:
    import pandas as pd


COVARIATE_COLUMNS = ("covariate", "outcome", "test", "groups", "n", "difference_or_r", "statistic", "df", "p_value", "note")
_MISSING = frozenset({"", "na", "n/a", "nan", "none"})
_MOST_SHOWN = 10


@dataclass(frozen=True)
class Covariates:
    """Covariates of some subjects.

    Attributes
    ----------
    values : mapping of str to mapping of str to str or float
        By covariate and subject: a number where the covariate is numeric, one of two texts where it is not; missing cells are left out.
    """

    values: Mapping[str, Mapping[str, str | float]]


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
        import pandas as pd

        return pd.DataFrame([[getattr(row, key) for key in COVARIATE_COLUMNS] for row in self.rows], columns=list(COVARIATE_COLUMNS))


def covariate_tests(covariates: Covariates, outcomes: Mapping[str, Mapping[str, float]]) -> CovariateTable:
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
    if not known & studied:
        raise InputError(f"no subject of the study has a covariate; the study has {_listed(studied)}, the covariates {_listed(known)}")
    rows = [_row(key, column, outcome, values) for key, column in covariates.values.items() for outcome, values in outcomes.items()]
    gaps = (("covariates of subjects that are not in the study ignored", known - studied), ("subjects without covariates", studied - known))
    return CovariateTable(tuple(rows), tuple(f"{said}: {_listed(names)}" for said, names in gaps if names))


def welch(first: npt.ArrayLike, second: npt.ArrayLike) -> tuple[float, float, float]:
    """Welch's t, degrees of freedom and two-sided p-value for the difference of two means; needs two values a group, not all alike.

    Examples
    --------
    >>> [round(v, 4) for v in welch([1.0, 2.0, 3.0], [2.0, 4.0])]
    [-0.866, 1.6842, 0.4921]
    """
    groups = [np.asarray(values, np.float64) for values in (first, second)]
    shares = [float(values.var(ddof=1) / len(values)) for values in groups]
    t = float(groups[0].mean() - groups[1].mean()) / math.sqrt(sum(shares))
    df = sum(shares) ** 2 / sum(share**2 / (len(values) - 1) for share, values in zip(shares, groups, strict=True))
    return t, df, _two_sided(t, df)


def pearson(x: npt.ArrayLike, y: npt.ArrayLike) -> tuple[float, float, float, float]:
    """Correlation r, its t = r sqrt(df/(1 - r^2)), df = n - 2 and two-sided p-value; needs three pairs, neither side constant.

    Examples
    --------
    >>> [round(v, 4) for v in pearson([1.0, 2.0, 3.0, 4.0], [1.0, 3.0, 2.0, 4.0])]
    [0.8, 1.8856, 2.0, 0.2]
    """
    u, v = _unit(x), _unit(y)
    r, df = float(u @ v), len(u) - 2.0
    rest = float(np.linalg.norm(u - v) * np.linalg.norm(u + v)) / 2.0  # sqrt(1 - r^2) without cancellation
    t = r * math.sqrt(df) / rest if rest > 0 else math.copysign(math.inf, r)
    return r, t, df, _two_sided(t, df)


def _unit(values: npt.ArrayLike) -> FloatArray:
    """Centred and scaled to length 1."""
    array = np.asarray(values, np.float64)
    centred = array - array.mean()
    return np.asarray(centred / np.linalg.norm(centred))


def _two_sided(t: float, df: float) -> float:
    return float(2.0 * stdtr(df, -abs(t)))


def _row(covariate: str, column: Mapping[str, str | float], outcome: str, values: Mapping[str, float]) -> CovariateTest:
    names = [name for name in values if name in column]
    y, x = np.array([values[name] for name in names]), [column[name] for name in names]
    kinds = sorted(set(column.values()), key=lambda kind: (isinstance(kind, str), kind))
    if len(kinds) > 2:
        return _pearson_row(covariate, outcome, np.array(x, np.float64), y)
    groups = [y[[value == kind for value in x]] if len(y) else y for kind in kinds]
    return _welch_row(covariate, outcome, [kind if isinstance(kind, str) else f"{kind:g}" for kind in kinds], groups)


def _welch_row(covariate: str, outcome: str, kinds: Sequence[str], groups: Sequence[FloatArray]) -> CovariateTest:
    about = (covariate, outcome, "t", " - ".join(kinds), " + ".join(str(len(values)) for values in groups))
    if len(groups) < 2:
        return CovariateTest(*about, note="one value only: nothing to compare")
    if min(map(len, groups)) < 2:
        return CovariateTest(*about, note="a group of fewer than two subjects has no variance")
    if all(np.ptp(values) == 0 for values in groups):
        return CovariateTest(*about, note="the outcome does not vary within the groups")
    return CovariateTest(*about, float(groups[0].mean() - groups[1].mean()), *welch(*groups))


def _pearson_row(covariate: str, outcome: str, x: FloatArray, y: FloatArray) -> CovariateTest:
    about = (covariate, outcome, "pearson", "", str(len(x)))
    if len(x) < 3:
        return CovariateTest(*about, note="fewer than three subjects: no correlation")
    if np.ptp(x) == 0 or np.ptp(y) == 0:
        return CovariateTest(*about, note="covariate or outcome does not vary over these subjects")
    return CovariateTest(*about, *pearson(x, y))


# --- Reading ----------------------------------------------------------------------------------------


def read_covariates(path: str | Path) -> Covariates:
    """Covariates from a CSV file with a column `subject` and one column per covariate.

    Comma, semicolon or tab between cells; UTF-8; a decimal comma where the comma does not separate cells. Empty cells and NA are missing. A
    covariate holds numbers, or exactly two different texts.

    Raises
    ------
    InputError
        One line per problem with file, row and column, ten at most.
    """
    rows, decimal_comma = _cells(path)
    _, header = rows[0]
    if "subject" not in header or len(header) < 2 or len(set(header)) < len(header) or "" in header:
        found = ", ".join(map(repr, header))
        raise InputError(f"{path}: row 1: found columns {found}, allowed: subject and at least one covariate, each with a name of its own")
    who = header.index("subject")
    _require_subjects(path, rows, who)
    problems: list[str] = []
    columns = {}
    for place, name in enumerate(header):
        if place != who:
            cells = [(row, record[who], _pointed(record[place]) if decimal_comma else record[place]) for row, record in rows[1:]]
            columns[name] = _column(f"{path}: row %d, column {name.replace('%', '%%')}: ", cells, problems)
    if problems:
        raise InputError(problems[:_MOST_SHOWN])
    return Covariates(columns)


def _cells(path: str | Path) -> tuple[list[tuple[int, list[str]]], bool]:
    """Row and stripped cells of every record that is not blank, all as wide as the header; whether the comma is free for decimals."""
    try:
        text = Path(path).read_bytes().decode("utf-8-sig")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8"
        raise InputError(f"{path}: cannot be read ({reason}), allowed: a CSV file in UTF-8") from error
    delimiter = max(",;\t", key=text.lstrip().split("\n", 1)[0].count)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=True, strict=True)
    try:
        rows = [(reader.line_num, [cell.strip() for cell in record]) for record in reader if "".join(record).strip()]
    except csv.Error as error:
        raise InputError(f"{path}: row {reader.line_num}: cannot be split into cells ({error})") from error
    if len(rows) < 2:
        raise InputError(f"{path}: found no row below the header, allowed: a header with subject, and one row per subject")
    width = len(rows[0][1])
    uneven = [(row, len(record)) for row, record in rows if len(record) != width]
    if uneven:
        raise InputError([f"{path}: row {row}: found {n} cells, allowed: {width} as in the header" for row, n in uneven[:_MOST_SHOWN]])
    return rows, delimiter != ","


def _pointed(cell: str) -> str:
    """A number with its decimal comma made a point; any other text as it is."""
    dotted = cell.replace(",", ".", 1)
    return dotted if _finite(dotted) is not None else cell


def _require_subjects(path: str | Path, rows: Sequence[tuple[int, list[str]]], place: int) -> None:
    seen: dict[str, int] = {}
    problems = []
    for row, record in rows[1:]:
        name = record[place]
        if not name:
            problems.append(f"{path}: row {row}, column subject: found '', allowed: a text that is not empty")
        elif name in seen:
            problems.append(f"{path}: row {row}, column subject: found {name!r} as in row {seen[name]}, allowed: each subject once")
        seen.setdefault(name, row)
    if problems:
        raise InputError(problems[:_MOST_SHOWN])


def _column(where: str, cells: Sequence[tuple[int, str, str]], problems: list[str]) -> dict[str, str | float]:
    """One covariate by subject: numbers if all cells are, else texts if there are exactly two."""
    given = [(row, subject, cell) for row, subject, cell in cells if cell.lower() not in _MISSING]
    numbers = [_finite(cell) for _, _, cell in given]
    if None not in numbers:
        return {subject: float(cell) for _, subject, cell in given}
    if len({cell for _, _, cell in given}) <= 2:
        return {subject: cell for _, subject, cell in given}
    bad = [(row, cell) for (row, _, cell), number in zip(given, numbers, strict=True) if number is None]
    problems += [where % row + f"found {cell!r}, allowed: a finite number (or two different texts in the column)" for row, cell in bad]
    return {}


def _finite(cell: str) -> float | None:
    try:
        value = float(cell)
    except ValueError:
        return None
    return value if math.isfinite(value) and "_" not in cell else None


def _listed(names: set[str]) -> str:
    shown = sorted(names)[:_MOST_SHOWN]
    return ", ".join(map(repr, shown)) + (f" and {len(names) - len(shown)} more" if len(names) > len(shown) else "")
