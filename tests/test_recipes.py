"""docs/how_to.md is run: the commands and programs of reading files, section by section, on files made up here as other programs write them."""

import re
import shlex
from contextlib import chdir
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import good, inside, refused
from scipy.io import savemat

import bayes_toe as bt

PAGE = Path(__file__).resolve().parents[1] / "docs" / "how_to.md"
PAIRS = [(0.087, 0.087), (0.087, 0.12), (0.12, 0.087), (0.12, 0.12)]


def psychopy(folder):
    for who in ("P1", "P2"):
        rows = [
            f"{a},{b},{i},{key},0.61,{who},same_or_different"
            for i, ((a, b), key) in enumerate(zip(PAIRS, "fjjf", strict=True))
        ]
        lines = [
            "first_g,second_g,trials.thisN,key_resp.keys,key_resp.rt,participant,expName",
            f",,,,,{who},same_or_different",
            *rows,
        ]
        write(
            folder / "data" / f"{who}_2026.csv",
            [*lines, f"0.087,0.12,4,None,,{who},same_or_different"],
        )


def jspsych(folder):
    rows = [f'"600","{key}","html-keyboard-response","{i + 1}","7","comparison","{a}","{b}"' for i, (a, b, key) in
            enumerate([(0, 0, "s"), (0, 0.3, "d"), (0.3, 0, "s"), (0.3, 0.3, "null")])]  # fmt: skip
    header = '"rt","response","trial_type","trial_index","participant_id","task","s1","s2"'
    write(
        folder / "jspsych.csv",
        [header, '"1234"," ","html-keyboard-response","0","7","instructions","",""', *rows],
    )


def which_was_stronger(folder):
    keys = [
        (0.087, 0.12, "right"),
        (0.12, 0.087, "left"),
        (0.12, 0.15, "right"),
        (0.15, 0.12, "None"),
    ]
    rows = [f"{a},{b},{i},{key},0.61,P1" for i, (a, b, key) in enumerate(keys)]
    write(
        folder / "data" / "P1_2026.csv",
        ["first_g,second_g,trials.thisN,key_resp.keys,key_resp.rt,participant", *rows],
    )


def right_or_wrong(folder):
    rows = [
        f'"{a}","{b}","{right}","comparison","7"'
        for a, b, right in ((0, 0.3, "true"), (0.3, 0, "false"), (0.3, 0.3, "true"))
    ]
    write(folder / "jspsych.csv", ['"s1","s2","correct","task","participant_id"', *rows])


def wide_tables(folder):
    write(
        folder / "wide.csv",
        [
            "subject,equal_0_0,equal_0_0.3,equal_0.3_0,equal_0.3_0.3",
            "01,46,20,12,45",
            "02,48,31,9,47",
        ],
    )


def standards(folder):
    rows = [
        f"a,0,{comparison},{interval},{word}"
        for comparison, interval, word in (
            (0.3, 1, "comparison"),
            (0.3, 2, "comparison"),
            (-0.3, 1, "standard"),
            (-0.3, 2, "comparison"),
        )
    ]
    write(folder / "standards.csv", ["subject,standard,comparison,interval,response", *rows])


def several_files(folder):
    for name in ("A_session1", "A_session2", "B_session1"):
        write(
            folder / "sessions" / f"{name}.csv",
            ["s1;s2;response", "0;0,3;same", "0,3;0;different", "0;0;same"],
        )


def proportions(folder):
    rows = ["A,0,0.3,0.9,10", "A,0.3,0,0.2,10"]
    write(folder / "shares.csv", ["subject,s1,s2,p_second,n", *rows])


def folder_of_tables(folder):
    for name in ("A", "B"):
        write(folder / "data" / f"{name}.csv", ["subject,s1,s2,response", f"{name},0,0.3,second"])
        write(folder / "data" / f"{name}.log", ["12.3 EXP"])


def bids(folder):
    for who in ("01", "02"):
        rows = [
            "0.0\t0.3\tn/a\tn/a\tinstruction\tn/a",
            "2.1\t0.7\t0.0\t0.3\tcomparison\tsame",
            "4.5\t0.7\t0.3\t0.0\tcomparison\tn/a",
        ]
        write(folder / "bids" / f"sub-{who}" / "beh" / f"sub-{who}_task-same_events.tsv",
              ["onset\tduration\tfirst\tsecond\ttrial_type\tresponse", *rows])  # fmt: skip


def matlab(folder):
    (folder / "matlab").mkdir()
    amplitudes = np.array(PAIRS)
    same = np.array([True, False, False, True])
    savemat(
        folder / "matlab" / "one.mat",
        {"subject": "M1", "amp1": amplitudes[:, 0], "amp2": amplitudes[:, 1], "same": same},
    )
    trials = np.array(
        [(3.0, a, b, k) for (a, b), k in zip(PAIRS, same, strict=True)],
        [(x, "O") for x in ("subject", "amp1", "amp2", "same")],
    )
    savemat(folder / "matlab" / "two.mat", {"trials": trials})
    savemat(folder / "nested.mat", {"session": {"log": {"amp": amplitudes, "same": same}}})


def write(path, lines):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


SECTIONS = {
    "A standard and a comparison": (standards, ["1 subject, 4 trials", "which was stronger"]),
    "PsychoPy": (
        psychopy,
        [
            "2 subjects, 8 trials",
            "2 trials without a response dropped",
        ],
    ),
    "jsPsych": (
        jspsych,
        [
            "1 subject, 3 trials",
            "1 trial without a response dropped: 7 1",
        ],
    ),
    "Which was stronger?": (which_was_stronger, ["1 subject, 3 trials", "'right' as second (2)"]),
    "Right or wrong": (right_or_wrong, ["1 subject, 2 trials"]),
    "Proportions": (proportions, ["1 subject, 20 trials", "Column p_second read as shares of n."]),
    "Wide tables": (wide_tables, {"names": ("01", "02"), "total": 400}),
    "Excel": (lambda folder: None, []),
    "A folder": (folder_of_tables, ["folder data: 2 .csv files read", "2 subjects, 2 trials"]),
    "Several files a subject": (
        several_files,
        ["2 subjects, 9 trials", "1 subject in several files, put together: A 2"],
    ),
    "BIDS": (
        bids,
        [
            "2 subjects, 2 trials",
            "2 files, such as sub-01_task-same_events.tsv: 1 trial without a response dropped",
        ],
    ),
    "MATLAB": (matlab, ["2 subjects, 8 trials", "MATLAB", {"names": ("S07",), "total": 4}]),
    "Leave-one-out": (lambda folder: None, {"names": ("S06",), "total": 650}),
}


def sections():
    """The sections about files of other programs, and that about leave-one-out."""
    page = PAGE.read_text(encoding="utf-8")
    files = page[: page.index("## Check the data")]
    parts = re.split(r"^### (.*)$", files, flags=re.MULTILINE)
    found = dict(zip(parts[1::2], parts[2::2], strict=True))
    _, title, rest = page.partition("## Leave-one-out")
    return {**found, title.removeprefix("## "): rest.partition("\n## ")[0]}


@pytest.mark.filterwarnings("ignore:Estimated shape parameter of Pareto")  # by ArviZ, and said
@pytest.mark.parametrize("name", SECTIONS)
def test_a_recipe_works_as_it_stands(name, tmp_path):
    assert list(sections()) == list(SECTIONS)
    made, expected = SECTIONS[name]
    made(tmp_path)
    wanted = [expected] if isinstance(expected, dict) else list(expected)
    for language, block in re.findall(
        r"^```(\w+)\n(.*?)^```", sections()[name], flags=re.MULTILINE | re.DOTALL
    ):
        if language == "python":
            known = {}
            with chdir(tmp_path):
                exec(block, known)
            study, about = known["study"], wanted.pop()
            assert (study.names, sum(one.total_trials for one in study)) == (
                about["names"],
                about["total"],
            )
            continue
        for line in block.replace("\\\n", " ").splitlines():
            program, *words = shlex.split(line)
            assert program == "bayes-toe"
            said = " ".join(good(*words, cwd=tmp_path).split())
            assert [one for one in wanted if isinstance(one, str) and one not in said] == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--where", "task"), "--where: found 'task', allowed: COLUMN=TEXT, each name once"),
        (
            ("--where", "task=compare"),
            "column task: found 'instructions', 'comparison', allowed: 'compare', as --where has it",
        ),
        (
            ("--subject-from", "sub-{}.csv"),
            "found no subject in its name, allowed: a file named as --subject-from sub-{}.csv",
        ),
        (("jspsych.csv",), "jspsych.csv: found twice, allowed: each file once"),
        (("none*.csv",), "none*.csv: cannot be read (No such file or directory)"),
    ],
    ids=lambda words: " ".join(words) if isinstance(words, tuple) else "",
)
def test_a_wrong_option_is_one_line(words, said, tmp_path):
    jspsych(tmp_path)
    names = () if "--subject-from" in words else ("--columns", "subject=participant_id")
    assert said in refused(
        "check",
        "jspsych.csv",
        *words,
        *names,
        "--equal-code",
        "s",
        "--different-code",
        "d",
        cwd=tmp_path,
    )


def test_problems_of_all_files_come_together(tmp_path):
    for folder in ("a", "b"):
        write(tmp_path / folder / "s.csv", ["subject,s1,s2,response", f"{folder},0,x,same"])
    done = inside("check", "a/s.csv", "b/s.csv", cwd=tmp_path)
    lines = [
        f"error: {folder}/s.csv: row 2, column s2: found 'x', allowed: a finite number"
        for folder in ("a", "b")
    ]
    assert done.stderr.splitlines() == lines


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            {"a": {"x": [1.0, 2.0]}, "b": {"x": [1.0]}},
            "found the structs a, b, allowed: one struct",
        ),
        ({"s1": [1.0, 2.0], "s2": [1.0, 2.0, 3.0]}, "found s1, not a column of 3"),
        (
            {"s1": [0.0, 1.0], "s2": [1.0, np.nan], "response": ["same", "same"], "subject": 7},
            "row 2, column s2: found '', allowed: a finite number",
        ),
    ],
    ids=["two structs", "lengths", "row"],
)
def test_other_matlab_files_are_refused(content, said, tmp_path):
    savemat(tmp_path / "t.mat", content)
    assert said in refused("check", "t.mat", cwd=tmp_path)


def test_blocks_of_a_subject_are_the_files(tmp_path):
    several_files(tmp_path)
    paths = sorted((tmp_path / "sessions").glob("*.csv"))
    study = bt.read_study(paths, bt.ReadOptions(subject_from="{}_session*.csv"))
    assert study["A"].answers.blocks == ("A_session1.csv", "A_session2.csv")
    assert study["A"].answers.block.tolist() == [0] * 3 + [1] * 3
    assert study.source == "3 files, A_session1.csv to B_session1.csv"
    frames = [
        pd.read_csv(path, sep=";", decimal=",").assign(subject=path.name[0]) for path in paths
    ]
    pd.testing.assert_frame_equal(bt.read_study(frames).frame(), study.frame())
