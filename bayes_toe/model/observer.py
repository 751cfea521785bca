"""The observer, who answers any task, and to whom the order of stimuli may matter.

    z = ((s2 - s1) - c + p (s1 - sbar)) / (sigma_d exp(b m)),   m = (s1 + s2)/2 - sbar
    which is stronger   P(second) = lambda/2 + (1 - lambda) Phi(z)
    same or different   P(equal) = lambda (2 Phi(k_m) - 1)
                                   + (1 - lambda) (Phi(k_m - z) - Phi(-k_m - z))
                        k_m = k exp(g m),  q0 = 2 Phi(k) - 1
    three answers       P(equal) as above,
                        P(second) = lambda Phi(-k_m) + (1 - lambda) Phi(z - k_m)

c is the constant error, p the contraction, lambda the lapse rate, sigma_d the noise, and k the
criterion of 'equal'; b and g are the slopes of noise and criterion with intensity. The coordinates
are those of :mod:`bayes_toe.model.parameters`. The four models
(:mod:`bayes_toe.model.models`) have the constant error, the contraction, both or neither.

:class:`ObserverRows` computes the likelihood of many rows of counts at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import erf, ndtr

from bayes_toe.arrays import ArrayPair, FloatArray, NamedArrays, Texts
from bayes_toe.data.conditions import StimulusScales
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import Task
from bayes_toe.model.answer_curves import (
    AnswerRows,
    AnswerSlopes,
    LogAnswers,
    criterion,
    criterion_slope,
    over_scale,
    pair_arrays,
)
from bayes_toe.model.densities import (
    CutNormal,
    LogitOfBeta,
    Priors,
    StandardNormal,
    StandardStudent,
    log_normal_density,
    normal_hazard,
)
from bayes_toe.model.parameters import ObserverPrior, lapse_logs, task_parameters

DEFAULT_PRIOR = ObserverPrior()
#: JND over sigma_d: the z at which 75 % of the answers are 'second'.
JND_OVER_NOISE = 0.6744897501960817


#: Slopes in z, in ln k (None in 'which is stronger') and in the lapse rate, for each pair.
Slopes = tuple[FloatArray, FloatArray | None, FloatArray]


class Curve(NamedTuple):
    """The parameters at points, and the numbers that follow for every pair.

    The shape is (rows, points, pairs), unless a comment gives another shape.
    """

    values: NamedArrays  # the quantities, and the criterion at the middle, (rows, points) each
    log_lapse: FloatArray  # log of the lapse rate, (rows, points, 1)
    log_attend: FloatArray  # log of 1 minus the lapse rate, (rows, points, 1)
    log_scale: FloatArray  # log of the noise
    z: FloatArray  # the distance
    k: FloatArray | None  # the criterion k_m; None in 'which is stronger'


@dataclass(frozen=True, eq=False)
class ObserverRows(AnswerRows):
    """Counts of one or several subjects of a task, with all k coordinates of the task.

    Attributes
    ----------
    first, difference, middle : ndarray, shape (rows, 1, pairs)
        s1 - sbar, s2 - s1 and (s1 + s2)/2 - sbar, in units of D.
    counts : ndarray, shape (rows, answers, 1, pairs)
    slope_unit : ndarray, shape (rows, 1)
        D / R.
    contraction_sd : ndarray, shape (rows, 1)
        Standard deviation of the prior of p: smaller where first stimuli are roved.
    """

    task: Task
    prior: ObserverPrior
    slope_unit: FloatArray
    contraction_sd: FloatArray
    row_numbers = ("slope_unit", "contraction_sd")

    @classmethod
    def from_subjects(
        cls,
        subjects: Sequence[Subject],
        prior: ObserverPrior = DEFAULT_PRIOR,
        scales: Sequence[StimulusScales] | None = None,
    ) -> ObserverRows:
        """A row for each subject. All subjects have one task.

        Without `scales`, each subject has the scales of its own stimuli.
        """
        if scales is None:
            scales = [subject.scales for subject in subjects]
        pairs = pair_arrays(
            subjects,
            [row_scales.sbar for row_scales in scales],
            [row_scales.step for row_scales in scales],
            [subject.counts for subject in subjects],
        )
        return cls(
            **pairs,
            task=subjects[0].task,
            prior=prior,
            slope_unit=np.array([[row_scales.step / row_scales.spread] for row_scales in scales]),
            contraction_sd=np.array(
                [[prior.contraction_sd * row_scales.roving_share] for row_scales in scales]
            ),
        )

    @property
    def coordinates(self) -> Texts:
        """Names of the k coordinates: 7 in tasks with 'equal', 5 in 'which is stronger'."""
        return tuple(parameter.name for parameter in task_parameters(self.task))

    # --- Quantities in units of D ----------------------------------------------------------------

    @cached_property
    def units(self) -> dict[str, FloatArray | float]:
        """The factor from each coordinate to its quantity, in the order of the coordinates."""
        prior = self.prior
        units: dict[str, FloatArray | float] = {
            "log_noise": prior.noise_sd,
            "logit_q0": 1.0,
            "lapse_score": 1.0,
            "noise_slope": prior.noise_slope_scale * self.slope_unit,
            "criterion_slope": prior.criterion_slope_scale * self.slope_unit,
            "constant_error": prior.constant_error_scale,
            "contraction": self.contraction_sd,
        }
        if not self.task.has_criterion:
            del units["logit_q0"], units["criterion_slope"]
        return units

    def quantities(self, u: FloatArray) -> NamedArrays:
        """The parameters at points, stimuli in units of D, shape (rows, points) each."""
        values = {name: unit * u[..., j] for j, (name, unit) in enumerate(self.units.items())}
        values["log_noise"] += np.log(self.prior.noise_median)  # u = 0 is the median noise
        return values

    def curve_at(self, u: FloatArray) -> Curve:
        """The curve of every point, by the formulas of the module."""
        values = self.quantities(u)
        # An axis for the pairs: (rows, points) becomes (rows, points, 1).
        slope = values["noise_slope"][..., None]
        log_scale = values["log_noise"][..., None] + slope * self.middle
        contraction = values["contraction"][..., None] * self.first_from_centre(values)
        shift = contraction - values["constant_error"][..., None]
        z = over_scale(self.difference + shift, log_scale)

        if self.task.has_criterion:
            values["criterion"] = criterion(values["logit_q0"])
            log_k = np.log(values["criterion"])[..., None]
            with np.errstate(over="ignore"):  # k may be infinite: every answer is 'equal'
                k = np.exp(log_k + values["criterion_slope"][..., None] * self.middle)
        else:
            k = None

        logs = lapse_logs(values["lapse_score"], self.prior.lapse_rate_b)
        log_lapse, log_attend = (log_share[..., None] for log_share in logs)
        return Curve(values, log_lapse, log_attend, log_scale, z, k)

    def first_from_centre(self, values: NamedArrays) -> FloatArray:
        """The first stimulus less the centre of the contraction, here sbar, in units of D."""
        return self.first

    # --- Likelihood ------------------------------------------------------------------------------

    @np.errstate(over="ignore", divide="ignore", invalid="ignore")  # far out, and the log of 0
    def log_answers(self, u: FloatArray) -> LogAnswers:
        """Log probability of each answer to every pair, (rows, points, pairs) each."""
        return list(map(np.log, self.answers_at(self.curve_at(u))))

    def answers_at(self, curve: Curve) -> tuple[FloatArray, ...]:
        """Probability of each answer on a curve, (rows, points, pairs) each.

        The counted answer comes first. Three answers are 'equal', 'second' and 'first'.
        Each is lambda P(answer at z = 0) + (1 - lambda) P(answer at z), lambda the lapse rate.
        """
        lapse, attend = np.exp(curve.log_lapse), np.exp(curve.log_attend)
        z = curve.z
        k = curve.k
        if k is None:
            return 0.5 * lapse + attend * ndtr(z), 0.5 * lapse + attend * ndtr(-z)
        p_inside, p_near_tail, p_far_tail = _window_and_tails(z, k)
        # At z = 0, P(equal) is 2 Phi(k) - 1 = erf(k / 2^(1/2)).
        equal = lapse * erf(k * np.sqrt(0.5)) + attend * p_inside
        if not self.task.has_three_answers:
            return equal, lapse * 2.0 * ndtr(-k) + attend * (p_near_tail + p_far_tail)
        guessed = lapse * ndtr(-k)
        # The answer that names the stronger stimulus, then that which names the weaker stimulus.
        expected = guessed + attend * p_near_tail
        opposite = guessed + attend * p_far_tail
        second_is_expected = z > 0.0
        second = np.where(second_is_expected, expected, opposite)
        first = np.where(second_is_expected, opposite, expected)
        return equal, second, first

    @np.errstate(over="ignore", divide="ignore", invalid="ignore")
    def gradient(self, u: FloatArray) -> ArrayPair:
        """Log likelihood and its gradient, (rows, points[, k]).

        The answers to a pair depend only on z, on ln k and on the lapse rate. Slopes in these are
        summed over the answers to a pair, and slopes in the coordinates follow from the sums. Where
        an answer that was given has a probability of 0, the slopes are not finite.
        """
        curve = self.curve_at(u)
        probabilities = self.answers_at(curve)
        # The slope n / P of n ln P in P, for each answer; 0 for an answer that was never given.
        slopes_by_answer = []
        for counts, probability in zip(self.counts_by_answer, probabilities, strict=True):
            zeros = np.zeros(probability.shape)
            slopes_by_answer.append(np.divide(counts, probability, out=zeros, where=counts > 0.0))
        terms = self._slope_terms(curve, self._pair_slopes(curve, probabilities, slopes_by_answer))
        sums = [term.sum(axis=-1) for term in terms]
        gradient = np.stack(sums, axis=-1) * self._slope_units(curve.values)
        log_likelihood = self.terms(list(map(np.log, probabilities))).sum(axis=-1)
        return log_likelihood, gradient

    @np.errstate(over="ignore", divide="ignore", invalid="ignore")
    def answer_slopes(self, u: FloatArray) -> AnswerSlopes:
        """Log probability of each answer, and its slopes in every coordinate.

        The slopes have the shape (rows, points, k, pairs).
        """
        curve = self.curve_at(u)
        probabilities = self.answers_at(curve)
        units = self._slope_units(curve.values)[..., None]
        slopes = []
        for i, probability in enumerate(probabilities):
            # ln P is the log likelihood of this answer, given once.
            slopes_by_answer = [np.zeros(1)] * len(probabilities)
            slopes_by_answer[i] = 1.0 / probability
            terms = self._slope_terms(
                curve, self._pair_slopes(curve, probabilities, slopes_by_answer)
            )
            slopes.append(np.stack(np.broadcast_arrays(*terms), axis=-2) * units)
        return list(map(np.log, probabilities)), slopes

    def _pair_slopes(
        self,
        curve: Curve,
        probabilities: Sequence[FloatArray],
        slopes_by_answer: Sequence[FloatArray],
    ) -> Slopes:
        """Slopes of the log likelihood of each pair, from its slope in the P of each answer.

        P = lambda blind + (1 - lambda) attending has the slope (blind - P)/(1 - lambda) in the
        lapse rate lambda. The slope that is returned is blind - P, because 1/(1 - lambda) cancels
        the first factor of d lambda/du = (1 - lambda) phi(u) / (b (1 - Phi(u))), see
        :meth:`_slope_units`.
        """
        lapse, attend = np.exp(curve.log_lapse), np.exp(curve.log_attend)
        z = curve.z
        k = curve.k
        if k is not None and self.task.has_three_answers:
            equal, second, first = probabilities
            by_equal, by_second, by_first = slopes_by_answer
            # P(second) has Phi(z - k), P(first) has Phi(-z - k), and the rest is 'equal'. So each
            # criterion, k or -k, separates two answers: what one gains, the other loses.
            upper = attend * _density(z - k) * (by_second - by_equal)
            lower = attend * _density(z + k) * (by_first - by_equal)
            lapse_term = lapse * _density(k) * (by_second + by_first - 2.0 * by_equal)
            in_lapse_rate = (
                by_equal * (erf(k * np.sqrt(0.5)) - equal)
                + by_second * (ndtr(-k) - second)
                + by_first * (ndtr(-k) - first)
            )
            return upper - lower, -k * (upper + lower + lapse_term), in_lapse_rate

        # There are two answers: what P of one answer gains, P of the other answer loses.
        by_counted, by_other = slopes_by_answer
        by_yes = by_counted - by_other
        p_yes, _ = probabilities
        if k is None:  # P(second) has Phi(z), and is 1/2 in a lapse
            return attend * by_yes * _density(z), None, by_yes * (0.5 - p_yes)
        # P(equal) has Phi(k - z) - Phi(-k - z), with the slopes phi(k + z) - phi(k - z) in z and
        # phi(k - z) + phi(k + z) in k. The near edge has phi(|z| - k), and the far edge
        # phi(|z| + k) = phi(|z| - k) exp(-2 |z| k). In a lapse P(equal) is 2 Phi(k) - 1.
        edge = attend * by_yes * _density(np.abs(z) - k)
        far_ratio = np.exp(-2.0 * np.abs(z) * k)
        in_z = edge * np.sign(z) * np.expm1(-2.0 * np.abs(z) * k)
        in_k = edge * (1.0 + far_ratio) + 2.0 * lapse * by_yes * _density(k)
        return in_z, in_k * k, by_yes * (erf(k * np.sqrt(0.5)) - p_yes)

    def _slope_terms(self, curve: Curve, slopes: Slopes) -> list[FloatArray]:
        """Slopes of each pair in every quantity, in the order of the coordinates.

        These slopes follow from `slopes` by the chain rule, where z is
        ((s2 - s1) - c + p (s1 - sbar)) / scale.
        """
        in_z, in_log_k, in_lapse = slopes
        in_log_scale = -in_z * curve.z
        in_noise_slope = in_log_scale * self.middle
        in_shift = in_z * np.exp(-curve.log_scale)
        if in_log_k is None:
            terms = [in_log_scale, in_lapse, in_noise_slope]
        else:
            in_criterion_slope = in_log_k * self.middle
            terms = [in_log_scale, in_log_k, in_lapse, in_noise_slope, in_criterion_slope]
        # The last two are the slopes in c and in p: the shift is p (s1 - sbar) - c.
        return [*terms, -in_shift, in_shift * self.first]

    def _slope_units(self, values: NamedArrays) -> FloatArray:
        """The derivative of a quantity in each coordinate, (rows, points, coordinates).

        It is the constant in :attr:`units`, in that order, except for the lapse rate lambda and q0.
        The slope of lambda is divided by 1 - lambda.
        """
        # phi(u) / (b (1 - Phi(u))): d lambda/du over 1 - lambda, which `_pair_slopes` leaves out.
        lapse_rise = normal_hazard(values["lapse_score"]) / self.prior.lapse_rate_b
        slopes = self.units | {"lapse_score": lapse_rise}
        if self.task.has_criterion:
            k = values["criterion"]
            # d ln k/du = (dk/du) / k, because the slopes of the answers are in ln k.
            slopes["logit_q0"] = criterion_slope(values["logit_q0"], k) / k
        columns = [np.atleast_2d(slope) for slope in slopes.values()]
        return np.stack(np.broadcast_arrays(*columns), axis=-1)

    # --- Prior -----------------------------------------------------------------------------------

    @cached_property
    def priors(self) -> Priors:
        """The prior of every coordinate."""
        normal = StandardNormal()
        student = StandardStudent()
        contraction = CutNormal(1.0 / self.contraction_sd)
        if not self.task.has_criterion:
            return normal, normal, student, student, contraction
        peak = LogitOfBeta(self.prior.q0_a, self.prior.q0_b)
        return normal, peak, normal, student, student, student, contraction


def _window_and_tails(z: FloatArray, k: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """P that the noisy distance lies from -k to k, beyond the nearer end, and beyond the other end.

    Each P has the shape of z and k, (rows, points, pairs). The nearer end is on the side of z.
    """
    distance = np.abs(z)
    with np.errstate(invalid="ignore"):  # `distance` and k may both be infinite
        near_end = k - distance
    near_end[np.isnan(near_end)] = 0.0
    far_end = -k - distance
    inside = ndtr(near_end) - ndtr(far_end)
    # Rounding could turn this difference negative if the window from -k to k is narrow. There it is
    # the width times the density in the middle, from which the mean density of the window differs
    # by a share of k^2 (z^2 - 1) / 6.
    is_narrow = k < 1e-6
    if is_narrow.any():
        inside = np.where(is_narrow, 2.0 * k * _density(distance), inside)
    return inside, ndtr(-near_end), ndtr(far_end)


def _density(x: FloatArray) -> FloatArray:
    """Standard normal density."""
    return np.exp(log_normal_density(x))
