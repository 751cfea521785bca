"""MATLAB beside CSV: a .mat file of trials is read into the same cells, so that every check is the same.

Its columns are the fields of one struct, or of a struct array, or else vectors of one length; a single value stands in every row, such as
the subject whose file it is. Row 1 is the first trial. MATLAB's own table objects are in no documented format: they are refused, with what
to save instead.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_toe.data.cells import Header
from bayes_toe.data.messages import bare, listed
from bayes_toe.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

MATLAB = "MATLAB"
_SAVED = "S = table2struct(T, 'ToScalar', true); save('trials.mat', '-struct', 'S', '-v7')"
_ALLOWED = f"one struct, or vectors of one length: {_SAVED}"


def is_matlab(path: str | Path) -> bool:
    """Whether a file is one by its name.

    Examples
    --------
    >>> is_matlab("trials.mat"), is_matlab("study.csv")
    (True, False)
    """
    return Path(path).suffix.lower() == ".mat"


def matlab_header(source: str, data: bytes) -> tuple[Header, pd.DataFrame]:
    """The header that names of fields stand for, and the columns as a frame.

    Raises
    ------
    InputError
        If the file is damaged, of a version that needs MATLAB, or holds something else than columns of one length.
    """
    import pandas as pd

    found = _loaded(source, data)
    structs = {name: value for name, value in found.items() if _is_struct(value)}
    if len(structs) > 1:
        raise InputError(f"{source}: found the structs {listed([*map(bare, structs)])}, allowed: {_ALLOWED}")
    columns = _fields(next(iter(structs.values()))) if structs else found
    flat = {name: _vector(value) for name, value in columns.items()}
    lengths = {name: len(value) for name, value in flat.items() if value is not None}
    wrong = [name for name, value in flat.items() if value is None]
    most = max(lengths.values(), default=0)
    wrong += [name for name, length in lengths.items() if length not in (1, most)]
    if wrong or not most:
        said = f"{listed([*map(bare, wrong)])}, not a column of {most}" if wrong else "nothing"
        raise InputError(f"{source}: found {said}, allowed: {_ALLOWED}")
    frame = pd.DataFrame({name: pd.Series(np.resize(value, most), dtype=object) for name, value in flat.items() if value is not None})
    return Header(source, MATLAB, "", [*frame.columns], 1), frame


def _loaded(source: str, data: bytes) -> dict[str, Any]:
    """The variables of a file by name."""
    from scipy.io import loadmat

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = loadmat(io.BytesIO(data), simplify_cells=True)
    except NotImplementedError:
        raise InputError(f"{source}: found a file of version 7.3, allowed: one saved with '-v7'") from None
    except Exception as error:  # of a damaged file the library raises whatever its parser meets
        said = bare(" ".join(str(error).split())[:200])
        raise InputError(f"{source}: found a damaged MATLAB file ({said}), allowed: one that MATLAB has saved with '-v7'") from None
    known = {name: value for name, value in found.items() if not name.startswith("__")}
    if "__function_workspace__" in found:
        raise InputError(f"{source}: found a table or another object of MATLAB's own, allowed: {_ALLOWED}")
    return known


def _is_struct(value: object) -> bool:
    return isinstance(value, Mapping) or (isinstance(value, list | np.ndarray) and len(value) > 0 and isinstance(value[0], Mapping))


def _fields(struct: Any) -> dict[str, Any]:
    """Columns of a struct of vectors, or of a struct array with a trial in each."""
    if isinstance(struct, Mapping):
        return dict(struct)
    return {name: np.array([one[name] for one in struct], object) for name in struct[0]}


def _vector(value: object) -> Any:
    """A column as an array of objects; None where it is none."""
    array = np.array([value], object) if isinstance(value, str) else np.asarray(value, object)
    if array.ndim == 0:
        array = array.reshape(1)
    return array.ravel() if array.size == max(array.shape, default=0) and array.size else None
