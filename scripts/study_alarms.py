"""How often fit and order of the trials flag a sound study, and how often they see what is wrong.

    python scripts/study_alarms.py --observers 100 --seed 901

Observers say which of two stimuli was stronger, or whether they were equal: 10 to 28 neighbouring
pairs, 12 or 40 trials each, an easy or a hard task, constant errors of up to 2 noise, contractions
of -.3 to .5, lapses of up to 8 %. Sound ones follow the four models; the other kinds do not.
"""

from __future__ import annotations

import argparse
from itertools import product

import numpy as np
import pandas as pd

from bayes_toe.answers.order_effect import best_model_fit, order_effect
from bayes_toe.answers.serial_screen import serial_screen
from bayes_toe.arrays import FloatArray, IntArray, Rng
from bayes_toe.checks.alarm_rate import flag_limit
from bayes_toe.checks.identification import identify
from bayes_toe.data.answers import Answers
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER, Task
from bayes_toe.design.observers import Observer, parameter_names
from bayes_toe.inference.order_evidence import MODEL_NAMES, Precision, order_evidence
from bayes_toe.model.observer import OrderModel

STEP = 0.25
STUDIES = (1, 12, 40, 200)  # subjects
TESTS = ("fit_p", "history_p", "moving_criterion_p")
KINDS = ("sound", "scatter", "heavy tails", "previous response", "wandering criterion")
_PRECISION = Precision(standard_error=0.2, effective_draws=100.0, most_draws=1000)


def pairs(task: Task, n_levels: int) -> FloatArray:
    """Neighbouring levels in both orders, of 'same or different' the equal pairs too."""
    levels = STEP * np.arange(n_levels)
    low, high = levels[:-1], levels[1:]
    rows = [np.column_stack([low, high]), np.column_stack([high, low])]
    if task == SAME_DIFFERENT:
        rows.append(np.column_stack([levels, levels]))
    return np.concatenate(rows)


def sound_parameters(task: Task, noise: float, has_error: bool, rng: Rng) -> dict[str, float]:
    """An observer of one of the four models, or of the two without a constant error."""
    values = dict.fromkeys(parameter_names(task), 0.0)
    values["noise"] = noise * STEP * np.exp(rng.normal(0.0, 0.25))
    values["lapse_rate"] = rng.choice([0.0, 0.03, 0.08])
    values["noise_slope"] = rng.choice([0.0, 0.15]) * rng.normal()
    if has_error and rng.random() < 0.5:
        values["constant_error"] = rng.choice([-2.0, -0.7, 0.3, 1.4]) * values["noise"]
    if rng.random() < 0.5:
        values["contraction"] = rng.choice([-0.3, 0.15, 0.3, 0.5])
    if task == SAME_DIFFERENT:
        values["q0"] = rng.uniform(0.7, 0.97)
    return values


def shifts(kind: str, pair: IntArray, rng: Rng) -> FloatArray:
    """By how much s2 seems stronger in every trial, in units of noise."""
    steps = rng.normal(size=len(pair))
    if kind == "scatter":
        return 0.4 * steps[pair]
    if kind == "heavy tails":
        return rng.standard_t(1.5, size=len(pair))
    if kind == "wandering criterion":
        return np.cumsum(steps) / np.sqrt(len(pair))
    return np.zeros(len(pair))


def simulate(
    kind: str, task: Task, n_levels: int, repeats: int, noise: float, seed: list[int]
) -> Subject:
    """The trials of one observer, in random order."""
    rng = np.random.default_rng(seed)
    parameters = sound_parameters(task, noise, kind != "wandering criterion", rng)
    observer = Observer("observer", kind, parameters, task)
    distinct = pairs(task, n_levels)
    pair = rng.permutation(np.repeat(np.arange(len(distinct)), repeats))
    s1, s2 = distinct[pair].T
    shift = parameters["noise"] * shifts(kind, pair, rng)
    is_yes = rng.random(len(pair)) < observer.p_yes(s1, s2 + shift, float(s1.mean()))
    if kind == "previous response":
        for trial in np.flatnonzero(rng.random(len(pair)) < 0.15)[1:]:
            is_yes[trial] = is_yes[trial - 1]
    order, ones = np.arange(len(pair)), np.ones(len(pair), int)
    answers = Answers(distinct[pair], is_yes.astype(int), ones, has_trial_rows=True, place=order)
    return Subject.from_answers("-".join(map(str, seed)), answers, task)


def observers(kind: str, n_observers: int, seed: int) -> pd.DataFrame:
    """A row for every observer of a kind, `n_observers` of each design."""
    rows = []
    for task in (WHICH_STRONGER, SAME_DIFFERENT):
        subjects = []
        for i, design in enumerate(product((6, 10), (12, 40), (0.6, 1.8))):
            for j in range(n_observers):
                key = [seed, KINDS.index(kind), len(rows), i, j]
                subjects.append(simulate(kind, task, *design, key))
        for evidence in order_evidence(subjects, seed, precision=_PRECISION):
            subject, mode = evidence.subject, evidence.modes[MODEL_NAMES.index("both")]
            posterior = OrderModel("both").posterior(subject, evidence.prior)
            screen = serial_screen(subject, posterior, mode)
            fit = best_model_fit(evidence, seed)
            answer = order_effect(evidence, identify(subject), fit=fit, screen=screen)
            row = {"task": task.name, "constant_error": str(answer.words["constant_error"])}
            row["depends_on_prior"] = answer.depends_on_prior
            rows.append(row | {test: getattr(answer, test) for test in TESTS})
    return pd.DataFrame(rows)


def flagged_studies(p_values: pd.Series) -> dict[int, float]:
    """Share of studies of such observers in which a test flags any, by the number of subjects."""
    shares = {}
    for n_subjects in STUDIES:
        is_flagged = p_values.dropna() < flag_limit(n_subjects)
        shares[n_subjects] = 1.0 - float((1.0 - is_flagged.mean()) ** n_subjects)
    return shares


def main() -> None:
    """Simulate and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--observers", type=int, default=50, help="of every kind and design")
    parser.add_argument("--seed", type=int, default=901)
    options = parser.parse_args()
    for kind in KINDS:
        table = observers(kind, options.observers, options.seed)
        for (task, rows), test in product(table.groupby("task"), TESTS):
            shares = flagged_studies(rows[test])
            print(kind, task, test, {n: round(share, 3) for n, share in shares.items()}, sep=", ")


if __name__ == "__main__":
    main()
