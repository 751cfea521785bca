"""Lists of trials: every trial once, blocks alike, orders balanced, few equal pairs in a row."""

from collections import Counter

import numpy as np
import pandas as pd
import pytest
from commands import refusal_of, run_ok
from conftest import columns, refused
from populations import grid_design

import bayes_toe as bt
from bayes_toe.design.study_design import StudyDesign, paper_study_design
from bayes_toe.design.trial_list import trial_list

DESIGNS = {
    "paper": paper_study_design(),
    "narrow": grid_design(np.linspace(-0.75, 1.25, 5), [-0.3, -0.15, 0.0, 0.15, 0.3], 654),
    "many equal": StudyDesign(*columns("0 0 100, 0 0.3 40, 0.3 0 40")),
    "odd": StudyDesign(*columns("0 0 7, 0 0.3 33, 0.3 0 21, 0.3 0.3 9")),
}


EACH_DESIGN = pytest.mark.parametrize("design", DESIGNS.values(), ids=DESIGNS)
EACH_NUMBER_OF_BLOCKS = pytest.mark.parametrize("blocks", [1, 4, 10])


@EACH_DESIGN
@EACH_NUMBER_OF_BLOCKS
def test_every_trial_of_the_design_is_listed_once(design, blocks):
    trials = trial_list(design, blocks=blocks, seed=1)
    n_listed = Counter(zip(trials.s1, trials.s2, strict=True))
    assert n_listed == dict(zip(design.pairs, design.n_trials.tolist(), strict=True))


@EACH_DESIGN
@EACH_NUMBER_OF_BLOCKS
def test_three_equal_pairs_follow_each_other_at_most(design, blocks):
    trials = trial_list(design, blocks=blocks, seed=1)
    marks = np.where(trials.s1 == trials.s2, "=", " ")  # one of each trial
    assert "====" not in "".join(marks)


@EACH_DESIGN
@EACH_NUMBER_OF_BLOCKS
def test_blocks_are_alike_in_size_and_in_pairs(design, blocks):
    """Numbers differ by a trial, or by two, because both orders of a pair stay together."""
    trials = trial_list(design, blocks=blocks, seed=1)
    sizes = np.bincount(trials.block)[1:]  # blocks count from 1
    assert len(sizes) == blocks
    assert np.ptp(sizes) <= 2
    for s1, s2 in design.pairs:
        is_pair = (trials.s1 == s1) & (trials.s2 == s2)
        n_in_block = np.bincount(trials.block[is_pair], minlength=blocks + 1)[1:]
        assert np.ptp(n_in_block) <= 2


def test_both_orders_equally_often_in_every_block():
    design = paper_study_design()
    n_trials = np.where(design.s1 == design.s2, 51, 47)  # no multiples of the blocks
    design = StudyDesign(design.s1, design.s2, n_trials)
    trials = trial_list(design, blocks=10, seed=3)
    n_listed = Counter(zip(trials.block, trials.s1, trials.s2, strict=True))
    for block, s1, s2 in n_listed:
        assert n_listed[block, s1, s2] == n_listed[block, s2, s1]


def test_equal_pairs_are_spread_over_a_block_evenly():
    design = paper_study_design().with_total(130)  # 5 of 13 pairs are equal: 50 trials
    n_equal = np.zeros(130)  # in 100 lists, for each place in the list
    for i in range(100):
        trials = trial_list(design, blocks=1, subject=str(i), seed=1)
        n_equal += trials.s1 == trials.s2
    expected = 50 / 130 * 100
    quarters = np.array_split(n_equal, 4)
    # The SD of a mean of about 32 places is below 0.9: a false alarm in 10,000 runs.
    assert [quarter.mean() for quarter in quarters] == pytest.approx([expected] * 4, abs=3.6)


def test_the_order_of_trials_depends_on_the_subject_and_the_seed():
    def first_stimuli(subject, seed):
        """The first stimulus of each trial of a subject's list."""
        design = paper_study_design().with_total(130)
        return trial_list(design, subject=subject, seed=seed).s1.tolist()

    stimuli = first_stimuli("S01", seed=1)
    assert first_stimuli("S01", seed=1) == stimuli
    assert first_stimuli("S02", seed=1) != stimuli
    assert first_stimuli("S01", seed=2) != stimuli


def test_a_filled_in_list_is_a_study_that_run_reads(tmp_path):
    """The list has no responses before the experiment, and is refused until they are filled in."""
    design = paper_study_design().with_total(130)
    design.save(tmp_path / "design.csv")
    options = "--list trials.csv --blocks 5 --subjects 2 --seed 4"
    run_ok("design design.csv", *options.split(), cwd=tmp_path)
    assert "found no response in any of 260 rows" in refusal_of("check trials.csv", cwd=tmp_path)
    frame = pd.read_csv(tmp_path / "trials.csv")
    frame["response"] = np.where(frame.s1 == frame.s2, "equal", "different")
    frame.to_csv(tmp_path / "answers.csv", index=False)
    study = bt.read_study(tmp_path / "answers.csv")
    assert study.names == ("S01", "S02")
    for subject in study:
        assert np.array_equal(subject.n_trials, design.n_trials)


def test_each_condition_has_all_pairs():
    design = DESIGNS["odd"]
    trials = trial_list(design, blocks=2, seed=1, conditions=("left", "right"))
    n_listed = Counter(zip(trials.s1, trials.s2, strict=True))
    assert n_listed == dict(zip(design.pairs, (2 * design.n_trials).tolist(), strict=True))
    assert set(Counter(trials.condition).values()) == {design.total}  # in each condition
    assert trials.trial.tolist() == list(range(1, 2 * design.total + 1))
    assert np.ptp(np.bincount(trials.block)[1:]) <= 2  # blocks count from 1, and are alike


@pytest.mark.parametrize(
    # Numbers of trials of an equal pair and of a different pair, options, and the refusal.
    "n_trials, options, message",
    [
        ([90, 10], {"blocks": 10}, "block 1, of 10 trials, has 9 equal pairs: more than 3 would"),
        ([1, 1], {"blocks": 3}, "--blocks 3: allowed is 1 to 2"),
    ],
)
def test_what_cannot_be_listed_is_refused(n_trials, options, message):
    with refused(message):
        trial_list(StudyDesign([0, 0], [0, 1], n_trials), seed=1, **options)
