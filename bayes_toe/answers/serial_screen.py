"""A quick look whether answers depend on the trials before: score tests.

`serial_screen` gives the p-values of a subject, `subject_screen` at the maximum of a model.

The null hypothesis has a free probability for each pair, so that no curve is assumed. Given how
often each pair got each answer, every order of a pair's answers is equally probable. A pair has n
trials and k counted answers, and y is 1 where a trial has the counted answer and else 0. With the
residual e = y - k/n of a trial and its regressors h, from which each pair's mean is subtracted,

    U = sum e h,   V = sum k (n - k) / (n (n - 1)) h h',   U' V^-1 U ~ chi-square

h holds the answer of the trial before (1, -1; 0 after a missing one), and its two stimuli times g,
the slope of logit P in s2 - s1 of the present pair: what a shift of the criterion by a share of
those stimuli does.

An answer is not independent of the other answers to its pair: where both trials are among the n of
one pair, the mean of e times the earlier answer is -2 k (n - k) / (n^2 (n - 1)). U is corrected
for this mean.

Where few answers are the rarer answer to their pair, chi-square is far from right, and V may be
almost singular. The reference is then U' V^-1 U with the answers to each pair in random orders, and
V is the mean of U U' over these orders and the observed one.

A criterion that wanders makes the residuals of neighbouring trials alike. The statistic sees it at
short and at long time scales; the weights are those of a noise whose power falls with frequency:

    T = sum over trials s and t, t - s > 1, of e_s e_t / sqrt(t - s)

Its reference is the same sum with the answers to each pair in random orders.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from bayes_toe.arrays import ArrayPair, FloatArray, IndexArray, Rng
from bayes_toe.checks.alarm_rate import simulated_p_value
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.inference.order_evidence import MODEL_NAMES, OrderEvidence
from bayes_toe.model.models import ObserverPosterior, OrderModel
from bayes_toe.model.parameters import CONSTANT_ERROR, task_parameters
from bayes_toe.model.trial_history import TrialSequence
from bayes_toe.seeds import generator

#: From so many rarer answers on, summed over pairs, the reference is chi-square.
_ENOUGH_RARER_ANSWERS = 50
#: Trials of all random orders together, which take about 20 ms. 2,031 orders of 320 trials resolve
#: the limit of studies of up to 100 subjects.
_SIMULATED_TRIALS = 650_000


@dataclass(frozen=True)
class SerialScreen:
    """p-values of the score tests; None where a test has nothing to say, or the order is not known.

    Attributes
    ----------
    joint_p : float or None
        Previous answer and stimuli together, 3 degrees of freedom; `history_p` of tables.
    moving_criterion_p : float or None
        A criterion that wanders, by the trials before the last.
    """

    joint_p: float | None = None
    moving_criterion_p: float | None = None


#: The screen where nothing can be tested.
NO_TESTS = SerialScreen()


def subject_screen(evidence: OrderEvidence) -> SerialScreen:
    """The score tests of a subject at the maximum of the model 'both', which sets the slopes g."""
    posterior = OrderModel("both").posterior(evidence.subject, evidence.prior)
    return serial_screen(posterior, evidence.modes[MODEL_NAMES.index("both")])


def serial_screen(posterior: ObserverPosterior, mode: FloatArray) -> SerialScreen:
    """Score tests of the answers of a subject in their order.

    Parameters
    ----------
    posterior : ObserverPosterior
        The posterior of the subject under the model 'both'.
    mode : array, shape (k,)
        The maximum of the posterior density.
    """
    subject = posterior.subject
    # With three answers, the tests need the trials with 'first' or 'second'.
    tested_subject = subject.two_answers
    if tested_subject is None:
        return NO_TESTS
    try:
        trials = TrialSequence.from_subject(tested_subject)
    except InputError:  # the order of the trials is not known
        return NO_TESTS
    slopes = logit_slopes(posterior, mode)
    if subject.task.has_three_answers:  # `tested_subject` lacks the pairs that were always 'equal'
        slopes = slopes[subject.n_trials > subject.n_yes]
    scores, variance = _scores(tested_subject, trials, slopes)
    return SerialScreen(
        joint_p=_p_value(scores, variance),
        moving_criterion_p=_moving_criterion_p(tested_subject, trials),
    )


def logit_slopes(posterior: ObserverPosterior, point: FloatArray) -> FloatArray:
    """Slope of logit P in s2 - s1, in units of 1/D, for each pair at a point of shape (k,).

    A constant error is subtracted from s2 - s1, so the slope in the error has the opposite sign. Of
    three answers, P is that of 'second' where the answer is not 'equal'.
    """
    _, slopes = posterior.rows.answer_slopes(posterior.full_points(point))
    coordinate = task_parameters(posterior.subject.task).index(CONSTANT_ERROR)
    # The last two answers are the counted and the other answer; of three, 'second' and 'first'.
    *_, counted, other = slopes
    in_constant_error = (counted - other)[0, 0, coordinate]  # (pairs,)
    # The coordinate of a constant error c is u = (c / D) / scale, so that the slope in c / D is the
    # slope in u over the scale.
    return -in_constant_error / posterior.prior.constant_error_scale


def _scores(subject: Subject, trials: TrialSequence, slopes: FloatArray) -> ArrayPair:
    """U, shape (3, sequences), and V, shape (3, 3), as in the module's docstring.

    The first sequence is the observed one. Random orders follow where the reference is not
    chi-square.
    """
    # The tested trials have an answer and a trial before, which may be without an answer.
    tested_trials = np.flatnonzero(trials.is_answered & ~trials.is_session_start)
    previous = tested_trials - 1
    pair = trials.pair[tested_trials]

    # Trials and counted answers of each pair. A pair with fewer than two tested trials says
    # nothing: 1 in the place of 0 avoids 0/0.
    n_pairs = subject.n_pairs
    n = np.bincount(pair, minlength=n_pairs)
    k = np.bincount(pair, trials.answer[tested_trials] > 0.0, n_pairs)
    n_safe = np.maximum(n, 1.0)
    pair_variance = k * (n - k) / np.maximum(n * (n - 1.0), 1.0)

    stimuli = np.stack([trials.first, trials.second])
    # The mean stimulus cancels below. Without it there, less is lost to rounding.
    stimulus_regressors = slopes[pair] * (stimuli[:, previous] - stimuli.mean())
    regressors = np.vstack([trials.answer[previous], stimulus_regressors])  # (3, tested trials)
    # Each pair's mean is subtracted; a regressor is a row of the array, which changes.
    for regressor in regressors:
        regressor -= (np.bincount(pair, regressor, n_pairs) / n_safe)[pair]
    variance = (regressors * pair_variance[pair]) @ regressors.T  # (3, 3)

    answers = trials.answer[None]  # (sequences, trials)
    if np.minimum(k, n - k).sum() < _ENOUGH_RARER_ANSWERS:
        rng = generator(0, subject.name, "previous trial")  # seed 0: p-values never change
        n_orders = _SIMULATED_TRIALS // len(trials.pair)
        answers = np.vstack(
            [answers, _random_orders(trials.answer, tested_trials, pair, n_orders, rng)]
        )
    # Residuals, (sequences, tested trials). An answer is 1 or -1, and its y is 1 or 0.
    residuals = 0.5 * (answers[:, tested_trials] + 1.0) - (k / n_safe)[pair]

    # Two tested trials of one pair that follow each other are not independent: the mean of their
    # product is -2 k (n - k) / (n^2 (n - 1)), which is subtracted.
    is_same_pair = np.isin(previous, tested_trials) & (trials.pair[previous] == pair)
    correction = (2.0 * pair_variance / n_safe)[pair[is_same_pair]].sum()
    answer_score = np.sum(residuals * answers[:, previous], axis=1) + correction
    # The scores of the two stimuli, regressors 1 and 2, have no correction.
    scores = np.vstack([answer_score, regressors[1:] @ residuals.T])
    if len(answers) > 1:  # V is the mean over the sequences
        variance = scores @ scores.T / len(answers)
    return scores, variance


def _random_orders(
    values: FloatArray, positions: IndexArray, pair: IndexArray, size: int, rng: Rng
) -> FloatArray:
    """`size` sequences of the values, each with the values of every pair in random order.

    `positions` are those of the values that change places, and `pair` has the pair of each value.
    """
    shuffled = np.tile(values, (size, 1))
    for i in np.unique(pair):
        positions_of_pair = positions[pair == i]
        shuffled[:, positions_of_pair] = rng.permuted(shuffled[:, positions_of_pair], axis=1)
    return shuffled


def _moving_criterion_p(subject: Subject, trials: TrialSequence) -> float | None:
    """P-value of a criterion that wanders; None where there is nothing to test.

    The statistic is T in the module's docstring, times a constant.
    """
    share = (subject.n_yes / subject.n_trials)[trials.pair]
    residual = np.where(trials.is_answered, (trials.answer > 0.0) - share, 0.0)  # e
    if not residual.any():  # every pair has one answer only
        return None

    # A sum of e_s e_t w(t - s) over trials is, up to a constant, the sum over frequencies of the
    # power of e times the spectrum of w. Weights begin at a lag of 2 trials.
    n_trials = len(trials.pair)
    n_padded = 2 * n_trials  # so that the last trial is no neighbour of the first
    kernel = np.zeros(n_padded)  # w at all lags; negative lags stand at the end
    lags = np.arange(2, n_trials)
    kernel[lags] = kernel[-lags] = 1.0 / np.sqrt(lags)
    weights = np.fft.rfft(kernel).real
    weights[1:-1] *= 2.0  # a real transform has each of these frequencies once, not twice

    answered_trials = np.flatnonzero(trials.is_answered)
    pair = trials.pair[answered_trials]
    rng = generator(0, subject.name, "moving criterion")  # seed 0: the p-value never changes

    def statistic(residuals: FloatArray) -> FloatArray:
        """The statistic of sequences of residuals, shape (sequences, trials)."""
        power = np.square(np.abs(np.fft.rfft(residuals, n_padded)))
        return np.asarray(power @ weights)

    return simulated_p_value(
        float(statistic(residual[None])[0]),
        lambda size: statistic(_random_orders(residual, answered_trials, pair, size, rng)),
    )


def _p_value(scores: FloatArray, variance: FloatArray) -> float | None:
    """p-value of all regressors together; None if no regressor varies.

    U' V^-1 U has a term for each regressor given the earlier regressors (Gaussian elimination). A
    regressor with less than 1e-9 of its variance left is a linear function of earlier regressors,
    up to rounding, and has no term.
    """
    statistics = np.zeros_like(scores[0])  # U' V^-1 U
    remaining_variance = variance  # V, given the regressors so far
    degrees_of_freedom = 0
    for i in range(len(variance)):
        own_variance = remaining_variance[i, i]
        if own_variance > 1e-9 * variance[i, i]:
            statistics += scores[i] ** 2 / own_variance
            degrees_of_freedom += 1
            # What is left of the other regressors, given this regressor.
            slope = remaining_variance[:, i] / own_variance
            scores = scores - np.outer(slope, scores[i])
            remaining_variance = remaining_variance - np.outer(slope, remaining_variance[i])
    if not degrees_of_freedom:
        return None
    if len(statistics) == 1:  # the observed sequence alone
        return float(chdtrc(degrees_of_freedom, statistics[0]))
    # The first sequence is the observed one. Statistics that differ by rounding count as equal.
    return float(np.mean(statistics >= statistics[0] - 1e-9))
