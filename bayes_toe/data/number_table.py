"""Small CSV tables of numbers, as `simulate` takes them: a design, a population."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.errors import InputError

if TYPE_CHECKING:
    import pandas as pd


def read_numbers(
    path: str | Path, names: Sequence[str], key: str | None = None, *, optional: Sequence[str] = ()
) -> tuple[list[str], dict[str, FloatArray]]:
    """Columns of finite numbers by name, optional ones where they are there, and, where `key` names one, a column of distinct texts.

    Raises
    ------
    InputError
        One line per problem, with file, row and column.
    """
    frame = _read(path)
    wanted = [*names] if key is None else [key, *names]
    missing = [name for name in wanted if name not in frame.columns]
    if missing or frame.empty:
        found = ", ".join(map(repr, frame.columns))
        raise InputError([f"{path}: column {name}: missing, found {found}" for name in missing] or f"{path}: no row below the header")
    columns = {name: _numbers(frame[name]) for name in (*names, *(name for name in optional if name in frame.columns))}
    problems = [
        f"{path}: row {row + 2}, column {name}: found {frame[name].iloc[row]!r}, allowed: a finite number"
        for name, values in columns.items()
        for row in np.flatnonzero(~np.isfinite(values))[:10]
    ]
    texts = [] if key is None else [str(text).strip() for text in frame[key]]
    problems += [
        f"{path}: row {row + 2}, column {key}: empty or repeated" for row, text in enumerate(texts) if texts.index(text) < row or not text
    ]
    if problems:
        raise InputError(problems[:10])
    return texts, columns


def _read(path: str | Path) -> pd.DataFrame:
    import pandas as pd

    try:
        frame = pd.read_csv(path, dtype=str, keep_default_na=False, encoding="utf-8-sig", skipinitialspace=True)
    except (OSError, ValueError) as error:  # pandas' own parser errors are ValueErrors
        raise InputError(f"{path}: cannot be read as comma-separated UTF-8 text ({str(error).splitlines()[0]})") from error
    return frame.rename(columns=str.strip)


def _numbers(cells: pd.Series[str]) -> FloatArray:
    import pandas as pd

    return np.asarray(pd.to_numeric(cells, errors="coerce"), np.float64)
