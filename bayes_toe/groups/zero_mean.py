"""Bayes factors of a mean, an effect or a difference of 0, by the Savage-Dickey ratio.

The Bayes factor of 0 against any other value is the posterior density at 0 over the prior density
at 0. Given the coefficients a of n subjects and their standard deviation tau, the likelihood of a
mean m is Normal(e; m, v^2) with e the mean of a and v = tau / sqrt(n). So

    BF = mean over draws of  Normal(e; 0, v^2) / integral of Normal(e; m, v^2) prior(m) dm.

It is accurate where 0 is among the draws. Where 0 is far from all of them, the average rests on a
few draws: then the Bayes factor says only that a mean of 0 is much less probable.

Sources: Dickey 1971, Annals of Mathematical Statistics 42, 204-223; Gelfand and Smith 1990, JASA
85, 398-409 (the average of densities).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv, logsumexp, ndtri, stdtrit

from bayes_toe.arrays import ArrayPair, FloatArray
from bayes_toe.groups.group_sampler import GroupDraws
from bayes_toe.groups.hyperprior import HyperpriorNumbers
from bayes_toe.inference.diagnostics import errors

#: Student's t with 3 degrees of freedom is a mixture of normals with the variances 3/x, where x is
#: chi-square with 3 degrees of freedom. These are the variances, with the logs of their shares. The
#: probability of x at a node u is u^3, so that most nodes are in the tails of Student's t.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(100)  # on (-1, 1)
_U = 0.5 * (_NODES + 1.0)
_STUDENT_VARIANCES = 1.5 / gammaincinv(1.5, _U**3)  # of x/2, which has a gamma distribution
_LOG_STUDENT_SHARES = np.log(1.5 * np.square(_U) * _WEIGHTS)  # weights are on an interval of 2
#: Probabilities of the prior of a standard deviation, at the middle of equal shares.
_SD_PROBABILITIES = (np.arange(24) + 0.5) / 24


class ZeroBayesFactor(NamedTuple):
    """Natural log of the Bayes factor of 0 against any other value.

    Attributes
    ----------
    log_bf : float
    error : float
        Its Monte Carlo standard error.
    """

    log_bf: float
    error: float


def zero_mean(
    draws: GroupDraws, numbers: HyperpriorNumbers, x: FloatArray, j: int
) -> ZeroBayesFactor:
    """The Bayes factor of 0 for the mean of coefficient j, with covariates at their reference."""
    centre, variance = _regression(draws, x, 0, j)
    log_at_zero = _log_normal_density(centre, variance)  # the likelihood at a mean of 0
    return _zero_bayes_factor(log_at_zero - _log_marginal_density(centre, variance, numbers, j))


def zero_effect(
    draws: GroupDraws, numbers: HyperpriorNumbers, x: FloatArray, i: int, j: int
) -> ZeroBayesFactor:
    """The Bayes factor of 0 for the effect of covariate i on coefficient j."""
    centre, variance = _regression(draws, x, i + 1, j)
    # The prior of the effect is Normal(0, sd_scale^2), so that the estimate has both variances.
    log_marginal = _log_normal_density(centre, variance + np.square(numbers.sd_scale[j]))
    return _zero_bayes_factor(_log_normal_density(centre, variance) - log_marginal)


def _regression(draws: GroupDraws, x: FloatArray, column: int, j: int) -> ArrayPair:
    """Estimate and variance of one weight in the regression of coefficient j, (chains, draws) each.

    The weights are the mean (column 0) and the effects of the covariates x, (subjects, covariates).
    Given the other weights in each draw, the likelihood of the weight is normal, with
    the estimate z'r / z'z and the variance tau^2 / z'z: r is what the others leave, and z the
    column of the weight.
    """
    design = np.column_stack([np.ones(len(x)), x])  # (subjects, columns)
    weights = np.concatenate([draws.mean[..., None, j], draws.effects[..., j]], axis=-1)
    other_columns = np.delete(np.arange(design.shape[1]), column)
    residual = draws.subjects[..., j] - weights[..., other_columns] @ design[:, other_columns].T

    z = design[:, column]
    return residual @ z / (z @ z), np.square(draws.sd[..., j]) / (z @ z)


def approximate_zero_mean(
    estimates: FloatArray, standard_errors: FloatArray, numbers: HyperpriorNumbers
) -> FloatArray:
    """Log Bayes factors of a mean of 0, from a normal likelihood of each subject.

    Given tau, the likelihood of the mean is normal. It is averaged over the prior of tau.

    Parameters
    ----------
    estimates, standard_errors : ndarray, shape (groups, subjects)
        In the unit of the group's parameters.
    numbers : HyperpriorNumbers
        The numbers of one coefficient.

    Returns
    -------
    ndarray, shape (groups,)

    Examples
    --------
    >>> from bayes_toe.model.prior import Hyperprior
    >>> numbers = HyperpriorNumbers.from_rows([Hyperprior().contraction])
    >>> estimates = np.array([[0.2, 0.3, 0.25, 0.22], [-0.2, 0.1, 0.2, -0.1]])
    >>> log_factors = approximate_zero_mean(estimates, np.full((2, 4), 0.05), numbers)
    >>> (log_factors > 0.0).tolist()
    [False, True]
    """
    # Quantiles of the prior of tau: the upper half of a symmetric density.
    probability = 0.5 + 0.5 * _SD_PROBABILITIES
    score = stdtrit(3.0, probability) if numbers.has_heavy_tails else ndtri(probability)
    tau_squared = np.square(numbers.sd_scale * score)[:, None]  # (taus, 1)
    variance = tau_squared + np.square(standard_errors)[:, None]  # (groups, taus, subjects)

    # Given tau, the mean's likelihood is exp(log_mass) Normal(centre; m, 1 / precision).
    precision = (1.0 / variance).sum(axis=-1)
    centre = (estimates[:, None] / variance).sum(axis=-1) / precision
    squares = np.square(estimates[:, None] - centre[..., None]) / variance
    log_mass = -0.5 * ((squares + np.log(variance)).sum(axis=-1) + np.log(precision))
    log_at_zero = logsumexp(log_mass + _log_normal_density(centre, 1.0 / precision), axis=-1)
    log_marginal = _log_marginal_density(centre, 1.0 / precision, numbers, j=0)
    return np.asarray(log_at_zero - logsumexp(log_mass + log_marginal, axis=-1))


def _log_marginal_density(
    centre: FloatArray, variance: FloatArray, numbers: HyperpriorNumbers, j: int
) -> FloatArray:
    """Log of the integral of Normal(centre; m, variance) prior(m) dm over the mean m.

    The mean is that of coefficient j. The result has the shape of centre and variance. The
    variances of two normals add up.
    """
    distance = centre - numbers.mean[j]
    scale_squared = numbers.mean_scale[j] ** 2
    if not numbers.has_heavy_tails[j]:
        return _log_normal_density(distance, variance + scale_squared)
    # Student's t is a mixture of normals, whose variances are on a further axis, the last one.
    variances = variance[..., None] + scale_squared * _STUDENT_VARIANCES
    log_densities = _log_normal_density(distance[..., None], variances)
    return np.asarray(logsumexp(log_densities + _LOG_STUDENT_SHARES, axis=-1))


def zero_difference(
    draws: GroupDraws, numbers: HyperpriorNumbers, columns: list[int], weights: FloatArray
) -> ZeroBayesFactor:
    """The Bayes factor for a weighted sum of means of coefficients with normal priors about 0.

    These means have no effects of covariates: the mean over subjects estimates them.
    """
    centre = draws.subjects[..., columns].mean(axis=2)  # (chains, draws, columns)
    variance = np.square(draws.sd[..., columns]) / draws.subjects.shape[2]
    prior_variance = np.square(numbers.mean_scale[columns])
    # Given the coefficients, a mean is Normal(share * centre, share * variance).
    share = prior_variance / (prior_variance + variance)
    squares = np.square(weights)
    # The log density of the sum at 0: posterior, given a draw, and prior.
    log_at_zero = _log_normal_density((share * centre) @ weights, (share * variance) @ squares)
    log_prior_at_zero = _log_normal_density(np.zeros(1), squares @ prior_variance)
    return _zero_bayes_factor(log_at_zero - log_prior_at_zero)


def _log_normal_density(distance: FloatArray, variance: FloatArray) -> FloatArray:
    """Log of a normal density at a distance from its mean."""
    return -0.5 * (np.square(distance) / variance + np.log(2.0 * np.pi * variance))


def _zero_bayes_factor(log_ratios: FloatArray) -> ZeroBayesFactor:
    """The log of the average of ratios given each draw, (chains, draws), and its error."""
    log_mean = float(logsumexp(log_ratios) - np.log(log_ratios.size))
    # Ratios divided by their mean have the mean 1, whose error is also that of its logarithm.
    return ZeroBayesFactor(log_mean, float(errors(np.exp(log_ratios - log_mean)).mean))
