"""True parameters of synthetic subjects, from the file that simulate writes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from bayes_toe.data.number_table import read_numbers
from bayes_toe.errors import InputError
from bayes_toe.model.target import ORDER


def read_truth(path: str | Path) -> Mapping[str, Mapping[str, float]]:
    """Known values by subject and quantity, from columns of these names beside `subject`.

    Raises
    ------
    InputError
        If the file cannot be used: one line per problem.
    """
    names, columns = read_numbers(path, (), key="subject", optional=ORDER)
    if not columns:
        raise InputError(f"{path}: no quantity among the columns, allowed: {', '.join(ORDER)}")
    return {name: {key: float(values[row]) for key, values in columns.items()} for row, name in enumerate(names)}
