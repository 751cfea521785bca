"""The versions of the package and its libraries, and the settings files that libraries read."""

from __future__ import annotations

import os
from contextlib import chdir
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

__version__ = version("bayes_toe")


def library_versions(*names: str) -> dict[str, str]:
    """The versions of this package, of the libraries that decide numbers, and of `names`."""
    return {
        name: version(name)
        for name in ("bayes_toe", "numpy", "scipy", "emcee", "arviz", "arviz-stats", *names)
    }


def import_without_folder_settings() -> None:
    """Import matplotlib and ArviZ so that they read no settings from the working folder.

    Both read files such as matplotlibrc there when they are imported, and a data folder may hold
    such a file. Nothing is imported where there is no such file.
    """
    if any(map(os.path.lexists, ("matplotlibrc", "arvizrc"))):
        with chdir(Path(__file__).parent):  # the folder of this package has no such file
            import_module("arviz")
            import_module("matplotlib")
