"""How often a whole study finds the order effect of its subjects: simulated ones taken together, a few at a time.

By random effects over their evidences, as `compare` has them, a study names the most frequent kind. By the analysis of the group, with the
model and the words of `population`, it finds an order effect on average, and names a pull, a constant error, or both.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING
from warnings import catch_warnings, simplefilter

from bayes_toe.comparison.population_answer import on_average
from bayes_toe.comparison.random_effects import random_effects
from bayes_toe.comparison.words import PROBABLY_HAS, PROBABLY_NONE
from bayes_toe.data.study import Study
from bayes_toe.errors import ConvergenceWarning, InputError
from bayes_toe.groups.population import population
from bayes_toe.model.ladder import ORDERS
from bayes_toe.model.prior import Prior
from bayes_toe.planning.observers import (
    MIXED,
    NONE,
    UPDATE,
    Observer,
    assumed,
    mixture,
    of_kind,
    shares_from,
)
from bayes_toe.planning.power import (
    FOUND,
    WIDTH,
    WORDS,
    Outcome,
    PowerTable,
    Simulations,
    named_designs,
    simulation,
)
from bayes_toe.planning.study_design import StudyDesign
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers

if TYPE_CHECKING:
    import pandas as pd

SUBJECTS, STUDIES = (4, 8, 16), 20
#: Columns of power_subjects.csv and of power_population.csv.
STUDY_COLUMNS = (
    "design",
    "trials",
    "observers",
    "subjects",
    "studies",
    "named",
    "low",
    "high",
    "another_named",
)
POPULATION_COLUMNS = (
    "design",
    "trials",
    "observers",
    "subjects",
    "quantity",
    "value",
    "low",
    "high",
    "studies",
)
#: What is counted of studies by their evidences, and of those analysed as groups beside an effect that is found.
NAMED, WRONG = "named", "another named"
PULL, ERROR, DENYING = "pull named", "constant error named", "none said"
#: Rows of the population's table of which the expected width of the 90 % interval is told.
WIDTHS = (("mean", "pull"), ("mean", "constant error"), ("sd", "pull"), ("sd", "constant error"))
_SURE = 0.95
DRAWS = 200  # effective ones of everything: chains that agree have many more of most


# --- By random effects over evidences -------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class StudyPower(Simulations[Outcome]):
    """Simulated studies of subjects of one kind, or mixed, and how often they name what is the most frequent kind, or another."""

    def frame(self) -> pd.DataFrame:
        """One row a design, number of trials, kind of subjects and number of them, with the columns of power_subjects.csv."""
        import pandas as pd

        both = [
            (one, self.counted[*one[:4], WRONG].value)
            for one in self.counted.values()
            if one.quantity == NAMED
        ]
        rows = [
            [
                one.design,
                one.trials,
                one.observers,
                one.subjects,
                one.size,
                one.value,
                one.low,
                one.high,
                p,
            ]
            for one, p in both
        ]
        return pd.DataFrame(rows, columns=list(STUDY_COLUMNS))

    def sentences(self) -> list[str]:
        """What studies of a mixed population name, else of those who update or the last kind there is, a line a design and trials."""
        last = [kind for kind in (*ORDERS, MIXED) if kind in self.different("observers")][-1:]
        lines = []
        for design, trials, kind in (
            key for key in self.different("design", "trials", "observers") if key[2] in last
        ):
            what = (
                f"{WORDS[kind]} as the most frequent kind"
                if kind in WORDS
                else "the most frequent kind of the mixed population"
            )
            said = ", ".join(
                one.of_studies
                for key, one in self.counted.items()
                if (*key[:3], key[4]) == (design, trials, kind, NAMED)
            )
            lines.append(f"with {design} and {trials} trials each, {what} is named in {said}")
        return lines


def power_of_studies(
    table: PowerTable, subjects: Sequence[int] = SUBJECTS, shares: Mapping[str, float] | None = None
) -> StudyPower:
    """Random effects over simulated subjects of one kind, as `compare` has them over real ones; with shares, also of a mixture of kinds.

    Data sets are taken together in order, each once, so that studies are independent; a kind is named where the probability that it is the
    most frequent in the population, protected against all being equally frequent, is above 0.95. There are no studies of more subjects
    than data sets, and none of a subject whose evidence is withheld.
    """
    sizes, found = [size for size in sorted(set(subjects)) if size > 1], []
    most = max((share, kind) for kind, share in shares.items())[1] if shares else ""
    known: dict[tuple[str, int], dict[str, list[tuple[float, ...]]]] = {}
    for row in table:
        of_kind = known.setdefault((row.design, row.trials), {}).setdefault(row.kind, [])
        of_kind += [] if row.judgement.log_evidence is None else [row.judgement.log_evidence]
    for design, kinds in known.items():
        for kind, some in kinds.items():
            for size in sizes:
                studies = (some[i : i + size] for i in range(0, len(some) - size + 1, size))
                found += [Outcome(*design, kind, size, _naming(study, kind)) for study in studies]
        for size in sizes if shares else ():
            for study in mixture(shares or {}, size, table.seed):
                if not all(i < len(kinds.get(kind, ())) for kind, i in study):
                    break
                found.append(
                    Outcome(
                        *design, MIXED, size, _naming([kinds[kind][i] for kind, i in study], most)
                    )
                )
    return StudyPower(tuple(found), table.seed)


def _naming(log_evidence: Sequence[tuple[float, ...]], right: str) -> dict[str, bool]:
    """Whether random effects over evidences name the right kind, and whether another."""
    found = random_effects(log_evidence).protected
    named = ORDERS[int(found.argmax())] if found.max() > _SURE else None
    return {NAMED: named == right, WRONG: named not in (None, right)}


# --- By the analysis of the group -----------------------------------------------------------------


@dataclass(frozen=True)
class PlannedStudy:
    """Observers who are the subjects of one study; its random streams are keyed by the name."""

    name: str
    kind: str
    people: tuple[Observer, ...]


@dataclass(frozen=True, eq=False)
class PopulationPower(Simulations[Outcome]):
    """Simulated studies analysed as groups, and what is counted of them."""

    COLUMNS = POPULATION_COLUMNS

    def sentences(self) -> list[str]:
        """How often an order effect of subjects is found on average, and how often one that is not there, a line a design."""
        kinds = self.different("observers")
        main = next((kind for kind in (MIXED, UPDATE) if kind in kinds), kinds[-1])
        whom = (
            f"subjects with {WORDS[main].replace('no order effect', 'none')}"
            if main in WORDS
            else "the mixed population"
        )
        lines = []
        for design, trials in self.different("design", "trials"):
            every = [
                one
                for one in self.counted.values()
                if (one.design, one.quantity) == (design, FOUND)
            ]
            said = ", ".join(one.of_studies for one in every if one.observers == main)
            wrong = [one for one in every if one.observers == NONE != main]
            more = f", and wrongly of others in {sum(one.value * one.size for one in wrong):.0f} of {sum(one.size for one in wrong)}"
            line = f"with {design} and {trials} trials each, population finds an order effect of {whom} in {said}"
            lines.append(line + more * bool(wrong))
        return lines


def power_of_populations(
    design: StudyDesign | Mapping[str, StudyDesign] | None = None,
    subjects: Sequence[int] = SUBJECTS,
    observers: str | Path | Sequence[Observer] | None = None,
    *,
    studies: int = STUDIES,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    keep: str | Path | None = None,
) -> PopulationPower:
    """How often :func:`~bayes_toe.groups.population.population` finds an order effect of simulated subjects on average, and how narrowly.

    A study takes about a second a subject.

    Parameters
    ----------
    design, observers, seed, prior, workers, progress, keep
        As :func:`bayes_toe.planning.power.power` takes them; every subject has the design's trials.
    subjects : sequence of int
        Of a study, at least 2. The subjects of a smaller study are also in a larger one, and in those of other designs.
    studies : int
        Of each design, kind of observers and number of subjects.

    Raises
    ------
    InputError
        If something is not allowed.
    """
    sizes = sorted({size for size in subjects if size > 1})
    if studies < 1 or not sizes:
        raise InputError(
            f"studies={studies}, subjects={list(subjects)}: allowed is at least 1 study of at least 2 subjects"
        )
    designs = named_designs(design)
    shares = (
        shares_from(observers, next(iter(designs.values())).task)
        if observers is None or isinstance(observers, str | Path)
        else {}
    )

    def planned(root: int) -> list[PlannedStudy]:
        return [
            *planned_studies(
                assumed(observers, designs, studies * sizes[-1], root, prior), sizes, shares, root
            )
        ]

    found = simulation(
        analysed_study, "studies", designs.items(), planned, seed, prior, workers, progress, keep
    )
    return PopulationPower(*found)


def planned_studies(
    people: Sequence[Observer], sizes: Sequence[int], shares: Mapping[str, float], seed: int
) -> Iterator[PlannedStudy]:
    """Studies of observers of one kind, taken together in order, or of a mixture; smaller ones have the first subjects of the largest."""
    groups = {kind: of_kind(people, kind) for kind in dict.fromkeys(one.kind for one in people)}
    most = min(len(some) for some in groups.values()) // sizes[-1]
    largest = {
        kind: [some[i * sizes[-1] : (i + 1) * sizes[-1]] for i in range(len(some) // sizes[-1])]
        for kind, some in groups.items()
    }
    if shares:
        drawn = islice(mixture(shares, sizes[-1], seed), most)
        largest[MIXED] = [[groups[kind][number] for kind, number in study] for study in drawn]
    for kind, studies in largest.items():
        for size in sizes:
            for number, study in enumerate(studies, 1):
                yield PlannedStudy(f"study {number} of {size}, {kind}", kind, tuple(study[:size]))


def analysed_study(
    name: str, design: StudyDesign, planned: PlannedStudy, seed: int, prior: Prior
) -> Outcome:
    """One study's answers to a design, analysed as a group; a subject's answers are those that it gives in :func:`power`."""
    answers = [
        one.answers(design, generator(seed, one.name, "answers", design.total))
        for one in planned.people
    ]
    own = int(generator(seed, planned.name, "population").integers(2**32))
    with catch_warnings():
        simplefilter("ignore", ConvergenceWarning)  # counted
        found = population(Study(tuple(answers)), draws=DRAWS, seed=own, prior=prior, workers=1)
    average, rows = on_average(found), [row for of in WIDTHS for row in found.table.some(*of)]
    assert average is not None  # free weighting has means that may be none
    said = said_on_average(
        average.p_none, average.named, [row.q95 - row.q05 for row in rows], bool(found.shortfalls)
    )
    return Outcome(name, design.total, planned.kind, len(answers), said)


def said_on_average(
    p_none: float, named: Collection[str], widths: Sequence[float], warned: bool
) -> dict[str, float]:
    """What is counted of :class:`~bayes_toe.comparison.population_answer.OnAverage`, and of 90 % intervals of :data:`WIDTHS`."""
    return {
        FOUND: p_none <= PROBABLY_HAS,
        PULL: "pull" in named,
        ERROR: "constant error" in named,
        DENYING: p_none >= PROBABLY_NONE,
        **{
            f"{WIDTH}{quantity} of {parameter}": width
            for (quantity, parameter), width in zip(WIDTHS, widths, strict=True)
        },
        "analysed with warnings": warned,
    }
