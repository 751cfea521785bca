"""What simulated data sets of a design said, counted: how often the order effect is named, and how often wrongly."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import betaincinv, ndtri

from bayes_toe.data.messages import listed
from bayes_toe.data.tables import Table, frame_of
from bayes_toe.errors import InputError
from bayes_toe.planning.observers import PLAIN, SAID, UPDATE

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


@dataclass(frozen=True)
class DataSet:
    """One simulated data set.

    Attributes
    ----------
    design : str
    trials : int
    observer, kind : str
    log_evidence, probability : tuple of float, optional
        Of no order effect, a constant error, the update; None where one is withheld.
    widths : tuple of float, optional
        Of the 90 % intervals of :data:`WIDTHS` under the update.
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

    def cells(self) -> list[object]:
        """A row of power_data_sets.csv."""
        parts = (self.log_evidence, self.probability, self.widths)
        return [self.design, self.trials, self.observer, self.kind, *(value for part in parts for value in part or (None,) * 3)]


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

        return pd.DataFrame([row.cells() for row in self.rows], columns=list(DATA_SET_COLUMNS))

    def sentences(self) -> list[str]:
        """What the simulation says, a line a design and number of trials.

        Examples
        --------
        >>> rows = [DataSet("these pairs", 650, f"update {i}", "update", None, (0.0, 0.1 * i, 1 - 0.1 * i), None) for i in range(2)]
        >>> PowerTable(tuple(rows), ("these pairs",), 1).sentences()
        ['with these pairs 650 trials name an update in 50 % of observers (6 to 94 %)']
        """
        return [self._sentence(design, number) for design in self.designs for number in self.trials]

    def _sentence(self, design: str, trials: int) -> str:
        keys = [kind for kind in self.kinds if (design, trials, kind) in self.groups]
        main = UPDATE if UPDATE in keys else keys[-1]
        named = self[design, trials, main, NAMED]
        line = f"with {design} {trials} trials name {WORDS[main]} in {said_share(named)}"
        others = [row for kind in keys if kind != main for row in self.groups[design, trials, kind]]
        wrong = sum(row.named() == main for row in others)
        return line + (f", and wrongly in {wrong} of {len(others)} others" if others else "")


def said_share(one: Counted) -> str:
    """A share of observers in percent, with its interval."""
    return f"{100 * one.value:.0f} % of observers ({100 * one.low:.0f} to {100 * one.high:.0f} %)"


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
