"""How long studies of many subjects take to be read, and one subject with many pairs to its evidence.

Times are those of one processor, best of a few repeats; the ratio is to the row before, with that of the sizes beside it: they are equal
where the time grows as the size does. Memory is the largest that this process has had so far.

Example: python scripts/reading_speed.py --subjects 1000,10000,100000 --pairs 13,100,1000,10000
"""

import argparse
import platform
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

import bayes_toe as bt
from bayes_toe.data.tables import write_table
from bayes_toe.model.closed_form import equal_probability

SEED, PAIRS_OF_EACH, TRIALS_OF_EACH = 1, 5, 10
_OBSERVER = {"mu1": 0.1, "sigma_p": 0.2, "sigma_l": 0.1, "q0": 0.93}


def counts(subjects: int) -> pd.DataFrame:
    """A row for each of five pairs of every subject."""
    rng, rows = np.random.default_rng(SEED), subjects * PAIRS_OF_EACH
    trials = rng.integers(1, 50, rows)
    names = np.repeat([f"S{i:06d}" for i in range(subjects)], PAIRS_OF_EACH)
    first, second = np.round(0.05 * rng.integers(0, 10, rows), 2), np.tile(0.05 * np.arange(PAIRS_OF_EACH), subjects)
    return pd.DataFrame({"subject": names, "s1": first, "s2": second, "n_equal": rng.binomial(trials, 0.5), "n_trials": trials})


def trials(subjects: int) -> pd.DataFrame:
    """A row for each of ten trials of every subject, with block and trial."""
    rng, rows = np.random.default_rng(SEED), subjects * TRIALS_OF_EACH
    names, number = np.repeat([f"S{i:06d}" for i in range(subjects)], TRIALS_OF_EACH), np.tile(np.arange(TRIALS_OF_EACH), subjects)
    s1, s2 = (np.round(0.05 * rng.integers(0, 5, rows), 2) for _ in range(2))
    answers = np.array(["different", "equal"])[rng.integers(0, 2, rows)]
    return pd.DataFrame({"subject": names, "s1": s1, "s2": s2, "response": answers, "block": number // 5, "trial": number})


def subject(pairs: int) -> bt.Subject:
    """One subject with ten trials of each of so many pairs."""
    rng = np.random.default_rng(SEED)
    s1 = rng.normal(0.0, 0.4, pairs)
    s2 = s1 + rng.normal(0.0, 0.3, pairs)
    return bt.Subject("S01", s1, s2, rng.binomial(TRIALS_OF_EACH, equal_probability(s1, s2, **_OBSERVER)), np.full(pairs, TRIALS_OF_EACH))


def seconds(work: Callable[[], object], repeats: int) -> float:
    """Processor time, the best of some repeats."""
    times = []
    for _ in range(repeats):
        before = time.process_time()
        work()
        times.append(time.process_time() - before)
    return min(times)


def report(what: str, sizes: Sequence[int], work_at: Callable[[int], Callable[[], object]], repeats: int) -> None:
    """A line for each size."""
    before: tuple[int, float] | None = None
    for size in sizes:
        took = seconds(work_at(size), repeats)
        ratio = "" if before is None else f"{took / before[1]:6.1f} x for {size / before[0]:g} x"
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e3 if sys.platform != "darwin" else 1e6)
        print(f"{what:<34}{size:>9}{took:>10.3f} s  {memory:7.0f} MB  {ratio}", flush=True)
        before = size, took


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--subjects", default="1000,10000,100000", help="sizes of studies that are read")
    parser.add_argument("--pairs", default="13,100,1000,10000", help="sizes of a subject that gets its evidence")
    parser.add_argument("--suffix", default=".csv", choices=[".csv", ".parquet"])
    parser.add_argument("--repeats", type=int, default=2)
    options = parser.parse_args()
    subjects, pairs = ([int(size) for size in sizes.split(",") if size] for sizes in (options.subjects, options.pairs))
    print(f"{platform.processor() or platform.machine()}, Python {platform.python_version()}, NumPy {np.__version__}")
    bt.evidence(bt.Study([subject(5)]), seed=SEED, workers=1)  # what is imported on the way is not counted
    with threadpool_limits(1), tempfile.TemporaryDirectory() as folder:

        def reading(made: Callable[[int], pd.DataFrame]) -> Callable[[int], Callable[[], object]]:
            def at(size: int) -> Callable[[], object]:
                path = write_table(made(size), Path(folder, f"study{options.suffix}"), overwrite=True)
                return partial(bt.read_study, path)

            return at

        report(f"{PAIRS_OF_EACH} pairs a subject, subjects", subjects, reading(counts), options.repeats)
        report(f"{TRIALS_OF_EACH} trials a subject, subjects", subjects, reading(trials), options.repeats)
        report(
            "evidence of one subject, pairs", pairs, lambda size: lambda: bt.evidence(bt.Study([subject(size)]), seed=SEED, workers=1), 1
        )


if __name__ == "__main__":
    main()
