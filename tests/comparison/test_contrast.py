"""What differs between conditions: Bayes factors, words, signs, units, and the command."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from commands import good, refused

import bayes_toe as bt
from bayes_toe.comparison.contrast import (
    CONTRAST_COLUMNS,
    ORDER_EFFECT,
    WORDS,
    joint_evidences,
    log_bayes_factor,
)
from bayes_toe.model.prior import DEFAULT

PAIRS = [(a, b) for a in (0.0, 0.3, 0.6, 0.9) for b in (a - 0.3, a + 0.3)]


def answers(
    levels=("left", "right"),
    offsets=(0.08, -0.08),
    pulls=(0.3, 0.3, 0.3),
    subjects="AB",
    trials=50,
    scale=1.0,
    shift=0.0,
):
    """Subjects whose constant error, or pull, depends on the condition."""
    rng, s = np.random.default_rng(3), np.array(PAIRS)
    rows = []
    for who in subjects:
        for level, offset, pull in zip(levels, offsets, pulls, strict=False):
            p = 1.0 / (
                1.0 + np.exp(-((s[:, 1] - s[:, 0]) - offset + pull * (s[:, 0] - 0.45)) / 0.15)
            )
            k = rng.binomial(trials, p)
            told = {
                "subject": who,
                "condition": level,
                "s1": scale * s[:, 0] + shift,
                "s2": scale * s[:, 1] + shift,
            }
            rows.append(pd.DataFrame({**told, "n_second": k, "n_trials": trials}))
    return pd.concat(rows)


@pytest.fixture(scope="module")
def table():
    return bt.contrast(bt.read_study(answers()), seed=1, workers=1)


def test_what_differs_is_found_with_its_sign_and_size(table):
    assert list(table.frame().columns) == list(CONTRAST_COLUMNS)
    assert [row.quantity for row in table][:4] == ["constant error", "pull", "width", ORDER_EFFECT]
    for one in table.some("constant error"):
        assert (one.word, one.robust) == (WORDS[0], "yes")
        assert one.q05 < -0.16 < one.q95
        assert one.p_direction > 0.99
    for one in table.some(ORDER_EFFECT):
        assert one.log_bf_differs > 3.0
        assert one.p_direction is None
        assert one.q05 < 0.16 < one.q95
    assert {row.word for row in table.some("pull")} <= {*WORDS[2:]}
    assert table.sentences()[0] == "constant error, of 2 subjects: differs 2"


def test_the_other_reference_turns_signs_another_unit_scales_and_no_bayes_factor_changes(table):
    study = bt.read_study(answers(scale=3.0, shift=2.0), bt.ReadOptions(reference="right"))
    other = bt.contrast(study.select(["A@right", "A@left"]), seed=2, workers=1)
    for one, turned in zip(table.rows, other, strict=False):
        assert turned.comparison == "left - right"
        factor = (1.0 if one.quantity == ORDER_EFFECT else -1.0) * (
            1.0 if one.quantity == "pull" else 3.0
        )
        assert turned.mean / factor == pytest.approx(one.mean, abs=0.35 * one.sd)
        assert turned.log_bf_differs == pytest.approx(
            one.log_bf_differs, abs=5 * np.hypot(one.log_bf_differs_se, turned.log_bf_differs_se)
        )


def test_a_pull_that_differs_moves_the_shift_by_its_share_of_the_spread_of_first_stimuli():
    study = bt.read_study(answers(offsets=(0.0, 0.0), pulls=(0.0, 0.6), subjects="A", trials=200))
    table = bt.contrast(study, model="contraction + no lapses", seed=1, workers=1)
    (pull,), (order,) = table.some("pull"), table.some(ORDER_EFFECT)
    assert pull.word == WORDS[0]
    assert order.q50 == pytest.approx(abs(pull.q50) * np.std(np.array(PAIRS)[:, 0]), rel=0.05)


def test_bayes_factors_by_hand():
    study = bt.read_study(answers(subjects="A", trials=8))
    known, _ = joint_evidences(study.subjects, study.conditions.design(), "contraction", DEFAULT, 1)
    z = {
        "".join(sorted(key[0] for key in some)): np.exp(one.log_evidence + 60.0)
        for some, one in known.items()
    }
    assert set(z) == {"", "c", "p", "w", "cp", "cw", "pw", "cpw"}
    value, _ = log_bayes_factor(known, "pull")
    assert np.exp(value) == pytest.approx(
        (z["p"] + z["cp"] + z["pw"] + z["cpw"]) / (z[""] + z["c"] + z["w"] + z["cw"])
    )
    value, _ = log_bayes_factor(known, ORDER_EFFECT)
    differs = sum(z[key] for key in ("c", "p", "cp", "cw", "pw", "cpw"))
    assert np.exp(value) == pytest.approx(differs / 3.0 / (z[""] + z["w"]))


def test_three_levels_numbers_and_a_missing_one():
    three = answers(("1", "2", "4"), (0.1, 0.0, -0.1), trials=20)
    three = three[~((three.subject == "B") & (three.condition == "1"))]
    slope = bt.contrast(bt.read_study(three), model="constant error + no lapses", seed=1, workers=1)
    assert [(row.subject, row.comparison) for row in slope.some("constant error")] == [
        ("A", "4 - 1")
    ]
    named = bt.contrast(
        bt.read_study(three, bt.ReadOptions(categorical=True)),
        model="constant error + no lapses",
        seed=1,
        workers=1,
    )
    assert [row.comparison for row in named.some("constant error")] == ["2 - 1", "4 - 1"]
    assert slope.some("constant error")[0].mean < -0.05
    assert slope.left_out == named.left_out == {"B": "at 2, 4 only"}, (
        "who met no two levels that are compared is said to be left out"
    )
    both = [row.conclusion for row in named.some("width")]
    assert "BF" in both[0], "of a difference between any levels"
    assert both[0] == both[1], "whatever the comparison"
    with pytest.raises(
        bt.InputError, match="found no subject at both 4 and 1, allowed: one and more"
    ):
        bt.contrast(bt.read_study(three).select(["B@2", "B@4"]), seed=1, workers=1)
    assert slope.quantities == ("constant error", "width", ORDER_EFFECT)


@pytest.mark.parametrize(
    ("options", "model", "said"),
    [
        (bt.ReadOptions(ignore="condition"), None, "no condition within subjects"),
        (bt.ReadOptions(), "free frequencies", "no quantities that conditions share"),
        (
            bt.ReadOptions(),
            "contraction + carry-over",
            "has a history of trials, which conditions cut; allowed: one without",
        ),
    ],
)
def test_what_is_refused(options, model, said):
    with pytest.raises(bt.InputError, match=said):
        bt.contrast(bt.read_study(answers(), options), model=model)


def test_the_figures_show_every_subject(table):
    study = bt.read_study(answers())
    forest, curves = bt.plots.contrast_figure(table), bt.plots.contrast_curves(study, table, "A")
    assert [tick.get_text() for tick in forest.axes[0].get_yticklabels()] == ["A", "B"]
    assert [ax.get_title() for ax in curves.axes] == ["condition left", "condition right"]
    with pytest.raises(bt.InputError, match="no contrast of subject 'C'"):
        bt.plots.contrast_curves(study, table, "C")
    words = [text.get_text() for text in forest.legends[0].get_texts()]
    assert words[0] == "differs"  # in their order, whichever panel has them first
    alone = replace(table, rows=tuple(row for row in table if row.quantity != "pull"))
    empty = replace(
        alone, rows=(*alone.rows, table.some("pull")[0]._replace(comparison="up - left"))
    )  # nobody met both of these
    assert [
        len(ax.collections[0].get_segments()) for ax in bt.plots.contrast_figure(empty).axes
    ] == [2, 2, 0]


def test_the_command(tmp_path):
    answers(subjects="A", trials=10).rename(columns={"condition": "hand"}).to_csv(
        tmp_path / "study.csv", index=False
    )
    hand = ("study.csv", "--condition", "hand")
    assert "left - right" in good(
        "contrast", *hand, "--reference", "right", "--seed", 1, cwd=tmp_path
    )
    assert set(pd.read_csv(tmp_path / "contrast.csv").comparison) == {"left - right"}
    assert (tmp_path / "contrast.png").exists()
    good("asymmetry", *hand, "-o", "asymmetry.csv", cwd=tmp_path)
    assert set(
        pd.read_csv(tmp_path / "asymmetry.csv")[["subject", "condition"]].itertuples(index=False)
    ) == {("A", "left"), ("A", "right")}
    line = refused("contrast", "study.csv", "--overwrite", cwd=tmp_path, silent=False)
    assert (
        "found no condition within subjects, allowed: a column condition, or --condition COLUMN"
        in line
    )
