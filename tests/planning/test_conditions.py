"""Planning for conditions within subjects: what is simulated, what is counted, and how trials are split."""

import numpy as np
import pandas as pd
import pytest
from commands import good, refused
from scipy.special import ndtri

import bayes_toe as bt
from bayes_toe.answers.contrast import contrast
from bayes_toe.experiments.conditions import Differing
from bayes_toe.planning.observers import observers_from
from bayes_toe.planning.power import Outcome
from bayes_toe.planning.power_of_conditions import (
    NOTHING,
    ConditionsPower,
    planned_conditions,
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
    return np.array(
        [found["offset"][0], ndtri(found["pull"][0]), np.log(found["width"][0]), found["q0"][0]]
    )


def test_an_observer_is_moved_by_what_is_asked_and_answers_as_before_in_the_middle(people):
    apart = {"constant error": (0.1, 0.0), "pull": (0.5, 0.0), "width": (-0.3, 0.0)}
    first, middle, last = under_conditions(people[0], Differing.of(("a", "b", "c"), apart), 1)
    assert middle.p_yes(WIDE) == pytest.approx(people[0].p_yes(WIDE), rel=1e-12)
    assert group_scales(last) - group_scales(first) == pytest.approx([0.1, 0.5, -0.3, 0.0])


def test_single_subjects_differ_by_the_mean_and_those_of_studies_scatter(people):
    planned = list(planned_conditions(people, {"pull": (0.5, 0.2)}, {1: 3, 3: 2}, 1))
    expected = [
        (size, kind, many) for size, many in ((2, 3), (6, 2)) for kind in (NOTHING, "pull +0.5")
    ]
    assert [(len(one.people), one.kind) for one in planned] == [
        (size, kind) for size, kind, many in expected for _ in range(many)
    ]
    by = [np.diff([group_scales(one)[1] for one in study.people])[::2] for study in planned]
    assert np.concatenate(by[:6]) == pytest.approx(np.repeat([0.0, 0.5], 3), abs=1e-9)
    scatter = np.concatenate(by[6:8])
    assert 0.02 < scatter.std() < 0.6
    assert np.concatenate(by[8:]) == pytest.approx(scatter + 0.5), (
        "the same subjects, with a difference on average"
    )


def test_the_command_has_the_words_of_contrast_of_the_same_answers_and_those_of_histories(
    tmp_path, three_models, blank_figure
):
    WIDE.save(tmp_path / "design.csv")
    asked = (
        "--trials",
        "200",
        "--data-sets",
        "1",
        "--differ",
        "constant error=0.15",
        "--carry-over",
        "0.6",
        "--seed",
        "1",
    )
    said = " ".join(
        good("power", "design.csv", *asked, "--workers", "1", "-o", "out", cwd=tmp_path).split()
    )
    assert (
        "with these pairs and 200 trials each, contrast says of single subjects that the constant error differs in 100 % of 1 with"
        in said
    )
    assert "with these pairs and 200 trials, answers are said to follow the trials before" in said
    assert set(pd.read_csv(tmp_path / "out" / "power_history.csv").observers) == {
        "0.6 carried over",
        "nothing carried over",
    }
    table = (
        pd.read_csv(tmp_path / "out" / "power_conditions.csv")
        .set_index(["observers", "quantity"])
        .value
    )
    [known] = [one for one in observers_from(None, 1, seed=1) if one.kind == "update"]
    units = under_conditions(known, Differing.of(("a", "b"), {"constant error": (0.15, 0.0)}), 1)
    half = WIDE.with_total(100)
    counts = [one.answers(half, bt.seeds.generator(1, one.name, "answers", 200)) for one in units]
    rows = [
        bt.Study((one,)).frame().assign(subject="S", condition=level)
        for level, one in zip("ab", counts, strict=True)
    ]
    by_hand = {
        {"contraction": "pull", "JND": "width"}.get(row.quantity, row.quantity): row.log_bf_differs
        for row in contrast(bt.read_study(pd.concat(rows)), seed=2, workers=1)
    }
    assert by_hand["constant error"] > 1.5, "far from a Bayes factor of 3"
    assert table["constant error +0.15"].to_dict() == said_of(by_hand)
    assert table[NOTHING]["constant error: differs, probably or not"] == 0.0


def test_words_are_counted():
    logs = {NOTHING: (3.5, 0.0, -3.2, -3.5), "pull +0.5": (3.5, 1.5, 4.0, None)}
    rows = [
        Outcome("d", 400, kind, 1, said_of({"pull": value}))
        for kind, values in logs.items()
        for value in values
    ]
    found = ConditionsPower(tuple(rows), 1)
    shares = found.frame().set_index(["observers", "quantity"]).value
    assert shares["pull +0.5"].tolist() == [0.5, 0.75, 0.0, 0.0]
    assert shares[NOTHING].tolist() == [0.25, 0.25, 0.5, 0.5]
    [line] = found.sentences()
    assert (
        "contrast says of single subjects that the pull differs in 75 % of 4 with pull +0.5" in line
    )
    assert line.endswith("and wrongly in 1 of 4 without")


def test_every_condition_has_every_trial_and_both_orders_in_every_block(tmp_path):
    WIDE.save(tmp_path / "design.csv")
    asked = (
        "design",
        "design.csv",
        "--list",
        "trials.csv",
        "--blocks",
        "5",
        "--seed",
        "1",
        "--conditions",
    )
    assert "1300 trials each in 5 blocks (650 in each of left, right, mixed" in " ".join(
        good(*asked, "left,right", cwd=tmp_path).split()
    )
    trials = pd.read_csv(tmp_path / "trials.csv")
    counts = trials[["block", "condition", "s1", "s2"]].value_counts()
    assert counts.groupby(["condition", "s1", "s2"]).sum().tolist() == [26] * 50
    assert set(counts.groupby(["block", "condition"]).sum()) <= set(range(120, 141))
    assert len(set(counts)) <= 2, "a pair is as often in one block as in another, up to one"
    assert len(set(trials.condition[:20])) > 1, "conditions are mixed"
    assert "--conditions: allowed with --list" in refused(
        "design", "design.csv", "--conditions", "a,b", cwd=tmp_path
    )
