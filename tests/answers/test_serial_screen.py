"""Score tests of an effect of the trial before: calibration, power, and missing p-values."""

from dataclasses import astuple, replace

import numpy as np
import pytest
from numpy.random import default_rng
from scipy.stats import kstest, norm
from serial_observers import LAPSE_RATE, NOISE, Q0, answered, in_order

from bayes_toe.answers.serial_screen import SerialScreen, serial_screen
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.model.models import OrderModel


def screen(subject, p=0.0):
    """The p-values of the screen, at the observer's true parameters instead of the maximum."""
    posterior = OrderModel("both").posterior(subject)
    parameters = {"noise": NOISE, "q0": Q0, "lapse_rate": LAPSE_RATE, "contraction": p}
    point = {name: np.array(parameters.get(name, 0.0)) for name in posterior.coordinates}
    return serial_screen(posterior, posterior.points(point))


def p_values(screens, name):
    """The p-values of one test, the field `name`, of these screens."""
    return np.array([getattr(row, name) for row in screens])


def p_value_of_1000(observed, simulate):
    """A p-value by 1,000 draws, which suffice for a limit of .01, instead of up to 20,000."""
    return (1 + np.count_nonzero(simulate(1000) >= observed)) / 1001


def test_observers_without_memory_seldom_fail_the_screen():
    screens = []
    for i in range(120):
        screens.append(screen(answered(i, WHICH_STRONGER, repeats=20, p=0.2), p=0.2))
        screens.append(screen(answered(i, SAME_DIFFERENT, repeats=12, p=0.2), p=0.2))
    observed = np.array([astuple(row) for row in screens])
    # Two tests of each of 240 subjects give 480 p-values. Five are expected below .01, and 12 is
    # three standard deviations above five.
    assert np.count_nonzero(observed < 0.01) <= 12

    # In one of 500 runs, one of these two tests of uniformity fails by chance.
    for column in observed.T:
        assert kstest(column, "uniform").pvalue > 1e-3


def test_answers_of_few_trials_to_a_pair_are_screened_without_bias():
    """A pair has six trials, so an answer tells much about the other answers to its pair.

    The observers have no memory, so the p-values are uniform. In one of 500 runs, one of the two
    tests of uniformity falls below 1e-3 by chance.
    """
    screens = [screen(answered(1000 + i, repeats=6, sessions=1, noise=0.6)) for i in range(400)]
    for name in ("joint_p", "moving_criterion_p"):
        assert kstest(p_values(screens, name), "uniform").pvalue > 1e-3


def test_three_errors_are_no_dependence():
    """An observer without memory makes three errors, in two pairs, so V is almost singular.

    V is the variance in the docstring of the module that is tested.
    """
    assert screen(answered(57, repeats=12, noise=0.07)).joint_p > 0.1


@pytest.mark.parametrize(
    # An effect, and by test the smallest number of observers, of 10, with p < .01.
    "effect, least_by_test",
    [
        ({"share_repeated": 0.2}, {"joint_p": 9}),
        ({"p": 0.35, "carry_over": 0.9}, {"joint_p": 10}),
        ({"drift": 0.3}, {"moving_criterion_p": 9}),
    ],
)
def test_an_effect_is_seen_by_its_own_test(effect, least_by_test, monkeypatch):
    monkeypatch.setattr("bayes_toe.answers.serial_screen.simulated_p_value", p_value_of_1000)
    screens = []
    for i in range(10):
        subject = answered(3000 + i, repeats=32, **effect)
        screens.append(screen(subject, p=effect.get("p", 0.0)))
    for name, least in least_by_test.items():
        assert np.count_nonzero(p_values(screens, name) < 0.01) >= least


def test_there_is_no_p_value_without_the_order_of_trials_or_if_pairs_were_answered_once():
    # SerialScreen() has no p-value.
    assert screen(answered(5, repeats=1)) == SerialScreen()
    subject = answered(1)
    assert screen(replace(subject, answers=None)) == SerialScreen()

    # Trials that are sorted by their stimuli, s1 and then s2, have lost their order, too.
    rows = np.lexsort(subject.answers.keys.T[::-1])
    answers = subject.answers
    sorted_answers = replace(answers, keys=answers.keys[rows], n_yes=answers.n_yes[rows])
    assert screen(replace(subject, answers=sorted_answers)) == SerialScreen()


def test_the_first_trial_of_a_session_has_no_trial_before():
    """Only the test of a criterion that wanders depends on which session comes first."""
    subject = answered(6, sessions=2, share_repeated=0.2)
    rows = np.roll(np.arange(400), 200)  # the sessions have 200 trials each
    answers = subject.answers
    swapped_answers = replace(answers, keys=answers.keys[rows], n_yes=answers.n_yes[rows])
    swapped_subject = Subject.from_answers("swapped", swapped_answers, subject.task)
    assert screen(swapped_subject).joint_p == pytest.approx(screen(subject).joint_p, rel=1e-9)


def test_with_a_constant_first_stimulus_all_p_values_exist():
    rng = default_rng(7)
    keys = np.column_stack([np.zeros(300), rng.choice([-0.3, 0.3, 0.6], 300)])  # (s1, s2) by trial
    n_yes = (rng.random(300) < norm.cdf(keys[:, 1] / NOISE)).astype(int)
    observed = astuple(screen(in_order(keys, n_yes, position=np.arange(300))))
    assert all(0.0 < p <= 1.0 for p in observed)


def test_a_trial_before_that_is_not_tested_needs_no_correction():
    """Blocks of two trials of one pair; the answers are independent.

    The first trial of a block has no trial before. Its answer is not tested, but it is the answer
    before the second trial. In a sound test, 5 % of the p-values are below .05. In one of 1,800
    runs, 12 % of 150 p-values are below .05 by chance.
    """
    joint_p = []
    for seed in range(150):
        rng = default_rng(seed)
        # Ten pairs: first 0 and then one of five levels, or first the level and then 0.
        pair = np.repeat(np.tile(np.arange(10), 4), 2)  # (80 trials,)
        level = 0.05 * (pair % 5 + 1)
        is_rising = pair < 5
        keys = np.column_stack([level * ~is_rising, level * is_rising])
        n_yes = (rng.random(80) < np.where(is_rising, 0.6, 0.4)).astype(int)
        position = np.arange(80) + np.arange(80) // 2  # a gap starts a block
        subject = in_order(keys, n_yes, position)
        joint_p.append(screen(subject).joint_p)
    assert np.mean(np.less(joint_p, 0.05)) < 0.12
