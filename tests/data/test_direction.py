"""Which stimulus came first, and which answer is 'second': read, or asked in one line."""

import re
import shlex
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from commands import inside
from conftest import text_table
from numpy.random import default_rng

import bayes_toe as bt
from bayes_toe.data.responses import direction
from bayes_toe.data.tasks import WHICH_STRONGER


def made_up_trials(n=240, constant_error=0.1):
    """Trials with a standard and a comparison; the second is chosen where it seems stronger."""
    rng = default_rng(8)
    table = pd.DataFrame({"subject": "P1", "standard": np.zeros(n)})
    table["comparison"] = rng.choice([-0.3, -0.2, -0.1, 0.1, 0.2, 0.3], n)
    table["first"] = rng.choice(["standard", "comparison"], n)
    difference = np.where(table["first"] == "standard", table.comparison, -table.comparison)
    table["second_is_chosen"] = difference - constant_error + rng.normal(0.0, 0.15, n) > 0.0
    return table


TRIALS = made_up_trials()
IS_FIRST = TRIALS["first"] == "standard"
WORDS = TRIALS.second_is_chosen.map({True: "second", False: "first"})
IN_ORDER = pd.DataFrame(
    {
        "subject": "P1",
        "s1": np.where(IS_FIRST, TRIALS.standard, TRIALS.comparison),
        "s2": np.where(IS_FIRST, TRIALS.comparison, TRIALS.standard),
        "response": WORDS,
    }
)
INTENDED = bt.read_study(IN_ORDER)


def with_order(column, standard, comparison, response=WORDS):
    """The table with a column that says which stimulus came first, by these two cells."""
    table = TRIALS[["subject", "standard", "comparison"]].copy()
    table[column] = np.where(IS_FIRST, standard, comparison)
    return table.assign(response=response)


def coded(second, first):
    """Responses with these codes of 'second' and 'first'."""
    return TRIALS.second_is_chosen.map({True: second, False: first})


def of_comparison(comparison, standard):
    """Responses that name the stimulus that was chosen."""
    return np.where(TRIALS.second_is_chosen == IS_FIRST, comparison, standard)


def checked(folder, table, *words):
    """What `check` says of a table."""
    table.to_csv(folder / "study.csv", index=False)
    return inside("check", "study.csv", *words, cwd=folder)


def typed_lines(result):
    """The options of each line that a refusal says to type."""
    _, _, lines = result.stderr.partition("type:")
    return [line[7:].partition("  ")[0] for line in f"type:{lines}".splitlines() if lines]


def is_intended(table, **options):
    """Whether a table is read as the study that is meant."""
    study = bt.read_study(table, bt.ReadOptions(**options))
    return study.frame().equals(INTENDED.frame())


#: Name of the column, its cell where the standard was first, and where the comparison was.
CERTAIN = """
    interval | 1 | 2
    interval | 1.0 | 2.0
    interval | first | Second
    interval | 1st | 2nd
    interval | interval 1 | interval 2
    order | standard_first | comparison_first
    order | Standard first | Test first
    order | standardFirst | comparisonFirst
    order | first_standard | first_comparison
    order | comparison second | standard second
    order | std_first | cmp_first
    order | SC | CS
    order | st | ts
    order | S-C | C-S
    order | standard-comparison | comparison-standard
    order | std/cmp | cmp/std
    order | standard then test | test then standard
    order | Standard zuerst | Vergleich zuerst
    first_stimulus | standard | comparison
    first_stimulus | ref | test
    second_stimulus | comparison | standard
    standard_first | True | False
    standard_first | 1 | 0
    std_first | yes | no
    isStandardFirst | TRUE | FALSE
    comparison_first | False | True
    test_first | 0 | 1
    standard_second | 0 | 1
"""


@pytest.mark.parametrize("column, standard, comparison", text_table(CERTAIN))
def test_an_order_whose_meaning_is_certain_is_read(column, standard, comparison):
    assert is_intended(with_order(column, standard, comparison), standard_interval=column)


#: The same of the interval of the comparison.
OF_COMPARISON = """
    comparison_interval | 2 | 1
    target_interval | second | first
    testInterval | 2 | 1
    signal_position | 2 | 1
    order | 2 | 1
"""


@pytest.mark.parametrize("column, standard, comparison", text_table(OF_COMPARISON))
def test_a_column_may_hold_the_interval_of_the_comparison(column, standard, comparison):
    table = with_order(column, standard, comparison)
    assert is_intended(table, comparison_interval=column)
    if column != "order":
        with pytest.raises(bt.InputError, match="but named as that of the comparison"):
            bt.read_study(table, bt.ReadOptions(standard_interval=column))
        assert is_intended(table, standard_interval=column, comparison_interval=column)


def test_a_name_is_no_proof_where_cells_or_a_code_say_more():
    table = with_order("comparison_interval", "1", "2")
    assert is_intended(table, standard_interval="comparison_interval", standard_first_code="1")
    table = with_order("comparison_position", "standard_first", "comparison_first")
    assert is_intended(table, standard_interval="comparison_position")
    table = with_order("standard_interval", "1", "2")
    with pytest.raises(bt.InputError, match="named as that of the standard") as refusal:
        bt.read_study(table, bt.ReadOptions(comparison_interval="standard_interval"))
    (remedy,) = refusal.value.remedies
    assert is_intended(
        table, comparison_interval="standard_interval", **{remedy.option: remedy.value}
    )


#: The same of codes that may mean either, so that there is one question.
UNCERTAIN = """
    interval | True | False
    order | 0 | 1
    order | 1 | 0
    interval | left | right
    order | L | R
    order | A | B
    interval | -1 | 1
    interval | 0.5 | 1
    order | sc1 | x7
    position | standard | other
"""


@pytest.mark.parametrize("column, standard, comparison", text_table(UNCERTAIN))
def test_codes_that_may_mean_either_are_one_question(column, standard, comparison, tmp_path):
    table = with_order(column, standard, comparison)
    result = checked(tmp_path, table, "--standard-interval", column)
    problem, *lines = result.stderr.splitlines()
    counts = [f"'{standard}' ({IS_FIRST.sum()})", f"'{comparison}' ({(~IS_FIRST).sum()})"]
    assert all(count in problem for count in counts)
    assert len(lines) == 2
    assert set(typed_lines(result)) == {
        f"--standard-first-code {code}" for code in (standard, comparison)
    }
    words = ["--standard-interval", column, "--standard-first-code", standard]
    assert checked(tmp_path, table, *words).returncode == 0
    assert is_intended(table, standard_interval=column, standard_first_code=standard)


def test_more_codes_than_two_are_refused_by_value(tmp_path):
    table = with_order("interval", "1", "2")
    table.loc[[3, 7, 9], "interval"] = ["3", "x", "3"]
    result = checked(tmp_path, table, "--standard-interval", "interval")
    lines = result.stderr.splitlines()
    assert "column interval: found '3' in 2 rows, the first is row 5, allowed: 1 or 2" in lines[0]
    assert "row 9, column interval: found 'x', allowed: 1 or 2, the interval" in lines[1]


def test_an_order_that_only_one_file_has_needs_no_other_code(tmp_path):
    """Blocks of one order: each file has one of the two codes."""
    table = with_order("order", "A", "B")
    for code, part in table.groupby("order"):
        part.to_csv(tmp_path / f"{code}.csv", index=False)
    options = bt.ReadOptions(standard_interval="order", standard_first_code="A")
    study = bt.read_study([tmp_path / "A.csv", tmp_path / "B.csv"], options)
    assert study.frame().equals(INTENDED.frame())


#: Responses, and options that read them beside a column `standard_interval`.
RESPONSES = [
    (coded("j", "f"), {"second_code": "j"}),
    (coded("j", "f"), {"first_code": "f"}),
    (coded("2", "1"), {"second_code": "2"}),
    (of_comparison("longer", "shorter"), {"comparison_code": "longer"}),
    (of_comparison("comparison", "standard"), {}),
    (of_comparison("Test", "Reference"), {}),
    (of_comparison("cmp", "std"), {}),
    (of_comparison("1", "0"), {"comparison_code": "1"}),
]


@pytest.mark.parametrize("response, options", RESPONSES)
def test_one_code_of_the_responses_is_enough_with_a_standard(response, options):
    table = with_order("standard_interval", "1", "2", response)
    assert is_intended(table, standard_interval="standard_interval", **options)


@pytest.mark.parametrize(
    "response, intended",
    [
        (coded("j", "f"), "--second-code j"),
        (of_comparison("longer", "shorter"), "--comparison-code longer"),
        (of_comparison("1", "0"), "--comparison-code 1"),
    ],
)
def test_what_is_typed_for_codes_is_accepted(response, intended, tmp_path):
    """The first line is the likeliest, and each line works."""
    table = with_order("standard_interval", "1", "2", response)
    words = ["--standard-interval", "standard_interval"]
    result = checked(tmp_path, table, *words)
    codes = sorted(set(response))
    for code in codes:
        assert f"'{code}' ({(response == code).sum()})" in result.stderr
    lines = typed_lines(result)
    assert lines[0] == intended
    assert {line.split()[0] for line in lines} >= {
        *("--second-code", "--equal-code", "--comparison-code")
    }
    for line in lines[:2]:
        assert checked(tmp_path, table, *words, *shlex.split(line)).returncode == 0


def test_of_several_other_codes_one_is_asked_for(tmp_path):
    table = with_order("standard_interval", "1", "2", coded("j", "f"))
    table.loc[5, "response"] = "x"
    words = ["--standard-interval", "standard_interval", "--second-code", "j"]
    result = checked(tmp_path, table, *words)
    assert "Which of them is 'first'?" in result.stderr
    assert typed_lines(result)[0].startswith("--first-code f")


def test_a_code_that_no_response_has_is_refused(tmp_path):
    words = ["--standard-interval", "order", "--second-code", "x"]
    result = checked(tmp_path, with_order("order", "SC", "CS", coded("j", "f")), *words)
    assert "None of them is the code that was given." in result.stderr
    assert typed_lines(result) == []


def test_a_standard_that_is_always_first_needs_no_column():
    table = with_order("interval", "1", "2")[IS_FIRST]
    always_first = bt.read_study(table, bt.ReadOptions(standard_first=True))
    by_column = bt.read_study(table, bt.ReadOptions(standard_interval="interval"))
    assert always_first.frame().equals(by_column.frame())


def test_the_order_may_be_that_of_blocks():
    assert is_intended(with_order("block", "SC", "CS"), standard_interval="block")


#: Files whose answers are reversed under the options, and what is typed and right.
REVERSED = [
    (
        IN_ORDER.assign(response=coded("first", "second")),
        [],
        ["--second-code first --first-code second"],
    ),
    (IN_ORDER.assign(response=coded("s1", "s2")), [], ["--second-code s1 --first-code s2"]),
    (
        IN_ORDER.assign(response=coded("-1", "1")),
        ["--second-code", "1"],
        ["--second-code -1 --first-code 1"],
    ),
    (
        IN_ORDER.assign(response=coded("-1", "1")),
        ["--second-code", "1", "--first-code", "-1"],
        ["--second-code -1 --first-code 1"],
    ),
    (
        with_order("standard_interval", "1", "2", of_comparison("n", "y")),
        ["--standard-interval", "standard_interval", "--comparison-code", "y"],
        ["--comparison-code n"],
    ),
    (
        with_order("interval", "2", "1", coded("2", "1")),
        ["--standard-interval", "interval", "--second-code", "2"],
        ["--second-code 1 --first-code 2", "--comparison-interval interval"],
    ),
]


@pytest.mark.parametrize("table, words, expected", REVERSED, ids=range(len(REVERSED)))
def test_the_advice_for_reversed_answers_works_when_it_is_typed(table, words, expected, tmp_path):
    result = checked(tmp_path, table, *words)
    assert (result.returncode, "found 'second' less often" in result.stderr) == (2, True)
    if not words:  # in Python, too
        use = r"use ReadOptions\(second_code='(first|s1)', first_code='(second|s2)'\) if "
        with pytest.raises(bt.InputError, match=use):
            bt.read_study(table)
    lines = typed_lines(result)
    assert lines == expected
    for line in lines:
        after = checked(tmp_path, table, *words, *line.split())
        assert (after.returncode, after.stderr) == (0, "")


def subjects_with(n_subjects, sign, n=40, slope=6.0):
    """Subjects whose P(second) rises with s2 - s1 (sign 1), or falls (sign -1: reversed)."""
    levels = np.array([-0.3, -0.2, -0.1, 0.1, 0.2, 0.3])
    share = 1.0 / (1.0 + np.exp(-sign * slope * levels))
    trials = np.full(len(levels), n)
    counts = np.rint(n * share).astype(int)
    names = [f"{sign * slope} {i}" for i in range(n_subjects)]
    options = {"task": WHICH_STRONGER}
    return [bt.Subject(name, 0.0 * levels, levels, counts, trials, **options) for name in names]


@pytest.mark.parametrize(
    "n_reversed, n_straight, slope, expected",
    [
        (1, 0, 6.0, -1),
        (13, 0, 6.0, -1),
        (40, 0, 1.0, -1),
        (3, 10, 6.0, 0),
        (7, 6, 6.0, 0),
        (12, 1, 6.0, 0),
        (0, 13, 6.0, 1),
    ],
)
def test_a_whole_study_is_reversed_if_all_subjects_are(n_reversed, n_straight, slope, expected):
    """-1 is a reversed study, 0 one that is not clear, 1 one as it should be."""
    subjects = subjects_with(n_reversed, -1, slope=slope)
    subjects += subjects_with(n_straight, 1, slope=slope)
    assert direction(bt.Study(subjects)) == expected


def test_three_reversed_subjects_beside_ten_of_a_hard_task_are_no_reversed_study():
    subjects = subjects_with(3, -1, slope=12.0) + subjects_with(10, 1, n=20, slope=0.5)
    assert direction(bt.Study(subjects)) == 0


@pytest.mark.parametrize("n_subjects", [1, 12, 40])
def test_subjects_who_guess_are_no_reversed_study(n_subjects):
    """One study in three million would be by chance."""
    rng = default_rng(n_subjects)
    for _ in range(50):
        subjects = []
        for subject in subjects_with(n_subjects, 1, n=20):
            guesses = rng.binomial(subject.n_trials, 0.5)
            subjects.append(replace(subject, n_yes=guesses))
        assert direction(bt.Study(subjects)) == 0


OUTCOME = (IN_ORDER.s2 > IN_ORDER.s1) == TRIALS.second_is_chosen
#: Columns that look like a condition by name, and whether they are offered as one.
CONDITIONS = {
    "right or wrong": (OUTCOME.map({True: "correct", False: "wrong"}), False),
    "side of the answer": (TRIALS.second_is_chosen.map({True: "left", False: "right"}), False),
    "name of the pair": (IN_ORDER.s1.astype(str) + "_" + IN_ORDER.s2.astype(str), False),
    "a text for each trial": (pd.Series([f"t{i}" for i in range(len(TRIALS))]), False),
    "blocks": (pd.Series(np.arange(len(TRIALS)) // 60 % 2), True),
    "right or wrong in half": (OUTCOME.where(np.arange(len(TRIALS)) < 120, "none"), True),
}


@pytest.mark.parametrize("name", CONDITIONS)
def test_what_follows_from_stimuli_and_answers_is_offered_as_no_condition(name, tmp_path):
    column, is_offered = CONDITIONS[name]
    result = checked(tmp_path, IN_ORDER.assign(feedback=column.to_numpy()))
    assert ("--condition feedback" in result.stdout) == is_offered


def test_a_column_condition_with_the_outcome_is_no_condition():
    study = bt.read_study(IN_ORDER.assign(condition=CONDITIONS["right or wrong"][0]))
    assert study.conditions is None
    assert any("condition" in note and "no condition" in note for note in study.notes)


#: Names of other columns, and what is read from them.
NAMES = {
    ("key_resp.keys", "trials.thisN"): {"response", "trial"},
    ("key_resp.keys", "practice_trials.thisN", "trials.thisN"): {"response", "trial"},
    ("key_resp.keys", "blocks.thisN", "main.thisN"): {"response", "trial"},
    ("key_resp.keys", "inner.thisN", "outer.thisN"): {"response"},
    ("key_resp_2.keys", "key_resp_2.rt"): {"response"},
}


@pytest.mark.parametrize("names", NAMES)
def test_columns_of_psychopy_are_read_where_one_is_similar(names):
    table = IN_ORDER.rename(columns={"response": names[0]})
    for name in names[1:]:
        table[name] = np.arange(len(table))
    study = bt.read_study(table)
    assert {*study.reading.read} - {"subject", "s1", "s2"} == NAMES[names]
    assert study.frame().equals(INTENDED.frame())


def test_two_columns_of_keys_are_proposed(tmp_path):
    table = IN_ORDER.rename(columns={"response": "key_resp.keys"}).assign(**{"key_2.keys": "space"})
    result = checked(tmp_path, table)
    assert typed_lines(result)[0] == "--columns response=key_resp.keys"
    assert checked(tmp_path, table, *typed_lines(result)[0].split()).returncode == 0


def test_all_that_is_missing_is_asked_at_once(tmp_path):
    """Columns, order and codes; the first line answers all of them."""
    table = with_order("Reihenfolge", "SC", "CS", coded("j", "f")).rename(
        columns={"standard": "amp_std", "comparison": "amp_cmp", "response": "Taste"}
    )
    result = checked(tmp_path, table)
    assert len(re.findall("^error:", result.stderr, re.MULTILINE)) == 2
    first, *other_lines = typed_lines(result)
    assert first == "--standard-interval Reihenfolge --second-code j"
    assert checked(tmp_path, table, *first.split()).returncode == 0
    for line in other_lines:  # it leads to the next question, or to an answer
        after = checked(tmp_path, table, *line.split())
        assert "found together" not in after.stderr


def test_columns_may_be_named_in_several_options(tmp_path):
    table = IN_ORDER.rename(columns={"s1": "a", "s2": "b"})
    words = ["--columns", "s1=a", "--columns", "s2=b"]
    assert checked(tmp_path, table, *words).returncode == 0


def test_subjects_that_are_numbers_are_named_by_numbers():
    frames = [IN_ORDER.assign(subject=name, block=1) for name in (7, 8, 9)]
    study = bt.read_study(pd.concat(frames))
    assert study.exclude(["7", "8"]).names == study.exclude([7, 8]).names == ("9",)
    assert study.exclude(7).changes == study.exclude(["7"]).changes == ("--exclude 7",)
    assert study.swap([7, 8], 1).changes == ("--swap 7:1", "--swap 8:1")
    with pytest.raises(bt.InputError, match="no subject '70'"):
        study.exclude([7, 70])
