"""How often a whole study names the order effect of its subjects: simulated ones taken together, a few at a time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.random_effects import random_effects
from bayes_toe.data.tables import Table, frame_of
from bayes_toe.planning.observers import MIXED, PLAIN, mixture
from bayes_toe.planning.power_table import CERTAIN, WORDS, PowerTable, share

if TYPE_CHECKING:
    import pandas as pd

#: Columns of power_subjects.csv.
STUDY_COLUMNS = ("design", "trials", "observers", "subjects", "studies", "named", "low", "high", "another_named")
SUBJECTS = (4, 8, 16)
_WHAT = {kind: f"{words} as the most frequent kind" for kind, words in WORDS.items()}
_WHAT[MIXED] = "the most frequent kind of the mixed population"


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
        return [_sentence(rows) for key, rows in groups.items() if key[2] in last]


def _sentence(rows: Sequence[StudyShare]) -> str:
    said = ", ".join(f"{100 * row.named:.0f} % of studies with {row.subjects} subjects (of {row.studies})" for row in rows)
    return f"with {rows[0].design} and {rows[0].trials} trials each, {_WHAT[rows[0].observers]} is named in {said}"


def power_of_studies(table: PowerTable, subjects: Sequence[int] = SUBJECTS, shares: Mapping[str, float] | None = None) -> StudyPower:
    """Random effects over simulated subjects of one kind, as `compare` has them over real ones; with shares, also of a mixture of kinds.

    Data sets are taken together in order, each once, so that studies are independent; a kind is named where the probability that it is the
    most frequent in the population, protected against all being equally frequent, is above 0.95. There are no rows of more subjects than
    data sets, and of a study one of whose evidences is withheld.

    Examples
    --------
    >>> from bayes_toe.planning.power_table import DataSet
    >>> rows = [DataSet("d", 650, f"u{i}", "update", (-5.0, -4.0, 0.0), (0.0, 0.1, 0.9), None) for i in range(8)]
    >>> [(row.subjects, row.studies, row.named) for row in power_of_studies(PowerTable(tuple(rows), ("d",), 1))]
    [(4, 2, 0.0), (8, 1, 1.0)]
    """
    known = {key: np.array([row.log_evidence for row in rows if row.log_evidence is not None]) for key, rows in table.groups.items()}
    sizes = [size for size in sorted(set(subjects)) if size > 1]
    found = [one for key, values in known.items() for size in sizes for one in _share(key, key[2], _alike(values, size))]
    if shares:
        most = max(shares, key=shares.__getitem__)
        for design, trials in dict.fromkeys(key[:2] for key in known):
            of_kind = {kind: known.get((design, trials, kind), np.empty(0)) for kind in shares}
            found += [
                one for size in sizes for one in _share((design, trials, MIXED), most, _mixed(of_kind, mixture(shares, size, table.seed)))
            ]
    return StudyPower(tuple(found))


def _alike(evidence: FloatArray, size: int) -> list[FloatArray]:
    """Log evidences of whole studies of so many subjects."""
    return [evidence[i : i + size] for i in range(0, len(evidence) - size + 1, size)]


def _mixed(evidence: Mapping[str, FloatArray], planned: Iterator[list[tuple[str, int]]]) -> list[FloatArray]:
    """The same of several kinds, as long as there are subjects of all."""
    there = takewhile(lambda study: all(number < len(evidence[kind]) for kind, number in study), planned)
    return [np.array([evidence[kind][number] for kind, number in study]) for study in there]


def _share(key: tuple[str, int, str], kind: str, studies: Sequence[FloatArray]) -> Iterator[StudyShare]:
    """How often the kind is named, where there is any study."""
    if studies:
        named = [_named(evidence) for evidence in studies]
        wrong = sum(one not in (None, kind) for one in named)
        yield StudyShare(*key, len(studies[0]), len(studies), *share(named.count(kind), len(studies)), wrong / len(studies))


def _named(evidence: FloatArray) -> str | None:
    found = random_effects(evidence).protected
    return list(PLAIN)[int(found.argmax())] if found.max() > CERTAIN else None
