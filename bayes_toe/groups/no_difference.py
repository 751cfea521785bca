"""The Bayes factor for 'this covariate makes no difference', by the Savage-Dickey ratio: density at 0, posterior over prior.

Given the subjects' parameters eta and their scatter, mean and effects are a linear regression with a normal prior, so the density of an
effect is a normal one, exactly; the posterior density is its average over draws, which holds far from where any draw of the effect is. (Of
Student's scatter: given also a precision for each subject, which is drawn.) Far out, few draws carry the average: its error says so, and
where it is too large only a bound is given.

Source: Dickey 1971, Annals of Mathematical Statistics 42, 204-223; Gelfand and Smith 1990, JASA 85, 398-409 (the average of densities).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.special import logsumexp

from bayes_toe.arrays import FloatArray
from bayes_toe.groups.joint import scatter_named, with_ones
from bayes_toe.inference.diagnostics import errors, pareto_k
from bayes_toe.seeds import generator

if TYPE_CHECKING:
    from bayes_toe.groups.population import Population

#: The largest relative Monte Carlo error with which a ratio is stated.
MOST_ERROR = 0.3
_MOST_K = 0.7
_UNSEEN = 3.0  # over effective draws: the most probable that something can be of which there was none, at 95 %


class Ratio(NamedTuple):
    """Bayes factor of no difference against a difference.

    Attributes
    ----------
    value : float or None
        None where only the bound is known.
    error : float or None
        Its relative Monte Carlo error.
    below : float or None
        Where there is no value: the ratio is smaller than this, at about 95 %.
    """

    value: float | None
    error: float | None
    below: float | None


def no_difference(found: Population) -> tuple[tuple[Ratio, ...], ...]:
    """For every regressor and parameter."""
    chains, given = found.chains, found.settings.hyperprior.numbers(found.names)
    rng, scatter = generator(found.settings.seed, "population", "no difference"), scatter_named(found.settings.scatter)
    whiten = np.linalg.inv(chains.root) / chains.scatter[..., None, :]  # from a subject less its mean to independent scores
    expected = chains.mean[..., None, :] + found.regressors.x @ chains.effects
    weights = scatter.precisions(rng, (chains.eta - expected) @ whiten.swapaxes(-1, -2))
    sds = np.stack([given.mean_sd, *[given.effect_sd] * found.regressors.x.shape[1]])
    centre, sd = _regression(with_ones(found.regressors.x), chains.eta - given.mean, weights, whiten, sds)
    per_sd = given.effect_sd / sd
    log_ratios = np.log(per_sd) - 0.5 * np.square(centre / sd)
    sizes = [[chains.convergence["effect", i, k].ess_bulk for k in range(sd.shape[3])] for i in range(sd.shape[2])]
    return tuple(
        tuple(ratio(log_ratios[:, :, i, k], per_sd[:, :, i, k], size) for k, size in enumerate(row)) for i, row in enumerate(sizes)
    )


def _regression(
    a: FloatArray, y: FloatArray, weights: FloatArray, whiten: FloatArray, prior_sd: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Means and sds of effects given y, (chains, draws, N, k), on the columns of a, (N, 1 + r): (chains, draws, r, k) each.

    Weights, (chains, draws, N, k), are those of whitened scores, by (chains, draws, k, k).
    """
    (*lead, k), q = y[:, :, 0].shape, a.shape[1]
    of_scores = np.einsum("cdnl,np,nq->cdlpq", weights, a, a, optimize=True)
    precision = np.einsum("cdlpq,cdlj,cdlm->cdpjqm", of_scores, whiten, whiten, optimize=True).reshape(*lead, q * k, q * k)
    inverse = np.linalg.inv(precision + np.diag(prior_sd.ravel() ** -2.0))
    pulled = a.T @ (weights * (y @ whiten.swapaxes(-1, -2))) @ whiten
    centre, variance = (inverse @ pulled.reshape(*lead, -1, 1))[..., 0], np.diagonal(inverse, axis1=-2, axis2=-1)
    return centre.reshape(*lead, q, k)[:, :, 1:], np.sqrt(variance).reshape(*lead, q, k)[:, :, 1:]


def ratio(log_ratios: FloatArray, highest: FloatArray, effective: float) -> Ratio:
    """The average of ratios given each draw, or a bound: with what draws of which there was none could have added.

    Parameters
    ----------
    log_ratios : array, shape (chains, draws)
    highest : array, shape (chains, draws)
        The largest that each could be, if its centre were 0.
    effective : float
        Effective draws.

    Examples
    --------
    >>> draws = np.random.default_rng(1).uniform(1.0, 3.0, (4, 500))
    >>> round(ratio(np.log(draws), draws, 2000.0).value, 1)
    2.0
    """
    log_mean = float(logsumexp(log_ratios) - np.log(log_ratios.size))
    error = float(errors(np.exp(log_ratios - log_mean)).mean)
    if error <= MOST_ERROR and pareto_k(log_ratios.ravel()) < _MOST_K:
        return Ratio(float(np.exp(log_mean)), error, None)
    return Ratio(None, None, float(np.exp(log_mean) + _UNSEEN / effective * np.median(highest)))
