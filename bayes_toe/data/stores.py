"""Stores: folders in Zarr's format that hold draws, one thing as a file is, made, replaced and removed as a whole."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Any

#: How the name of a store ends.
STORE = ".zarr"
#: The document of a store that says everything but the numbers, and its attribute that only stores of draws have.
DOCUMENT, SEAL = "zarr.json", "bayes_toe_sha256"
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
        ours = SEAL in store_document(path)["attributes"]
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return False
    files = (Path(folder, name) for folder, _, names in os.walk(path) for name in names)
    return ours and all(_PIECES.fullmatch(file.relative_to(path).as_posix()) for file in files)


def store_document(path: Path) -> Any:
    """The document of a store; raises OSError, ValueError or RecursionError where it is none."""
    return json.loads((path / DOCUMENT).read_text(encoding="utf-8"))
