"""Observers in relation to what they are shown: one middle and one prior of all designs that are compared, and whether anybody answers.

Nothing here knows zero: with a constant added to every stimulus observers move along, so that a study of ln(rate / 1 Hz) near 3.4 is
planned as one of amplitudes near its reference is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from bayes_toe.data.study import Study, Subject
from bayes_toe.errors import InputError
from bayes_toe.model.prior import Prior
from bayes_toe.model.study_prior import prior_for
from bayes_toe.planning.observers import MIDDLE, PLAIN, PRIOR, Observer, observers_from, of_kind
from bayes_toe.planning.study_design import Pairs, StudyDesign

_NEVER = 0.01  # P(equal) below which an answer is practically certain
_NO_LAPSES = 1e-12
#: What helps where nobody ever says 'equal': with observers who are stated, and with those who are assumed amid all designs.
_STATED = "observers stated for such stimuli (at, mu1, offset), or those who are assumed amid them where --observers is left out"
_AMID_ALL = "designs of neighbouring stimuli, amid which these observers are assumed; each of the others by itself"


def assumed(
    given: str | Path | Sequence[Observer] | None, designs: Mapping[str, StudyDesign], size: int, seed: int, prior: Prior | str | None
) -> Sequence[Observer]:
    """The observers given, or so many of each kind of a source, the same ones for all designs.

    Raises
    ------
    InputError
        If the source is not allowed, or all observers of a kind would practically never say 'equal' in a design.
    """
    if size < 1:
        raise InputError(f"data_sets={size}: allowed is at least 1")
    people: Sequence[Observer]
    if given is None or isinstance(given, str | Path):
        shown = list(designs.values())
        people = observers_from(given, size, seed, prior=prior_of(shown, prior), middle=middle_of(shown))
    else:
        people = given
    if given != PRIOR:  # of whom some are so
        for name, one in designs.items():
            _require_answers(people, name, one, _AMID_ALL if given is None else _STATED)
    return people


def middle_of(shown: Iterable[StudyDesign | Pairs]) -> float:
    """From where default offsets count: the middle of all stimuli, or that of the paper's where it lies in the middle half of them.

    So the paper's own numbers stand, and those of wider ranges about it.

    Examples
    --------
    >>> middle_of([StudyDesign([0.0], [0.51], [1])]), middle_of([StudyDesign([4.0], [4.5], [1]), StudyDesign([3.5], [3.5], [1])])
    (0.25, 4.0)
    """
    stimuli = np.concatenate([values for one in shown for values in (one.s1, one.s2)])
    lowest, highest = float(stimuli.min()), float(stimuli.max())
    middle = 0.5 * (lowest + highest)
    return MIDDLE if abs(middle - MIDDLE) <= 0.25 * (highest - lowest) else middle


def prior_of(shown: Sequence[StudyDesign], prior: Prior | str | None) -> Prior:
    """The prior in numbers, for the stimuli and intervals of all designs together; of some without intervals, those of the others."""
    subjects = [replace(one.unanswered, name=str(number)) for number, one in enumerate(shown)]
    timed, rest = ([one for one in subjects if (one.isi is not None) == has] for has in (True, False))
    if not (timed and rest):
        return prior_for(Study(tuple(subjects)), prior)
    untimed = tuple(Subject.from_counts(one.name, one.s1, one.s2, one.n_equal, one.n_trials) for one in subjects)
    return replace(prior_for(Study(untimed), prior), reference_interval=prior_for(Study(tuple(timed)), prior).reference_interval)


def _require_answers(people: Sequence[Observer], name: str, design: StudyDesign, allowed: str) -> None:
    """Refuse a design whose stimuli are so far from observers that all of a kind find even identical ones different."""
    for kind in PLAIN:
        some = of_kind(people, kind)
        if some and not any(_answers(one, design) for one in some):
            stimuli = np.concatenate([design.s1, design.s2])
            raise InputError(
                f"observers: with {name}, stimuli from {stimuli.min():g} to {stimuli.max():g}, P(equal) of all observers of the kind "
                f"'{kind}' is below {_NEVER:g}, even of identical stimuli, and nothing can be told; allowed: {allowed}"
            )


def _answers(one: Observer, design: StudyDesign) -> bool:
    """Whether an observer says 'equal' to some pair, or to one of its stimuli twice, otherwise than by a lapse."""
    rest = design.pairs.columns[2:]
    twice = [np.stack([values, values, *rest]) for values in (design.s1, design.s2)]
    columns = np.unique(np.hstack([np.stack(design.pairs.columns), *twice]), axis=1)
    pairs = StudyDesign(columns[0], columns[1], np.ones(columns.shape[1], np.int64), *columns[2:])
    lapses = {"lapse_rate": _NO_LAPSES} if "lapse_rate" in one.quantities else {}
    return bool((replace(one, quantities={**one.quantities, **lapses}).equal(pairs) > _NEVER).any())
