"""Conditions within subjects: what docs/conditions.md says of real studies, of nulls and of simulated groups.

    python scripts/conditions.py subjects [--data FOLDER]       # real studies: differences by delay; odd and even trials; early and late
    python scripts/conditions.py group [--data FOLDER]          # the group by delay
    python scripts/conditions.py studies --number 10            # groups of 16, with and without a difference, beside unpaired analyses

FOLDER has auditory_pwm/trials.csv and vibrotactile_rate/trials.csv. Everything is printed, a line as soon as it is known.
"""

from __future__ import annotations

import argparse
import math
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.special import ndtr
from scipy.stats import ttest_1samp

import bayes_toe as bt
from bayes_toe.comparison.contrast import ContrastTable

PAIRS = np.array([(a, a + step) for a in np.linspace(0.0, 1.5, 6) for step in (-0.3, 0.3)])
STEP = 0.3  # D
#: Constant error, probit of the pull, log width, guesses: of a typical subject, and how far subjects scatter.
TYPICAL, SCATTER, GUESSES = np.array([0.0, -0.7, np.log(0.3)]), np.array([0.06, 0.4, 0.2]), 0.04
#: What differs on average in the simulated studies, and how far subjects scatter in that.
AVERAGE, TAU = np.array([0.3 * STEP / 2, 0.3, 0.15]), np.array([0.1 * STEP / 2, 0.15, 0.1])


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
    for who, blocks in (
        ("946", (2, 4, 6)),
        ("865", (2,)),
    ):  # who most likely missed a swap of the buttons
        turned = (pulses["subject"] == who) & pulses["block"].isin(blocks)
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


def said(what: str, table: ContrastTable) -> None:
    """How many subjects have which Bayes factor."""
    for quantity in table.quantities:
        rows = table.some(quantity)
        log_bf = np.array([row.log_bf_differs for row in rows], np.float64)
        counts = ", ".join(f"{label} {int(found.sum())}" for label, found in (
            ("BF > 3", log_bf > np.log(3)), ("> 20", log_bf > np.log(20)), ("< 1/3", log_bf < -np.log(3))))  # fmt: skip
        changed = sum(row.robust == "no" for row in rows)
        print(
            f"{what} | {quantity} | of {len(rows)}: {counts}; not robust {changed}; mean {np.mean([row.mean for row in rows]):+.3f}",
            flush=True,
        )


def answers(
    name: str, truth: np.ndarray, trials: int, rng: np.random.Generator
) -> Iterator[pd.DataFrame]:
    """A subject in two conditions, of truth (2, 3)."""
    s1, s2 = PAIRS.T
    for level, (offset, probit, log_width) in zip(("a", "b"), truth, strict=True):
        z = (s2 - s1 - offset + ndtr(probit) * (s1 - s1.mean())) / np.exp(log_width)
        p, n = GUESSES / 2 + (1 - GUESSES) * ndtr(z), trials // len(s1)
        yield pd.DataFrame(
            {
                "subject": name,
                "condition": level,
                "s1": s1,
                "s2": s2,
                "n_second": rng.binomial(n, p),
                "n_trials": n,
            }
        )


def by_delay(study: bt.Study, model: str, draws: int, seed: int) -> None:
    """The rows of a group that are of conditions."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bt.ConvergenceWarning)
        found = bt.population(study, model=model, draws=draws, seed=seed)
    for row in found.table:
        if row.quantity.startswith("condition"):
            print(
                f"{row.parameter} | {row.quantity} | {row.level} | {row.mean:+.3f} +- {row.sd:.3f} | BF of none {row.of_none}",
                flush=True,
            )
    print(f"converged: {found.converged} {found.chains.reason}", flush=True)


def studies(number: int, seed: int, size: int = 16, trials: int = 200) -> None:
    """Groups in whom nothing differs on average, or all three; a group for each condition by itself, and a t test of single subjects."""
    for index in range(2 * number):
        differs, rng, rows = (
            bool(index % 2),
            np.random.default_rng([seed, index]),
            list[pd.DataFrame](),
        )
        for i in range(size):
            own = TYPICAL + SCATTER * rng.standard_normal(3)
            apart = AVERAGE * differs + TAU * rng.standard_normal(3)
            rows += answers(f"O{i:02d}", own + np.array([[-0.5], [0.5]]) * apart, trials, rng)
        table = pd.concat(rows)
        study, *halves = map(
            bt.read_study,
            (table, *(some.drop(columns="condition") for _, some in table.groupby("condition"))),
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", bt.ConvergenceWarning)
            found, *apart = (
                bt.population(some, model="contraction", draws=100, seed=seed)
                for some in (study, *halves)
            )
        subjects = bt.contrast(study, model="contraction", seed=seed)
        factors = {
            row.parameter: row
            for row in found.table.some("condition_effect")
            if row.parameter != "order effect"
        }
        for label, truth, quantity in zip(
            ("constant error", "probit pull", "log width"),
            AVERAGE,
            ("constant error", "pull", "width"),
            strict=True,
        ):
            row = factors[label]
            none = row.bf_no_difference if row.bf_no_difference is not None else row.bf_below
            covered = row.q05 < truth * differs < row.q95
            t = ttest_1samp([one.mean for one in subjects.some(quantity)], 0.0).pvalue
            unpaired = math.hypot(
                *(
                    one.sd
                    for half in apart
                    for one in half.table.some("mean")
                    if one.parameter == label
                )
            )
            numbers = f"mean {row.mean:+.4f} sd {row.sd:.4f}, unpaired {unpaired:.4f} | BF of none {none:.3g} | covered {covered} | t p {t:.3f}"
            print(
                f"study {index} | {'differs' if differs else 'none'} | {label} | {numbers}",
                flush=True,
            )


def main() -> None:
    """What was asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["subjects", "group", "studies"])
    parser.add_argument("--data", type=Path, default=Path("data"))
    parser.add_argument("--number", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    if asked.what == "subjects":
        for name, study in real(asked.data):
            said(name, bt.contrast(study, seed=asked.seed))
    elif asked.what == "group":
        by_delay(
            next(study for _, study in real(asked.data)), "contraction + sloped", 300, asked.seed
        )
    else:
        studies(asked.number, asked.seed)


if __name__ == "__main__":
    main()
