"""Recipes of docs/how_to.md run as they stand, on files as other programs write them."""

import re
from contextlib import chdir
from pathlib import Path

import numpy as np
import pytest
from commands import on_one_line, run_ok
from scipy.io import savemat

PAGE = Path(__file__).resolve().parents[1] / "docs" / "how_to.md"
PAIRS = [(0.087, 0.087), (0.087, 0.12), (0.12, 0.087), (0.12, 0.12)]


PSYCHOPY = """\
first_g,second_g,trials.thisN,key_resp.keys,key_resp.corr,key_resp.rt,participant,expName
,,,,,,NAME,same_or_different
"""
# Stimuli, keys and scores; the key of 'same' is f.
for trial, cells in enumerate(
    (
        "87,87,N,f,1",
        "87,120,N,j,1",
        "120,87,N,j,1",
        "120,120,N,j,0",
        "87,87,N,f,1",
        "87,120,N,None,0",
    )
    * 8
):
    PSYCHOPY += f"{cells.replace('N,', f'{trial},')},0.61,NAME,same_or_different\n"
JSPSYCH = """\
"rt","response","trial_type","trial_index","participant_id","task","s1","s2"
"1234"," ","html-keyboard-response","0","7","instructions","",""
"600","s","html-keyboard-response","1","7","comparison","0","0"
"600","d","html-keyboard-response","2","7","comparison","0","0.3"
"600","d","html-keyboard-response","3","7","comparison","0.3","0"
"600","null","html-keyboard-response","4","7","comparison","0.3","0.3"
"""
RIGHT_OR_WRONG = """\
"s1","s2","correct","task","participant_id"
"0","0.3","true","comparison","7"
"0.3","0","false","comparison","7"
"0.3","0.3","true","comparison","7"
"""
SHARES = "subject,s1,s2,p_second,n\nA,0,0.3,0.9,10\nA,0.3,0,0.2,10\n"
WIDE = """\
subject,n_trials,equal_0_0,equal_0_0.3,equal_0.3_0,equal_0.3_0.3
01,50,46,20,12,45
02,50,48,31,9,47
"""
SURVEY = """\
subject,age,Q1_100_112,Q2_112_100,Q3_100_112
01,23,second,first,first
02,31,first,,second
"""
CELLS = "subject,pair,response\n01,100 vs 112,second\n02,112 vs 100,first\n"
STANDARDS = """\
subject,standard,comparison,interval,response
a,0,0.3,1,comparison
a,0,0.3,2,comparison
a,0,-0.3,1,standard
a,0,-0.3,2,comparison
"""
FOLDER = {
    "data/A.csv": "subject,s1,s2,response\nA,0,0.3,second\n",
    "data/B.csv": "subject,s1,s2,response\nB,0,0.3,second\n",
    "data/A.log": "12.3 EXP\n",
    "data/B.log": "12.3 EXP\n",
}
SESSION = "s1;s2;response\n0;0,3;same\n0,3;0;different\n0;0;same\n"
SESSIONS = {f"sessions/{name}.csv": SESSION for name in ("A_session1", "A_session2", "B_session1")}
EVENTS = """\
onset\tduration\tfirst\tsecond\ttrial_type\tresponse
0.0\t0.3\tn/a\tn/a\tinstruction\tn/a
2.1\t0.7\t0.0\t0.3\tcomparison\tsame
4.5\t0.7\t0.3\t0.0\tcomparison\tn/a
"""
#: The files of each recipe by its heading, and what the screen says of them.
RECIPES = {
    "A standard and a comparison": (
        {"standards.csv": STANDARDS},
        "1 subject, 4 trials",
        "which was stronger",
    ),
    "PsychoPy": (
        {
            "data/P1_2026.csv": PSYCHOPY.replace("NAME", "P1"),
            "data/P2_2026.csv": PSYCHOPY.replace("NAME", "P2"),
        },
        "2 subjects, 80 trials",
        "16 trials without a response dropped",
    ),
    "jsPsych": (
        {"jspsych.csv": JSPSYCH},
        "1 subject, 3 trials",
        "1 trial without a response dropped: 7 1",
    ),
    "Right or wrong": ({"jspsych.csv": RIGHT_OR_WRONG}, "1 subject, 2 trials"),
    "Proportions": (
        {"shares.csv": SHARES},
        "1 subject, 20 trials",
        "Column p_second read as shares of n.",
    ),
    "Wide tables": (
        {"survey.csv": SURVEY},
        "2 subjects, 5 trials",
        "Pairs read from names of 3 columns",
    ),
    "Wide tables of counts": ({"wide.csv": WIDE}, "2 subjects, 400 trials"),
    "Pairs in one cell": ({"cells.csv": CELLS}, "Pairs read from column pair"),
    "A folder": (FOLDER, "folder data: 2 .csv files read", "2 subjects, 2 trials"),
    "Several files a subject": (
        SESSIONS,
        "2 subjects, 9 trials",
        "1 subject in several files, put together (for conditions, add a column): A 2",
    ),
    "BIDS": (
        {f"bids/sub-{name}/beh/sub-{name}_task-same_events.tsv": EVENTS for name in ("01", "02")},
        "2 subjects, 2 trials",
        "2 rows without a response dropped: 01 1, 02 1",
    ),
    "MATLAB": ({}, "2 subjects, 8 trials", "MATLAB"),
    "Leave-one-out": ({},),
}
#: Names of the subjects and the number of trials of the study that a program has.
STUDIES = {
    "MATLAB": (("S07",), 4),
    "Leave-one-out": (("S06",), 650),
}


def write_files(folder, files):
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def write_matlab(folder):
    (folder / "matlab").mkdir()
    first, second = np.transpose(PAIRS)
    identical = np.array([True, False, False, True])
    columns = {"subject": "M1", "amp1": first, "amp2": second, "same": identical}
    savemat(folder / "matlab" / "one.mat", columns)
    fields = [(name, "O") for name in columns]
    rows = np.array([(3.0, *row) for row in zip(first, second, identical, strict=True)], fields)
    savemat(folder / "matlab" / "two.mat", {"trials": rows})
    savemat(
        folder / "nested.mat", {"session": {"log": {"amp": np.array(PAIRS), "same": identical}}}
    )


def recipe_by_heading():
    """The recipes of the page by their headings: those for files of other programs, and one more.

    That is leave-one-out, a section of its own.
    """
    page = PAGE.read_text(encoding="utf-8")
    files = page[: page.index("## Check the data")]
    _, *parts = re.split(r"^### (.*)$", files, flags=re.MULTILINE)
    _, title, text = page.partition("## Leave-one-out")
    parts += [title.removeprefix("## "), text.partition("\n## ")[0]]
    return dict(zip(parts[::2], parts[1::2], strict=True))


def blocks_of(section):
    """The language and the content of each block in a section."""
    return re.findall(r"^```(\w+)\n(.*?)^```", section, flags=re.MULTILINE | re.DOTALL)


@pytest.mark.filterwarnings("ignore:Estimated shape parameter of Pareto")  # as the page says
@pytest.mark.parametrize("name", RECIPES)
def test_a_recipe_works_as_it_stands(name, tmp_path):
    # RECIPES has the files of a recipe, and what the screen of its commands says of them.
    files, *sentences = RECIPES[name]
    write_files(tmp_path, files)
    if name == "MATLAB":
        write_matlab(tmp_path)
    for language, block in blocks_of(recipe_by_heading()[name]):
        if language == "python":
            # The block makes a study, with the subjects and the trials that STUDIES has.
            names = {}
            with chdir(tmp_path):
                exec(block, names)
            study = names["study"]
            n_trials = sum(subject.total_trials for subject in study)
            assert (study.names, n_trials) == STUDIES[name]
            continue
        for line in block.replace("\\\n", " ").splitlines():
            program, _, words = line.partition(" ")
            assert program == "bayes-toe"
            screen = on_one_line(run_ok(words, cwd=tmp_path))
            assert [sentence for sentence in sentences if sentence not in screen] == []


def test_every_recipe_is_run():
    # The headings of the page are the keys of RECIPES, in the same order.
    assert list(recipe_by_heading()) == list(RECIPES)
