"""How often each alarm is raised: in sound studies, for faults, and for observers of ten kinds.

    python scripts/alarms.py -o docs --seed 2611

It writes alarms.md. Sound observers follow the four models: 10 to 28 neighbouring pairs, 12 or 40
trials each in five blocks, noise of .6, 1.8 or 4 steps of a pair, constant errors of up to 2.5
steps, contractions of -.4 to .65, lapses of up to 8 %. The observers of the ten kinds answer in
studies of 12, whose limits are those of a user's study.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from reference.pages import markdown
from scipy.stats import binom

from bayes_toe.answers.order_effect import OrderEffect, answer_evidence
from bayes_toe.arrays import FloatArray, IntArray, Rng
from bayes_toe.checks.alarm_rate import flag_limit
from bayes_toe.checks.alternative_models import Alternatives, compare_alternatives
from bayes_toe.checks.answer_checks import has_other_task, subject_findings
from bayes_toe.data.answers import Answers
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER, Task
from bayes_toe.design.observers import Observer, parameter_names
from bayes_toe.inference.order_evidence import Precision, order_evidence

STEP = 0.25
N_BLOCKS = 5
STUDIES = (1, 12, 40, 200)  # subjects
STUDY_OF_KINDS = 12
TASKS = (WHICH_STRONGER, SAME_DIFFERENT)
DESIGNS = tuple(product((6, 10), (12, 40), (0.6, 1.8, 4.0)))  # levels, trials, noise
KINDS = (
    *("clean", "lapses of 8 %", "lapses to one response", "heavy tails", "noise by intensity"),
    *("learning", "previous response", "wandering criterion", "recent stimuli"),
    "scatter between pairs",
)
#: Constant error in steps and contraction of the observers of a kind, which take turns.
EFFECTS = ((0.0, 0.0), (0.0, 0.0), (0.6, 0.0), (0.0, 0.3), (0.0, 0.65), (0.0, -0.4))
FAULTS = ("guesses", "swapped keys", "one swapped block", "other task", "repeated trials")
ALARM_OF_FAULT = {
    "guesses": "independent_answers",
    "swapped keys": "reversed_answers",
    "one swapped block": "swapped_blocks",
    "repeated trials": "repeated_trials",
    "other task": "another_task",
}
#: Names of the alarms of the page, and how they act.
ALARMS = {
    "reversed_answers": ("keys look swapped", "refuses the subject; `--swap`"),
    "swapped_blocks": ("keys look swapped in blocks", "refuses the subject; `--swap`"),
    "repeated_trials": ("trials are repeated", "refuses the subject; remove the copies"),
    "other_task": ("another task than 2AFC", "refuses the study"),
    "like_2afc": ("2AFC, or a large constant error", "marks these subjects"),
    "independent_answers": ("responses say little about the stimuli", "marks the subject"),
    "time": ("blocks differ, responses drift", "marks the subject"),
    "fit_p": ("the model does not fit", "marks the subject"),
    "history_p": ("depends on the previous trial", "marks the subject"),
    "moving_criterion_p": ("the criterion wanders", "marks the subject"),
}
P_VALUES = ("fit_p", "history_p", "moving_criterion_p")
_SHORT_NAMES = {
    "time": "blocks, drift",
    "moving_criterion_p": "criterion",
    "history_p": "previous trial",
    "fit_p": "fit",
}
_QUESTIONS = ("constant_error", "contraction")
_REFUSING = ("reversed_answers", "swapped_blocks", "repeated_trials")
_TIME = ("block_dispersion", "drift")
_PRECISION = Precision(standard_error=0.2, effective_draws=100.0, most_draws=1000)


# --- Observers -----------------------------------------------------------------------------------


def pairs(task: Task, n_levels: int) -> FloatArray:
    """Neighbouring levels in both orders, of 'same or different' the equal pairs too."""
    levels = STEP * np.arange(n_levels)
    low, high = levels[:-1], levels[1:]
    rows = [np.column_stack([low, high]), np.column_stack([high, low])]
    if task == SAME_DIFFERENT:
        rows.append(np.column_stack([levels, levels]))
    return np.concatenate(rows)


def sound_parameters(task: Task, noise: float, rng: Rng) -> dict[str, Any]:
    """An observer of one of the four models."""
    values: dict[str, Any] = dict.fromkeys(parameter_names(task), 0.0)
    values["noise"] = noise * STEP * np.exp(rng.normal(0.0, 0.25))
    values["lapse_rate"] = rng.choice([0.0, 0.03, 0.08])
    values["noise_slope"] = rng.choice([0.0, 0.15]) * rng.normal()
    if rng.random() < 0.5:
        values["constant_error"] = rng.choice([-2.5, -1.0, 0.3, 1.6]) * STEP
    if rng.random() < 0.5:
        values["contraction"] = rng.choice([-0.4, 0.15, 0.3, 0.65])
    if task == SAME_DIFFERENT:
        values["q0"] = rng.uniform(0.7, 0.97)
    return values


def kind_parameters(kind: str, task: Task, effects: tuple[float, float], rng: Rng) -> Any:
    """An observer of one of the ten kinds, with a constant error in steps and a contraction."""
    values: dict[str, Any] = dict.fromkeys(parameter_names(task), 0.0)
    values["noise"] = 0.8 * STEP * np.exp(rng.normal(0.0, 0.2))
    values["lapse_rate"] = 0.08 if kind == "lapses of 8 %" else 0.02
    values["noise_slope"] = 0.55 if kind == "noise by intensity" else 0.0
    values["constant_error"] = effects[0] * STEP * rng.choice([-1.0, 1.0])
    values["contraction"] = effects[1]
    if task == SAME_DIFFERENT:
        values["q0"] = 0.85
    return values


def shifts(kind: str, pair: IntArray, keys: FloatArray, rng: Rng) -> FloatArray:
    """By how much s2 seems stronger in every trial, in units of noise."""
    n_trials = len(pair)
    steps = rng.normal(size=n_trials)
    if kind == "scatter between pairs":
        return 0.4 * steps[pair]
    if kind == "heavy tails":
        return rng.standard_t(2.0, size=n_trials)
    if kind == "recent stimuli":
        recent = np.roll(keys.mean(axis=1) - keys.mean(), 1)
        return -0.3 * recent / STEP
    if kind == "wandering criterion":
        criterion = steps.copy()
        for trial in range(1, n_trials):
            criterion[trial] = 0.98 * criterion[trial - 1] + 0.2 * steps[trial]
        return 0.5 * criterion
    return np.zeros(n_trials)


def learning_p(
    task: Task, parameters: dict[str, Any], keys: FloatArray, sbar: float
) -> list[float]:
    """P(yes) of every trial of an observer whose noise falls over the trials."""
    p_yes = []
    for factor, (s1, s2) in zip(np.linspace(1.6, 0.6, len(keys)), keys, strict=True):
        noise = float(factor * parameters["noise"])
        observer = Observer("observer", "learning", parameters | {"noise": noise}, task)
        p_yes.append(float(observer.p_yes(s1, s2, sbar)))
    return p_yes


def simulate(
    kind: str, task: Task, parameters: dict[str, Any], n_levels: int, repeats: int, rng: Rng
) -> Subject:
    """The trials of one observer, in random order and five blocks."""
    distinct = pairs(task, n_levels)
    pair = rng.permutation(np.repeat(np.arange(len(distinct)), repeats))
    n_trials = len(pair)
    keys = distinct[pair]
    noise = parameters["noise"]
    shift = noise * shifts(kind, pair, keys, rng)
    observer = Observer("observer", kind, parameters, task)

    uniform = rng.random(n_trials)
    sbar = float(keys[:, 0].mean())
    is_yes = uniform < observer.p_yes(keys[:, 0], keys[:, 1] + shift, sbar)
    if kind == "learning":
        is_yes = uniform < learning_p(task, parameters, keys, sbar)
    if kind == "lapses to one response":
        is_yes |= rng.random(n_trials) < 0.08
    if kind == "previous response":
        above = observer.p_yes(keys[:, 0], keys[:, 1] + 0.3 * noise, sbar)
        below = observer.p_yes(keys[:, 0], keys[:, 1] - 0.3 * noise, sbar)
        for trial in range(1, n_trials):
            p_yes = above if is_yes[trial - 1] else below
            is_yes[trial] = uniform[trial] < p_yes[trial]

    block = np.arange(n_trials) * N_BLOCKS // n_trials
    if kind == "guesses":
        is_yes = uniform < 0.5
    elif kind == "swapped keys":
        is_yes = ~is_yes
    elif kind == "one swapped block":
        is_yes = is_yes ^ (block == 1)
    if kind == "repeated trials":
        n_copied = n_trials // 3
        keys[-n_copied:], is_yes[-n_copied:] = keys[:n_copied], is_yes[:n_copied]
    answers = Answers(
        keys,
        is_yes.astype(int),
        np.ones(n_trials, int),
        block,
        tuple("12345"),
        has_trial_rows=True,
        place=np.arange(n_trials),
    )
    return Subject.from_answers("observer", answers, task)


def sound_observers(task: Task, n_observers: int, seed: int, kind: str = "sound") -> list[Subject]:
    """Observers of the four models, so many of each design; or with a fault, in easy tasks."""
    subjects = []
    for i, (n_levels, repeats, noise) in enumerate(DESIGNS):
        if kind != "sound" and noise > 1.0:
            continue
        for j in range(n_observers):
            rng = np.random.default_rng([seed, TASKS.index(task), len(kind), i, j])
            parameters = sound_parameters(task, noise, rng)
            subject = simulate(kind, task, parameters, n_levels, repeats, rng)
            subjects.append(replace(subject, name=f"{kind} {i} {j}"))
    return subjects


def kind_observers(kind: str, task: Task, n_observers: int, seed: int) -> list[Subject]:
    """Observers of one of the ten kinds."""
    subjects = []
    for i in range(n_observers):
        rng = np.random.default_rng([seed, TASKS.index(task), KINDS.index(kind), i])
        parameters = kind_parameters(kind, task, EFFECTS[i % len(EFFECTS)], rng)
        repeats = 40 if task == WHICH_STRONGER else 30
        subject = simulate(kind, task, parameters, 6, repeats, rng)
        subjects.append(replace(subject, name=f"{kind} {i}"))
    return subjects


# --- Alarms --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Judged:
    """An observer with what the program finds; there is no answer where only faults are looked for.

    The code `another_task` says that the other task explains the responses.
    """

    subject: Subject
    alternatives: Alternatives | None
    answer: OrderEffect | None = None

    def alarms(self, n_subjects: int) -> set[str]:
        """The alarms in a study of so many subjects, without those that concern the whole study."""
        codes = set[str]()
        for finding in subject_findings(self.subject, n_subjects, self.alternatives):
            codes.add("time" if finding.code in _TIME else finding.code)
        if self.alternatives is not None and has_other_task(self.alternatives, self.subject.task):
            codes.add("another_task")
        for name in P_VALUES:
            p_value = getattr(self.answer, name, None)
            if p_value is not None and p_value < flag_limit(n_subjects):
                codes.add(name)
        return codes


def find_faults(subjects: list[Subject]) -> list[Judged]:
    """Observers of one task with the other models that explain their responses."""
    alternatives = compare_alternatives(Study(tuple(subjects)))
    return [Judged(subject, alternatives.get(subject.name)) for subject in subjects]


def judge(subjects: list[Subject], seed: int) -> list[Judged]:
    """What the program finds for observers of one task."""
    answers = []
    for evidence in order_evidence(subjects, seed, precision=_PRECISION):
        answers.append(answer_evidence(evidence, seed))
    found = zip(find_faults(subjects), answers, strict=True)
    return [replace(observer, answer=answer) for observer, answer in found]


def study_rates(observers: list[Judged], task: Task) -> pd.DataFrame:
    """Share of studies in which an alarm is raised at all, %, by alarm and number of subjects."""
    own = "other_task" if task == WHICH_STRONGER else "like_2afc"
    columns = {}
    for n_subjects in STUDIES:
        codes = pd.Series([observer.alarms(n_subjects) for observer in observers])
        shares = pd.Series(
            {
                code: codes.map(lambda of, code=code: code in of).mean()
                for code in (*ALARMS, "another_task")
            }
        )
        rates = 1.0 - (1.0 - shares) ** n_subjects
        rates[own] = binom.sf(n_subjects // 2, n_subjects, shares["another_task"])
        columns[f"{n_subjects}"] = 100.0 * rates
    return pd.DataFrame(columns).drop({"other_task", "like_2afc", "another_task"} - {own})


def found_faults(fault: str, n_observers: int, seed: int) -> dict[str, str]:
    """How many observers with a fault get its alarm in a study of 12, by task."""
    row = {"fault": fault}
    for task in TASKS:
        if fault == "other task":
            (made,) = (other for other in TASKS if other != task)
            subjects = sound_observers(made, n_observers, seed, fault)
            subjects = [replace(subject, task=task, answers=None) for subject in subjects]
        else:
            subjects = sound_observers(task, n_observers, seed, fault)
        found = [ALARM_OF_FAULT[fault] in one.alarms(12) for one in find_faults(subjects)]
        row[task.name] = f"{sum(found)} of {len(found)}"
    return row


# --- The ten kinds -------------------------------------------------------------------------------


def kind_row(kind: str, task: Task, observers: list[Judged]) -> dict[str, str]:
    """Refusals, flags, words and coverage of the observers of one kind."""
    alarms = [observer.alarms(STUDY_OF_KINDS) for observer in observers]
    row = {"observers": kind, "task": "2AFC" if task == WHICH_STRONGER else "same"}
    row["refused"] = f"{sum(not codes.isdisjoint(_REFUSING) for codes in alarms)}"
    for code, name in _SHORT_NAMES.items():
        row[name] = f"{sum(code in codes for codes in alarms)}"

    effects = np.resize(np.array(EFFECTS), (len(observers), 2))
    for true_sizes, question, symbol in zip(effects.T, _QUESTIONS, "cp", strict=True):
        is_yes = np.array([one.answer.words[question] == "yes" for one in observers])
        row[f"false {symbol}"] = count(is_yes[true_sizes == 0.0])
        row[f"found {symbol}"] = count(is_yes[true_sizes != 0.0])
    sizes = [observer.answer.sizes["contraction_p"] for observer in observers]
    low, high = np.array([(size.q025, size.q975) for size in sizes]).T
    is_covered = (low <= effects[:, 1]) & (effects[:, 1] <= high)
    row["p covered"] = count(is_covered[effects[:, 1] != 0.0])
    return row


def count(is_there: np.ndarray) -> str:
    """How many are there."""
    return f"{is_there.sum()} of {len(is_there)}"


# --- The page ------------------------------------------------------------------------------------

PAGE = """# Alarms: how often they are false, and what they find

<!-- generated by {command} -->

A sound study has no fault. In such a study, an alarm that refuses responses should occur with a
probability of at most 2 %. Any other alarm should occur with a probability of at most 5 %. So the
limits depend on the number N of subjects. The limit of a p-value is .05/N. The limit of a Bayes
factor is N/.02 for an alarm that refuses responses, and N/.05 for any other alarm. We chose the
limits with another seed.

## Sound studies

A cell shows the per cent of studies in which at least one subject has the alarm. The first number
is for 2AFC, and the second number is for 'same or different'. We simulated {n_sound} observers of
each task with the four models. `scripts/alarms.py` has the ranges of the parameters. The numbers
for 200 subjects are imprecise. One observer with a false alarm changes a number from 0 to {one} %.

{sound}

## What they find

The table counts observers with a fault for whom the program raises the alarm, in studies of 12
subjects. The noise of these observers is .6 times the difference between the stimuli of a pair.

{faults}

In some of these observers, the constant error is 2.5 times this difference and hides the fault.
The program finds another task only if more than half of the subjects respond as in another task.

## Observers whom no model describes

We simulated {n_kind} observers of each kind and task, in studies of 12 subjects and 400 or 480
trials. One third of the observers have no effect. One sixth have only a constant error (c) of .6
times the difference between the stimuli of a pair. One half have only a contraction (p) of 30, 65
or -40 %. The columns `false c` and `false p` count observers with the word `yes` but without
the effect. The columns `found c` and `found p` count observers with the word `yes` and with the
effect. The column `p covered` counts observers whose 95 % interval contains the true contraction.

{kinds}

Three kinds of observers often have a false `yes` for a constant error. Lapses to one response look
like a constant error in 2AFC, and no mark shows such lapses. The program marks only some observers
with a wandering criterion or with scatter between pairs. If a subject has one of these two marks,
report the mark with the constant error. Scatter between pairs also makes the intervals of the
contraction too narrow.
"""


def sound_table(rates: dict[Task, pd.DataFrame]) -> pd.DataFrame:
    """Rates of both tasks in per cent, an alarm a row."""
    texts = []
    for task in TASKS:
        texts.append(rates[task].reindex(ALARMS).map("{:.1f}".format).replace("nan", "-"))
    table = texts[0] + ", " + texts[1]
    names = pd.DataFrame(ALARMS, index=["alarm", "what it does"]).T
    return names.join(table).rename(columns={"1": "1 subject"})


def main() -> None:
    """Simulate, print, and write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--observers", type=int, default=400, help="sound ones of each design")
    parser.add_argument("--kinds", type=int, default=120, help="observers of each kind and task")
    parser.add_argument("--faults", type=int, default=30, help="observers of each fault and design")
    parser.add_argument("--seed", type=int, default=2611)
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()

    rates = {}
    for task in TASKS:
        observers = judge(sound_observers(task, options.observers, options.seed), options.seed)
        rates[task] = study_rates(observers, task)
        print(task.name, rates[task].round(4).to_string(), sep="\n", flush=True)
    faults = pd.DataFrame(
        [found_faults(fault, options.faults, options.seed + 1) for fault in FAULTS]
    )
    print(faults.to_string(), flush=True)
    rows = []
    for kind, task in product(KINDS, TASKS):
        observers = judge(kind_observers(kind, task, options.kinds, options.seed + 2), options.seed)
        rows.append(kind_row(kind, task, observers))
        print(rows[-1], flush=True)
    kinds = pd.DataFrame(rows)

    n_sound = options.observers * len(DESIGNS)
    numbers = f"--observers {options.observers} --kinds {options.kinds} --faults {options.faults}"
    page = PAGE.format(
        command=f"scripts/alarms.py -o docs {numbers} --seed {options.seed}",
        n_sound=f"{n_sound:,}",
        one=f"{100.0 * (1.0 - (1.0 - 1.0 / n_sound) ** 200):.1f}",
        sound=markdown(sound_table(rates)),
        faults=markdown(faults),
        n_kind=options.kinds,
        kinds=markdown(kinds),
    )
    if options.output is not None:
        (options.output / "alarms.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
