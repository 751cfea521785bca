"""Bayes factors for 'none on average' and 'no difference' by the Savage-Dickey ratio: density where it would be, posterior over prior.

Given the subjects' parameters eta and their scatter, means and effects are a linear regression with a normal prior, so their density is a
normal one, exactly, of one of them or of several together; the posterior density is its average over draws, which holds far from where any
draw is. (Of Student's scatter: given also a precision for each subject, which is drawn.) Given next to no scatter it is a spike, which is
widened a little. Far out, few draws carry the average: its error says so, and where it is too large only a bound is given.

Source: Dickey 1971, Annals of Mathematical Statistics 42, 204-223; Gelfand and Smith 1990, JASA 85, 398-409 (the average of densities).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.special import logsumexp

from bayes_toe.arrays import FloatArray
from bayes_toe.groups.joint import scatter_named, with_ones
from bayes_toe.inference.diagnostics import errors, pareto_k
from bayes_toe.model.contrasted import QUANTITIES
from bayes_toe.seeds import generator

if TYPE_CHECKING:
    from bayes_toe.groups.chains import GroupChains
    from bayes_toe.groups.hyperprior import HyperpriorNumbers
    from bayes_toe.groups.population import Population

#: The largest relative Monte Carlo error with which a ratio is stated.
MOST_ERROR = 0.3
_MOST_K = 0.7
#: Group parameters whose mean is 0, on their scale, where there is no order effect on average, and what that effect is called.
ORDER_EFFECTS = {"gain": "pull", "offset": "constant error"}
_KERNEL = 0.1  # posterior sds: no density given a draw is narrower, lest a few with next to no scatter carry the average
_UNSEEN = 3.0  # over effective draws: the most probable that something can be of which there was none, at 95 %


class Ratio(NamedTuple):
    """Bayes factor of a mean or an effect of 0 against any other.

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


class Ratios(NamedTuple):
    """Those of means that may be none, by the group parameter; of all together, unless a pull cannot be none; of effects by regressor."""

    means: dict[str, Ratio]
    joint: Ratio | None
    effects: tuple[tuple[Ratio, ...], ...]


class AtZero:
    """Bayes factors of 0 of coefficients of a group's regression on x, (N, r): of means, then effects, regressor by regressor."""

    def __init__(
        self,
        chains: GroupChains,
        given: HyperpriorNumbers,
        x: FloatArray,
        scatter: str,
        rng: np.random.Generator,
    ) -> None:
        whiten = (
            np.linalg.inv(chains.root) / chains.scatter[..., None, :]
        )  # from a subject less its mean to independent scores
        expected = chains.mean[..., None, :] + x @ chains.effects
        weights = scatter_named(scatter).precisions(
            rng, (chains.eta - expected) @ whiten.swapaxes(-1, -2)
        )
        self._chains, self.k, r = chains, len(given.mean), x.shape[1]
        self._prior_sd = np.concatenate([given.mean_sd, np.tile(given.effect_sd, r)])
        self._centre, self._covariance = _regression(
            with_ones(x), chains.eta - given.mean, weights, whiten, self._prior_sd
        )
        self._zero = np.concatenate(
            [-given.mean, np.zeros(r * self.k)]
        )  # means count from those of the prior
        drawn = np.concatenate([chains.mean[..., None, :], chains.effects], axis=2)
        self._kernel = np.square(_KERNEL) * drawn.var(axis=(0, 1)).ravel()

    def __call__(self, places: Sequence[int]) -> Ratio:
        """Of some coefficients together."""
        sds, k = self._prior_sd[places], self.k
        own, far = (
            self._covariance[..., places, :][..., places],
            self._zero[places] - self._centre[..., places],
        )
        variances = np.diagonal(own, axis1=-2, axis2=-1)
        own = own + np.maximum(self._kernel[places] - variances, 0.0)[..., None] * np.eye(
            len(places)
        )
        squares = np.einsum("...i,...ij,...j->...", far, np.linalg.inv(own), far)
        highest = (
            np.log(sds).sum()
            - 0.5 * np.linalg.slogdet(own)[1]
            + 0.5 * np.square(self._zero[places] / sds).sum()
        )
        keys = [
            ("effect", place // k - 1, place % k) if place >= k else ("mean", -1, place)
            for place in places
        ]
        return ratio(
            highest - 0.5 * squares,
            np.exp(highest),
            min(self._chains.convergence[key].ess_bulk for key in keys),
        )


def savage_dickey(found: Population) -> Ratios:
    """For what tells of an order effect on average, and for every regressor and parameter."""
    given, x = found.settings.hyperprior.numbers(found.names), found.regressors.x
    at_zero = AtZero(
        found.chains,
        given,
        x,
        found.settings.scatter,
        generator(found.settings.seed, "population", "no difference"),
    )
    own, k = (
        {name: found.names.index(name) for name in ORDER_EFFECTS if name in found.names},
        len(found.names),
    )
    effects = tuple(tuple(at_zero([(1 + i) * k + j]) for j in range(k)) for i in range(x.shape[1]))
    always = any(name in QUANTITIES["pull"] and name not in ORDER_EFFECTS for name in found.names)
    joint = None if always or not own else at_zero([*own.values()])
    return Ratios({name: at_zero([place]) for name, place in own.items()}, joint, effects)


def _regression(
    a: FloatArray, y: FloatArray, weights: FloatArray, whiten: FloatArray, prior_sd: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Means, (chains, draws, q k), and covariance of coefficients given y, (chains, draws, N, k), on the columns of a, (N, q).

    Weights, (chains, draws, N, k), are those of whitened scores, by (chains, draws, k, k).
    """
    (*lead, k), q = y[:, :, 0].shape, a.shape[1]
    of_scores = np.einsum("cdnl,np,nq->cdlpq", weights, a, a, optimize=True)
    precision = np.einsum(
        "cdlpq,cdlj,cdlm->cdpjqm", of_scores, whiten, whiten, optimize=True
    ).reshape(*lead, q * k, q * k)
    covariance = np.linalg.inv(precision + np.diag(prior_sd**-2.0))
    pulled = a.T @ (weights * (y @ whiten.swapaxes(-1, -2))) @ whiten
    return (covariance @ pulled.reshape(*lead, -1, 1))[..., 0], covariance


def ratio(log_ratios: FloatArray, highest: FloatArray, effective: float) -> Ratio:
    """The average of ratios given each draw, (chains, draws), or a bound: with what draws of which there was none could have added.

    `highest`, of the same shape, is the largest that each could be, if its centre were 0; `effective` the number of effective draws.

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
