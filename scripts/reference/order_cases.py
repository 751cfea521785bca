"""Subjects of both tasks whose evidences of the four models are known by tempering.

They are synthetic. Counts of an observer are its rounded expected counts, so a case has no seed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np

import bayes_toe as bt
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER, Task
from bayes_toe.design.observers import make_observer
from bayes_toe.design.study_design import StudyDesign
from reference.hard_cases import hard_cases

_LEVELS = 0.25 * np.arange(6)
#: Every level before and after the next one, and the same with identical pairs.
NEIGHBOURS = [(a, b) for a, b in permutations(_LEVELS, 2) if abs(a - b) < 0.3]
WITH_IDENTICAL = [*NEIGHBOURS, *zip(_LEVELS, _LEVELS, strict=True)]
#: First stimuli that spread ten times as far as the two of a pair are apart.
_ROVED = [(base, base + shift) for base in np.linspace(-3.0, 3.0, 12) for shift in (-0.2, 0.2)]


def order_cases() -> dict[str, bt.Subject]:
    """The collection, by name."""
    example = bt.example_study("same/different")
    stronger = bt.simulate(12, batches=40, seed=2604, task="2afc").study
    hard = hard_cases()
    cases = {
        "same/different, bundled S01": example["S01"],
        "same/different, bundled S09": example["S09"],
        "same/different, perfect": hard["perfect observer"],
        "same/different, always equal": hard["all equal"],
        "same/different, guesses": hard["guessing at 0.5"],
        "same/different, one trial a pair": hard["one batch"],
        "same/different, lapses": _observer(
            SAME_DIFFERENT, WITH_IDENTICAL, 40, lapse_rate=0.3, constant_error=0.2
        ),
        "same/different, repulsion": _observer(
            SAME_DIFFERENT, WITH_IDENTICAL, 40, contraction=-0.5
        ),
        "2AFC, simulated S01": stronger["S01"],
        "2AFC, simulated S07": stronger["S07"],
        "2AFC, perfect": _observer(WHICH_STRONGER, NEIGHBOURS, 40, noise=1e-3),
        "2AFC, always second": _observer(WHICH_STRONGER, NEIGHBOURS, 40, constant_error=-50.0),
        "2AFC, two trials a pair": _observer(WHICH_STRONGER, NEIGHBOURS, 2, constant_error=0.2),
        "2AFC, lapses": _observer(
            WHICH_STRONGER, NEIGHBOURS, 65, lapse_rate=0.3, constant_error=0.25
        ),
        "2AFC, repulsion": _observer(
            WHICH_STRONGER, NEIGHBOURS, 65, contraction=-0.5, constant_error=0.25
        ),
        "2AFC, roved stimuli": _observer(WHICH_STRONGER, _ROVED, 30, contraction=0.03),
    }
    return {name: replace(case, name=name) for name, case in cases.items()}


def _observer(
    task: Task, pairs: Sequence[tuple[float, float]], n: int, **parameters: float
) -> bt.Subject:
    """Expected counts of an observer with q0 = .95, n trials a pair."""
    s1, s2 = np.transpose(pairs)
    design = StudyDesign(s1, s2, np.full(len(s1), n), task=task)
    values = {"noise": 0.2, "lapse_rate": 0.02, **parameters}
    if task == SAME_DIFFERENT:
        values["q0"] = 0.95
    p_yes = make_observer("case", "case", values, task).p_design(design)[0]
    # Halves go to even numbers, whatever the last digit is.
    return design.answered(np.rint((n * p_yes).round(9)).astype(np.int64))
