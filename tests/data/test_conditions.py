"""Conditions within subjects: units, their scales, the design of levels, and what is refused."""

import re
from io import StringIO

import numpy as np
import pandas as pd
import pytest
from conftest import each_row, read, refused

import bayes_toe as bt
from bayes_toe.data.conditions import Conditions
from bayes_toe.data.study import common_scales
from bayes_toe.data.tables import write_table
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER

HEADER = "subject,s1,s2,response,condition,isi\n"
#: Three trials at 'right' with an interval of 2, and then three at 'left' with an interval of 1.
A_ROWS = """\
a,0.0,0.0,equal,right,2
a,0.0,0.3,different,right,2
a,0.3,0.0,equal,right,2
a,1.0,1.0,equal,left,1.0
a,1.0,1.3,different,left,1.0
a,1.3,1.0,equal,left,1.0
"""
B_ROWS = A_ROWS.replace("a,", "b,")
ROWS = HEADER + A_ROWS + B_ROWS


@pytest.mark.parametrize("levels", ["ab", "abc", "abcde", "142"])
def test_any_two_levels_differ_alike_and_effects_sum_to_nothing(levels):
    # The design has a row for each level and a column for each effect: (n, n - 1). A column sums to
    # 0 over the levels, so that effects are deviations from the mean, and all pairs of rows have
    # the distance 1, so that no two levels differ more than others a priori.
    n = len(levels)
    x = Conditions("c", tuple(levels)).design()
    assert x.shape == (n, n - 1)
    np.testing.assert_allclose(x.sum(axis=0), 0.0, atol=1e-14)
    distances = np.square(x[:, None] - x[None]).sum(axis=-1)  # squared, (n, n)
    np.testing.assert_allclose(distances, 1.0 - np.eye(n), atol=1e-14)


def test_numbers_have_a_slope_over_their_range():
    # Levels that are numbers have one column: the slope, in units of their range from 2 to 8.
    delays = Conditions("delay", ("4", "2", "8"), numeric=True)
    assert delays.comparisons == (("8", "2"),)
    numbers = np.array([4.0, 2.0, 8.0])
    expected = (numbers - numbers.mean()) / np.ptp(numbers)
    np.testing.assert_allclose(delays.design()[:, 0], expected)
    highest, lowest = delays.design(("8", "2"))[:, 0]
    assert highest - lowest == pytest.approx(1.0)


def test_units_are_subjects_in_conditions():
    # Subjects a and b answered at both levels, 'left' and 'right', of the column condition.
    study = read(ROWS)
    units = [(unit.name, unit.subject_name, unit.condition) for unit in study]
    assert units == [
        ("a@left", "a", "left"),
        ("a@right", "a", "right"),
        ("b@left", "b", "left"),
        ("b@right", "b", "right"),
    ]
    assert study.conditions == Conditions("condition", ("left", "right"))
    reread_study = bt.read_study(study.frame())
    assert reread_study.names == study.names
    assert reread_study.conditions == study.conditions
    assert read(ROWS, "--reference right").conditions.comparisons == (("left", "right"),)


def test_units_have_the_scales_of_their_subject():
    # The prior is scaled by the stimuli. In each condition it has the scales of all trials of the
    # subject, as in a study without conditions. Otherwise a difference between conditions might be
    # a difference of scales.
    study, without_conditions = read(ROWS), read(ROWS, "--ignore condition")
    for unit in study:  # such as a@left
        subject = without_conditions[unit.subject_name]
        assert unit.shared_scales == common_scales(unit) == pytest.approx(common_scales(subject))
        posterior_of_unit, posterior_of_subject = map(bt.model.paper_posterior, (unit, subject))
        assert posterior_of_unit.sbar == pytest.approx(posterior_of_subject.sbar)
        # All scales but the last: the spread of first stimuli is that of the unit alone.
        assert unit.scales[:4] == pytest.approx(subject.scales[:4])
    # The scales do not depend on the responses, which are swapped here.
    assert study.swap("a@left")["a@left"].shared_scales == study["a@left"].shared_scales


def test_intervals_may_be_levels():
    # The interstimulus interval isi is 1 or 2 in the rows. Numbers have a slope, if they are not
    # declared as categories.
    study = read(ROWS, "--condition isi")
    assert study.names[:2] == ("a@1", "a@2")
    assert study.conditions.numeric
    assert not read(ROWS, "--condition isi --categorical-condition").conditions.numeric


def test_a_level_that_no_subject_has_is_no_level():
    # One more row of subject a has the interval 0.5, and then this level is excluded.
    study = read(ROWS + "a,0.0,0.0,equal,right,0.5\n", "--condition isi")
    assert study.conditions.levels == ("0.5", "1", "2")
    remaining = study.exclude("a@0.5")
    assert remaining.conditions == Conditions("isi", ("1", "2"), numeric=True)
    # Without units at level 1, it stays a level, because a condition has two levels at least.
    assert remaining.exclude("a@1").exclude("b@1").conditions.levels == ("1", "2")


def test_what_does_not_differ_within_subjects_is_no_condition():
    # All rows of a are at the level 'training', and all rows of b at 'left'.
    text = HEADER + re.sub("left|right", "training", A_ROWS) + B_ROWS.replace("right", "left")
    study = read(text)
    assert not study.reading.doubts
    assert study.names == ("a", "b")
    assert study.conditions is None
    assert any("no condition within" in note for note in study.notes)
    assert all(subject.answers is not None for subject in study)
    for options in ("--condition condition", "--reference left", "--categorical-condition"):
        with refused("every subject at one level"):
            read(text, options)


#: Trials of four pairs with {} in the place of the condition.
FOUR_PAIRS = """\
subject,s1,s2,response,condition
a,0,0.3,equal,{}
a,0.3,0,equal,{}
a,0,0.6,equal,{}
a,0.6,0,equal,{}
"""


@pytest.mark.parametrize("levels, n_levels", [("P1 P2 P3 P4", 4), ("up down up down", 2)])
def test_levels_that_share_no_pair_are_no_condition_unless_asked_for(levels, n_levels):
    # All trials of a pair have one level: (0, 0.3) the first of `levels`, (0.3, 0) the second, etc.
    # So the level may be a name of the pair. One trial at another level shows a condition.
    header, *rows = FOUR_PAIRS.format(*levels.split()).splitlines()
    text = "\n".join([header, *rows * 4])
    study = read(text)
    assert study.names == ("a",)
    assert study.conditions is None
    assert "found no pair with one answer at two of its levels" in study.notes[-1]
    assert len(read(text, "--condition condition")) == n_levels
    text_with_a_shared_pair = f"{text}\na,0,0.3,equal,other"
    assert read(text_with_a_shared_pair).conditions is not None


def messages_of_check(study):
    """The messages of `check` by subject and code, such as ('a', 'missing_condition')."""
    return {(finding.subject, finding.code): finding.message for finding in bt.check(study)}


def test_check_warns_where_no_pair_is_in_two_conditions():
    # The pair (0, 0.3) is always 'up' and the pair (0.3, 0) always 'down'.
    rows = "a,0.0,0.3,equal,up\na,0.3,0.0,equal,down\n" * 6
    study = read("subject,s1,s2,response,condition\n" + rows, "--condition condition")
    assert messages_of_check(study)["a", "stimuli_by_condition"] == (
        "No pair was presented in two conditions. A difference between conditions may be an effect "
        "of the pairs."
    )


#: A text in the place of 'left' in the column condition, options, and the refusal.
REFUSED = """
    l@ft |  | column condition: found 'l@ft' in 6 rows, the first is row 5, allowed: a name without
    |  | column condition: found '' in 6 rows, the first is row 5, allowed: a text that is not
    left | --reference up | --reference: found 'up', allowed: left, right
    left | --condition hand | there is no column hand
    left | --ignore condition --reference up | --reference and --categorical
"""


@each_row("level, options, problem", REFUSED)
def test_levels_and_options_of_conditions_that_cannot_be_used_are_refused(level, options, problem):
    # Such as 'l@ft' in the place of 'left': names of units, such as a@left, have an @ of their own.
    with refused(problem):
        read(ROWS.replace("left", level), options)


def test_numbers_have_no_reference():
    # The levels 2 and 6 are numbers, whose one effect is a slope.
    with refused("--reference: found with levels that are numbers"):
        read(ROWS.replace("left", "2").replace("right", "6"), "--reference 6")


def test_tables_have_subject_and_condition(tmp_path):
    # The name of a unit, a@left, becomes two cells. A row with * is of all subjects together.
    frame = pd.DataFrame({"model": ["m", "m"], "subject": ["a@left", "*"], "value": [1.0, 2.0]})
    path = write_table(frame, tmp_path / "table.csv", units=True)
    assert path.read_text().splitlines() == [
        "model,subject,condition,value",
        "m,a,left,1.0",
        "m,*,,2.0",
    ]


def test_check_warns_of_conditions_in_order_of_other_stimuli_and_of_missing_levels():
    # Both subjects have all trials at 'right' before those at 'left', whose stimuli are 1 higher.
    # The standard deviation of the first stimuli is 0.52, so that 1 is 1.9 standard deviations.
    messages = messages_of_check(read(ROWS))
    assert "by 1.9 standard deviations" in messages["a", "stimuli_by_condition"]
    assert "right, left, for 2 subjects" in messages["", "conditions_in_order"]
    assert ("a", "missing_condition") not in messages
    # Levels of a alternate, and b has no trial at 'left', where its first row is (1, 1).
    rows = A_ROWS.splitlines(keepends=True)
    rows_of_a = "".join([*rows[::2], *rows[1::2]])
    messages = messages_of_check(read(HEADER + rows_of_a + B_ROWS.partition("b,1.0")[0]))
    assert ("", "conditions_in_order") not in messages
    assert "No trials in condition left" in messages["b", "missing_condition"]


def test_all_files_have_the_condition_or_none_has_it():
    # The second file has other subjects, c in the place of a, and the same rows of b.
    frame = pd.read_csv(StringIO(ROWS))
    other_frame = frame.replace("a", "c")
    with refused("found column condition in some files only"):
        bt.read_study([frame, other_frame.rename(columns={"condition": "hand"})])
    study = bt.read_study([frame, other_frame])
    assert study.names == ("a@left", "a@right", "b@left", "b@right", "c@left", "c@right")
    assert study["b@left"].shared_scales == pytest.approx(study["a@left"].shared_scales)


def test_a_condition_that_has_a_level_of_practice_is_a_condition():
    # Without the option, rows of practice are left out.
    text = ROWS.replace("left", "practice").replace("condition", "phase")
    assert read(text, "--condition phase").conditions.levels == ("practice", "right")


# --- Tasks as conditions -------------------------------------------------------------------------

TASKS = """\
subject,s1,s2,response,task
a,0.0,0.3,different,same/different
a,0.3,0.0,equal,same/different
a,0.0,0.3,second,2afc
a,0.3,0.0,first,2afc
b,0.0,0.3,second,2afc
"""
# The response 'different' is followed by ',s'; the name of the task, same/different, is not.
CODES = TASKS.replace("different,s", "0,s").replace("first", "0")
CODES = CODES.replace("equal", "1").replace("second", "1")


#: Subject a answered both tasks, and b only which stimulus was stronger.
UNITS = ("a@2AFC", "a@same/different", "b@2AFC")


def test_tasks_are_conditions_by_a_column():
    study = read(TASKS, "--condition task")
    assert study.names == UNITS
    assert [part.task for part in study.by_task] == [WHICH_STRONGER, SAME_DIFFERENT]
    assert study["a@2AFC"].shared_scales == study["a@same/different"].shared_scales
    assert study.by_task[0].swap("a@2AFC")["a@2AFC"].scales == study["a@2AFC"].scales
    # In CODES the responses are 0 and 1.
    assert read(CODES, "--condition task --equal-code 1 --second-code 1").names == UNITS


def test_the_column_of_tasks_may_have_another_name():
    # The row of a third task, 'rating', is left out with a note.
    renamed = TASKS.replace(",task", ",question")
    study = read(renamed + "b,0,1,7,rating\n", "--condition question --reference same/different")
    assert "column question: rows with 'rating' left out, which tell no task" in study.notes
    assert study.conditions == Conditions("question", ("same/different", "2AFC"))


def test_tasks_are_conditions_by_files_of_one_task_each():
    # The two files have no column of tasks. The words of the responses say which task it was.
    frame = pd.read_csv(StringIO(TASKS))
    files = [rows.drop(columns="task") for _, rows in frame.groupby("task")]
    assert bt.read_study(files, bt.ReadOptions(condition="task")).names == UNITS


def test_a_file_of_two_tasks_is_refused_with_options_that_read_it():
    # Three remedies: one of the two tasks alone, or both as conditions.
    with pytest.raises(bt.InputError) as caught:
        read(TASKS)
    names_by_choice = []
    for remedies, _ in caught.value.choices:
        options = [remedy.typed for remedy in remedies]
        names_by_choice.append(read(TASKS, " ".join(options)).names)
    assert sorted(names_by_choice) == [("a",), ("a", "b"), UNITS]


def test_a_word_of_another_task_is_named_with_its_row():
    # One response to 2afc, in row 4, is 'equal', which this task does not have.
    text = TASKS.replace("0.3,second", "0.3,equal", 1).replace(",task", ",experiment")
    with refused("row 4, column response: found 'equal', allowed: sec"):
        read(text, "--condition experiment")


@pytest.mark.parametrize(
    "text, options, message",
    [
        (TASKS, "", "use ReadOptions(where={'task': 'same/different'}) for the task"),
        (CODES, "", "found '0' (2), '1' (3) of the tasks 'same/different' and '2afc'"),
        (CODES, "--condition task --second-code 1", "use ReadOptions(equal_code='1')"),
        (CODES, "--condition hand --second-code 1 --equal-code 1", "different texts"),
        (TASKS.replace("same/different", "2afc"), "", "row 2, column response: found 'different'"),
        (ROWS, "--condition task", "found the task 'same/different' alone"),
    ],
)
def test_two_tasks_are_refused_where_they_are_no_conditions(text, options, message):
    # TASKS has the words 'equal', 'different', 'first' and 'second', CODES has 0 and 1 in their
    # places, and ROWS has one task alone.
    with refused(re.escape(message)):
        read(text, options)


def test_other_analyses_refuse_a_study_of_two_tasks():
    # Only `contrast` analyses two tasks together.
    study = read(TASKS, "--condition task")
    for analyse in (bt.run, bt.evidence, bt.population, bt.fit, bt.check, bt.Study.frame):
        with refused("found the tasks 'which is stronger' and"):
            analyse(study)
