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

from collections import defaultdict
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


#: Slopes in what the answers to a pair depend on, (rows, points, pairs) each: in "z", the distance;
#: in "log_k", the log of the criterion k_m, but not in 'which is stronger'; and in "log_attend",
#: ln(1 - lambda), lambda the lapse rate.
Slopes = NamedArrays


class Curve(NamedTuple):
    """The parameters at points, and the numbers that follow for every pair.

    The shape is (rows, points, pairs), unless a comment gives another shape.
    """

    values: NamedArrays  # the quantities, and the criterion k as "criterion", (rows, points) each
    lapse: FloatArray  # the lapse rate lambda, (rows, points, 1)
    attend: FloatArray  # 1 - lambda, (rows, points, 1)
    log_scale: FloatArray  # log of the noise at the pair, ln sigma_d + b m
    z: FloatArray  # the distance
    k: FloatArray | None  # the criterion at the pair, k_m; None in 'which is stronger'


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
            # Priors of slopes are for one spread of the stimuli, and rows count stimuli in steps.
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
        """The factor from each coordinate u to its quantity, by the name of the quantity.

        The order is that of the coordinates. The quantities are in units of D: c/D, b D, and so on.
        """
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
        """The quantities of :attr:`units` at points u, (rows, points, k) -> (rows, points) each."""
        values = {name: unit * u[..., j] for j, (name, unit) in enumerate(self.units.items())}
        values["log_noise"] += np.log(self.prior.noise_median)  # u = 0 is the median noise
        return values

    def curve_at(self, u: FloatArray) -> Curve:
        """The curve of every point u, (rows, points, k), by the formulas of the module."""
        values = self.quantities(u)
        # `[..., None]` is an axis for the pairs: (rows, points) becomes (rows, points, 1).
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
        lapse, attend = (np.exp(log_share)[..., None] for log_share in logs)
        return Curve(values, lapse, attend, log_scale, z, k)

    def first_from_centre(self, values: NamedArrays) -> FloatArray:
        """The first stimulus less the centre of the contraction, which is sbar here.

        In units of D, (rows, 1, pairs). With carry-over the centre depends on `values`.
        """
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
        _, lapse, attend, _, z, k = curve
        if k is None:
            return 0.5 * lapse + attend * ndtr(z), 0.5 * lapse + attend * ndtr(-z)
        p_inside, p_near_tail, p_far_tail = _window_and_tails(z, k)
        # At z = 0, P(equal) is 2 Phi(k) - 1 = erf(k / 2^(1/2)).
        equal = lapse * erf(k * np.sqrt(0.5)) + attend * p_inside
        if not self.task.has_three_answers:
            return equal, lapse * 2.0 * ndtr(-k) + attend * (p_near_tail + p_far_tail)
        guessed = lapse * ndtr(-k)
        # The answer that the sign of z makes more probable, and the other one.
        expected = guessed + attend * p_near_tail
        opposite = guessed + attend * p_far_tail
        second_is_expected = z > 0.0
        second = np.where(second_is_expected, expected, opposite)
        first = np.where(second_is_expected, opposite, expected)
        return equal, second, first

    # --- Slopes ----------------------------------------------------------------------------------

    @np.errstate(over="ignore", divide="ignore", invalid="ignore")
    def gradient(self, u: FloatArray) -> ArrayPair:
        """Log likelihood and its gradient in the coordinates, (rows, points[, k]).

        Where an answer that was given has a probability of 0, the slopes are not finite.
        """
        curve = self.curve_at(u)
        probabilities = self.answers_at(curve)
        log_likelihood = self.terms(list(map(np.log, probabilities))).sum(axis=-1)

        # Slopes of the log likelihood of each pair: the sum over answers of (n / P) dP.
        pair_slopes: Slopes = defaultdict(lambda: np.zeros(1))
        slopes_of_answers = self._probability_slopes(curve, probabilities)
        for counts, p, slopes in zip(
            self.counts_by_answer, probabilities, slopes_of_answers, strict=True
        ):
            # An answer that was never given adds 0, also where its P is 0.
            ratio = np.divide(counts, p, out=np.zeros(p.shape), where=counts > 0.0)
            for name, slope in slopes.items():
                pair_slopes[name] = pair_slopes[name] + ratio * slope

        by_quantity = self._quantity_slopes(curve, pair_slopes)
        units = self._slope_units(curve.values).items()
        columns = [by_quantity[name].sum(axis=-1) * unit for name, unit in units]  # over pairs
        return log_likelihood, np.stack(columns, axis=-1)

    @np.errstate(over="ignore", divide="ignore", invalid="ignore")
    def answer_slopes(self, u: FloatArray) -> AnswerSlopes:
        """Log probability of each answer, and its slopes in the coordinates.

        The slopes have the shape (rows, points, k, pairs).
        """
        curve = self.curve_at(u)
        probabilities = self.answers_at(curve)
        slopes_of_answers = self._probability_slopes(curve, probabilities)
        units = self._slope_units(curve.values).items()
        log_slopes = []
        for p, slopes in zip(probabilities, slopes_of_answers, strict=True):
            by_quantity = self._quantity_slopes(curve, slopes)
            # Units get an axis for the pairs. The slope of ln P is that of P over P.
            columns = [by_quantity[name] * np.asarray(unit)[..., None] / p for name, unit in units]
            log_slopes.append(np.stack(columns, axis=-2))
        return list(map(np.log, probabilities)), log_slopes

    def _probability_slopes(
        self, curve: Curve, probabilities: Sequence[FloatArray]
    ) -> list[Slopes]:
        """Slopes of the probability of each answer, in the order of `answers_at`.

        P = lambda P(answer at z = 0) + (1 - lambda) P(answer at z) has in ln(1 - lambda) the slope
        P - P(answer at z = 0).
        """
        _, lapse, attend, _, z, k = curve
        if k is None:  # P(second) is lambda/2 + (1 - lambda) Phi(z), and P(first) is the rest
            second = {"z": attend * _density(z), "log_attend": probabilities[0] - 0.5}
            return [second, _negative(second)]

        # P(equal) has Phi(k - z) - Phi(-k - z), with the slopes phi(k + z) - phi(k - z) in z and
        # phi(k - z) + phi(k + z) in k. Of these densities at the edges of the window, the edge
        # near z has phi(|z| - k), and the far edge has phi(|z| + k) = phi(|z| - k) exp(-2 |z| k).
        # In a lapse P(equal) is 2 Phi(k) - 1.
        distance = np.abs(z)
        near_edge = attend * _density(distance - k)
        far_less_near = near_edge * np.expm1(-2.0 * distance * k)
        lapse_edge = lapse * _density(k)
        equal = {
            "z": np.sign(z) * far_less_near,
            "log_k": k * (2.0 * near_edge + far_less_near + 2.0 * lapse_edge),
            "log_attend": probabilities[0] - erf(k * np.sqrt(0.5)),
        }
        if not self.task.has_three_answers:
            return [equal, _negative(equal)]

        # P(second) has Phi(z - k), and P(first) has Phi(-z - k). In a lapse each is Phi(-k).
        slopes = [equal]
        for sign, p in zip((1.0, -1.0), probabilities[1:], strict=True):
            edge = attend * _density(sign * z - k)
            slopes.append(
                {"z": sign * edge, "log_k": -k * (edge + lapse_edge), "log_attend": p - ndtr(-k)}
            )
        return slopes

    def _quantity_slopes(self, curve: Curve, slopes: Slopes) -> NamedArrays:
        """Slopes in the quantities of :attr:`units`, (rows, points, pairs) each, by the chain rule.

        z = ((s2 - s1) - c + p (s1 - sbar)) / scale with ln scale = ln sigma_d + b m, and
        ln k_m = ln k + g m. The slopes of 'logit_q0' and 'lapse_score' are in ln k and in
        ln(1 - lambda).
        """
        in_log_scale = -slopes["z"] * curve.z
        in_shift = slopes["z"] * np.exp(-curve.log_scale)
        by_quantity = {
            "log_noise": in_log_scale,
            "lapse_score": slopes["log_attend"],
            "noise_slope": in_log_scale * self.middle,
            "constant_error": -in_shift,
            "contraction": in_shift * self.first,
        }
        if self.task.has_criterion:
            by_quantity["logit_q0"] = slopes["log_k"]
            by_quantity["criterion_slope"] = slopes["log_k"] * self.middle
        return by_quantity

    def _slope_units(self, values: NamedArrays) -> dict[str, FloatArray | float]:
        """The slope of each quantity of `_quantity_slopes` in its coordinate u.

        That of ln(1 - lambda) = ln Phi(-u) / b is -phi(u) / (b Phi(-u)), and that of ln k is
        (dk/du) / k. The others are constant, see :attr:`units`.
        """
        lapse_slope = -normal_hazard(values["lapse_score"]) / self.prior.lapse_rate_b
        slopes = self.units | {"lapse_score": lapse_slope}
        if self.task.has_criterion:
            k = values["criterion"]
            slopes["logit_q0"] = criterion_slope(values["logit_q0"], k) / k
        return slopes

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


def _negative(slopes: Slopes) -> Slopes:
    """The slopes of 1 - P from those of P."""
    return {name: -slope for name, slope in slopes.items()}


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
