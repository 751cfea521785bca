"""Observers whose responses depend on the trial before, by the formulas of the documents."""

import numpy as np
from scipy.special import ndtr, ndtri

from bayes_toe.data.answers import Answers
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER

#: The distance of neighbouring levels, and then the parameters that all observers have.
STEP, NOISE, LAPSE_RATE, Q0 = 0.25, 0.2, 0.05, 0.9


def neighbouring_pairs(task, repeats=1):
    """Pairs of neighbours among six levels in both orders, (pairs, 2), and again `repeats` times.

    In the task same or different, the equal pairs follow.
    """
    low = STEP * np.arange(5.0)
    first, second = np.concatenate([low, low + STEP]), np.concatenate([low + STEP, low])
    if task == SAME_DIFFERENT:
        levels = STEP * np.arange(6.0)
        first, second = np.concatenate([first, levels]), np.concatenate([second, levels])
    return np.tile(np.column_stack([first, second]), (repeats, 1))


def in_order(keys, n_yes, position, task=WHICH_STRONGER, name="S"):
    """A subject with single trials in their order; a gap between positions begins a session."""
    answers = Answers(keys, n_yes, np.ones_like(n_yes), has_trial_rows=True, place=position)
    return Subject.from_answers(name, answers, task)


def answered(
    seed,
    task=WHICH_STRONGER,
    repeats=40,
    p=0.0,
    carry_over=0.0,
    share_repeated=0.0,
    drift=0.0,
    sessions=2,
    noise=NOISE,
):
    """An observer by the formulas of the documents, trial by trial, in random order.

    `p` is the contraction toward an expectation, and `carry_over` the share of the expectation that
    stays from trial to trial. In a share of the trials the response before is repeated, or
    alternated if the share is negative. The criterion wanders by a sine of height `drift`.
    """
    rng = np.random.default_rng(seed)
    keys = rng.permutation(neighbouring_pairs(task, repeats))
    n_trials = len(keys)
    session = np.arange(n_trials) * sessions // n_trials
    centre = keys[:, 0].mean()
    walk = drift * np.sin(2.0 * np.pi * np.arange(n_trials) / 80.0)  # a wave of 80 trials
    criterion = ndtri(0.5 + 0.5 * Q0)
    n_yes = np.zeros(n_trials, int)
    expectation = 0.0
    for t, (s1, s2) in enumerate(keys):
        is_first = t == 0 or session[t] != session[t - 1]
        if is_first:
            expectation = 0.0
        z = (s2 - s1 + p * (s1 - centre - expectation) + walk[t]) / noise
        if task == SAME_DIFFERENT:
            p_attentive = ndtr(criterion - z) - ndtr(-criterion - z)
            probability = LAPSE_RATE * Q0 + (1.0 - LAPSE_RATE) * p_attentive
        else:
            probability = LAPSE_RATE / 2.0 + (1.0 - LAPSE_RATE) * ndtr(z)
        n_yes[t] = rng.random() < probability
        if not is_first and rng.random() < abs(share_repeated):
            is_repetition = share_repeated > 0.0
            n_yes[t] = n_yes[t - 1] == is_repetition
        # The expectation of the next trial is rho times a mean of the stimuli and the expectation.
        of_stimuli = (1.0 - p) * (s2 - centre) + p * (1.0 - p) * (s1 - centre)
        expectation = carry_over * (of_stimuli + p**2 * expectation)
    return in_order(keys, n_yes, np.arange(n_trials) + session, task, f"observer {seed}")
