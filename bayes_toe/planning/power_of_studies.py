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
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING
from warnings import catch_warnings, simplefilter

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.random_effects import random_effects
from bayes_toe.data.study import Study
from bayes_toe.errors import ConvergenceWarning, InputError
from bayes_toe.groups.asymmetries import asymmetries
from bayes_toe.groups.population import Population, population
from bayes_toe.kept import keeping
from bayes_toe.model.ladder import PREDICTIVE_UPDATE
from bayes_toe.model.prior import Prior
from bayes_toe.planning.observers import CONSTANT_ERROR, MIXED, NONE, PLAIN, UPDATE, Observer, assumed, mixture, of_kind, shares_from
from bayes_toe.planning.power import WORDS, PowerTable, Simulations, jobs_of, mean, named_designs, share, worked
from bayes_toe.planning.study_design import StudyDesign, each_once
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers

if TYPE_CHECKING:
    import pandas as pd

SUBJECTS, STUDIES = (4, 8, 16), 20
#: Columns of power_subjects.csv and of power_population.csv.
STUDY_COLUMNS = ("design", "trials", "observers", "subjects", "studies", "named", "low", "high", "another_named")
POPULATION_COLUMNS = ("design", "trials", "observers", "subjects", "quantity", "value", "low", "high", "studies")
#: What is counted.
NAMED, WRONG = "named", "another named"
ON_AVERAGE, REVERSED, SOMEWHERE = "found on average", "found on average, reversed", "found in some pair"
#: Quantities of the group of which the expected width of the 90 % interval is told.
WIDTHS = ("mean of mu1", "mean of probit gamma", "pull at the means", "sd of mu1", "sd of probit gamma")
_WHAT = {kind: f"{words} as the most frequent kind" for kind, words in WORDS.items()}
_WHAT[MIXED] = "the most frequent kind of the mixed population"
_WHO = {
    NONE: "subjects without one",
    CONSTANT_ERROR: "subjects with a constant error",
    UPDATE: "subjects with a pull",
    MIXED: "the mixed population",
}
_DIRECTION, _BAND, _SURE = 0.975, 0.95, 0.95
_DRAWS = 200  # effective ones of everything: chains that agree have many more of most


# --- By random effects over evidences -------------------------------------------------------------


@dataclass(frozen=True)
class ComparedStudy:
    """One study of subjects of one kind, or mixed, by the random effects of `compare`: the most frequent kind, and which one is named."""

    design: str
    trials: int
    subjects: int
    kind: str
    right: str
    named: str | None


@dataclass(frozen=True, eq=False)
class StudyPower(Simulations[ComparedStudy]):
    """Simulated studies, and how often they name what is the most frequent kind, or another."""

    def _counts(self, kind: str, rows: Sequence[ComparedStudy]) -> Iterator[tuple[str, tuple[float, float, float], int]]:
        yield NAMED, share(sum(row.named == row.right for row in rows), len(rows)), len(rows)
        yield WRONG, share(sum(row.named not in (None, row.right) for row in rows), len(rows)), len(rows)

    def frame(self) -> pd.DataFrame:
        """One row a design, number of trials, kind of subjects and number of them, with the columns of power_subjects.csv."""
        import pandas as pd

        both = [(self.counted[*key, NAMED], self.counted[*key, WRONG].value) for key in self.groups]
        rows = [[one.design, one.trials, one.observers, one.subjects, one.size, one.value, one.low, one.high, p] for one, p in both]
        return pd.DataFrame(rows, columns=list(STUDY_COLUMNS))

    def sentences(self) -> list[str]:
        """What studies of a mixed population name, else of those who update or the last kind there is, a line a design and trials."""
        last = [kind for kind in (*PLAIN, MIXED) if kind in self.kinds][-1:]
        lines = []
        for design, trials, kind in dict.fromkeys(key[:3] for key in self.groups if key[2] in last):
            found = [one for key, one in self.counted.items() if (*key[:3], key[4]) == (design, trials, kind, NAMED)]
            said = ", ".join(f"{100 * one.value:.0f} % of studies with {one.subjects} subjects (of {one.size})" for one in found)
            lines.append(f"with {design} and {trials} trials each, {_WHAT[kind]} is named in {said}")
        return lines


def power_of_studies(table: PowerTable, subjects: Sequence[int] = SUBJECTS, shares: Mapping[str, float] | None = None) -> StudyPower:
    """Random effects over simulated subjects of one kind, as `compare` has them over real ones; with shares, also of a mixture of kinds.

    Data sets are taken together in order, each once, so that studies are independent; a kind is named where the probability that it is the
    most frequent in the population, protected against all being equally frequent, is above 0.95. There are no studies of more subjects
    than data sets, and none of a subject whose evidence is withheld.

    Examples
    --------
    >>> from bayes_toe.planning.judging import Judgement
    >>> from bayes_toe.planning.power import DataSet
    >>> rows = [DataSet("d", 650, f"u{i}", "update", Judgement((-5.0, -4.0, 0.0))) for i in range(8)]
    >>> found = power_of_studies(PowerTable(tuple(rows), 1))
    >>> [(row.subjects, row.size, row.value) for row in found.counted.values() if row.quantity == "named"]
    [(4, 2, 0.0), (8, 1, 1.0)]
    """
    sizes, found = [size for size in sorted(set(subjects)) if size > 1], []
    most = max((share, kind) for kind, share in shares.items())[1] if shares else ""
    for design, trials in dict.fromkeys(key[:2] for key in table.groups):
        groups = {key[2]: [row.judgement.log_evidence for row in rows] for key, rows in table.groups.items() if key[:2] == (design, trials)}
        known = {kind: [one for one in some if one is not None] for kind, some in groups.items()}
        for kind, some in known.items():
            for size in sizes:
                studies = (some[i : i + size] for i in range(0, len(some) - size + 1, size))
                found += [ComparedStudy(design, trials, size, kind, kind, _named(study)) for study in studies]
        for size in sizes if shares else ():
            for study in mixture(shares or {}, size, table.seed):
                if not all(i < len(known.get(kind, ())) for kind, i in study):
                    break
                found.append(ComparedStudy(design, trials, size, MIXED, most, _named([known[kind][i] for kind, i in study])))
    return StudyPower(tuple(found), table.seed)


def _named(log_evidence: Sequence[tuple[float, ...]]) -> str | None:
    found = random_effects(log_evidence).protected
    return list(PLAIN)[int(found.argmax())] if found.max() > _SURE else None


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


@dataclass(frozen=True, eq=False)
class PopulationPower(Simulations[AnalysedStudy]):
    """Simulated studies analysed as groups, and what is counted of them."""

    COLUMNS = POPULATION_COLUMNS

    def _counts(self, kind: str, rows: Sequence[AnalysedStudy]) -> Iterator[tuple[str, tuple[float, float, float], int]]:
        size = len(rows)
        yield ON_AVERAGE, share(sum(row.sign != 0 for row in rows), size), size
        if kind != NONE:  # there is a direction
            yield REVERSED, share(sum(row.sign * row.truth < 0.0 for row in rows), size), size
        yield SOMEWHERE, share(sum(row.somewhere for row in rows), size), size
        for name, values in zip(WIDTHS, zip(*(row.widths for row in rows), strict=True), strict=True):
            yield f"90 % width of {name}", mean(values), size
        yield "analysed with warnings", share(sum(row.warned for row in rows), size), size

    def sentences(self) -> list[str]:
        """How often the order effect of subjects is found in some pair, and how often one that is not there, a line a design."""
        main = next((kind for kind in (MIXED, UPDATE) if kind in self.kinds), self.kinds[-1])
        lines = []
        for design, trials in dict.fromkeys(key[:2] for key in self.groups):
            found = [one for one in self.counted.values() if (one.design, one.observers, one.quantity) == (design, main, SOMEWHERE)]
            said = ", ".join(f"{100 * one.value:.0f} % of studies with {one.subjects} subjects (of {one.size})" for one in found)
            line = f"with {design} and {trials} trials each, population shows an order effect of {_WHO[main]} in {said}"
            wrong = [row.somewhere for row in self.rows if row.design == design and row.kind == NONE != main]
            lines.append(line + (f", and wrongly of others in {sum(wrong)} of {len(wrong)}" if wrong else ""))
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
        rows, failed = worked(kept, jobs_of(analysed_study, designs.items(), planned, root, prior), workers, progress)
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
        found = population(Study(tuple(answers)), model=PREDICTIVE_UPDATE.name, draws=_DRAWS, seed=own, prior=prior, workers=1)
    pairs, direction, somewhere = comparisons(design), float("nan"), False
    known = asymmetries(found, pairs)
    if known is not None:
        draws = known.draws[:, :, 0].reshape(-1, len(known.comparisons))
        direction, somewhere = float((draws[:, 0] > 0.0).mean()), outside_band(draws[:, 1:])
    truth = float(np.mean([asymmetry_of(one, pairs) for one in planned.people]))
    widths, warned = _widths(found), bool(found.shortfalls)
    return AnalysedStudy(name, design.total, len(answers), planned.kind, direction, truth, somewhere, widths, warned)


def comparisons(design: StudyDesign) -> FloatArray:
    """Weaker and stronger stimulus, and interval where there are any, of all pairs of different stimuli: (comparisons, 2 or 3).

    Also of those that the design has in one order only: what would be answered in the other follows from the model.

    Examples
    --------
    >>> comparisons(StudyDesign([0.0, 0.3, 0.5], [0.3, 0.0, 0.5], [1, 1, 1])).tolist()
    [[0.0, 0.3]]
    """
    weak, strong = np.minimum(design.s1, design.s2), np.maximum(design.s1, design.s2)
    return np.unique(np.column_stack([weak, strong, *design.columns[2:]])[weak < strong], axis=0)


def asymmetry_of(observer: Observer, pairs: FloatArray) -> float:
    """How much likelier 'equal' is with the stronger stimulus first, on average over comparisons."""
    weak, strong, *isi = pairs.T
    first, second = (observer.equal(each_once(a, b, *isi)).mean() for a, b in ((strong, weak), (weak, strong)))
    return float(first - second)


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
