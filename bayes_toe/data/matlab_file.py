"""MATLAB files as columns of text, read in a process of their own.

SciPy reads files up to version 7, and h5py those of version 7.3, which are HDF5. A damaged file can
end the process of such a compiled reader. A separate process reads the file: if it ends, this one
file is refused.
"""

from __future__ import annotations

import io
import json
import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from bayes_toe.arrays import Record
from bayes_toe.data.text_table import damaged, require_size, value_text
from bayes_toe.errors import InputError

#: What MATLAB saves so that it can be read.
SAVED = (
    "one struct, one matrix, or vectors of one length: S = table2struct(T, 'ToScalar', true); "
    "save('trials.mat', '-struct', 'S', '-v7')"
)
_DAMAGED_ALLOWED = "one that MATLAB has saved with '-v7'"

#: Seconds after which a file is refused; one of 10^6 trials takes some 10 s.
_LONGEST = 120
_MOST_MEMORY = 2**32  # bytes
#: The program of the reader; its arguments are the parent of the package, and the source.
_READER = (
    "import sys; sys.path.append(sys.argv[1]); "
    "from bayes_toe.data.matlab_file import write_texts; write_texts(sys.argv[2])"
)


def matlab_values(source: str, data: bytes) -> Any:
    """The variables of a file by name: texts, structs by field, and arrays as lists.

    Raises
    ------
    InputError
        If the file is damaged, too large, or holds an object of MATLAB's own.
    """
    # -P keeps the working folder off the search path.
    package_parent = str(Path(__file__).resolve().parents[2])
    command = [sys.executable, "-P", "-c", _READER, package_parent, source]
    try:
        reader = subprocess.run(command, input=data, capture_output=True, timeout=_LONGEST)
    except subprocess.TimeoutExpired:
        raise InputError(
            f"{source}: not read within {_LONGEST} s, allowed: {_DAMAGED_ALLOWED}"
        ) from None

    if reader.returncode:
        raise damaged(
            source, "MATLAB", f"its reader ended with {reader.returncode}", _DAMAGED_ALLOWED
        )

    result = json.loads(reader.stdout)
    if "problems" in result:
        raise InputError(result["problems"])
    return result["variables"]


# --- In the process of the reader -----------------------------------------------------------------


def write_texts(source: str) -> None:
    """Read a file from standard input and write its columns, or its problems, as JSON."""
    try:
        if sys.platform != "win32":
            import resource

            with suppress(OSError, ValueError):  # some systems have no such limit
                resource.setrlimit(resource.RLIMIT_AS, (_MOST_MEMORY, _MOST_MEMORY))
        variables = _with_columns_of_matrix(_variables(source, sys.stdin.buffer.read()))
        sizes = list(_sizes(variables))
        require_size(source, len(sizes), len(sizes) * max(sizes, default=0))
        result: Record = {"variables": variables}
    except InputError as error:
        result = {"problems": error.problems}
    except MemoryError:
        problem = f"{source}: found more than fits into {_MOST_MEMORY:,} bytes of memory, allowed: "
        result = {"problems": [f"{problem}a smaller file"]}
    json.dump(result, sys.stdout, default=_json_value)


def _variables(source: str, data: bytes) -> Record:
    """The variables of a file of any version, without those that describe the file."""
    try:
        variables = _load_variables(data)
    except MemoryError:
        raise
    except Exception as error:  # of a damaged file the library raises whatever its parser meets
        raise damaged(source, "MATLAB", error, _DAMAGED_ALLOWED) from None

    # A file has such a variable if it holds a table or another object of MATLAB's own, whose format
    # is not documented.
    if {"__function_workspace__", "#subsystem#"} & variables.keys():
        raise InputError(
            f"{source}: found a table or another object of MATLAB's own, allowed: {SAVED}"
        )
    return {name: value for name, value in variables.items() if not name.startswith(("__", "#"))}


def _with_columns_of_matrix(variables: Record) -> Record:
    """The variables with the columns of a matrix in its place, if there is one matrix.

    The columns are named by the texts of a cell array with a text for each column, else by numbers.
    In a struct such as data.trials and data.colNames, columns stand in the place of its matrix.
    """
    for name, value in variables.items():
        if isinstance(value, dict):
            variables[name] = _with_columns_of_matrix(value)

    matrices = [name for name, value in variables.items() if np.ndim(value) == 2]
    if len(matrices) != 1:
        return variables
    columns = variables[matrices[0]].T
    names = list(map(str, range(1, len(columns) + 1)))

    other_variables = {}
    for name, value in variables.items():
        if np.shape(value) == (len(columns),) and isinstance(value[0], str):
            names = value
        elif name not in matrices:
            other_variables[name] = value
    return other_variables | dict(zip(names, columns, strict=True))


def _load_variables(data: bytes) -> Record:
    """All that a file holds, by name."""
    from scipy.io import loadmat

    try:
        with warnings.catch_warnings(action="ignore"):
            return loadmat(io.BytesIO(data), simplify_cells=True)
    except NotImplementedError:  # version 7.3, which is HDF5
        import h5py

        with h5py.File(io.BytesIO(data)) as file:
            return _hdf5_value(file)


def _hdf5_value(item: Any) -> Any:
    """A file or a struct by field, a text, or an array as MATLAB has it."""
    import h5py

    if isinstance(item, h5py.Group):
        fields = {}
        for name in item:
            if not isinstance(item.get(name, getlink=True), h5py.HardLink):
                raise ValueError(f"{name} is a link")  # perhaps to another file
            # '#refs#' is a folder of the contents of cells and objects.
            fields[name] = None if name.startswith("#") else _hdf5_value(item[name])
        return fields
    if item.external:
        raise ValueError(f"{item.name[1:]} is in another file")
    if item.nbytes > _MOST_MEMORY // 8:  # the process makes several copies of it
        raise MemoryError
    if "MATLAB_empty" in item.attrs:
        return ""

    values = item[()].T  # MATLAB writes the columns of an array as rows
    kind = item.attrs.get("MATLAB_class")
    if kind == b"char":
        texts = ["".join(map(chr, row)) for row in values]
        return texts[0] if len(texts) == 1 else texts
    if item.dtype == h5py.ref_dtype:  # a cell array, of references such as /#refs#/b
        cells = np.empty(values.size, object)
        for i, reference in enumerate(values.ravel("F")):
            cells[i] = _hdf5_value(item.file[reference])
        return cells

    if kind == b"logical":
        values = values.astype(bool)
    return values.item() if values.size == 1 else np.squeeze(values)


def _sizes(value: Any) -> Iterator[int]:
    """The size of an array, or of each array in a struct and in its structs."""
    if not isinstance(value, dict):
        yield np.size(value)
        return
    for field in value.values():
        yield from _sizes(field)


def _json_value(value: Any) -> Any:
    """An array as a list, or the text of a value."""
    return list(value) if isinstance(value, np.ndarray) else value_text(value)
