"""Does the model describe the answers? Deviance and posterior predictive p-values.

`summarise_fit` gives :class:`GoodnessOfFit` of a subject, from `fit_at` and `predictive_check`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import betainc, chdtrc, gammaln, xlogy

from bayes_toe.arrays import ArrayPair, FloatArray, IntArray, thinned
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.model.answer_curves import times_counts
from bayes_toe.model.posterior import AnswerPosterior, require_points
from bayes_toe.seeds import generator

#: Below this posterior predictive p-value, or p-value of the deviance, the model is said not to
#: describe the answers.
MISFIT = 0.01
_BLOCK = 1 << 18  # values of one temporary array
_OFTEN = 20.0  # expected rarer answers from which chi-square holds for a pair
_COUNTS = 101  # counts that matter where there are fewer
_OF_MOMENTS = 3000  # draws times pairs over which the moments of a deviance are averaged
_CONSPICUOUS = 2.0  # residual from which a pair is named among the worst
_MOST_WORST = 3  # how many are


# --- Deviance -------------------------------------------------------------------------------------


def binomial_deviance(
    n_yes: npt.ArrayLike, n_trials: npt.ArrayLike, log_q: FloatArray, log_rest: FloatArray
) -> FloatArray:
    """Deviance of k answers in n from their probability q, in nats times 2.

    Arguments broadcast; the other answer has the probability 1 - q.

    D = 2 [k ln(k/(n q)) + (n - k) ln((n - k)/(n (1 - q)))] is twice the log likelihood of the
    saturated model minus that of this one. `log_q` and `log_rest` are the logs of q and of 1 - q,
    because either probability may be below the smallest float. D is infinite where an answer was
    given that has the probability 0.
    """
    k, n = np.asarray(n_yes, np.float64), np.asarray(n_trials, np.float64)
    saturated = xlogy(k, k / n) + xlogy(n - k, (n - k) / n)
    return 2.0 * np.maximum(saturated - times_counts(k, log_q) - times_counts(n - k, log_rest), 0.0)


@dataclass(frozen=True, eq=False)
class Fit:
    """Fit of one subject's answers at one point."""

    q: FloatArray  # (pairs,): their probability by the model
    # (pairs,): signed root of the deviance; positive where the answer that the task counts was
    # given more often than the model has it
    residual: FloatArray
    deviance: float  # sum over pairs, against the saturated model
    degrees_of_freedom: int  # pairs less the free parameters
    # P(deviance >= this one), see :func:`deviance_p_value`; NaN without degrees of freedom
    p_value: float


def fit_at(posterior: AnswerPosterior, x: npt.ArrayLike) -> Fit:
    """Deviance and residuals at one unconstrained point x, shape (k,).

    Meant for the maximum of the likelihood.
    """
    (log_q,), (log_rest,) = posterior.log_answers(np.asarray(x, np.float64).reshape(1, -1))
    subject, q = posterior.subject, np.exp(log_q)
    pairs = binomial_deviance(subject.n_yes, subject.n_trials, log_q, log_rest)
    sign = np.sign(subject.n_yes - subject.n_trials * q)
    freedom = subject.n_pairs - len(posterior.coordinates)
    p_value = deviance_p_value(float(pairs.sum()), freedom, subject.n_trials, log_q, log_rest)
    return Fit(q, sign * np.sqrt(pairs), float(pairs.sum()), freedom, p_value)


def deviance_p_value(
    value: float, freedom: int, n_trials: npt.ArrayLike, log_q: FloatArray, log_rest: FloatArray
) -> float:
    """P(deviance >= value) of a fit with these degrees of freedom; NaN without any.

    The reference is chi-square if every pair has many answers of both kinds. Otherwise it is a
    scaled chi-square: the mean and variance of each pair's deviance follow from the logs of q and
    1 - q, and those of the sum are multiplied by degrees of freedom over pairs. Logs may have the
    shape (pairs,) or (draws, pairs); draws are averaged. The maximum alone has too little scatter
    where answers are few.

    Examples
    --------
    >>> half = np.full(6, np.log(0.5))
    >>> quantile = 13.28  # at 99 %, of chi-square with 4 degrees of freedom
    >>> round(deviance_p_value(quantile, 4, np.full(6, 1000), half, half), 4)
    0.01
    """
    if freedom <= 0:
        return float("nan")
    moments = _moments(
        np.asarray(n_trials, np.float64), np.atleast_2d(log_q), np.atleast_2d(log_rest)
    )
    mean, variance = (float(values.sum(axis=1).mean()) for values in moments)
    if variance == 0.0:  # the answers are certain under the model
        return float(value <= 0.0)
    reference_freedom = 2.0 * mean**2 / variance * freedom / log_q.shape[-1]
    return float(chdtrc(reference_freedom, 2.0 * mean / variance * value))


def _moments(n: FloatArray, log_q: FloatArray, log_rest: FloatArray) -> ArrayPair:
    """Mean and variance of each pair's deviance, over the counts of its less probable answer.

    They are 1 and 2, as of chi-square, if this answer is expected often enough.
    """
    log_rare, log_common = np.minimum(log_q, log_rest), np.maximum(log_q, log_rest)
    n_counts = min(_COUNTS, int(n.max()) + 1)
    counts = np.arange(n_counts, dtype=np.float64)[:, None, None]  # (counts, draws, pairs)
    k = np.minimum(counts, n)
    log_ways = gammaln(n + 1.0) - gammaln(k + 1.0) - gammaln(n - k + 1.0)
    log_chance = log_ways + times_counts(k, log_rare) + times_counts(n - k, log_common)
    chance = np.where(counts <= n, np.exp(log_chance), 0.0)
    deviance = np.where(chance > 0.0, binomial_deviance(k, n, log_rare, log_common), 0.0)
    mean = (chance * deviance).sum(axis=0)
    variance = (chance * (deviance - mean) ** 2).sum(axis=0)
    is_rare = n * np.exp(log_rare) < _OFTEN
    return np.where(is_rare, mean, 1.0), np.where(is_rare, variance, 2.0)


# --- Posterior predictive check -------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PredictiveCheck:
    """Observed answers against predictions for a repetition of the experiment.

    P(n_rep <= n_yes) and P(n_rep >= n_yes) for replicated counts are binomial tails averaged over
    draws, not simulated.
    """

    expected: (
        FloatArray  # (pairs,): posterior mean of the probability of the answer that the task counts
    )
    p_fewer: FloatArray
    p_more: FloatArray
    # P(deviance of replicated counts >= deviance of the observed ones), both at the same draw
    p_overall: float
    p_overall_se: float  # its Monte Carlo standard error, counting draws as independent

    @property
    def p_value(self) -> FloatArray:
        """Two-sided p-value of every pair, twice the smaller tail.

        Conservative, since the same answers shaped the posterior.
        """
        return np.minimum(1.0, 2.0 * np.minimum(self.p_fewer, self.p_more))


def predictive_check(posterior: AnswerPosterior, x: npt.ArrayLike, seed: int) -> PredictiveCheck:
    """Posterior predictive p-values of one subject from draws x, shape (draws, k), unconstrained.

    The seed is that of the replicated counts, which enter `p_overall` only; the stream is keyed by
    subject and model.
    """
    points, subject = require_points(x, len(posterior.coordinates)), posterior.subject
    n_yes, n_trials = subject.n_yes, subject.n_trials
    rng = generator(seed, subject.name, posterior.model.name, "predictive check")
    expected, p_fewer, p_more = np.zeros((3, subject.n_pairs))
    n_beyond, n_rows = 0, max(1, _BLOCK // subject.n_pairs)
    for start in range(0, len(points), n_rows):
        log_yes, log_no = posterior.log_answers(points[start : start + n_rows])
        p_yes, p_no = np.exp(log_yes), np.exp(log_no)
        expected += p_yes.sum(axis=0)
        p_fewer += _at_most(n_yes, n_trials, p_no).sum(axis=0)
        p_more += _at_most(n_trials - n_yes, n_trials, p_yes).sum(axis=0)
        replicated = rng.binomial(n_trials, p_yes)
        deviance = binomial_deviance(n_yes, n_trials, log_yes, log_no).sum(axis=1)
        of_replicated = binomial_deviance(replicated, n_trials, log_yes, log_no).sum(axis=1)
        n_beyond += int(np.count_nonzero(of_replicated >= deviance))
    n_draws = len(points)
    share = n_beyond / n_draws
    se = float(np.sqrt(share * (1.0 - share) / n_draws))
    return PredictiveCheck(expected / n_draws, p_fewer / n_draws, p_more / n_draws, share, se)


def _at_most(count: IntArray, n_trials: IntArray, p_other: FloatArray) -> FloatArray:
    """P(no more than `count` answers in `n_trials`), from the probability of the other answer."""
    n_other = np.maximum(n_trials - count, 1)
    return np.where(count < n_trials, betainc(n_other, count + 1, p_other), 1.0)


@dataclass(frozen=True)
class PairResidual:
    """A pair with its observed share of an answer and the one that the model expects.

    Stimuli are natural-log intensities, the interval is in seconds.
    """

    s1: float
    s2: float
    observed: float
    expected: float
    isi: float | None = None
    answer: str = SAME_DIFFERENT.yes


@dataclass(frozen=True)
class GoodnessOfFit:
    """Goodness of fit of one subject in a few numbers, for tables.

    The deviance is the smallest over the draws. With thousands of draws it is within about 0.1 of
    the deviance at the maximum of the likelihood. `worst` has up to three pairs with the largest
    residuals at that draw, the largest first. All but the first have a residual of at least 2. A
    file of draws does not store them, so a summary from a file has none.
    """

    deviance: float
    degrees_of_freedom: int  # pairs less the free parameters
    # posterior predictive p-value of the deviance, and its Monte Carlo error, see
    # :class:`PredictiveCheck`
    p_overall: float
    p_overall_se: float
    # smallest two-sided posterior predictive p-value of a pair, not corrected for the number of
    # pairs
    worst_p: float
    worst_s1: float  # that pair, natural-log intensity, at its interval, seconds
    worst_s2: float
    worst_isi: float | None = None
    p_deviance: float = float(
        "nan"
    )  # see :func:`deviance_p_value`, moments averaged over draws; NaN without degrees of freedom
    worst: tuple[PairResidual, ...] = ()

    @property
    def misfit(self) -> bool:
        """Whether the model does not describe the answers: a p-value is below 0.01."""
        return self.p_overall < MISFIT or self.p_deviance < MISFIT

    @property
    def describes(self) -> bool | None:
        """Whether the model describes the answers.

        None where it cannot be told: with no more pairs than parameters it fits them all.
        """
        if self.degrees_of_freedom <= 0 and not self.misfit:
            return None
        return not self.misfit


def summarise_fit(
    posterior: AnswerPosterior,
    x: npt.ArrayLike,
    seed: int,
    *,
    log_likelihood: FloatArray | None = None,
    most: int = 2000,
) -> GoodnessOfFit:
    """Deviance and posterior predictive p-values of one subject from draws x, (draws, k).

    The predictive check takes up to `most` draws, evenly spaced. The smallest deviance is that of
    the draw with the highest log likelihood. `log_likelihood`, shape (draws,), is computed if it is
    not given.
    """
    points, subject = require_points(x, len(posterior.coordinates)), posterior.subject
    check = predictive_check(posterior, thinned(points, most), seed)
    if log_likelihood is None:
        log_likelihood = posterior.log_likelihood(points)
    fit = fit_at(posterior, points[int(np.argmax(log_likelihood))])
    few = thinned(points, _OF_MOMENTS / subject.n_pairs)
    answers = posterior.log_answers(few)
    p_deviance = deviance_p_value(fit.deviance, fit.degrees_of_freedom, subject.n_trials, *answers)
    worst = _pair_residual(subject, fit, int(np.argmin(check.p_value)))
    size = np.abs(fit.residual)
    largest, *smaller = np.argsort(-size, kind="stable").tolist()[:_MOST_WORST]
    conspicuous = [largest, *(i for i in smaller if size[i] >= _CONSPICUOUS)]
    return GoodnessOfFit(
        deviance=fit.deviance,
        degrees_of_freedom=fit.degrees_of_freedom,
        p_overall=check.p_overall,
        p_overall_se=check.p_overall_se,
        worst_p=float(check.p_value.min()),
        worst_s1=worst.s1,
        worst_s2=worst.s2,
        worst_isi=worst.isi,
        p_deviance=p_deviance,
        worst=tuple(_pair_residual(subject, fit, i) for i in conspicuous),
    )


def _pair_residual(subject: Subject, fit: Fit, i: int) -> PairResidual:
    """The share of the counted answer to a pair, and its probability by the model."""
    isi = None if subject.isi is None else float(subject.isi[i])
    observed = float(subject.n_yes[i] / subject.n_trials[i])
    s1, s2 = float(subject.s1[i]), float(subject.s2[i])
    return PairResidual(s1, s2, observed, float(fit.q[i]), isi, subject.task.yes)
