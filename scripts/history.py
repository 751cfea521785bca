"""How well serial dependence is seen in simulated observers.

    python scripts/history.py -o docs --observers 10 --trials 400 --seed 1

It writes history_recovery.csv. Observers say which of two stimuli was stronger: neighbours of six
levels in both orders, two sessions, noise of one step, 4 % lapses. They differ in contraction, in
what they carry over, and in how often they repeat or alternate the response of the trial before.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
from reference.pages import number_parser

from bayes_toe.answers.serial_dependence import EFFECT_MODELS, SubjectDependence, subject_dependence
from bayes_toe.data.answers import Answers
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.design.observers import make_observer
from bayes_toe.inference.order_evidence import order_evidence
from bayes_toe.model.trial_history import expectations
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
    trial = np.arange(n_trials)
    is_session_start = np.isin(trial, (0, n_trials // 2))

    sbar = keys[:, 0].mean()
    expected = expectations(*(keys - sbar).T, contraction, carry_over, is_session_start)
    parameters = {"noise": NOISE, "lapse_rate": LAPSE_RATE, "contraction": contraction}
    simulated = make_observer(name, truth, parameters, WHICH_STRONGER)
    p_second = simulated.p_questions(*keys.T, sbar, expected)[0]
    n_yes = np.zeros(n_trials, np.int64)
    for t in trial:
        n_yes[t] = rng.random() < p_second[t]
        if not is_session_start[t] and rng.random() < abs(repeated):
            n_yes[t] = n_yes[t - 1] if repeated > 0.0 else 1 - n_yes[t - 1]

    # The numbers of the trials leave a gap between the sessions.
    place = trial + (trial >= n_trials // 2)
    answers = Answers(keys, n_yes, np.ones_like(n_yes), has_trial_rows=True, place=place)
    return Subject.from_answers(name, answers, WHICH_STRONGER)


def count_words(rows: list[SubjectDependence]) -> dict[str, float]:
    """Words of both effects, sums, and what the screen sees."""
    counts = {}
    for effect in EFFECT_MODELS:
        words = Counter(row.word(effect).partition(" (")[0] for row in rows)
        counts |= {f"{effect} {word}": words[word] for word in WORDS}
        counts[f"{effect} ln BF in sum"] = sum(row.log_bayes_factor(effect) for row in rows)
    for test in ("joint_p", "moving_criterion_p"):
        p_values = pd.Series([getattr(row.screen, test) for row in rows], dtype=float)
        counts[f"{test} < 0.01"] = (p_values < 0.01).sum()
    return counts


def recovery(n_observers: int, n_trials: int, seed: int) -> pd.DataFrame:
    """One row a truth."""
    table = []
    for truth, (_, carry_over, _) in TRUTHS.items():
        subjects = [observer(truth, n_trials, i, seed) for i in range(n_observers)]
        evidences = order_evidence(subjects, seed)
        rows = [subject_dependence(evidence, seed) for evidence in evidences]
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
    parser = number_parser(__doc__, observers=24, trials=400, seed=1)
    parser.add_argument("-o", "--output", type=Path, default=Path())
    options = parser.parse_args()
    table = recovery(options.observers, options.trials, options.seed)
    table.to_csv(options.output / "history_recovery.csv", index=False)
    print(table.to_string())


if __name__ == "__main__":
    main()
