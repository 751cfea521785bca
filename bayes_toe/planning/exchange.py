"""Exchange: trials move, a portion at a time, to the pair where they tell most, until none is better off elsewhere (Fedorov 1972)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.planning.information import Information

#: Portions in which trials move, for each pair that a design may have.
_PORTIONS = 2
_SWEEPS, _GAIN = 30, 1e-7  # at most so often through all portions; by how much a move has to raise the score


@dataclass(frozen=True, eq=False)
class Task:
    """What is exchanged: trials in all, how many different pairs there may be, and trials that stay where they are.

    Attributes
    ----------
    information : Information
    trials : int
        To distribute, besides those that stay.
    most : int
        Pairs, with those that stay.
    fixed : array of int, shape (pairs,)
    """

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


def scattered(task: Task, rng: np.random.Generator) -> IntArray:
    """Portions on pairs at random, of those among which the information is large more often."""
    worth = task.information.worth(task.information.total(np.full(len(task.fixed), task.trials / len(task.fixed))))
    size = min(task.most - int((task.fixed > 0).sum()), len(worth))
    places = rng.choice(len(worth), size, replace=False, p=_even(worth))
    return np.bincount(np.resize(places, task.portions), minlength=len(worth))


def exchanged(task: Task, counts: IntArray) -> IntArray:
    """Portions by pair after moves that each raise the score, until none does; never worse than before."""
    found = counts.copy()
    value = _score(task, found)
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
        found[_best(np.where(found > 0, gains, -np.inf))] += 1
    return found


def _put(task: Task, counts: IntArray) -> tuple[int, float]:
    """Put one portion where it tells most: the place, and the score then."""
    trials = (counts * task.portion + task.fixed).astype(np.float64)
    gains = task.information.with_more(task.information.total(trials), float(task.portion))
    if np.count_nonzero(trials) >= task.most:
        gains = np.where(trials > 0, gains, -np.inf)
    at = _best(gains)
    counts[at] += 1
    return at, float(gains[at])


def _best(gains: FloatArray) -> int:
    return int(gains.argmax())


def _score(task: Task, counts: IntArray) -> float:
    return task.information.score(task.information.total((counts * task.portion + task.fixed).astype(np.float64)))


def _even(worth: FloatArray) -> FloatArray:
    """Probabilities from what pairs are worth; none is excluded."""
    some = worth - worth.min() + np.ptp(worth) / len(worth) + 1e-12
    return np.asarray(some / some.sum())
