"""Log density and gradient of the joint posterior of a group.

`SubjectRows` is the likelihood of all subjects. `separate_fits` fits each subject alone.
`GroupPosterior` joins both with the hyperprior; a call gives the log density and its gradient.

Subject i has a vector of coefficients a_i: the parameters of the group (see
:mod:`bayes_toe.groups.hyperprior`) and, with conditions, their differences. The group has means m,
effects beta of the covariates x_i, and standard deviations tau:

    a_i = mu_i + tau u_i,   mu_i = m + x_i' beta,   u_i ~ Normal(0, 1).

Where the responses say nothing of a_i the best coordinate is its score u_i (non-centred); where
they determine a_i it is a_i itself (centred). The coordinate xi lies between both:

    a = s mu + (1 - s) e + tau s^(1/2) xi,   s = 1/(1 + h tau^2).

The estimate e and its precision h are those of the separate fits (`SeparateFits.precision` is h,
`information` is h e). Given mu and tau, xi is nearly standard normal. Rough values of e and h cost
speed, not exactness; with h = 0 the coordinates are non-centred. The lapse rate and the slopes of
noise and criterion have the prior of a single subject.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bayes_toe.arrays import ArrayPair, FloatArray, IntArray, NamedArrays, Rng
from bayes_toe.data.conditions import StimulusScales
from bayes_toe.data.study import Subject
from bayes_toe.groups.hyperprior import HyperpriorNumbers
from bayes_toe.model.densities import by_coordinate, half_normal_score
from bayes_toe.model.observer import ObserverRows
from bayes_toe.model.parameters import ObserverPrior, group_parameters, task_parameters
from bayes_toe.model.posterior_array import LinearLikelihood, loading_of

#: In these units a coordinate of the observer is c/D, p, log(sigma_d/D) or logit q0 itself, and not
#: that quantity over its prior's scale.
PLAIN_UNITS = ObserverPrior(noise_sd=1.0, constant_error_scale=1.0, contraction_sd=1.0)
#: Steps of Fisher scoring.
_SCORING_STEPS = 40
#: Expected gain, nats, below which rounding errors hide which of two values is larger.
_SMALL_GAIN = 1e-9


@dataclass(frozen=True, eq=False)
class SubjectRows(LinearLikelihood):
    """The counts of all subjects as one likelihood; a subject has a row for each condition.

    A subject's point w has its q coefficients, then the parameters that the group does not share.
    The loading of a row turns w into the coordinates of the observer in that row.

    Attributes
    ----------
    n_coefficients : int
        q, the number of coefficients of a subject.
    unshared_coordinates : list of int
        The coordinates of the rows that the group does not share.
    """

    rows: ObserverRows
    n_coefficients: int
    unshared_coordinates: list[int]

    @classmethod
    def from_subjects(
        cls,
        units: Sequence[Subject],
        scales: Sequence[StimulusScales],
        first_row: IntArray,
        differences: NamedArrays,
    ) -> SubjectRows:
        """The likelihood of units, which are subjects, or subjects in a condition: a row each.

        Parameters
        ----------
        units, scales
            Counts and scales of every row.
        first_row : ndarray of int
            The first row of every subject.
        differences : mapping of str to ndarray, shape (rows, columns)
            The design of the conditions for each parameter that may differ between them.
        """
        task = units[0].task  # of all units
        names = [parameter.name for parameter in task_parameters(task)]
        shared_names = [parameter.name for parameter in group_parameters(task)]
        unshared_names = [name for name in names if name not in shared_names]

        unit_column = np.ones((len(units), 1))
        loading = loading_of(
            names,
            [
                *((name, unit_column) for name in shared_names),
                *differences.items(),
                *((name, unit_column) for name in unshared_names),
            ],
        )
        return cls(
            ObserverRows.from_subjects(units, PLAIN_UNITS, scales),
            loading,
            first_row,
            n_coefficients=loading.shape[2] - len(unshared_names),
            unshared_coordinates=list(map(names.index, unshared_names)),
        )

    @property
    def n_subjects(self) -> int:
        """Number of subjects."""
        return len(self.first_row)

    @property
    def n_coordinates(self) -> int:
        """Length of a subject's point: q, and the number of unshared parameters."""
        return int(self.loading.shape[2])

    def gradient(self, w: FloatArray) -> ArrayPair:
        """Log likelihood and its gradient in w, (subjects, points[, coordinates of w])."""
        value, slope = self.rows.gradient(self.row_points(w))
        return self.summed(value), self.summed(slope @ self.loading)

    def log_unshared_prior(self, unshared: FloatArray) -> ArrayPair:
        """Log prior of the unshared parameters, (..., unshared) -> (...), and their slopes."""
        priors = tuple(self.rows.priors[coordinate] for coordinate in self.unshared_coordinates)
        log_densities = by_coordinate(priors, "log_density", unshared)
        return log_densities.sum(axis=-1), by_coordinate(priors, "slope", unshared)


class SeparateFits(NamedTuple):
    """Approximate posteriors of each subject without the other subjects.

    Attributes
    ----------
    mode : ndarray, shape (subjects, q + unshared)
        The maximum under a normal prior as wide as the hyperprior.
    sd : ndarray, shape (subjects, q + unshared)
    information, precision : ndarray, shape (subjects, q)
        h e and h of the coefficients by the responses alone.
    ridge : ndarray, shape (subjects, unshared, q)
        How the mode of the slopes moves with the coefficients; 0 of the lapse rate.
    """

    mode: FloatArray
    sd: FloatArray
    information: FloatArray
    precision: FloatArray
    ridge: FloatArray


def separate_fits(rows: SubjectRows, numbers: HyperpriorNumbers) -> SeparateFits:
    """The normal that approximates each subject's posterior at its maximum.

    The prior of a subject is normal here. Unshared parameters have SD 1. A coefficient has the sum
    of two variances: that of the group mean, and that between subjects.
    """
    q = rows.n_coefficients
    prior_mean = np.zeros(rows.n_coordinates)
    prior_precision = np.ones(rows.n_coordinates)
    prior_mean[:q] = numbers.mean
    prior_precision[:q] = 1.0 / (np.square(numbers.mean_scale) + np.square(numbers.sd_scale))
    mode, information = _scored_maxima(rows, prior_mean, prior_precision)

    # The precision of the responses is that of the posterior less that of the prior. Where nothing
    # is left, the responses say nothing, and h e is 0 as h is.
    variance = np.diagonal(np.linalg.inv(information), axis1=1, axis2=2)  # (subjects, q + unshared)
    precision_of_responses = np.maximum(1.0 / variance[:, :q] - prior_precision[:q], 0.0)
    information_of_responses = mode[:, :q] / variance[:, :q] - prior_precision[:q] * prior_mean[:q]
    information_of_responses[precision_of_responses <= 0.0] = 0.0

    # How the mode of the unshared parameters v moves with the coefficients a: -I_vv^-1 I_va.
    ridge = -np.linalg.solve(information[:, q:, q:], information[:, q:, :q])
    # The lapse rate is the first of the unshared parameters. It trades off against the noise along
    # a curve, not a line.
    ridge[:, 0] = 0.0
    fits = (mode, np.sqrt(variance), information_of_responses, precision_of_responses, ridge)
    # Single precision is enough, and the same on processors whose last bits differ.
    return SeparateFits(*(values.astype(np.float32).astype(np.float64) for values in fits))


def _scored_maxima(
    rows: SubjectRows, prior_mean: FloatArray, prior_precision: FloatArray
) -> ArrayPair:
    """The maximum of each subject's log density, (n, k), and the information there, (n, k, k).

    The prior is normal, with this mean and precision, (k,) each. By Fisher scoring all subjects
    move at once. A step that lowers the log density of a subject is not made; the next step of that
    subject is shorter.
    """

    def scored(w: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Log density, (n,), gradient, (n, k), and information, (n, k, k), at w, (n, k)."""
        value, slope, information = rows.scoring(w[:, None])  # with an axis of one point
        deviation = w - prior_mean
        return (
            value[:, 0] - 0.5 * (prior_precision * np.square(deviation)).sum(axis=1),
            slope[:, 0] - prior_precision * deviation,
            information[:, 0] + np.diag(prior_precision),
        )

    w = np.tile(prior_mean, (rows.n_subjects, 1))
    value, slope, information = scored(w)
    share = np.ones((rows.n_subjects, 1))  # of a full step, for each subject
    for _ in range(_SCORING_STEPS):
        step = np.linalg.solve(information, slope[..., None])[..., 0]
        trial = w + share * step
        trial_value, *trial_slopes = scored(trial)
        # Where the gain is lost in rounding errors, any step is as good.
        expected_gain = (step * slope).sum(axis=1)
        is_better = (trial_value > value) | (expected_gain < _SMALL_GAIN)

        # Subjects with a better point move there: their values change in place.
        for values, new_values in zip(
            (w, value, slope, information), (trial, trial_value, *trial_slopes), strict=True
        ):
            values[is_better] = new_values[is_better]
        # After a step that is made, the next share is twice as large; otherwise it is a quarter.
        share = np.where(is_better[:, None], np.minimum(1.0, 2.0 * share), 0.25 * share)
    return w, information


class Coefficients(NamedTuple):
    """The coefficients of the subjects, with the parts of their formula in the module's docstring.

    The shape is (subjects, points, q).
    """

    share: FloatArray  # s = 1/(1 + h tau^2)
    slope_at_mu: FloatArray  # h (e - mu), the slope of the likelihood's normal in a, at mu
    value: FloatArray  # a, as mu + tau^2 s h (e - mu) + tau s^(1/2) xi
    score: FloatArray  # u = (a - mu) / tau


@dataclass(frozen=True, eq=False)
class GroupPosterior:
    """Log density of the joint posterior, with its gradient.

    A point theta has the means, scores of the standard deviations and effects, then for each
    subject xi of its coefficients, and the parameters that are not shared, counted from their mode.
    The mode of a slope moves with the coefficients, because slopes trade off against p.

    Attributes
    ----------
    rows : SubjectRows
    numbers : HyperpriorNumbers
    x : ndarray, shape (subjects, covariates)
    fits : SeparateFits
    """

    rows: SubjectRows
    numbers: HyperpriorNumbers
    x: FloatArray
    fits: SeparateFits

    @property
    def n_shared(self) -> int:
        """Number of coordinates of the group; they come first."""
        return int(self.rows.n_coefficients * (2 + self.x.shape[1]))

    def __call__(self, theta: FloatArray) -> ArrayPair:
        """Log density, (points,), and gradient at theta, (points, coordinates)."""
        numbers = self.numbers
        q = self.rows.n_coefficients
        mean, sd_score, effects, xi, unshared = self._split(theta)
        tau, tau_rise, log_prior_of_sd, slope_of_sd_prior = numbers.sds(sd_score)  # (points, q)
        coefficients = self._coefficients(mean, tau, effects, xi)
        w = self._subject_points(coefficients.value, unshared)

        log_likelihood, likelihood_slope = self.rows.gradient(w)
        log_unshared, unshared_slope = self.rows.log_unshared_prior(w[..., q:])
        # Normal prior of the scores u, with the Jacobian |du/dxi| = s^(1/2).
        log_scores = 0.5 * np.log(coefficients.share) - 0.5 * np.square(coefficients.score)
        log_mean, mean_slope = numbers.prior_of_mean(mean)
        log_effect, effect_slope = numbers.prior_of_effect(effects)
        log_prior = (log_mean + log_prior_of_sd).sum(axis=-1) + log_effect.sum(axis=(1, 2))
        log_density_of_subjects = log_likelihood + log_unshared + log_scores.sum(axis=-1)
        value = log_prior + log_density_of_subjects.sum(axis=0)

        # Slopes in the subjects' parameters, (subjects, points, ...), then in those of the group.
        by_unshared = likelihood_slope[..., q:] + unshared_slope
        by_coefficient = likelihood_slope[..., :q] + by_unshared @ self.fits.ridge
        by_xi, by_expected, by_sd = self._coefficient_slopes(coefficients, tau, xi, by_coefficient)
        mean_slope = mean_slope + by_expected.sum(axis=0)
        sd_slope = slope_of_sd_prior + by_sd.sum(axis=0) * tau_rise
        effect_slope = effect_slope + np.einsum("nr,npq->prq", self.x, by_expected)
        return value, self._join(mean_slope, sd_slope, effect_slope, by_xi, by_unshared)

    def _coefficient_slopes(
        self, coefficients: Coefficients, tau: FloatArray, xi: FloatArray, by_value: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Slopes of the log density in xi, mu and tau, from its slope `by_value` in a.

        The shape is (subjects, points, q). By the chain rule, with the prior of the scores u: its
        log has the slope -u du/dxi in xi, and so on.
        """
        share, slope_at_mu, _, score = coefficients
        precision = self.fits.precision[:, None]  # h, (subjects, 1, q)
        root = np.sqrt(share)  # du/dxi
        unit = tau * root  # da/dxi
        by_xi = by_value * unit - score * root

        score_fall = precision * tau * share  # -du/dmu, and minus the slope of the log Jacobian
        by_expected = by_value * share + score * score_fall  # da/dmu is the share

        value_rise = share * root * (2.0 * unit * slope_at_mu + xi)  # da/dtau
        score_rise = share * slope_at_mu * (2.0 * share - 1.0) - root * score_fall * xi  # du/dtau
        by_sd = by_value * value_rise - score * score_rise - score_fall
        return by_xi, by_expected, by_sd

    def points(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The parameters of coordinates theta, shape (points, coordinates).

        Means and standard deviations, (points, q), effects, (points, covariates, q), and the
        subjects' points w, (points, subjects, q + unshared).
        """
        mean, sd_score, effects, xi, unshared = self._split(theta)
        tau, *_ = self.numbers.sds(sd_score)  # without densities and slopes
        coefficients = self._coefficients(mean, tau, effects, xi)
        points = self._subject_points(coefficients.value, unshared)
        return mean, tau, effects, points.swapaxes(0, 1)

    def start(self, n_points: int, rng: Rng) -> FloatArray:
        """Starting points of chains about the separate fits, farther apart than the posterior.

        Means scatter by two of their standard errors, and standard deviations by a factor of about
        2. The latter are at least 0.3 of their scale, because separate fits may hardly differ.
        """
        q = self.rows.n_coefficients
        mode = self.fits.mode[:, :q]
        spread = np.maximum(mode.std(axis=0), 0.3 * self.numbers.sd_scale)  # (q,)
        standard_error = spread / np.sqrt(self.rows.n_subjects)

        mean = mode.mean(axis=0) + 2.0 * standard_error * rng.standard_normal((n_points, q))
        sd = spread * np.exp(0.7 * rng.standard_normal((n_points, q)))  # exp(0.7) is 2
        sd_score = half_normal_score(sd / self.numbers.sd_scale)
        # Effects of covariates are about 0.
        effects = standard_error * rng.standard_normal((n_points, self.x.shape[1], q))
        # A subject has q scores xi, which are standard normal, and then the unshared parameters.
        block = rng.standard_normal((n_points, self.rows.n_subjects, self.rows.n_coordinates))
        xi, unshared = np.split(block.swapaxes(0, 1), [q], axis=-1)
        return self._join(mean, sd_score, effects, xi, unshared * self.fits.sd[:, None, q:])

    def _split(self, theta: FloatArray) -> tuple[FloatArray, ...]:
        """The parts of theta: means, scores of SDs, effects, xi, and the unshared parameters.

        The last two have the shape (subjects, points, ...), and the others (points, ...).
        """
        q = self.rows.n_coefficients
        n_points = len(theta)
        mean, sd_score, effects, block = np.split(theta, (q, 2 * q, self.n_shared), axis=1)
        block = block.reshape(n_points, self.rows.n_subjects, self.rows.n_coordinates)
        xi, unshared = np.split(block.swapaxes(0, 1), [q], axis=-1)
        return mean, sd_score, effects.reshape(n_points, -1, q), xi, unshared

    def _join(
        self,
        mean: FloatArray,
        sd_score: FloatArray,
        effects: FloatArray,
        xi: FloatArray,
        unshared: FloatArray,
    ) -> FloatArray:
        """Theta, or slopes in it, (points, coordinates): the inverse of `_split`."""
        block = np.concatenate([xi, unshared], axis=-1).swapaxes(0, 1)
        parts = (mean, sd_score, effects, block)
        return np.concatenate([part.reshape(len(mean), -1) for part in parts], axis=1)

    def _coefficients(
        self, mean: FloatArray, tau: FloatArray, effects: FloatArray, xi: FloatArray
    ) -> Coefficients:
        """The coefficients of the subjects from their coordinates xi, (subjects, points, q)."""
        precision = self.fits.precision[:, None]  # h, (subjects, 1, q)
        expected = mean + np.einsum("nr,prq->npq", self.x, effects)  # mu
        slope_at_mu = self.fits.information[:, None] - precision * expected
        share = 1.0 / (1.0 + precision * np.square(tau))
        root = np.sqrt(share)
        unit = tau * root
        value = expected + np.square(unit) * slope_at_mu + unit * xi
        return Coefficients(share, slope_at_mu, value, score=tau * share * slope_at_mu + root * xi)

    def _subject_points(self, coefficients: FloatArray, unshared: FloatArray) -> FloatArray:
        """Points w, (subjects, points, q + unshared), from coefficients and further coordinates.

        The coordinates of unshared parameters count from their mode given the coefficients.
        """
        q = self.rows.n_coefficients
        # With an axis for the points, (subjects, 1, ...).
        mode, unshared_mode = np.split(self.fits.mode[:, None], [q], axis=-1)
        shift = (coefficients - mode) @ self.fits.ridge.swapaxes(1, 2)
        return np.concatenate([coefficients, unshared_mode + shift + unshared], axis=-1)
