"""Subjects and studies: validated once, immutable, and the same whatever the order of rows."""

import dataclasses

import numpy as np
import pytest
from conftest import columns, each_row, made_subject, refused, s1_s2_yes_trials

from bayes_toe.data.study import Study, Subject

COLUMNS = ("s1", "s2", "n_yes", "n_trials")


def two_pairs_of(name="S01"):
    """A subject with 2 of 8 responses 'equal' to the pair (0.3, 0), and 7 of 10 to (0, 0.3)."""
    return made_subject("0.3 0 2 8, 0 0.3 7 10", name)


def test_pairs_are_sorted_together_with_their_counts():
    # Rows of s1, s2, answers 'equal' and trials.
    subject = made_subject("0.3 0.5 1 4, 0 0.3 2 5, 0.3 0 3 6")
    assert s1_s2_yes_trials(subject) == [(0.0, 0.3, 2, 5), (0.3, 0.0, 3, 6), (0.3, 0.5, 1, 4)]
    types = [getattr(subject, column).dtype.name for column in COLUMNS]
    assert types == ["float64", "float64", "int64", "int64"]


def test_a_subject_has_the_number_of_its_pairs_and_trials_and_the_share_of_equal():
    # 2 of 8 and 7 of 10 responses are 'equal'.
    subject = two_pairs_of("S01")
    assert subject.n_pairs == 2
    assert subject.total_trials == 18
    assert subject.fraction_yes == 0.5


def test_arrays_are_copies_and_read_only():
    # A later change of the caller's array does not change the subject, and the arrays of the
    # subject cannot be changed.
    s1 = np.array([0.0, 0.3])
    subject = Subject("S01", s1, [0.0, 0.0], [1, 1], [2, 2])
    s1[0] = 9.0
    assert subject.s1.tolist() == [0.0, 0.3]
    for column in COLUMNS:
        with pytest.raises(ValueError, match="read-only"):
            getattr(subject, column)[0] = 1
    with pytest.raises(dataclasses.FrozenInstanceError):
        subject.name = "S02"


#: Rows of s1, s2, answers 'equal' and trials, and the message that refuses them.
REFUSED_ROWS = r"""
    0.3 0 2 8, nan 0.3 7 10 | s1 and s2 must be finite
    0.3 inf 2 8, 0 0.3 7 10 | s1 and s2 must be finite
    0.3 0 2.5 8, 0 0.3 7 10 | n_yes must be whole numbers, found \[2.5\]
    0.3 0 nan 8, 0 0.3 7 10 | n_yes must be whole numbers
    0.3 0 2 8.5, 0 0.3 7 10 | n_trials must be whole numbers
    0.3 0 -1 8, 0 0.3 7 10 | every n_yes must lie in 0..n_trials
    0.3 0 9 8, 0 0.3 7 10 | every n_yes must lie in 0..n_trials
"""


@each_row("rows, message", REFUSED_ROWS)
def test_rows_that_are_no_counts_are_refused(rows, message):
    # Rows of s1, s2, answers 'equal' and trials, such as '0.3 0 9 8': 9 of 8 is no count.
    with refused(message):
        made_subject(rows)


@pytest.mark.parametrize(
    "name, s1, n_yes, n_trials, message",
    [
        ("", [0.3, 0.0], [2, 7], [8, 10], "subject name '' must be a non-empty text"),
        (7, [0.3, 0.0], [2, 7], [8, 10], "subject name 7 must be a non-empty text"),
        ("S01", [0.0], [2, 7], [8, 10], "must be of one length"),
        ("S01", [0.3, 0.0], [2, 7], [8, 10, 1], "must be of one length"),
        ("S01", [0.3, 0.0], ["2", "7"], [8, 10], "n_yes must be numbers"),
        ("S01", np.ma.array([0.3, 0.0], mask=[1, 0]), [2, 7], [8, 10], "none of them masked"),
    ],
)
def test_invalid_subjects_are_refused(name, s1, n_yes, n_trials, message):
    # A subject with two pairs, s2 of 0 and 0.3, and with one wrong column.
    with refused(message):
        Subject(name, s1, [0.0, 0.3], n_yes, n_trials)


def test_a_subject_without_trials_is_refused():
    with refused("no answered trial"):
        Subject("S01", [], [], [], [])


def test_counts_are_added_up():
    # Rows of s1, s2, 'equal' and trials. Two rows have the pair (0.3, 0), and (1, 1) has no trials.
    subject = Subject("S01", *columns("0.3 0 1 5, 0 0.3 2 5, 0.3 0 3 6, 1 1 0 0"))
    assert s1_s2_yes_trials(subject) == [(0.0, 0.3, 2, 5), (0.3, 0.0, 4, 11)]
    # The stimuli of a pair without trials may be nan, and -0 is the same stimulus as 0.
    assert Subject("S01", *columns("0 0 1 5, nan 0 0 0")).n_pairs == 1
    assert Subject("S01", *columns("0 1 1 1, -0 1 0 1")).n_pairs == 1


def test_a_study_is_a_sequence_of_its_subjects():
    subjects = [two_pairs_of("b"), two_pairs_of("a"), two_pairs_of("c")]
    study = Study(subjects, "pilot", synthetic=True, notes=["n"])
    assert len(study) == 3
    assert study.names == ("b", "a", "c")
    assert list(study) == subjects
    assert study["a"] is subjects[1]
    selection = study.select(["c", "b"])
    assert selection.names == ("c", "b")
    assert selection.source == "pilot"
    assert selection.synthetic is True
    assert selection.notes == study.notes == ("n",)


def test_unknown_subjects_are_refused_with_those_there_are():
    study = Study((two_pairs_of("a"), two_pairs_of("b")), "pilot")
    for action in (lambda: study["c"], lambda: study.select(["a", "c"])):
        with refused(r"no subject 'c' in pilot; there are: 'a', 'b'$"):
            action()


def test_studies_need_distinct_subjects():
    with refused("at least one subject"):
        Study(())
    with refused(r"must be unique, repeated: 'a'$"):
        Study((two_pairs_of("a"), two_pairs_of("b"), two_pairs_of("a")))
    assert len(Study((two_pairs_of("a"), two_pairs_of("A")))) == 2  # names that differ


@pytest.mark.parametrize(
    "rows",
    [
        "0 0.3 0 1e300",
        "0 0.3 0 inf",
        "0 0.3 0 1000000000002",
        ", ".join(["0 0.3 0 1e12"] * 3000),
    ],
    ids=["1e300", "inf", "one count", "sum"],
)
def test_counts_that_are_too_large_are_refused(rows):
    # Rows of s1, s2, 'equal' and trials. A pair has at most 10^12 trials. The last case has 3,000
    # rows of one pair, each with so many trials.
    with refused(r"no more than 10\^12"):
        Subject("S01", *columns(rows))


def test_stimuli_that_are_no_numbers_are_refused():
    with refused("must be numbers"):
        Subject("S01", ["a"], [0.3], [0], [1])
