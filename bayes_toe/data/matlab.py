"""Trials in MATLAB's files: fields of one struct, of vectors or of a struct array, or else vectors of one length, by name.

A single value stands in every row, such as the subject whose file it is. MATLAB's own table objects are in no documented format: they are
refused, with what to save instead.
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

from bayes_toe.data.messages import bare, listed
from bayes_toe.errors import InputError

_SAVED = "S = table2struct(T, 'ToScalar', true); save('trials.mat', '-struct', 'S', '-v7')"
_ALLOWED = f"one struct, or vectors of one length: {_SAVED}"
_DAMAGED = "found a damaged MATLAB file ({}), allowed: one that MATLAB has saved with '-v7'"


def matlab_columns(source: str, data: bytes) -> dict[str, list[Any]]:
    """The columns in a file, of one length or of one value.

    Raises
    ------
    InputError
        If the file is damaged, of a version that needs MATLAB, or holds something else than columns of one length.
    """
    # In a process of its own, because some damaged files end the process that reads them.
    reader = f"import sys; sys.path.append({str(Path(__file__).parents[2])!r}); from bayes_toe.data.matlab import print_columns as p; p()"
    done = subprocess.run([sys.executable, "-P", "-c", reader], input=data, capture_output=True, check=False)
    if done.returncode:
        raise InputError(f"{source}: {_DAMAGED.format(f'reading it ended with {done.returncode}')}")
    refused, columns = json.loads(done.stdout)
    if refused:
        raise InputError(f"{source}: {refused}")
    return dict(columns)


def print_columns() -> None:
    """Of the file that is standard input: why it is refused, or nothing, and its columns, as JSON."""
    warnings.simplefilter("ignore")
    refused, columns = "", dict[str, list[object]]()
    try:
        columns = _columns(_variables(sys.stdin.buffer.read()))
    except InputError as error:
        refused = str(error)
    json.dump((refused, columns), sys.stdout, default=lambda value: {type(value).__name__: str(value)})


def _variables(data: bytes) -> dict[str, Any]:
    from scipy.io import loadmat

    try:
        found = loadmat(io.BytesIO(data), simplify_cells=True)
    except NotImplementedError:
        raise InputError("found a file of version 7.3, allowed: one saved with '-v7'") from None
    except Exception as error:  # of a damaged file the library raises whatever its parser meets
        raise InputError(_DAMAGED.format(bare(" ".join(str(error).split())[:200]))) from None
    if "__function_workspace__" in found:
        raise InputError(f"found a table or another object of MATLAB's own, allowed: {_ALLOWED}")
    return {name: value for name, value in found.items() if not name.startswith("__")}


def _columns(found: dict[str, Any]) -> dict[str, list[object]]:
    structs = {name: value for name, value in found.items() if isinstance(value, dict)}
    arrays = {name: value for name, value in found.items() if np.ndim(value) == 1 and len(value) and isinstance(value[0], dict)}
    if len(structs) + len(arrays) > 1:
        raise InputError(
            f"found the structs {listed([bare(name) for name in found if name in {**structs, **arrays}])}, allowed: {_ALLOWED}"
        )
    for struct in structs.values():
        found = struct
    for trials in arrays.values():
        found = {name: np.array([one[name] for one in trials], object) for name in trials[0]}
    columns = {name: np.atleast_1d(np.asarray(value, object)) for name, value in found.items()}
    lengths = {name: column.size if column.size == max(column.shape) else 0 for name, column in columns.items()}
    most = max(lengths.values(), default=0)
    wrong = [bare(name) for name, length in lengths.items() if length not in (1, most) or not length]
    if wrong or not most:
        raise InputError(f"found {f'{listed(wrong)}, not a column of {most}' if wrong else 'nothing'}, allowed: {_ALLOWED}")
    return {
        name: [value.item() if isinstance(value, np.generic) else value for value in column.ravel()] for name, column in columns.items()
    }
