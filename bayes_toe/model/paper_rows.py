"""The paper's model (H1) as rows of counts, in scores of its prior.

    z = ((s2 - s1) + p (s1 - mu1)) / w,   p = 2 gamma / (1 + 2 gamma + (1 + 4 gamma)^(1/2))
    same or different   P(equal) = q0 2^(-z^2),                       w = sigma_p (1 - p)^(-3/2)
    which is stronger   P(second) = lambda/2 + (1 - lambda) Phi(z),   w = sigma_p (1 - p)^(-1)

There are four coordinates u: the score of mu1; the score of the width w or of sigma_p, whichever
has a prior of its own; the probit of gamma; the probit of q0 or of the lapse rate lambda. A score
is that of :mod:`bayes_toe.model.densities`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import expit, log_expit, log_ndtr, ndtr

from bayes_toe.arrays import ArrayPair, FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import Task
from bayes_toe.model.answer_curves import (
    AnswerRows,
    LogAnswers,
    pair_arrays,
    second_answers,
)
from bayes_toe.model.densities import (
    PriorDensity,
    ProbitOfBeta,
    StandardNormal,
    half_normal_score,
    log_half_normal,
    log_half_normal_slope,
    log_normal,
    logit_of_probit,
    logit_rise,
    normal_hazard,
)
from bayes_toe.model.paper_equations import LN2, log_different, pull
from bayes_toe.model.prior import Prior

#: Of G = 1 / (1 - p) in the width sigma_p G^power, by the parameter of the task.
POWERS = {"q0": 1.5, "lapse_rate": 1.0}


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
    n_yes, n_no : ndarray, shape (rows, 1, pairs)
    """

    task: Task
    prior: Prior

    @classmethod
    def from_subject(cls, subject: Subject, prior: Prior) -> PaperRows:
        """The row of a subject."""
        return cls(**pair_arrays([subject], [0.0], [1.0]), task=subject.task, prior=prior)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the parameters that have a coordinate."""
        return self.prior.paper_parameters(self.task)

    @property
    def power(self) -> float:
        """The power of G in the width sigma_p G^power."""
        return POWERS[self.task.lapses]

    @cached_property
    def priors(self) -> tuple[PriorDensity, ...]:
        """The prior of every coordinate."""
        normal = StandardNormal()
        of_gamma = ProbitOfBeta(self.prior.gamma_a, self.prior.gamma_b)
        if self.task.lapses == "q0":
            of_share = ProbitOfBeta(self.prior.q0_a, self.prior.q0_b)
        else:
            of_share = ProbitOfBeta(self.prior.lapse_rate_a, self.prior.lapse_rate_b)
        return normal, normal, of_gamma, of_share

    # --- Quantities ------------------------------------------------------------------------------

    def mu1(self, u: FloatArray) -> FloatArray:
        """Prior mean of the observer, natural-log intensity, (rows, points)."""
        mean, sd = self.prior.mu1_normal
        return mean + sd * u[..., 0]

    def pull(self, u: FloatArray) -> FloatArray:
        """Pull p, (rows, points)."""
        return pull(ndtr(u[..., 2]))

    def _pull_slope(self, u: FloatArray) -> FloatArray:
        """Its derivative in the third coordinate.

        gamma = p/(1 - p)^2, so that d ln gamma / d ln p = (1 + p)/(1 - p).
        """
        p = self.pull(u)
        return p * (1.0 - p) / (1.0 + p) * normal_hazard(-u[..., 2])

    def log_pull(self, u: FloatArray) -> FloatArray:
        """Log of the pull, finite however small gamma is, (rows, points)."""
        gamma = ndtr(u[..., 2])
        log_divisor = np.log(1.0 + 2.0 * gamma + np.sqrt(1.0 + 4.0 * gamma))
        return LN2 + log_ndtr(u[..., 2]) - log_divisor

    def _log_spread_share(self, pull: FloatArray) -> FloatArray:
        """Log of what has a prior, sigma_p or the width, over the width."""
        if self.prior.spread == "width":
            return np.zeros_like(pull)
        return self.power * np.log1p(-pull)

    def log_width(self, u: FloatArray) -> FloatArray:
        """Log of the width w, (rows, points)."""
        score = u[..., 1]
        sd = self.prior.spread_sd
        log_ratio = log_half_normal(score) if sd is None else sd * score
        return np.log(self.prior.spread_scale) + log_ratio - self._log_spread_share(self.pull(u))

    def spread_score(self, log_width: FloatArray, pull: FloatArray) -> FloatArray:
        """The second coordinate, from the log width and the pull."""
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
        """Distance z of the second stimulus from the evolved mean, in w, (rows, points, pairs)."""
        lever = self.first - self.mu1(u)[..., None]
        numerator = self.difference + self.pull(u)[..., None] * lever
        with np.errstate(divide="ignore", over="ignore"):
            # In logs, because 0 over a width below the smallest float is 0.
            log_distance = np.log(np.abs(numerator)) - self.log_width(u)[..., None]
            return np.sign(numerator) * np.exp(log_distance)

    # --- Answers ---------------------------------------------------------------------------------

    def log_answers(self, u: FloatArray) -> LogAnswers:
        """Log probability of both answers to every pair, (rows, points, pairs) each."""
        answers_at, _ = CURVES[self.task.lapses]
        return answers_at(self.distance(u), logit_of_probit(u[..., 3:]))

    def answer_slopes(self, u: FloatArray) -> tuple[LogAnswers, FloatArray, FloatArray]:
        """Log answers, and the slopes of both in every coordinate, (rows, points, 4, pairs).

        The first three coordinates act through z = distance / width, the fourth one through the
        share of lapses or q0.
        """
        z = self.distance(u)
        logit_share = logit_of_probit(u[..., 3:])
        answers_at, slopes_at = CURVES[self.task.lapses]
        answers = answers_at(z, logit_share)
        in_z, in_share = slopes_at(z, logit_share, answers)

        by_spread, by_gamma = self.spread_slope(u), np.zeros(u.shape[:-1])
        if self.prior.spread != "width":
            by_gamma = self.power * self._pull_slope(u) / (1.0 - self.pull(u))
        lever = self.first - self.mu1(u)[..., None]
        slopes = []
        with np.errstate(over="ignore", invalid="ignore"):  # far out, where the density is 0
            inverse_width = np.exp(-self.log_width(u))[..., None]
            z_by_mu1 = -(self.pull(u) * self.prior.mu1_normal[1])[..., None] * inverse_width
            z_by_pull = self._pull_slope(u)[..., None] * lever * inverse_width
            z_slopes = (z_by_mu1, -z * by_spread[..., None], z_by_pull - z * by_gamma[..., None])
            for of_z, of_share in zip(in_z, in_share, strict=True):
                terms = [of_z * z_slope for z_slope in z_slopes]
                terms.append(of_share * logit_rise(u[..., 3:]))
                slopes.append(np.stack(np.broadcast_arrays(*terms), axis=-2))
        yes_slopes, no_slopes = slopes
        return answers, yes_slopes, no_slopes


# --- Curves of both answers ----------------------------------------------------------------------


def bell_answers(z: FloatArray, logit_q0: FloatArray) -> LogAnswers:
    """Log of P(equal) = q0 2^(-z^2) and of its complement. Source: Eq. mod:q."""
    with np.errstate(over="ignore"):  # z^2 beyond the largest float: log P(equal) is -inf
        return LogAnswers(log_expit(logit_q0) - LN2 * np.square(z), log_different(z, logit_q0))


def bell_slopes(
    z: FloatArray, logit_q0: FloatArray, answers: LogAnswers
) -> tuple[ArrayPair, ArrayPair]:
    """Slopes of :func:`bell_answers` in z and in the logit of q0, of both answers each.

    With the odds r = q/(1 - q), those of log(1 - q) are 2 ln2 r z and -r (1 - q0).
    """
    lapse = expit(-logit_q0)
    with np.errstate(over="ignore", invalid="ignore"):
        odds = np.exp(answers.yes - answers.no)
        return (-2.0 * LN2 * z, 2.0 * LN2 * odds * z), (lapse, -odds * lapse)


def guessing_answers(z: FloatArray, logit_rate: FloatArray) -> LogAnswers:
    """Log of P(second) = lambda/2 + (1 - lambda) Phi(z) and of its complement.

    Examples
    --------
    >>> far = guessing_answers(np.array([[-1e9]]), np.array([[np.log(0.2 / 0.8)]]))
    >>> round(float(np.exp(far.yes)[0, 0]), 12)
    0.1
    """
    guessed, attended = _guessing_parts(z, logit_rate)
    yes, no = np.logaddexp(guessed, attended.yes), np.logaddexp(guessed, attended.no)
    # The larger probability is the complement of the smaller one.
    is_rare = yes < no
    other = np.log1p(-np.exp(np.where(is_rare, yes, no)))
    return LogAnswers(np.where(is_rare, yes, other), np.where(is_rare, other, no))


@np.errstate(over="ignore", invalid="ignore")
def guessing_slopes(
    z: FloatArray, logit_rate: FloatArray, answers: LogAnswers
) -> tuple[ArrayPair, ArrayPair]:
    """Slopes of :func:`guessing_answers` in z and in the logit of lambda, of both answers each."""
    log_guessed, log_attended = _guessing_parts(z, logit_rate)
    log_density = log_expit(-logit_rate) + log_normal(z)
    yes_in_z, no_in_z = np.exp(log_density - answers.yes), -np.exp(log_density - answers.no)
    in_rate = []
    for log_part, log_p in zip(log_attended, answers, strict=True):
        guessed, attended = np.exp(log_guessed - log_p), np.exp(log_part - log_p)
        in_rate.append(guessed * expit(-logit_rate) - attended * expit(logit_rate))
    yes_in_rate, no_in_rate = in_rate
    return (yes_in_z, no_in_z), (yes_in_rate, no_in_rate)


def _guessing_parts(z: FloatArray, logit_rate: FloatArray) -> tuple[FloatArray, LogAnswers]:
    """Log probability of either answer by a guess, and of both by the curve."""
    curve = second_answers(z)
    log_attend = log_expit(-logit_rate)
    attended = LogAnswers(log_attend + curve.yes, log_attend + curve.no)
    return log_expit(logit_rate) - LN2, attended


#: The curves of both answers with their slopes, by the parameter of the task.
CURVES = {
    "q0": (bell_answers, bell_slopes),
    "lapse_rate": (guessing_answers, guessing_slopes),
}
