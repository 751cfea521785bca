"""Reading studies: every dialect gives the same study, every bad input one line per problem."""

import csv
import io
import math
import re
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayes_toe.data.options import ReadOptions, parse_columns
from bayes_toe.data.read_study import read_study
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tasks import WHICH_STRONGER
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
        return read_study(path, ReadOptions(**options))


def words(rows):
    """Rows whose fourth cell is 1 or 0, with words in its place."""
    return re.sub(
        r"^((?:[^,]*,){3})([01])(?=,|$)",
        lambda row: row[1] + ("different", "equal")[int(row[2])],
        rows,
        flags=re.MULTILINE,
    )


def refused(data, **options):
    with pytest.raises(InputError) as caught:
        read(data, **options)
    problems = caught.value.problems
    assert all(problem.isprintable() for problem in problems), (
        "one line per problem, and nothing that a terminal would obey"
    )
    lines = str(caught.value).splitlines()
    assert lines[: len(problems)] == list(problems)
    remedies = [f"use {remedy.python} {remedy.meaning}" for remedy in caught.value.remedies]
    assert lines[len(problems) :] == remedies
    assert all(problem.startswith(("study.csv: ", "... and ")) for problem in problems)
    return [problem.removeprefix("study.csv: ") for problem in problems]


def content(study):
    return {
        subject.name: list(
            zip(
                subject.s1.tolist(),
                subject.s2.tolist(),
                subject.n_yes.tolist(),
                subject.n_trials.tolist(),
                strict=True,
            )
        )
        for subject in study
    }


# --- What is read ---------------------------------------------------------------------------------

AMPLITUDES = "subject,i1,i2,response\n"
ONE = {"a": [(0.0, 0.0, 1, 1)]}


@pytest.mark.parametrize(
    ("data", "options", "expected"),
    [
        # Grouped by subject and ordered pair; subjects in order of first appearance, also in rows
        # without an answer.
        (
            TRIALS + "b,0.1,0.3,equal\nb,0.1,0.3,different\na,0,0,different\n",
            {},
            {"b": [(0.1, 0.3, 1, 2)], "a": [(0.0, 0.0, 0, 1)]},
        ),
        (TRIALS + "b,0,0,\na,0,0,equal\nb,0,0,equal\n", {}, {"b": [(0.0, 0.0, 1, 1)], **ONE}),
        (
            COUNTS + "a,0,0.3,1,5\na,0.0,0.30,2,6\na,1,1,0,0\na,0,0.3,0,4\n",
            {},
            {"a": [(0.0, 0.3, 3, 15)]},
        ),
        (
            f"{COUNTS}a,0,0,9007199254740992,9007199254740992\n",
            {},
            {"a": [(0.0, 0.0, 2**53, 2**53)]},
        ),
        (f"{TRIALS}a,-0.0,0,same\na,0,-0,different\n", {}, {"a": [(0.0, 0.0, 1, 2)]}),
        *(
            (f"{TRIALS}a,{text},-{text.lstrip('+')},same\n", {}, {"a": [(0.25, -0.25, 1, 1)]})
            for text in ("+0.25", ".25", "25E-2", "00.250")
        ),
        *(
            (f"{COUNTS}a,0,0,0,{text}\n", {}, {"a": [(0.0, 0.0, 0, 5)]})
            for text in ("5", "5.0", "5.", "+5", "005", "5.00")
        ),
        *((f"{TRIALS}a,0,0,{text}\n", {}, ONE) for text in ("equal", "EQUAL", " Same ")),
        *(
            (f"{TRIALS}a,0,0,{text}\n", {}, {"a": [(0.0, 0.0, 0, 1)]})
            for text in ("different", "Different")
        ),
        # Cells and headers are stripped; blank rows and other columns, also repeated ones, are
        # ignored.
        (' subject , s1,"s2 ",response \n a , 0 ,\t0.5, "equal "\n', {}, {"a": [(0.0, 0.5, 1, 1)]}),
        ('x,subject,s1,,x,s2,response,\n\n1,a,0,,"free, text",0,equal,\n  \n,,,,,,,\n,\n', {}, ONE),
        ("subject;s1;s2;response;a,b,c,d,e,f,g\na;0;0;equal;y\n", {}, ONE),
        (
            "subject;s1;s2;response\na;0;0;1,0\na;0;0;0,0\na;0;0;1\n",
            {"equal_code": "1"},
            {"a": [(0.0, 0.0, 2, 3)]},
        ),
        ("block,s1,s2,response\na,0,0,equal\n", {"columns": {"subject": "block"}}, ONE),
        # Codes are exact; one leaves the default words of the other side; one is never also read as
        # its opposite.
        (
            f"{TRIALS}a,0,0,f\na,0,0, J \n",
            {"equal_code": "f", "different_code": "J"},
            {"a": [(0.0, 0.0, 1, 2)]},
        ),
        (
            f"{TRIALS}a,0,0,0\na,0,0,1\n",
            {"equal_code": "0", "different_code": "1"},
            {"a": [(0.0, 0.0, 1, 2)]},
        ),
        (
            f"{TRIALS}a,0,0,z\na,0,0,different\na,0,0,Different\n",
            {"equal_code": "z"},
            {"a": [(0.0, 0.0, 1, 3)]},
        ),
        (
            f"{TRIALS}a,0,0,None\na,0,0,none\na,0,0,different\n",
            {"equal_code": "None"},
            {"a": [(0.0, 0.0, 1, 2)]},
        ),
        # Stimuli in both units are chosen by the option; columns may be swapped; the reference
        # itself is exactly 0.
        ("subject,s1,s2,i1,i2,response\na,0,0,7,8,equal\n", {}, ONE),
        ("subject,s1,s2,i1,i2,response\na,7,8,0.087,0.087,equal\n", {"intensity": 0.087}, ONE),
        (
            f"{TRIALS}a,1,2,equal\n",
            {"columns": {"s1": "s2", "s2": "s1"}},
            {"a": [(2.0, 1.0, 1, 1)]},
        ),
    ],
)
def test_what_is_read(data, options, expected):
    study = read(data, **options)
    assert content(study) == expected
    assert list(study.names) == list(expected)
    assert not any(np.signbit(subject.s1[subject.s1 == 0]).any() for subject in study)


@pytest.mark.parametrize(
    ("data", "options", "notes"),
    [
        (
            TRIALS + "a,0,0,1.0\na,0,0,0\n",
            {"equal_code": "1"},
            [
                "trial rows, comma-separated, UTF-8, responses '1.0' as equal (1) / '0' as "
                "different (1)"
            ],
        ),
        (
            COUNTS + "a,0,0.3,1,5\nb,0,0,3,3\na,0.0,0.30,2,6\na,1,1,0,0\na,0,0.3,0,4\n",
            {},
            [
                "grouped rows, comma-separated, UTF-8, 6 of 18 trials answered 'equal'",
                "1 row with n_trials = 0 left out",
                "2 repeated rows merged: a 2",
            ],
        ),
        (
            "subject,s1,s2,k,n\na,0,0,1,2\na,0,0,1,2\n",
            {"columns": {"n_equal": "k", "n_trials": "n"}},
            [
                "grouped rows, comma-separated, UTF-8, 2 of 4 trials answered 'equal'",
                *(
                    "column k read as n_equal",
                    "column n read as n_trials",
                    "1 repeated row merged: a 1",
                ),
            ],
        ),
        (
            AMPLITUDES.replace("i1", "first") + "a,0.087,0.174,f\n",
            {"intensity": 0.087, "equal_code": "f", "columns": {"i1": "first"}},
            [
                "trial rows, comma-separated, UTF-8, responses 'f' as equal (1) / 'different' (0)",
                "column first read as i1",
                "column first read as amplitude in units of 0.087",
                "column i2 read as amplitude in units of 0.087",
            ],
        ),
        (
            "subject;s1;s2;isi;response;task\na;0,5;0;0,5;same;x\na;0,5;0;2;same;x\nb;x;;;;y\n",
            {"where": {"task": "x"}},
            [
                "trial rows, semicolon-separated, UTF-8, decimal comma, responses 'same' as equal "
                "(2) / 'different' (0)",
                *(
                    "only rows with x in column task",
                    "2 intervals in column isi: 0.5, 2 s; contrast --condition isi compares them",
                ),
            ],
        ),
    ],
)
def test_what_was_detected_and_merged_is_noted(data, options, notes):
    assert list(read(data, **options).notes) == notes


@pytest.mark.parametrize("text", ["", " ", "NA", "na", "N/A", "n/a", "NaN", "nan", "None"])
def test_rows_without_a_response_are_dropped_and_counted(text):
    study = read(f"{TRIALS}a,0,0,equal\na,,x,{text}\nb,0,0,{text}\n,,,{text}\na,0,0,{text}\n")
    assert content(study) == ONE
    nobody = ", (no subject) 1" if text.strip() else ""  # without any text, that row is blank
    assert study.notes[1:] == (
        f"{4 if nobody else 3} trials without a response dropped: a 2, b 1{nobody}",
        "1 subject without any response left out: b",
    )


def test_subject_names_stay_as_they_are():
    names = [
        "01",
        "1",
        "1.0",
        "NA",
        "nan",
        "None",
        "Zoë",
        "被験者 一",
        "🙂",
        "a\u200bb",
        "O'Neil",
        "true",
        "1e5",
        "-",
    ]
    assert read(TRIALS + "".join(f"{name},0,0,equal\n" for name in names)).names == tuple(names)
    assert read(f'{TRIALS}"a ""x"", b",0,0,equal\n"c\nd",0,0,equal\n').names == ('a "x", b', "c\nd")


def test_amplitudes_become_log_intensities_and_do_not_overflow():
    study = read(AMPLITUDES + "a,0.087,0.174,equal\na,0.0435,1e-3,different\n", intensity=0.087)
    assert study["a"].s1.tolist() == pytest.approx([math.log(0.5), 0.0], abs=1e-15)
    assert study["a"].s2.tolist() == pytest.approx(
        [math.log(1e-3 / 0.087), math.log(2.0)], rel=1e-14
    )
    extreme = read(AMPLITUDES + "a,1e308,1e-308,same\n", intensity=1e-300)
    assert (extreme["a"].s1[0], extreme["a"].s2[0]) == pytest.approx(
        (608 * math.log(10), -8 * math.log(10))
    )


@pytest.mark.parametrize(
    ("marks", "synthetic"),
    [
        (("1", "1"), True),
        (("true", "YES"), True),
        (("1", "0"), False),
        (("", ""), False),
        (("1", ""), False),
    ],
)
def test_synthetic_column(marks, synthetic):
    study = read(
        f"subject,s1,s2,response,synthetic\na,0,0,equal,{marks[0]}\na,0,0,equal,{marks[1]}\n"
    )
    assert study.synthetic is synthetic
    assert any("synthetic" in note for note in study.notes) is ("1" in marks or synthetic)


# --- Answers in their order -----------------------------------------------------------------------


def test_blocks_and_trials_are_kept_in_order_beside_the_counts():
    study = read(
        ORDERED + words("a,0,1,1,10,2\nb,0,0,1,x,7\na,0,0,0,9,1\na,0,0,NA,9,2\na,0,0,1,10,1\n")
    )
    assert content(study) == {"a": [(0.0, 0.0, 1, 2), (0.0, 1.0, 1, 1)], "b": [(0.0, 0.0, 1, 1)]}
    answers = study["a"].answers
    assert answers.blocks == ("10", "9"), "one block is no number: in order of appearance"
    assert answers.keys.tolist() == [[0, 0], [0, 1], [0, 0], [0, 0]], (
        "a trial without an answer was felt all the same"
    )
    assert (answers.n_yes.tolist(), answers.n_trials.tolist(), answers.block.tolist()) == (
        [1, 1, 0, 0],
        [1, 1, 1, 0],
        [0, 0, 1, 1],
    )
    assert (answers.trials, answers.begins.tolist()) == (True, [True, False, True, False]), (
        "memory begins anew in another block"
    )
    assert study.reading.ignored == ()
    numbered = read(ORDERED + words("a,0,1,1,10,2\na,0,0,0,9,1\na,0,0,1,10,1\n"))["a"].answers
    assert (numbered.blocks, numbered.n_yes.tolist()) == (("9", "10"), [0, 1, 1])
    running = read(ORDERED + words("a,0,1,1,1,12\na,0,0,0,2,3\na,0,0,0,1,4\n"))["a"].answers
    assert (running.n_yes.tolist(), running.block.tolist()) == ([0, 0, 1], [1, 0, 0]), (
        "trials numbered over all blocks"
    )


def test_sessions_tell_the_order_and_where_memory_begins_anew():
    header = "subject,s1,s2,response,session,block,trial,iti\n"
    rows = words("a,0,0,1,2,1,1,\na,0,1,1,1,1,1,\na,0,1,0,1,2,1,2.5\na,1,1,1,1,2,3,-1\n")
    study = read(header + rows)
    answers = study["a"].answers
    assert (answers.n_yes.tolist(), answers.begins.tolist()) == (
        [1, 0, 1, 1],
        [True, False, False, True],
    )
    np.testing.assert_array_equal(answers.iti, [np.nan, 2.5, np.nan, np.nan])
    assert study.notes[1:] == (
        "trial numbers are missing (a 1); keep trials without a response in the file, with an "
        "empty response",
        "no time since the trial before for 1 trial in column iti",
    )
    assert study.exclude("a", "2")["a"].answers.begins.tolist() == [True, True]
    assert replace(study["a"], n_yes=[0, 0, 0]).answers is None, (
        "other counts are not those of the answers"
    )


def test_trials_that_tell_no_order_leave_that_of_the_file_and_are_noted():
    study = read(ORDERED + words("a,0,1,1,1,1\na,0,0,0,1,1\nb,0,0,0,1,x\nc,0,0,0,1,1\n"))
    assert study.notes[1:] == (
        "column trial does not order all trials, so the order of the file is used: a, b",
    )
    assert study["a"].answers.n_yes.tolist() == [1, 0]


def test_trials_that_are_there_twice_are_told():
    rows = words("a,0,1,1,1,1\na,0,0,0,1,2\nb,0,0,0,1,1\n")
    (same,) = read(
        ORDERED + rows + words("b,0,1,NA,1,1\na,0,0,0,1,2\nb,0,0,0,1,1\n")
    ).reading.doubts
    assert (
        "2 rows repeat block and trial of another row with the same stimuli and answer, first row "
        "6, which repeats row 3 (" in same
    )
    (other,) = read(ORDERED + rows + words("b,0,0,1,1,1\n")).reading.doubts
    assert (
        "1 row repeats block and trial of another row, none with the same stimuli and answer, "
        "first row 5" in other
    )
    assert "unless these are several sessions" in other
    unblocked = "subject,s1,s2,response,trial\n" + words("a,0,1,1,1\na,0,1,1,1\n")
    assert "1 row repeats trial of another row with the same" in read(unblocked).reading.doubts[0]
    several = words("a,0,0,0,1,x\na,0,0,0,1,x\n"), words("a,0,0,1,1\n"), words("a,0,1,1\na,0,1,1\n")
    for fine in (
        ORDERED + rows,
        ORDERED + rows + several[0],
        unblocked + several[1],
        TRIALS + several[2],
    ):
        assert read(fine).reading.doubts == (), (
            "in another block, without a number, or without blocks they may be other trials"
        )


def test_counts_have_answers_where_they_have_blocks():
    study = read(
        "subject,s1,s2,n_equal,n_trials,Run\na,0,1,1,5,1\na,0,1,2,5,2\n", columns={"block": "Run"}
    )
    assert content(study) == {"a": [(0.0, 1.0, 3, 10)]}
    answers = study["a"].answers
    assert (answers.n_yes.tolist(), answers.n_trials.tolist(), answers.blocks, answers.trials) == (
        [1, 2],
        [5, 5],
        ("1", "2"),
        False,
    )
    assert read(COUNTS + "a,0,1,1,5\n")["a"].answers is None


def test_columns_that_nobody_reads_are_told_by_name():
    study = read("rt,subject,s1,s2,i1,,response,rt,Block\n1,a,0,1,5,,same,2,3\n")
    assert study.reading.ignored == ("rt", "i1", "Block")
    assert study.reading.read == ("subject", "s1", "s2", "response")
    twice = read("subject,s1,s2,response,block,block\na,0,1,same,1,2\n")
    assert twice.reading.ignored == ("block",), (
        "which of two is meant cannot be told, and no result depends on it"
    )


# --- Several files --------------------------------------------------------------------------------


def test_a_file_that_is_a_copy_of_another_is_told(tmp_path):
    rows = words("".join(f"a,0,{row % 3},{row % 2}\n" for row in range(20)))
    texts = {
        "1.csv": TRIALS + rows,
        "2.csv": TRIALS + rows.replace("a,", "b,"),
        "3.csv": TRIALS + rows,
        "4.csv": TRIALS + rows + "a,0,0,same\n",
    }
    paths = [tmp_path / name for name in texts]
    for path, text in zip(paths, texts.values(), strict=True):
        path.write_text(text, encoding="utf-8")
    (told,) = read_study(paths).reading.doubts
    assert told.startswith(
        "3.csv has the same 20 trials of subject a as 1.csv: repeated trials make"
    )
    assert read_study([paths[0], paths[1], paths[3]]).reading.doubts == ()


def test_of_several_files_the_problems_of_the_first_are_all_told_and_the_other_files_counted(
    tmp_path,
):
    for name, rows in {"a": 12, "b": 3, "c": 3, "d": 3}.items():
        (tmp_path / f"{name}.csv").write_text(TRIALS + "a,x,0,equal\n" * rows, encoding="utf-8")
    files = [tmp_path / f"{name}.csv" for name in "abcd"]
    for asked, last in (
        (files[:1], "... and 2 more problems"),
        (files, "... and problems in 3 more files"),
        (files[1:3], "c.csv: row 4, column s1: found 'x', allowed: a finite number"),
        (files[1:], "... and the same in 2 more files"),
    ):
        with pytest.raises(InputError) as refusal:
            read_study(asked)
        assert refusal.value.problems[-1] == last


# --- Options --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "problems"),
    [
        (
            {"equal_code": "a", "different_code": " a "},
            ["--different-code: found 'a' as --equal-code"],
        ),
        ({"equal_code": "  "}, ["--equal-code: found ''"]),
        ({"different_code": ""}, ["--different-code: found ''"]),
        ({"intensity": 0.0}, ["--intensity: found 0.0, allowed: a positive finite number"]),
        ({"intensity": math.nan}, ["--intensity: found nan"]),
        ({"intensity": math.inf}, ["--intensity: found inf"]),
        ({"columns": {"first": "s1"}}, ["--columns: found 'first=s1'"]),
        ({"columns": {"s1": " "}}, ["--columns: found 's1='"]),
        ({"columns": {"s1": "a", "s2": "a"}}, ["--columns: found 's2=a', allowed: each name once"]),
        (
            {"subject_from": "x.csv"},
            ["--subject-from: found 'x.csv', allowed: a file's name with one {}"],
        ),
        (
            {"intensity": -1, "equal_code": "", "columns": {"x": "y"}},
            ["--intensity", "--equal-code", "--columns"],
        ),
    ],
)
def test_options_that_make_no_sense_are_refused_all_at_once(options, problems):
    with pytest.raises(InputError) as caught:
        ReadOptions(**options)
    assert len(caught.value.problems) == len(problems)
    assert all(
        line.startswith(problem)
        for line, problem in zip(caught.value.problems, problems, strict=True)
    )


@pytest.mark.parametrize(
    ("text", "found"),
    [
        *((text, repr(text)) for text in ("", "s1", "s1=", "=x", "S1=x", "s3=a")),
        ("s1=a,", "''"),
        ("s1=a,s1=b", "'s1=b'"),
    ],
)
def test_parse_columns_refuses(text, found):
    with pytest.raises(InputError) as caught:
        parse_columns(text)
    (problem,) = caught.value.problems
    assert problem.startswith(f"--columns: found {found}, allowed: ")
    assert problem.endswith(
        "one of subject, s1, s2, i1, i2, standard, comparison, response, n_equal, n_second, "
        "n_trials, isi, session, block, trial, iti, condition"
    )


# --- Dialects -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("codec", "label"),
    [("utf-8", "UTF-8"), ("utf-8-sig", "UTF-8"), ("utf-16", "UTF-16"), ("utf-16-be", "UTF-16")],
    ids=str,
)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"], ids=["LF", "CRLF", "CR"])
@pytest.mark.parametrize(
    ("delimiter", "name"), [(",", "comma"), (";", "semicolon"), ("\t", "tab"), ("|", "bar")]
)
def test_dialects(codec, label, end, delimiter, name):
    lines = [
        '"subject","a~b","s1","s2","response"',
        "Zoë,0,0.5,-0.25,equal",
        "Ω,0,0,0,different",
        "",
    ]
    mark = b"\xfe\xff" if codec == "utf-16-be" else b""
    study = read(mark + end.join(lines).replace(",", delimiter).replace("~", ",").encode(codec))
    assert content(study) == {"Zoë": [(0.5, -0.25, 1, 1)], "Ω": [(0.0, 0.0, 0, 1)]}
    assert study.notes[0].startswith(
        f"trial rows, {name}-separated, {label}, responses 'equal' (1)"
    )


# --- Files of other labs --------------------------------------------------------------------------


def test_names_that_are_alike_are_read_and_noted():
    study = read("Participant;S1;S2;R\u00e9ponse\n01;0;0,3;second\n01;0,3;0;first\n")
    assert content(study) == {"01": [(0.0, 0.3, 1, 1), (0.3, 0.0, 0, 1)]}
    assert {"column Participant read as subject", "column S1 read as s1"} <= set(study.notes)
    assert "column R\u00e9ponse read as response" in study.notes
    with pytest.raises(InputError, match="no column subject"):
        read("participant,observer,s1,s2,response\na,b,0,0.3,second\n")


def test_of_two_codes_one_tells_the_other():
    rows = "subject,s1,s2,response\na,0,0.3,j\na,0.3,0,f\na,0,0.3,\n"
    assert content(read(rows, second_code="j")) == {"a": [(0.0, 0.3, 1, 1), (0.3, 0.0, 0, 1)]}
    assert read(rows, second_code="j").subjects[0].total_trials == 2
    with pytest.raises(InputError, match="found 'k'"):
        read(rows + "a,0,0.3,k\n", second_code="j")


def test_the_code_proposed_for_second_is_commoner_with_a_stronger_second_stimulus():
    rows = "subject,s1,s2,response\n" + "a,0,0.3,z\na,0.3,0,m\n" * 3 + "a,0,0.3,m\n"
    with pytest.raises(InputError) as caught:
        read(rows)
    assert [remedy.typed for remedy in caught.value.remedies] == [
        "--equal-code z",
        "--second-code z",
    ]


MISSED = """subject,s1,s2,correct,key,rt
a,0,0.3,1,j,.6
a,0,0.3,0,,
a,0.3,0,1,f,.5
a,0.3,0,0,,
"""


def test_missed_trials_that_are_scored_wrong_are_no_responses():
    study = read(MISSED, correct="correct")
    assert content(study) == {"a": [(0.0, 0.3, 1, 1), (0.3, 0.0, 0, 1)]}
    assert "no response where column key, rt is empty" in study.notes
    assert "2 trials without a response dropped: a 2" in study.notes
    # An empty cell beside a right response is no sign: the column says something else.
    assert read(MISSED.replace("0,,", "1,,"), correct="correct").subjects[0].total_trials == 4
    # A reaction time of 999 ms is no sign either.
    assert read(MISSED.replace("0,,", "0,f,999"), correct="correct").subjects[0].total_trials == 4
    without_signs = "subject,s1,s2,correct\na,0,0.3,1\na,0,0.3,0\na,0.3,0,1\na,0.3,0,0\n"
    assert read(without_signs, correct="correct").subjects[0].total_trials == 4


POINTS = "subject;i1;i2;response\na;850;1.050;second\na;1.050;850;first\n"


def test_a_sign_that_may_group_thousands_is_asked_for():
    for data in (POINTS, POINTS.replace(";", "\t").replace(".", ",")):
        with pytest.raises(InputError, match=r"can be 1050 or 1\.050") as caught:
            read(data, intensity=1000.0)
        sign, other = (remedy.value for remedy in caught.value.remedies)
        assert (sign, other) == ((".", ",") if "." in data else (",", "."))
        grouped = read(data, intensity=1000.0, decimal=other).subjects[0]
        assert np.exp(grouped.s1) == pytest.approx([0.85, 1.05])
        decimal = read(data, intensity=1.0, decimal=sign).subjects[0]
        assert sorted(np.exp(decimal.s1)) == pytest.approx([1.05, 850.0])
    shown = read(POINTS.replace("850", "0.850"), intensity=1.0).subjects[0]
    assert np.exp(shown.s1) == pytest.approx([0.85, 1.05])
    # Natural logs are never thousands.
    logs = "subject;s1;s2;response\na;1.625;2.125;second\na;2.125;1.625;first\n"
    assert read(logs).subjects[0].s1.tolist() == [1.625, 2.125]


def test_spaces_apostrophes_a_minus_sign_and_a_line_that_names_the_delimiter():
    data = "sep=;\nsubject;i1;i2;response\na;1'360;1 500;second\na;1\u202f500;1360;first\n"
    assert np.exp(read(data, intensity=1.0)["a"].s1) == pytest.approx([1360.0, 1500.0])
    assert content(read(f"{TRIALS}a,\u22120.3,0,same\n")) == {"a": [(-0.3, 0.0, 1, 1)]}


STANDARDS = """subject,standard,comparison,interval,response
a,0,0.3,1,comparison
a,0,0.3,2,comparison
a,0,0.3,1,standard
a,0,-0.3,2,standard
"""


def test_a_standard_and_a_comparison_need_their_order():
    for names in ({}, {"columns": {"s1": "standard", "s2": "comparison"}}):
        with pytest.raises(InputError) as caught:
            read(STANDARDS, **names)
        assert [remedy.typed for remedy in caught.value.remedies] == [
            "--standard-interval interval",
            "--standard-first",
        ]
    with pytest.raises(InputError, match="an order effect would cancel out"):
        read(STANDARDS, columns={"s1": "standard", "s2": "comparison"})


def test_responses_to_a_standard_and_a_comparison_follow_the_interval():
    # 'comparison' is 'second' exactly when the comparison was second.
    expected = {"a": [(-0.3, 0.0, 1, 1), (0.0, 0.3, 1, 2), (0.3, 0.0, 0, 1)]}
    study = read(STANDARDS, standard_interval="interval")
    assert (study.task, content(study)) == (WHICH_STRONGER, expected)
    coded = STANDARDS.replace(",comparison\n", ",c\n").replace(",standard\n", ",s\n")
    coded = coded.replace("interval,response", "where,response")
    options = {"standard_interval": "where", "comparison_code": "c"}
    assert content(read(coded, **options)) == expected
    in_words = STANDARDS.replace("3,1,", "3,first,").replace("3,2,", "3,second,")
    assert content(read(in_words, standard_interval="interval")) == expected
    # 'first' and 'second' name intervals themselves, whatever stood there.
    absolute = "subject,std,comp,order,response\na,0,0.3,2,first\na,0,0.3,1,second\n"
    found = content(read(absolute, standard_interval="order"))
    assert found == {"a": [(0.0, 0.3, 1, 1), (0.3, 0.0, 0, 1)]}
    always = content(read(absolute.replace(",2,first", ",1,first"), standard_first=True))
    assert always == {"a": [(0.0, 0.3, 1, 2)]}


def test_what_is_refused_of_a_standard_and_a_comparison():
    (problem,) = refused(STANDARDS.replace("3,2,", "3,3,", 1), standard_interval="interval")
    assert problem.startswith("row 3, column interval: found '3', allowed: 1 or 2")
    (problem,) = refused(STANDARDS.replace("a,0,", "a,x,", 1), standard_interval="interval")
    assert problem == "row 2, column standard: found 'x', allowed: a finite number"
    without_comparison = STANDARDS.replace("comparison,interval", "level,interval")
    (problem,) = refused(without_comparison, standard_interval="interval")
    assert problem.startswith("row 1: there is no column comparison.")
    (problem,) = refused(STANDARDS, standard_interval="interval", comparison_code="c")
    assert problem.startswith("column response: found 'comparison', 'standard', allowed: 'c'")
    with pytest.raises(InputError, match="allowed: one of them"):
        ReadOptions(standard_interval="a", standard_first=True)
    with pytest.raises(InputError, match="--comparison-code: found alone"):
        ReadOptions(comparison_code="c")


def test_texts_that_say_that_nobody_responded():
    rows = "".join(f"a,0,0.3,{text}\n" for text in ("second", "timeout", "No response", "-99", "."))
    study = read(f"{TRIALS}{rows}a,0.3,0,first\n")
    assert study.subjects[0].total_trials == 2
    assert "4 trials without a response dropped: a 4" in study.notes


def test_codes_may_be_numbers_as_in_a_data_frame():
    rows = "subject,s1,s2,response\na,0,0.3,1\na,0.3,0,0\n"
    for code in (1, True, 1.0):
        assert content(read(rows, second_code=code)) == {"a": [(0.0, 0.3, 1, 1), (0.3, 0.0, 0, 1)]}


# --- Refusals -------------------------------------------------------------------------------------

NUMBER = "a finite number"
WHOLE = "a whole number from 0 to 2**53, without thousands separators"
ANSWERS = "equal, same (equal) or different (different), or empty; other codes by --equal-code, --different-code"
QUOTES = "allowed: quotes around whole cells, doubled inside"
TEXT = "allowed: text in UTF-8 or UTF-16, or the encoding that --encoding names"
EMPTY = "found an empty file, allowed: a header and at least one row"
HEADER_ONLY = "row 1: found a header only, allowed: at least one row below it"


def missing(found, *names):
    absent = " and ".join(f"no column {name}" for name in names)
    return f"row 1: there is {absent}. The columns are {found}."


def no(data, *problems, **options):
    """A file, read with these options, and its problems."""
    return data, options, list(problems)


HEAD = "subject, s1, s2"
ALONE = (
    "allowed: response alone (one row per trial) or n_equal and n_trials alone (one row per pair)"
)
REFUSED = [
    # The header.
    no(
        "id,x,response\na,0,equal\n",
        "row 1: there is no column subject, no column s1 and no column s2. The columns are id, x, "
        "response.",
    ),
    no("subject,s1,s2,n_equal\na,0,1,5\n", missing(f"{HEAD}, n_equal", "n_trials")),
    no("subject,s1,s2,n_trials\na,0,1,5\n", missing(f"{HEAD}, n_trials", "n_equal")),
    no("subject,i1,i2,response\na,1,2,equal\n", missing("subject, i1, i2, response", "s1", "s2")),
    no(f"{TRIALS}a,1,2,equal\n", missing(f"{HEAD}, response", "i1", "i2"), intensity=1.0),
    no(
        f"{TRIALS}a,0,0,equal\n",
        missing(f"{HEAD}, response", "first", "n"),
        columns={"s1": "first", "n_trials": "n"},
    ),
    *(
        no(
            f"subject,s1,s2,response,{counts}\n",
            f"row 1, column response: found together with {counts.replace(',', ' and ')}, {ALONE}",
        )
        for counts in ("n_equal", "n_trials", "n_equal,n_trials")
    ),
    no(
        "subject,s1,s2,s1,response\na,0,0,0,equal\n",
        "row 1, column s1: found 2 columns of this name, allowed: one",
    ),
    no(
        f"{TRIALS}a,0,0,equal\n",
        "row 1, column s2: found as s1 and as s2, allowed: one meaning per column",
        columns={"s1": "s2"},
    ),
    no(
        "subject,s1,response\na,0,equal\nb,0\n",
        missing("subject, s1, response", "s2"),
        "row 3: found 2 cells, allowed: 3 cells as in the header",
    ),
    *(no(data, EMPTY) for data in (b"", b"\n\n", b"  \n", b"\xef\xbb\xbf", b"\xff\xfe")),
    *(no(header, HEADER_ONLY) for header in (TRIALS, COUNTS, TRIALS + "\n\n", COUNTS + ",,,\n")),
    no(
        '"subject,s1,s2,response\na,0,0,equal\n',
        f"row 1: found a quote that is never closed, {QUOTES}",
    ),
    # Rows that cannot be split; rows are physical.
    *(
        no(
            f"{TRIALS}a,0,0,equal\n{row}\na,0,0,equal\n",
            f"row 3: found {cells}, allowed: 4 cells as in the header",
        )
        for row, cells in (("a,0,0", "3 cells"), ("a", "1 cell"), ("a,0,0,equal,", "5 cells"))
    ),
    no(
        f'{TRIALS}a,0,0,equal\n"b,0,0,equal\nc,0,0,equal\n',
        f"row 3: found a quote that is never closed, {QUOTES}",
    ),
    no(f'{TRIALS}a,"1"2,0,equal\n', f"row 2: found text after a closing quote, {QUOTES}"),
    no(
        f'{TRIALS}"{"x" * 200_000}",0,0,equal\n',
        "row 2: found a cell of more than 131072 characters (a quote that is never closed?), "
        f"{QUOTES}",
    ),
    no(
        f'{TRIALS}"a\n\nb",0,0,equal\n\n"c\nd",x,0,equal\na,0\n',
        f"row 6, column s1: found 'x', allowed: {NUMBER}",
        "row 8: found 2 cells, allowed: 4 cells as in the header",
    ),
    no(f"\n \n{TRIALS}\na,0,x,equal\n", f"row 5, column s2: found 'x', allowed: {NUMBER}"),
    # Cells.
    *(
        no(
            f"{head}a,0,0,{good}\n ,0,0,{bad}\n",
            "row 3, column subject: found '', allowed: a text that is not empty",
        )
        for head, good, bad in (
            (TRIALS, "equal", "equal"),
            (COUNTS, "1,2", "1,2"),
            (COUNTS, "1,2", "0,0"),
        )
    ),
    *(
        no(
            f"{TRIALS}a,0,0,equal\na,{text},0,equal\n",
            f"row 3, column s1: found {text!r}, allowed: {NUMBER}",
        )
        for text in ("abc", "nan", "-inf", "1e999", "1_0", "0x1", "", "1 2", "٣", "\u2212\u22121")
    ),
    *(
        no(
            f"subject;s1;s2;response\na;{text};0;same\n",
            f"row 2, column s1: found {text!r}, allowed: {NUMBER}{unclear}",
        )
        for text, unclear in (
            *(
                (text, ", without thousands separators")
                for text in ("1.234,5", "1,234.5", "1,2,3", "1.2.3")
            ),
            *((text, "") for text in ("1 00", "1'000'0")),
        )
    ),
    no(
        f'{TRIALS}a,"0,087",0,same\n',
        f"row 2, column s1: found '0,087', allowed: {NUMBER}; decimal commas need ';' or tab "
        "between cells",
    ),
    *(
        no(
            f"{AMPLITUDES}a,1,{text},same\n",
            f"row 2, column i2: found {text!r}, allowed: a positive finite number",
            intensity=2.0,
        )
        for text in ("0", "-0.1", "0.0", "1e-999", "nan", "inf", "x", "")
    ),
    no(
        "subject,s1,s2,isi,response\na,0,0,0,same\n",
        "row 2, column isi: found '0', allowed: a positive finite number of seconds, in every row "
        "or no such column",
    ),
    *(
        no(f"{COUNTS}a,0,0,{cells}\n", f"row 2, column {column}: found {shown!r}, allowed: {WHOLE}")
        for text in ("-1", "2.5", "", "inf", "9007199254740993", "1e3", "5.000", "1,5", "٣")
        for column, cells, shown in (
            ("n_equal", f'"{text}",9007199254740992', text),
            ("n_trials", f'0,"{text}"', text),
        )
    ),
    no(
        "subject;s1;s2;n_equal;n_trials\na;0;0;5;12.000\n",
        f"row 2, column n_trials: found '12.000', allowed: {WHOLE}",
    ),
    no(
        f"{COUNTS}a,0,0,2,2\na,0,1,6,5\n",
        "row 3, column n_equal: found '6', allowed: 0 to n_trials = 5",
    ),
    no(
        f"{COUNTS}a,0,0,2,2\na,0,1,1,0\n",
        "row 3, column n_equal: found '1', allowed: 0 to n_trials = 0",
    ),
    no(
        f"{COUNTS}a,0,0,7,5\na,0,0,0,5\n",
        "row 2, column n_equal: found '7', allowed: 0 to n_trials = 5",
    ),
    (
        f"{COUNTS}a,0,0,1,2\nb,0,0,0,0\nb,0,1,0,0\nc,0,0,0,0\n",
        {},
        [
            f"row {row}, column n_trials: found 0 in all rows of subject '{name}', allowed: at "
            "least 1 trial"
            for row, name in ((3, "b"), (5, "c"))
        ],
    ),
    *(
        no(
            f"{TRIALS}a,0,0,equal\na,0,0,{text}\n",
            f"row 3, column response: found {text!r}, allowed: {ANSWERS}",
        )
        for text in ("2", "0.5", "true", "equal.", "same different", "1e0")
    ),
    *(
        no(
            f"{TRIALS}a,0,0,{text}\n",
            f"row 2, column response: found {text!r}, allowed: 'f' (equal) or 'J' (different), "
            f"{ANSWERS.split('), ')[1]}",
            equal_code="f",
            different_code="J",
        )
        for text in ("F", "j", "equal", "1", "0")
    ),
    no(
        f"{TRIALS}a,0,0,f\na,0,0,F\n",
        f"row 3, column response: found 'F', allowed: 'f' (equal) or {ANSWERS.split(' or ', 1)[1]}",
        equal_code="f",
    ),
    no(
        f"{TRIALS}a,0,0,NA\nb,0,0,\n",
        "found no response in any of 2 rows, allowed: at least one answered trial",
    ),
    no(
        "who,s1,first,s2,response\na,9,x,1,same\n",
        f"row 2, column first: found 'x', allowed: {NUMBER}",
        columns={"subject": "who", "s1": "first"},
    ),
    # Which rows, and whose.
    no(
        f"{TRIALS}a,0,0,1\n",
        missing(f"{HEAD}, response", "task"),
        where={"task": "x"},
    ),
    no(
        f"{TRIALS}a,0,0,1\n",
        "column s1: found '0', allowed: '7', as --where has it, in some row",
        where={"s1": "7"},
    ),
    no(
        f"{TRIALS}a,0,1,1\na,1,0,1\n",
        "found no row that is as --where has it in all of s1, s2",
        where={"s1": "0", "s2": "0"},
    ),
    no(
        "s1,s2,response\n0,0,1\n",
        "found no subject in its name, allowed: a file named as --subject-from {}.tsv",
        subject_from="{}.tsv",
    ),
    # Bytes.
    no(
        b"PK\x03\x04" + b"[Content_Types].xml\x82",
        f"found a spreadsheet or an archive, {TEXT}; save its sheet as .xlsx or CSV",
    ),
    no(
        TRIALS.encode() + "ä,0,0,equal\r\n".encode() + b"Zo\xeb,0,0,equal\n",
        f"row 3: found byte 0xeb at offset 39, not UTF-8, {TEXT}",
    ),
    no(
        b"\xef\xbb\xbf" + TRIALS.encode() + b"Zo\xeb,0,0,equal\n",
        f"row 2: found byte 0xeb at offset 28, not UTF-8, {TEXT}",
    ),
    no(
        f"{TRIALS}a,0,0,equal".encode("utf-16")[:-1],
        f"row 2: found byte 0x6c at offset 68, not UTF-16, {TEXT}",
    ),
    no(TRIALS.encode() + b"a\0,0,0,equal\n", f"row 2: found a NUL character at offset 24, {TEXT}"),
    no(b"\0", f"row 1: found a NUL character at offset 0, {TEXT}"),
    no(TRIALS.encode("utf-16-le"), HEADER_ONLY),
    # All problems at once, in the order of rows, ten at most; what was found is cut.
    no(
        f"{TRIALS}a,x,0,equal\n,0,0,equal\na,0,y,maybe\na,0\na,0,0,equal\nb,,z,\n",
        f"row 2, column s1: found 'x', allowed: {NUMBER}",
        "row 3, column subject: found '', allowed: a text that is not empty",
        f"row 4, column response: found 'maybe', allowed: {ANSWERS}",
        f"row 4, column s2: found 'y', allowed: {NUMBER}",
        "row 5: found 2 cells, allowed: 4 cells as in the header",
    ),
    *(
        no(
            TRIALS + "a,x,0,equal\n" * count,
            *(
                f"row {row}, column s1: found 'x', allowed: {NUMBER}"
                for row in range(2, 2 + min(count, 10))
            ),
            *last,
        )
        for count, last in (
            (10, []),
            (11, ["... and 1 more problem"]),
            (45, ["... and 35 more problems"]),
        )
    ),
    no(
        f"{TRIALS}a,{'x' * 5000},0,equal\n",
        f"row 2, column s1: found '{'x' * 35}...', allowed: {NUMBER}",
    ),
    no(
        f'{TRIALS}a,"\x1b[31m\n",0,equal\n',
        f"row 2, column s1: found '\\x1b[31m', allowed: {NUMBER}",
    ),
]


@pytest.mark.parametrize(("data", "options", "problems"), REFUSED, ids=range(len(REFUSED)))
def test_what_cannot_be_used_is_refused_by_row_and_column(data, options, problems):
    assert refused(data, **options) == problems


def test_unreadable_paths(tmp_path, monkeypatch):
    (tmp_path / "file.txt").write_text("x")
    for path in (
        tmp_path / "missing\n.csv",
        tmp_path,
        tmp_path / "file.txt" / "x.csv",
        "nul\0l.csv",
        "x" * 300,
    ):
        with pytest.raises(InputError, match="cannot be read") as caught:
            read_study(path)
        assert len(caught.value.problems) == 1
        assert str(caught.value).isprintable()

    def forbidden(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", forbidden)
    with pytest.raises(InputError, match=r"study\.csv: cannot be read \(Permission denied\)"):
        read_study((tmp_path / "file.txt").rename(tmp_path / "study.csv"))


# --- Properties -----------------------------------------------------------------------------------

# No bare carriage return: the csv module of Python before 3.13 writes it without quotes, which ends
# a row.
_names = (
    st.text(min_size=1, max_size=8)
    .map(str.strip)
    .filter(lambda name: name != "" and not set("\0\r") & set(name))
)
_numbers = st.floats(-5, 5).map(lambda value: round(value, 3) + 0.0)
_trials = st.lists(st.tuples(_names, _numbers, _numbers, st.booleans()), min_size=1, max_size=30)


@FUZZ
@given(
    trials=_trials,
    delimiter=st.sampled_from(",;\t"),
    comma=st.booleans(),
    codec=st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]),
    end=st.sampled_from(["\n", "\r\n"]),
    quoting=st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL]),
)
def test_any_dialect_gives_the_same_study(trials, delimiter, comma, codec, end, quoting):
    text = io.StringIO(newline="")
    writer = csv.writer(text, delimiter=delimiter, lineterminator=end, quoting=quoting)
    writer.writerow(["response", "s2", "extra", "subject", "s1"])
    for name, s1, s2, equal in trials:
        first, second = (f"{value!r}" for value in (s1, s2))
        if comma and delimiter != ",":
            first, second = first.replace(".", ","), second.replace(".", ",")
        writer.writerow(["equal" if equal else "different", second, "x;y,z\t", name, first])
    names = list(dict.fromkeys(name for name, *_ in trials))
    subjects = (
        Subject.from_trials(
            name, *zip(*(rest for who, *rest in trials if who == name), strict=True)
        )
        for name in names
    )
    study = read(text.getvalue().encode(codec))
    assert content(study) == content(Study(tuple(subjects)))
    assert list(study.names) == names


@pytest.mark.parametrize("sign", ["", ".", "e"])
@pytest.mark.parametrize("digit", ["0", "1"])
def test_a_hopeless_number_of_many_digits_is_none(digit, sign):
    text = (
        digit * 60_000 + sign + digit * 60_000 + "x"
    )  # a pattern that tries every split of the digits would not end
    assert math.isnan(number(text))
    assert whole_number(text) == -1
