"""'Which was stronger?' beside 'same or different?': words tell the task, numbers never do.

What is read, refused, doubted.
"""

import pandas as pd
import pytest
from commands import refusal_of
from conftest import each_row, made_subject, read, refused, s1_s2_yes_trials, typed_options

import bayes_toe as bt
from bayes_toe.checks.answer_checks import check_answers
from bayes_toe.data.tasks import WHICH_STRONGER

#: Headers of files of trials, of counts, of scores, and of trials with a column of tasks.
TRIALS, COUNTS = "subject,s1,s2,response", "subject,s1,s2,n_second,n_trials"
RIGHT, TASK = "subject,s1,s2,acc", "subject,s1,s2,response,task"
#: Header and rows, options, and the counts that are read. tests/data/test_shapes.py has more files.
READ = f"""
    {TRIALS} a,0,1,second a,0,1,S1 a,1,0,2nd a,1,0,FIRST a,1,0, |  | 0 1 1 2, 1 0 1 2
    {TRIALS} a,0,1,1 a,0,1,0.0 a,1,0,1.0 a,1,0,NA | --second-code 1 | 0 1 1 2, 1 0 1 1
    {TRIALS} a,0,1,second a,1,0,first | --second-code first --first-code second | 0 1 0 1, 1 0 1 1
    subject,s1,s2,k,n_trials a,0,1,3,5 | --columns n_second=k | 0 1 3 5
    {RIGHT} a,0,1,1 a,0,1,0 a,1,0,1 a,1,0,wrong a,0,0,1 a,0,1, | --correct acc | 0 1 1 2, 1 0 1 2
    subject,s1,s2,response a,0,1,second, a,1,0,first, |  | 0 1 1 1, 1 0 0 1
    subject,s1,s2,response, a,0,1,second a,1,0,first |  | 0 1 1 1, 1 0 0 1
    {TRIALS} a,0,1,2.0 a,0,1,9.0 | --second-code 2 --first-code 1 --missed 9.0 | 0 1 1 1
    {TRIALS} a,0,1,2 a,0,1,9 | --second-code 2 --first-code 1 --missed 9.0 | 0 1 1 1
    {TASK} a,0,1,second,2AFC a,0,1,same,same-different | --where task=2AFC | 0 1 1 1
    {TASK} a,0,1,second,comparison a,1,0,first,rating |  | 0 1 1 1, 1 0 0 1
"""


@each_row("text, options, expected", READ)
def test_answers_second_and_first_are_read(text, options, expected):
    # A text has spaces for line ends. The study is the same when its own table is read again.
    study_of_text = read(text.replace(" ", "\n"), options)
    for study in (study_of_text, bt.read_study(study_of_text.frame())):
        assert study.task == WHICH_STRONGER
        # Such as '0 1 1 2, 1 0 1 2': s1, s2, answers 'second' and trials.
        assert s1_s2_yes_trials(study["a"]) == s1_s2_yes_trials(made_subject(expected))


def test_right_answers_are_dropped_where_stimuli_are_equal_and_said():
    # Columns are s1, s2 and right or wrong. One trial has equal stimuli, and one has no response.
    study = read(f"{RIGHT}\na,0,1,1\na,0,0,1\nb,0,1,0\nb,0,1,\n", "--correct acc")
    assert study.notes == (
        "trial rows, comma-separated, UTF-8, responses '1' as right (2) / '0' as wrong (1), "
        "'second' or 'first' by the sign of s2 - s1, stimuli as natural logs",
        "1 trial without a response dropped: b 1",
        "1 trial with equal stimuli, of which no answer is right in 2AFC, dropped: a 1",
    )
    # A column that says where stimuli are equal, and a right answer there, tell the other task.
    text = "subject,s1,s2,kind,acc\na,0,0,same,1\na,0,1,different,0\n"
    assert "as column kind does" in str(read(text, "--correct acc").notes)


def test_a_column_that_is_ignored_pools_pairs_and_is_not_asked_for():
    # Two trials of one pair have different delays, an interval that is known by this name, and
    # different blocks.
    text = "subject,s1,s2,Delay,response,block\na,0,1,2,second,1\na,0,1,4,first,2\n"
    study = read(text, "--ignore isi --ignore block")
    assert bt.ReadOptions(ignore="isi") == bt.ReadOptions(ignore=["isi"])
    assert s1_s2_yes_trials(study["a"]) == [(0.0, 1.0, 1, 2)]
    assert not any("looks like" in finding.message for finding in check_answers(study))


def test_codes_without_an_effect_are_said():
    # One command may read the files of several subjects, of whom some missed no trial.
    study = read("subject,s1,s2,response\na,0,1,second\n", "--missed zzz")
    assert "no effect of 'zzz', which the table lacks" in study.notes
    study = read("subject,s1,s2,n_second,n_trials\na,0,1,1,2\n", "--equal-code zz")
    assert "no effect of 'zz', which the table lacks" in study.notes
    study = read("subject,s1,s2,response\na,0,1,second\na,0,1,k\na,0,1,x\n", "--missed k,x")
    assert "no effect" not in " ".join(study.notes)


#: Header and rows, options, and a part of the refusal.
REFUSED = f"""
    {TRIALS} a,0,1,1 a,1,0,0 |  | error: study.csv: column response: the codes are '1' (1), '0' (1)
    {TRIALS} a,0,1,2 a,1,0,1 |  | --second-code 2  if 2 is 'the second was stronger' (2AFC)
    {TRIALS} a,0,1,right a,1,0,wrong |  | if response says right or wrong
    {TRIALS} a,0,1,hit a,1,0,miss |  | if response says right or wrong
    {TRIALS} a,0,1,error a,1,0,correct |  | if response says right or wrong
    {TRIALS} a,0,1,Yes a,1,0,no |  | if response says right or wrong
    {TRIALS} a,0,1,1.0 a,1,0,0.0 |  | if response says right or wrong
    {TRIALS} a,0,1,TRUE a,1,0,FALSE |  | if response says right or wrong
    {TRIALS} a,0,1,equal | --second-code 1 | found 'equal', allowed: '1' (second) or first, s1, 1st
    {TRIALS} a,0,1,2nd a,0,1,1 |  | row 3, column response: found '1', allowed: second, s2, 2nd
    {TASK} a,0,1,second,2afc a,0,1,first,same/different |  | column task: found 'same/different'
    {TASK} a,0,1,second,same/different |  | found 'same/different', allowed: 'which is stronger'
    {COUNTS},n_equal a,0,1,1,1,2 |  | column n_equal: found together with n_second and n_trials
    {RIGHT} a,0,1,1 | --columns response=acc | found as response, though it seems to say right
    {RIGHT} a,0,1,maybe | --correct acc | row 2, column acc: found 'maybe', allowed: 1, true, yes
    {RIGHT} a,0,0,1 | --correct acc | found no response in any of 1 rows
    {RIGHT} a,0,1,1 | --correct hit | there is no column hit. The columns are subject, s1, s2, acc.
    {RIGHT} a,0,1,1 | --correct acc --second-code 1 | --second-code, --correct: found together
    subject,i1,i2,response a,0,1,second | --intensity 1 | row 2, column i1: found '0', allowed: a po
    subject,att1_dB,att2_dB,response a,1,2,first |  | column att1_dB: found attenuation, whose
    subject,s1,s2,n_correct,n_trials a,0,1,2,9 a,1,0,9,9 a,1,2,3,9 a,2,1,8,9 |  | n_correct=n_
    {TRIALS} a,0,1,second | --task same/different | --task is 'same/different', but the responses in
"""


@each_row("text, options, message", REFUSED)
def test_a_file_that_cannot_be_read_is_one_line_and_nothing_is_written(
    tmp_path, text, options, message
):
    # Such as codes 1 and 0 without an option, with the message that nobody knows what they mean.
    (tmp_path / "study.csv").write_text(text.replace(" ", "\n"))
    assert message in refusal_of(f"run study.csv -o out {options}", cwd=tmp_path)


#: Options that make no sense in any file, and the beginning of the refusal.
OPTIONS = """
    --different-code 0 --second-code 1 | --different-code, --second-code: found together
    --second-code 1 --first-code 1 | --first-code: found '1' as --second-code, allowed: different
    --equal-code a --different-code ' a ' | --different-code: found 'a' as --equal-code
    --equal-code '  ' | --equal-code: found ''
    --different-code '' | --different-code: found ''
    --ignore s1 | --ignore: found 's1', allowed: isi, session, block, trial, condition
    --task 3afc | --task: found '3afc', allowed: same/different, 2afc (which is stronger), or
    --unit '$x$' | --unit: found '$x$', allowed: ln, log10, dB, dB-power, octaves,
    --unit 'dB SPL' | --unit: found 'dB SPL', allowed: ln,
    --unit Cent | --unit: found 'Cent', allowed: ln,
    --intensity 0 | --intensity: found 0.0, allowed: a positive finite number
    --intensity nan | --intensity: found nan
    --intensity inf | --intensity: found inf
    --columns first=s1 | --columns: found 'first=s1'
    --columns 's1= ' | --columns: found 's1='
    --columns S1=x | --columns: found 'S1=x', allowed: OURS=NAME with OURS one of
    --columns s1 | --columns: found 's1', allowed: OURS=NAME, each name once
    --columns =x | --columns: found '=x', allowed: OURS=NAME, each name once
    --columns s2=a --columns s2=x | --columns: found 's2=x', allowed: OURS=NAME, each name once
    --subject-from x.csv | --subject-from: found 'x.csv', allowed: a file's name with
    --standard-interval a --standard-first | --standard-first, --standard-interval, --comp
    --standard-interval a --comparison-interval b | --comparison-interval: found together
    --standard-first-code c | --standard-first-code: found alone
    --comparison-code c | --comparison-code: found alone
"""


@each_row("options, message", OPTIONS)
def test_options_that_make_no_sense_are_refused(tmp_path, options, message):
    # Such as '--task 3afc', with the tasks that are allowed. The file itself is good.
    (tmp_path / "study.csv").write_text(f"{TRIALS}\na,0,1,second\n")
    assert message in refusal_of(f"check study.csv {options}", cwd=tmp_path)


def test_several_files_are_of_one_task():
    # One file has the word 'same', and the other file has 'second'.
    frame = pd.DataFrame({"subject": ["a"], "s1": 0, "s2": 1, "response": ["same"]})
    message = r"asked which is stronger, and .* same/different; allowed: files of one task"
    with refused(message):
        bt.read_study([frame, frame.assign(response="second")])


@pytest.mark.parametrize(
    "file, options, n_trials",
    [
        ("auditory_pwm/trials.csv", "--ignore isi", 17934),
        ("numerosity/trials.csv", "", 34553),
        ("weights/counts.csv", "", 1000),
    ],
)
def test_real_studies_are_read_as_they_were_asked(file, options, n_trials, real_data):
    # The auditory study has 18,244 rows, of which 310 have no response. The other studies lose no
    # row.
    study = bt.read_study(real_data / file, typed_options(options))
    assert study.task == WHICH_STRONGER
    assert sum(subject.total_trials for subject in study) == n_trials
