"""Synthetic observers under several conditions: what differs, by how much, in tables as in files."""

import numpy as np
import pandas as pd
import pytest
from commands import good
from scipy.special import ndtri

import bayes_toe as bt
from bayes_toe.experiments.conditions import Differing, differing_from

ONE = {"mu1": 0.3, "sigma_p": 0.2, "sigma_l": 0.1}


def group_scales(truth, sbar, power):
    """Constant error, probit of the pull, log width by the closed form: G solves G^2 = G + gamma."""
    ratio = (1.0 + np.sqrt(1.0 + 4.0 * (truth["sigma_l"] / truth["sigma_p"]) ** 2)) / 2.0
    p = 1.0 - 1.0 / ratio
    return np.array([p * (truth["mu1"] - sbar), ndtri(p), np.log(truth["sigma_p"] * ratio**power)])


@pytest.mark.parametrize(
    ("task", "lapses", "power"), [("same/different", "q0", 1.5), ("2afc", "lapse_rate", 1.0)]
)
@pytest.mark.parametrize("isi", [None, (0.5, 2.0)])
def test_conditions_differ_by_what_is_stated_about_the_subject(task, lapses, power, isi):
    apart = {"constant error": 0.1, "pull": 0.5, "width": -0.3}
    made = bt.simulate(
        {"A": {**ONE, lapses: 0.1}},
        batches=2,
        isi=isi,
        seed=1,
        task=task,
        conditions=("a", "b", "c"),
        differ=apart,
    )
    assert made.study.names == ("A@a", "A@b", "A@c") == tuple(made.truth)
    sbar = made.study["A@a"].s1.mean()
    found = np.array([group_scales(values, sbar, power) for values in made.truth.values()])
    assert found[1] == pytest.approx(group_scales(ONE, sbar, power))
    assert np.diff(found, axis=0) == pytest.approx(np.tile(np.array([0.1, 0.5, -0.3]) / 2, (2, 1)))
    assert [values[lapses] for values in made.truth.values()] == pytest.approx([0.1] * 3)


def test_numbers_are_as_far_apart_as_they_say_and_subjects_scatter():
    truth = bt.simulate(
        200, batches=1, seed=1, conditions=("1", "2", "5"), differ={"width": (0.4, 0.2)}
    ).truth
    logs = np.log(
        [[truth[f"S{i + 1:03d}@{level}"]["sigma_p"] for level in "125"] for i in range(200)]
    )
    assert logs[:, 1] - logs[:, 0] == pytest.approx((logs[:, 2] - logs[:, 1]) / 3)
    slopes = logs[:, 2] - logs[:, 0]
    assert slopes.mean() == pytest.approx(0.4, abs=4 * 0.2 / np.sqrt(200))
    assert slopes.std() == pytest.approx(0.2, rel=0.25)


def test_nothing_differs_where_nothing_is_said_but_the_answers():
    study, truth = bt.simulate(1, batches=20, seed=1, conditions=("a", "b"))
    assert truth["S01@a"] == pytest.approx(truth["S01@b"], rel=1e-12)
    assert not np.array_equal(study["S01@a"].n_yes, study["S01@b"].n_yes)
    assert study["S01@a"].felt == study["S01@b"].felt is not None


def test_the_file_is_the_study(tmp_path):
    differ = "pull=0.5:0.1, constant error=0.1"
    asked = (
        "--subjects",
        "2",
        "--batches",
        "4",
        "--seed",
        "3",
        "--conditions",
        "left,right",
        "--differ",
        differ,
    )
    good("simulate", "-o", "study.csv", "--truth", "truth.csv", *asked, cwd=tmp_path)
    read = bt.read_study(tmp_path / "study.csv")
    made = bt.simulate(
        2,
        batches=4,
        seed=3,
        conditions=("left", "right"),
        differ={"pull": (0.5, 0.1), "constant error": 0.1},
    )
    assert read.conditions == made.study.conditions
    assert read.names == made.study.names
    assert all(
        np.array_equal(read[name].n_yes, made.study[name].n_yes)
        and read[name].felt == made.study[name].felt
        for name in read.names
    )
    known = pd.read_csv(tmp_path / "truth.csv").set_index("subject").T.to_dict()
    assert known == {name: pytest.approx(values) for name, values in made.truth.items()}
    assert "conditions_in_order" not in {one.code for one in bt.check(read)}, "they come in turn"


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (
            lambda: Differing.of(["a"]),
            "--conditions: found 'a', allowed: two levels and more, each once, without @",
        ),
        (lambda: Differing.of(["a", "a"]), "--conditions"),
        (lambda: Differing.of(["1", "1.0"]), "--conditions"),
        (lambda: Differing.of(["a@", "b"]), "--conditions"),
        (
            lambda: Differing.of(["a", "b"], {"mu1": 1.0}),
            "--differ: found 'mu1=1:0', allowed: QUANTITY=SIZE",
        ),
        (lambda: Differing.of(["a", "b"], {"pull": (0.5, -0.1)}), "--differ"),
        (lambda: differing_from("a,b", "pull"), "--differ: found 'pull', allowed: QUANTITY=SIZE"),
        (lambda: differing_from(None, "pull=1"), "--differ: allowed with --conditions"),
        (lambda: bt.simulate(1, differ={"pull": 1.0}), "differ: allowed with conditions"),
    ],
)
def test_what_is_refused(make, said):
    with pytest.raises(bt.InputError, match=said):
        make()
