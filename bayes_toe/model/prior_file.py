"""Prior files: TOML with a section for each parameter of the observer, and [paper] for H1."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from bayes_toe.data.messages import quoted
from bayes_toe.errors import InputError
from bayes_toe.model.parameters import ObserverPrior
from bayes_toe.model.prior import DEFAULT, Prior
from bayes_toe.model.prior_fields import (
    RETIRED,
    STIMULI,
    PriorField,
    number_problems,
    real,
    toml_table,
)

#: The section of the paper's model (H1).
PAPER = "paper"
#: Sections of the observer's parameters: the keys of each, in words. D and R are those of the stimuli.
_OBSERVER_WORDS: Mapping[str, Mapping[str, str]] = {
    "noise": {
        "median": "median of the lognormal prior of sigma_d, in D",
        "sd": "sd of its logarithm",
    },
    "q0": {"a": "a of the beta prior of q0", "b": "its b"},
    "lapse_rate": {"b": "the lapse rate has the prior Beta(1, b)"},
    "noise_slope": {"scale": "scale of Student's t with 3 degrees of freedom, over R"},
    "criterion_slope": {"scale": "scale of Student's t with 3 degrees of freedom, over R"},
    "constant_error": {"scale": "scale of Student's t with 3 degrees of freedom, in D"},
    "contraction": {"sd": "sd of the normal prior of p on (-1, 1)"},
}


def sections() -> dict[str, dict[str, PriorField]]:
    """Every section of a prior file, with its keys."""
    found = {}
    for section, words in _OBSERVER_WORDS.items():
        found[section] = {
            key: PriorField(
                key,
                getattr(ObserverPrior, f"{section}_{key}"),
                section,
                "scale",
                text,
                "",
                1e-3,
                1e3,
            )
            for key, text in words.items()
        }
    found[PAPER] = {one.name: one for one in Prior.declared()}
    return found


def read_prior(path: str | Path) -> Prior:
    """The prior in a TOML file; :func:`example_file` has all its sections and keys.

    Parameters
    ----------
    path : str or Path
        UTF-8. What is absent keeps its default. In the section [paper], what is absent keeps the
        paper's own number; without that section H1 keeps its default prior.

    Raises
    ------
    InputError
        If the file cannot be read, is not TOML, or holds an unknown key, something that is not a
        number or a number out of range: one line per problem.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "prior.toml")
    ...     _ = file.write_text("contraction.sd = 0.5", encoding="utf-8")
    ...     read_prior(file).observer.contraction_sd
    0.5
    """
    known = sections()
    found = toml_table(path, "[SECTION] and NAME = NUMBER, as in [contraction] and sd = 0.25")
    problems = []
    for section, values in found.items():
        if section in known and isinstance(values, Mapping):
            problems += _key_problems(known, section, values)
        else:
            problems.append(_misplaced(known, section))
    if problems:
        raise InputError([f"{path}: {line}" for line in problems])

    observer = {}
    for section in _OBSERVER_WORDS:
        for key, value in found.get(section, {}).items():
            observer[f"{section}_{key}"] = real(value)
    prior = DEFAULT
    if PAPER in found:
        prior = Prior(**{key: _number(value) for key, value in found[PAPER].items()})
    return replace(prior, observer=ObserverPrior(**observer))


def _number(value: Any) -> Any:
    """A number of H1's prior: "stimuli" stays a word."""
    return value if value == STIMULI else real(value)


def _key_problems(
    known: Mapping[str, Mapping[str, PriorField]], section: str, values: Mapping[str, Any]
) -> list[str]:
    """What is wrong with the keys of a section, one line each."""
    problems = []
    for key, value in values.items():
        if key in RETIRED:
            problems.append(_misplaced(known, key))
        else:
            problems += number_problems(known[section], key, value)
    return [f"[{section}] {line}" for line in problems]


def _misplaced(known: Mapping[str, Mapping[str, PriorField]], key: str) -> str:
    """What is wrong with a key that stands outside the sections, or that is retired."""
    allowed = f"allowed: sections {', '.join(f'[{section}]' for section in known)}"
    if key in known:
        return f"{key}: found no section, allowed: [{key}] and below it {', '.join(known[key])}"
    if key in known[PAPER]:
        return f"key {key}: found outside of the sections, allowed: in the section [{PAPER}]"
    if RETIRED.get(key):
        return f"key {key}: retired, allowed in its place: {RETIRED[key]}"
    if key in RETIRED:
        return f"key {key}: retired with its model, {allowed}"
    return f"key {quoted(key)}: unknown, {allowed}"


def example_file() -> str:
    """A complete prior file with the defaults of the observer and the paper's numbers of H1.

    What has no default is a comment.
    """
    blocks = []
    for section, keys in sections().items():
        lines = [f"[{section}]"]
        for one in keys.values():
            line = f"{one.name} = {one.default!r}"
            if one.default is None:
                line = f"# {one.name} = 1.0"
            lines.append(f"{line:<27} # {one.about}")
        blocks.append("\n".join(lines) + "\n")
    return "\n".join(blocks)
