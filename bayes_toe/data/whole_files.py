"""Results as they go out: every file appears whole, by a rename, or not at all.

An existing file is replaced only where the caller says so. What a failed or interrupted run leaves behind is what was
there before it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from bayes_toe.data.places import finished, make_folders, probe, put_in_place, refuse_impossible, remove, reporting, shown, taken
from bayes_toe.data.stores import is_store, named_store
from bayes_toe.data.unfinished import free_name, sweep
from bayes_toe.errors import OutputError


@contextmanager
def whole_file(path: str | Path, *, overwrite: bool = False) -> Iterator[Path]:
    """A temporary path to write to, which becomes `path` when the block ends well and is removed when it does not.

    Parameters
    ----------
    path : str or Path
        The file to be; missing folders are made, and removed again on failure.
    overwrite : bool
        Whether an existing file may be replaced.

    Yields
    ------
    Path
        A path that does not exist yet, in the same folder and with the same suffix.

    Raises
    ------
    OutputError
        If the file exists and may not be replaced, is a folder, or it or its folder cannot be made or written to.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with whole_file(Path(folder, "new", "a.txt")) as temporary:
    ...         _ = temporary.write_text("whole", encoding="utf-8")
    ...     Path(folder, "new", "a.txt").read_text(encoding="utf-8")
    'whole'
    """
    target = Path(path)
    _refuse_taken(target, overwrite)
    with ExitStack() as made, ExitStack() as cleanup:
        make_folders(target.parent, made)
        temporary = free_name(target.parent, target.suffix)
        cleanup.callback(remove, temporary)
        probe(temporary)
        with reporting(target):
            yield temporary
            put_in_place(temporary, target, overwrite)
        made.pop_all()
        finished.append(target)


def require_writable(path: str | Path, *, overwrite: bool) -> None:
    """Refuse now what :func:`whole_file` would refuse after long work, with its arguments and errors; leaves nothing behind.

    What processes that were killed have left unfinished there is swept.

    Examples
    --------
    >>> require_writable(".", overwrite=True)
    Traceback (most recent call last):
        ...
    bayes_toe.errors.OutputError: .: is a folder, choose the name of a file
    """
    target = Path(path)
    _refuse_taken(target, overwrite)
    with ExitStack() as made:
        make_folders(target.parent, made)
        sweep(target.parent)
        probe(free_name(target.parent, target.suffix))


def _refuse_taken(target: Path, overwrite: bool) -> None:
    refuse_impossible(target)
    if os.path.isdir(target) and not is_store(target):
        what = "holds something else than draws, choose another name" if named_store(target) else "is a folder, choose the name of a file"
        raise OutputError(f"{shown(target)}: {what}")
    if not overwrite and os.path.lexists(target):
        raise taken(target)
