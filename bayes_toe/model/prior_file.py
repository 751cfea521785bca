"""Priors as TOML files: read strictly, every problem in one line; what a file leaves out keeps its default."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from bayes_toe.data.cells import bare, quoted
from bayes_toe.errors import InputError
from bayes_toe.model.prior import Prior

#: What a prior file may hold: the values of a :class:`~bayes_toe.model.prior.Prior`.
KEYS = tuple(field.name for field in fields(Prior))
#: Beyond these a square would leave the range of floats.
_SMALLEST, _LARGEST = 1e-100, 1e100
_NUMBER = f"a number from -{_LARGEST:g} to {_LARGEST:g}"
_SCALE = f"a number from {_SMALLEST:g} to {_LARGEST:g}"


def read_prior(path: str | Path) -> Prior:
    """The prior in a TOML file with some of the keys mu1_mean, mu1_sd and sigma_p_scale, all natural-log intensity.

    Parameters
    ----------
    path : str or Path
        UTF-8; a key that is absent keeps its default.

    Raises
    ------
    InputError
        If the file cannot be read, is not TOML, or holds an unknown key, something that is not a number or a number out of range: one
        line per problem.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "prior.toml")
    ...     _ = file.write_text("mu1_sd = 2.5  # prior sd of mu1", encoding="utf-8")
    ...     read_prior(file)
    Prior(mu1_mean=0.0, mu1_sd=2.5, sigma_p_scale=1.0)
    """
    found = _table(path)
    problems = [f"{path}: {line}" for key, value in found.items() for line in _problem(key, value)]
    if problems:
        raise InputError(problems)
    return Prior(**{key: float(value) for key, value in found.items()})


def prior_or_default(path: str | Path | None) -> Prior:
    """The prior in a file, the default one where there is none."""
    return Prior() if path is None else read_prior(path)


def example_file() -> str:
    """A complete prior file with the defaults and what they mean.

    Examples
    --------
    >>> tomllib.loads(example_file()) == asdict(Prior())
    True
    """
    about = {
        "mu1_mean": "mean of the normal prior of mu1, natural-log intensity",
        "mu1_sd": "its standard deviation, natural-log intensity; positive",
        "sigma_p_scale": "scale of the half-normal prior of sigma_p, natural-log intensity; positive",
    }
    return "".join(f"{f'{key} = {value!r}':<21}# {about[key]}\n" for key, value in asdict(Prior()).items())


def _table(path: str | Path) -> Mapping[str, Any]:
    lines = ", ".join(f"{key} = NUMBER" for key in KEYS)
    try:
        return tomllib.loads(Path(path).read_bytes().decode("utf-8-sig"))  # Windows' editors put a byte-order mark in front
    except OSError as error:
        reason = "no such file" if isinstance(error, FileNotFoundError) else f"cannot be read ({error.strerror})"
        raise InputError(f"{path}: {reason}; allowed: a TOML file with {lines}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: found bytes that are not UTF-8, allowed: a TOML file with {lines}") from error
    except tomllib.TOMLDecodeError as error:
        what = " ".join(str(error).split())
        raise InputError(f"{path}: found text that is not TOML ({what}), allowed: lines {lines}") from error


def _problem(key: str, value: object) -> list[str]:
    if key not in KEYS:
        return [f"key {quoted(key)}: unknown, allowed: {', '.join(KEYS)}"]
    allowed = _NUMBER if key == "mu1_mean" else _SCALE
    # bool is an int for Python, not for a reader
    good = isinstance(value, int | float) and not isinstance(value, bool) and _in_range(key, value)
    return [] if good else [f"key {key}: found {_shown(value)}, allowed: {allowed}"]


def _in_range(key: str, value: float) -> bool:
    if isinstance(value, float) and not math.isfinite(value):
        return False
    return abs(value) <= _LARGEST if key == "mu1_mean" else _SMALLEST <= value <= _LARGEST


def _shown(value: object) -> str:
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, list):
        return "a list"
    return str(value).lower() if isinstance(value, bool) else quoted(value) if isinstance(value, str) else bare(str(value))
