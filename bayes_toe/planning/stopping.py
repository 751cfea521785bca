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
from bayes_toe.kept import keeping
from bayes_toe.model.prior import Prior
from bayes_toe.planning.judging import Judgement, judged
from bayes_toe.planning.observers import NONE, Observer, assumed
from bayes_toe.planning.power import DATA_SETS, WORDS, jobs_of, named_designs, share, worked
from bayes_toe.planning.study_design import StudyDesign
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers

if TYPE_CHECKING:
    import pandas as pd

#: Columns of power_stopping.csv.
STOPPING_COLUMNS = ("design", "observer", "kind", "trials", "effect", "kind_named", "p_none", "p_constant_error", "p_update")
#: Words of a verdict at which a session may end.
ALLOWED = (*(word for word in EFFECTS if word not in ("", "undecided")), *KINDS.values(), *(f"probably {kind}" for kind in KINDS.values()))


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
            raise InputError(f"--stop: found {', '.join(map(quoted, wrong)) or 'nothing'}, allowed: some of {', '.join(ALLOWED)}")
        if not 1 <= self.every <= self.most:
            raise InputError(f"--look {self.every}: allowed is 1 to {self.most}, the largest number of trials")

    def ends(self, verdict: Verdict) -> bool:
        """Whether the verdict says one of the words."""
        return verdict.effect in self.words or verdict.kind in self.words


@dataclass(frozen=True)
class Session:
    """One simulated session: its trials, and how all answers were judged at its end."""

    design: str
    observer: str
    kind: str
    trials: int
    judgement: Judgement


@dataclass(frozen=True, eq=False)
class StoppingTable(Table[Session]):
    """Simulated sessions under a rule, a row each."""

    rule: StoppingRule
    seed: int
    failed: Mapping[str, str]

    def frame(self) -> pd.DataFrame:
        """Every session, with the columns of power_stopping.csv."""
        import pandas as pd

        ends = [(row.judgement.verdict, row.judgement.probability or (None,) * 3) for row in self.rows]
        cells = [
            [row.design, row.observer, row.kind, row.trials, said.effect, said.kind, *p]
            for row, (said, p) in zip(self.rows, ends, strict=True)
        ]
        return pd.DataFrame(cells, columns=list(STOPPING_COLUMNS))

    def sentences(self) -> list[str]:
        """How often the rule ends with what is there, with something else, and after how many trials, a line a design and kind."""
        words = " or ".join(f"'{word}'" for word in self.rule.words)
        lines, rule = [], f"stopping at {words}, or {self.rule.most} trials"
        for design, kind in dict.fromkeys((row.design, row.kind) for row in self.rows):
            rows = [row for row in self.rows if (row.design, row.kind) == (design, kind)]
            said = [row.judgement for row in rows]
            if kind == NONE:
                right, wrong = sum(one.named == NONE for one in said), sum(one.found for one in said)
                what, else_ = "says none, or a negligible effect", "one"
            else:
                right, wrong = sum(one.found for one in said), sum(one.named == NONE for one in said)
                what, else_ = "finds an order effect", "none, or a negligible one,"
            p, low, high = (100 * part for part in share(right, len(rows)))
            lines.append(
                f"with {design}, {rule} {what} in {p:.0f} % of observers with {WORDS[kind]} ({low:.0f} to {high:.0f} %), and "
                f"{else_} in {wrong} of {len(rows)}; median {np.median([row.trials for row in rows]):.0f} trials"
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
    judgement = Judgement(None)
    while not rule.ends(judgement.verdict) and trials < rule.most:
        trials = min(trials + rule.every, rule.most)
        so_far = (column[:trials] for column in (s1, s2, equal, *isi))
        judgement = judged(Subject.from_trials(observer.name, *so_far), seed, prior)
    return Session(name, observer.name, observer.kind, trials, judgement)
