#!/usr/bin/env python3
"""Compare the processor time of the verbs in two checkouts, in alternating pairs of one run.

    scripts/compare_speed.py ../other_checkout                # every verb, three pairs each
    scripts/compare_speed.py ../other_checkout --pairs 7 --verbs evidence fit

Each measurement is a process of its own. It imports the package of one checkout and runs a verb on
some subjects of the bundled example, with one worker and one BLAS thread. The time is that
of the processor, without imports. A ratio above 1 says that this checkout needs more time.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
CALLS = {
    "evidence": "bt.evidence(study, seed=1, workers=1)",
    "sample": "bt.sample(study, seed=1, workers=1)",
    "fit": "bt.fit(study, seed=1, workers=1)",
    "population": "bt.population(study, seed=1)",
    "run": "bt.run(study, draws=1000, seed=1, workers=1)",
}
PROGRAM = """
import time
import bayes_toe as bt
example = bt.example_study()
study = example.select(list(example.names)[:{subjects}])
bt.evidence(example.select([example.names[0]]), seed=1, workers=1)  # loads what is loaded late
start = time.process_time()
{call}
print(time.process_time() - start)
"""


def processor_seconds(checkout: Path, verb: str, n_subjects: int) -> float:
    """Processor time of a verb of the package of a checkout, seconds."""
    program = PROGRAM.format(call=CALLS[verb], subjects=n_subjects)
    one_thread = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    output = subprocess.check_output(
        [sys.executable, "-c", program],
        cwd=checkout,
        env={**os.environ, "PYTHONPATH": str(checkout), **one_thread},
        text=True,
    )
    return float(output.splitlines()[-1])


def main() -> None:
    """Print a row per verb: median times of both checkouts, and the ratio of each pair."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("other", type=Path, help="a checkout to compare with")
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--subjects", type=int, default=6)
    parser.add_argument("--verbs", nargs="+", choices=list(CALLS), default=list(CALLS))
    options = parser.parse_args()
    checkouts = (ROOT, options.other.resolve(strict=True))
    print(f"{'verb':<11}{'this, s':>9}{'other, s':>10}  this / other")
    for verb in options.verbs:
        times = []
        for _ in range(options.pairs):
            times.append([processor_seconds(path, verb, options.subjects) for path in checkouts])
        this_times, other_times = np.transpose(times)
        medians = f"{np.median(this_times):9.2f}{np.median(other_times):10.2f}"
        ratios = np.array2string(this_times / other_times, precision=2)
        print(f"{verb:<11}{medians}  {ratios}", flush=True)


if __name__ == "__main__":
    main()
