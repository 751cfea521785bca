"""How the time of the whole route grows with distinct pairs and with trials."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

import bayes_toe as bt
from bayes_toe.experiments.simulate import reference_design
from bayes_toe.inference.adaptation import adapt_proposal
from bayes_toe.inference.modes import find_maxima
from bayes_toe.inference.sampling import SamplerSettings, sample_chains
from bayes_toe.seeds import generator
from speed.counting import Counting

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = (
    "axis",
    "pairs",
    "trials",
    "runs",
    "maxima_s",
    "fit_s",
    "chains_s",
    "total_s",
    "evaluations",
    "ns_per_evaluation_and_pair",
    "efficiency",
    "smallest_ess",
    "converged",
)
PAIRS, TRIALS = (13, 100, 1000, 10_000), tuple(10**k for k in range(2, 9))
_PER_PAIR, _DRAWS = 10, 4000
_SLOW_S = 5.0  # a point that took longer is measured once
_GRIDS = {100: (10, 10), 1000: (25, 40), 10_000: (100, 100)}


@dataclass(frozen=True)
class Timing:
    """One run of the route: seconds of its three stages, and what came of it."""

    maxima_s: float
    fit_s: float
    chains_s: float
    evaluations: int
    efficiency: float
    smallest_ess: float
    converged: bool

    @property
    def total_s(self) -> float:
        """Seconds from the counts to the draws."""
        return self.maxima_s + self.fit_s + self.chains_s


def scaling(seed: int, *, runs: int = 5, shrink: int = 1) -> pd.DataFrame:
    """Time every size; the largest ones are left out by a factor of shrink."""
    import pandas as pd

    rows = []
    for axis, subject in _subjects(shrink):
        timings = [_timed(subject, seed)]
        while len(timings) < runs and timings[0].total_s < _SLOW_S:
            timings.append(_timed(subject, seed + len(timings)))
        rows.append(_row(axis, subject, timings))
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _subjects(shrink: int) -> Iterator[tuple[str, bt.Subject]]:
    for pairs in PAIRS:
        if pairs * shrink <= PAIRS[-1]:
            yield "pairs", _subject(pairs, _PER_PAIR * pairs)
    for trials in TRIALS:
        if trials * shrink**2 <= TRIALS[-1]:
            yield "trials", _subject(13, trials)


def _subject(pairs: int, trials: int) -> bt.Subject:
    """One ordinary observer; expected counts, rounded by a golden-ratio sequence."""
    if pairs == 13:
        design = reference_design()
        s1, s2 = design.s1, design.s2
    else:
        sides = (np.linspace(0.0, 0.6, size) for size in _GRIDS[pairs])
        s1, s2 = (side.ravel() for side in np.meshgrid(*sides, indexing="ij"))
    n = trials // pairs + (np.arange(pairs) < trials % pairs)
    q = bt.model.equal_probability(s1, s2, mu1=-0.5, sigma_p=0.25, sigma_l=0.14, q0=0.9)
    rounding = (np.arange(pairs) * (np.sqrt(5.0) - 1.0) / 2.0) % 1.0
    return bt.Subject(f"{pairs} pairs, {trials} trials", s1, s2, np.floor(q * n + rounding).astype(np.int64).clip(0, n), n)


def _timed(subject: bt.Subject, seed: int) -> Timing:
    posterior = Counting(bt.posterior_of(subject))
    clock = [time.perf_counter()]
    maxima = find_maxima(posterior)
    clock.append(time.perf_counter())
    fitted = adapt_proposal(posterior, generator(seed, subject.name, "proposal"), start=maxima)
    clock.append(time.perf_counter())
    chains = sample_chains(fitted, SamplerSettings(draws=_DRAWS), seed)
    clock.append(time.perf_counter())
    smallest = min(min(found.ess_bulk, found.ess_tail) for found in chains.diagnostics.values())
    return Timing(*np.diff(clock).tolist(), posterior.evaluations, fitted.efficiency, smallest, chains.converged)


def _row(axis: str, subject: bt.Subject, timings: list[Timing]) -> dict[str, object]:
    keys = ("maxima_s", "fit_s", "chains_s", "total_s", "evaluations", "efficiency", "smallest_ess")
    row: dict[str, object] = {"axis": axis, "pairs": subject.n_pairs, "trials": subject.total_trials, "runs": len(timings)}
    row |= {key: median(getattr(timing, key) for timing in timings) for key in keys}
    work = [timing.total_s / timing.evaluations / subject.n_pairs for timing in timings]
    return row | {"ns_per_evaluation_and_pair": 1e9 * median(work), "converged": sum(t.converged for t in timings) / len(timings)}
