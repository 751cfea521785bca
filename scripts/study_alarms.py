"""How often fit and order of the trials flag a sound study, and how often they see what is wrong.

    python scripts/study_alarms.py --observers 100 --seed 901

Observers say which of two stimuli was stronger, or whether they were equal: 10 to 28 neighbouring
pairs, 12 or 40 trials each, an easy or a hard task, constant errors of up to 2 noise, contractions
of -.3 to .5, lapses of up to 8 %. Sound ones follow the four models; the other kinds do not.
"""

from __future__ import annotations

import argparse
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from bayes_toe.answers.order_effect import OrderEffect, best_model_fit, order_effect
from bayes_toe.answers.serial_screen import serial_screen
from bayes_toe.answers.words import Word
from bayes_toe.arrays import FloatArray, Rng
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
KINDS = ("sound", "scatter", "heavy tails", "previous response", "walk", "slow", "fast")
#: Kinds whose criterion changes from trial to trial; they have no constant error.
WANDERING = ("walk", "slow", "fast")
#: Correlation of the criterion over a trial: a time scale of 50 or of 10 trials.
CORRELATIONS = {"slow": 0.98, "fast": 0.9}
_PRECISION = Precision(standard_error=0.2, effective_draws=100.0, most_draws=1000)


def pairs(task: Task, n_levels: int) -> FloatArray:
    """Neighbouring levels in both orders, of 'same or different' the equal pairs too."""
    low = STEP * np.arange(n_levels - 1.0)
    rows = [np.column_stack([low, low + STEP]), np.column_stack([low + STEP, low])]
    if task == SAME_DIFFERENT:
        levels = STEP * np.arange(float(n_levels))
        rows.append(np.column_stack([levels, levels]))
    return np.concatenate(rows)


def sound_observer(task: Task, noise: float, has_error: bool, rng: Rng) -> Observer:
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
    return Observer("observer", "sound", values, task)


def criterion(kind: str, n_trials: int, rng: Rng) -> FloatArray:
    """The criterion of every trial, in units of noise, about 0."""
    steps = rng.normal(size=n_trials)
    if kind == "walk":
        return np.cumsum(steps) / np.sqrt(n_trials)
    correlation = CORRELATIONS[kind]
    values = steps.copy()
    for trial in range(1, n_trials):
        new = np.sqrt(1.0 - correlation**2) * steps[trial]
        values[trial] = correlation * values[trial - 1] + new
    return 0.5 * values


def simulate(
    kind: str, task: Task, n_levels: int, repeats: int, noise: float, seed: list[int]
) -> Subject:
    """The trials of one observer, in random order."""
    rng = np.random.default_rng(seed)
    is_wandering = kind in WANDERING
    observer = sound_observer(task, noise, not is_wandering, rng)
    noise = observer.parameters["noise"]
    distinct = pairs(task, n_levels)
    pair = rng.permutation(np.repeat(np.arange(len(distinct)), repeats))
    s1, s2 = distinct[pair].T
    shift = np.zeros(len(pair))
    if kind == "scatter":
        shift = 0.4 * noise * rng.normal(size=len(distinct))[pair]
    elif kind == "heavy tails":
        shift = noise * rng.standard_t(1.5, size=len(pair))
    elif is_wandering:
        shift = noise * criterion(kind, len(pair), rng)
    p_yes = observer.p_yes(s1, s2 + shift, float(s1.mean()))
    is_yes = rng.random(len(pair)) < p_yes
    if kind == "previous response":
        for trial in np.flatnonzero(rng.random(len(pair)) < 0.15)[1:]:
            is_yes[trial] = is_yes[trial - 1]
    order = np.arange(len(pair))
    counts = is_yes.astype(int), np.ones(len(pair), int)
    answers = Answers(distinct[pair], *counts, has_trial_rows=True, place=order)
    return Subject.from_answers("-".join(map(str, seed)), answers, task)


def judge(subjects: list[Subject], seed: int) -> list[OrderEffect]:
    """The answers of subjects of one task."""
    answers = []
    for evidence in order_evidence(subjects, seed, precision=_PRECISION):
        subject = evidence.subject
        posterior = OrderModel("both").posterior(subject, evidence.prior)
        mode = evidence.modes[MODEL_NAMES.index("both")]
        screen = serial_screen(subject, posterior, mode)
        fit = best_model_fit(evidence, seed)
        answers.append(order_effect(evidence, identify(subject), fit=fit, screen=screen))
    return answers


def analyse(kind: str, n_observers: int, seed: int) -> pd.DataFrame:
    """A row for every observer of a kind, over all designs."""
    # The criterion of 'same or different' is no constant error.
    tasks = (WHICH_STRONGER,) if kind in WANDERING else (WHICH_STRONGER, SAME_DIFFERENT)
    rows = []
    for task, n_levels, repeats, noise in product(tasks, (6, 10), (12, 40), (0.6, 1.8)):
        subjects = []
        for i in range(n_observers):
            key = [seed, KINDS.index(kind), len(rows), i]
            subjects.append(simulate(kind, task, n_levels, repeats, noise, key))
        for answer in judge(subjects, seed):
            row = {"kind": kind, "task": task.name, "levels": n_levels, "trials": repeats}
            row |= {"noise": noise, "has_error": answer.words["constant_error"] is Word.YES}
            row |= {test: getattr(answer, test) for test in TESTS}
            rows.append(row | {"depends_on_prior": answer.depends_on_prior})
    return pd.DataFrame(rows)


def rates(table: pd.DataFrame, column: str) -> dict[str, float]:
    """Share of studies of one kind of observers in which a test flags any, and of subjects."""
    values = table[column].dropna()
    shares = {}
    for n_subjects in STUDIES:
        of_subjects = float((values < flag_limit(n_subjects)).mean())
        shares[f"study of {n_subjects}"] = 1.0 - (1.0 - of_subjects) ** n_subjects
        shares[f"subject of {n_subjects}"] = of_subjects
    return shares


def main() -> None:
    """Simulate and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--observers", type=int, default=50, help="of every kind and design")
    parser.add_argument("--seed", type=int, default=901)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("-o", "--output", type=Path, help="table of all observers")
    options = parser.parse_args()
    rows, tables = [], []
    for kind in options.kinds:
        table = analyse(kind, options.observers, options.seed)
        tables.append(table)
        for task, test in product(table["task"].unique(), TESTS):
            of_task = table[table["task"] == task]
            row = {"kind": kind, "task": task, "test": test, "observers": len(of_task)}
            rows.append(row | rates(of_task, test))
        if options.output is not None:
            pd.concat(tables).to_csv(options.output, index=False)
    print(pd.DataFrame(rows).round(3).to_string(index=False))


if __name__ == "__main__":
    main()
