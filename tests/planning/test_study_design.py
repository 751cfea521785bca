"""Designs as files, and their trials."""

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.errors import InputError
from bayes_toe.planning.study_design import apportioned, narrow_study_design, paper_study_design


def test_a_design_comes_back_from_its_file(tmp_path):
    design = bt.StudyDesign([0.3, 0.0], [0.0, 0.1 + 0.2], [4, 7], isi=[1.0, 0.5])
    found = bt.read_study_design(design.save(tmp_path / "design.csv"))
    for key in ("s1", "s2", "n_trials", "isi"):
        assert np.array_equal(getattr(found, key), getattr(design, key))
    assert found.s1.tolist() == [0.0, 0.3]


def test_the_papers_pairs():
    design = paper_study_design(325)
    assert (design.n_pairs, design.total, set(design.n_trials.tolist())) == (13, 325, {25})


@pytest.mark.parametrize("trials", [25, 26, 70, 649, 651])
def test_every_pair_keeps_its_share_and_at_least_one_trial(trials):
    design = narrow_study_design(np.linspace(0.0, 1.0, 5), np.array([-0.2, -0.1, 0.0, 0.1, 0.2]), 650).with_total(trials)
    assert (design.total, design.n_trials.min() >= 1) == (trials, True)
    assert np.ptp(design.n_trials) <= 1


def test_shares_are_kept_as_far_as_whole_numbers_can():
    counts = apportioned(np.array([0.001, 0.3, 0.699]), 100)
    assert counts.tolist() == [1, 30, 69]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("s1,s2\n0,0\n", "design.csv: row 1, column n_trials: missing"),
        ("s1,s2,n_trials\n0,0,2.5\n", "row 2, column n_trials: found '2.5', allowed: a whole number of at least 1"),
        ("s1,s2,n_trials\n0,0,0\n", "row 2, column n_trials: found '0', allowed: a whole number of at least 1"),
        ("s1,s2,n_trials\n0,x,1\n", "row 2, column s2: found 'x', allowed: a finite number"),
        ("s1,s2,n_trials\n0,0,1\n0,0,2\n", "a pair of stimuli is repeated"),
        ("s1,s2,n_trials,isi\n0,0,1,-1\n", "isi must be positive"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(tmp_path, text, said):
    (tmp_path / "design.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        bt.read_study_design(tmp_path / "design.csv")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_fewer_trials_than_pairs_are_refused():
    with pytest.raises(InputError, match="12 trials for 13 pairs"):
        paper_study_design(12)
