"""Tables of results: rows to go through and to look up, as a frame, and in a CSV file that is whole or not there."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from bayes_toe.data.places import reporting
from bayes_toe.data.whole_files import whole_file

if TYPE_CHECKING:
    import pandas as pd


def write_table(frame: pd.DataFrame, path: str | Path, *, overwrite: bool = False) -> Path:
    """A table as a CSV file: UTF-8, one line per row, numbers that read back to the same bits, missing as empty.

    Parameters
    ----------
    frame : pandas.DataFrame
        Its index is not written.
    path : str or Path
        The file to be.
    overwrite : bool
        Whether an existing file may be replaced.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    OutputError
        If the file cannot be written, or exists and may not be replaced.

    Examples
    --------
    >>> import tempfile
    >>> import pandas as pd
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     table = write_table(pd.DataFrame({"subject": ["S01"], "q0": [0.1 + 0.2]}), Path(folder, "table.csv"))
    ...     table.read_text(encoding="utf-8").splitlines()
    ['subject,q0', 'S01,0.30000000000000004']
    """
    target = Path(path)
    with whole_file(target, overwrite=overwrite) as temporary, reporting(target):
        frame.to_csv(temporary, index=False, encoding="utf-8", lineterminator="\n", na_rep="")
    return target
