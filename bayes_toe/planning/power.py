"""What a design will tell: assumed observers answer it, and every data set is judged as the program judges a study's.

Counted are the words of the verdict: how often an effect that is there is found, its kind named, and how often one is said that is not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeAlias, TypeVar

import numpy as np
from scipy.special import betaincinv, ndtri

from bayes_toe.comparison.words import EFFECTS
from bayes_toe.data.messages import listed
from bayes_toe.data.tables import Table, frame_of
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.errors import InputError
from bayes_toe.inference.subject import Wanted, fitted_result
from bayes_toe.kept import keeping
from bayes_toe.model.ladder import ORDERS, models_of
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.planning.judging import Judgement, judged
from bayes_toe.planning.observers import CONSTANT_ERROR, NONE, UPDATE, Observer, assumed, prior_of
from bayes_toe.planning.study_design import StudyDesign, paper_study_design
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers

if TYPE_CHECKING:
    import pandas as pd

#: Quantities of the update of which the expected width of the 90 % interval is told, and what the width is called.
WIDTHS, WIDTH = ("gain", "mu1", "width"), "90 % width of "
#: Columns of power.csv and of power_data_sets.csv.
POWER_COLUMNS = ("design", "trials", "observers", "quantity", "value", "low", "high", "data_sets")
_EACH = ("none", "constant_error", "update")
DATA_SET_COLUMNS = (
    *("design", "trials", "observer", "kind", "effect", "kind_named"),
    *(f"log_evidence_{one}" for one in _EACH),
    *(f"p_{one}" for one in _EACH),
    *(f"{name}_90" for name in WIDTHS),
)
#: What is counted: whether an order effect is said, the observer's kind, or another; 'probably' counts, and negligible effects are none.
FOUND, NAMED, WRONG = "effect found", "kind named", "another kind named"
#: Kinds in a sentence.
WORDS = {NONE: "no order effect", CONSTANT_ERROR: "a constant error", UPDATE: "a pull"}
_LEVEL = 0.95  # of the intervals of Monte Carlo error
#: Value with both ends of its interval, and over how many it is.
Estimate: TypeAlias = tuple[float, float, float, int]
#: By quantity whether something is said, its probability, or a width; None where it is withheld.
Said: TypeAlias = Mapping[str, float | None]
Row = TypeVar("Row", bound=Any)
TRIALS, DATA_SETS = (325, 650, 1300), 100


# --- What is counted ------------------------------------------------------------------------------


class Counted(NamedTuple):
    """A share or a mean over so many (`size`) simulated data sets, or studies of so many subjects, with its 95 % interval."""

    design: str
    trials: int
    observers: str
    subjects: int
    quantity: str
    value: float
    low: float
    high: float
    size: int

    @property
    def percent(self) -> str:
        """A share in words."""
        return f"{100 * self.value:.0f} %"

    @property
    def interval(self) -> str:
        """That of a share in words."""
        return f"({100 * self.low:.0f} to {100 * self.high:.0f} %)"

    @property
    def hits(self) -> str:
        """Of how many it is so."""
        return f"{self.value * self.size:.0f} of {self.size}"

    @property
    def of_studies(self) -> str:
        """A share of studies in words."""
        return f"{self.percent} of studies with {self.subjects} subjects (of {self.size})"


class Outcome(NamedTuple):
    """What was said of one simulated study of so many subjects of a kind, or of one subject; `trials` are those of a subject."""

    design: str
    trials: int
    kind: str
    subjects: int
    said: Said


@dataclass(frozen=True, eq=False)
class Simulations(Table[Row]):
    """What was simulated, a row each, and what is counted of it by design, trials, kind of observers and number of subjects.

    Rows are outcomes, or have what these have; `failed` has the names of observers, or studies, whose work was lost, with the reason.
    """

    seed: int
    failed: Mapping[str, str] = field(default_factory=dict)
    COLUMNS: ClassVar[tuple[str, ...]] = ()  # of the file, the last being the size

    @cached_property
    def counted(self) -> dict[tuple[str, int, str, int, str], Counted]:
        """Every share, and mean of widths, by its group and quantity, of what is not withheld."""
        values: dict[tuple[str, int, str, int, str], list[float]] = {}
        for row in self.rows:
            for quantity, value in row.said.items():
                values.setdefault(
                    (row.design, row.trials, row.kind, row.subjects, quantity), []
                ).extend([] if value is None else [value])
        return {
            key: Counted(*key, *(mean if key[-1].startswith(WIDTH) else share_of)(some))
            for key, some in values.items()
            if some
        }

    def different(self, *names: str) -> tuple[Any, ...]:
        """What there is of a field of :class:`Counted`, in its order, such as designs or kinds of observers; or of several."""
        return tuple(dict.fromkeys(attrgetter(*names)(one) for one in self.counted.values()))

    def frame(self) -> pd.DataFrame:
        """The table with the columns of its file: a share or a mean a row, with both ends of the 95 % interval of its Monte Carlo error."""
        return frame_of(self.counted.values(), (*self.COLUMNS[:-1], "size")).set_axis(
            list(self.COLUMNS), axis=1
        )


def share_of(values: Sequence[float]) -> Estimate:
    """The share of what is so and its 95 % interval, by Jeffreys' prior; an end is 0 or 1 where nothing or all is.

    Of probabilities the interval is too wide, if anything: they scatter no more than hits do.

    Examples
    --------
    >>> [round(value, 3) for value in share_of([True] * 7 + [False] * 13)]
    [0.35, 0.172, 0.568, 20]
    """
    hits, size, tail = sum(values), len(values), 0.5 * (1.0 - _LEVEL)
    low = 0.0 if hits == 0 else float(betaincinv(hits + 0.5, size - hits + 0.5, tail))
    high = 1.0 if hits == size else float(betaincinv(hits + 0.5, size - hits + 0.5, 1.0 - tail))
    return hits / size, low, high, size


def mean(values: Sequence[float]) -> Estimate:
    """A mean and its 95 % interval, whose ends are NaN where there is one value only."""
    middle = float(np.mean(values))
    error = (
        float(np.std(values, ddof=1) / np.sqrt(len(values)) * ndtri(0.5 * (1 + _LEVEL)))
        if len(values) > 1
        else float("nan")
    )
    return middle, middle - error, middle + error, len(values)


@dataclass(frozen=True)
class DataSet:
    """One simulated observer's answers, how many, and how they are judged."""

    design: str
    trials: int
    observer: str
    kind: str
    judgement: Judgement
    subjects: ClassVar[int] = 1

    @property
    def said(self) -> Said:
        """What is counted of it."""
        found, none = self.judgement, (None,) * 3
        return {
            **{f"P({kind})": p for kind, p in zip(ORDERS, found.probability or none, strict=True)},
            **{f"said: {word}": found.verdict.effect == word for word in EFFECTS if word},
            FOUND: found.found,
            NAMED: found.named == self.kind,
            WRONG: found.named not in (None, self.kind),
            **{
                f"{WIDTH}{name}": width
                for name, width in zip(WIDTHS, found.widths or none, strict=True)
            },
            "evidence withheld": found.probability is None,
        }


def data_sets_frame(rows: Iterable[DataSet]) -> pd.DataFrame:
    """A row a data set; what is withheld is missing."""
    import pandas as pd

    cells = []
    for row in rows:
        said = row.judgement
        numbers = [
            value
            for some in (said.log_evidence, said.probability, said.widths)
            for value in some or (None,) * 3
        ]
        cells.append(
            (
                row.design,
                row.trials,
                row.observer,
                row.kind,
                said.verdict.effect,
                said.verdict.kind,
                *numbers,
            )
        )
    return pd.DataFrame(cells, columns=list(DATA_SET_COLUMNS))


@dataclass(frozen=True, eq=False)
class PowerTable(Simulations[DataSet]):
    """Simulated data sets of one or several designs, and what is counted of them."""

    COLUMNS = POWER_COLUMNS

    def __getitem__(self, key: tuple[str, int, str, str]) -> Counted:
        """What is counted, by (design, trials, kind of observers, quantity)."""
        found = self.counted.get((*key[:3], 1, key[3]))
        if found is None:
            raise InputError(
                f"nothing counted for {key!r}; quantities: {listed([repr(name) for name in self.different('quantity')], 20)}"
            )
        return found

    def data_sets_frame(self) -> pd.DataFrame:
        """Every simulated data set, with the columns of power_data_sets.csv."""
        return data_sets_frame(self.rows)

    def sentences(self) -> list[str]:
        """What the simulation says, a line a design and number of trials."""
        lines = []
        for design, trials in self.different("design", "trials"):
            kinds = [
                kind
                for kind in self.different("observers")
                if (design, trials, kind, 1, FOUND) in self.counted
            ]
            main = UPDATE if UPDATE in kinds else kinds[-1]
            found, right = (self[design, trials, main, what] for what in (FOUND, NAMED))
            wrong = (
                f"; and wrongly one in {self[design, trials, NONE, FOUND].hits} without"
                if NONE in kinds and main != NONE
                else ""
            )
            lines.append(
                f"with {design} {trials} trials find an order effect in {found.percent} of observers with "
                f"{WORDS[main].replace('no order effect', 'none')} {found.interval}, and name {WORDS[main]} in {right.percent}{wrong}"
            )
        return lines


# --- Simulation -----------------------------------------------------------------------------------


def power(
    design: StudyDesign | Mapping[str, StudyDesign] | None = None,
    trials: Sequence[int] = TRIALS,
    observers: str | Path | Sequence[Observer] | None = None,
    *,
    data_sets: int = DATA_SETS,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    keep: str | Path | None = None,
) -> PowerTable:
    """How often a design finds the order effect of assumed observers, names its kind, is wrong, and how narrow posteriors become.

    Parameters
    ----------
    design : StudyDesign or mapping of str to StudyDesign, optional
        Or several by name; by default the paper's 13 pairs.
    trials : sequence of int
        Numbers of trials of one subject, shared among the pairs as the design shares its own.
    observers : str, path or sequence of Observer, optional
        As :func:`bayes_toe.planning.observers.observers_from` takes it, or observers themselves. What is not stated is
        assumed in relation to the stimuli of all designs together.
    data_sets : int
        Observers of each kind, each with one simulated data set a design and number of trials.
    seed, prior, workers, progress, keep
        As in :func:`bayes_toe.analysis.evidence`; the prior is that of the analysis, and that which observers 'prior' are drawn from.

    Raises
    ------
    InputError
        If there are fewer trials than pairs, something is not allowed, or observers would practically always answer alike.

    Examples
    --------
    >>> table = power(trials=[130], data_sets=1, seed=1, workers=1)
    >>> len(table.rows), table["the paper's pairs", 130, "update", "kind named"].size
    (3, 1)
    """
    designs = named_designs(design)
    people = partial(assumed, observers, designs, data_sets, prior=prior)
    return PowerTable(
        *simulation(
            simulated,
            "data sets",
            with_totals(designs, trials),
            people,
            seed,
            prior,
            workers,
            progress,
            keep,
        )
    )


def named_designs(
    design: StudyDesign | Mapping[str, StudyDesign] | None, task: Task | str = SAME_DIFFERENT
) -> Mapping[str, StudyDesign]:
    """Designs by name; the paper's for a task where there is none."""
    if design is None:
        return {"the paper's pairs": paper_study_design(task=task)}
    return {"these pairs": design} if isinstance(design, StudyDesign) else design


def with_totals(
    designs: Mapping[str, StudyDesign], trials: Iterable[int]
) -> list[tuple[str, StudyDesign]]:
    """Each design, by its name, with each of these numbers of trials."""
    return [
        (name, one.with_total(number))
        for name, one in designs.items()
        for number in dict.fromkeys(trials)
    ]


def simulation(
    job: Callable[..., Row],
    what: str,
    designs: Iterable[tuple[str, StudyDesign]],
    units: Callable[[int], Sequence[Any]],
    seed: int | None,
    prior: Prior | str | None,
    workers: Workers,
    progress: Progress | None,
    keep: str | Path | None = None,
) -> tuple[tuple[Row, ...], int, dict[str, str]]:
    """What a job returns of every unit with every design, the root seed, and by the names of units why some could not be done.

    Units, made from the seed, are observers or studies of such, by whose names streams are keyed; priors are in numbers for each design.
    """
    with keeping(keep, f"simulated {what}") as kept:
        root = kept.seed(seed)
        made = units(root)
        numbers = [(name, one, prior_of([one], prior)) for name, one in designs]
        jobs = [
            partial(job, name, one, unit, seed=root, prior=of)
            for name, one, of in numbers
            for unit in made
        ]
        done = kept.work(jobs, workers, progress, [(one.args[2].name,) for one in jobs])
        return (
            tuple(done),
            root,
            {jobs[at].args[2].name: one.reason for at, one in done.failed.items()},
        )


def simulated(
    name: str, design: StudyDesign, observer: Observer, seed: int, prior: Prior
) -> DataSet:
    """One observer's answers to a design, judged, with the widths of the update's 90 % intervals where its draws can be trusted.

    Streams are keyed by seed, observer and number of trials.
    """
    subject = observer.answers(design, generator(seed, observer.name, "answers", design.total))
    models, widths = models_of(subject.task), None
    fitted = fitted_result(models.update.posterior(subject, prior), seed, Wanted())[1].proposal
    if fitted.trusted:
        target, draws = fitted.proposal.posterior, fitted.draws
        assert isinstance(target, Posterior)
        values = target.quantities(draws.x)
        ends = (
            np.quantile(values[one], (0.05, 0.95), weights=draws.shares, method="inverted_cdf")
            for one in WIDTHS
        )
        widths = tuple(float(np.ptp(one)) for one in ends)
    found = replace(judged(subject, seed, prior, models.space), widths=widths)
    return DataSet(name, design.total, observer.name, observer.kind, found)
