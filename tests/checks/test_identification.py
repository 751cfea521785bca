"""Identification: each row of the table where it holds, and where it does not."""

import itertools
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from conftest import BOTH_TASKS
from serial_observers import neighbouring_pairs

import bayes_toe as bt
from bayes_toe.checks.identification import IMITATION, QUESTIONS, identify
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.design.study_design import reference_design

LEVELS = (0.0, 0.14, 0.31, 0.44, 0.51)
GRID = list(itertools.product(LEVELS, repeat=2))
CONTRACTION = ("contraction",)
CRITERION = "a response bias predict the same responses"


def make_subject(pairs, task=SAME_DIFFERENT, n_trials=20):
    """A subject who gives either answer in half of the trials of each pair (s1, s2)."""
    s1, s2 = np.transpose(pairs)
    return bt.Subject("S", s1, s2, [n_trials // 2] * len(s1), [n_trials] * len(s1), task=task)


#: Pairs of stimuli, the questions that they cannot answer, and a part of the reason.
@BOTH_TASKS
@pytest.mark.parametrize(
    "pairs, unknown, reason",
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
def test_the_pairs_decide_which_questions_can_be_told(pairs, unknown, reason, task):
    """In every unit of the stimuli. Of 2AFC, a note says that a response bias may be the cause."""
    for scale, shift in ((1.0, 0.0), (1e-9, 0.0), (1e9, 3e9)):
        moved = [(scale * s1 + shift, scale * s2 + shift) for s1, s2 in pairs]
        identified = identify(make_subject(moved, task))
        assert tuple(identified.reasons) == unknown
        assert reason in " ".join(set(identified.reasons.values()))
        assert (CRITERION in " ".join(identified.notes)) == (task == WHICH_STRONGER)


@BOTH_TASKS
def test_roved_stimuli_need_both_signs_but_no_repeated_pairs(task):
    """One trial of each of 200 pairs whose first stimulus is random."""
    rng = np.random.default_rng(1)
    s1, step = rng.normal(0.0, 2.0, 200), np.abs(rng.normal(0.0, 0.3, 200))
    always_rising = np.column_stack([s1, s1 + step])
    assert identify(make_subject(always_rising, task, n_trials=1)).reasons
    step[::2] *= -1.0
    of_both_signs = np.column_stack([s1, s1 + step])
    assert not identify(make_subject(of_both_signs, task, n_trials=1)).reasons


def read_trials(**columns):
    """The only subject of a file with 80 trials, whose responses alternate."""
    responses = ["equal", "different"] * 40
    return bt.read_study(pd.DataFrame({"subject": "a", "response": responses, **columns}))["a"]


def orders(is_rising):
    """Columns s1 and s2 of four pairs in turn; the weaker stimulus is first in rising trials."""
    weak, strong = np.zeros(80), np.tile([0.1, 0.2, 0.3, 0.4], 20)
    return {"s1": np.where(is_rising, weak, strong), "s2": np.where(is_rising, strong, weak)}


TRIAL = np.arange(80)
BLOCKS = {"block": TRIAL // 20}
SESSIONS = {"trial": TRIAL, "session": TRIAL // 20}


#: How many trials in a row have the same order of stimuli, the columns that say when each trial
#: was, and whether the file can show an order effect. Sorted rows alone are no order of trials. If
#: each block or session, or each long stretch of trials, has one order, the effect of the order
#: cannot be distinguished from a change over time.
@pytest.mark.parametrize(
    "stretch, columns, is_identified",
    [
        (20, BLOCKS, False),
        (20, SESSIONS, False),
        (40, {"trial": TRIAL}, False),
        (10, {"trial": TRIAL}, False),
        (2, {"trial": TRIAL}, True),
        (1, BLOCKS, True),
        (20, {}, True),
    ],
)
def test_an_order_that_fills_its_own_blocks_cannot_be_told(stretch, columns, is_identified):
    is_rising = TRIAL // stretch % 2 == 0
    reasons = identify(read_trials(**orders(is_rising), **columns)).reasons
    assert ("order_effect" not in reasons) == is_identified


def test_one_trial_of_the_other_order_in_each_block_is_enough_to_pass():
    # Blocks of 20 trials alternate; the eighth trial of each has the other order.
    is_rising = (TRIAL // 20 % 2 == 0) ^ (TRIAL % 20 == 7)
    reasons = identify(read_trials(**orders(is_rising), **BLOCKS)).reasons
    assert "order_effect" not in reasons


def is_imitated(pairs, task, n_trials=20):
    """Whether noise that changes with intensity may look like a contraction, and nothing else."""
    reasons = identify(make_subject(pairs, task, n_trials)).reasons
    assert set(reasons) <= {"contraction"}
    return reasons == {"contraction": IMITATION}


def test_missed_trials_change_no_design():
    # These pairs say hardly more about a contraction than its prior does.
    planned = make_subject([pair for pair in GRID if 0.14 in pair], WHICH_STRONGER, n_trials=4)
    missed = replace(planned, n_trials=planned.n_trials - (planned.s1 != 0.14))
    assert identify(missed) == identify(planned)


def test_the_papers_pairs_cannot_show_a_contraction_whatever_the_trials():
    """Other pairs can, and so can the paper's in 2AFC."""
    paper = reference_design().pairs
    for n_trials in (2, 20, 10**9):
        assert is_imitated(paper, SAME_DIFFERENT, n_trials)
        assert not is_imitated(paper, WHICH_STRONGER, n_trials)
        assert not is_imitated(neighbouring_pairs(SAME_DIFFERENT), SAME_DIFFERENT, n_trials)
