"""How many subjects and trials find a difference between two conditions: simulated ones, by the words of `contrast` and of `population`.

Observers with a difference of the size that is asked for, and the same without, answer the design under both conditions, with half of the
trials under each. Single subjects are judged by :func:`bayes_toe.answers.contrast.contrast`, studies of several by
:func:`bayes_toe.groups.population.population`, each with its default model and the words of a Bayes factor of 3 and 20.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import cycle
from pathlib import Path
from warnings import catch_warnings, simplefilter

from bayes_toe.answers.contrast import ORDER_EFFECT, WORDS, contrast, word_of
from bayes_toe.data.conditions import felt_together
from bayes_toe.data.study import Study
from bayes_toe.data.validation import AT
from bayes_toe.errors import ConvergenceWarning, InputError
from bayes_toe.experiments.conditions import Differing, Sizes
from bayes_toe.groups.hyperprior import GROUP_PARAMETERS
from bayes_toe.groups.population import population
from bayes_toe.model.contrasted import QUANTITIES
from bayes_toe.model.ladder import ORDERS
from bayes_toe.model.prior import Prior
from bayes_toe.planning.observers import Observer, assumed, of_kind
from bayes_toe.planning.power import (
    DATA_SETS,
    TRIALS,
    Outcome,
    Simulations,
    named_designs,
    simulation,
    with_totals,
)
from bayes_toe.planning.power_of_studies import DRAWS, POPULATION_COLUMNS, PlannedStudy
from bayes_toe.planning.study_design import StudyDesign, nobody
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers

#: Conditions under which observers answer, and what is called the absence of any difference.
LEVELS, NOTHING = ("a", "b"), "nothing differs"
#: Words that say a difference, and none.
_SAID = {"differs": WORDS[:2], "no difference": WORDS[-1:-3:-1]}
_LABELS = {
    GROUP_PARAMETERS[name].label: key
    for key, names in QUANTITIES.items()
    for name in names
    if name in GROUP_PARAMETERS
}
_LABELS[ORDER_EFFECT] = ORDER_EFFECT
#: Quantities of `contrast`, by the names that observers have.
_OF_CONTRAST = {"contraction": "pull", "JND": "width"}


@dataclass(frozen=True, eq=False)
class ConditionsPower(Simulations[Outcome]):
    """Simulated studies under two conditions, and how often they say of each quantity that it differs, or that it does not."""

    COLUMNS = POPULATION_COLUMNS

    def sentences(self) -> list[str]:
        """How often a difference is said, probably or not, and how often one that is not there, a line a design, trials and subjects."""
        lines = []
        for design, trials, kind, size in self.different(
            "design", "trials", "observers", "subjects"
        ):
            whom = (
                "contrast says of single subjects"
                if size == 1
                else f"population says of {size} subjects on average"
            )
            for quantity in (
                part.rpartition(" ")[0] for part in kind.split(", ") if kind != NOTHING
            ):
                found, wrong = (
                    self.counted[design, trials, one, size, f"{quantity}: differs, probably or not"]
                    for one in (kind, NOTHING)
                )
                lines.append(
                    f"with {design} and {trials} trials each, {whom} that the {quantity} differs in {found.percent} of {found.size} with "
                    f"{kind} {found.interval}, and wrongly in {wrong.hits} without"
                )
        return lines


def power_of_conditions(  # noqa: PLR0913  # each is a choice of its own, and has a default
    differ: Sizes,
    design: StudyDesign | Mapping[str, StudyDesign] | None = None,
    trials: Sequence[int] = TRIALS,
    observers: str | Path | Sequence[Observer] | None = None,
    *,
    studies: Mapping[int, int] | None = None,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    keep: str | Path | None = None,
) -> ConditionsPower:
    """How often a difference between two conditions is found, in single subjects and on average; 1 to 2 seconds a subject of each study.

    Parameters
    ----------
    differ : mapping of str to (float, float)
        Of "constant error" (natural-log intensity), "pull" (its probit) and "width" (its log) the mean difference and its sd between the
        subjects of a study, see :class:`bayes_toe.experiments.conditions.Differing`. In single subjects the difference is the mean.
    design, trials, observers, seed, prior, workers, progress, keep
        As :func:`bayes_toe.planning.power.power` takes them; half of the trials are under either condition. Of the kinds of observers the
        last one that there is counts, with a pull if there is one.
    studies : mapping of int to int, optional
        How many studies there are of each number of subjects, with the difference and without; by default 100 of single ones.

    Raises
    ------
    InputError
        If something is not allowed.
    """
    many = {1: DATA_SETS} if studies is None else dict(sorted(studies.items()))
    if not differ or not many or min(*many, *many.values()) < 1:
        raise InputError(
            f"differ={differ!r}, studies={many}: allowed is something that differs, and studies of 1 subject or more"
        )
    designs = named_designs(design)

    def planned(root: int) -> list[PlannedStudy]:
        people = assumed(
            observers, designs, max(size * number for size, number in many.items()), root, prior
        )
        people = of_kind(people, max((one.kind for one in people), key=ORDERS.index))
        return [*planned_conditions(people, differ, many, root)]

    found = simulation(
        judged_study,
        "conditions",
        with_totals(designs, trials),
        planned,
        seed,
        prior,
        workers,
        progress,
        keep,
    )
    return ConditionsPower(*found)


def planned_conditions(
    people: Sequence[Observer], differ: Sizes, studies: Mapping[int, int], seed: int
) -> Iterator[PlannedStudy]:
    """So many studies of each number of the observers under both conditions, with a difference and without."""
    kind = ", ".join(f"{key} {size:+g}" for key, (size, _) in differ.items())
    for size, many in studies.items():
        spread = {key: (mean, sd if size > 1 else 0.0) for key, (mean, sd) in differ.items()}
        for label, apart in (
            (NOTHING, {key: (0.0, sd) for key, (_, sd) in spread.items()}),
            (kind, spread),
        ):
            differing = Differing.of(LEVELS, apart)
            for number in range(many):
                some = people[number * size : (number + 1) * size]
                units = tuple(
                    unit for one in some for unit in under_conditions(one, differing, seed)
                )
                yield PlannedStudy(f"study {number + 1} of {size}, {label}", label, units)


def under_conditions(one: Observer, differing: Differing, seed: int) -> list[Observer]:
    """An observer in every condition."""
    target = one.target(nobody(one.task))
    moved, x = differing.moved(target, one.point(target), one.name, seed)
    found, levels = moved.quantities(x), differing.conditions.levels
    told = [
        {name: float(found[name][i]) for name in moved.names.natural} for i in range(len(levels))
    ]
    named = zip(levels, told, strict=True)
    return [
        replace(one, name=f"{one.name}{AT}{level}", model=moved.model.name, quantities=values)
        for level, values in named
    ]


def judged_study(
    name: str, design: StudyDesign, planned: PlannedStudy, seed: int, prior: Prior
) -> Outcome:
    """What is said of one study's answers to a design; trials are those of a subject under both conditions together."""
    said = said_of(differences(design, planned, seed, prior))
    return Outcome(name, design.total, planned.kind, len(planned.people) // len(LEVELS), said)


def said_of(log_bf: Mapping[str, float | None]) -> dict[str, bool]:
    """Whether it is said of each quantity that it differs, and that it does not, of log Bayes factors, None where one is withheld."""
    said = {}
    for quantity, value in log_bf.items():
        for what, (surely, probably) in _SAID.items():
            said[f"{quantity}: {what}"] = word_of(value) == surely
            said[f"{quantity}: {what}, probably or not"] = word_of(value) in (surely, probably)
    return said


def differences(
    design: StudyDesign, planned: PlannedStudy, seed: int, prior: Prior
) -> dict[str, float | None]:
    """Log Bayes factors by quantity, of one subject or of several on average, who answer half of a design under either condition.

    Streams are keyed by observer and condition.
    """
    half = design.with_total(design.total // len(LEVELS))
    answers = [
        one.answers(half, generator(seed, one.name, "answers", design.total))
        for one in planned.people
    ]
    units = felt_together(
        replace(one, condition=level) for one, level in zip(answers, cycle(LEVELS), strict=False)
    )
    study, own = (
        Study(units, conditions=Differing.of(LEVELS).conditions),
        int(generator(seed, planned.name, "study").integers(2**32)),
    )
    if len(units) == len(LEVELS):
        return {
            _OF_CONTRAST.get(row.quantity, row.quantity): row.log_bf_differs
            for row in contrast(study, seed=own, prior=prior, workers=1)
        }
    with catch_warnings():
        simplefilter("ignore", ConvergenceWarning)
        found = population(study, draws=DRAWS, seed=own, prior=prior, workers=1)
    rows = found.table.some("condition_effect")
    return {
        _LABELS[row.parameter]: row.log_bf_differs for row in rows if row.log_bf_differs is not None
    }
