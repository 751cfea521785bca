"""Is the Bayes factor of a group's mean calibrated? Simulated studies, half of the means being 0.

    python scripts/population_checks.py --studies 80

A simulated study has ten subjects who answer which of two stimuli is stronger: ten ordered pairs of
neighbours of six levels 0.25 apart, 40 or 200 trials a subject. The noise is 0.8 D exp(Normal(0,
0.35)); with probability 1/2 each, the lapse rate is Beta(2, 14) and the noise slope Normal(-0.1,
0.25)/R, otherwise 0. A study takes about 4 s of CPU.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import numpy as np
import pandas as pd
from reference.pages import number_parser
from scipy.special import expit

import bayes_toe as bt
from bayes_toe.design.study_design import StudyDesign

STEP, N_SUBJECTS = 0.25, 10
LEVELS = STEP * np.arange(6)
S1, S2 = np.append(LEVELS[:-1], LEVELS[1:]), np.append(LEVELS[1:], LEVELS[:-1])
LIMITS = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)


def simulated_study(
    mean: tuple[float, float], sd: tuple[float, float], n_trials: int, seed: int
) -> bt.Study:
    """Ten subjects of a group with these means and SDs of c, in D, and of p."""
    rng = np.random.default_rng([4, seed])
    design = StudyDesign(S1, S2, np.full(len(S1), n_trials // len(S1)), task="2afc")
    size = N_SUBJECTS
    c, p = rng.normal(mean, sd, (size, 2)).T
    columns = {
        "constant_error": STEP * c,
        "contraction": p,
        "noise": 0.8 * STEP * np.exp(rng.normal(0.0, 0.35, size)),
        "lapse_rate": rng.beta(2, 14, size) * rng.integers(2, size=size),
        "noise_slope": rng.normal(-0.1, 0.25, size) / S1.std() * rng.integers(2, size=size),
    }
    names = [f"S{i}" for i in range(size)]
    observers = pd.DataFrame(columns, index=names).to_dict("index")
    return bt.simulate(observers, design=design, task="2afc", seed=seed).study


def analysed_means(n_studies: int) -> Iterator[tuple[float, bool]]:
    """The probability that a mean is 0, and whether it is; half of the means are 0."""
    for i in range(n_studies):
        rng = np.random.default_rng([3, i])
        is_zero = rng.uniform(size=2) < 0.5
        mean_c, mean_p = np.where(is_zero, 0.0, (0.5 * rng.standard_t(3), rng.normal(0.0, 0.2)))
        sd, n_trials = ((0.1, 0.05), 40) if i % 2 == 0 else ((0.5, 0.15), 200)
        study = simulated_study((mean_c, mean_p), sd, n_trials, i)
        # A result that is not reliable is printed and counts.
        with warnings.catch_warnings(action="ignore", category=bt.ConvergenceWarning):
            result = bt.population(study, seed=i)
        print(*result.problems, sep="\n", end="", flush=True)
        for name, zero in zip(("constant_error", "contraction"), is_zero.tolist(), strict=True):
            yield float(expit(result.table.row("mean", name).ln_bf_zero)), zero


def main() -> None:
    """Simulate studies, and count how often a mean is 0 where the Bayes factor says so."""
    options = number_parser(__doc__, studies=80).parse_args()
    table = pd.DataFrame(analysed_means(options.studies), columns=["probability", "zero"])
    groups = table.groupby(pd.cut(table["probability"], LIMITS), observed=True)
    print(groups.agg(stated=("probability", "mean"), zeros=("zero", "sum"), means=("zero", "size")))


if __name__ == "__main__":
    main()
