"""Conditions within subjects: the numbers of docs/validation.md.

    python scripts/conditions.py --number 24 --seed 1

In simulated subjects nothing or one quantity differs. The table counts subjects with a Bayes
factor above 3 for a difference.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd
from reference.pages import number_parser

import bayes_toe as bt
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.design.observers import make_observer
from bayes_toe.design.study_design import StudyDesign

#: The pairs of simulated subjects; D is STEP.
STEP = 0.3
PAIRS = np.array([(a, a + step) for a in np.linspace(0.0, 1.5, 6) for step in (-STEP, STEP)])
DESIGN = StudyDesign(*PAIRS.T, np.full(len(PAIRS), 50), task=WHICH_STRONGER)
#: Constant error, contraction and log noise of a simulated subject, and how far subjects scatter.
TYPICAL, SCATTER = np.array([0.0, 0.24, np.log(0.3)]), np.array([0.06, 0.1, 0.2])
LAPSE_RATE = 0.04
#: What differs between the two conditions of simulated subjects.
DIFFERENCES = {
    "nothing": (0.0, 0.0, 0.0),
    "constant error, by D/4": (STEP / 4, 0.0, 0.0),
    "contraction, by 0.17": (0.0, 0.17, 0.0),
    "JND, by 0.3 of its log": (0.0, 0.0, 0.3),
}


def simulated(number: int, seed: int) -> Iterator[tuple[str, bt.Study]]:
    """Studies of single subjects in two conditions."""
    for label, difference in DIFFERENCES.items():
        rng = np.random.default_rng([seed, DESIGN.total])
        rows: list[pd.DataFrame] = []
        for i in range(number):
            middle = TYPICAL + SCATTER * rng.standard_normal(3)
            for condition, side in (("a", -0.5), ("b", 0.5)):
                truth = middle + side * np.array(difference)
                n_second = rng.binomial(DESIGN.n_trials, p_second(*truth.tolist()))
                names = {"subject": f"O{i:02d}", "condition": condition}
                rows.append(DESIGN.frame().assign(n_second=n_second, **names))
        yield label, bt.read_study(pd.concat(rows))


def p_second(constant_error: float, contraction: float, log_noise: float) -> np.ndarray:
    """P('second') of every pair."""
    parameters = {
        "constant_error": constant_error,
        "contraction": contraction,
        "noise": float(np.exp(log_noise)),
        "lapse_rate": LAPSE_RATE,
    }
    return make_observer("O", "simulated", parameters, WHICH_STRONGER).p_design(DESIGN)[0]


def main() -> None:
    """Simulate subjects, compare their conditions, print the counts."""
    options = number_parser(__doc__, number=24, seed=1).parse_args()
    counts = {}
    for label, study in simulated(options.number, options.seed):
        table = bt.contrast(study, seed=options.seed, workers=1).frame(full=True)
        is_different = table["log_bf_differs"].astype(float) > np.log(3.0)
        counts[label] = is_different.groupby(table["quantity"], sort=False).sum()
    print(pd.DataFrame(counts).T)


if __name__ == "__main__":
    main()
