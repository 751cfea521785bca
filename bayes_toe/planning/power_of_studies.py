"""How often a whole study finds the order effect of its subjects: simulated ones taken together, a few at a time.

By random effects over their evidences a study names the most frequent kind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bayes_toe.comparison.random_effects import random_effects
from bayes_toe.model.ladder import ORDERS
from bayes_toe.planning.observers import (
    MIXED,
    mixture,
)
from bayes_toe.planning.power import (
    WORDS,
    Outcome,
    PowerTable,
    Simulations,
)

if TYPE_CHECKING:
    import pandas as pd

SUBJECTS, STUDIES = (4, 8, 16), 20
#: Columns of power_subjects.csv.
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
#: What is counted of studies.
NAMED, WRONG = "named", "another named"
_SURE = 0.95


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
