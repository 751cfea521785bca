"""Observers are assumed amid what is shown: no number depends on the stimuli's zero, and who would never say 'equal' is refused."""

import numpy as np
import pytest
from commands import inside

import bayes_toe as bt
from bayes_toe.errors import InputError
from bayes_toe.planning.observers import assumed, middle_of, observers_from, prior_of
from bayes_toe.planning.optimal import MOVED, OPTIMISED, PAPER, DesignGoal, grid, optimal_design
from bayes_toe.planning.power import power
from bayes_toe.planning.stopping import StoppingRule, stopping
from bayes_toe.planning.study_design import StudyDesign, paper_study_design

PAIRS = StudyDesign([0.0, 0.0, 0.4, 0.4, 0.2, 0.2, 0.5], [0.0, 0.4, 0.0, 0.4, 0.2, 0.5, 0.2], [10] * 7)
WIDER = StudyDesign([-0.5, 1.0, 1.0], [-0.25, 1.0, 0.75], [10, 20, 30])
FAR = 4.0


def moved(designs):
    return {name: one.moved(FAR) for name, one in designs.items()}


@pytest.mark.parametrize("observers", [None, "prior"])
def test_a_constant_added_to_every_stimulus_changes_no_number_of_power(observers):
    given = {"narrow": PAIRS, "wider": WIDER}
    here, there = (power(designs, [280], observers, data_sets=1, seed=1, prior="stimuli", workers=1) for designs in (given, moved(given)))
    assert (here.failed, there.failed) == ({}, {})
    for one, other in zip(here.rows, there.rows, strict=True):
        assert (one.design, one.observer) == (other.design, other.observer)
        one, other = one.judgement, other.judgement
        assert other.log_evidence == pytest.approx(one.log_evidence, abs=0.05)  # the same answers; standard errors are below 0.02
        if one.widths is not None:
            assert np.log(other.widths) == pytest.approx(np.log(one.widths), abs=0.1)
    assert any(np.ptp(row.judgement.log_evidence) > 1.0 for row in there)  # they tell something


def test_sessions_that_stop_are_as_long():
    rule = StoppingRule(0.9, 140, 70)
    here, there = (stopping(one, rule, data_sets=1, seed=1, prior="stimuli", workers=1) for one in (PAIRS, PAIRS.moved(FAR)))
    assert [(row.trials, row.named) for row in there] == [(row.trials, row.named) for row in here]


def test_a_constant_added_to_the_range_changes_no_chosen_pair():
    """A range of 1.2 near ln 40, of a vibration's rate in Hz, was once refused as too narrow."""
    here, there = (
        optimal_design(grid(low, low + 1.2, 0.3), 280, DesignGoal(max_pairs=8), data_sets=1, seed=1, prior="stimuli", workers=1)
        for low in (-0.35, 3.3)
    )
    assert there.design.s1 - 3.65 == pytest.approx(here.design.s1)
    assert there.design.s2 - 3.65 == pytest.approx(here.design.s2)
    assert np.array_equal(there.design.n_trials, here.design.n_trials)
    assert there.candidates[OPTIMISED].utility == pytest.approx(here.candidates[OPTIMISED].utility, rel=1e-6)
    assert there.candidates[MOVED].utility == pytest.approx(here.candidates[PAPER].utility, rel=1e-6)
    assert there.candidates[MOVED].design.s1 == pytest.approx(paper_study_design().s1 + 3.65)
    assert [row.judgement.named() for row in there.power] == [row.judgement.named() for row in here.power]
    assert any("from 3.65 to 4.16, amid what can be shown" in line for line in there.said())


def test_all_designs_share_one_middle_and_the_papers_stays_where_it_is_amid_them():
    assert middle_of([paper_study_design(), WIDER]) == 0.25
    assert middle_of([PAIRS.moved(FAR)]) == 4.25
    assert middle_of([StudyDesign([0.2], [6.0], [1])]) == 3.1  # 0.25 is within the range, at its edge
    people = assumed(None, moved({"narrow": PAIRS, "wider": WIDER}), 2, 1, None)
    assert {one.centre for one in people} == {4.25}
    assert assumed(None, {"paper": paper_study_design()}, 2, 1, None) == observers_from(None, 2, seed=1)


def test_quantities_hold_over_the_designs_own_interval():
    """One interval only, however long, changes nothing: it is the unit."""
    timed = StudyDesign(PAIRS.s1, PAIRS.s2, PAIRS.n_trials, np.full(7, 0.3))
    for observers in (None, "prior"):
        with_, without = (assumed(observers, {"d": one}, 1, 1, "stimuli")[-1] for one in (timed, PAIRS))
        assert (with_.interval, without.interval) == (0.3, 1.0)
        assert with_.equal(timed) == pytest.approx(without.equal(PAIRS), rel=1e-12)
    assert prior_of([timed, PAIRS], None).reference_interval == 0.3
    assert prior_of([timed, WIDER], "stimuli").mu1_mean == prior_of([PAIRS, WIDER], "stimuli").mu1_mean


STATED = "[none]\nwidth = 0.3\nq0 = 0.9\n[update]\npull = 0.35\nwidth = 0.3\nq0 = 0.9\n{}\n"


def test_stated_observers_stay_as_stated_and_what_is_not_stated_is_amid(tmp_path):
    for text, mu1 in (("mu1 = 3.0", 3.0), ("offset = 0", 4.25)):
        (tmp_path / "people.toml").write_text(STATED.format(text), encoding="utf-8")
        people = assumed(tmp_path / "people.toml", {"d": PAIRS.moved(FAR)}, 1, 1, None)
        assert people[-1].quantities["mu1"] == pytest.approx(mu1)


@pytest.mark.parametrize("lapses", ["", "lapse_rate = 0.1"])
def test_who_would_find_identical_stimuli_different_is_refused(tmp_path, lapses):
    (tmp_path / "people.toml").write_text(STATED.format("mu1 = 0.4\n" + lapses), encoding="utf-8")
    designs = {"near": PAIRS, "far": PAIRS.moved(FAR)}
    with pytest.raises(
        InputError, match=r"with far, stimuli from 4 to 4.5, P\(equal\) of all observers of the kind 'update' is below 0.01"
    ):
        assumed(tmp_path / "people.toml", designs, 2, 1, None)
    with pytest.raises(InputError, match="with far"):
        assumed(observers_from(tmp_path / "people.toml", 2, 1), designs, 2, 1, None)
    with pytest.raises(InputError, match=r"with near, stimuli from 0 to 0\.5, .*; allowed: designs of neighbouring stimuli"):
        assumed(None, {"near": PAIRS, "far": PAIRS.moved(9.0)}, 2, 1, None)
    few = StudyDesign([0.0, 3.0], [3.0, 0.0], [10, 10])  # of which nothing is told either, but by the pairs' fault
    assert assumed(tmp_path / "people.toml", {"near": PAIRS, "few": few}, 1, 1, None)


DESIGN = ("design", "--lowest", "3.3", "--highest", "4.5", "--step", "0.2", "-o", "o.csv")


@pytest.mark.parametrize(
    ("mu1", "asked", "said"),
    [
        (0.4, ("power", "d.csv"), "observers: with these pairs, stimuli from 4 to 4.5, P(equal) of all observers of the kind 'update'"),
        (-9, DESIGN, "observers: with the pairs that can be shown, stimuli from 3.3 to 4.5, P(equal) of all"),
        (0.4, DESIGN, "a wider range, or more trials, or observers nearer to it than these, whose mu1 is 0.4 (of 10"),
    ],
)
def test_the_commands_refuse_them_in_one_line(tmp_path, mu1, asked, said):
    (tmp_path / "people.toml").write_text(STATED.format(f"mu1 = {mu1}"), encoding="utf-8")
    PAIRS.moved(FAR).save(tmp_path / "d.csv")
    done = inside(*asked, "--observers", "people.toml", "--trials", "70", "--seed", "1", "--workers", "1", cwd=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert said in done.stderr


def test_a_session_takes_a_prior_of_the_stimuli():
    session = bt.Adaptive(PAIRS.moved(FAR), prior="stimuli", seed=1, draws=512)
    assert session.prior.mu1_mean == pytest.approx(FAR + np.mean([PAIRS.s1, PAIRS.s2]))
