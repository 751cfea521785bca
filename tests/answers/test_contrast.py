"""What differs between conditions: words, signs, units, and the command."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
from commands import refusal_of, run_ok
from conftest import refused
from legible import words_of
from numpy.random import default_rng
from scipy.special import ndtr

import bayes_toe as bt
from bayes_toe.answers.contrast import CONTRAST_COLUMNS, ORDER_EFFECT

NOT_DIFFERENT = ("undecided", "probably not", "no")

# Eight pairs: each of four first stimuli, with a second stimulus .3 below and .3 above it.
FIRST = np.repeat([0.0, 0.3, 0.6, 0.9], 2)
SECOND = FIRST + np.tile([-0.3, 0.3], 4)


def condition_counts(
    levels=("left", "right"),
    constant_errors=(0.08, -0.08),
    contractions=(0.3, 0.3, 0.3),
    subjects="AB",
    trials=50,
):
    """Counts of subjects whose constant error, or contraction, depends on the condition.

    P('second') is Phi((s2 - s1 - c + p (s1 - mean of s1)) / noise), with a noise of .25. The
    conditions are as many as there are levels; further errors and contractions are not used.
    """
    rng = default_rng(3)
    rows = []
    conditions = list(zip(levels, constant_errors, contractions, strict=False))
    for name, (level, error, contraction) in product(subjects, conditions):
        perceived = SECOND - FIRST - error + contraction * (FIRST - FIRST.mean())
        n_second = rng.binomial(trials, ndtr(perceived / 0.25))
        fields = {"subject": name, "condition": level, "n_second": n_second, "n_trials": trials}
        rows.append(pd.DataFrame({"s1": FIRST, "s2": SECOND, **fields}))
    return pd.concat(rows)


@pytest.fixture(scope="module")
def table():
    """Subjects A and B: a constant error of .08 at left and -.08 at right, no other difference."""
    return bt.contrast(bt.read_study(condition_counts()), seed=1)


def test_what_differs_has_its_sign_and_size(table):
    quantities = ["constant error", "contraction", "JND", ORDER_EFFECT]
    assert [row.quantity for row in table] == 2 * quantities
    for row in table.select("constant error"):
        assert (row.word, row.robust) == ("yes", "yes")
        assert row.q025 < row.q05 < -0.16 < row.q95 < row.q975  # the truth is -.08 - .08
        assert row.p_direction > 0.99
        # The table is in the log of intensity, and `interval` in per cent of it.
        assert row.interval(table.unit).q975 == pytest.approx(100.0 * np.expm1(row.q975))
    for row in table.select(ORDER_EFFECT):
        assert row.word == "yes"
        assert row.p_direction is None  # The order effect is a size, without a sign.
        assert row.q05 < 0.16 < row.q95
    for row in table.select("contraction"):
        assert row.word in NOT_DIFFERENT


def test_the_table_has_a_sentence_its_columns_and_the_prior(table):
    assert "Constant error differs: 2 of 2 subjects yes." in table.sentences()
    frame = table.frame(full=True)
    assert tuple(frame.columns) == CONTRAST_COLUMNS
    (prior,) = set(frame["prior"])  # the same in all rows
    assert "contraction ~ Normal(0, 0.25) on (-1, 1)" in prior  # the default prior


def test_a_contraction_that_differs_moves_the_shift_by_the_spread_of_first_stimuli():
    study = bt.read_study(
        condition_counts(
            constant_errors=(0.0, 0.0), contractions=(0.0, 0.5), subjects="A", trials=200
        )
    )
    table = bt.contrast(study, seed=1)
    (contraction,) = table.select("contraction")
    (order,) = table.select(ORDER_EFFECT)
    assert contraction.word == "yes"
    assert contraction.q025 < 0.5 < contraction.q975
    # Difference of the order effect = difference of the contraction x spread of first stimuli,
    # to 10 %, because the estimated constant errors differ a little, too.
    spread = np.std(FIRST)
    assert order.q50 == pytest.approx(abs(contraction.q50) * spread, rel=0.1)


@pytest.fixture
def three_levels():
    """Counts of subject A in the conditions 1, 2 and 4, and of subject B in 2 and 4."""
    frame = condition_counts(("1", "2", "4"), (0.1, 0.0, -0.1), trials=20)
    return frame.query("subject != 'B' or condition != '1'")


def test_of_levels_that_are_numbers_the_highest_and_the_lowest_are_compared(three_levels):
    table = bt.contrast(bt.read_study(three_levels), seed=1)
    assert [(row.subject, row.comparison) for row in table.select("JND")] == [("A", "4 - 1")]
    (constant_error,) = table.select("constant error")
    assert constant_error.mean < -0.05  # the truth is -.1 - .1
    assert table.left_out == {"B": "at 2, 4 only"}


def test_each_level_that_is_a_name_is_compared_with_the_first_one(three_levels):
    table = bt.contrast(bt.read_study(three_levels, bt.ReadOptions(categorical=True)), seed=1)
    assert [row.comparison for row in table.select("constant error")] == ["2 - 1", "4 - 1"]
    assert table.left_out == {"B": "at 2, 4 only"}
    # The Bayes factor is that of a difference between any levels, whatever the comparison.
    result_of_2, result_of_4 = ((row.word, row.factor) for row in table.select("JND"))
    assert result_of_2 == result_of_4


def test_a_study_without_a_subject_at_both_levels_is_refused(three_levels):
    only_b = bt.read_study(three_levels).select(["B@2", "B@4"])
    message = "found no subject at both 4 and 1, allowed: one and more"
    with refused(message):
        bt.contrast(only_b, seed=1)


def test_a_study_without_conditions_is_refused_with_the_way_on():
    # A table without a column of conditions; and a table whose column has another name, which the
    # refusal proposes.
    single_condition = condition_counts(["left"]).drop(columns="condition")
    delays = condition_counts(("1", "3")).rename(columns={"condition": "isi"})
    without_proposal = (
        "found no condition within subjects, allowed: a column condition, or --condition"
    )
    with_proposal = "or --condition COLUMN, such as --condition isi"
    for frame, message in ((single_condition, without_proposal), (delays, with_proposal)):
        with refused(message):
            bt.contrast(bt.read_study(frame))


def test_the_forest_shows_every_subject(table):
    figure = bt.plots.contrast(table)
    assert words_of(figure.axes[0].get_yticklabels()) == ["A", "B"]
    # Words are in their order, whichever panel has them first.
    first_word, *_ = words_of(figure.legends[0].get_texts())
    assert first_word == "differs"
    # The first line of the first panel is the interval of A's constant error.
    first_line, *_ = figure.axes[0].collections[0].get_segments()
    (low, _), (high, _) = first_line  # x and y of its ends
    row_of_a, _ = table.select("constant error")
    interval = row_of_a.interval(table.unit)
    assert (low, high) == pytest.approx((interval.q025, interval.q975))


@pytest.fixture
def two_hands(tmp_path):
    """A folder with a study of one subject, whose column of conditions is `hand`."""
    frame = condition_counts(subjects="A", trials=10).rename(columns={"condition": "hand"})
    frame.to_csv(tmp_path / "study.csv", index=False)
    return tmp_path


def test_contrast_compares_with_the_reference_that_is_typed(two_hands):
    line = "contrast study.csv --condition hand --reference right --seed 1"
    assert "left - right" in run_ok(line, cwd=two_hands)
    assert set(pd.read_csv(two_hands / "contrast.csv").comparison) == {"left - right"}
    assert (two_hands / "contrast.png").exists()


def test_the_asymmetry_of_fit_has_rows_for_each_condition(two_hands):
    run_ok("fit study.csv --condition hand --asymmetry asymmetry.csv --replicates 2", cwd=two_hands)
    table = pd.read_csv(two_hands / "asymmetry.csv")
    # Two pairs have both orders. A third pair does not, because 0.6 + 0.3 is not 0.9 to the bit.
    n_rows = table.groupby(["subject", "condition"]).size()
    assert n_rows.to_dict() == {("A", "left"): 2, ("A", "right"): 2}


@pytest.fixture(scope="module")
def two_tasks(tmp_path_factory):
    """A folder with the study of a subject A in two tasks, 480 trials each, by the column `task`.

    A has the same contraction in both tasks, and a constant error in 2AFC alone.
    """
    folder = tmp_path_factory.mktemp("tasks")
    design = folder / "design.csv"
    pd.DataFrame({"s1": FIRST, "s2": SECOND}).to_csv(design, index=False)
    observer = {"noise": 0.25, "contraction": 0.3}
    tables = []
    for task, parameters in (("2afc", {"constant_error": 0.25}), ("same/different", {"q0": 0.8})):
        observers = {"A": observer | parameters}
        study, _ = bt.simulate(observers, design=str(design), batches=60, seed=1, task=task)
        tables.append(study.frame().drop(columns="synthetic").assign(task=task))
    pd.concat(tables).to_csv(folder / "study.csv", index=False)
    return folder


def test_tasks_as_conditions_are_compared_by_contrast_and_refused_by_run(two_tasks):
    assert "bayes-toe contrast" in run_ok("check study.csv --condition task", cwd=two_tasks)
    assert "--where task=2afc" in refusal_of("run study.csv --condition task", cwd=two_tasks)


def test_tasks_agree_but_for_what_differs_and_have_one_observer(two_tasks):
    screen = run_ok("contrast study.csv --condition task --seed 1", cwd=two_tasks)
    assert "same/different - 2AFC" in screen
    assert "This does not test whether one observer fits." in screen
    words = pd.read_csv(two_tasks / "contrast.csv").set_index("quantity").word
    # The contractions are equal, but 960 trials cannot show that nothing differs.
    assert (words["constant error"], words["contraction"]) == ("yes", "undecided")
    assert words["JND"] in NOT_DIFFERENT
    # The order effect of one observer that is fitted to both tasks together.
    (answer,) = pd.read_csv(two_tasks / "contrast_one_observer.csv").itertuples()
    assert (answer.subject, answer.order_effect) == ("A", "yes")
