"""How often a whole study names the order effect of its subjects: simulated ones taken together, a few at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.exact_random_effects import exact_random_effects
from bayes_toe.data.tables import Table
from bayes_toe.planning.observers import PLAIN
from bayes_toe.planning.power_table import CERTAIN, WORDS, PowerTable, share

if TYPE_CHECKING:
    import pandas as pd

#: Columns of power_subjects.csv.
STUDY_COLUMNS = ("design", "trials", "observers", "subjects", "studies", "named", "low", "high", "another_named")
SUBJECTS = (4, 8, 16)


@dataclass(frozen=True)
class StudyShare:
    """Of studies with so many subjects of one kind, the share that names it, with a 95 % interval, and the share that names another."""

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
        import pandas as pd

        return pd.DataFrame([[getattr(row, key) for key in STUDY_COLUMNS] for row in self.rows], columns=list(STUDY_COLUMNS))

    def sentences(self) -> list[str]:
        """What studies of subjects who update name, or of the last kind there is, a line a design and number of trials."""
        groups: dict[tuple[str, int, str], list[StudyShare]] = {}
        for row in self.rows:
            groups.setdefault((row.design, row.trials, row.observers), []).append(row)
        last = [kind for kind in PLAIN if any(key[2] == kind for key in groups)][-1:]
        return [_sentence(rows) for key, rows in groups.items() if key[2] in last]


def _sentence(rows: Sequence[StudyShare]) -> str:
    said = ", ".join(f"{100 * row.named:.0f} % of studies with {row.subjects} subjects (of {row.studies})" for row in rows)
    return (
        f"with {rows[0].design} and {rows[0].trials} trials each, {WORDS[rows[0].observers]} as the most frequent kind is named in {said}"
    )


def power_of_studies(table: PowerTable, subjects: Sequence[int] = SUBJECTS) -> StudyPower:
    """Random effects over simulated subjects of one kind, as `compare` has them over real ones.

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
    known = {key: [row.log_evidence for row in rows if row.log_evidence is not None] for key, rows in table.groups.items()}
    return StudyPower(tuple(found for key, values in known.items() for found in _shares(key, np.array(values), subjects)))


def _shares(key: tuple[str, int, str], evidence: FloatArray, subjects: Sequence[int]) -> Iterator[StudyShare]:
    for size in sorted(set(subjects)):
        studies = len(evidence) // size
        if studies and size > 1:
            named = [_named(evidence[i * size : (i + 1) * size]) for i in range(studies)]
            wrong = sum(one not in (None, key[2]) for one in named)
            yield StudyShare(*key, size, studies, *share(named.count(key[2]), studies), wrong / studies)


def _named(evidence: FloatArray) -> str | None:
    names = tuple(str(i) for i in range(len(evidence)))
    found = exact_random_effects(evidence, models=tuple(PLAIN), subjects=names).protected
    return list(PLAIN)[int(found.argmax())] if found.max() > CERTAIN else None
