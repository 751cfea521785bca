"""Answers that come one by one: the posterior of a model meanwhile, and rules when a session stops.

A rule looks after so many trials, and stops when a kind of order effect is sure enough; how often that is right, simulation says.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import logsumexp

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.data.tables import Table
from bayes_toe.errors import InputError
from bayes_toe.inference.adaptation import fitting, refreshed
from bayes_toe.inference.proposal import FittedProposal, efficiency
from bayes_toe.kept import keeping
from bayes_toe.model.posterior import Model, Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.planning.observers import PLAIN, Observer, assumed
from bayes_toe.planning.power import CERTAIN, DATA_SETS, WORDS, Judgement, jobs_of, named_designs, share, worked
from bayes_toe.planning.study_design import StudyDesign
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers

if TYPE_CHECKING:
    import pandas as pd

#: Share of the draws that counted when they were made, below which they are made anew.
ENOUGH = 0.5
#: Efficiency below which a proposal that was brought up to date is fitted from the beginning.
_POOR = 0.25
#: Columns of power_stopping.csv.
STOPPING_COLUMNS = ("design", "observer", "kind", "trials", "named", "p_none", "p_constant_error", "p_update")
_DRAWS = 4000
_INTERVAL = 1.0


@dataclass(eq=False)
class Particles:
    """Draws of one model with their weights.

    The first ones are of the prior. When an answer comes their weights change; when fewer than half of those count that did, the mixture
    that they came from is refitted to them and all are drawn from it again, each with its weight: the program's global move without
    rejections, so that no error is handed on from one generation to the next.

    `centre` is that of offsets (natural-log intensity), `interval` that of pull and width (seconds). `log_posterior` is the joint density
    of draws and answers, `log_weight` the same over the density that draws came from, both -inf outside of the support, shape (draws,);
    `generation` counts how often they were made anew.
    """

    model: Model
    prior: Prior
    centre: float
    interval: float
    x: FloatArray
    log_posterior: FloatArray
    log_weight: FloatArray
    fitted: FittedProposal | None = None
    generation: int = 0
    _meanwhile: list[Subject] = field(default_factory=list)  # answers since they were last begun to be made anew

    @classmethod
    def of_prior(cls, model: Model, prior: Prior, centre: float, interval: float, draws: int, rng: np.random.Generator) -> Particles:
        """Before any answer."""
        nobody = Subject("prior", np.zeros(1), np.zeros(1), np.zeros(1, np.int64), np.ones(1, np.int64))
        target = Posterior(nobody, model, prior, centre, interval)
        x = target.sample_prior(rng, draws)
        return cls(model, prior, centre, interval, x, target.log_prior(x), np.zeros(draws))

    def target(self, pairs: Subject) -> Posterior:
        """The posterior of these answers, or the rule by which these pairs are answered."""
        return Posterior(pairs, self.model, self.prior, self.centre, self.interval)

    @property
    def shares(self) -> FloatArray:
        """Weights that sum to 1, shape (draws,)."""
        return np.asarray(np.exp(self.log_weight - logsumexp(self.log_weight)))

    @property
    def log_evidence(self) -> float:
        """Of all answers, nats."""
        return float(logsumexp(self.log_weight) - np.log(len(self.x)))

    @property
    def possible(self) -> bool:
        """Whether the model can have given all answers; one without lapses never calls identical stimuli different."""
        return bool(self.log_weight.max() > -np.inf)

    @property
    def effective(self) -> float:
        """How many draws count; none where the answers are impossible."""
        return efficiency(self.log_weight) * len(self.x) if self.possible else 0.0

    def allows(self, more: Subject) -> bool:
        """Whether the model can have given these answers too."""
        return bool((self.log_weight + self.target(more).log_likelihood(self.x)).max() > -np.inf)

    def answered(self, more: Subject) -> None:
        """Take in further answers."""
        self._meanwhile.append(more)
        gained = self.target(more).log_likelihood(self.x)
        self.log_posterior, self.log_weight = self.log_posterior + gained, self.log_weight + gained

    @property
    def left(self) -> float:
        """Share of the draws that counted when they were made, that count still."""
        return self.effective / (len(self.x) * (1.0 if self.fitted is None else self.fitted.efficiency))

    def renewing(self, subject: Subject, rng: np.random.Generator) -> Iterator[int]:
        """Make the draws anew, for all answers so far, in portions, told by about how many draws they took.

        Answers may come in between, and old draws serve meanwhile. Where the old proposal can be brought up to date it is one portion, else
        there are a few.
        """
        self._meanwhile = []
        target = self.target(subject)
        fitted = None if self.fitted is None else refreshed(self.fitted, target, self.log_posterior, rng)
        if fitted is None or not fitted.trusted or fitted.efficiency < _POOR:
            if fitted is not None:
                yield len(self.x)
            fitted = yield from fitting(target, rng, draws=len(self.x))
        draws, later, self._meanwhile = fitted.draws, self._meanwhile, []
        self.x, self.log_posterior, self.log_weight, self.fitted = draws.x, draws.log_posterior, draws.log_weights, fitted
        self.generation += 1
        for more in later:
            self.answered(more)


# --- Rules ----------------------------------------------------------------------------------------


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
    """Simulated sessions under a rule, a row each."""

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
    """One observer's session."""
    rng = generator(seed, observer.name, "session")
    order = rng.permutation(np.repeat(np.arange(design.n_pairs), design.n_trials))
    equal = rng.uniform(size=len(order)) < observer.equal(design)[order]
    s1, s2, *isi = (column[order] for column in design.pairs.columns)
    centre = float(np.average(design.s1, weights=design.n_trials))
    interval = _INTERVAL if prior.reference_interval is None else prior.reference_interval
    clouds = [
        Particles.of_prior(model, prior, centre, interval, _DRAWS, generator(seed, observer.name, kind, "prior"))
        for kind, model in PLAIN.items()
    ]
    judgement, trials = Judgement((0.0,) * len(PLAIN)), 0
    while judgement.named(rule.certain) is None and trials < rule.most:
        end = min(trials + rule.every, rule.most)
        new, every = (
            Subject.from_trials("session", s1[at], s2[at], equal[at], *(one[at] for one in isi)) for at in (slice(trials, end), slice(end))
        )
        for kind, cloud in zip(PLAIN, clouds, strict=True):
            cloud.answered(new)
            if cloud.left < ENOUGH:
                list(cloud.renewing(every, generator(seed, observer.name, kind, "particles", end)))
        judgement, trials = Judgement(tuple(cloud.log_evidence for cloud in clouds)), end
    return Session(name, observer.name, observer.kind, trials, judgement.named(rule.certain), judgement.probability or ())
