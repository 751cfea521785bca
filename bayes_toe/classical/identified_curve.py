"""The curve of the paper's model (H1) in the coordinates in which a fit moves.

    x = (offset c, logit(p / p_max), log w, logit of q0 or of the lapse rate)
    z = ((s2 - s1) + p (s1 - sbar) - c) / w,   c = p (mu1 - sbar)

No prior plays a role: the likelihood has a maximum in these coordinates, or rises towards an edge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import expit

from bayes_toe.arrays import ArrayPair, FloatArray, IntArray
from bayes_toe.data.study import Subject
from bayes_toe.model.answer_curves import LogAnswers, log_likelihoods, times_counts
from bayes_toe.model.paper_equations import MAX_PULL
from bayes_toe.model.paper_rows import (
    POWERS,
    bell_answers,
    bell_slopes,
    guessing_answers,
    guessing_slopes,
)


@dataclass(frozen=True, eq=False)
class IdentifiedCurve:
    """The likelihood of one subject's pairs; points x have the shape (points, 4).

    Parameters
    ----------
    subject : Subject
    centre : float, optional
        The intensity sbar, natural-log units; by default the mean first stimulus.
    """

    subject: Subject
    centre: float | None = None

    @cached_property
    def sbar(self) -> float:
        """Intensity from which the offset counts, natural-log units."""
        if self.centre is not None:
            return self.centre
        return float(np.average(self.subject.s1, weights=self.subject.n_trials))

    @property
    def share(self) -> str:
        """The name of the fourth parameter: q0 or lapse_rate."""
        return self.subject.task.lapses

    def for_subject(self, subject: Subject) -> IdentifiedCurve:
        """The same centre for other answers or other pairs."""
        return replace(self, subject=subject, centre=self.sbar)

    def distance(self, x: FloatArray) -> FloatArray:
        """Distance z of every pair, (points, 4) -> (points, pairs)."""
        numerator = (self.subject.s2 - self.subject.s1) - x[:, :1]
        numerator = numerator + MAX_PULL * expit(x[:, 1:2]) * (self.subject.s1 - self.sbar)
        with np.errstate(divide="ignore", over="ignore"):
            # In logs, because 0 over a width below the smallest float is 0.
            return np.sign(numerator) * np.exp(np.log(np.abs(numerator)) - x[:, 2:3])

    def log_answers(self, x: FloatArray) -> LogAnswers:
        """Log probability of both answers to every pair, (points, pairs) each."""
        if self.share == "q0":
            return bell_answers(self.distance(x), x[:, 3:])
        return guessing_answers(self.distance(x), x[:, 3:])

    def likelihood_gradient(self, x: FloatArray, n_yes: IntArray) -> ArrayPair:
        """Log likelihood, (points,), and its gradient, (points, 4), of counts (points, pairs).

        With the slope A_z of the log likelihood in z, that in log w is -A_z z.
        """
        z, n_trials = self.distance(x), self.subject.n_trials
        answers = self.log_answers(x)
        curve_slopes = bell_slopes if self.share == "q0" else guessing_slopes
        in_z, in_share = curve_slopes(z, x[:, 3:], answers)
        yes, no = n_yes.astype(np.float64), (n_trials - n_yes).astype(np.float64)
        with np.errstate(over="ignore", invalid="ignore"):  # far out, where nothing changes
            slope_z = times_counts(yes, in_z.yes) + times_counts(no, in_z.no)
            slope_share = times_counts(yes, in_share.yes) + times_counts(no, in_share.no)
            inverse_width, p = np.exp(-x[:, 2:3]), MAX_PULL * expit(x[:, 1:2])
            lever = p * expit(-x[:, 1:2]) * (self.subject.s1 - self.sbar)
            terms = slope_z * inverse_width, slope_z * inverse_width * lever, slope_z * z
            # A slope of 0 falls faster than any factor may grow.
            by_c, by_pull, by_width = (np.where(slope_z == 0.0, 0.0, term) for term in terms)

        columns = -by_c.sum(1), by_pull.sum(1), -by_width.sum(1), slope_share.sum(1)
        value = log_likelihoods(n_yes, n_trials, answers).sum(axis=1)
        return value, np.stack(columns, axis=-1)

    def natural(self, x: FloatArray) -> FloatArray:
        """mu1, sigma_p, sigma_l and q0 or lapse rate at points, (points, 4)."""
        p, width = MAX_PULL * expit(x[:, 1]), np.exp(x[:, 2])
        sigma_p = width * (1.0 - p) ** POWERS[self.share]
        with np.errstate(over="ignore"):  # 1/p beyond the largest float
            inverse_pull = (1.0 + np.exp(-x[:, 1])) / MAX_PULL
        with np.errstate(invalid="ignore"):
            reach = np.where(x[:, 0] == 0.0, 0.0, x[:, 0] * inverse_pull)
        columns = self.sbar + reach, sigma_p, sigma_p * np.sqrt(p) / (1.0 - p), expit(x[:, 3])
        return np.stack(columns, axis=-1)
