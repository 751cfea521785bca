"""Rules when a session stops: after so many trials a rule looks, and ends the session when the verdict says one of its words.

How often that is right, simulation says.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.comparison.verdict import Verdict
from bayes_toe.comparison.words import EFFECTS, KINDS
from bayes_toe.data.messages import quoted
from bayes_toe.data.study import Subject
from bayes_toe.data.tables import Table
from bayes_toe.errors import InputError
from bayes_toe.model.ladder import models_of
from bayes_toe.model.prior import Prior
from bayes_toe.planning.judging import Judgement, judged
from bayes_toe.planning.observers import NONE, Observer, assumed
from bayes_toe.planning.power import (
    DATA_SETS,
    WORDS,
    DataSet,
    data_sets_frame,
    named_designs,
    share_of,
    simulation,
)
from bayes_toe.planning.study_design import StudyDesign
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers

if TYPE_CHECKING:
    import pandas as pd

#: Columns of power_stopping.csv.
STOPPING_COLUMNS = (
    "design",
    "observer",
    "kind",
    "trials",
    "effect",
    "kind_named",
    "p_none",
    "p_constant_error",
    "p_update",
)
#: Words of a verdict at which a session may end.
ALLOWED = (
    *(word for word in EFFECTS if word not in ("", "undecided")),
    *KINDS.values(),
    *(f"probably {kind}" for kind in KINDS.values()),
)


@dataclass(frozen=True)
class StoppingRule:
    """When to stop.

    Parameters
    ----------
    words : sequence of str
        What the verdict has to say, of the effect or of its kind, for a session to end: some of :data:`ALLOWED`.
    most : int
        Trials after which it ends anyway.
    every : int
        Trials between two looks.
    """

    words: Sequence[str] = ("has", "negligible", "none")
    most: int = 1000
    every: int = 50

    def __post_init__(self) -> None:
        wrong = [one for one in self.words if one not in ALLOWED]
        if wrong or not self.words:
            raise InputError(
                f"--stop: found {', '.join(map(quoted, wrong)) or 'nothing'}, allowed: some of {', '.join(ALLOWED)}"
            )
        if not 1 <= self.every <= self.most:
            raise InputError(
                f"--look {self.every}: allowed is 1 to {self.most}, the largest number of trials"
            )

    def ends(self, verdict: Verdict) -> bool:
        """Whether the verdict says one of the words."""
        return verdict.effect in self.words or verdict.kind in self.words


@dataclass(frozen=True, eq=False)
class StoppingTable(Table[DataSet]):
    """Simulated sessions under a rule, a row each: their trials, and how all answers were judged at the end."""

    seed: int
    failed: Mapping[str, str]
    rule: StoppingRule

    def frame(self) -> pd.DataFrame:
        """Every session, with the columns of power_stopping.csv."""
        return data_sets_frame(self.rows, STOPPING_COLUMNS)

    def sentences(self) -> list[str]:
        """How often the rule ends with what is there, with something else, and after how many trials, a line a design and kind."""
        words = " or ".join(f"'{word}'" for word in self.rule.words)
        lines, rule = [], f"stopping at {words}, or {self.rule.most} trials"
        for design, kind in dict.fromkeys((row.design, row.kind) for row in self.rows):
            rows = [row for row in self.rows if (row.design, row.kind) == (design, kind)]
            found, none = (
                [row.judgement.found for row in rows],
                [row.judgement.named == NONE for row in rows],
            )
            what, right, else_, wrong = (
                "finds an order effect",
                found,
                "none, or a negligible one,",
                none,
            )
            if kind == NONE:
                what, right, else_, wrong = "says none, or a negligible effect", none, "one", found
            p, low, high = (100 * part for part in share_of(right)[:3])
            lines.append(
                f"with {design}, {rule} {what} in {p:.0f} % of observers with {WORDS[kind]} ({low:.0f} to {high:.0f} %), and "
                f"{else_} in {sum(wrong)} of {len(rows)}; median {np.median([row.trials for row in rows]):.0f} trials"
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
    """Error rates and lengths of sessions that stop when the verdict says enough.

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
    chosen, given = StoppingRule() if rule is None else rule, named_designs(design)
    longest = [(name, one.with_total(chosen.most)) for name, one in given.items()]
    people = partial(assumed, observers, given, data_sets, prior=prior)
    found = simulation(
        partial(session, rule=chosen),
        "sessions",
        longest,
        people,
        seed,
        prior,
        workers,
        progress,
        keep,
    )
    return StoppingTable(*found, chosen)


def session(
    name: str, design: StudyDesign, observer: Observer, rule: StoppingRule, seed: int, prior: Prior
) -> DataSet:
    """One observer's session: at every look all answers so far are judged."""
    rng, trials = generator(seed, observer.name, "session"), 0
    order = rng.permutation(np.repeat(np.arange(design.n_pairs), design.n_trials))
    yes = rng.uniform(size=len(order)) < observer.p_yes(design)[order]
    s1, s2, *isi = (column[order] for column in design.columns)
    judgement = Judgement(None)
    while not rule.ends(judgement.verdict) and trials < rule.most:
        trials = min(trials + rule.every, rule.most)
        so_far = (column[:trials] for column in (s1, s2, yes, *isi))
        judgement = judged(
            Subject.from_trials(observer.name, *so_far, task=design.task),
            seed,
            prior,
            models_of(design.task).space,
        )
    return DataSet(name, trials, observer.name, observer.kind, judgement)
