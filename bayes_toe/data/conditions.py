"""Conditions within subjects: each subject at each level of a column is a unit `S01@left`, whose scales are those of all of the subject's.

Units are what every analysis of single subjects takes as subjects. Their stimuli's location and scales, which priors and offsets refer to,
are those of the subject over all conditions: else a constant error would move with the stimuli that a condition happens to have.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.data.covariates import level_words, levels
from bayes_toe.data.messages import bare, counted, listed, quoted
from bayes_toe.data.text_table import Column, TextTable
from bayes_toe.data.validation import AT, number
from bayes_toe.errors import InputError

if TYPE_CHECKING:
    from bayes_toe.data.options import ReadOptions
    from bayes_toe.data.study import Study, Subject


_REPEATED = 10  # trials with a pair that was there before: from so many on it is no chance that all have the level that it had


class Stimuli(NamedTuple):
    """Location and scales of the stimuli that somebody felt, natural-log intensity; all are means over trials.

    Attributes
    ----------
    mean : float
        M, of all stimuli, first and second.
    sd : float
        R, their standard deviation.
    step : float
        D, root mean square of s2 - s1 over trials with different stimuli.
    first : float
        sbar, of the first stimuli.
    """

    mean: float
    sd: float
    step: float
    first: float

    @classmethod
    def of(cls, *subjects: Subject) -> Stimuli | None:
        """Those of one subject, of a unit over all of the subject's conditions; or of several together.

        None where no pair has different stimuli: there is no scale.
        """
        if len(subjects) == 1 and subjects[0].felt is not None:
            return subjects[0].felt
        s1, s2, n = (
            np.concatenate([getattr(subject, name) for subject in subjects])
            for name in ("s1", "s2", "n_trials")
        )
        unequal = (s1 != s2) & (n > 0)
        if not unequal.any():
            return None
        mean = float(np.average(0.5 * (s1 + s2), weights=n))
        sd = float(
            np.sqrt(np.average(0.5 * (np.square(s1 - mean) + np.square(s2 - mean)), weights=n))
        )
        step = float(np.sqrt(np.average(np.square(s2 - s1)[unequal], weights=n[unequal])))
        # differences whose squares are below the smallest float
        return (
            cls(mean, sd, step, float(np.average(s1, weights=n)))
            if sd > 0.0 and step > 0.0
            else None
        )

    def number(self, symbol: str) -> float:
        """What a key of :data:`bayes_toe.model.prior_fields.OF_STIMULI` stands for."""
        return {"M": self.mean, "2.5 R": 2.5 * self.sd, "D": self.step}[symbol]


def mean_first(*subjects: Subject) -> float:
    """Mean first stimulus of all trials, natural-log intensity; of a unit that of the subject over all conditions."""
    if len(subjects) == 1 and subjects[0].felt is not None:
        return subjects[0].felt.first
    s1, n = (
        np.concatenate([getattr(subject, name) for subject in subjects])
        for name in ("s1", "n_trials")
    )
    return float(np.average(s1, weights=n))


@dataclass(frozen=True)
class Conditions:
    """The levels of a condition that differs within subjects.

    Attributes
    ----------
    name : str
        The column of the file.
    levels : tuple of str
        The first one is that with which the others are compared.
    numeric : bool
        Whether levels are numbers, of which an effect is a slope.

    Examples
    --------
    >>> Conditions("hand", ("left", "right")).design().round(3).tolist()
    [[-0.5], [0.5]]
    >>> Conditions("delay", ("2", "4", "6"), numeric=True).comparisons
    (('6', '2'),)
    """

    name: str
    levels: tuple[str, ...]
    numeric: bool = False

    @cached_property
    def comparisons(self) -> tuple[tuple[str, str], ...]:
        """Levels that are compared, each with that which is taken from it: of numbers the largest and the smallest one."""
        if self.numeric:
            return ((max(self.levels, key=float), min(self.levels, key=float)),)
        return tuple((level, self.levels[0]) for level in self.levels[1:])

    def design(self, some: Sequence[str] | None = None) -> FloatArray:
        """Columns X, (levels, columns), of all levels or some: with independent N(0, h^2) effects any two levels differ by N(0, h^2).

        Of two levels -1/2 and 1/2; of more orthonormal ones that sum to 0, over 2^(1/2), so that no level is special; of numbers one,
        (x - mean)/range, so that the effect is that over the whole range.
        """
        own = self.levels if some is None else tuple(some)
        if self.numeric:
            x, all_of = np.array(own, np.float64), np.array(self.levels, np.float64)
            return np.asarray(((x - all_of.mean()) / np.ptp(all_of))[:, None])
        away = np.eye(len(own)) - 1.0 / len(own)
        turned = np.linalg.qr(away[:, 1:])[0] / np.sqrt(2.0)
        return np.asarray(turned * np.where(turned[-1] < 0.0, -1.0, 1.0))

    @property
    def about(self) -> str:
        """The column and its levels in words."""
        kind = ", as numbers" if self.numeric else f"; {bare(self.levels[0])} is the reference"
        return f"{bare(self.name)}: {counted(len(self.levels), 'level')}, {listed([*map(bare, self.levels)])}{kind}"


# --- Reading ---------------------------------------------------------------------------------------


def with_units(
    table: TextTable, columns: dict[str, Column], categorical: bool
) -> dict[str, Column]:
    """Columns by our names with the unit of every row as its subject, where there is a condition.

    Numbers that are written differently are one level; names with the sign that joins them are noted as problems.
    """
    if "condition" not in columns:
        return columns
    subject, level = columns["subject"], columns["condition"]
    for column in (subject, level):
        joined = column.map(lambda text: AT in text, np.bool_)
        table.fault(column, joined, f"a name without {AT}, which joins subject and condition")

    def word(text: str) -> str:
        value = math.nan if categorical else number(text, table.decimal_comma)
        return text if math.isnan(value) else level_words([value])[0]

    words = [word(text) for text in level.texts]
    pairs, codes = np.unique(
        np.column_stack([subject.codes, level.codes]), axis=0, return_inverse=True
    )
    names = [(subject.texts[one], words[other]) for one, other in pairs.tolist()]
    return {
        **columns,
        "subject": Column.of(
            subject.name, [f"{who}{AT}{what}" if who else "" for who, what in names], codes.ravel()
        ),
    }


def with_conditions(study: Study, options: ReadOptions) -> Study:
    """A study whose subjects are named as units, with what they are units of; subjects again, where none has several levels.

    An InputError where a condition was asked for that no subject meets at several levels, or a reference that is no level.
    """
    if "condition" not in study.reading.read:
        return study
    name, of = options.name("condition"), {one.name: one.name.partition(AT)[::2] for one in study}
    found = [level for _, level in of.values()]
    if not all(found):
        raise InputError(
            f"{study.source}: found column {bare(name)} in some files only, allowed: in all or in none"
        )
    if len({who for who, _ in of.values()}) == len(of):
        said = f"column {bare(name)}: found every subject at one level of it"
        if options.condition is not None:
            raise InputError(
                f"{study.source}: {said}, allowed: at two and more of some subject; between subjects it is a covariate"
            )
        whole = tuple(replace(one, name=of[one.name][0]) for one in study)
        notes = (*study.notes, f"{said}, so that it is no condition within subjects: not used")
        return replace(study, subjects=whole, notes=notes)
    values = [number(level, False) for level in found]
    numeric = not options.categorical and not any(map(math.isnan, values))
    order = level_words(levels(values if numeric else found))
    if options.reference not in (None, *order):
        raise InputError(
            f"--reference: found {quoted(str(options.reference))}, allowed: {listed([*map(bare, order)])}"
        )
    order.sort(key=lambda level: level != options.reference)
    people = list(dict.fromkeys(who for who, _ in of.values()))
    subjects = sorted(
        (replace(one, condition=of[one.name][1]) for one in study),
        key=lambda one: (people.index(one.person), order.index(one.condition)),
    )
    made = Conditions(name, tuple(order), numeric)
    return replace(
        study,
        subjects=felt_together(subjects),
        conditions=made,
        notes=(*study.notes, f"condition {made.about}"),
    )


def felt_together(subjects: Iterable[Subject]) -> tuple[Subject, ...]:
    """Units with the location and scales of the stimuli of their subjects."""
    people = by_person(subjects)
    felt = {
        person: Stimuli.of(*(replace(one, felt=None) for one in own))
        for person, own in people.items()
    }
    return tuple(
        replace(one, felt=felt[one.person]) for one in chain.from_iterable(people.values())
    )


def follows_from_pairs(people: Iterable[Sequence[Subject]]) -> bool:
    """Whether pairs were repeated, and none in two units of its subject: such a condition may be a name of pairs, or of their order."""
    repeated = 0
    for units in people:
        pairs = [set(zip(one.s1.tolist(), one.s2.tolist(), strict=True)) for one in units]
        distinct = len(set().union(*pairs))
        if len(units) > 1 and distinct < sum(map(len, pairs)):
            return False
        repeated += sum(one.total_trials for one in units) - distinct if len(units) > 1 else 0
    return repeated >= _REPEATED


def by_person(subjects: Iterable[Subject]) -> dict[str, tuple[Subject, ...]]:
    """Units by the subject that they are of."""
    found: dict[str, tuple[Subject, ...]] = {}
    for one in subjects:
        found[one.person] = (*found.get(one.person, ()), one)
    return found


# --- What files of results keep --------------------------------------------------------------------


def kept(study: Study) -> dict[str, Any]:
    """What tells conditions and units again, as JSON has it; empty without conditions."""
    if study.conditions is None:
        return {}
    return {
        **asdict(study.conditions),
        "units": {one.name: [one.condition, one.felt] for one in study},
    }


def from_kept(told: Mapping[str, Any]) -> tuple[Conditions | None, dict[str, dict[str, Any]]]:
    """The conditions, and of every unit by its name what a :class:`~bayes_toe.data.study.Subject` has besides the counts."""
    if not told:
        return None, {}
    units = {
        name: {"condition": level, "felt": felt and Stimuli(*felt)}
        for name, (level, felt) in told["units"].items()
    }
    return Conditions(told["name"], tuple(told["levels"]), told["numeric"]), units
