"""Rules when a session stops: after so many trials a rule looks, and ends the session when a kind of order effect is sure enough.

How often that is right, simulation says.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.data.study import Subject
from bayes_toe.data.tables import Table
from bayes_toe.errors import InputError
from bayes_toe.kept import keeping
from bayes_toe.model.prior import Prior
from bayes_toe.planning.observers import PLAIN, Observer, assumed
from bayes_toe.planning.power import CERTAIN, DATA_SETS, WORDS, Judgement, jobs_of, judged, named_designs, share, worked
from bayes_toe.planning.study_design import StudyDesign
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers

if TYPE_CHECKING:
    import pandas as pd

#: Columns of power_stopping.csv.
STOPPING_COLUMNS = ("design", "observer", "kind", "trials", "named", "p_none", "p_constant_error", "p_update")


@dataclass(frozen=True)
class StoppingRule:
    """When to stop.

    Parameters
    ----------
    certain : float
        Probability of a kind above which a session ends.
    most : int
        Trials after which it ends anyway.
    every : int
        Trials between two looks.
    """

    certain: float = CERTAIN
    most: int = 1000
    every: int = 50

    def __post_init__(self) -> None:
        if not 1 / 3 < self.certain < 1.0:
            raise InputError(f"--stop {self.certain:g}: allowed is a probability above 1/3 and below 1")
        if not 1 <= self.every <= self.most:
            raise InputError(f"--look {self.every}: allowed is 1 to {self.most}, the largest number of trials")


@dataclass(frozen=True)
class Session:
    """One simulated session: its trials, the kind it named, if any, and probabilities at its end, None if one is withheld."""

    design: str
    observer: str
    kind: str
    trials: int
    named: str | None
    probability: tuple[float, ...] | None


@dataclass(frozen=True, eq=False)
class StoppingTable(Table[Session]):
    """Simulated sessions under a rule, a row each."""

    rule: StoppingRule
    seed: int
    failed: Mapping[str, str]

    def frame(self) -> pd.DataFrame:
        """Every session, with the columns of power_stopping.csv."""
        import pandas as pd

        cells = [[row.design, row.observer, row.kind, row.trials, row.named, *(row.probability or (None,) * 3)] for row in self.rows]
        return pd.DataFrame(cells, columns=list(STOPPING_COLUMNS))

    def sentences(self) -> list[str]:
        """How often the rule names what is there, how often something else, and after how many trials, a line a design and kind."""
        lines, rule = [], f"stopping at P > {self.rule.certain:g} or {self.rule.most} trials"
        for design, kind in dict.fromkeys((row.design, row.kind) for row in self.rows):
            rows = [row for row in self.rows if (row.design, row.kind) == (design, kind)]
            wrong = sum(row.named not in (None, kind) for row in rows)
            p, low, high = (100 * part for part in share(sum(row.named == kind for row in rows), len(rows)))
            lines.append(
                f"with {design}, {rule} names {WORDS[kind]} in {p:.0f} % of such observers ({low:.0f} to {high:.0f} %), and something else "
                f"in {wrong} of {len(rows)}; median {np.median([row.trials for row in rows]):.0f} trials"
            )
        return lines


def stopping(
    design: StudyDesign | Mapping[str, StudyDesign] | None = None,
    rule: StoppingRule | None = None,
    observers: str | Path | Sequence[Observer] | None = None,
    *,
    data_sets: int = DATA_SETS,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    keep: str | Path | None = None,
) -> StoppingTable:
    """Error rates and lengths of sessions that stop when a kind of order effect is sure enough.

    Parameters
    ----------
    design, observers, data_sets, seed, prior, workers, progress, keep
        As :func:`bayes_toe.planning.power.power` takes them; the pairs of the largest number of trials come in random order.
    rule : StoppingRule, optional

    Examples
    --------
    >>> table = stopping(rule=StoppingRule(most=52, every=26), data_sets=1, seed=1, workers=1)
    >>> [row.trials <= 52 for row in table]
    [True, True, True]
    """
    chosen = StoppingRule() if rule is None else rule
    given = named_designs(design)
    designs = {name: one.with_total(chosen.most) for name, one in given.items()}
    with keeping(keep, "simulated sessions") as kept:
        root = kept.seed(seed)
        people = assumed(observers, given, data_sets, root, prior)
        rows, failed = worked(kept, jobs_of(partial(session, rule=chosen), designs.items(), people, root, prior), workers, progress)
    return StoppingTable(rows, chosen, root, failed)


def session(name: str, design: StudyDesign, observer: Observer, rule: StoppingRule, seed: int, prior: Prior) -> Session:
    """One observer's session: at every look all answers so far are judged."""
    rng, trials = generator(seed, observer.name, "session"), 0
    order = rng.permutation(np.repeat(np.arange(design.n_pairs), design.n_trials))
    equal = rng.uniform(size=len(order)) < observer.equal(design)[order]
    s1, s2, *isi = (column[order] for column in design.columns)
    judgement = Judgement((0.0,) * len(PLAIN))
    while judgement.named(rule.certain) is None and trials < rule.most:
        trials = min(trials + rule.every, rule.most)
        so_far = (column[:trials] for column in (s1, s2, equal, *isi))
        judgement = judged(Subject.from_trials(observer.name, *so_far), seed, prior)
    return Session(name, observer.name, observer.kind, trials, judgement.named(rule.certain), judgement.probability)
