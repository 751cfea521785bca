"""Reading studies: every dialect gives the same study, every bad input one line per problem."""

import csv
import io
import math
import re
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import counts, problems
from hypothesis import given, settings
from hypothesis import strategies as st

import bayes_toe as bt
from bayes_toe.data.options import ReadOptions
from bayes_toe.data.validation import number, whole_number
from bayes_toe.errors import InputError

TRIALS = "subject,s1,s2,response\n"
COUNTS = "subject,s1,s2,n_equal,n_trials\n"
ORDERED = "subject,s1,s2,response,block,trial\n"
FUZZ = settings(max_examples=120, deadline=None, derandomize=True, database=None)


def read(data, **options):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "study.csv")
        path.write_bytes(data if isinstance(data, bytes) else data.encode())
        return bt.read_study(path, ReadOptions(**options))


def words(rows):
    """Rows whose fourth cell is 1 or 0, with words in its place."""
    rows = re.sub(r"^((?:[^,]*,){3})1(?=,|$)", r"\1equal", rows, flags=re.MULTILINE)
    return re.sub(r"^((?:[^,]*,){3})0(?=,|$)", r"\1different", rows, flags=re.MULTILINE)


def refused(data, **options):
    """The problems of a file without its name, each one line that no terminal would obey."""
    lines = problems(read, data, **options)
    assert all(map(str.isprintable, lines))
    assert all(line.startswith(("study.csv: ", "... and ")) for line in lines)
    return [line.removeprefix("study.csv: ") for line in lines]


def content(study):
    """Subjects of a study with their pairs and counts, as a text."""
    rows = []
    for subject in study:
        rows += [f"{subject.name} {s1} {s2} {k} {n}" for s1, s2, k, n in counts(subject)]
    return ", ".join(rows)


# --- What is read ---------------------------------------------------------------------------------

AMPLITUDES = "subject,i1,i2,response\n"
#: What `content` gives: subject, s1, s2, responses 'equal' and trials.
EQUAL = "a 0.0 0.0 1 1"
DIFFERENT = "a 0.0 0.0 0 1"
EACH_CASE = "a 0.0 0.0 1 2"
FIVE = "a 0.0 0.0 0 5"
QUARTER = "a 0.25 -0.25 1 1"

#: Rows of trials and how they are read.
READ_TRIALS = [
    # Subjects in order of first appearance, also in rows without an answer.
    ("b,0.1,0.3,equal\nb,0.1,0.3,different\na,0,0,different", "b 0.1 0.3 1 2, a 0.0 0.0 0 1"),
    ("b,0,0,\na,0,0,equal\nb,0,0,equal", "b 0.0 0.0 1 1, a 0.0 0.0 1 1"),
    ("a,-0.0,0,same\na,0,-0,different", EACH_CASE),
    ("a,+0.25,-0.25,same", QUARTER),
    ("a,.25,-.25,same", QUARTER),
    ("a,25E-2,-25E-2,same", QUARTER),
    ("a,0,0, SAME ", EQUAL),
    ("a,0,0,Different", DIFFERENT),
]
READ_FILES = [
    (COUNTS + "a,0,0.3,1,5\na,0.0,0.30,2,6\na,1,1,0,0\na,0,0.3,0,4", "a 0.0 0.3 3 15"),
    (
        COUNTS + "a,0,0,1000000000000,1000000000000",
        "a 0.0 0.0 1000000000000 1000000000000",
    ),
    (COUNTS + "a,0,0,0,5.0", FIVE),
    (COUNTS + "a,0,0,0,+5", FIVE),
    (COUNTS + "a,0,0,0,005", FIVE),
    # Cells and headers are stripped; blank rows and other columns, also repeated ones, are ignored.
    (' subject , s1,"s2 ",response \n a , 0 ,\t0.5, "equal "\n', "a 0.0 0.5 1 1"),
    ('x,subject,s1,,x,s2,response,\n\n1,a,0,,"free, text",0,equal,\n  \n,,,,,,,\n,\n', EQUAL),
    ("subject;s1;s2;response;a,b,c,d,e,f,g\na;0;0;equal;y\n", EQUAL),
    ("subject,s1,s2,response\ra,0,0,equal\r", EQUAL),
    # Stimuli in both units: the option chooses.
    ("subject,s1,s2,i1,i2,response\na,0,0,7,8,equal\n", EQUAL),
]


def require_read(data, expected, **options):
    study = read(data, **options)
    assert content(study) == expected
    assert not any(np.signbit(subject.s1[subject.s1 == 0]).any() for subject in study)


@pytest.mark.parametrize("rows, expected", READ_TRIALS)
def test_rows_of_trials_are_read(rows, expected):
    require_read(TRIALS + rows, expected)


@pytest.mark.parametrize("text, expected", READ_FILES)
def test_files_are_read(text, expected):
    require_read(text, expected)


def test_codes_are_exact_and_one_leaves_the_words_of_the_other_side():
    coded = "subject;s1;s2;response\na;0;0;1,0\na;0;0;0,0\na;0;0;1\n"
    require_read(coded, "a 0.0 0.0 2 3", equal_code="1")
    require_read(f"{TRIALS}a,0,0,f\na,0,0, J \n", EACH_CASE, equal_code="f", different_code="J")
    require_read(f"{TRIALS}a,0,0,0\na,0,0,1\n", EACH_CASE, equal_code="0", different_code="1")
    rows = "a,0,0,z\na,0,0,different\na,0,0,Different\n"
    require_read(TRIALS + rows, "a 0.0 0.0 1 3", equal_code="z")
    require_read(f"{TRIALS}a,0,0,None\na,0,0,none\na,0,0,different\n", EACH_CASE, equal_code="None")


def test_columns_are_chosen_by_options():
    block = {"columns": {"subject": "block"}}
    require_read("block,s1,s2,response\na,0,0,equal\n", EQUAL, **block)
    swapped = {"columns": {"s1": "s2", "s2": "s1"}}
    require_read(f"{TRIALS}a,1,2,equal\n", "a 2.0 1.0 1 1", **swapped)
    joint = "subject,s1,s2,i1,i2,response\na,7,8,0.087,0.087,equal\n"
    require_read(joint, EQUAL, intensity=0.087)  # the reference itself is exactly 0


@pytest.mark.parametrize(
    "data, options, notes",
    [
        (
            TRIALS + "a,0,0,1.0\na,0,0,0\n",
            {"equal_code": "1"},
            """
            trial rows, comma-separated, UTF-8, responses '1.0' as equal (1) / '0' as different (1)
            """,
        ),
        (
            COUNTS + "a,0,0.3,1,5\nb,0,0,3,3\na,0.0,0.30,2,6\na,1,1,0,0\na,0,0.3,0,4\n",
            {},
            """
            grouped rows, comma-separated, UTF-8, 6 of 18 trials answered 'equal'
            1 row with n_trials = 0 left out
            2 repeated rows merged: a 2
            """,
        ),
        (
            "subject,s1,s2,k,n\na,0,0,1,2\na,0,0,1,2\n",
            {"columns": {"n_equal": "k", "n_trials": "n"}},
            """
            grouped rows, comma-separated, UTF-8, 2 of 4 trials answered 'equal'
            column k read as n_equal
            column n read as n_trials
            1 repeated row merged: a 1
            """,
        ),
        (
            "subject,first,i2,response\na,0.087,0.174,f\n",
            {"intensity": 0.087, "equal_code": "f", "columns": {"i1": "first"}},
            """
            trial rows, comma-separated, UTF-8, responses 'f' as equal (1) / 'different' (0)
            column first read as i1, amplitude in units of 0.087
            column i2 read as amplitude in units of 0.087
            """,
        ),
        (
            "subject;s1;s2;response;task\na;0,5;0;same;x\na;0,5;0;same;x\nb;x;;;y\n",
            {"where": {"task": "x"}},
            """
            trial rows, semicolon-separated, UTF-8, decimal comma,
            responses 'same' as equal (2) / 'different' (0)
            only rows with x in column task
            """,
        ),
    ],
)
def test_what_was_detected_and_merged_is_noted(data, options, notes):
    assert " ".join(read(data, **options).notes) == " ".join(notes.split())


@pytest.mark.parametrize("text", ["", " ", "NA", "na", "N/A", "n/a", "NaN", "nan", "None"])
def test_rows_without_a_response_are_dropped_and_counted(text):
    study = read(f"{TRIALS}a,0,0,equal\na,,x1,{text}\nb,0,0,{text}\n,,,{text}\na,0,0,{text}\n")
    assert content(study) == EQUAL
    notes = (
        "1 row without stimuli and response left out",
        "3 trials without a response dropped: a 2, b 1",
        "1 subject without any response left out: b",
    )
    # Without any text, the reader of the file leaves out the blank row.
    assert study.notes[1:] == notes[not text.strip() :]


def test_subject_names_stay_as_they_are():
    text = "01|1|1.0|NA|nan|None|Zoë|被験者 一|🙂|a\u200bb|O'Neil|true|1e5|-"
    names = text.split("|")
    assert read(TRIALS + "".join(f"{name},0,0,equal\n" for name in names)).names == tuple(names)
    assert read(f'{TRIALS}"a ""x"", b",0,0,equal\n"c\nd",0,0,equal\n').names == ('a "x", b', "c\nd")


def test_amplitudes_become_log_intensities_and_do_not_overflow():
    study = read(AMPLITUDES + "a,0.087,0.174,equal\na,0.0435,1e-3,different\n", intensity=0.087)
    assert study["a"].s1 == pytest.approx([math.log(0.5), 0.0], abs=1e-15)
    assert study["a"].s2 == pytest.approx([math.log(1e-3 / 0.087), math.log(2.0)], rel=1e-14)
    extreme = read(AMPLITUDES + "a,1e308,1e-308,same\n", intensity=1e-300)["a"]
    assert extreme.s1 == pytest.approx([608 * math.log(10)])
    assert extreme.s2 == pytest.approx([-8 * math.log(10)])


@pytest.mark.parametrize(
    "marks, synthetic, noted",
    [
        ("1 1", True, True),
        ("true YES", True, True),
        ("1 0", False, True),
        (" ", False, False),
        ("1 ", False, True),
    ],
)
def test_synthetic_column(marks, synthetic, noted):
    rows = "a,0,0,equal,{}\na,0,0,equal,{}\n".format(*marks.split(" "))
    study = read("subject,s1,s2,response,synthetic\n" + rows)
    assert study.synthetic is synthetic
    assert any("synthetic" in note for note in study.notes) is noted


# --- Answers in their order -----------------------------------------------------------------------


def answers(text, **options):
    """The answers of the subject a."""
    return read(text, **options)["a"].answers


def test_blocks_and_trials_are_kept_in_order_beside_the_counts():
    # The columns of ORDERED: subject, s1, s2, response, block, trial.
    rows = words("a,0,1,1,10,2\nb,0,0,1,x,7\na,0,0,0,9,1\na,0,0,NA,9,2\na,0,0,1,10,1\n")
    study = read(ORDERED + rows)
    assert content(study) == "a 0.0 0.0 1 2, a 0.0 1.0 1 1, b 0.0 0.0 1 1"

    in_order = study["a"].answers
    # One block is no number: they are in order of appearance.
    assert in_order.blocks == ("10", "9")
    # A trial without an answer was presented all the same.
    assert in_order.keys.tolist() == [[0, 0], [0, 1], [0, 0], [0, 0]]
    assert in_order.n_yes.tolist() == [1, 1, 0, 0]
    assert in_order.n_trials.tolist() == [1, 1, 1, 0]
    assert in_order.block.tolist() == [0, 0, 1, 1]
    assert in_order.is_session_start.tolist() == [True, False, True, False]
    assert in_order.has_trial_rows
    assert study.reading.ignored == ()

    # Blocks that are numbers are sorted as numbers.
    numbered = answers(ORDERED + words("a,0,1,1,10,2\na,0,0,0,9,1\na,0,0,1,10,1\n"))
    assert (numbered.blocks, numbered.n_yes.tolist()) == (("9", "10"), [0, 1, 1])


def test_sessions_tell_the_order_and_where_memory_begins_anew():
    header = "subject,s1,s2,response,session,block,trial,iti\n"
    rows = words("a,0,0,1,2,1,1,\na,0,1,1,1,1,1,\na,0,1,0,1,2,1,2.5\na,1,1,1,1,2,3,-1\n")
    study = read(header + rows)
    in_order = study["a"].answers
    assert in_order.n_yes.tolist() == [1, 0, 1, 1]
    assert in_order.is_session_start.tolist() == [True, False, False, True]
    np.testing.assert_array_equal(in_order.iti, [np.nan, 2.5, np.nan, np.nan])
    assert study.notes[1:] == (
        "trial numbers are missing (a 1); keep trials without a response in the file, with an "
        "empty response",
        "no time since the trial before for 1 trial in column iti",
    )
    assert study.exclude("a", "2")["a"].answers.is_session_start.tolist() == [True, True]
    # Other counts are not those of the answers.
    assert replace(study["a"], n_yes=[0, 0, 0]).answers is None


def test_trials_that_tell_no_order_leave_that_of_the_file_and_are_noted():
    study = read(ORDERED + words("a,0,1,1,1,1\na,0,0,0,1,1\nb,0,0,0,1,x\nc,0,0,0,1,1\n"))
    assert study.notes[1:] == (
        "column trial does not order all trials, so the order of the file is used: a, b",
    )
    assert study["a"].answers.n_yes.tolist() == [1, 0]


#: Trials with numbers: columns as in ORDERED, and the same without blocks.
NUMBERED = ORDERED + words("a,0,1,1,1,1\na,0,0,0,1,2\nb,0,0,0,1,1\n")
WITHOUT_BLOCKS = "subject,s1,s2,response,trial\na,0,1,equal,1\n"


def test_rows_that_repeat_an_earlier_trial_are_doubted():
    (doubt,) = read(NUMBERED + words("b,0,1,NA,1,1\na,0,0,0,1,2\nb,0,0,0,1,1\n")).reading.doubts
    expected = "2 rows with the trial number and all else of an earlier row, first row 6 ("
    assert expected in doubt
    (doubt,) = read(WITHOUT_BLOCKS + "a,0,1,equal,1\n").reading.doubts
    assert "1 row with the trial number and all else" in doubt


@pytest.mark.parametrize(
    "text",
    [
        NUMBERED,
        NUMBERED + words("b,0,0,1,1,1\n"),
        NUMBERED + words("a,0,0,0,1,x\na,0,0,0,1,x\n"),
        WITHOUT_BLOCKS + "a,0,0,equal,1\n",
        TRIALS + words("a,0,1,1\na,0,1,1\n"),
    ],
    ids=["as it is", "another response", "no number", "another pair", "no column trial"],
)
def test_rows_that_differ_or_have_no_trial_number_are_no_doubt(text):
    assert read(text).reading.doubts == ()


def test_counts_have_answers_where_they_have_blocks():
    text = "subject,s1,s2,n_equal,n_trials,Run\na,0,1,1,5,1\na,0,1,2,5,2\n"
    study = read(text, columns={"block": "Run"})
    assert content(study) == "a 0.0 1.0 3 10"
    in_order = study["a"].answers
    assert (in_order.n_yes.tolist(), in_order.n_trials.tolist()) == ([1, 2], [5, 5])
    assert (in_order.blocks, in_order.has_trial_rows) == (("1", "2"), False)
    assert answers(COUNTS + "a,0,1,1,5\n") is None


def test_columns_that_nobody_reads_are_told_by_name():
    reading = read("rt,subject,s1,s2,i1,,response,rt,Block\n1,a,0,1,5,,same,2,3\n").reading
    assert reading.ignored == ("rt", "i1", "Block")
    assert reading.read == ("subject", "s1", "s2", "response")
    # Which of two is meant cannot be told, and no result depends on it.
    twice = read("subject,s1,s2,response,block,block\na,0,1,same,1,2\n")
    assert twice.reading.ignored == ("block",)


# --- Several files --------------------------------------------------------------------------------


def written(folder, **texts):
    """Write files by name."""
    for name, text in texts.items():
        (folder / f"{name}.csv").write_text(text)
    return [folder / f"{name}.csv" for name in texts]


def test_a_file_that_is_a_copy_of_another_is_told(tmp_path):
    text = TRIALS + words("".join(f"a,0,{row % 3},{row % 2}\n" for row in range(20)))
    other = text.replace("a,", "b,")
    files = written(tmp_path, first=text, other=other, copy=text, longer=text + "a,0,0,same\n")
    (doubt,) = bt.read_study(files).reading.doubts
    identical = "copy.csv has the same 20 trials of subject a as first.csv: repeated trials make"
    assert doubt.startswith(identical)
    assert bt.read_study([files[0], files[1], files[3]]).reading.doubts == ()


def test_of_several_files_the_first_problems_are_told(tmp_path):
    bad, other = TRIALS + "a,x,0,equal\n" * 3, TRIALS + "a,y,0,equal\n"
    numerous = TRIALS + "".join(f"a,x{letter},0,equal\n" for letter in "abcdefghijkl")
    files = written(tmp_path, a=numerous, b=bad, c=bad, d=other)
    assert problems(bt.read_study, files)[-1] == "... and more problems"
    assert problems(bt.read_study, files[1:]) == [
        "2 files, such as b.csv: column s1: found 'x' in 3 rows, the first is row 2, allowed: a "
        "finite number",
        "d.csv: row 2, column s1: found 'y', allowed: a finite number",
    ]


# --- Options --------------------------------------------------------------------------------------


def test_options_are_refused_all_at_once():
    wrong = {"intensity": -1, "equal_code": "", "columns": {"x": "y"}}
    observed = problems(lambda: ReadOptions(**wrong))
    assert [problem.partition(":")[0] for problem in observed] == [
        "--equal-code",
        "--intensity",
        "--columns",
    ]
    (problem,) = problems(lambda: ReadOptions(missed=None))
    assert problem == "missed: found NoneType, allowed: a text, or several in a list"


# --- Files of other labs; tests/data/test_shapes.py has more of them ------------------------------

BOTH_ORDERS = "a 0.0 0.3 1 1, a 0.3 0.0 0 1"


def test_two_columns_that_may_be_the_subject_are_none():
    with pytest.raises(InputError, match="no column subject"):
        read("participant,observer,s1,s2,response\na,b,0,0.3,second\n")


def typed_remedies(data, **options):
    """What a refusal proposes to type."""
    with pytest.raises(InputError) as caught:
        read(data, **options)
    return [remedy.typed for remedy in caught.value.remedies]


def test_a_column_of_responses_without_any_is_named():
    rows = "subject,s1,s2,response,judgement\na,0,0.3,,second\na,0.3,0,,first\n"
    assert typed_remedies(rows) == ["--columns response=NAME"]
    assert content(read(rows, columns={"response": "judgement"})) == BOTH_ORDERS


def test_the_code_proposed_for_second_is_commoner_with_a_stronger_second_stimulus():
    rows = TRIALS + "a,0,0.3,z\na,0.3,0,m\n" * 3 + "a,0,0.3,m\n"
    assert typed_remedies(rows) == ["--second-code z", "--equal-code z"]


#: A column beside `correct`, its cells in answered trials (of both orders), and in missed trials.
SIGNS = [
    *(("key", "j|l", text) for text in ("-1", "-99", "-999", "0", "[]", "timeout", "no response")),
    *(("rt", ".6|.7", text) for text in ("-1", "-1.0", "0", "999", "inf", "None", "NA")),
    *(("key_resp_2.rt", "743|820", text) for text in ("9999", "-1", "")),
    *((name, "0|0", "1") for name in ("timed_out", "timeout", "missed", "noResponse", "too_late")),
    ("Timed out", "no|no", "yes"),
]
#: The same where the last cell is that of an answered trial, too.
NO_SIGNS = [
    ("key", "1|1", "0"),
    ("rt", "1400|1500", "999"),
    ("rt", "2999|2998", "3000"),
    ("start", "7|8", "0"),
    ("timeout", "0|0", "3000"),
]


def scored(column, answered, missed, scores="00"):
    """Eight trials that are scored right or wrong, and two for each of `scores`.

    In the column, the latter have the cell of a missed trial.
    """
    first, second = answered.split("|")
    rows = [f"subject,s1,s2,correct,{column}"]
    for score in "1101":
        rows += [f"a,0,0.3,{score},{first}", f"a,0.3,0,{score},{second}"]
    for score in scores:
        rows += [f"a,0,0.3,{score},{missed}", f"a,0.3,0,{score},{missed}"]
    return "\n".join([*rows, ""])


@pytest.mark.parametrize("column, answered, missed", SIGNS)
def test_a_missed_trial_is_shown_by_any_usual_sign(column, answered, missed):
    study = read(scored(column, answered, missed), correct="correct")
    assert study["a"].total_trials == 8  # without the four that are missed
    (note,) = (note for note in study.notes if "dropped" in note)
    cell = repr(missed) if missed else "empty"
    assert note == f"4 trials without a response dropped ({cell} in column {column}): a 4"
    # A trial that is scored right has a response, whatever the sign says.
    right = read(scored(column, answered, missed, scores="11"), correct="correct")
    assert right["a"].total_trials == 8 + 4


@pytest.mark.parametrize("column, answered, missed", NO_SIGNS)
def test_other_cells_beside_wrong_responses_show_no_missed_trial(column, answered, missed):
    study = read(scored(column, answered, missed, scores="0"), correct="correct")
    assert study["a"].total_trials == 8 + 2


THREE_CODES = TRIALS + "a,0,0.3,39\na,0.3,0,37\na,0,0.3,{0}\na,0.3,0,{0}\n"


def test_minus_one_beside_two_named_codes_is_a_missed_trial():
    for missed in ((), "-1"):
        study = read(THREE_CODES.format("-1"), second_code="39", first_code="37", missed=missed)
        assert content(study) == BOTH_ORDERS
        assert "2 trials without a response dropped ('-1' in column response): a 2" in study.notes
    assert content(read(TRIALS + "a,0,0.3,second\na,0.3,0,first\na,0,0.3,-1\n")) == BOTH_ORDERS
    # It is an answer beside one code, and may be one beside others whose meaning is not known.
    two_codes = TRIALS + "a,0,0.3,1\na,0.3,0,-1\n"
    assert content(read(two_codes, second_code="1")) == BOTH_ORDERS
    with pytest.raises(InputError):
        read(two_codes + "a,0.3,0,0\n", second_code="1")


def test_another_third_code_is_asked_for_and_may_be_declared():
    codes = {"second_code": "39", "first_code": "37"}
    text = THREE_CODES.format("0")
    assert typed_remedies(text, **codes) == ["--equal-code 0", "--second-code 39"]  # a half
    study = read(text, missed="0", **codes)
    assert content(study) == BOTH_ORDERS
    assert "2 trials without a response dropped ('0' in column response): a 2" in study.notes
    keys = scored("key", "j|l", "x")
    assert read(keys, correct="correct", missed=["y", "x"])["a"].total_trials == 8


POINTS = "subject;i1;i2;response\na;850;1.050;second\na;1.050;850;first\n"
COMMAS = POINTS.replace(";", "\t").replace(".", ",")


@pytest.mark.parametrize("data, sign, other", [(POINTS, ".", ","), (COMMAS, ",", ".")])
def test_a_sign_that_may_group_thousands_is_asked_for(data, sign, other):
    with pytest.raises(InputError, match=r"can be 1050 or 1\.050"):
        read(data, intensity=1000.0)
    assert typed_remedies(data, intensity=1000.0) == [f"--decimal {sign}", f"--decimal {other}"]
    grouped = read(data, intensity=1000.0, decimal=other)["a"]
    assert np.exp(grouped.s1) == pytest.approx([0.85, 1.05])
    decimal = read(data, intensity=1.0, decimal=sign)["a"]
    assert sorted(np.exp(decimal.s1)) == pytest.approx([1.05, 850.0])


def test_other_numbers_show_that_a_sign_groups_no_thousands():
    decimal = read(POINTS.replace("850", "0.850"), intensity=1.0)["a"]
    assert np.exp(decimal.s1) == pytest.approx([0.85, 1.05])
    # Natural logs are never thousands.
    logs = "subject;s1;s2;response\na;99;2.125;second\na;2.125;99;first\n"
    assert read(logs, unit="ln")["a"].s1.tolist() == [2.125, 99.0]
    assert typed_remedies(logs.replace("99", "-100"))  # too large for one


def test_spaces_apostrophes_a_minus_sign_and_a_line_that_names_the_delimiter():
    data = "sep=;\nsubject;i1;i2;response\na;1'360;1 500;second\na;1\u202f500;1360;first\n"
    assert np.exp(read(data, intensity=1.0)["a"].s1) == pytest.approx([1360.0, 1500.0])
    assert content(read(f"{TRIALS}a,\u22120.3,0,same\n")) == "a -0.3 0.0 1 1"


STANDARDS = """subject,standard,comparison,interval,response
a,0,0.3,1,comparison
a,0,0.3,2,comparison
a,0,0.3,1,standard
a,0,-0.3,2,standard
"""


def test_a_standard_and_a_comparison_need_their_order():
    columns = {"s1": "standard", "s2": "comparison"}
    remedies = [
        "--standard-interval interval",
        "--comparison-interval interval",
        "--standard-first",
    ]
    assert typed_remedies(STANDARDS) == typed_remedies(STANDARDS, columns=columns) == remedies
    with pytest.raises(InputError, match="an order effect would cancel out"):
        read(STANDARDS, columns=columns)


@pytest.mark.parametrize(
    "earlier, after, expected",
    [
        ("a,0,0.3,1", "a,x,0.3,1", "row 2, column standard: found 'x', allowed: a finite number"),
        ("comparison,interval", "level,interval", "row 1: there is no column comparison."),
    ],
)
def test_what_is_refused_of_a_standard_and_a_comparison(earlier, after, expected):
    text = STANDARDS.replace(earlier, after, 1)
    (problem,) = refused(text, standard_interval="interval")
    assert problem.startswith(expected)


# --- Refusals -------------------------------------------------------------------------------------

NUMBER = "a finite number"
RANGE = "0, or natural logs from 1e-99 to 1e100 in size"
UNGROUPED = f"{NUMBER}, without thousands separators"
WHOLE_NUMBER = "a whole number from 0 to 10^12, without thousands separators"
OTHER_CODES = "or empty; other codes by --equal-code, --different-code"
ANSWERS = f"equal, same (equal) or different (different), {OTHER_CODES}"
CODES = f"'f' (equal) or 'J' (different), {OTHER_CODES}"
QUOTES = "allowed: quotes around whole cells, doubled inside"
TEXT = "allowed: text in UTF-8 or UTF-16, or the encoding that --encoding names"
EMPTY = "found an empty file, allowed: a header and at least one row"
HEADER_ONLY = "row 1: found no row below it, allowed: at least one row"
ALONE = (
    "allowed: responses (one row per trial), counts of one response (one row per pair), or "
    "n_first, n_equal and n_second"
)
POSITIVE = "a positive finite number"
SEMICOLONS = "subject;s1;s2;response\n"

#: A file with {} in the place of a cell of row 2, options, the column, what is allowed, the cells.
CELLS = [
    (TRIALS + "a,{},0,equal", {}, "s1", NUMBER, "abc|nan|-inf|1e999|1_0|0x1||1 2|٣|\u2212\u22121"),
    (SEMICOLONS + "a;{};0;same", {}, "s1", UNGROUPED, "1.234,5|1,234.5|1,2,3|1.2.3"),
    (SEMICOLONS + "a;{};0;same", {}, "s1", NUMBER, "1 00|1'000'0"),
    (
        TRIALS + 'a,"{}",0,same',
        {},
        "s1",
        f"{NUMBER}; decimal commas need ';' or tab between cells",
        "0,087",
    ),
    (
        AMPLITUDES + "a,1,{},same",
        {"intensity": 2.0},
        "i2",
        POSITIVE,
        "0|-0.1|0.0|1e-999|nan|inf|x|",
    ),
    (
        COUNTS + 'a,0,0,"{}",1000000000000',
        {},
        "n_equal",
        WHOLE_NUMBER,
        "-1|2.5||inf|1000000000001|1e3|5.000|1,5|٣",
    ),
    ("subject;s1;s2;n_equal;n_trials\na;0;0;5;{}", {}, "n_trials", WHOLE_NUMBER, "12.000"),
    (TRIALS + "a,{},0,equal", {"unit": "ln"}, "s1", RANGE, "1e101|-1e300|1e-100"),
    (
        TRIALS + "a,0,0,{}\na,0,0,equal",
        {},
        "response",
        ANSWERS,
        "2|0.5|true|equal.|same different|1e0",
    ),
    (
        TRIALS + "a,0,0,{}",
        {"equal_code": "f", "different_code": "J"},
        "response",
        CODES,
        "F|j|equal|1|0",
    ),
    (
        "who,s1,first,s2,response\na,9,{},1,same",
        {"columns": {"subject": "who", "s1": "first"}},
        "first",
        NUMBER,
        "x",
    ),
]


@pytest.mark.parametrize("text, options, column, rule, cells", CELLS)
def test_a_cell_that_cannot_be_used_is_refused(text, options, column, rule, cells):
    for cell in cells.split("|"):
        expected = f"row 2, column {column}: found {cell!r}, allowed: {rule}"
        assert refused(text.format(cell), **options) == [expected]


#: Whole files and their problems, a line each.
REFUSED_FILES = {
    "id,x,response\na,0,equal\n": (
        "row 1: there is no column subject, no column s1 and no column s2. The columns are id, x, "
        "response."
    ),
    "subject,s1,s2,n_equal\na,0,1,5\n": (
        "row 1: there is no column n_trials. The columns are subject, s1, s2, n_equal."
    ),
    "subject,s1,s2,n_trials\na,0,1,5\n": (
        "row 1: there is no column n_equal. The columns are subject, s1, s2, n_trials."
    ),
    "subject,i1,i2,response\na,1,2,equal\n": "row 1, columns i1 and i2 seem to be intensities.",
    "subject,s1,s2,response,n_equal\n": (
        f"row 1, column response: found together with n_equal, {ALONE}"
    ),
    "subject,s1,s2,s1,response\na,0,0,0,equal\n": (
        "row 1, column s1: found 2 columns of this name, allowed: one"
    ),
    "subject,s1,response\na,0,equal\nb,0\n": (
        "row 1: there is no column s2. The columns are subject, s1, response.\n"
        "row 3: found 2 cells, allowed: 3 cells as in the header"
    ),
    "": EMPTY,
    "\ufeff": EMPTY,
    TRIALS: HEADER_ONLY,
    COUNTS: HEADER_ONLY,
    f'"{TRIALS}a,0,0,equal\n': f"row 1: found a quote that is never closed, {QUOTES}",
    f"\n \n{TRIALS}\na,0,x,equal\n": "row 5, column s2: found 'x', allowed: a finite number",
}
#: The same of rows below the header of counts.
REFUSED_COUNTS = {
    "a,0,0,1,2\n ,0,0,0,0\n": (
        "row 3, column subject: found '', allowed: a text that is not empty"
    ),
    "a,0,0,2,2\na,0,1,6,5\n": ("row 3, column n_equal: found '6', allowed: 0 to n_trials = 5"),
    "a,0,0,2,2\na,0,1,1,0\n": ("row 3, column n_equal: found '1', allowed: 0 to n_trials = 0"),
    "a,0,0,1,2\nb,0,0,0,0\nb,0,1,0,0\nc,0,0,0,0\n": (
        "column subject: found 'b' in 2 rows, the first is row 3, allowed: a subject with at least "
        "1 trial in some row\n"
        "row 5, column subject: found 'c', allowed: a subject with at least 1 trial in some row"
    ),
}
#: The same of rows below the header of trials.
REFUSED_TRIALS = {
    "a,0,0,equal\na,0,0\na,0,0,equal\n": (
        "row 3: found 3 cells, allowed: 4 cells as in the header"
    ),
    "a,0,0,equal,\n": "row 2: found 5 cells below 4 names, allowed: a name for each column",
    'a,0,0,equal\n"b,0,0,equal\nc,0,0,equal\n': (
        f"row 3: found a quote that is never closed, {QUOTES}"
    ),
    'a,"1"2,0,equal\n': f"row 2: found text after a closing quote, {QUOTES}",
    f'"{"x" * 200_000}",0,0,equal\n': (
        "row 2: found a cell of more than 131072 characters (a quote that is never closed?), "
        f"{QUOTES}"
    ),
    '"a\n\nb",0,0,equal\n\n"c\nd",x,0,equal\na,0\n': (
        "row 6, column s1: found 'x', allowed: a finite number\n"
        "row 8: found 2 cells, allowed: 4 cells as in the header"
    ),
    "a,0,0,equal\n ,0,0,equal\n": (
        "row 3, column subject: found '', allowed: a text that is not empty"
    ),
    "a,0,0,NA\nb,0,0,\n": (
        "column response: found no response in any of 2 rows, allowed: at least one answered trial"
    ),
    "a,x,0,equal\n,0,0,equal\na,0,y,maybe\na,0\na,0,0,equal\nb,,z,\n": (
        "row 2, column s1: found 'x', allowed: a finite number\n"
        "row 3, column subject: found '', allowed: a text that is not empty\n"
        f"row 4, column response: found 'maybe', allowed: {ANSWERS}\n"
        "row 4, column s2: found 'y', allowed: a finite number\n"
        "row 5: found 2 cells, allowed: 4 cells as in the header"
    ),
    f"a,{'x' * 5000},0,equal\n": (
        f"row 2, column s1: found '{'x' * 35}...', allowed: a finite number"
    ),
    'a,"\x1b[31m\n",0,equal\n': "row 2, column s1: found '\\x1b[31m', allowed: a finite number",
}


@pytest.mark.parametrize(
    "header, table",
    [("", REFUSED_FILES), (COUNTS, REFUSED_COUNTS), (TRIALS, REFUSED_TRIALS)],
)
def test_a_file_that_cannot_be_used_is_refused(header, table):
    for rows, lines in table.items():
        assert refused(header + rows) == lines.splitlines()


@pytest.mark.parametrize(
    "data, problem",
    [
        (b"\xff\xfe", EMPTY),
        (
            b"PK\x03\x04" + b"[Content_Types].xml\x82",
            f"found a spreadsheet or an archive, {TEXT}; save its sheet as .xlsx or CSV",
        ),
        (
            b"subject,s1,s2,response\n\xc3\xa4,0,0,equal\r\nZo\xeb,0,0,equal\n",
            f"row 3: found byte 0xeb, not UTF-8, {TEXT}",
        ),
        (
            b"\xef\xbb\xbfsubject,s1,s2,response\nZo\xeb,0,0,equal\n",
            f"row 2: found byte 0xeb, not UTF-8, {TEXT}",
        ),
        (
            f"{TRIALS}a,0,0,equal".encode("utf-16")[:-1],
            f"row 2: found byte 0x6c, not UTF-16, {TEXT}",
        ),
        (
            b"subject,s1,s2,response\na\0,0,0,equal\n",
            f"row 2: found the character '\\x00', {TEXT}",
        ),
        (b"\0", f"row 1: found the character '\\x00', {TEXT}"),
        (TRIALS.encode("utf-16-le"), HEADER_ONLY),
    ],
)
def test_bytes_that_are_no_text_are_refused(data, problem):
    assert refused(data) == [problem]


@pytest.mark.parametrize(
    "rows, options, problem",
    [
        (
            "a,1,2,equal",
            {"intensity": 1.0},
            "row 1: there is no column i1 and no column i2. The columns are subject, s1, s2, "
            "response.",
        ),
        (
            "a,0,0,equal",
            {"columns": {"s1": "first", "n_trials": "n"}},
            "row 1: there is no column first and no column n. The columns are subject, s1, s2, "
            "response.",
        ),
        (
            "a,0,0,equal",
            {"columns": {"s1": "s2"}},
            "row 1, column s2: found as s1 and as s2, allowed: one meaning per column",
        ),
        (
            "a,0,0,f\na,0,0,F",
            {"equal_code": "f"},
            "row 3, column response: found 'F', allowed: 'f' (equal) or different (different), "
            f"{OTHER_CODES}",
        ),
        (
            "a,0,0,1",
            {"where": {"task": "x"}},
            "row 1: there is no column task. The columns are subject, s1, s2, response.",
        ),
        (
            "a,0,0,1",
            {"where": {"s1": "7"}},
            "column s1: found '0', allowed: '7', as --where has it, in some row",
        ),
        (
            "a,0,1,1\na,1,0,1",
            {"where": {"s1": "0", "s2": "0"}},
            "found no row that is as --where has it in all of s1, s2",
        ),
    ],
)
def test_trials_that_do_not_fit_the_options_are_refused(rows, options, problem):
    assert refused(TRIALS + rows, **options) == [problem]


def test_a_column_that_chooses_rows_is_there_once():
    problem = "row 1, column kind: found 2 columns of this name, allowed: one"
    assert refused("subject,s1,s2,response,kind,kind\n", where={"kind": "x"}) == [problem]


@pytest.mark.parametrize(
    "n_values, last", [(10, []), (11, ["1 more problem"]), (45, ["35 more problems"])]
)
def test_ten_values_are_told_at_most(n_values, last):
    lines = refused(TRIALS + "".join(f"a,x{i},0,equal\n" * 2 for i in range(n_values)))
    line = "column s1: found 'x{}' in 2 rows, the first is row {}, allowed: a finite number"
    assert lines[:10] == [line.format(i, 2 * i + 2) for i in range(10)]
    assert lines[10:] == [f"... and {text}" for text in last]


def test_unreadable_paths(tmp_path, monkeypatch):
    (tmp_path / "file.txt").write_text("x")
    names = "missing\n.csv", "file.txt/x.csv", "nul\0l.csv", "x" * 300
    for name in names:
        (problem,) = problems(bt.read_study, tmp_path / name)
        assert "cannot be read" in problem
        assert problem.isprintable()

    def forbidden(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", forbidden)
    with pytest.raises(InputError, match=r"study\.csv: cannot be read \(Permission denied\)"):
        bt.read_study((tmp_path / "file.txt").rename(tmp_path / "study.csv"))


# --- Properties -----------------------------------------------------------------------------------

# No bare carriage return: the csv module of Python before 3.13 writes it without quotes, which ends
# a row.
_names = (
    st.text(min_size=1, max_size=8)
    .map(str.strip)
    .filter(lambda name: name != "" and not set("\0\r") & set(name))
)
_numbers = st.floats(-1.5, 1.5).map(lambda value: round(value, 3) + 0.0)
_trials = st.lists(st.tuples(_names, _numbers, _numbers, st.booleans()), min_size=1, max_size=30)


@FUZZ
@given(
    trials=_trials,
    delimiter=st.sampled_from(",;\t|"),
    comma=st.booleans(),
    codec=st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]),
    end=st.sampled_from(["\n", "\r\n"]),
    quoting=st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL]),
)
def test_any_dialect_gives_the_same_study(trials, delimiter, comma, codec, end, quoting):
    text = io.StringIO(newline="")
    writer = csv.writer(text, delimiter=delimiter, lineterminator=end, quoting=quoting)
    writer.writerow(["response", "s2", "extra", "subject", "s1"])
    by_subject = {}
    for name, s1, s2, equal in trials:
        by_subject.setdefault(name, []).append((s1, s2, equal))
        first, second = repr(s1), repr(s2)
        if comma and delimiter != ",":
            first, second = first.replace(".", ","), second.replace(".", ",")
        writer.writerow(["equal" if equal else "different", second, "x;y,z\t", name, first])
    expected = {}
    for name, rows in by_subject.items():
        expected[name] = counts(bt.Subject.from_trials(name, *zip(*rows, strict=True)))
    study = read(text.getvalue().encode(codec))
    assert list(study.names) == list(expected)
    assert list(map(counts, study)) == list(expected.values())


@pytest.mark.parametrize("sign", ["", ".", "e"])
def test_a_hopeless_number_of_many_digits_is_none(sign):
    """A pattern that tries every split of the digits would not end."""
    for digit in "01":
        text = digit * 60_000 + sign + digit * 60_000 + "x"
        assert math.isnan(number(text))
        assert whole_number(text) == -1


def test_options_take_numbers_as_the_cells_of_a_frame_have_them():
    options = bt.ReadOptions(equal_code=1234568, different_code=True, where={"session": 1.0})
    assert (options.equal_code, options.different_code) == ("1234568", "1")
    assert options.where == {"session": "1"}
    with pytest.raises(bt.InputError, match="--intensity: found '1', allowed: a positive"):
        bt.ReadOptions(intensity="1")


PERCENTAGES = "subject,s1,s2,percent,n_trials\n"
AS_COUNTS = {"n_second": "percent"}


def test_only_the_share_that_is_wrong_is_refused():
    rows = "a,0,1,33.3,3\na,1,0,66.7,3\na,0,2,x,3\na,2,0,100,?\na,2,1,0,3\n"
    of_share, of_trials = refused(PERCENTAGES + rows, columns=AS_COUNTS)
    assert of_share.startswith("row 4, column percent: found 'x'")
    assert of_trials.startswith("row 5, column n_trials: found '?'")


def test_shares_with_a_percent_sign_are_percentages():
    study = read(f"{PERCENTAGES}a,0,1,0%,200\na,1,0,0.5%,200\n", columns=AS_COUNTS)
    assert study["a"].n_yes.tolist() == [0, 1]


def test_a_pattern_of_pairs_fits_the_whole_name():
    frame = pd.DataFrame({"subject": ["a"], "100_112_2": ["second"], "112_100_2": ["first"]})
    study = bt.read_study(frame, bt.ReadOptions(wide="{first}_{second}_*", intensity=100.0))
    assert study["a"].s2.tolist() == pytest.approx([np.log(1.12), 0.0])


def test_files_of_one_name_are_told_apart_by_their_folders(tmp_path):
    files = []
    for folder in (tmp_path / "one/x", tmp_path / "two/x"):
        folder.mkdir(parents=True)
        files += written(folder, t=TRIALS + "a,0,1,second\n")
    assert bt.read_study(files)["a"].answers.blocks == ("one/x/t.csv", "two/x/t.csv")
