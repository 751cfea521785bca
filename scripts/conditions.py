"""Conditions within subjects: the numbers of docs/validation.md.

    python scripts/conditions.py --number 24 --seed 1

In simulated subjects nothing or one quantity differs. The table counts subjects with a Bayes
factor above 3 for a difference.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from reference.pages import number_parser

import bayes_toe as bt
from bayes_toe.design.study_design import StudyDesign

#: The pairs of simulated subjects; D is STEP.
STEP = 0.3
PAIRS = np.array([(a, a + step) for a in np.linspace(0.0, 1.5, 6) for step in (-STEP, STEP)])
DESIGN = StudyDesign(*PAIRS.T, np.full(len(PAIRS), 50), task="2afc")
#: What differs between the two conditions of simulated subjects.
DIFFERENCES = {
    "nothing": {},
    "constant error, by D/4": {"constant_error": STEP / 4},
    "contraction, by 0.17": {"contraction": 0.17},
    "JND, by 0.3 of its log": {"noise": 0.3},
}


def main() -> None:
    """Simulate subjects, compare their conditions, print the counts."""
    options = number_parser(__doc__, number=24, seed=1).parse_args()
    rng = np.random.default_rng(options.seed)
    scores = pd.DataFrame(
        rng.standard_normal((options.number, 3)),
        columns=["constant_error", "contraction", "noise"],
        index=[f"O{i:02d}" for i in range(options.number)],
    )
    parameters = scores * [0.06, 0.1, 0.2] + [0.0, 0.24, np.log(0.3)]
    parameters["noise"] = np.exp(parameters["noise"])
    parameters["lapse_rate"] = 0.04
    observers = parameters.to_dict("index")

    counts = {}
    for label, differ in DIFFERENCES.items():
        settings = {"design": DESIGN, "task": "2afc", "seed": options.seed}
        study, _ = bt.simulate(observers, conditions=("a", "b"), differ=differ, **settings)
        table = bt.contrast(study, seed=options.seed, workers=1).frame(full=True)
        is_different = table["log_bf_differs"].astype(float) > np.log(3.0)
        counts[label] = is_different.groupby(table["quantity"], sort=False).sum()
    print(pd.DataFrame(counts).T)


if __name__ == "__main__":
    main()
