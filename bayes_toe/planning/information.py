"""What single trials tell: about assumed observers the Fisher information of one answer to each of many pairs, in closed form.

An answer to a pair with P(yes) = q has the information g g' q/(1 - q), g the gradient of log q. With the prior's curvature and the
information of all trials it makes a normal approximation of the posterior, of covariance C, at each observer's true values. The model is
the update with sloped noise and lapses, so that a design pays for what these parts leave open; parts that an observer does not
have are small there, not known to be absent. The pull counts as it is, with the variance of its prior: near the end of its range, where
observers who clearly update are, its logit would take that end for knowledge.

Designs are made of it by exchange: trials move, a portion at a time, to the pair where they tell most, until none is better off elsewhere
(Fedorov 1972).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import cast

import numpy as np
from scipy.special import entr, expit, log_ndtr

from bayes_toe.arrays import BoolArray, FloatArray, IndexArray, IntArray
from bayes_toe.comparison.words import NAMED
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import MAX_PULL
from bayes_toe.model.crowd import Crowd
from bayes_toe.model.ladder import models_of
from bayes_toe.model.posterior import Posterior, prior_draws
from bayes_toe.model.prior import Prior
from bayes_toe.model.record import Model
from bayes_toe.model.target import hessian
from bayes_toe.planning.observers import UPDATE, Observer, model_of, natural_of
from bayes_toe.planning.study_design import StudyDesign

#: What a design may be made for, and what its utility is then.
UTILITIES = {
    "update": "log probability to name those who update, plus expected log Bayes factor against an update of the others, nats",
    "gain": "minus log expected sd of the gain",
    "mu1": "minus log expected sd of mu1",
    "width": "minus log expected sd of log width",
    "parameters": "half the log determinant of the information about the four parameters",
}
#: The lapse rate, and the pull, of observers who have none by assumption.
SMALL_LAPSES = 0.02
SMALL_PULL = 1e-3
#: Share of the score for what is not asked: pairs that the aim could spare keep q0 and width from being guessed.
_SHARED = 0.2
#: Portions in which trials move, for each pair that a design may have; by how much a move has to raise the score.
_PORTIONS, _GAIN = 2, 1e-7


def _change(total: FloatArray, rows: FloatArray, trials: float) -> tuple[FloatArray, FloatArray]:
    """Of so many trials more of each row r, one row after the other, C r and 1 + trials r'C r, C the inverse of the information."""
    spread = rows @ np.linalg.inv(total)
    return spread, 1.0 + trials * np.einsum("ojk,ojk->oj", spread, rows)


@dataclass(frozen=True, eq=False)
class Information:
    """Information of one trial of each pair about each observer, and what of it is wanted.

    `aim` is one of :data:`UTILITIES`. `rows` has the shape (observers, pairs, k): a trial's information is the outer product of a row with
    itself; `prior` (observers, k, k) is the curvature of the prior, `direction` (observers, k) the gradient of the wanted quantity, of the
    pull where the aim is to name the update. Those who do not update, of whom only that aim takes account, have next to no `pull`.
    `interest` has the places of the paper's four parameters among the k coordinates.
    """

    aim: str
    rows: FloatArray
    prior: FloatArray
    direction: FloatArray
    pull: FloatArray
    updates: BoolArray
    prior_variance: float
    interest: tuple[int, ...]

    def total(self, n_trials: FloatArray | IntArray) -> FloatArray:
        """Information of so many trials of each pair, shape (pairs,), and the prior: (observers, k, k)."""
        some = np.flatnonzero(n_trials)
        rows = self.rows[:, some]
        return np.asarray(
            self.prior
            + np.einsum(
                "oji,ojk,j->oik", rows, rows, n_trials[some].astype(np.float64), optimize=True
            )
        )

    def variance(self, total: FloatArray) -> FloatArray:
        """Of the wanted quantity, shape (observers,)."""
        return np.asarray(
            np.einsum("ok,okl,ol->o", self.direction, np.linalg.inv(total), self.direction)
        )

    def utility(self, total: FloatArray) -> float:
        """Utility of a design with this information for its aim alone; larger is better."""
        return float(self._after(total, self.rows[:, :1], 0.0)[0][0])

    def score(self, total: FloatArray) -> float:
        """What designs are chosen by: utility, and a share of the information about all four parameters, so that none is left open."""
        return float(self.scores(total, 0.0, slice(1))[0])

    def scores(self, total: FloatArray, trials: float, pairs: slice = slice(None)) -> FloatArray:
        """The same with so many trials more of each of some pairs, one pair after the other: shape (pairs,)."""
        wanted, of_all = self._after(total, self.rows[:, pairs], trials)
        return wanted + _SHARED * of_all / len(self.interest)

    def _after(
        self, total: FloatArray, rows: FloatArray, trials: float
    ) -> tuple[FloatArray, FloatArray]:
        """With so many trials more of each row the utility, and half the log determinant of the information about what is of interest.

        Of the latter others are unknown. Of the aim to name the update the utility is the log of the probability to, of those who do, and
        the expected log Bayes factor against an update, log(V0/V)/2, of those who do not.
        """
        rest = [i for i in range(total.shape[1]) if i not in self.interest]
        nuisance = total[:, rest][:, :, rest]
        (spread, growth), (_, of_rest) = (
            _change(total, rows, trials),
            _change(nuisance, rows[..., rest], trials),
        )
        before = np.linalg.slogdet(total)[1] - np.linalg.slogdet(nuisance)[1]
        of_all = np.asarray(0.5 * (before[:, None] + np.log(growth) - np.log(of_rest)).mean(axis=0))
        if self.aim == "parameters":
            return of_all, of_all
        toward = np.einsum("ojk,ok->oj", spread, self.direction)
        variance = self.variance(total)[:, None] - trials * np.square(toward) / growth
        told = -0.5 * np.log(variance)
        if self.aim == "update":
            told[~self.updates] += 0.5 * np.log(self.prior_variance)
            told[self.updates] = log_ndtr(self._ahead(variance)[self.updates])
        return np.asarray(
            sum(told[some].mean(axis=0) for some in (self.updates, ~self.updates) if some.any())
        ), of_all

    def _ahead(self, variance: FloatArray) -> FloatArray:
        """Standard errors by which the answers' estimate of the pull is expected beyond what naming it takes.

        With the variances V0 before and V after the answers, they alone have the precision 1/V - 1/V0, and at an estimate of z standard
        errors the Bayes factor is log B = z^2/2 - log(V0/V)/2.
        """
        gained = np.maximum(
            1.0 / variance - 1.0 / self.prior_variance, 0.0
        )  # below 0 by rounding alone
        needed = 2.0 * np.log(NAMED / (1.0 - NAMED)) + np.log1p(self.prior_variance * gained)
        return np.asarray(self.pull[:, None] * np.sqrt(gained) - np.sqrt(needed))


def information(
    pairs: StudyDesign, observers: Sequence[Observer], aim: str, prior: Prior
) -> Information:
    """Information of every pair about the observers: those who update, and for the aim to name these the others too."""
    model, prior = (
        model_of(pairs.task, UPDATE, (pairs.task.lapses, "lapse_rate", "noise_slope")),
        prior.at(pairs.unanswered),
    )
    needed = {*Posterior(pairs.unanswered, model, prior).names.natural}
    some = [
        one
        for one in observers
        if (one.kind == UPDATE or aim == "update") and _natural(one).keys() >= needed
    ]
    updates = np.array([one.kind == UPDATE for one in some], np.bool_)
    if not updates.any():
        raise InputError(
            "--observers: found nobody with a predictive update, allowed: such observers, of whom a design is to tell"
        )
    rows, curvature, x = (
        np.stack(parts)
        for parts in zip(*(_of_one(model, pairs, one, prior) for one in some), strict=True)
    )
    places = {name: i for i, name in enumerate(model.coordinates)}
    at, spread = places["logit_pull"], float(np.var(prior_draws(model, prior, 0.0)["pull"]))
    pull = MAX_PULL * expit(x[:, at])
    rows[:, :, at] /= (pull * (1.0 - pull / MAX_PULL))[:, None]
    curvature[:, at], curvature[:, :, at] = 0.0, 0.0
    curvature[:, at, at] = 1.0 / spread
    wanted = {
        "update": {"logit_pull": 1.0},
        "parameters": {"logit_pull": 1.0},
        "gain": {"logit_pull": 1.0},
        "width": {"log_width": 1.0},
    }
    wanted["mu1"] = {"offset": 1.0 / pull, "logit_pull": -x[:, places["offset"]] / np.square(pull)}
    direction = np.zeros_like(x)
    for name, slope in wanted[aim].items():
        direction[:, places[name]] = slope
    interest = tuple(places[name] for name in models_of(pairs.task).update.coordinates)
    return Information(aim, rows, curvature, direction, pull, updates, spread, interest)


def _natural(observer: Observer) -> dict[str, float]:
    """An observer as the model has them, as far as that can be; it counts those without a pull as those with next to none."""
    values = {"lapse_rate": SMALL_LAPSES, "noise_slope": 0.0, **observer.quantities}
    if observer.kind != UPDATE and "width" in values:
        values = natural_of(
            {"pull": SMALL_PULL, "offset": 0.0, **values}, observer.centre, observer.task
        )
    return values


def _of_one(
    model: Model, pairs: StudyDesign, observer: Observer, prior: Prior
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rows of one observer, curvature of the prior there, and the point."""
    size, one = pairs.n_pairs, np.ones((pairs.n_pairs, 1), np.int64)
    crowd = Crowd(
        pairs.s1[:, None],
        pairs.s2[:, None],
        one,
        one,
        None if pairs.isi is None else pairs.isi[:, None],
    )
    target = Posterior(cast(Subject, crowd), model, prior, observer.centre, observer.interval)
    x = target.points(
        {
            name: np.array([value])
            for name, value in _natural(observer).items()
            if name in target.names.natural
        }
    )
    value, gradient = target.likelihood_gradient(np.repeat(x, size, axis=0))
    log_other = target.log_answers(np.repeat(x, size, axis=0))[1][:, 0]
    bends, vectors = np.linalg.eigh(-hessian(target.prior_gradient, x)[0])
    bent = (
        vectors * np.maximum(bends, 0.0)
    ) @ vectors.T  # where a prior bends upward it holds nothing
    return gradient * np.exp(0.5 * (value - log_other))[:, None], bent, x[0]


def entropy(answers: FloatArray) -> FloatArray:
    """Of an answer with these probabilities of one and the other, (2, ...) -> (...), nats.

    Of both, because 1 less a sum of weighted ones that are all 1 may be below 0 by rounding.
    """
    return np.asarray(entr(answers).sum(axis=0))


def told(answers: FloatArray, weights: FloatArray, which: IndexArray) -> FloatArray:
    """Expected information of one answer to each pair about the group of which an observer is, nats, shape (pairs,).

    Of draws of observers the probabilities of both answers, (2, draws, pairs), weights that sum to 1 and groups, (draws,).
    """
    members = np.where(which == np.unique(which)[:, None], weights, 0.0)
    share = members.sum(axis=1)
    members, share = members[share > 0], share[share > 0]
    return np.asarray(
        entropy(weights @ answers) - share @ entropy(members @ answers / share[:, None])
    )


# --- Exchange -------------------------------------------------------------------------------------


def exchanged(
    known: Information, trials: int, most: int, fixed: IntArray, partner: IndexArray
) -> IntArray:
    """Trials of every pair, (pairs,): so many to distribute beside those that are fixed, over at most so many different pairs.

    A pair and its partner, which may be itself, have equally many. Portions are put one after the other where they tell most, and then
    moved as long as a move raises the score.
    """
    unit, put = 1 + int((partner != np.arange(len(partner))).any()), np.zeros_like(fixed)
    portion = unit * max(1, trials // (unit * _PORTIONS * most))

    shown, best = (
        partial(_shown, put, fixed, partner),
        partial(_best, known, put, fixed, partner, most),
    )
    for _ in range(trials // portion):
        put[best(portion, unit)] += portion
    score, before = known.score(known.total(shown())), -np.inf
    while score > before + _GAIN:
        before = score
        for place in np.flatnonzero(put):
            while put[place]:
                put[place] -= portion
                at = best(portion, unit)
                put[at] += portion
                moved = known.score(known.total(shown()))
                if moved < score + _GAIN:
                    put[at] -= portion
                    put[place] += portion
                    break  # those that stay are alike
                score = moved
    for _ in range(trials % portion // unit):
        put[best(unit, most + 1)] += unit
    found = shown()
    found[best(1, most + 1)] += trials - int((found - fixed).sum())  # one that is left, if any
    return found


def _shown(put: IntArray, fixed: IntArray, partner: IndexArray) -> IntArray:
    """Trials of every pair: half of what is put is the partner's."""
    return fixed + (put + put[partner]) // 2


def _best(
    known: Information,
    put: IntArray,
    fixed: IntArray,
    partner: IndexArray,
    most: int,
    size: int,
    new: int,
) -> int:
    """Where so many trials more tell most: of the pairs there are, where so many new ones would be too many."""
    n = _shown(put, fixed, partner)
    scores, allowed = (
        known.scores(known.total(n), size),
        (n > 0) | (np.count_nonzero(n) + new <= most),
    )
    return int(np.where(allowed, scores + scores[partner], -np.inf).argmax())
