"""What is known of each subject besides the answers.

A CSV file with a column `subject` and one column per covariate.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bayes_toe.data.messages import bare, listed, quoted
from bayes_toe.data.read_table import read_table
from bayes_toe.data.validation import (
    MISSING_WORDS,
    bare_names,
    number,
    require_numbers,
    require_texts,
)
from bayes_toe.errors import InputError


@dataclass(frozen=True)
class Covariates:
    """Covariates of some subjects.

    Attributes
    ----------
    values : mapping of str to mapping of str to str or float
        By covariate and subject: a finite number (else an InputError) where the covariate is
        numeric, a text where it is not; what is missing is left out.
    """

    values: Mapping[str, Mapping[str, str | float]]

    def __post_init__(self) -> None:
        for name, column in self.values.items():
            for subject, value in column.items():
                if not isinstance(value, str) and not math.isfinite(value):
                    found = f"covariate {bare(name)} of subject {quoted(subject)}: found {value}"
                    raise InputError(
                        f"{found}, allowed: a finite number or a text; leave out what is missing"
                    )


def levels(values: Iterable[str | float]) -> list[str | float]:
    """The different values of a covariate in their order: numbers before texts."""
    return sorted(set(values), key=lambda value: (isinstance(value, str), value))


def level_words(values: Iterable[str | float]) -> list[str]:
    """Levels as tables name them, every two different ones differently."""
    return [
        value if isinstance(value, str) else str(float(value)).removesuffix(".0")
        for value in values
    ]


def read_covariates(path: Covariates | str | Path) -> Covariates:
    r"""Covariates from a CSV file with a column `subject` and one column per covariate.

    Those that are some stay what they are.

    Comma, semicolon or tab between cells; UTF-8, or UTF-16 with a byte-order mark; a decimal comma
    where the comma does not separate cells. Empty cells and NA are missing. A covariate whose cells
    are all texts, none of them a number, is a category with any number of levels, and so is one
    with two different texts; all others hold numbers.

    Raises
    ------
    InputError
        One line per problem with file, row and column, ten at most.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "people.csv")
    ...     _ = file.write_text("subject,age,site\nS01,23,north\nS02,NA,south\nS03,31.5,west\n", encoding="utf-8")
    ...     read_covariates(file).values["age"]
    {'S01': 23.0, 'S03': 31.5}
    """
    if isinstance(path, Covariates):
        return path
    table = read_table(path, set)
    if (
        "subject" not in table.names
        or not len(table.names) == len(table.columns) > 1
        or "" in table.names
    ):
        found = listed([quoted(name) for name in table.names])
        table.require(
            [
                f"found columns {found}, allowed: subject and at least one covariate, each with a "
                "name of its own"
            ]
        )
    table.require([])
    require_texts(table, table.columns["subject"], once=True)
    subject, values = bare_names(table, table.columns["subject"]), {}
    for name, column in table.columns.items():
        if name == "subject":
            continue
        # What each distinct text stands for: a number, NaN where it is none, or a level's text;
        # None where missing.
        given = {
            text: number(text, table.decimal_comma)
            for text in column.texts
            if text.lower() not in MISSING_WORDS
        }
        words = [math.isnan(value) for value in given.values()]
        category = all(words) or (len(words) <= 2 and any(words))
        meanings = [
            text if category and text in given else given.get(text) for text in column.texts
        ]
        wrong = np.array(
            [isinstance(value, float) and math.isnan(value) for value in meanings], np.bool_
        )
        require_numbers(
            table, column, wrong[column.codes], "a finite number (or no number in the whole column)"
        )
        of_rows = (
            (subject.text(row), meanings[code]) for row, code in enumerate(column.codes.tolist())
        )
        values[name] = {who: value for who, value in of_rows if value is not None}
    table.problems.refuse()
    return Covariates(values)
