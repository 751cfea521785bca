#!/usr/bin/env python3
"""Compare the processor time of the verbs in two checkouts, in alternating pairs of one run.

    scripts/compare_speed.py ../other_checkout                # every verb, three pairs each
    scripts/compare_speed.py ../other_checkout --pairs 7 --verbs evidence fit

Each measurement is a process of its own. It imports the package of one checkout and runs a verb on
some subjects of the bundled example, with one worker and one BLAS thread. The time is that
of the processor, without imports. A ratio above 1 says that this checkout needs more time.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from reference.pages import number_parser

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


ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def processor_seconds(checkout: Path, program: str) -> float:
    """Processor time of a program with the package of a checkout, seconds."""
    environment = {**os.environ, **ONE_THREAD, "PYTHONPATH": str(checkout)}
    command = [sys.executable, "-c", program]
    output = subprocess.check_output(command, cwd=checkout, env=environment, text=True)
    return float(output.splitlines()[-1])


def main() -> None:
    """Print a row per verb: median times of both checkouts, and the ratio of each pair."""
    parser = number_parser(__doc__, pairs=3, subjects=6)
    parser.add_argument("other", type=Path, help="a checkout to compare with")
    parser.add_argument("--verbs", nargs="+", choices=list(CALLS), default=list(CALLS))
    options = parser.parse_args()
    checkouts = [ROOT, options.other.resolve(strict=True)]
    print(f"{'verb':<11}{'this, s':>9}{'other, s':>10}  this / other")
    for verb in options.verbs:
        program = PROGRAM.format(call=CALLS[verb], subjects=options.subjects)
        times = [processor_seconds(path, program) for path in options.pairs * checkouts]
        this, other = np.reshape(times, (-1, 2)).T
        ratios = " ".join(map("{:.2f}".format, this / other))
        print(f"{verb:<11}{np.median(this):9.2f}{np.median(other):10.2f}  {ratios}", flush=True)


if __name__ == "__main__":
    main()
