"""Figures do not depend on settings files in the working folder.

matplotlib and ArviZ read such files when they are imported, and a data folder may hold one.
"""

from __future__ import annotations

import os
from contextlib import chdir
from importlib import import_module
from pathlib import Path


def ignore_settings_of_folder() -> None:
    """Import matplotlib and ArviZ so that they read no settings from the working folder.

    Both read files such as matplotlibrc there when they are imported, and a data folder may hold
    one. Nothing is imported where there is no such file.
    """
    if any(map(os.path.lexists, ("matplotlibrc", "arvizrc"))):
        with chdir(Path(__file__).parent):
            import_module("arviz")
            import_module("matplotlib")
