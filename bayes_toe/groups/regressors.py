"""Covariates as the columns x of eta_ik ~ Normal(m_k + x_i' beta_k, tau_k^2), and who of a study has them.

A numeric covariate is one column, in sds about its mean; a category has a column for each level but the reference, 1 for its subjects and 0
for others. So m is the mean of subjects at the reference levels and at the means of numeric covariates.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from typing import NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.data.covariates import Covariates, level_words, levels
from bayes_toe.data.messages import bare, counted, listed, quoted
from bayes_toe.errors import InputError

#: A column of which the others leave no more than this share is theirs but for rounding.
_ALL_BUT_ROUNDING = 1e-8


class Regressor(NamedTuple):
    """One column, x = (covariate - mean)/sd, or 1 at a level of a category and 0 at others."""

    covariate: str
    level: str  # of a category; empty for a numeric covariate
    about: str  # what its effect is an effect of: 'age, per sd of 11.2 about 34.1', 'group B against A'
    mean: float = 0.0
    sd: float = 1.0
    reference: str = ""  # of a level: the one that it is held against

    @property
    def label(self) -> str:
        """Covariate and level."""
        return " ".join(bare(part) for part in (self.covariate, self.level) if part)


@dataclass(frozen=True, eq=False)
class Regressors:
    """The subjects that have all covariates, in the order of the study, and their columns."""

    subjects: tuple[str, ...]
    x: FloatArray  # (subjects, columns)
    columns: tuple[Regressor, ...] = ()
    left_out: Mapping[str, str] = field(
        default_factory=dict
    )  # subjects of the study that are not among them, with the reason
    notes: tuple[str, ...] = ()  # who was left out, and whose covariates nobody asked for, in words

    def __post_init__(self) -> None:
        x = np.array(self.x, np.float64)
        x.setflags(write=False)
        object.__setattr__(self, "x", x)

    @classmethod
    def none(cls, subjects: Sequence[str]) -> Regressors:
        """Subjects without covariates."""
        return cls(tuple(subjects), np.empty((len(subjects), 0)))

    def without(self, subjects: Collection[str]) -> Regressors:
        """The same columns without some subjects."""
        kept = [name not in subjects for name in self.subjects]
        return replace(self, subjects=tuple(compress(self.subjects, kept)), x=self.x[kept])


def regressors(
    people: Covariates, subjects: Sequence[str], *, categorical: Collection[str] = ()
) -> Regressors:
    """The columns that covariates make for the subjects of a study that have all of them, at least two more than there are columns.

    Covariates that are `categorical` have numbers for names of levels, as in a group that is 0 or 1; others are categories where one of
    the values is a text. Each must vary, and no column may follow from others.

    Examples
    --------
    >>> people = Covariates({"age": dict(zip("abcde", [30.0, 20.0, 25.0, 40.0, 35.0])), "group": dict(zip("abcd", "xxyy"))})
    >>> found = regressors(people, ["e", "d", "c", "b", "a"])
    >>> found.subjects, dict(found.left_out), found.x[:, 1].tolist()
    (('d', 'c', 'b', 'a'), {'e': 'no group'}, [1.0, 1.0, 0.0, 0.0])
    >>> [column.about for column in found.columns]
    ['age, per sd of 8.539 about 28.75', 'group y against x']
    """
    unknown = [name for name in categorical if name not in people.values]
    if unknown:
        raise InputError(
            f"categorical: found {quoted(unknown[0])}, allowed: {listed([*map(quoted, people.values)])}"
        )
    left_out = dict[str, str]()
    for subject in subjects:
        missing = [
            f"no {bare(name)}" for name, values in people.values.items() if subject not in values
        ]
        if missing:
            left_out[subject] = (
                "no covariates" if len(missing) == len(people.values) > 1 else ", ".join(missing)
            )
    said = listed([f"{quoted(subject)} ({reason})" for subject, reason in left_out.items()])
    kept = tuple(subject for subject in subjects if subject not in left_out)
    _require_subjects(kept, len(people.values), said)
    columns, x = list[Regressor](), [np.empty((len(kept), 0))]
    for name, values in people.values.items():
        own = [values[subject] for subject in kept]
        of_levels = name in categorical or any(isinstance(value, str) for value in values.values())
        more, part = (
            _of_levels(name, own) if of_levels else _of_numbers(name, np.array(own, np.float64))
        )
        columns += more
        x.append(part)
    _require_subjects(kept, len(columns), said)
    _require_independent(columns, np.hstack(x))
    others = sorted(
        {subject for values in people.values.values() for subject in values}.difference(subjects)
    )
    notes = (
        (
            "covariates of subjects that are not in the study ignored",
            listed([*map(quoted, others)]),
        ),
        ("subjects left out", said),
    )
    return Regressors(
        kept,
        np.hstack(x),
        tuple(columns),
        left_out,
        tuple(f"{about}: {names}" for about, names in notes if names),
    )


def _of_numbers(name: str, values: FloatArray) -> tuple[list[Regressor], FloatArray]:
    _require_several(name, f"{values[0]:g}", bool(values.min() < values.max()))
    unit = float(
        np.abs(values).max()
    )  # squares of numbers beyond 1e154 are beyond the largest float
    mean, sd = float(np.mean(values / unit)), float(np.std(values / unit, ddof=1))
    about = f"{bare(name)}, per sd of {unit * sd:.4g} about {unit * mean:.4g}"
    return [Regressor(name, "", about, unit * mean, unit * sd)], ((values / unit - mean) / sd)[
        :, None
    ]


def _of_levels(name: str, values: Sequence[str | float]) -> tuple[list[Regressor], FloatArray]:
    kinds = levels(values)
    reference, *others = level_words(kinds)
    _require_several(name, quoted(reference), bool(others))
    columns = [
        Regressor(
            name, word, f"{bare(name)} {bare(word)} against {bare(reference)}", reference=reference
        )
        for word in others
    ]
    return columns, np.array(
        [[value == kind for kind in kinds[1:]] for value in values], np.float64
    )


def _require_several(name: str, found: str, several: bool) -> None:
    if not several:
        allowed = "allowed: at least two different values; leave the column out"
        raise InputError(f"covariate {bare(name)}: found {found} for every subject, {allowed}")


def _require_subjects(kept: Sequence[str], columns: int, left_out: str) -> None:
    if columns and len(kept) < columns + 2:
        found = f"covariates: found {counted(len(kept), 'subject')} with all of them"
        rest = f"; left out: {left_out}" if left_out else ""
        raise InputError(
            f"{found}, allowed: at least {columns + 2} for {counted(columns, 'column')}{rest}"
        )


def _require_independent(columns: Sequence[Regressor], x: FloatArray) -> None:
    """R of the QR decomposition has on its diagonal what the columns before leave of each."""
    left = np.abs(np.diagonal(np.linalg.qr(np.column_stack([np.ones(len(x)), x]), mode="r")))[1:]
    for i, size in enumerate(np.linalg.norm(x - x.mean(axis=0), axis=0)):
        if left[i] < _ALL_BUT_ROUNDING * size:
            found = f"covariates: {columns[i].label} follows from {listed([one.label for one in columns[:i]])}"
            raise InputError(f"{found}, allowed: columns that tell different things; leave one out")
