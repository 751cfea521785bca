"""A prior that refers to a study, made numbers: once, where the study meets the prior, so that all subjects and models have the same.

A prior may say "stimuli" for a location or a scale: mean, range or step of the stimuli presented, weighted by trials. With all of them so
(the preset `stimuli`) nothing depends on the unit of intensity: a constant added to every stimulus, or a factor, changes no evidence.

With inter-stimulus intervals, what the prior says of sigma_p, gamma and rho holds over the reference interval: that of the prior, or the
geometric mean of the study's intervals over all trials. So a column with one interval only changes no evidence.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from bayes_toe.data.study import Study, require_study
from bayes_toe.errors import InputError
from bayes_toe.model.intervals import typical_interval
from bayes_toe.model.prior import Prior, read_prior
from bayes_toe.model.prior_fields import STIMULI

#: The paper's prior, which is the default, and the one of no unit.
PAPER = "paper"
_ALL: dict[str, Any] = {one.name: STIMULI for one in Prior.declared() if one.stimuli}
PRESETS = {PAPER: Prior(), STIMULI: Prior(**_ALL)}


def preset_or_file(given: str | None) -> Prior:
    """The preset of this name, or the prior in the file of this path; the default one where there is nothing."""
    return PRESETS[PAPER] if given is None else PRESETS[given] if given in PRESETS else read_prior(given)


class Stimuli(NamedTuple):
    """Location and scales of a study's stimuli, natural-log intensity.

    Attributes
    ----------
    mean : float
        Of all stimuli presented, first and second.
    mean_s1 : float
        Of the first ones.
    range : float
        From the lowest to the highest.
    step : float
        Root mean square of s2 - s1 over trials with different stimuli.
    """

    mean: float
    mean_s1: float
    range: float
    step: float

    @property
    def four_ranges(self) -> float:
        """Four times the range: about as far from the stimuli as a mean of a prior belief may be."""
        return 4.0 * self.range

    @property
    def inverse_range(self) -> float:
        """1 / range."""
        return 1.0 / self.range

    @property
    def log_step(self) -> float:
        """Natural logarithm of the step."""
        return float(np.log(self.step))

    @classmethod
    def of(cls, study: Study) -> Stimuli:
        """Those of a study.

        Raises
        ------
        InputError
            If no pair has different stimuli: there is no scale.

        Examples
        --------
        >>> from bayes_toe.data.study import Subject
        >>> Stimuli.of(Study([Subject("S", [0.0, 1.0], [3.0, 0.0], [1, 1], [5, 5])])).range
        3.0
        """
        s1, s2, n = (np.concatenate([getattr(subject, name) for subject in study]) for name in ("s1", "s2", "n_trials"))
        unequal = s1 != s2
        if not unequal.any():
            raise InputError(
                f"{STIMULI!r} in a prior needs pairs of different stimuli, found none; allowed: numbers, as the prior {PAPER!r} has"
            )
        mean = float(np.average(0.5 * (s1 + s2), weights=n))
        step = float(np.sqrt(np.average(np.square(s2 - s1)[unequal], weights=n[unequal])))
        return cls(mean, mean_first(study), float(np.maximum(s1, s2).max() - np.minimum(s1, s2).min()), step)


def mean_first(study: Study) -> float:
    """Mean first stimulus of all trials, natural-log intensity."""
    s1, n = (np.concatenate([getattr(subject, name) for subject in study]) for name in ("s1", "n_trials"))
    return float(np.average(s1, weights=n))


def prior_for(study: Study, prior: Prior | str | None = None) -> Prior:
    """The prior in numbers for a study, the same for all its subjects; a prior of numbers without intervals is itself.

    Parameters
    ----------
    study : Study
    prior : Prior or str, optional
        A prior, perhaps with "stimuli" in the place of numbers, or the name of a preset: "paper" (the default) or "stimuli".

    Raises
    ------
    InputError
        If there is no such preset, or the stimuli have no scale; for something else than a study.

    Examples
    --------
    >>> from bayes_toe.data.study import Subject
    >>> study = Study([Subject("S", [0.0, 0.0], [0.0, 0.5], [9, 4], [10, 10])])
    >>> prior_for(study, "stimuli").describe()[:74]
    'mu1 ~ Normal(0.125, 0.5), sigma_p ~ HalfNormal(0.5), gamma ~ Uniform(0, 1)'
    """
    require_study(study)
    if isinstance(prior, str) and prior not in PRESETS:
        raise InputError(f"prior {prior!r}: allowed: a Prior, or one of {', '.join(map(repr, PRESETS))}")
    given = PRESETS[PAPER if prior is None else prior] if prior is None or isinstance(prior, str) else prior
    named = [one for one in given.declared() if getattr(given, one.name) == STIMULI]
    found = replace(given, reference_interval=_reference(study, given.reference_interval))
    if not named:
        return found
    stimuli = Stimuli.of(study)
    words = f"{', '.join(one.name for one in named)} from the stimuli"
    numbers: dict[str, Any] = {one.name: getattr(stimuli, one.stimuli) for one in named}
    return replace(found, **numbers, origin=words)


def _reference(study: Study, given: float | None) -> float | None:
    """The reference interval, seconds; None for a study without intervals."""
    if not study.intervals or given is not None:
        return given if study.intervals else None
    if len(study.intervals) == 1:
        return study.intervals[0]
    isi, n = (np.concatenate([np.asarray(getattr(subject, name)) for subject in study]) for name in ("isi", "n_trials"))
    return float(typical_interval(isi, n)[0])
