"""How many more trials would decide whether a subject has an order effect, of the same pairs and of those that tell most."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp, softmax

from bayes_toe.data.messages import listed
from bayes_toe.data.study import Study, Subject, pooled
from bayes_toe.errors import InputError
from bayes_toe.inference.prediction import Predictor
from bayes_toe.kept import Kept
from bayes_toe.model.ladder import ORDERS, models_of
from bayes_toe.model.prior import Prior
from bayes_toe.model.record import Model
from bayes_toe.model.study_prior import prior_for
from bayes_toe.planning.information import told
from bayes_toe.planning.judging import Weighed, judged, weighed
from bayes_toe.planning.study_design import StudyDesign, all_pairs
from bayes_toe.seeds import generator, root_seed
from bayes_toe.workers import Progress, Workers

#: Simulated repetitions, of how many a verdict is asked, and by how many times the trials so far more are tried, fewest first.
REPETITIONS, ENOUGH = 10, 8
TIMES = (0.5, 1.0, 2.0, 4.0, 8.0)
_PAIRS = 6  # that tell most
_PREDICTED = 400  # draws over models by which pairs are compared


class Tried(NamedTuple):
    """So many more trials of a design, and in how many of the simulated repetitions the verdict is then decided."""

    design: StudyDesign
    trials: int
    decided: int


@dataclass(frozen=True, eq=False)
class MoreTrials:
    """What more trials of a subject would do: of the same pairs as so far, and of others of the same stimuli that tell more."""

    subject: str
    same: Tried
    telling: Tried

    def sentence(self) -> str:
        """In words, without the subject's name."""
        pairs = listed([f"{a:.3g} then {b:.3g}" for a, b, *_ in self.telling.design.pairs], _PAIRS)
        return f"{_said(self.same, 'the same pairs')}; {_said(self.telling, f'the pairs {pairs}')}"


def _said(one: Tried, pairs: str) -> str:
    number, often = (
        f"{float(f'{one.trials:.2g}'):,.0f} more trials of {pairs}",
        f"in {one.decided} of {REPETITIONS} simulated repetitions",
    )
    return (
        f"about {number} would decide ({often})"
        if one.decided >= ENOUGH
        else f"even {number} would decide {often} only"
    )


def more_trials(
    study: Study,
    subjects: Sequence[str] | None = None,
    *,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
) -> tuple[MoreTrials, ...]:
    """How many more trials would decide about subjects, by simulation; some ten seconds each.

    Observers are drawn from what the answers so far leave open, over all models of the verdict; their further answers are added to those
    so far, and judged. Numbers of trials from half to eight times those so far are tried, the fewest with which 8 of 10 are decided.

    Parameters
    ----------
    study : Study
    subjects : sequence of str, optional
        Names; by default all who are undecided.
    seed, prior, workers, progress
        As in :func:`bayes_toe.analysis.evidence`.

    Raises
    ------
    InputError
        If something is not allowed, or an evidence that counts is missing.
    """
    root, numbers = root_seed(seed), prior_for(study, prior)
    space = models_of(study.task).space
    names = (
        [
            one.name
            for one in study
            if judged(one, root, numbers, space).verdict.effect == "undecided"
        ]
        if subjects is None
        else subjects
    )
    jobs = [partial(of_subject, study[name], root, numbers) for name in names]
    done = Kept().work(jobs, workers, progress, [(name,) for name in names])
    for lost in done.failed.values():
        raise InputError(lost.reason)
    return tuple(done)


def of_subject(subject: Subject, seed: int, prior: Prior) -> MoreTrials:
    """One subject's simulation."""
    found = weighed(subject, seed, prior, models_of(subject.task).space)
    if not np.isfinite(found.values).all():
        raise InputError(
            f"subject {subject.name!r}: no evidence of some model, and nothing to simulate from"
        )
    people = observers(found, _PREDICTED, generator(seed, subject.name, "more trials"))
    same = StudyDesign(subject.s1, subject.s2, subject.n_trials, subject.isi, task=subject.task)
    every = all_pairs(np.unique([subject.s1, subject.s2]), subject.intervals, subject.task)
    yes = np.array([one.yes(*every.columns)[0] for one in people])
    orders = np.array([ORDERS.index(dict(one.target.model.levels)["order"]) for one in people])
    worth = told(np.stack([yes, 1.0 - yes]), np.full(_PREDICTED, 1.0 / _PREDICTED), orders)
    best, judges = np.sort(np.argsort(-worth)[:_PAIRS]), likeliest(found)

    def tried(design: StudyDesign, times: float) -> Tried:
        shared, decided = (
            design.with_total(max(design.n_pairs, round(times * subject.total_trials))),
            0,
        )
        for number, one in enumerate(people[:REPETITIONS]):
            rng = generator(seed, subject.name, "repetition", number, shared.total)
            more = shared.answered(
                rng.binomial(shared.n_trials, one.yes(*shared.columns)[0]), subject.name
            )
            both = replace(
                pooled((subject, more)),
                name=subject.name,
                condition=subject.condition,
                felt=subject.felt,
            )
            decided += judged(both, seed, prior, judges).verdict.effect != "undecided"
        return Tried(shared, shared.total, decided)

    def fewest(design: StudyDesign) -> Tried:
        """Of those tried that decide, or the most: the middle number first, then upward or downward from it."""
        by = cache(partial(tried, design))
        return by(
            TIMES[bisect_left(TIMES[:-1], True, key=lambda times: by(times).decided >= ENOUGH)]
        )

    return MoreTrials(subject.name, fewest(same), fewest(every.some(best)))


def likeliest(found: Weighed) -> list[Model]:
    """The models of all orders with the likeliest levels of the other parts, of each curve: by these a repetition is judged."""
    shapes: dict[str, dict[tuple[str, ...], list[int]]] = {}
    for place, model in enumerate(found.models):
        levels = dict(model.levels)
        rest = tuple(level for part, level in model.levels if part not in ("order", "curve"))
        shapes.setdefault(levels["curve"], {}).setdefault(rest, []).append(place)
    best = (
        max(some.values(), key=lambda places: float(logsumexp(found.values[places])))
        for some in shapes.values()
    )
    return [found.models[place] for place in sorted(place for places in best for place in places)]


def observers(found: Weighed, size: int, rng: np.random.Generator) -> list[Predictor]:
    """Draws of the posterior over models, one by one, with the model that each is of."""
    places = list(found.draws)
    made = []
    for place in rng.choice(places, size, p=softmax(found.values[places])).tolist():
        posterior, x, weights = found.draws[place]
        made.append(Predictor(posterior, x[rng.choice(len(x), 1, p=softmax(weights))]))
    return made
