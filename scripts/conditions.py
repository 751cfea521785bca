"""Conditions within subjects: the numbers of docs/validation.md.

    python scripts/conditions.py --number 24 --seed 1

In simulated subjects nothing or one quantity differs. A line is printed as soon as it is known.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np
import pandas as pd
from scipy.special import ndtr

import bayes_toe as bt
from bayes_toe.answers.contrast import ContrastTable

#: The pairs of simulated subjects; D is STEP.
STEP = 0.3
PAIRS = np.array([(a, a + step) for a in np.linspace(0.0, 1.5, 6) for step in (-STEP, STEP)])
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


def simulated(number: int, trials: int, seed: int) -> Iterator[tuple[str, bt.Study]]:
    """Studies of single subjects in two conditions, with so many trials in each."""
    for label, difference in DIFFERENCES.items():
        rng = np.random.default_rng([seed, trials])
        rows: list[pd.DataFrame] = []
        for i in range(number):
            middle = TYPICAL + SCATTER * rng.standard_normal(3)
            for level, side in (("a", -0.5), ("b", 0.5)):
                truth = middle + side * np.array(difference)
                answers = simulated_answers(*truth, trials, rng)
                rows.append(answers.assign(subject=f"O{i:02d}", condition=level))
        yield f"{label}, {trials} trials a condition", bt.read_study(pd.concat(rows))


def simulated_answers(
    constant_error: float,
    contraction: float,
    log_noise: float,
    trials: int,
    rng: np.random.Generator,
) -> pd.DataFrame:
    """Counts of 'which is stronger' of every pair."""
    s1, s2 = PAIRS.T
    shift = contraction * (s1 - s1.mean()) - constant_error
    p_second = ndtr((s2 - s1 + shift) / np.exp(log_noise))
    p_second = LAPSE_RATE / 2 + (1 - LAPSE_RATE) * p_second
    n_trials = trials // len(s1)
    n_second = rng.binomial(n_trials, p_second)
    return pd.DataFrame({"s1": s1, "s2": s2, "n_second": n_second, "n_trials": n_trials})


def print_counts(label: str, table: ContrastTable) -> None:
    """How many subjects have which Bayes factor."""
    rows = table.frame(full=True)
    log_bf = rows["log_bf_differs"].astype(float)
    counts = rows.assign(
        above_3=log_bf > np.log(3.0),
        above_20=log_bf > np.log(20.0),
        below_third=log_bf < -np.log(3.0),
        not_robust=rows["robust"] == "no",
    ).groupby("quantity", sort=False)
    sums = counts[["above_3", "above_20", "below_third", "not_robust"]].sum()
    print(label, sums.join(counts[["mean", "sd"]].mean()).round(3), sep="\n", flush=True)


def main() -> None:
    """Simulate subjects, compare their conditions, print the counts."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--number", type=int, default=30, help="simulated subjects a line")
    parser.add_argument("--trials", type=int, default=600, help="of a simulated condition")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    for label, study in simulated(asked.number, asked.trials, asked.seed):
        print_counts(label, bt.contrast(study, seed=asked.seed, workers=1))


if __name__ == "__main__":
    main()
