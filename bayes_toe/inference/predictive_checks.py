"""Does the model describe the answers? Deviance and posterior predictive p-values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import betainc, chdtrc, gammaln, xlogy

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.errors import NumericalError
from bayes_toe.model.target import Answering, times_counts
from bayes_toe.seeds import generator

#: Below this posterior predictive p-value, or p-value of the deviance, the model is said not to describe the answers.
MISFIT = 0.01
_BLOCK = 1 << 18  # values of one temporary array
_OFTEN, _COUNTS = 20.0, 101  # expected rarer answers from which chi-square holds for a pair; counts that matter where there are fewer
_OF_MOMENTS = 3000  # draws times pairs over which the moments of a deviance are averaged
_CONSPICUOUS, _NAMED = 2.0, 3  # residual from which a pair is named among the worst, and how many are


# --- Deviance ---------------------------------------------------------------------------------------


def binomial_deviance(n_equal: npt.ArrayLike, n_trials: npt.ArrayLike, log_q: npt.ArrayLike, log_rest: npt.ArrayLike) -> FloatArray:
    """Deviance of k 'equal' answers in n from P(equal) = q and P(different) = 1 - q, in nats times 2. Arguments broadcast.

    D = 2 [k ln(k/(n q)) + (n - k) ln((n - k)/(n (1 - q)))], twice the log likelihood that the saturated model has more. The logs of q and
    of 1 - q are given apart: either probability may be below the smallest float. Infinite where an answer was given that has probability 0.

    Examples
    --------
    >>> half = np.log(0.5)
    >>> [round(float(binomial_deviance(k, 50, half, half)), 6) for k in (25, 0)]
    [0.0, 69.314718]
    """
    k, n = np.asarray(n_equal, np.float64), np.asarray(n_trials, np.float64)
    return np.asarray(2.0 * (_excess(k, n, np.asarray(log_q, np.float64)) + _excess(n - k, n, np.asarray(log_rest, np.float64))))


def _excess(x: FloatArray, n: FloatArray, log_share: FloatArray) -> FloatArray:
    """The term x ln(x/m) - x + m >= 0 with m = n e^log_share; near x = m by the series of the logarithm in v = (x - m)/(x + m)."""
    x, m = np.broadcast_arrays(x, n * np.exp(log_share))
    both = x + m
    v = np.divide(x - m, both, out=np.zeros(both.shape), where=both > 0)
    near = np.abs(v) < 0.1
    square = np.where(near, v * v, 0.0)
    series = np.zeros_like(square)
    for j in range(10, 0, -1):  # 0.01^10 is far below rounding
        series = (series + 1.0 / (2 * j + 1)) * square
    with np.errstate(divide="ignore", invalid="ignore"):  # branches not taken
        far = np.where(x > 0, x * (np.log(x / n) - log_share), 0.0) - x + m
    return np.asarray(np.where(near, (x - m) * v + 2.0 * x * v * series, far))


@dataclass(frozen=True, eq=False)
class Fit:
    """Fit of one subject's answers at one point.

    Attributes
    ----------
    q : array, shape (pairs,)
        P(equal) by the model.
    residual : array, shape (pairs,)
        Signed root of each pair's deviance; positive where 'equal' was answered more often than the model has it.
    deviance : float
        Sum over pairs, against the saturated model.
    degrees_of_freedom : int
        Pairs less the free parameters.
    p_value : float
        P(deviance >= this one), see :func:`deviance_p_value`; NaN without degrees of freedom.
    """

    q: FloatArray
    residual: FloatArray
    deviance: float
    degrees_of_freedom: int
    p_value: float


def fit_at(posterior: Answering, x: npt.ArrayLike) -> Fit:
    """Deviance and residuals at one unconstrained point x, shape (k,); meant for the maximum of the likelihood.

    Examples
    --------
    >>> from bayes_toe.data.study import Subject
    >>> from bayes_toe.model.ladder import posterior_of
    >>> posterior = posterior_of(Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [45, 20, 15], [50, 50, 50]))
    >>> fit = fit_at(posterior, [0.0, 0.0, -1.0, 2.2])
    >>> fit.residual.shape, fit.degrees_of_freedom
    ((3,), -1)
    """
    point = np.asarray(x, np.float64).reshape(1, -1)
    logs = posterior.log_answers(point)
    pairs, q = _pair_deviance(posterior, *logs)[0], np.exp(logs[0][0])
    subject = posterior.subject
    sign, freedom = np.sign(subject.n_equal - subject.n_trials * q), subject.n_pairs - len(posterior.coordinates)
    p_value = deviance_p_value(float(pairs.sum()), freedom, subject.n_trials, logs[0][0], logs[1][0])
    return Fit(q, sign * np.sqrt(pairs), float(pairs.sum()), freedom, p_value)


def deviance_p_value(value: float, freedom: int, n_trials: npt.ArrayLike, log_q: FloatArray, log_rest: FloatArray) -> float:
    """P(deviance >= value) of a fit with so many degrees of freedom, by a scaled chi-square; NaN where there are none.

    Chi-square itself where every pair has many answers of both kinds. Elsewhere the deviance of a pair has another mean and variance,
    known from the logs of q and 1 - q: the reference has those of the sum, times degrees of freedom over pairs. Logs of shape
    (draws, pairs) are averaged over: the maximum itself, shape (pairs,), promises too little scatter where answers are few.

    Examples
    --------
    >>> half = np.full(6, np.log(0.5))
    >>> round(deviance_p_value(13.28, 4, np.full(6, 1000), half, half), 4)  # 13.28 is the 99 % quantile of chi-square with 4 of them
    0.01
    """
    if freedom <= 0:
        return float("nan")
    moments = _moments(np.asarray(n_trials, np.float64), np.atleast_2d(log_q), np.atleast_2d(log_rest))
    mean, variance = (float(values.sum(axis=1).mean()) for values in moments)
    if variance == 0.0:  # the answers are certain under the model
        return float(value <= 0.0)
    return float(chdtrc(2.0 * mean**2 / variance * freedom / log_q.shape[-1], 2.0 * mean / variance * value))


def _moments(n: FloatArray, log_q: FloatArray, log_rest: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and variance of each pair's deviance, over the counts of its rarer answer; 1 and 2 where that is not rare."""
    log_rare, log_other = np.minimum(log_q, log_rest), np.maximum(log_q, log_rest)
    k = np.arange(min(_COUNTS, int(n.max()) + 1), dtype=np.float64).reshape(-1, *(1,) * np.ndim(log_q))
    possible, at = k <= n, np.minimum(k, n)
    log_ways = gammaln(n + 1.0) - gammaln(at + 1.0) - gammaln(n - at + 1.0)
    log_chance = times_counts(at, log_rare) + times_counts(n - at, log_other)
    chance = np.where(possible, np.exp(log_ways + log_chance), 0.0)
    values = np.where(chance > 0.0, 2.0 * (_saturated(at, n) - log_chance), 0.0)
    mean = (chance * values).sum(axis=0)
    rare = n * np.exp(log_rare) < _OFTEN
    return np.where(rare, mean, 1.0), np.where(rare, (chance * (values - mean) ** 2).sum(axis=0), 2.0)


def _saturated(k: FloatArray, n: FloatArray) -> FloatArray:
    """Log likelihood of k 'equal' answers in n where P(equal) = k/n, the largest there is, without binomial coefficients."""
    return np.asarray(xlogy(k, k / n) + xlogy(n - k, (n - k) / n))


def deviance(posterior: Answering, x: npt.ArrayLike) -> FloatArray:
    """Deviance of every pair at unconstrained points, (points, k) -> (points, pairs)."""
    return _pair_deviance(posterior, *posterior.log_answers(require_draws(x, posterior)))


def _pair_deviance(posterior: Answering, log_q: FloatArray, log_rest: FloatArray) -> FloatArray:
    return binomial_deviance(posterior.subject.n_equal, posterior.subject.n_trials, log_q, log_rest)


def _half_deviance(k: FloatArray, n: FloatArray, logs: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Half the deviance of counts, (points, pairs) -> (points,), to the rounding of the likelihood: counts are compared by it."""
    return np.asarray((_saturated(k, n) - times_counts(k, logs[0]) - times_counts(n - k, logs[1])).sum(axis=-1))


def require_draws(x: npt.ArrayLike, posterior: Answering) -> FloatArray:
    """Draws as an array, shape (draws, k).

    Raises
    ------
    NumericalError
        If they have another shape, there are none, or one is NaN.
    """
    points, k = np.asarray(x, np.float64), len(posterior.coordinates)
    if points.ndim != 2 or points.shape[1] != k or not len(points) or np.isnan(points).any():
        raise NumericalError(f"draws must have shape (draws, {k}) and no NaN, found shape {points.shape}")
    return points


# --- Posterior predictive check ---------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PredictiveCheck:
    """Observed answers against what the posterior predicts for a repetition of the experiment.

    Attributes
    ----------
    expected : array, shape (pairs,)
        Posterior mean of P(equal).
    p_fewer, p_more : array, shape (pairs,)
        P(n_rep <= n_equal) and P(n_rep >= n_equal) for replicated counts: binomial tails averaged over draws, not simulated; where counts
        scatter more than that, over one session simulated for each draw.
    p_overall : float
        P(deviance of replicated counts >= deviance of the observed ones), both at the same draw.
    p_overall_se : float
        Its Monte Carlo standard error, counting draws as independent.
    """

    expected: FloatArray
    p_fewer: FloatArray
    p_more: FloatArray
    p_overall: float
    p_overall_se: float

    @property
    def p_mid(self) -> FloatArray:
        """P(n_rep < n_equal) + P(n_rep = n_equal)/2, shape (pairs,): near 0 too few 'equal' answers, near 1 too many."""
        return np.asarray(0.5 * (self.p_fewer + (1.0 - self.p_more)))

    @property
    def p_value(self) -> FloatArray:
        """Two-sided p-value of every pair, twice the smaller tail; conservative, since the same answers shaped the posterior."""
        return np.asarray(np.minimum(1.0, 2.0 * np.minimum(self.p_fewer, self.p_more)))


def predictive_check(posterior: Answering, x: npt.ArrayLike, seed: int) -> PredictiveCheck:
    """Posterior predictive p-values of one subject.

    Parameters
    ----------
    posterior : Answering
        A model of one subject, H1 or another one of the ladder.
    x : array_like, shape (draws, k)
        Posterior draws in unconstrained coordinates.
    seed : int
        Root seed of the replicated counts, which enter `p_overall` only; the stream is keyed by subject and model.

    Raises
    ------
    NumericalError
        If draws have another shape or hold a NaN.
    """
    points, subject = require_draws(x, posterior), posterior.subject
    answers, trials = subject.n_equal.astype(np.float64), subject.n_trials.astype(np.float64)
    rng = generator(seed, subject.name, posterior.model.name, "predictive check")
    expected, fewer, more = (np.zeros(subject.n_pairs) for _ in range(3))
    beyond = 0
    rows = max(1, _BLOCK // subject.n_pairs)
    for start in range(0, len(points), rows):
        some = points[start : start + rows]
        logs = posterior.log_answers(some)
        q, rest = (np.exp(values) for values in posterior.realised_answers(rng, some, logs))
        expected += np.exp(logs[0]).sum(axis=0)
        for total, tail in zip((fewer, more), binomial_tails(subject.n_equal, subject.n_trials, q, rest), strict=True):
            total += tail.sum(axis=0)
        again = rng.binomial(subject.n_trials, q).astype(np.float64)
        beyond += int(np.count_nonzero(_half_deviance(again, trials, logs) >= _half_deviance(answers, trials, logs)))
    share = beyond / len(points)
    error = float(np.sqrt(share * (1.0 - share) / len(points)))
    return PredictiveCheck(expected / len(points), fewer / len(points), more / len(points), share, error)


@dataclass(frozen=True)
class PairFit:
    """A pair (natural-log intensity, interval in seconds) with its observed share of 'equal' and the one that the model expects."""

    s1: float
    s2: float
    observed: float
    expected: float
    isi: float | None = None


@dataclass(frozen=True)
class FitSummary:
    """Goodness of fit of one subject in a few numbers, for tables.

    Attributes
    ----------
    deviance : float
        Smallest over the draws: with thousands of draws within about 0.1 of that of the maximum of the likelihood.
    degrees_of_freedom : int
        Pairs less the free parameters.
    p_overall, p_overall_se : float
        Posterior predictive p-value of the deviance and its Monte Carlo standard error, see :class:`PredictiveCheck`.
    worst_p : float
        Smallest two-sided posterior predictive p-value of a pair, not corrected for the number of pairs.
    worst_s1, worst_s2 : float
        That pair, natural-log intensity.
    worst_isi : float, optional
        Its interval, seconds, where the subject has intervals.
    p_deviance : float
        p-value of the deviance, see :func:`deviance_p_value`, its moments averaged over draws; NaN without degrees of freedom.
    worst : tuple of PairFit
        The pairs with the largest residuals at the draw of the smallest deviance, at most three, largest first; all but the first beyond
        2. Not stored with draws: empty where the summary comes from a file.
    """

    deviance: float
    degrees_of_freedom: int
    p_overall: float
    p_overall_se: float
    worst_p: float
    worst_s1: float
    worst_s2: float
    worst_isi: float | None = None
    p_deviance: float = float("nan")
    worst: tuple[PairFit, ...] = ()

    @property
    def misfit(self) -> bool:
        """Whether the model does not describe the answers: predictive p, or that of the deviance, below 0.01."""
        return self.p_overall < MISFIT or self.p_deviance < MISFIT

    @property
    def describes(self) -> bool | None:
        """Whether the model describes the answers; None where it cannot be told: with no more pairs than parameters it fits them all."""
        return None if self.degrees_of_freedom <= 0 and not self.misfit else not self.misfit


def summarise_fit(
    posterior: Answering, x: npt.ArrayLike, seed: int, *, log_likelihood: FloatArray | None = None, most: int = 2000
) -> FitSummary:
    """Deviance and posterior predictive p-values of one subject from draws x, shape (draws, k), unconstrained.

    The predictive check takes `most` draws, evenly spaced; the smallest deviance is sought over all, by their log likelihood, shape
    (draws,), which is evaluated where it is not given.

    Raises
    ------
    NumericalError
        If draws have another shape or hold a NaN.
    """
    points, subject = require_draws(x, posterior), posterior.subject
    check = predictive_check(posterior, points[:: max(1, -(-len(points) // most))], seed)
    best = int(np.argmax(posterior.log_likelihood(points) if log_likelihood is None else log_likelihood))
    worst, fit = int(np.argmin(check.p_value)), fit_at(posterior, points[best : best + 1])
    few = points[:: max(1, -(-len(points) * subject.n_pairs // _OF_MOMENTS))]
    return FitSummary(
        fit.deviance,
        fit.degrees_of_freedom,
        check.p_overall,
        check.p_overall_se,
        float(check.p_value[worst]),
        float(subject.s1[worst]),
        float(subject.s2[worst]),
        None if subject.isi is None else float(subject.isi[worst]),
        deviance_p_value(fit.deviance, fit.degrees_of_freedom, subject.n_trials, *posterior.log_answers(few)),
        _worst_pairs(subject, fit),
    )


def _worst_pairs(subject: Subject, fit: Fit) -> tuple[PairFit, ...]:
    order, far = np.argsort(-np.abs(fit.residual), kind="stable"), np.abs(fit.residual) >= _CONSPICUOUS
    named = [int(pair) for place, pair in enumerate(order[:_NAMED]) if place == 0 or far[pair]]
    share = subject.n_equal / subject.n_trials
    isi = [None] * subject.n_pairs if subject.isi is None else subject.isi.tolist()
    return tuple(PairFit(float(subject.s1[i]), float(subject.s2[i]), float(share[i]), float(fit.q[i]), isi[i]) for i in named)


def binomial_tails(n_equal: npt.ArrayLike, n_trials: npt.ArrayLike, q: FloatArray, rest: FloatArray) -> tuple[FloatArray, FloatArray]:
    """P(N <= k) and P(N >= k) for N ~ Binomial(n, q); `rest` is 1 - q. Arguments broadcast.

    Examples
    --------
    >>> [float(tail) for tail in binomial_tails(1, 2, np.array(0.5), np.array(0.5))]
    [0.75, 0.75]
    """
    k, n = np.asarray(n_equal, np.float64), np.asarray(n_trials, np.float64)
    fewer = np.where(k < n, betainc(np.maximum(n - k, 1.0), k + 1.0, rest), 1.0)
    more = np.where(k > 0, betainc(np.maximum(k, 1.0), n - k + 1.0, q), 1.0)
    return np.asarray(fewer), np.asarray(more)
