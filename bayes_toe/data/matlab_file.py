"""MATLAB files as columns of text, read in a process of their own.

The compiled reader of SciPy can end its process at a damaged file. A process of its own makes that
one refused file.
"""

from __future__ import annotations

import io
import json
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from bayes_toe.arrays import Record
from bayes_toe.data.messages import bare, listed, one_line
from bayes_toe.data.text_table import ColumnTexts, cell_texts
from bayes_toe.errors import InputError

_SAVED = (
    "one struct, or vectors of one length: S = table2struct(T, 'ToScalar', true); "
    "save('trials.mat', '-struct', 'S', '-v7')"
)
_DAMAGED_ALLOWED = "allowed: one that MATLAB has saved with '-v7'"
#: Seconds after which a file is refused; one of 10^6 trials takes some 10 s.
_LONGEST = 120
_PACKAGE_PARENT = Path(__file__).resolve().parents[2]
_READER = (
    "import sys; sys.path.append(sys.argv[1]); "
    "from bayes_toe.data.matlab_file import write_texts; write_texts(sys.argv[2])"
)


def matlab_texts(source: str, data: bytes) -> dict[str, ColumnTexts]:
    """The columns of a file, as text, all of one length, with their problems.

    Trials are fields of one struct, of vectors or of a struct array, or vectors of one length by
    name. A single value stands in every row. Arrays in the cells of a column are its problem.

    Raises
    ------
    InputError
        If the file is damaged, or holds anything else.
    """
    # -P keeps the working folder off the search path.
    command = [sys.executable, "-P", "-c", _READER, str(_PACKAGE_PARENT), source]
    try:
        reader = subprocess.run(command, input=data, capture_output=True, timeout=_LONGEST)
    except subprocess.TimeoutExpired:
        problem = f"{source}: not read within {_LONGEST} s, {_DAMAGED_ALLOWED}"
        raise InputError(problem) from None
    if reader.returncode:
        raise InputError(
            f"{source}: found a damaged MATLAB file (its reader ended with {reader.returncode}), "
            f"{_DAMAGED_ALLOWED}"
        )
    result = json.loads(reader.stdout)
    if "problems" in result:
        raise InputError(result["problems"])
    columns: dict[str, ColumnTexts] = result["columns"]
    return columns


# --- In the process of the reader -----------------------------------------------------------------


def write_texts(source: str) -> None:
    """Read a file from standard input and write its columns, or its problems, as JSON."""
    try:
        columns = _columns(source, _variables(source, sys.stdin.buffer.read()))
        texts = {}
        for name, cells in columns.items():
            texts[name] = cell_texts(name, cells, range(1, len(cells) + 1))
        json.dump({"columns": texts}, sys.stdout)
    except InputError as error:
        json.dump({"problems": error.problems}, sys.stdout)


def _variables(source: str, data: bytes) -> Record:
    from scipy.io import loadmat

    try:
        with warnings.catch_warnings(action="ignore"):
            variables = loadmat(io.BytesIO(data), simplify_cells=True)
    except NotImplementedError:
        raise InputError(
            f"{source}: found a file of version 7.3, allowed: one saved with '-v7'"
        ) from None
    except Exception as error:  # of a damaged file the library raises whatever its parser meets
        raise InputError(
            f"{source}: found a damaged MATLAB file ({one_line(error)}), {_DAMAGED_ALLOWED}"
        ) from None
    if "__function_workspace__" in variables:
        # MATLAB's own table objects are in no documented format.
        raise InputError(
            f"{source}: found a table or another object of MATLAB's own, allowed: {_SAVED}"
        )
    return {name: value for name, value in variables.items() if not name.startswith("__")}


def _columns(source: str, variables: Record) -> dict[str, list[Any]]:
    """The values of every column, all of one length."""
    fields = variables
    structs = _structs(variables)
    if len(structs) > 1:
        several = listed([*map(bare, structs)])
        raise InputError(f"{source}: found the structs {several}, allowed: {_SAVED}")
    for name in structs:
        fields = _fields(variables[name])
    columns = {name: np.atleast_1d(np.asarray(value, object)) for name, value in fields.items()}
    n_rows = max((column.size for column in columns.values()), default=0)
    if not n_rows:
        raise InputError(f"{source}: found nothing, allowed: {_SAVED}")
    wrong = []
    for name, column in columns.items():
        is_vector = column.size == max(column.shape)
        if not is_vector or column.size not in (1, n_rows):
            wrong.append(bare(name))
    if wrong:
        finding = f"{listed(wrong)}, not a column of {n_rows}"
        raise InputError(f"{source}: found {finding}, allowed: {_SAVED}")
    values = {}
    for name, column in columns.items():
        cells = column.ravel().tolist()
        values[name] = cells * (n_rows // len(cells))
    return values


def _structs(variables: Record) -> list[str]:
    """The names of the structs and struct arrays among variables."""
    names = []
    for name, value in variables.items():
        is_array = np.ndim(value) == 1 and len(value) and isinstance(value[0], dict)
        if is_array or isinstance(value, dict):
            names.append(name)
    return names


def _fields(struct: Any) -> Record:
    """The fields of a struct, or the values of each field over a struct array."""
    if isinstance(struct, dict):
        return struct
    values = {}
    for name in struct[0]:
        values[name] = np.array([trial[name] for trial in struct], object)
    return values
