"""Stopping rules: look after so many trials, stop when a kind of order effect is sure enough; how often that is right, by simulation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import softmax

from bayes_toe.arrays import BoolArray, IntArray
from bayes_toe.data.study import Subject
from bayes_toe.data.tables import Table
from bayes_toe.errors import InputError
from bayes_toe.kept import keeping
from bayes_toe.model.prior import Prior
from bayes_toe.planning.assumed import assumed
from bayes_toe.planning.observers import PLAIN, Observer
from bayes_toe.planning.particles import ENOUGH, Particles
from bayes_toe.planning.power import DATA_SETS, each_observer, named_designs
from bayes_toe.planning.power_table import CERTAIN, WORDS, share
from bayes_toe.planning.study_design import StudyDesign
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers

if TYPE_CHECKING:
    import pandas as pd

#: Columns of power_stopping.csv.
STOPPING_COLUMNS = ("design", "observer", "kind", "trials", "named", "p_none", "p_constant_error", "p_update")
_DRAWS = 4000
_INTERVAL = 1.0


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
    """One simulated session: how many trials it took, which kind it named, if any, and all probabilities at its end."""

    design: str
    observer: str
    kind: str
    trials: int
    named: str | None
    probability: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class StoppingTable(Table[Session]):
    """Simulated sessions under a rule.

    Attributes
    ----------
    rows : tuple of Session
    rule : StoppingRule
    seed : int
    failed : mapping of str to str
    """

    rule: StoppingRule
    seed: int
    failed: Mapping[str, str]

    def frame(self) -> pd.DataFrame:
        """Every session, with the columns of power_stopping.csv."""
        import pandas as pd

        cells = [[row.design, row.observer, row.kind, row.trials, row.named, *row.probability] for row in self.rows]
        return pd.DataFrame(cells, columns=list(STOPPING_COLUMNS))

    def sentences(self) -> list[str]:
        """How often the rule names what is there, how often something else, and after how many trials, a line a design and kind."""
        keys = dict.fromkeys((row.design, row.kind) for row in self.rows)
        return [self._sentence(*key) for key in keys]

    def _sentence(self, design: str, kind: str) -> str:
        rows = [row for row in self.rows if (row.design, row.kind) == (design, kind)]
        right, wrong = (sum(row.named not in (None, kind) if other else row.named == kind for row in rows) for other in (False, True))
        (p, low, high), trials = share(right, len(rows)), np.median([row.trials for row in rows])
        rule = f"stopping at P > {self.rule.certain:g} or {self.rule.most} trials"
        return (
            f"with {design}, {rule} names {WORDS[kind]} in {100 * p:.0f} % of such observers ({100 * low:.0f} to {100 * high:.0f} %), and "
            f"something else in {wrong} of {len(rows)}; median {trials:.0f} trials"
        )


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
        rows, failed = each_observer(kept, partial(session, rule=chosen), designs.items(), people, root, prior, workers, progress)
    return StoppingTable(rows, chosen, root, failed)


def session(name: str, design: StudyDesign, observer: Observer, rule: StoppingRule, seed: int, prior: Prior) -> Session:
    """One observer's session."""
    rng = generator(seed, observer.name, "session")
    order = rng.permutation(np.repeat(np.arange(design.n_pairs), design.n_trials))
    equal = rng.uniform(size=len(order)) < observer.equal(design)[order]
    centre = float(np.average(design.s1, weights=design.n_trials))
    interval = _INTERVAL if prior.reference_interval is None else prior.reference_interval
    clouds = [
        Particles.of_prior(model, prior, centre, interval, _DRAWS, generator(seed, observer.name, kind, "prior"))
        for kind, model in PLAIN.items()
    ]
    p, trials = np.full(len(PLAIN), 1.0 / len(PLAIN)), 0
    for begin, end in _looks(rule):
        new, every = (_answers(design, order[some], equal[some]) for some in (slice(begin, end), slice(end)))
        for kind, cloud in zip(PLAIN, clouds, strict=True):
            cloud.answered(new)
            if cloud.left < ENOUGH:
                cloud.renew(every, generator(seed, observer.name, kind, "particles", end))
        p, trials = softmax([cloud.log_evidence for cloud in clouds]), end
        if p.max() > rule.certain:
            break
    named = list(PLAIN)[int(p.argmax())] if p.max() > rule.certain else None
    return Session(name, observer.name, observer.kind, trials, named, tuple(p.tolist()))


def _looks(rule: StoppingRule) -> Iterator[tuple[int, int]]:
    ends = [*range(rule.every, rule.most, rule.every), rule.most]
    return zip([0, *ends[:-1]], ends, strict=True)


def _answers(design: StudyDesign, pairs: IntArray, equal: BoolArray) -> Subject:
    s1, s2, *isi = (column[pairs] for column in design.pairs.columns)
    return Subject.from_trials("session", s1, s2, equal, *isi)
