"""Answers that are swapped, and subjects or blocks that are excluded.

What changes and what stays, what is refused, and which results remember it.
"""

from io import StringIO

import pandas as pd
import pytest
from commands import refusal_of, run_ok
from conftest import (
    answers_in_order,
    each_row,
    problems,
    quick_study,
    s1_s2_yes_trials,
    write_counts,
)

import bayes_toe as bt
from bayes_toe.data.options import changed

HEADER = "subject,s1,s2,block,trial,response"
#: Subject a has three blocks of two trials, and b:1 has two blocks of one trial.
ROWS = """\
a,0,0.3,1,1,equal
a,0,0.3,1,2,different
a,0,0.3,2,3,equal
a,0.3,0,2,4,equal
a,0,0,3,5,equal
a,0.3,0,3,6,equal
b:1,0,0.3,1,1,equal
b:1,0.3,0,2,2,different
"""
FRAME = pd.read_csv(StringIO(f"{HEADER}\n{ROWS}"))


@pytest.fixture
def study():
    """Subject a with three blocks of two trials, and b:1 with two blocks of one trial."""
    return bt.read_study(FRAME)


def answers_by_subject(study):
    """The answers of each subject in their order, by its name, as answers_in_order gives them."""
    return {subject.name: answers_in_order(subject) for subject in study}


def test_swapping_blocks_is_as_if_the_file_had_them_the_other_way_round(study):
    # All six answers of a are 'equal' but the second. The answers of blocks 2 and 3 become
    # 'different'. A block may be given as a number or as a text.
    swapped_study = study.swap("a", [2, "3"])
    swapped = swapped_study["a"]
    # A text has the block, * where a session begins, s1, s2, and 'equal'/trials.
    assert answers_in_order(swapped) == [
        "block 1* 0.0 0.3 1/1",
        "block 1 0.0 0.3 0/1",
        "block 2* 0.0 0.3 0/1",
        "block 2 0.3 0.0 0/1",
        "block 3* 0.0 0.0 0/1",
        "block 3 0.3 0.0 0/1",
    ]
    assert s1_s2_yes_trials(swapped) == [(0.0, 0.0, 0, 1), (0.0, 0.3, 1, 3), (0.3, 0.0, 0, 2)]
    assert swapped_study["b:1"] is study["b:1"]
    assert swapped_study.select("a").changes == ("--swap a:2,3",)
    assert swapped_study.notes == (*study.notes, "subject a, blocks 2, 3: responses swapped")
    # To swap a block twice changes nothing. Without blocks, all blocks of a subject are swapped,
    # once even if the subject is named twice.
    assert answers_by_subject(swapped_study.swap("a", (2, 3))) == answers_by_subject(study)
    answers = answers_by_subject(study.swap(["a", "a"]))
    assert answers == answers_by_subject(study.swap("a", [1, 2, 3]))


def test_excluding_is_as_if_the_file_had_no_such_rows(study):
    without_block_2 = study.exclude("a", 2)
    is_excluded = (FRAME.subject == "a") & (FRAME.block == 2)
    expected = bt.read_study(FRAME[~is_excluded])
    assert answers_by_subject(without_block_2) == answers_by_subject(expected)
    assert without_block_2.frame().equals(expected.frame())
    # Without any of its blocks the subject is excluded, too.
    for without_a in (study.exclude("a"), study.exclude("a", [1, 2, 3])):
        assert answers_by_subject(without_a) == {"b:1": answers_in_order(study["b:1"])}


def test_options_name_subjects_and_blocks_and_are_done_in_one_order(study):
    # As with --swap a:2 --swap 'a: 3' --swap b:1 --exclude b:1:2. A subject may have a colon in its
    # name, and b:1:2 is block 2 of b:1.
    changed_study = changed(study, swap=["a:2", "a: 3", "b:1"], exclude=["b:1:2"])
    assert changed_study.changes == (
        "--swap a:2",
        "--swap a:3",
        "--swap b:1",
        "--exclude b:1:2",
    )
    assert answers_by_subject(changed_study) == answers_by_subject(
        study.swap("a", [2, 3]).swap("b:1").exclude("b:1", 2)
    )
    assert changed(study) is study  # without options
    # All blocks are swapped, and block 2 a second time.
    swapped_study = changed(study, swap=["a:2", "a"])
    assert answers_by_subject(swapped_study) == answers_by_subject(study.swap("a", [1, 3]))


def test_blocks_of_several_files_are_named_after_these(tmp_path):
    files = [tmp_path / "session 1.csv", tmp_path / "session 2.csv"]
    for file in files:
        FRAME.to_csv(file, index=False)
    study = changed(bt.read_study(files), swap=["a:session 1.csv: 2, session 2.csv: 3"])
    # Each file has six trials of a. Trials 3 and 4 are block 2 of the first file, and trials 11 and
    # 12 are block 3 of the second file.
    assert study["a"].answers.n_yes.tolist() == [1, 0, 0, 0, 1, 1, 1, 0, 1, 1, 0, 0]
    assert study.changes == ("--swap 'a:session 1.csv: 2,session 2.csv: 3'",)


def test_a_subject_is_excluded_in_all_conditions():
    # A unit is a subject in a condition, such as a@left. A single unit can be excluded, too.
    frame = FRAME.assign(hand=["left", "left", "right"] * 2 + ["left", "right"])
    units = bt.read_study(frame, bt.ReadOptions(condition="hand"))
    assert changed(units, exclude=["a"]).names == ("b:1@left", "b:1@right")
    assert changed(units, exclude=["a@left"]).names == ("a@right", "b:1@left", "b:1@right")


#: Options of every command that reads a study, and the message that refuses them.
REFUSED = """
    --swap x:2 | --swap x:2: no subject 'x'; the subjects are a, b:1
    --exclude a:9 | --exclude a:9: found no block '9', allowed: 1, 2, 3
    --swap a:2 --swap a:2,3 | --swap a:2,3: named twice; name each subject or block once
    --exclude a --exclude a:1 | --exclude a:1: no subject 'a'; the subjects are b:1
    --swap a --swap a | --swap a: named twice; name each subject or block once
    --exclude a --exclude b:1 | --exclude b:1: no subject is left; exclude fewer
"""


@each_row("options, message", REFUSED)
def test_options_that_cannot_be_followed_are_refused_in_one_line(tmp_path, options, message):
    # Such as '--swap x:2' with the message that there is no subject 'x'.
    FRAME.to_csv(tmp_path / "study.csv", index=False)
    for command in ("check study.csv", "fit study.csv -o out.csv", "run study.csv -o out"):
        assert refusal_of(f"{command} {options}", cwd=tmp_path) == f"error: {message}\n"


def test_blocks_of_counts_without_blocks_are_refused():
    # The study has counts of each pair, and no column of blocks.
    message = (
        "--swap A:2: found no column block, allowed: all answers of the subject, or a column with "
        "--columns block=NAME"
    )
    assert problems(changed, quick_study("AB"), swap=["A:2"]) == [message]


def test_results_remember_what_was_changed(tmp_path):
    write_counts(tmp_path / "study.csv", quick_study("ABC"))
    options = "--swap A --exclude C --seed 1 --draws 100"
    screen = run_ok(f"sample study.csv -o draws.nc {options}", cwd=tmp_path)
    assert "\nWith --swap A --exclude C\n" in screen
    study = bt.load(tmp_path / "draws.nc").study
    assert study.changes == ("--swap A", "--exclude C")
    # Of 50 trials of each pair, 45, 20, 15 and 46 answers were 'equal' before the swap.
    assert study["A"].n_yes.tolist() == [5, 30, 35, 4]
