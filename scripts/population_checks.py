"""Is the Bayes factor of a group's mean calibrated? Simulated studies, half of the means being 0.

    python scripts/population_checks.py --studies 80

A simulated study has ten subjects who answer which of two stimuli is stronger: ten ordered pairs of
neighbours of six levels 0.25 apart, 40 or 200 trials a subject. The noise is 0.8 D exp(Normal(0,
0.35)); with probability 1/2 each, the lapse rate is Beta(2, 14) and the noise slope Normal(-0.1,
0.25)/R, otherwise 0. A study takes about 4 s of CPU. The output has the expected calibration error
of the probabilities that a mean is 0, and its p-value, as docs/calibration_order.md explains.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd
from reference.calibration_statistics import judge_probabilities
from reference.pages import number_parser

import bayes_toe as bt
from bayes_toe.design.study_design import StudyDesign

STEP, N_SUBJECTS = 0.25, 10
LEVELS = STEP * np.arange(6)
LOW, HIGH = LEVELS[:-1], LEVELS[1:]
S1, S2 = np.append(LOW, HIGH), np.append(HIGH, LOW)


def simulated_study(
    mean: np.ndarray, sd: tuple[float, float], n_trials: int, seed: int
) -> bt.Study:
    """Ten subjects of a group with these means and SDs of c, in D, and of p."""
    rng = np.random.default_rng([4, seed])
    design = StudyDesign(S1, S2, np.full(len(S1), n_trials // len(S1)), task="2afc")
    c, p = rng.normal(mean, sd, (N_SUBJECTS, 2)).T
    has_lapses, has_slope = rng.integers(2, size=(2, N_SUBJECTS))
    columns = {
        "constant_error": STEP * c,
        "contraction": p,
        "noise": 0.8 * STEP * np.exp(rng.normal(0.0, 0.35, N_SUBJECTS)),
        "lapse_rate": rng.beta(2, 14, N_SUBJECTS) * has_lapses,
        "noise_slope": rng.normal(-0.1, 0.25, N_SUBJECTS) / S1.std() * has_slope,
    }
    names = [f"S{i}" for i in range(N_SUBJECTS)]
    observers = pd.DataFrame(columns, index=names).to_dict("index")
    return bt.simulate(observers, design=design, task="2afc", seed=seed).study


def analysed_means(n_studies: int) -> Iterator[tuple[float, bool]]:
    """The log odds that a mean is 0, and whether it is; half of the means are 0.

    A result that is not reliable counts, with a warning.
    """
    for i in range(n_studies):
        rng = np.random.default_rng([3, i])
        is_zero = rng.uniform(size=2) < 0.5
        mean = np.where(is_zero, 0.0, (0.5 * rng.standard_t(3), rng.normal(0.0, 0.2)))
        sd, n_trials = ((0.1, 0.05), 40) if i % 2 == 0 else ((0.5, 0.15), 200)
        table = bt.population(simulated_study(mean, sd, n_trials, i), seed=i).table
        for name, zero in zip(("constant_error", "contraction"), is_zero.tolist(), strict=True):
            yield table.row("mean", name).ln_bf_zero, zero


def main() -> None:
    """Simulate studies, and judge the probabilities that their means are 0."""
    options = number_parser(__doc__, studies=80).parse_args()
    log_odds, is_zero = zip(*analysed_means(options.studies), strict=True)
    print(pd.Series(judge_probabilities(log_odds, is_zero, np.random.default_rng(1))))


if __name__ == "__main__":
    main()
