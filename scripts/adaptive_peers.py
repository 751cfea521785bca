"""Adaptive sessions of bayes_toe, questplus and ADOpy side by side: the same observers, pairs and numbers of trials.

    python scripts/adaptive_peers.py --observers 10 --trials 150 -o docs/adaptive_peers.csv --seed 1

The other two work on a grid of the four parameters of the update and know no such model: questplus is given the probabilities of its
answers in the place of one of its own functions, ADOpy is given the model. What each has chosen is judged alike: the posterior of its
answers by the particles of `bt.Adaptive` under the program's prior. Times are those of choosing a pair and taking in an answer.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import bayes_toe as bt
from bayes_toe.data.tables import write_table
from bayes_toe.model.closed_form import equal_probability
from bayes_toe.planning.observers import Observer, observers_from, of_kind
from bayes_toe.planning.study_design import StudyDesign
from bayes_toe.seeds import generator

LEVELS = np.round(np.arange(-0.75, 1.26, 0.2), 10)
#: A grid of the parameters around whom observers may be: no true value is on it.
GRID = {
    "mu1": np.linspace(-0.3, 1.1, 10),
    "pull": np.linspace(0.02, 0.37, 8),
    "width": np.geomspace(0.15, 0.6, 8),
    "q0": np.linspace(0.7, 0.99, 6),
}
NAMES = ("gain", "mu1", "width", "q0")


def p_equal(s1: Any, s2: Any, mu1: Any, pull: Any, width: Any, q0: Any) -> Any:
    """P(equal) of the update by gain and width."""
    gain = 1.0 - np.asarray(pull)
    sigma_p = width * gain**1.5
    return equal_probability(s1, s2, mu1, sigma_p, sigma_p * np.sqrt(pull) / gain, q0)


def pairs() -> list[tuple[float, float]]:
    """Every ordered pair of levels."""
    return [(float(a), float(b)) for a in LEVELS for b in LEVELS]


class Ours:
    """bt.Adaptive."""

    name = "bayes_toe"

    def __init__(self, seed: int) -> None:
        self.session = bt.Adaptive(pairs(), seed=seed)

    def next(self) -> tuple[float, float]:
        """The next pair."""
        first, second = self.session.next()
        return first, second

    def answer(self, pair: tuple[float, float], equal: bool) -> None:
        """Take in an answer."""
        self.session.answer(pair, equal)

    def means(self) -> dict[str, float]:
        """Estimates: posterior medians."""
        return {name: self.session.quantiles(name)[1] for name in NAMES}


class Quest:
    """Questplus, with its likelihood replaced."""

    name = "questplus"

    def __init__(self, seed: int) -> None:
        import questplus
        import xarray as xr

        class Equal(questplus.QuestPlus):
            def _gen_likelihoods(self) -> xr.DataArray:
                axes = np.meshgrid(LEVELS, LEVELS, *GRID.values(), indexing="ij", sparse=True)
                q = p_equal(*axes)
                return xr.DataArray(
                    np.stack([q, 1.0 - q]),
                    dims=("response", *self.stim_domain, *self.param_domain),
                    coords={"response": ["equal", "different"], **self.stim_domain, **self.param_domain},
                )

        self.quest = Equal(
            stim_domain={"s1": LEVELS, "s2": LEVELS}, param_domain=GRID, outcome_domain={"response": ["equal", "different"]},
            func="norm_cdf", stim_scale="linear",
        )  # fmt: skip

    def next(self) -> tuple[float, float]:
        """The next pair."""
        stimulus = self.quest.next_stim
        return float(stimulus["s1"]), float(stimulus["s2"])

    def answer(self, pair: tuple[float, float], equal: bool) -> None:
        """Take in an answer."""
        self.quest.update(stim={"s1": pair[0], "s2": pair[1]}, outcome={"response": "equal" if equal else "different"})

    def means(self) -> dict[str, float]:
        """Estimates: posterior means on the grid."""
        return _by_gain(self.quest.param_estimate)


class Ado:
    """ADOpy."""

    name = "ADOpy"

    def __init__(self, seed: int) -> None:
        for word, kind in (("int", int), ("float", float), ("bool", bool), ("object", object), ("str", str)):
            if word not in np.__dict__:
                setattr(np, word, kind)  # its release is older than NumPy 1.24, which dropped these names
        from adopy import Engine, Model, Task

        def log_likelihood(choice: Any, s1: Any, s2: Any, mu1: Any, pull: Any, width: Any, q0: Any) -> Any:
            q = p_equal(s1, s2, mu1, pull, width, q0)
            return np.where(choice == 1, np.log(q), np.log1p(-q))

        task = Task(name="pairs", designs=["s1", "s2"], responses=["choice"])
        model = Model(name="update", task=task, params=list(GRID), func=log_likelihood)
        self.engine = Engine(task, model, {"s1": LEVELS, "s2": LEVELS}, GRID, {"choice": [0, 1]})

    def next(self) -> tuple[float, float]:
        """The next pair."""
        design = self.engine.get_design("optimal")
        return float(design["s1"]), float(design["s2"])

    def answer(self, pair: tuple[float, float], equal: bool) -> None:
        """Take in an answer."""
        self.engine.update({"s1": pair[0], "s2": pair[1]}, {"choice": int(equal)})

    def means(self) -> dict[str, float]:
        """Estimates: posterior means on the grid."""
        return _by_gain(dict(zip(GRID, self.engine.post_mean, strict=True)))


class Chance(Ours):
    """Pairs at random, for what choosing is worth."""

    name = "random pairs"

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self.rng = generator(seed, "chance")

    def next(self) -> tuple[float, float]:
        """A pair at random."""
        every = pairs()
        return every[int(self.rng.integers(len(every)))]


def _by_gain(found: dict[str, Any]) -> dict[str, float]:
    values = {name: float(value) for name, value in found.items()}
    return {"gain": 1.0 - values["pull"], **{name: values[name] for name in NAMES[1:]}}


def truth(observer: Observer) -> dict[str, float]:
    """What estimates should be."""
    target = observer.target(StudyDesign([0.0], [0.0], [1]).unanswered)
    found = target.quantities(observer.point(target))
    return {name: float(found[name][0]) for name in NAMES}


def played(kind: Callable[[int], Any], observer: Observer, trials: int, seed: int) -> dict[str, object]:
    """One session of one program with one observer."""
    begun = time.perf_counter()
    program = kind(seed)
    setup, spent, answers = time.perf_counter() - begun, [], []
    rng = generator(seed, observer.name, "answers")
    for _ in range(trials):
        start = time.perf_counter()
        pair = program.next()
        chosen = time.perf_counter()
        equal = bool(rng.uniform() < observer.equal(StudyDesign([pair[0]], [pair[1]], [1]))[0])
        said = time.perf_counter()
        program.answer(pair, equal)
        spent.append(1000.0 * (time.perf_counter() - said + chosen - start))
        answers.append((pair, equal))
    judge = bt.Adaptive(pairs(), seed=seed)
    for pair, equal in answers:
        judge.answer(pair, equal)
    sizes = {name: float(np.ptp(judge.quantiles(name))) for name in NAMES}
    own, true = program.means(), truth(observer)
    return {
        "program": program.name, "observer": observer.name, "trials": trials, "setup_s": setup,
        "median_ms": float(np.median(spent)), "p95_ms": float(np.quantile(spent, 0.95)), "largest_ms": float(np.max(spent)),
        **{f"width_90_{name}": sizes[name] for name in NAMES},
        "log_volume": float(np.log(list(sizes.values())).sum()),
        **{f"error_{name}": own[name] - true[name] for name in NAMES},
    }  # fmt: skip


def rows(observers: int, trials: int, seed: int) -> Iterator[dict[str, object]]:
    """Every program with every observer."""
    for observer in of_kind(observers_from(None, observers, seed), "update"):
        for kind in (Ours, Quest, Ado, Chance):
            yield played(kind, observer, trials, seed)


def main() -> None:
    """Play, write, print means."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--observers", type=int, default=10)
    parser.add_argument("--trials", type=int, default=150)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path, required=True)
    asked = parser.parse_args()
    table = pd.DataFrame(rows(asked.observers, asked.trials, asked.seed))
    write_table(table, asked.output, overwrite=True)
    print(table.drop(columns=["observer", "trials"]).groupby("program", sort=False).mean().T.round(3).to_string())


if __name__ == "__main__":
    main()
