"""How many trials tell that something is carried over from trial to trial: simulated observers, by the words of `compare --history`.

Observers who carry over the share that is asked for, and the same ones who carry over nothing, answer a design in one session, its trials
in random order.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.history import subject_history
from bayes_toe.data.answers import Answers
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.inference.space import space_evidence
from bayes_toe.model.history import require_order
from bayes_toe.model.ladder import models_of
from bayes_toe.model.parts import compose
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.planning.observers import UPDATE, Observer, assumed, of_kind
from bayes_toe.planning.power import (
    DATA_SETS,
    POWER_COLUMNS,
    TRIALS,
    Outcome,
    Simulations,
    named_designs,
    simulation,
    with_totals,
)
from bayes_toe.planning.study_design import StudyDesign
from bayes_toe.seeds import generator
from bayes_toe.workers import Progress, Workers

NOTHING = "nothing carried over"
#: Words of which the first says for sure, and both together say, that answers follow the trials before.
WORDS = ("yes", "probably", "undecided", "probably not", "no", "no pull")
FOUND = "yes or probably"


class Carrying(NamedTuple):
    """An observer, and the share of what is expected after a trial that is carried over to the next."""

    name: str
    observer: Observer
    share: float


@dataclass(frozen=True, eq=False)
class HistoryPower(Simulations[Outcome]):
    """Simulated observers, and how often their answers are said to follow the trials before."""

    COLUMNS = POWER_COLUMNS

    def sentences(self) -> list[str]:
        """How often it is said of those who carry something over, and of those who do not, a line a design and number of trials."""
        lines = []
        for design, trials, kind in (
            key for key in self.different("design", "trials", "observers") if key[2] != NOTHING
        ):
            found, wrong = (self.counted[design, trials, one, 1, FOUND] for one in (kind, NOTHING))
            lines.append(
                f"with {design} and {trials} trials, answers are said to follow the trials before, for sure or probably, of "
                f"{found.percent} of observers with {kind} {found.interval}, and wrongly of {wrong.hits} without"
            )
        return lines


def power_of_histories(  # noqa: PLR0913  # each is a choice of its own, and has a default
    carry_over: float,
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
) -> HistoryPower:
    """How often it is found that a share is carried over from trial to trial; about 5 seconds an observer.

    Parameters
    ----------
    carry_over : float
        The share, above 0 and below 1.
    design, trials, observers, seed, prior, workers, progress, keep
        As :func:`bayes_toe.planning.power.power` takes them. Of the kinds of observers those with a pull count, without which nothing
        can be carried over.
    data_sets : int
        Observers, each once with and once without.

    Raises
    ------
    InputError
        If something is not allowed, or no observers have a pull.
    """
    designs = named_designs(design)

    def planned(root: int) -> list[Carrying]:
        everybody = assumed(observers, designs, data_sets, root, prior)
        require_carrying(carry_over, everybody)
        people = of_kind(everybody, UPDATE)
        return [
            Carrying(f"{one.name}, {share:g} carried over", one, share)
            for share in (0.0, carry_over)
            for one in people
        ]

    return HistoryPower(
        *simulation(
            followed,
            "histories",
            with_totals(designs, trials),
            planned,
            seed,
            prior,
            workers,
            progress,
            keep,
        )
    )


def require_carrying(share: float, observers: Iterable[Observer]) -> None:
    """Refuse a share that nobody can carry over, and observers without a pull."""
    if not 0.0 < share < 1.0:
        raise InputError(f"--carry-over: found {share:g}, allowed: a number above 0 and below 1")
    if all(one.kind != UPDATE for one in observers):
        raise InputError(
            "--carry-over: found observers without a pull, who carry nothing over, allowed: some of the kind update"
        )


def followed(name: str, design: StudyDesign, one: Carrying, seed: int, prior: Prior) -> Outcome:
    """What is said of one observer's answers to a design; streams are keyed by observer, share and number of trials."""
    subject = answers_in_order(one, design, generator(seed, one.name, "answers", design.total))
    found = subject_history(
        space_evidence(subject, prior, models_of(subject.task).space, seed), seed
    )
    return Outcome(
        name,
        design.total,
        f"{one.share:g} carried over" if one.share else NOTHING,
        1,
        said_of(found.depends),
    )


def said_of(depends: str) -> dict[str, bool]:
    """Which word it is, and whether it says that answers follow the trials before."""
    return {**{f"said: {word}": depends == word for word in WORDS}, FOUND: depends in WORDS[:2]}


def answers_in_order(one: Carrying, design: StudyDesign, rng: np.random.Generator) -> Subject:
    """Answers of an observer to the trials of a design, in one session and random order."""
    keys = np.column_stack(design.columns)[
        rng.permutation(np.repeat(np.arange(design.n_pairs), design.n_trials))
    ]
    count = len(keys)
    answers = Answers(
        keys, np.zeros(count, np.int64), np.ones(count, np.int64), None, (), True, np.arange(count)
    )
    target = one.observer.target(Subject.from_answers(one.observer.name, answers, design.task))
    quantities = {key: np.array([value]) for key, value in one.observer.quantities.items()}
    if one.share:
        target = replace(
            target,
            model=compose(design.task, **{**dict(target.model.levels), "history": "carry-over"}),
        )
        quantities["carry_over"] = np.array([one.share])
    return answered(target, target.points(quantities), rng)


def answered(target: Posterior, x: FloatArray, rng: np.random.Generator) -> Subject:
    """The subject of a posterior with the answers that the model gives to its trials, in their order, at a point, (1, k)."""
    subject = target.subject
    answers = require_order(subject)
    p = np.empty(len(answers.n_yes))
    p[np.lexsort(answers.keys.T[::-1])] = np.exp(
        target.trial_answers(x)[0]
    )  # trials are in the order of the pairs there
    return Subject.from_answers(
        subject.name,
        replace(answers, n_yes=(rng.random(len(p)) < p).astype(np.int64)),
        subject.task,
    )
