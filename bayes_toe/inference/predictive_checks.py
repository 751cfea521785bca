"""Does the model describe the answers? Deviance and posterior predictive p-values.

`summarise_fit` gives :class:`GoodnessOfFit` of a subject, from `fit_at` and `predictive_check`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import betainc, chdtrc, gammaln, xlogy

from bayes_toe.arrays import ArrayPair, FloatArray
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

    D = 2 [k ln(k/(n q)) + (n - k) ln((n - k)/(n (1 - q)))], twice the log likelihood that the
    saturated model has more, to the rounding of that. The logs of q and of 1 - q are given apart:
    either probability may be below the smallest float. Infinite where an answer was given that has
    probability 0.
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
    """Mean and variance of each pair's deviance, over the counts of its rarer answer.

    Where that is not rare, they are 1 and 2.
    """
    k = np.arange(min(_COUNTS, int(n.max()) + 1), dtype=np.float64).reshape(
        -1, *(1,) * np.ndim(log_q)
    )
    log_rare, log_other = np.minimum(log_q, log_rest), np.maximum(log_q, log_rest)
    count = np.minimum(k, n)
    log_ways = gammaln(n + 1.0) - gammaln(count + 1.0) - gammaln(n - count + 1.0)
    chance = np.where(
        k <= n,
        np.exp(log_ways + times_counts(count, log_rare) + times_counts(n - count, log_other)),
        0.0,
    )
    values = np.where(chance > 0.0, binomial_deviance(count, n, log_rare, log_other), 0.0)
    mean, rare = (chance * values).sum(axis=0), n * np.exp(log_rare) < _OFTEN
    return np.where(rare, mean, 1.0), np.where(
        rare, (chance * (values - mean) ** 2).sum(axis=0), 2.0
    )


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
    k, n = subject.n_yes, subject.n_trials
    rng = generator(seed, subject.name, posterior.model.name, "predictive check")
    sums, beyond = np.zeros((3, subject.n_pairs)), 0
    rows = max(1, _BLOCK // subject.n_pairs)
    for start in range(0, len(points), rows):
        block = points[start : start + rows]
        logs = posterior.log_answers(block)
        q, complement = map(np.exp, logs)
        tails = (
            np.where(x < n, betainc(np.maximum(n - x, 1), x + 1, share), 1.0)
            for x, share in ((k, complement), (n - k, q))
        )
        sums += [values.sum(axis=0) for values in (np.exp(logs[0]), *tails)]
        replicated, observed = (
            binomial_deviance(counts, n, *logs).sum(axis=1) for counts in (rng.binomial(n, q), k)
        )
        beyond += int(np.count_nonzero(replicated >= observed))
    (expected, p_fewer, p_more), share = sums / len(points), beyond / len(points)
    return PredictiveCheck(
        expected, p_fewer, p_more, share, float(np.sqrt(share * (1.0 - share) / len(points)))
    )


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

    The deviance is the smallest over the draws: with thousands of draws within about 0.1 of that of
    the maximum of the likelihood. The worst pairs are those with the largest residuals at that
    draw, at most three, largest first, all but the first beyond 2; they are not stored with draws:
    none where the summary comes from a file.
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

    The predictive check takes `most` draws, evenly spaced; the smallest deviance is sought over
    all, by their log likelihood, shape (draws,), which is evaluated where it is not given.
    """
    points, subject = require_points(x, len(posterior.coordinates)), posterior.subject
    check = predictive_check(posterior, points[:: max(1, -(-len(points) // most))], seed)
    if log_likelihood is None:
        log_likelihood = posterior.log_likelihood(points)
    best = int(np.argmax(log_likelihood))
    fit, worst = fit_at(posterior, points[best]), int(np.argmin(check.p_value))
    isi = [None] * subject.n_pairs if subject.isi is None else subject.isi.tolist()
    s1, s2, observed, expected = (
        column.tolist()
        for column in (subject.s1, subject.s2, subject.n_yes / subject.n_trials, fit.q)
    )
    size = np.abs(fit.residual)
    largest, *smaller = np.argsort(-size, kind="stable").tolist()[:_MOST_WORST]
    conspicuous = [largest, *(i for i in smaller if size[i] >= _CONSPICUOUS)]
    few = points[:: max(1, -(-len(points) * subject.n_pairs // _OF_MOMENTS))]
    return GoodnessOfFit(
        fit.deviance,
        fit.degrees_of_freedom,
        check.p_overall,
        check.p_overall_se,
        float(check.p_value[worst]),
        s1[worst],
        s2[worst],
        isi[worst],
        deviance_p_value(
            fit.deviance, fit.degrees_of_freedom, subject.n_trials, *posterior.log_answers(few)
        ),
        tuple(
            PairResidual(s1[i], s2[i], observed[i], expected[i], isi[i], subject.task.yes)
            for i in conspicuous
        ),
    )
