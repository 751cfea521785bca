"""'Which was stronger?' beside 'same or different?': words tell the task, numbers never do.

What is read, refused, doubted.
"""

import numpy as np
import pandas as pd
import pytest
from commands import refused
from scipy.io import savemat
from scipy.special import ndtr

import bayes_toe as bt
from bayes_toe.checks.answer_checks import check_answers
from bayes_toe.data.tasks import WHICH_STRONGER

TRIALS, RIGHT, TASK = "subject,s1,s2,response", "subject,s1,s2,acc", "subject,s1,s2,response,task"
COUNTS = "subject,s1,s2,n_second,n_trials"
GRID = [(a, b) for a in (-0.4, -0.2, 0.0, 0.2, 0.4) for b in (-0.4, -0.2, 0.0, 0.2, 0.4)]


def written(folder, head, *rows):
    path = folder / "study.csv"
    path.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    return path


READ = [
    (
        TRIALS,
        ["a,0,1,second", "a,0,1,S1", "a,1,0,2nd", "a,1,0,FIRST", "a,1,0,"],
        {},
        [1, 1],
        [2, 2],
    ),
    (
        TRIALS,
        ["a,0,1,1", "a,0,1,0.0", "a,1,0,1.0", "a,1,0,NA"],
        {"second_code": "1"},
        [1, 1],
        [2, 1],
    ),
    (TRIALS, ["a,0,1,2", "a,0,1,1", "a,1,0,2"], {"second_code": "2"}, [1, 1], [2, 1]),
    (TRIALS, ["a,0,1,True", "a,1,0,False"], {"second_code": "True"}, [1, 0], [1, 1]),
    (TRIALS, ["a,0,1,j", "a,1,0,f"], {"second_code": "j", "first_code": "f"}, [1, 0], [1, 1]),
    (
        TRIALS,
        ["a,0,1,second", "a,1,0,first"],
        {"second_code": "first", "first_code": "second"},
        [0, 1],
        [1, 1],
    ),
    (COUNTS, ["a,0,1,3,5", "a,1,0,1,5"], {}, [3, 1], [5, 5]),
    (COUNTS.replace("n_second", "k"), ["a,0,1,3,5"], {"columns": {"n_second": "k"}}, [3], [5]),
    (
        RIGHT,
        ["a,0,1,1", "a,0,1,0", "a,1,0,1", "a,1,0,wrong", "a,0,0,1", "a,0,1,"],
        {"correct": "acc"},
        [1, 1],
        [2, 2],
    ),
    (
        TASK,
        ["a,0,1,second,2AFC", "a,0,1,same,same-different"],
        {"where": {"task": "2AFC"}},
        [1],
        [1],
    ),
    (TASK, ["a,0,1,second,comparison", "a,1,0,first,practice"], {}, [1, 0], [1, 1]),
]


@pytest.mark.parametrize(
    ("head", "rows", "options", "n_yes", "n_trials"), READ, ids=range(len(READ))
)
def test_answers_second_and_first_are_read(tmp_path, head, rows, options, n_yes, n_trials):
    study = bt.read_study(written(tmp_path, head, *rows), bt.ReadOptions(**options))
    assert study.task == WHICH_STRONGER
    assert (study["a"].n_yes.tolist(), study["a"].n_trials.tolist()) == (n_yes, n_trials)
    again = bt.read_study(study.frame())
    assert (again.task, again["a"].n_yes.tolist()) == (WHICH_STRONGER, n_yes)


def test_other_sources_tell_their_task_alike(tmp_path):
    columns = {
        "s1": np.array([0.0, 0.3, 0.0]),
        "s2": np.array([0.3, 0.0, 0.0]),
        "hit": np.array([True, False, True]),
    }
    savemat(tmp_path / "trials.mat", {"subject": "M", **columns})
    for source in (tmp_path / "trials.mat", pd.DataFrame({"subject": "M", **columns})):
        study = bt.read_study(source, bt.ReadOptions(correct="hit"))
        assert (study.task, study["M"].n_yes.tolist()) == (WHICH_STRONGER, [1, 1])
    with pytest.raises(
        bt.InputError,
        match=r"(?s)ReadOptions\(second_code='1'\) .*ReadOptions\(correct='response'\)",
    ):
        bt.read_study(pd.DataFrame({"subject": "M", **columns, "response": [True] * 3}))


def test_right_answers_are_dropped_where_stimuli_are_equal_and_said(tmp_path):
    study = bt.read_study(
        written(tmp_path, RIGHT, "a,0,1,1", "a,0,0,1", "b,0,1,0", "b,0,1,"),
        bt.ReadOptions(correct="acc"),
    )
    assert study.notes == (
        "trial rows, comma-separated, UTF-8, responses '1' as right (2) / '0' as wrong (1), "
        "'second' or 'first' by the sign of s2 - s1",
        "1 trial without a response dropped: b 1",
        "1 trial with equal stimuli, of which no answer is right, dropped: a 1",
    )


def test_a_column_that_is_ignored_pools_pairs_and_is_not_asked_for(tmp_path):
    path = written(
        tmp_path, "subject,s1,s2,Delay,response,block", "a,0,1,2,second,1", "a,0,1,4,first,2"
    )
    timed, pooled = (
        bt.read_study(path, bt.ReadOptions(columns={"isi": "Delay"}, ignore=some))
        for some in ((), ("isi", "block"))
    )
    assert bt.ReadOptions(ignore="isi") == bt.ReadOptions(ignore=["isi"])
    assert (timed["a"].n_pairs, pooled["a"].n_pairs, pooled.intervals) == (2, 1, ())
    assert [note for note in pooled.notes if "ignore" in note] == [
        f"column {one} not read, as --ignore has it" for one in ("Delay", "block")
    ]
    assert not any("looks like" in found.message for found in check_answers(pooled))


UNTOLD = "The program does not know what they mean."
BACK = [f"a,{first},{second},{'first' if second > first else 'second'}" for first, second in GRID]
REFUSED = [
    (
        TRIALS,
        ["a,0,1,1", "a,1,0,0"],
        "",
        "error: study.csv: column response: the codes are '1' (1), '0' (1). " + UNTOLD,
    ),
    (
        TRIALS,
        ["a,0,1,2", "a,1,0,1"],
        "",
        "       --second-code 2  if 2 is 'the second was stronger' (2AFC)",
    ),
    (
        TRIALS,
        ["a,0,1,True", "a,1,0,False"],
        "",
        "       --correct response  if True is a correct response (2AFC)",
    ),
    (
        TRIALS,
        ["a,0,1,f", "a,1,0,j"],
        "",
        "type:  --equal-code f   if f is 'equal' in a same-different task",
    ),
    (TRIALS, ["a,0,1,2", "a,1,0,1", "a,1,0,3"], "", "; name the other code too"),
    (
        TRIALS,
        ["a,0,1,equal", "a,1,0,second"],
        "",
        "found 'equal' and 'second', words of two tasks, allowed: one task",
    ),
    (
        TRIALS,
        ["a,0,1,equal"],
        "--second-code 1",
        "row 2, column response: found 'equal', allowed: '1' (second) or first, s1, 1st",
    ),
    (
        TRIALS,
        ["a,0,1,2nd", "a,0,1,1"],
        "",
        "row 3, column response: found '1', allowed: second, s2, 2nd (second) or first",
    ),
    (
        TASK,
        ["a,0,1,second,2afc", "a,0,1,first,same/different"],
        "",
        "column task: found '2afc' and 'same/different', allowed: one task",
    ),
    (
        TASK,
        ["a,0,1,second,same/different"],
        "",
        "column task: found 'same/different', allowed: 'which is stronger'",
    ),
    (
        COUNTS.replace("n_trials", "n_equal,n_trials"),
        ["a,0,1,1,1,2"],
        "",
        "column n_second: found together with n_equal, allowed: one",
    ),
    (RIGHT, ["a,0,1,1"], "", "--correct acc            if acc says right or wrong (2AFC)"),
    (
        RIGHT,
        ["a,0,1,1"],
        "--columns response=acc",
        "column acc: found as response, though it seems to say right or wrong, allowed: --correct",
    ),
    (
        RIGHT,
        ["a,0,1,maybe"],
        "--correct acc",
        "row 2, column acc: found 'maybe', allowed: 1, true, yes, correct, right, hit (right) or 0",
    ),
    (RIGHT, ["a,0,0,1"], "--correct acc", "found no response in any of 1 rows"),
    (
        RIGHT,
        ["a,0,1,1"],
        "--correct hit",
        "row 1: there is no column hit. The columns are subject, s1, s2, acc.",
    ),
    (
        RIGHT,
        ["a,0,1,1"],
        "--correct acc --second-code 1",
        "--second-code, --correct: found together, allowed: what tells one task",
    ),
    (
        TRIALS,
        ["a,0,1,1"],
        "--equal-code 1 --second-code 1",
        "--equal-code, --second-code: found together",
    ),
    (
        TRIALS,
        ["a,0,1,1"],
        "--second-code 1 --first-code 1",
        "--first-code: found '1' as --second-code, allowed: two different texts",
    ),
    (
        TRIALS,
        ["a,0,1,second"],
        "--ignore s1",
        "--ignore: found 's1', allowed: isi, session, block, trial, iti, condition",
    ),
    (
        "subject,i1,i2,response",
        ["a,0,1,second"],
        "--intensity 1",
        "row 2, column i1: found '0', allowed: a positive finite number",
    ),
    (
        TRIALS,
        ["a,0,1,second"],
        "--task same/different",
        "--task is 'same/different', but the responses in",
    ),
    (
        TRIALS,
        ["a,0,1,second"],
        "--task 3afc",
        "--task: found '3afc', allowed: same/different, or 2afc (which is stronger)",
    ),
    (
        TRIALS,
        BACK * 3,
        "",
        "less often the larger s2 - s1 is (correlation -0.82), allowed: 'second' where the second "
        "stimulus was called",
    ),
    (TRIALS, BACK * 3, "", "if they mean the opposite, --second-code first --first-code second"),
]


@pytest.mark.parametrize(("head", "rows", "options", "said"), REFUSED, ids=range(len(REFUSED)))
def test_what_cannot_be_read_is_one_line_and_nothing_is_written(
    tmp_path, head, rows, options, said
):
    written(tmp_path, head, *rows)
    assert said in refused("run", "study.csv", "-o", "out", *options.split(), cwd=tmp_path)


def test_several_files_are_of_one_task(tmp_path):
    frames = [
        pd.DataFrame({"subject": ["a"], "s1": 0, "s2": 1, "response": [one]})
        for one in ("same", "second")
    ]
    with pytest.raises(
        bt.InputError,
        match=r"asked which is stronger, and .* same/different; allowed: files of one task",
    ):
        bt.read_study(frames)


# --- Doubts ---------------------------------------------------------------------------------------


def answering(name, p, trials=12, pairs=GRID, task=WHICH_STRONGER, seed=1):
    s1, s2 = np.transpose(pairs)
    counts = np.random.default_rng(seed).binomial(trials, p(s2 - s1))
    return bt.Subject(name, s1, s2, counts, [trials] * len(pairs), task=task)


def rising(difference):
    return 0.05 + 0.9 * ndtr((difference + 0.03) / 0.2)


def reversed_answers(*subjects):
    findings = check_answers(bt.Study(subjects))
    return {(finding.subject, finding.code): finding.option for finding in findings}


def test_some_reversed_subjects_are_found_and_all_are_refused_where_they_are_read():
    straight, back = answering("a", rising), answering("b", lambda d: rising(-d))
    assert reversed_answers(straight, back) == {("b", "reversed_answers"): "--swap b"}
    mixed = bt.read_study(bt.Study((straight, back)).frame())
    assert reversed_answers(*mixed.swap("b")) == {}
    with pytest.raises(bt.InputError, match=r"correlation -0\.[67].*n_second counts those"):
        bt.read_study(bt.Study((back, answering("c", lambda d: rising(-d)))).frame())
    parts = [bt.Study((one,)).frame() for one in (straight, back)]
    assert reversed_answers(*bt.read_study(parts)) == {("b", "reversed_answers"): "--swap b"}, (
        "a file of one reversed subject is not a study"
    )
    trials = pd.DataFrame(
        [(*pair, "a", "first" if pair[1] > pair[0] else "second") for pair in GRID * 3],
        columns=["s1", "s2", "subject", "response"],
    )
    with pytest.raises(
        bt.InputError,
        match=r"the opposite, ReadOptions\(second_code='first', first_code='second'\)",
    ):
        bt.read_study(trials)
    for guessing in range(20):  # one subject at chance is no reversed study
        bt.read_study(bt.Study((answering("a", lambda d: 0 * d + 0.5, seed=guessing),)).frame())


def test_real_studies_are_read_as_they_were_asked(real_data):
    for name, file, options, trials in (
        ("auditory_pwm", "trials.csv", {"ignore": ("isi",)}, 17934),
        ("numerosity", "trials.csv", {}, 34553),
        ("weights", "counts.csv", {}, 1000),
    ):
        study = bt.read_study(real_data / name / file, bt.ReadOptions(**options))
        assert (study.task, sum(subject.total_trials for subject in study)) == (
            WHICH_STRONGER,
            trials,
        )
