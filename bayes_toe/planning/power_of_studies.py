"""How often a whole study finds the order effect of its subjects: simulated ones taken together, a few at a time.

By random effects over their evidences, as `compare` has them, a study names the most frequent kind. By the analysis of the group, as
`population` has it, an order effect is *found* in two ways, each of them wrong in some 5 % of studies without any, where priors say
nothing:

* on average: the probability of direction of the population's asymmetry, averaged over all pairs, is above 0.975;
* in some pair: 0 lies outside the simultaneous 95 % band of the asymmetries of all pairs, so that many pairs are no more chances.

A pull toward the middle of a wide range cancels on average; in single pairs it does not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice, product
from pathlib import Path
from typing import TYPE_CHECKING
from warnings import catch_warnings, simplefilter

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.random_effects import random_effects
from bayes_toe.data.study import Study
from bayes_toe.data.tables import Table, frame_of
from bayes_toe.errors import ConvergenceWarning, InputError
from bayes_toe.groups.asymmetries import asymmetries
from bayes_toe.groups.population import Population, population
from bayes_toe.kept import keeping
from bayes_toe.model.prior import Prior
from bayes_toe.planning.observers import CONSTANT_ERROR, MIXED, NONE, PLAIN, UPDATE, Observer, assumed, mixture, of_kind, shares_from
from bayes_toe.planning.power import CERTAIN, WORDS, PowerTable, each_observer, mean, named_designs, share
from bayes_toe.planning.study_design import StudyDesign
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers

if TYPE_CHECKING:
    import pandas as pd

#: Columns of power_subjects.csv.
STUDY_COLUMNS = ("design", "trials", "observers", "subjects", "studies", "named", "low", "high", "another_named")
SUBJECTS = (4, 8, 16)
_WHAT = {kind: f"{words} as the most frequent kind" for kind, words in WORDS.items()}
_WHAT[MIXED] = "the most frequent kind of the mixed population"
#: Columns of power_population.csv.
POPULATION_COLUMNS = ("design", "trials", "observers", "subjects", "quantity", "value", "low", "high", "studies")
STUDIES = 20
#: What is counted, and quantities of which the expected width of the 90 % interval is told.
ON_AVERAGE, REVERSED, SOMEWHERE = "found on average", "found on average, reversed", "found in some pair"
WIDTHS = ("mean of mu1", "mean of probit gamma", "pull at the means", "sd of mu1", "sd of probit gamma")
_WHO = {
    NONE: "subjects without one",
    CONSTANT_ERROR: "subjects with a constant error",
    UPDATE: "subjects who update",
    MIXED: "the mixed population",
}
_DIRECTION, _BAND = 0.975, 0.95
_DRAWS = 200  # effective ones of everything: chains that agree have many more of most


@dataclass(frozen=True)
class StudyShare:
    """How often studies with so many subjects of one kind name it, with a 95 % interval, and how often another.

    Of a mixed population it is the kind that is the most frequent in it.
    """

    design: str
    trials: int
    observers: str
    subjects: int
    studies: int
    named: float
    low: float
    high: float
    another_named: float


@dataclass(frozen=True, eq=False)
class StudyPower(Table[StudyShare]):
    """One row a design, number of trials, kind of subjects and number of them."""

    def frame(self) -> pd.DataFrame:
        """The table with the columns of power_subjects.csv."""
        return frame_of(self.rows, STUDY_COLUMNS)

    def sentences(self) -> list[str]:
        """What studies of subjects who update name, or of the last kind there is, a line a design and number of trials."""
        groups: dict[tuple[str, int, str], list[StudyShare]] = {}
        for row in self.rows:
            groups.setdefault((row.design, row.trials, row.observers), []).append(row)
        last = [kind for kind in (*PLAIN, MIXED) if any(key[2] == kind for key in groups)][-1:]
        lines = []
        for (design, trials, kind), rows in groups.items():
            said = ", ".join(f"{100 * row.named:.0f} % of studies with {row.subjects} subjects (of {row.studies})" for row in rows)
            lines += [f"with {design} and {trials} trials each, {_WHAT[kind]} is named in {said}"] if kind in last else []
        return lines


def power_of_studies(table: PowerTable, subjects: Sequence[int] = SUBJECTS, shares: Mapping[str, float] | None = None) -> StudyPower:
    """Random effects over simulated subjects of one kind, as `compare` has them over real ones; with shares, also of a mixture of kinds.

    Data sets are taken together in order, each once, so that studies are independent; a kind is named where the probability that it is the
    most frequent in the population, protected against all being equally frequent, is above 0.95. There are no rows of more subjects than
    data sets, and of a study one of whose evidences is withheld.

    Examples
    --------
    >>> from bayes_toe.planning.power import DataSet
    >>> rows = [DataSet("d", 650, f"u{i}", "update", (-5.0, -4.0, 0.0), (0.0, 0.1, 0.9), None) for i in range(8)]
    >>> [(row.subjects, row.studies, row.named) for row in power_of_studies(PowerTable(tuple(rows), ("d",), 1))]
    [(4, 2, 0.0), (8, 1, 1.0)]
    """
    known = {key: np.array([row.log_evidence for row in rows if row.log_evidence is not None]) for key, rows in table.groups.items()}
    sizes = [size for size in sorted(set(subjects)) if size > 1]
    studies = [
        (key, key[2], [values[i : i + size] for i in range(0, len(values) - size + 1, size)])
        for key, values in known.items()
        for size in sizes
    ]
    if shares:
        most = max(shares, key=shares.__getitem__)
        for (design, trials), size in product(dict.fromkeys(key[:2] for key in known), sizes):
            of_kind = {kind: known.get((design, trials, kind), np.empty(0)) for kind in shares}
            mixed = []
            for study in mixture(shares, size, table.seed):
                if not all(number < len(of_kind[kind]) for kind, number in study):
                    break
                mixed.append(np.array([of_kind[kind][number] for kind, number in study]))
            studies.append(((design, trials, MIXED), most, mixed))
    found = []
    for key, kind, some in studies:
        named = [_named(evidence) for evidence in some]
        if named:
            wrong = sum(one not in (None, kind) for one in named) / len(named)
            found.append(StudyShare(*key, len(some[0]), len(some), *share(named.count(kind), len(named)), wrong))
    return StudyPower(tuple(found))


def _named(evidence: FloatArray) -> str | None:
    found = random_effects(evidence).protected
    return list(PLAIN)[int(found.argmax())] if found.max() > CERTAIN else None


# --- By the analysis of the group -----------------------------------------------------------------


@dataclass(frozen=True)
class PlannedStudy:
    """Observers who are the subjects of one study; its random streams are keyed by the name."""

    name: str
    kind: str
    people: tuple[Observer, ...]


@dataclass(frozen=True)
class AnalysedStudy:
    """What the analysis of one simulated study said; `trials` are those of each subject, `kind` is that of all subjects, or "mixed".

    `direction` is the probability that the mean asymmetry is positive, NaN where the design has no pair of different stimuli, `truth` the
    subjects' own mean asymmetry, `somewhere` whether an order effect is found in some pair, `widths` are those of the 90 % intervals of
    :data:`WIDTHS`, `warned` whether something was not reached.
    """

    design: str
    trials: int
    subjects: int
    kind: str
    direction: float
    truth: float
    somewhere: bool
    widths: tuple[float, ...]
    warned: bool

    @property
    def sign(self) -> int:
        """Of the mean asymmetry, where it is found; else 0."""
        return int(self.direction > _DIRECTION) - int(self.direction < 1.0 - _DIRECTION)


@dataclass(frozen=True)
class CountedStudies:
    """One row of power_population.csv: a share or a mean over studies, with its 95 % interval of Monte Carlo error."""

    design: str
    trials: int
    observers: str
    subjects: int
    quantity: str
    value: float
    low: float
    high: float
    studies: int


@dataclass(frozen=True, eq=False)
class PopulationPower(Table[AnalysedStudy]):
    """Simulated studies and what is counted of them.

    Attributes
    ----------
    rows : tuple of AnalysedStudy
    seed : int
    failed : mapping of str to str
        Studies whose work was lost, with the reason.
    """

    seed: int
    failed: Mapping[str, str]

    @cached_property
    def counted(self) -> dict[tuple[str, str, int, str], CountedStudies]:
        """Every share and mean, by design, kind of observers, number of subjects and quantity."""
        groups: dict[tuple[str, str, int], list[AnalysedStudy]] = {}
        for row in self.rows:
            groups.setdefault((row.design, row.kind, row.subjects), []).append(row)
        return {(*key, one.quantity): one for key, rows in groups.items() for one in _counted(rows)}

    @property
    def trials(self) -> int:
        """Of each subject."""
        return self.rows[0].trials

    @property
    def designs(self) -> tuple[str, ...]:
        """Names of designs."""
        return tuple(dict.fromkeys(row.design for row in self.rows))

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of observers."""
        return tuple(dict.fromkeys(row.kind for row in self.rows))

    @property
    def subjects(self) -> tuple[int, ...]:
        """Numbers of subjects."""
        return tuple(dict.fromkeys(row.subjects for row in self.rows))

    def frame(self) -> pd.DataFrame:
        """The table with the columns of power_population.csv."""
        return frame_of(self.counted.values(), POPULATION_COLUMNS)

    def sentences(self) -> list[str]:
        """How often the order effect of subjects is found in some pair, and how often one that is not there, a line a design."""
        main = next((kind for kind in (MIXED, UPDATE) if kind in self.kinds), self.kinds[-1])
        lines = []
        for design in self.designs:
            rows = [one for one in self.counted.values() if one.design == design and one.quantity == SOMEWHERE]
            found = [one for one in rows if one.observers == main]
            said = ", ".join(f"{100 * one.value:.0f} % of studies with {one.subjects} subjects (of {one.studies})" for one in found)
            line = f"with {design} and {found[0].trials} trials each, population shows an order effect of {_WHO[main]} in {said}"
            wrong = [one for one in rows if one.observers == NONE != main]
            hits, size = round(sum(one.value * one.studies for one in wrong)), sum(one.studies for one in wrong)
            lines.append(line + (f", and wrongly of others in {hits} of {size}" if wrong else ""))
        return lines


def _counted(rows: Sequence[AnalysedStudy]) -> Iterator[CountedStudies]:
    one, size = rows[0], len(rows)

    def made(quantity: str, found: tuple[float, float, float]) -> CountedStudies:
        return CountedStudies(one.design, one.trials, one.kind, one.subjects, quantity, *found, size)

    yield made(ON_AVERAGE, share(sum(row.sign != 0 for row in rows), size))
    if one.kind != NONE:  # there is a direction
        yield made(REVERSED, share(sum(row.sign * row.truth < 0.0 for row in rows), size))
    yield made(SOMEWHERE, share(sum(row.somewhere for row in rows), size))
    for name, values in zip(WIDTHS, zip(*(row.widths for row in rows), strict=True), strict=True):
        yield made(f"90 % width of {name}", mean(values))
    yield made("analysed with warnings", share(sum(row.warned for row in rows), size))


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
    """How often :func:`~bayes_toe.groups.population.population` finds the order effect of simulated subjects, and how narrow it gets.

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
        raise InputError(f"studies={studies}, subjects={list(subjects)}: allowed is at least 1 study of at least 2 subjects")
    designs = named_designs(design)
    with keeping(keep, "simulated studies") as kept:
        root = kept.seed(seed)
        people = assumed(observers, designs, studies * sizes[-1], root, prior)
        shares = shares_from(observers) if observers is None or isinstance(observers, str | Path) else {}
        planned = list(planned_studies(people, sizes, shares, root))
        rows, failed = each_observer(kept, analysed_study, designs.items(), planned, root, prior, workers, progress)
    return PopulationPower(rows, root, failed)


def planned_studies(people: Sequence[Observer], sizes: Sequence[int], shares: Mapping[str, float], seed: int) -> Iterator[PlannedStudy]:
    """Studies of observers of one kind, taken together in order, or of a mixture; smaller ones have the first subjects of the largest."""
    groups = {kind: of_kind(people, kind) for kind in dict.fromkeys(one.kind for one in people)}
    most = min(len(some) for some in groups.values()) // sizes[-1]
    largest = {kind: [some[i * sizes[-1] : (i + 1) * sizes[-1]] for i in range(len(some) // sizes[-1])] for kind, some in groups.items()}
    if shares:
        drawn = islice(mixture(shares, sizes[-1], seed), most)
        largest[MIXED] = [[groups[kind][number] for kind, number in study] for study in drawn]
    for kind, studies in largest.items():
        for size in sizes:
            for number, study in enumerate(studies, 1):
                yield PlannedStudy(f"study {number} of {size}, {kind}", kind, tuple(study[:size]))


def analysed_study(name: str, design: StudyDesign, planned: PlannedStudy, seed: int, prior: Prior) -> AnalysedStudy:
    """One study's answers to a design, analysed as a group; a subject's answers are those that it gives in :func:`power`."""
    answers = [one.answers(design, generator(seed, one.name, "answers", design.total)) for one in planned.people]
    own = int(generator(seed, planned.name, "population").integers(2**32))
    with catch_warnings():
        simplefilter("ignore", ConvergenceWarning)  # counted
        found = population(Study(tuple(answers)), draws=_DRAWS, seed=own, prior=prior, workers=1)
    pairs = comparisons(design)
    truth = np.mean([asymmetry_of(one, pairs) for one in planned.people])
    direction, somewhere = _order_effect(found, pairs)
    return AnalysedStudy(
        name, design.total, len(answers), planned.kind, direction, float(truth), somewhere, _widths(found), bool(found.shortfalls)
    )


def comparisons(design: StudyDesign) -> FloatArray:
    """Weaker and stronger stimulus, and interval where there are any, of all pairs of different stimuli: (comparisons, 2 or 3).

    Also of those that the design has in one order only: what would be answered in the other follows from the model.

    Examples
    --------
    >>> comparisons(StudyDesign([0.0, 0.3, 0.5], [0.3, 0.0, 0.5], [1, 1, 1])).tolist()
    [[0.0, 0.3]]
    """
    weak, strong = np.minimum(design.s1, design.s2), np.maximum(design.s1, design.s2)
    return np.unique(np.column_stack([weak, strong, *design.pairs.columns[2:]])[weak < strong], axis=0)


def asymmetry_of(observer: Observer, pairs: FloatArray) -> float:
    """How much likelier 'equal' is with the stronger stimulus first, on average over comparisons."""
    (weak, strong, *isi), once = pairs.T, np.ones(len(pairs), np.int64)
    first, second = (observer.equal(StudyDesign(a, b, once, *isi)).mean() for a, b in ((strong, weak), (weak, strong)))
    return float(first - second)


def _order_effect(found: Population, pairs: FloatArray) -> tuple[float, bool]:
    """P(mean asymmetry > 0), and whether an order effect is found in some pair."""
    known = asymmetries(found, pairs)
    if known is None:
        return float("nan"), False
    draws = known.draws[:, :, 0].reshape(-1, len(known.comparisons))
    return float((draws[:, 0] > 0.0).mean()), outside_band(draws[:, 1:])


def outside_band(draws: FloatArray) -> bool:
    """Whether 0 lies outside the simultaneous 95 % band, in units of each one's sd about its mean, of some column of (draws, columns).

    Examples
    --------
    >>> z = np.random.default_rng(1).standard_normal((2000, 20))
    >>> outside_band(z + 2.5), outside_band(z + 3.5)
    (False, True)
    """
    middle, sd = draws.mean(axis=0), draws.std(axis=0)
    band = np.quantile(np.abs((draws - middle) / sd).max(axis=1), _BAND)
    return bool((np.abs(middle) > band * sd).any())


def _widths(found: Population) -> tuple[float, ...]:
    own, (mu1, gamma) = found.chains, (found.names.index(name) for name in ("mu1", "gamma"))
    values = (own.mean[..., mu1], own.mean[..., gamma], found.quantities(own.mean)["pull"], own.scatter[..., mu1], own.scatter[..., gamma])
    return tuple(float(np.subtract(*np.quantile(one, (0.95, 0.05)))) for one in values)
