"""An adaptive session: choose a pair, show it, wait for an answer, and so on.

The session can stop and go on at any time.

    python scripts/adaptive_session.py session.json --subject S01 --trials 40

Here a simulated observer responds. In an experiment, `respond` presents the stimuli and waits for a
key, by PsychoPy, pygame or the driver of a vibrator. The session is saved after every answer, and
the same command goes on with it. At the end its trials are in session.csv, which `bayes-toe run`
reads.
"""

from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from reference.pages import number_parser

import bayes_toe as bt
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.design.observers import make_observer

LEVELS = np.round(np.arange(-0.75, 1.26, 0.1), 10)
OBSERVER = {"noise": 0.2, "q0": 0.93, "lapse_rate": 0.03, "contraction": 0.3}


def respond(pair: tuple[float, ...], rng: np.random.Generator) -> bool:
    """Whether an observer who draws the first stimulus to the mean responds 'equal'."""
    observer = make_observer("O1", "contraction", OBSERVER, SAME_DIFFERENT)
    return bool(rng.uniform() < observer.p_questions(*pair, sbar=LEVELS.mean())[0])


def main() -> None:
    """One session."""
    parser = number_parser(__doc__, trials=40)
    parser.add_argument("file", type=Path)
    parser.add_argument("--subject", default="S01")
    asked = parser.parse_args()
    if asked.file.exists():
        session = bt.design.Adaptive.resume(asked.file)
    else:
        session = bt.design.Adaptive(list(product(LEVELS, repeat=2)), seed=1)
    rng = np.random.default_rng(session.trials)
    while session.trials < asked.trials:
        pair = session.next()
        session.answer(pair, respond(pair, rng))
        session.save(asked.file)
    frame = pd.DataFrame(session.answers, columns=["s1", "s2", "response"])
    frame["response"] = frame["response"].map({True: "equal", False: "different"})
    frame = frame.assign(subject=asked.subject, trial=np.arange(len(frame)) + 1)
    frame.to_csv(asked.file.with_suffix(".csv"), index=False)
    print(", ".join(f"P({name}) = {p:.3f}" for name, p in session.probabilities.items()))
    if any(first != second for first, second, _ in session.answers):
        print(session.order_effect.describe())
    else:
        print("no answer yet: every pair so far had two equal stimuli")


if __name__ == "__main__":
    main()
