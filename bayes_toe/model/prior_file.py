"""Presets and prior files: TOML with a section for each parameter, and [paper] for H1.

`read_prior` reads a file, `example_file` has the text of one, and `prior_for` gives the prior of a
study.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from bayes_toe.arrays import StrPath
from bayes_toe.data.messages import quoted
from bayes_toe.data.read_table import toml_table
from bayes_toe.data.study import Study, require_study
from bayes_toe.errors import InputError, require_kind
from bayes_toe.model.parameters import PARAMETERS, ObserverPrior
from bayes_toe.model.prior import DEFAULT, Prior
from bayes_toe.model.prior_fields import (
    STIMULI,
    PriorField,
    number_problems,
    real,
)

#: The section of the paper's model (H1).
PAPER = "paper"


def sections() -> dict[str, dict[str, PriorField]]:
    """Every section of a prior file, with its keys."""
    by_section: dict[str, dict[str, PriorField]] = {}
    for parameter in PARAMETERS:
        name = parameter.name
        by_section[name] = {}
        for key, words in parameter.prior_keys:
            default = getattr(ObserverPrior, f"{name}_{key}")
            by_section[name][key] = PriorField(key, default, name, words, "", 1e-3, 1e3)
    by_section[PAPER] = {number.name: number for number in Prior.declared()}
    return by_section


def read_prior(path: StrPath) -> Prior:
    """Read a prior from a TOML file. :func:`example_file` has all sections and keys.

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
    all_sections = sections()
    table = toml_table(path, "[SECTION] and NAME = NUMBER, as in [contraction] and sd = 0.25")
    problems = []
    for section, values in table.items():
        if section in all_sections and isinstance(values, Mapping):
            problems += _key_problems(all_sections, section, values)
        else:
            problems.append(_misplaced(all_sections, section))
    if problems:
        raise InputError([f"{path}: {line}" for line in problems])

    observer = {}
    for parameter in PARAMETERS:
        for key, value in table.get(parameter.name, {}).items():
            observer[f"{parameter.name}_{key}"] = real(value)
    prior = DEFAULT
    if PAPER in table:
        prior = Prior(**{key: _number(value) for key, value in table[PAPER].items()})
    return replace(prior, observer=ObserverPrior(**observer))


def _number(value: Any) -> Any:
    """A number of H1's prior: "stimuli" stays a word."""
    return value if value == STIMULI else real(value)


def _key_problems(
    all_sections: Mapping[str, Mapping[str, PriorField]], section: str, values: Mapping[str, Any]
) -> list[str]:
    """Problems of the keys of a section, a line each."""
    problems = []
    for key, value in values.items():
        problems += number_problems(all_sections[section], key, value)
    return [f"[{section}] {line}" for line in problems]


def _misplaced(all_sections: Mapping[str, Mapping[str, PriorField]], key: str) -> str:
    """The problem of a key outside the sections."""
    section_names = ", ".join(f"[{section}]" for section in all_sections)
    if key in all_sections:
        return (
            f"{key}: found no section, allowed: [{key}] and below it {', '.join(all_sections[key])}"
        )
    if key in all_sections[PAPER]:
        return f"key {key}: found outside of the sections, allowed: in the section [{PAPER}]"
    return f"key {quoted(key)}: unknown, allowed: sections {section_names}"


def example_file() -> str:
    """A complete prior file with the defaults of the observer and the paper's numbers of H1.

    What has no default is a comment.
    """
    blocks = []
    for section, keys in sections().items():
        lines = [f"[{section}]"]
        for number in keys.values():
            line = f"{number.name} = {number.default!r}"
            if number.default is None:
                line = f"# {number.name} = 1.0"
            lines.append(f"{line:<27} # {number.about}")
        blocks.append("\n".join(lines) + "\n")
    return "\n".join(blocks)


# --- The prior of a study -------------------------------------------------------------------------

PRESETS = {"default": DEFAULT, "paper": Prior()}


def preset_or_file(source: StrPath | None) -> Prior:
    """The preset of this name, or the prior in the file of this path; None is the default."""
    if source is None:
        return DEFAULT
    kinds = f"{', '.join(map(repr, PRESETS))}, a TOML file, or in Python a Prior"
    require_kind("prior", source, (str, os.PathLike), kinds)
    if str(source) in PRESETS:
        return PRESETS[str(source)]
    if not Path(source).suffix and not Path(source).exists():
        raise InputError(f"prior {str(source)!r}: no such preset or file, allowed: {kinds}")
    return read_prior(source)


def prior_for(study: Study, prior: Prior | str | None = None) -> Prior:
    """The prior that is asked for, if every subject of a study has a scale for it.

    Scales that come from the stimuli become numbers subject by subject
    (:meth:`bayes_toe.model.prior.Prior.for_subjects`), because subjects may have different stimuli.

    Parameters
    ----------
    study : Study
    prior : Prior or str, optional
        A prior, the name of a preset, "default" or "paper", or the path of a TOML file, see
        :func:`read_prior`.

    Raises
    ------
    InputError
        If there is no such preset, or no scale for it: a subject without pairs of different
        stimuli; for something else than a study.

    Examples
    --------
    >>> from bayes_toe.data.study import Subject
    >>> study = Study([Subject("S", [0.0, 0.0], [0.0, 0.5], [9, 4], [10, 10])])
    >>> prior_for(study).describe().split("; ")[0]
    'mu1 ~ Normal(M, 2.5 R), width ~ LogNormal(D, 1), gamma ~ Uniform(0, 1), q0 ~ Beta(4, 1)'
    """
    require_study(study)
    study_prior = prior if isinstance(prior, Prior) else preset_or_file(prior)
    for subject in study:
        study_prior.for_subjects(subject)
    return study_prior
