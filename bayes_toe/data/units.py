"""Units in a file: the levels of a condition within subjects become part of the subjects' names."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from bayes_toe.data.conditions import Conditions
from bayes_toe.data.covariates import level_words, levels
from bayes_toe.data.messages import bare, listed, quoted
from bayes_toe.data.options import ReadOptions
from bayes_toe.data.study import Study, Subject, felt_together
from bayes_toe.data.text_table import Column, TextTable
from bayes_toe.data.validation import AT, number
from bayes_toe.errors import InputError

#: From so many trials with a repeated pair on, it is no chance that each pair keeps its level.
_REPEATED = 10


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
