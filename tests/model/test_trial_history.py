"""Effects of the trial before, against a loop over trials by the formulas of the module."""

from dataclasses import replace

import definitions
import mpmath as mp
import numpy as np
import pytest
from conftest import BOTH_TASKS
from numpy.random import default_rng
from scipy import stats

from bayes_toe.data.answers import Answers
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.model.models import OrderModel
from bayes_toe.model.trial_history import (
    TrialHistory,
    TrialHistoryPosterior,
    looks_sorted,
)

#: Whether the model has an effect of the previous response, and of the previous stimuli.
EACH_HISTORY = pytest.mark.parametrize(
    "has_response, has_carry_over", [(False, False), (True, False), (False, True), (True, True)]
)


def two_sessions(task=WHICH_STRONGER, n_trials=60):
    """Two sessions of random pairs and answers, with five trials without an answer."""
    rng = default_rng(1)
    keys = rng.choice(np.linspace(-0.4, 0.6, 5), (n_trials, 2))
    n_answers = np.ones(n_trials, int)  # of each trial
    n_answers[rng.choice(n_trials, 5, replace=False)] = 0
    n_yes = rng.integers(0, 2, n_trials) * n_answers
    # A position that is left out ends the first session after a third of the trials.
    position = np.arange(n_trials) + (np.arange(n_trials) >= n_trials // 3)
    answers = Answers(keys, n_yes, n_answers, has_trial_rows=True, place=position)
    return Subject.from_answers("A", answers, task)


def make_posterior(subject, has_response=True, has_carry_over=True):
    """The posterior of the model 'both' with these effects of the trial before."""
    history = TrialHistory(OrderModel("both"), has_response, has_carry_over)
    return TrialHistoryPosterior(subject, history)


def draw_points(posterior, n_points):
    """Draws from the prior, (points, coordinates)."""
    probability = default_rng(2).uniform(size=(1, n_points, len(posterior.array.names)))
    return posterior.array.prior_points(probability)[0]


def log_likelihood_at(posterior, points):
    """The log likelihood at points, (points, coordinates) -> (points,)."""
    return posterior.array.likelihood.value(points[None])[0]


def loop_log_likelihood(subject, values, kappa, rho):
    """The log likelihood by the formulas of the module, trial by trial in 40 digits.

    `kappa` is the effect of the previous response, and `rho` the share of an expectation that is
    carried over.
    """
    answers = subject.answers
    sbar = float(np.average(subject.s1, weights=subject.n_trials))
    is_session_start = np.diff(answers.place, prepend=-2) > 1  # a position was left out
    total = mp.mpf(0)
    expectation = mp.mpf(0)
    response = 0
    with mp.workdps(40):
        values = {name: mp.mpf(float(value)) for name, value in values.items()}
        p = values["contraction"]
        bare_k = definitions.criterion(values["q0"]) if "q0" in values else None
        for t, (first, second) in enumerate(answers.keys.tolist()):
            s1, s2 = mp.mpf(first), mp.mpf(second)
            if is_session_start[t]:
                expectation = mp.mpf(0)
                response = 0
            trial_before = {"expectation": expectation, "response": kappa * response}
            p_responses = definitions.observer_answers(values, bare_k, sbar, s1, s2, **trial_before)
            is_answered = answers.n_trials[t]  # 0 or 1
            is_yes = answers.n_yes[t]  # 0 or 1
            if is_answered:
                yes, no = p_responses
                total += mp.log(yes if is_yes else no)
            # The expectation moves to each stimulus in turn by a share 1 - p.
            moved_by_s1 = p * expectation + (1 - p) * (s1 - sbar)
            expectation = rho * (p * moved_by_s1 + (1 - p) * (s2 - sbar))
            response = int(is_answered * (2 * is_yes - 1))  # 1, -1, or 0 without an answer
    return float(total)


@BOTH_TASKS
@EACH_HISTORY
def test_the_likelihood_is_that_of_a_loop_over_trials(task, has_response, has_carry_over):
    subject = two_sessions(task)
    posterior = make_posterior(subject, has_response, has_carry_over)
    x = draw_points(posterior, 3)
    # Effects that the model does not have are 0.
    values = {"previous_response": np.zeros(3), "carry_over": np.zeros(3)}
    values |= posterior.quantities(x)
    for i, log_likelihood in enumerate(log_likelihood_at(posterior, x)):
        point = {name: column[i] for name, column in values.items()}
        kappa, rho = point["previous_response"], point["carry_over"]
        expected = loop_log_likelihood(subject, point, kappa, rho)
        assert log_likelihood == pytest.approx(expected, rel=1e-9)


def test_large_batches_of_points_are_done_in_parts():
    posterior = make_posterior(two_sessions(n_trials=300))
    x = draw_points(posterior, 900)
    assert len(x) * 300 > 1 << 17  # more points times trials than are computed at once
    log_likelihood = log_likelihood_at(posterior, x)
    for i in range(0, 900, 90):
        expected = log_likelihood_at(posterior, x[[i]])  # of a single point
        np.testing.assert_allclose(log_likelihood[i], expected[0], rtol=1e-12)


@BOTH_TASKS
def test_the_prior_is_that_of_the_documents(task):
    posterior = make_posterior(two_sessions(task))
    x = draw_points(posterior, 4000)
    values = posterior.quantities(x)
    # The effect of the previous response is normal with this SD, and the carry-over is uniform from
    # 0 to 1. The tolerances are four errors of 4,000 draws.
    sd = {SAME_DIFFERENT: 0.25, WHICH_STRONGER: 0.5}[task]
    assert values["previous_response"].std() == pytest.approx(sd, rel=0.05)
    quartiles = [0.25, 0.5, 0.75]
    assert np.quantile(values["carry_over"], quartiles) == pytest.approx(quartiles, abs=0.03)

    # The last two coordinates are the scores of both effects, which are standard normal.
    log_prior = posterior.array.log_prior(x[None])[0] - posterior.observer.log_prior(x[:, :-2])
    assert log_prior == pytest.approx(stats.norm.logpdf(x[:, -2:]).sum(axis=1))


def test_a_contraction_beyond_1_is_impossible():
    # So many trials that an expectation which grows from trial to trial would overflow.
    posterior = make_posterior(two_sessions(n_trials=2000))
    x = draw_points(posterior, 3)
    x[1, posterior.array.names.index("contraction")] = 8.0  # prior SDs of .25: p is 2
    log_likelihood = log_likelihood_at(posterior, x)
    assert np.isfinite(log_likelihood).tolist() == [True, False, True]
    assert log_likelihood[1] == -np.inf


def test_blocks_of_one_pair_in_both_orders_are_not_sorted():
    """Four blocks of 12 trials, each of one pair whose order is random."""
    low = np.repeat([0.0, 0.3, 0.1, 0.5], 12)
    counts = np.ones(48, int)  # one answer in each trial, always the counted one
    keys = np.column_stack([low, low + 0.2])  # s1 and s2 of each trial
    is_turned = default_rng(1).random(48) >= 0.5
    keys[is_turned] = keys[is_turned][:, ::-1]
    answers = Answers(keys, n_yes=counts, n_trials=counts, has_trial_rows=True, place=np.arange(48))
    assert not looks_sorted(answers)

    # Sorted by the first stimulus and then by the second, upwards and downwards.
    sorted_keys = keys[np.lexsort(keys.T[::-1])]
    assert looks_sorted(replace(answers, keys=sorted_keys))
    assert looks_sorted(replace(answers, keys=sorted_keys[::-1]))
