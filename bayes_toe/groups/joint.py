"""The joint posterior of a group: mean m, scatter tau and effects beta of every parameter, and the parameters eta of every member.

    eta_ik = mu_ik + tau_k u_ik,    mu_ik = m_k + x_i' beta_k,    u ~ normal, or Student's t,
    m ~ Normal,    tau ~ HalfNormal,    beta ~ Normal(0, .)    (:mod:`bayes_toe.groups.hyperprior`)

Scores u of a member are independent, or u = L v with independent v (:mod:`bayes_toe.groups.correlations`).

Coordinates in which it is easy to sample depend on what each member's answers say. If they say much of eta_ik, it should be a coordinate
itself (centred); if nothing, its score u_ik (non-centred). With h_ik and e_ik, precision and place of eta_ik by the answers alone, roughly
normal, and s = 1/(1 + h tau^2), the population's share of what is known of eta_ik,

    eta = (1 - s) e + s mu + tau s^(1/2) xi

is in between: given mu and tau, xi is then standard normal. That h and e are rough costs speed, not exactness. So

    d eta/d mu = s,    d eta/d log tau = -2 s (1 - s) (mu - e) + tau s^(3/2) xi,    d eta/d xi = tau s^(1/2),
    u = (e - mu) h tau s + s^(1/2) xi,    which does not cancel where tau is small.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.groups.coefficients import CoefficientUnits, Units
from bayes_toe.groups.correlations import Root, pairs
from bayes_toe.groups.hyperprior import HyperpriorNumbers
from bayes_toe.groups.scatter import Scatter
from bayes_toe.groups.shared import Shared, log_hyperprior, split_shared, with_ones
from bayes_toe.groups.told import Told, without_funnel

Likelihood = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


class _Place(NamedTuple):
    """Where members are, shape (points, N, k) or one column of it, the population's share and the rest, their unit, and what moves them."""

    eta: FloatArray
    score: FloatArray
    share: FloatArray
    rest: FloatArray
    log_unit: FloatArray
    unit: FloatArray
    by_log_scatter: FloatArray


@dataclass(frozen=True, eq=False)
class Joint:
    """Log density and gradient of the joint posterior at several points; a point has D = k (2 + r) + c + N k coordinates.

    Parameters
    ----------
    likelihood : callable
        Log likelihood of each member and its gradient, eta of shape (points, N, k) -> (points, N) and (points, N, k).
    hyperprior : HyperpriorNumbers
    x : array, shape (N, r)
        Regressors.
    told : Told
    scatter : Scatter
    correlated : bool
        Whether scores of a member may be correlated: c = k (k - 1)/2 further coordinates.
    """

    likelihood: Likelihood
    hyperprior: HyperpriorNumbers
    x: FloatArray
    told: Told
    scatter: Scatter
    correlated: bool = False

    @property
    def dimension(self) -> int:
        """Number of coordinates, D."""
        return self.size + self.told.place.size

    @property
    def size(self) -> int:
        """Number of coordinates that belong to all members: they come first, see :func:`~bayes_toe.groups.shared.split_shared`."""
        k = self.told.place.shape[1]
        return int(k * (2 + self.x.shape[1]) + self.correlated * len(pairs(k)))

    def __call__(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Log density, (points,), and gradient, (points, D), at points, (points, D)."""
        given = self._given(theta)
        units, coefficients = self._units.at(given.log_scatter), given.coefficients
        shared, xi = _out_of_units(given, units, coefficients), self._xi(theta)
        at, by_pull = self._place(shared, xi)
        of_answers, of_eta = self.likelihood(at.eta)
        of_scores, by_score, by_z = self._scores(at.score, shared.z)
        drawn = by_score * np.exp(-shared.log_scatter)[:, None]
        steep = of_eta + drawn
        if self.told.funnel is not None and by_pull is not None:
            funnelled = steep[..., self.told.funnel.mean] * by_pull[0] + by_pull[1]
            for whole in (of_eta, steep):
                whole[..., self.told.funnel.pull] += funnelled
        of_members = of_scores + (at.log_unit - shared.log_scatter[:, None]).sum(axis=(1, 2))
        prior, of_prior = log_hyperprior(shared, self.hyperprior)
        by_mean = of_eta * at.share - drawn * at.rest  # not steep - drawn, which cancels where the scatter is small
        by_coefficient = of_prior.coefficients + self._columns.T @ by_mean
        by_log_scatter = of_prior.log_scatter + (steep * at.by_log_scatter - by_score * at.score - at.rest).sum(axis=1)
        moved = coefficients * units.unit
        by_log_scatter += (by_coefficient * (units.centre_slope + moved * units.log_unit_slope) + units.log_unit_slope).sum(axis=1)
        gradient = self._joined(by_coefficient * units.unit, by_log_scatter, of_prior.z + by_z, steep * at.unit)
        return of_answers.sum(axis=1) + of_members + prior + units.log_unit.sum(axis=(1, 2)), gradient

    def split(self, theta: FloatArray) -> tuple[Shared, FloatArray]:
        """What is shared, and xi of the members, (points, N, k)."""
        given = self._given(theta)
        return _out_of_units(given, self._units.at(given.log_scatter), given.coefficients), self._xi(theta)

    def eta(self, theta: FloatArray) -> FloatArray:
        """Parameters of the members, shape (points, N, k)."""
        return self._place(*self.split(theta))[0].eta

    def point(self, shared: Shared, eta: FloatArray) -> FloatArray:
        """The inverse: coordinates of what is shared and of members' parameters, shape (points, D)."""
        xi, units = np.zeros(eta.shape), self._units.at(shared.log_scatter)
        for _ in range(2):  # the prior mean's place and unit depend on the pull
            at = self._place(shared, xi)[0]
            xi = xi + (eta - at.eta) * np.exp(-at.log_unit)
        return self._joined((shared.coefficients - units.centre) * np.exp(-units.log_unit), shared.log_scatter, shared.z, xi)

    @cached_property
    def plainly(self) -> Told:
        """What is told without the funnel."""
        return without_funnel(self.told, self.hyperprior)

    @cached_property
    def _units(self) -> CoefficientUnits:
        return CoefficientUnits(self.plainly, self.x, self.hyperprior)

    @cached_property
    def _columns(self) -> FloatArray:
        return with_ones(self.x)

    def _given(self, theta: FloatArray) -> Shared:
        """What is shared, means and effects in their units."""
        return split_shared(theta[:, : self.size], self.told.place.shape[1], self.x.shape[1])

    def _xi(self, theta: FloatArray) -> FloatArray:
        return theta[:, self.size :].reshape(len(theta), *self.told.place.shape)

    def _scores(self, score: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Log density of scores, (points, N, k), by point, its slopes in each of them, and in the coordinates of correlations."""
        if not self.correlated:
            return self.scatter.log_density(score).sum(axis=(1, 2)), self.scatter.slope(score), z
        root, n = Root.at(z, score.shape[2]), score.shape[1]
        with np.errstate(all="ignore"):  # a correlation next to 1: density 0, where no trajectory goes on
            plain = root.plain(score)
            density = self.scatter.log_density(plain).sum(axis=(1, 2)) - n * root.log_diagonal.sum(axis=1)
            by_score = root.back(self.scatter.slope(plain))
            by_z = root.slopes(-by_score.swapaxes(1, 2) @ plain) - n * root.log_diagonal_slopes
        return density, by_score, by_z

    def _joined(self, coefficients: FloatArray, log_scatter: FloatArray, z: FloatArray, xi: FloatArray) -> FloatArray:
        """Coordinates, or a gradient, of these parts, (points, D)."""
        parts = (coefficients[:, 0], log_scatter, coefficients[:, 1:], z, xi)
        return np.concatenate([part.reshape(len(xi), -1) for part in parts], axis=1)

    def _place(self, shared: Shared, xi: FloatArray) -> tuple[_Place, FloatArray | None]:
        """Where members are; where there is a funnel, also what the pull's quantity does: to mu1 and to the log of its unit."""
        told, expected, log_scatter = self.told, shared.expected(self.x), shared.log_scatter[:, None]
        at = _between(told.log_precision, told.log_precision, told.place - expected, log_scatter, expected, xi)
        if told.funnel is None:
            return at, None
        i, of = told.funnel.mean, told.funnel.pulled(at.eta[..., told.funnel.pull])
        precision, log_scatter, far = told.log_precision[:, i], log_scatter[..., i], expected[..., i] - told.funnel.centre
        with np.errstate(divide="ignore"):  # a pull below the smallest float: nothing is told
            log_pull = np.log(of.pull)
        short = told.place[:, i] - of.pull * far
        column = _between(precision + 2.0 * log_pull, precision + log_pull, short, log_scatter, expected[..., i], xi[..., i])
        for whole, part in zip(at, column, strict=True):
            whole[..., i] = part
        weight = np.exp(precision + 2.0 * column.log_unit)
        by_pull = weight * (short * (2.0 * column.share - 1.0) - of.pull * (far + column.unit * xi[..., i]))
        return at, np.stack([by_pull * of.rise, -of.pull * weight * of.rise])


def _out_of_units(given: Shared, units: Units, coefficients: FloatArray) -> Shared:
    """What is shared as it is, from means and effects in their units, (points, 1 + r, k)."""
    return Shared.of(units.centre + coefficients * units.unit, given.log_scatter, given.z)


def _between(
    log_precision: FloatArray, log_lever: FloatArray, short: FloatArray, log_scatter: FloatArray, expected: FloatArray, xi: FloatArray
) -> _Place:
    """Members between the population's mean and where their answers have them; the latter is exp(log_lever - log_precision) short away."""
    log_ratio = log_precision + 2.0 * log_scatter
    log_share = -np.logaddexp(0.0, log_ratio)
    share, log_unit = np.exp(log_share), log_scatter + 0.5 * log_share
    unit = np.exp(log_unit)
    drawn, own = np.exp(log_lever + 2.0 * log_unit) * short, unit * xi
    score = np.exp(log_lever + log_unit + 0.5 * log_share) * short + np.exp(0.5 * log_share) * xi
    return _Place(expected + drawn + own, score, share, np.exp(log_ratio + log_share), log_unit, unit, share * (2.0 * drawn + own))
