"""Figures as files, or as bytes.

The same figure gives the same bytes, and a file appears whole or not at all.
"""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.figure import Figure

from bayes_toe.arrays import StrPath
from bayes_toe.data.whole_files import whole_file
from bayes_toe.errors import InputError, require_kind, require_number

#: Metadata that would differ from one writing to the next, by format.
_UNDATED = {
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "Producer": None, "Creator": None},
    "svg": {"Date": None, "Creator": None},
}


def png(figure: Figure) -> bytes:
    """A figure as the content of a PNG file."""
    return figure_bytes(figure, "png", dpi=150)


def figure_bytes(figure: Figure, form: str, *, dpi: int = 300) -> bytes:
    """A figure as the content of a file in a format such as 'png'.

    Without dates or random names, so that the same figure gives the same bytes.
    """
    settings: dict[Any, Any] = {
        "text.hinting": "no_hinting",  # browsers scale pictures, and letters with them
        "pdf.fonttype": 42,  # TrueType: some journals refuse letters as outlines (type 3)
        "ps.fonttype": 42,
        "svg.fonttype": "none",  # texts as texts
        "svg.hashsalt": "bayes_toe",  # names from the content, not from chance
    }
    buffer = io.BytesIO()
    with warnings.catch_warnings(), mpl.rc_context(settings):
        # Characters that the font lacks become boxes.
        warnings.filterwarnings("ignore", "Glyph .* missing from font", UserWarning)
        figure.savefig(buffer, format=form, dpi=dpi, metadata=_UNDATED.get(form))
    return buffer.getvalue()


def save_figure(figure: Figure, path: StrPath, *, overwrite: bool = False, dpi: int = 200) -> Path:
    """Write a figure to a file. The suffix determines the format.

    The file is written completely or not at all.

    Raises
    ------
    OutputError
        If the file exists and may not be replaced, or cannot be written.
    InputError
        If matplotlib knows no such format.
    """
    require_kind("figure", figure, Figure, "Figure")
    require_number("dpi", dpi)
    with whole_file(path, overwrite=overwrite) as target:
        target.write_bytes(figure_bytes(figure, require_suffix(path), dpi=dpi))
    return Path(path)


def require_suffix(path: StrPath) -> str:
    """The format that a file's name says: 'S01.PNG' -> 'png'; unknown formats are refused."""
    suffix = Path(path).suffix.lstrip(".").lower()
    if suffix not in FigureCanvasBase.get_supported_filetypes():
        raise InputError(
            f"{path}: found suffix {suffix!r}, allowed: png, pdf, svg and what else matplotlib "
            "writes"
        )
    return suffix
