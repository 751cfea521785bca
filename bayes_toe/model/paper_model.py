"""The paper's model (H1) of one subject: its answers, its posterior and its quantities.

    natural      (mu1, sigma_p, sigma_l, q0)          what the paper reports
    identified   (offset c, pull p, width w, q0)      what the answers depend on

    z = ((s2 - s1) + p (s1 - mu1)) / w,   p = 2 gamma / (1 + 2 gamma + (1 + 4 gamma)^(1/2))
    same or different   P(equal) = q0 2^(-z^2),                       w = sigma_p (1 - p)^(-3/2)
    which is stronger   P(second) = lambda/2 + (1 - lambda) Phi(z),   w = sigma_p (1 - p)^(-1)

with c = p (mu1 - sbar), sbar the mean first stimulus of the subject; gamma and G are those of
:mod:`bayes_toe.model.paper_equations`. Which is stronger has the lapse rate lambda in the place of
q0.

There are four coordinates u: the score of mu1; the score of the spread, which is the width w or
sigma_p, whichever has a prior of its own; the probit of gamma; the probit of the share, which is q0
or lambda. A score is that of :mod:`bayes_toe.model.densities`. :class:`PaperRows` has the answers,
:class:`PaperPosterior` the posterior, and :class:`FunnelArray` the posterior in coordinates without
a funnel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri

from bayes_toe.arrays import ArrayPair, FloatArray, NamedArrays, Texts
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import Task
from bayes_toe.model.answer_curves import (
    AnswerRows,
    AnswerSlopes,
    LogAnswers,
    over_scale,
    pair_arrays,
)
from bayes_toe.model.densities import (
    Priors,
    ProbitOfBeta,
    StandardNormal,
    half_normal_score,
    log_half_normal_slope,
    log_half_normal_value,
    log_normal_density,
    normal_hazard,
    probit_of_logit,
)
from bayes_toe.model.observer import JND_OVER_NOISE
from bayes_toe.model.paper_equations import (
    LN2,
    natural_names,
    noise_ratio,
    pull,
    variance_ratio,
)
from bayes_toe.model.posterior import Names, SubjectPosterior
from bayes_toe.model.posterior_array import PosteriorArray
from bayes_toe.model.prior import DEFAULT, Prior

#: The name of the paper's model in files and in the keys of its random streams.
PAPER_MODEL = "predictive update"
PRIOR_DRAWS = 100_000
#: The power of G = 1 / (1 - p) in the width sigma_p G^power, by the fourth parameter of the task.
POWERS = {"q0": 1.5, "lapse_rate": 1.0}
#: The just noticeable difference over the width: where P(equal) is half its peak, or P(second) is
#: 75 %.
_JND_OVER_WIDTH = {"q0": 1.0, "lapse_rate": JND_OVER_NOISE}


# --- Answers -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PaperRows(AnswerRows):
    """Counts of one subject of a task, with the four coordinates of H1; a row may be repeated.

    Attributes
    ----------
    task : Task
    prior : Prior
        With numbers in the place of "stimuli".
    first, difference : ndarray, shape (rows, 1, pairs)
        s1 and s2 - s1, natural-log intensity.
    counts : ndarray, shape (rows, 2, 1, pairs)
        Three answers are two here: 'equal' and not 'equal'.
    """

    task: Task
    prior: Prior

    @property
    def coordinates(self) -> Texts:
        """Names of the parameters that have a coordinate."""
        return self.prior.paper_parameters(self.task)

    @property
    def power(self) -> float:
        """The power of G in the width sigma_p G^power."""
        return POWERS[self.task.lapses]

    @cached_property
    def priors(self) -> Priors:
        """The prior of every coordinate."""
        score = StandardNormal()
        gamma = ProbitOfBeta(self.prior.gamma_a, self.prior.gamma_b)
        if self.task.lapses == "q0":
            share = ProbitOfBeta(self.prior.q0_a, self.prior.q0_b)
        else:
            share = ProbitOfBeta(self.prior.lapse_rate_a, self.prior.lapse_rate_b)
        return score, score, gamma, share

    # --- Quantities ------------------------------------------------------------------------------

    def mu1(self, u: FloatArray) -> FloatArray:
        """Prior mean of the observer, natural-log intensity, (rows, points)."""
        mean, sd = self.prior.mu1_normal
        return mean + sd * u[..., 0]

    def pull(self, u: FloatArray) -> FloatArray:
        """Contraction p, (rows, points); the third coordinate is the probit of gamma."""
        return pull(ndtr(u[..., 2]))

    def log_pull(self, u: FloatArray) -> FloatArray:
        """Log of p, finite however small gamma is, (rows, points)."""
        v = u[..., 2]  # p = gamma / G^2, gamma = Phi(v)
        return log_ndtr(v) - 2.0 * np.log(variance_ratio(ndtr(v)))

    def _log_spread_share(self, pull: FloatArray) -> FloatArray:
        """Log of the spread over the width w, of the shape of the pull p.

        The spread is w or sigma_p = w (1 - p)^power, whichever has a prior of its own.
        """
        if self.prior.spread == "width":
            return np.zeros_like(pull)
        return self.power * np.log1p(-pull)

    def log_width(self, u: FloatArray) -> FloatArray:
        """Log of the width w, (rows, points), from the score of the spread and the pull.

        The spread over its scale is half-normal, or lognormal if it has a standard deviation.
        """
        score = u[..., 1]
        sd = self.prior.spread_sd
        log_ratio = log_half_normal_value(score) if sd is None else sd * score
        return np.log(self.prior.spread_scale) + log_ratio - self._log_spread_share(self.pull(u))

    def spread_score(self, log_width: FloatArray, pull: FloatArray) -> FloatArray:
        """The second coordinate, from the log width and the pull p; the inverse of `log_width`."""
        log_ratio = log_width + self._log_spread_share(pull) - np.log(self.prior.spread_scale)
        if self.prior.spread_sd is None:
            return half_normal_score(np.exp(log_ratio))
        return log_ratio / self.prior.spread_sd

    def spread_slope(self, u: FloatArray) -> FloatArray:
        """Slope of the log width in the second coordinate, (rows, points)."""
        if self.prior.spread_sd is None:
            return log_half_normal_slope(u[..., 1])
        return np.full(u.shape[:-1], self.prior.spread_sd)

    def distance(self, u: FloatArray) -> FloatArray:
        """Distance of the second stimulus from the evolved mean, in widths, (rows, points, pairs).

        z = (s2 - s1 + p (s1 - mu1)) / w.
        """
        first_from_mu1 = self.first - self.mu1(u)[..., None]
        numerator = self.difference + self.pull(u)[..., None] * first_from_mu1
        return over_scale(numerator, self.log_width(u)[..., None])

    # --- Answers ---------------------------------------------------------------------------------

    def log_answers(self, u: FloatArray) -> LogAnswers:
        """Log probability of both answers to every pair, (rows, points, pairs) each."""
        answers_at, _ = CURVES[self.task.lapses]
        # The slice keeps an axis for the pairs: (rows, points, 1).
        return answers_at(self.distance(u), ndtr(u[..., 3:]), ndtr(-u[..., 3:]))

    @np.errstate(over="ignore", invalid="ignore")  # far out, where the density is 0
    def answer_slopes(self, u: FloatArray) -> AnswerSlopes:
        """Log probability of each answer, and its slopes, (rows, points, 4, pairs).

        The first three coordinates act through z, the distance in widths. The fourth coordinate
        acts through the share, q0 or the lapse rate, which is Phi of it.
        """
        z = self.distance(u)  # (rows, points, pairs)
        share, complement = ndtr(u[..., 3:]), ndtr(-u[..., 3:])  # (rows, points, 1) each
        answers_at, slopes_at = CURVES[self.task.lapses]
        log_answers = answers_at(z, share, complement)
        in_z, in_share = slopes_at(z, share, log_answers)

        z_slopes = self._distance_slopes(u, z)
        share_slope = np.exp(log_normal_density(u[..., 3:]))
        slopes = []
        for log_p_by_z, log_p_by_share in zip(in_z, in_share, strict=True):
            by_first_three = log_p_by_z[..., None, :] * z_slopes
            by_fourth = np.broadcast_to(log_p_by_share * share_slope, z.shape)
            slopes.append(np.concatenate([by_first_three, by_fourth[..., None, :]], axis=-2))
        return log_answers, slopes

    def _distance_slopes(self, u: FloatArray, z: FloatArray) -> FloatArray:
        """Slopes of z = (s2 - s1 + p (s1 - mu1)) / w, (rows, points, 3, pairs).

        They are in the score of mu1, in the score of the spread and in the probit of gamma.
        """
        p = self.pull(u)  # (rows, points)
        _, mu1_sd = self.prior.mu1_normal
        first_from_mu1 = self.first - self.mu1(u)[..., None]
        inverse_width = np.exp(-self.log_width(u))[..., None]

        # From gamma = p/(1 - p)^2 = Phi(v), with v the probit of gamma,
        # d ln gamma / d ln p = (1 + p)/(1 - p) and d ln gamma / dv = phi(v)/Phi(v).
        p_by_gamma = p * (1.0 - p) / (1.0 + p) * normal_hazard(-u[..., 2])
        if self.prior.spread == "width":
            log_width_by_gamma = np.zeros_like(p)
        else:  # w = sigma_p (1 - p)^(-power)
            log_width_by_gamma = self.power * p_by_gamma / (1.0 - p)

        by_mu1 = -(p * mu1_sd)[..., None] * inverse_width
        by_spread = -z * self.spread_slope(u)[..., None]
        by_gamma = p_by_gamma[..., None] * first_from_mu1 * inverse_width
        by_gamma -= z * log_width_by_gamma[..., None]
        return np.stack(np.broadcast_arrays(by_mu1, by_spread, by_gamma), axis=-2)


# --- Curves of both answers ----------------------------------------------------------------------


def bell_answers(z: FloatArray, q0: FloatArray, complement: FloatArray) -> ArrayPair:
    """Log of P(equal) = q0 2^(-z^2) and of P(different), where `complement` is 1 - q0.

    P(different) is the sum of 1 - q0 and q0 (1 - 2^(-z^2)). Source: Eq. mod:q.

    Examples
    --------
    >>> log_equal, _ = bell_answers(np.array(1e3), np.array(0.5), np.array(0.5))
    >>> round(float(log_equal), 2)  # the probability is below the smallest float
    -693147.87
    """
    with np.errstate(over="ignore", divide="ignore"):  # the log of 0
        log_bell = -LN2 * np.square(z)
        return np.log(q0) + log_bell, np.log(complement - q0 * np.expm1(log_bell))


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def bell_slopes(
    z: FloatArray, q0: FloatArray, log_answers: LogAnswers
) -> tuple[ArrayPair, ArrayPair]:
    """Slopes of :func:`bell_answers` in z, and in q0; both answers in each.

    With the odds r = P(equal)/P(different), the slopes of ln P(different) are 2 ln2 r z and -r/q0.
    """
    log_equal, log_different = log_answers
    odds = np.exp(log_equal - log_different)
    equal_in_z = -2.0 * LN2 * z
    return (equal_in_z, -odds * equal_in_z), (1.0 / q0, -odds / q0)


def guessing_answers(z: FloatArray, rate: FloatArray, complement: FloatArray) -> ArrayPair:
    """Log of P(second) = lambda/2 + (1 - lambda) Phi(z) and of P(first).

    Examples
    --------
    >>> log_second, _ = guessing_answers(np.array(-1e9), np.array(0.2), np.array(0.8))
    >>> round(float(np.exp(log_second)), 12)
    0.1
    """
    with np.errstate(divide="ignore"):  # the log of 0
        log_second, log_first = (
            np.log(0.5 * rate + complement * ndtr(distance)) for distance in (z, -z)
        )
    return log_second, log_first


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def guessing_slopes(
    z: FloatArray, rate: FloatArray, log_answers: LogAnswers
) -> tuple[ArrayPair, ArrayPair]:
    """Slopes of :func:`guessing_answers` in z, and in lambda; both answers in each."""
    log_second, log_first = log_answers
    log_density = np.log1p(-rate) + log_normal_density(z)
    in_z = np.exp(log_density - log_second), -np.exp(log_density - log_first)
    in_rate = (0.5 - ndtr(z)) * np.exp(-log_second), (0.5 - ndtr(-z)) * np.exp(-log_first)
    return in_z, in_rate


#: The log probabilities of both answers, and their slopes, by the fourth parameter of the task.
CURVES = {
    "q0": (bell_answers, bell_slopes),
    "lapse_rate": (guessing_answers, guessing_slopes),
}


# --- Posterior -----------------------------------------------------------------------------------


def paper_posterior(subject: Subject, prior: Prior = DEFAULT) -> PaperPosterior:
    """The posterior of one subject under the paper's model (H1).

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> paper_posterior(subject).coordinates
    ('mu1', 'width', 'gamma', 'q0')
    """
    return PaperPosterior(subject, prior)


@dataclass(frozen=True, eq=False)
class PaperPosterior(SubjectPosterior):
    """Log posterior of one subject under the paper's model.

    Parameters
    ----------
    subject : Subject
        The counts.
    prior : Prior
        "stimuli" in it become numbers of this subject's stimuli.
    centre : float, optional
        Intensity from which the offset counts, natural-log units; by default the mean first
        stimulus.
    """

    subject: Subject
    prior: Prior = DEFAULT
    centre: float | None = None
    model_name = PAPER_MODEL

    def __post_init__(self) -> None:
        object.__setattr__(self, "prior", self.prior.for_subjects(self.subject))

    @cached_property
    def rows(self) -> PaperRows:
        """The counts, as one row."""
        subject = self.subject
        counts = subject.n_yes, subject.n_trials - subject.n_yes
        return PaperRows(
            **pair_arrays([subject], [0.0], [1.0], [counts]),
            task=subject.task,
            prior=self.prior,
        )

    @cached_property
    def sbar(self) -> float:
        """Intensity from which the offset counts, natural-log units."""
        if self.centre is not None:
            return self.centre
        if self.subject.shared_scales is not None:
            return self.subject.shared_scales.sbar
        return self.subject.mean_first

    def for_subject(self, subject: Subject) -> PaperPosterior:
        """The same prior and centre for other answers or other pairs."""
        return replace(self, subject=subject, centre=self.sbar)

    @property
    def names(self) -> Names:
        """The names of the quantities."""
        return Names(
            natural=natural_names(self.subject.task),
            identified=("offset", "pull", "width", self.subject.task.lapses),
            derived=("pse_shift", "jnd", "gamma", "sigma1", "gain", "width"),
            same_ranks={"pse_shift": "offset", "jnd": "width", "gain": "gamma", "pull": "gamma"},
        )

    def quantities(self, x: FloatArray) -> NamedArrays:
        """Every named quantity, each with the shape of x without its last axis.

        The shift of the point of subjective equality, at the mean first stimulus, is the offset.
        The just noticeable difference is the distance at which 'equal' is half as frequent as at
        its peak, or P(second) 75 % without lapses.
        """
        rows = self.rows
        share_name = self.subject.task.lapses  # q0 or lapse_rate
        mu1 = rows.mu1(x)
        width = np.exp(rows.log_width(x))
        p = rows.pull(x)

        gain = 1.0 - p
        sigma_p = width * gain**rows.power
        offset = p * (mu1 - self.sbar)

        # sigma_p = w (1 - p)^power, sigma_l = sigma_p sqrt(gamma) with gamma = p/(1 - p)^2, and
        # sigma_1 = sigma_p sqrt(G) with G = 1/(1 - p).
        return {
            "mu1": mu1,
            "sigma_p": sigma_p,
            "sigma_l": sigma_p * np.sqrt(p) / gain,
            "gamma": ndtr(x[..., 2]),
            "sigma1": sigma_p / np.sqrt(gain),
            "gain": gain,
            "width": width,
            "offset": offset,
            "pull": p,
            share_name: ndtr(x[..., 3]),
            "jnd": width * _JND_OVER_WIDTH[share_name],
            "pse_shift": offset,
        }

    def points(self, quantities: NamedArrays) -> FloatArray:
        """Points, shape (..., 4), from the natural quantities of shape (...).

        Notes
        -----
        Where sigma_l and sigma_p differ by rounding only, gamma = 1 and its logit is infinite: such
        a point is on the edge, outside the open support. Draws come there, because floats cannot
        distinguish sigmas beyond a logit of 36.
        """
        mu1, sigma_p, sigma_l, share = (
            np.asarray(quantities[name], np.float64) for name in self.names.natural
        )
        rows = self.rows
        ratio = variance_ratio(noise_ratio(sigma_p, sigma_l))  # G
        log_width = np.log(sigma_p) + rows.power * np.log(ratio)
        mean, sd = self.prior.mu1_normal

        with np.errstate(divide="ignore"):  # on the edge, see above
            columns = (  # in the order of the coordinates
                (mu1 - mean) / sd,
                rows.spread_score(log_width, pull=1.0 - 1.0 / ratio),
                probit_of_logit(_logit_gamma(sigma_p, sigma_l)),
                ndtri(share),
            )
        return np.stack(np.broadcast_arrays(*columns), axis=-1)


def _logit_gamma(sigma_p: FloatArray, sigma_l: FloatArray) -> FloatArray:
    """The logit of gamma, ln gamma - ln(1 - gamma), with gamma = (sigma_l/sigma_p)^2.

    1 - gamma = d (1 + sigma_l/sigma_p) with d = 1 - sigma_l/sigma_p. A d from -1e-15 to 0 is a
    rounded 0.
    """
    difference = (sigma_p - sigma_l) / sigma_p  # d
    is_rounding = (difference < 0.0) & (difference >= -1e-15)
    complement = difference * (1.0 + sigma_l / sigma_p)
    log_complement = np.log(np.where(is_rounding, 0.0, complement))
    return 2.0 * (np.log(sigma_l) - np.log(sigma_p)) - log_complement


# --- Without a funnel -----------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Funnel:
    """Coordinates y in which the posterior of H1 has no funnel.

    The answers determine the offset c = p (mu1 - sbar). The smaller the pull p is, the wider is
    the posterior of mu1: a funnel. Given p and the width w, the score u_0 of mu1 is about normal
    with

        s^-2 = 1 + kappa sd^2 p^2 / (w^2 + w_0^2),   mean = (1 - s^2) (sbar + c/p - m) / sd,

    where m and sd are those of the prior of mu1, and the answers give c, kappa and w_0 at the
    highest maximum. A curve that is much steeper than the steps of the stimuli (w below w_0) does
    not determine c better. The coordinates y are those of u, but (u_0 - mean)/s takes the place of
    u_0, and the log width takes the place of a score of sigma_p.

    Attributes
    ----------
    rows : PaperRows
        The answers of one subject, as one row.
    centre : float
        The score at which mu1 is sbar.
    offset : float
        c over the prior standard deviation of mu1.
    log_precision : float
        Log of kappa sd^2.
    log_least_width : float
        Log of w_0.
    depends_on_width : bool
        Whether the formula has the divisor w^2 + w_0^2. It has none if several maxima leave c open.
    """

    rows: PaperRows
    centre: float
    offset: float
    log_precision: float
    log_least_width: float
    depends_on_width: bool

    def mu1_moments(self, u: FloatArray) -> ArrayPair:
        """Mean and log of s of the score of mu1, given the other coordinates at points u.

        Both have the shape (posteriors, points). These are the equations above, in logs.
        """
        log_pull = self.rows.log_pull(u)
        # The precision that the answers add to that of the prior, which is 1.
        log_information = self.log_precision + 2.0 * log_pull
        if self.depends_on_width:  # over w^2 + w_0^2
            log_width = self.rows.log_width(u)
            log_information -= np.logaddexp(2.0 * log_width, 2.0 * self.log_least_width)
        log_sd = -0.5 * np.logaddexp(0.0, log_information)  # s = (1 + information)^(-1/2)
        log_share = log_information + 2.0 * log_sd  # 1 - s^2, the answers' share of the precision

        # c/p in logs, because p may be below the smallest float.
        mean = np.exp(log_share) * self.centre + np.exp(log_share - log_pull) * self.offset
        return mean, log_sd

    def forward(self, u: FloatArray) -> FloatArray:
        """Coordinates y of u, (posteriors, points, 4)."""
        mean, log_sd = self.mu1_moments(u)
        y = u.copy()
        y[..., 0] = (u[..., 0] - mean) * np.exp(-log_sd)
        if self.rows.prior.spread != "width":  # the score of the width is linear in its log
            y[..., 1] = self.rows.log_width(u)
        return y

    def inverse(self, y: FloatArray) -> ArrayPair:
        """Coordinates u of y, and log |dy/du| there, (posteriors, points)."""
        u = y.copy()
        has_log_width = self.rows.prior.spread != "width"  # y[..., 1] is the log width
        if has_log_width:
            u[..., 1] = self.rows.spread_score(y[..., 1], self.rows.pull(y))
        # Mean and s depend only on pull and width, which u has now: u_0 is not yet in use.
        mean, log_sd = self.mu1_moments(u)
        u[..., 0] = mean + y[..., 0] * np.exp(log_sd)
        log_volume = -log_sd
        if has_log_width:
            log_volume += np.log(self.rows.spread_slope(u))
        return u, log_volume


@dataclass(frozen=True, eq=False)
class FunnelArray(PosteriorArray):
    """The posterior of one subject under H1 in the coordinates y of its funnel.

    Densities are with respect to y.
    """

    funnel: Funnel

    def prior_points(self, probability: FloatArray) -> FloatArray:
        """Points y at quantiles of the prior of u, (posteriors, points, 4)."""
        return self.funnel.forward(super().prior_points(probability))

    def densities(self, y: FloatArray) -> ArrayPair:
        """Log prior and log posterior density of y, (posteriors, points) each."""
        u, log_volume = self.funnel.inverse(y)
        log_prior, log_posterior = super().densities(u)
        return log_prior - log_volume, log_posterior - log_volume

    def original(self, y: FloatArray) -> ArrayPair:
        """Points u of the posteriors, and log |dy/du| there."""
        return self.funnel.inverse(y)
