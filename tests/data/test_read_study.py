"""Reading studies: every dialect gives the same study, every bad input one line per problem."""

import csv
import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from conftest import answers_in_order, each_row, problems, read, refused
from hypothesis import given, settings
from hypothesis import strategies as st

import bayes_toe as bt
from bayes_toe.data.validation import number, whole_number
from bayes_toe.errors import InputError

TRIALS = "subject,s1,s2,response\n"
COUNTS = "subject,s1,s2,n_equal,n_trials\n"
ORDERED = "subject,s1,s2,response,block,trial\n"
FUZZ = settings(max_examples=60, deadline=None, derandomize=True, database=None)


def problem_lines(data, options=""):
    """The problems with which a file is refused, a line each, without the name of the file.

    A line has no character that a terminal would obey.
    """
    lines = problems(read, data, options)
    assert all(map(str.isprintable, lines))
    assert all(line.startswith(("study.csv: ", "... and ")) for line in lines)
    return [line.removeprefix("study.csv: ") for line in lines]


def pairs_as_text(study):
    """Subject, s1, s2, responses 'equal' (or 'second') and trials of each pair, as a text.

    Such as 'a 0.0 0.3 1 1, a 0.3 0.0 0 1'.
    """
    table = study.frame().iloc[:, :5].to_csv(sep=" ", header=False, index=False)
    return ", ".join(table.splitlines())


# --- What is read ---------------------------------------------------------------------------------

#: A study of one response 'equal', as `pairs_as_text` gives it.
EQUAL = "a 0.0 0.0 1 1"

#: Rows of trials, options, and the study as `pairs_as_text` gives it. Subjects are in the order of
#: their first rows.
READ_TRIALS = """
    b,0.1,0.3,equal b,0.1,0.3,different a,0,0,different |  | b 0.1 0.3 1 2, a 0.0 0.0 0 1
    b,0,0, a,0,0,equal b,0,0,equal |  | b 0.0 0.0 1 1, a 0.0 0.0 1 1
    a,-0.0,0,same a,0,-0,different |  | a 0.0 0.0 1 2
    a,+0.25,-0.25,same |  | a 0.25 -0.25 1 1
    a,.25,-.25,same |  | a 0.25 -0.25 1 1
    a,25E-2,-25E-2,same |  | a 0.25 -0.25 1 1
    a,\u22120.3,0,same |  | a -0.3 0.0 1 1
    a,0,0,SAME a,0,0,Different |  | a 0.0 0.0 1 2
    a,0,0,f a,0,0,J | --equal-code f --different-code J | a 0.0 0.0 1 2
    a,0,0,0 a,0,0,1 | --equal-code 0 --different-code 1 | a 0.0 0.0 1 2
    a,0,0,z a,0,0,different a,0,0,Different | --equal-code z | a 0.0 0.0 1 3
    a,0,0,None a,0,0,none a,0,0,different | --equal-code None | a 0.0 0.0 1 2
    a,1,2,equal | --columns s1=s2,s2=s1 | a 2.0 1.0 1 1
    a,0,1,9 a,0,1,7 a,0,1,-1 | --second-code 9 --first-code 7 --missed -1 | a 0.0 1.0 1 2
    a,0,1,9 a,0,1,7 a,0,1,0 | --second-code 9 --first-code 7 --missed 0 | a 0.0 1.0 1 2
    a,0,0.3,1 a,0.3,0,-1 | --second-code 1 | a 0.0 0.3 1 1, a 0.3 0.0 0 1
"""
#: Texts of files, options, and the study as `pairs_as_text` gives it.
READ_FILES = [
    (COUNTS + "a,0,0.3,1,5\na,0.0,0.30,2,6\na,1,1,0,0\na,0,0.3,0,4", "", "a 0.0 0.3 3 15"),
    (COUNTS + f"a,0,0,{10**12},{10**12}", "", "a 0.0 0.0 1000000000000 1000000000000"),
    (COUNTS + "a,0,0,0,5.0\na,0,0,0,+5\na,0,0,0,005", "", "a 0.0 0.0 0 15"),
    # Cells and headers are stripped; blank rows and other columns, also repeated ones, are ignored.
    (' subject , s1,"s2 ",response \n a , 0 ,\t0.5, "equal "\n', "", "a 0.0 0.5 1 1"),
    ('x,subject,s1,,x,s2,response,\n\n1,a,0,,"free, text",0,equal,\n  \n,,,,,,,\n,\n', "", EQUAL),
    ("subject;s1;s2;response;a,b,c,d,e,f,g\na;0;0;equal;y\n", "", EQUAL),
    ("subject,s1,s2,response\ra,0,0,equal\r", "", EQUAL),
    # The next two files have logs and intensities: the option chooses. The reference becomes 0.
    ("subject,s1,s2,i1,i2,response\na,0,0,7,8,equal\n", "", EQUAL),
    ("subject,s1,s2,i1,i2,response\na,7,8,0.087,0.087,equal\n", "--intensity 0.087", EQUAL),
    ("subject;s1;s2;response\na;0;0;1,0\na;0;0;0,0\na;0;0;1\n", "--equal-code 1", "a 0.0 0.0 2 3"),
    ("block,s1,s2,response\na,0,0,equal\n", "--columns subject=block", EQUAL),
]


@each_row("rows, options, expected", READ_TRIALS)
def test_rows_of_trials_are_read(rows, options, expected):
    # The rows stand on one line with spaces between, such as 'a,0,0,equal a,0,0,different'.
    assert pairs_as_text(read(TRIALS + rows.replace(" ", "\n"), options)) == expected


@pytest.mark.parametrize("text, options, expected", READ_FILES)
def test_files_are_read(text, options, expected):
    # Such as a file with other columns and blank rows, or with a decimal comma and semicolons.
    assert pairs_as_text(read(text, options)) == expected


@pytest.mark.parametrize(
    "data, options, notes",
    [
        (
            TRIALS + "a,0,0,1.0\na,0,0,0\n",
            "--equal-code 1",
            """
            trial rows, comma-separated, UTF-8, responses '1' as equal (1) / '0' as different (1),
            stimuli as natural logs
            """,
        ),
        (
            TRIALS + "a,0,1,5\na,1,0,3\na,1,0,0\n",
            "--second-code 5 --first-code 3 --missed 0",
            """
            trial rows, comma-separated, UTF-8, responses '5' as second (1) / '3' as first (1),
            stimuli as natural logs
            1 trial without a response dropped ('0' in column response): a 1
            """,
        ),
        (
            COUNTS + "a,0,0.3,1,5\nb,0,0,3,3\na,0.0,0.30,2,6\na,1,1,0,0\na,0,0.3,0,4\n",
            "",
            """
            grouped rows, comma-separated, UTF-8, 18 trials, 6 'equal', 12 'different',
            stimuli as natural logs
            1 row with n_trials = 0 left out
            2 repeated rows merged: a 2
            """,
        ),
        (
            "subject,s1,s2,k,n\na,0,0,1,2\na,0,0,1,2\n",
            "--columns n_equal=k,n_trials=n",
            """
            grouped rows, comma-separated, UTF-8, 4 trials, 2 'equal', 2 'different',
            stimuli as natural logs
            column k read as n_equal
            column n read as n_trials
            1 repeated row merged: a 1
            """,
        ),
        (
            "subject,first,i2,response\na,0.087,0.174,f\n",
            "--intensity 0.087 --equal-code f --columns i1=first",
            """
            trial rows, comma-separated, UTF-8, responses 'f' as equal (1) / 'different' (0)
            column first read as i1, intensity in units of 0.087
            column i2 read as intensity in units of 0.087
            """,
        ),
        (
            "subject;s1;s2;response;task\na;0,5;0;same;x\na;0,5;0;same;x\nb;x;;;y\n",
            "--where task=x",
            """
            trial rows, semicolon-separated, UTF-8, decimal comma,
            responses 'same' as equal (2) / 'different' (0), stimuli as natural logs
            only rows with x in column task
            """,
        ),
    ],
)
def test_notes_say_what_was_detected_and_merged(data, options, notes):
    # All notes are compared as one text, in which line ends are spaces.
    assert " ".join(read(data, options).notes) == " ".join(notes.split())


@pytest.mark.parametrize("text", ["", " ", "NA", "na", "N/A", "n/a", "NaN", "nan", "None"])
def test_rows_without_a_response_are_dropped_and_counted(text):
    # One row has a response, three rows lack a response, and one row has neither stimuli nor a
    # response.
    study = read(f"{TRIALS}a,0,0,equal\na,,x1,{text}\nb,0,0,{text}\n,,,{text}\na,0,0,{text}\n")
    assert pairs_as_text(study) == EQUAL
    notes = (
        "1 row without stimuli and response left out",
        "3 rows without a response dropped: a 2, b 1",
        "1 subject without any response left out: b",
    )
    # The first note of the study is on the format. If `text` is blank, the row ',,,' is blank, too,
    # and the first of the three notes is missing.
    assert study.notes[1:] == notes[not text.strip() :]


def test_subject_names_stay_as_they_are():
    # Names that look like numbers, missing values or signs, and names with quotes or a line end.
    text = "01|1|1.0|NA|nan|None|Zoë|被験者 一|🙂|a\u200bb|O'Neil|true|1e5|-"
    names = text.split("|")
    assert read(TRIALS + "".join(f"{name},0,0,equal\n" for name in names)).names == tuple(names)
    assert read(f'{TRIALS}"a ""x"", b",0,0,equal\n"c\nd",0,0,equal\n').names == ('a "x", b', "c\nd")


#: Values of a column `synthetic`, whether the study is synthetic, and whether the notes say why.
SYNTHETIC = """
    1 1 | True | True
    true YES | True | True
    1 0 | False | True
    NA NA | False | False
    1 NA | False | True
"""


@each_row("marks, is_synthetic, has_note", SYNTHETIC)
def test_a_column_marks_synthetic_data(marks, is_synthetic, has_note):
    # The cells of two rows, such as '1 0': then the study is not synthetic, and a note says why.
    rows = "a,0,0,equal,{}\na,0,0,equal,{}\n".format(*marks.replace("NA", "").split(" "))
    study = read("subject,s1,s2,response,synthetic\n" + rows)
    assert str(study.synthetic) == is_synthetic
    assert str("synthetic" in " ".join(study.notes)) == has_note


#: Two amplitudes, options, and the amplitudes in units of the reference.
AMPLITUDES = """
    0.0435 0.174 | --intensity 0.087 | 0.5 2
    0.850 1.050 | --intensity 1 | 0.85 1.05
    850 1.050 | --intensity 1000 --decimal , | 0.85 1.05
    850 1.050 | --intensity 1 --decimal . | 850 1.05
    850 1,050 | --intensity 1000 --decimal . | 0.85 1.05
    850 1,050 | --intensity 1 --decimal , | 850 1.05
    1'360 1\u202f500 | --intensity 1 | 1360 1500
"""
IN_AMPLITUDES = "sep=;\nsubject;i1;i2;response\na;{0};{1};second\na;{1};{0};first\n"


@each_row("amplitudes, options, expected", AMPLITUDES)
def test_amplitudes_become_log_intensities(amplitudes, options, expected):
    # Such as '850 1,050' with --intensity 1000 --decimal . , whose comma groups thousands: .85 and
    # 1.05 of the reference. s1 is their natural log.
    (subject,) = read(IN_AMPLITUDES.format(*amplitudes.split(" ")), options)
    first, second = map(float, expected.split())
    stimuli = set(np.exp(subject.s1))
    assert sorted(stimuli) == pytest.approx(sorted([first, second]), rel=1e-14)


def test_amplitudes_do_not_overflow():
    (subject,) = read(IN_AMPLITUDES.format("1e308", "1e-308"), "--intensity 1e-300")
    # Relative to 1e-300, 1e-308 is 1e-8, and 1e308 is 1e608, which no float holds.
    assert subject.s1 == pytest.approx(np.array([-8, 608]) * math.log(10))


@pytest.mark.parametrize("sign, other_sign, delimiter", [(".", ",", ";"), (",", ".", "\t")])
def test_a_sign_that_may_group_thousands_is_asked_for(sign, other_sign, delimiter):
    # The amplitude 1.050 beside 850: its sign rather groups thousands.
    text = IN_AMPLITUDES.format(850, f"1{sign}050").replace(";", delimiter)
    with refused(r"can be 1050 or 1\.050"):
        read(text, "--intensity 1000")
    remedies = [f"--decimal {other_sign}", f"--decimal {sign}"]
    assert typed_remedies(text, "--intensity 1000") == remedies


def test_natural_logs_are_never_thousands():
    logs = "subject;s1;s2;response\na;99;2.125;second\na;2.125;99;first\n"
    assert read(logs, "--unit ln")["a"].s1.tolist() == [2.125, 99.0]
    # -100 is too large in size for a log, so 2.125 may have thousands in spite of the unit.
    assert typed_remedies(logs.replace("99", "-100"), "--unit ln") == ["--decimal ,", "--decimal ."]


# --- Answers in their order -----------------------------------------------------------------------


def test_blocks_and_trials_are_kept_in_order_beside_the_counts():
    # The columns are those of ORDERED: subject, s1, s2, response, block, trial.
    rows = "a,0,1,1,10,2\nb,0,0,1,x,7\na,0,0,0,9,1\na,0,0,NA,9,2\na,0,0,1,10,1\n"
    study = read(ORDERED + rows, "--equal-code 1")
    assert pairs_as_text(study) == "a 0.0 0.0 1 2, a 0.0 1.0 1 1, b 0.0 0.0 1 1"
    # The block x is no number, so the blocks are in order of appearance. A trial without an answer
    # stays in the order, because it was presented, too. Each text has the block, * where a session
    # begins, s1, s2, and 'equal'/trials.
    assert answers_in_order(study["a"]) == [
        "block 10* 0.0 0.0 1/1",
        "block 10 0.0 1.0 1/1",
        "block 9* 0.0 0.0 0/1",
        "block 9 0.0 0.0 0/0",
    ]
    assert study["a"].answers.has_trial_rows
    assert study.reading.ignored == ()

    # Blocks that are numbers are sorted as numbers.
    (numbered,) = read(ORDERED + rows.replace("b,0,0,1,x,7\n", ""), "--equal-code 1")
    assert numbered.answers.blocks == ("9", "10")


def test_sessions_tell_the_order_and_where_memory_begins_anew():
    # The columns are subject, s1, s2, response, session, block and trial. Session 2 stands first in
    # the file, and session 1 has blocks 1 and 2, of whose trials number 2 is missing.
    header = "subject,s1,s2,response,session,block,trial\n"
    rows = "a,0,0,1,2,1,1\na,0,1,1,1,1,1\na,0,1,0,1,2,1\na,1,1,1,1,2,3\n"
    study = read(header + rows, "--equal-code 1")
    # A session begins at *, where the memory of earlier trials ends.
    assert answers_in_order(study["a"]) == [
        "block 1* 0.0 1.0 1/1",
        "block 2 0.0 1.0 0/1",
        "block 2 1.0 1.0 1/1",
        "block 1* 0.0 0.0 1/1",
    ]
    # Without its block 2, each session has one trial.
    assert answers_in_order(study.exclude("a", "2")["a"]) == [
        "block 1* 0.0 1.0 1/1",
        "block 1* 0.0 0.0 1/1",
    ]
    # Counts that are changed by hand do not fit the answers, whose order is then lost.
    assert replace(study["a"], n_yes=[0, 0, 0]).answers is None


def test_trials_that_tell_no_order_leave_the_order_of_the_file_and_are_noted():
    # The columns are subject, s1, s2, response, block and trial. In block 1, a has the trial number
    # 1 twice, and the trial number of b is x.
    rows = "a,0,1,1,1,1\na,0,0,0,1,1\nb,0,0,0,1,x\nc,0,0,0,1,1\n"
    study = read(ORDERED + rows, "--equal-code 1")
    # The first note is about the format of the file.
    assert study.notes[1:] == (
        "column trial does not order all trials, so the order of the file is used for a, b. If its "
        "numbers begin anew, two persons or sessions may be pooled: --columns subject=NAME or "
        "session=NAME keeps them apart, or --where one of them",
    )
    assert study["a"].answers.n_yes.tolist() == [1, 0]  # 'equal' and 'different', as in the file


#: Trials with numbers in the columns of ORDERED, and a trial without a column of blocks.
NUMBERED = ORDERED + "a,0,1,1,1,1\na,0,0,0,1,2\nb,0,0,0,1,1\n"
WITHOUT_BLOCKS = "subject,s1,s2,response,trial\na,0,1,1,1\n"


@pytest.mark.parametrize(
    "text, expected",
    [
        (
            NUMBERED + "b,0,1,NA,1,1\na,0,0,0,1,2\nb,0,0,0,1,1\n",
            "2 rows with the trial number and all cells of an earlier row, first row 6 (",
        ),
        (WITHOUT_BLOCKS + "a,0,1,1,1\n", "1 row with the trial number and all cells"),
        (NUMBERED, ""),
        (NUMBERED + "b,0,0,1,1,1\n", ""),
        (NUMBERED + "a,0,0,0,1,x\na,0,0,0,1,x\n", ""),
        (WITHOUT_BLOCKS + "a,0,0,1,1\n", ""),
        (TRIALS + "a,0,1,1\na,0,1,1\n", ""),
    ],
    ids=[
        "two repeated rows",
        "one repeated row",
        "no repeated row",
        "another response",
        "no number",
        "another pair",
        "no column trial",
    ],
)
def test_rows_that_repeat_an_earlier_trial_are_doubted(text, expected):
    # A row repeats an earlier row if it has the same block, trial number, pair and response.
    # Otherwise there is no doubt, and `expected` is empty.
    doubts = read(text, "--equal-code 1").reading.doubts
    assert len(doubts) == bool(expected)
    assert expected in "".join(doubts)


def test_counts_have_answers_where_they_have_blocks():
    # Run is the column of blocks; without blocks the order of answers is not known.
    text = "subject,s1,s2,n_equal,n_trials,Run\na,0,1,1,5,1\na,0,1,2,5,2\n"
    study = read(text, "--columns block=Run")
    assert pairs_as_text(study) == "a 0.0 1.0 3 10"
    # Each block is a session (*), with its number of 'equal' and of trials.
    assert answers_in_order(study["a"]) == ["block 1* 0.0 1.0 1/5", "block 2* 0.0 1.0 2/5"]
    assert not study["a"].answers.has_trial_rows
    assert read(COUNTS + "a,0,1,1,5\n")["a"].answers is None


def test_columns_that_nobody_reads_are_told_by_name():
    # The header has a column without a name, which is not listed, and rt twice, which is listed
    # once.
    reading = read("rt,subject,s1,s2,i1,,response,rt,Notes\n1,a,0,1,5,,same,2,3\n").reading
    assert reading.ignored == ("rt", "i1", "Notes")
    assert reading.read == ("subject", "s1", "s2", "response")
    # Two columns have the name block. Nobody knows which column is meant, so neither is read.
    study = read("subject,s1,s2,response,block,block\na,0,1,same,1,2\n")
    assert study.reading.ignored == ("block",)


# --- Several files --------------------------------------------------------------------------------


def write_files(folder, **texts):
    """Write a CSV file for each name and text, and return their paths."""
    for name, text in texts.items():
        (folder / f"{name}.csv").write_text(text)
    return [folder / f"{name}.csv" for name in texts]


def test_subjects_with_the_same_trials_are_told(tmp_path):
    # Both subjects of two.csv, a and b, have the trials of a in first.csv. The subjects c and d of
    # easy.csv have the same trials, too, but all answers are 'same'. Two subjects may both give
    # such answers to an easy pair, so these are not doubted.
    text = TRIALS + "a,0,0.3,same\na,0,0.3,different\n" * 12
    easy = "c,0,0.3,same\n" * 40
    files = write_files(
        tmp_path,
        first=text,
        two=text + text.replace(TRIALS, "").replace("a,", "b,"),
        easy=TRIALS + easy + easy.replace("c", "d"),
    )
    finding = " has the same trials and answers as first.csv: subject a: repeated trials make"
    doubts = [doubt.partition(finding)[0] for doubt in bt.read_study(files).reading.doubts]
    assert doubts == ["two.csv: subject a", "two.csv: subject b"]
    assert bt.read_study(files[1]).reading.doubts


def test_of_several_files_the_first_problems_are_told(tmp_path):
    # The file a has twelve problems, more than are listed, and a sound row. The files b and c share
    # a problem in three rows, and d has another problem.
    three_rows, single_row = TRIALS + "a,x,0,equal\n" * 3, TRIALS + "a,y,0,equal\n"
    twelve_rows = TRIALS + "".join(f"a,x{letter},0,equal\n" for letter in "abcdefghijkl")
    twelve_rows += "a,0,0,equal\n"
    files = write_files(tmp_path, a=twelve_rows, b=three_rows, c=three_rows, d=single_row)
    assert problems(bt.read_study, files)[-1] == "... and more problems"
    assert problems(bt.read_study, files[1:]) == [
        "2 files, such as b.csv: column s1: found 'x' in 3 rows, the first is row 2, allowed: a "
        "finite number",
        "d.csv: row 2, column s1: found 'y', allowed: a finite number",
    ]


# --- Options --------------------------------------------------------------------------------------


def test_options_are_refused_all_at_once():
    # Three options are wrong, and each has a line.
    lines = problems(bt.ReadOptions, intensity=-1, equal_code="", columns={"x": "y"})
    options = [line.partition(":")[0] for line in lines]
    assert options == ["--equal-code", "--intensity", "--columns"]
    (problem,) = problems(bt.ReadOptions, missed=None)
    assert problem == "missed: found NoneType, allowed: a text, or several in a list"


# --- Files of other labs; tests/data/test_shapes.py has more of them ------------------------------


def typed_remedies(data, options=""):
    """The options that a refusal of a file proposes to type, such as ['--second-code z']."""
    with pytest.raises(InputError) as caught:
        read(data, options)
    return [remedy.typed for remedy in caught.value.remedies]


def test_an_empty_column_of_responses_asks_for_another_one():
    # The column response is empty, and the responses are in the column judgement.
    rows = "subject,s1,s2,response,judgement\na,0,0.3,,second\na,0.3,0,,first\n"
    assert typed_remedies(rows) == ["--columns response=NAME"]
    study = read(rows, "--columns response=judgement")
    assert pairs_as_text(study) == "a 0.0 0.3 1 1, a 0.3 0.0 0 1"


#: Rows of trials, options, and the beginning of the list of proposed options.
REMEDIES = """
    a,0,0.3,z a,0.3,0,m a,0,0.3,z a,0.3,0,m a,0,0.3,m |  | --second-code z, --second-code m
    a,0,1,9 a,1,0,7 a,0,1,0 a,1,0,0 | --first-code 7 --second-code 9 | --equal-code 0
    a,0,1,1 a,1,0,-1 a,1,0,0 | --second-code 1 | --equal-code 0, --first-code -1
    a,0,1,first a,1,0,second | --intensity 2 | --columns i1=NAME,i2=NAME
    a,2,1,first a,1,2,second | --intensity 2 | --columns i1=s1,i2=s2
"""


@each_row("rows, options, expected", REMEDIES)
def test_codes_and_columns_that_are_not_known_are_asked_for(rows, options, expected):
    """The code of 'second' is the code that is more frequent if the second stimulus is stronger.

    In the rows 'a,0,0.3,z a,0.3,0,m', for example, the code of 'second' is z. A column that has the
    number 0 has no intensities, so other columns are asked for.
    """
    remedies = typed_remedies(TRIALS + rows.replace(" ", "\n"), options)
    assert ", ".join(remedies).startswith(expected)


#: A column beside `correct`, its cell in a missed trial, and its cells in two answered trials, one
#: in each order.
SIGNS = """
    key | -1 | j l
    key | -99 | j l
    key | -999 | j l
    key | 0 | j l
    key | [] | j l
    key | timeout | j l
    key | no response | j l
    rt | -1 | .6 .7
    rt | -1.0 | .6 .7
    rt | 0 | .6 .7
    rt | 999 | .6 .7
    rt | inf | .6 .7
    rt | None | .6 .7
    rt | NA | .6 .7
    key_resp_2.rt | 9999 | 743 820
    key_resp_2.rt | -1 | 743 820
    key_resp_2.rt |  | 743 820
    timed_out | 1 | 0 0
    timeout | 1 | 0 0
    missed | 1 | 0 0
    noResponse | 1 | 0 0
    too_late | 1 | 0 0
    Timed out | yes | no no
"""
#: Columns as in SIGNS, with cells that an answered trial may have, too.
NO_SIGNS = """
    key | 0 | 1 1
    rt | 999 | 1400 1500
    rt | 3000 | 2999 2998
    start | 0 | 7 8
    timeout | 3000 | 0 0
"""


def scored_trials(column, missed, answered, scores="00"):
    """A text of eight answered trials, scored 1 or 0, and two more for each of `scores`.

    In the column, which may be a key or a time, the trials for `scores` have the cell `missed`, and
    the answered trials have the two cells in `answered` by turns.
    """
    rows = "a,0,0.3,{0},{1}\na,0.3,0,{0},{2}\n"
    text = f"subject,s1,s2,correct,{column}\n"
    for score in "1101":
        text += rows.format(score, *answered.split())
    for score in scores:
        text += rows.format(score, missed, missed)
    return text


@each_row("column, missed, answered", SIGNS)
def test_a_missed_trial_is_shown_by_any_usual_sign(column, missed, answered):
    # Such as 0 in the column key, whose other cells are j and l. Beside the eight answered trials,
    # four have this sign and the score 0 (wrong): they were missed.
    study = read(scored_trials(column, missed, answered), "--correct correct")
    assert study["a"].total_trials == 8
    cell = repr(missed) if missed else "empty"
    assert f"4 trials without a response dropped ({cell} in column {column}): a 4" in study.notes
    # Trials that are scored right have a response, whatever the sign says.
    study = read(scored_trials(column, missed, answered, scores="11"), "--correct correct")
    assert study["a"].total_trials == 8 + 4


@each_row("column, missed, answered", NO_SIGNS)
def test_other_cells_beside_wrong_responses_show_no_missed_trial(column, missed, answered):
    # Such as a key 0 beside keys 1, or a time of 3000 beside 2999: they may be responses. Two
    # trials have this cell.
    study = read(scored_trials(column, missed, answered, scores="0"), "--correct correct")
    assert study["a"].total_trials == 8 + 2


def test_several_codes_of_missed_trials_may_be_declared():
    """Four trials have the code x, beside four with j and four with l."""
    (subject,) = read(scored_trials("key", "x", "j l"), "--correct correct --missed j --missed x")
    assert subject.total_trials == 4


STANDARDS = """subject,standard,comparison,interval,response
a,0,0.3,1,comparison
a,0,0.3,2,comparison
a,0,0.3,1,standard
a,0,-0.3,2,standard
"""


# --- Refusals -------------------------------------------------------------------------------------

OTHER_CODES = "or empty; other codes by --equal-code, --different-code"
ANSWERS = f"equal, same (equal) or different (different), {OTHER_CODES}"
OPEN_QUOTE = (
    "found a quote that is never closed, or text after it, allowed: quotes around whole cells, "
    "doubled inside"
)
TEXT = (
    "allowed: text in UTF-8 or UTF-16, or the encoding that --encoding names, such as shift_jis, "
    "gb18030, euc_kr, cp1251, cp1254 or mac_roman"
)
EMPTY = "found an empty file, allowed: a header and at least one row"
HEADER_ONLY = "row 1: found no row below it, allowed: at least one row"
ALONE = (
    "allowed: responses (one row per trial), counts of one response (one row per pair), or "
    "n_first, n_equal and n_second"
)

#: Rules for the text of a cell, by name.
RULES = {
    "number": "a finite number",
    "ungrouped": "a finite number, with a decimal point and no thousands separators",
    "range": "0, or natural logs from 1e-99 to 1e100 in size",
    "positive": "a positive finite number",
    "count": "a whole number from 0 to 10^12, without thousands separators",
    "answer": ANSWERS,
    "code": f"'f' (equal) or 'J' (different), {OTHER_CODES}",
}
#: Header and rows with {} in the place of a cell of row 2, options, the column of the cell, the
#: rule, and texts of the cell between bars.
CELLS = """
    subject,s1,s2,response a,{},0,same |  | s1 | number | abc|nan|-inf|1e999|1_0|0x1||1 2|٣
    subject,s1,s2,response a,{},0,same |  | s1 | number | \u2212\u22121
    subject;s1;s2;response a;{};0;same |  | s1 | ungrouped | 1.234,5|1,234.5|1,2,3
    subject;s1;s2;response a;{};0;same |  | s1 | number | 1 00|1'000'0|1.2.3
    subject,s1,s2,response a,{},0,same | --unit ln | s1 | range | 1e101|-1e300|1e-100
    subject,i1,i2,response a,1,{},same | --intensity 2 | i2 | positive | 0|-0.1|1e-999|nan|inf|x|
    subject,s1,s2,n_equal,n_trials a,0,0,"{}",9 |  | n_equal | count | -1|2.5||inf|1000000000001|1,5
    subject,s1,s2,n_equal,n_trials a,0,0,{},9 |  | n_equal | count | ٣
    subject,s1,s2,n_equal,n_trials a,0,0,{},9 |  | n_equal | count | 1e3|5.000
    subject;s1;s2;n_equal;n_trials a;0;0;5;{} |  | n_trials | count | 12.000
    subject,s1,s2,response a,0,0,{} a,0,0,equal |  | response | answer | 2|0.5|true|equal.|1e0
    subject,s1,s2,response a,0,0,{} a,0,0,equal |  | response | answer | same different
    subject,s1,s2,response a,0,0,{} | --equal-code f --different-code J | response | code | F|j|1
    subject,s1,s2,response a,0,0,{} | --equal-code f --different-code J | response | code | equal
    who,s1,first,s2,response a,9,{},1,same | --columns subject=who,s1=first | first | number | x
"""


@each_row("text, options, column, rule, cells", CELLS)
def test_a_cell_that_cannot_be_used_is_refused(text, options, column, rule, cells):
    # Each cell, such as those of 'abc|nan|-inf', takes the place of {} in the text, whose spaces
    # are line ends. The rule is a key of RULES.
    for cell in cells.split("|"):
        expected = f"row 2, column {column}: found {cell!r}, allowed: {RULES[rule]}"
        assert problem_lines(text.replace(" ", "\n").format(cell), options) == [expected]


#: Whole files and their problems, a line each.
REFUSED_FILES = {
    "id,x,response\na,0,equal\n": (
        "row 1: there is no column subject, no column s1 and no column s2. The columns are id, x, "
        "response."
    ),
    "participant,observer,s1,s2,response\na,b,0,0.3,second\n": (
        "row 1: there is no column subject. The columns are participant, observer, s1, s2, "
        "response."
    ),
    "subject,s1,s2,n_equal\na,0,1,5\n": (
        "row 1: there is no column n_trials. The columns are subject, s1, s2, n_equal."
    ),
    "subject,s1,s2,n_trials\na,0,1,5\n": (
        "row 1: there is no column n_equal or n_second. The columns are subject, s1, s2, n_trials. "
        "--columns n_second=NAME names the column that counts 'second'; in the same way, name "
        "n_first, n_equal, n_different or, of right answers in 2AFC, n_correct."
    ),
    "subject,i1,i2,response\na,1,2,equal\n": "columns i1 and i2 may be intensities.",
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
    "subject,s1,s2,n_first,n_equal,n_second\na,0\n": (
        "row 2: found 2 cells, allowed: 6 cells as in the header"
    ),
    "": EMPTY,
    "\ufeff": EMPTY,
    TRIALS: HEADER_ONLY,
    COUNTS: HEADER_ONLY,
    f'"{TRIALS}a,0,0,equal\n': f"row 1: {OPEN_QUOTE}",
    f"\n \n{TRIALS}\na,0,x,equal\n": "row 5, column s2: found 'x', allowed: a finite number",
}
#: Rows below the header of counts, and the problems of the file.
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
#: Rows below the header of trials, and the problems of the file.
REFUSED_TRIALS = {
    "a,0,0,equal\na,0,0\na,0,0,equal\n": (
        "row 3: found 3 cells, allowed: 4 cells as in the header"
    ),
    "a,0,0,equal,x\n": (
        "row 2: found 5 cells below 4 names, allowed: a name for each column. Between commas, a "
        "number with a decimal comma needs quotation marks"
    ),
    'a,0,0,equal\n"b,0,0,equal\nc,0,0,equal\n': f"row 3: {OPEN_QUOTE}",
    'a,"1"2,0,equal\n': f"row 2: {OPEN_QUOTE}",
    f'"{"x" * 200_000}",0,0,equal\n': f"row 2: {OPEN_QUOTE}",
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
        f"row 2, column s1: found '{'x' * 17}...{'x' * 18}', allowed: a finite number"
    ),
    'a,"\x1b[31m\n",0,equal\n': "row 2, column s1: found '\\x1b[31m', allowed: a finite number",
}


@pytest.mark.parametrize(
    "header, table",
    [("", REFUSED_FILES), (COUNTS, REFUSED_COUNTS), (TRIALS, REFUSED_TRIALS)],
)
def test_a_file_that_cannot_be_used_is_refused(header, table):
    # `table` has rows, and the problems of a file with this header and these rows, a line for each.
    for rows, lines in table.items():
        assert problem_lines(header + rows) == lines.splitlines()


@pytest.mark.parametrize(
    "data, problem",
    [
        (b"\xff\xfe", EMPTY),
        (
            b"PK\x03\x04" + b"[Content_Types].xml\x82",
            "found a spreadsheet or an archive, allowed: its sheet saved as .xlsx or CSV",
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
    # Such as a letter of Windows-1252, 0xeb, in a file that is UTF-8 elsewhere.
    assert problem_lines(data) == [problem]


@pytest.mark.parametrize(
    "text, options, problem",
    [
        (
            TRIALS + "a,1,2,equal",
            "--intensity 1",
            "row 1: there is no column i1 and no column i2. The columns are subject, s1, s2, "
            "response.",
        ),
        (
            TRIALS + "a,0,0,equal",
            "--columns s1=first,n_trials=n",
            "row 1: there is no column first and no column n. The columns are subject, s1, s2, "
            "response.",
        ),
        (
            TRIALS + "a,0,0,equal",
            "--columns s1=s2",
            "row 1, column s2: found as s1 and as s2, allowed: one meaning per column",
        ),
        (
            TRIALS + "a,0,0,f\na,0,0,F",
            "--equal-code f",
            "row 3, column response: found 'F', allowed: 'f' (equal) or different (different), "
            f"{OTHER_CODES}",
        ),
        (
            TRIALS + "a,0,0,1",
            "--where task=x",
            "row 1: there is no column task. The columns are subject, s1, s2, response.",
        ),
        (
            TRIALS + "a,0,0,1",
            "--where s1=7",
            "column s1: found '0', allowed: '7', as --where has it, in some row",
        ),
        (
            TRIALS + "a,0,1,1\na,1,0,1",
            "--where s1=0,s2=0",
            "column s2: found '1', allowed: '0', as --where has it, in some row",
        ),
        (
            "subject,s1,s2,response,kind,kind\n",
            "--where kind=x",
            "row 1, column kind: found 2 columns of this name, allowed: one",
        ),
        (
            STANDARDS.replace("a,0,0.3,1", "a,x,0.3,1", 1),
            "--standard-interval interval",
            "row 2, column standard: found 'x', allowed: a finite number",
        ),
        (
            STANDARDS.replace("comparison", "weight", 1),
            "--standard-interval interval",
            "row 1: there is no column comparison. The columns are subject, standard, weight, "
            "interval, response.",
        ),
    ],
)
def test_files_that_do_not_fit_the_options_are_refused(text, options, problem):
    # Such as a file with s1 and s2, and --intensity, which needs i1 and i2.
    assert problem_lines(text, options) == [problem]


@pytest.mark.parametrize(
    "n_values, n_lines, last_line",
    [
        (10, 10, "column s1: found 'x9' in 2 rows, the first is row 20, allowed: a finite number"),
        (11, 11, "... and 1 more problem"),
        (45, 11, "... and 35 more problems"),
    ],
)
def test_ten_values_are_told_at_most(n_values, n_lines, last_line):
    # Each of the values x0, x1, ... is in two rows, and is one problem. A last row is sound.
    rows = "".join(f"a,x{i},0,equal\n" * 2 for i in range(n_values))
    lines = problem_lines(TRIALS + rows + "a,0,0,equal\n")
    assert len(lines) == n_lines
    assert lines[-1] == last_line


@pytest.mark.parametrize("name", ["missing\n.csv", "file.txt/x.csv", "nul\0l.csv", "x" * 300])
def test_a_path_that_cannot_be_read_is_refused_in_one_line(name, tmp_path):
    # A file that is missing, a path below a file that is no folder, a name that no system allows,
    # and a name that is too long.
    (tmp_path / "file.txt").write_text("x")
    (problem,) = problems(bt.read_study, tmp_path / name)
    assert "cannot be read" in problem
    assert problem.isprintable()


# --- Properties -----------------------------------------------------------------------------------

# No bare carriage return: the csv module of Python before 3.13 writes it without quotes, which ends
# a row.
_names = st.from_regex(r"[^\0\r\s]([^\0\r]{0,6}[^\0\r\s])?", fullmatch=True)
_numbers = st.floats(-1.5, 1.5).map(lambda value: round(value, 3) + 0.0)
_responses = st.sampled_from(["equal", "different"])
_trials = st.lists(st.tuples(_names, _numbers, _numbers, _responses), min_size=1, max_size=30)


@FUZZ
@given(
    trials=_trials,
    delimiter=st.sampled_from(",;\t|"),
    decimal=st.sampled_from(".,"),
    codec=st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]),
    end=st.sampled_from(["\n", "\r\n"]),
    quoting=st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL]),
)
def test_any_dialect_gives_the_same_study(trials, delimiter, decimal, codec, end, quoting):
    # The trials are written with other delimiters, decimal signs, encodings, line ends and quotes,
    # and with a column that nobody reads.
    frame = pd.DataFrame(trials, columns=["subject", "s1", "s2", "response"])
    if delimiter == ",":
        decimal = "."
    reordered_frame = frame.assign(extra="x;y,z\t")[["response", "s2", "extra", "subject", "s1"]]
    text = reordered_frame.to_csv(
        index=False, sep=delimiter, decimal=decimal, lineterminator=end, quoting=quoting
    )
    assert read(text.encode(codec)).frame().equals(bt.read_study(frame).frame())


@pytest.mark.parametrize("sign", ["", ".", "e"])
def test_a_text_of_many_digits_that_is_no_number_is_refused_quickly(sign):
    """A regular expression that tries every split of 120,000 digits would not end."""
    for digit in "01":
        text = digit * 60_000 + sign + digit * 60_000 + "x"
        assert math.isnan(number(text))
        assert whole_number(text) == -1  # the value for texts that are no whole number


def test_options_take_numbers_as_the_cells_of_a_frame_have_them():
    # A whole number, a truth value and a float become the same texts as in a cell of a data frame.
    # The whole number has seven digits, because the format %g would round it to six.
    options = bt.ReadOptions(equal_code=1234568, different_code=True, where={"session": 1.0})
    assert options.equal_code == "1234568"
    assert options.different_code == "1"
    assert options.where == {"session": "1"}


def test_an_intensity_is_no_text():
    with refused("--intensity: found '1', allowed: a positive"):
        bt.ReadOptions(intensity="1")


PERCENTAGES = "subject,s1,s2,percent,n_trials\n"


def test_only_the_share_that_is_wrong_is_refused():
    # 33.3 % of 3 trials is 1, and 66.7 % is 2. Row 4 has no share, and row 5 no number of trials.
    rows = "a,0,1,33.3,3\na,1,0,66.7,3\na,0,2,x,3\na,2,0,100,?\na,2,1,0,3\n"
    share_problem, trials_problem = problem_lines(PERCENTAGES + rows, "--columns n_second=percent")
    assert share_problem.startswith("row 4, column percent: found 'x'")
    assert trials_problem.startswith("row 5, column n_trials: found '?'")


def test_shares_with_a_percent_sign_are_percentages():
    # 0.5 % of 200 trials is one trial. As a share, 0.5 would be 100.
    rows = "a,0,1,0%,200\na,1,0,0.5%,200\n"
    study = read(PERCENTAGES + rows, "--columns n_second=percent")
    assert pairs_as_text(study) == "a 0.0 1.0 0 200, a 1.0 0.0 1 200"


def test_a_pattern_of_pairs_fits_the_whole_name():
    # The names are 1_1.5_2 and 1.5_1_2: a pair, and a number of the presentation that * stands for.
    study = read("subject,1_1.5_2,1.5_1_2\na,second,first\n", "--wide {first}_{second}_* --unit g")
    assert np.exp(study["a"].s2) == pytest.approx([1.5, 1.0])


def test_files_of_one_name_are_told_apart_by_their_folders(tmp_path):
    # Both files are x/t.csv, in the folders one and two.
    files = []
    for folder in (tmp_path / "one/x", tmp_path / "two/x"):
        folder.mkdir(parents=True)
        files += write_files(folder, t=TRIALS + "a,0,1,second\n")
    assert bt.read_study(files)["a"].answers.blocks == ("one/x/t.csv", "two/x/t.csv")
