"""Power: simulated answers are analysed as those of a subject are, and shares are right."""

from dataclasses import replace

import numpy as np
import pytest
from commands import refusal_of, run_ok
from conftest import each_row, refused
from populations import grid_design

import bayes_toe as bt
from bayes_toe.answers.order_effect import QUESTIONS, answer_subject
from bayes_toe.answers.words import Word
from bayes_toe.data.tasks import THREE_ANSWERS, WHICH_STRONGER
from bayes_toe.design.observers import assume_observers
from bayes_toe.design.power import (
    DETECTED,
    PowerTable,
    group_power,
    power,
)
from bayes_toe.design.study_design import paper_study_design
from bayes_toe.model.prior import Hyperprior, ParameterHyperprior, Prior


@pytest.fixture(scope="module")
def designs():
    """The paper's design, and a design whose first stimuli are far apart."""
    steps = np.linspace(-0.3, 0.3, 5)
    wide = grid_design(np.linspace(-0.75, 1.25, 5), steps, 650)
    return {"paper": paper_study_design(), "wide": wide}


@pytest.fixture(scope="module")
def table(designs):
    """The power of both designs for three observers of each of three kinds."""
    observers = []
    for kind in ("none", "large constant error", "contraction"):
        observers += assume_observers(kind, size=3, seed=1, designs=list(designs.values()))
    return power(designs, [650], observers, seed=1)


def test_a_data_set_is_answered_as_a_subject_is(table, designs):
    _, data_set, *_ = table.data_sets  # a data set of the first design, the paper's pairs
    # Seed 1 is that of the table, so the observer gives the same answers again.
    subject = data_set.observer.answers(designs["paper"], seed=1)
    expected, _ = answer_subject(subject, seed=4)
    # A data set has fewer draws than a subject, and other draws, so both have Monte Carlo errors.
    assert data_set.answer.probabilities == pytest.approx(expected.probabilities, abs=0.06)
    size = data_set.answer.sizes["contraction_p"]
    assert size.q50 == pytest.approx(expected.sizes["contraction_p"].q50, abs=0.05)


def test_first_stimuli_far_apart_show_a_contraction_that_the_papers_pairs_do_not(table):
    # Shares by design, number of trials, kind of observers, question and words.
    assert table["wide", 650, "contraction", "contraction", DETECTED].value == 1.0
    assert table["wide", 650, "contraction", "constant_error", DETECTED].value == 0.0
    assert table["wide", 650, "large constant error", "constant_error", "yes"].value == 1.0
    assert table["wide", 650, "none", "order_effect", "yes"].value == 0.0
    widths = {"paper": 0.0, "wide": 0.0}  # of all 95 % intervals of the contraction
    for data_set in table.data_sets:
        interval = data_set.answer.sizes["contraction_p"]
        widths[data_set.design] += interval.q975 - interval.q025
    assert widths["paper"] > 2.0 * widths["wide"]


def test_power_is_the_share_of_data_sets_with_a_word(table):
    """Five data sets of observers without effects, each with one word for all questions."""
    data_set, *_ = table.data_sets
    data_sets = []
    for word in ("YES", "PROBABLY", "PROBABLY", "UNDECIDED", "CANNOT_BE_TOLD"):
        words = dict.fromkeys(QUESTIONS, Word[word])
        data_sets.append(replace(data_set, answer=replace(data_set.answer, words=words)))
    table_of_five = PowerTable.from_data_sets(data_sets, seed=0)
    shares = {"yes": 0.2, "probably": 0.4, "undecided": 0.2, "no": 0.0, "cannot be told": 0.2}
    shares[DETECTED] = 0.6  # yes or probably
    for word, expected in shares.items():
        estimate = table_of_five["paper", 650, "none", "contraction", word]
        assert estimate.value == pytest.approx(expected)
    assert table_of_five.sentences() == ["Paper, 650 trials: false positives 60 % [21, 91]."]
    with refused("nothing counted for"):
        table_of_five["paper", 650, "none", "contraction", "maybe"]


def test_the_effect_that_is_detected_least_comes_first(table):
    # [46, 100] is the interval of 3 of 3 observers, and [0, 54] the interval of 0 of 3.
    paper_sentence, wide_sentence = table.sentences()
    assert paper_sentence.endswith(" Contraction: cannot be told.")
    assert not group_power(table, [10]).select("paper", 650, "contraction")
    assert wide_sentence == (
        "Wide, 650 trials: large constant error detected least often, in 100 % [46, 100]; false "
        "positives 0 % [0, 54]."
    )


def test_groups_find_a_mean_and_rarely_one_that_is_0(designs):
    """Power is the share of 400 simulated studies of 10 or of 20 subjects that find the mean.

    Subjects are drawn from twelve observers, whose effects differ.
    """
    wide = designs["wide"]
    observers = assume_observers("groups", size=12, seed=1, designs=[wide], is_even=True)
    kinds = ("mean 0", "contraction 20 %")
    observers = [observer for observer in observers if observer.kind in kinds]
    table_of_subjects = power({"wide": wide}, [650], observers, seed=1)
    groups = group_power(table_of_subjects, [10, 20])
    rows = groups.select("wide", 650, "contraction")
    assert [row.true_mean for row in rows["mean 0"]] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert all(row.power < 0.1 for row in rows["mean 0"])  # false positives
    row_of_10, row_of_20 = rows["contraction 20 %"]
    # Twelve equidistant values from .03 to .37 have an SD of .098.
    assert (row_of_10.true_mean, row_of_10.true_sd) == pytest.approx((0.2, 0.098), abs=2e-3)
    assert 0.9 < row_of_10.power <= row_of_20.power
    assert row_of_10.detected_low < row_of_10.detected < row_of_20.detected <= 20
    first_sentence, *_ = groups.sentences()
    assert first_sentence.startswith("Wide, 650 trials: studies detect the mean of 'contraction 20")
    # Under this prior, every mean is about 0.
    near_0 = ParameterHyperprior(mean=0.0, mean_scale=0.001, sd_scale=0.15)
    prior = Prior(group=Hyperprior(contraction=near_0))
    *_, row_of_contraction = group_power(table_of_subjects, [20], prior).rows
    assert row_of_contraction.power < 0.1


def test_the_command_writes_a_table_and_a_figure_and_a_second_table_of_groups(tmp_path):
    paper_study_design().with_total(130).save(tmp_path / "short.csv")
    words = "power short.csv --trials 130 --simulated 1 --observers both --seed 1"
    screen = run_ok(words, "-o", "out", cwd=tmp_path)
    # Observers of the kind 'both' have both effects. One was simulated, and it was detected.
    assert "These pairs, 130 trials: both detected in 100 % [15, 100]" in screen
    screen = run_ok(words, "-o", "out", "--subjects", "4,8", "--overwrite", cwd=tmp_path)
    assert "4 subjects  8 subjects" in screen
    names = {path.name for path in (tmp_path / "out").glob("power*")}
    tables = {"power.csv", "power_groups.csv"}
    assert names == {*tables, "power.pdf", "power.png"}


def test_tasks_are_compared_by_observers_with_the_same_effects(tmp_path):
    """A task has the same numbers whatever else is compared."""
    words = "power --task 2afc,ternary --trials 130 --simulated 2 --observers both --seed 1"
    screen = run_ok(words, "-o", "out", cwd=tmp_path)
    # Observers of the kind 'both' have a constant error and a contraction.
    assert "The paper's pairs, three answers, 130 trials: both detected in" in screen

    pairs = paper_study_design()
    two_afc, ternary = (replace(pairs, task=task) for task in (WHICH_STRONGER, THREE_ANSWERS))
    options = {"trials": [130], "observers": "both", "data_sets": 2, "seed": 1, "workers": 1}
    # Two data sets of 2AFC, and then two data sets with three answers.
    data_sets = power({"2AFC": two_afc, "ternary": ternary}, **options).data_sets
    for effect in ("constant_error", "contraction"):
        values = [data_set.observer.parameters[effect] for data_set in data_sets]
        assert values[:2] == values[2:]
    # Without the comparison, the data sets with three answers are the same.
    for expected, data_set in zip(power(ternary, **options).data_sets, data_sets[2:], strict=True):
        assert data_set.answer.sizes == expected.answer.sizes


#: Options of `power`, and the message that refuses them. Two folders have a design d.csv of 13
#: pairs.
REFUSED = """
    --task 2afc,3afc | --task: found '3afc', allowed: same/different, 2afc
    --trials 0 | --trials is '0'. It must be whole numbers from 1
    --trials 12 | 12 trials for 13 pairs
    --subjects 1,9 | --subjects is '1,9'. It must be whole numbers from 2
    --observers nobody | --observers: found 'nobody'
    --unit um | --unit: allowed with DESIGN.csv.
    d.csv other/d.csv | Two design files have the name 'd'.
"""


@each_row("options, message", REFUSED)
def test_power_that_cannot_be_computed_is_refused_in_one_line(tmp_path, options, message):
    (tmp_path / "other").mkdir()
    for folder in (tmp_path, tmp_path / "other"):
        paper_study_design().with_total(13).save(folder / "d.csv")
    assert message in refusal_of(f"power {options} --simulated 1 --seed 1", cwd=tmp_path)


def test_the_figure_has_a_panel_for_each_design_and_question(table):
    figure = bt.plots.power(table)
    assert len(figure.axes) == 6  # two designs, three questions
    assert figure.axes[2].get_title() == "contraction: yes or probably"
    # The last panel is that of the contraction for the wide design, with a bar for each kind.
    for bar, kind in zip(figure.axes[5].containers, table.different("observers"), strict=True):
        expected = table["wide", 650, kind, "contraction", DETECTED].value
        assert bar.lines[0].get_ydata().tolist() == [expected]
