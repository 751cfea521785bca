"""Flags of answers: which subjects have a flag, which do not, and how often by chance."""

import itertools
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from conftest import BOTH_TASKS
from numpy.random import default_rng
from scipy.special import ndtr
from serial_observers import neighbouring_pairs

import bayes_toe as bt
from bayes_toe.checks.answer_checks import (
    Finding,
    answer_flags,
    check_answers,
    not_interpreted,
)
from bayes_toe.data.answers import Answers
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.design.observers import make_observer
from bayes_toe.design.study_design import StudyDesign

OTHER_TASK = {SAME_DIFFERENT: WHICH_STRONGER, WHICH_STRONGER: SAME_DIFFERENT}
#: The flag of subjects whose responses are those of the other task.
LIKE_OTHER = {SAME_DIFFERENT: "like_2afc", WHICH_STRONGER: "other_task"}
LEVELS = np.arange(6) * 0.25


def make_subject(seed, n_trials=650, n_blocks=10, name="S"):
    """A sound subject by trials in blocks, with a constant error of a fifth of a step."""
    keys, yes = signal_trials(default_rng(seed), SAME_DIFFERENT, np.full(n_trials, 0.2), noise=0.1)
    block = np.arange(n_trials) * n_blocks // n_trials
    return replace(from_trials(keys, yes, block), name=name)


def from_trials(keys, yes, block=None, task=SAME_DIFFERENT):
    """A subject by the pair and the answer of each trial, and perhaps the index of its block."""
    names = ()
    if block is not None:
        names = tuple(str(1 + index) for index in range(block.max() + 1))
    answers = Answers(keys, yes, np.ones_like(yes), block, names, has_trial_rows=True)
    return Subject.from_answers("S", answers, task)


def signal_trials(rng, task, shifts, is_reversed=False, noise=0.2):
    """The pairs, (trials, 2), and answers of trials of neighbours.

    The PSE of each trial is moved by its value in `shifts`, in steps between neighbours. A reversed
    observer gives the other answer in every trial.
    """
    pairs = neighbouring_pairs(task)
    n_trials = len(shifts)
    # Rounds of all pairs, each in random order. The number of rounds is rounded up, and the last
    # round is cut.
    n_rounds = -(-n_trials // len(pairs))
    pair = np.concatenate([rng.permutation(len(pairs)) for _ in range(n_rounds)])
    keys = pairs[pair[:n_trials]]
    perceived = keys[:, 1] - keys[:, 0] - 0.25 * shifts + rng.normal(0, noise, n_trials)
    yes = np.abs(perceived) < 0.2 if task == SAME_DIFFERENT else perceived > 0
    return keys, (yes ^ is_reversed).astype(int)


def findings_of(*subjects):
    """The findings of the check on a study of these subjects."""
    return check_answers(Study(subjects))


def messages(*subjects):
    """The message of each finding, by its code."""
    return {finding.code: finding.message for finding in findings_of(*subjects)}


def test_flags_are_those_of_each_subject_in_the_order_of_the_study():
    """A sound subject has no flags, and a subject whose block 4 is swapped has one flag."""
    study = Study((make_subject(1, name="a"), make_subject(0, name="S 1"))).swap("S 1", 4)
    message = "Responses look swapped in block 4."
    flag = Finding("S 1", "swapped_blocks", message, "--swap 'S 1:4'")
    assert answer_flags(study) == [(), (flag,)]
    assert (flag.words, flag.is_interpretable) == ("responses look swapped", False)


# --- False alarms --------------------------------------------------------------------------------


def test_clean_observers_are_flagged_as_rarely_as_stated():
    # Two tests, of blocks and of drift, at 2.5 % in each of 50 studies of one subject: 3 studies
    # are expected to have a flag, and more than 8 in one of 1,000 such runs.
    n_flagged = 0
    for seed in range(50):
        n_flagged += findings_of(make_subject(seed, n_trials=260, n_blocks=5)) != ()
    assert n_flagged <= 8


@pytest.mark.parametrize("constant_error", [-2.5, 0.0, 1.0, 2.5])
@BOTH_TASKS
def test_constant_errors_are_no_flaw_of_the_answers(task, constant_error):
    shifts = np.full(400, constant_error)
    subjects = []
    for seed in range(5):
        trials = signal_trials(default_rng(seed), task, shifts)
        subjects.append(replace(from_trials(*trials, task=task), name=str(seed)))
    for finding in findings_of(*subjects):
        # A drift may be found by chance, and the largest errors leave only one answer.
        assert finding.code in ("drift", "one_answer")


# --- Trials that are there twice -----------------------------------------------------------------


@pytest.mark.parametrize(
    "rows, message",
    [
        (
            np.r_[0:84, 0:84],
            "84 of 168 answered trials repeat earlier ones. The first copy is answered trial 85.",
        ),
        (
            np.r_[0:84, 20:80],
            "60 of 144 answered trials repeat earlier ones. The first copy is answered trial 85.",
        ),
    ],
    ids=["all trials", "some of them"],
)
def test_sequences_of_trials_that_come_again_are_flagged(rows, message):
    """The file has the 84 trials of a session, and then all or some of them once more."""
    keys, yes = signal_trials(default_rng(1), SAME_DIFFERENT, np.zeros(84))
    (finding,) = findings_of(from_trials(keys[rows], yes[rows]))
    assert finding.code == "repeated_trials"
    assert finding.message.startswith(message)
    assert finding.option == "--exclude S"


@pytest.mark.parametrize("noise", [0.05, 0.1, 0.2], ids=["hardly an error", "some", "many"])
def test_a_list_of_stimuli_that_is_used_again_is_no_repetition(noise):
    """Three sessions have the same 200 pairs, to which the subject responds anew."""
    for seed in range(12):
        rng = default_rng(seed)
        keys, _ = signal_trials(rng, SAME_DIFFERENT, np.zeros(200))
        keys = np.tile(keys, (3, 1))
        perceived = keys[:, 1] - keys[:, 0] + rng.normal(0, noise, len(keys))
        yes = (np.abs(perceived) < 0.13).astype(int)  # about half of a step of .25
        assert "repeated_trials" not in messages(from_trials(keys, yes))


def test_roved_stimuli_with_sure_answers_that_come_again_are_no_repetition():
    """Right answers to the same pairs are the same; errors in the same trials are repetitions."""
    rng = default_rng(1)
    s1 = rng.normal(0, 1, 150)
    keys = np.tile(np.column_stack([s1, s1 + rng.choice([-0.5, 0.5], 150)]), (2, 1))
    right_answers = (keys[:, 1] > keys[:, 0]).astype(int)
    assert findings_of(from_trials(keys, right_answers, task=WHICH_STRONGER)) == ()
    answers = right_answers ^ np.tile(rng.random(150) < 0.3, 2)  # with errors
    assert "repeated_trials" in messages(from_trials(keys, answers, task=WHICH_STRONGER))


def test_repeated_counts_of_a_pair_are_no_repetition():
    # A file of counts has the rows of two pairs 30 times.
    rows = {"s1": [0, 0.3] * 30, "s2": [0.3, 0] * 30, "n_equal": [5, 4] * 30, "n_trials": [9] * 60}
    study = bt.read_study(pd.DataFrame({"subject": "S", **rows}))
    assert "repeated_trials" not in messages(*study)


# --- The counts ----------------------------------------------------------------------------------


@pytest.mark.parametrize("n_yes", [0, 40])
@BOTH_TASKS
def test_a_subject_with_one_answer_only_is_flagged(task, n_yes):
    s1, s2 = neighbouring_pairs(SAME_DIFFERENT).T  # with equal pairs, which both tasks may have
    subject = Subject("A", s1, s2, [n_yes] * len(s1), [40] * len(s1), task=task)
    (finding,) = findings_of(subject)
    assert (finding.code, finding.option) == ("one_answer", "")
    response = {0: task.no, 40: task.yes}[n_yes]
    assert finding.message == f"Every response is {response!r}."


@pytest.mark.parametrize("n_trials, is_flagged", [(59, True), (60, False)])
def test_fewer_than_60_trials_are_flagged(n_trials, is_flagged):
    trial = np.arange(n_trials)
    s2 = np.choose(trial % 3, [0.0, 0.3, -0.3])  # s1 is 0
    yes = (s2 == 0.0).astype(int)
    keys = np.column_stack([np.zeros(n_trials), s2])
    assert ("few_trials" in messages(from_trials(keys, yes))) == is_flagged


@BOTH_TASKS
def test_reversed_answers_are_flagged_and_fine_when_they_are_turned(task):
    """The option that is proposed swaps the answers back, and no flag is left."""
    no_shifts = np.zeros(400)
    keys, yes = signal_trials(default_rng(2), task, no_shifts, is_reversed=True)
    study = Study((from_trials(keys, yes, task=task),))
    (finding,) = check_answers(study)
    assert (finding.code, finding.option) == ("reversed_answers", "--swap S")
    assert check_answers(study.swap("S")) == ()


def guessing_subject(seed, task, n_trials):
    """A subject whose responses do not depend on the stimuli."""
    rng = default_rng(seed)
    keys, _ = signal_trials(rng, task, np.zeros(n_trials))
    return from_trials(keys, (rng.random(n_trials) < 0.5).astype(int), task=task)


@BOTH_TASKS
def test_a_guessing_subject_is_flagged_and_interpreted_all_the_same(task):
    codes = []
    for seed in range(8):
        for finding in findings_of(guessing_subject(seed, task, n_trials=960)):
            codes.append(finding.code)
            assert finding.option == "", "nothing is to be swapped or excluded"
            assert finding.is_interpretable
    # Five or six of eight subjects have this flag: by chance, guesses may look like a weak
    # dependence on the stimuli.
    assert codes.count("independent_answers") >= 4


def simulated_subject(seed, task, *, p=0.0, noise=0.25, name="S"):
    """A subject by counts: an observer with contraction p, 30 trials of each neighbouring pair."""
    pairs = neighbouring_pairs(task)
    design = StudyDesign(*pairs.T, [30] * len(pairs), task=task)
    parameters = {"noise": noise, "lapse_rate": 0.02, "contraction": p}
    if task == SAME_DIFFERENT:
        parameters["q0"] = 0.8
    return make_observer(name, "simulated", parameters, task).answers(design, seed)


@pytest.mark.parametrize("p", [0.5, 0.65, -0.4])
@BOTH_TASKS
def test_a_strong_contraction_or_repulsion_has_no_flag(task, p):
    subjects = [simulated_subject(i, task, p=p, name=f"S{i}") for i in range(8)]
    assert findings_of(*subjects) == ()


def test_a_group_in_a_hard_task_does_not_look_like_another_task():
    # Noise of three steps: some subjects look like guessing, which is no other task.
    subjects = [simulated_subject(i, WHICH_STRONGER, noise=0.75, name=f"S{i}") for i in range(40)]
    for finding in findings_of(*subjects):
        assert finding.code == "independent_answers"


@BOTH_TASKS
def test_answers_to_the_other_question_flag_every_subject(task):
    """Three subjects answer the question of the other task, which the file calls `task`."""
    rng = default_rng(3)
    answered = OTHER_TASK[task]
    s1, s2 = np.transpose(list(itertools.product(LEVELS[:4], repeat=2)))
    n_trials = np.full(len(s1), 30)
    p = p_yes(s2 - s1, answered)
    subjects = [
        Subject(name, s1, s2, rng.binomial(30, p), n_trials, task=answered) for name in "abc"
    ]
    code = LIKE_OTHER[task]
    assert code not in messages(*subjects)
    findings = findings_of(*(replace(subject, task=task) for subject in subjects))
    message_by_subject = {
        finding.subject: finding.message for finding in findings if finding.code == code
    }
    assert list(message_by_subject) == ["a", "b", "c"]
    assert "in 3 of 3 subjects" in message_by_subject["a"].lower()


def p_yes(distance, task):
    """P('equal') or P('second') of an observer without order effect, by s2 - s1."""
    if task == SAME_DIFFERENT:
        return 0.9 * np.exp(-((distance / 0.3) ** 2))
    return ndtr(distance / 0.3)


@BOTH_TASKS
def test_scatter_of_shares_in_billions_of_trials_is_no_fault(task):
    """Shares scatter by .08 about the curve: not a sound fit, but no fault of the responses."""
    n_trials = 10**10
    keys = neighbouring_pairs(SAME_DIFFERENT)
    scatter = default_rng(1).normal(0, 0.08, len(keys))
    share = np.clip(p_yes(keys[:, 1] - keys[:, 0], task) + scatter, 0.0, 1.0)
    counts = (share * n_trials).astype(np.int64)
    subject = Subject("S", *keys.T, counts, [n_trials] * len(keys), task=task)
    assert findings_of(subject) == ()


# --- Blocks and drift ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "blocks, words",
    [
        ([4], "block 4"),
        ([3, 4], "blocks 3 and 4"),
        ([2, 4, 6, 8, 10], "blocks 2, 4, 6, 8 and 10"),
    ],
)
def test_swapped_blocks_are_named_with_what_turns_them_back(blocks, words):
    option = f"--swap S:{','.join(map(str, blocks))}"
    n_recognised = 0
    for seed in range(5):
        findings = check_answers(Study((make_subject(seed),)).swap("S", blocks))
        # A wrong set of blocks is never proposed.
        assert {finding.option for finding in findings} <= {option, ""}
        finding, *further_findings = findings
        if finding.code == "swapped_blocks":
            n_recognised += 1
            assert finding.message == f"Responses look swapped in {words}."
            assert further_findings == []
    # If the program is not sure enough which blocks are swapped, it only says that blocks differ.
    assert n_recognised >= 3


def moving_criterion(rng, kind):
    """Shifts of the PSE, SD half a step: a random walk, or a shift for each block of 65 trials."""
    if kind == "blocks":
        return np.repeat(rng.normal(0, 0.5, 10), 65)
    walk = np.cumsum(rng.normal(0, 1, 650))
    return 0.5 * (walk - walk.mean()) / walk.std()


@pytest.mark.parametrize("kind", ["walk", "blocks"])
@BOTH_TASKS
def test_a_moving_criterion_is_flagged_and_never_called_swapped_blocks(task, kind):
    n_flagged = 0
    for seed in range(5):
        rng = default_rng(seed)
        keys, yes = signal_trials(rng, task, moving_criterion(rng, kind))
        findings = findings_of(from_trials(keys, yes, np.arange(650) // 65, task))
        assert not any("--swap" in finding.option for finding in findings)
        codes = {finding.code for finding in findings}
        n_flagged += not codes.isdisjoint({"drift", "block_dispersion"})
    assert n_flagged >= 4  # a criterion may happen to move little


def test_drift_is_flagged_with_its_size_and_a_small_one_is_not():
    n_trials = 1300  # the standard error of a change of P(second) is about .04
    rng = default_rng(3)
    keys, _ = signal_trials(rng, WHICH_STRONGER, np.zeros(n_trials))
    share = ndtr((keys[:, 1] - keys[:, 0]) / 0.3)
    time = np.linspace(-0.5, 0.5, n_trials)

    def messages_of(change):
        """The messages for a P(second) that changes linearly by so much over the trials."""
        yes = (rng.random(n_trials) < np.clip(share + change * time, 0, 1)).astype(int)
        return messages(from_trials(keys, yes, task=WHICH_STRONGER))

    (text,) = messages_of(0.3).values()
    assert text.startswith("Responses drift (test p ")
    _, _, end = text.partition("The P(second) changes by ")  # '0.31 over the trials.'
    size, *_ = end.split()
    assert 0.2 < float(size) < 0.4  # .3, and 2.5 standard errors either way
    assert messages_of(0.1) == {}  # a change below .2 is not flagged


def test_counts_without_order_of_trials_have_no_flags_of_blocks():
    subject = Study((make_subject(1),)).swap("S", 4)["S"]
    assert findings_of(replace(subject, answers=None)) == ()


# --- Real studies --------------------------------------------------------------------------------


def test_vibrotactile_blocks_that_look_swapped_are_proposed_until_they_are_turned(vibrotactile):
    options = {finding.option for finding in check_answers(vibrotactile)}
    assert options == {"--swap 865:2", "--swap 946:2,4,6", ""}
    study = vibrotactile.swap(946, [2, 4, 6]).swap(865, 2)
    assert {finding.option for finding in check_answers(study)} == {""}
    assert not_interpreted(study) == {}


@pytest.mark.parametrize(
    "path",
    ["morse_rothkopf_1957/dots.csv", "auditory_pwm/trials.csv", "numerosity/trials.csv"],
)
def test_nothing_is_proposed_in_the_other_public_studies(real_data, path):
    for finding in check_answers(bt.read_study(real_data / path)):
        assert finding.is_interpretable
        assert finding.option == ""
