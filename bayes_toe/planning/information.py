"""What single trials tell about assumed observers, in closed form: Fisher information of one answer to each of many pairs.

An answer to a pair with P(equal) = q has the information g g' q/(1 - q), g the gradient of log q. With the prior's curvature and the
information of all trials it makes a normal approximation of the posterior, of covariance C, at each observer's true values. The model is
the update with sloped noise and lapses both ways, so that a design pays for what these parts leave open; parts that an observer does not
have are small there, not known to be absent. The pull counts as it is, with the variance of its prior: near the end of its range, where
observers who clearly update are, its logit would take that end for knowledge.

Designs are made of it by exchange: trials move, a portion at a time, to the pair where they tell most, until none is better off elsewhere
(Fedorov 1972).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from scipy.special import expit, log_ndtr, ndtr

from bayes_toe.arrays import BoolArray, FloatArray, IndexArray, IntArray
from bayes_toe.comparison.words import NAMED
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import MAX_PULL
from bayes_toe.model.crowd import Crowd
from bayes_toe.model.ladder import model_named
from bayes_toe.model.posterior import Model, Posterior, prior_draws
from bayes_toe.model.prior import Prior
from bayes_toe.model.target import hessian
from bayes_toe.planning.observers import UPDATE, Observer, natural_of
from bayes_toe.planning.study_design import StudyDesign

#: What a design may be made for, and what its utility is then.
UTILITIES = {
    "update": "log probability to name those who update, plus expected log Bayes factor against an update of the others, nats",
    "gain": "minus log expected sd of the gain",
    "mu1": "minus log expected sd of mu1",
    "width": "minus log expected sd of log width",
    "parameters": "half the log determinant of the information about the four parameters",
}
#: The model under which information counts, and the lapse rate of observers who have none by assumption.
MODEL = "update + sloped + both ways"
SMALL_LAPSES = 0.02
SMALL_PULL = 1e-3  # of those who do not update
#: Share of the score for what is not asked: pairs that the aim could spare keep q0 and width from being guessed.
_SHARED = 0.2
_INTEREST = ("offset", "logit_pull", "log_width", "logit_q0")
#: Portions in which trials move, for each pair that a design may have.
_PORTIONS = 2
_SWEEPS, _GAIN = 30, 1e-7  # at most so often through all portions; by how much a move has to raise the score


class _Change:
    """So many trials more of each row r, one row after the other: by the formula for matrices that change by an outer product."""

    def __init__(self, total: FloatArray, rows: FloatArray, trials: float) -> None:
        self.rows, self.trials = rows, trials
        self.spread: FloatArray = rows @ np.linalg.inv(total)
        self.growth: FloatArray = 1.0 + trials * np.einsum("ojk,ojk->oj", self.spread, rows)


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

    def total(self, n_trials: FloatArray) -> FloatArray:
        """Information of so many trials of each pair, shape (pairs,), and the prior: (observers, k, k)."""
        some = np.flatnonzero(n_trials)
        rows = self.rows[:, some]
        return np.asarray(self.prior + np.einsum("oji,ojk,j->oik", rows, rows, n_trials[some], optimize=True))

    def utility(self, total: FloatArray) -> float:
        """Utility of a design with this information for its aim alone; larger is better."""
        return float(self._wanted(total, _Change(total, self.rows[:, :1], 0.0))[0])

    def score(self, total: FloatArray) -> float:
        """What designs are chosen by: utility, and a share of the information about all four parameters, so that none is left open."""
        return float(self._scored(total, self.rows[:, :1], 0.0)[0])

    def with_more(self, total: FloatArray, trials: float, pairs: IndexArray | slice = slice(None)) -> FloatArray:
        """The score with so many trials more of each of some pairs, one after the other, shape (pairs,)."""
        return self._scored(total, self.rows[:, pairs], trials)

    def variance(self, total: FloatArray) -> FloatArray:
        """Of the wanted quantity, shape (observers,)."""
        return np.asarray(np.einsum("ok,okl,ol->o", self.direction, np.linalg.inv(total), self.direction))

    def named(self, total: FloatArray) -> float:
        """Predicted share of those who update whom a design names; for the aim 'update'."""
        return float(ndtr(self._ahead(self.variance(total)[:, None]))[self.updates].mean())

    def worth(self, total: FloatArray) -> FloatArray:
        """What one more trial of each pair adds to the score, shape (pairs,)."""
        return self.with_more(total, 1.0) - self.score(total)

    def _scored(self, total: FloatArray, rows: FloatArray, trials: float) -> FloatArray:
        change = _Change(total, rows, trials)
        return self._wanted(total, change) + _SHARED * self._of_determinants(total, change) / len(self.interest)

    def _wanted(self, total: FloatArray, change: _Change) -> FloatArray:
        """The utility after each change.

        Of the aim to name the update: the log of the probability to, of those who do, and the expected log Bayes factor against an update,
        log(V0/V)/2, of those who do not.
        """
        if self.aim == "parameters":
            return self._of_determinants(total, change)
        toward = np.einsum("ojk,ok->oj", change.spread, self.direction)
        variance = self.variance(total)[:, None] - change.trials * np.square(toward) / change.growth
        if self.aim != "update":
            return np.asarray(-0.5 * np.log(variance).mean(axis=0))
        told = log_ndtr(self._ahead(variance))
        told[~self.updates] = 0.5 * np.log(self.prior_variance / variance[~self.updates])
        return np.asarray(sum(told[some].mean(axis=0) for some in (self.updates, ~self.updates) if some.any()))

    def _of_determinants(self, total: FloatArray, change: _Change) -> FloatArray:
        """Half the log determinant of the information about the parameters of interest, all others being unknown."""
        rest = [i for i in range(total.shape[1]) if i not in self.interest]
        nuisance = total[:, rest][:, :, rest]
        of_rest = _Change(nuisance, change.rows[..., rest], change.trials).growth
        before = np.linalg.slogdet(total)[1] - np.linalg.slogdet(nuisance)[1]
        return np.asarray(0.5 * (before[:, None] + np.log(change.growth) - np.log(of_rest)).mean(axis=0))

    def _ahead(self, variance: FloatArray) -> FloatArray:
        """Standard errors by which the answers' estimate of the pull is expected beyond what naming it takes.

        With the variances V0 before and V after the answers, they alone have the precision 1/V - 1/V0, and at an estimate of z standard
        errors the Bayes factor is log B = z^2/2 - log(V0/V)/2.
        """
        gained = np.maximum(1.0 / variance - 1.0 / self.prior_variance, 0.0)  # below 0 by rounding alone
        needed = 2.0 * np.log(NAMED / (1.0 - NAMED)) + np.log1p(self.prior_variance * gained)
        return np.asarray(self.pull[:, None] * np.sqrt(gained) - np.sqrt(needed))


def information(pairs: StudyDesign, observers: Sequence[Observer], aim: str, prior: Prior) -> Information:
    """Information of every pair about the observers: those who update, and for the aim to name these the others too.

    Raises
    ------
    InputError
        If nobody updates.
    """
    model, prior = model_named(MODEL), prior.at(pairs.unanswered)
    assert isinstance(model, Model)
    some = [(one.kind == UPDATE, found) for one in observers if (found := _quantities(one)) is not None]
    some = [(updates, found) for updates, found in some if updates or aim == "update"]
    updates = np.array([of for of, _ in some], np.bool_)
    if not updates.any():
        raise InputError("--observers: found nobody with a predictive update, allowed: such observers, of whom a design is to tell")
    rows, curvature, x = (np.stack(parts) for parts in zip(*(_of_one(model, pairs, *one, prior) for _, one in some), strict=True))
    places = {name: i for i, name in enumerate(model.coordinates)}
    pull, at = MAX_PULL * expit(x[:, places["logit_pull"]]), places["logit_pull"]
    spread = float(np.var(prior_draws(model, prior, 0.0)["pull"]))
    rows[:, :, at] /= (pull * (1.0 - pull / MAX_PULL))[:, None]
    curvature[:, at], curvature[:, :, at] = 0.0, 0.0
    curvature[:, at, at] = 1.0 / spread
    interest = tuple(places[name] for name in _INTEREST)
    return Information(aim, rows, curvature, _direction(aim, x, pull, places), pull, updates, spread, interest)


def _quantities(observer: Observer) -> tuple[dict[str, float], float, float] | None:
    """An observer as the model has them, with centre and reference interval; None for those who are too different."""
    known = observer.quantities
    parts = {"lapse_rate": SMALL_LAPSES, "noise_slope": 0.0} | {
        name: known[name] for name in ("lapse_rate", "noise_slope") if name in known
    }
    if observer.kind == UPDATE:
        shared = {name: known[name] for name in ("mu1", "sigma_p", "sigma_l", "q0") if name in known}
        return ({**shared, **parts}, observer.centre, observer.interval) if len(shared) == 4 else None
    if not {"width", "q0"} <= known.keys():
        return None
    values = {"pull": SMALL_PULL, "offset": known.get("offset", 0.0), "width": known["width"], "q0": known["q0"]}
    return {**natural_of(values, observer.centre), **parts}, observer.centre, observer.interval


def _of_one(
    model: Model, pairs: StudyDesign, quantities: Mapping[str, float], centre: float, interval: float, prior: Prior
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rows of one observer of these quantities, curvature of the prior there, and the point."""
    size = pairs.n_pairs
    one = np.ones((size, 1), np.int64)
    isi = None if pairs.isi is None else pairs.isi[:, None]
    crowd = Crowd(pairs.s1[:, None], pairs.s2[:, None], one, one, isi)
    target = Posterior(cast(Subject, crowd), model, prior, centre, interval)
    x = target.points({name: np.array([value]) for name, value in quantities.items()})
    value, gradient = target.likelihood_gradient(np.repeat(x, size, axis=0))
    log_different = target.log_answers(np.repeat(x, size, axis=0))[1][:, 0]
    single = Posterior(Subject.from_counts("prior", [0.0], [0.0], [0], [1]), model, prior, centre, interval)
    curvature = -hessian(single.prior_gradient, x)[0]
    values, vectors = np.linalg.eigh(curvature)
    bent = (vectors * np.maximum(values, 0.0)) @ vectors.T  # where a prior bends upward it holds nothing
    return gradient * np.exp(0.5 * (value - log_different))[:, None], bent, x[0]


def _direction(aim: str, x: FloatArray, pull: FloatArray, places: dict[str, int]) -> FloatArray:
    """Gradient of the wanted quantity: in the coordinates of the model, but for the pull itself."""
    found = np.zeros_like(x)
    if aim == "width":
        found[:, places["log_width"]] = 1.0
    elif aim == "mu1":
        offset = x[:, places["offset"]]
        found[:, places["offset"]] = 1.0 / pull
        found[:, places["logit_pull"]] = -offset / np.square(pull)
    else:
        found[:, places["logit_pull"]] = 1.0
    return found


# --- Exchange -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Task:
    """What is exchanged: trials to distribute beside those that are `fixed`, by pair, and how many different pairs there may be in all."""

    information: Information
    trials: int
    most: int
    fixed: IntArray

    @property
    def portion(self) -> int:
        """Trials that move together."""
        return max(1, self.trials // (_PORTIONS * self.most))

    @property
    def portions(self) -> int:
        """Of which there are so many; a few trials may be left over."""
        return self.trials // self.portion


def built(task: Task) -> IntArray:
    """Portions by pair, one after the other put where it tells most, shape (pairs,)."""
    counts = np.zeros_like(task.fixed)
    for _ in range(task.portions):
        _put(task, counts)
    return counts


def exchanged(task: Task, counts: IntArray) -> IntArray:
    """Portions by pair after moves that each raise the score, until none does; never worse than before."""
    found = counts.copy()
    value = task.information.score(task.information.total((found * task.portion + task.fixed).astype(np.float64)))
    for _ in range(_SWEEPS):
        before = value
        for place in np.flatnonzero(found):
            for _ in range(int(found[place])):
                found[place] -= 1
                at, moved = _put(task, found)
                if moved < value + _GAIN:
                    found[at] -= 1
                    found[place] += 1
                    break  # those that are left there are alike
                value = moved
        if value <= before + _GAIN:
            break
    return found


def trials_of(task: Task, counts: IntArray) -> IntArray:
    """Trials of every pair: portions, those that stay, and what is left over one by one where it tells most."""
    found = counts * task.portion + task.fixed
    for _ in range(task.trials - int(counts.sum()) * task.portion):
        gains = task.information.with_more(task.information.total(found.astype(np.float64)), 1.0)
        found[int(np.where(found > 0, gains, -np.inf).argmax())] += 1
    return found


def _put(task: Task, counts: IntArray) -> tuple[int, float]:
    """Put one portion where it tells most: the place, and the score then."""
    trials = (counts * task.portion + task.fixed).astype(np.float64)
    gains = task.information.with_more(task.information.total(trials), float(task.portion))
    if np.count_nonzero(trials) >= task.most:
        gains = np.where(trials > 0, gains, -np.inf)
    at = int(gains.argmax())
    counts[at] += 1
    return at, float(gains[at])
