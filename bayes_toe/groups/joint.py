"""The joint posterior of a group: mean m, scatter tau and effects beta of every parameter, and the parameters eta of every subject.

    eta_ik = mu_ik + tau_k u_ik,    mu_ik = m_k + x_i' beta_k,    u ~ normal, or Student's t,
    m ~ Normal,    tau ~ HalfNormal,    beta ~ Normal(0, .)    (:mod:`bayes_toe.groups.hyperprior`)

Coordinates in which it is easy to sample depend on what each subject's answers say. If they say much of eta_ik, it should be a coordinate
itself (centred); if nothing, its score u_ik (non-centred). With h_ik and e_ik, precision and location of eta_ik by the answers alone,
roughly normal, and s = 1/(1 + h tau^2), the population's share of what is known of eta_ik,

    eta = (1 - s) e + s mu + tau s^(1/2) xi

is in between: given mu and tau, xi is then standard normal. That h and e are rough costs speed, not exactness. So

    d eta/d mu = s,    d eta/d log tau = -2 s (1 - s) (mu - e) + tau s^(3/2) xi,    d eta/d xi = tau s^(1/2),
    u = (e - mu) h tau s + s^(1/2) xi,    which does not cancel where tau is small.

Means and effects are in units of what is known of them once the scatter is given: where it is small, subjects are all but one, and their
answers together tell the mean far better than where it is large. The mean given tau is about normal with precision and mean

    P = 1/s^2 + sum_i w_i,    (m_0/s^2 + sum_i w_i e_i)/P,    w_i = 1/(tau^2 + 1/h_i),

and an effect has the precision 1/s^2 + sum_i w_i x_i^2. In these units coordinates are standard normal, whatever the scatter, about.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.special import betaln, ndtri, stdtrit

from bayes_toe.arrays import FloatArray
from bayes_toe.errors import InputError
from bayes_toe.groups.hyperprior import HyperpriorNumbers
from bayes_toe.groups.subjects import NormalApproximation, without_funnel
from bayes_toe.model.distributions import LOG_2PI, Random


@dataclass(frozen=True)
class Scatter:
    """A density of independent scores, symmetric about 0: standard normal, or Student's t with 4 degrees of freedom.

    Of a normal one tau is the standard deviation, of Student's the scale, 1/2^(1/2) of it.
    """

    name: str

    @property
    def _normal(self) -> bool:
        return self.name == "normal"

    @property
    def sd(self) -> float:
        """Standard deviation of a score: what turns tau into one."""
        return 1.0 if self._normal else float(np.sqrt(2.0))

    def log_density(self, u: FloatArray) -> FloatArray:
        """-u^2/2 - ln(2 pi)/2, or ln(3/8) - (5/2) ln(1 + u^2/4)."""
        return np.asarray(
            -0.5 * (np.square(u) + LOG_2PI)
            if self._normal
            else np.log(0.375) - 2.5 * np.log1p(0.25 * np.square(u))
        )

    def slope(self, u: FloatArray) -> FloatArray:
        """Its derivative: -u, or -5 u/(4 + u^2)."""
        return np.asarray(-u if self._normal else -5.0 * u / (4.0 + np.square(u)))

    def sample(self, rng: Random, shape: tuple[int, ...]) -> FloatArray:
        """Independent scores."""
        return rng.standard_normal(shape) if self._normal else rng.standard_t(4, shape)

    def quantile(self, p: FloatArray) -> FloatArray:
        """Scores below which these probabilities lie."""
        return np.asarray(ndtri(p) if self._normal else stdtrit(4.0, p))

    def precisions(self, rng: Random, u: FloatArray) -> FloatArray:
        """Draws of the precision with which each score, given its value, counts as a normal one.

        Student's t is normal with a precision of Gamma(2, rate 2), which given the score is Gamma(5/2, rate 2 + u^2/2).
        """
        return (
            np.ones(u.shape)
            if self._normal
            else np.asarray(rng.standard_gamma(2.5, u.shape) / (2.0 + 0.5 * np.square(u)))
        )


SCATTERS = ("normal", "t")


def scatter_named(name: str) -> Scatter:
    """The scatter of this name, which a user gave."""
    if name not in SCATTERS:
        raise InputError(f"population {name!r}: allowed: {', '.join(SCATTERS)}")
    return Scatter(name)


def pairs(k: int) -> tuple[tuple[int, int], ...]:
    """The pairs (j, i), j < i, of k parameters, (0, 1), (0, 2), (1, 2): the order of the coordinates."""
    return tuple(combinations(range(k), 2))


class Root(NamedTuple):
    """Correlated scores u = L v of independent v, L the Cholesky factor of the correlations R.

        L_ij = t_ij prod_(l < j) (1 - t_il^2)^(1/2),    t_ij = tanh z_ij for j < i, t_ii = 1,

    where t_ij is the partial correlation of i and j given those before j, and z_ij has no bounds. Without coordinates R is 1. Here are L,
    (points, k, k), log of its diagonal, (points, k), and of what it is made: t and the product, both (points, k, k).

    Source: Lewandowski, Kurowicka and Joe 2009, Journal of Multivariate Analysis 100, 1989-2001.
    """

    factor: FloatArray
    log_diagonal: FloatArray
    partial: FloatArray
    left: FloatArray

    @classmethod
    def at(cls, z: FloatArray, k: int) -> Root:
        """At coordinates, (points, k (k - 1)/2), or (points, 0).

        Examples
        --------
        >>> factor = Root.at(np.array([[np.arctanh(0.6)]]), 2).factor[0]
        >>> (factor @ factor.T).round(12).tolist()
        [[1.0, 0.6], [0.6, 1.0]]
        """
        square = np.zeros((len(z), k, k))
        for place, (j, i) in enumerate(pairs(k)[: z.shape[1]]):
            square[:, i, j] = z[:, place]
        log_rest = np.log(2.0) - np.logaddexp(square, -square)  # ln sech
        log_left = np.cumsum(log_rest, axis=2) - log_rest
        partial, left = np.tanh(square) + np.eye(k), np.exp(log_left)
        return cls(np.tril(partial * left), np.diagonal(log_left, axis1=1, axis2=2), partial, left)

    def plain(self, u: FloatArray) -> FloatArray:
        """Independent scores v of scores u = L v, (points, N, k)."""
        v, diagonal = np.empty(u.shape), np.exp(self.log_diagonal)
        for i in range(u.shape[2]):
            v[..., i] = (u[..., i] - (v[..., :i] @ self.factor[:, i, :i, None])[..., 0]) / diagonal[
                :, i, None
            ]
        return v

    def back(self, slopes: FloatArray) -> FloatArray:
        """What slopes in v are in u, (points, N, k)."""
        found, diagonal = np.empty(slopes.shape), np.exp(self.log_diagonal)
        for i in reversed(range(slopes.shape[2])):
            later = (found[..., i + 1 :] @ self.factor[:, i + 1 :, i, None])[..., 0]
            found[..., i] = (slopes[..., i] - later) / diagonal[:, i, None]
        return found

    def slopes(self, of_factor: FloatArray) -> FloatArray:
        """What slopes in L, (points, k, k), are in the coordinates, (points, k (k - 1)/2)."""
        through = of_factor * self.factor
        later = np.cumsum(through[:, :, ::-1], axis=2)[:, :, ::-1] - through
        return _below(
            of_factor * (1.0 - np.square(self.partial)) * self.left - self.partial * later
        )

    @property
    def log_diagonal_slopes(self) -> FloatArray:
        """Those of the sum of the logs of the diagonal of L."""
        return _below(-self.partial)


def log_lkj(z: FloatArray, k: int, shape: float) -> tuple[FloatArray, FloatArray]:
    """Log density of the coordinates under LKJ(shape), (points,), and its slopes; 0 and none where there are no coordinates.

    Under density det(R)^(shape - 1) they are independent with densities sech(z)^(2 b) / B(b, 1/2), b = shape + (k - 2 - j)/2, j from 0.
    """
    b = np.array([shape + 0.5 * (k - 2 - j) for j, _ in pairs(k)[: z.shape[1]]])
    log_cosh = np.logaddexp(z, -z) - np.log(2.0)
    return np.asarray((-2.0 * b * log_cosh - betaln(b, 0.5)).sum(axis=1)), np.asarray(
        -2.0 * b * np.tanh(z)
    )


def _below(square: FloatArray) -> FloatArray:
    """The entries below the diagonal in the order of the coordinates."""
    k = square.shape[-1]
    return (
        np.stack([square[:, i, j] for j, i in pairs(k)], axis=1)
        if k > 1
        else np.empty((len(square), 0))
    )


Likelihood = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


class Hyperparameters(NamedTuple):
    """Mean (..., k), log of the scatter (..., k), effects (..., r, k), coordinates of correlations (..., c), which are 0 without."""

    mean: FloatArray
    log_scatter: FloatArray
    effects: FloatArray
    z: FloatArray

    @property
    def coefficients(self) -> FloatArray:
        """Means, then effects, (..., 1 + r, k)."""
        return np.concatenate([self.mean[..., None, :], self.effects], axis=-2)

    def expected(self, x: FloatArray) -> FloatArray:
        """The mean of subjects with these regressors, (N, r) -> (..., N, k)."""
        return np.asarray(self.mean[..., None, :] + x @ self.effects)


def with_ones(x: FloatArray) -> FloatArray:
    """1, which the mean goes with, and the regressors, (N, r) -> (N, 1 + r)."""
    return np.column_stack([np.ones(len(x)), x])


def log_hyperprior(
    at: Hyperparameters, given: HyperpriorNumbers
) -> tuple[FloatArray, Hyperparameters]:
    """Log density with respect to (m, log tau, beta, z), (points,), and its slopes in each of them."""
    of_mean, of_effects = (at.mean - given.mean) / given.mean_sd, at.effects / given.effect_sd
    of_scatter = np.exp(at.log_scatter) / given.sd_scale
    constant = (
        np.log(given.mean_sd) + 0.5 * LOG_2PI + np.log(given.sd_scale) + 0.5 * np.log(np.pi / 2.0)
    ).sum()
    constant += at.effects.shape[1] * (np.log(given.effect_sd) + 0.5 * LOG_2PI).sum()
    squares = (
        np.square(of_mean).sum(axis=1)
        + np.square(of_scatter).sum(axis=1)
        + np.square(of_effects).sum(axis=(1, 2))
    )
    of_correlations, of_z = log_lkj(at.z, at.mean.shape[1], given.lkj)
    slopes = Hyperparameters(
        -of_mean / given.mean_sd, 1.0 - np.square(of_scatter), -of_effects / given.effect_sd, of_z
    )
    return np.asarray(
        -0.5 * squares + at.log_scatter.sum(axis=1) - constant + of_correlations
    ), slopes


class _Units(NamedTuple):
    """Centre and unit of mean and effects, (points, 1 + r, k), with its log, and what the log of the scatter does to centre and log."""

    centre: FloatArray
    log_unit: FloatArray
    unit: FloatArray
    centre_slope: FloatArray
    log_unit_slope: FloatArray


class _Place(NamedTuple):
    """Where subjects are, (points, N, k) or one column of it, the population's share and the rest, their unit, and what moves them."""

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

    The likelihood has that of each subject and its gradient, eta of shape (points, N, k) -> (points, N) and (points, N, k), and a normal
    approximation; x are regressors, shape (N, r). Correlated scores of a subject have c = k (k - 1)/2 coordinates, otherwise c = 0.
    """

    likelihood: Likelihood
    hyperprior: HyperpriorNumbers
    x: FloatArray
    approximation: NormalApproximation
    scatter: Scatter
    correlated: bool = False

    @property
    def dimension(self) -> int:
        """Number of coordinates, D."""
        return self.size + self.approximation.location.size

    @property
    def size(self) -> int:
        """Number of coordinates of hyperparameters: they come first, means, log scatters, effects by regressor, then correlations."""
        k = self.approximation.location.shape[1]
        return int(k * (2 + self.x.shape[1]) + self.correlated * len(pairs(k)))

    def __call__(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Log density, (points,), and gradient, (points, D), at points, (points, D)."""
        given, xi = self._parts(theta)
        units, coefficients = self._units(given.log_scatter), given.coefficients
        hyper = _out_of_units(given, units, coefficients)
        at, by_pull = self._place(hyper, xi)
        of_answers, of_eta = self.likelihood(at.eta)
        of_scores, by_score, by_z = self._scores(at.score, hyper.z)
        drawn = by_score * np.exp(-hyper.log_scatter)[:, None]
        steep = of_eta + drawn
        if self.approximation.funnel is not None and by_pull is not None:
            funnelled = steep[..., self.approximation.funnel.mean] * by_pull[0] + by_pull[1]
            for whole in (of_eta, steep):
                whole[..., self.approximation.funnel.pull] += funnelled
        of_subjects = of_scores + (at.log_unit - hyper.log_scatter[:, None]).sum(axis=(1, 2))
        prior, of_prior = log_hyperprior(hyper, self.hyperprior)
        by_mean = (
            of_eta * at.share - drawn * at.rest
        )  # not steep - drawn, which cancels where the scatter is small
        by_coefficient = of_prior.coefficients + with_ones(self.x).T @ by_mean
        by_log_scatter = of_prior.log_scatter + (
            steep * at.by_log_scatter - by_score * at.score - at.rest
        ).sum(axis=1)
        moved = coefficients * units.unit
        by_log_scatter += (
            by_coefficient * (units.centre_slope + moved * units.log_unit_slope)
            + units.log_unit_slope
        ).sum(axis=1)
        by_unit = by_coefficient * units.unit
        parts = (by_unit[:, 0], by_log_scatter, by_unit[:, 1:], of_prior.z + by_z, steep * at.unit)
        gradient = np.concatenate([part.reshape(len(theta), -1) for part in parts], axis=1)
        return of_answers.sum(axis=1) + of_subjects + prior + units.log_unit.sum(
            axis=(1, 2)
        ), gradient

    def split(self, theta: FloatArray) -> tuple[Hyperparameters, FloatArray]:
        """Hyperparameters, and parameters of the subjects, (points, N, k)."""
        given, xi = self._parts(theta)
        hyper = _out_of_units(given, self._units(given.log_scatter), given.coefficients)
        return hyper, self._place(hyper, xi)[0].eta

    @cached_property
    def without_funnel(self) -> NormalApproximation:
        """The approximation with mu1 itself in the place of its product with the pull."""
        return without_funnel(self.approximation, self.hyperprior)

    def _units(self, log_scatter: FloatArray) -> _Units:
        """Of means and effects at logs of scatters, (points, k)."""
        prior, about, squares = self.hyperprior, self.without_funnel, np.square(with_ones(self.x)).T
        log_ratio = about.log_precision + 2.0 * log_scatter[:, None]
        log_share = -np.logaddexp(0.0, log_ratio)
        weight = np.exp(about.log_precision + log_share)
        slope = -2.0 * weight * np.exp(log_ratio + log_share)
        precision = (
            np.stack([prior.mean_sd, *[prior.effect_sd] * self.x.shape[1]]) ** -2.0
            + squares @ weight
        )
        log_unit_slope = -0.5 * (squares @ slope) / precision
        centre, centre_slope = np.zeros(precision.shape), np.zeros(precision.shape)
        centre[:, 0] = (
            prior.mean / np.square(prior.mean_sd) + (weight * about.location).sum(axis=1)
        ) / precision[:, 0]
        # The slope of sum w e less that of P times the centre: about the centre, so that locations far from 0 do not cancel.
        centre_slope[:, 0] = (slope * (about.location - centre[:, :1])).sum(axis=1) / precision[
            :, 0
        ]
        log_unit = -0.5 * np.log(precision)
        return _Units(centre, log_unit, np.exp(log_unit), centre_slope, log_unit_slope)

    def _parts(self, theta: FloatArray) -> tuple[Hyperparameters, FloatArray]:
        """Hyperparameters with means and effects in their units, and xi, of points, (points, D)."""
        (n, k), r = self.approximation.location.shape, self.x.shape[1]
        mean, log_scatter, effects, z, xi = np.split(
            theta, (k, 2 * k, (2 + r) * k, self.size), axis=1
        )
        return Hyperparameters(mean, log_scatter, effects.reshape(len(theta), r, k), z), xi.reshape(
            len(theta), n, k
        )

    def _scores(
        self, score: FloatArray, z: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Log density of scores, (points, N, k), by point, its slopes in each of them, and in the coordinates of correlations."""
        if not self.correlated:
            return self.scatter.log_density(score).sum(axis=(1, 2)), self.scatter.slope(score), z
        root, n = Root.at(z, score.shape[2]), score.shape[1]
        with np.errstate(
            all="ignore"
        ):  # a correlation next to 1: density 0, where no trajectory goes on
            plain = root.plain(score)
            density = self.scatter.log_density(plain).sum(axis=(1, 2)) - n * root.log_diagonal.sum(
                axis=1
            )
            by_score = root.back(self.scatter.slope(plain))
            by_z = root.slopes(-by_score.swapaxes(1, 2) @ plain) - n * root.log_diagonal_slopes
        return density, by_score, by_z

    def _place(self, hyper: Hyperparameters, xi: FloatArray) -> tuple[_Place, FloatArray | None]:
        """Where subjects are; where there is a funnel, also what the pull's quantity does: to mu1 and to the log of its unit."""
        about, expected, log_scatter = (
            self.approximation,
            hyper.expected(self.x),
            hyper.log_scatter[:, None],
        )
        at = _between(
            about.log_precision,
            about.log_precision,
            about.location - expected,
            log_scatter,
            expected,
            xi,
        )
        if about.funnel is None:
            return at, None
        i, of = about.funnel.mean, about.funnel.pulled(at.eta[..., about.funnel.pull])
        precision, log_scatter, far = (
            about.log_precision[:, i],
            log_scatter[..., i],
            expected[..., i] - about.funnel.centre,
        )
        with np.errstate(divide="ignore"):  # a pull below the smallest float: nothing is told
            log_pull = np.log(of.pull)
        short = about.location[:, i] - of.pull * far
        column = _between(
            precision + 2.0 * log_pull,
            precision + log_pull,
            short,
            log_scatter,
            expected[..., i],
            xi[..., i],
        )
        for whole, part in zip(at, column, strict=True):
            whole[..., i] = part
        weight = np.exp(precision + 2.0 * column.log_unit)
        by_pull = weight * (
            short * (2.0 * column.share - 1.0) - of.pull * (far + column.unit * xi[..., i])
        )
        return at, np.stack([by_pull * of.rise, -of.pull * weight * of.rise])


def _out_of_units(
    given: Hyperparameters, units: _Units, coefficients: FloatArray
) -> Hyperparameters:
    """Hyperparameters as they are, from means and effects in their units, (points, 1 + r, k)."""
    whole = units.centre + coefficients * units.unit
    return Hyperparameters(whole[:, 0], given.log_scatter, whole[:, 1:], given.z)


def _between(
    log_precision: FloatArray,
    log_lever: FloatArray,
    short: FloatArray,
    log_scatter: FloatArray,
    expected: FloatArray,
    xi: FloatArray,
) -> _Place:
    """Subjects between the population's mean and where their answers have them; the latter is exp(log_lever - log_precision) short away."""
    log_ratio = log_precision + 2.0 * log_scatter
    log_share = -np.logaddexp(0.0, log_ratio)
    share, log_unit = np.exp(log_share), log_scatter + 0.5 * log_share
    unit = np.exp(log_unit)
    drawn, own = np.exp(log_lever + 2.0 * log_unit) * short, unit * xi
    score = np.exp(log_lever + log_unit + 0.5 * log_share) * short + np.exp(0.5 * log_share) * xi
    return _Place(
        expected + drawn + own,
        score,
        share,
        np.exp(log_ratio + log_share),
        log_unit,
        unit,
        share * (2.0 * drawn + own),
    )
