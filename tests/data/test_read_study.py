"""Reading studies: every dialect gives the same study, every bad input one line per problem."""

from __future__ import annotations

import csv
import io
import math
import pickle
import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bayes_toe.data import cells, columns
from bayes_toe.data import read_study as read_study_module
from bayes_toe.data.read_options import ReadOptions, parse_columns
from bayes_toe.data.read_study import read_study
from bayes_toe.data.study import Study, Subject
from bayes_toe.errors import InputError

TRIALS = "subject,s1,s2,response\n"
COUNTS = "subject,s1,s2,n_equal,n_trials\n"
FUZZ = settings(max_examples=200, deadline=None, derandomize=True, database=None)


def read(data: str | bytes, options: ReadOptions | None = None) -> Study:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "study.csv")
        path.write_bytes(data if isinstance(data, bytes) else data.encode())
        return read_study(path, options)


def refused(data: str | bytes, options: ReadOptions | None = None) -> list[str]:
    with pytest.raises(InputError) as caught:
        read(data, options)
    problems = caught.value.problems
    assert all(len(problem.splitlines()) == 1 for problem in problems), "one line per problem"
    assert str(caught.value).splitlines() == list(problems)
    return list(problems)


def content(study: Study) -> dict[str, list[tuple[float, float, int, int]]]:
    return {
        one.name: list(zip(one.s1.tolist(), one.s2.tolist(), one.n_equal.tolist(), one.n_trials.tolist(), strict=True)) for one in study
    }


# --- What is read -----------------------------------------------------------------------------------


def test_trials_are_grouped_by_subject_and_ordered_pair() -> None:
    study = read(TRIALS + "b,0.1,0.3,equal\na,0,0,different\nb,0.3,0.1,different\nb,0.1,0.3,different\n")
    assert content(study) == {"b": [(0.1, 0.3, 1, 2), (0.3, 0.1, 0, 1)], "a": [(0.0, 0.0, 0, 1)]}
    assert study.names == ("b", "a"), "order of first appearance"
    assert study.source == "study.csv"
    assert study.synthetic is False
    assert study.notes == ("trial rows, comma-separated, UTF-8, responses 'equal' (1) / 'different' (3)",)


def test_order_of_appearance_counts_rows_without_a_response() -> None:
    assert read(TRIALS + "b,0,0,\na,0,0,equal\nb,0,0,equal\n").names == ("b", "a")


def test_counts_are_merged_where_a_pair_is_repeated() -> None:
    study = read(COUNTS + "a,0,0.3,1,5\nb,0,0,3,3\na,0.0,0.30,2,6\na,1,1,0,0\na,0,0.3,0,4\n")
    assert content(study) == {"a": [(0.0, 0.3, 3, 15)], "b": [(0.0, 0.0, 3, 3)]}
    assert study.notes == (
        "grouped rows, comma-separated, UTF-8, 6 of 18 trials answered 'equal'",
        "1 row with n_trials = 0 left out",
        "2 repeated rows merged: a 2",
    )


def test_merging_is_noted_under_renamed_columns_too() -> None:
    data = "subject,s1,s2,k,n\na,0,0,1,2\na,0,0,1,2\n"
    study = read(data, ReadOptions(columns={"n_equal": "k", "n_trials": "n"}))
    assert study.notes[1:] == ("column k read as n_equal", "column n read as n_trials", "1 repeated row merged: a 1")


def test_trials_and_counts_of_one_experiment_agree() -> None:
    trials = TRIALS + "a,0,0.3,equal\na,0,0.3,different\na,0.3,0,equal\n"
    assert content(read(trials)) == content(read(COUNTS + "a,0.3,0,1,1\na,0,0.3,1,2\n"))


@pytest.mark.parametrize(
    ("text", "equal"),
    [
        *((text, 1) for text in ("equal", "EQUAL", " Same ", "1", "1.0", "1.")),
        *((text, 0) for text in ("different", "Different", "0", "0.0", "0.00")),
    ],
)
def test_default_responses(text: str, equal: int) -> None:
    assert content(read(f"{TRIALS}a,0,0,{text}\n")) == {"a": [(0.0, 0.0, equal, 1)]}


@pytest.mark.parametrize("text", ["2", "10", "0.5", "-1", "true", "yes", "diff", "equal.", "same different", "1e0"])
def test_unknown_responses_are_refused(text: str) -> None:
    (problem,) = refused(f"{TRIALS}a,0,0,equal\na,0,0,{text}\n")
    assert problem.startswith(f"study.csv: row 3, column response: found {text!r}, allowed: equal, same, 1 (equal) or")


@pytest.mark.parametrize("text", ["", " ", "NA", "na", "N/A", "n/a", "NaN", "nan", "None"])
def test_rows_without_a_response_are_dropped_and_counted(text: str) -> None:
    study = read(f"{TRIALS}a,0,0,equal\na,,x,{text}\nb,0,0,{text}\n,,,{text}\na,0,0,{text}\n")
    assert content(study) == {"a": [(0.0, 0.0, 1, 1)]}
    nobody = ", (no subject) 1" if text.strip() else ""  # without any text, that row is blank
    assert study.notes[1:] == (
        f"{4 if nobody else 3} trials without a response dropped: a 2, b 1{nobody}",
        "1 subject without any response left out: b",
    )


def test_notes_list_ten_subjects_at_most() -> None:
    rows = "".join(f"S{i:02d},0,0,\n" for i in range(12))
    study = read(f"{TRIALS}a,0,0,equal\n{rows}")
    assert study.notes[2].startswith("12 subjects without any response left out: S00, S01")
    assert study.notes[2].endswith("S09, ... and 2 more")
    rows = "".join(f"S{i:02d},0,0,\n" for i in range(10))
    assert read(f"{TRIALS}a,0,0,equal\n{rows}").notes[2].endswith("S08, S09")


def test_nothing_answered_at_all_is_refused() -> None:
    message = "study.csv: found no response in any of 2 rows, allowed: at least one answered trial"
    assert refused(f"{TRIALS}a,0,0,NA\nb,0,0,\n") == [message]


def test_subject_names_stay_as_they_are() -> None:
    names = ["01", "1", "1.0", "NA", "nan", "None", "Zoë", "被験者 一", "🙂", "a\u200bb", "O'Neil", "true", "1e5", "-"]
    study = read(TRIALS + "".join(f"{name},0,0,equal\n" for name in names))
    assert study.names == tuple(names)


def test_subjects_may_hold_quotes_delimiters_and_newlines() -> None:
    study = read(f'{TRIALS}"a ""x"", b",0,0,equal\n"c\nd",0,0,equal\n')
    assert study.names == ('a "x", b', "c\nd")


def test_cells_and_headers_are_stripped() -> None:
    study = read(' subject , s1,"s2 ",response \n a , 0 ,\t0.5, "equal "\n')
    assert content(study) == {"a": [(0.0, 0.5, 1, 1)]}


def test_extra_and_blank_columns_rows_and_repeated_extra_columns_are_ignored() -> None:
    study = read('x,subject,s1,,x,s2,response,\n\n1,a,0,,"free, text",1,equal,\n  \n,,,,,,,\n,\n2,b,0,,,1,0,\n\n')
    assert content(study) == {"a": [(0.0, 1.0, 1, 1)], "b": [(0.0, 1.0, 0, 1)]}


ORDERED = "subject,s1,s2,response,block,trial\n"


def test_blocks_and_trials_are_kept_in_order_beside_the_counts() -> None:
    study = read(ORDERED + "a,0,1,equal,10,2\nb,0,0,1,x,7\na,0,0,0,9,1\na,0,0,NA,9,2\na,0,0,1,10,1\n")
    assert content(study) == {"a": [(0.0, 0.0, 1, 2), (0.0, 1.0, 1, 1)], "b": [(0.0, 0.0, 1, 1)]}
    answers = study.reading.answers["a"]
    assert answers.blocks == ("10", "9"), "one block is no number: in order of appearance"
    assert answers.keys.tolist() == [[0, 0], [0, 1], [0, 0]]
    assert (answers.n_equal.tolist(), answers.block.tolist(), answers.trials) == ([1, 1, 0], [0, 0, 1], True)
    assert study.reading.ignored == ()
    numbered = read(ORDERED + "a,0,1,1,10,2\na,0,0,0,9,1\na,0,0,1,10,1\n").reading.answers["a"]
    assert (numbered.blocks, numbered.n_equal.tolist()) == (("9", "10"), [0, 1, 1])
    running = read(ORDERED + "a,0,1,1,1,12\na,0,0,0,2,3\na,0,0,0,1,4\n").reading.answers["a"]
    assert (running.n_equal.tolist(), running.block.tolist()) == ([0, 0, 1], [1, 0, 0]), "trials numbered over all blocks"


def test_trials_that_tell_no_order_leave_that_of_the_file_and_are_noted() -> None:
    study = read(ORDERED + "a,0,1,1,1,1\na,0,0,0,1,1\nb,0,0,0,1,x\nc,0,0,0,1,1\n")
    assert study.notes[1:] == ("column trial does not tell the order of all trials, so that of the file stands: a, b",)
    assert study.reading.answers["a"].n_equal.tolist() == [1, 0]
    assert len(read(TRIALS + "a,0,1,equal\n").notes) == 1


def test_trials_that_are_there_twice_are_told() -> None:
    rows = "a,0,1,1,1,1\na,0,0,0,1,2\nb,0,0,0,1,1\n"
    (same,) = read(ORDERED + rows + "b,0,1,NA,1,1\n" + "a,0,0,0,1,2\nb,0,0,0,1,1\n").reading.doubts
    assert "2 rows repeat block and trial of another row with the same stimuli and answer, first row 6, which repeats row 3 (" in same
    (other,) = read(ORDERED + rows + "b,0,0,1,1,1\n").reading.doubts
    assert "1 row repeats block and trial of another row, none with the same stimuli and answer, first row 5" in other
    assert "unless these are several sessions" in other
    unblocked = "subject,s1,s2,response,trial\na,0,1,1,1\na,0,1,1,1\n"
    assert "1 row repeats trial of another row with the same" in read(unblocked).reading.doubts[0]
    for fine in (ORDERED + rows, ORDERED + rows + "a,0,0,0,1,x\na,0,0,0,1,x\n", unblocked + "a,0,0,1,1\n", TRIALS + "a,0,1,1\na,0,1,1\n"):
        assert read(fine).reading.doubts == (), "in another block, without a number, or without blocks they may be other trials"


def test_a_file_that_is_a_copy_of_another_is_told(tmp_path: Path) -> None:
    rows = "".join(f"a,0,{row % 3},{row % 2}\n" for row in range(20))
    texts = {"1.csv": TRIALS + rows, "2.csv": TRIALS + rows.replace("a", "b"), "3.csv": TRIALS + rows, "4.csv": TRIALS + rows + "a,0,0,1\n"}
    paths = [tmp_path / name for name in texts]
    for path, text in zip(paths, texts.values(), strict=True):
        path.write_text(text, encoding="utf-8")
    (told,) = read_study(paths).reading.doubts
    assert told.startswith("3.csv has the same 20 trials of subject a as 1.csv: trials that are there twice")
    assert read_study([paths[0], paths[1], paths[3]]).reading.doubts == ()


def test_counts_have_answers_where_they_have_blocks() -> None:
    study = read("subject,s1,s2,n_equal,n_trials,Run\na,0,1,1,5,1\na,0,1,2,5,2\n", ReadOptions(columns={"block": "Run"}))
    assert content(study) == {"a": [(0.0, 1.0, 3, 10)]}
    answers = study.reading.answers["a"]
    assert (answers.n_equal.tolist(), answers.n_trials.tolist(), answers.blocks, answers.trials) == ([1, 2], [5, 5], ("1", "2"), False)
    assert read(COUNTS + "a,0,1,1,5\n").reading.answers == {}


def test_columns_that_nobody_reads_are_told_by_name() -> None:
    study = read("rt,subject,s1,s2,i1,,response,rt,Block\n1,a,0,1,5,,1,2,3\n")
    assert study.reading.ignored == ("rt", "i1", "Block")
    assert study.reading.read == ("subject", "s1", "s2", "response")
    twice = read("subject,s1,s2,response,block,block\na,0,1,1,1,2\n")
    assert twice.reading.ignored == ("block",), "which of two is meant cannot be told, and no result depends on it"
    assert read("block,s1,s2,response\na,0,1,1\n", ReadOptions(columns={"subject": "block"})).names == ("a",)


def test_a_missing_column_is_told_with_the_spelling_that_the_file_has() -> None:
    (problem,) = refused("Subject,s1,s2,response\na,0,1,1\n")
    assert problem.endswith("allowed: a column of this name, or --columns subject=Subject")
    (problem,) = refused("subject,s1,s2,Answer\na,0,1,1\n")
    assert "or --columns response=Answer;" in problem


def test_header_may_follow_blank_lines_and_rows_keep_their_physical_number() -> None:
    (problem,) = refused(f"\n \n{TRIALS}\na,0,x,equal\n")
    assert problem == "study.csv: row 5, column s2: found 'x', allowed: a finite number"


@pytest.mark.parametrize("text", ["0.25", "+0.25", ".25", "2.5e-1", "25E-2", "0.250", "00.25"])
def test_number_formats(text: str) -> None:
    assert content(read(f"{TRIALS}a,{text},-{text.lstrip('+')},1\n")) == {"a": [(0.25, -0.25, 1, 1)]}


def test_minus_zero_is_zero() -> None:
    study = read(f"{TRIALS}a,-0.0,0,1\na,0,-0,0\n")
    assert content(study) == {"a": [(0.0, 0.0, 1, 2)]}
    assert not np.signbit(study["a"].s1).any()


@pytest.mark.parametrize(("text", "count"), [("5", 5), ("5.0", 5), ("5.", 5), ("+5", 5), ("005", 5), ("5.00", 5)])
def test_count_formats(text: str, count: int) -> None:
    assert content(read(f"{COUNTS}a,0,0,0,{text}\n")) == {"a": [(0.0, 0.0, 0, count)]}


# --- Codes, amplitudes, column names ------------------------------------------------------------------


def test_codes_are_exact() -> None:
    options = ReadOptions(equal_code="f", different_code="J")
    study = read(f"{TRIALS}a,0,0,f\na,0,0, J \na,0,0,f\n", options)
    assert content(study) == {"a": [(0.0, 0.0, 2, 3)]}
    assert study.notes[0].endswith("responses 'f' as equal (2) / 'J' as different (1)")
    for text in ("F", "j", "equal", "1", "0"):
        (problem,) = refused(f"{TRIALS}a,0,0,{text}\n", options)
        assert problem.startswith(f"study.csv: row 2, column response: found {text!r}, allowed: 'f' (equal) or 'J' (different)")


def test_codes_may_turn_the_default_round() -> None:
    study = read(f"{TRIALS}a,0,0,0\na,0,0,1\na,0,0,1\n", ReadOptions(equal_code="0", different_code="1"))
    assert content(study) == {"a": [(0.0, 0.0, 1, 3)]}


def test_one_code_leaves_the_default_words_of_the_other_side() -> None:
    study = read(f"{TRIALS}a,0,0,z\na,0,0,0.0\na,0,0,Different\n", ReadOptions(equal_code="z"))
    assert content(study) == {"a": [(0.0, 0.0, 1, 3)]}
    assert len(refused(f"{TRIALS}a,0,0,equal\n", ReadOptions(equal_code="z"))) == 1
    assert content(read(f"{TRIALS}a,0,0,same\n", ReadOptions(different_code="z"))) == {"a": [(0.0, 0.0, 1, 1)]}


def test_a_code_is_never_also_read_as_its_opposite() -> None:
    # '0' means equal here, so '0.0' must not mean different.
    options = ReadOptions(equal_code="0")
    assert content(read(f"{TRIALS}a,0,0,0\n", options)) == {"a": [(0.0, 0.0, 1, 1)]}
    assert "found '0.0'" in refused(f"{TRIALS}a,0,0,0\na,0,0,0.0\n", options)[0]


def test_a_code_may_be_a_word_for_missing() -> None:
    options = ReadOptions(equal_code="None")
    study = read(f"{TRIALS}a,0,0,None\na,0,0,none\na,0,0,0\n", options)
    assert content(study) == {"a": [(0.0, 0.0, 1, 2)]}, "that very text only"


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"equal_code": "a", "different_code": " a "}, "--different-code: found 'a' as --equal-code"),
        ({"equal_code": "  "}, "--equal-code: found ''"),
        ({"different_code": ""}, "--different-code: found ''"),
        ({"intensity": 0.0}, "--intensity: found 0.0, allowed: a positive finite number"),
        ({"intensity": -0.087}, "--intensity: found -0.087"),
        ({"intensity": math.nan}, "--intensity: found nan"),
        ({"intensity": math.inf}, "--intensity: found inf"),
        ({"columns": {"first": "s1"}}, "--columns: found 'first=s1'"),
        ({"columns": {"s1": " "}}, "--columns: found 's1='"),
        ({"columns": {"s1": "a", "s2": "a"}}, "--columns: found 's2=a', allowed: each name once"),
    ],
)
def test_options_that_make_no_sense_are_refused(options: dict[str, object], problem: str) -> None:
    with pytest.raises(InputError) as caught:
        ReadOptions(**options)  # type: ignore[arg-type]
    assert len(caught.value.problems) == 1
    assert caught.value.problems[0].startswith(problem)


def test_all_problems_of_options_at_once() -> None:
    with pytest.raises(InputError) as caught:
        ReadOptions(intensity=-1, equal_code="", columns={"x": "y"})
    assert len(caught.value.problems) == 3


def test_options_travel_between_processes() -> None:
    options = ReadOptions(0.087, "f", "j", {"s1": "first"})
    assert pickle.loads(pickle.dumps(options)) == options


def test_amplitudes_become_log_intensities() -> None:
    data = "subject,i1,i2,response\na,0.087,0.174,equal\na,0.0435,1e-3,different\n"
    study = read(data, ReadOptions(intensity=0.087))
    assert study["a"].s1.tolist() == pytest.approx([math.log(0.5), 0.0], abs=1e-15)
    assert study["a"].s2.tolist() == pytest.approx([math.log(1e-3 / 0.087), math.log(2.0)], rel=1e-14)
    assert study["a"].s1[1] == 0.0, "the reference itself is exactly 0"
    assert study.notes[1:] == (
        "column i1 read as amplitude in units of 0.087",
        "column i2 read as amplitude in units of 0.087",
    )


def test_extreme_amplitudes_do_not_overflow() -> None:
    study = read("subject,i1,i2,response\na,1e308,1e-308,1\n", ReadOptions(intensity=1e-300))
    assert study["a"].s1[0] == pytest.approx(608 * math.log(10))
    assert study["a"].s2[0] == pytest.approx(-8 * math.log(10))


@pytest.mark.parametrize("text", ["0", "-0.1", "0.0", "1e-999", "nan", "inf", "x", ""])
def test_amplitudes_must_be_positive(text: str) -> None:
    (problem,) = refused(f"subject,i1,i2,response\na,1,{text},1\n", ReadOptions(intensity=2.0))
    assert problem == f"study.csv: row 2, column i2: found {text!r}, allowed: a positive finite number"


def test_stimuli_in_both_units_are_chosen_by_the_option() -> None:
    data = "subject,s1,s2,i1,i2,response\na,5,6,1,2,equal\n"
    assert content(read(data)) == {"a": [(5.0, 6.0, 1, 1)]}
    assert read(data, ReadOptions(intensity=1.0))["a"].s2[0] == math.log(2.0)


def test_columns_under_other_names() -> None:
    data = "participant,s1,first,s2,answer\n01,9,0.1,0.2,equal\n"
    options = ReadOptions(columns=parse_columns("subject=participant,s1=first,response=answer"))
    study = read(data, options)
    assert content(study) == {"01": [(0.1, 0.2, 1, 1)]}
    assert "column first read as s1" in study.notes
    (problem,) = refused(data.replace("0.1", "x"), options)
    assert problem == "study.csv: row 2, column first: found 'x', allowed: a finite number", "named as in the file"


def test_columns_may_be_swapped() -> None:
    study = read(f"{TRIALS}a,1,2,equal\n", ReadOptions(columns={"s1": "s2", "s2": "s1"}))
    assert content(study) == {"a": [(2.0, 1.0, 1, 1)]}


def test_parse_columns() -> None:
    assert parse_columns("subject=participant,s1=first") == {"subject": "participant", "s1": "first"}
    assert parse_columns(" s1 = a b , s2=x=y ") == {"s1": "a b", "s2": "x=y"}


@pytest.mark.parametrize(
    ("text", "found"),
    [
        *((text, repr(text)) for text in ("", "s1", "s1=", "=x", "S1=x", "s3=a")),
        ("s1=a,", "''"),
        ("s1=a,s1=b", "'s1=b'"),
        ("s1=a,s2=a", "'s2=a'"),
    ],
)
def test_parse_columns_refuses(text: str, found: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_columns(text)
    (problem,) = caught.value.problems
    assert problem.startswith(f"--columns: found {found}, allowed: ")
    assert problem.endswith("one of subject, s1, s2, i1, i2, response, n_equal, n_trials, isi, block, trial")


# --- Dialects -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("codec", "label"), [("utf-8", "UTF-8"), ("utf-8-sig", "UTF-8"), ("utf-16", "UTF-16")], ids=lambda text: str(text))
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"], ids=["LF", "CRLF", "CR"])
@pytest.mark.parametrize(("delimiter", "name"), [(",", "comma"), (";", "semicolon"), ("\t", "tab")])
def test_dialects(codec: str, label: str, end: str, delimiter: str, name: str) -> None:
    lines = ["subject,s1,s2,response", "Zoë,0.5,-0.25,equal", "Ω,0,0,0", ""]
    study = read(end.join(lines).replace(",", delimiter).encode(codec))
    assert content(study) == {"Zoë": [(0.5, -0.25, 1, 1)], "Ω": [(0.0, 0.0, 0, 1)]}
    assert study.notes[0].startswith(f"trial rows, {name}-separated, {label}, responses 'equal' (1)")


def test_utf16_big_endian() -> None:
    data = b"\xfe\xff" + f"{TRIALS}Zoë,0,0,equal\n".encode("utf-16-be")
    assert read(data).names == ("Zoë",)


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_decimal_commas(delimiter: str) -> None:
    data = f"{COUNTS}a,0d5,-1d25e-1,1d0,5\na,0.5,d5,0,3d0\n".replace(",", delimiter).replace("d", ",")
    study = read(data)
    assert content(study) == {"a": [(0.5, -0.125, 1, 5), (0.5, 0.5, 0, 3)]}
    assert "decimal comma" in study.notes[0]
    assert "decimal comma" not in read(data.replace(",", ".")).notes[0]


def test_decimal_commas_in_responses() -> None:
    assert content(read("subject;s1;s2;response\na;0;0;1,0\na;0;0;0,0\n")) == {"a": [(0.0, 0.0, 1, 2)]}


@pytest.mark.parametrize("text", ["1.234,5", "1,234.5", "1,2,3", "1.2.3", "1 000", "1'000"])
def test_thousands_separators_are_refused(text: str) -> None:
    (problem,) = refused(f"subject;s1;s2;response\na;{text};0;1\n")
    unclear = ", without thousands separators" if "," in text or "." in text else ""
    assert problem == f"study.csv: row 2, column s1: found {text!r}, allowed: a finite number{unclear}"


def test_decimal_commas_between_commas_are_refused_with_a_hint() -> None:
    (problem,) = refused(f'{TRIALS}a,"0,087",0,1\n')
    assert problem == ("study.csv: row 2, column s1: found '0,087', allowed: a finite number; decimal commas need ';' or tab between cells")


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_quoted_headers(delimiter: str) -> None:
    header = delimiter.join(f'"{name}"' for name in ("subject", "a,b;c\td", "s1", "s2", "response"))
    assert read(f"{header}\n{delimiter.join(('x', 'y', '0', '1', 'equal'))}\n").names == ("x",)


def test_the_delimiter_is_the_one_that_finds_our_columns() -> None:
    assert read("subject;s1;s2;response;a,b,c,d,e,f,g\nx;0;1;equal;y\n").names == ("x",)


# --- Synthetic data -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("marks", "synthetic"),
    [(("1", "1"), True), (("true", "YES"), True), (("1", "0"), False), (("", ""), False), (("1", ""), False)],
)
def test_synthetic_column(marks: tuple[str, str], synthetic: bool) -> None:
    study = read(f"subject,s1,s2,response,synthetic\na,0,0,equal,{marks[0]}\na,0,0,equal,{marks[1]}\n")
    assert study.synthetic is synthetic
    assert any("synthetic" in note for note in study.notes) is ("1" in marks or synthetic)


# --- Refusals: the header -------------------------------------------------------------------------------


def test_missing_columns_are_all_named() -> None:
    problems = refused("id,x,response\na,0,equal\n")
    assert [problem.split(":")[1] for problem in problems] == [
        " row 1, column subject",
        " row 1, column s1",
        " row 1, column s2",
    ]
    assert "found 'id', 'x', 'response'" in problems[0]
    assert problems[0].endswith("--columns subject=NAME; or --subject-from '{}.csv', where the name of the file tells it")


def test_amplitudes_without_a_reference_are_explained() -> None:
    problems = refused("subject,i1,i2,response\na,1,2,equal\n")
    assert len(problems) == 2
    assert problems[0].startswith("study.csv: row 1, column s1: missing, found 'subject', 'i1', 'i2', 'response'")
    assert all("i1, i2 need --intensity REF" in problem for problem in problems)
    assert "--intensity" not in refused("id,i1,i2,s1,s2,response\n")[0], "about the subject"
    assert "--intensity" not in refused("subject,x,y,response\n")[0], "without amplitudes"


def test_log_intensities_with_a_reference_are_explained() -> None:
    problems = refused(f"{TRIALS}a,1,2,equal\n", ReadOptions(intensity=1.0))
    assert len(problems) == 2
    assert all("s1, s2 are read without --intensity" in problem for problem in problems)
    assert "--intensity" not in refused("id,i1,i2,s1,s2,response\n", ReadOptions(intensity=1.0))[0]


def test_neither_responses_nor_counts() -> None:
    (problem,) = refused("subject,s1,s2\na,0,1\n")
    assert problem.startswith("study.csv: row 1, column response: missing")
    assert problem.endswith("or counts in n_equal and n_trials")


@pytest.mark.parametrize(("present", "absent"), [("n_equal", "n_trials"), ("n_trials", "n_equal")])
def test_half_of_the_counts(present: str, absent: str) -> None:
    (problem,) = refused(f"subject,s1,s2,{present}\na,0,1,5\n")
    assert problem.startswith(f"study.csv: row 1, column {absent}: missing")


@pytest.mark.parametrize("counts", ["n_equal", "n_trials", "n_equal,n_trials"])
def test_responses_together_with_counts(counts: str) -> None:
    (problem,) = refused(f"subject,s1,s2,response,{counts}\n")
    assert problem.startswith("study.csv: row 1, column response: found together with n_")


def test_duplicated_needed_column() -> None:
    assert refused("subject,s1,s2,s1,response\na,0,0,0,equal\n") == [
        "study.csv: row 1, column s1: found 2 columns of this name, allowed: one"
    ]


def test_columns_that_the_file_lacks() -> None:
    problems = refused(f"{TRIALS}a,0,0,equal\n", ReadOptions(columns={"s1": "first", "n_trials": "n"}))
    assert [problem.split(",")[1] for problem in problems] == [" column first: missing", " column n: missing"]


def test_one_column_with_two_meanings() -> None:
    assert refused(f"{TRIALS}a,0,0,equal\n", ReadOptions(columns={"s1": "s2"})) == [
        "study.csv: row 1, column s2: found as s1 and as s2, allowed: one meaning per column"
    ]


def test_header_problems_do_not_hide_ragged_rows() -> None:
    problems = refused("subject,s1,response\na,0,equal\nb,0\n")
    assert [problem.split(":")[1] for problem in problems] == [" row 1, column s2", " row 3"]


@pytest.mark.parametrize("data", [b"", b"\n\n", b"  \n", b"\xef\xbb\xbf", b"\xff\xfe"])
def test_empty_files(data: bytes) -> None:
    assert refused(data) == ["study.csv: found an empty file, allowed: a header and at least one row"]


@pytest.mark.parametrize("header", [TRIALS, COUNTS, TRIALS + "\n\n", COUNTS + ",,,\n"])
def test_header_only(header: str) -> None:
    assert refused(header) == ["study.csv: row 1: found a header only, allowed: at least one row below it"]


# --- Refusals: rows ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("row", "cells"), [("a,0,0", "3 cells"), ("a", "1 cell"), ("a,0,0,equal,", "5 cells")])
def test_ragged_rows(row: str, cells: str) -> None:
    assert refused(f"{TRIALS}a,0,0,equal\n{row}\na,0,0,equal\n") == [f"study.csv: row 3: found {cells}, allowed: 4 cells as in the header"]


def test_row_numbers_are_physical_also_after_cells_with_newlines() -> None:
    problems = refused(f'{TRIALS}"a\n\nb",0,0,equal\n\n"c\nd",x,0,equal\na,0\n')
    assert [problem.split(":")[1] for problem in problems] == [" row 6, column s1", " row 8"]


def test_an_open_quote_is_found_where_it_opens() -> None:
    assert refused(f'{TRIALS}a,0,0,equal\n"b,0,0,equal\nc,0,0,equal\n') == [
        "study.csv: row 3: found a quote that is never closed, allowed: quotes around whole cells, doubled inside"
    ]


def test_a_quote_inside_a_cell_does_not_change_a_number() -> None:
    assert refused(f'{TRIALS}a,"1"2,0,equal\n') == [
        "study.csv: row 2: found text after a closing quote, allowed: quotes around whole cells, doubled inside"
    ]


def test_a_giant_cell() -> None:
    (problem,) = refused(f'{TRIALS}"{"x" * 200_000}",0,0,equal\n')
    assert problem.startswith("study.csv: row 2: found a cell of more than 131072 characters")


def test_a_broken_header() -> None:
    assert refused('"subject,s1,s2,response\na,0,0,equal\n') == [
        "study.csv: row 1: found a quote that is never closed, allowed: quotes around whole cells, doubled inside"
    ]


def test_empty_subject() -> None:
    expected = ["study.csv: row 3, column subject: found '', allowed: a text that is not empty"]
    assert refused(f"{TRIALS}a,0,0,equal\n ,0,0,equal\n") == expected
    assert refused(f"{COUNTS}a,0,0,1,2\n ,0,0,1,2\n") == expected
    assert refused(f"{COUNTS}a,0,0,1,2\n ,0,0,0,0\n") == expected


@pytest.mark.parametrize("text", ["abc", "nan", "NaN", "inf", "-inf", "1e999", "1_0", "0x1", "", "1 2", "٣", "½", "\u22121"])
def test_stimuli_must_be_finite_numbers(text: str) -> None:
    (problem,) = refused(f"{TRIALS}a,0,0,equal\na,{text},0,equal\n")
    assert problem == f"study.csv: row 3, column s1: found {text!r}, allowed: a finite number"


@pytest.mark.parametrize("text", ["-1", "2.5", "x", "", "nan", "inf", "9007199254740993", "1" * 5000, "1e3", "5.000", "1,5", "٣"])
@pytest.mark.parametrize("column", ["n_equal", "n_trials"])
def test_counts_must_be_whole_numbers(text: str, column: str) -> None:
    k, n = (f'"{text}"', "9007199254740992") if column == "n_equal" else ("0", f'"{text}"')
    (problem,) = refused(f"{COUNTS}a,0,0,{k},{n}\n")
    assert problem.startswith(f"study.csv: row 2, column {column}: found '{text[:30]}")
    assert problem.endswith("allowed: a whole number from 0 to 2**53, without thousands separators")


def test_the_largest_count() -> None:
    study = read(f"{COUNTS}a,0,0,9007199254740992,9007199254740992\n")
    assert content(study) == {"a": [(0.0, 0.0, 2**53, 2**53)]}


def test_counts_must_add_up_below_the_largest_count() -> None:
    (problem,) = refused(f"{COUNTS}b,0,0,1,2\na,0,0,0,9007199254740992\na,0,1,0,2\n")
    where = "study.csv: row 3, column n_trials"
    assert problem.startswith(f"{where}: found a sum of 9007199254740994 over the rows of subject 'a'")


def test_thousands_in_counts_are_not_read_as_decimals() -> None:
    # 12.000 is twelve in English and twelve thousand in German.
    (problem,) = refused("subject;s1;s2;n_equal;n_trials\na;0;0;5;12.000\n")
    assert problem.startswith("study.csv: row 2, column n_trials: found '12.000'")


def test_more_equal_than_trials() -> None:
    assert refused(f"{COUNTS}a,0,0,2,2\na,0,1,6,5\n") == ["study.csv: row 3, column n_equal: found '6', allowed: 0 to n_trials = 5"]
    assert refused(f"{COUNTS}a,0,0,2,2\na,0,1,1,0\n") == ["study.csv: row 3, column n_equal: found '1', allowed: 0 to n_trials = 0"]


def test_two_wrong_counts_do_not_cancel() -> None:
    assert len(refused(f"{COUNTS}a,0,0,7,5\na,0,0,0,5\n")) == 1


def test_subjects_without_any_trial_in_counts() -> None:
    problems = refused(f"{COUNTS}a,0,0,1,2\nb,0,0,0,0\nb,0,1,0,0\nc,0,0,0,0\n")
    assert problems == [
        f"study.csv: row {row}, column n_trials: found 0 in all rows of subject '{name}', allowed: 1 to 2**53 trials per subject"
        for row, name in ((3, "b"), (5, "c"))
    ]


def test_all_problems_at_once_in_the_order_of_rows() -> None:
    problems = refused(f"{TRIALS}a,x,0,equal\n,0,0,equal\na,0,y,maybe\na,0\na,0,0,equal\nb,,z,\n")
    assert [problem.split(": ")[1] for problem in problems] == [
        "row 2, column s1",
        "row 3, column subject",
        "row 4, column s2",
        "row 4, column response",
        "row 5",
    ]


@pytest.mark.parametrize(("count", "last"), [(11, "... and 1 more problem"), (45, "... and 35 more problems")])
def test_ten_problems_are_shown_and_the_others_counted(count: int, last: str) -> None:
    problems = refused(TRIALS + "a,x,0,equal\n" * (count - 1) + "a,0,0,maybe\n")
    assert problems[-1] == last
    assert [problem.split(",")[0] for problem in problems[:-1]] == [f"study.csv: row {row}" for row in range(2, 12)]


def test_ten_problems_are_all_shown() -> None:
    assert len(refused(TRIALS + "a,x,y,equal\n" * 5)) == 10


def test_found_texts_are_cut() -> None:
    (problem,) = refused(f"{TRIALS}a,{'x' * 5000},0,equal\n")
    found = problem.split("found ")[1].split(", allowed")[0]
    assert len(found) == 40
    assert found.startswith("'xxx")
    assert found.endswith("x...'")


def test_control_characters_do_not_reach_the_terminal() -> None:
    (problem,) = refused(f'{TRIALS}a,"\x1b[31m\n",0,equal\n')
    assert problem.isprintable()


# --- Refusals: files ----------------------------------------------------------------------------------------


def test_unreadable_paths(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file.txt").write_text("x")
    for path in (tmp_path / "missing.csv", tmp_path, tmp_path / "file.txt" / "x.csv", "nul\0l.csv"):
        with pytest.raises(InputError, match="cannot be read") as caught:
            read_study(path)
        assert len(caught.value.problems) == 1
        assert str(caught.value).isprintable()

    def forbidden(*_: object, **__: object) -> bytes:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", forbidden)
    with pytest.raises(InputError, match=r"study\.csv: cannot be read \(Permission denied\)"):
        read_study((tmp_path / "file.txt").rename(tmp_path / "study.csv"))


def test_invalid_utf8_names_byte_and_row() -> None:
    data = TRIALS.encode() + b"a,0,0,equal\r\nZo\xeb,0,0,equal\n"
    (problem,) = refused(data)
    assert problem.startswith(f"study.csv: row 3: found byte 0xeb at offset {data.index(0xEB)}, not UTF-8")
    (problem,) = refused(b"\xef\xbb\xbf" + data)
    assert f"offset {3 + data.index(0xEB)}," in problem


def test_truncated_utf16() -> None:
    data = f"{TRIALS}a,0,0,equal".encode("utf-16")[:-1]
    (problem,) = refused(data)
    assert problem.startswith(f"study.csv: row 2: found byte 0x6c at offset {len(data) - 1}, not UTF-16")


def test_nul_bytes() -> None:
    (problem,) = refused(TRIALS.encode() + b"a\0,0,0,equal\n")
    assert problem.startswith("study.csv: row 2: found a NUL character at offset 24, allowed: text in UTF-8")
    (problem,) = refused(b"\0")
    assert problem.startswith("study.csv: row 1: found a NUL character at offset 0,")
    (problem,) = refused(TRIALS.encode("utf-16-le"))
    assert problem.startswith("study.csv: row 1: found a NUL character at offset 1,"), "UTF-16 without its mark"


def test_file_names_are_shown_on_one_line(tmp_path: Path) -> None:
    path = tmp_path / "my\nstudy.csv"
    path.write_text(f"{TRIALS}a,x,0,equal\n")
    with pytest.raises(InputError) as caught:
        read_study(path)
    assert len(str(caught.value).splitlines()) == 1


# --- Properties ---------------------------------------------------------------------------------------------

# No bare carriage return: the csv module of Python before 3.13 writes it without quotes, which ends a row.
_names = st.text(min_size=1, max_size=8).map(str.strip).filter(lambda name: name != "" and not set("\0\r") & set(name))
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
def test_any_dialect_gives_the_same_study(
    trials: list[tuple[str, float, float, bool]], delimiter: str, comma: bool, codec: str, end: str, quoting: int
) -> None:
    text = io.StringIO(newline="")
    writer = csv.writer(text, delimiter=delimiter, lineterminator=end, quoting=quoting)  # type: ignore[arg-type]
    writer.writerow(["response", "s2", "extra", "subject", "s1"])
    for name, s1, s2, equal in trials:
        first, second = (f"{value!r}" for value in (s1, s2))
        if comma and delimiter != ",":
            first, second = first.replace(".", ","), second.replace(".", ",")
        writer.writerow(["equal" if equal else "different", second, "x;y,z\t", name, first])
    names = list(dict.fromkeys(name for name, *_ in trials))
    subjects = (Subject.from_trials(name, *zip(*(rest for who, *rest in trials if who == name), strict=True)) for name in names)
    study = read(text.getvalue().encode(codec))
    assert content(study) == content(Study(tuple(subjects)))
    assert list(study.names) == names


def _only_a_study_or_an_input_error(data: bytes, options: ReadOptions | None = None) -> None:
    try:
        study = read(data, options)
    except InputError as error:
        problems = error.problems
    else:
        problems = ()
        assert len(study) >= 1
        assert all(note.isprintable() for note in study.notes)
    assert len(problems) <= 11
    assert all(len(problem.splitlines()) == 1 for problem in problems)


@FUZZ
@given(st.binary(max_size=200))
@example(b"\xff\xfe\x00")
@example(b"\xff\xfe\x00\xd8")
def test_any_bytes(data: bytes) -> None:
    _only_a_study_or_an_input_error(data)
    _only_a_study_or_an_input_error(TRIALS.encode() + data)


_cells = st.one_of(
    st.sampled_from(["", "0", "1", "0.5", "0,5", "equal", "NA", "nan", "inf", "-1", "1e400", "9" * 400, '"', "a", " "]),
    st.text(max_size=5),
)
_headers = st.sampled_from(
    [
        TRIALS,
        COUNTS,
        COUNTS.replace(",", ";"),
        "subject,i1,i2,response\n",
        "subject\ts1\ts2\tresponse\tsynthetic\n",
        "\ufeff\n",
    ]
)


@FUZZ
@given(
    header=_headers,
    rows=st.lists(st.lists(_cells, min_size=3, max_size=6), max_size=8),
    quoted=st.booleans(),
    intensity=st.sampled_from([None, 0.087]),
    equal_code=st.sampled_from([None, "a", "NA", "0"]),
)
def test_any_cells(header: str, rows: list[list[str]], quoted: bool, intensity: float | None, equal_code: str | None) -> None:
    delimiter = next((sign for sign in ";\t" if sign in header), ",")
    body = "\n".join(delimiter.join('"' + cell.replace('"', '""') + '"' if quoted else cell for cell in row) for row in rows)
    options = ReadOptions(intensity=intensity, equal_code=equal_code)
    _only_a_study_or_an_input_error((header + body).encode("utf-8", "replace"), options)


def _calls(text: str) -> int:
    """How many functions are called, in Python or in C, while this text is read."""
    count = 0

    def hook(_frame: object, event: str, _argument: object) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    sys.setprofile(hook)
    try:
        read(text)
    finally:
        sys.setprofile(None)
    return count


def test_twice_the_rows_are_twice_the_work_and_each_distinct_text_is_converted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = "S01,0.1,0.2,equal\nS02,0.2,0.1,different\n"
    few, some, many = (_calls(TRIALS + rows * times) for times in (1, 1000, 2000))
    assert many - some == pytest.approx(some - few, rel=0.01)
    assert some - few < 50 * 2000  # some calls a row, one or two a cell
    converted: list[str] = []
    monkeypatch.setattr(columns, "number", lambda text, comma: converted.append(text) or cells.number(text, comma))
    study = read(TRIALS + rows * 50_000)
    assert sorted(converted) == ["0.1", "0.1", "0.2", "0.2"]
    assert content(study) == {"S01": [(0.1, 0.2, 50_000, 50_000)], "S02": [(0.2, 0.1, 0, 50_000)]}


class Steps:
    """A backtracking matcher on the parsed expression, as in `re`, that counts how often it tries something."""

    def __init__(self, pattern: re.Pattern[str], text: str) -> None:
        self.text, self.count = text, 0
        tree = list(re._parser.parse(pattern.pattern, pattern.flags))  # type: ignore[attr-defined]
        self.matched = any(end == len(text) for end in self._sequence(tree, 0))

    def _sequence(self, nodes: list[Any], start: int) -> Iterator[int]:
        """Where a match of these nodes from here may end, in the order in which they are tried."""
        self.count += 1
        if not nodes:
            yield start
            return
        for end in self._node(*nodes[0], start):
            yield from self._sequence(nodes[1:], end)

    def _node(self, kind: object, argument: Any, start: int) -> Iterator[int]:
        name = str(kind)
        if name in ("SUBPATTERN", "BRANCH"):
            for alternative in argument[1] if name == "BRANCH" else argument[-1:]:
                yield from self._sequence(list(alternative), start)
        elif name == "MAX_REPEAT":
            yield from self._repeat(*argument, start)
        elif name == "ASSERT_NOT":
            yield from [start] * (next(self._sequence(list(argument[1]), start), None) is None)
        elif name == "AT":
            yield from [start] * (start == len(self.text))
        else:
            yield from [start + 1] * (start < len(self.text) and self._holds(name, argument, self.text[start]))

    def _repeat(self, least: int, most: int, body: Any, start: int) -> Iterator[int]:
        """The longest first; what is repeated more than once is one character wide."""
        assert most == 1 or body.getwidth() == (1, 1)
        if most == 1:
            yield from self._sequence(list(body), start)
            yield from [start] * (least == 0)
            return
        ends = [start]
        while len(ends) <= most and (end := next(self._sequence(list(body), ends[-1]), None)) is not None:
            ends.append(end)
        yield from reversed(ends[least:])

    @staticmethod
    def _holds(name: str, argument: Any, sign: str) -> bool:
        if name == "LITERAL":
            return sign == chr(argument)
        assert name == "IN"
        digits = any(str(value) == "CATEGORY_DIGIT" for _, value in argument)
        return (digits and sign in "0123456789") or sign in [chr(value) for kind, value in argument if str(kind) == "LITERAL"]


@pytest.mark.parametrize(
    "text", ["", "1", "-1.5e3", ".5", ".", "5.", "5.0", "5.000", "5.0000", "+007", "1e", "1" * 17, "0" * 30 + "12x", "1,0"]
)
def test_the_counted_matcher_is_that_of_the_library(text: str) -> None:
    for pattern in (cells._NUMBER, cells._COUNT, read_study_module._SWITCH):
        assert Steps(pattern, text).matched == (pattern.fullmatch(text) is not None), pattern


def test_a_hopeless_number_costs_linear_work() -> None:
    def growth(pattern: re.Pattern[str], digit: str, sign: str) -> float:
        few, many = (Steps(pattern, digit * n + sign + digit * n + "x").count for n in (100, 200))
        return many / few

    for pattern in (cells._NUMBER, cells._COUNT, read_study_module._SWITCH):
        for digit in "01":
            for sign in ("", ".", "e"):
                assert growth(pattern, digit, sign) < 2.1, (pattern, digit, sign)
    assert growth(re.compile(r"\d*\d*"), "1", "") > 3.5  # what the reader must not do is seen
    refused(f"{COUNTS}a,{'1' * 120_000}x,{'0' * 120_000}x,{'0' * 120_000}x,{'0' * 120_000}\n")


def test_of_several_files_the_problems_of_the_first_are_all_told_and_the_other_files_counted(tmp_path: Path) -> None:
    for name, rows in {"a": 12, "b": 3, "c": 3}.items():
        (tmp_path / f"{name}.csv").write_text(TRIALS + "a,x,0,equal\n" * rows, encoding="utf-8")
    files = [tmp_path / f"{name}.csv" for name in "abc"]
    for asked, last in (
        (files[:1], "... and 2 more problems"),
        (files, "... and problems in 2 more files"),
        (files[1:], "c.csv: row 4, column s1: found 'x', allowed: a finite number"),
    ):
        with pytest.raises(InputError) as refusal:
            read_study(asked)
        assert refusal.value.problems[-1] == last
