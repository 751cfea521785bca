"""Designs as files, and numbers of trials that are shared among pairs."""

import numpy as np
import pytest
from conftest import columns, refused

import bayes_toe as bt
from bayes_toe.design.study_design import (
    full_design,
    paper_study_design,
    reference_design,
)


def test_a_design_comes_back_from_its_file(tmp_path):
    """Its pairs are sorted, and 0.30000000000000004 needs 17 digits."""
    design = bt.design.StudyDesign(*columns("0.3 0 4, 0 0.30000000000000004 7"))
    loaded = bt.design.read_study_design(design.save(tmp_path / "design.csv"))
    assert loaded.pairs == [(0.0, 0.30000000000000004), (0.3, 0.0)]
    assert loaded.n_trials.tolist() == [7, 4]


@pytest.mark.parametrize("trials", [13, 25, 70, 649, 651])
def test_every_pair_keeps_its_share_and_at_least_one_trial(trials):
    design = paper_study_design().with_total(trials)  # 13 pairs with equal shares
    assert design.total == trials
    assert design.n_trials.min() >= 1
    assert np.ptp(design.n_trials) <= 1


def test_a_repeated_pair_is_refused(tmp_path):
    (tmp_path / "design.csv").write_text("s1,s2,n_trials\n0,0,1\n0,0,2\n")
    with refused(r"design\.csv: .*a pair of stimuli is repeated"):
        bt.design.read_study_design(tmp_path / "design.csv")


def test_the_reference_design_is_that_of_the_paper():
    """Methods: 5 amplitudes, in units of the reference, and 50 trials of each of 13 pairs."""
    design = reference_design()
    assert np.exp(np.unique(design.s1)) == pytest.approx([1.0, 1.15, 1.36, 1.55, 1.66])
    assert set(design.n_trials) == {50}
    pairs = set(design.pairs)
    assert len(pairs) == len(design.pairs) == 13
    # 5 equal pairs, and the reference with each of the 4 others in both orders.
    assert (design.s1 == design.s2).sum() == 5
    for s1, s2 in pairs:
        assert (s2, s1) in pairs


def test_the_full_design_has_every_ordered_pair_of_the_five_stimuli():
    assert len(set(full_design().pairs)) == 25
