"""A quick look whether answers depend on the trials before: score tests.

`serial_screen` gives the p-values of a subject, `subject_screen` at the maximum of a model.

The null hypothesis has a free probability for each pair, so that no curve is assumed. Given how
often each pair got each answer, every order of a pair's answers is equally probable. So the
reference of each statistic is the same statistic with the answers to each pair in random orders.

A pair has n trials and k counted answers, and y is 1 where a trial has the counted answer and else
0. With the residual e = y - k/n of a trial and its regressors h, from which each pair's mean is
subtracted, the statistic of the trial before is U' V^-1 U with

    U = sum e h,   V = sum k (n - k) / (n (n - 1)) h h'

h holds the answer of the trial before (1, -1; 0 after a missing one), and its two stimuli times g,
the slope of logit P in s2 - s1 of the present pair: what a shift of the criterion by a share of
those stimuli does.

A criterion that wanders makes the residuals of neighbouring trials alike. The statistic sees it at
short and at long time scales; the weights are those of a noise whose power falls with frequency:

    T = sum over trials s and t, t - s > 1, of e_s e_t / sqrt(t - s)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bayes_toe.arrays import FloatArray, IndexArray, Rng
from bayes_toe.checks.alarm_rate import simulated_p_value
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.inference.order_evidence import MODEL_NAMES, OrderEvidence
from bayes_toe.model.models import ObserverPosterior, OrderModel
from bayes_toe.model.parameters import CONSTANT_ERROR, task_parameters
from bayes_toe.model.trial_history import TrialSequence
from bayes_toe.seeds import generator


@dataclass(frozen=True)
class SerialScreen:
    """P-values of the score tests; None where a test has nothing to say, or the order is not known.

    Attributes
    ----------
    joint_p : float or None
        Previous answer and stimuli together; `history_p` of tables.
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
    return SerialScreen(
        joint_p=_previous_trial_p(tested_subject, trials, slopes),
        moving_criterion_p=_moving_criterion_p(tested_subject, trials),
    )


def logit_slopes(posterior: ObserverPosterior, point: FloatArray) -> FloatArray:
    """Slope of logit P(counted answer) in the constant error at a point, (k,) -> (pairs,).

    It is the slope in s2 - s1 times a number, which cancels in the statistic. Of three answers, P
    is that of 'second' where the answer is not 'equal'.
    """
    _, slopes = posterior.rows.answer_slopes(posterior.full_points(point))
    coordinate = task_parameters(posterior.subject.task).index(CONSTANT_ERROR)
    # The last two answers are the counted and the other answer; of three, 'second' and 'first'.
    *_, counted, other = slopes
    # The slope of logit P = log P - log(1 - P), for the one row and point.
    return np.asarray((counted - other)[0, 0, coordinate])


def _previous_trial_p(subject: Subject, trials: TrialSequence, slopes: FloatArray) -> float | None:
    """P-value of an effect of the trial before; None where there is nothing to test.

    `slopes` has the slope g of each pair.
    """
    # The tested trials have an answer and a trial before, which may be without an answer.
    tested_trials = np.flatnonzero(trials.is_answered & ~trials.is_session_start)
    previous = tested_trials - 1
    pair = trials.pair[tested_trials]

    # Trials n and counted answers k of each pair, (pairs,). A pair without tested trials says
    # nothing: 1 in the place of 0 avoids 0/0.
    n = np.maximum(np.bincount(pair), 1)
    k = np.bincount(pair, trials.answer[tested_trials] > 0.0)
    pair_variance = k * (n - k) / (n * np.maximum(n - 1, 1))

    # The regressors h are the answer and both stimuli of the trial before, (3, tested trials),
    # without each pair's mean. The mean stimulus cancels; without it, less is lost to rounding.
    stimuli = np.stack([trials.first, trials.second])  # (2, trials)
    stimulus_regressors = slopes[pair] * (stimuli[:, previous] - stimuli.mean())
    h = np.vstack([trials.answer[previous], stimulus_regressors])
    pair_means = np.stack([np.bincount(pair, regressor) / n for regressor in h])  # (3, pairs)
    h = h - pair_means[:, pair]

    variance = (h * pair_variance[pair]) @ h.T  # V, (3, 3)
    if not variance.any():
        return None
    inverse = _pseudo_inverse(variance)

    def statistic(answers: FloatArray) -> FloatArray:
        """U' V^-1 U of sequences of answers 1 and -1, (sequences, trials) -> (sequences,)."""
        y = 0.5 * (answers[:, tested_trials] + 1.0)
        e = y - (k / n)[pair]  # (sequences, tested trials)
        # The previous answers change with the sequence. They keep the mean of each pair, because
        # the residuals e add up to 0 over the trials of a pair.
        answer_score = (e * answers[:, previous]).sum(axis=1)
        stimulus_scores = h[1:] @ e.T  # of the two stimuli
        scores = np.vstack([answer_score, stimulus_scores])  # U, (3, sequences)
        return np.asarray((scores * (inverse @ scores)).sum(axis=0))

    rng = generator(0, subject.name, "previous trial")  # seed 0: the p-value never changes
    return _random_order_p(statistic, trials.answer, tested_trials, pair, rng)


def _pseudo_inverse(variance: FloatArray) -> FloatArray:
    """Inverse of a variance matrix, (n, n), in which some variables may follow from others.

    A variable that follows from others, or that does not vary, adds nothing. The matrix is inverted
    in units in which each variable has the variance 1.
    """
    sd = np.sqrt(np.diagonal(variance))
    unit = np.where(sd > 0.0, sd, 1.0)
    unit_products = np.outer(unit, unit)
    return np.linalg.pinv(variance / unit_products, rcond=1e-9, hermitian=True) / unit_products


def _random_order_p(
    statistic: Callable[[FloatArray], FloatArray],
    values: FloatArray,
    positions: IndexArray,
    pair: IndexArray,
    rng: Rng,
) -> float:
    """P-value of a statistic of a sequence of values, with the values of each pair in random order.

    `values` has a value for each trial, (trials,). The values at `positions` change places with
    others of the same pair; `pair` has the pair of each of these positions. `statistic` maps
    sequences, (sequences, trials), to (sequences,).
    """

    def simulate(size: int) -> FloatArray:
        """The statistic of `size` random orders, (size,)."""
        shuffled = np.tile(values, (size, 1))
        for i in np.unique(pair):
            positions_of_pair = positions[pair == i]
            shuffled[:, positions_of_pair] = rng.permuted(shuffled[:, positions_of_pair], axis=1)
        return statistic(shuffled)

    return simulated_p_value(float(statistic(values[None])[0]), simulate)


def _moving_criterion_p(subject: Subject, trials: TrialSequence) -> float | None:
    """P-value of a criterion that wanders; None where there is nothing to test.

    The statistic is T in the module's docstring, times a constant.
    """
    share = (subject.n_yes / subject.n_trials)[trials.pair]
    e = np.where(trials.is_answered, (trials.answer > 0.0) - share, 0.0)  # residuals, (trials,)
    if not e.any():  # every pair has one answer only
        return None

    # The sum over trials s and t of e_s e_t w(t - s), with the weight w(lag) = 1/sqrt(lag) from a
    # lag of 2 trials on, is up to a constant a sum over frequencies: the power of e times the
    # spectrum of w.
    n_trials = len(e)
    n_padded = 2 * n_trials  # so that the last trial is no neighbour of the first
    w = np.zeros(n_padded)  # negative lags stand at the end
    lags = np.arange(2, n_trials)
    w[lags] = w[-lags] = 1.0 / np.sqrt(lags)
    spectrum = np.fft.rfft(w).real
    spectrum[1:-1] *= 2.0  # a real transform has each of these frequencies once, not twice

    def statistic(residuals: FloatArray) -> FloatArray:
        """The statistic of sequences of residuals, (sequences, trials) -> (sequences,)."""
        power = np.square(np.abs(np.fft.rfft(residuals, n_padded)))  # (sequences, frequencies)
        return np.asarray(power @ spectrum)

    answered_trials = np.flatnonzero(trials.is_answered)
    rng = generator(0, subject.name, "moving criterion")  # seed 0: the p-value never changes
    return _random_order_p(statistic, e, answered_trials, trials.pair[answered_trials], rng)
