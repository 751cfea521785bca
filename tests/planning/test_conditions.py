"""Planning for conditions within subjects: what is simulated, what is counted, and how trials are split."""

import numpy as np
import pandas as pd
import pytest
from commands import good, refused
from scipy.special import ndtri

import bayes_toe as bt
from bayes_toe.comparison.contrast import contrast
from bayes_toe.experiments.conditions import Differing
from bayes_toe.planning.observers import observers_from, prior_of
from bayes_toe.planning.power import Outcome
from bayes_toe.planning.power_of_conditions import (
    NOTHING,
    ConditionsPower,
    differences,
    planned_conditions,
    power_of_conditions,
    said_of,
    under_conditions,
)
from bayes_toe.planning.study_design import narrow_study_design, nobody

WIDE = narrow_study_design(np.linspace(-0.75, 1.25, 5), np.linspace(-0.3, 0.3, 5), 650)


@pytest.fixture(scope="module")
def people():
    return observers_from(None, 6, seed=1)[-6:]


def group_scales(one):
    target = one.target(nobody(one.task))
    found = target.quantities(one.point(target))
    return np.array([found["offset"][0], ndtri(found["pull"][0]), np.log(found["width"][0]), found["q0"][0]])


def test_an_observer_is_moved_by_what_is_asked_and_answers_as_before_in_the_middle(people):
    apart = {"constant error": (0.1, 0.0), "pull": (0.5, 0.0), "width": (-0.3, 0.0)}
    first, middle, last = under_conditions(people[0], Differing.of(("a", "b", "c"), apart), 1)
    assert middle.p_yes(WIDE) == pytest.approx(people[0].p_yes(WIDE), rel=1e-12)
    assert group_scales(last) - group_scales(first) == pytest.approx([0.1, 0.5, -0.3, 0.0])


def test_single_subjects_differ_by_the_mean_and_those_of_studies_scatter(people):
    planned = list(planned_conditions(people, {"pull": (0.5, 0.2)}, {1: 3, 3: 2}, 1))
    assert [(len(one.people), one.kind) for one in planned] == [
        *[(2, NOTHING)] * 3, *[(2, "pull +0.5")] * 3, *[(6, NOTHING)] * 2, *[(6, "pull +0.5")] * 2
    ]  # fmt: skip
    by = [np.diff([group_scales(one)[1] for one in study.people])[::2] for study in planned]
    assert np.concatenate(by[:3]) == pytest.approx(np.zeros(3), abs=1e-9)
    assert np.concatenate(by[3:6]) == pytest.approx(np.full(3, 0.5))
    scatter = np.concatenate(by[6:8])
    assert 0.02 < scatter.std() < 0.6
    assert np.concatenate(by[8:]) == pytest.approx(scatter + 0.5), "the same subjects, with a difference on average"


def test_words_are_those_of_contrast_of_the_same_answers():
    apart = {"constant error": (0.15, 0.0)}
    table = power_of_conditions(apart, WIDE, [200], studies={1: 1}, seed=1, workers=1)
    assert [one.kind for one in table] == [NOTHING, "constant error +0.15"]
    [known] = [one for one in observers_from(None, 1, seed=1) if one.kind == "update"]
    planned, asked = planned_conditions([known], apart, {1: 1}, 1), WIDE.with_total(200)
    without, found = (differences(asked, one, 1, prior_of([asked], None)) for one in planned)
    assert [one.said for one in table] == [said_of(without), said_of(found)]
    assert found["constant error"] > without["constant error"] + 2.0
    half = WIDE.with_total(100)
    units = under_conditions(known, Differing.of(("a", "b"), apart), 1)
    counts = [one.answers(half, bt.seeds.generator(1, one.name, "answers", 200)) for one in units]
    rows = [{"subject": "S", "condition": level, "s1": one.s1, "s2": one.s2, "n_equal": one.n_yes, "n_trials": one.n_trials}
            for level, one in zip("ab", counts, strict=True)]  # fmt: skip
    study = bt.read_study(pd.concat([pd.DataFrame(row) for row in rows]))
    [row] = contrast(study, seed=2, workers=1).some("constant error")
    assert found["constant error"] == pytest.approx(row.log_bf_differs, abs=0.3)


def test_words_are_counted():
    logs = {NOTHING: (3.5, 0.0, -1.5, -3.5), "pull +0.5": (3.5, 1.5, 4.0, None)}
    rows = [Outcome("d", 400, kind, 1, said_of({"pull": value})) for kind, values in logs.items() for value in values]
    found = ConditionsPower(tuple(rows), 1)
    shares = found.frame().set_index(["observers", "quantity"]).value
    assert shares["pull +0.5"].tolist() == [0.5, 0.75, 0.0, 0.0]
    assert shares[NOTHING].tolist() == [0.25, 0.25, 0.25, 0.5]
    [line] = found.sentences()
    assert "contrast says of single subjects that the pull differs in 75 % of 4 with pull +0.5" in line
    assert line.endswith("and wrongly in 1 of 4 without")


def test_the_commands(tmp_path, three_models):
    WIDE.save(tmp_path / "design.csv")
    asked = ("--trials", "100", "--data-sets", "1", "--differ", "pull=0.5", "--carry-over", "0.6", "--seed", "1", "--workers", "1")
    said = " ".join(good("power", "design.csv", *asked, "-o", "out", cwd=tmp_path).split())
    assert "with these pairs and 100 trials each, contrast says of single subjects that the pull differs in" in said
    assert "with these pairs and 100 trials, answers are said to follow the trials before" in said
    assert set(pd.read_csv(tmp_path / "out" / "power_history.csv").observers) == {"0.6 carried over", "nothing carried over"}
    table = pd.read_csv(tmp_path / "out" / "power_conditions.csv")
    assert set(table.observers) == {NOTHING, "pull +0.5"}
    said = good("design", "design.csv", "--list", "trials.csv", "--conditions", "left,right", "--blocks", "5", "--seed", "1", cwd=tmp_path)
    assert "1 subject, 1300 trials each in 5 blocks (650 in each of left, right, mixed within blocks)" in " ".join(said.split())
    assert refused("design", "design.csv", "--list", "t.csv", "--conditions", "left", cwd=tmp_path).startswith("error: --conditions: found")
    assert refused("design", "design.csv", "--conditions", "a,b", cwd=tmp_path).startswith("error: --conditions: allowed with --list")
    assert refused("power", "--differ", "gain=1", "--trials", "100", "-o", "o", cwd=tmp_path).startswith(
        "error: --differ: found 'gain=1:0'"
    )


def test_every_condition_has_every_trial_and_both_orders_in_every_block():
    trials = bt.planning.trial_list(WIDE, blocks=5, seed=1, conditions=("left", "right"))
    counts = pd.DataFrame({"block": trials.block, "condition": trials.condition, "s1": trials.s1, "s2": trials.s2}).value_counts()
    assert counts.groupby(["condition", "s1", "s2"]).sum().tolist() == [26] * 50
    assert set(counts.groupby(["block", "condition"]).sum()) <= set(range(120, 141))
    assert len(set(counts)) <= 2, "a pair is as often in one block as in another, up to one"
    assert len({tuple(trials.condition[:20])}) == 1 < len(set(trials.condition[:20])), "conditions are mixed"
