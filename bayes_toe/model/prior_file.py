"""Presets and prior files: TOML with a section for each parameter, [paper] for H1, and [group].

`read_prior` reads a file, `hyperprior_from` reads the prior of a group from it, and `prior_for`
gives the prior of a study.
"""

from __future__ import annotations

import os
from pathlib import Path

from bayes_toe.arrays import StrPath
from bayes_toe.data.messages import format_path
from bayes_toe.data.read_table import toml_table
from bayes_toe.data.study import Study, require_study
from bayes_toe.errors import InputError, require_kind
from bayes_toe.model.prior import DEFAULT, GROUP, PAPER, Hyperprior, Prior, changed_prior


def read_prior(path: StrPath) -> Prior:
    """Read a prior from a TOML file. Background describes all sections and keys.

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
    table = toml_table(path, "[SECTION] and NAME = NUMBER, as in [contraction] and sd = 0.25")
    return changed_prior(Prior() if PAPER in table else DEFAULT, table, format_path(Path(path)))


def hyperprior_from(source: Hyperprior | StrPath | None) -> Hyperprior:
    """The prior of a group: the given prior, that of a prior file, or (None) the default.

    A file may also have nothing but the sections of [group], without `group.` in their names.

    Raises
    ------
    InputError
        As :func:`read_prior`.
    """
    if source is None:
        return Hyperprior()
    if isinstance(source, Hyperprior):
        return source

    require_kind(
        "hyperprior", source, (str, os.PathLike), "a Hyperprior, or the path of a TOML file"
    )
    table = toml_table(
        source, "[SECTION] and NAME = NUMBER, as in [group.contraction] and sd_scale = 0.3"
    )

    if GROUP not in table:  # the sections of the file are those of the group
        table = {GROUP: table}
    return changed_prior(DEFAULT, table, format_path(Path(source))).group


# --- The prior of a study -------------------------------------------------------------------------

PRESETS = {"default": DEFAULT, "paper": Prior()}


def preset_or_file(source: Prior | StrPath | None) -> Prior:
    """The given prior, the preset of this name, the prior in this file, or (None) the default."""
    if source is None:
        return DEFAULT
    if isinstance(source, Prior):
        return source
    kinds = f"{', '.join(map(repr, PRESETS))}, a TOML file, or in Python a Prior"
    require_kind("prior", source, (str, os.PathLike), kinds)
    if str(source) in PRESETS:
        return PRESETS[str(source)]
    # A text without a suffix is more probably a misspelt preset than a file.
    if not Path(source).suffix and not Path(source).exists():
        raise InputError(f"prior {str(source)!r}: no such preset or file, allowed: {kinds}")
    return read_prior(source)


def prior_for(study: Study, prior: Prior | str | None = None) -> Prior:
    """The prior that is asked for; every subject of a study needs a scale for the prior.

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
        If there is no such preset, or no scale for the prior, because a subject has no pairs of
        different stimuli; for something else than a study.

    Examples
    --------
    >>> from bayes_toe.data.study import Subject
    >>> study = Study([Subject("S", [0.0, 0.0], [0.0, 0.5], [9, 4], [10, 10])])
    >>> prior_for(study).describe().split("; ")[0]
    'mu1 ~ Normal(M, 2.5 R), width ~ LogNormal(D, 1), gamma ~ Uniform(0, 1), q0 ~ Beta(4, 1)'
    """
    require_study(study, several_tasks=True)
    study_prior = preset_or_file(prior)
    for subject in study:
        study_prior.for_subjects(subject)  # refuses a subject that gives no scale
    return study_prior
