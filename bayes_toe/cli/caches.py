"""A place for the caches of libraries, where the user's home has none."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from contextlib import suppress


def require_caches() -> None:
    """Give libraries a folder for this run where they could not make theirs: some fail without, or make it in the working directory."""
    cache = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    with suppress(OSError):
        if os.path.isabs(cache):
            os.makedirs(cache, exist_ok=True)
            if os.access(cache, os.W_OK):
                return
    with suppress(OSError):
        folder = tempfile.mkdtemp(prefix="bayes_toe-")
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        os.environ["XDG_CACHE_HOME"] = folder
        os.environ.setdefault("MPLCONFIGDIR", folder)
