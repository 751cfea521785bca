"""What a design will tell: assumed observers answer it, and every answer is analysed as the program analyses a study's.

Of each simulated subject the evidences without order effect, with a constant error and with the update, by the pipeline of the commands
with fewer judging draws: their standard errors are below 0.02 nat, and what is asked is whether factors of 3 and more are passed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from scipy.special import betaincinv, ndtri

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.words import probabilities
from bayes_toe.data.messages import listed
from bayes_toe.data.study import Subject
from bayes_toe.data.tables import Table, frame_of
from bayes_toe.errors import InputError
from bayes_toe.inference.evidence import weighed
from bayes_toe.inference.subject import Wanted, fitted_result
from bayes_toe.kept import Kept, keeping
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.planning.observers import PLAIN, SAID, UPDATE, Observer, assumed, prior_of
from bayes_toe.planning.study_design import StudyDesign, paper_study_design
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers

if TYPE_CHECKING:
    import pandas as pd

#: Columns of power.csv and of power_data_sets.csv.
POWER_COLUMNS = ("design", "trials", "observers", "quantity", "value", "low", "high", "data_sets")
_LOG_EVIDENCES = ("log_evidence_none", "log_evidence_constant_error", "log_evidence_update")
_PROBABILITIES = ("p_none", "p_constant_error", "p_update")
#: Quantities of the update of which the expected width of the 90 % interval is told.
WIDTHS = ("gain", "mu1", "width")
DATA_SET_COLUMNS = ("design", "trials", "observer", "kind", *_LOG_EVIDENCES, *_PROBABILITIES, *(f"{name}_90" for name in WIDTHS))
#: Probability from which a kind counts as named, and Bayes factors against the best of its rivals.
CERTAIN, FACTORS = 0.95, (3, 10, 30)
NAMED, WRONG = f"named, P > {CERTAIN}", f"another named, P > {CERTAIN}"
#: Kinds in a sentence.
WORDS = {"none": "no order effect", "constant error": "a constant error", UPDATE: "an update"}
_LEVEL = 0.95  # of the intervals of Monte Carlo error
Row = TypeVar("Row")
TRIALS, DATA_SETS = (325, 650, 1300), 100
#: Independent draws behind each evidence.
DRAWS = 4000


@dataclass(frozen=True)
class DataSet:
    """One simulated data set: log evidence and probability of no order effect, a constant error, the update, None where one is withheld.

    And the widths of the 90 % intervals of :data:`WIDTHS` under the update.
    """

    design: str
    trials: int
    observer: str
    kind: str
    log_evidence: tuple[float, ...] | None
    probability: tuple[float, ...] | None
    widths: tuple[float, ...] | None

    def named(self, certain: float = CERTAIN) -> str | None:
        """The kind whose probability is above `certain`, if there is one."""
        if self.probability is None:
            return None
        best = int(np.argmax(self.probability))
        return list(PLAIN)[best] if self.probability[best] > certain else None

    def favoured(self, factor: float) -> str | None:
        """The kind whose Bayes factor against its best rival is above `factor`, if there is one."""
        if self.log_evidence is None:
            return None
        best, ahead = int(np.argmax(self.log_evidence)), np.diff(np.sort(self.log_evidence)[-2:])[0]
        return list(PLAIN)[best] if ahead > np.log(factor) else None


@dataclass(frozen=True)
class Counted:
    """One row of power.csv: a share or a mean over data sets, with its 95 % interval of Monte Carlo error."""

    design: str
    trials: int
    observers: str
    quantity: str
    value: float
    low: float
    high: float
    data_sets: int


@dataclass(frozen=True, eq=False)
class PowerTable(Table[DataSet]):
    """Simulated data sets of one or several designs, and what is counted of them.

    Attributes
    ----------
    rows : tuple of DataSet
    designs : tuple of str
    seed : int
    failed : mapping of str to str
        Observers whose work was lost, with the reason.
    """

    designs: tuple[str, ...]
    seed: int
    failed: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, key: tuple[str, int, str, str]) -> Counted:
        """What is counted, by (design, trials, kind of observers, quantity)."""
        found = self._by_key.get(key)
        if found is None:
            raise InputError(f"nothing counted for {key!r}; quantities: {listed([repr(name) for name in self.quantities], 20)}")
        return found

    @property
    def trials(self) -> tuple[int, ...]:
        """Numbers of trials, in their order."""
        return tuple(dict.fromkeys(row.trials for row in self.rows))

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of observers."""
        return tuple(dict.fromkeys(row.kind for row in self.rows))

    @property
    def quantities(self) -> tuple[str, ...]:
        """What is counted."""
        return tuple(dict.fromkeys(one.quantity for one in self.counted))

    @cached_property
    def counted(self) -> tuple[Counted, ...]:
        """Every share and mean."""
        return tuple(one for key, rows in self.groups.items() for one in _counted(*key, rows))

    @cached_property
    def _by_key(self) -> dict[tuple[str, int, str, str], Counted]:
        return {(one.design, one.trials, one.observers, one.quantity): one for one in self.counted}

    @cached_property
    def groups(self) -> dict[tuple[str, int, str], list[DataSet]]:
        """Data sets by (design, trials, kind of observers)."""
        groups: dict[tuple[str, int, str], list[DataSet]] = {}
        for row in self.rows:
            groups.setdefault((row.design, row.trials, row.kind), []).append(row)
        return groups

    def frame(self) -> pd.DataFrame:
        """The table with the columns of power.csv: a share or a mean a row, with low and high end of a 95 % interval of its error."""
        return frame_of(self.counted, POWER_COLUMNS)

    def data_sets_frame(self) -> pd.DataFrame:
        """Every simulated data set, with the columns of power_data_sets.csv."""
        import pandas as pd

        parts = [(row.log_evidence, row.probability, row.widths) for row in self.rows]
        numbers = [[value for part in some for value in part or (None,) * 3] for some in parts]
        cells = [[row.design, row.trials, row.observer, row.kind, *more] for row, more in zip(self.rows, numbers, strict=True)]
        return pd.DataFrame(cells, columns=list(DATA_SET_COLUMNS))

    def sentences(self) -> list[str]:
        """What the simulation says, a line a design and number of trials.

        Examples
        --------
        >>> rows = [DataSet("these pairs", 650, f"update {i}", "update", None, (0.0, 0.1 * i, 1 - 0.1 * i), None) for i in range(2)]
        >>> PowerTable(tuple(rows), ("these pairs",), 1).sentences()
        ['with these pairs 650 trials name an update in 50 % of observers (6 to 94 %)']
        """
        lines = []
        for design in self.designs:
            for trials in self.trials:
                keys = [kind for kind in self.kinds if (design, trials, kind) in self.groups]
                main = UPDATE if UPDATE in keys else keys[-1]
                named, others = self[design, trials, main, NAMED], [kind for kind in keys if kind != main]
                wrong = [row.named() == main for kind in others for row in self.groups[design, trials, kind]]
                said = f"{100 * named.value:.0f} % of observers ({100 * named.low:.0f} to {100 * named.high:.0f} %)"
                more = f", and wrongly in {sum(wrong)} of {len(wrong)} others" if wrong else ""
                lines.append(f"with {design} {trials} trials name {WORDS[main]} in {said}{more}")
        return lines


def share(hits: float, size: int) -> tuple[float, float, float]:
    """A share and its 95 % interval, by Jeffreys' prior; an end is 0 or 1 where nothing or all hit.

    Of a sum of probabilities the interval is too wide, if anything: they scatter no more than hits do.

    Examples
    --------
    >>> [round(value, 3) for value in share(7, 20)]
    [0.35, 0.172, 0.568]
    """
    tail = 0.5 * (1.0 - _LEVEL)
    low = 0.0 if hits == 0 else float(betaincinv(hits + 0.5, size - hits + 0.5, tail))
    high = 1.0 if hits == size else float(betaincinv(hits + 0.5, size - hits + 0.5, 1.0 - tail))
    return hits / size, low, high


def _counted(design: str, trials: int, kind: str, rows: Sequence[DataSet]) -> Iterator[Counted]:
    def made(quantity: str, found: tuple[float, float, float], size: int) -> Counted:
        return Counted(design, trials, kind, quantity, *found, size)

    known = [row for row in rows if row.probability is not None]
    if known:
        for word, values in zip(SAID, zip(*(row.probability for row in known if row.probability), strict=True), strict=True):
            yield made(f"P({word})", share(sum(values), len(known)), len(known))
    rules: list[tuple[str, str, Callable[[DataSet], str | None]]] = [(NAMED, WRONG, DataSet.named)]
    rules += [(f"named, BF > {f}", f"another named, BF > {f}", lambda row, f=f: row.favoured(f)) for f in FACTORS]  # type: ignore[misc]
    for right, wrong, rule in rules:
        named = [rule(row) for row in rows]
        yield made(right, share(named.count(kind), len(rows)), len(rows))
        yield made(wrong, share(sum(one not in (None, kind) for one in named), len(rows)), len(rows))
    told = [row.widths for row in rows if row.widths is not None]
    if told:
        for name, values in zip(WIDTHS, zip(*told, strict=True), strict=True):
            yield made(f"90 % width of {name}", mean(values), len(told))
    yield made("evidence withheld", share(len(rows) - len(known), len(rows)), len(rows))


def mean(values: Sequence[float]) -> tuple[float, float, float]:
    """A mean and its 95 % interval; the interval is the number itself where there is one value only."""
    middle = float(np.mean(values))
    error = float(np.std(values, ddof=1) / np.sqrt(len(values)) * ndtri(0.5 * (1 + _LEVEL))) if len(values) > 1 else float("nan")
    return middle, middle - error, middle + error


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
    """How often a design names the order effect of assumed observers, how often wrongly, and how narrow posteriors become.

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
        If there are fewer trials than pairs, something is not allowed, or observers would practically never say 'equal'.

    Examples
    --------
    >>> table = power(trials=[130], data_sets=1, seed=1, workers=1)
    >>> len(table.rows), table["the paper's pairs", 130, "update", "named, P > 0.95"].data_sets
    (3, 1)
    """
    designs = named_designs(design)
    asked = [(name, one.with_total(number)) for name, one in designs.items() for number in dict.fromkeys(trials)]
    with keeping(keep, "simulated data sets") as kept:
        root = kept.seed(seed)
        people = assumed(observers, designs, data_sets, root, prior)
        rows, failed = each_observer(kept, simulated, asked, people, root, prior, workers, progress)
    return PowerTable(rows, tuple(designs), root, failed)


def each_observer(
    kept: Kept,
    job: Callable[..., Row],
    designs: Iterable[tuple[str, StudyDesign]],
    people: Sequence[Any],
    seed: int,
    prior: Prior | str | None,
    workers: Workers,
    progress: Progress | None,
) -> tuple[tuple[Row, ...], dict[str, str]]:
    """A job done for every observer, or study of such, of every design, and by the observer's name why some could not be.

    The job is called with the design's name, the design, the observer, by whose name random streams are keyed, `seed` and `prior`, in
    numbers for the design's stimuli.
    """
    numbers = [(name, one, prior_of([one], prior)) for name, one in designs]
    jobs = [partial(job, name, one, person, seed=seed, prior=of) for name, one, of in numbers for person in people]
    done = kept.work(jobs, workers, progress, [(one.args[2].name,) for one in jobs])
    return tuple(done), {jobs[at].args[2].name: one.reason for at, one in done.failed.items()}


def simulated(name: str, design: StudyDesign, observer: Observer, seed: int, prior: Prior) -> DataSet:
    """One observer's answers to a design, analysed; streams are keyed by seed, observer and number of trials."""
    subject = observer.answers(design, generator(seed, observer.name, "answers", design.total))
    evidence, widths = analysed(subject, seed, prior)
    p = None if evidence is None else probabilities(evidence)
    return DataSet(name, design.total, observer.name, observer.kind, evidence, p, widths)


def analysed(subject: Subject, seed: int, prior: Prior) -> tuple[tuple[float, ...] | None, tuple[float, ...] | None]:
    """Log evidences of the three kinds (nats) and widths of 90 % intervals under the update; None if withheld."""
    found, widths = [], None
    for kind, model in PLAIN.items():
        result, fitted = fitted_result(model.posterior(subject, prior), seed, Wanted(evidence_draws=DRAWS))
        assert result.evidence is not None  # it was asked for
        found.append(result.evidence)
        if kind == UPDATE and fitted.proposal.trusted:
            draws, target = fitted.proposal.draws, fitted.proposal.proposal.posterior
            assert isinstance(target, Posterior)
            values = target.quantities(draws.x)
            widths = tuple(_width(values[name], draws.shares) for name in WIDTHS)
    logs = weighed([one.value for one in found], [one.bound for one in found])
    return None if np.isnan(logs).any() else tuple(logs.tolist()), widths


def _width(values: FloatArray, shares: FloatArray) -> float:
    """Of the 90 % interval of weighted draws."""
    order = np.argsort(values)
    low, high = np.searchsorted(np.cumsum(shares[order]), (0.05, 0.95))
    return float(values[order[min(high, len(order) - 1)]] - values[order[low]])


def named_designs(design: StudyDesign | Mapping[str, StudyDesign] | None) -> Mapping[str, StudyDesign]:
    """Designs by name; the paper's where there is none."""
    if design is None:
        return {"the paper's pairs": paper_study_design()}
    return {"these pairs": design} if isinstance(design, StudyDesign) else design
