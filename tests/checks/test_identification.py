"""Identification: each row of the table where it holds, and where it does not."""

import itertools
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from conftest import BOTH_TASKS, subject_of_pairs
from serial_observers import neighbouring_pairs

import bayes_toe as bt
from bayes_toe.checks.identification import IMITATION, QUESTIONS, identify
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.design.study_design import reference_design

LEVELS = (0.0, 0.14, 0.31, 0.44, 0.51)
GRID = list(itertools.product(LEVELS, repeat=2))
CONTRACTION = ("contraction",)
CRITERION = "a response bias predict the same responses"


@BOTH_TASKS
@pytest.mark.parametrize(
    # Pairs of stimuli, the questions that they cannot answer, and a part of the reason.
    "pairs, unknown_questions, reason",
    [
        (GRID, (), ""),
        ([pair for pair in GRID if pair[0] <= pair[1]], QUESTIONS, "one order only"),
        ([pair for pair in GRID if pair[0] >= pair[1]], QUESTIONS, "one order only"),
        ([(s, s) for s in LEVELS], QUESTIONS, "two different stimuli"),
        ([(0.3, s) for s in LEVELS], CONTRACTION, "first stimulus is always the same"),
        ([(s, 0.3) for s in LEVELS], CONTRACTION, "linear function"),
        ([(s, 0.4 - s) for s in LEVELS], CONTRACTION, "linear function"),
        ([(0.0, 0.3), (0.3, 0.0)], CONTRACTION, "linear function"),
        ([(0.0, 0.3), (0.1, 0.3), (0.1 + 0.2, 0.3)], QUESTIONS, "one order only"),
    ],
)
def test_the_pairs_decide_which_questions_can_be_told(pairs, unknown_questions, reason, task):
    """The unit of the stimuli does not matter. In 2AFC, a note names a response bias as a cause."""
    for scale, shift in ((1.0, 0.0), (1e-9, 0.0), (1e9, 3e9)):
        changed_pairs = [(scale * s1 + shift, scale * s2 + shift) for s1, s2 in pairs]
        identification = identify(subject_of_pairs(changed_pairs, task=task))
        assert tuple(identification.reasons) == unknown_questions
        assert reason in " ".join(set(identification.reasons.values()))
        assert (CRITERION in " ".join(identification.notes)) == (task == WHICH_STRONGER)


@BOTH_TASKS
def test_roved_stimuli_need_both_signs_but_no_repeated_pairs(task):
    """One trial of each of 200 pairs whose first stimulus is random."""
    rng = np.random.default_rng(1)
    s1 = rng.normal(0.0, 2.0, 200)
    step = np.abs(rng.normal(0.0, 0.3, 200))
    rising_pairs = np.column_stack([s1, s1 + step])
    assert identify(subject_of_pairs(rising_pairs, 1, task=task)).reasons
    step[::2] *= -1.0
    pairs_of_both_signs = np.column_stack([s1, s1 + step])
    assert not identify(subject_of_pairs(pairs_of_both_signs, 1, task=task)).reasons


def read_trials(**columns):
    """The only subject of a file with 80 trials, whose responses alternate."""
    responses = ["equal", "different"] * 40
    return bt.read_study(pd.DataFrame({"subject": "a", "response": responses, **columns}))["a"]


def orders(is_rising):
    """Columns s1 and s2 of four pairs in turn; the weaker stimulus is first in rising trials."""
    weak = np.zeros(80)
    strong = np.tile([0.1, 0.2, 0.3, 0.4], 20)
    return {"s1": np.where(is_rising, weak, strong), "s2": np.where(is_rising, strong, weak)}


TRIAL = np.arange(80)
BLOCKS = {"block": TRIAL // 20}
SESSIONS = {"trial": TRIAL, "session": TRIAL // 20}


@pytest.mark.parametrize(
    # How many trials in a row have the same order of stimuli, the columns that say when each trial
    # was, and whether the file can show an order effect.
    "stretch, columns, is_identified",
    [
        (20, BLOCKS, False),  # each block has one order
        (20, SESSIONS, False),  # each session has one order
        (40, {"trial": TRIAL}, False),
        (10, {"trial": TRIAL}, False),  # each long stretch of trials has one order
        (2, {"trial": TRIAL}, True),
        (1, BLOCKS, True),
        (20, {}, True),  # rows alone are no order of trials
    ],
)
def test_an_order_that_fills_its_own_blocks_cannot_be_told(stretch, columns, is_identified):
    # If the order changes only from block to block, its effect may be a change over time.
    stretch_of_trial = TRIAL // stretch
    trials = read_trials(**orders(stretch_of_trial % 2 == 0), **columns)
    reasons = identify(trials).reasons
    assert ("order_effect" not in reasons) == is_identified


def test_one_trial_of_the_other_order_in_each_block_is_enough_to_pass():
    # Blocks of 20 trials alternate; the eighth trial of each has the other order.
    is_rising = (TRIAL // 20 % 2 == 0) ^ (TRIAL % 20 == 7)
    reasons = identify(read_trials(**orders(is_rising), **BLOCKS)).reasons
    assert "order_effect" not in reasons


def is_imitated(pairs, task, n_trials=20):
    """Whether noise that changes with intensity may look like a contraction, and nothing else."""
    reasons = identify(subject_of_pairs(pairs, n_trials, task=task)).reasons
    assert set(reasons) <= {"contraction"}
    return reasons == {"contraction": IMITATION}


def test_missed_trials_change_no_design():
    # These pairs say hardly more about a contraction than its prior does.
    subject = subject_of_pairs([pair for pair in GRID if 0.14 in pair], 4, task=WHICH_STRONGER)
    with_missed_trials = replace(subject, n_trials=subject.n_trials - (subject.s1 != 0.14))
    assert identify(with_missed_trials) == identify(subject)


def test_the_papers_pairs_cannot_show_a_contraction_whatever_the_trials():
    """Other pairs can, and so can the paper's in 2AFC."""
    paper = reference_design().pairs
    for n_trials in (2, 20, 10**9):
        assert is_imitated(paper, SAME_DIFFERENT, n_trials)
        assert not is_imitated(paper, WHICH_STRONGER, n_trials)
        assert not is_imitated(neighbouring_pairs(SAME_DIFFERENT), SAME_DIFFERENT, n_trials)
