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
    """p-values of the score tests; None where a test has nothing to say, or the order is not known.

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
    """Slope of logit P in the constant error, for each pair at a point of shape (k,).

    It is the slope in s2 - s1 times a number, which cancels in the statistic. Of three answers, P
    is that of 'second' where the answer is not 'equal'.
    """
    _, slopes = posterior.rows.answer_slopes(posterior.full_points(point))
    coordinate = task_parameters(posterior.subject.task).index(CONSTANT_ERROR)
    # The last two answers are the counted and the other answer; of three, 'second' and 'first'.
    *_, counted, other = slopes
    return np.asarray((counted - other)[0, 0, coordinate])  # (pairs,)


def _previous_trial_p(subject: Subject, trials: TrialSequence, slopes: FloatArray) -> float | None:
    """P-value of an effect of the trial before; None where there is nothing to test.

    `slopes` has the slope g of each pair.
    """
    # The tested trials have an answer and a trial before, which may be without an answer.
    tested_trials = np.flatnonzero(trials.is_answered & ~trials.is_session_start)
    previous = tested_trials - 1
    pair = trials.pair[tested_trials]

    # Trials and counted answers of each pair. A pair without tested trials says nothing: 1 in the
    # place of 0 avoids 0/0.
    n_pairs = subject.n_pairs
    n = np.maximum(np.bincount(pair, minlength=n_pairs), 1)
    k = np.bincount(pair, trials.answer[tested_trials] > 0.0, n_pairs)
    pair_variance = k * (n - k) / (n * np.maximum(n - 1, 1))

    stimuli = np.stack([trials.first, trials.second])
    # The mean stimulus cancels below. Without it there, less is lost to rounding.
    stimulus_regressors = slopes[pair] * (stimuli[:, previous] - stimuli.mean())
    regressors = np.vstack([trials.answer[previous], stimulus_regressors])  # (3, tested trials)
    # Each pair's mean is subtracted; a regressor is a row of the array, which changes.
    for regressor in regressors:
        regressor -= (np.bincount(pair, regressor, n_pairs) / n)[pair]
    variance = (regressors * pair_variance[pair]) @ regressors.T  # V, (3, 3)
    if not variance.any():
        return None
    # The inverse of V in units in which each regressor has the variance 1. A regressor that follows
    # from others, or that does not vary, adds nothing.
    sd = np.sqrt(np.diagonal(variance))
    unit = np.where(sd > 0.0, sd, 1.0)
    unit_products = np.outer(unit, unit)
    inverse = np.linalg.pinv(variance / unit_products, rcond=1e-9, hermitian=True) / unit_products

    def statistic(answers: FloatArray) -> FloatArray:
        """The statistic of sequences of answers, shape (sequences, trials)."""
        # An answer is 1 or -1, and its y is 1 or 0.
        residuals = 0.5 * (answers[:, tested_trials] + 1.0) - (k / n)[pair]
        # Unlike the rows of `regressors`, the previous answers keep the mean of each pair, because
        # residuals add up to 0 over the trials of a pair.
        answer_score = (residuals * answers[:, previous]).sum(axis=1)
        stimulus_scores = regressors[1:] @ residuals.T  # of the two stimuli
        scores = np.vstack([answer_score, stimulus_scores])  # U, (3, sequences)
        return np.asarray((scores * (inverse @ scores)).sum(axis=0))  # U' V^-1 U

    rng = generator(0, subject.name, "previous trial")  # seed 0: the p-value never changes
    return _random_order_p(statistic, trials.answer, tested_trials, pair, rng)


def _random_order_p(
    statistic: Callable[[FloatArray], FloatArray],
    values: FloatArray,
    positions: IndexArray,
    pair: IndexArray,
    rng: Rng,
) -> float:
    """P-value of a statistic of a sequence of values, with the values of each pair in random order.

    `positions` are those of the values that change places, and `pair` has the pair of each of them.
    """

    def simulate(size: int) -> FloatArray:
        """The statistic of `size` random orders."""
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

    return _random_order_p(statistic, residual, answered_trials, pair, rng)
