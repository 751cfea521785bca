"""Stores: folders in Zarr's format that hold draws, one thing as a file is, made, replaced and removed as a whole."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

#: How the name of a store ends.
STORE = ".zarr"
_OURS = {"model", "settings", "seed"}  # attributes that stores of draws have
_PIECES = re.compile(r"([^/]+/){0,2}zarr\.json|[^/]+/[^/]+/c(/[0-9]+)+")


def named_store(path: Path) -> bool:
    """Whether a path has the name of a store.

    Examples
    --------
    >>> named_store(Path("posterior.zarr")), named_store(Path("posterior.nc"))
    (True, False)
    """
    return path.suffix == STORE


def is_store(path: Path) -> bool:
    """Whether a folder is a store of draws with nothing else in it: then it may be replaced, and no file of a user is lost."""
    if not named_store(path) or path.is_symlink() or not path.is_dir():
        return False
    try:
        ours = json.loads((path / "zarr.json").read_text(encoding="utf-8"))["attributes"].keys() >= _OURS
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return False
    files = (Path(folder, name) for folder, _, names in os.walk(path) for name in names)
    return ours and all(_PIECES.fullmatch(file.relative_to(path).as_posix()) for file in files)
