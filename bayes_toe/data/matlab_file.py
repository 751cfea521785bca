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
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from bayes_toe.arrays import Record
from bayes_toe.data.messages import display_name, join_names
from bayes_toe.data.text_table import NoValue, damaged, require_size, value_text
from bayes_toe.errors import InputError

_SAVED = (
    "one struct, or vectors of one length: S = table2struct(T, 'ToScalar', true); "
    "save('trials.mat', '-struct', 'S', '-v7')"
)
_DAMAGED_ALLOWED = "one that MATLAB has saved with '-v7'"
#: Where objects of MATLAB's own leave a mark, in files of both kinds.
_OBJECTS = {"__function_workspace__", "#subsystem#"}
#: Seconds after which a file is refused; one of 10^6 trials takes some 10 s.
_LONGEST = 120
_MOST_MEMORY = 2**32  # bytes
_READER = (
    "import sys; sys.path.append(sys.argv[1]); "
    "from bayes_toe.data.matlab_file import write_texts; write_texts(sys.argv[2])"
)


def matlab_columns(source: str, data: bytes) -> dict[str, list[str | NoValue]]:
    """The columns of a file, as text, all of one length.

    Trials are fields of one struct, of vectors or of a struct array, or vectors of one length by
    name. A single value stands in every row. An array in a cell is no value.

    Raises
    ------
    InputError
        If the file is damaged, or holds anything else.
    """
    # -P keeps the working folder off the search path.
    package_parent = str(Path(__file__).resolve().parents[2])
    command = [sys.executable, "-P", "-c", _READER, package_parent, source]
    try:
        reader = subprocess.run(command, input=data, capture_output=True, timeout=_LONGEST)
    except subprocess.TimeoutExpired:
        problem = f"{source}: not read within {_LONGEST} s, allowed: {_DAMAGED_ALLOWED}"
        raise InputError(problem) from None
    if reader.returncode:
        raise damaged(
            source, "MATLAB", f"its reader ended with {reader.returncode}", _DAMAGED_ALLOWED
        )
    result = json.loads(reader.stdout)
    if "problems" in result:
        raise InputError(result["problems"])
    columns = {}
    for name, cells in result["columns"].items():
        columns[name] = [cell if isinstance(cell, str) else NoValue(*cell) for cell in cells]
    return columns


# --- In the process of the reader -----------------------------------------------------------------


def write_texts(source: str) -> None:
    """Read a file from standard input and write its columns, or its problems, as JSON."""
    try:
        if sys.platform != "win32":
            import resource

            with suppress(OSError, ValueError):  # where the system cannot
                resource.setrlimit(resource.RLIMIT_AS, (_MOST_MEMORY, _MOST_MEMORY))
        columns = _columns(source, _variables(source, sys.stdin.buffer.read()))
        texts = {name: [*map(value_text, cells)] for name, cells in columns.items()}
        json.dump({"columns": texts}, sys.stdout)
    except InputError as error:
        json.dump({"problems": error.problems}, sys.stdout)
    except MemoryError:
        problem = f"{source}: found more than fits into {_MOST_MEMORY:,} bytes of memory"
        json.dump({"problems": [f"{problem}, allowed: a smaller file"]}, sys.stdout)


def _variables(source: str, data: bytes) -> Record:
    """The variables of a file of any version."""
    try:
        variables = _loaded(data)
    except MemoryError:
        raise
    except Exception as error:  # of a damaged file the library raises whatever its parser meets
        raise damaged(source, "MATLAB", error, _DAMAGED_ALLOWED) from None
    if _OBJECTS & variables.keys():
        # MATLAB's own table objects are in no documented format.
        raise InputError(
            f"{source}: found a table or another object of MATLAB's own, allowed: {_SAVED}"
        )
    return {name: value for name, value in variables.items() if not name.startswith(("__", "#"))}


def _loaded(data: bytes) -> Record:
    """All that a file holds; one of version 7.3 is HDF5."""
    import h5py
    from scipy.io import loadmat

    try:
        with warnings.catch_warnings(action="ignore"):
            variables: Record = loadmat(io.BytesIO(data), simplify_cells=True)
    except NotImplementedError:
        with h5py.File(io.BytesIO(data)) as file:
            variables = {name: _hdf5_value(file, name) for name in file}
    return variables


def _hdf5_value(group: Any, name: str) -> Any:
    """A variable, a field or a cell: a struct by field, a text, or an array as MATLAB has it."""
    import h5py

    if name.startswith("#"):  # the cells, to which references lead, and objects
        return None
    if not isinstance(group.get(name, getlink=True), h5py.HardLink):
        raise ValueError(f"{name} is a link")
    item = group[name]
    if isinstance(item, h5py.Group):
        return {field: _hdf5_value(item, field) for field in item}
    if item.external:
        raise ValueError(f"{name} is in another file")
    if item.nbytes > _MOST_MEMORY // 8:
        raise MemoryError
    if "MATLAB_empty" in item.attrs:
        return ""
    values = item[()].T
    kind = item.attrs.get("MATLAB_class")
    if kind == b"char":
        texts = ["".join(map(chr, row)) for row in values]
        return texts[0] if len(texts) == 1 else texts
    if item.dtype == h5py.ref_dtype:
        cells = np.empty(values.size, object)
        for i, reference in enumerate(values.ravel("F")):
            cells[i] = _hdf5_value(item.file["#refs#"], item.file[reference].name.split("/")[-1])
        return cells
    if kind == b"logical":
        values = values.astype(np.bool_)
    return values.item() if values.size == 1 else np.squeeze(values)


def _columns(source: str, variables: Record) -> dict[str, list[Any]]:
    """The values of every column, all of one length."""
    columns = {}
    for name, value in _fields(source, variables).items():
        columns[name] = np.atleast_1d(np.squeeze(np.asarray(value)))
    n_rows = max((column.size for column in columns.values()), default=0)
    if not n_rows:
        raise InputError(f"{source}: found nothing, allowed: {_SAVED}")
    require_size(source, len(columns), n_rows * len(columns))  # a small file may unpack to many
    wrong, values = [], {}
    for name, column in columns.items():
        if column.shape not in ((1,), (n_rows,)):
            wrong.append(display_name(name))
            continue
        cells = list(column)
        values[name] = cells * (n_rows // len(cells))
    if wrong:
        finding = f"{join_names(wrong)}, not a column of {n_rows}"
        raise InputError(f"{source}: found {finding}, allowed: {_SAVED}")
    return values


def _fields(source: str, variables: Record) -> Record:
    """The fields of the one struct or struct array; the variables where there is none."""
    structs = {}
    for name, value in variables.items():
        is_array = np.ndim(value) == 1 and len(value) and isinstance(value[0], dict)
        if is_array or isinstance(value, dict):
            structs[name] = value
    if len(structs) > 1:
        several = join_names([*map(display_name, structs)])
        raise InputError(f"{source}: found the structs {several}, allowed: {_SAVED}")
    for struct in structs.values():
        if isinstance(struct, dict):
            return struct
        return {name: np.array([trial[name] for trial in struct], object) for name in struct[0]}
    return variables
