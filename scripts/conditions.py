"""Conditions within subjects: the numbers of docs/validation.md.

    # real studies: delays, and splits in which nothing differs
    python scripts/conditions.py subjects [--data FOLDER]
    # simulated subjects: nothing or one quantity differs
    python scripts/conditions.py simulated --number 30
    python scripts/conditions.py group [--data FOLDER]        # the group by delay

FOLDER has auditory_pwm/trials.csv and vibrotactile_rate/trials.csv. A line is printed as soon as it
is known.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator
from pathlib import Path

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


def real(folder: Path) -> Iterator[tuple[str, bt.Study]]:
    """Each real study under the conditions that it is split by."""
    auditory, options = folder / "auditory_pwm" / "trials.csv", bt.ReadOptions(condition="isi")
    yield "auditory, delay 6 - 2 s", bt.read_study(auditory, options)
    trials = pd.read_csv(auditory, dtype={"subject": str}).drop(columns="isi")
    trials = trials[trials["response"].notna()]
    yield (
        "auditory, odd and even",
        bt.read_study(trials.assign(condition=np.where(trials["trial"] % 2, "odd", "even"))),
    )
    pulses = pd.read_csv(folder / "vibrotactile_rate" / "trials.csv", dtype={"subject": str})
    pulses["response"] = np.where(pulses["response"] == 1, "equal", "different")
    # These two most likely missed a swap of the buttons.
    for subject, blocks in (("946", (2, 4, 6)), ("865", (2,))):
        turned = (pulses["subject"] == subject) & pulses["block"].isin(blocks)
        pulses.loc[turned, "response"] = pulses.loc[turned, "response"].map(
            {"equal": "different", "different": "equal"}
        )
    place = pulses.groupby("subject").cumcount()
    yield (
        "vibrotactile, odd and even",
        bt.read_study(pulses.assign(condition=np.where(place % 2, "odd", "even"))),
    )
    half = place < pulses.groupby("subject")["subject"].transform("size") / 2
    yield (
        "vibrotactile, early and late",
        bt.read_study(pulses.assign(condition=np.where(half, "early", "late"))),
    )


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
    for quantity in table.quantities:
        rows = table.select(quantity)
        log_bf = np.array([row.log_bf_differs for row in rows], np.float64)
        counts = {
            "BF > 3": log_bf > np.log(3.0),
            "> 20": log_bf > np.log(20.0),
            "< 1/3": log_bf < -np.log(3.0),
        }
        words = ", ".join(f"{limit} {int(reached.sum())}" for limit, reached in counts.items())
        not_robust = sum(row.robust == "no" for row in rows)
        mean, sd = np.mean([row.mean for row in rows]), np.mean([row.sd for row in rows])
        print(
            f"{label} | {quantity} | of {len(rows)}: {words}; not robust {not_robust}; "
            f"mean {mean:+.3f}, sd {sd:.3f}",
            flush=True,
        )


def print_group(study: bt.Study, seed: int) -> None:
    """The rows of a group that are of conditions."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bt.ConvergenceWarning)
        result = bt.population(study, seed=seed)
    for row in result.table:
        if row.quantity.startswith("difference"):
            interval = f"{row.q50:+.3f} [{row.q025:+.3f}, {row.q975:+.3f}]"
            print(f"{row.parameter} | {row.quantity} | {row.level} | {interval} | {row.zero_words}")
    print(f"reliable: {result.is_reliable} {result.draws.shortfall}", flush=True)


def main() -> None:
    """What was asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["subjects", "simulated", "group"])
    parser.add_argument("--data", type=Path, default=Path("data"))
    parser.add_argument("--number", type=int, default=30, help="simulated subjects a line")
    parser.add_argument("--trials", type=int, default=600, help="of a simulated condition")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    if asked.what == "group":
        print_group(next(study for _, study in real(asked.data)), asked.seed)
        return
    studies = real(asked.data)
    if asked.what == "simulated":
        studies = simulated(asked.number, asked.trials, asked.seed)
    for label, study in studies:
        print_counts(label, bt.contrast(study, seed=asked.seed, workers=1))


if __name__ == "__main__":
    main()
