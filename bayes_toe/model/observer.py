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

:class:`ObserverRows` computes the likelihood of many rows of counts at once. Three answers are two
questions with two answers each: was it 'equal'; and if not, was it 'second'? Their product is
exactly the trinomial. So P(equal) is that of 'same or different'.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter

import numpy as np
from scipy.special import erf, log_ndtr, ndtr, xlogy

from bayes_toe.arrays import ArrayPair, FloatArray, NamedArrays, Texts
from bayes_toe.data.conditions import StimulusScales
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import Task
from bayes_toe.model.answer_curves import (
    AnswerRows,
    LogAnswers,
    criterion,
    criterion_slope,
    direction_answers,
    equal_answers,
    near_edge,
    pair_arrays,
    second_answers,
    unequal_logs,
)
from bayes_toe.model.densities import (
    CutNormal,
    LogitOfBeta,
    PriorDensity,
    StandardNormal,
    StandardStudent,
    log_normal,
)
from bayes_toe.model.paper_equations import LN2
from bayes_toe.model.parameters import ObserverPrior, lapse_logs, task_parameters

DEFAULT_PRIOR = ObserverPrior()
#: JND over sigma_d: the z at which 75 % of the answers are 'second'.
JND_OVER_NOISE = 0.6744897501960817
#: Responses of an observer who ignores the stimuli and is asked which one is stronger.
_GUESS = LogAnswers(np.array(-LN2), np.array(-LN2))


@dataclass(frozen=True, eq=False)
class ObserverRows(AnswerRows):
    """Counts of one or several subjects of a task, with all k coordinates of the task.

    Attributes
    ----------
    first, difference, middle : ndarray, shape (rows, 1, pairs)
        s1 - sbar, s2 - s1 and (s1 + s2)/2 - sbar, in units of D.
    n_yes, n_no : ndarray, shape (rows, 1, pairs), of three answers (rows, 1, 2 pairs)
    slope_unit : ndarray, shape (rows, 1)
        D / R.
    contraction_sd : ndarray, shape (rows, 1)
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
        """A row for each subject; all of one task. `scales` default to the subjects' own."""
        if scales is None:
            scales = [subject.scales for subject in subjects]
        numbers = map(attrgetter("sbar", "step", "spread", "roving_share"), scales)
        sbar, step, spread, roving_share = np.array([*numbers]).T
        pairs = pair_arrays(subjects, sbar.tolist(), step.tolist())
        task = subjects[0].task
        if task.has_three_answers:
            directions = np.zeros((2, *pairs["first"].shape))
            for i, subject in enumerate(subjects):
                directions[:, i, 0, : subject.n_pairs] = subject.n_second, subject.n_first
            for name, counts in zip(("n_yes", "n_no"), directions, strict=True):
                pairs[name] = np.concatenate([pairs[name], counts], axis=-1)
        return cls(
            **pairs,
            task=task,
            prior=prior,
            slope_unit=(step / spread)[:, None],
            contraction_sd=prior.contraction_sd * roving_share[:, None],
        )

    @property
    def coordinates(self) -> Texts:
        """Names of the k coordinates: 7 with 'equal', 5 of which is stronger."""
        return tuple(parameter.name for parameter in task_parameters(self.task))

    # --- Quantities in units of D ----------------------------------------------------------------

    @cached_property
    def units(self) -> dict[str, FloatArray | float]:
        """By how much each quantity rises with its coordinate, in the order of the coordinates."""
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
        values["log_noise"] += np.log(self.prior.noise_median)
        return values

    def curve_at(self, u: FloatArray) -> tuple[NamedArrays, FloatArray, FloatArray | None]:
        """The quantities at points, with the distance and the criterion of every pair."""
        values = self.quantities(u)
        return values, self.distance_at(values), self.criterion_at(values)

    def distance_at(self, values: NamedArrays) -> FloatArray:
        """The distance z of every pair, (rows, points, pairs)."""
        lever = self.lever_at(values)
        shift = values["contraction"][..., None] * lever - values["constant_error"][..., None]
        numerator = self.difference + shift
        log_scale = self._log_scale_at(values)
        with np.errstate(divide="ignore", over="ignore"):
            # In logs, because 0 over a scale beyond the smallest float is 0.
            return np.sign(numerator) * np.exp(np.log(np.abs(numerator)) - log_scale)

    def lever_at(self, values: NamedArrays) -> FloatArray:
        """The first stimulus from the centre of the contraction, in D: here from sbar."""
        return self.first

    def _log_scale_at(self, values: NamedArrays) -> FloatArray:
        """Log of the noise at every pair, (rows, points, pairs)."""
        return values["log_noise"][..., None] + values["noise_slope"][..., None] * self.middle

    def criterion_at(self, values: NamedArrays) -> FloatArray | None:
        """The criterion k_m of every pair, (rows, points, pairs); None of which is stronger."""
        if not self.task.has_criterion:
            return None
        log_k = np.log(criterion(values["logit_q0"]))[..., None]
        with np.errstate(over="ignore"):
            return np.exp(log_k + values["criterion_slope"][..., None] * self.middle)

    # --- Likelihood ------------------------------------------------------------------------------

    def log_answers(self, u: FloatArray) -> LogAnswers:
        """Log probability of both answers to every pair, (rows, points, pairs) each.

        Of three answers, those of the second question follow: (rows, points, 2 pairs).
        """
        values, z, k = self.curve_at(u)
        answers = self._answers_at(values, z, k)
        if k is None or not self.task.has_three_answers:
            return answers
        return _joined(answers, direction_answers(z, k, self._lapse_logs(values)))

    def _answers_at(self, values: NamedArrays, z: FloatArray, k: FloatArray | None) -> LogAnswers:
        """Log probability of both answers at distances and criteria, with lapses."""
        if k is None:
            attending, blind = second_answers(z), _GUESS
        else:
            attending, blind = equal_answers(z, k), equal_answers(np.zeros(1), k)
        log_lapse, log_attend = self._lapse_logs(values)
        yes = np.logaddexp(log_lapse + blind.yes, log_attend + attending.yes)
        no = np.logaddexp(log_lapse + blind.no, log_attend + attending.no)
        return LogAnswers(yes, no)

    def _lapse_logs(self, values: NamedArrays) -> ArrayPair:
        """Log of the lapse rate and of its complement, (rows, points, 1) each."""
        log_lapse, log_attend = lapse_logs(values["lapse_score"], self.prior.lapse_rate_b)
        return log_lapse[..., None], log_attend[..., None]

    def plain_log_likelihood(self, u: FloatArray) -> FloatArray:
        """:meth:`log_likelihood` by plain probabilities, at a third of its cost.

        Each answer has a sum of positive terms of its own. Both forms agree to 1e-12 within 200
        nats of the best point; far from there this one may be -inf.
        """
        return self._multinomial(self.plain_answers_at(*self.curve_at(u)))

    @property
    def _answer_counts(self) -> tuple[FloatArray, ...]:
        """How often each answer was given: of three answers 'equal', 'second' and 'first'."""
        if not self.task.has_three_answers:
            return self.n_yes, self.n_no
        n_equal, n_second = np.split(self.n_yes, 2, axis=-1)
        return n_equal, n_second, self.n_no[..., n_equal.shape[-1] :]

    def _multinomial(self, probabilities: Sequence[FloatArray]) -> FloatArray:
        """Log likelihood, (rows, points), from the probabilities of the answers."""
        return np.asarray(sum(map(xlogy, self._answer_counts, probabilities))).sum(axis=-1)

    def plain_answers_at(
        self, values: NamedArrays, z: FloatArray, k: FloatArray | None
    ) -> tuple[FloatArray, ...]:
        """Probability of each answer at distances and criteria, (rows, points, pairs) each.

        Two answers are the counted one and the other one; three are 'equal', 'second' and 'first'.
        """
        lapse, attend = map(np.exp, self._lapse_logs(values))
        if k is None:
            return 0.5 * lapse + attend * ndtr(z), 0.5 * lapse + attend * ndtr(-z)
        inside, near, far = _window_and_tails(z, k)
        equal = lapse * erf(k * np.sqrt(0.5)) + attend * inside
        if not self.task.has_three_answers:
            return equal, lapse * 2.0 * ndtr(-k) + attend * (near + far)
        guessed = lapse * ndtr(-k)
        near, far = guessed + attend * near, guessed + attend * far
        is_second_near = z > 0.0
        return equal, np.where(is_second_near, near, far), np.where(is_second_near, far, near)

    @np.errstate(over="ignore", divide="ignore", invalid="ignore")
    def plain_gradient(self, u: FloatArray) -> ArrayPair:
        """Log likelihood and its gradient, (rows, points[, k]), by plain probabilities.

        Both answers to a pair depend on z, on ln k and on the lapse rate alone. The slopes in
        these are summed over the answers first, and follow the coordinates after that. Where an
        answer that was given has a probability of 0, the slopes are not finite.
        """
        values, z, k = self.curve_at(u)
        probabilities = self.plain_answers_at(values, z, k)
        terms = self._slope_terms(values, z, *self._plain_slopes(values, z, k, probabilities))

        lapse_rise = np.exp(_log_hazard(values["lapse_score"])) / self.prior.lapse_rate_b
        sums = [term.sum(axis=-1) for term in terms]
        slope = np.stack(sums, axis=-1) * self._slope_units(values, lapse_rise)
        return self._multinomial(probabilities), slope

    def _plain_slopes(
        self,
        values: NamedArrays,
        z: FloatArray,
        k: FloatArray | None,
        probabilities: Sequence[FloatArray],
    ) -> tuple[FloatArray, FloatArray | None, FloatArray]:
        """Slopes of the log likelihood of each pair in z, in ln k and in the lapse rate.

        P = lambda blind + (1 - lambda) attending, so that (1 - lambda) dP/dlambda = blind - P; and
        d lambda/du = phi(u) (1 - lambda) / (b (1 - Phi(u))).
        """
        lapse, attend = map(np.exp, self._lapse_logs(values))
        by_yes, *by_alternatives = map(_per_answer, self._answer_counts, probabilities)
        if k is not None and self.task.has_three_answers:
            equal, second, first = probabilities
            by_second, by_first = by_alternatives
            # A criterion that moves takes from one answer what it gives to the other.
            upper = attend * _density(z - k) * (by_second - by_yes)
            lower = attend * _density(z + k) * (by_first - by_yes)
            blind = lapse * _density(k) * (by_second + by_first - 2.0 * by_yes)
            in_lapse = (
                by_yes * (erf(k * np.sqrt(0.5)) - equal)
                + by_second * (ndtr(-k) - second)
                + by_first * (ndtr(-k) - first)
            )
            return upper - lower, -k * (upper + lower + blind), in_lapse

        # What is added to P is taken from the probability of the other answer.
        by_yes = by_yes - by_alternatives[0]
        if k is None:
            return attend * by_yes * _density(z), None, by_yes * (0.5 - probabilities[0])
        edge = attend * by_yes * _density(np.abs(z) - k)
        far_share = np.exp(-2.0 * np.abs(z) * k)
        in_z = edge * np.sign(z) * np.expm1(-2.0 * np.abs(z) * k)
        in_k = edge * (1.0 + far_share) + 2.0 * lapse * by_yes * _density(k)
        return in_z, in_k * k, by_yes * (erf(k * np.sqrt(0.5)) - probabilities[0])

    @np.errstate(over="ignore", invalid="ignore")
    def answer_slopes(self, u: FloatArray) -> tuple[LogAnswers, FloatArray, FloatArray]:
        """Log answers, and the slopes of both in every coordinate, (rows, points, k, pairs).

        Of three answers, those of the second question follow, as in :meth:`log_answers`.
        """
        values, z, k = self.curve_at(u)
        log_lapse, log_attend = self._lapse_logs(values)
        answers = self._answers_at(values, z, k)
        # d lambda/du = phi(u) (1 - lambda) / (b (1 - Phi(u)))
        log_rise = (_log_hazard(values["lapse_score"]) - np.log(self.prior.lapse_rate_b))[..., None]
        if k is None:
            near, blind, rise_in_z = z, _GUESS, np.ones(1)
        else:
            distance = np.abs(z)
            near, blind = near_edge(distance, k), equal_answers(np.zeros(1), k)
            rise_in_z = np.sign(z) * np.expm1(-2.0 * distance * k)
            rise_in_k = 1.0 + np.exp(-2.0 * distance * k)
        units = self._slope_units(values, np.ones(1))[..., None]
        in_log_k = None
        slopes = []
        for log_p, log_blind, sign in zip(answers, blind, (1.0, -1.0), strict=True):
            # The density at the near edge over P, with the sign of the answer.
            edge = sign * np.exp(log_attend + log_normal(near) - log_p)
            if k is not None:
                blind_edge = sign * 2.0 * np.exp(log_lapse + log_normal(k) - log_p)
                in_log_k = (edge * rise_in_k + blind_edge) * k
            in_lapse = np.exp(log_rise + log_blind - log_p) - np.exp(log_rise)
            terms = self._slope_terms(values, z, edge * rise_in_z, in_log_k, in_lapse)
            slopes.append(np.stack(np.broadcast_arrays(*terms), axis=-2) * units)
        yes_slopes, no_slopes = slopes
        if k is None or not self.task.has_three_answers:
            return answers, yes_slopes, no_slopes
        of_direction = direction_answers(z, k, (log_lapse, log_attend))
        terms = self._slope_terms(values, z, *self._odds_slopes(values, z, k, log_rise))
        odds_slopes = np.stack(np.broadcast_arrays(*terms), axis=-2) * units
        second_share, first_share = (np.exp(log_p)[..., None, :] for log_p in of_direction)
        yes_slopes = np.concatenate([yes_slopes, first_share * odds_slopes], axis=-1)
        no_slopes = np.concatenate([no_slopes, -second_share * odds_slopes], axis=-1)
        return _joined(answers, of_direction), yes_slopes, no_slopes

    def _odds_slopes(
        self, values: NamedArrays, z: FloatArray, k: FloatArray, log_rise: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Slopes of log P('second')/P('first') in z, ln k and the coordinate of the lapse rate."""
        log_lapse, log_attend = lapses = self._lapse_logs(values)
        log_second, log_first = unequal_logs(z, k, lapses)
        second = np.exp(log_attend + log_normal(z - k) - log_second)
        first = np.exp(log_attend + log_normal(z + k) - log_first)

        def difference(log_density: FloatArray) -> FloatArray:
            """A density over P('second') minus that over P('first')."""
            return np.exp(log_density - log_second) - np.exp(log_density - log_first)

        in_k = first - second - difference(log_lapse + log_normal(k))
        return second + first, k * in_k, difference(log_rise + log_ndtr(-k))

    def _slope_terms(
        self,
        values: NamedArrays,
        z: FloatArray,
        in_z: FloatArray,
        in_log_k: FloatArray | None,
        in_lapse: FloatArray,
    ) -> list[FloatArray]:
        """Slopes of each pair in the quantities of which the coordinates are multiples.

        They follow from those in z, in ln k (None of which is stronger) and in the lapse rate.
        """
        by_noise = -in_z * z
        by_shift = in_z * np.exp(-self._log_scale_at(values))
        if in_log_k is None:
            terms = [by_noise, in_lapse, by_noise * self.middle]
        else:
            slope_terms = [by_noise * self.middle, in_log_k * self.middle]
            terms = [by_noise, in_log_k, in_lapse, *slope_terms]
        return [*terms, -by_shift, by_shift * self.first]

    def _slope_units(self, values: NamedArrays, lapse_unit: FloatArray) -> FloatArray:
        """Derivatives of those quantities in their coordinates, (rows, points, k)."""
        units = self.units | {"lapse_score": lapse_unit}
        if self.task.has_criterion:
            k = criterion(values["logit_q0"])
            units["logit_q0"] = criterion_slope(values["logit_q0"], k) / k  # of ln k
        columns = [np.atleast_2d(unit) for unit in units.values()]
        return np.stack(np.broadcast_arrays(*columns), axis=-1)

    # --- Prior -----------------------------------------------------------------------------------

    @cached_property
    def priors(self) -> tuple[PriorDensity, ...]:
        """The prior of every coordinate."""
        normal, student = StandardNormal(), StandardStudent()
        contraction = CutNormal(1.0 / self.contraction_sd)
        if not self.task.has_criterion:
            return normal, normal, student, student, contraction
        peak = LogitOfBeta(self.prior.q0_a, self.prior.q0_b)
        return normal, peak, normal, student, student, student, contraction


def _window_and_tails(z: FloatArray, k: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Probability that a noisy distance lies within the criterion, beyond it, and opposite."""
    distance = np.abs(z)
    with np.errstate(invalid="ignore"):
        near = near_edge(distance, k)
    far = -k - distance
    inside = ndtr(near) - ndtr(far)
    # Rounding could turn the difference negative. Here the density over the window is level to 12
    # digits.
    is_narrow = k < 1e-6
    if is_narrow.any():
        inside = np.where(is_narrow, 2.0 * k * _density(distance), inside)
    return inside, ndtr(-near), ndtr(far)


def _joined(first: LogAnswers, second: LogAnswers) -> LogAnswers:
    """The answers to one question of every pair, then those to another one."""
    parts = zip(first, second, strict=True)
    return LogAnswers(*(np.concatenate(part, axis=-1) for part in parts))


def _per_answer(counts: FloatArray, probability: FloatArray) -> FloatArray:
    """Counts over probabilities; an answer never given has 0."""
    counts, probability = np.broadcast_arrays(counts, probability)
    zeros = np.zeros(probability.shape)
    return np.divide(counts, probability, out=zeros, where=counts > 0.0)


def _log_hazard(score: FloatArray) -> FloatArray:
    """Log of phi(u) / (1 - Phi(u))."""
    return log_normal(score) - log_ndtr(-score)


def _density(x: FloatArray) -> FloatArray:
    """Standard normal density."""
    return np.exp(log_normal(x))
