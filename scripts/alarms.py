"""How often each alarm is raised: in sound studies, for faults, and for observers of ten kinds.

    python scripts/alarms.py -o docs --observers 100 --kinds 120 --faults 10 --seed 2612

It writes alarms.md. Of each design there are so many sound --observers, and --faults observers with
each fault; there are --kinds observers of each kind and task. Sound observers follow the four
models: 10 to 28 neighbouring pairs, 12 or 40 trials each in five blocks, noise of .6, 1.8 or 4
steps of a pair, constant errors of up to 2.5 steps, contractions of -.4 to .65, lapses of up to
8 %. The observers of the ten kinds answer in studies of 12, whose limits are those of a user's
study.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, product
from pathlib import Path

import numpy as np
import pandas as pd
from reference.pages import markdown, number_parser, render
from scipy.stats import binom

from bayes_toe.answers.order_effect import OrderEffect, answer_evidence
from bayes_toe.arrays import FloatArray, IntArray, Rng
from bayes_toe.checks.alarm_rate import evidence_limit, flag_limit
from bayes_toe.checks.alternative_models import Alternatives, compare_alternatives
from bayes_toe.checks.answer_checks import has_other_task, subject_findings
from bayes_toe.data.answers import Answers
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER, Task
from bayes_toe.design.observers import Observer, make_observer
from bayes_toe.inference.order_evidence import Precision, order_evidence

STEP = 0.25
N_BLOCKS = 5
STUDIES = {"1 subject": 1, "12": 12, "40": 40, "200": 200}
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
#: By fault its alarm.
FAULTS = {
    "guesses": "independent_answers",
    "swapped keys": "reversed_answers",
    "one swapped block": "swapped_blocks",
    "other task": "another_task",
    "repeated trials": "repeated_trials",
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
#: The alarm of a study whose subjects do another task, by the task that is stated.
TASK_ALARMS = {WHICH_STRONGER: "other_task", SAME_DIFFERENT: "like_2afc"}
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
    equal = levels if task == SAME_DIFFERENT else levels[:0]
    return np.column_stack([np.r_[low, high, equal], np.r_[high, low, equal]])


def sound_observer(name: str, task: Task, noise: float, rng: Rng) -> Observer:
    """An observer of one of the four models."""
    values = {
        "noise": noise * STEP * np.exp(rng.normal(0.0, 0.25)),
        "lapse_rate": rng.choice([0.0, 0.03, 0.08]),
        "noise_slope": rng.choice([0.0, 0.15]) * rng.normal(),
    }
    if rng.random() < 0.5:
        values["constant_error"] = rng.choice([-2.5, -1.0, 0.3, 1.6]) * STEP
    if rng.random() < 0.5:
        values["contraction"] = rng.choice([-0.4, 0.15, 0.3, 0.65])
    if task == SAME_DIFFERENT:
        values["q0"] = rng.uniform(0.7, 0.97)
    return make_observer(name, "sound", values, task)


def kind_observer(
    name: str, kind: str, task: Task, effects: tuple[float, float], rng: Rng
) -> Observer:
    """An observer of one of the ten kinds, with a constant error in steps and a contraction."""
    values = {
        "noise": 0.8 * STEP * np.exp(rng.normal(0.0, 0.2)),
        "lapse_rate": 0.08 if kind == "lapses of 8 %" else 0.02,
        "noise_slope": 0.55 if kind == "noise by intensity" else 0.0,
        "constant_error": effects[0] * STEP * rng.choice([-1.0, 1.0]),
        "contraction": effects[1],
    }
    if task == SAME_DIFFERENT:
        values["q0"] = 0.85
    return make_observer(name, kind, values, task)


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


def learning_p(observer: Observer, keys: FloatArray, sbar: float) -> list[float]:
    """P(yes) of every trial of an observer whose noise falls over the trials."""
    noises = np.linspace(1.6, 0.6, len(keys)) * observer.parameters["noise"]
    p_yes = []
    for noise, (s1, s2) in zip(noises.tolist(), keys, strict=True):
        now = replace(observer, parameters={**observer.parameters, "noise": noise})
        p_yes.append(now.p_questions(s1, s2, sbar)[0])
    return p_yes


def simulate(observer: Observer, kind: str, n_levels: int, repeats: int, rng: Rng) -> Subject:
    """The trials of one observer of a kind or with a fault, in random order and five blocks."""
    distinct = pairs(observer.task, n_levels)
    pair = rng.permutation(np.repeat(np.arange(len(distinct)), repeats))
    n_trials = len(pair)
    keys = distinct[pair]
    s1, s2 = keys.T
    noise = observer.parameters["noise"]
    shift = noise * shifts(kind, pair, keys, rng)

    uniform = rng.random(n_trials)
    sbar = s1.mean()
    is_yes = uniform < observer.p_questions(s1, s2 + shift, sbar)[0]
    if kind == "learning":
        is_yes = uniform < learning_p(observer, keys, sbar)
    if kind == "lapses to one response":
        is_yes |= rng.random(n_trials) < 0.08
    if kind == "previous response":
        after_no, after_yes = (
            observer.p_questions(s1, s2 + step * noise, sbar)[0] for step in (-0.3, 0.3)
        )
        for trial in range(1, n_trials):
            p_yes = after_yes if is_yes[trial - 1] else after_no
            is_yes[trial] = uniform[trial] < p_yes[trial]

    block = np.arange(n_trials) * N_BLOCKS // n_trials
    if kind == "guesses":
        is_yes = uniform < 0.5
    elif kind == "swapped keys":
        is_yes = ~is_yes
    elif kind == "one swapped block":
        is_yes ^= block == 1
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
    return Subject.from_answers(observer.name, answers, observer.task)


def sound_observers(task: Task, n_observers: int, seed: int, kind: str = "sound") -> list[Subject]:
    """Observers of the four models, so many of each design; or with a fault, in easy tasks."""
    subjects = []
    for (i, design), j in product(enumerate(DESIGNS), range(n_observers)):
        n_levels, repeats, noise = design
        if kind == "sound" or noise < 1.0:
            rng = np.random.default_rng([seed, TASKS.index(task), len(kind), i, j])
            observer = sound_observer(f"{kind} {i} {j}", task, noise, rng)
            subjects.append(simulate(observer, kind, n_levels, repeats, rng))
    return subjects


def kind_observers(kind: str, task: Task, n_observers: int, seed: int) -> list[Subject]:
    """Observers of one of the ten kinds."""
    subjects = []
    for i in range(n_observers):
        rng = np.random.default_rng([seed, TASKS.index(task), KINDS.index(kind), i])
        observer = kind_observer(f"{kind} {i}", kind, task, EFFECTS[i % len(EFFECTS)], rng)
        repeats = 40 if task == WHICH_STRONGER else 30
        subjects.append(simulate(observer, kind, 6, repeats, rng))
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
        codes: set[str] = set()
        # The limit of guesses is that of a study with a third of doubtful subjects.
        for finding in subject_findings(
            self.subject, n_subjects, self.alternatives, evidence_limit(n_subjects, share=0.05)
        ):
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
    evidences = order_evidence(subjects, seed, precision=_PRECISION)
    observers = zip(find_faults(subjects), evidences, strict=True)
    return [replace(one, answer=answer_evidence(evidence, seed)) for one, evidence in observers]


def study_rates(observers: list[Judged], task: Task, n_subjects: int) -> pd.Series:
    """Share of studies of so many subjects in which an alarm is raised at all, %, by alarm."""
    raised = Counter(chain.from_iterable(one.alarms(n_subjects) for one in observers))
    rates = {}
    for code in ALARMS:
        share = raised[code] / len(observers)
        rates[code] = f"{100.0 * (1.0 - (1.0 - share) ** n_subjects):.1f}"
    rates |= dict.fromkeys(TASK_ALARMS.values(), "-")
    rate = binom.sf(n_subjects // 2, n_subjects, raised["another_task"] / len(observers))
    rates[TASK_ALARMS[task]] = f"{100.0 * rate:.1f}"
    return pd.Series(rates)


def found_faults(fault: str, n_observers: int, seed: int) -> dict[str, str]:
    """How many observers with a fault get its alarm in a study of 12, by task."""
    row = {"fault": fault}
    for task, other in zip(TASKS, reversed(TASKS), strict=True):
        if fault == "other task":
            simulated = sound_observers(other, n_observers, seed, fault)
            subjects = [replace(subject, task=task, answers=None) for subject in simulated]
        else:
            subjects = sound_observers(task, n_observers, seed, fault)
        observers = find_faults(subjects)
        row[task.name] = count([FAULTS[fault] in one.alarms(STUDY_OF_KINDS) for one in observers])
    return row


# --- The ten kinds -------------------------------------------------------------------------------


def kind_row(kind: str, task: Task, observers: list[Judged]) -> dict[str, str]:
    """Refusals, flags, words and coverage of the observers of one kind."""
    alarms = [observer.alarms(STUDY_OF_KINDS) for observer in observers]
    row = {"observers": kind, "task": "2AFC" if task == WHICH_STRONGER else "same"}
    row["refused"] = f"{sum(not codes.isdisjoint(_REFUSING) for codes in alarms)}"
    raised = Counter(chain.from_iterable(alarms))
    row |= {name: f"{raised[code]}" for code, name in _SHORT_NAMES.items()}

    answers = [observer.answer for observer in observers]
    effects = np.resize(EFFECTS, (len(observers), 2))
    for true_sizes, question, symbol in zip(effects.T, _QUESTIONS, "cp", strict=True):
        is_yes = np.array([answer.words[question] == "yes" for answer in answers])
        row[f"false {symbol}"] = count(is_yes[true_sizes == 0.0])
        row[f"found {symbol}"] = count(is_yes[true_sizes != 0.0])
    low, _, high = np.array([answer.sizes["contraction_p"] for answer in answers]).T
    p = effects[:, 1]
    row["p covered"] = count(((low <= p) & (p <= high))[p != 0.0])
    return row


def count(is_there: Sequence[bool]) -> str:
    """How many are there."""
    return f"{sum(is_there)} of {len(is_there)}"


# --- The page ------------------------------------------------------------------------------------


def sound_table(observers: dict[Task, list[Judged]]) -> pd.DataFrame:
    """Rates of both tasks in per cent, an alarm a row."""
    table = pd.DataFrame(ALARMS, index=["alarm", "what it does"]).T
    for title, n_subjects in STUDIES.items():
        first, second = (study_rates(observers[task], task, n_subjects) for task in TASKS)
        table[title] = first + ", " + second
    return table


def main() -> None:
    """Simulate, and write the page."""
    parser = number_parser(__doc__, observers=100, kinds=120, faults=10, seed=2612)
    parser.add_argument("-o", "--output", type=Path, default=Path())
    options = parser.parse_args()
    seed = options.seed

    sound = {}
    for task in TASKS:
        sound[task] = judge(sound_observers(task, options.observers, seed), seed)
    faults = [found_faults(fault, options.faults, seed + 1) for fault in FAULTS]
    kinds = []
    for kind, task in product(KINDS, TASKS):
        observers = judge(kind_observers(kind, task, options.kinds, seed + 2), seed)
        kinds.append(kind_row(kind, task, observers))

    page = render(
        __file__,
        options=options,
        n_sound=options.observers * len(DESIGNS),
        sound=markdown(sound_table(sound)),
        faults=markdown(pd.DataFrame(faults)),
        kinds=markdown(pd.DataFrame(kinds)),
    )
    (options.output / "alarms.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
