"""Small CSV files of numbers: a design, a population, pairs to predict, true parameters."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.data.cells import Cells, Fault, Header, read_cells, read_header, refuse
from bayes_toe.data.columns import is_empty, name_faults, number_fault, numbers
from bayes_toe.data.messages import bare, listed, quoted

_NUMBER, _COUNT = "a finite number", "a whole number of at least 1"


def read_numbers(
    path: str | Path, names: Sequence[str], key: str | None = None, *, optional: Sequence[str] = (), counts: Sequence[str] = ()
) -> tuple[list[str], dict[str, FloatArray]]:
    r"""Columns of finite numbers by name, optional ones where they are there, and, where `key` names one, a column of distinct texts.

    Columns that are `counts` hold whole numbers of at least 1. Comma, semicolon or tab between cells; UTF-8, or UTF-16 with a byte-order
    mark. Other columns are ignored.

    Returns
    -------
    texts : list of str
        Of the column `key`, in the order of the rows; empty without one.
    columns : dict of str to array, shape (rows,)
        In the units of the file.

    Raises
    ------
    InputError
        One line per problem of the file, ten at most, with row and column.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pairs = Path(folder, "pairs.csv")
    ...     _ = pairs.write_text("s1;s2\n0;0,5\n0,25;0\n", encoding="utf-8")
    ...     read_numbers(pairs, ("s1", "s2"))[1]["s2"].tolist()
    [0.5, 0.0]
    """
    needed = [*names] if key is None else [key, *names]
    header, text = read_header(path, frozenset((*needed, *optional)))
    cells = read_cells(header, text, *_places(header, needed, optional))
    texts = None if key is None else cells.columns[key]
    columns = {name: numbers(cells, column) for name, column in cells.columns.items() if name != key}
    bad = {
        name: ~((values >= 1) & (values == np.floor(values))) if name in counts else np.isnan(values) for name, values in columns.items()
    }
    kinds = {name: _COUNT if name in counts else _NUMBER for name in columns}
    faults = [number_fault(cells, cells.columns[name], bad[name], kinds[name]) for name in columns]
    refuse(header.source, [cells.fault, *([] if texts is None else name_faults(cells, texts)), *faults])
    return [] if texts is None else [texts.text(row) for row in range(len(cells.rows))], columns


def read_some_numbers(path: str | Path, key: str, names: Sequence[str]) -> tuple[list[str], dict[str, FloatArray]]:
    """The column `key` of distinct texts, and which of the columns of numbers there are: NaN where a cell is empty.

    Returns and errors as :func:`read_numbers`, and one where there is none of the columns.
    """
    header, text = read_header(path, frozenset((key, *names)))
    places, problems = _places(header, [key], names)
    if len(places) < 2 and not problems:
        found = listed([quoted(name) for name in header.names])
        problems = [f"{header.place}: found {found}, allowed: {bare(key)} and some of {', '.join(names)}"]
    cells = read_cells(header, text, places, problems)
    columns, faults = _numbers_or_nothing(cells, [name for name in cells.columns if name != key])
    refuse(header.source, [cells.fault, *name_faults(cells, cells.columns[key]), *faults])
    return [cells.columns[key].text(row) for row in range(len(cells.rows))], columns


def read_rows(path: str | Path, texts: Sequence[str], names: Sequence[str]) -> tuple[dict[str, list[str]], dict[str, FloatArray]]:
    r"""A table that this program has written: columns of texts, and of numbers, NaN where a cell is empty; all of them must be there.

    Errors as of :func:`read_numbers`.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     table = Path(folder, "table.csv")
    ...     _ = table.write_text("model,value\nsymmetric,0.5\nsymmetric,\n", encoding="utf-8")
    ...     texts, values = read_rows(table, ["model"], ["value"])
    >>> texts["model"], values["value"].tolist()
    (['symmetric', 'symmetric'], [0.5, nan])
    """
    needed = [*texts, *names]
    header, text = read_header(path, frozenset(needed))
    cells = read_cells(header, text, *_places(header, needed, ()))
    values, faults = _numbers_or_nothing(cells, names)
    refuse(header.source, [cells.fault, *faults])
    return {name: [cells.columns[name].text(row) for row in range(len(cells.rows))] for name in texts}, values


def _numbers_or_nothing(cells: Cells, names: Sequence[str]) -> tuple[dict[str, FloatArray], list[Fault]]:
    """Columns of numbers, NaN where a cell is empty, and the cells that hold something else."""
    columns = {name: numbers(cells, cells.columns[name]) for name in names}
    wrong = {name: np.isnan(values) & ~is_empty(cells.columns[name]) for name, values in columns.items()}
    return columns, [number_fault(cells, cells.columns[name], bad) for name, bad in wrong.items()]


def _places(header: Header, needed: Sequence[str], optional: Sequence[str]) -> tuple[dict[str, int], list[str]]:
    """Where the columns are that the file has, and what is wrong with its header."""
    counts = {name: header.names.count(name) for name in (*needed, *optional)}
    found = listed([quoted(name) for name in header.names])
    missing = [f"column {bare(name)}: missing, found {found}, allowed: a column of this name" for name in needed if counts[name] == 0]
    twice = [f"column {bare(name)}: found {count} columns of this name, allowed: one" for name, count in counts.items() if count > 1]
    places = {name: header.names.index(name) for name, count in counts.items() if count}
    return places, [f"{header.place}, {line}" for line in (*missing, *twice)]
