"""The prior of a study: a preset by its name, and the interval to which the priors of sigma_p, gamma and rho refer.

Scales that come from the stimuli become numbers subject by subject (:meth:`bayes_toe.model.prior.Prior.at`): subjects of one file may have
felt different ones. The reference interval is one for all: that of the prior, or the geometric mean of the study's intervals over all
trials. So a column with one interval only changes no evidence.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from bayes_toe.data.study import Study, require_study
from bayes_toe.errors import InputError, require_kind
from bayes_toe.model.intervals import reference_interval
from bayes_toe.model.prior import DEFAULT, Prior
from bayes_toe.model.prior_file import read_prior

PRESETS = {"default": DEFAULT, "paper": Prior()}


def preset_or_file(given: str | Path | None) -> Prior:
    """The preset of this name, or the prior in the file of this path; the default one where there is nothing."""
    if given is None:
        return DEFAULT
    allowed = f"{', '.join(map(repr, PRESETS))}, a TOML file, or in Python a Prior"
    require_kind("prior", given, (str, os.PathLike), allowed)
    if str(given) in PRESETS:
        return PRESETS[str(given)]
    if not Path(given).suffix and not Path(given).exists():
        raise InputError(f"prior {str(given)!r}: no such preset or file, allowed: {allowed}")
    return read_prior(given)


def prior_for(study: Study, prior: Prior | str | None = None) -> Prior:
    """The prior with the reference interval of a study; without intervals, itself.

    Parameters
    ----------
    study : Study
    prior : Prior or str, optional
        A prior, the name of a preset, "default" or "paper", or the path of a TOML file, see :func:`bayes_toe.model.prior_file.read_prior`.

    Raises
    ------
    InputError
        If there is no such preset, or no scale for it: a subject without pairs of different stimuli; for something else than a study.

    Examples
    --------
    >>> from bayes_toe.data.study import Subject
    >>> study = Study([Subject("S", [0.0, 0.0], [0.0, 0.5], [9, 4], [10, 10])])
    >>> prior_for(study).describe()
    'mu1 ~ Normal(M, 2.5 R), width ~ LogNormal(D, 1), gamma ~ Uniform(0, 1), q0 ~ Beta(4, 1); M mean and R sd of the stimuli, D rms step'
    """
    require_study(study)
    given = prior if isinstance(prior, Prior) else preset_or_file(prior)
    for subject in study:
        given.at(subject)
    return replace(
        given,
        reference_interval=reference_interval(given.reference_interval, *study)
        if study.intervals
        else None,
    )
