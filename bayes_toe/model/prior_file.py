"""Priors as TOML files: read strictly, every problem in one line; what a file leaves out keeps its default."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from bayes_toe.data.messages import bare, quoted, visible
from bayes_toe.data.text_table import input_bytes
from bayes_toe.errors import InputError
from bayes_toe.model.prior import Prior
from bayes_toe.model.prior_fields import STIMULI, PriorField
from bayes_toe.model.study_prior import PAPER, PRESETS

_LARGEST = 2**16  # bytes; a complete file has some 2,000
AnyPrior = TypeVar("AnyPrior", bound=Prior)


def read_prior(path: str | Path, kind: type[AnyPrior] = Prior) -> AnyPrior:  # type: ignore[assignment]
    """The prior in a TOML file with some of the numbers that it declares, by name; :func:`example_file` has all, with their units.

    Parameters
    ----------
    path : str or Path
        UTF-8; a key that is absent keeps its default.
    kind : type
        Of prior; its declaration says which keys there are and which numbers are allowed.

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
    ...     read_prior(file) == Prior(mu1_sd=2.5)
    True
    """
    keys = {one.name: one for one in kind.declared()}
    found = toml_table(path, f"NAME = NUMBER, as in {next(iter(keys))} = 0")
    problems = [f"{path}: {line}" for key, value in found.items() for line in number_problems(keys, key, value)]
    if problems:
        raise InputError(problems)
    numbers: dict[str, Any] = {key: value if value == STIMULI else real(value) for key, value in found.items()}
    return kind(**numbers)


def preset_or_file(given: str | None) -> Prior:
    """The preset of this name, or the prior in the file of this path; the default one where there is nothing."""
    return PRESETS[PAPER] if given is None else PRESETS[given] if given in PRESETS else read_prior(given)


def example_file(kind: type[Prior] = Prior) -> str:
    """A complete prior file with the defaults and what they mean; what has none is a comment.

    Examples
    --------
    >>> print(example_file().splitlines()[0])
    mu1_mean = 0.0              # mean of the normal prior of mu1, natural-log intensity; or "stimuli", their mean
    """
    lines = {f"# {one.name} = 1.0" if one.default is None else f"{one.name} = {one.default!r}": one.about for one in kind.declared()}
    width = max(map(len, lines))
    return "".join(f"{line:<{width}}  # {about}\n" for line, about in lines.items())


def toml_table(path: str | Path, lines: str) -> Mapping[str, Any]:
    """What a TOML file holds; `lines` says which ones are allowed.

    Raises
    ------
    InputError
        In one line, if the file cannot be read or is not TOML.
    """
    try:
        return tomllib.loads(input_bytes(path, _LARGEST).decode("utf-8-sig"))  # Windows' editors put a byte-order mark in front
    except OSError as error:
        reason = "no such file" if isinstance(error, FileNotFoundError) else f"cannot be read ({error.strerror})"
        raise InputError(f"{path}: {reason}; allowed: a TOML file with {lines}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: found bytes that are not UTF-8, allowed: a TOML file with {lines}") from error
    except (ValueError, RecursionError) as error:  # the parser's own, Python's on integers of 5,000 digits, thousands of brackets
        what = visible(" ".join(str(error).split()))
        raise InputError(f"{path}: found text that is not TOML ({what}), allowed: lines {lines}") from error


def number_problems(keys: Mapping[str, PriorField], key: str, value: object) -> list[str]:
    """What is wrong with one number, in one line that ends in what is allowed; nothing where it is right."""
    if key not in keys:
        return [f"key {quoted(key)}: unknown, allowed: {', '.join(keys)}"]
    one = keys[key]
    # bool is an int for Python, not for a reader; a NaN is in no range
    if value == STIMULI and one.stimuli:
        return []
    good = one.smallest <= real(value) <= one.largest
    return [] if good else [f"key {key}: found {shown(value)}, allowed: {one.allowed}"]


def real(value: object) -> float:
    """The number that a value is; NaN where it is none, or too large an integer."""
    try:
        return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
    except OverflowError:
        return math.nan


def shown(value: object) -> str:
    """A value of a TOML file as messages show it."""
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, list):
        return "a list"
    if isinstance(value, int) and not isinstance(value, bool) and math.isnan(real(value)):
        return "an integer too large for a number"
    return str(value).lower() if isinstance(value, bool) else quoted(value) if isinstance(value, str) else bare(str(value))
