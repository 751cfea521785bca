"""Covariates as the columns of a regression: `regressors`.

The column of a numeric covariate is (value - mean) / sd. A category has a column for each level but
the reference: 1 for the subjects of the level and 0 for others. The mean of a coefficient is
m + x' beta, so m is that of subjects at the reference levels and at the means of covariates.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.data.covariates import Covariates, level_words, levels
from bayes_toe.data.messages import (
    display_name,
    join_display_names,
    join_names,
    join_quoted,
    plural,
    quoted,
)
from bayes_toe.errors import InputError


class Regressor(NamedTuple):
    """One column, x = (covariate - mean)/sd, or 1 at a level of a category and 0 at other levels.

    Attributes
    ----------
    level : str
        The level of a category; empty for a numeric covariate.
    meaning : str
        What its effect means: 'age, per sd of 11.2 about 34.1', 'group B against A'.
    reference : str
        The level with which a level is compared.
    """

    covariate: str
    level: str
    meaning: str
    reference: str = ""

    @property
    def label(self) -> str:
        """The name of the column: the covariate, and the level of a category, as in 'sex f'."""
        return " ".join(display_name(part) for part in (self.covariate, self.level) if part)


@dataclass(frozen=True, eq=False)
class Regressors:
    """The subjects that have all covariates, in the order of the study, and their columns.

    Attributes
    ----------
    subjects : tuple of str
    x : ndarray, shape (subjects, columns)
    columns : tuple of Regressor
    notes : tuple of str
        Subjects that were left out, and subjects of the table that are not in the study, in words.
    """

    subjects: tuple[str, ...]
    x: FloatArray
    columns: tuple[Regressor, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def labels(self) -> list[str]:
        """The names of the columns."""
        return [column.label for column in self.columns]


def regressors(
    covariates: Covariates, subjects: Sequence[str], *, categorical: Collection[str] = ()
) -> Regressors:
    """The columns of the covariates for the subjects of a study that have all of them.

    Parameters
    ----------
    covariates : Covariates
        Empty without covariates.
    subjects : sequence of str
    categorical : collection of str
        Covariates whose numbers are names of levels, such as a group 0 or 1. Others are categories
        if one of the values is a text.

    Raises
    ------
    InputError
        If there are fewer than two subjects more than columns, a covariate does not vary, or a
        column follows from others.

    Examples
    --------
    >>> age, group = [30.0, 20.0, 25.0, 40.0, 35.0], "xxyy"
    >>> columns = {"age": dict(zip("abcde", age)), "group": dict(zip("abcd", group))}
    >>> found = regressors(columns, ["e", "d", "c", "b", "a"])
    >>> found.subjects, found.notes, found.x[:, 1].tolist()
    (('d', 'c', 'b', 'a'), ("subjects left out: 'e' (no group)",), [1.0, 1.0, 0.0, 0.0])
    >>> [column.meaning for column in found.columns]
    ['age, per sd of 8.539 about 28.75', 'group y against x']
    """
    for name in categorical:
        if name not in covariates:
            names = join_quoted(covariates) or "none, without covariates"
            raise InputError(f"categorical: found {quoted(name)}, allowed: {names}")
    complete_subjects, left_out = _with_all_covariates(subjects, covariates)
    # The columns cannot be made without subjects. Each covariate has a column or more, and the
    # number of columns is known only below.
    _require_subjects(complete_subjects, len(covariates), left_out)

    columns = []
    x = np.empty((len(complete_subjects), 0))
    for name, by_subject in covariates.items():
        values = [by_subject[subject] for subject in complete_subjects]
        words = level_words(values)
        if len(set(words)) == 1:
            raise InputError(
                f"covariate {display_name(name)}: found {quoted(words[0])} for every subject, "
                "allowed: at least two different values; leave the column out"
            )
        has_text = any(isinstance(value, str) for value in by_subject.values())
        if has_text or name in categorical:
            new_columns, new_x = _columns_of_category(name, values)
        else:
            new_columns, new_x = _column_of_numbers(name, np.array(values, np.float64))
        columns += new_columns
        x = np.hstack([x, new_x])
    _require_subjects(complete_subjects, len(columns), left_out)
    _require_independent(columns, x)

    notes = []
    unknown_subjects = set().union(*covariates.values()).difference(subjects)
    if unknown_subjects:
        names = join_quoted(sorted(unknown_subjects))
        notes.append(f"covariates of subjects that are not in the study ignored: {names}")
    if left_out:
        notes.append(f"subjects left out: {left_out}")
    return Regressors(complete_subjects, x, tuple(columns), tuple(notes))


def _with_all_covariates(
    subjects: Sequence[str], covariates: Covariates
) -> tuple[tuple[str, ...], str]:
    """The subjects that have all covariates, and a text that names the others and their gaps."""
    complete_subjects = []
    incomplete_subjects = []
    for subject in subjects:
        missing_covariates = [name for name, values in covariates.items() if subject not in values]
        if missing_covariates:
            reason = f"no {join_display_names(missing_covariates)}"
            incomplete_subjects.append(f"{quoted(subject)} ({reason})")
        else:
            complete_subjects.append(subject)
    return tuple(complete_subjects), join_names(incomplete_subjects)


def _column_of_numbers(name: str, values: FloatArray) -> tuple[list[Regressor], FloatArray]:
    """A numeric covariate as one column, shape (subjects, 1), of mean 0 and sd 1."""
    if not np.isfinite(values).all():
        raise InputError(
            f"covariate {display_name(name)}: found a number that is not finite, allowed: finite "
            "numbers; leave out what is missing"
        )
    # The square of a number beyond 1e154 is beyond the largest float, so that the mean and the SD
    # are computed with the largest number as unit.
    unit = np.abs(values).max()
    scaled = values / unit
    mean = scaled.mean()
    sd = scaled.std(ddof=1)
    words = f"{display_name(name)}, per sd of {unit * sd:.4g} about {unit * mean:.4g}"
    column = (scaled - mean) / sd
    return [Regressor(name, level="", meaning=words)], column[:, None]


def _columns_of_category(
    name: str, values: Sequence[str | float]
) -> tuple[list[Regressor], FloatArray]:
    """A category as a column of 0 and 1 for each level but the reference."""
    # The first level is the reference. The number 1 and the text '1' are one level.
    reference, *other_levels = dict.fromkeys(level_words(levels(values)))
    columns = []
    for level in other_levels:
        words = f"{display_name(name)} {display_name(level)} against {display_name(reference)}"
        columns.append(Regressor(name, level, words, reference))
    # Whether each subject has each level, (subjects, columns).
    is_level = np.array(level_words(values))[:, None] == np.array(other_levels)
    return columns, is_level.astype(np.float64)


def _require_subjects(subjects: Sequence[str], n_columns: int, left_out: str) -> None:
    """Refuse fewer subjects than columns + 2, the intercept and one more, if there are columns."""
    if n_columns and len(subjects) < n_columns + 2:
        ending = f"; left out: {left_out}" if left_out else ""
        raise InputError(
            f"covariates: found {plural(len(subjects), 'subject')} with all of them, allowed: at "
            f"least {n_columns + 2} for {plural(n_columns, 'column')}{ending}"
        )


def _require_independent(columns: Sequence[Regressor], x: FloatArray) -> None:
    """Refuse a column that follows from the earlier columns and the intercept."""
    deviations = x - x.mean(axis=0)  # what the intercept leaves
    for i, column in enumerate(columns):
        if np.linalg.matrix_rank(deviations[:, : i + 1], tol=1e-8) == i:  # not i + 1
            earlier = join_names(earlier_column.label for earlier_column in columns[:i])
            raise InputError(
                f"covariates: {column.label} follows from {earlier}, "
                "allowed: columns that tell different things; leave one out"
            )
