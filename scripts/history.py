"""How well serial dependence is seen in simulated observers.

    python scripts/history.py -o docs --observers 24 --seed 1     # writes history_recovery.csv

Observers say which of two stimuli was stronger: neighbours of six levels in both orders, two
sessions, noise of one step, 4 % lapses. They differ in contraction, in what they carry over, and in
how often they repeat or alternate the response of the trial before.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.special import ndtr

from bayes_toe.answers.serial_dependence import EFFECT_MODELS, SubjectDependence, subject_dependence
from bayes_toe.data.answers import Answers
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.inference.order_evidence import order_evidence
from bayes_toe.seeds import generator

STEP, NOISE, LAPSE_RATE = 0.3, 0.3, 0.04
WORDS = ("yes", "probably", "undecided", "probably not", "no")
#: Contraction, carry-over, and share of responses that repeat (below 0: alternate) the one before.
TRUTHS = {
    "no effect": (0.0, 0.0, 0.0),
    "contraction alone": (0.3, 0.0, 0.0),
    "carry-over 0.5": (0.3, 0.5, 0.0),
    "carry-over 0.9": (0.3, 0.9, 0.0),
    "10 % repeated": (0.3, 0.0, 0.1),
    "20 % repeated": (0.3, 0.0, 0.2),
    "20 % alternated": (0.3, 0.0, -0.2),
}


def observer(truth: str, n_trials: int, number: int, seed: int) -> Subject:
    """One simulated observer, trial by trial."""
    contraction, carry_over, repeated = TRUTHS[truth]
    name = f"{truth} {n_trials} {number}"
    rng = generator(seed, name, "observer")
    low, is_up = rng.integers(0, 5, n_trials), rng.random(n_trials) < 0.5
    keys = STEP * np.column_stack([low + ~is_up, low + is_up]).astype(float)
    place = np.arange(n_trials) + (np.arange(n_trials) >= n_trials // 2)
    centre, expectation = keys[:, 0].mean(), 0.0
    n_yes = np.zeros(n_trials, np.int64)
    for t, (s1, s2) in enumerate(keys):
        is_first = t in (0, n_trials // 2)
        expectation = 0.0 if is_first else expectation
        z = (s2 - s1 + contraction * (s1 - centre - expectation)) / NOISE
        n_yes[t] = rng.random() < 0.5 * LAPSE_RATE + (1.0 - LAPSE_RATE) * ndtr(z)
        if not is_first and rng.random() < abs(repeated):
            n_yes[t] = n_yes[t - 1] if repeated > 0.0 else 1 - n_yes[t - 1]
        share = 1.0 - contraction
        moved = share * (s2 - centre) + contraction * share * (s1 - centre)
        expectation = carry_over * (moved + contraction**2 * expectation)
    ones = np.ones(n_trials, np.int64)
    answers = Answers(keys, n_yes, ones, has_trial_rows=True, place=place)
    return Subject.from_answers(name, answers, WHICH_STRONGER)


def analyse(truth: str, n_trials: int, number: int, seed: int) -> SubjectDependence:
    """What is concluded of one of them."""
    (evidence,) = order_evidence([observer(truth, n_trials, number, seed)], seed)
    return subject_dependence(evidence, seed)


def count_words(rows: list[SubjectDependence]) -> dict[str, object]:
    """Words of both effects, sums, and what the screen sees."""
    found: dict[str, object] = {}
    for effect in EFFECT_MODELS:
        words = [row.word(effect).partition(" (")[0] for row in rows]
        for word in WORDS:
            found[f"{effect} {word}"] = words.count(word)
        found[f"{effect} ln BF in sum"] = sum(row.log_bayes_factor(effect) for row in rows)
    for test in ("joint_p", "answer_p", "stimuli_p", "moving_criterion_p"):
        values = [getattr(row.screen, test) for row in rows]
        found[f"{test} < 0.01"] = sum(p is not None and p < 0.01 for p in values)
    return found


def recovery(n_observers: int, trials: list[int], seed: int) -> pd.DataFrame:
    """One row a truth and number of trials."""
    table = []
    for truth, (_, carry_over, _) in TRUTHS.items():
        for n_trials in trials:
            rows = [analyse(truth, n_trials, i, seed) for i in range(n_observers)]
            counts = {"truth": truth, "trials": n_trials, "observers": n_observers}
            counts |= count_words(rows)
            if carry_over > 0.0:
                # Without carry-over rho is 0, which no interval of a share holds.
                holds = [row.rho[0] <= carry_over <= row.rho[2] for row in rows]
                counts["rho in its interval"] = sum(holds)
            table.append(counts)
    return pd.DataFrame(table)


def main() -> None:
    """Simulate, count the words, write them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, default=Path())
    parser.add_argument("--observers", type=int, default=24)
    parser.add_argument("--trials", type=int, nargs="+", default=[200, 400])
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    table = recovery(arguments.observers, arguments.trials, arguments.seed)
    table.to_csv(arguments.output / "history_recovery.csv", index=False)
    print(table.to_string())


if __name__ == "__main__":
    main()
