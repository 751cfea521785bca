"""The prior of a study: a preset by its name, and the interval to which the priors of sigma_p, gamma and rho refer.

Scales that come from the stimuli become numbers subject by subject (:meth:`bayes_toe.model.prior.Prior.at`): subjects of one file may have
felt different ones. The reference interval is one for all: that of the prior, or the geometric mean of the study's intervals over all
trials. So a column with one interval only changes no evidence.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayes_toe.data.study import Study, require_study
from bayes_toe.errors import InputError
from bayes_toe.model.intervals import typical_interval
from bayes_toe.model.prior import DEFAULT, Prior, read_prior

PRESETS = {"default": DEFAULT, "paper": Prior()}


def preset_or_file(given: str | None) -> Prior:
    """The preset of this name, or the prior in the file of this path; the default one where there is nothing."""
    return DEFAULT if given is None else PRESETS[given] if given in PRESETS else read_prior(given)


def mean_first(study: Study) -> float:
    """Mean first stimulus of all trials, natural-log intensity."""
    s1, n = (np.concatenate([getattr(subject, name) for subject in study]) for name in ("s1", "n_trials"))
    return float(np.average(s1, weights=n))


def prior_for(study: Study, prior: Prior | str | None = None) -> Prior:
    """The prior with the reference interval of a study; without intervals, itself.

    Parameters
    ----------
    study : Study
    prior : Prior or str, optional
        A prior, or the name of a preset: "default" or "paper".

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
    if isinstance(prior, str) and prior not in PRESETS:
        raise InputError(f"prior {prior!r}: allowed: a Prior, or one of {', '.join(map(repr, PRESETS))}")
    given = DEFAULT if prior is None else PRESETS[prior] if isinstance(prior, str) else prior
    for subject in study:
        given.at(subject)
    return replace(given, reference_interval=_reference(study, given.reference_interval))


def _reference(study: Study, given: float | None) -> float | None:
    """The reference interval, seconds; None for a study without intervals."""
    if not study.intervals or given is not None:
        return given if study.intervals else None
    if len(study.intervals) == 1:
        return study.intervals[0]
    isi, n = (np.concatenate([np.asarray(getattr(subject, name)) for subject in study]) for name in ("isi", "n_trials"))
    return float(typical_interval(isi, n)[0])
