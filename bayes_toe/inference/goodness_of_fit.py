"""Does the model describe the answers? The deviance of a subject and its p-value.

`summarise_fit` gives :class:`GoodnessOfFit` of a subject.

The deviance D compares the answers with the model at the maximum of the posterior density. Its
reference is a scaled chi-square. The parameters that the answers determine count against the pairs:

    p_D = mean of D over the posterior - D at the maximum       (Spiegelhalter et al. 2002)

A parameter that the prior determines does not count, so few pairs do not make a poor fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import chdtrc, gammaln, xlogy

from bayes_toe.arrays import ArrayPair, FloatArray, IndexArray, thinned
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.model.answer_curves import log_questions, times_counts
from bayes_toe.model.posterior import SubjectPosterior

# --- Deviance -------------------------------------------------------------------------------------


def binomial_deviance(
    n_yes: npt.ArrayLike, n_trials: npt.ArrayLike, log_q: FloatArray, log_other: FloatArray
) -> FloatArray:
    """Deviance of k answers in n from their probability q, in nats times 2.

    Arguments broadcast; the other answer has the probability 1 - q.

    D = 2 [k ln(k/(n q)) + (n - k) ln((n - k)/(n (1 - q)))] is twice the log likelihood of the
    saturated model minus that of this one. `log_q` and `log_other` are the logs of q and of 1 - q,
    because either probability may be below the smallest float. D is infinite where an answer was
    given that has the probability 0.
    """
    k = np.asarray(n_yes, np.float64)
    n = np.asarray(n_trials, np.float64)
    saturated = xlogy(k, k / n) + xlogy(n - k, (n - k) / n)
    log_ratio = saturated - times_counts(k, log_q) - times_counts(n - k, log_other)
    return 2.0 * np.maximum(log_ratio, 0.0)  # rounding can make the log ratio negative


def deviance_p_value(
    deviance: float,
    freedom: float,
    n_trials: npt.ArrayLike,
    log_q: FloatArray,
    log_other: FloatArray,
) -> float:
    """Chance of a deviance that is at least as large, with these degrees of freedom.

    The chance is NaN without degrees of freedom. The reference is chi-square if every pair has many
    answers of both kinds. Otherwise it is a scaled chi-square: the mean and variance of each pair's
    deviance follow from the logs of q and 1 - q, shape (pairs,). Mean and variance of the sum are
    multiplied by degrees of freedom over pairs.

    Examples
    --------
    >>> half = np.full(6, np.log(0.5))
    >>> quantile = 13.28  # at 99 %, of chi-square with 4 degrees of freedom
    >>> round(deviance_p_value(quantile, 4, np.full(6, 1000), half, half), 4)
    0.01
    """
    if freedom <= 0.0:
        return float("nan")
    moments = _moments(np.asarray(n_trials, np.float64), log_q, log_other)
    mean, variance = (float(by_pair.sum()) for by_pair in moments)
    if variance == 0.0:  # the model is certain of all answers: 1 if it is right, else 0
        return float(deviance <= 0.0)

    # a times a chi-square with f degrees of freedom has the mean a f and the variance 2 a^2 f. Mean
    # and variance are multiplied by `freedom` over pairs, so that a does not depend on `freedom`.
    inverse_scale = 2.0 * mean / variance
    reference_freedom = 2.0 * mean**2 / variance * freedom / len(log_q)
    return float(chdtrc(reference_freedom, inverse_scale * deviance))


def _moments(n: FloatArray, log_q: FloatArray, log_other: FloatArray) -> ArrayPair:
    """Mean and variance of each pair's deviance, over the counts of its less probable answer.

    Mean and variance are 1 and 2, as of chi-square with one degree of freedom, if this answer is
    expected 20 times or more. Where it is expected less often, counts above 100 have almost no
    probability.
    """
    log_rare = np.minimum(log_q, log_other)
    log_common = np.maximum(log_q, log_other)
    n_counts = min(101, int(n.max()) + 1)  # the counts 0 to 100, or to the largest n
    counts = np.arange(n_counts, dtype=np.float64)[:, None]  # (counts, 1); n is (pairs,)
    k = np.minimum(counts, n)  # (counts, pairs): a pair of fewer trials lacks the last counts

    # The binomial probability of each count.
    log_ways = gammaln(n + 1.0) - gammaln(k + 1.0) - gammaln(n - k + 1.0)
    log_chance = log_ways + times_counts(k, log_rare) + times_counts(n - k, log_common)
    chance = np.where(counts <= n, np.exp(log_chance), 0.0)

    deviance = np.where(chance > 0.0, binomial_deviance(k, n, log_rare, log_common), 0.0)
    mean = (chance * deviance).sum(axis=0)
    variance = (chance * (deviance - mean) ** 2).sum(axis=0)
    is_rare = n * np.exp(log_rare) < 20.0
    return np.where(is_rare, mean, 1.0), np.where(is_rare, variance, 2.0)


# --- Goodness of fit ------------------------------------------------------------------------------


@dataclass(frozen=True)
class PairResidual:
    """A pair with the observed and the expected share of an answer.

    Stimuli are natural-log intensities.
    """

    s1: float
    s2: float
    observed: float
    expected: float
    answer: str = SAME_DIFFERENT.yes


@dataclass(frozen=True)
class GoodnessOfFit:
    """Goodness of fit of one subject in a few numbers, for tables.

    Attributes
    ----------
    deviance : float
        The deviance at the maximum of the posterior density, against one free probability per pair.
    degrees_of_freedom : int
        Pairs less the free parameters. With three answers, a pair that has unequal answers counts
        twice.
    fit_p : float
        P-value of the deviance; NaN without degrees of freedom.
    worst : tuple of PairResidual
        Up to three pairs with the largest residuals, the largest first. All but the first have a
        residual of at least 2. A file of draws does not store them.
    """

    deviance: float
    degrees_of_freedom: int
    fit_p: float = float("nan")
    worst: tuple[PairResidual, ...] = ()


def summarise_fit(posterior: SubjectPosterior, x: FloatArray, maximum: FloatArray) -> GoodnessOfFit:
    """Goodness of fit of one subject.

    The responses determine fewer parameters than the model has, because the prior determines them
    too. Their effective number is the mean deviance of the draws minus the deviance at the maximum.
    The p-value depends on this number. It exists where there are more questions than coordinates.

    Parameters
    ----------
    posterior : SubjectPosterior
    x : ndarray, shape (draws, k)
        Draws from the posterior, unconstrained.
    maximum : ndarray, shape (k,)
        The point with the highest posterior density.
    """
    # The maximum comes first; 2000 draws are enough for a mean.
    points = np.vstack([maximum, thinned(x, 2000)])
    questions = log_questions(posterior.log_answers(points))
    # Of all pairs the first question, then the second one, which three answers have.
    log_yes, log_no = np.concatenate(questions, axis=-1)  # (1 + draws, questions) each
    counts = posterior.rows.counts[0, :, 0]  # of the one row, (answers, pairs)
    n_yes = counts[:-1].ravel()
    # A question is asked until an answer is counted: in fewer trials than the question before. If
    # all answers to a pair are 'equal', its second question has no trial and does not count.
    n_trials = np.concatenate([counts[i:].sum(axis=0) for i in range(len(questions))])
    asked_index = np.flatnonzero(n_trials)
    n_yes, n_trials = n_yes[asked_index], n_trials[asked_index]
    log_yes, log_no = log_yes[:, asked_index], log_no[:, asked_index]

    deviances = binomial_deviance(n_yes, n_trials, log_yes, log_no)  # (1 + draws, questions)
    deviance = float(deviances[0].sum())
    n_determined = float(deviances[1:].sum(axis=1).mean()) - deviance  # p_D

    freedom = len(asked_index) - len(posterior.coordinates)
    if freedom > 0:
        effective_freedom = len(asked_index) - n_determined
        fit_p = deviance_p_value(deviance, effective_freedom, n_trials, log_yes[0], log_no[0])
    else:
        fit_p = float("nan")

    shares = np.stack([n_yes / n_trials, np.exp(log_yes[0])])
    worst = _worst_pairs(posterior.subject, asked_index, np.sqrt(deviances[0]), shares)
    return GoodnessOfFit(deviance, freedom, fit_p, worst)


def _worst_pairs(
    subject: Subject, asked_index: IndexArray, residuals: FloatArray, shares: FloatArray
) -> tuple[PairResidual, ...]:
    """The pairs with the largest residuals, see :class:`GoodnessOfFit`.

    `asked_index` has the pair of each first question, and the number of pairs more for a second
    question, see :func:`log_questions`. `shares` has the observed and the expected share of the
    counted answer, (2, questions).
    """
    largest_first = np.argsort(-residuals, kind="stable").tolist()
    worst: list[PairResidual] = []
    for i in largest_first[:3]:
        if worst and residuals[i] < 2.0:  # all but the first need a residual of 2
            break
        question, pair = divmod(int(asked_index[i]), subject.n_pairs)
        observed_and_expected = shares[:, i]
        if question == 1:  # asked where the answer to question 0, of index `pair`, was no
            observed_and_expected = observed_and_expected * (1.0 - shares[:, pair])
        observed, expected = observed_and_expected.tolist()
        s1 = float(subject.s1[pair])
        s2 = float(subject.s2[pair])
        worst.append(PairResidual(s1, s2, observed, expected, subject.task.questions[question]))
    return tuple(worst)
