"""Covariates: facts about each subject besides the answers.

A CSV file with a column `subject` and one column per covariate.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from bayes_toe.arrays import StrPath
from bayes_toe.data.messages import join_quoted
from bayes_toe.data.text_table import value_text
from bayes_toe.data.validation import (
    bare_names,
    is_missing,
    number,
    numbers,
    require_numbers,
    require_texts,
    table_with,
)

#: By covariate and subject: a finite number where the covariate is numeric, a text where it is not.
#: What is missing is left out.
Covariates = Mapping[str, Mapping[str, str | float]]


def levels(values: Iterable[str | float]) -> list[str | float]:
    """The different values of a covariate in their order: numbers before texts."""
    return sorted(set(values), key=lambda value: (isinstance(value, str), value))


def level_words(values: Iterable[str | float]) -> list[str]:
    """Levels as tables name them; the number 1.0 is '1'."""
    return list(map(value_text, values))


def read_covariates(path: StrPath) -> Covariates:
    r"""Read a CSV file with a column `subject` and one column per covariate.

    Commas, semicolons or tabs separate cells. The encoding is UTF-8, or UTF-16 with a byte-order
    mark. Numbers may have a decimal comma where the comma does not separate cells. Empty cells and
    NA are missing. A covariate is a category if none of its cells is a number. It is a category too
    if it has two different cells at most and one of them is no number. All others hold numbers.

    Raises
    ------
    InputError
        One line per problem with file, row and column, ten at most.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "people.csv")
    ...     table = "subject,age,site\nS01,23,north\nS02,NA,south\nS03,31.5,west\n"
    ...     _ = file.write_text(table, encoding="utf-8")
    ...     read_covariates(file)["age"]
    {'S01': 23.0, 'S03': 31.5}
    """
    table = table_with(path, ["subject"])
    if len(table.columns) == 1:
        table.require(
            [f"found columns {join_quoted(table.names)}, allowed: subject and a covariate"]
        )
    require_texts(table, table.columns["subject"], once=True)
    subjects = bare_names(table, table.columns["subject"]).map(str, object)

    covariates: dict[str, dict[str, str | float]] = {}
    for name, column in table.columns.items():
        if name == "subject":
            continue
        has_value = ~column.map(is_missing)
        texts = column.only(has_value).texts  # each text once
        values_of_texts = [number(text, table.decimal_comma) for text in texts]  # NaN for a word
        n_words = np.isnan(values_of_texts).sum()
        is_category = n_words == len(texts) or (len(texts) == 2 and n_words == 1)

        values = column.map(str, object)
        if not is_category:
            values = numbers(table, column)
            require_numbers(
                table,
                column,
                has_value & np.isnan(values),
                "a finite number (or no number in the whole column)",
            )
        covariates[name] = dict(
            zip(subjects[has_value].tolist(), values[has_value].tolist(), strict=True)
        )
    table.problems.refuse()
    return covariates
